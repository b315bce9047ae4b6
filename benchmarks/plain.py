"""The hand-turned gyro and norm work in plain NumPy, as one would write it first: the twin of the kernels and the baseline.

Nothing here is imported by the package. Tests compare the kernels with it; ``make bench`` times both in the same run.
"""

from __future__ import annotations

import numpy as np


def exponential(v):
    """Rotation matrices and left Jacobians of rotation vectors (n, 3)."""
    t2 = np.sum(v * v, axis=1)
    t = np.sqrt(t2)
    small = t2 < 1e-8
    safe = np.where(small, 1.0, t)
    c1 = np.where(small, 1 - t2 / 6, np.sin(safe) / safe)
    c2 = np.where(small, 0.5 - t2 / 24, (1 - np.cos(safe)) / safe**2)
    c3 = np.where(small, 1 / 6 - t2 / 120, (1 - c1) / safe**2)
    k = np.zeros((len(v), 3, 3))
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    k -= np.swapaxes(k, 1, 2)
    k2 = k @ k
    eye = np.eye(3)
    return (
        eye + c1[:, None, None] * k + c2[:, None, None] * k2,
        eye + c2[:, None, None] * k + c3[:, None, None] * k2,
    )


def integrate(time, gyro, force, inverse, bias, g_matrix, first, last):
    """Same arguments and results as :func:`sagnac.kernels.rotation.integrate`."""
    rotation, sum_1, sum_w, sum_f = [], [], [], []
    for a, b in zip(first, last, strict=True):
        dt = np.diff(time[a : b + 1])
        f = 0.5 * (force[a:b] + force[a + 1 : b + 1])
        w = (0.5 * (gyro[a:b] + gyro[a + 1 : b + 1]) - bias - f @ g_matrix.T) @ inverse.T
        turns, left = exponential(w * dt[:, None])
        before = np.empty_like(turns)
        r = np.eye(3)
        for k, turn in enumerate(turns):
            before[k] = r
            r = r @ turn
        moved = before @ left * dt[:, None, None]
        rotation.append(r)
        sum_1.append(moved.sum(axis=0))
        sum_w.append(np.einsum("nij,nl->ijl", moved, w))
        sum_f.append(np.einsum("nij,nl->ijl", moved, f))
    return np.array(rotation), np.array(sum_1), np.array(sum_w), np.array(sum_f)


def moving_variance(values, width):
    """Variance of every window, by strided views: the direct form of :func:`sagnac.observe.static.moving_variance`."""
    return np.lib.stride_tricks.sliding_window_view(values, width, axis=0).var(axis=-1)
