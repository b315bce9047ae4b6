"""Elements of a MATLAB 5 file: where its arrays of numbers lie.

Layout: The MathWorks, "MAT-File Format", level 5.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..table import Fault
from .mat5_bytes import Inflated, Plain

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"}
_CHAR, _STRUCT, _NUMERIC = 4, 2, range(6, 16)  # classes of arrays
_COMPLEX = 0x800
_DEEPEST = 16  # structures in structures
_LONGEST_TEXT = 64


@dataclass
class Found:
    """What a file holds: arrays of numbers, and short texts that may be units."""

    arrays: list[Numbers] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Numbers:
    """Numbers of a matrix, column after column, `start` bytes into the `size` bytes that `source` opens."""

    name: str
    shape: tuple[int, int]
    kind: np.dtype[Any]
    source: Callable[[BinaryIO], Plain | Inflated]
    start: int
    size: int


def walk(path: Path, file: BinaryIO, found: Found) -> None:
    """Go through the elements of the file.

    Raises
    ------
    Fault
        At damage; what lies before it has been found.
    """
    size = path.stat().st_size
    head = file.read(_HEADER)
    if len(head) < _HEADER:
        raise Fault(path, size, f"the file ends within the header, which has {_HEADER} bytes")
    order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
    if order is None:
        raise Fault(path, 126, f"the byte order is {head[126:128]!r}, neither b'IM' nor b'MI'")
    at = _HEADER
    while at < size:
        file.seek(at)
        tag = file.read(8)
        if len(tag) < 8:
            raise Fault(path, size, f"the file ends within the tag of the variable at byte {at}")
        kind, length = struct.unpack(order + "II", tag)
        if kind not in (_MATRIX, _COMPRESSED):
            raise Fault(path, at, f"an element of type {kind}, where a variable should begin")
        end = at + 8 + length
        if end > size:
            raise Fault(
                path, size, f"the file ends {end - size} bytes before the end of the variable that begins at byte {at}"
            )
        _Reader(path, order, found, (at + 8, end), packed=kind == _COMPRESSED).variable(file)
        at = end


class _Reader:
    """Reader of one variable.

    Parameters
    ----------
    path, order : Path, str
        Order of bytes: ``<`` or ``>``.
    found : Found
        Gets what is found, when the variable is whole.
    place : tuple of int
        Bytes of the file where it begins and ends.
    packed : bool
        Whether it is compressed.
    """

    def __init__(self, path: Path, order: str, found: Found, place: tuple[int, int], *, packed: bool) -> None:
        self._path, self._order, self._found, self._place, self._packed = path, order, found, place, packed
        self._new = Found()

    def _open(self, file: BinaryIO) -> Plain | Inflated:
        return (Inflated if self._packed else Plain)(self._path, file, *self._place)

    def variable(self, file: BinaryIO) -> None:
        """Read it."""
        source = self._source = self._open(file)
        length = self._place[1] - self._place[0]
        if self._packed:
            kind, inside, _ = self._tag(None)
            # zlib cannot do better than 1032 to 1: what claims more is no data
            if kind != _MATRIX or inside > 1032 * length:
                raise self._damage(f"type {kind} of {inside} bytes where a compressed variable should begin")
            length = inside
        self._size = source.position + length
        self._matrix(self._size, "", 0)
        self._found.arrays += self._new.arrays
        self._found.texts |= self._new.texts

    def _damage(self, reason: str) -> Fault:
        return Fault(
            self._path, self._source.place, f"{reason}, in the variable that begins at byte {self._place[0] - 8}"
        )

    def _bytes(self, size: int) -> bytes:
        data = self._source.some(size)
        if len(data) < size:
            raise self._source.fault or self._damage("the data end too early")
        return data

    def _tag(self, end: int | None) -> tuple[int, int, bytes | None]:
        """Type and size of an element before `end`, and its data where they are packed into the tag."""
        raw = self._bytes(8)
        kind, size = struct.unpack(self._order + "II", raw)
        if kind >> 16:
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise self._damage(f"a short element of {size} bytes")
            return kind, size, raw[4 : 4 + size]
        if end is not None and size > end - self._source.position:
            raise self._damage(f"an element of {size} bytes where {end - self._source.position} are left")
        return kind, size, None

    def _small(self, end: int, largest: int) -> tuple[int, bytes]:
        """Type and data of an element that is part of the description of an array."""
        kind, size, data = self._tag(end)
        if data is None:
            if size > largest:
                raise self._damage(f"an element of {size} bytes in the description of an array")
            data = self._bytes(size)
            self._source.skip(-size % 8)
        return kind, data

    def _matrix(self, end: int, prefix: str, depth: int) -> None:
        """An array that ends at `end`: numbers are noted, structures gone through, the rest is left out."""
        if end == self._source.position:
            return  # an empty field of a structure
        flags = self._small(end, 8)[1]
        dimensions = self._small(end, 128)[1]
        name = self._small(end, 256)[1].decode("latin-1").strip()
        if len(flags) != 8 or len(dimensions) % 4 or len(dimensions) < 8:
            raise self._damage("an array without its description")
        (bits,) = struct.unpack(self._order + "I", flags[:4])
        shape = struct.unpack(f"{self._order}{len(dimensions) // 4}i", dimensions)
        if min(shape) < 0:
            raise self._damage(f"an array of the shape {shape}")
        name = f"{prefix}.{name}" if prefix and name else prefix or name
        kind = bits & 0xFF
        if kind == _STRUCT and math.prod(shape) == 1 and depth < _DEEPEST:
            self._struct(end, name, depth)
        elif kind in _NUMERIC and name and len(shape) == 2 and math.prod(shape) > 1 and not bits & _COMPLEX:
            self._numbers(end, name, shape)
        elif kind == _CHAR and math.prod(shape) <= _LONGEST_TEXT:
            stored, data = self._small(end, 4 * _LONGEST_TEXT)
            codec = _TEXTS.get(stored, "latin-1") + ({"<": "-le", ">": "-be"}[self._order] if stored in (4, 17) else "")
            self._new.texts[name] = data.decode(codec, errors="replace").strip()
        if depth:  # what stands at the top is found by the tag after it
            self._source.skip(max(end - self._source.position, 0))

    def _numbers(self, end: int, name: str, shape: tuple[int, ...]) -> None:
        stored, size, short = self._tag(end)
        if stored not in _NUMBERS:
            raise self._damage(f"numbers of the type {stored}")
        kind = np.dtype(self._order + _NUMBERS[stored])
        if size != math.prod(shape) * kind.itemsize:
            raise self._damage(f"{size} bytes of numbers in an array of the shape {shape}")
        start = self._source.position - (4 if short is not None else 0)
        self._new.arrays.append(Numbers(name, (shape[0], shape[1]), kind, self._open, start, self._size))

    def _struct(self, end: int, name: str, depth: int) -> None:
        raw = self._small(end, 4)[1]
        width = struct.unpack(self._order + "i", raw)[0] if len(raw) == 4 else 0
        fields = self._small(end, 1 << 20)[1]
        if not 0 < width <= 256 or len(fields) % width:
            raise self._damage(f"names of fields in {len(fields)} bytes, {width} each")
        for at in range(0, len(fields), width):
            own = fields[at : at + width].split(b"\0")[0].decode("latin-1")
            kind, size, short = self._tag(end)
            if kind != _MATRIX or short is not None:
                raise self._damage(f"an element of type {kind} where the field {own!r} should begin")
            self._matrix(self._source.position + size, f"{name}.{own}" if name else own, depth + 1)
