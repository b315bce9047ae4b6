"""A recording: samples of one unit in SI, piece by piece, each of them checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..frames import Array

SENSORS = {
    "accel": ("accel_x", "accel_y", "accel_z"),
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
}
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
class Recording:
    """Samples of one unit. Made by :func:`~sagnac.recording.open_recording` or :func:`from_arrays`.

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
    axes : mapping of str to (str, float)
        Axis of a sensor (``gyro_x``) -> its column in the file, and what its numbers are multiplied by.
    format : str or None
        Name of the file's format (:data:`sagnac.formats.FORMATS`).
    select : str or None
        Which of several recordings in the file, in the words of the format, where it may hold several.
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
    axes: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    format: str | None = None
    select: str | None = None
    _remarks: tuple[Sequence[str], ...] = field(default=(), repr=False)
    _warmth: list[Array] = field(default_factory=list, repr=False)
    _origins: Sequence[float] = field(default=(), repr=False)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was done to the samples that the user would not expect; complete when all have been read."""
        return tuple(text for part in self._remarks for text in part)

    @property
    def origin(self) -> float:
        """What was taken off the times of the file, s, so that they begin at zero; known when the first have been read."""
        return sum(self._origins)

    @property
    def temperature(self) -> tuple[float, float, float] | None:
        """Mean, least and greatest temperature [K] of all samples; None before they have been read, or without any."""
        parts = np.array([w for w in self._warmth if w[0]]).reshape(-1, 4)
        if not parts.size:
            return None
        count, total, least, greatest = parts.T
        return float(total.sum() / count.sum()), float(least.min()), float(greatest.max())

    def batches(self, *, with_other: bool = False) -> Iterator[Batch]:
        """Samples piece by piece, each checked.

        Raises
        ------
        InputError
            With file, row and reason: time that does not increase, a sample that is not finite, a field that is no
            number.
        """
        last = -math.inf
        seen: list[Array] = []
        for batch in self._stream(with_other):
            if batch.time.size:
                _check(self.name, batch, last)
                last = float(batch.time[-1])
                seen.append(_extremes(batch.rig.get("temperature")))
                yield batch
        self._warmth[:] = seen

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


def _extremes(values: Array | None) -> Array:
    """Number, sum, least and greatest of the values that are there: a slow channel may leave gaps."""
    good = values[np.isfinite(values)] if values is not None else np.empty(0)
    return np.array([good.size, good.sum(), good.min(), good.max()]) if good.size else np.zeros(4)


def _shown(value: float) -> str:
    return "missing or not a number" if math.isnan(value) else "infinite"
