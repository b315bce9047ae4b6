"""Comma, semicolon or tab separated text with one header line, streamed through pyarrow."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from .table import Table

_BLOCK = 1 << 24  # bytes read at a time: what bounds the memory
_HEADER = 1 << 16


def open_table(path: Path) -> Table:
    """Open a CSV file; lines before the header that start with ``#`` are comments.

    Raises
    ------
    InputError
        When there is no header, a name stands twice, or (while reading) a row has the wrong number of fields or a
        field is no number.
    """
    skip, delimiter, names = _header(path)
    stripped = tuple(name.strip() for name in names)
    twice = sorted({n for n in stripped if stripped.count(n) > 1})
    if twice:
        raise InputError(f"{path}: these columns stand more than once in the header: {', '.join(twice)}")

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        return _stream(path, skip, delimiter, stripped, numeric, other)

    return Table(path, stripped, read)


def _header(path: Path) -> tuple[int, str, list[str]]:
    with path.open("rb") as stream:
        head = stream.read(_HEADER)
    try:
        text = head.decode("utf-8-sig", errors="strict" if len(head) < _HEADER else "ignore")
    except UnicodeDecodeError as cause:
        raise InputError(f"{path}: neither Parquet nor UTF-8 text (byte {cause.start})") from cause
    if "\0" in text:
        raise InputError(f"{path}: neither Parquet nor text (a zero byte at {text.index(chr(0))})")
    for skip, line in enumerate(text.splitlines()):
        if line.strip() and not line.lstrip().startswith("#"):
            delimiter = max(",;\t", key=line.count)
            return skip, delimiter, next(csv.reader([line], delimiter=delimiter))
    raise InputError(f"{path}: no header line found")


def _stream(
    path: Path, skip: int, delimiter: str, names: tuple[str, ...], numeric: Sequence[str], other: Sequence[str]
) -> Iterator[Any]:
    import pyarrow as pa
    from pyarrow import csv as pacsv

    wanted = [*numeric, *other]
    try:
        reader = pacsv.open_csv(
            path,
            read_options=pacsv.ReadOptions(block_size=_BLOCK, column_names=list(names), skip_rows=skip + 1),
            parse_options=pacsv.ParseOptions(delimiter=delimiter),
            convert_options=pacsv.ConvertOptions(
                include_columns=wanted, column_types=dict.fromkeys(numeric, pa.float64()), strings_can_be_null=False
            ),
        )
        yield from reader
    except pa.ArrowInvalid as cause:
        if "Empty CSV" in str(cause):
            return
        raise InputError(f"{path}: {_plain(str(cause), skip)}") from cause


def _plain(message: str, skip: int) -> str:
    """Arrow's message about a row, with the line of the file where it says which row."""
    text = message.removeprefix("CSV parse error: ").removeprefix("In ")
    return f"cannot read a row as numbers ({text.strip()}); the header is on line {skip + 1}"
