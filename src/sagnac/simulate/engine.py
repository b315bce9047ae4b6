"""Time series: what a rig does to a unit, sampled piece by piece on as many threads as there are.

The samples are the same for a seed however many threads work and however long the pieces are: every axis and every process of
its noise draws from a stream of its own, and what one sample leaves to the next (slow processes, residues of pulses) is handed
on from piece to piece.
"""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from ..frames import Array
from ..recording import SENSORS
from ..sensors import AXES, Correction, forward
from .noise import NO_NOISE, AxisNoise, NoiseModel, generator

PIECE = 1 << 14
"""Samples computed at a time: what bounds the memory."""
STREAMS = {"unit": 0, "rig": 1, "noise": 2, "clock": 3, "stamp": 4, "master": 5, "encoder": 6}
"""First number of the stream of random numbers of each purpose."""


class Motion(Protocol):
    """What a rig does; called for increasing times, from several threads at once."""

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """Specific force and angular rate of the case, (n, 3) each, m/s^2 and rad/s, at times (n,)."""
        ...

    def columns(self, time: Array) -> dict[str, Array]:
        """The rig's own channels by their names in a recording, SI."""
        ...


@runtime_checkable
class Averaged(Motion, Protocol):
    """A motion that knows its own means, exactly; of others they are taken by Gauss' rule with two points."""

    def means(self, edges: Array) -> tuple[Array, Array]:
        """Mean specific force and angular rate over the intervals between instants (n + 1,), (n, 3) each."""
        ...


@dataclass(frozen=True)
class Clock:
    """When samples are taken.

    Attributes
    ----------
    frequency : float, Hz
    count : int
        Number of samples; the first is one interval after zero.
    jitter, stamp_jitter : float, s
        Bounds of how far a sample is off its nominal time, and its time stamp off the sample.
    """

    frequency: float
    count: int
    jitter: float = 0.0
    stamp_jitter: float = 0.0


@dataclass(frozen=True)
class Channel:
    """How one axis is read.

    Attributes
    ----------
    sensor : str
        ``accel`` or ``gyro``.
    axis : int
    noise : NoiseModel
    worth : float
        Input that one count stands for; zero for readings in SI.
    increment : bool
        Whether counts are of the input summed over the sample interval.
    """

    sensor: str
    axis: int
    noise: NoiseModel = NO_NOISE
    worth: float = 0.0
    increment: bool = False

    @property
    def name(self) -> str:
        """``accel_x`` to ``gyro_z``."""
        return SENSORS[self.sensor][self.axis]


@dataclass(frozen=True)
class Drift:
    """Temperature of the unit, and what it changes.

    Attributes
    ----------
    profile : callable
        Temperature, K, at times (n,).
    reference : float, K
    bias, scale : mapping of str to ndarray, shape (3,)
        Change per kelvin of the biases and scale errors of a triad.
    """

    profile: Callable[[Array], Array]
    reference: float
    bias: Mapping[str, Array]
    scale: Mapping[str, Array]


@dataclass(frozen=True)
class Job:
    """Everything that the samples depend on.

    Attributes
    ----------
    motion : Motion
    to_unit : ndarray, shape (3, 3)
        Takes coordinates of the case to those of the unit.
    models : mapping of str to Correction
        Of each triad.
    channels : tuple of Channel
        Columns to record, in their order.
    clock : Clock
    seed : int
    drift : Drift or None
    rig : bool
        Whether the rig's own channels are recorded.
    """

    motion: Motion
    to_unit: Array
    models: Mapping[str, Correction]
    channels: tuple[Channel, ...]
    clock: Clock
    seed: int
    drift: Drift | None = None
    rig: bool = False


class Piece(NamedTuple):
    """Consecutive samples."""

    time: Array
    """(n,), s, as stamped."""
    sensors: dict[str, Array]
    """(n,) by name of the column: m/s^2 and rad/s, or whole counts."""
    rig: dict[str, Array]
    """(n,), rad and K."""


class _Instants(NamedTuple):
    """True times of a piece: of the samples, and of the one before."""

    stamps: Array
    true: Array
    intervals: Array
    before: float


class _Clean(NamedTuple):
    readings: dict[str, Array]
    """(3, n) by triad."""
    rig: dict[str, Array]


def stream(job: Job, *, threads: int | None = None, piece: int = PIECE) -> Iterator[Piece]:
    """Samples of a job, piece by piece.

    Parameters
    ----------
    job : Job
    threads : int, optional
        All processors unless given. The samples do not depend on it.
    piece : int
        Samples at a time; they do not depend on it either.

    Yields
    ------
    Piece
    """
    workers = threads or os.cpu_count() or 1
    axes = [_Axis(channel, job.clock, job.seed) for channel in job.channels]
    if workers == 1:  # a short recording is done before a thread has started
        for instants in _instants(job.clock, job.seed, piece):
            clean = _clean(job, instants)
            read = {a.channel.name: a.read(clean.readings[a.channel.sensor], instants) for a in axes}
            yield Piece(instants.stamps, read, clean.rig)
        return
    with ThreadPoolExecutor(workers) as pool:
        ahead: deque[tuple[_Instants, Future[_Clean]]] = deque()
        ahead_of_us = _instants(job.clock, job.seed, piece)

        def look_ahead() -> None:
            for times in ahead_of_us:
                ahead.append((times, pool.submit(_clean, job, times)))
                if len(ahead) > workers:
                    return

        last: tuple[_Instants, _Clean, list[Future[Array]]] | None = None
        look_ahead()
        try:
            while ahead:
                times, future = ahead.popleft()
                clean = future.result()
                done = _gathered(last, job) if last is not None else None
                # the axes of this piece may start only when those of the piece before are through
                tasks = [pool.submit(a.read, clean.readings[a.channel.sensor], times) for a in axes]
                last = times, clean, tasks
                look_ahead()
                if done is not None:
                    yield done
            if last is not None:
                yield _gathered(last, job)
        finally:
            for _, future in ahead:
                future.cancel()


