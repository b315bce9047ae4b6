"""Attitude from small rotations, one after the other."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy")
def compose(turns, previous, start):  # type: ignore[no-untyped-def]
    """Attitude after each of many small rotations.

    The integral of the rate over a step becomes a rotation vector with a twelfth of its cross product with the one before
    (coning; exact to third order for rates that change linearly, Savage 1998), and quaternions are composed, so that no
    step leaves the rotations.

    Parameters
    ----------
    turns : ndarray, shape (n, 3), rad
        Integral of the body rate over each step.
    previous : ndarray, shape (3,), rad
        The one before the first.
    start : ndarray, shape (4,)
        Quaternion before the first step, scalar last, from body to the frame that attitudes refer to.

    Returns
    -------
    ndarray, shape (n, 4)
        Quaternion after each step, scalar last.
    """
    n = turns.shape[0]
    out = np.empty((n, 4))
    x, y, z, w = start[0], start[1], start[2], start[3]
    p0, p1, p2 = previous[0], previous[1], previous[2]
    for k in range(n):
        t0, t1, t2 = turns[k, 0], turns[k, 1], turns[k, 2]
        a0 = t0 + (p1 * t2 - p2 * t1) / 12.0
        a1 = t1 + (p2 * t0 - p0 * t2) / 12.0
        a2 = t2 + (p0 * t1 - p1 * t0) / 12.0
        p0, p1, p2 = t0, t1, t2
        h2 = 0.25 * (a0 * a0 + a1 * a1 + a2 * a2)
        if h2 < 1e-6:
            f, c = 0.5 * (1.0 - h2 / 6.0 * (1.0 - h2 / 20.0)), 1.0 - 0.5 * h2 * (1.0 - h2 / 12.0)
        else:
            h = math.sqrt(h2)
            f, c = 0.5 * math.sin(h) / h, math.cos(h)
        b0, b1, b2 = f * a0, f * a1, f * a2
        nx = w * b0 + x * c + y * b2 - z * b1
        ny = w * b1 - x * b2 + y * c + z * b0
        nz = w * b2 + x * b1 - y * b0 + z * c
        nw = w * c - x * b0 - y * b1 - z * b2
        norm = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz + nw * nw)
        x, y, z, w = nx * norm, ny * norm, nz * norm, nw * norm
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = x, y, z, w
    return out
