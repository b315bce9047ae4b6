"""Roll-isolated rig: an inner cylinder that turns freely about the axis of a spinning carrier, and the encoder between them.

Frames: carrier 0 (x forward is the spin axis, y up, z right), inner cylinder 1, unit 2. Coordinates change by ::

    C_1^2 = Rz(pitch) Ry(yaw)   passive:  Rz = [[c, s, 0], [-s, c, 0], [0, 0, 1]],  Ry = [[c, 0, -s], [0, 1, 0], [s, 0, c]]
    C_0^1 = rot_x(e) T          active,   T takes x to [cos a, sin a cos e0, sin a sin e0] the short way round

with e the roll of the carrier against the inner cylinder, a the half-angle of the cone between spin axis and cylinder and e0
its phase. A carrier that spins at w makes the inner cylinder turn at ([ZHANG15]) ::

    w1 = [w cos a - de/dt, w sin a cos(e + e0), w sin a sin(e + e0)]

whose first component, the roll rate, is what isolation leaves. The encoder shows ::

    reading(t) = E(e(t + delay)),   E(e) = e + cos1 cos e + sin1 sin e + cos2 cos 2e + sin2 sin 2e

rounded to its step. Functions take complex numbers as well, so that their derivatives can be checked to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..frames import Array

MOUNT_YAW, MOUNT_PITCH = "rig.mount_yaw", "rig.mount_pitch"
HALF_ANGLE, PHASE = "rig.cone_half_angle", "rig.cone_phase"
DELAY = "rig.encoder_delay"
ECCENTRICITY = tuple(f"rig.encoder_eccentricity.{k}" for k in ("cos1", "sin1", "cos2", "sin2"))
_NEWTON = 6  # steps of true_angle: quadratic from an eccentricity of at most some degrees


@dataclass(frozen=True)
class RollRig:
    """Errors of one rig.

    Attributes
    ----------
    mount_yaw, mount_pitch : float, rad
        Of the unit in the inner cylinder.
    half_angle, phase : float, rad
        Of the cone between spin axis and inner cylinder; the phase is counted from the encoder's zero.
    delay : float, s
        How much later than the samples' time the encoder is read.
    eccentricity : tuple of four floats, rad
        cos1, sin1, cos2, sin2 of the encoder.
    """

    mount_yaw: float = 0.0
    mount_pitch: float = 0.0
    half_angle: float = 0.0
    phase: float = 0.0
    delay: float = 0.0
    eccentricity: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, values: Mapping[str, float]) -> RollRig:
        """The rig of named parameters (SI); what is not named is zero."""
        c1, s1, c2, s2 = (values.get(n, 0.0) for n in ECCENTRICITY)
        yaw, pitch, half, phase, delay = (
            values.get(n, 0.0) for n in (MOUNT_YAW, MOUNT_PITCH, HALF_ANGLE, PHASE, DELAY)
        )
        return cls(yaw, pitch, half, phase, delay, (c1, s1, c2, s2))


def mount(yaw: float, pitch: float) -> Array:
    """C_1^2, inner cylinder to unit, shape (3, 3)."""
    cp, sp, cy, sy = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array([[cp * cy, sp, -cp * sy], [-sp * cy, cp, sp * sy], [sy, 0.0 * sy, cy]])


def mount_derivatives(yaw: float, pitch: float) -> Array:
    """Derivatives of :func:`mount` to yaw and pitch, shape (2, 3, 3)."""
    cp, sp, cy, sy = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [[-cp * sy, 0.0, -cp * cy], [sp * sy, 0.0, sp * cy], [cy, 0.0, -sy]],
            [[-sp * cy, cp, sp * sy], [-cp * cy, -sp, cp * sy], [0.0, 0.0, 0.0]],
        ]
    )


def inner_rates(roll_rate: Array, spin: Array | float, angle: Array, rig: RollRig) -> Array:
    """Rates of the inner cylinder, w1.

    Parameters
    ----------
    roll_rate : ndarray, shape (n,), rad/s
        About its own axis, ``w cos a - de/dt``.
    spin : float or ndarray, shape (n,), rad/s
        w, of the carrier.
    angle : ndarray, shape (n,), rad
        e.
    rig : RollRig

    Returns
    -------
    ndarray, shape (n, 3), rad/s
        In frame 1. [ZHANG15], see the module.
    """
    across = spin * np.sin(rig.half_angle)
    return np.stack([roll_rate, across * np.cos(angle + rig.phase), across * np.sin(angle + rig.phase)], axis=-1)


def unit_rates(roll_rate: Array, spin: Array | float, angle: Array, rig: RollRig) -> Array:
    """Rates of the unit, w2 = C_1^2 w1; arguments as for :func:`inner_rates`, shape (n, 3), rad/s."""
    return np.asarray(
        np.einsum("ij,nj->ni", mount(rig.mount_yaw, rig.mount_pitch), inner_rates(roll_rate, spin, angle, rig))
    )


RATE_ARGUMENTS = ("mount_yaw", "mount_pitch", "half_angle", "angle", "spin", "roll_rate")
"""What :func:`unit_rate_derivatives` differentiates to; the derivative to the phase is that to the angle."""


def unit_rate_derivatives(roll_rate: Array, spin: float, angle: Array, rig: RollRig) -> Array:
    """Derivatives of :func:`unit_rates`.

    Returns
    -------
    ndarray, shape (6, 3, n)
        To :data:`RATE_ARGUMENTS`, component by component.
    """
    turn, d_turn = mount(rig.mount_yaw, rig.mount_pitch), mount_derivatives(rig.mount_yaw, rig.mount_pitch)
    cos, sin = np.cos(angle + rig.phase), np.sin(angle + rig.phase)
    ca, sa = np.cos(rig.half_angle), np.sin(rig.half_angle)
    w1 = np.stack([roll_rate, spin * sa * cos, spin * sa * sin])
    out = np.empty((6, 3, angle.size), dtype=w1.dtype)
    out[0], out[1] = np.einsum("ij,jn->in", d_turn[0], w1), np.einsum("ij,jn->in", d_turn[1], w1)
    for k, (along_y, along_z) in enumerate(
        ((spin * ca * cos, spin * ca * sin), (-spin * sa * sin, spin * sa * cos), (sa * cos, sa * sin)), start=2
    ):
        for i in range(3):
            out[k, i] = turn[i, 1] * along_y + turn[i, 2] * along_z
    out[5] = turn[:, 0, None]
    return out


def eccentric_basis(angle: Array) -> Array:
    """Columns of the eccentricity: cos e, sin e, cos 2e, sin 2e, shape (4, n)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c, s, c * c - s * s, 2.0 * s * c])


