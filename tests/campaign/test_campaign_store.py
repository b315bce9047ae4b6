"""The folder of a campaign: what is kept, what is refused, what is done again. No workers here: chunks are made in place."""

from __future__ import annotations

import errno
import json
import math
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from campaign_jobs import COLUMNS, Draw, store
from pyarrow import parquet

from sagnac.campaign import chunks
from sagnac.campaign import store as stores
from sagnac.campaign.chunks import Part
from sagnac.campaign.store import Store, read_chunks, read_manifest, read_results
from sagnac.campaign.work import Job, perform
from sagnac.errors import DataError, InputError

KINDS = {"a": "double", "s": "string"}
VERSION = stores.__version__


def rows(part: Part, **more: object) -> list[dict[str, object]]:
    return [{"run": i, "status": "ok", "a": i / 3.0, "s": f"s{i}"} | more for i in range(*part)]


def chunk(held: Store, part: Part) -> bytes:
    return chunks.encode(rows(part), KINDS, part, held.fingerprint)


def small(folder: Path, runs: int = 10, **identity: str) -> Store:
    return Store(folder, {"scenario": "norm", **identity}, runs, KINDS)


def fill(held: Store, size: int, limit: int | None = None) -> None:
    """Start, if need be, and put the missing chunks."""
    if held.runs_per_chunk is None:
        held.start(size)
    for i, part in enumerate(held.missing()):
        if i == limit:
            return
        held.put(part, chunk(held, part))


def files(folder: Path) -> list[Path]:
    return sorted((folder / "chunks").iterdir())


# ---------------------------------------------------------------------------------------------------- one chunk


def test_a_chunk_reads_back_and_says_what_it_is():
    part = Part(3, 5)
    made = [{"run": 3, "status": "ok", "a": math.nan, "s": "x"}, {"run": 4, "status": "too few positions"}]
    data = chunks.encode(made, KINDS, part, "ff")
    assert data == chunks.encode(made, KINDS, part, "ff")
    campaign, told, table = chunks.decode(data)
    assert (campaign, told) == ("ff", part)
    first, second = table.to_pylist()
    assert first["run"] == 3
    assert math.isnan(first["a"])  # not a number is not the same as missing
    assert second == {"run": 4, "status": "too few positions", "a": None, "s": None}


@pytest.mark.parametrize(
    ("row", "words"),
    [({"run": 0, "b": 1.0}, "run 0: a row has b"), ({"run": 0, "a": "text"}, "run 0: column a is not double")],
)
def test_rows_that_are_not_those_of_the_task_are_refused(row, words):
    with pytest.raises(ValueError, match=words):
        chunks.encode([row], KINDS, Part(0, 1), "ff")


@pytest.mark.parametrize("data", [b"", b"PAR1", b"x" * 1000])
def test_bytes_that_are_no_chunk_are_refused(data):
    with pytest.raises(ValueError, match="no chunk"):
        chunks.decode(data)


def test_a_chunk_without_one_of_its_runs_is_refused():
    data = chunks.encode(rows(Part(0, 2)), KINDS, Part(0, 3), "ff")
    with pytest.raises(ValueError, match="does not hold runs 0 to 2"):
        chunks.decode(data)


# ----------------------------------------------------------------------------------------------------- the folder


def test_a_second_start_goes_on_where_the_first_one_ended(tmp_path):
    with small(tmp_path) as held:
        assert held.runs_per_chunk is None
        fill(held, 4, limit=2)
        assert held.done == 8
    with small(tmp_path) as held:
        assert held.runs_per_chunk == 4
        assert held.done == 8
        assert list(held.missing()) == [Part(8, 10)]
        assert not held.finish()
        assert not (tmp_path / "results.parquet").exists()
        fill(held, 99)
        assert held.finish()
    table = parquet.read_table(tmp_path / "results.parquet")
    assert table["run"].to_pylist() == list(range(10))
    assert table["a"].to_pylist() == [i / 3.0 for i in range(10)]
    assert len(files(tmp_path)) == 3


def test_the_bytes_of_the_results_do_not_depend_on_chunks_or_their_order(tmp_path, monkeypatch):
    monkeypatch.setattr(stores, "GROUP", 16)
    made, taken = [], []
    for size in (1, 3, 16, 17, 50, 100):
        with small(tmp_path / str(size), 100) as held:
            held.start(size)
            for part in reversed(list(held.missing())):
                held.put(part, chunk(held, part))
            tables = []
            assert held.finish(tables.append)
        made.append((tmp_path / str(size) / "results.parquet").read_bytes())
        taken.append(tables)
    assert len(set(made)) == 1
    assert [len(t) for t in taken[0]] == [16] * 6 + [4]
    assert all(tables == taken[0] for tables in taken)
    found = parquet.ParquetFile(tmp_path / "1" / "results.parquet")
    assert found.num_row_groups == 7
    assert VERSION.encode() not in found.metadata.metadata[b"sagnac.campaign"]  # a hash, no date, nothing of the moment


