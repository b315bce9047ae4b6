"""A roll-isolated rig that does not exist: a plan and the truth become samples, piece by piece.

The published case [ZHANG15] is here as :data:`PUBLISHED`, :func:`published_plan` and :func:`published_check`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..frames import Array
from ..plan import Limits, Noise, Plan, Rig, Segment, Unit
from ..recording import Batch, Recording, from_arrays
from ..rigs.roll_isolated import (
    DELAY,
    ECCENTRICITY,
    HALF_ANGLE,
    MOUNT_PITCH,
    MOUNT_YAW,
    PHASE,
    RollRig,
    encoder_reading,
    unit_rates,
)

_DEG = math.pi / 180
_DEG_H = _DEG / 3600
PARAMETERS = (
    MOUNT_YAW,
    MOUNT_PITCH,
    HALF_ANGLE,
    PHASE,
    *(f"gyro.{term}.{a}" for term in ("bias", "scale_error") for a in "xyz"),
    DELAY,
    *ECCENTRICITY,
)
"""Names that a truth may hold; what it lacks is zero."""

PUBLISHED = {
    MOUNT_YAW: -0.11 * _DEG,
    MOUNT_PITCH: -0.04 * _DEG,
    HALF_ANGLE: 0.1642 * _DEG,
    PHASE: 27.3 * _DEG,
}
"""Angles found by [ZHANG15], rad."""
BIAS_STABILITY = 30.0 * _DEG_H
"""Of the gyros of [ZHANG15], rad/s."""
DENSITY = 0.005 * _DEG
"""Noise of the simulated gyros, rad/s/sqrt(Hz): 0.3 deg/sqrt(h). The publication gives none; usual at +-300 deg/s."""
BITS = 14
"""Of the simulated encoder: a step of 0.022 deg. The publication gives none."""


def published_plan(
    *, hold: float = 60.0, spins: tuple[float, ...] = (6480.0,), move: float = 10.0, encoder_delay: float | None = None
) -> Plan:
    """Stage 1 at +-280 deg/s, stage 2 at 6480 deg/s (or others), as in [ZHANG15].

    Parameters
    ----------
    hold, move : float, s
        Length of a segment, and time between two.
    spins : tuple of float, deg/s
    encoder_delay : float, s, or None
        As the plan states it.
    """
    segments, now = [], move
    stages: list[tuple[str, float]] = [("inner", 280.0), ("inner", -280.0), *(("spin", s) for s in spins)]
    for number, (stage, rate) in enumerate(stages):
        name = f"spin {number - 1}" if stage == "spin" else f"inner {'+' if rate > 0 else '-'}"
        rates = {f"{stage}_rate": rate * _DEG}
        segments.append(
            Segment.model_validate({"name": name, "start": now, "stop": now + hold, "stage": stage} | rates)
        )
        now += hold + move
    return _plan(tuple(segments), encoder_delay)


def published_check(*, hold: float = 60.0, spin: float = 3600.0, encoder_delay: float | None = None) -> Plan:
    """The published test: 3600 deg/s for 60 s."""
    segment = Segment(name="test", start=5.0, stop=5.0 + hold, stage="spin", spin_rate=spin * _DEG)
    return _plan((segment,), encoder_delay)


def _plan(segments: tuple[Segment, ...], encoder_delay: float | None) -> Plan:
    return Plan(
        latitude=40.0 * _DEG,
        unit=Unit(
            model="simulated MEMS unit",
            serial="0001",
            noise=Noise(gyro=DENSITY),
            limits=Limits(gyro_drift=BIAS_STABILITY, gyro_scale=0.01),
        ),
        rig=Rig(
            kind="roll-isolated",
            rate_uncertainty=1e-4,
            encoder_resolution=2.0 * math.pi / 2**BITS,
            encoder_delay=encoder_delay,
        ),
        segment=segments,
    )


@dataclass(frozen=True)
class Profile:
    """A quantity that changes linearly from knot to knot, and its integral; constant beyond the ends."""

    time: Array
    value: Array
    integral: Array

    @classmethod
    def through(cls, knots: Iterable[tuple[float, float]]) -> Profile:
        """From (time, value) in order of time."""
        time, value = np.array(list(knots), dtype=float).T
        steps = np.diff(time) * (value[:-1] + value[1:]) / 2.0
        return cls(time, value, np.concatenate([[0.0], np.cumsum(steps)]))

    def at(self, time: Array) -> tuple[Array, Array]:
        """Value and integral since the first knot, (n,) each."""
        value = np.interp(time, self.time, self.value)
        i = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, self.time.size - 1)
        return value, self.integral[i] + (time - self.time[i]) * (self.value[i] + value) / 2.0


@dataclass(frozen=True)
class Motion:
    """What rig and cylinder do over a whole plan.

    Attributes
    ----------
    spin, inner : Profile
        Rates of the carrier and of the inner cylinder turned on its own, rad/s.
    envelope : Profile
        Of the swing, one where the carrier spins.
    amplitude, frequency : float, rad and Hz
        Of the swing.
    """

    spin: Profile
    inner: Profile
    envelope: Profile
    amplitude: float
    frequency: float

    @classmethod
    def of(cls, plan: Plan, amplitude: float, frequency: float) -> Motion:
        """The plan's rates, with steady changes between segments and from and to rest at the ends."""
        spin: list[tuple[float, float]] = []
        inner: list[tuple[float, float]] = []
        envelope: list[tuple[float, float]] = []
        for s in sorted(plan.segment, key=lambda s: s.start):
            for t in (s.start, s.stop):
                spin.append((t, s.spin_rate))
                inner.append((t, s.inner_rate))
                envelope.append((t, float(s.stage == "spin")))
        first, last = spin[0][0], spin[-1][0]
        for knots in (spin, inner, envelope):
            if first > 0:
                knots.insert(0, (0.0, 0.0))
            knots.append((last + 5.0, 0.0))
        return cls(Profile.through(spin), Profile.through(inner), Profile.through(envelope), amplitude, frequency)

    def swing(self, time: Array) -> tuple[Array, Array]:
        """Angle and rate of the swing, (n,) each."""
        rise = np.diff(self.envelope.value) / np.maximum(np.diff(self.envelope.time), 1e-9)
        size, _ = self.envelope.at(time)
        i = np.clip(np.searchsorted(self.envelope.time, time, side="right") - 1, 0, rise.size - 1)
        w = 2.0 * math.pi * self.frequency
        sin, cos = np.sin(w * time), np.cos(w * time)
        return self.amplitude * size * sin, self.amplitude * (size * w * cos + rise[i] * sin)

    def angle(self, time: Array, rig: RollRig) -> Array:
        """Roll e of the carrier against the inner cylinder, rad; nothing of it moves while the cylinder is turned alone."""
        return np.asarray(self.spin.at(time)[1] * math.cos(rig.half_angle) - self.swing(time)[0])


