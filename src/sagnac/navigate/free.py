"""Free inertial navigation of a recording: from a state at its start to a track in a file.

Nothing corrects it on its way. Errors of the start and of the sensors swing with the Schuler period of 84 minutes and drift: a
bias of 0.01 deg/h of a gyro makes about a kilometre in the first hour. The vertical is unstable (it doubles its error in some
seven minutes), so that the height is held unless told otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..earth import EARTH_RATE, radii
from ..errors import DataError, InputError
from ..files import write_atomically
from ..frames import Array
from ..recording import GAP, Recording
from .state import State
from .strapdown import Frame, Meaning, Navigator, Vertical, unpack
from .stream import Gap, Stream

COLUMNS = (
    "time [s]",
    "latitude [deg]",
    "longitude [deg]",
    "height [m]",
    "v_east [m/s]",
    "v_north [m/s]",
    "v_up [m/s]",
    "heading [deg]",
    "pitch [deg]",
    "roll [deg]",
)
"""Of a track: those of a master's log, so that a track can be one."""
_NO_BIAS = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Journey:
    """What became of a navigation.

    Attributes
    ----------
    begin, stop : float, s
        On the clock of the recording.
    samples, rows : int
        Samples taken in, and rows written.
    final : State
    distance : float, m
        From the start to the end, along the ground.
    farthest, farthest_time : float, m and s
        Greatest distance of a row from the start, and when.
    gaps : tuple of Gap
        Gaps of the recording that were filled.
    """

    begin: float
    stop: float
    samples: int
    rows: int
    final: State
    distance: float
    farthest: float
    farthest_time: float
    gaps: tuple[Gap, ...]

    def to_dict(self) -> dict[str, Any]:
        """Numbers for machines, angles in degrees."""
        latitude, longitude, _ = self.final.place
        heading, pitch, roll = self.final.angles
        return {
            "begin": self.begin,
            "stop": self.stop,
            "samples": self.samples,
            "rows": self.rows,
            "distance": self.distance,
            "farthest": self.farthest,
            "farthest_time": self.farthest_time,
            "final": {
                "latitude": float(np.degrees(latitude)),
                "longitude": float(np.degrees(longitude)),
                "height": float(self.final.height),
                "velocity_enu": self.final.velocity_enu.tolist(),
                "heading": float(np.degrees(heading)),
                "pitch": float(np.degrees(pitch)),
                "roll": float(np.degrees(roll)),
            },
            "gaps": [list(g) for g in self.gaps],
        }

    def summary(self) -> str:
        """A few lines of text."""
        final = self.to_dict()["final"]
        east, north, up = final["velocity_enu"]
        lines = [
            f"Free inertial navigation from {self.begin:.9g} s to {self.stop:.9g} s, {self.samples} samples",
            "",
            f"  at the end {final['latitude']:.7f} deg, {final['longitude']:.7f} deg, {final['height']:.2f} m",
            f"  velocity   {east:.4f} m/s east, {north:.4f} m/s north, {up:.4f} m/s up",
            f"  heading {final['heading']:.4f} deg, pitch {final['pitch']:.4f} deg, roll {final['roll']:.4f} deg",
            f"  distance from the start {self.distance:.1f} m; at most {self.farthest:.1f} m, at {self.farthest_time:.6g} s",
        ]
        lines += [
            f"  note: gap from {g.start:.9g} s to {g.stop:.9g} s filled with the mean of the samples around it: a guess"
            for g in self.gaps
        ]
        return "\n".join(lines)


