"""The registry: calibrations of a fleet over the years, in SQLite or PostgreSQL.

:func:`open_registry` opens one, :func:`add_files` fills it. Importing this costs nothing; SQLAlchemy is loaded when a registry is
opened.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .entries import Added, Bound, Entry, Filed, History, Listed, Parameter, State, Unit

if TYPE_CHECKING:
    from .candidates import Candidate, Lacking
    from .store import Registry

__all__ = [
    "Added",
    "Bound",
    "Entry",
    "Filed",
    "History",
    "Listed",
    "Parameter",
    "State",
    "Unit",
    "add_files",
    "open_registry",
    "upgrade",
]


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


def add_files(
    where: str | PathLike[str] | None,
    paths: Sequence[str | Path],
    lacking: Lacking | None = None,
    *,
    progress: Callable[[float], None] | None = None,
) -> Filed:
    """Register calibrations from files, and from all ``*.json`` in folders.

    Files are taken one by one: what is no calibration, or cannot be registered, is refused, and the others are registered all the
    same. Those of a batch are registered together or, should the database fail, not at all; a second try adds what is missing.

    Parameters
    ----------
    where : path or URL, optional
        As of :func:`open_registry`; the registry is made if it is not there and a file is good.
    paths : sequence of path
    lacking : Lacking, optional
        What files do not say themselves.
    progress : callable, optional
        Told the number of files done.

    Returns
    -------
    Filed

    Raises
    ------
    InputError
        When the database cannot be written to, or a folder holds nothing.
    """
    from itertools import chain

    from .candidates import NOTHING, find, read

    refused: list[str] = []

    def good() -> Iterator[Candidate]:
        for path in find(paths):
            try:
                yield read(path, lacking or NOTHING)
            except InputError as cause:
                refused.append(str(cause))

    candidates = good()
    first = next(candidates, None)
    if first is None:
        return Filed((), tuple(refused))
    added = []
    with open_registry(where, write=True) as registry:
        try:
            for one in registry.add(chain([first], candidates)):
                if one.refused:
                    refused.append(one.refused)
                else:
                    added.append(one)
                if progress is not None:
                    progress(len(added) + len(refused))
        except InputError as cause:
            raise InputError(
                f"{cause}; {len(added)} files before are registered, a second try adds the others"
            ) from cause
    return Filed(tuple(added), tuple(refused))


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
