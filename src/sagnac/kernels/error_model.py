"""How small errors of a navigation system grow: its system matrix, row by row from the vector equations."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _cross(F, row, column, rows, columns, x, y, z):  # type: ignore[no-untyped-def]
    """Add the first rows and columns of ``[(x, y, z) x]`` to a block of F."""
    for i in range(rows):
        for j in range(columns):
            k = 3 - i - j
            if i == j:
                continue
            value = x if k == 0 else (y if k == 1 else z)
            F[row + i, column + j] += value if (j - i) % 3 == 2 else -value


@nb.njit(cache=True, nogil=True, error_model="numpy")
def earth_terms(v, u, h, slaved, ellipsoid, rate, by_v, by_u, by_h):  # type: ignore[no-untyped-def]
    """Rate of the frame over the Earth and what changes it, and what changes gravity.

    Parameters
    ----------
    v, u : ndarray, shape (3,)
        Velocity, m/s, and the Earth's axis, in the frame.
    h : float, m
    slaved : bool
        Whether the frame stays on north (x east); else it is a wander frame.
    ellipsoid : ndarray
        :data:`sagnac.earth.ELLIPSOID`.
    rate, by_h : ndarray, shape (3,), rad/s and rad/s/m
        Filled: the rate, and its derivative to the height.
    by_v, by_u : ndarray, shape (3, 3)
        Filled: its derivatives to `v` and `u`.

    Returns
    -------
    by_s, by_height : float
        Derivatives of gravity to the third component of `u` and to the height.
    """
    a, e2, equator, somigliana, p, q = (
        ellipsoid[0],
        ellipsoid[1],
        ellipsoid[2],
        ellipsoid[3],
        ellipsoid[4],
        ellipsoid[5],
    )
    s = u[2]
    w2 = 1.0 - e2 * s * s
    normal = a / math.sqrt(w2)
    meridian = normal * (1.0 - e2) / w2
    normal_s = normal * e2 * s / w2
    meridian_s = normal_s * (1.0 - e2) / w2 + 2.0 * e2 * s * meridian / w2
    k1 = 1.0 / (normal + h)
    k2 = k1 * e2 * normal / w2 / (meridian + h)
    k1_s = -k1 * k1 * normal_s
    k2_s = k2 * (k1_s / k1 + normal_s / normal + 2.0 * e2 * s / w2 - meridian_s / (meridian + h))
    k1_h, k2_h = -k1 * k1, -k2 * (k1 + 1.0 / (meridian + h))
    along = u[0] * v[0] + u[1] * v[1]
    by_v[:] = 0.0
    by_u[:] = 0.0
    for i in range(2):
        # row i of (K v): it turns the frame about y for i = 0, backwards about x for i = 1
        row, sign = 1 - i, 1.0 - 2.0 * i
        rate[row] = sign * (k1 * v[i] + k2 * u[i] * along)
        by_h[row] = sign * (k1_h * v[i] + k2_h * u[i] * along)
        by_u[row, 2] = sign * (k1_s * v[i] + k2_s * u[i] * along)
        for j in range(2):
            by_v[row, j] = sign * k2 * u[i] * u[j]
            by_u[row, j] = sign * k2 * u[i] * v[j]
        by_v[row, i] += sign * k1
        by_u[row, i] += sign * k2 * along
    rate[2] = 0.0
    by_h[2] = 0.0
    if slaved:
        tan = u[2] / u[1]
        rate[2] = rate[1] * tan
        by_h[2] = by_h[1] * tan
        for j in range(3):
            by_v[2, j] = by_v[1, j] * tan
            by_u[2, j] = by_u[1, j] * tan
        by_u[2, 1] -= rate[1] * u[2] / (u[1] * u[1])
        by_u[2, 2] += rate[1] / u[1]
    ratio = h / a
    surface = equator * (1.0 + somigliana * s * s) / math.sqrt(w2)
    surface_s = equator * 2.0 * somigliana * s / math.sqrt(w2) + surface * e2 * s / w2
    factor = 1.0 - (p - q * s * s) * ratio + 3.0 * ratio * ratio
    return surface_s * factor + surface * 2.0 * q * s * ratio, surface * (6.0 * ratio - (p - q * s * s)) / a


@nb.njit(cache=True, nogil=True, error_model="numpy")
def system(C, v, u, h, f, earth_rate, ellipsoid, at, F):  # type: ignore[no-untyped-def]
    """System matrix of the errors of a navigation system.

    Equations of Huang et al. 2011 as vectors, with the ellipsoid's curvature in place of one radius; errors of position as
    the rotation theta of the computed direction cosines, ``C~_e = (I - [theta x]) C_e``, so that the Earth's axis is off by
    ``u x theta``::

        dv'    = f x phi + C nab - (2 w_ie + w_ef) x dv + v x (2 dw_ie + dw_ef) - dg z
        phi'   = -(w_ie + w_ef) x phi + dw_ie + dw_ef - C eps
        theta' = -w_ef x theta + dw_ef,      dh' = dv_z

    Parameters
    ----------
    C : ndarray, shape (3, 3)
        Takes body coordinates to the frame.
    v, u, f : ndarray, shape (3,)
        Velocity, m/s, Earth's axis and specific force, m/s^2, in the frame.
    h : float, m
    earth_rate : float, rad/s
    ellipsoid : ndarray
    at : ndarray of int, shape (10,)
        Where the blocks begin, and how long they are: dv, its length (2 or 3), phi, theta, its length (0: none; 1: the wander
        angle with the position known; 2: position on a north-slaved frame; 3: position and wander angle), dh (-1: none), eps,
        nab, its length (2 or 3), and whether the frame is slaved to north.
    F : ndarray, shape (n, n), 1/s
        Filled.
    """
    dv, nv, phi, theta, nt, dh, eps, nab, nn = at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7], at[8]
    slaved = at[9] != 0
    rate, by_h = np.empty(3), np.empty(3)
    by_v, by_u = np.empty((3, 3)), np.empty((3, 3))
    g_s, g_h = earth_terms(v, u, h, slaved, ellipsoid, rate, by_v, by_u, by_h)
    F[:] = 0.0
    ie = earth_rate * u
    _cross(F, dv, phi, nv, 3, f[0], f[1], f[2])
    _cross(F, dv, dv, nv, nv, -2.0 * ie[0] - rate[0], -2.0 * ie[1] - rate[1], -2.0 * ie[2] - rate[2])
    _cross(F, phi, phi, 3, 3, -ie[0] - rate[0], -ie[1] - rate[1], -ie[2] - rate[2])
    for i in range(3):
        for j in range(3):
            F[phi + i, eps + j] = -C[i, j]
        for j in range(nv):
            F[phi + i, dv + j] += by_v[i, j]
    for i in range(nv):
        for j in range(nn):
            F[dv + i, nab + j] = C[i, j]
        m, k = (i + 1) % 3, (i + 2) % 3
        for j in range(nv):
            F[dv + i, dv + j] += v[m] * by_v[k, j] - v[k] * by_v[m, j]
    for j in range(nt):
        # column j: the rotation t that one unit of this error is, and with it the change d of the Earth's axis
        t = np.zeros(3)
        t[2 if nt == 1 else j] = 1.0
        if nt == 2 and j == 1:
            t[2] = u[2] / u[1]
        d = np.array([u[1] * t[2] - u[2] * t[1], u[2] * t[0] - u[0] * t[2], u[0] * t[1] - u[1] * t[0]])
        turned = by_u @ d
        for i in range(3):
            F[phi + i, theta + j] += earth_rate * d[i] + turned[i]
        for i in range(nv):
            m, k = (i + 1) % 3, (i + 2) % 3
            F[dv + i, theta + j] += v[m] * (2.0 * earth_rate * d[k] + turned[k])
            F[dv + i, theta + j] -= v[k] * (2.0 * earth_rate * d[m] + turned[m])
        if nv == 3:
            F[dv + 2, theta + j] -= g_s * d[2]
        if nt > 1:
            for i in range(nt):
                m, k = (i + 1) % 3, (i + 2) % 3
                F[theta + i, theta + j] += turned[i] - (rate[m] * t[k] - rate[k] * t[m])
                if j == 0:
                    for c in range(nv):
                        F[theta + i, dv + c] += by_v[i, c]
    if nt == 1:
        # the wander angle itself: al' = -(tan L / (R_N + h)) v_E, with the position known
        c2 = u[0] * u[0] + u[1] * u[1]
        a, e2 = ellipsoid[0], ellipsoid[1]
        per = u[2] / c2 / (a / math.sqrt(1.0 - e2 * u[2] * u[2]) + h)
        F[theta, dv] = -per * u[1]
        F[theta, dv + 1] = per * u[0]
        F[theta, theta] = per * (u[0] * v[0] + u[1] * v[1])
    if dh >= 0:
        F[dh, dv + 2] = 1.0
        for i in range(3):
            F[phi + i, dh] = by_h[i]
            m, k = (i + 1) % 3, (i + 2) % 3
            F[dv + i, dh] = v[m] * by_h[k] - v[k] * by_h[m]
        for i in range(nt):
            F[theta + i, dh] = by_h[i]
        F[dv + 2, dh] -= g_h
