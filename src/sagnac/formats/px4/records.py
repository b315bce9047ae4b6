"""The records of a ULog file in their order, and the data of the topics asked for.

Source: PX4 guide, "ULog File Format" (dev_log/ulog_file_format).
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..blocks import Blocks
from ..table import Fault
from .definitions import LARGEST, DefinitionError, Formats, Topic

_HEADER = 16
_FLAGS = 40  # bytes of the record B, as far as it is known
_MANY = 1 << 16  # records listed at a time

Record = NDArray[Any]
"""Structured array with the plain fields of a topic."""
Wanted = Callable[[str, int], bool]
"""Tells by name and instance of a topic whether its data are wanted."""


@dataclass
class Log:
    """What a walk through a file has met so far.

    Attributes
    ----------
    formats : Formats
    topics : dict of int to Topic
        By message number.
    dropouts : list of int, ms
        Stretches that the logger could not write.
    position : int
        First byte that was not looked at.
    """

    formats: Formats = field(default_factory=Formats)
    topics: dict[int, Topic] = field(default_factory=dict)
    dropouts: list[int] = field(default_factory=list)
    position: int = _HEADER


def walk(path: Path, log: Log, wanted: Wanted) -> Iterator[tuple[Topic, Record]]:
    """Data of the wanted topics, in the order of the file, many messages of one topic at a time.

    Parameters
    ----------
    path : path
    log : Log
        A new one; filled on the way.
    wanted : callable

    Raises
    ------
    InputError
        When the file is of a version that must not be read.
    Fault
        At the first record that is none or unfinished, after all before it was yielded.
    """
    stretches = _stretches(path)
    lists = _Lists()
    with Blocks(path, *stretches[0]) as blocks:
        for i, stretch in enumerate(stretches):
            if i:
                blocks.restart(*stretch)
            yield from _stretch(path, blocks, log, lists, wanted)
        if blocks.data.size:  # of an earlier stretch the unfinished end is to be ignored
            raise Fault(path, log.position, "the file ends within a record")


class _Lists:
    """What the kernel looks up and fills."""

    def __init__(self) -> None:
        self.shortest, self.longest = np.full(LARGEST, -1, dtype=np.int32), np.zeros(LARGEST, dtype=np.int32)
        self.wanted = np.zeros(LARGEST, dtype=np.uint8)
        self.places, self.kinds = np.empty(_MANY, dtype=np.int64), np.empty(_MANY, dtype=np.uint16)


def _stretch(path: Path, blocks: Blocks, log: Log, lists: _Lists, wanted: Wanted) -> Iterator[tuple[Topic, Record]]:
    from ...kernels import records

    at = 0
    while True:
        at, count, why = records.walk_ulog(
            blocks.data, at, lists.shortest, lists.longest, lists.wanted, lists.places, lists.kinds
        )
        log.position = blocks.base + at
        kinds = lists.kinds[:count]
        for kind in np.unique(kinds):
            topic = log.topics[int(kind)]
            raw = records.gather(blocks.data, lists.places[:count][kinds == kind], topic.dtype.itemsize)
            yield topic, raw.view(topic.dtype)[:, 0]
        if why == records.DAMAGED:
            raise Fault(path, log.position, "no ULog record stands here")
        if why == records.CONTROL:
            at += _control(path, blocks.data[at:], log, lists, wanted)
        elif why == records.UNFINISHED:
            if not blocks.more(at):
                return
            at = 0


def _stretches(path: Path) -> list[tuple[int, int]]:
    """Parts of the file: data may have been appended, behind a log that stopped anywhere."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(_HEADER + 3 + _FLAGS)
    if len(head) < _HEADER:
        raise Fault(path, len(head), "the file ends within its header")
    if head[_HEADER + 2 : _HEADER + 3] != b"B" or len(head) < _HEADER + 3 + _FLAGS:
        return [(_HEADER, size)]
    flags, *offsets = struct.unpack_from("<8x8s3Q", head, _HEADER + 3)
    if flags[0] & ~1 or any(flags[1:]):
        raise InputError(
            f"{path}: a ULog file of a later kind (incompatible flags {flags.hex()}), which cannot be read"
        )
    ends = [offset for offset in offsets if offset] if flags[0] & 1 else []
    if sorted(set(ends)) != ends or any(end < _HEADER for end in ends):
        raise Fault(path, _HEADER + 3 + 16, f"data are said to be appended at {ends}")
    return list(itertools.pairwise([_HEADER, *(end for end in ends if end < size), size]))


def _control(path: Path, data: NDArray[np.uint8], log: Log, lists: _Lists, wanted: Wanted) -> int:
    """Note a record that says something about others; its length."""
    size, letter = int(data[0]) | int(data[1]) << 8, chr(data[2])
    content = data[3 : 3 + size].tobytes()
    try:
        if letter == "O":
            log.dropouts.append(int.from_bytes(content, "little"))
        elif letter == "F":
            log.formats.define(content.decode("ascii"))
        elif letter == "A":
            _subscribe(content, log, lists, wanted)
    except (DefinitionError, UnicodeDecodeError) as cause:
        raise Fault(path, log.position, str(cause)) from cause
    return 3 + size


def _subscribe(content: bytes, log: Log, lists: _Lists, wanted: Wanted) -> None:
    if len(content) < 4:
        raise DefinitionError("a subscription without a name")
    number, name = int.from_bytes(content[1:3], "little"), content[3:].decode("ascii")
    topic = log.formats.topic(name, content[0], wanted(name, content[0]))
    if log.topics.setdefault(number, topic) != topic:
        raise DefinitionError(f"message {number} is announced as {name} and was {log.topics[number].name}")
    lists.shortest[number], lists.longest[number] = topic.shortest, topic.longest
    lists.wanted[number] = topic.dtype is not None
