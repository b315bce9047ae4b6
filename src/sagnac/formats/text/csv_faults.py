"""Where a CSV file is damaged: pyarrow tells what is wrong, the lines are searched for it."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..table import Fault
from .lines import blocks, hint

_SHAPE = re.compile(r"Expected (\d+) columns, got \d+")
_VALUE = re.compile(r"CSV column #(\d+): .*invalid value '(.*)'", re.DOTALL)


@dataclass(frozen=True)
class Layout:
    """Lines up to and with the header, what parts the fields, and the names of the columns."""

    path: Path
    skip: int
    delimiter: str
    names: tuple[str, ...]


def up_to_fault(
    layout: Layout, message: str, rows: int, wanted: Sequence[str], types: dict[str, Any]
) -> tuple[list[Any], Fault]:
    """The rows after those read well and before the first bad one, and what is wrong with that."""
    import pyarrow as pa
    from pyarrow import csv as pacsv

    sound: list[Any] = []
    begin, end, reason = _located(layout, message, rows)
    while end > begin:
        with layout.path.open("rb") as stream:
            stream.seek(begin)
            piece = pa.py_buffer(stream.read(end - begin))
        try:
            sound = pacsv.read_csv(
                piece,
                pacsv.ReadOptions(block_size=max(1 << 20, end - begin), column_names=list(layout.names)),
                pacsv.ParseOptions(delimiter=layout.delimiter),
                pacsv.ConvertOptions(include_columns=wanted, column_types=types, strings_can_be_null=False),
            ).to_batches()
            break
        except pa.ArrowException as cause:  # an earlier row is bad too: threads read beside each other
            _, earlier, why = _located(layout, str(cause), rows)
            if earlier >= end:
                break
            end, reason = earlier, why
    fault = Fault(layout.path, end, reason)
    fault.args = (f"{layout.path}: {reason} (byte {end})",)  # a person finds a row and a line sooner than a byte
    return sound, fault


def without_rows(message: str) -> bool:
    """Whether pyarrow complains only because nothing follows the header."""
    return "Empty CSV" in message or "Could not skip initial" in message


def _located(layout: Layout, message: str, rows: int) -> tuple[int, int, str]:
    """Bytes of the first row that was not read and of the bad one, and what is wrong with that, from pyarrow's message."""
    value = _VALUE.search(message)
    column = int(value[1]) if value else 0
    width = len(layout.names)
    begin = layout.path.stat().st_size
    for row, line, offset, fields in _rows(layout):
        if row <= rows:
            continue
        begin = min(begin, offset)
        if _SHAPE.search(message) and len(fields) != width:
            return begin, offset, f"row {row} (line {line}) has {len(fields)} fields where the header has {width}"
        if value and len(fields) == width and fields[column].strip() == value[2].strip():
            reason = f"{layout.names[column]!r} is {value[2]!r}, not a number{hint(value[2])}"
            return begin, offset, f"row {row} (line {line}): {reason}"
    return begin, begin, f"cannot read the rows after row {rows}: {message.removeprefix('CSV parse error: ').strip()}"


def _rows(layout: Layout) -> Iterator[tuple[int, int, int, list[str]]]:
    """Number, line, byte and fields of each row that is not blank, as far as the text can be read."""
    byte = 0  # of the next line: the reader takes whole lines, as many as a quoted field holds

    def lines() -> Iterator[str]:
        nonlocal byte
        for offset, raw in blocks(layout.path, 0):
            byte = offset
            for line in raw.splitlines(keepends=True):
                byte += len(line)
                yield line.decode("utf-8", errors="replace")

    source = lines()
    for _ in range(layout.skip):
        next(source, "")
    reader = csv.reader(source, delimiter=layout.delimiter)
    row, begin = 0, byte
    try:
        for fields in reader:
            row += bool(fields)
            if fields:
                yield row, layout.skip + reader.line_num, begin, fields
            begin = byte
    except (csv.Error, Fault):  # a field or a line without end: what was read well is all that can be said
        return
