"""Comma, semicolon or tab separated text with one header line, streamed through pyarrow."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from .table import Table

_BLOCK = 1 << 23  # bytes read at a time: what bounds the memory
_HEADER = 1 << 16
_LINE = re.compile(r"\r\n|\n|\r")  # what pyarrow takes for the end of a line, and no more
_SHAPE = re.compile(r"Expected (\d+) columns, got \d+")
_VALUE = re.compile(r"CSV column #(\d+): .*invalid value '(.*)'", re.DOTALL)


@dataclass(frozen=True)
class _Layout:
    """Lines up to and with the header, what parts the fields, and the names of the columns."""

    path: Path
    skip: int
    delimiter: str
    names: tuple[str, ...]


def open_table(path: Path) -> Table:
    """Open a CSV file; lines before the header that start with ``#`` are comments.

    Raises
    ------
    InputError
        When there is no header, a name stands twice, or (while reading) a row has the wrong number of fields or a
        field is no number.
    """
    layout = _layout(path)
    twice = sorted({n for n in layout.names if layout.names.count(n) > 1})
    if twice:
        raise InputError(f"{path}: these columns stand more than once in the header: {', '.join(twice)}")

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        return _stream(layout, numeric, other)

    return Table(path, layout.names, read)


def _layout(path: Path) -> _Layout:
    lines = _LINE.split(_head(path))
    for i, line in enumerate(lines):
        if line.strip() and not line.lstrip().startswith("#"):
            if i == len(lines) - 1 and path.stat().st_size > _HEADER:
                break
            delimiter = max(",;\t", key=line.count)
            fields = next(csv.reader([line], delimiter=delimiter))
            names = tuple(name.strip() or f"column {k}" for k, name in enumerate(fields, 1))
            return _Layout(path, i + 1, delimiter, names)
    raise InputError(f"{path}: no header line (time [s],accel_x [g],...) found in its first {_HEADER // 1024} kB")


def _head(path: Path) -> str:
    """Beginning of the file as text."""
    with path.open("rb") as stream:
        head = stream.read(_HEADER)
    try:
        text = codecs.getincrementaldecoder("utf-8-sig")().decode(head, final=len(head) < _HEADER)
    except UnicodeDecodeError as cause:
        raise InputError(
            f"{path}: neither Parquet nor UTF-8 text (byte {cause.start}); a text file must be saved as UTF-8"
        ) from cause
    if "\0" in text:
        raise InputError(f"{path}: neither Parquet nor text (a zero byte at {text.index(chr(0))})")
    return text


def _stream(layout: _Layout, numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
    import pyarrow as pa

    types = dict.fromkeys(numeric, pa.float64()) | _types(layout, other)
    rows = 0
    try:
        for batch in _reader(layout, [*numeric, *other], types):
            rows += batch.num_rows
            yield batch
    except (pa.ArrowException, OSError) as cause:
        if _without_rows(str(cause)):
            return
        raise InputError(f"{layout.path}: {_located(layout, str(cause), rows)}") from cause


def _reader(layout: _Layout, wanted: Sequence[str], types: dict[str, Any]) -> Any:
    from pyarrow import csv as pacsv

    return pacsv.open_csv(
        layout.path,
        read_options=pacsv.ReadOptions(block_size=_BLOCK, column_names=list(layout.names), skip_rows=layout.skip),
        parse_options=pacsv.ParseOptions(delimiter=layout.delimiter),
        convert_options=pacsv.ConvertOptions(include_columns=wanted, column_types=types, strings_can_be_null=False),
    )


def _types(layout: _Layout, other: Sequence[str]) -> dict[str, Any]:
    """Types of the columns that are only passed on; text where the first block does not tell for the whole file."""
    import pyarrow as pa

    if not other or layout.path.stat().st_size <= _BLOCK:
        return {}
    try:
        for _ in _reader(layout, other, {}):
            pass
    except (pa.ArrowException, OSError):
        return dict.fromkeys(other, pa.string())
    return {}


def _without_rows(message: str) -> bool:
    """Whether pyarrow complains only because nothing follows the header."""
    return "Empty CSV" in message or "Could not skip initial" in message


def _located(layout: _Layout, message: str, rows: int) -> str:
    """What is wrong with which row, from pyarrow's message and the number of rows that were read well."""
    value = _VALUE.search(message)
    column = int(value[1]) if value else 0
    width = len(layout.names)
    for row, line, fields in _rows(layout):
        if row <= rows:
            continue
        if _SHAPE.search(message) and len(fields) != width:
            return f"row {row} (line {line}) has {len(fields)} fields where the header has {width}"
        if value and len(fields) == width and fields[column].strip() == value[2].strip():
            hint = "; decimals are written with a point" if re.fullmatch(r"\s*[+-]?\d*,\d+\s*", value[2]) else ""
            return f"row {row} (line {line}): {layout.names[column]!r} is {value[2]!r}, not a number{hint}"
    return f"cannot read the rows after row {rows}: {message.removeprefix('CSV parse error: ').strip()}"


def _rows(layout: _Layout) -> Iterator[tuple[int, int, list[str]]]:
    """Number, line and fields of each row that is not blank, as far as the text can be read."""
    with layout.path.open(encoding="utf-8-sig", errors="replace", newline=None) as stream:
        for _ in range(layout.skip):
            stream.readline()
        reader = csv.reader(stream, delimiter=layout.delimiter)
        row = 0
        try:
            for fields in reader:
                row += bool(fields)
                if fields:
                    yield row, layout.skip + reader.line_num, fields
        except csv.Error:  # a field without end: what was read well is all that can be said
            return
