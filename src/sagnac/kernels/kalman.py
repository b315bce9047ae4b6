"""A Kalman filter in small pieces; one triangle of the covariance is computed and copied to the other."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy")
def transition(F, dt, phi):  # type: ignore[no-untyped-def]
    """``phi = I + F dt + (F dt)^2 / 2``.

    Parameters
    ----------
    F, phi : ndarray, shape (n, n)
    dt : float, s
    """
    n = F.shape[0]
    for i in range(n):
        for j in range(n):
            phi[i, j] = F[i, j] * dt + (1.0 if i == j else 0.0)
        for k in range(n):
            first = 0.5 * F[i, k] * dt * dt
            if first != 0.0:
                for j in range(n):
                    phi[i, j] += first * F[k, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def propagate(P, phi, noise, room):  # type: ignore[no-untyped-def]
    """``P = phi (P + Q/2) phi' + Q/2`` with diagonal Q, the trapezoid over the interval.

    Parameters
    ----------
    P, phi, room : ndarray, shape (n, n)
        `room` is overwritten.
    noise : ndarray, shape (n,)
        Diagonal of Q.
    """
    n = P.shape[0]
    for i in range(n):
        P[i, i] += 0.5 * noise[i]
    for i in range(n):
        for j in range(n):
            room[i, j] = 0.0
        for k in range(n):
            value = phi[i, k]
            if value != 0.0:
                for j in range(n):
                    room[i, j] += value * P[k, j]
    for i in range(n):
        for j in range(i, n):
            total = 0.0
            for k in range(n):
                total += room[i, k] * phi[j, k]
            P[i, j] = total
            P[j, i] = total
        P[i, i] += 0.5 * noise[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def distance(P, H, R, y):  # type: ignore[no-untyped-def]
    """``y' (H P H' + diag R)^-1 y`` of an innovation (k,): chi-square with k degrees of freedom when the model holds."""
    k, n = H.shape
    S = np.empty((k, k))
    for a in range(k):
        for b in range(a + 1):
            total = R[a] if a == b else 0.0
            for i in range(n):
                if H[a, i] != 0.0:
                    for j in range(n):
                        total += H[a, i] * P[i, j] * H[b, j]
            S[a, b] = total
    out = 0.0
    w = np.empty(k)
    for a in range(k):  # Cholesky, and forward substitution beside it
        for b in range(a + 1):
            total = S[a, b]
            for c in range(b):
                total -= S[a, c] * S[b, c]
            S[a, b] = math.sqrt(total) if a == b else total / S[b, b]
        w[a] = y[a]
        for c in range(a):
            w[a] -= S[a, c] * w[c]
        w[a] /= S[a, a]
        out += w[a] * w[a]
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def take(x, P, h, variance, y, g):  # type: ignore[no-untyped-def]
    """Take in one measurement ``y = h x + noise``; `g` (n,) is overwritten."""
    n = x.size
    s, innovation = variance, y
    for i in range(n):
        total = 0.0
        for j in range(n):
            if h[j] != 0.0:
                total += P[i, j] * h[j]
        g[i] = total
    for i in range(n):
        s += h[i] * g[i]
        innovation -= h[i] * x[i]
    for i in range(n):
        gain = g[i] / s
        x[i] += gain * innovation
        for j in range(i, n):
            P[i, j] -= gain * g[j]
            P[j, i] = P[i, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def update(x, P, H, R, y):  # type: ignore[no-untyped-def]
    """Take in measurements one by one: white, ``y = H x + noise``.

    Parameters
    ----------
    x : ndarray, shape (n,)
    P : ndarray, shape (n, n)
        Both in place.
    H : ndarray, shape (k, n)
    R : ndarray, shape (k,)
        Variances.
    y : ndarray, shape (k,)
    """
    g = np.empty(x.size)
    for a in range(H.shape[0]):
        take(x, P, H[a], R[a], y[a], g)
