"""Files of named arrays (MATLAB, HDF5): which of them are the samples of one recording, and their rows as a stream."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from ...errors import InputError
from ..table import Fault, Table

BATCH = 1 << 17
WIDEST = 1000
"""An array with more columns than that is no log."""
_BUDGET = 1 << 24  # bytes read at a time
_UNIT = re.compile(r"[^\[\]\n]{1,64}")
_NAMED = 12  # arrays named in a message


class Rows(Protocol):
    """Rows of an array, one piece after the other."""

    def take(self, count: int) -> tuple[list[NDArray[Any]], Fault | None]:
        """The next rows of the columns asked for; or fewer, and what is wrong with the rest."""

    def finish(self) -> None:
        """Check what is only known when all is read (a checksum); raises Fault."""


@dataclass(frozen=True)
class Variable:
    """An array of numbers of which one axis is the time.

    Attributes
    ----------
    name : str
        With dots between the structures, groups or fields in which it lies.
    length : int
        Samples.
    names : tuple of str
        One per column: its own name, or ``name.1`` to ``name.k``.
    itemsize : int
        Bytes of one number.
    units : tuple of str
        One per column where the file gives units, else empty.
    rows : callable
        ``rows(file, columns)`` gives :class:`Rows` of columns given by their index.
    whole : bool
        Whether its numbers are integers in the file.
    """

    name: str
    length: int
    names: tuple[str, ...]
    itemsize: int
    units: tuple[str, ...]
    rows: Callable[[Any, Sequence[int]], Rows]
    whole: bool = False

    @property
    def headers(self) -> tuple[str, ...]:
        """Texts of the columns, with units as far as the file gives them."""
        units = self.units or ("",) * len(self.names)
        return tuple(f"{n} [{u}]" if u and _UNIT.fullmatch(u) else n for n, u in zip(self.names, units, strict=True))


def column_names(name: str, width: int) -> tuple[str, ...]:
    """One name, or ``name.1`` to ``name.k``."""
    return (name,) if width == 1 else tuple(f"{name}.{k}" for k in range(1, width + 1))


def table(
    path: Path,
    found: Sequence[Variable],
    opened: Callable[[], AbstractContextManager[Any]],
    fault: Fault | None = None,
) -> Table:
    """Table of the arrays that belong together: those as long as the one named time, else the longest.

    The arrays of other lengths stand beside it, each length in a table of its own, for who asks for them by name.

    Parameters
    ----------
    path : Path
    found : sequence of Variable
    opened : callable
        Opens the file for reading.
    fault : Fault, optional
        Damage behind the arrays that were found: raised when their rows have been read.

    Raises
    ------
    InputError
        When there is no array of numbers, or two columns have one name.
    """
    if fault is not None and not found:
        raise fault
    if not found:
        raise InputError(f"{path}: no array of numbers with more than one sample in it")
    length = max([v.length for v in found if v.name.lower().split(".")[-1] == "time"] or [v.length for v in found])
    lengths = [length, *sorted({v.length for v in found} - {length})]
    places = {n: {h: (v, i) for v in found if v.length == n for i, h in enumerate(v.headers)} for n in lengths}
    unclear = {n for n in lengths if len(places[n]) < sum(len(v.names) for v in found if v.length == n)}
    if length in unclear:
        raise InputError(f"{path}: several columns have one name: {_listed([v for v in found if v.length == length])}")
    tables = [_table(path, found, n, places[n], opened, fault) for n in lengths if n not in unclear]
    return replace(tables[0], besides=tuple(tables[1:]))


def _table(
    path: Path,
    found: Sequence[Variable],
    length: int,
    places: dict[str, tuple[Variable, int]],
    opened: Callable[[], AbstractContextManager[Any]],
    fault: Fault | None,
) -> Table:
    """Table of the arrays of one length."""
    left = [v for v in found if v.length != length]
    remarks = (
        (f"read are the arrays of {length} samples; left out, of another length: {_listed(left)}",) if left else ()
    )
    size = path.stat().st_size
    seen = [0]

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        with opened() as file:
            done = 0
            for batch in _read(file, places, numeric, other):
                done += batch.num_rows
                seen[0] = size * done // length
                yield batch
        if fault is not None:
            raise fault

    whole = frozenset(h for h, (v, _) in places.items() if v.whole)
    return Table(path, tuple(places), read, remarks, position=lambda: seen[0], size=size, whole=whole, samples=length)


def _listed(variables: Sequence[Variable]) -> str:
    names = [f"{v.name} ({v.length})" for v in variables[:_NAMED]]
    return ", ".join(names) + (f" and {len(variables) - _NAMED} more" if len(variables) > _NAMED else "")


def _read(
    file: Any, places: dict[str, tuple[Variable, int]], numeric: Sequence[str], other: Sequence[str]
) -> Iterator[Any]:
    import pyarrow as pa

    wanted = [*numeric, *other]
    columns: dict[str, list[int]] = {}
    variables = {v.name: v for v, _ in (places[h] for h in wanted)}
    for header in wanted:
        columns.setdefault(places[header][0].name, []).append(places[header][1])
    readers = {name: v.rows(file, columns[name]) for name, v in variables.items()}
    row = sum(v.itemsize * len(v.names) for v in variables.values())
    left = next(iter(variables.values())).length
    while left:
        count = min(left, BATCH, max(1, _BUDGET // row))
        taken = {name: reader.take(count) for name, reader in readers.items()}
        shortest = min(taken.values(), key=lambda pieces: len(pieces[0][0]))
        sound = len(shortest[0][0])
        arrays = []
        for k, header in enumerate(wanted):
            variable, column = places[header]
            piece = taken[variable.name][0][columns[variable.name].index(column)][:sound]
            arrays.append(pa.array(piece.astype(float if k < len(numeric) else piece.dtype.newbyteorder("="))))
        if sound:
            yield pa.RecordBatch.from_arrays(arrays, names=wanted)
        if shortest[1] is not None:
            raise shortest[1]
        left -= sound
    for reader in readers.values():
        reader.finish()
