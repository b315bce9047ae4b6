"""The exact quadric start of norm calibration, without [DONG18]'s truncation.

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
    x, y, z = ((readings - centre) / size).T
    design = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, -2 * x, -2 * y, -2 * z], axis=1)
    names = [f"{kind}.scale_error.{a}" for a in "xyz"]
    names += [f"{kind}.misalignment.{p}" for p in ("yx", "zx", "zy")] + [f"{kind}.bias.{a}" for a in "xyz"]
    _refuse_poor(readings, centre, design, names, kind)
    q_matrix, bias = _solve(design, (norms / norms[0]) ** 2)
    values = np.linalg.eigvalsh(q_matrix)
    if not np.all(np.isfinite(values)) or not np.all(values > 0) or values[-1] > 1e8 * values[0]:
        raise DataError(
            f"the {kind} readings do not lie on an ellipsoid: an axis is dead or saturated, or a position was not static"
        )
    matrix = np.linalg.cholesky(np.linalg.inv(q_matrix)) * size / abs(norms[0])
    return Ellipsoid(matrix, centre + size * bias)


def _solve(design: Array, squares: Array) -> tuple[Array, Array]:
    """Q and centre b of ``N'QN - 2 q'N = |u|^2 - c`` with c = b'Qb.

    The coefficients are linear in the right side, hence in c: one unknown is left, the root of b'Qb - c.
    """
    both = np.linalg.lstsq(design, np.column_stack([squares, np.ones_like(squares)]), rcond=None)[0]

    def parts(c: float) -> tuple[Array, Array, float]:
        p = both[:, 0] - c * both[:, 1]
        q_matrix = np.array([[p[0], p[3], p[4]], [p[3], p[1], p[5]], [p[4], p[5], p[2]]])
        bias = np.linalg.lstsq(q_matrix, p[6:9], rcond=None)[0]
        return q_matrix, bias, float(bias @ q_matrix @ bias) - c

    _, bias, first = parts(0.0)
    # equal norms: Q is known up to the factor 1 - c, and b not at all affected, which solves it exactly
    c, before, value_before = first / (1.0 + first), 0.0, first
    for _ in range(50):
        q_matrix, bias, value = parts(c)
        if abs(value) < 1e-15 or value == value_before:
            break
        c, before, value_before = c - value * (c - before) / (value - value_before), c, value
    return q_matrix, bias


def _refuse_poor(readings: Array, centre: Array, design: Array, names: list[str], kind: str) -> None:
    _, unseen = null_space(design, names, threshold=_SPREAD)
    count = distinct(unit(readings - centre))
    if count < FEWEST:
        seen = f"; they cannot see {unseen[0]}" if unseen else ""
        raise DataError(
            f"norm calibration of the {kind} triad needs at least {FEWEST} well-spread positions; "
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
