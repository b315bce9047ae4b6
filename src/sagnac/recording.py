"""One table of samples: which column is what, in which unit, streamed in SI.

A :class:`Recording` is opened, not loaded: :meth:`Recording.batches` reads the file piece by piece, checks every
sample, and hands out SI (or counts, when no nominal scale is known).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import formats, units
from .errors import InputError
from .frames import Array

SENSORS = {
    "accel": ("accel_x", "accel_y", "accel_z"),
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
}
_KIND = {
    "time": "time",
    "accel": "acceleration",
    "gyro": "angular rate",
    "outer": "angle",
    "middle": "angle",
    "inner": "angle",
    "arm": "angle",
    "encoder": "angle",
    "temperature": "temperature",
}
_NAMES = ("time", *SENSORS["accel"], *SENSORS["gyro"], "outer", "middle", "inner", "arm", "encoder", "temperature")
_HEADER = re.compile(r"([^\[\]]*)\[([^\[\]]*)\]\s*")
GAP = 1.5
"""A step of more than this many sample intervals is a gap."""


@dataclass(frozen=True)
class Batch:
    """Consecutive samples.

    Attributes
    ----------
    row : int
        Number of the first sample, counted from one.
    time : ndarray, shape (n,), s
    accel, gyro : ndarray, shape (n, 3), or None
        m/s^2 and rad/s, or counts where the recording says so.
    rig : dict of str to ndarray, shape (n,)
        ``outer``, ``middle``, ``inner``, ``arm``, ``encoder`` (rad), ``temperature`` (K), as far as recorded.
    other : object
        pyarrow record batch of the columns that nothing here reads, for passing on; None when not asked for.
    single : dict of str to ndarray, shape (n,)
        Axes (``accel_z``, ...) of sensors that lack others, SI or counts as `accel` and `gyro`.
    """

    row: int
    time: Array
    accel: Array | None
    gyro: Array | None
    rig: Mapping[str, Array] = field(default_factory=dict)
    other: Any = None
    single: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Channel:
    """How a column becomes SI: value * factor, and per sample interval when it counts increments."""

    column: str
    factor: float
    increment: bool = False
    offset: float = 0.0
    counted: bool = False


@dataclass(frozen=True)
class Recording:
    """Samples of one unit. Made by :func:`open_recording` or :func:`from_arrays`.

    Attributes
    ----------
    name : str
        File name or a name for messages.
    path : Path or None
    counts : frozenset of str
        Sensors (``accel``, ``gyro``) whose samples stay raw counts.
    has : frozenset of str
        Sensors with all three columns.
    increments : frozenset of str
        Sensors whose samples are pulses counted over the sample interval (turned into rates, residue carried).
    other : tuple of str
        Header texts of the columns that nothing here reads.
    scale : mapping of str to str
        Nominal scale factors that turned counts into SI.
    single : frozenset of str
        Axes of sensors that lack others, as on a rig with one accelerometer (``accel_z``). Methods that need whole triads
        refuse such a recording, see :meth:`need_whole`.
    rig : frozenset of str
        Names of the rig columns, see :class:`Batch`.
    """

    name: str
    path: Path | None
    counts: frozenset[str]
    has: frozenset[str]
    increments: frozenset[str]
    other: tuple[str, ...]
    scale: Mapping[str, str]
    _stream: Callable[[bool], Iterator[Batch]] = field(repr=False)
    single: frozenset[str] = frozenset()
    rig: frozenset[str] = frozenset()

    def batches(self, *, with_other: bool = False) -> Iterator[Batch]:
        """Samples piece by piece, each checked.

        Raises
        ------
        InputError
            With file, row and reason: time that does not increase, a sample that is not finite, a field that is no
            number.
        """
        last = -math.inf
        for batch in self._stream(with_other):
            if batch.time.size:
                _check(self.name, batch, last)
                last = float(batch.time[-1])
                yield batch

    def read(self) -> Batch:
        """All samples at once, of whole triads (see :meth:`need_whole`)."""
        self.need_whole()
        parts = list(self.batches())
        if not parts:
            raise InputError(f"{self.name}: no samples")
        if len(parts) == 1:
            return parts[0]

        def joined(pick: Callable[[Batch], Array | None]) -> Array | None:
            pieces = [p for p in map(pick, parts) if p is not None]
            return np.concatenate(pieces) if pieces else None

        time = joined(lambda b: b.time)
        assert time is not None
        rig = {k: np.concatenate([p.rig[k] for p in parts]) for k in parts[0].rig}
        return Batch(1, time, joined(lambda b: b.accel), joined(lambda b: b.gyro), rig)

    def need(self, sensor: str) -> None:
        """Refuse, with what is missing, when the three columns of a sensor are not there."""
        self.need_whole()
        if sensor not in self.has:
            columns = ", ".join(SENSORS[sensor])
            raise InputError(f"{self.name}: this method needs the columns {columns}; rename others with --map")

    def need_whole(self) -> None:
        """Refuse a recording in which a sensor has some of its three columns only: others may have another name."""
        for sensor, axes in SENSORS.items():
            missing = [a for a in axes if a not in self.single]
            if len(missing) < len(axes):
                raise InputError(f"{self.name}: {sensor} lacks {', '.join(missing)}; rename columns with --map")


def from_arrays(
    time: ArrayLike,
    accel: ArrayLike | None = None,
    gyro: ArrayLike | None = None,
    *,
    counts: tuple[str, ...] = (),
    name: str = "recording",
    rig: Mapping[str, ArrayLike] | None = None,
    single: Mapping[str, ArrayLike] | None = None,
) -> Recording:
    """A recording from arrays in memory.

    Parameters
    ----------
    time : array_like, shape (n,), s
    accel, gyro : array_like, shape (n, 3), optional
        m/s^2 and rad/s, or counts for the sensors named in `counts`.
    counts : tuple of str
        ``accel``, ``gyro`` or both, when they are raw counts.
    name : str
        Used in messages.
    rig : mapping of str to array_like, shape (n,), optional
        Rig columns in SI.
    single : mapping of str to array_like, shape (n,), optional
        Axes (``accel_z``, ...) of sensors that lack others.

    Raises
    ------
    InputError
        When shapes do not agree.
    """
    t = _numbers(time, f"{name}: time")
    if t.ndim != 1:
        raise InputError(f"{name}: time has shape {t.shape}, not (n,)")
    data: dict[str, Array] = {}
    for sensor, values in (("accel", accel), ("gyro", gyro)):
        if values is not None:
            data[sensor] = _numbers(values, f"{name}: {sensor}")
            if data[sensor].shape != (t.size, 3):
                raise InputError(f"{name}: {sensor} has shape {data[sensor].shape}, time has {t.size} samples")
    columns = {k: _numbers(v, f"{name}: {k}") for k, v in (rig or {}).items()}
    axes = {k: _numbers(v, f"{name}: {k}") for k, v in (single or {}).items()}
    for column, values in (*columns.items(), *axes.items()):
        if values.shape != t.shape:
            raise InputError(f"{name}: {column} has shape {values.shape}, time has {t.size} samples")
    _refuse_no_single(name, axes, data)

    def stream(_: bool) -> Iterator[Batch]:
        yield Batch(1, t, data.get("accel"), data.get("gyro"), columns, single=axes)

    return Recording(
        name,
        None,
        counts=frozenset(counts),
        has=frozenset(data),
        increments=frozenset(),
        other=(),
        scale={},
        _stream=stream,
        single=frozenset(axes),
        rig=frozenset(columns),
    )


def _refuse_no_single(name: str, given: Collection[str], whole: Collection[str]) -> None:
    """Single axes must be axes, of sensors that are not there as a whole."""
    for axis in given:
        if axis not in (*SENSORS["accel"], *SENSORS["gyro"]):
            raise InputError(f"{name}: {axis!r} is no axis (accel_x, ... gyro_z)")
    for sensor, axes in SENSORS.items():
        if sensor in whole and any(a in given for a in axes):
            raise InputError(f"{name}: {sensor} is given as a whole and by single axes")
        if all(a in given for a in axes):
            raise InputError(f"{name}: the single axes make {sensor} whole; give {sensor}, shape (n, 3), instead")


def _numbers(values: ArrayLike, what: str) -> Array:
    try:
        return np.ascontiguousarray(values, dtype=float)
    except (TypeError, ValueError) as cause:
        raise InputError(f"{what}: cannot read as numbers: {cause}") from cause


def open_recording(
    path: str | Path,
    *,
    units_of: Mapping[str, str] | None = None,
    scale: Mapping[str, str] | None = None,
    rename: Mapping[str, str] | None = None,
) -> Recording:
    """Open a CSV or Parquet recording.

    Parameters
    ----------
    path : path
    units_of : mapping, optional
        Units for columns whose header gives none: ``{"accel": "g", "gyro_x": "deg/s", "time": "s"}``.
    scale : mapping, optional
        Nominal scale factors of count columns: ``{"gyro": "1.1866 pulse/arcsec"}``, or one per axis.
    rename : mapping, optional
        Standard name to the file's own: ``{"accel_x": "AX"}``.

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
        _refuse_unknown(option, given)
    table = formats.open_table(path)
    path = Path(path)
    headers = _headers(table.columns, rename or {}, path)
    channels: dict[str, Channel] = {}
    counts: set[str] = set()
    for name, (column, unit_text) in headers.items():
        channels[name] = _channel(name, column, unit_text, units_of or {}, scale or {}, path, counts)
    if "time" not in channels:
        raise InputError(f"{path}: no column 'time [s]'; the columns are: {', '.join(table.columns)}")
    present = {s: [a for a in axes if a in channels] for s, axes in SENSORS.items()}
    has = frozenset(s for s, axes in present.items() if len(axes) == len(SENSORS[s]))
    single = frozenset(a for s, axes in present.items() if s not in has for a in axes)
    for sensor, axes in present.items():
        if any(a in counts for a in axes) and not all(a in counts for a in axes):
            raise InputError(
                f"{path}: some {sensor} columns are counts and others are not; give --scale for all of them"
            )
    if not has and not single:
        raise InputError(f"{path}: no sensor columns (accel_x [g], gyro_x [deg/s], ...); rename others with --map")
    raw = frozenset(s for s, axes in present.items() if any(a in counts for a in axes))
    summed = frozenset(s for s, axes in present.items() if any(channels[a].increment for a in axes))
    used = {c.column for c in channels.values()}
    other = tuple(c for c in table.columns if c not in used)

    def stream(with_other: bool) -> Iterator[Batch]:
        return _stream(table, channels, other if with_other else ())

    counted = {s for s, axes in present.items() if any(channels[a].counted for a in axes)}
    needed = {k: v for k, v in (scale or {}).items() if k.split("_")[0] in counted}
    return Recording(
        str(path),
        path,
        counts=raw,
        has=has,
        increments=summed,
        other=other,
        scale=needed,
        _stream=stream,
        single=single,
        rig=frozenset(_NAMES[7:]) & channels.keys(),
    )


