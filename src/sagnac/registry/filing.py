"""Files into the registry."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from os import PathLike
from pathlib import Path

from ..errors import InputError
from . import open_registry
from .candidates import NOTHING, Candidate, Lacking, find, read
from .entries import Added


@dataclass(frozen=True)
class Filed:
    """What became of the files.

    Attributes
    ----------
    added : tuple of Added
        Those registered now, and those that were before.
    refused : tuple of str
        Why, with the name of the file.
    """

    added: tuple[Added, ...]
    refused: tuple[str, ...]


def add_files(
    where: str | PathLike[str] | None,
    paths: Sequence[str | Path],
    lacking: Lacking = NOTHING,
    *,
    progress: Callable[[float], None] | None = None,
) -> Filed:
    """Register calibrations from files, and from all ``*.json`` in folders.

    Files are taken one by one: what is no calibration, or cannot be registered, is refused, and the others are registered all the
    same. Those of a batch are registered together or, should the database fail, not at all; a second try adds what is missing.

    Parameters
    ----------
    where : path or URL, optional
        See :func:`sagnac.registry.open_registry`; the registry is made if it is not there and a file is good.
    paths : sequence of path
    lacking : Lacking
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
    refused: list[str] = []

    def good() -> Iterator[Candidate]:
        for path in find(paths):
            try:
                yield read(path, lacking)
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
