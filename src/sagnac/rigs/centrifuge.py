"""Centrifuge: specific force and angular rate of a unit on a turning arm, as Fourier series in the arm's angle.

The arm of radius r turns at the rate w (signed, counter-clockwise from above) about an axis that points up but for a small
tilt. The base frame r has its z along that axis and, without tilt, its x to the east and y to the north; the arm's angle th
counts from x. With C the rotation from east, north, up to r, W the Earth rate and u up, both in r::

    W = C W_enu,   u = C [0, 0, 1],   A = w^2 r,   A1 = 2 w r W_z

Unit on a counter-rotating platform, which keeps its direction ([XU18], in m/s^2 and without truncation)::

    f = g u - (A + A1) [cos th, sin th, 0] + 2 w r [0, 0, W_x cos th + W_y sin th]
    rate = W

Unit fixed to the arm (IEEE Std 836): the same vectors in axes that turn with it (x outward, y ahead, z along the axis), and
the arm's own rate on z. In both cases the gimbals take base (or arm) coordinates to the unit's::

    C_r^p = Ry(gamma) Rz(beta) Rx(alpha),   passive rotations

Left out: W x (W x r) (5e-9 of A at 1 rad/s) and the change of the plumb line along the arm (g/R in place of w^2, 1.5e-6 of A at
1 rad/s); both act as a change of the radius.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..frames import Array, cross, rot_x, rot_y, rot_z, skew
from .turntable import Site

EFFECTS = ("radius", "tilt_x", "tilt_y", "gravity", "arm_rate", "alpha", "beta", "gamma")
"""What the derivatives of :class:`Series` are to, in their order."""
_X, _Y, _Z = np.eye(3)
_RADIUS, _TILT, _GRAVITY, _ARM_RATE, _GIMBALS = 0, slice(1, 3), 3, 4, slice(5, 8)


@dataclass(frozen=True)
class Arm:
    """The arm.

    Attributes
    ----------
    radius : float, m
        From the axis to the unit.
    counter_rotating : bool
        Whether the platform keeps its direction; otherwise the unit turns with the arm.
    tilt : tuple of float, rad
        Of the arm's axis, about east and about north. The platform's axis is parallel to it.
    """

    radius: float
    counter_rotating: bool = True
    tilt: tuple[float, float] = (0.0, 0.0)


class Series(NamedTuple):
    """Inputs of n segments in p as Fourier series in th.

    The third index is that of the components, the last but one that of the series: mean, cosine, sine.
    """

    force: Array
    """(n, 3, 3), m/s^2."""
    rate: Array
    """(n, 3, 3), rad/s."""
    to_force: Array
    """(n, 3, 3, 8): derivatives to :data:`EFFECTS`, SI."""
    to_rate: Array
    """(n, 3, 3, 8)."""


def gimbals(angles: ArrayLike) -> Array:
    """C_r^p of gimbal settings.

    Parameters
    ----------
    angles : array_like, shape (..., 3), rad
        alpha, beta, gamma.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    alpha, beta, gamma = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    return np.asarray(np.swapaxes(rot_x(alpha) @ rot_z(beta) @ rot_y(gamma), -1, -2))


def _gimbal_slopes(angles: Array, to_p: Array) -> Array:
    """Derivatives of C_r^p to alpha, beta, gamma, (..., 3, 3, 3), the angle first."""
    last = np.swapaxes(rot_y(angles[..., 2]), -1, -2)
    last_two = last @ np.swapaxes(rot_z(angles[..., 1]), -1, -2)
    # a passive turn by da about an axis e of the frame it starts from: dC = -C [e x]
    return np.stack(
        [
            -to_p @ skew(_X),
            -last_two @ skew(_Z) @ np.swapaxes(last_two, -1, -2) @ to_p,
            -skew(_Y) @ to_p,
        ],
        axis=-3,
    )


def _base(arm: Arm, site: Site) -> tuple[Array, Array, Array, Array]:
    """W (3,) and u (3,) in r, and their derivatives to the two tilts (3, 2)."""
    x, y = (turn(angle).T for turn, angle in zip((rot_x, rot_y), arm.tilt, strict=True))
    to_base = y @ x
    slopes = (-y @ skew(_X) @ x, -skew(_Y) @ to_base)
    return (
        to_base @ site.enu,
        to_base[:, 2],
        np.stack([s @ site.enu for s in slopes], axis=1),
        np.stack([s[:, 2] for s in slopes], axis=1),
    )


class _Base(NamedTuple):
    """Series in base or arm coordinates, (n, 3, 3), and their derivatives to the first five effects, (n, 3, 3, 5)."""

    force: Array
    rate: Array
    to_force: Array
    to_rate: Array


