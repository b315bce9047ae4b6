"""What the logs of robots have in common: records one after another, some of them packed in compressed chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..table import Fault

_OP, _ID, _TIME, _FIRST, _LAST, _AT = range(6)


@dataclass(frozen=True)
class Block:
    """A stretch of records in memory.

    Attributes
    ----------
    path : Path
    data : ndarray of uint8
    offset : int
        Byte of the file at which the stretch begins; of a decompressed one the byte at which its chunk begins.
    end : int
        Bytes of the file that have been read with it.
    packed : bool
        Whether it was decompressed, so that a byte in it is no byte of the file.
    broken : Fault or None
        What is to be raised after its last whole record.
    """

    path: Path
    data: NDArray[np.uint8]
    offset: int
    end: int
    packed: bool = False
    broken: Fault | None = None

    def fault(self, place: int, reason: str) -> Fault:
        """Damage at a byte of the stretch."""
        if self.packed:
            return Fault(self.path, self.offset, f"in the chunk that begins there, at byte {place} unpacked, {reason}")
        return Fault(self.path, self.offset + place, reason)

    def content(self, row: NDArray[np.int64]) -> bytes:
        """Content of a record."""
        return self.data[row[_FIRST] : row[_LAST]].tobytes()


class Records(NamedTuple):
    """Records found in a block, one a row as the kernels of :mod:`sagnac.kernels.bag_records` tell them."""

    block: Block
    rows: NDArray[np.int64]


class Channel(NamedTuple):
    """What messages of one number are."""

    topic: str
    type: str
    encoding: str


class Contents(NamedTuple):
    """What a log holds: its channels, how many messages each topic has, and the damage behind which more may lie."""

    channels: dict[int, Channel]
    counts: dict[str, int]
    fault: Fault | None = None


@dataclass(frozen=True)
class Messages:
    """Messages of one topic, as they lie in memory.

    Attributes
    ----------
    data : ndarray of uint8
    first, last : ndarray of int64, shape (n,)
        First byte of each message and the byte after it.
    received : ndarray of int64, shape (n,), ns
    encoding : str
        ``ros1`` or ``cdr``.
    end : int
        Bytes of the file that have been read with them.
    fault : callable
        ``fault(i, reason)`` is the damage of message `i`.
    """

    data: NDArray[np.uint8]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    received: NDArray[np.int64]
    encoding: str
    end: int
    fault: Callable[[int, str], Fault] = field(repr=False)


@dataclass(frozen=True)
class Container:
    """How a kind of log chains its messages.

    Attributes
    ----------
    walk : callable
        ``walk(path, stream, size)`` yields :class:`Records`.
    define : callable
        ``define(block, row, channels)`` reads a record that says what messages of one number are.
    message : int
        Op of a message.
    """

    walk: Callable[[Path, BinaryIO, int], Iterator[Records]]
    define: Callable[[Block, NDArray[np.int64], dict[int, Channel]], None]
    message: int


def messages(container: Container, path: Path, wanted: Callable[[Channel], bool]) -> Iterator[Messages]:
    """Messages of the channels that `wanted` picks, in the order of the file.

    Raises
    ------
    Fault
        After all that lies before the damage.
    """
    channels: dict[int, Channel] = {}
    with path.open("rb") as stream:
        for records in container.walk(path, stream, path.stat().st_size):
            rows = _messages(container, records, channels)
            mine = [(i, c.encoding) for i, c in channels.items() if wanted(c)]
            for encoding in sorted({e for _, e in mine}):
                these = rows[np.isin(rows[:, _ID], [i for i, e in mine if e == encoding])]
                if len(these):
                    yield _picked(records.block, these, encoding)


def _messages(container: Container, records: Records, channels: dict[int, Channel]) -> NDArray[np.int64]:
    """Rows of messages; those before them that say what the messages are, are read."""
    block, rows = records
    is_message = rows[:, _OP] == container.message
    for row in rows[~is_message]:
        container.define(block, row, channels)
    rows = np.compress(is_message, rows, axis=0)
    known = np.isin(rows[:, _ID], list(channels))
    if not known.all():
        row = rows[np.argmin(known)]
        raise block.fault(int(row[_AT]), f"a message of a connection ({row[_ID]}) that was not declared")
    return rows


def _picked(block: Block, rows: NDArray[np.int64], encoding: str) -> Messages:
    def fault(i: int, reason: str) -> Fault:
        return block.fault(int(rows[i, _AT]), reason)

    return Messages(block.data, rows[:, _FIRST], rows[:, _LAST], rows[:, _TIME], encoding, block.end, fault)


def survey(container: Container, path: Path) -> Contents:
    """Contents of a log without index, from all that can be read of it."""
    channels: dict[int, Channel] = {}
    count: dict[int, int] = {}
    fault = None
    with path.open("rb") as stream:
        try:
            for records in container.walk(path, stream, path.stat().st_size):
                rows = _messages(container, records, channels)
                for number, more in zip(*np.unique(rows[:, _ID], return_counts=True), strict=True):
                    count[int(number)] = count.get(int(number), 0) + int(more)
        except Fault as cause:
            fault = cause
    return Contents(channels, counted(channels, count), fault)


def counted(channels: dict[int, Channel], count: dict[int, int]) -> dict[str, int]:
    """Messages of each topic, from those of its connections."""
    out: dict[str, int] = {}
    for number, channel in channels.items():
        out[channel.topic] = out.get(channel.topic, 0) + count.get(number, 0)
    return out
