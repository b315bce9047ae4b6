"""Three-axis turntable: Earth rate, gravity and table rate in the case frame k.

The attitude of the case::

    C_k^n = Rx(tilt_x) Ry(tilt_y) Rz(outer) Ry(n_1) Rx(middle) Rz(n_2) Ry(inner)

with n east, north, up, the tilt of the outer axis from the vertical, and n_1, n_2 the non-perpendicularity of middle
to outer and of inner to middle axis ([DONG18], section 2, with the rig's errors written out). Each angle is the
setting plus the axis's zero error plus the error of that setting.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..earth import earth_rate_enu
from ..frames import Array, rot_x, rot_y, rot_z


@dataclass(frozen=True)
class TableErrors:
    """Errors of the rig, rad.

    Attributes
    ----------
    tilt : tuple of float
        Of the outer axis, about east and about north.
    nonperpendicularity : tuple of float
        Middle to outer, inner to middle.
    zero : tuple of float
        Of outer, middle and inner scale.
    """

    tilt: tuple[float, float] = (0.0, 0.0)
    nonperpendicularity: tuple[float, float] = (0.0, 0.0)
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0)


PERFECT = TableErrors()


@dataclass(frozen=True)
class Site:
    """Where the rig stands.

    Attributes
    ----------
    latitude : float, rad
    gravity : float, m/s^2
    earth_rate : float, rad/s
    """

    latitude: float
    gravity: float
    earth_rate: float
    enu: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Keep the Earth rate in east, north, up beside its size."""
        object.__setattr__(self, "enu", earth_rate_enu(self.latitude, self.earth_rate))


def attitude(angles: Array, errors: TableErrors = PERFECT) -> Array:
    """C_k^n for settings of the table.

    Parameters
    ----------
    angles : ndarray, shape (..., 3), rad
        Outer, middle, inner.
    errors : TableErrors

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    outer, middle, inner = np.moveaxis(angles + np.array(errors.zero), -1, 0)
    base = rot_x(errors.tilt[0]) @ rot_y(errors.tilt[1])
    first, second = errors.nonperpendicularity
    return np.asarray(base @ rot_z(outer) @ rot_y(first) @ rot_x(middle) @ rot_z(second) @ rot_y(inner))


def rate(angles: Array, rates: Array, errors: TableErrors = PERFECT) -> Array:
    """Rotation of the case against the Earth, in k.

    Parameters
    ----------
    angles, rates : ndarray, shape (..., 3), rad and rad/s
        Outer, middle, inner.
    errors : TableErrors

    Returns
    -------
    ndarray, shape (..., 3), rad/s
    """
    _, middle, inner = np.moveaxis(angles + np.array(errors.zero), -1, 0)
    first, second = errors.nonperpendicularity
    inner_turn = rot_z(second) @ rot_y(inner)
    middle_turn = rot_y(first) @ rot_x(middle) @ inner_turn
    return np.asarray(
        rates[..., 0, None] * middle_turn[..., 2, :]
        + rates[..., 1, None] * inner_turn[..., 0, :]
        + rates[..., 2, None] * np.array([0.0, 1.0, 0.0])
    )


def inputs(angles: Array, rates: Array, site: Site, errors: TableErrors = PERFECT) -> tuple[Array, Array]:
    """Specific force and angular rate of the case, in k, for angles and rates at the same instants.

    Parameters
    ----------
    angles, rates : ndarray, shape (n, 3), rad and rad/s
    site : Site
    errors : TableErrors

    Returns
    -------
    specific_force, angular_rate : ndarray, shape (n, 3), m/s^2 and rad/s
    """
    to_enu = attitude(angles, errors)
    force = site.gravity * to_enu[..., 2, :]
    return force, np.einsum("...ji,j->...i", to_enu, site.enu) + rate(angles, rates, errors)


def averaging(turned: Array, count: Array) -> Array:
    """What is left of a turning vector after averaging over evenly spaced samples (Dirichlet kernel).

    Parameters
    ----------
    turned : ndarray
        Angle from one sample to the next, rad.
    count : ndarray of int
        Number of samples; one sample is left as it is, a whole turn leaves nothing.

    Returns
    -------
    ndarray
        Factor on the vector at mid time.
    """
    half = np.asarray(turned, dtype=float) / 2.0
    n = np.asarray(count, dtype=float)
    small = np.abs(np.sin(half)) < 1e-9
    safe = np.where(small, 1.0, np.sin(half))
    # whole turns from sample to sample look like standing still, or like alternating
    return np.where(small, np.cos(n * half) / np.cos(half), np.sin(n * half) / (n * safe))


def mean_inputs(angles: Array, outer_rate: Array, turned: Array, count: Array, site: Site) -> tuple[Array, Array]:
    """Mean inputs of segments whose outer axis turns steadily, on a perfect table.

    Parameters
    ----------
    angles : ndarray, shape (n, 3), rad
        At the middle of each segment.
    outer_rate : ndarray, shape (n,), rad/s
    turned : ndarray, shape (n,), rad
        Angle from one sample to the next.
    count : ndarray of int, shape (n,)
    site : Site

    Returns
    -------
    specific_force, angular_rate : ndarray, shape (n, 3), in k
    """
    to_enu = attitude(angles)
    up = to_enu[:, 2, :]
    level = np.einsum("nji,j->ni", to_enu, np.array([0.0, site.enu[1], 0.0]))
    left = averaging(turned, count)
    return site.gravity * up, (outer_rate + site.enu[2])[:, None] * up + left[:, None] * level
