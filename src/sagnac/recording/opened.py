"""A recording from a file of any format that :mod:`sagnac.formats` knows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from .. import formats, units
from ..errors import InputError
from ..frames import Array
from .clock import Clock
from .columns import RIG, Channel, channel, headers, mapped, refuse_unknown
from .record import SENSORS, Batch, Recording, sample_interval

Watch = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Called with the name and the size of a file for each pass over it; gives what is told how many bytes are done."""


def open_recording(
    path: str | Path,
    *,
    units_of: Mapping[str, str] | None = None,
    scale: Mapping[str, str] | None = None,
    rename: Mapping[str, str] | None = None,
    select: str | None = None,
    rate: str | None = None,
    partial: bool = False,
    watch: Watch | None = None,
) -> Recording:
    """Open a recording of any known format (:data:`sagnac.formats.FORMATS`), told by its content.

    Parameters
    ----------
    path : path
    units_of : mapping, optional
        Units for columns whose header gives none: ``{"accel": "g", "gyro_x": "deg/s", "time": "s"}``.
    scale : mapping, optional
        Nominal scale factors of count columns: ``{"gyro": "1.1866 pulse/arcsec"}``, or one per axis.
    rename : mapping, optional
        Standard name to the file's own: ``{"accel_x": "AX"}``; ``{"accel": "acc"}`` for the columns of a matrix acc.
    select : str, optional
        Which of several recordings in the file: the topic of a bag, the instance of a sensor.
    rate : str, optional
        Sample rate of a file without time: ``"100 Hz"``.
    partial : bool
        Take a damaged file up to the damage, which is then a remark of the recording, instead of refusing it.
    watch : callable, optional
        Told how far the reading has come, see :data:`Watch`.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        When a column has no unit, an unknown one or one of the wrong kind, when a needed column is missing, or the
        file cannot be read.
    """
    for option, given in (("units", units_of or {}), ("scale", scale or {})):
        refuse_unknown(option, given)
    path = Path(path)
    table = _meant(formats.open_table(path, select), rename or {}, path)
    channels: dict[str, Channel] = {}
    counts: set[str] = set()
    for name, (column, unit_text) in headers(table.columns, rename or {}, path).items():
        channels[name] = channel(name, column, unit_text, units_of or {}, scale or {}, path, counts)
    step = _step(rate, "time" in channels, path, table.columns)
    present = {s: [a for a in axes if a in channels] for s, axes in SENSORS.items()}
    _refuse_unfit(path, present, counts, table.columns)
    has = frozenset(s for s, axes in present.items() if len(axes) == len(SENSORS[s]))
    used = {c.column for c in channels.values()}
    other = tuple(c for c in table.columns if c not in used)
    faults: list[str] = []
    clock: list[str] = []
    origins = [table.origin]

    def stream(with_other: bool) -> Iterator[Batch]:
        pieces = _told(table, channels, other if with_other else (), watch)
        time = Clock(channels["time"], clock, origins) if step is None else step
        return _in_si(path, _sound(pieces, partial, faults), channels, time, other if with_other else ())

    counted = {s for s, axes in present.items() if any(channels[a].counted for a in axes)}
    return Recording(
        str(path),
        path,
        counts=frozenset(s for s, axes in present.items() if any(a in counts for a in axes)),
        has=has,
        increments=frozenset(s for s, axes in present.items() if any(channels[a].increment for a in axes)),
        other=other,
        scale={k: v for k, v in (scale or {}).items() if k.split("_")[0] in counted},
        _stream=stream,
        single=frozenset(a for s, axes in present.items() if s not in has for a in axes),
        rig=frozenset(RIG) & channels.keys(),
        axes={a: (channels[a].column, channels[a].factor) for axes in present.values() for a in axes},
        format=table.format,
        select=table.choice,
        _remarks=(table.remarks, clock, faults),
        _origins=origins,
    )


def _meant(table: formats.Table, rename: Mapping[str, str], path: Path) -> formats.Table:
    """Of a file with columns of several lengths those that are as long as the renamed ones."""
    tables = (table, *table.besides)
    if not rename or len(tables) == 1:
        return table
    columns = mapped(tuple(c for t in tables for c in t.columns), rename, path)
    meant = {name: next(t for t in tables if column in t.columns) for name, column in columns.items()}
    lengths = {t.samples: t for t in meant.values()}
    if len(lengths) > 1:
        told = ", ".join(f"{name}={columns[name]} ({t.samples} samples)" for name, t in meant.items())
        raise InputError(f"{path}: the columns named by --map have different lengths: {told}")
    return next(iter(lengths.values()))