def eccentric_slope(angle: Array, eccentricity: tuple[float, float, float, float]) -> Array:
    """dE/de - 1: relative error of the rate that the encoder shows, shape (n,)."""
    c1, s1, c2, s2 = eccentricity
    c, s, c_2, s_2 = eccentric_basis(angle)
    return np.asarray(s1 * c - c1 * s + 2.0 * (s2 * c_2 - c2 * s_2))


def encoder_reading(angle: Array, rig: RollRig, resolution: float = 0.0) -> Array:
    """What the encoder shows, in rad, not wrapped.

    Parameters
    ----------
    angle : ndarray, shape (n,), rad
        e at the time of reading, that is ``e(t + delay)`` for the sample of time t.
    rig : RollRig
    resolution : float, rad
        Step; zero for none.
    """
    shown = angle + np.tensordot(np.array(rig.eccentricity), eccentric_basis(angle), 1)
    return np.asarray(np.round(shown / resolution) * resolution if resolution else shown)


def true_angle(reading: Array, eccentricity: tuple[float, float, float, float]) -> Array:
    """Angle that the encoder shows as this reading: E inverted by Newton's method, shape (n,), rad."""
    if not any(eccentricity):
        return reading
    weights = np.array(eccentricity)
    angle = reading
    for _ in range(_NEWTON):
        missed = angle + np.tensordot(weights, eccentric_basis(angle), 1) - reading
        angle = angle - missed / (1.0 + eccentric_slope(angle, eccentricity))
        if np.max(np.abs(missed), initial=0.0) < 1e-9:  # the step just taken left its square
            break
    return np.asarray(angle)


def without_cone(rates: Array, angle: Array, angle_rate: Array, rig: RollRig) -> tuple[Array, Array]:
    """Rates of the inner cylinder laid onto the spin axis, and the carrier's spin.

    The carrier turns at ``w1 + e' x`` in frame 1. Turned by -a across the phase of the cone its x axis is the carrier's own;
    what then rolls back by e is the inner cylinder without the cone. Exact for any motion of the carrier; for one that only
    spins it is ``w1`` less the cone rates ``w [cos a - 1, sin a cos(e + e0), sin a sin(e + e0)]``.

    Parameters
    ----------
    rates : ndarray, shape (n, 3), rad/s
        w1.
    angle, angle_rate : ndarray, shape (n,), rad and rad/s
        e and de/dt.
    rig : RollRig

    Returns
    -------
    rates : ndarray, shape (n, 3), rad/s
    spin : ndarray, shape (n,), rad/s
    """
    x, y, z = rates[:, 0] + angle_rate, rates[:, 1], rates[:, 2]
    ky, kz = -np.sin(angle + rig.phase), np.cos(angle + rig.phase)
    c, s = np.cos(rig.half_angle), np.sin(rig.half_angle)
    along = (1.0 - c) * (ky * y + kz * z)  # Rodrigues, about the axis [0, ky, kz] across the phase
    spin = c * x - s * (ky * z - kz * y)
    return np.stack(
        [spin - angle_rate, c * y - s * kz * x + along * ky, c * z + s * ky * x + along * kz], axis=-1
    ), spin