def simulate(
    plan: Plan,
    truth: Mapping[str, float],
    rng: np.random.Generator,
    *,
    frequency: float = 1000.0,
    swing_amplitude: float = 2.0 * _DEG,
    swing_frequency: float = 1.7,
    encoder_bits: int | None = BITS,
    density: float | None = None,
    drift: float = 0.0,
    earth: tuple[float, float, float] | None = None,
    full_scale: float | None = None,
    stop: float | None = None,
    chunk: int = 1 << 16,
) -> Iterator[Batch]:
    """Samples of a whole plan, with the moves between its segments.

    Parameters
    ----------
    plan : Plan
        Of a roll-isolated rig.
    truth : mapping of str to float
        Parameters by name (:data:`PARAMETERS`), SI.
    rng : numpy Generator
    frequency : float, Hz
    swing_amplitude, swing_frequency : float, rad and Hz
        Of the inner cylinder while the carrier spins.
    encoder_bits : int or None
        The encoder's steps are a turn over 2^bits; None: it does not round.
    density : float, rad/s/sqrt(Hz), optional
        White noise of the gyros; otherwise the plan's, or none.
    drift : float, rad/s
        Standard deviation of what each gyro's bias is off in each segment.
    earth : tuple of three floats, rad/s, optional
        Earth rate along the roll axis, and up and right of it; otherwise that of a level axis pointing north at the plan's
        latitude, or none.
    full_scale : float, rad/s, optional
        Range of the gyros.
    stop : float, s, optional
        End of the recording; otherwise a second after the last segment.
    chunk : int
        Samples in a piece. The samples do not depend on it.

    Yields
    ------
    Batch
        With ``gyro`` and ``rig["encoder"]``, the latter between 0 and one turn.
    """
    rig = RollRig.of(truth)
    motion = Motion.of(plan, swing_amplitude, swing_frequency)
    bias = np.array([truth.get(f"gyro.bias.{a}", 0.0) for a in "xyz"])
    gain = 1.0 + np.array([truth.get(f"gyro.scale_error.{a}", 0.0) for a in "xyz"])
    stated = plan.unit.noise.of("gyro") or np.zeros(3)
    noise = np.asarray(stated if density is None else density) * math.sqrt(frequency)
    offsets = _offsets(plan, rng, drift)
    turning = _earth_of(plan) if earth is None else earth
    step = 0.0 if encoder_bits is None else 2.0 * math.pi / 2**encoder_bits
    end = max(s.stop for s in plan.segment) + 1.0 if stop is None else stop
    for first in range(1, math.floor(end * frequency) + 1, chunk):
        time = np.arange(first, min(first + chunk, math.floor(end * frequency) + 1)) / frequency
        rates = _true_rates(time, motion, rig, turning)
        gyro = gain * rates + bias + offsets(time) + noise * rng.standard_normal((time.size, 3))
        if full_scale is not None:
            gyro = np.clip(gyro, -full_scale, full_scale)
        reading = encoder_reading(motion.angle(time + rig.delay, rig), rig, step)
        yield Batch(first, time, None, gyro, {"encoder": np.mod(reading, 2.0 * math.pi)})