def _gathered(part: tuple[_Instants, _Clean, list[Future[Array]]], job: Job) -> Piece:
    times, clean, tasks = part
    values = {c.name: t.result() for c, t in zip(job.channels, tasks, strict=True)}
    return Piece(times.stamps, values, clean.rig)


def _instants(clock: Clock, seed: int, piece: int) -> Iterator[_Instants]:
    """True times and time stamps."""
    early, wrong = (generator(seed, STREAMS[purpose]) for purpose in ("clock", "stamp"))
    before = 0.0
    for first in range(0, clock.count, piece):
        n = min(piece, clock.count - first)
        true = np.arange(first + 1, first + n + 1) / clock.frequency
        if clock.jitter > 0:
            true += early.uniform(-clock.jitter, clock.jitter, n)
        stamps = true + wrong.uniform(-clock.stamp_jitter, clock.stamp_jitter, n) if clock.stamp_jitter > 0 else true
        yield _Instants(stamps, true, np.diff(true, prepend=before), before)
        before = float(true[-1])


_NODE = 0.5 / math.sqrt(3.0)
"""Of Gauss' rule with two points, from the middle of an interval."""


def _clean(job: Job, times: _Instants) -> _Clean:
    """Readings without noise: at the instants of the samples, or for the mean input of the intervals before them.

    What a term of second order makes of the change of its input within an interval is left out: 1e-9 g for 12 ug/g^2 on a
    centrifuge at 10 g, half a turn a second and 1 kHz.
    """
    wanted = {c.sensor: c.increment for c in job.channels}
    out: dict[str, Array] = {}
    for increment in sorted(set(wanted.values())):
        sensors = [s for s, i in wanted.items() if i == increment]
        if increment:
            middle = times.true - 0.5 * times.intervals
            out |= _readings(job, middle, sensors, *_means(job.motion, times, middle))
        else:
            out |= _readings(job, times.true, sensors, *job.motion.inputs(times.true))
    rig = job.motion.columns(times.true) if job.rig else {}
    if job.drift is not None:
        rig["temperature"] = job.drift.profile(times.true)
    return _Clean(out, rig)


def _means(motion: Motion, times: _Instants, middle: Array) -> tuple[Array, Array]:
    """Mean inputs over the interval before each sample."""
    if isinstance(motion, Averaged):
        return motion.means(np.concatenate([[times.before], times.true]))
    both = [motion.inputs(middle + side * _NODE * times.intervals) for side in (-1.0, 1.0)]
    for whole, other in zip(*both, strict=True):
        np.add(whole, other, out=whole)
        np.multiply(whole, 0.5, out=whole)
    return both[0]


def _readings(job: Job, time: Array, sensors: list[str], force: Array, rate: Array) -> dict[str, Array]:
    """Readings (3, n) by triad for inputs in the case, (n, 3) each."""
    if not np.array_equal(job.to_unit, np.eye(3)):
        force, rate = force @ job.to_unit.T, rate @ job.to_unit.T
    out = {}
    for sensor in sensors:
        u, model = (force if sensor == "accel" else rate), job.models[sensor]
        values = np.ascontiguousarray(forward(model, u, force if model.needs_force else None).T)
        if job.drift is not None:
            warmer = job.drift.profile(time) - job.drift.reference
            for i in range(3):
                values[i] += warmer * (job.drift.bias[sensor][i] + job.drift.scale[sensor][i] * u[:, i])
        out[sensor] = values
    return out


@dataclass
class _Axis:
    """Noise and counter of one axis, continued from piece to piece."""

    channel: Channel
    clock: Clock
    seed: int
    _noise: AxisNoise = field(init=False)
    _residue: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        number = list(SENSORS).index(self.channel.sensor) * 3 + self.channel.axis
        stream = (STREAMS["noise"], number)
        self._noise = AxisNoise(self.channel.noise, 1.0 / self.clock.frequency, self.seed, stream)

    def read(self, clean: Array, times: _Instants) -> Array:
        """Readings (n,) of this axis, given those of its triad without noise, (3, n)."""
        values: Array = clean[self.channel.axis].copy()
        self._noise.add(values)
        if self.channel.worth == 0.0:
            return values
        if not self.channel.increment:
            return np.asarray(np.round(values / self.channel.worth))
        from ..kernels.simulation import count

        self._residue = count(self._residue, times.intervals, 1.0 / self.channel.worth, values)
        return values


def no_drift() -> dict[str, Array]:
    """Zero change with temperature, by triad."""
    return {sensor: np.zeros(len(AXES)) for sensor in SENSORS}
