"""Lines of a text file with their place in it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ..table import Fault

BLOCK = 1 << 23
"""Bytes read at a time: what bounds the memory."""
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+\s*")
_UNENDED = "the file does not end with a line break: a last number that was cut off would not be seen"


def hint(value: str) -> str:
    """What to add to the message when a field is a number of another country."""
    return "; decimals are written with a point" if _DECIMAL_COMMA.fullmatch(value) else ""


def unended(path: Path) -> tuple[str, ...]:
    """A remark when the last line has no end, as in a log whose writer was stopped."""
    with path.open("rb") as stream:
        stream.seek(max(path.stat().st_size - 1, 0))
        return () if stream.read(1) in b"\r\n" else (_UNENDED,)


def blocks(path: Path, start: int) -> Iterator[tuple[int, bytes]]:
    """Whole lines with the byte where they begin, about :data:`BLOCK` bytes at a time.

    Raises
    ------
    Fault
        When a line is longer than a block.
    """
    with path.open("rb") as stream:
        stream.seek(start)
        rest = b""
        while data := stream.read(BLOCK):
            data = rest + data
            end = (data.rfind(b"\n") + 1) or (data[:-1].rfind(b"\r") + 1)  # the last \r may be half of \r\n
            if end:
                yield start, data[:end]
            elif len(data) > BLOCK:
                raise Fault(path, start, f"a line without end: {len(data)} bytes and no line break")
            start, rest = start + end, data[end:]
        if rest:
            yield start, rest
