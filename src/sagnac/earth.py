"""WGS-84: shape, normal gravity and Earth rate."""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from .frames import Array

EARTH_RATE = 7.292115e-5
"""rad/s, WGS-84 (NIMA TR8350.2, table 3.1)."""
STANDARD_GRAVITY = 9.80665
"""m/s^2, the unit g (CGPM 1901)."""

# NIMA TR8350.2, tables 3.1 to 3.4
_SEMI_MAJOR = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_GRAVITY_EQUATOR = 9.7803253359
_SOMIGLIANA_K = 0.00193185265241
_ECCENTRICITY2 = _FLATTENING * (2.0 - _FLATTENING)
_CENTRIFUGAL_M = 0.00344978650684


@overload
def normal_gravity(latitude: float, height: float = ...) -> float: ...
@overload
def normal_gravity(latitude: Array, height: ArrayLike = ...) -> Array: ...
def normal_gravity(latitude: float | Array, height: ArrayLike = 0.0) -> float | Array:
    """Normal gravity of the WGS-84 ellipsoid.

    Parameters
    ----------
    latitude : float or ndarray, shape (...), rad
        Geodetic latitude.
    height : float or array_like, shape (...), m
        Height above the ellipsoid.

    Returns
    -------
    float or ndarray, shape (...), m/s^2

    Notes
    -----
    Somigliana's closed formula, then the second-order height term (NIMA TR8350.2, equations 4-1 and 4-3). The real
    gravity of a site differs by some 30 mGal (3e-5 of g, one sigma): give the measured value where you have it.
    """
    g = gravity_by_sine(np.sin(latitude), height)
    return g if g.ndim else float(g)


def gravity_by_sine(sine: ArrayLike, height: ArrayLike) -> Array:
    """The same from the sine of the latitude, for places that are known by direction cosines."""
    s2, ratio = np.square(sine), np.asarray(height, dtype=float) / _SEMI_MAJOR
    surface = _GRAVITY_EQUATOR * (1.0 + _SOMIGLIANA_K * s2) / np.sqrt(1.0 - _ECCENTRICITY2 * s2)
    first = 2.0 * (1.0 + _FLATTENING + _CENTRIFUGAL_M - 2.0 * _FLATTENING * s2) * ratio
    return np.asarray(surface * (1.0 - first + 3.0 * ratio**2))


def gravity_excess(gravity: float | None, latitude: float, height: float) -> float:
    """Real gravity less the normal one, m/s^2.

    Parameters
    ----------
    gravity : float or None, m/s^2
        As it was measured there; None: it is the normal one.
    latitude : float, rad
    height : float, m
    """
    return 0.0 if gravity is None else gravity - normal_gravity(latitude, height)


ELLIPSOID = np.array(
    [
        _SEMI_MAJOR,
        _ECCENTRICITY2,
        _GRAVITY_EQUATOR,
        _SOMIGLIANA_K,
        2.0 * (1.0 + _FLATTENING + _CENTRIFUGAL_M),
        4.0 * _FLATTENING,
    ]
)
"""What the kernels take: a [m], e^2, g at the equator [m/s^2], Somigliana's k, and the two coefficients p, q of the height term
``g(h) = g(0) (1 - (p - q sin^2 L) h / a + 3 (h / a)^2)``."""


def radii(latitude: ArrayLike) -> tuple[Array, Array]:
    """Radii of curvature of the ellipsoid.

    Parameters
    ----------
    latitude : array_like, rad

    Returns
    -------
    meridian, normal : ndarray, m
        R_M, in the meridian, and R_N, of the prime vertical.
    """
    w2 = 1.0 - _ECCENTRICITY2 * np.sin(latitude) ** 2
    normal = _SEMI_MAJOR / np.sqrt(w2)
    return normal * (1.0 - _ECCENTRICITY2) / w2, np.asarray(normal)


def earth_rate_enu(latitude: float, rate: float = EARTH_RATE) -> Array:
    """Earth rate in east, north, up.

    Parameters
    ----------
    latitude : float, rad
    rate : float, rad/s

    Returns
    -------
    ndarray, shape (3,), rad/s
    """
    return np.array([0.0, rate * np.cos(latitude), rate * np.sin(latitude)])
