"""Migrations: they make the tables that the code knows, and bring up every earlier registry with what it holds."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from registered import candidate, content
from sqlalchemy import create_engine, exc, make_url, text

import sagnac.registry
from sagnac.errors import InputError
from sagnac.limits import Limits
from sagnac.registry import database as databases
from sagnac.registry import open_registry, upgrade
from sagnac.registry.address import address
from sagnac.registry.candidates import of_content
from sagnac.registry.database import Database
from sagnac.registry.tables import REVISIONS, VERSION_TABLE, metadata

SCRIPTS = Path(sagnac.registry.__file__).with_name("migrations")


def made_at(where: str, revision: str) -> None:
    """An empty registry as an earlier version made it."""
    database = Database(address(where), write=True)
    database.upgrade(revision)
    database.close()


# One calibration as each revision kept it, in SQL that does not follow the code.
ROWS = {
    "0001": (
        "INSERT INTO units (model, serial) VALUES ('LG-1', '0001')",
        """INSERT INTO calibrations (unit_id, created, method, misalignment, software, sha256, added, recordings)
        VALUES (1, 1740830400000000, 'norm', 'element', 'sagnac 1.2.3', :sha256, 1740830400000000, '')""",
        "INSERT INTO documents VALUES (1, :content)",
        "INSERT INTO parameters (name, unit, misalignment) VALUES ('accel.bias.x', 'm/s^2', '')",
        "INSERT INTO \"values\" VALUES (1, 1, 0.0049, 0.0001, NULL)",
    ),
    "0002": (
        """INSERT INTO limits (model, serial, key, lower, upper, unit, rule, specification, valid_from, added)
        VALUES ('LG-1', '', 'accel.bias.x', -0.001, 0.001, 'm/s^2', 'simple acceptance', '', 0, 0)""",
    ),
}  # fmt: skip


def fill(where: str, revision: str) -> None:
    database = Database(address(where), write=True)
    file = content()
    given = {"sha256": of_content(file, "cal.json").sha256, "content": file}
    with database.writing() as connection:
        for known in REVISIONS[: REVISIONS.index(revision) + 1]:
            for statement in ROWS[known]:
                asked = {k: v for k, v in given.items() if f":{k}" in statement}
                connection.execute(text(statement), asked)
    database.close()


def test_the_code_knows_the_revisions_that_there_are():
    config = Config()
    config.set_main_option("script_location", str(SCRIPTS))
    found = [s.revision for s in ScriptDirectory.from_config(config).walk_revisions()]
    assert tuple(reversed(found)) == REVISIONS
    assert set(ROWS) == set(REVISIONS)


def test_the_tables_are_those_of_the_code(where):
    with open_registry(where, write=True) as registry, registry._database.reading() as connection:
        context = MigrationContext.configure(
            connection, opts={"version_table": VERSION_TABLE, "compare_type": True, "compare_server_default": True}
        )
        assert compare_metadata(context, metadata) == []


@pytest.mark.parametrize("revision", REVISIONS)
def test_every_earlier_registry_is_brought_up_with_what_it_holds(where, revision):
    made_at(where, revision)
    fill(where, revision)
    assert upgrade(where) == (revision, REVISIONS[-1])
    assert upgrade(where) == (REVISIONS[-1], REVISIONS[-1])
    with open_registry(where, write=True) as registry:
        (entry,) = registry.entries(registry.unit("0001"))
        assert registry.content(entry) == content()
        assert registry.history(entry.unit).value.tolist() == [0.0049]
        added = list(registry.add([of_content(content(), "cal.json"), candidate("0002")]))
        assert [a.new for a in added] == [False, True]
        registry.set_limits(Limits({"accel.bias.x": "1 mg"}), model="LG-1", serial="0002")
        assert {f.unit.serial: f.state.word for f in registry.listing()}["0002"] == "pass"


@pytest.mark.parametrize("write", [False, True])
@pytest.mark.parametrize("revision", REVISIONS[:-1])
def test_an_earlier_registry_is_not_brought_up_unasked(where, revision, write):
    made_at(where, revision)
    with pytest.raises(InputError, match="made by an earlier version of sagnac .*`sagnac registry upgrade`"):
        open_registry(where, write=write)


@pytest.mark.parametrize("write", [False, True])
def test_a_newer_registry_is_refused(where, write):
    made_at(where, REVISIONS[-1])
    database = Database(address(where), write=True)
    with database.writing() as connection:
        connection.execute(text(f"UPDATE {VERSION_TABLE} SET version_num = '9999'"))
    database.close()
    for attempt in (lambda: open_registry(where, write=write), lambda: upgrade(where)):
        with pytest.raises(InputError, match="made by a newer version of sagnac .*'9999'.*install that version"):
            attempt()


def test_an_upgrade_that_fails_leaves_all_as_it_was(where, monkeypatch):
    made_at(where, "0001")
    fill(where, "0001")

    def upgrade_and_fail(config, to):
        command_upgrade(config, to)
        raise OverflowError("in the middle")

    command_upgrade = command.upgrade
    monkeypatch.setattr(command, "upgrade", upgrade_and_fail)
    with pytest.raises(InputError, match="in the middle"):
        upgrade(where)
    monkeypatch.undo()
    assert upgrade(where) == ("0001", REVISIONS[-1])


def test_there_must_be_something_to_bring_up(where, tmp_path):
    with pytest.raises(InputError, match="`sagnac registry add` makes one"):
        upgrade(where)
    assert not (tmp_path / "fleet.db").exists()


def test_a_database_of_something_else_is_left_alone(where, tmp_path):
    if "://" in where:
        engine = create_engine(make_url(where).set(drivername="postgresql+psycopg"))
        with engine.begin() as connection:
            connection.execute(text("CREATE TABLE units (name TEXT)"))
        engine.dispose()
    else:
        with sqlite3.connect(where) as connection:
            connection.execute("CREATE TABLE songs (name TEXT)")
        connection.close()
    for write in (False, True):
        with pytest.raises(InputError, match="database of something else \\(with a table '(songs|units)'\\)"):
            open_registry(where, write=write)


def test_the_migrations_are_shipped():
    assert (SCRIPTS / "env.py").is_file()
    assert databases.MIGRATIONS == SCRIPTS


NEXT = """
import sqlalchemy as sa
from alembic import op
from contextlib import nullcontext
from sagnac.registry.migrations.append_only import lifted
revision, down_revision = "0003", "0002"

