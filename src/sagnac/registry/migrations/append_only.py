"""Triggers that refuse to change or remove what a table holds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import sqlalchemy as sa
from alembic import op

_HELD = {
    "sqlite": "SELECT tbl_name, name, sql FROM sqlite_master WHERE type = 'trigger'",
    "postgresql": """
        SELECT relname, tgname, pg_get_triggerdef(pg_trigger.oid) FROM pg_trigger JOIN pg_class ON pg_class.oid = tgrelid
        WHERE NOT tgisinternal AND tgenabled <> 'D' AND relnamespace = current_schema()::regnamespace
    """,
}
"""Triggers that there are: table, name, and how it is made."""
_NEEDED = {
    "sqlite": ("{}_no_update", "{}_no_delete", "{}_no_replace"),
    "postgresql": ("{}_append_only_row", "{}_append_only_statement"),
}
"""Those that a table must have."""
_FUNCTION = """
CREATE FUNCTION sagnac_append_only() RETURNS trigger LANGUAGE plpgsql AS
$$ BEGIN RAISE EXCEPTION 'the registry is append-only: nothing in % is changed or removed', TG_TABLE_NAME; END $$
"""


def refuse_changes(table: str, *keys: Sequence[str]) -> None:
    """Let a table only grow.

    Parameters
    ----------
    table : str
    *keys : sequence of str
        Columns of each of its keys; SQLite's REPLACE would remove a row of the same key without a word to the triggers of DELETE.
    """
    if op.get_bind().dialect.name == "postgresql":
        for what, each in (("UPDATE OR DELETE", "ROW"), ("TRUNCATE", "STATEMENT")):
            name = f"{table}_append_only_{each.lower()}"
            op.execute(
                f'CREATE TRIGGER "{name}" BEFORE {what} ON "{table}" FOR EACH {each} '
                "EXECUTE FUNCTION sagnac_append_only()"
            )
        return
    said = f"SELECT RAISE(ABORT, 'the registry is append-only: nothing in {table} is changed or removed')"
    for what in ("UPDATE", "DELETE"):
        op.execute(f'CREATE TRIGGER "{table}_no_{what.lower()}" BEFORE {what} ON "{table}" BEGIN {said}; END')
    same = " OR ".join("(" + " AND ".join(f'"{c}" = NEW."{c}"' for c in key) + ")" for key in keys)
    op.execute(
        f'CREATE TRIGGER "{table}_no_replace" BEFORE INSERT ON "{table}" '
        f'WHEN EXISTS (SELECT 1 FROM "{table}" WHERE {same}) BEGIN {said}; END'
    )


def prepare() -> None:
    """Make what the triggers of a database share."""
    if op.get_bind().dialect.name == "postgresql":
        op.execute(_FUNCTION)


@contextmanager
def lifted(table: str) -> Iterator[None]:
    """Change a table within: fill a column, or let Alembic make it anew (``batch_alter_table``, which drops its triggers).

    Outside, an UPDATE would be refused, and a table made anew would not refuse changes any more.

    Parameters
    ----------
    table : str
        Its keys stay what they are.
    """
    connection = op.get_bind()
    kind = connection.dialect.name
    triggers = [row for row in connection.execute(sa.text(_HELD[kind])) if row[0] == table]
    for _, name, _ in triggers:
        op.execute(f'DROP TRIGGER "{name}"' + (f' ON "{table}"' if kind == "postgresql" else ""))
    yield
    for _, _, statement in triggers:
        connection.exec_driver_sql(statement)


def bare_tables(connection: sa.Connection, tables: Iterable[str]) -> list[str]:
    """Tables that would take a change: a trigger is missing.

    Parameters
    ----------
    connection : Connection
    tables : iterable of str
        Of those that there are, the ones to look at.
    """
    kind = connection.dialect.name
    held = {(row[0], row[1]) for row in connection.execute(sa.text(_HELD[kind]))}
    there = sa.inspect(connection).get_table_names()
    return sorted(t for t in tables if t in there and any((t, name.format(t)) not in held for name in _NEEDED[kind]))
