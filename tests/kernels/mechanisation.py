"""The nonlinear mechanisation once more, in plain NumPy that takes complex numbers: the oracle of the error models."""

from __future__ import annotations

import numpy as np

from sagnac.earth import EARTH_RATE, ELLIPSOID

STEP = 1e-30


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def vee(m):
    return np.array([m[2, 1], m[0, 2], m[1, 0]])


def gravity(s, h):
    a, e2, equator, k, p, q = ELLIPSOID
    r = h / a
    return equator * (1 + k * s * s) / np.sqrt(1 - e2 * s * s) * (1 - (p - q * s * s) * r + 3 * r * r)


def transport(v, u, h, slaved):
    """Rate of the frame over the Earth from R_M and R_N, in the textbook's way: by components along east and north."""
    a, e2 = ELLIPSOID[:2]
    w2 = 1 - e2 * u[2] ** 2
    normal = a / np.sqrt(w2)
    meridian = normal * (1 - e2) / w2
    c = np.sqrt(u[0] ** 2 + u[1] ** 2)
    sin, cos = u[0] / c, u[1] / c
    east, north = v[0] * cos - v[1] * sin, v[0] * sin + v[1] * cos
    about_east, about_north = -north / (meridian + h), east / (normal + h)
    z = about_north * u[2] / c if slaved else 0.0 * u[2]
    return np.array([about_east * cos + about_north * sin, -about_east * sin + about_north * cos, z])


def wander_rate(v, u, h):
    """al' with the position known."""
    a, e2 = ELLIPSOID[:2]
    c = np.sqrt(u[0] ** 2 + u[1] ** 2)
    east = (v[0] * u[1] - v[1] * u[0]) / c
    return -east / (a / np.sqrt(1 - e2 * u[2] ** 2) + h) * u[2] / c


def right_side(C, v, C_e, h, force, rate, slaved):
    """Derivatives of attitude, velocity, position, height."""
    u = C_e[:, 2]
    over = transport(v, u, h, slaved)
    earth = EARTH_RATE * u
    dv = C @ force - np.cross(2 * earth + over, v) - np.array([0, 0, gravity(u[2], h)])
    return C @ skew(rate) - skew(earth + over) @ C, dv, -skew(over) @ C_e, v[2]


def system(state, force, rate, at, n):
    """System matrix by complex step of :func:`right_side`, with the errors as they are defined."""
    C, v, C_e, h = state
    dv, nv, phi, theta, nt, dh, eps, nab, nn, slaved = at
    F = np.zeros((n, n))
    true = right_side(C, v, C_e, h, force, rate, slaved)
    u = C_e[:, 2]
    for j in range(n):
        x = np.zeros(n, complex)
        x[j] = 1j * STEP
        velocity = v + np.concatenate([x[dv : dv + nv], np.zeros(3 - nv)])
        turned = np.zeros(3, complex)
        if nt == 1:
            turned[2] = x[theta]
        else:
            turned[:nt] = x[theta : theta + nt]
        if nt == 2:
            turned[2] = turned[1] * u[2] / np.sqrt(1 - u[2] ** 2)
        tilt = x[phi : phi + 3]
        bias = np.concatenate([x[nab : nab + nn], np.zeros(3 - nn)])
        height = h + (x[dh] if dh >= 0 else 0)
        C_ = (np.eye(3) - skew(tilt)) @ C
        C_e_ = (np.eye(3) - skew(turned)) @ C_e
        got = right_side(C_, velocity, C_e_, height, force + bias, rate + x[eps : eps + 3], slaved)
        F[dv : dv + nv, j] = got[1].imag[:nv] / STEP
        F[phi : phi + 3, j] = -vee((got[0].imag / STEP + skew(tilt.imag / STEP) @ true[0].real) @ C.T)
        moved = -vee((got[2].imag / STEP + skew(turned.imag / STEP) @ true[2].real) @ C_e.T)
        if nt > 1:
            F[theta : theta + nt, j] = moved[:nt]
        if nt == 1:
            F[theta, j] = np.imag(wander_rate(velocity, C_e_[:, 2], height)) / STEP
        if dh >= 0:
            F[dh, j] = np.imag(got[3]) / STEP
    return F
