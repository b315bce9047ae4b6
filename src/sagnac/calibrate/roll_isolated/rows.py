"""Rows of a roll-isolated rig: names of the parameters, and the inner stage.

With f the roll rate of the inner cylinder, a sample of the gyros is ::

    y = (1 + s) o (C_1^2 [f, w sin a cos(e + e0), w sin a sin(e + e0)] + Earth rate) + b + n

In the inner stage the carrier stands, w = 0, and f is the table's rate. The spin stage is in :mod:`.spin`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ...frames import Array
from ...observe.rolling import Window
from ...plan import Segment
from ...rigs.roll_isolated import MOUNT_PITCH, MOUNT_YAW, mount, mount_derivatives


def spin_name(segment: Segment) -> str:
    """Parameter of a segment's spin rate, rad/s."""
    return f"rig.spin_rate.{segment.name}"


def drift_name(axis: str, segment: Segment) -> str:
    """Parameter of what a gyro's bias is off in one segment, rad/s."""
    return f"gyro.drift.{axis}.{segment.name}"


def earth_names(segment: Segment) -> tuple[str, str]:
    """Parameters of the Earth rate across the roll axis at the start of a segment, rad/s."""
    return f"rig.earth.y.{segment.name}", f"rig.earth.z.{segment.name}"


EARTH_ALONG = "rig.earth.x"
"""Earth rate along the axis of the inner stage, rad/s: like a bias of gyro x."""
RATE_ERROR = "rig.rate_error"
COAXIAL = ("rig.coaxial.y", "rig.coaxial.z")
"""Direction of the inner stage's rate axis in the cylinder, rad."""


@dataclass(frozen=True)
class Noise:
    """What the rows are whitened with.

    Attributes
    ----------
    gyro : ndarray, shape (3,), rad/s/sqrt(Hz)
    encoder : float, rad^2
        Variance of a reading.
    """

    gyro: Array
    encoder: float


Channel = tuple[tuple[str, ...], Array]
"""Parameters of the columns, and whitened rows (k + 1, n), derivatives first and the residual last."""


@dataclass(frozen=True)
class Piece:
    """Whitened rows of one window.

    Attributes
    ----------
    segment : int
    time : ndarray, shape (n,), s
    channels : dict
        ``x``, ``y``, ``z`` of the inner stage, ``encoder``, ``y``, ``z`` of the spin stage.
    roll_rate, angle : ndarray, shape (n,), rad/s and rad, or None
        f (smoothed) and e at the samples' time, of the spin stage.
    sigma : ndarray, shape (2,), rad/s
        What y and z of the spin stage were divided by.
    """

    segment: int
    time: Array
    channels: dict[str, Channel]
    roll_rate: Array | None = None
    angle: Array | None = None
    sigma: Array = field(default_factory=lambda: np.ones(2))


def inner_rows(
    w: Window, segment: Segment, origin: float, values: Mapping[str, float], noise: Noise, interval: float
) -> dict[str, Channel]:
    """Rows of the three gyros while the inner cylinder turns alone.

    Parameters
    ----------
    w : Window
    segment : Segment
    origin : float, s
        Time of the segment's first sample.
    values : mapping of str to float
        Parameters by name; what is not there is zero.
    noise : Noise
    interval : float, s
    """
    time, gyro = w.time[w.centre] - origin, w.gyro[w.centre]
    yaw, pitch = values.get(MOUNT_YAW, 0.0), values.get(MOUNT_PITCH, 0.0)
    along, earth = values.get(EARTH_ALONG, 0.0), earth_names(segment)
    rate = segment.inner_rate * (1.0 + values.get(RATE_ERROR, 0.0))
    tilt = np.array([1.0, *(values.get(n, 0.0) for n in COAXIAL)])
    turn, d_turn = mount(yaw, pitch), mount_derivatives(yaw, pitch)
    c, s = np.cos(rate * time), np.sin(rate * time)
    p, q = (values.get(n, 0.0) for n in earth)
    w1 = np.stack([np.full(time.size, rate + along), rate * tilt[1] + p * c + q * s, rate * tilt[2] - p * s + q * c])
    out = {}
    for i, axis in enumerate("xyz"):
        gain = 1.0 + values.get(f"gyro.scale_error.{axis}", 0.0)
        rates = turn[i] @ w1
        bias = values.get(f"gyro.bias.{axis}", 0.0) + values.get(drift_name(axis, segment), 0.0)
        sigma = float(noise.gyro[i]) / math.sqrt(interval)
        one = np.ones(time.size)
        columns = {
            f"gyro.bias.{axis}": one,
            drift_name(axis, segment): one,
            f"gyro.scale_error.{axis}": rates,
            MOUNT_YAW: gain * (d_turn[0, i] @ w1),
            MOUNT_PITCH: gain * (d_turn[1, i] @ w1),
            RATE_ERROR: gain * segment.inner_rate * float(turn[i] @ tilt) * one,
            EARTH_ALONG: gain * turn[i, 0] * one,
            COAXIAL[0]: gain * rate * turn[i, 1] * one,
            COAXIAL[1]: gain * rate * turn[i, 2] * one,
            earth[0]: gain * (turn[i, 1] * c - turn[i, 2] * s),
            earth[1]: gain * (turn[i, 1] * s + turn[i, 2] * c),
        }
        residual = gyro[:, i] - gain * rates - bias
        out[axis] = tuple(columns), np.vstack([*(-v for v in columns.values()), residual]) / sigma
    return out
