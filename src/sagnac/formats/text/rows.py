"""Rows of numbers in a text file, parsed block by block through pyarrow."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..table import Fault
from .lines import blocks, hint

BATCH = 1 << 17
"""Rows handed out at a time."""
COMMENTS = (b"#", b"%", b"//")
_COMMENT = re.compile(rb"[ \t]*(?:#|%|//)[^\n]*")


@dataclass(frozen=True)
class Layout:
    """How the rows of a text file are written.

    Attributes
    ----------
    path : Path
    start : int
        Byte of the first line that may be a row.
    line : int
        Number of that line, counted from one.
    delimiter : str
        What parts the fields; a blank stands for any run of blanks and tabs.
    names : tuple of str
        One per field.
    seen : list of int
        One number: bytes parsed by the latest reading.
    """

    path: Path
    start: int
    line: int
    delimiter: str
    names: tuple[str, ...]
    seen: list[int] = field(default_factory=lambda: [0])

    def position(self) -> int:
        """Bytes parsed by the latest reading."""
        return self.seen[0]


def rows(layout: Layout, wanted: Mapping[str, bool]) -> Iterator[Any]:
    """Record batches of the wanted columns; comments and blank lines are no rows.

    Parameters
    ----------
    layout : Layout
    wanted : mapping of str to bool
        Columns, and whether they are numbers; others are handed out as text.

    Raises
    ------
    Fault
        At the first row with another number of fields or a field that is no number, after all rows before it.
    """
    row, line = 1, layout.line
    layout.seen[0] = layout.start
    for offset, raw in blocks(layout.path, layout.start):
        text = _unix(raw)
        try:
            table = _parsed(layout, text, wanted)
            fault = None
        except _errors() as cause:
            table, fault = _up_to_fault(layout, wanted, raw, _Place(offset, row, line), str(cause))
        layout.seen[0] = offset + len(raw)
        line += text.count(b"\n")
        if table is not None:
            row += table.num_rows
            yield from table.combine_chunks().to_batches(max_chunksize=BATCH)
        if fault is not None:
            raise fault


def _errors() -> tuple[type[Exception], ...]:
    import pyarrow as pa

    return (pa.ArrowException, UnicodeDecodeError)


def _unix(raw: bytes) -> bytes:
    return raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in raw else raw


def tidy(text: bytes, delimiter: str) -> bytes:
    """The same lines without comments, runs of blanks as one where blanks part the fields.

    Whole-block replacements: a loop over lines would take longer than the parsing.
    """
    if any(mark in text for mark in COMMENTS):
        text = _COMMENT.sub(b"", text)
    if delimiter != " ":
        return text
    text = text.replace(b"\t", b" ")
    while b"  " in text:
        text = text.replace(b"  ", b" ")
    return text.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")


def _parsed(layout: Layout, text: bytes, wanted: Mapping[str, bool]) -> Any:
    """Arrow table of the lines, None when there is no row in them."""
    import pyarrow as pa
    from pyarrow import csv

    text = tidy(text, layout.delimiter)
    if not text.strip():
        return None
    types = {name: pa.float64() if number else pa.string() for name, number in wanted.items()}
    return csv.read_csv(
        pa.py_buffer(text),
        # one pyarrow block a thread; no line can be longer than what is given
        read_options=csv.ReadOptions(column_names=list(layout.names), block_size=max(1 << 20, len(text) // 4)),
        parse_options=csv.ParseOptions(delimiter=layout.delimiter, quote_char=False),
        convert_options=csv.ConvertOptions(include_columns=list(wanted), column_types=types, strings_can_be_null=False),
    )


@dataclass(frozen=True)
class _Place:
    """Byte, row and line at which a block begins."""

    offset: int
    row: int
    line: int


def _up_to_fault(layout: Layout, wanted: Mapping[str, bool], raw: bytes, at: _Place, message: str) -> tuple[Any, Fault]:
    """Rows of a block before the first bad one, and what is wrong with that.

    The parser itself is asked, by bisection: a second opinion on what a number is might differ.
    """
    lines = raw.splitlines(keepends=True)
    good, bad, table = 0, len(lines), None
    while bad - good > 1:
        middle = (good + bad) // 2
        try:
            table = _parsed(layout, _unix(b"".join(lines[:middle])), wanted)
            good = middle
        except _errors() as cause:
            bad, message = middle, str(cause)
    sound = table.num_rows if table is not None else 0
    place = f"row {at.row + sound} (line {at.line + good})"
    offset = at.offset + sum(map(len, lines[:good]))
    last = offset + len(lines[good]) >= layout.path.stat().st_size and not lines[good].endswith((b"\n", b"\r"))
    return table, Fault(layout.path, offset, place + _reason(layout, wanted, lines[good], message, last=last))


def _reason(layout: Layout, wanted: Mapping[str, bool], line: bytes, message: str, *, last: bool) -> str:
    text = tidy(line.strip(b"\r\n"), layout.delimiter).decode("utf-8", errors="replace")
    fields = text.split(layout.delimiter)
    if len(fields) != len(layout.names):
        cut = ", the last line, is cut off: it" if last and len(fields) < len(layout.names) else ""
        return f"{cut} has {len(fields)} fields where there are {len(layout.names)} columns"
    for name, value in zip(layout.names, fields, strict=True):
        if wanted.get(name) and not _is_number(value):
            return f": column {name!r} is {value.strip()[:60]!r}, not a number{hint(value)}"
    return f" cannot be read: {message.removeprefix('CSV conversion error to double: ')[:200]}"


def _is_number(text: str) -> bool:
    try:
        float(text or "nan")
    except ValueError:
        return False
    return "_" not in text
