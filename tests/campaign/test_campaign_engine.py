"""The engine on processes of this machine: the same results whoever does them, chunks of the right size, clear words."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from campaign_jobs import COLUMNS, Draw, store
from pyarrow import parquet

from sagnac.campaign import engine, work
from sagnac.campaign.chunks import Part, decode
from sagnac.campaign.engine import run
from sagnac.campaign.progress import Watch
from sagnac.campaign.store import Store
from sagnac.campaign.work import MOST_CHUNKS, Job, perform, runs_per_chunk
from sagnac.errors import DataError, InputError

VERSION = work.__version__


def results(folder: Path) -> bytes:
    return (folder / "results.parquet").read_bytes()


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Results of 100 runs by one worker in one piece."""
    folder = tmp_path_factory.mktemp("reference")
    with store(folder) as held:
        run(Draw(refuse=9), held, workers=1, chunk=100)
    return results(folder)


@pytest.mark.parametrize(("workers", "chunk"), [(2, 7), (1, 30), (2, None)])
def test_results_do_not_depend_on_workers_or_chunks(tmp_path, reference, workers, chunk):
    with store(tmp_path) as held:
        run(Draw(refuse=9), held, workers=workers, chunk=chunk)
    assert results(tmp_path) == reference


def test_a_run_without_a_result_is_a_row_with_the_reason(tmp_path, reference):
    (tmp_path / "r.parquet").write_bytes(reference)
    rows = parquet.read_table(tmp_path / "r.parquet").to_pylist()
    assert [r["run"] for r in rows] == list(range(100))
    refused = [r for r in rows if r["status"] != "ok"]
    assert [r["run"] for r in refused] == list(range(8, 100, 9))
    assert refused[0] == {"run": 8, "status": "nothing to be seen in run 8"} | dict.fromkeys(COLUMNS)
    plain = Draw().row(50)
    assert {k: rows[50][k] for k in ("seed", "value", "name", "good")} == {k: plain[k] for k in plain if k != "product"}


def test_progress_is_told_up_to_the_end_and_rows_are_given_in_order(tmp_path):
    told, taken = [], []
    with store(tmp_path) as held:
        run(Draw(), held, workers=1, chunk=10, watch=Watch(lambda *a: told.append(a)), take=taken.append)
    assert told[0] == (0, 100)
    assert told[-1] == (100, 100)
    assert told == sorted(told)
    assert [i for t in taken for i in t["run"].to_pylist()] == list(range(100))


def test_a_campaign_that_is_done_starts_no_worker(tmp_path, monkeypatch):
    with store(tmp_path, 10) as held:
        run(Draw(), held, workers=1, chunk=10)
    monkeypatch.setattr(engine, "LocalCrew", None)
    taken = []
    with store(tmp_path, 10) as held:
        run(Draw(), held, take=taken.append)
    assert sum(map(len, taken)) == 10


@pytest.mark.parametrize("seed", [None, 5])
def test_a_bug_stops_the_campaign_with_the_run_and_how_to_see_it_again(tmp_path, seed):
    with store(tmp_path) as held, pytest.raises(DataError) as caught:
        run(
            Draw(fail=42),
            held,
            workers=1,
            chunk=10,
            seed=seed,
            again=lambda i: f"sagnac campaign run C.toml --only {i}",
        )
    words = str(caught.value)
    named = "run 42 stopped" if seed is None else r"run 42 (seed 5, spawn key 42) stopped"
    assert words.startswith(f"{named} the campaign: ZeroDivisionError: a bug (")
    assert "campaign_jobs.py, line" in words
    assert "to see it again: sagnac campaign run C.toml --only 42; " in words
    assert words.endswith(f"40 of 100 runs are safe in {tmp_path}: the same command goes on from there")
    assert "ZeroDivisionError" in caught.value.__notes__[0]


@dataclass(frozen=True)
class Odd(Draw):
    """Rows with something that the columns do not name."""

    def row(self, index: int) -> Mapping[str, Any]:
        return {**super().row(index), "more": 1}


class Unready(Draw):
    """Does not come out of its pickle."""

    def __reduce__(self) -> tuple[Any, ...]:
        return int, ("not a task",)


class Environment(Draw):
    """What a worker finds around it."""

    @property
    def columns(self) -> Mapping[str, str]:
        return {"blas": "string", "numba": "string", "pid": "int64"}

    def row(self, index: int) -> Mapping[str, Any]:
        return {
            "blas": os.environ.get("OPENBLAS_NUM_THREADS"),
            "numba": os.environ.get("NUMBA_NUM_THREADS"),
            "pid": os.getpid(),
        }


