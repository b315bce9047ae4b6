"""The registry: calibrations of a fleet over the years, in SQLite or PostgreSQL.

:func:`open_registry` opens one. Importing this costs nothing; SQLAlchemy is loaded when a registry is opened.
"""

from __future__ import annotations

from contextlib import closing
from os import PathLike
from typing import TYPE_CHECKING

from ..errors import InputError
from .entries import Added, Bound, Entry, History, Listed, Parameter, State, Unit

if TYPE_CHECKING:
    from .store import Registry

__all__ = ["Added", "Bound", "Entry", "History", "Listed", "Parameter", "State", "Unit", "open_registry", "upgrade"]


def open_registry(where: str | PathLike[str] | None = None, *, write: bool = False) -> Registry:
    """Open a registry.

    Parameters
    ----------
    where : path or URL, optional
        A file of SQLite, or ``postgresql://user@host/database``. Left out: the environment variable SAGNAC_REGISTRY, and without
        it a file in the user's folder for data (:func:`sagnac.registry.address.default_file`).
    write : bool
        Whether it will be written to; then it is made where there is none.

    Returns
    -------
    Registry
        To be closed, or used in a ``with``.

    Raises
    ------
    InputError
        When it is not there, cannot be reached, is damaged, no registry, or of another version.
    """
    _need()
    from .address import address
    from .store import Registry

    return Registry(address(where), write=write)


def upgrade(where: str | PathLike[str] | None = None) -> tuple[str | None, str]:
    """Bring a registry of an earlier version up to this one, whole or not at all.

    Parameters
    ----------
    where : path or URL, optional
        As of :func:`open_registry`.

    Returns
    -------
    before, after : str
        Revisions of its tables; `before` is None where there were none.

    Raises
    ------
    InputError
        As of :func:`open_registry`.
    """
    _need()
    from .address import address
    from .database import Database

    found = address(where)
    there = Database(found, write=False)
    with closing(there), there.reading() as connection:
        if there.revision(connection) is None:
            there.check(None)  # nothing there to bring up
    database = Database(found, write=True)
    with closing(database):
        return database.upgrade()


def _need() -> None:
    try:
        import sqlalchemy  # noqa: F401
    except ImportError as cause:
        raise InputError("a registry is kept by SQLAlchemy: pip install 'sagnac[registry]'") from cause
