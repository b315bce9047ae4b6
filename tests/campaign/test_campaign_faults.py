"""Killed workers, killed drivers, full disks: nothing lost, nothing double, and the next start goes on."""

from __future__ import annotations

import errno
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from campaign_jobs import Draw, store
from pyarrow import parquet

from sagnac.campaign import engine
from sagnac.campaign import store as stores
from sagnac.campaign.engine import run
from sagnac.campaign.progress import Watch
from sagnac.errors import DataError, InputError

PATIENCE = 120.0  # s, for what takes no time on a quiet machine

# A driver as a process of its own, that says how far it is.
DRIVER = """
import signal
import sys
from pathlib import Path
from campaign_jobs import Draw, store
from sagnac.campaign.engine import run
from sagnac.campaign.progress import Watch
from sagnac.errors import InputError

signal.signal(signal.SIGINT, signal.default_int_handler)  # tests that a shell runs in the background inherit that it is ignored
folder, scheduler, gate = sys.argv[1:]

def say(*words):
    global gate
    print(*words, flush=True)
    if gate and isinstance(words[0], int) and words[0] >= 20:
        gate = ""
        sys.stdin.readline()

try:
    with store(Path(folder), 400) as held:
        who = {"scheduler": scheduler} if scheduler else {"workers": 2}
        run(Draw(pause=0.002), held, **who, chunk=4, watch=Watch(say, say))
except InputError as error:
    say("refused:", error)
"""


@contextmanager
def driver(folder: Path, scheduler: str = "", *, gate: bool = False) -> Iterator[subprocess.Popen[str]]:
    """A driver of 400 runs in chunks of 4, in a process group of its own; with a gate it waits for a line at 20 runs."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-c", DRIVER, str(folder), scheduler, "gate" if gate else ""]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, env=environment, start_new_session=True, **pipes) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def some_way(process: subprocess.Popen[str], least: int = 20) -> int:
    """Runs that are safe, when it is so many."""
    assert process.stdout is not None
    for line in process.stdout:
        done, _, runs = line.partition(" ")
        if done.isdigit() and int(done) >= least:
            assert int(done) < int(runs)
            return int(done)
    raise AssertionError("the driver ended too soon")


def whole(folder: Path) -> bytes:
    """The results, each run once."""
    table = parquet.read_table(folder / "results.parquet")
    assert table["run"].to_pylist() == list(range(len(table)))
    return (folder / "results.parquet").read_bytes()


def chunk_files(folder: Path) -> dict[str, int]:
    return {p.name: p.stat().st_mtime_ns for p in (folder / "chunks").glob("[!.]*")}


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Results of 400 runs that nothing happens to."""
    folder = tmp_path_factory.mktemp("reference")
    with store(folder, 400) as held:
        run(Draw(), held, workers=2, chunk=100)
    return whole(folder)


def go_on(folder: Path, **task: float) -> list[str]:
    """Start again; what was said."""
    notes: list[str] = []
    with store(folder, 400) as held:
        run(Draw(**task), held, workers=2, watch=Watch(note=notes.append))
    return notes


# ------------------------------------------------------------------------------------------------------- workers


def test_a_worker_killed_by_its_process_id_in_the_middle(tmp_path, reference):
    killed, notes = [], []

    def progress(done: int, runs: int) -> None:
        if done >= 40 and not killed:
            worker = multiprocessing.active_children()[0]
            assert worker.pid is not None
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    with store(tmp_path, 400) as held:
        run(Draw(pause=0.002), held, workers=2, chunk=10, watch=Watch(progress, notes.append))
    assert whole(tmp_path) == reference
    assert len(chunk_files(tmp_path)) == 40
    assert killed[0] not in psutil.pids()
    lost = "a worker was lost (it was ended by SIGKILL, perhaps for want of memory); once more: runs "
    assert all(note.startswith(lost) for note in notes[:1])  # none if it had just handed over its chunk
    assert len(notes) <= 1
    assert multiprocessing.active_children() == []


