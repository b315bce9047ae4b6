"""A unit on an imperfect centrifuge: the motion at any time, samples piece by piece, or the harmonics of each segment at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ..frames import Array, rot_x, rot_y, rot_z
from ..observe.harmonics import SegmentHarmonics
from ..plan import Plan
from ..recording import SENSORS
from ..rigs.centrifuge import Arm, inputs, series
from ..rigs.turntable import Site
from ..sensors import TERMS, Axis
from ..sensors.series import basis, response

ALL_AXES = (*SENSORS["accel"], *SENSORS["gyro"])
_ORDER = 3  # highest harmonic of a polynomial of third order
_CHUNK = 1 << 15  # samples at once: their arrays stay in the cache


@dataclass(frozen=True)
class SimulatedCentrifuge:
    """The rig as it is, which nobody there knows.

    Attributes
    ----------
    radius_error : float, m
    tilt : tuple of float, rad
        Of the arm's axis, about east and north.
    settings : ndarray, shape (segments, 3), or None, rad
        Error of each setting of alpha, beta, gamma; None: none.
    rate_error : float
        Relative, of all rates.
    phase : float, rad
        Added to the plan's arm_phase (zero where it has none).
    continuous : bool
        The arm turns on through the segments of one rate, from the first one's phase; otherwise every segment starts at its
        phase.
    mount : tuple of float, rad
        C_p^gimbals = Rx Ry Rz of the three.
    """

    radius_error: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    settings: Array | None = None
    rate_error: float = 0.0
    phase: float = 0.0
    continuous: bool = False
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)


PERFECT = SimulatedCentrifuge()


class Samples(NamedTuple):
    """Consecutive samples, as :class:`sagnac.recording.Batch` has them."""

    time: Array
    """(n,), s."""
    accel: Array | None
    """(n, 3), m/s^2, when all three axes are asked for."""
    gyro: Array | None
    """(n, 3), rad/s."""
    arm: Array
    """(n,), rad: true angle of the arm from east, less whole turns."""
    single: dict[str, Array]
    """Axes of a sensor that is not asked for as a whole, (n,) each."""


class State(NamedTuple):
    """Arm and gimbals at instants."""

    angle: Array
    """(n,), rad."""
    rate: Array
    """(n,), rad/s."""
    acceleration: Array
    """(n,), rad/s^2."""
    gimbals: Array
    """(n, 3), rad."""
    gimbal_rates: Array
    """(n, 3), rad/s."""


class _Piece(NamedTuple):
    """A stretch of time in which the arm turns steadily, or in which arm and gimbals move from one segment to the next."""

    start: float
    stop: float
    angles: tuple[float, float]
    rates: tuple[float, float]
    gimbals: tuple[Array, Array]
    steady: bool


@dataclass(frozen=True)
class Motion:
    """What arm and gimbals do over the whole plan: steady in its segments, smooth moves between them."""

    plan: Plan
    rig: SimulatedCentrifuge = PERFECT

    @cached_property
    def arm(self) -> Arm:
        """The arm with its errors."""
        radius = (self.plan.rig.radius or 0.0) + self.rig.radius_error
        return Arm(radius, self.plan.rig.counter_rotating, self.rig.tilt)

    @cached_property
    def site(self) -> Site:
        """Where the rig stands."""
        return Site(self.plan.need_latitude("the Earth rate"), self.plan.site_gravity, self.plan.earth_rate)

    @cached_property
    def to_p(self) -> Array:
        """From the gimbals' coordinates to those of the unit."""
        x, y, z = self.rig.mount
        return np.asarray((rot_x(x) @ rot_y(y) @ rot_z(z)).T)

    @cached_property
    def pieces(self) -> tuple[_Piece, ...]:
        """Steady and moving stretches in their order; the first and last go on for ever."""
        segments = sorted(enumerate(self.plan.segment), key=lambda s: s[1].start)
        errors = np.zeros((len(segments), 3)) if self.rig.settings is None else self.rig.settings
        out: list[_Piece] = []
        for i, s in segments:
            rate = s.arm_rate * (1.0 + self.rig.rate_error)
            angle = (s.arm_phase or 0.0) + self.rig.phase
            gimbals = np.array([s.alpha, s.beta, s.gamma]) + errors[i]
            if out:
                last = out[-1]
                gap = s.start - last.stop
                ahead = last.angles[1] + (last.rates[1] + rate) / 2.0 * gap
                # as far as steady acceleration would take it, or the nearest such angle
                angle = (
                    ahead if self.rig.continuous else angle + 2.0 * np.pi * np.round((ahead - angle) / (2.0 * np.pi))
                )
                out.append(
                    _Piece(
                        last.stop,
                        s.start,
                        (last.angles[1], angle),
                        (last.rates[1], rate),
                        (last.gimbals[1], gimbals),
                        steady=False,
                    )
                )
            end = angle + rate * (s.stop - s.start)
            out.append(_Piece(s.start, s.stop, (angle, end), (rate, rate), (gimbals, gimbals), steady=True))
        return tuple(out)

    def parts(self, time: Array) -> Iterator[tuple[slice, _Piece]]:
        """Stretches of increasing instants and the piece that each lies in."""
        ends = np.array([p.stop for p in self.pieces[:-1]])
        edges = [0, *np.searchsorted(time, ends).tolist(), time.size]
        for piece, i, j in zip(self.pieces, edges[:-1], edges[1:], strict=True):
            if j > i:
                yield slice(i, j), piece

    def state(self, time: Array) -> State:
        """Arm and gimbals at increasing instants (n,), s."""
        angle, rate, acceleration = np.empty((3, time.size))
        gimbals, gimbal_rates = np.empty((2, time.size, 3))
        for at, piece in self.parts(time):
            moved = _moved(piece, time[at])
            angle[at], rate[at], acceleration[at], gimbals[at], gimbal_rates[at] = moved
        return State(angle, rate, acceleration, gimbals, gimbal_rates)

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """Specific force [m/s^2] and angular rate [rad/s] of the unit in p at increasing instants, (n, 3) each."""
        s = self.state(time)
        force, rate = inputs(
            self.arm,
            self.site,
            s.angle,
            s.rate,
            s.gimbals,
            arm_acceleration=s.acceleration,
            gimbal_rates=s.gimbal_rates,
        )
        return force @ self.to_p.T, rate @ self.to_p.T


