"""The exact quadric start of norm calibration (methods, section 2).

The readings lie on an ellipsoid::

    (N - b)' Q (N - b) = |u|^2,   Q = S^-T S^-1

The nine coefficients of the general quadric are linear in the data; the centre is b, and the lower-triangular S is the
Cholesky factor of Q^-1. [DONG18] drops second-order terms here, which costs 5.9e-6 in its scale factors; nothing is
dropped below.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import DataError
from ..estimate import null_space
from ..frames import Array, unit

FEWEST = 9
_SPREAD = 3e-3
"""Smallest singular value, over the largest, of a usable set: an icosahedron has 0.3, attitudes of a hand 0.1, turns about
one axis only what their errors add (an arcminute: 3e-4)."""
_APART = np.cos(np.radians(2.0))


class Ellipsoid(NamedTuple):
    """Readings of a triad for inputs of known norm.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
        S, lower triangular with a positive diagonal.
    bias : ndarray, shape (3,)
    """

    matrix: Array
    bias: Array


def fit(readings: Array, norms: Array, kind: str) -> Ellipsoid:
    """Ellipsoid through readings of inputs of known norm, exact for noise-free data.

    Parameters
    ----------
    readings : ndarray, shape (n, 3)
    norms : ndarray, shape (n,)
        Norm of each input, SI.
    kind : str
        ``accel`` or ``gyro``, for the message.

    Returns
    -------
    Ellipsoid

    Raises
    ------
    DataError
        With fewer than nine directions, with a spread that leaves a parameter unseen (named), or when the readings do
        not lie on an ellipsoid.
    """
    centre = readings.mean(axis=0)
    size = np.abs(readings - centre).max()
    if not size > 0:
        raise DataError(f"the {kind} readings are the same in all {len(readings)} positions: nothing to calibrate with")
    shape = (readings - centre) / size
    equal = np.ptp(norms) <= 1e-9 * abs(norms[0])
    x, y, z = shape.T
    columns = [x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, -2 * x, -2 * y, -2 * z]
    names = [f"{kind}.scale_error.{a}" for a in "xyz"]
    names += [f"{kind}.misalignment.{p}" for p in ("yx", "zx", "zy")] + [f"{kind}.bias.{a}" for a in "xyz"]
    right = (norms / norms[0]) ** 2
    if not equal:
        columns.append(-np.ones_like(x))
        names.append(f"the {kind} scale")
    design = np.stack(columns, axis=1)
    _refuse_poor(readings, centre, design, names, kind)
    p = np.linalg.lstsq(design, right, rcond=None)[0]
    q_matrix = np.array([[p[0], p[3], p[4]], [p[3], p[1], p[5]], [p[4], p[5], p[2]]])
    if np.linalg.det(q_matrix) == 0:
        raise DataError(f"the {kind} readings do not lie on an ellipsoid")
    bias = np.linalg.solve(q_matrix, p[6:9])
    if equal:  # only the shape is known so far: N'QN - 2q'N = 1 up to a factor
        q_matrix = q_matrix / (1.0 + bias @ q_matrix @ bias)
    values = np.linalg.eigvalsh(q_matrix)
    if not np.all(values > 0) or values[-1] > 1e8 * values[0]:
        raise DataError(
            f"the {kind} readings do not lie on an ellipsoid: an axis is dead or saturated, or a position was not static"
        )
    matrix = np.linalg.cholesky(np.linalg.inv(q_matrix)) * size / abs(norms[0])
    return Ellipsoid(matrix, centre + size * bias)


def _refuse_poor(readings: Array, centre: Array, design: Array, names: list[str], kind: str) -> None:
    _, unseen = null_space(design, names, threshold=_SPREAD)
    count = distinct(unit(readings - centre))
    if count < FEWEST or len(readings) < design.shape[1]:
        seen = f"; they cannot see {unseen[0]}" if unseen else ""
        raise DataError(
            f"norm calibration of the {kind} triad needs at least {design.shape[1]} well-spread positions; "
            f"{count} different ones were found among {len(readings)}{seen}"
        )
    if unseen:
        raise DataError(f"the {kind} positions are not spread well enough: they cannot see {'; '.join(unseen)}")


def distinct(directions: Array) -> int:
    """How many directions (n, 3) differ by more than two degrees."""
    kept: list[Array] = []
    for d in directions:
        if not kept or np.max(np.array(kept) @ d) < _APART:
            kept.append(d)
    return len(kept)
