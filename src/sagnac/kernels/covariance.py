"""Covariances along a known course: the filter's second moments, with no data."""

from __future__ import annotations

import numba as nb
import numpy as np

from .error_model import system
from .kalman import propagate, transition, update


@nb.njit(cache=True, nogil=True, error_model="numpy")
def follow(  # type: ignore[no-untyped-def]
    C, v, u, h, f, steps, earth_rate, ellipsoid, at, still, H, R, noise, pick, P, product, gramian, sigmas, picked
):
    """Propagate over each interval and update at its end.

    Parameters
    ----------
    C, v, u, h, f : ndarray, shape (m, 3, 3), (m, 3), (m, 3), (m,), (m, 3)
        Of each interval, see :func:`sagnac.kernels.error_model.system`.
    steps : ndarray, shape (m,), s
    earth_rate, ellipsoid, at : see there
    still : ndarray, shape (n, n)
        Part of the system matrix that does not change with time.
    H : ndarray, shape (m, k, n)
    R : ndarray, shape (k,)
    noise : ndarray, shape (n,)
        Density of the driving noise.
    pick : ndarray, shape (m, 3, n)
        Combinations of states of which the covariance is wanted too.
    P, product, gramian : ndarray, shape (n, n)
        Covariance, transition from the start, and Gramian ``sum (H T)' R^-1 (H T)``; in place.
    sigmas : ndarray, shape (m, n)
        Filled with the standard deviations after each update.
    picked : ndarray, shape (m, 3, 3)
        Filled with the covariance of the combinations.
    """
    m, k, n = H.shape
    F, phi, room = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    x, y = np.zeros(n), np.zeros(k)
    seen = np.empty(n)
    for i in range(m):
        system(C[i], v[i], u[i], h[i], f[i], earth_rate, ellipsoid, at, F)
        F += still
        transition(F, steps[i], phi)
        propagate(P, phi, noise * steps[i], room)
        for a in range(n):
            for b in range(n):
                total = 0.0
                for c in range(n):
                    if phi[a, c] != 0.0:
                        total += phi[a, c] * product[c, b]
                room[a, b] = total
        product[:] = room
        update(x, P, H[i], R, y)
        for a in range(k):
            for b in range(n):
                total = 0.0
                for c in range(n):
                    if H[i, a, c] != 0.0:
                        total += H[i, a, c] * product[c, b]
                seen[b] = total
            for b in range(n):
                for c in range(n):
                    gramian[b, c] += seen[b] * seen[c] / R[a]
        for a in range(n):
            sigmas[i, a] = np.sqrt(P[a, a])
        for a in range(3):
            for b in range(3):
                total = 0.0
                for c in range(n):
                    if pick[i, a, c] != 0.0:
                        for d in range(n):
                            total += pick[i, a, c] * P[c, d] * pick[i, b, d]
                picked[i, a, b] = total
