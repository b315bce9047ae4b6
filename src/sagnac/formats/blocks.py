"""A file read piece by piece for parsers that stop where a record is unfinished."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

SIZE = 1 << 22  # bytes read at a time: what bounds the memory


class Blocks:
    """A stretch of a file in pieces, each beginning where the parser stopped in the one before.

    Parameters
    ----------
    path : path
    start, stop : int
        First byte, and the one behind the last.

    Attributes
    ----------
    data : ndarray of uint8
        The piece in hand.
    base : int
        Where in the file it begins.
    """

    def __init__(self, path: Path, start: int, stop: int) -> None:
        self._stream = path.open("rb", buffering=0)
        self._stop = stop
        self.restart(start, stop)

    def __enter__(self) -> Blocks:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()

    def restart(self, start: int, stop: int) -> None:
        """Go on with another stretch."""
        self._stream.seek(start)
        self._stop, self.base = stop, start
        self.data: NDArray[np.uint8] = np.empty(0, dtype=np.uint8)
        self.more(0)

    @property
    def last(self) -> bool:
        """Whether nothing follows the piece in hand."""
        return self.base + self.data.size >= self._stop

    def more(self, used: int) -> bool:
        """Drop the first `used` bytes and read on behind the others; whether anything came."""
        rest = self.data[used:]
        self.base += used
        wanted = min(SIZE, max(self._stop - self.base - rest.size, 0))
        read = np.frombuffer(self._stream.read(wanted), dtype=np.uint8)
        self.data = np.concatenate((rest, read))
        if read.size < wanted:  # the file has become shorter, or the system gives less at a time
            self._stop = self._stop if read.size else self.base + self.data.size
        return read.size > 0
