r"""First attitudes: from the directions of gravity and of the Earth rate, or from how gravity turns with the Earth.

Errors as everywhere: computed attitude ``(I - [phi x]) C_b_n``, gyro reads ``w + eps``, accelerometer ``f + nab``. With errors
of the means in east, north, up, the attitude of :func:`gyrocompass` is off by (Titterton & Weston, *Strapdown Inertial Navigation
Technology*, 10.3; the signs are those of this package)::

    phi_E = -nab_N / g,   phi_N = nab_E / g,   phi_U = phi_N tan L - eps_E / (w_e cos L)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...earth import EARTH_RATE, earth_rate_enu
from ...errors import DataError, InputError
from ...frames import Array, unit, wahba
from .model import Blocks, upward

_PARALLEL = 1e-3
"""rad: gravity and Earth rate closer together than this (some kilometres from a pole) leave the azimuth open."""


class Coarse(NamedTuple):
    """An attitude and the covariance of its error."""

    C_b_n: Array
    """Takes body coordinates to east, north, up, shape (3, 3)."""
    covariance: Array
    """Of phi, east, north, up, shape (3, 3), rad^2."""


def gyrocompass(
    force: ArrayLike,
    rate: ArrayLike,
    latitude: float,
    *,
    accel_sigma: ArrayLike = 0.0,
    gyro_sigma: ArrayLike = 0.0,
    earth_rate: float = EARTH_RATE,
) -> Coarse:
    """Attitude of a unit at rest from its mean specific force and its mean rate.

    Up is along the specific force, east along rate x force. Exact for a unit at rest with perfect sensors: gravity as it
    is at rest, with the centrifugal part, is vertical, and the Earth's axis has no east component. The size of
    neither matters.

    Parameters
    ----------
    force, rate : array_like, shape (3,), m/s^2 and rad/s
        Means in body axes.
    latitude : float, rad
        For the covariance only.
    accel_sigma, gyro_sigma : array_like, shape () or (3,), m/s^2 and rad/s
        Standard uncertainty of the means: bias and noise together.
    earth_rate : float, rad/s

    Returns
    -------
    Coarse

    Raises
    ------
    InputError
        When the means are no vectors.
    DataError
        When force and rate are parallel: at a pole, or with rates that are not the Earth's.
    """
    f, w = (np.asarray(v, dtype=float) for v in (force, rate))
    if f.shape != (3,) or w.shape != (3,) or not (np.isfinite(f).all() and np.isfinite(w).all()):
        raise InputError(
            f"gyrocompassing needs a mean specific force and a mean rate of three numbers each, not {f} and {w}"
        )
    up = unit(f) if f.any() else f
    east = np.cross(w, up)
    if np.linalg.norm(east) <= _PARALLEL * np.linalg.norm(w):
        raise DataError(
            "the mean rate is along the vertical (or there is none): it shows no north. At a pole there is none to be found"
        )
    C = np.stack([unit(east), np.cross(up, unit(east)), up])
    horizontal = earth_rate * np.cos(latitude)
    size = float(np.linalg.norm(f))
    to_accel = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [np.tan(latitude), 0.0, 0.0]]) / size
    to_gyro = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]) / horizontal
    by_body = [(J @ C) * np.broadcast_to(s, 3) for J, s in ((to_accel, accel_sigma), (to_gyro, gyro_sigma))]
    return Coarse(C, np.asarray(sum(J @ J.T for J in by_body)))


def inertial(blocks: Blocks, latitude: float, *, earth_rate: float = EARTH_RATE) -> Array:
    """Attitude of a unit that sways on its place, from how gravity turns with the Earth in inertial space.

    The integral of the specific force in the frame that the body had at the start is compared with that of gravity in the east,
    north, up of the middle of the time, kept inertially: one rotation takes all vectors of the first kind to those of the second
    (Wahba's problem; Wu, Wu, Hu & Hu 2011, Aerospace Science and Technology 15, 1-17). Sway stays as a bounded velocity against
    integrals that grow.

    Parameters
    ----------
    blocks : Blocks
    latitude : float, rad
    earth_rate : float, rad/s

    Returns
    -------
    ndarray, shape (3, 3)
        C_s_i, see :mod:`sagnac.align.static.model`.
    """
    middle = 0.5 * float(blocks.end[-1])
    _, there, _ = upward(blocks.end, middle, earth_rate_enu(latitude, earth_rate))
    size = np.linalg.norm(blocks.speed[-1]) / np.linalg.norm(there[-1])
    return wahba(blocks.speed, size * there)