def _turning_with(vector: Array) -> Array:
    """A vector of the base in axes that turn with the arm, as series (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, x, y], [0.0, y, -x], [z, 0.0, 0.0]])


def _standing(vector: Array) -> Array:
    return np.outer(vector, _X)


def _in_base(arm: Arm, site: Site, w: Array) -> _Base:
    earth, up, d_earth, d_up = _base(arm, site)
    n, r, g = len(w), arm.radius, site.gravity
    force, rate = np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    to_force, to_rate = np.zeros((n, 3, 3, 5)), np.zeros((n, 3, 3, 5))
    steady = _standing if arm.counter_rotating else _turning_with
    # where -(A + A1) and 2 w r (W_x, W_y) stand in the series
    places = ((0, 1), (1, 2)) if arm.counter_rotating else ((0, 0),)
    force += g * steady(up)
    rate += steady(earth)
    to_force[..., _GRAVITY] = steady(up)
    for k in range(2):
        to_force[..., _TILT.start + k] = g * steady(d_up[:, k])
        to_rate[..., _TILT.start + k] = steady(d_earth[:, k])
    for i, b in places:
        force[:, i, b] -= r * w * (w + 2.0 * earth[2])
        to_force[:, i, b, _RADIUS] = -w * (w + 2.0 * earth[2])
        to_force[:, i, b, _ARM_RATE] = -2.0 * r * (w + earth[2])
        to_force[:, i, b, _TILT] -= 2.0 * r * w[:, None] * d_earth[2]
    for k in range(2):
        force[:, 2, 1 + k] += 2.0 * r * w * earth[k]
        to_force[:, 2, 1 + k, _RADIUS] = 2.0 * w * earth[k]
        to_force[:, 2, 1 + k, _ARM_RATE] = 2.0 * r * earth[k]
        to_force[:, 2, 1 + k, _TILT] += 2.0 * r * w[:, None] * d_earth[k]
    if not arm.counter_rotating:
        rate[:, 2, 0] += w
        to_rate[:, 2, 0, _ARM_RATE] = 1.0
    return _Base(force, rate, to_force, to_rate)


def series(arm: Arm, site: Site, arm_rate: Array, angles: Array) -> Series:
    """Inputs of segments, each with one arm rate and one setting of the gimbals.

    Parameters
    ----------
    arm : Arm
    site : sagnac.rigs.turntable.Site
    arm_rate : ndarray, shape (n,), rad/s
        Signed; zero for an arm at rest.
    angles : ndarray, shape (n, 3), rad
        alpha, beta, gamma, with the errors of the settings.

    Returns
    -------
    Series
    """
    base = _in_base(arm, site, arm_rate)
    to_p = gimbals(angles)
    slopes = _gimbal_slopes(angles, to_p)
    to_force, to_rate = np.empty((len(to_p), 3, 3, 8)), np.empty((len(to_p), 3, 3, 8))
    for out, values, derivatives in ((to_force, base.force, base.to_force), (to_rate, base.rate, base.to_rate)):
        out[..., :5] = (to_p @ derivatives.reshape(-1, 3, 15)).reshape(-1, 3, 3, 5)
        out[..., _GIMBALS] = np.moveaxis(slopes @ values[:, None], 1, -1)
    return Series(to_p @ base.force, to_p @ base.rate, to_force, to_rate)


def inputs(
    arm: Arm,
    site: Site,
    angle: Array,
    arm_rate: Array,
    angles: Array,
    *,
    arm_acceleration: ArrayLike = 0.0,
    gimbal_rates: Array | None = None,
) -> tuple[Array, Array]:
    """Specific force and angular rate in p at instants, also while the arm or the gimbals are being moved.

    Parameters
    ----------
    arm : Arm
    site : sagnac.rigs.turntable.Site
    angle, arm_rate : ndarray, shape (n,), rad and rad/s
    angles : ndarray, shape (n, 3), rad
        alpha, beta, gamma.
    arm_acceleration : array_like, shape (n,), rad/s^2
    gimbal_rates : ndarray, shape (n, 3), rad/s, optional

    Returns
    -------
    specific_force, angular_rate : ndarray, shape (n, 3), m/s^2 and rad/s
    """
    earth, up, _, _ = _base(arm, site)
    nothing = np.zeros_like(angle)
    outward = np.stack([np.cos(angle), np.sin(angle), nothing], axis=1)
    ahead = np.stack([-np.sin(angle), np.cos(angle), nothing], axis=1)
    w = arm_rate[:, None]
    force = arm.radius * (np.reshape(arm_acceleration, (-1, 1)) * ahead - w**2 * outward) + site.gravity * up
    force = force + 2.0 * cross(earth[None], arm.radius * w * ahead)
    rate = np.broadcast_to(earth, force.shape)
    if not arm.counter_rotating:
        to_arm = np.stack([outward, ahead, np.broadcast_to(_Z, outward.shape)], axis=1)
        force = np.einsum("nij,nj->ni", to_arm, force)
        rate = np.einsum("nij,nj->ni", to_arm, rate) + w * _Z
    to_p = gimbals(angles)
    force, rate = np.einsum("nij,nj->ni", to_p, force), np.einsum("nij,nj->ni", to_p, rate)
    if gimbal_rates is not None:
        last = np.swapaxes(rot_y(angles[:, 2]), -1, -2)
        about = np.stack([to_p[:, :, 0], last[:, :, 2], np.broadcast_to(_Y, force.shape)], axis=2)
        rate = rate + np.einsum("nij,nj->ni", about, gimbal_rates)
    return force, rate