def _headers(columns: tuple[str, ...], rename: Mapping[str, str], path: Path) -> dict[str, tuple[str, str | None]]:
    """Standard name -> (column, unit text)."""
    parsed = {column: header_parts(column) for column in columns}
    out: dict[str, tuple[str, str | None]] = {}
    owner: dict[str, str] = {}
    for name, own in rename.items():
        column = _renamed(name, own, parsed, path)
        if column in owner:
            raise InputError(f"--map {name}={own}: the column {column!r} of {path} is {owner[column]} already")
        owner[column] = name
        out[name] = (column, parsed[column][1])
    for column, (bare, unit_text) in parsed.items():
        if bare not in _NAMES or bare in rename or column in owner:
            continue
        if bare in out:
            raise InputError(
                f"{path}: the columns {out[bare][0]!r} and {column!r} are both {bare}; "
                f"say which one counts with --map '{bare}={column}'"
            )
        out[bare] = (column, unit_text)
    return out


def header_parts(column: str) -> tuple[str, str | None]:
    """Name and unit text of a header, ``accel_x [g]``; the unit is None when there are no brackets at its end."""
    match = _HEADER.fullmatch(column)
    return (match[1].strip(), match[2].strip()) if match else (column.strip(), None)


def _renamed(name: str, own: str, parsed: Mapping[str, tuple[str, str | None]], path: Path) -> str:
    """The column that a ``--map`` pair means."""
    if name not in _NAMES:
        raise InputError(f"--map {name}={own}: {name!r} is no standard name ({', '.join(_NAMES)})")
    found = [own] if own in parsed else [c for c, (bare, _) in parsed.items() if bare == own]
    if not found:
        raise InputError(f"--map {name}={own}: {path} has no column {own!r}; it has: {', '.join(parsed)}")
    if len(found) > 1:
        raise InputError(f"--map {name}={own}: {path} has several such columns: {', '.join(found)}; write one in full")
    return found[0]


