"""Filters of velocity matching, many side by side: every row holds one number of each, see :mod:`sagnac.kernels.lanes`.

The eleven states of Huang et al. 2011 stand in an order of their own, those that move first::

    0, 1   velocity error, m/s        2, 3, 4   attitude error, rad       5   error of the wander angle, rad
    6:9    gyro bias, rad/s           9, 10     accelerometer bias, m/s^2

A covariance is stored as a whole square, element (i, j) in row ``11 i + j``. What is computed is the upper triangle,
copied to the lower one, or both by the very same operations: it stays symmetric to the last bit. (One that does not
diverges after some thousand updates.)
"""

from __future__ import annotations

import math

import numba as nb

from .lanes import LANES

STATES = 11
MOVING = 6
"""States before the biases, which do not change by themselves."""
MOTION = 19
"""Rows of :func:`transition`'s motion: C_b row by row, velocity, specific force, Earth's axis (three each), height."""
ROOM = MOVING * STATES
"""Rows that the functions work in."""

_ROW = STATES * LANES
_QUICK = {"contract"}  # a product and a sum may become one instruction


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _system(motion, dt, earth_rate, ellipsoid, slaved, out):  # type: ignore[no-untyped-def] # noqa: PLR0915 - all elements
    """The upper rows of the system matrix times the step; see :func:`sagnac.kernels.error_model.system`."""
    semi_major, e2 = ellipsoid[0], ellipsoid[1]
    wander = 0.0 if slaved else 1.0
    for i in range(MOVING * STATES * LANES):
        out[i] = 0.0
    for i in range(LANES):
        v0, v1, v2 = motion[9 * LANES + i], motion[10 * LANES + i], motion[11 * LANES + i]
        f0, f1, f2 = dt * motion[12 * LANES + i], dt * motion[13 * LANES + i], dt * motion[14 * LANES + i]
        u0, u1, u2 = motion[15 * LANES + i], motion[16 * LANES + i], motion[17 * LANES + i]
        height = motion[18 * LANES + i]
        w2 = 1.0 - e2 * u2 * u2
        normal = semi_major / math.sqrt(w2)
        k1 = 1.0 / (normal + height)
        k2 = k1 * e2 * normal / (normal * (1.0 - e2) + height * w2)
        along = u0 * v0 + u1 * v1
        e0, e1, ez = dt * earth_rate * u0, dt * earth_rate * u1, dt * earth_rate * u2
        # K dt, and the same for a frame that turns with north (x east)
        xx, xy, yy = dt * (k1 + k2 * u0 * u0), dt * k2 * u0 * u1, dt * (k1 + k2 * u1 * u1)
        tan = (1.0 - wander) * u2 / u1
        zx, zy = tan * xx, tan * xy
        r0, r1 = -(xy * v0 + yy * v1), xx * v0 + xy * v1
        rz = tan * r1
        w0, w1, wz = e0 + r0, e1 + r1, ez + rz
        # what a wander angle that is off does to the rates of the Earth and of the frame
        across, c = u1 * v0 - u0 * v1, wander * dt * k2
        d0, d1 = c * (along * u0 - u1 * across), c * (along * u1 + u0 * across)
        g0, g1 = wander * e1, -wander * e0
        per = wander * dt * k1 * u2 / (u0 * u0 + u1 * u1)

        out[i] = zx * v1 - xx * v2
        out[LANES + i] = wz + ez + zy * v1 - xy * v2
        out[3 * LANES + i] = -f2
        out[4 * LANES + i] = f1
        out[5 * LANES + i] = -(2.0 * g1 + d1) * v2
        out[9 * LANES + i] = dt * motion[i]
        out[10 * LANES + i] = dt * motion[LANES + i]
        out[_ROW + i] = -(wz + ez) - zx * v0 - xy * v2
        out[_ROW + LANES + i] = -zy * v0 - yy * v2
        out[_ROW + 2 * LANES + i] = f2
        out[_ROW + 4 * LANES + i] = -f0
        out[_ROW + 5 * LANES + i] = (2.0 * g0 + d0) * v2
        out[_ROW + 9 * LANES + i] = dt * motion[3 * LANES + i]
        out[_ROW + 10 * LANES + i] = dt * motion[4 * LANES + i]
        out[2 * _ROW + i] = -xy
        out[2 * _ROW + LANES + i] = -yy
        out[2 * _ROW + 3 * LANES + i] = wz
        out[2 * _ROW + 4 * LANES + i] = -w1
        out[2 * _ROW + 5 * LANES + i] = g0 + d0
        out[3 * _ROW + i] = xx
        out[3 * _ROW + LANES + i] = xy
        out[3 * _ROW + 2 * LANES + i] = -wz
        out[3 * _ROW + 4 * LANES + i] = w0
        out[3 * _ROW + 5 * LANES + i] = g1 + d1
        out[4 * _ROW + i] = zx
        out[4 * _ROW + LANES + i] = zy
        out[4 * _ROW + 2 * LANES + i] = w1
        out[4 * _ROW + 3 * LANES + i] = -w0
        out[5 * _ROW + i] = -per * u1
        out[5 * _ROW + LANES + i] = per * u0
        out[5 * _ROW + 5 * LANES + i] = per * along
        for r in range(3):
            out[(2 + r) * _ROW + 6 * LANES + i] = -dt * motion[3 * r * LANES + i]
            out[(2 + r) * _ROW + 7 * LANES + i] = -dt * motion[(3 * r + 1) * LANES + i]
            out[(2 + r) * _ROW + 8 * LANES + i] = -dt * motion[(3 * r + 2) * LANES + i]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def transition(motion, dt, earth_rate, ellipsoid, slaved, phi, room):  # type: ignore[no-untyped-def]
    """Upper rows of ``I + F dt + (F dt)^2 / 2``; those of the biases are of the identity.

    Parameters
    ----------
    motion : ndarray, shape (MOTION * LANES,)
        C_b row by row, velocity (m/s), specific force (m/s^2) and the Earth's axis, in the frame of the errors; height
        (m).
    dt, earth_rate : float, s and rad/s
    ellipsoid : ndarray
        `sagnac.earth.ELLIPSOID`.
    slaved : bool
        Whether the frame is east, north, up; then there is no error of the wander angle. Else a wander frame.
    phi : ndarray, shape (MOVING * STATES * LANES,)
        Filled.
    room : ndarray, shape (ROOM * LANES,)
        Overwritten.
    """
    _system(motion, dt, earth_rate, ellipsoid, slaved, room)
    for j in range(STATES):
        for i in range(LANES):
            at = j * LANES + i
            c0, c1, c2 = 0.5 * room[at], 0.5 * room[at + _ROW], 0.5 * room[at + 2 * _ROW]
            c3, c4, c5 = 0.5 * room[at + 3 * _ROW], 0.5 * room[at + 4 * _ROW], 0.5 * room[at + 5 * _ROW]
            phi[at] = room[at] + _six(room, i, c0, c1, c2, c3, c4, c5)
            phi[at + _ROW] = room[at + _ROW] + _six(room, i + _ROW, c0, c1, c2, c3, c4, c5)
            phi[at + 2 * _ROW] = room[at + 2 * _ROW] + _six(room, i + 2 * _ROW, c0, c1, c2, c3, c4, c5)
            phi[at + 3 * _ROW] = room[at + 3 * _ROW] + _six(room, i + 3 * _ROW, c0, c1, c2, c3, c4, c5)
            phi[at + 4 * _ROW] = room[at + 4 * _ROW] + _six(room, i + 4 * _ROW, c0, c1, c2, c3, c4, c5)
            phi[at + 5 * _ROW] = room[at + 5 * _ROW] + _six(room, i + 5 * _ROW, c0, c1, c2, c3, c4, c5)
    for j in range(MOVING):
        for i in range(LANES):
            phi[j * (_ROW + LANES) + i] += 1.0


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _six(m, at, c0, c1, c2, c3, c4, c5):  # type: ignore[no-untyped-def]
    """Sum of the products of six rows of `m`, from `at` on, with six numbers."""
    s = m[at] * c0 + m[at + LANES] * c1 + m[at + 2 * LANES] * c2
    return s + m[at + 3 * LANES] * c3 + m[at + 4 * LANES] * c4 + m[at + 5 * LANES] * c5


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _eleven(m, at, c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10):  # type: ignore[no-untyped-def]
    """The same for eleven."""
    s = _six(m, at, c0, c1, c2, c3, c4, c5) + m[at + 6 * LANES] * c6 + m[at + 7 * LANES] * c7
    return s + m[at + 8 * LANES] * c8 + m[at + 9 * LANES] * c9 + m[at + 10 * LANES] * c10


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _add_half(P, noise):  # type: ignore[no-untyped-def]
    for j in range(STATES):
        half = 0.5 * noise[j]
        for i in range(LANES):
            P[j * (_ROW + LANES) + i] += half


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def propagate(P, x, phi, noise, room):  # type: ignore[no-untyped-def]
    """``P = phi (P + Q / 2) phi' + Q / 2``, the trapezoid over the interval, and ``x = phi x``.

    Parameters
    ----------
    P : ndarray, shape (STATES * STATES * LANES,)
    x : ndarray, shape (STATES * LANES,)
        Both in place.
    phi : ndarray, shape (MOVING * STATES * LANES,)
        See :func:`transition`.
    noise : ndarray, shape (STATES,)
        Diagonal of Q.
    room : ndarray, shape (ROOM * LANES,)
        Overwritten.
    """
    _add_half(P, noise)
    for j in range(STATES):  # P is symmetric: its row is its column
        _times(phi, P[j * _ROW : (j + 1) * _ROW], room[j * LANES :], _ROW)
    for j in range(MOVING):
        own = room[j * _ROW : (j + 1) * _ROW]
        _times(phi, own, P[j * _ROW : (j + 1) * _ROW], LANES)
        for i in range(MOVING * LANES, _ROW):
            P[j * _ROW + i] = own[i]
    for r in range(MOVING):
        for j in range(r + 1, STATES):
            for i in range(LANES):
                P[j * _ROW + r * LANES + i] = P[r * _ROW + j * LANES + i]
    _add_half(P, noise)
    for i in range(_ROW):
        room[i] = x[i]
    _times(phi, room, x, LANES)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _times(phi, x, out, apart):  # type: ignore[no-untyped-def]
    """The upper rows of ``phi x``, so far apart in `out`."""
    for i in range(LANES):
        c0, c1, c2, c3 = x[i], x[i + LANES], x[i + 2 * LANES], x[i + 3 * LANES]
        c4, c5, c6, c7 = x[i + 4 * LANES], x[i + 5 * LANES], x[i + 6 * LANES], x[i + 7 * LANES]
        c8, c9, c10 = x[i + 8 * LANES], x[i + 9 * LANES], x[i + 10 * LANES]
        out[i] = _eleven(phi, i, c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10)
        out[i + apart] = _eleven(phi, i + _ROW, c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10)
        out[i + 2 * apart] = _eleven(phi, i + 2 * _ROW, c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10)
        out[i + 3 * apart] = _eleven(phi, i + 3 * _ROW, c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10)
        out[i + 4 * apart] = _eleven(phi, i + 4 * _ROW, c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10)
        out[i + 5 * apart] = _eleven(phi, i + 5 * _ROW, c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def update(P, x, axis, seen, variance, nis, room):  # type: ignore[no-untyped-def]
    """Take in one component of the velocity difference, ``z = x[axis] + t x[5] + noise``.

    Parameters
    ----------
    P : ndarray, shape (STATES * STATES * LANES,)
    x : ndarray, shape (STATES * LANES,)
        Both in place.
    axis : int
        0 or 1.
    seen : ndarray, shape (4 * LANES,), m/s
        In rows 0 and 1 the components z, in rows 2 and 3 what a wander angle that is off adds to each, t, per radian.
    variance : float, (m/s)^2
    nis : ndarray, shape (LANES,)
        The squared innovation over its variance is added to it.
    room : ndarray, shape (ROOM * LANES,)
        Overwritten.
    """
    own, measured, turned = axis * _ROW, axis * LANES, (2 + axis) * LANES
    gain, step = STATES * LANES, (STATES + 1) * LANES  # of room, whose first rows hold P H'
    for j in range(STATES):
        for i in range(LANES):
            room[j * LANES + i] = P[own + j * LANES + i] + seen[turned + i] * P[5 * _ROW + j * LANES + i]
    for i in range(LANES):
        t = seen[turned + i]
        s = 1.0 / (room[measured + i] + t * room[5 * LANES + i] + variance)
        innovation = seen[measured + i] - x[measured + i] - t * x[5 * LANES + i]
        nis[i] += innovation * innovation * s
        room[gain + i] = s
        room[step + i] = s * innovation
    for j in range(STATES):
        for i in range(LANES):
            x[j * LANES + i] += room[j * LANES + i] * room[step + i]
            at, g, s = j * _ROW + i, room[j * LANES + i], room[gain + i]
            P[at] -= g * room[i] * s
            P[at + LANES] -= g * room[LANES + i] * s
            P[at + 2 * LANES] -= g * room[2 * LANES + i] * s
            P[at + 3 * LANES] -= g * room[3 * LANES + i] * s
            P[at + 4 * LANES] -= g * room[4 * LANES + i] * s
            P[at + 5 * LANES] -= g * room[5 * LANES + i] * s
            P[at + 6 * LANES] -= g * room[6 * LANES + i] * s
            P[at + 7 * LANES] -= g * room[7 * LANES + i] * s
            P[at + 8 * LANES] -= g * room[8 * LANES + i] * s
            P[at + 9 * LANES] -= g * room[9 * LANES + i] * s
            P[at + 10 * LANES] -= g * room[10 * LANES + i] * s


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def step(P, x, motion, seen, dt, earth_rate, ellipsoid, slaved, noise, variance, nis, room):  # type: ignore[no-untyped-def]
    """One interval: propagate, then take in both components of the velocity difference.

    Parameters
    ----------
    P, x, seen, variance, nis : see :func:`update`
    motion, dt, earth_rate, ellipsoid, slaved : see :func:`transition`
    noise : see :func:`propagate`
    room : ndarray, shape (2 * ROOM * LANES,)
        Overwritten.
    """
    phi, rest = room[: ROOM * LANES], room[ROOM * LANES :]
    transition(motion, dt, earth_rate, ellipsoid, slaved, phi, rest)
    propagate(P, x, phi, noise, rest)
    for axis in range(2):
        update(P, x, axis, seen, variance, nis, rest)
