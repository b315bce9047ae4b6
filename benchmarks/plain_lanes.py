"""Plain twins of the filter lanes: whole matrices in NumPy, one run at a time."""

from __future__ import annotations

import numpy as np

from sagnac.frames import skew
from sagnac.navigate.wander import curvature

DV, PHI, WANDER, EPS, NAB = slice(0, 2), slice(2, 5), 5, slice(6, 9), slice(9, 11)
"""Where the states stand, in the kernel's order."""


def system(C, v, f, u, height, earth_rate, slaved=False):
    """System matrix of the eleven states, from the vector equations.

    Parameters
    ----------
    C : ndarray, shape (3, 3)
        C_b, and velocity `v`, specific force `f` and Earth's axis `u`, shape (3,), in the frame.
    slaved : bool
        East, north, up; else a wander frame.
    """
    frame = np.zeros((3, 3))
    frame[:, 2] = u
    k1, k2 = curvature(frame, height)
    K = k1 * np.eye(2) + k2 * np.outer(u[:2], u[:2])
    by_v = np.array([-K[1], K[0], np.zeros(2)])  # of the frame's rate over the Earth
    if slaved:
        by_v[2] = K[0] * u[2] / u[1]
    over, earth = by_v @ v[:2], earth_rate * u
    F = np.zeros((11, 11))
    F[DV, PHI] = skew(f)[:2]
    F[DV, DV] = (-skew(2.0 * earth + over)[:, :2] + skew(v) @ by_v)[:2]
    F[DV, NAB] = C[:2, :2]
    F[PHI, PHI] = -skew(earth + over)
    F[PHI, DV] = by_v
    F[PHI, EPS] = -C
    if not slaved:
        turned = np.array([u[1], -u[0], 0.0])  # what a wander angle that is off does to the axis
        bent = k2 * (turned[:2] * (u[:2] @ v[:2]) + u[:2] * (turned[:2] @ v[:2]))  # and to K v
        rates = np.array([-bent[1], bent[0], 0.0])
        F[DV, WANDER] = np.cross(v, 2.0 * earth_rate * turned + rates)[:2]
        F[PHI, WANDER] = earth_rate * turned + rates
        per = k1 * u[2] / (u[:2] @ u[:2])
        F[WANDER, DV] = per * np.array([-u[1], u[0]])
        F[WANDER, WANDER] = per * (u[:2] @ v[:2])
    return F


def step(P, x, F, dt, noise, seen, variance):
    """One interval of a filter: covariance, estimate, and normalised innovation squared."""
    A = F * dt
    phi = np.eye(11) + A + 0.5 * A @ A
    half = 0.5 * np.diag(noise)
    P, x, H = phi @ (P + half) @ phi.T + half, phi @ x, np.zeros((2, 11))
    H[0, 0], H[1, 1], H[:, WANDER] = 1.0, 1.0, seen[2:]
    S = H @ P @ H.T + variance * np.eye(2)
    K, innovation = P @ H.T @ np.linalg.inv(S), seen[:2] - H @ x
    P = P - K @ S @ K.T
    return 0.5 * (P + P.T), x + K @ innovation, innovation @ np.linalg.solve(S, innovation)
