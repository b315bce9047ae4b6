"""Bytes of a MATLAB 5 file from one place on, plain or through zlib; short at damage, never more than asked for."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import BinaryIO

from ..table import Fault

_PIECE = 1 << 16  # compressed bytes given to zlib at a time
_SKIP = 1 << 20


class Plain:
    """Bytes `begin` to `end` of a file.

    Parameters
    ----------
    path : Path
        For messages.
    file : binary file
        May be shared: it is positioned before every reading.
    begin, end : int
    """

    def __init__(self, path: Path, file: BinaryIO, begin: int, end: int) -> None:
        self._path, self._file, self._begin, self._end = path, file, begin, end
        self.position = 0
        self.fault: Fault | None = None

    def some(self, size: int) -> bytes:
        """The next bytes; fewer at damage, of which `fault` then tells."""
        self._file.seek(self._begin + self.position)
        data = self._file.read(min(size, max(self._end - self._begin - self.position, 0)))
        self.position += len(data)
        if len(data) < size:
            self.fault = Fault(self._path, self.place, "the data end too early")
        return data

    def skip(self, size: int) -> None:
        """Leave bytes out."""
        self.position += size

    @property
    def place(self) -> int:
        """Byte of the file that is next."""
        return min(self._begin + self.position, self._end)

    def finish(self, size: int) -> None:
        """Nothing to check: plain data have no checksum."""


class Inflated:
    """The same of data compressed by zlib; `position` counts the bytes that come out."""

    def __init__(self, path: Path, file: BinaryIO, begin: int, end: int) -> None:
        self._path, self._file, self.place, self._end = path, file, begin, end
        self._engine = zlib.decompressobj()
        self._tail = b""  # read from the file and not yet taken by zlib
        self.position = 0
        self.fault: Fault | None = None

    def some(self, size: int) -> bytes:
        """The next bytes; fewer at damage, of which `fault` then tells."""
        parts: list[bytes] = []
        need = size
        while need > 0 and self.fault is None:
            part = self._part(need)
            parts.append(part)
            need -= len(part)
        data = b"".join(parts)
        self.position += len(data)
        return data

    def _part(self, size: int) -> bytes:
        """A piece of at most `size` bytes; sets `fault` where there is none."""
        reason = "the compressed data end too early"
        while size and not self._engine.eof:
            before = self._engine.copy()
            try:
                part = self._engine.decompress(self._tail, size)
            except zlib.error as cause:  # what was inflated before the damage is lost with it: ask for less
                self._engine, size, reason = before, size // 2, f"compressed data cannot be read: {cause}"
                continue
            self._tail = self._engine.unconsumed_tail
            if part:
                return part
            self._file.seek(self.place)
            self._tail = self._file.read(min(_PIECE, self._end - self.place))
            self.place += len(self._tail)
            if not self._tail:
                break
        self.fault = Fault(self._path, self.place, reason)
        return b""

    def skip(self, size: int) -> None:
        """Leave bytes out: they are inflated and dropped."""
        while size > 0 and self.fault is None:
            size -= len(self.some(min(size, _SKIP)))

    def finish(self, size: int) -> None:
        """Read to the end, where the checksum stands.

        Parameters
        ----------
        size : int
            Bytes that should come out in all.

        Raises
        ------
        Fault
            When the checksum is not that of the data, or more data come than should.
        """
        while not self._engine.eof and self.fault is None:
            self.some(_SKIP)
            if self.position > size:
                self.fault = Fault(self._path, self.place, "more compressed data than their description says")
                raise self.fault
        if not self._engine.eof and self.fault is not None:
            raise self.fault