def navigate(
    recording: Recording,
    start: State,
    out: str | Path,
    *,
    begin: float | None = None,
    stop: float | None = None,
    interval: float = 1.0,
    gyro_bias: Array | None = None,
    accel_bias: Array | None = None,
    meaning: Meaning = "instant",
    samples: int = 2,
    frame: Frame = "wander",
    vertical: Vertical = "held",
    gravity_excess: float = 0.0,
    earth_rate: float = EARTH_RATE,
    bridge: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Journey:
    """Navigate a recording and write the track.

    Parameters
    ----------
    recording : Recording
        With both triads. It is streamed: memory does not grow with its length.
    start : State
        At `begin`. Its vertical velocity is of no matter when the height is held.
    out : path
        Track to write, ``.parquet`` or ``.csv``, with :data:`COLUMNS`. Written whole or not at all.
    begin, stop : float, s, optional
        Part of the recording to navigate; all of it unless given.
    interval : float, s
        Time between rows, rounded to whole samples.
    gyro_bias, accel_bias : ndarray, shape (3,), rad/s and m/s^2, optional
        Taken off the samples.
    meaning : {"instant", "mean"}
        What samples that are not pulses are, see :func:`sagnac.navigate.strapdown.increments`.
    samples, frame, vertical, gravity_excess, earth_rate
        As :class:`sagnac.navigate.strapdown.Navigator` takes them.
    bridge : bool
        Fill gaps instead of refusing them.
    progress : callable, optional
        Called with the number of samples taken in so far.

    Returns
    -------
    Journey

    Raises
    ------
    InputError
        When columns are missing, or `out` cannot be written.
    DataError
        At a gap that is not to be filled, or when the recording has no samples where the start is known.
    """
    out = Path(out)
    if out.suffix not in (".parquet", ".csv"):
        raise InputError(f"{out}: write to a .parquet or .csv file")
    if recording.path is not None and out.exists() and out.samefile(recording.path):
        raise InputError(f"{out}: is the recording itself; input is never modified")
    if not interval > 0.0:
        raise InputError(f"an interval of {interval!r} s between rows is none")
    stream = Stream(recording, meaning=meaning, start=begin, stop=stop, bridge=bridge)
    if vertical == "held":
        start = replace(start, velocity=start.velocity * [1.0, 1.0, 0.0])
    navigator = Navigator(
        start, samples=samples, frame=frame, vertical=vertical, gravity_excess=gravity_excess, earth_rate=earth_rate
    )
    biases = tuple(np.asarray(_NO_BIAS if b is None else b, dtype=float) for b in (gyro_bias, accel_bias))
    seen = _Seen(start)
    with write_atomically(out) as temporary:
        writer: Any = None
        try:
            for table in _tables(stream, navigator, begin, interval, biases, seen):
                writer = _writer(temporary, table.schema) if writer is None else writer
                writer.write_batch(table)
                if progress is not None:
                    progress(seen.samples)
        finally:
            if writer is not None:
                writer.close()
    final = navigator.state
    distance, _ = seen.farthest_of(np.zeros(1), final.place[0], final.place[1])
    return Journey(
        seen.begin,
        seen.stop,
        seen.samples,
        seen.rows,
        final,
        distance,
        seen.farthest,
        seen.farthest_time,
        tuple(stream.gaps),
    )


class _Seen:
    """What is kept of a navigation while it runs."""

    def __init__(self, start: State) -> None:
        latitude, longitude, _ = start.place
        self._place = (float(latitude), float(longitude), float(start.height))
        self.begin = self.stop = self.farthest_time = float("nan")
        self.samples = self.rows = 0
        self.farthest = 0.0

    def farthest_of(self, time: Array, latitude: Array, longitude: Array) -> tuple[float, float]:
        """Greatest distance from the start, m, and its time."""
        east, north = displacement(np.atleast_1d(latitude), np.atleast_1d(longitude), *self._place)
        distance = np.hypot(east, north)
        k = int(np.argmax(distance))
        return float(distance[k]), float(time[k])

    def add(self, columns: list[Array]) -> None:
        """Take in rows of :data:`COLUMNS`."""
        distance, at = self.farthest_of(columns[0], np.radians(columns[1]), np.radians(columns[2]))
        if not self.rows or distance > self.farthest:
            self.farthest, self.farthest_time = distance, at
        self.rows += columns[0].size


def displacement(
    latitude: Array, longitude: Array, from_latitude: float, from_longitude: float, height: float = 0.0
) -> tuple[Array, Array]:
    """Distance east and north of a place on a plane, m; good for some tens of kilometres.

    Parameters
    ----------
    latitude, longitude : ndarray, shape (n,), rad
    from_latitude, from_longitude : float, rad
    height : float, m

    Returns
    -------
    east, north : ndarray, shape (n,), m
    """
    meridian, normal = radii(0.5 * (latitude + from_latitude))
    turned = np.mod(longitude - from_longitude + np.pi, 2.0 * np.pi) - np.pi
    east = turned * (normal + height) * np.cos(0.5 * (latitude + from_latitude))
    return np.asarray(east), np.asarray((latitude - from_latitude) * (meridian + height))


def _tables(
    stream: Stream,
    navigator: Navigator,
    begin: float | None,
    interval: float,
    biases: tuple[Array, ...],
    seen: _Seen,
) -> Iterator[Any]:
    """Rows of the track as record batches: the start, every k-th sample and the last one."""
    every, since = 0, 0
    for piece in stream:
        if not every:
            usual = float(np.median(piece.steps))
            _refuse_late(stream.recording.name, piece.begin, begin, usual)
            every = max(1, round(interval / usual))
            seen.begin = piece.begin
            yield _table(np.concatenate([[piece.begin], navigator.numbers])[None], seen)
        h = piece.steps[:, None]
        rows, _ = navigator.trace(
            piece.turns - biases[0] * h,
            piece.pushes - biases[1] * h,
            piece.steps,
            every=every,
            since=since,
            time=piece.begin,
        )
        since = (since + piece.time.size) % every
        seen.samples += piece.time.size
        seen.stop = float(piece.time[-1])
        if rows.size:
            yield _table(rows, seen)
    if since:
        yield _table(np.concatenate([[seen.stop], navigator.numbers])[None], seen)


def _refuse_late(name: str, first: float, begin: float | None, usual: float) -> None:
    if begin is not None and abs(first - begin) > GAP * usual:
        raise DataError(
            f"{name}: the samples begin at {first:.9g} s, but the start is known at {begin:.9g} s: what happened between them "
            f"is not known"
        )


def _table(rows: Array, seen: _Seen) -> Any:
    """Time and states (m, 25) as a record batch with :data:`COLUMNS`."""
    import pyarrow as pa

    states = unpack(rows[:, 1:])
    latitude, longitude, _ = states.place
    velocity = states.velocity_enu
    degrees = [np.degrees(v) for v in (latitude, longitude, *states.angles)]
    columns = [rows[:, 0], *degrees[:2], states.height, *velocity.T, *degrees[2:]]
    columns = [np.ascontiguousarray(c) for c in columns]
    seen.add(columns)
    return pa.RecordBatch.from_arrays([pa.array(c) for c in columns], names=list(COLUMNS))


def _writer(path: Path, schema: Any) -> Any:
    if path.suffix == ".csv":
        from pyarrow import csv

        return csv.CSVWriter(path, schema)
    from pyarrow import parquet

    return parquet.ParquetWriter(path, schema)