def _step(rate: str | None, has_time: bool, path: Path, columns: tuple[str, ...]) -> float | None:
    """Sample interval of a file without time, in s; None where the file tells the time."""
    if rate is None:
        if not has_time:
            raise InputError(
                f"{path}: no column 'time [s]'; the columns are: {', '.join(columns)} (name one with --map time=..., or give "
                "the sample rate of a file without time, --rate '100 Hz')"
            )
        return None
    if has_time:
        raise InputError(f"--rate {rate}: {path} has a time of its own; --rate is for files without")
    hertz = units.parse(rate, "sample rate", "--rate")
    if not 1e-6 < hertz < 1e9:
        raise InputError(f"--rate {rate}: is no rate of samples")
    return 1.0 / hertz


def _refuse_unfit(path: Path, present: Mapping[str, list[str]], counts: set[str], columns: tuple[str, ...]) -> None:
    """Refuse a file without sensors, or with a sensor that is counts in part."""
    for sensor, axes in present.items():
        if any(a in counts for a in axes) and not all(a in counts for a in axes):
            raise InputError(
                f"{path}: some {sensor} columns are counts and others are not; give --scale for all of them"
            )
    if not any(present.values()):
        raise InputError(
            f"{path}: no sensor columns (accel_x [g], gyro_x [deg/s], ...); rename others with --map; "
            f"the columns are: {', '.join(columns)}"
        )


def _told(
    table: formats.Table, channels: Mapping[str, Channel], other: tuple[str, ...], watch: Watch | None
) -> Iterator[Any]:
    """The rows of a table, with word of how far the reading has come."""
    columns = _doubles(channels, table.whole)
    pieces = table.read(columns, tuple(c.column for c in channels.values() if c.column not in columns) + other)
    if watch is None or table.position is None:
        yield from pieces
        return
    with watch(table.path.name, table.size) as tell:
        for piece in pieces:
            tell(table.position())
            yield piece


def _doubles(channels: Mapping[str, Channel], whole: frozenset[str]) -> list[str]:
    """Columns to be read as doubles: all but a time in whole numbers, which may be more than a double holds."""
    return [c.column for name, c in channels.items() if name != "time" or c.column not in whole]


def _sound(pieces: Iterator[Any], partial: bool, faults: list[str]) -> Iterator[Any]:
    """The rows before the damage of a file, the damage noted where a part is enough and told otherwise."""
    rows = 0
    try:
        for piece in pieces:
            rows += piece.num_rows
            yield piece
    except formats.Fault as fault:
        if not rows:
            raise
        if not partial:
            raise InputError(f"{fault}; --partial takes the {rows} samples before it") from fault
        faults[:] = [f"{fault.path}: only the {rows} samples before byte {fault.offset} were read: {fault.reason}"]


def _in_si(
    path: Path,
    pieces: Iterator[Any],
    channels: Mapping[str, Channel],
    clock: Clock | float,
    other: tuple[str, ...],
) -> Iterator[Batch]:
    """Rows as batches in SI; time counted from the rows where there is only the step between them."""
    row, interval = 1, 0.0
    read = {n: c for n, c in channels.items() if n != "time"}
    summed = [name for name, channel in channels.items() if channel.increment]
    for piece in _two_rows_first(pieces):
        size = piece.num_rows
        with np.errstate(over="ignore", invalid="ignore"):  # the checks of the batch find what is not finite
            si = {n: _floats(piece.column(c.column)) * c.factor + c.offset for n, c in read.items()}
            if isinstance(clock, Clock):
                si["time"] = clock.seconds(piece.column(channels["time"].column))
            else:
                si["time"] = (row - 1 + np.arange(size)) * clock
            if summed and row == 1:
                interval = _counting_interval(path, si["time"])
            for name in summed:
                si[name] = si[name] / interval
        sensors = {
            s: np.column_stack([si[a] for a in axes]) for s, axes in SENSORS.items() if all(a in si for a in axes)
        }
        rig = {n: v for n, v in si.items() if n in RIG}
        single = {a: si[a] for s, axes in SENSORS.items() if s not in sensors for a in axes if a in si}
        rest = piece.select(list(other)) if other else None
        yield Batch(row, si["time"], sensors.get("accel"), sensors.get("gyro"), rig, rest, single)
        row += size


def _two_rows_first(pieces: Iterator[Any]) -> Iterator[Any]:
    """The same rows, the first piece with two rows at least where the file has them: they say how far samples lie apart."""
    first: Any = None
    started = False
    for piece in pieces:
        if started:
            yield piece
            continue
        first = piece if first is None else _joined(first, piece)
        if first.num_rows > 1:
            started = True
            yield first
    if not started and first is not None:
        yield first


def _joined(first: Any, second: Any) -> Any:
    import pyarrow as pa

    both = pa.Table.from_batches([first, second]).combine_chunks()
    return both.to_batches()[0] if both.num_rows else first


def _counting_interval(path: Path, time: Array) -> float:
    """Time over which pulses were counted; where the time is unsound one, as it is refused later."""
    if time.size < 2:
        raise InputError(f"{path}: one sample alone cannot say over which time its pulses were counted")
    interval = sample_interval(time)
    return interval if 0 < interval < math.inf else 1.0


def _floats(column: Any) -> Array:
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)
