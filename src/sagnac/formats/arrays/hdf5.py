"""HDF5, and MATLAB 7.3 (``save -v7.3``), which is HDF5 with a header: datasets of numbers, streamed by slices."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..table import Fault, Table
from .hdf5_attributes import LONGEST_TEXT, attribute, heaps_are_sound, units
from .hdf5_packed import unpacked
from .variables import WIDEST, Rows, Variable, column_names, table

_TRUNCATED = re.compile(r"truncated file: eof = (\d+), .*stored_eof = (\d+)")
_COMPRESSED = 1032  # bytes that one compressed byte may stand for (zlib)
_ERRORS = (
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    KeyError,
    AttributeError,
    UnicodeError,
    OverflowError,
    MemoryError,
)
"""What h5py raises where a file is damaged."""


def open_table(path: Path) -> Table:
    """Open an HDF5 or MATLAB 7.3 file: datasets with one or two axes, fields of compound ones; names joined by dots.

    Raises
    ------
    InputError
        When h5py is not installed, or there is no dataset of numbers. Fault where the file is cut off, of which nothing
        can be read, or damaged.
    """
    try:
        import h5py
    except ImportError as cause:
        raise InputError(f"{path}: HDF5 and MATLAB 7.3 need one more package: pip install 'sagnac[matlab]'") from cause
    try:
        with h5py.File(path, "r") as file:
            found = _survey(path, file)
    except InputError:
        raise
    except _ERRORS as cause:
        if match := _TRUNCATED.search(str(cause)):
            reason = f"the file ends here, its own description says at byte {match[2]}; HDF5 cannot be read in part"
            raise Fault(path, int(match[1]), reason) from cause
        raise Fault(path, 0, f"the structure of the file cannot be read ({cause})") from cause
    return table(path, found, lambda: h5py.File(path, "r"))


def _survey(path: Path, file: Any) -> list[Variable]:
    """Every array of numbers in the file."""
    import h5py

    found: list[Variable] = []
    texts: dict[str, str] = {}
    size = path.stat().st_size
    sound = cache(lambda: heaps_are_sound(path))

    def visit(name: str, item: Any) -> None:
        if name.startswith("#") or not isinstance(item, h5py.Dataset):
            return  # a group, or MATLAB's own (#refs#, #subsystem#)
        if "MATLAB_class" in item.attrs:
            kind = attribute(item, "MATLAB_class", sound)
            if kind == b"char" and item.size <= LONGEST_TEXT and item.dtype.kind == "u":
                texts[name] = "".join(map(chr, np.ravel(item[()]).tolist())).strip()
            if kind in (b"char", b"cell", b"function_handle") or "MATLAB_empty" in item.attrs:
                return
        if item.ndim in (1, 2) and "MATLAB_sparse" not in item.parent.attrs:
            _refuse_bomb(path, item, size)
            for variable in _variables(path, name, item):
                given = () if item.dtype.names else units(item, len(variable.names), sound)
                found.append(unpacked(path, item, replace(variable, units=given)))

    file.visititems(visit)
    return [_with_unit(v, texts) for v in found]


def _refuse_bomb(path: Path, item: Any, size: int) -> None:
    for shape in (item.shape, item.chunks or ()):  # a chunk is held whole
        if math.prod(shape) * item.dtype.itemsize > _COMPRESSED * size:
            raise InputError(f"{path}: {item.name} claims {shape} numbers, more than a file of {size} bytes can hold")


def _variables(path: Path, name: str, item: Any) -> list[Variable]:
    """The dataset, or each field of a compound one."""
    if item.dtype.names is None:
        return _variable(path, name, item, None, item.shape, item.dtype)
    if item.ndim != 1:
        return []
    kinds = [(f, item.dtype[f]) for f in item.dtype.names]
    return [
        v for f, kind in kinds for v in _variable(path, f"{name}/{f}", item, f, (*item.shape, *kind.shape), kind.base)
    ]


def _variable(
    path: Path, name: str, item: Any, part: str | None, shape: tuple[int, ...], kind: np.dtype[Any]
) -> list[Variable]:
    if kind.kind not in "iufb" or kind.itemsize > 8 or len(shape) > 2 or max(shape) < 2 or min(shape) < 1:
        return []
    length, width = (shape[0], 1) if len(shape) == 1 else (max(shape), min(shape))
    if width > WIDEST:
        return []
    # of MATLAB's arrays the axes stand in reverse; along which the time runs is told by the length alone
    across = len(shape) == 2 and (shape[1] > shape[0] or (shape[1] == shape[0] and "MATLAB_class" in item.attrs))
    if across and part is not None:
        return []  # a field with more numbers than the dataset has rows
    where = item.name

    def rows(file: Any, columns: Sequence[int]) -> Rows:
        return _Slices(path, file[where], part, columns, across=across)

    dotted = ".".join(p.strip() for p in name.split("/"))
    return [Variable(dotted, length, column_names(dotted, width), kind.itemsize, (), rows, whole=kind.kind in "iu")]


def _with_unit(variable: Variable, texts: dict[str, str]) -> Variable:
    """With the unit that a structure ``units`` beside a MATLAB array gives (``units.acc`` of ``acc``)."""
    parent, _, own = variable.name.rpartition(".")
    unit = texts.get("/".join([*parent.split("."), "units", own]).lstrip("/"), "")
    return replace(variable, units=(unit,) * len(variable.names)) if unit and not variable.units else variable


class _Slices:
    """Rows of a dataset, slice after slice."""

    def __init__(self, path: Path, item: Any, part: str | None, columns: Sequence[int], *, across: bool) -> None:
        self._path, self._item, self._part, self._columns, self._across = path, item, part, columns, across
        self._row = 0

    def take(self, count: int) -> tuple[list[NDArray[Any]], Fault | None]:
        """See :class:`Rows`; where a slice cannot be read, the part of it that can be is looked for by bisection."""
        cause = None
        try:
            block = self._slice(count)
        except _ERRORS as error:
            good, block, cause = 0, None, error
            while count - good > 1:
                middle = (good + count) // 2
                try:
                    block = self._slice(middle)
                    good = middle
                except _ERRORS as later:
                    count, cause = middle, later
            count = good
        self._row += count
        pieces = [np.zeros(0) if block is None else block[:, c] if block.ndim == 2 else block for c in self._columns]
        return pieces, None if cause is None else self._fault(cause)

    def _fault(self, cause: Exception) -> Fault:
        reason = f"{self._item.name} cannot be read from row {self._row + 1} on ({cause})"
        return Fault(self._path, self._place(), reason)

    def _slice(self, count: int) -> NDArray[Any]:
        span = slice(self._row, self._row + count)
        if self._part is not None:
            return np.asarray(self._item.fields(self._part)[span])
        return np.asarray(self._item[:, span]).T if self._across else np.asarray(self._item[span])

    def _place(self) -> int:
        """Byte of the file at which the piece with the next row lies, as far as HDF5 tells."""
        item = self._item
        if item.chunks is None:
            return int(item.id.get_offset() or 0)
        corner = [0] * item.ndim
        axis = 1 if self._across else 0
        corner[axis] = self._row // item.chunks[axis] * item.chunks[axis]
        try:
            return int(item.id.get_chunk_info_by_coord(tuple(corner)).byte_offset or 0)
        except _ERRORS:
            return 0

    def finish(self) -> None:
        """Nothing is left to check: HDF5 checks each piece as it is read."""