def upgrade():
    op.add_column("calibrations", sa.Column("operator", sa.String(200), nullable=True))
    with {around}("calibrations"):
        op.execute("UPDATE calibrations SET operator = method")
    with {around}("values"), op.batch_alter_table("values", recreate="always") as batch:
        batch.alter_column("standard_uncertainty", nullable=True)
"""


@pytest.fixture
def next_revision(tmp_path, monkeypatch):
    """Put a migration after the last."""

    def write(source: str) -> None:
        folder = tmp_path / "migrations"
        shutil.copytree(SCRIPTS, folder)
        (folder / "versions" / "r0003_next.py").write_text(source)
        monkeypatch.setattr(databases, "MIGRATIONS", folder)
        monkeypatch.setattr(databases, "REVISIONS", (*REVISIONS, "0003"))

    return write


def refused(connection, statement: str) -> bool:
    try:
        with connection.begin_nested():
            connection.execute(text(statement))
    except exc.DBAPIError as cause:
        return "append-only" in str(cause)
    return False


def test_a_later_migration_fills_a_column_and_leaves_the_tables_append_only(where, next_revision):
    made_at(where, "0002")
    fill(where, "0002")
    next_revision(NEXT.format(around="lifted"))
    database = Database(address(where), write=True)
    assert database.upgrade("0003") == ("0002", "0003")
    with database.writing() as connection:
        assert connection.execute(text("SELECT operator FROM calibrations")).scalars().all() == ["norm"]
        assert refused(connection, "UPDATE calibrations SET operator = 'x'")
        assert refused(connection, 'DELETE FROM "values"')
        assert refused(connection, 'UPDATE "values" SET value = 1')
        if database.dialect == "sqlite":
            assert refused(connection, 'REPLACE INTO "values" SELECT * FROM "values"')
        assert connection.execute(text('SELECT value FROM "values"')).scalars().all() == [0.0049]
    database.close()


def test_a_migration_after_which_a_table_would_take_changes_is_undone(where, next_revision):
    made_at(where, "0002")
    next_revision(NEXT.format(around="nullcontext"))
    database = Database(address(where), write=True)
    with pytest.raises(RuntimeError, match="migration to 0003: values would not be append-only any more"):
        database.upgrade("0003")
    with database.reading() as connection:
        assert database.revision(connection) == "0002"
    database.close()
