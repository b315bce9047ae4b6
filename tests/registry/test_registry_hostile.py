"""Registries that are no registries, files that are no calibrations, disks that are full, names that hurt."""

from __future__ import annotations

import multiprocessing
import os
import sqlite3
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from postgresql_server import PASSWORD
from registered import DAY, MG, add, calibration, candidate, content
from sqlalchemy import event, make_url

from sagnac.errors import InputError, SagnacError
from sagnac.registry import add_files, database, open_registry, store
from sagnac.registry.address import address, default_file
from sagnac.registry.candidates import Lacking, find, of_content, read
from sagnac.registry.dates import parse

# -------------------------------------------------------------------------------------------- where a registry is


def test_where_the_registry_is(monkeypatch, tmp_path):
    monkeypatch.setenv("SAGNAC_REGISTRY", str(tmp_path / "said.db"))
    assert address().path == tmp_path / "said.db"
    assert address(tmp_path / "other.db").path == tmp_path / "other.db"
    monkeypatch.setenv("SAGNAC_REGISTRY", "")
    assert address().path == default_file()


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="folders of Linux")
def test_the_folder_of_the_user(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert default_file() == tmp_path / "sagnac" / "registry.db"
    monkeypatch.setenv("XDG_DATA_HOME", "relative")  # to be ignored, as the specification of these folders says
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert default_file() == tmp_path / "home" / ".local" / "share" / "sagnac" / "registry.db"
    with open_registry(default_file(), write=True):
        pass
    assert default_file().is_file()


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("mysql://root:secret@host/db", "kept in SQLite or PostgreSQL, not in 'mysql'"),
        ("postgresql://user:secret@host:port/db", r"cannot read the URL \(postgresql://...\)"),
        ("postgresql:/bob:secret@host/db", "neither a file nor a URL"),
        ("postgresql+psycopg:/bob:secret@host/db", "neither a file nor a URL"),
        ("host=db password=secret dbname=x", "neither a file nor a URL"),
        ("postgresql://bob:p@secret@nohost.invalid", "more than one @; write %40"),
        ("postgresql://bob:p@x/secret@nohost.invalid/db", "more than one @; write %40"),
        ("sqlite://", "names no file"),
        ("  ", "it is empty"),
    ],
)
def test_a_url_of_no_use(url, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=said) as caught:
        open_registry(url, write=True)
    assert "secret" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["C:/fleet.db", "C:\\fleet.db", "fleet:2.db", "/data/host=a/fleet.db"])
def test_what_looks_like_no_url_is_a_file(name):
    assert str(address(name)) == str(Path(name))


def test_a_url_of_a_file(tmp_path):
    with open_registry(f"sqlite:///{tmp_path / 'fleet.db'}", write=True) as registry:
        add(registry, candidate())
    with open_registry(tmp_path / "fleet.db") as registry:
        assert len(registry.listing()) == 1


@pytest.mark.parametrize("name", ["a b.db", "a?mode=ro#x.db", "ü%41.db", "';.db"])
def test_odd_names_of_files(tmp_path, name):
    with open_registry(tmp_path / name, write=True) as registry:
        add(registry, candidate())
    assert (tmp_path / name).is_file()
    with open_registry(tmp_path / name) as registry:
        assert len(registry.listing()) == 1


# --------------------------------------------------------------------------------------------- what is no registry


@pytest.mark.parametrize("write", [False, True])
@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda p: p.mkdir(), "is a folder; a registry is one file"),
        (lambda p: p.write_bytes(content()), "no registry: this is not a file of SQLite"),
        (lambda p: p.write_bytes(b"SQLite format 3\0" + bytes(range(256)) * 64), "damaged, or no registry"),
        (lambda p: p.symlink_to(p), "cannot open|there is no registry"),
    ],
)
def test_what_is_no_registry(tmp_path, made, said, write):
    path = tmp_path / "fleet.db"
    made(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(InputError, match=said):
        open_registry(path, write=write)
    assert before is None or path.read_bytes() == before


def test_to_read_there_must_be_one(tmp_path):
    with pytest.raises(InputError, match="there is no registry; `sagnac registry add` makes one"):
        open_registry(tmp_path / "fleet.db")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "fleet.db").touch()
    with pytest.raises(InputError, match="holds no registry yet"):
        open_registry(tmp_path / "fleet.db")


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> bytes:
    """The file of a registry with a few calibrations."""
    path = tmp_path_factory.mktemp("sound") / "fleet.db"
    with open_registry(path, write=True) as registry:
        add(registry, *(candidate(f"{i % 3:04d}", DAY.format(i + 1), bias=i * MG) for i in range(9)))
        with registry._database._engine.connect() as connection:
            connection.exec_driver_sql("ROLLBACK")
            connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)")
    return path.read_bytes()


