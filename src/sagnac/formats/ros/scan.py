"""Records of the logs of robots: those in chunks, which are decompressed, and those that stand in none."""

from __future__ import annotations

import bz2
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..table import Fault
from .bag import Block, Records

LIMIT = 1 << 28  # bytes of a chunk or record: what bounds the memory
ROWS = 1 << 16  # records found at a time
_WINDOW = 1 << 16  # bytes read at first where no chunk tells how many
_STEP = 1 << 20  # bytes decompressed at a time

Scan = Callable[[NDArray[np.uint8], int, NDArray[np.int64]], tuple[int, int, int]]
"""A kernel that finds records, see :mod:`sagnac.kernels.bag_records`."""


def scanned(block: Block, scan: Scan) -> Iterator[Records]:
    """Records of a block that holds nothing else."""
    at = 0
    while at < block.data.size:
        out = np.empty((min(ROWS, block.data.size // 9 + 1), 6), dtype=np.int64)
        count, at, status = scan(block.data, at, out)
        if count:
            yield Records(block, out[:count])
        if status:
            cut_off = block.broken if block.packed and status == 1 else None
            raise cut_off or block.fault(at, _reason(status))
    if block.broken:
        raise block.broken


def loose(
    path: Path, stream: BinaryIO, at: int, size: int, scan: Scan, skip: Callable[[bytes], int]
) -> Generator[Records, None, int]:
    """Records that stand in no chunk, from byte `at`; returns the byte of the first that the kernel does not read.

    Parameters
    ----------
    path : Path
    stream : file
    at : int
    size : int
        Of the file.
    scan : callable
    skip : callable
        Length of the record that begins with the given bytes when nobody wants its content, otherwise 0.
    """
    window = _WINDOW
    while at < size:
        stream.seek(at)
        data = np.frombuffer(stream.read(min(window, size - at)), dtype=np.uint8)
        block = Block(path, data, at, at + data.size)
        out = np.empty((min(ROWS, data.size // 9 + 1), 6), dtype=np.int64)
        count, used, status = scan(data, 0, out)
        if count:
            yield Records(block, out[:count])
        at += used
        if status == 3:
            return at
        whole = at + data.size - used >= size
        if status == 1 and not whole:
            unwanted = skip(data[used : used + 16].tobytes())
            if unwanted and at + unwanted <= size:
                at += unwanted
            elif used == 0 and window >= LIMIT:
                raise block.fault(0, f"a record longer than the {LIMIT >> 20} MiB that are read")
            window = max(window, min(2 * window, 1 << 22)) if used else 2 * window
        elif status:
            raise block.fault(used, _reason(status))
    return at


def _reason(status: int) -> str:
    return "the file ends inside the record that begins there" if status == 1 else "no record can begin like this"


def chunk_block(path: Path, raw: bytes, at: int, body: int, length: int, codec: str, stated: int) -> Block:
    """Records of a chunk, decompressed; those of a chunk that the file cuts off as far as they go.

    Parameters
    ----------
    path : Path
    raw : bytes
        Of the chunk's `length` bytes those that the file has.
    at, body : int
        First byte of the chunk's record and of `raw`.
    length : int
    codec : str
        ``none``, ``bz2``, ``lz4`` (frames) or ``zstd``.
    stated : int
        Bytes that it is said to have when decompressed.

    Raises
    ------
    Fault
        When it is larger than :data:`LIMIT`, not what was stated, or cannot be decompressed.
    """
    if length > LIMIT or stated > LIMIT:
        raise Fault(path, at, f"a chunk larger than the {LIMIT >> 20} MiB that are read at once")
    cut = Fault(path, at, "the file ends inside the chunk that begins there") if len(raw) < length else None
    if cut and codec == "none":
        cut = Fault(path, body + len(raw), f"the file ends inside the chunk that begins at byte {at}")
    if codec == "none":
        if stated != length:
            raise Fault(path, at, f"a chunk of {length} bytes that says it has {stated}")
        return Block(path, np.frombuffer(raw, dtype=np.uint8), body, body + len(raw), broken=cut)
    data, complaint = unpacked(raw, codec, stated)
    if complaint and cut is None:
        raise Fault(path, at, f"the chunk that begins there cannot be unpacked: {complaint}")
    seen = np.frombuffer(memoryview(data).toreadonly(), dtype=np.uint8)
    return Block(path, seen, at, body + len(raw), packed=True, broken=cut)


def unpacked(raw: bytes, codec: str, stated: int) -> tuple[bytearray, str]:
    """Decompressed bytes as far as they go, never more than stated, and what is wrong with them."""
    out = bytearray()
    try:
        pull = _puller(raw, codec)
        while len(out) <= stated and (piece := pull(min(_STEP, stated + 1 - len(out)))):
            out += piece
    except (OSError, EOFError, ValueError) as cause:
        return out[:stated], str(cause)
    if len(out) != stated:
        return out[:stated], f"it has {'more' if len(out) > stated else len(out)} bytes where {stated} are stated"
    return out, ""


def _puller(raw: bytes, codec: str) -> Callable[[int], bytes]:
    """Function that gives the next decompressed bytes, at most as many as asked for."""
    if codec == "bz2":
        machine = bz2.BZ2Decompressor()
        given = iter((raw,))

        def pull(most: int) -> bytes:
            return b"" if machine.eof else machine.decompress(next(given, b""), most)

        return pull
    import pyarrow as pa

    if codec not in ("lz4", "zstd"):
        raise ValueError(f"compression {codec!r} is not known here")
    read: Callable[[int], bytes] = pa.CompressedInputStream(pa.BufferReader(raw), codec).read
    return read
