"""Rows of the spin stage of a roll-isolated rig.

The roll rate f is not known beforehand. Gyro x, solved for f and integrated to a roll angle, is compared with the encoder in the
angle domain ::

    u(t) - w cos a (t + d) + roll(t + d) = constant + random walk of gyro x + rounding of the encoder

(u: the reading with the eccentricity undone, d: delay), whitened exactly by the innovations of a local-level filter
(:mod:`sagnac.kernels.local_level`): a rounded encoder cannot be differentiated. Gyros y and z give a row each, with e from the
encoder as that filter sees it, and with the noise of gyro x neglected where mounting angles carry it over.

Derivatives are exact but for that of the cone which gyro x sees, smoothed, to the eccentricity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ...frames import Array
from ...observe.rolling import Window, local_polynomial, polynomial_taps, step_integrals
from ...plan import Segment
from ...rigs.roll_isolated import (
    DELAY,
    ECCENTRICITY,
    HALF_ANGLE,
    MOUNT_PITCH,
    MOUNT_YAW,
    PHASE,
    RollRig,
    eccentric_basis,
    eccentric_slope,
    mount,
    mount_derivatives,
    true_angle,
    unit_rate_derivatives,
    unit_rates,
)
from .rows import Noise, Piece, drift_name, earth_names, spin_name

# parameters that the rows of the encoder depend on, in the order of their columns
_ENCODER = (
    "gyro.bias.x",
    "gyro.scale_error.x",
    MOUNT_YAW,
    MOUNT_PITCH,
    HALF_ANGLE,
    PHASE,
    "spin",
    DELAY,
    *ECCENTRICITY,
)
_BIAS, _SCALE, _YAW, _PITCH, _HALF, _PHASE, _SPIN, _DELAY = range(8)
_ECC = slice(8, 12)


@dataclass
class Run:
    """State of the spin stage from window to window of a segment."""

    origin: float
    integral: float = 0.0
    reading: float = 0.0
    variance: float = -1.0
    levels: Array = field(default_factory=lambda: np.zeros(len(_ENCODER) + 1))


def spin_rows(
    w: Window,
    segment: Segment,
    run: Run,
    values: Mapping[str, float],
    noise: Noise,
    interval: float,
    steady: float | None,
) -> Piece:
    """Rows of the encoder and of gyros y and z while the carrier spins.

    Parameters
    ----------
    w : Window
    segment : Segment
    run : Run
        What came before in this segment; brought up to date.
    values : mapping of str to float
        Parameters by name, the segment's spin rate among them; what else is not there is zero.
    noise : Noise
    interval : float, s
    steady : float, rad/s, or None
        Mean gyro x where the cylinder does not swing enough to tell motion from noise.
    """
    from ...kernels.local_level import innovations

    if w.fresh:
        run.variance = -1.0
    v = _SpinValues.of(values, segment)
    time = w.time[w.centre]
    motion = _motion(w, v, interval) if steady is None else _Motion.steady(steady, time.size)
    angles = _angles(w, run, v, motion)
    walk = float(noise.gyro[0]) ** 2  # scale and mounting change it by less than it is known
    steps = np.diff(w.time[w.half - 1 : w.half + time.size])
    whitened, back, run.variance = innovations(angles.columns, steps, noise.encoder, walk, run.variance, run.levels)
    # as the filter sees it: a filtered reading is the reading less what `back` makes of the innovation
    angle, d_angle = angles.angle - back * whitened[-1], angles.d_angle - back * whitened[:-1]
    roll_rate, d_roll_rate = motion.roll_rate(v)
    across = _Across(segment, v, roll_rate, d_roll_rate, angle, d_angle, angles.rolled)
    # the filter's angle is off by its own uncertainty, which the cone turns into noise
    blur = 0.5 * (v.spin * math.sin(v.rig.half_angle)) ** 2 * run.variance
    sigma = np.sqrt(noise.gyro[1:] ** 2 / interval + blur)
    channels = {
        "encoder": (_common(segment), whitened),
        "y": across.rows(1, values, w.gyro[w.centre, 1], float(sigma[0])),
        "z": across.rows(2, values, w.gyro[w.centre, 2], float(sigma[1])),
    }
    return Piece(w.segment, time, channels, roll_rate, angle, sigma)


def _common(segment: Segment) -> tuple[str, ...]:
    return tuple(spin_name(segment) if n == "spin" else n for n in _ENCODER)


@dataclass(frozen=True)
class _SpinValues:
    """Parameters of a spinning segment; `gain` takes gyro x less its bias to the roll rate."""

    rig: RollRig
    spin: float
    bias: float
    scale: float
    gain: float

    @classmethod
    def of(cls, values: Mapping[str, float], segment: Segment) -> _SpinValues:
        rig = RollRig.of(values)
        scale = values.get("gyro.scale_error.x", 0.0)
        gain = 1.0 / ((1.0 + scale) * math.cos(rig.mount_pitch) * math.cos(rig.mount_yaw))
        return cls(rig, values[spin_name(segment)], values.get("gyro.bias.x", 0.0), scale, gain)


@dataclass(frozen=True)
class _Motion:
    """Motion about the axis as gyro x sees it, smoothed, without the cone.

    Its noise is no motion that the encoder could show a delay later, and would pass for one.
    """

    rate: Array
    """Local quadratic of gyro x, (3, n)."""
    slopes: Array
    """Its derivatives to the parameters, (12, 3, n), or (12, 3, 1)."""

    @classmethod
    def steady(cls, rate: float, count: int) -> _Motion:
        """A cylinder that does not swing."""
        out = np.zeros((3, count))
        out[0] = rate
        return cls(out, np.zeros((len(_ENCODER), 3, 1)))

    def roll_rate(self, v: _SpinValues) -> tuple[Array, Array]:
        """Roll rate f (n,) and its derivatives (12, n)."""
        return self._rolled(v, self.rate[0] - v.bias, self.slopes[:, 0], 1.0)

    def shift(self, v: _SpinValues) -> tuple[Array, Array]:
        """Roll from t to t + d, (n,), and its derivatives (12, n)."""
        d = v.rig.delay
        (g0, g1, g2), slopes = self.rate, np.moveaxis(self.slopes, 1, 0)
        turned = d * (g0 + d * (g1 / 2.0 + d * g2 / 3.0) - v.bias)
        by_slopes = d * (slopes[0] + d * (slopes[1] / 2.0 + d * slopes[2] / 3.0))
        out, d_out = self._rolled(v, turned, by_slopes, d)
        d_out[_DELAY] += v.gain * (g0 + d * (g1 + d * g2) - v.bias)
        return out, d_out

    @staticmethod
    def _rolled(v: _SpinValues, turned: Array, slopes: Array, per_bias: float) -> tuple[Array, Array]:
        """Gyro x less bias, or its integral, taken to the axis."""
        out = v.gain * turned
        d_out = np.broadcast_to(v.gain * slopes, (len(_ENCODER), out.size)).copy()
        d_out[_BIAS] -= v.gain * per_bias
        d_out[_SCALE] -= out / (1.0 + v.scale)
        d_out[_YAW] += out * math.tan(v.rig.mount_yaw)
        d_out[_PITCH] += out * math.tan(v.rig.mount_pitch)
        return out, d_out


def _motion(w: Window, v: _SpinValues, interval: float) -> _Motion:
    """Smoothed gyro x less what it sees of the cone through the mounting angles."""
    assert w.encoder is not None  # start.look has seen to it
    rig, taps = v.rig, polynomial_taps(w.half, interval)
    turn, d_turn = mount(rig.mount_yaw, rig.mount_pitch)[0], mount_derivatives(rig.mount_yaw, rig.mount_pitch)[:, 0]
    e = true_angle(w.encoder, rig.eccentricity) + rig.phase - v.spin * math.cos(rig.half_angle) * rig.delay
    cos, sin = local_polynomial(np.cos(e), taps), local_polynomial(np.sin(e), taps)
    sa, ca = math.sin(rig.half_angle), math.cos(rig.half_angle)
    size = (1.0 + v.scale) * v.spin * sa
    seen = turn[1] * cos + turn[2] * sin
    by_angle = -size * (turn[2] * cos - turn[1] * sin)
    slopes = np.zeros((len(_ENCODER), *cos.shape))
    slopes[_SCALE] = -v.spin * sa * seen
    slopes[_YAW] = -size * (d_turn[0, 1] * cos + d_turn[0, 2] * sin)
    slopes[_PITCH] = -size * (d_turn[1, 1] * cos + d_turn[1, 2] * sin)
    slopes[_HALF] = -(1.0 + v.scale) * v.spin * ca * seen + by_angle * v.spin * sa * rig.delay
    slopes[_PHASE] = by_angle
    slopes[_SPIN] = -(1.0 + v.scale) * sa * seen - by_angle * ca * rig.delay
    slopes[_DELAY] = -by_angle * v.spin * ca
    return _Motion(local_polynomial(w.gyro[:, 0], taps) - size * seen, slopes)


@dataclass(frozen=True)
class _Angles:
    """Encoder against spin and rolled angle in one window."""

    columns: Array
    """Derivatives to the parameters and, last, what should be constant, (13, n)."""
    angle: Array
    """Encoder's angle e at the samples' time, not filtered, (n,)."""
    d_angle: Array
    """Its derivatives, (12, n)."""
    rolled: Array
    """roll(t) by gyro x, (n,)."""


def _angles(w: Window, run: Run, v: _SpinValues, motion: _Motion) -> _Angles:
    assert w.encoder is not None  # start.look has seen to it
    rig, time = v.rig, w.time[w.centre] - run.origin
    d, ca, sa = rig.delay, math.cos(rig.half_angle), math.sin(rig.half_angle)
    u = true_angle(w.encoder[w.centre], rig.eccentricity)
    shift, d_angle = motion.shift(v)
    angle = u - v.spin * ca * d + shift
    d_angle[_HALF] += v.spin * sa * d
    d_angle[_SPIN] -= ca * d
    d_angle[_DELAY] -= v.spin * ca
    d_angle[_ECC] -= eccentric_basis(u) / (1.0 + eccentric_slope(u, rig.eccentricity))
    steps = step_integrals(w.time, w.gyro[:, 0], w.half)
    if w.fresh:
        steps[0] = 0.0
    integral = run.integral + np.cumsum(steps)
    run.integral = float(integral[-1])
    # gyro x sees the cone through the mounting angles: a rate whose integral has a closed form, but for a slow swing's change
    ty, tp = math.tan(rig.mount_yaw), math.tan(rig.mount_pitch)
    cy, cp = math.cos(rig.mount_yaw), math.cos(rig.mount_pitch)
    roll_rate, d_roll_rate = motion.roll_rate(v)
    turning = v.spin * ca - roll_rate
    longer = v.spin / turning
    cos, sin = longer * np.cos(angle + rig.phase), longer * np.sin(angle + rig.phase)
    seen = tp / cy * sin + ty * cos
    by_angle = -sa * (tp / cy * cos - ty * sin)
    turned = v.gain * (integral - v.bias * time)
    rolled = turned - sa * seen
    out = np.empty((len(_ENCODER) + 1, time.size))
    out[:-1] = (1.0 + by_angle) * d_angle - sa * seen / turning * d_roll_rate
    out[_BIAS] -= v.gain * time
    out[_SCALE] -= turned / (1.0 + v.scale)
    out[_YAW] += turned * ty - sa * (tp * ty / cy * sin + cos / cy**2)
    out[_PITCH] += turned * tp - sa / (cy * cp**2) * sin
    out[_HALF] += v.spin * sa * time - ca * seen - sa * seen * (v.spin * sa / turning)
    out[_PHASE] += by_angle
    out[_SPIN] += sa * seen * roll_rate / (v.spin * turning) - ca * time
    chain = np.unwrap(np.concatenate([[run.reading], angle - v.spin * ca * time + rolled]))
    out[-1] = chain[1:]
    run.reading = float(chain[-1])
    return _Angles(out, angle, d_angle, rolled)


@dataclass(frozen=True)
class _Across:
    """What gyros y and z of one window depend on."""

    segment: Segment
    v: _SpinValues
    roll_rate: Array
    d_roll_rate: Array
    angle: Array
    d_angle: Array
    rolled: Array

    def rows(self, i: int, values: Mapping[str, float], gyro: Array, sigma: float) -> tuple[tuple[str, ...], Array]:
        """Parameters and whitened rows of axis i, the residual last."""
        v, axis, earth = self.v, "xyz"[i], earth_names(self.segment)
        gain = 1.0 + values.get(f"gyro.scale_error.{axis}", 0.0)
        turn = mount(v.rig.mount_yaw, v.rig.mount_pitch)
        c, s = np.cos(self.rolled), np.sin(self.rolled)
        d_p, d_q = turn[i, 1] * c - turn[i, 2] * s, turn[i, 1] * s + turn[i, 2] * c
        rates = unit_rates(self.roll_rate, v.spin, self.angle, v.rig)[:, i]
        felt = rates + values.get(earth[0], 0.0) * d_p + values.get(earth[1], 0.0) * d_q
        slope = unit_rate_derivatives(self.roll_rate, v.spin, self.angle, v.rig)[:, i]
        d_rate = slope[3] * self.d_angle + slope[5] * self.d_roll_rate
        d_rate[[_YAW, _PITCH, _HALF, _PHASE, _SPIN]] += slope[:5]
        one = np.ones(gyro.size)
        bias, drift = f"gyro.bias.{axis}", drift_name(axis, self.segment)
        residual = gyro - gain * felt - values.get(bias, 0.0) - values.get(drift, 0.0)
        rows = np.vstack([-gain * d_rate, -np.stack([one, one, felt, gain * d_p, gain * d_q]), residual]) / sigma
        return (*_common(self.segment), bias, drift, f"gyro.scale_error.{axis}", *earth), rows
