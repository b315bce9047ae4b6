"""Apache Parquet, streamed by row group pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from .table import Table

_ROWS = 1 << 17  # rows decoded at a time


def open_table(path: Path) -> Table:
    """Open a Parquet file.

    Raises
    ------
    InputError
        When the file is damaged, or (while reading) a column asked for is not numeric.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(path) as stream:
            schema = stream.schema_arrow
    except (pa.ArrowException, OSError, UnicodeDecodeError) as cause:
        raise InputError(f"{path}: damaged Parquet file: {cause}") from cause
    stripped = [name.strip() for name in schema.names]
    twice = sorted({n for n in stripped if stripped.count(n) > 1})
    if twice:
        raise InputError(f"{path}: these columns stand more than once: {', '.join(twice)}")
    names = dict(zip(stripped, schema.names, strict=True))

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        target = None
        wanted = [*numeric, *other]
        try:
            # buffered ahead, the whole file would end up in memory
            with parquet.ParquetFile(path, pre_buffer=False) as stream:
                for batch in stream.iter_batches(batch_size=_ROWS, columns=[names[c] for c in wanted]):
                    columns = [batch.column(names[c]) for c in wanted]
                    for i in range(len(numeric)):
                        target = wanted[i]
                        columns[i] = columns[i].cast(pa.float64(), safe=False)  # whole nanoseconds are rounded
                    yield pa.RecordBatch.from_arrays(columns, names=wanted)
        except (pa.ArrowException, OSError, UnicodeDecodeError) as cause:
            place = f" in column {target!r}" if target else ""
            raise InputError(f"{path}: cannot read the numbers{place}: {cause}") from cause

    whole = frozenset(n for n, kind in zip(stripped, schema.types, strict=True) if pa.types.is_integer(kind))
    return Table(path, tuple(names), read, whole=whole)
