"""Several writers at once lose nothing, and one that is killed leaves nothing half."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from registered import DAY, add, calibration, candidate

from sagnac.registry import open_registry

HERE = str(Path(__file__).parent)
WRITERS, EACH = 4, 50

# Adds calibrations one by one; half of them are of a unit of its own, half of one that all share. What all writers have in common
# is every tenth file.
WRITER = """
import sys
sys.path.insert(0, {here!r})
from registered import candidate
from sagnac.registry import open_registry
me, where = int(sys.argv[1]), sys.argv[2]
every = [
    candidate("shared" if i % 2 else f"own {{me}}", f"2025-01-01T{{me:02d}}:{{i:02d}}:00+00:00")
    if i % 10
    else candidate("common", f"2025-01-02T00:{{i:02d}}:00+00:00")
    for i in range({each})
]
print("ready", flush=True)
sys.stdin.readline()
with open_registry(where, write=True) as registry:
    print(sum(one.new for c in every for one in registry.add([c])))
"""

# Writes a batch and stops in the middle of the transaction.
HALF = """
import sys, time
sys.path.insert(0, {here!r})
from registered import candidate
from sagnac.registry import open_registry, writer
with open_registry(sys.argv[1], write=True) as registry:
    with registry._database.writing() as connection:
        writer.add(connection, [candidate("half", f"2025-02-01T00:00:{{i:02d}}+00:00") for i in range(60)])
        print("in the middle", flush=True)
        time.sleep(60)
"""


def start(code: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", code.format(here=HERE, each=EACH), *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_four_writers_at_once_lose_nothing(where):
    writers = [start(WRITER, me, where) for me in range(WRITERS)]
    for w in writers:
        assert w.stdout.readline() == "ready\n"
    for w in writers:  # all at once, on a registry that none of them finds made
        w.stdin.write("go\n")
        w.stdin.flush()
    told = [w.communicate(timeout=120) for w in writers]
    assert [w.returncode for w in writers] == [0] * WRITERS, told
    common = EACH // 10
    with open_registry(where) as registry:
        found = {f.unit.serial: f.count for f in registry.listing()}
        own = {f"own {me}": EACH // 2 - common for me in range(WRITERS)}
        assert found == own | {"shared": WRITERS * EACH // 2, "common": common}
        assert sum(int(out) for out, _ in told) == sum(found.values())
        entries = [e for f in registry.listing() for e in registry.entries(f.unit)]
        assert registry.history().value.size == 4 * len(entries)
        for entry in entries:
            assert registry.calibration(entry) == calibration(entry.unit.serial, entry.created.isoformat())


def test_a_writer_killed_in_the_middle_leaves_nothing(where):
    with open_registry(where, write=True) as registry:
        (before,) = add(registry, candidate())
    victim = start(HALF, where)
    assert victim.stdout.readline() == "in the middle\n"
    with open_registry(where) as registry:  # who reads meanwhile sees nothing of it, and does not wait
        assert [f.latest for f in registry.listing()] == [before]
    victim.kill()
    victim.communicate()
    with open_registry(where, write=True) as registry:
        assert [f.latest for f in registry.listing()] == [before]
        assert registry.history().value.size == 4
        (after,) = add(registry, candidate(created=DAY.format(2)))
        assert registry.entries(before.unit) == [before, after]


def test_a_reader_keeps_what_it_sees_while_others_write(where):
    with open_registry(where, write=True) as registry, open_registry(where) as other:
        add(registry, candidate())
        with other._database.reading() as connection:
            from sagnac.registry import queries

            seen = queries.units_where(connection, None, None)
            add(registry, candidate("0002"))
            assert queries.units_where(connection, None, None) == seen
        assert len(other.listing()) == 2


@pytest.mark.parametrize("wait", [0.2])
def test_who_waits_too_long_is_told(where, monkeypatch, wait):
    from sagnac.errors import InputError
    from sagnac.registry import database

    with open_registry(where, write=True) as registry:
        monkeypatch.setattr(database, "WAIT", wait)
        with (
            open_registry(where, write=True) as other,
            registry._database.writing(),
            pytest.raises(InputError, match="others have been writing for too long; try again .*nothing of it is kept"),
        ):
            add(other, candidate())
