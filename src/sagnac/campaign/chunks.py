"""Rows of some runs as the bytes of a small Parquet file that says which runs of which campaign it holds.

A chunk is known by its contents: its name is the SHA-256 of its bytes, and the runs and the campaign that it belongs to
stand in its own footer. So a chunk can be checked without any list of chunks, a torn or changed one gives itself away
by its name, and the same chunk made twice is the same file.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    import pyarrow as pa

OK = "ok"
"""Status of a run that came to a result; any other is the reason why it did not."""
_FOOTER = b"sagnac.campaign", b"sagnac.first", b"sagnac.last"


class UnfitError(Exception):
    """Raised by a task that can do none of its runs as it should; the campaign ends with these words."""


class Task(Protocol):
    """What is done once for each run; can be pickled, and has everything in it that a run needs."""

    @property
    def columns(self) -> Mapping[str, str]:
        """Columns of the results besides ``run`` and ``status``: names and types as pyarrow calls them (``double``)."""

    def row(self, index: int) -> Mapping[str, Any]:
        """Results of a run, by column; what is left out is null.

        It depends on the index alone, not on what ran before. The engine adds the run and, unless the row brings its
        own, the status. An :class:`~sagnac.errors.InputError` or :class:`~sagnac.errors.DataError` becomes the status
        of a row without results; any other exception stops the campaign, an :class:`UnfitError` with its words alone.
        """


class Part(NamedTuple):
    """Some runs, one after the other."""

    first: int
    last: int
    """The first one that is no longer in it."""

    def __str__(self) -> str:
        return f"run {self.first}" if self.last == self.first + 1 else f"runs {self.first} to {self.last - 1}"


class Chunk(NamedTuple):
    """What the bytes of a chunk hold."""

    campaign: str
    """Fingerprint of it."""
    part: Part
    table: pa.Table


def schema(columns: Mapping[str, str]) -> pa.Schema:
    """Columns of the results: run, status and those of the task."""
    import pyarrow as pa

    own = {name: kind for name, kind in columns.items() if name not in ("run", "status")}
    return pa.schema({"run": "int64", "status": "string", **own}.items()).with_metadata(None)


def encode(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str], part: Part, campaign: str) -> bytes:
    """Parquet file of the rows of some runs.

    Parameters
    ----------
    rows : iterable of mapping
        One for each run, with ``run`` and ``status``.
    columns : mapping
        Of the task.
    part : Part
    campaign : str
        Fingerprint.

    Raises
    ------
    ValueError
        With the column, when a row has one that the task does not name, or a value is not of its type.
    """
    import pyarrow as pa

    kinds = schema(columns)
    filled: dict[str, list[Any]] = {name: [] for name in kinds.names}
    for row in rows:
        strange = row.keys() - filled.keys()
        if strange:
            raise ValueError(
                f"run {row['run']}: a row has {', '.join(sorted(strange))}, which the task's columns do not name"
            )
        for name, values in filled.items():
            values.append(row.get(name))
    arrays = []
    for field in kinds:
        try:
            arrays.append(pa.array(filled[field.name], field.type))
        except (pa.ArrowException, OverflowError) as cause:
            raise ValueError(f"{part}: column {field.name} is not {field.type}: {cause}") from cause
    named = (campaign, str(part.first), str(part.last))
    told = dict(zip(_FOOTER, (text.encode() for text in named), strict=True))
    stream = io.BytesIO()
    write(pa.Table.from_arrays(arrays, schema=kinds.with_metadata(told)), stream)
    return stream.getvalue()


def decode(data: bytes) -> Chunk:
    """Chunk from its bytes.

    Raises
    ------
    ValueError
        When it is none.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        table = parquet.read_table(pa.BufferReader(data), use_threads=False)
        campaign, first, last = ((table.schema.metadata or {})[key].decode() for key in _FOOTER)
        chunk = Chunk(campaign, Part(int(first), int(last)), table.replace_schema_metadata(None))
    except (pa.ArrowException, OSError, KeyError) as cause:
        raise ValueError(f"no chunk of a campaign: {cause}") from cause
    if chunk.table["run"].to_pylist() != list(range(*chunk.part)):
        raise ValueError(f"it does not hold {chunk.part}, as it says")
    return chunk


def name_of(data: bytes) -> str:
    """Name of the file that holds a chunk."""
    return f"{hashlib.sha256(data).hexdigest()}.parquet"


def write(table: pa.Table, stream: Any) -> None:
    """Write a table as one row group; the bytes depend on its values and schema alone."""
    with writing(table.schema, stream) as group:
        group(table)


@contextmanager
def writing(kinds: pa.Schema, target: Any) -> Iterator[Callable[[pa.Table], None]]:
    """A function that writes tables as row groups of a Parquet file; its bytes depend on schema, values and groups alone.

    Nothing in the file is from a clock or from chance. Arrow ends pages where the pieces of a column end; they are
    made one before a group is written.
    """
    import pyarrow as pa
    from pyarrow import parquet

    texts = [field.name for field in kinds if pa.types.is_string(field.type)]
    with parquet.ParquetWriter(target, kinds, compression="zstd", use_dictionary=texts) as stream:
        yield lambda table: stream.write_table(table.combine_chunks(), row_group_size=max(len(table), 1))
