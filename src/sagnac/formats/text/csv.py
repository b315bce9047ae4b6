"""Comma, semicolon or tab separated text with one header line, streamed through pyarrow."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ...errors import InputError
from ..table import Table
from .csv_faults import Layout, up_to_fault, without_rows
from .lines import unended

_BLOCK = 1 << 23  # bytes read at a time: what bounds the memory
_HEADER = 1 << 16
_COMMENTS = ("#", "%", "//")
_LINE = re.compile(r"\r\n|\n|\r")  # what pyarrow takes for the end of a line, and no more


def open_table(path: Path) -> Table:
    """Open a CSV file; lines before the header that start with ``#``, ``%`` or ``//`` are comments.

    Raises
    ------
    InputError
        When there is no header, numbers stand in its place, or a name stands twice. Fault (while reading) at a row
        with the wrong number of fields or a field that is no number.
    """
    layout = _layout(path)
    twice = sorted({n for n in layout.names if layout.names.count(n) > 1})
    if twice:
        raise InputError(f"{path}: these columns stand more than once in the header: {', '.join(twice)}")

    seen = [0]

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        return _stream(layout, numeric, other, seen)

    return Table(path, layout.names, read, unended(path), position=lambda: seen[0], size=path.stat().st_size)


def _layout(path: Path) -> Layout:
    lines = _LINE.split(_head(path))
    for i, line in enumerate(lines):
        if line.strip() and not line.lstrip().startswith(_COMMENTS):
            if i == len(lines) - 1 and path.stat().st_size > _HEADER:
                break
            delimiter = max(",;\t", key=line.count)
            fields = next(csv.reader([line], delimiter=delimiter))
            _refuse_numbers(path, i + 1, fields)
            names = tuple(name.strip() or f"column {k}" for k, name in enumerate(fields, 1))
            return Layout(path, i + 1, delimiter, names)
    raise InputError(f"{path}: no header line (time [s],accel_x [g],...) found in its first {_HEADER // 1024} kB")


def _refuse_numbers(path: Path, line: int, fields: Sequence[str]) -> None:
    """Refuse a first row of data in the header's place: it would be lost, and its numbers be names of columns."""
    try:
        numbers = [float(field) for field in fields if field.strip()]
    except ValueError:
        return
    if numbers:
        raise InputError(
            f"{path}: line {line} is numbers alone where the header (time [s],accel_x [g],...) should stand; write a "
            "header before it, or take quotes away from the numbers: columns without names are then 1, 2, ..."
        )


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


def _stream(layout: Layout, numeric: Sequence[str], other: Sequence[str], seen: list[int]) -> Iterator[Any]:
    import pyarrow as pa

    types = dict.fromkeys(numeric, pa.float64()) | _types(layout, other)
    rows = seen[0] = 0
    try:
        # both are closed where the rows are left before their end: the reader parses ahead in threads
        with pa.OSFile(str(layout.path)) as source, _reader(layout, source, [*numeric, *other], types) as reader:
            for batch in reader:
                rows += batch.num_rows
                seen[0] = source.tell()
                types = {column.name: column.type for column in batch.schema}
                yield batch
    except (pa.ArrowException, OSError) as cause:
        if without_rows(str(cause)):
            return
        sound, fault = up_to_fault(layout, str(cause), rows, [*numeric, *other], types)
        yield from sound
        raise fault from cause


def _reader(layout: Layout, source: Any, wanted: Sequence[str], types: dict[str, Any]) -> Any:
    from pyarrow import csv as pacsv

    return pacsv.open_csv(
        source,
        read_options=pacsv.ReadOptions(block_size=_BLOCK, column_names=list(layout.names), skip_rows=layout.skip),
        parse_options=pacsv.ParseOptions(delimiter=layout.delimiter),
        convert_options=pacsv.ConvertOptions(include_columns=wanted, column_types=types, strings_can_be_null=False),
    )


def _types(layout: Layout, other: Sequence[str]) -> dict[str, Any]:
    """Types of the columns that are only passed on; text where the first block does not tell for the whole file."""
    import pyarrow as pa

    if not other or layout.path.stat().st_size <= _BLOCK:
        return {}
    try:
        with _reader(layout, layout.path, other, {}) as reader:
            for _ in reader:
                pass
    except (pa.ArrowException, OSError):
        return dict.fromkeys(other, pa.string())
    return {}