def test_a_run_that_kills_its_worker_once_is_done_by_another(tmp_path, reference):
    notes = []
    with store(tmp_path, 400) as held:
        task = Draw(kill=205, once=str(tmp_path / "once"))
        run(task, held, workers=2, chunk=10, watch=Watch(note=notes.append))
    assert whole(tmp_path) == reference
    lost = "a worker was lost (it was ended by SIGKILL, perhaps for want of memory); "
    assert notes == [f"{lost}once more: runs 200 to 209"]


def test_runs_that_kill_every_worker_are_named(tmp_path, reference):
    with store(tmp_path, 400) as held, pytest.raises(DataError) as caught:
        run(Draw(kill=205), held, workers=2, chunk=10, again=lambda i: f"--only {i}")
    words = str(caught.value)
    assert words.startswith("runs 200 to 209 were on 3 workers that died (it was ended by SIGKILL")
    assert "to see what happens: --only 200; " in words
    assert multiprocessing.active_children() == []
    assert not go_on(tmp_path)  # what was done counts, whoever does the rest
    assert whole(tmp_path) == reference


def test_a_pilot_that_kills_its_worker_is_done_again(tmp_path, reference):
    notes = []
    with store(tmp_path, 400) as held:
        run(Draw(kill=0, once=str(tmp_path / "once")), held, workers=1, watch=Watch(note=notes.append))
    assert whole(tmp_path) == reference
    assert len(notes) == 1


def test_a_pilot_that_kills_every_worker_is_named(tmp_path):
    with store(tmp_path, 400) as held, pytest.raises(DataError, match="the first runs, .* were on 3 workers that died"):
        run(Draw(kill=0), held, workers=1, again=lambda i: f"--only {i}")
    assert not (tmp_path / "campaign.json").exists()


# ------------------------------------------------------------------------------------------------------- drivers


def test_a_killed_driver_leaves_no_workers_and_loses_chunks_in_flight_at_most(tmp_path, reference):
    with driver(tmp_path) as process:
        done = some_way(process)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        process.wait(PATIENCE)
    _, alive = psutil.wait_procs(workers, PATIENCE)
    assert not alive
    before = chunk_files(tmp_path)
    assert len(before) * 4 >= done
    assert not go_on(tmp_path)
    assert whole(tmp_path) == reference
    after = chunk_files(tmp_path)
    assert before.items() <= after.items()  # nothing is done again
    assert len(after) == 100


def test_interrupting_stops_it_and_says_how_to_go_on(tmp_path, reference):
    with driver(tmp_path, gate=True) as process:
        some_way(process)
        workers = psutil.Process(process.pid).children(recursive=True)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to the workers as well
        said, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == -signal.SIGINT  # as Python ends by a KeyboardInterrupt
    note = next(line for line in said.splitlines() if line.startswith("stopped; "))
    assert note.endswith(f"of 400 runs are safe in {tmp_path}: the same command goes on from there")
    _, alive = psutil.wait_procs(workers, PATIENCE)
    assert not alive
    assert list((tmp_path / "chunks").glob(".*")) == []
    before = chunk_files(tmp_path)
    go_on(tmp_path)
    assert whole(tmp_path) == reference
    assert before.items() <= chunk_files(tmp_path).items()


def test_two_drivers_at_once(tmp_path, reference):
    with driver(tmp_path, gate=True) as process:
        some_way(process)
        with pytest.raises(InputError, match=f"process {process.pid} on .* is at work on it"):
            go_on(tmp_path)
        process.communicate("\n", timeout=PATIENCE)
    assert process.returncode == 0
    assert whole(tmp_path) == reference


# ---------------------------------------------------------------------------------------------------------- disks