@pytest.mark.parametrize(
    ("task", "words"),
    [
        (Odd(), "run 0: a row has more, which"),
        (Unready(), "a worker cannot load the task: ValueError: invalid literal"),
    ],
)
def test_a_task_that_cannot_be_used_is_refused(tmp_path, task, words):
    with store(tmp_path) as held, pytest.raises(InputError, match=words):
        run(task, held, workers=1)


def test_workers_have_one_thread_each_and_ours_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    with Store(tmp_path, {}, 4, Environment().columns) as held:
        run(Environment(), held, workers=1, chunk=4)
    found = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert {(r["blas"], r["numba"]) for r in found} == {("1", "1")}
    assert os.getpid() not in {r["pid"] for r in found}
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"
    assert "NUMBA_NUM_THREADS" not in os.environ


def test_no_workers_are_too_few(tmp_path):
    with store(tmp_path) as held, pytest.raises(InputError, match="0 workers: take one at least"):
        run(Draw(), held, workers=0)


def test_a_script_that_starts_itself_again_in_each_worker_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from campaign_jobs import Draw, store\n"
        "from sagnac.campaign.engine import run\n"
        f"with store({str(tmp_path / 'out')!r}) as held:\n"
        "    run(Draw(), held, workers=1)\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "workers end before they have done anything (it ended with status 1)" in done.stderr
    assert 'if __name__ == "__main__":' in done.stderr


# ------------------------------------------------------------------------------------------- the size of a chunk


@pytest.mark.parametrize(
    ("seconds", "runs", "columns", "expected"),
    [
        (2e-3, 10_000, 60, 500),  # a second of work
        (0.4, 1000, 60, 3),  # never less than half a second
        (0.5, 1000, 60, 1),  # a run so long is a chunk by itself
        (900.0, 1000, 60, 1),
        (2e-3, 100, 60, 100),  # no more than there are
        (1e-6, 10**6, 10, 104_858),  # 2^20 values at most
        (1.0, 10**6, 60, 10**6 // MOST_CHUNKS),  # no more than so many files
        (0.0, 10, 60, 10),
    ],
)
def test_a_chunk_is_a_second_of_work(seconds, runs, columns, expected):
    assert runs_per_chunk(seconds, runs, columns) == expected


@dataclass(frozen=True)
class Timed(Draw):
    """Takes its time on a clock of its own."""

    seconds: float = 0.0

    def row(self, index: int) -> Mapping[str, Any]:
        _now[0] += self.seconds * (100.0 if index == 0 else 1.0)  # the first run compiles
        return super().row(index)


_now = [0.0]


@pytest.mark.parametrize("seconds", [1e-3, 0.04, 0.3, 2.0])
def test_the_pilot_times_runs_without_the_first(monkeypatch, seconds):
    monkeypatch.setattr(work.time, "perf_counter", lambda: _now[0])
    began = _now[0]
    job = Job(Part(0, 5000), "ff", pilot=True)
    reply = perform(pickle.dumps(Timed(seconds=seconds)), job, VERSION)
    assert reply.kind == "timed"
    assert reply.seconds == pytest.approx(seconds)
    assert _now[0] - began <= max(100 * seconds + 0.3, 104 * seconds)  # it ends soon
    # of long runs nothing is thrown away: each is a chunk
    parts = [part for part, _ in reply.chunks]
    assert len(parts) == (4 if seconds == 2.0 else 0)
    assert [decode(data)[:2] for _, data in reply.chunks] == [("ff", part) for part in parts]


def test_the_pilot_looks_all_over_the_campaign():
    seen = []
    for run_ in work._spread(0, 1000):
        seen.append(run_)
        if len(seen) == 20:
            break
    assert len({i // 100 for i in seen}) == 10
    assert sorted(work._spread(5, 9)) == [6, 7, 8]
    assert list(work._spread(0, 1)) == []


def test_long_runs_of_the_pilot_are_kept(tmp_path):
    with store(tmp_path, 3) as held:
        run(Draw(pause=0.51), held, workers=1)
        assert held.runs_per_chunk == 1
    assert len(list((tmp_path / "chunks").iterdir())) == 3


def test_one_run_is_a_campaign(tmp_path):
    with store(tmp_path, 1) as held:
        run(Draw(), held)
    assert parquet.read_table(tmp_path / "results.parquet")["run"].to_pylist() == [0]


def test_a_worker_with_another_version_does_nothing():
    reply = perform(pickle.dumps(Draw()), Job(Part(0, 1), "ff"), "99.0")
    assert reply.kind == "unfit"
    assert reply.text == f"the worker has Sagnac {VERSION}, the driver 99.0"