@given(where=st.floats(0, 1, exclude_max=True), bits=st.integers(1, 255), keep=st.floats(0.3, 1))
def test_a_damaged_file_is_told_or_does_no_harm(sound, tmp_path, where, bits, keep):
    damaged = bytearray(sound)
    damaged[int(where * len(damaged))] ^= bits
    path = tmp_path / "damaged.db"
    path.write_bytes(damaged[: int(keep * len(damaged))] if keep < 0.9 else damaged)
    try:
        with open_registry(path) as registry:
            found = registry.listing()
            registry.history()
            registry.find(datetime(2025, 3, 5, tzinfo=UTC))
            documents = [registry.content(f.latest) for f in found]
        with open_registry(path, write=True) as registry:
            add(registry, candidate("new"))
    except SagnacError as told:
        assert str(path) in str(told)  # noqa: PT017 - it may be told, and need not
    else:
        assert all(of_content(d, "cal.json") for d in documents)


def test_a_full_disk_is_told_and_nothing_is_half(tmp_path):
    with open_registry(tmp_path / "fleet.db", write=True) as registry:
        (kept,) = add(registry, candidate())
    with open_registry(tmp_path / "fleet.db", write=True) as registry:
        engine = registry._database._engine
        engine.dispose()

        @event.listens_for(engine, "connect")
        def no_more_room(connection, _record):
            connection.execute("PRAGMA max_page_count = 30")

        with pytest.raises(InputError, match=r"the disk is full .*nothing of it is kept"):
            add(registry, *(candidate(f"{i}") for i in range(100)))
        assert [f.latest for f in registry.listing()] == [kept]
    with open_registry(tmp_path / "fleet.db", write=True) as registry:
        assert len(add(registry, *(candidate(f"{i}") for i in range(100)))) == 100


def test_a_disk_that_fills_up_keeps_what_was_told(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "BATCH", 10)
    folder = tmp_path / "files"
    folder.mkdir()
    for i in range(100):
        (folder / f"{i:03d}.json").write_bytes(content(f"{i:03d}"))

    def no_more_room(connection):
        connection.execute("PRAGMA max_page_count = 60")

    monkeypatch.setattr(database, "_use_log", no_more_room)
    with pytest.raises(
        InputError, match="the disk is full .* files before are registered, a second try adds the others"
    ) as said:
        add_files(tmp_path / "fleet.db", [folder])
    monkeypatch.undo()
    with open_registry(tmp_path / "fleet.db") as registry:
        kept = len(registry.listing())
    assert 0 < kept < 100
    assert f" {kept} files before" in str(said.value)
    done = add_files(tmp_path / "fleet.db", [folder])
    assert [sum(a.new for a in done.added), len(done.added)] == [100 - kept, 100]


def _as_nobody(job, *arguments) -> str:
    """What a job says that is run without the rights of root."""

    def run(pipe):
        if os.geteuid() == 0:
            os.setgroups([])
            os.setgid(65534)
            os.setuid(65534)
        try:
            pipe.send(job(*arguments))
        except SagnacError as cause:
            pipe.send(str(cause))

    mine, its = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=run, args=(its,))
    child.start()
    child.join(60)
    return mine.recv() if mine.poll() else f"ended with {child.exitcode}"


def _reads(path: Path) -> str:
    with open_registry(path) as registry:
        return registry.listing()[0].unit.serial


def _writes(path: Path) -> str:
    with open_registry(path, write=True) as registry:
        return str(len(list(registry.add([candidate("0002")]))))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_folder_that_takes_no_files(tmp_path_factory):
    import tempfile

    with tempfile.TemporaryDirectory() as name:  # not below the tests' own folder, which is closed to others
        folder = Path(name)
        path = folder / "fleet.db"
        with open_registry(path, write=True) as registry:
            add(registry, candidate())
        path.chmod(0o444)
        folder.chmod(0o555)
        assert sorted(p.name for p in folder.iterdir()) == ["fleet.db"]
        assert _as_nobody(_reads, path) == "0001"
        assert f"{path}: " in (said := _as_nobody(_writes, path))
        assert "cannot be written to" in said
        assert "cannot open" in _as_nobody(_writes, folder / "new.db")
        assert "cannot open" in _as_nobody(_writes, folder / "new" / "new.db")
        folder.chmod(0o755)