def _moved(piece: _Piece, time: Array) -> State:
    """Arm and gimbals within a piece: steady, or a cubic from one angle and rate to the next."""
    if piece.steady:
        rate = np.full(time.size, piece.rates[0])
        gimbals = np.repeat(piece.gimbals[0][None], time.size, axis=0)
        angle = piece.angles[0] + piece.rates[0] * (time - piece.start)
        return State(angle, rate, np.zeros(time.size), gimbals, np.zeros_like(gimbals))
    h = piece.stop - piece.start
    (a0, a1), (r0, r1) = piece.angles, piece.rates
    u = (time - piece.start) / h
    apart, middle = (a1 - a0) / h, r0 + r1
    angle = a0 + h * (r0 * u + (3 * apart - 2 * r0 - r1) * u**2 + (middle - 2 * apart) * u**3)
    rate = r0 + 2 * (3 * apart - 2 * r0 - r1) * u + 3 * (middle - 2 * apart) * u**2
    acceleration = (2 * (3 * apart - 2 * r0 - r1) + 6 * (middle - 2 * apart) * u) / h
    way = piece.gimbals[1] - piece.gimbals[0]
    gimbals = piece.gimbals[0] + np.outer(u * u * (3 - 2 * u), way)
    return State(angle, rate, acceleration, gimbals, np.outer(6 * u * (1 - u) / h, way))


class Sensor(NamedTuple):
    """One sensor and the values of its parameters."""

    axis: Axis
    x: Array


def sensors_of(truth: Mapping[str, float], axes: Sequence[str] = ALL_AXES) -> tuple[Sensor, ...]:
    """Models of the axes asked for.

    Parameters
    ----------
    truth : mapping of str to float
        Parameters by name, SI; misalignments as directions of the input axes. Absent ones are zero.
    axes : sequence of str
        ``accel_x`` to ``gyro_z``.

    Raises
    ------
    ValueError
        When a parameter is none of these sensors'.
    """
    for name in truth:
        kind, _, rest = name.partition(".")
        if kind in TERMS and rest.split(".")[0] not in (*TERMS[kind], "scale_error", "misalignment"):
            raise ValueError(f"no sensor has a parameter {name!r}")
    out = []
    for column in axes:
        kind, _, letter = column.partition("_")
        own = [n.split(".") for n in truth if n.startswith(f"{kind}.")]
        terms = tuple(t for _, t, a in own if a == letter and t in (*TERMS[kind], "scale_error"))
        pairs = tuple(a for _, t, a in own if t == "misalignment" and a[0] == letter)
        axis = Axis(kind, letter, terms, pairs)
        out.append(Sensor(axis, np.array([truth[n] for n in axis.names])))
    return tuple(out)


