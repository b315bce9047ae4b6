"""MCAP files (mcap.dev/spec), with and without summary, chunks and checksums."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..table import Fault, Table
from . import bag, scan
from .bag import Block, Channel, Container, Contents, Records
from .imu import of_imu
from .topics import Bag, open_bags

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS = 2, 3, 4, 5, 6, 11
_STEP = 1 << 20  # bytes summed at a time
_END = 9 + 20 + len(_MAGIC)  # bytes of the footer and what follows it
_SCHEMA_KEY = -1  # schemas are kept beside the channels, under negative numbers


def open_table(path: Path, select: str | None = None) -> Table:
    """Open the Imu messages of one topic of an MCAP file.

    Parameters
    ----------
    path : Path
    select : str, optional
        The topic.

    Raises
    ------
    InputError
        As :func:`~.topics.open_bags`.
    """
    try:
        return open_bags(path, [mcap_bag(path)], select)
    except OSError as cause:
        raise InputError(f"{path}: cannot read: {cause.strerror}") from cause


def mcap_bag(path: Path) -> Bag:
    """One MCAP file, alone or as part of a ROS 2 bag.

    Raises
    ------
    InputError
        When it is not MCAP.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise InputError(f"{path}: not an MCAP file (its first bytes are others)")
        try:
            found = _summary(path, stream, size)
        except (Fault, struct.error):
            found = None  # what can be read of the records themselves counts
    channels, counts, fault = found or bag.survey(_CONTAINER, path)
    return Bag(
        path,
        size,
        {c.topic: c.type for i, c in channels.items() if i >= 0},
        lambda topic: bag.messages(_CONTAINER, path, of_imu(topic)),
        lambda: counts,
        fault=fault,
    )


def _walk(path: Path, stream: BinaryIO, size: int) -> Iterator[Records]:
    """Records of the whole file, those in its chunks in their place."""
    from ...kernels.bag_records import scan_mcap

    at, summed = len(_MAGIC), False
    while True:
        at = yield from scan.loose(path, stream, at, size, scan_mcap, _unwanted)
        if at >= size:
            raise Fault(path, size, "the file ends without its footer: it was not closed, or it was cut off")
        stream.seek(at)
        footer = stream.read(_END)
        if footer[0] == _FOOTER:
            break
        block, crc = _chunk(path, stream, at, size)
        summed = summed or crc != 0
        yield from scan.scanned(block, scan_mcap)
        at = block.end
    if len(footer) < _END or not footer.endswith(_MAGIC):
        raise Fault(path, at, "the file does not end with its footer")
    if not summed:
        _check_whole(path, stream, min(struct.unpack_from("<Q", footer, 9)[0] or at, at))


def _check_whole(path: Path, stream: BinaryIO, end: int) -> None:
    """Compare the data with the checksum of all of them, which stands in the record before byte `end`."""
    at = end - 13
    stream.seek(max(0, at))
    record = stream.read(13)
    crc, stated = 0, int.from_bytes(record[9:], "little")
    if at <= 0 or record[:1] != b"\x0f" or stated == 0:
        return
    stream.seek(0)
    for begin in range(0, at, _STEP):
        crc = crc32(stream.read(min(_STEP, at - begin)), crc)
    if crc != stated:
        raise Fault(path, at, "the data before it do not match the checksum that stands there")


def _unwanted(begin: bytes) -> int:
    """Length of a record that is neither schema, channel nor message."""
    return 0 if begin[0] in (_SCHEMA, _CHANNEL, _MESSAGE) else 9 + int.from_bytes(begin[1:9], "little")


def _chunk(path: Path, stream: BinaryIO, at: int, size: int) -> tuple[Block, int]:
    """Records of a chunk and its checksum: times (8, 8), size (8), CRC (4), compression (4 and its name), length (8), records."""
    stream.seek(at + 1)
    head = stream.read(8 + 32)
    body = at + 9 + 32 + (int.from_bytes(head[36:], "little") if len(head) == 40 else size) + 8
    if body > size:
        raise Fault(path, at, "the file ends inside the chunk that begins there")
    record, _, _, stated, crc, name = struct.unpack("<QQQQII", head)
    if name > 32:
        raise Fault(path, at, f"a chunk whose compression has a name of {name} bytes")
    codec = stream.read(name).decode("ascii", "replace")
    length = int.from_bytes(stream.read(8), "little")
    if body + length != at + 9 + record:
        raise Fault(path, at, f"a chunk of {record} bytes that says its records have {length}")
    raw = stream.read(length) if length <= scan.LIMIT else b""  # refused below
    block = scan.chunk_block(path, raw, at, body, length, codec or "none", stated)
    if crc and not block.broken and crc32(block.data.data) != crc:
        raise Fault(path, at, "the chunk that begins there does not match its checksum")
    return block, crc


def _define(block: Block, row: NDArray[np.int64], channels: dict[int, Channel]) -> None:
    """Read a schema (number, name, ...) or a channel (number, schema, topic, encoding, ...)."""
    op, at = int(row[0]), int(row[5])
    if op not in (_SCHEMA, _CHANNEL):
        return
    content = block.content(row)
    try:
        if op == _SCHEMA:
            channels[_SCHEMA_KEY - int.from_bytes(content[:2], "little")] = Channel("", _text(content, 2)[0], "")
            return
        schema = channels.get(_SCHEMA_KEY - int.from_bytes(content[2:4], "little"))
        topic, after = _text(content, 4)
        encoding, _ = _text(content, after)
    except (struct.error, ValueError) as cause:
        raise block.fault(at, "a channel or schema that cannot be") from cause
    channels[int.from_bytes(content[:2], "little")] = Channel(topic, schema.type if schema else "", encoding)


def _text(content: bytes, at: int) -> tuple[str, int]:
    """Text with its length before it, and the place after it."""
    (size,) = struct.unpack_from("<I", content, at)
    if size > len(content) - at - 4:
        raise ValueError(size)
    return content[at + 4 : at + 4 + size].decode(), at + 4 + size


def _summary(path: Path, stream: BinaryIO, size: int) -> Contents | None:
    """Channels and counts from the end of the file; None where it does not hold them all."""
    from ...kernels.bag_records import scan_mcap

    stream.seek(max(0, size - _END))
    footer = stream.read(_END)
    if size < _END + len(_MAGIC) or footer[0] != _FOOTER or not footer.endswith(_MAGIC):
        return None
    begin, _, crc = struct.unpack_from("<QQI", footer, 9)
    if not 0 < begin < size - _END or size - begin > scan.LIMIT:
        return None
    stream.seek(begin)
    raw = stream.read(size - _END - begin)
    if crc and crc32(raw + footer[: 9 + 16]) != crc:
        return None
    block = Block(path, np.frombuffer(raw, dtype=np.uint8), begin, size)
    channels: dict[int, Channel] = {}
    statistics = b""
    for _, rows in scan.scanned(block, scan_mcap):
        for row in rows:
            _define(block, row, channels)
            if row[0] == _STATISTICS:
                statistics = block.content(row)
    return _checked(channels, statistics)


def _checked(channels: dict[int, Channel], statistics: bytes) -> Contents | None:
    """Channels and counts when the statistics say that these are all channels."""
    _, _, number = struct.unpack_from("<QHI", statistics)
    if number != sum(i >= 0 for i in channels):
        return None
    counts = statistics[46:]  # after eight numbers and the length of these
    return Contents(channels, bag.counted(channels, dict(struct.iter_unpack("<HQ", counts[: len(counts) // 10 * 10]))))


_CONTAINER = Container(_walk, _define, _MESSAGE)