# ------------------------------------------------------------------------------------------------------ PostgreSQL


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"username": "guarded", "password": "wrong/&?"}, "the server does not let you in"),
        ({"username": "guarded"}, "the server does not let you in"),
        ({"username": "nobody at all", "password": "wrong/&?"}, "the server does not let you in"),
        ({"database": "nowhere", "password": "wrong/&?"}, "no such database; make it with createdb"),
    ],
)
def test_a_server_that_does_not_let_you_in(postgresql, change, said):
    url = make_url(postgresql).set(**change).render_as_string(hide_password=False)
    for write in (False, True):
        with pytest.raises(InputError, match=said) as caught:
            open_registry(url, write=write)
        chain = f"{caught.value!r} {caught.value.__cause__!r}"
        assert "wrong" not in chain


def test_the_password_opens_and_is_not_shown(schema):
    url = make_url(schema)
    if os.environ.get("SAGNAC_TEST_POSTGRESQL"):
        pytest.skip("the role is that of the tests' own server")
    with open_registry(schema, write=True) as registry:
        add(registry, candidate())
    guarded = url.set(username="guarded", password=PASSWORD).render_as_string(hide_password=False)
    with pytest.raises(InputError, match="guarded:\\*\\*\\*@.*(permission denied|holds no registry)") as caught:
        open_registry(guarded)
    assert PASSWORD not in str(caught.value)
    in_query = url.set(username="guarded").update_query_dict({"password": "wrong/&?"})
    with pytest.raises(InputError, match="does not let you in") as caught:
        open_registry(in_query.render_as_string(hide_password=False))
    assert "wrong" not in str(caught.value)


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("postgresql://me:secret@no.such.host.invalid/db", "there is no such host"),
        ("postgresql://me:secret@127.0.0.1:1/db", "no server answers there"),
        ("postgresql://me:secret@/db?host=/nowhere", "no server answers there"),
        ("postgresql://me:secret@127.0.0.1:1/db?no_such_option=1", "cannot"),
    ],
)
def test_a_server_that_is_not_there(url, said):
    with pytest.raises(InputError, match=said) as caught:
        open_registry(url, write=True)
    assert "secret" not in str(caught.value)
    assert "postgresql://me:***@" in str(caught.value)


# ----------------------------------------------------------------------------------------------------------- names

NAMES = st.text(st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"]), min_size=1, max_size=200).filter(
    lambda name: name == name.strip()
)


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def open_one(request, tmp_path_factory):
    """One registry for many examples."""
    if request.param == "sqlite":
        where = tmp_path_factory.mktemp("names") / "fleet.db"
    else:
        url = make_url(request.getfixturevalue("postgresql"))
        import psycopg

        with psycopg.connect(url.render_as_string(hide_password=False), autocommit=True) as connection:
            connection.execute("DROP SCHEMA IF EXISTS test_names CASCADE; CREATE SCHEMA test_names")
        where = url.update_query_dict({"options": "-csearch_path=test_names"}).render_as_string(hide_password=False)
    with open_registry(where, write=True) as registry:
        yield registry


@given(model=NAMES, serial=NAMES)
@example(model="'; DROP TABLE units; --", serial='"%s" %(x)s :id {}')
@example(model="Ω" * 200, serial="😀" * 200)
@example(model="a\N{COMBINING DIAERESIS}", serial="ä")
@example(model="?", serial="id:1")
def test_any_name_that_can_be_read_is_kept(open_one, model, serial):
    (entry,) = add(open_one, candidate(serial, model=model))
    assert (entry.unit.model, entry.unit.serial) == (model, serial)
    assert open_one.unit(serial, model) == entry.unit
    assert open_one.entries(entry.unit) == [entry]
    assert open_one.listing(model=model, serial=serial)[0].latest == entry
    assert entry.unit.id in open_one.history(model=model).units


@pytest.mark.parametrize("name", ["a\0b", "a\nb", "\x1b[31m", "a\ud800", "x" * 201, "a\u2028b"])
def test_a_name_that_cannot_be_kept_is_refused(name):
    for how in ({"serial": name}, {"model": name}, {"method": name}):
        file = calibration(**how).to_json().encode()
        with pytest.raises(InputError, match=r"cal.json: the (serial|model|method) .*(cannot be kept|200 are kept)"):
            of_content(file, "cal.json")


def test_a_name_that_is_no_text_is_not_found(open_one):
    with pytest.raises(InputError, match="is no text that a registry could hold"):
        open_one.unit("a\udcff")