@dataclass(frozen=True)
class _Readings:
    """Noise-free readings of several sensors over a motion."""

    motion: Motion
    sensors: tuple[Sensor, ...]
    _coefficients: dict[float, Array] = field(default_factory=dict)

    def at(self, time: Array) -> tuple[Array, Array]:
        """Readings (n, sensors) and the arm's angle (n,) at increasing instants."""
        out, angle = np.empty((time.size, len(self.sensors))), np.empty(time.size)
        for at, piece in self.motion.parts(time):
            if piece.steady:
                angle[at] = piece.angles[0] + piece.rates[0] * (time[at] - piece.start)
                np.matmul(basis(angle[at], _ORDER), self.coefficients(piece), out=out[at])
                continue
            angle[at] = self.motion.state(time[at]).angle
            force, rate = self.motion.inputs(time[at])
            for j, s in enumerate(self.sensors):
                out[at, j] = s.axis.evaluate(s.x, force, rate).value
        return out, angle

    def coefficients(self, piece: _Piece) -> Array:
        """Fourier coefficients of a steady piece, (7, sensors), computed once."""
        if piece.start not in self._coefficients:
            felt = series(self.motion.arm, self.motion.site, np.array(piece.rates[:1]), piece.gimbals[0][None])
            force, rate = self.motion.to_p @ felt.force, self.motion.to_p @ felt.rate
            told = [response(s.axis, s.x, force, rate, _ORDER).value[0] for s in self.sensors]
            self._coefficients[piece.start] = np.stack(told, axis=1)
        return self._coefficients[piece.start]


def simulate(
    plan: Plan,
    truth: Mapping[str, float],
    *,
    rig: SimulatedCentrifuge = PERFECT,
    axes: Sequence[str] = ALL_AXES,
    frequency: float = 1000.0,
    density: Mapping[str, float] | None = None,
    rng: np.random.Generator | None = None,
    start: float = 0.0,
    stop: float | None = None,
) -> Iterator[Samples]:
    """Samples of the whole plan, piece by piece.

    Parameters
    ----------
    plan : Plan
        With rig.kind ``centrifuge``.
    truth : mapping of str to float
        See :func:`sensors_of`.
    rig : SimulatedCentrifuge
    axes : sequence of str
        Columns wanted, ``accel_x`` to ``gyro_z``.
    frequency : float, Hz
    density : mapping of str to float, optional
        White noise of ``accel`` and ``gyro``, or of single axes, per sqrt(Hz).
    rng : numpy Generator, optional
        Needed with noise.
    start, stop : float, s
        Times of the first and of the last sample; the latter is the end of the plan where not given.

    Yields
    ------
    Samples
    """
    readings = _Readings(Motion(plan, rig), sensors_of(truth, axes))
    noise = density or {}
    size = np.array([noise.get(a, noise.get(a.partition("_")[0], 0.0)) for a in axes]) * np.sqrt(frequency)
    if size.any() and rng is None:
        raise ValueError("noise needs a generator of random numbers (rng)")
    last = max(s.stop for s in plan.segment) if stop is None else stop
    count = int(np.floor((last - start) * frequency * (1.0 + 1e-12))) + 1
    for first in range(0, count, _CHUNK):
        time = start + np.arange(first, min(first + _CHUNK, count)) / frequency
        values, angle = readings.at(time)
        if rng is not None and size.any():
            values += size * rng.standard_normal(values.shape)
        yield _sorted(time, values, np.remainder(angle, 2.0 * np.pi), axes)


def _sorted(time: Array, values: Array, arm: Array, axes: Sequence[str]) -> Samples:
    """Columns as whole triads where all three are there."""
    columns = {a: values[:, i] for i, a in enumerate(axes)}
    whole = {
        sensor: np.stack([columns.pop(a) for a in triad], axis=1)
        for sensor, triad in SENSORS.items()
        if all(a in columns for a in triad)
    }
    return Samples(time, whole.get("accel"), whole.get("gyro"), arm, columns)


