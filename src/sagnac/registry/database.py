"""The database below a registry: how it is opened, which revision it is at, and what its complaints mean."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa
from sqlalchemy import event, exc

from ..errors import InputError, SagnacError
from .address import Address
from .queries import DamagedError
from .tables import REVISIONS, VERSION_TABLE, metadata

if TYPE_CHECKING:
    import sqlite3

MIGRATIONS = Path(__file__).with_name("migrations")
WAIT = 60.0
"""Seconds that a writer waits for the others."""
_MAGIC = b"SQLite format 3\0"
_LOCK = 0x5A6AC  # of all writers of one database: they go one after the other, as they do in SQLite
_WRITES = "sagnac_writes"
_TABLES = {
    "sqlite": "SELECT name FROM sqlite_master WHERE type = 'table'",
    "postgresql": "SELECT tablename FROM pg_tables WHERE schemaname = current_schema()",
}


class Database:
    """A database that is open.

    Parameters
    ----------
    where : Address
    write : bool
        Whether it will be written to; then a file that is not there is made.

    Raises
    ------
    InputError
        When it is not there (only to be read), cannot be opened, or is no database.
    """

    def __init__(self, where: Address, *, write: bool) -> None:
        self.where = where
        self.write = write
        self._engine = _postgresql(where) if where.path is None else _sqlite(where.path, write=write)

    @property
    def dialect(self) -> str:
        """``sqlite`` or ``postgresql``."""
        return self._engine.dialect.name

    def close(self) -> None:
        """Let go of it."""
        self._engine.dispose()

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """A connection in a transaction that sees one state of the database.

        Raises
        ------
        InputError
            When the database cannot be reached, or is damaged.
        """
        with self._told("read"), self._engine.connect() as connection:
            if self.dialect == "postgresql":
                connection.execution_options(isolation_level="REPEATABLE READ")
            with connection.begin():
                yield connection

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """A connection in a transaction of which all is kept, or nothing; other writers wait.

        Raises
        ------
        InputError
            When it cannot be written to, the disk is full, or others have kept it for too long.
        """
        with (
            self._told("write to"),
            self._engine.connect().execution_options(**{_WRITES: True}) as connection,
            connection.begin(),
        ):
            if self.dialect == "postgresql":
                connection.execute(sa.text(f"SET LOCAL lock_timeout = '{WAIT * 1000:.0f}ms'"))
                connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_LOCK)))
            yield connection

    @contextmanager
    def _told(self, what: str) -> Iterator[None]:
        try:
            yield
        except SagnacError:
            raise
        except exc.SQLAlchemyError as cause:
            raise self.complaint(cause, what) from None  # its chain could show a password
        except UnicodeEncodeError as cause:
            raise InputError(f"{self.where}: {cause.object!a} is no text that a registry could hold") from cause
        except (DamagedError, UnicodeDecodeError, OverflowError, MemoryError) as cause:
            raise InputError(f"{self.where}: cannot {what} the registry: it is damaged ({cause})") from cause

    def complaint(self, cause: Exception, what: str) -> InputError:
        """What the database says, in one line, and what can be done."""
        own = getattr(cause, "orig", None) or cause
        said = " ".join(str(own).split())
        for secret in self.where.secrets:
            said = said.replace(secret, "***")
        done = "; nothing of it is kept" if what == "write to" else ""
        for pattern, advice in _ADVICE:
            if re.search(pattern, said):
                return InputError(f"{self.where}: {advice} ({_short(said)}){done}")
        return InputError(f"{self.where}: cannot {what} the registry: {_short(said)}{done}")

    def revision(self, connection: sa.Connection) -> str | None:
        """Revision of the tables; None where there are none.

        Raises
        ------
        InputError
            When the database is that of another program.
        """
        names = set(connection.execute(sa.text(_TABLES[self.dialect])).scalars())
        if VERSION_TABLE not in names:
            if names & set(metadata.tables) or (names and self.dialect == "sqlite"):
                raise InputError(
                    f"{self.where}: the database of something else (with a table {min(names)!r}); give the registry its own"
                )
            return None
        found = connection.execute(sa.text(f"SELECT version_num FROM {VERSION_TABLE}")).scalars().all()
        return str(found[0]) if found else None

    def make(self) -> None:
        """Make the tables where there are none yet, and see that they are those of this version."""
        with self.reading() as connection:
            found = self.revision(connection)
        if found is None:
            self.upgrade()
        else:
            self.check(found)

    def check(self, found: str | None) -> None:
        """Refuse tables of another version.

        Raises
        ------
        InputError
            With what to do.
        """
        if found == REVISIONS[-1]:
            return
        if found is None:
            raise InputError(f"{self.where}: holds no registry yet; `sagnac registry add` makes one")
        if found not in REVISIONS:
            raise InputError(
                f"{self.where}: made by a newer version of sagnac (its tables are at {found!r}, this version knows "
                f"{REVISIONS[-1]!r}); install that version"
            )
        raise InputError(
            f"{self.where}: made by an earlier version of sagnac (its tables are at {found!r}, this version needs "
            f"{REVISIONS[-1]!r}); bring it up with `sagnac registry upgrade`; earlier versions cannot read it then"
        )

    def upgrade(self, to: str = REVISIONS[-1]) -> tuple[str | None, str]:
        """Run the migrations that are missing, all of them or none.

        Parameters
        ----------
        to : str

        Returns
        -------
        before, after : str
            Revisions; `before` is None where there were no tables.
        """
        with self.writing() as connection:
            before = self.revision(connection)  # under the lock: somebody else may have been quicker
            if before is not None and before not in REVISIONS:
                self.check(before)
            if before is None or REVISIONS.index(before) < REVISIONS.index(to):
                _migrate(connection, to)
                return before, to
            return before, before


def _migrate(connection: sa.Connection, to: str) -> None:
    try:
        from alembic import command
        from alembic.config import Config
    except ImportError as cause:
        raise InputError("a registry is made by Alembic: pip install 'sagnac[registry]'") from cause
    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    command.upgrade(config, to)
    from .migrations.append_only import bare_tables

    bare = bare_tables(connection, metadata.tables)
    if bare:
        raise RuntimeError(
            f"migration to {to}: {', '.join(bare)} would not be append-only any more; see append_only.lifted"
        )


def _short(text: str) -> str:
    return text if len(text) <= 200 else text[:200] + " ..."


_ADVICE = (
    (r"database is locked|lock timeout|database table is locked", "others have been writing for too long; try again"),
    (r"disk is full|No space left|could not extend file", "the disk is full"),
    (r"readonly database|read-only|permission denied", "it cannot be written to"),
    (r"file is not a database|malformed|Could not decode|file is encrypted", "the file is damaged, or no registry"),
    (r"unable to open database file", "cannot open the file; see that its folder is there and may be written to"),
    (r"password authentication failed|no password supplied|role .* does not exist", "the server does not let you in"),
    (r"could not translate host|failed to resolve host|[Nn]ame or service not known", "there is no such host"),
    (r"Connection refused|timeout expired|No such file or directory|connection timeout", "no server answers there"),
    (r"database .* does not exist", "the server has no such database; make it with createdb"),
)
"""What a message of SQLite or PostgreSQL means."""


def _sqlite(path: Path, *, write: bool) -> sa.Engine:
    import sqlite3

    _check_file(path, write=write)
    mode = "rwc" if write else "ro"
    if not write and _frozen(path):
        mode += "&immutable=1"
    name = path.absolute().as_uri() + f"?mode={mode}"

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(name, uri=True, timeout=WAIT, isolation_level=None, check_same_thread=False)

    engine = sa.create_engine("sqlite://", creator=connect, poolclass=sa.pool.QueuePool)

    @event.listens_for(engine, "connect")
    def _settle(connection: Any, _record: object) -> None:
        connection.execute("PRAGMA foreign_keys = ON")
        connection.execute("PRAGMA cache_size = -65536")  # KiB
        if write:
            _use_log(connection)

    @event.listens_for(engine, "begin")
    def _begin(connection: sa.Connection) -> None:
        # a writer asks for the lock first: one that has read already could not wait for it
        asked = connection.get_execution_options().get(_WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if asked else "BEGIN")

    return engine


def _use_log(connection: sqlite3.Connection) -> None:
    """Write-ahead log: readers do not wait for writers. Each transaction that has ended is on the disk."""
    import sqlite3

    until, mode = time.monotonic() + WAIT, ""
    while not mode:
        try:
            (mode,) = connection.execute("PRAGMA journal_mode = WAL").fetchone()  # as it was, if a file system cannot
        except sqlite3.OperationalError as cause:  # for this, SQLite does not wait by itself
            if "locked" not in str(cause) or time.monotonic() > until:
                raise
            time.sleep(0.02)
    connection.execute("PRAGMA synchronous = FULL")


def _check_file(path: Path, *, write: bool) -> None:
    """Refuse what cannot be a registry, before SQLite makes something of it."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder; a registry is one file")
        if not path.exists():
            if not write:
                raise InputError(f"{path}: there is no registry; `sagnac registry add` makes one")
            path.parent.mkdir(parents=True, exist_ok=True)
            return
        with path.open("rb") as stream:
            head = stream.read(len(_MAGIC))
    except (OSError, ValueError) as cause:
        raise InputError(f"{path}: cannot open the registry: {getattr(cause, 'strerror', None) or cause}") from cause
    if head and head != _MAGIC:
        raise InputError(f"{path}: no registry: this is not a file of SQLite")


def _frozen(path: Path) -> bool:
    """Whether it can only be read as it lies there: the folder takes no files, and there is no log beside the file.

    SQLite would want to make files there even to read. Who begins to write meanwhile is not waited for.
    """
    beside = path.with_name(path.name + "-wal")
    return not os.access(path.parent, os.W_OK) and not (beside.exists() and beside.stat().st_size)


def _postgresql(where: Address) -> sa.Engine:
    try:
        return sa.create_engine(where.url or "", connect_args={"connect_timeout": 10}, isolation_level="READ COMMITTED")
    except ImportError as cause:
        raise InputError("PostgreSQL is reached by psycopg: pip install 'sagnac[registry]'") from cause
    except (exc.SQLAlchemyError, TypeError, ValueError) as cause:
        raise InputError(f"{where}: cannot use this URL ({type(cause).__name__})") from None