# ----------------------------------------------------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (b"", "not a JSON file"),
        (b"\xff\xfe{}", "not a JSON file"),
        (b"[1, 2]", "it names no schema"),
        (b'{"schema": "sagnac/calibration/2"}', "its schema is 'sagnac/calibration/2'"),
        (b'{"schema": "sagnac/alignment/1"}', "not a calibration .* its schema is 'sagnac/alignment/1'"),
        (content()[:-20], "not a JSON file"),
        (content().replace(b'"chi2": 9.0', b'"chi2": "a"'), "damaged calibration: fit.chi2"),
        (content(serial=""), "names no serial number of the unit; say it with --serial"),
        (content(model="  "), "names no model of the unit; say it with --model"),
        (content(created="2099-01-01T00:00:00+00:00"), "dated 2099-01-01T00:00:00\\+00:00, in the future"),
        (content(created="last week"), "its date 'last week' cannot be read; say when it was made with --as-of"),
    ],
)
def test_a_file_that_is_refused_does_not_keep_the_others_out(tmp_path, made, said):
    folder = tmp_path / "files"
    folder.mkdir()
    for name, file in (("a.json", content("1")), ("b.json", made), ("c.json", content("2"))):
        (folder / name).write_bytes(file)
    done = add_files(tmp_path / "fleet.db", [folder])
    assert [Path(a.file).name for a in done.added] == ["a.json", "c.json"]
    (refused,) = done.refused
    assert refused.startswith(f"{folder / 'b.json'}: ")
    with pytest.raises(InputError, match=said):
        read(folder / "b.json")


def test_where_all_files_are_refused_no_registry_is_made(tmp_path):
    (tmp_path / "a.json").write_text("{}")
    done = add_files(tmp_path / "fleet.db", [tmp_path / "a.json", tmp_path / "missing.json"])
    assert len(done.refused) == 2
    assert "missing.json: cannot read the calibration" in done.refused[1]
    assert not (tmp_path / "fleet.db").exists()


def test_what_files_do_not_say_is_given_and_what_they_say_is_not_overruled():
    nameless = calibration(serial="", model="", created="?").to_json().encode()
    found = of_content(nameless, "cal.json", Lacking("LG-1", "0042", "2025-01-31"))
    assert (found.model, found.serial, found.created) == ("LG-1", "0042", datetime(2025, 1, 31, tzinfo=UTC))
    for lacking, said in (
        (Lacking(serial="0002"), "says '0001' itself, and --serial says '0002'"),
        (Lacking(model="LG-2"), "says 'LG-1' itself, and --model says 'LG-2'"),
        (Lacking(created="2099-01-31"), "dated 2099-01-31T00:00:00\\+00:00, in the future"),
    ):
        with pytest.raises(InputError, match=said):
            of_content(content(), "cal.json", lacking)
    assert of_content(content(), "cal.json", Lacking("LG-1", "0001")).serial == "0001"


def test_a_folder_without_files(tmp_path):
    with pytest.raises(InputError, match=r"no \.json files in this folder"):
        find([tmp_path])


# ----------------------------------------------------------------------------------------------------------- dates


@pytest.mark.parametrize(
    ("text", "end", "moment"),
    [
        ("2025-03-01", False, datetime(2025, 3, 1, tzinfo=UTC)),
        ("2025-03-01", True, datetime(2025, 3, 1, 23, 59, 59, 999999, tzinfo=UTC)),
        ("20250301", True, datetime(2025, 3, 1, 23, 59, 59, 999999, tzinfo=UTC)),
        ("2025-W09-6", True, datetime(2025, 3, 1, 23, 59, 59, 999999, tzinfo=UTC)),
        ("2025-03-01T08:30", True, datetime(2025, 3, 1, 8, 30, tzinfo=UTC)),
        ("2025-03-01 08:30:00+02:00", False, datetime(2025, 3, 1, 6, 30, tzinfo=UTC)),
        ("2025-03-01T08:30:00.25Z", False, datetime(2025, 3, 1, 8, 30, 0, 250000, tzinfo=UTC)),
    ],
)
def test_dates(text, end, moment):
    assert parse(text, end=end) == moment


@pytest.mark.parametrize(
    "text",
    ["", "yesterday", "2025-02-30", "01.03.2025", "9999-12-31T23:00:00-05:00", "2026-W01", "2026W01", "2026-W01T08:00"],
)
def test_what_is_no_date(text):
    with pytest.raises(InputError, match="is no date; write 2026-11-22"):
        parse(text)


def test_a_date_is_told_apart_to_the_microsecond(where):
    with open_registry(where, write=True) as registry:
        made = [candidate(created=f"2025-03-01T12:00:00.{n:06d}+00:00") for n in (1, 2)]
        first, last = add(registry, *made)
        assert registry.find(first.created) == [first]
        assert registry.find(last.created) == [last]


def test_sqlite_is_new_enough():
    assert sqlite3.sqlite_version_info >= (3, 24)