def test_a_disk_that_fills_up_in_the_middle(tmp_path, reference, monkeypatch):
    written = []
    write = Path.write_bytes

    def full(self: Path, data: bytes) -> int:
        if len(written) >= 10:
            write(self, data[:100])
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(self)
        return write(self, data)

    with monkeypatch.context() as patched, store(tmp_path, 400) as held:
        patched.setattr(Path, "write_bytes", full)
        with pytest.raises(InputError) as caught:
            run(Draw(), held, workers=2, chunk=10)
    words = str(caught.value)
    assert "No space left on device; 100 of 400 runs are safe" in words
    assert words.endswith("the same command goes on from there")
    before = chunk_files(tmp_path)
    assert len(before) == 10
    assert list((tmp_path / "chunks").glob(".*")) == []
    assert not go_on(tmp_path)
    assert whole(tmp_path) == reference
    assert before.items() <= chunk_files(tmp_path).items()


def test_a_disk_that_has_no_room_for_the_results(tmp_path, reference):
    """A real limit of the system, on the size of files: chunks are below it, the results are not."""
    with store(tmp_path, 400) as held:
        held.start(10)
        old = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (8000, old[1]))
        try:
            with pytest.raises(InputError, match=r"cannot write .*results.parquet: .*File too large"):
                run(Draw(), held, workers=2)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert len(chunk_files(tmp_path)) == 40
    assert not [p for p in tmp_path.iterdir() if "results" in p.name]
    go_on(tmp_path)
    assert whole(tmp_path) == reference


def test_a_chunk_damaged_between_two_starts(tmp_path, reference):
    with store(tmp_path, 400) as held, pytest.raises(DataError):
        run(Draw(fail=300), held, workers=1, chunk=50)
    victim = sorted((tmp_path / "chunks").iterdir())[2]
    victim.write_bytes(victim.read_bytes()[:-1] + b"x")
    assert go_on(tmp_path) == [f"{victim}: damaged; its runs are done again"]
    assert whole(tmp_path) == reference


def test_results_that_vanish_are_written_again_without_any_run(tmp_path, reference):
    with store(tmp_path, 400) as held:
        run(Draw(), held, workers=2, chunk=50)
    (tmp_path / "results.parquet").unlink()
    go_on(tmp_path, fail=0)  # it would raise
    assert whole(tmp_path) == reference


def test_a_worker_that_hangs_is_named_once(tmp_path, reference, monkeypatch):
    monkeypatch.setattr(engine, "_PATIENCE", 2.0)
    stopped, notes = [], []

    def progress(done: int, runs: int) -> None:
        if done >= 40 and not stopped:
            stopped.append(multiprocessing.active_children()[0].pid)
            os.kill(stopped[0], signal.SIGSTOP)

    def note(text: str) -> None:
        notes.append(text)
        if f"with process {stopped[0]} since" in text:
            os.kill(stopped[0], signal.SIGKILL)

    with store(tmp_path, 400) as held:
        run(Draw(pause=0.002), held, workers=2, chunk=10, watch=Watch(progress, note))
    assert whole(tmp_path) == reference
    late = [n for n in notes if f"with process {stopped[0]} since" in n]
    assert len(late) == 1
    assert late[0].startswith("runs ")
    assert "s are usual" in late[0]


def test_a_task_that_cannot_be_sent_is_named(tmp_path):
    class Local(Draw):
        pass

    with store(tmp_path, 400) as held, pytest.raises(InputError, match="the task cannot be sent to workers: .*Local"):
        run(Local(), held, workers=1)


def test_workers_and_a_scheduler_are_not_both_given(tmp_path):
    with store(tmp_path, 400) as held, pytest.raises(InputError, match="give one of them"):
        run(Draw(), held, workers=1, scheduler="tcp://127.0.0.1:8786")


def test_other_packages_than_at_the_beginning_are_told(tmp_path, monkeypatch):
    with store(tmp_path, 400) as held:
        held.start(100)
    monkeypatch.setattr(stores, "packages", lambda: {"numpy": "99.0"})
    with store(tmp_path, 400) as held:
        assert len(held.notes) == 1
        assert held.notes[0].startswith("not as when it was begun: numpy 99.0 here, ")
