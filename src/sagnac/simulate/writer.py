"""Samples to a file, piece by piece."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..frames import Array
from .engine import Piece

_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}
_DEG = 180.0 / np.pi
_INT32 = 2**31 - 1
_GROUP = 1 << 17
"""Samples written at a time (a row group of Parquet), by a thread of its own."""
# bytes of a field: numbers as they are (noise does not shrink), text with all digits
_PARQUET_FIELD, _PARQUET_COUNT, _CSV_FIELD, _CSV_COUNT = 8, 4, 22, 8


def headers(columns: Mapping[str, bool], rig: tuple[str, ...]) -> list[str]:
    """Header texts of a recording.

    Parameters
    ----------
    columns : mapping of str to bool
        Sensor columns, and whether they are counts.
    rig : tuple of str
        The rig's own channels.
    """
    sensors = [f"{name} [{'pulse' if counted else _UNITS[name.split('_')[0]]}]" for name, counted in columns.items()]
    return ["time [s]", *sensors, *(f"{name} [{'degC' if name == 'temperature' else 'deg'}]" for name in rig)]


def size(rows: int, columns: Mapping[str, bool], rig: tuple[str, ...], kind: str) -> int:
    """Bytes that a recording takes at most, about."""
    field, count = (_PARQUET_FIELD, _PARQUET_COUNT) if kind == "parquet" else (_CSV_FIELD, _CSV_COUNT)
    counted = sum(columns.values())
    return rows * (field * (1 + len(columns) - counted + len(rig)) + count * counted)


@contextmanager
def writing(
    path: Path, columns: Mapping[str, bool], rig: tuple[str, ...], kind: str
) -> Iterator[Callable[[Piece], None]]:
    """Open a recording for writing; what is given takes the pieces in order, and writes some at a time in the background.

    Parameters
    ----------
    path : Path
    columns : mapping of str to bool
        Sensor columns, and whether they are counts.
    rig : tuple of str
    kind : str
        ``parquet`` or ``csv``.

    Raises
    ------
    InputError
        When a count does not fit into 32 bits.
    """
    import pyarrow as pa

    types = [pa.int32() if counted else pa.float64() for counted in columns.values()]
    names = headers(columns, rig)
    schema = pa.schema(list(zip(names, [pa.float64(), *types, *[pa.float64()] * len(rig)], strict=True)))

    def put(pieces: list[Piece]) -> None:
        writer.write_table(pa.Table.from_batches([batch(p) for p in pieces]))

    def batch(piece: Piece) -> Any:
        fields = [piece.time]
        fields += [_counts(name, piece.sensors[name]) if c else piece.sensors[name] for name, c in columns.items()]
        fields += [piece.rig[n] - 273.15 if n == "temperature" else piece.rig[n] * _DEG for n in rig]
        return pa.record_batch([pa.array(f) for f in fields], schema=schema)

    held: list[Piece] = []
    with _writer(path, schema, kind) as writer, ThreadPoolExecutor(1) as pool:
        written: Future[None] = pool.submit(lambda: None)

        def write(piece: Piece) -> None:
            nonlocal written
            held.append(piece)
            if sum(p.time.size for p in held) >= _GROUP:
                written.result()
                written = pool.submit(put, held.copy())
                held.clear()

        yield write
        written.result()
        if held:
            put(held)


@contextmanager
def _writer(path: Path, schema: Any, kind: str) -> Iterator[Any]:
    if kind == "csv":
        from pyarrow import csv

        # the writer puts its header in quotes; these names need none
        with path.open("wb") as stream:
            stream.write((",".join(schema.names) + "\n").encode())
            with csv.CSVWriter(stream, schema, write_options=csv.WriteOptions(include_header=False)) as writer:
                yield writer
        return
    import pyarrow as pa
    from pyarrow import parquet

    # a dictionary of noise is larger than the noise and takes ten times as long, and noise does not shrink
    small = {f.name: "snappy" if pa.types.is_integer(f.type) or f.name == "time [s]" else "none" for f in schema}
    with parquet.ParquetWriter(path, schema, use_dictionary=False, write_statistics=False, compression=small) as writer:
        yield writer


def _counts(name: str, values: Array) -> Any:
    if values.size and max(float(values.max()), -float(values.min())) > _INT32:
        raise InputError(f"unit.scale: {name} counts more than {_INT32} pulses in a sample; make its scale smaller")
    return values.astype(np.int32)