def test_files_in_chunks_are_named_by_the_hash_of_what_is_in_them(tmp_path):
    with small(tmp_path) as held:
        fill(held, 5)
    told = subprocess.run(["sha256sum", *files(tmp_path)], capture_output=True, text=True, check=True).stdout
    assert [line.split()[0] + ".parquet" for line in told.splitlines()] == [p.name for p in files(tmp_path)]


def test_another_campaign_is_refused_with_what_differs(tmp_path):
    with small(tmp_path, seed="1", table="x" * 1000) as held:
        fill(held, 5)
    with pytest.raises(
        InputError, match=r"another campaign: seed is 1 there, 2 here, table differs; take another folder"
    ):
        small(tmp_path, seed="2", table="y" * 1000).__enter__()
    with pytest.raises(InputError, match="runs is 10 there, 11 here"):
        small(tmp_path, 11, seed="1", table="x" * 1000).__enter__()
    assert len(files(tmp_path)) == 2


def test_another_version_is_another_campaign(tmp_path, monkeypatch):
    with small(tmp_path) as held:
        fill(held, 5)
    monkeypatch.setattr(stores, "__version__", "99.0")
    with pytest.raises(InputError, match=f"sagnac is {VERSION} there, 99.0 here"):
        small(tmp_path).__enter__()


@pytest.mark.parametrize("name", ["chunks", "results.parquet"])
def test_a_folder_with_results_of_nobody_knows_what_is_refused(tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=f"has {name}, but no campaign.json"):
        small(tmp_path).__enter__()


def test_a_torn_manifest_is_refused(tmp_path):
    (tmp_path / "campaign.json").write_text("{")
    with pytest.raises(InputError, match="not a JSON file"):
        small(tmp_path).__enter__()


def test_a_campaign_without_runs_is_refused(tmp_path):
    with pytest.raises(InputError, match="a campaign of 0 runs"):
        small(tmp_path, 0)


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make the folder"):
        small(tmp_path / "file" / "x").__enter__()


# -------------------------------------------------------------------------------------------------------- damage


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-10])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def exchange(path: Path) -> None:
    path.write_bytes(next(p for p in path.parent.iterdir() if p != path).read_bytes())


@pytest.mark.parametrize("damage", [flip, cut, empty, exchange])
def test_a_damaged_chunk_is_thrown_away_and_done_again(tmp_path, damage):
    with small(tmp_path) as held:
        fill(held, 2)
    first = files(tmp_path)[0]
    damage(first)
    with small(tmp_path) as held:
        assert held.notes == [f"{first}: damaged; its runs are done again"]
        assert held.done == 8
        assert not first.exists()
        fill(held, 2)
        assert held.finish()
    assert parquet.read_table(tmp_path / "results.parquet")["run"].to_pylist() == list(range(10))


def test_damage_that_comes_later_is_found_before_the_results_are_written(tmp_path):
    with small(tmp_path) as held:
        fill(held, 2)
        flip(files(tmp_path)[3])
        taken = []
        assert not held.finish(taken.append)
        assert not taken
        assert held.done == 8
        fill(held, 2)
        assert held.finish(taken.append)
        assert sum(map(len, taken)) == 10


def test_a_whole_chunk_of_another_campaign_is_not_taken(tmp_path):
    with small(tmp_path / "other", seed="2") as other:
        fill(other, 5)
    with small(tmp_path / "here", seed="1") as held:
        fill(held, 5, limit=1)
    stranger = files(tmp_path / "other")[1]
    (tmp_path / "here" / "chunks" / stranger.name).write_bytes(stranger.read_bytes())
    with small(tmp_path / "here", seed="1") as held:
        assert held.done == 5
        assert len(held.notes) == 1


def test_a_chunk_parted_otherwise_is_not_taken(tmp_path):
    with small(tmp_path) as held:
        held.start(5)
        with pytest.raises(DataError, match="runs 2 to 3: what came back belongs to another part"):
            held.put(Part(2, 4), chunk(held, Part(2, 4)))
        with pytest.raises(DataError, match="runs 0 to 4: what came back belongs"):
            held.put(Part(0, 5), chunks.encode(rows(Part(0, 5)), KINDS, Part(0, 5), "other"))
    assert not (tmp_path / "chunks").exists()


