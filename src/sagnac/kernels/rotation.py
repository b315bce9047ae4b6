"""Rotations from rotation vectors, and from gyro samples with the analytic derivative to the gyro model."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _rodrigues(a0, a1, a2, c1, c2, out):  # type: ignore[no-untyped-def]
    """``out = I + c1 [a x] + c2 [a x]^2``."""
    d = 1.0 - c2 * (a0 * a0 + a1 * a1 + a2 * a2)
    out[0, 0] = d + c2 * a0 * a0
    out[0, 1] = c2 * a0 * a1 - c1 * a2
    out[0, 2] = c2 * a0 * a2 + c1 * a1
    out[1, 0] = c2 * a0 * a1 + c1 * a2
    out[1, 1] = d + c2 * a1 * a1
    out[1, 2] = c2 * a1 * a2 - c1 * a0
    out[2, 0] = c2 * a0 * a2 - c1 * a1
    out[2, 1] = c2 * a1 * a2 + c1 * a0
    out[2, 2] = d + c2 * a2 * a2


@nb.njit(cache=True, nogil=True, error_model="numpy")
def exponential(a0, a1, a2, turn, left):  # type: ignore[no-untyped-def]
    """``turn = exp([a x])`` and its left Jacobian, the mean of the rotation on the way."""
    t2 = a0 * a0 + a1 * a1 + a2 * a2
    if t2 < 1e-6:
        c1 = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0)
        c2 = 0.5 - t2 / 24.0 * (1.0 - t2 / 30.0)
        c3 = 1.0 / 6.0 - t2 / 120.0 * (1.0 - t2 / 42.0)
    else:
        t = math.sqrt(t2)
        c1, c2 = math.sin(t) / t, (1.0 - math.cos(t)) / t2
        c3 = (1.0 - c1) / t2
    _rodrigues(a0, a1, a2, c1, c2, turn)
    _rodrigues(a0, a1, a2, c2, c3, left)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def integrate(time, gyro, force, inverse, bias, g_matrix, first, last):  # type: ignore[no-untyped-def]
    """Rotation from sample `first` to sample `last` of each interval, and what its derivative needs.

    The rate between two samples is ``w = A (y - b - G f)`` of the mean of both. With R the rotation from body at
    the start to body now, and Jl the left Jacobian of SO(3), the body-frame error at the end is
    ``R_end' sum R Jl(w dt) dw dt`` (Forster et al. 2017, equation 7), so that three sums serve every parameter.

    Parameters
    ----------
    time : ndarray, shape (n,), s
    gyro : ndarray, shape (n, 3)
        Readings.
    force : ndarray, shape (n, 3), m/s^2
    inverse : ndarray, shape (3, 3)
        A, the inverse of S.
    bias : ndarray, shape (3,)
    g_matrix : ndarray, shape (3, 3)
    first, last : ndarray of int, shape (m,)

    Returns
    -------
    rotation : ndarray, shape (m, 3, 3)
        Takes body coordinates at the end to those at the start.
    sum_1 : ndarray, shape (m, 3, 3)
        ``sum R Jl dt``.
    sum_w, sum_f : ndarray, shape (m, 3, 3, 3)
        ``sum (R Jl)_ij w_l dt`` and the same with the specific force.
    """
    m = first.size
    rotation = np.empty((m, 3, 3))
    sum_1 = np.zeros((m, 3, 3))
    sum_w = np.zeros((m, 3, 3, 3))
    sum_f = np.zeros((m, 3, 3, 3))
    turn, left, new = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    w, f, y = np.empty(3), np.empty(3), np.empty(3)
    for s in range(m):
        r = np.eye(3)
        for k in range(first[s], last[s]):
            dt = time[k + 1] - time[k]
            for i in range(3):
                f[i] = 0.5 * (force[k, i] + force[k + 1, i])
            for i in range(3):
                y[i] = 0.5 * (gyro[k, i] + gyro[k + 1, i]) - bias[i]
                for j in range(3):
                    y[i] -= g_matrix[i, j] * f[j]
            for i in range(3):
                w[i] = inverse[i, 0] * y[0] + inverse[i, 1] * y[1] + inverse[i, 2] * y[2]
            exponential(w[0] * dt, w[1] * dt, w[2] * dt, turn, left)
            for i in range(3):
                for j in range(3):
                    new[i, j] = r[i, 0] * turn[0, j] + r[i, 1] * turn[1, j] + r[i, 2] * turn[2, j]
                    e = dt * (r[i, 0] * left[0, j] + r[i, 1] * left[1, j] + r[i, 2] * left[2, j])
                    sum_1[s, i, j] += e
                    for k2 in range(3):
                        sum_w[s, i, j, k2] += e * w[k2]
                        sum_f[s, i, j, k2] += e * f[k2]
            for i in range(3):
                for j in range(3):
                    r[i, j] = new[i, j]
        rotation[s] = r
    return rotation, sum_1, sum_w, sum_f
