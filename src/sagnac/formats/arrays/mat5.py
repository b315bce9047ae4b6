"""MATLAB 5 files (``save -v6`` and ``-v7``), read from where they lie: no array is ever held whole.

scipy.io holds whole variables and does not tell at which byte a file is damaged; it is the peer and the writer in the
tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..table import Fault, Table
from .mat5_elements import Found, Numbers, walk
from .variables import WIDEST, Rows, Variable, column_names, table


def open_table(path: Path) -> Table:
    """Open a MATLAB 5 file: vectors and matrices of real numbers, those in structures with dots in their names.

    Raises
    ------
    InputError
        When there is no array of numbers in it. Fault where the file is damaged before the first; damage behind an array
        is raised when its rows have been read.
    """
    found = Found()
    fault = None
    with path.open("rb") as file:
        try:
            walk(path, file, found)
        except Fault as damage:
            fault = damage
    variables = [_variable(a, found.texts) for a in found.arrays if max(a.shape) > 1 and min(a.shape) <= WIDEST]
    return table(path, variables, lambda: path.open("rb"), fault)


def _variable(array: Numbers, texts: dict[str, str]) -> Variable:
    """The array as columns; a structure ``units`` beside it gives their unit (``units.acc`` of ``acc``)."""
    length, width = max(array.shape), min(array.shape)
    parent, _, own = array.name.rpartition(".")
    unit = texts.get(f"{parent}.units.{own}" if parent else f"units.{own}", "")
    names = column_names(array.name, width)

    def rows(file: BinaryIO, columns: Sequence[int]) -> Rows:
        return _Rows(array, file, columns)

    units = (unit,) * width if unit else ()
    return Variable(array.name, length, names, array.kind.itemsize, units, rows, whole=array.kind.kind in "iu")


class _Rows:
    """Rows of an array: of a tall one each column has its own place in the file, of a wide one a sample lies together."""

    def __init__(self, array: Numbers, file: BinaryIO, columns: Sequence[int]) -> None:
        self._array, self._columns = array, columns
        height, width = array.shape
        self._tall = height >= width
        self._sources = [array.source(file) for _ in (columns if self._tall else (0,))]
        for source, column in zip(self._sources, columns, strict=False):
            source.skip(array.start + column * height * array.kind.itemsize * self._tall)

    def take(self, count: int) -> tuple[list[NDArray[Any]], Fault | None]:
        """See :class:`Rows`."""
        kind = self._array.kind
        together = 1 if self._tall else self._array.shape[0]
        data = [source.some(count * together * kind.itemsize) for source in self._sources]
        sound = min(map(len, data)) // (together * kind.itemsize)
        blocks = [np.frombuffer(d, kind, sound * together).reshape(sound, together) for d in data]
        pieces = [b[:, 0] for b in blocks] if self._tall else [blocks[0][:, c] for c in self._columns]
        return pieces, next((s.fault for s in self._sources if s.fault), None)

    def finish(self) -> None:
        """See :class:`Rows`."""
        max(self._sources, key=lambda s: s.position).finish(self._array.size)
