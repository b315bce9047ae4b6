"""A unit on a vehicle: lever arm, mounting and flexure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...earth import ELLIPSOID
from ...frames import Array, cross, left_jacobian, rotation_matrix, transform
from .. import wander

_ROUNDS = 3  # Newton's steps for a point beside a known one: from 1 km, 0.1 m, then 1e-6 m, then rounding
MARKOV_2 = 2.146
"""Of a second-order Gauss-Markov process, such as a flexure: its rate is this over the correlation time (Gelb, *Applied Optimal
Estimation*, 1974, table 2.2-1)."""


@dataclass(frozen=True)
class Flexure:
    """How the unit's foot turns against the vehicle.

    Attributes
    ----------
    angle : callable
        Takes times (n,), s, to rotation vectors (n, 3), rad, in the vehicle's axes, and their rates (n, 3), rad/s.
    scale : float, s
        Within a tenth of it, between two breaks, the function is as good as a low polynomial: of a sine, the period.
    breaks : ndarray, shape (m,), s
        Where it is not smooth, as the knots of a spline.
    """

    angle: Callable[[Array], tuple[Array, Array]]
    scale: float
    breaks: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Carried:
    """Where on a vehicle a unit sits.

    Attributes
    ----------
    lever_arm : ndarray, shape (3,), m
        From the vehicle's own point (the master) to the unit, in the vehicle's axes.
    mounting : ndarray, shape (3, 3)
        C_s_m: takes coordinates of the unit to those of the vehicle.
    flexure : Flexure or None
        ``C_s_m(t) = exp([flexure x]) mounting``.
    """

    lever_arm: Array = field(default_factory=lambda: np.zeros(3))
    mounting: Array = field(default_factory=lambda: np.eye(3))
    flexure: Flexure | None = None

    @property
    def aside(self) -> bool:
        """Whether it is off the vehicle's own point."""
        return bool(np.any(self.lever_arm))

    @property
    def turned(self) -> bool:
        """Whether its axes are not those of the vehicle."""
        return self.flexure is not None or not np.array_equal(self.mounting, np.eye(3))

    def attitude(self, time: Array) -> Array:
        """C_s_m at times (n,), (n, 3, 3)."""
        if self.flexure is None:
            return np.broadcast_to(self.mounting, (time.size, 3, 3))
        return np.asarray(rotation_matrix(self.flexure.angle(time)[0]) @ self.mounting)

    def rate(self, time: Array) -> Array | float:
        """Rate against the vehicle at times (n,), in the vehicle's axes, (n, 3), rad/s."""
        if self.flexure is None:
            return 0.0
        angle, rate = self.flexure.angle(time)
        return transform(left_jacobian(angle), rate)


RIGID = Carried()
"""The vehicle itself."""


def beside(C_e_w: Array, height: Array, offset: Array) -> tuple[Array, Array]:
    """Wander frame and height of points beside others.

    Parameters
    ----------
    C_e_w : ndarray, shape (n, 3, 3)
    height : ndarray, shape (n,), m
    offset : ndarray, shape (n, 3), m
        From the known points to the others, in w.

    Returns
    -------
    turned : ndarray, shape (n, 3, 3)
        Takes coordinates in the w of the known points to those of the others, whose direction cosines are ``turned @ C_e_w``:
        w is carried over by the shortest way.
    height : ndarray, shape (n,), m
    """
    there = _centre(C_e_w[:, :, 2], height) + offset
    turned, above = np.broadcast_to(np.eye(3), C_e_w.shape), height
    for _ in range(_ROUNDS):
        cosines = turned @ C_e_w
        axis = cosines[:, :, 2]
        missing = transform(turned, there) - _centre(axis, above)
        k1, k2 = wander.curvature(cosines, above)
        along = k2 * (axis[:, 0] * missing[:, 0] + axis[:, 1] * missing[:, 1])
        x, y = k1 * missing[:, 0] + along * axis[:, 0], k1 * missing[:, 1] + along * axis[:, 1]
        turned = rotation_matrix(np.stack([y, -x, np.zeros_like(x)], axis=-1)) @ turned
        above = above + missing[:, 2]
    return turned, above


def _centre(axis: Array, height: Array) -> Array:
    """From the Earth's centre to places, in their w, given the Earth's axis in w, (n, 3), m."""
    a, e2 = ELLIPSOID[:2]
    normal = a / np.sqrt(1.0 - e2 * axis[:, 2] ** 2)
    out = -(e2 * normal * axis[:, 2])[:, None] * axis
    out[:, 2] += normal + height
    return np.asarray(out)


def swung(arm: Array, earth: Array, rate: Array, slope: Array) -> Array:
    """Acceleration of a point at the end of an arm against the arm's foot, seen from the Earth with its Coriolis acceleration.

    Parameters
    ----------
    arm : ndarray, shape (3,), m
        In b.
    earth, rate, slope : ndarray, shape (n, 3)
        Earth rate, rate of b over the Earth, and the derivative of that, in b.

    Returns
    -------
    ndarray, shape (n, 3), m/s^2
        ``slope x l + (w_eb + 2 w_ie) x (w_eb x l)``.
    """
    return cross(slope, arm) + cross(rate + 2.0 * earth, cross(rate, arm))
