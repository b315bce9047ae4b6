"""Position as direction cosines: the wander frame, with no singular place on the Earth.

The wander frame w has z up and x at the wander angle al from east, counter-clockwise: ``x_w = E cos al + N sin al``.
C_e_w takes Earth-fixed coordinates to w and holds latitude, longitude and wander angle; they are singular at the poles, and only
they.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..earth import ELLIPSOID
from ..frames import Array, rot_z


def direction_cosines(latitude: ArrayLike, longitude: ArrayLike, wander: ArrayLike = 0.0) -> Array:
    """C_e_w of places and wander angles.

    Parameters
    ----------
    latitude, longitude, wander : array_like, shape (...), rad
        A wander angle of zero gives east, north, up.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    lat, lon, al = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (latitude, longitude, wander)))
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=-1)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    north = np.cross(up, east)
    return np.asarray(rot_z(-al) @ np.stack([east, north, up], axis=-2))


def place(C_e_w: Array) -> tuple[Array, Array, Array]:
    """Latitude, longitude and wander angle, the inverse of :func:`direction_cosines`.

    Parameters
    ----------
    C_e_w : ndarray, shape (..., 3, 3)

    Returns
    -------
    latitude, longitude, wander : ndarray, shape (...), rad
        Longitude and wander angle from -pi to pi; at a pole itself only their sum or difference means something.
    """
    latitude = np.arctan2(C_e_w[..., 2, 2], np.hypot(C_e_w[..., 0, 2], C_e_w[..., 1, 2]))
    longitude = np.arctan2(C_e_w[..., 2, 1], C_e_w[..., 2, 0])
    return latitude, longitude, np.arctan2(C_e_w[..., 0, 2], C_e_w[..., 1, 2])


def to_enu(wander: ArrayLike) -> Array:
    """C_w_n: takes coordinates in w to east, north, up.

    Parameters
    ----------
    wander : array_like, shape (...), rad

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    return rot_z(wander)


def curvature(C_e_w: Array, height: ArrayLike) -> tuple[Array, Array]:
    """Curvature of the Earth in w, without angles and therefore without singular places.

    The curvature is ``K = k1 I + k2 p p'`` with p the first two components of the Earth's axis in w: ``1/(R_M + h)`` along north,
    ``1/(R_N + h)`` along east, because ``R_N - R_M`` is proportional to ``cos^2 L = p'p``. The rate of w over the Earth is
    ``w_ew = (-(K v)_y, (K v)_x, 0)``.

    Parameters
    ----------
    C_e_w : ndarray, shape (..., 3, 3)
    height : array_like, shape (...), m

    Returns
    -------
    k1, k2 : ndarray, shape (...), 1/m
    """
    a, e2 = ELLIPSOID[:2]
    w2 = 1.0 - e2 * C_e_w[..., 2, 2] ** 2
    normal = a / np.sqrt(w2)
    meridian = normal * (1.0 - e2) / w2
    k1 = 1.0 / (normal + height)
    return np.asarray(k1), np.asarray(k1 * e2 * normal / w2 / (meridian + height))


def transport_rate(C_e_w: Array, velocity: Array, height: ArrayLike) -> Array:
    """Rate of the wander frame over the Earth, in w.

    Parameters
    ----------
    C_e_w : ndarray, shape (..., 3, 3)
    velocity : ndarray, shape (..., 3), m/s
        In w.
    height : array_like, shape (...), m

    Returns
    -------
    ndarray, shape (..., 3), rad/s
    """
    k1, k2 = curvature(C_e_w, height)
    p0, p1 = C_e_w[..., 0, 2], C_e_w[..., 1, 2]
    along = k2 * (p0 * velocity[..., 0] + p1 * velocity[..., 1])
    x = k1 * velocity[..., 0] + along * p0
    y = k1 * velocity[..., 1] + along * p1
    return np.stack([-y, x, np.zeros_like(x)], axis=-1)