def _refuse_unknown(option: str, given: Mapping[str, str]) -> None:
    known = {*SENSORS, *_NAMES} if option == "units" else {*SENSORS, *SENSORS["accel"], *SENSORS["gyro"]}
    for name in given:
        if name not in known:
            raise InputError(f"{option}: {name}={given[name]}: {name!r} is none of {', '.join(sorted(known))}")


def _lookup(table: Mapping[str, str], name: str) -> str | None:
    return table.get(name, table.get(name.split("_", maxsplit=1)[0]))


def _channel(
    name: str,
    column: str,
    unit_text: str | None,
    units_of: Mapping[str, str],
    scale: Mapping[str, str],
    path: Path,
    counts: set[str],
) -> Channel:
    group = name.split("_", maxsplit=1)[0]
    kind = _KIND[group]
    unit_text = _lookup(units_of, name) or unit_text
    example = {"accel": "accel=g", "gyro": "gyro=deg/s"}.get(group, f"{name}={units.KINDS[kind][0]}")
    if unit_text is None or not unit_text.strip():
        raise InputError(
            f"{path}: column {column!r} has no unit. Write it in the header ({name} [{example.split('=')[1]}]) "
            f"or give it with --units {example}"
        )
    what = f"{path}: column {column!r}"
    if group in SENSORS and units.is_count(unit_text):
        text = _lookup(scale, name)
        if text is None:
            counts.add(name)
            return Channel(column, 1.0)
        worth, increment = nominal_scale(text, group, what)
        return Channel(column, worth, increment, counted=True)
    if kind == "temperature":
        zero = units.parse(f"0 {unit_text}", kind, what)
        return Channel(column, units.parse(f"1 {unit_text}", kind, what) - zero, offset=zero)
    return Channel(column, units.factor(unit_text, kind, what))


