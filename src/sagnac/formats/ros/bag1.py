"""ROS 1 bags, format 2.0, with and without index (wiki.ros.org/Bags/Format/2.0)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..table import Fault, Table
from . import bag, scan
from .bag import Block, Channel, Container, Contents, Records
from .imu import of_imu
from .topics import Bag, open_bags

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _INDEX_INFO, _CONNECTION = 2, 3, 6, 7
_HEADER = 1 << 16  # bytes within which the header of a chunk or bag must end


class _MalformedError(ValueError):
    """Fields that cannot be."""


def open_table(path: Path, select: str | None = None) -> Table:
    """Open the Imu messages of one topic of a ROS 1 bag.

    Parameters
    ----------
    path : Path
    select : str, optional
        The topic.

    Raises
    ------
    InputError
        When the bag is of another version or encrypted, or as :func:`~.topics.open_bags`.
    """
    try:
        return open_bags(path, [_bag(path)], select)
    except OSError as cause:
        raise InputError(f"{path}: cannot read: {cause.strerror}") from cause


def _bag(path: Path) -> Bag:
    size = path.stat().st_size
    with path.open("rb") as stream:
        magic = stream.read(len(_MAGIC))
        if magic != _MAGIC:
            raise InputError(
                f"{path}: {magic.strip().decode('ascii', 'replace')} is no bag of version 2.0; `rosbag fix` converts it"
            )
        fields, _ = _header(path, stream, len(_MAGIC), size)
        if fields.get(b"encryptor"):
            raise InputError(f"{path}: the bag is encrypted")
        try:
            index = _number(fields, b"index_pos")
            found = _indexed(path, stream, index, size, fields) if 0 < index < size else None
        except (_MalformedError, Fault):
            found = None  # what can be read of the records themselves counts
    channels, counts, fault = found or bag.survey(_CONTAINER, path)
    unclosed = fields.get(b"index_pos") == bytes(8)
    remarks = ("the bag has no index: it was not closed, and its last messages may be missing",)
    return Bag(
        path,
        size,
        {c.topic: c.type for c in channels.values()},
        lambda topic: bag.messages(_CONTAINER, path, of_imu(topic)),
        lambda: counts,
        remarks if unclosed else (),
        fault,
    )


def _walk(path: Path, stream: BinaryIO, size: int) -> Iterator[Records]:
    """Records of the whole file, those in its chunks in their place."""
    from ...kernels.bag_records import scan_ros1

    fields, at = _header(path, stream, len(_MAGIC), size)
    at += 4 + _length(path, stream, at, size)
    if at > size:
        raise Fault(path, len(_MAGIC), "the file ends inside the record that begins there")
    while True:
        at = yield from scan.loose(path, stream, at, size, scan_ros1, lambda _: 0)
        if at >= size:
            break
        block = _chunk(path, stream, at, size)
        yield from scan.scanned(block, scan_ros1)
        at = block.end
    try:
        index = _number(fields, b"index_pos")
    except _MalformedError:
        index = 0
    if index >= size:
        raise Fault(path, size, f"the file ends before its index, which was at byte {index}")


def _chunk(path: Path, stream: BinaryIO, at: int, size: int) -> Block:
    fields, body = _header(path, stream, at, size)
    try:
        stated, codec = _number(fields, b"size"), fields[b"compression"].decode("ascii", "replace")
    except (_MalformedError, KeyError) as cause:
        raise Fault(path, at, "a chunk that does not say its compression and size") from cause
    length = _length(path, stream, body, size)
    raw = stream.read(length) if length <= scan.LIMIT else b""  # refused below
    return scan.chunk_block(path, raw, at, body + 4, length, codec, stated)


def _length(path: Path, stream: BinaryIO, at: int, size: int) -> int:
    if size - at < 4:
        raise Fault(path, at, "the file ends inside a record")
    stream.seek(at)
    return int.from_bytes(stream.read(4), "little")


def _header(path: Path, stream: BinaryIO, at: int, size: int) -> tuple[dict[bytes, bytes], int]:
    """Fields of a record's header and the byte after it."""
    length = _length(path, stream, at, size)
    if length > min(_HEADER, size - at - 4):
        cut = length <= _HEADER
        raise Fault(path, at, "the file ends inside a record" if cut else f"a record whose header has {length} bytes")
    try:
        return _fields(stream.read(length)), at + 4 + length
    except _MalformedError as cause:
        raise Fault(path, at, str(cause)) from cause


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Fields ``name=value``, each with its length before it."""
    out: dict[bytes, bytes] = {}
    at = 0
    while at < len(header):
        size = int.from_bytes(header[at : at + 4], "little")
        name, equals, value = header[at + 4 : at + 4 + size].partition(b"=")
        if not equals or at + 4 + size > len(header):
            raise _MalformedError("a record whose header cannot be")
        out[name] = value
        at += 4 + size
    return out


def _number(fields: dict[bytes, bytes], name: bytes) -> int:
    value = fields.get(name, b"")
    if len(value) not in (4, 8):
        raise _MalformedError(f"a record without {name.decode()}")
    return int.from_bytes(value, "little")


def _define(block: Block, row: NDArray[np.int64], channels: dict[int, Channel]) -> None:
    """Read a record of a connection: its topic stands in the header, the type of its messages in the data."""
    op, number, _, first, _, at = row.tolist()
    if op != _CONNECTION:
        return
    try:
        named = _fields(block.data[at + 4 : first - 4].tobytes()) | _fields(block.content(row))
        topic, kind = named[b"topic"].decode(), named[b"type"].decode()
    except (_MalformedError, KeyError, UnicodeDecodeError) as cause:
        raise block.fault(at, "a connection without topic and type") from cause
    channels[number] = Channel(topic, kind, "ros1")


def _indexed(path: Path, stream: BinaryIO, at: int, size: int, fields: dict[bytes, bytes]) -> Contents | None:
    """Connections and counts from the end of the bag; None where they are not complete."""
    from ...kernels.bag_records import scan_ros1

    connections, chunks = _number(fields, b"conn_count"), _number(fields, b"chunk_count")
    channels: dict[int, Channel] = {}
    count: dict[int, int] = {}
    for block, rows in scan.loose(path, stream, at, size, scan_ros1, lambda _: 0):
        for row in rows:
            _define(block, row, channels)
            if row[0] == _INDEX_INFO:  # of a chunk: pairs of a connection and the number of its messages
                chunks -= 1
                content = block.content(row)
                for number, more in struct.iter_unpack("<II", content[: len(content) // 8 * 8]):
                    count[number] = count.get(number, 0) + more
    whole = len(channels) == connections and chunks == 0
    return Contents(channels, bag.counted(channels, count)) if whole else None


_CONTAINER = Container(_walk, _define, _MESSAGE)