def test_what_a_killed_driver_was_writing_is_swept_away(tmp_path):
    with small(tmp_path) as held:
        fill(held, 5, limit=1)
    left = [tmp_path / "chunks" / ".0123.parquet.x8z.parquet", tmp_path / ".results.parquet.y9_.parquet"]
    for path in left:
        path.write_bytes(b"PAR1")
    with small(tmp_path) as held:
        assert not any(path.exists() for path in left)
        assert (tmp_path / ".lock").exists()
        assert not held.notes
        assert held.done == 5


def test_results_that_were_changed_are_written_again(tmp_path):
    with small(tmp_path) as held:
        fill(held, 5)
        held.finish()
    good = (tmp_path / "results.parquet").read_bytes()
    flip(tmp_path / "results.parquet")
    with small(tmp_path) as held:
        assert held.finish()
    assert (tmp_path / "results.parquet").read_bytes() == good


def test_a_full_disk_leaves_nothing_half_written(tmp_path, monkeypatch):
    def full(self: Path, data: bytes) -> int:
        with self.open("wb") as stream:
            stream.write(data[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    with small(tmp_path) as held:
        fill(held, 5, limit=1)
        with monkeypatch.context() as patched:
            patched.setattr(Path, "write_bytes", full)
            with pytest.raises(InputError, match="cannot write .*: No space left on device"):
                fill(held, 5)
        assert len(files(tmp_path)) == 1
        assert held.done == 5
        fill(held, 5)
        assert held.finish()


# ------------------------------------------------------------------------------------------------ several at once


def test_two_drivers_at_once_the_second_is_refused(tmp_path):
    with small(tmp_path) as held:
        fill(held, 5, limit=1)
        with pytest.raises(InputError, match=r"process \d+ on .* is at work on it"):
            small(tmp_path).__enter__()
        fill(held, 5)
    with small(tmp_path) as again:  # it is free afterwards
        assert again.done == 10


def test_the_lock_of_a_killed_driver_is_free(tmp_path):
    code = (
        "import sys, pathlib; from sagnac.campaign.lock import locked\n"
        f"with locked(pathlib.Path({str(tmp_path / '.lock')!r}), 'x'):\n"
        "    print('held', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=f"process {other.pid} on"):
            small(tmp_path).__enter__()
        other.kill()
        other.wait()
    with small(tmp_path) as held:
        assert held.done == 0


def test_a_campaign_under_way_can_be_looked_at(tmp_path):
    with small(tmp_path) as held:
        fill(held, 2, limit=3)
        flip(files(tmp_path)[0])
        found = list(read_chunks(tmp_path, read_manifest(tmp_path)))
        assert len(found) == 2
        assert {c.part for c in found} < {Part(0, 2), Part(2, 4), Part(4, 6)}
        assert len(files(tmp_path)) == 3  # nothing is changed by looking
        fill(held, 2)
        assert not held.finish()
        fill(held, 2)
        assert held.finish()
    assert [len(t) for t in read_results(tmp_path)] == [10]


def test_a_folder_without_a_campaign_is_named(tmp_path):
    with pytest.raises(InputError, match="cannot read the campaign"):
        read_manifest(tmp_path)


def test_the_manifest_tells_what_is_in_the_folder(tmp_path):
    with Store(tmp_path, {"seed": "1"}, 10, KINDS, {"kind": "norm"}) as held:
        held.start(5)
    table = json.loads((tmp_path / "campaign.json").read_text())
    assert table["schema"] == "sagnac/campaign/1"
    assert table["runs"] == 10
    assert table["runs_per_chunk"] == 5
    assert table["identity"]["seed"] == "1"
    assert table["about"] == {"kind": "norm"}
    assert read_manifest(tmp_path).columns == KINDS


# the whole way of a chunk but for the process
def test_what_a_worker_makes_is_what_is_kept(tmp_path):
    with store(tmp_path, 20) as held:
        held.start(20)
        (part,) = held.missing()
        reply = perform(pickle.dumps(Draw(refuse=7)), Job(part, held.fingerprint), VERSION)
        assert reply.kind == "done"
        held.put(*reply.chunks[0])
        assert held.finish()
    table = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert [r["status"] for r in table].count("ok") == 18
    assert table[6] == {"run": 6, "status": "nothing to be seen in run 6"} | dict.fromkeys(COLUMNS)