def nominal_scale(text: str, sensor: str, what: str) -> tuple[float, bool]:
    """Factor from counts to SI and whether the counts are increments over a sample interval.

    Parameters
    ----------
    text : str
        ``16384 LSB/g`` (the count is the input) or ``1.1866 pulse/arcsec``, ``10800 pulse/g/s`` (the count is the
        input summed over the sample interval).
    sensor : str
        ``accel`` or ``gyro``.
    what : str
        For the message.
    """
    value = units.quantity(text, f"{what}: scale")
    rate = {"accel": "m/s^2", "gyro": "rad/s"}[sensor]
    ureg = units.registry()
    for unit_text, increment in ((f"count/({rate})", False), (f"count/({rate})/s", True)):
        if value.is_compatible_with(ureg.Unit(unit_text)):
            counts = float(value.to(ureg.Unit(unit_text)).magnitude)
            if 1e-100 < abs(counts) < 1e100:
                return 1.0 / counts, increment
            raise InputError(f"{what}: scale {text!r} is no scale that a sensor has")
    good = {"accel": "16384 LSB/g or 10800 pulse/g/s", "gyro": "131 LSB/(deg/s) or 1.1866 pulse/arcsec"}[sensor]
    raise InputError(f"{what}: scale {text!r} is no count per input; write for example {good}")


def _stream(table: formats.Table, channels: Mapping[str, Channel], other: tuple[str, ...]) -> Iterator[Batch]:
    row, interval = 1, 0.0
    columns = list(dict.fromkeys(c.column for c in channels.values()))
    summed = [name for name, channel in channels.items() if channel.increment]
    for piece in _two_rows_first(table.read(columns, other)):
        size = piece.num_rows
        values = {c: _floats(piece.column(i)) for i, c in enumerate(columns)}
        with np.errstate(over="ignore", invalid="ignore"):  # the checks of the batch find what is not finite
            si = {n: values[c.column] * c.factor + c.offset for n, c in channels.items()}
            if summed and row == 1:
                interval = _counting_interval(table.path, si["time"])
            for name in summed:
                si[name] = si[name] / interval
        sensors = {
            s: np.column_stack([si[a] for a in axes]) for s, axes in SENSORS.items() if all(a in si for a in axes)
        }
        rig = {n: v for n, v in si.items() if n in _NAMES[7:]}
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


def sample_interval(time: Array) -> float:
    """Mean sample interval of the stretches without gaps, in s.

    Parameters
    ----------
    time : ndarray, shape (n,), s, n > 1
    """
    steps = np.diff(time)
    usual = float(np.median(steps))
    whole = steps[(steps > 0) & (steps < GAP * usual)]
    return float(whole.mean()) if whole.size else usual


def _check(name: str, batch: Batch, last: float) -> None:
    # no calibration reads the temperature: a slow or empty channel spoils nothing
    angles = [(k, v) for k, v in batch.rig.items() if k != "temperature"]
    columns: list[tuple[str, NDArray[Any]]] = [("time", batch.time), *angles]
    for sensor, values in (("accel", batch.accel), ("gyro", batch.gyro)):
        if values is not None:
            columns += [(axis, values[:, i]) for i, axis in enumerate(SENSORS[sensor])]
    columns += batch.single.items()
    for column, values in columns:
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"{name}: row {batch.row + int(bad[0])}: {column} is {_shown(values[bad[0]])} "
                f"({bad.size} such in this part of the file); remove or mend these samples first"
            )
    steps = np.diff(batch.time, prepend=last)
    wrong = np.flatnonzero(steps <= 0)
    if wrong.size:
        i = int(wrong[0])
        before = batch.time[i - 1] if i else last
        raise InputError(
            f"{name}: row {batch.row + i}: time goes from {before:.9g} s to {batch.time[i]:.9g} s; "
            "it must increase from sample to sample"
        )


def _shown(value: float) -> str:
    return "missing or not a number" if math.isnan(value) else "infinite"