def _true_rates(time: Array, motion: Motion, rig: RollRig, earth: tuple[float, float, float]) -> Array:
    """Rates of the unit with the Earth's, (n, 3)."""
    from ..rigs.roll_isolated import mount

    inner, turned = motion.inner.at(time)
    swung, swing_rate = motion.swing(time)
    out = unit_rates(inner + swing_rate, motion.spin.at(time)[0], motion.angle(time, rig), rig)
    if any(earth):
        c, s = np.cos(turned + swung), np.sin(turned + swung)
        along, up, right = earth
        felt = np.stack([np.full(time.size, along), up * c + right * s, right * c - up * s])
        out += (mount(rig.mount_yaw, rig.mount_pitch) @ felt).T
    return out


def _offsets(plan: Plan, rng: np.random.Generator, drift: float) -> Any:
    """Bias changes of the three gyros as a function of time (n,) -> (n, 3): steady in a segment, linear between."""
    if drift == 0.0:
        return lambda _: 0.0
    segments = sorted(plan.segment, key=lambda s: s.start)
    values = np.repeat(drift * rng.standard_normal((len(segments), 3)), 2, axis=0)
    knots = np.array([t for s in segments for t in (s.start, s.stop)])
    return lambda time: np.stack([np.interp(time, knots, v) for v in values.T], axis=-1)


def _earth_of(plan: Plan) -> tuple[float, float, float]:
    if plan.latitude is None:
        return 0.0, 0.0, 0.0
    return plan.earth_rate * math.cos(plan.latitude), plan.earth_rate * math.sin(plan.latitude), 0.0


def recording_of(batches: Iterable[Batch], name: str = "simulated recording") -> Recording:
    """A recording in memory from pieces of :func:`simulate`."""
    parts = list(batches)
    return from_arrays(
        np.concatenate([b.time for b in parts]),
        gyro=np.concatenate([b.gyro for b in parts if b.gyro is not None]),
        rig={"encoder": np.concatenate([b.rig["encoder"] for b in parts])},
        name=name,
    )


def write_recording(path: str | Path, batches: Iterable[Batch]) -> int:
    """Write pieces of :func:`simulate` as a Parquet recording in deg/s and deg, one after the other.

    Returns
    -------
    int
        Number of samples.
    """
    import pyarrow as pa
    from pyarrow import parquet

    from ..files import write_atomically

    names = ["time [s]", *(f"gyro_{a} [deg/s]" for a in "xyz"), "encoder [deg]"]
    schema = pa.schema([(n, pa.float64()) for n in names])
    rows = 0
    with write_atomically(path) as temporary, parquet.ParquetWriter(temporary, schema) as writer:
        for b in batches:
            assert b.gyro is not None  # simulate makes no other
            columns = [b.time, *np.degrees(b.gyro.T), np.degrees(b.rig["encoder"])]
            writer.write_batch(
                pa.RecordBatch.from_arrays([pa.array(np.ascontiguousarray(c)) for c in columns], schema=schema)
            )
            rows += b.time.size
    return rows