@lru_cache(maxsize=32)
def _regression(
    rate: float, count: int, interval: float, order: int, extended: bool
) -> tuple[Array, Array, Array, Array]:
    """Time from the middle (count,), least-squares matrix (c, count), covariance (c, c) and its root for unit variance."""
    tau: Array = (np.arange(count, dtype=float) - 0.5 * (count - 1)) * interval
    terms = basis(rate * tau, order if rate else 0)
    if extended and rate:
        terms = np.hstack([terms, tau[:, None] * terms[:, 1:]])
    size = np.linalg.norm(terms, axis=0)
    left, values, right = np.linalg.svd(terms / size, full_matrices=False)
    root = right.T / values / size[:, None]
    return tau, root @ left.T, root @ root.T, root


def simulate_harmonics(
    plan: Plan,
    truth: Mapping[str, float],
    *,
    rig: SimulatedCentrifuge = PERFECT,
    axes: Sequence[str] = ALL_AXES,
    frequency: float = 1000.0,
    density: Mapping[str, float] | None = None,
    rng: np.random.Generator | None = None,
    order: int = 4,
    extended: bool = False,
) -> SegmentHarmonics:
    """What :func:`sagnac.observe.harmonics.segment_harmonics` would find, drawn at once: for campaigns of thousands of runs.

    Parameters
    ----------
    plan, truth, rig, axes, frequency, density, rng
        See :func:`simulate`.
    order : int
        Highest harmonic.
    extended : bool
        With the terms that show an error of the rate, which is then, as if found in the samples, that of the arm; otherwise
        that of the plan.

    Returns
    -------
    SegmentHarmonics
        Its noise density is the true one.
    """
    readings = _Readings(Motion(plan, rig), sensors_of(truth, axes))
    pieces = {p.start: p for p in readings.motion.pieces if p.steady}
    noise = density or {}
    levels = np.array([noise.get(a, noise.get(a.partition("_")[0], 0.0)) for a in axes])
    n, m, c = len(plan.segment), len(axes), 1 + 2 * order * (1 + extended)
    coefficient, covariance = np.zeros((n, m, c)), np.zeros((n, c, c))
    covariance[:, np.arange(c), np.arange(c)] = np.inf
    rates, phases, middles = np.empty(n), np.empty(n), np.empty(n)
    counts = np.array([max(round((s.stop - s.start) * frequency), 1) for s in plan.segment])
    for i, s in enumerate(plan.segment):
        piece = pieces[s.start]
        rates[i] = piece.rates[0] if extended and s.arm_rate else s.arm_rate
        tau, solve, spread, root = _regression(float(rates[i]), int(counts[i]), 1.0 / frequency, order, extended)
        middles[i] = s.start + tau[-1]
        phases[i] = (s.arm_phase or 0.0) + float(rates[i]) * tau[-1]
        true = piece.angles[0] + piece.rates[0] * (middles[i] + tau - s.start)
        turned = _turned_terms(len(spread), phases[i], order)
        values = (turned @ (solve @ (basis(true, _ORDER) @ readings.coefficients(piece)))).T
        if rng is not None:
            values += levels[:, None] * np.sqrt(frequency) * (turned @ root @ rng.standard_normal((len(spread), m))).T
        k = len(spread)
        coefficient[i, :, :k], covariance[i, :k, :k] = values, turned @ spread @ turned.T
    interval = np.full(n, 1.0 / frequency)
    found = np.where(rates != 0, rates, np.nan) if extended else np.full(n, np.nan)
    return SegmentHarmonics(
        segments=plan.segment,
        order=order,
        axes=tuple(axes),
        mid_time=middles,
        interval=interval,
        duration=counts * interval,
        count=counts,
        rate=rates,
        phase=phases,
        coefficient=coefficient,
        unit_covariance=covariance,
        condition=np.ones(n),
        density=levels,
        noise_degrees_of_freedom=float(counts.sum()),
        residual_variance=np.tile(levels**2 * frequency, (n, 1)),
        measured_rate=found,
        rate_sigma=1e-9 * np.abs(found),
        arm_known=np.zeros(n, dtype=np.bool_),
        span=(min(s.start for s in plan.segment), max(s.stop for s in plan.segment)),
    )


def _turned_terms(count: int, phase: float, order: int) -> Array:
    """From coefficients in an angle that is zero in the middle to those in an angle that is `phase` there, (count, count)."""
    out = np.eye(count)
    for k in range(1, count - 1, 2):
        h = (k - 1) // 2 % order + 1
        c, s = np.cos(h * phase), np.sin(h * phase)
        out[k : k + 2, k : k + 2] = [[c, -s], [s, c]]
    return out
