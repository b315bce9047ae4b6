"""Strapdown navigation of many trajectories side by side.

Each lane of every row is a trajectory of its own. Rows of :data:`LANES` numbers lie one after the other in flat arrays,
row r from ``r * LANES``; the innermost loops go over the lanes, and the compiler makes vector instructions of them. The
rows of a state are the numbers of :mod:`sagnac.kernels.strapdown`, the sample before included, and the algorithm is
that of :func:`sagnac.kernels.strapdown.advance` for groups of two samples in the wander frame, to rounding.

A lane does not know of the others: its numbers are the same to the last bit wherever it stands and whatever the others
do.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from .strapdown import cross

LANES = 16
"""Trajectories side by side: four registers to a row, and a filter of eleven states stays in the first cache."""
STATE = 24
"""Rows of a state."""
SAMPLE = 6
"""Rows of a sample: turn x, y, z (rad), push x, y, z (m/s)."""
ROOM = 5
"""Rows that :func:`advance` works in."""

_HEIGHT, _LAST, _STEP = 16, 17, 23
_BLOCK = 16  # samples of many groups at a time, an even number: those of a thousand stay in the second cache
_GAP = 2.0  # next to a step that is this much longer nothing is known of how the rate changed
_QUICK = {"contract"}  # a product and a sum may become one instruction


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _series(first, one, second, two, keep, c, room):  # type: ignore[no-untyped-def]
    """Coefficients of the closed forms of velocity and attitude for the rotation vector of a group, of length a.

    Rows 0 to 3 of `room` become ``(1 - cos a) / a^2``, ``(a - sin a) / a^3``, ``sin(a / 2) / a`` and ``cos(a / 2)``.
    """
    wide = 0
    for i in range(LANES):
        p0, p1, p2 = first[one + i], first[one + LANES + i], first[one + 2 * LANES + i]
        q0, q1, q2 = second[two + i], second[two + LANES + i], second[two + 2 * LANES + i]
        c0, c1, c2 = cross(p0, p1, p2, q0, q1, q2)
        a0, a1, a2 = keep * p0 + q0 + c * c0, keep * p1 + q1 + c * c1, keep * p2 + q2 + c * c2
        angle2 = a0 * a0 + a1 * a1 + a2 * a2
        room[i] = 0.5 - angle2 / 24.0 * (1.0 - angle2 / 30.0 * (1.0 - angle2 / 56.0 * (1.0 - angle2 / 90.0)))
        third = 1.0 - angle2 / 20.0 * (1.0 - angle2 / 42.0 * (1.0 - angle2 / 72.0 * (1.0 - angle2 / 110.0)))
        room[LANES + i] = third / 6.0
        quarter = 0.25 * angle2
        s = 0.5 - quarter / 12.0 * (1.0 - quarter / 20.0 * (1.0 - quarter / 42.0 * (1.0 - quarter / 72.0)))
        half = 1.0 - quarter / 12.0 * (1.0 - quarter / 30.0 * (1.0 - quarter / 56.0))
        room[2 * LANES + i] = s
        room[3 * LANES + i] = 1.0 - quarter / 2.0 * half
        room[4 * LANES + i] = angle2
        wide += angle2 >= 0.25
    if wide > 0:
        for i in range(LANES):
            angle2 = room[4 * LANES + i]
            if angle2 >= 0.25:
                a = math.sqrt(angle2)
                room[i], room[LANES + i] = (1.0 - math.cos(a)) / angle2, (a - math.sin(a)) / (angle2 * a)
                room[2 * LANES + i], room[3 * LANES + i] = math.sin(0.5 * a) / a, math.cos(0.5 * a)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _group(state, first, one, second, two, keep, c, step, tied, constants, pushed, room):  # type: ignore[no-untyped-def] # noqa: PLR0915
    """Advance all lanes by one group: two samples, or with `keep` zero the second one alone.

    Row 4 of `room` holds heights at the end of the group, used if `tied`.
    """
    a, e2, g_e, g_k, g_p, g_q = constants[0], constants[1], constants[2], constants[3], constants[4], constants[5]
    earth_rate, excess = constants[6], constants[7]
    half = 0.5 * step
    per_step = 1.0 / step
    for i in range(LANES):
        x, y, z, w = state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i]
        v0, v1, v2 = state[4 * LANES + i], state[5 * LANES + i], state[6 * LANES + i]
        m00, m01, m02 = state[7 * LANES + i], state[8 * LANES + i], state[9 * LANES + i]
        m10, m11, m12 = state[10 * LANES + i], state[11 * LANES + i], state[12 * LANES + i]
        m20, m21, m22 = state[13 * LANES + i], state[14 * LANES + i], state[15 * LANES + i]
        height = state[16 * LANES + i]

        # rotation vector a and translation vector u of the group
        p0, p1, p2 = first[one + i], first[one + LANES + i], first[one + 2 * LANES + i]
        q0, q1, q2 = first[one + 3 * LANES + i], first[one + 4 * LANES + i], first[one + 5 * LANES + i]
        a0, a1, a2 = second[two + i], second[two + LANES + i], second[two + 2 * LANES + i]
        u0, u1, u2 = second[two + 3 * LANES + i], second[two + 4 * LANES + i], second[two + 5 * LANES + i]
        c0, c1, c2 = cross(p0, p1, p2, a0, a1, a2)
        s0, s1, s2 = cross(p0, p1, p2, u0, u1, u2)
        r0, r1, r2 = cross(q0, q1, q2, a0, a1, a2)
        a0, a1, a2 = a0 + keep * p0 + c * c0, a1 + keep * p1 + c * c1, a2 + keep * p2 + c * c2
        u0, u1, u2 = u0 + keep * q0 + c * (s0 + r0), u1 + keep * q1 + c * (s1 + r1), u2 + keep * q2 + c * (s2 + r2)

        # velocity gained, in body axes at the start: u + b1 a x u + b2 a x (a x u)
        b1, b2 = room[i], room[LANES + i]
        t0, t1, t2 = cross(a0, a1, a2, u0, u1, u2)
        r0, r1, r2 = cross(a0, a1, a2, t0, t1, t2)
        u0, u1, u2 = u0 + b1 * t0 + b2 * r0, u1 + b1 * t1 + b2 * r1, u2 + b1 * t2 + b2 * r2

        # in w at the start: C u, from the quaternion
        t0, t1, t2 = cross(x, y, z, u0, u1, u2)
        t0, t1, t2 = t0 + t0, t1 + t1, t2 + t2
        r0, r1, r2 = cross(x, y, z, t0, t1, t2)
        u0, u1, u2 = u0 + w * t0 + r0, u1 + w * t1 + r1, u2 + w * t2 + r2

        # axis of the Earth in w and height, in the middle of the group, with the velocity at its start
        aim = room[4 * LANES + i]
        v2 = (aim - height) * per_step if tied else v2
        middle = height + half * v2
        sine2 = m22 * m22
        w2 = 1.0 - e2 * sine2
        normal = a / math.sqrt(w2)
        k1 = 1.0 / (normal + height)
        k2 = k1 * e2 * normal / (normal * (1.0 - e2) + height * w2)
        along = k2 * (m02 * v0 + m12 * v1)
        f0, f1 = k1 * v0 + along * m02, k1 * v1 + along * m12  # K v
        l0, l1, l2 = m02 - half * (f0 * m22), m12 - half * (f1 * m22), m22 + half * (f0 * m02 + f1 * m12)

        # curvature and gravity there (NIMA TR8350.2, equations 4-1 and 4-3)
        sine2 = l2 * l2
        w2 = 1.0 - e2 * sine2
        root = math.sqrt(w2)
        normal = a / root
        k1 = 1.0 / (normal + middle)
        k2 = k1 * e2 * normal / (normal * (1.0 - e2) + middle * w2)
        ratio = middle / a
        gravity = g_e * (1.0 + g_k * sine2) / root * (1.0 - (g_p - g_q * sine2) * ratio + 3.0 * ratio * ratio) + excess

        # rates of the Earth and of w over it, with that velocity
        e0, e1, ez = earth_rate * l0, earth_rate * l1, earth_rate * l2
        w0, w1 = e0 - f1, e1 + f0
        t0, t1, t2 = cross(w0, w1, ez, u0, u1, u2)
        u0, u1, u2 = u0 - half * t0, u1 - half * t1, u2 - half * t2  # in w at half time
        pushed[i] += u0
        pushed[LANES + i] += u1
        pushed[2 * LANES + i] += u2
        u2 -= gravity * step

        # velocity in the middle, and again the rate of w with it
        t0, t1, t2 = cross(e0 + w0, e1 + w1, ez + ez, v0, v1, v2)
        h0, h1, h2 = v0 + 0.5 * (u0 - step * t0), v1 + 0.5 * (u1 - step * t1), v2 + 0.5 * (u2 - step * t2)
        h2 = v2 if tied else h2
        along = k2 * (l0 * h0 + l1 * h1)
        f0, f1 = k1 * h0 + along * l0, k1 * h1 + along * l1
        w0, w1 = e0 - f1, e1 + f0
        t0, t1, t2 = cross(e0 + w0, e1 + w1, ez + ez, h0, h1, h2)
        v0, v1 = v0 + u0 - step * t0, v1 + u1 - step * t1
        fall = 0.0 if tied else u2 - step * t2
        height = aim if tied else height + step * (v2 + 0.5 * fall)
        v2 += fall

        # position: C_e_w (I - [r x] + [r x]^2 / 2), r = w_ew step
        f0, f1 = -step * f1, step * f0
        t0, t1, t2 = f1 * m20, -f0 * m20, f0 * m10 - f1 * m00
        m00, m10, m20 = m00 - t0 + 0.5 * f1 * t2, m10 - t1 - 0.5 * f0 * t2, m20 - t2 + 0.5 * (f0 * t1 - f1 * t0)
        t0, t1, t2 = f1 * m21, -f0 * m21, f0 * m11 - f1 * m01
        m01, m11, m21 = m01 - t0 + 0.5 * f1 * t2, m11 - t1 - 0.5 * f0 * t2, m21 - t2 + 0.5 * (f0 * t1 - f1 * t0)
        t0, t1, t2 = f1 * m22, -f0 * m22, f0 * m12 - f1 * m02
        m02, m12, m22 = m02 - t0 + 0.5 * f1 * t2, m12 - t1 - 0.5 * f0 * t2, m22 - t2 + 0.5 * (f0 * t1 - f1 * t0)

        # attitude: quaternion of the body's turn from the right, of the turn of w against i from the left
        s, q = room[2 * LANES + i], room[3 * LANES + i]
        a0, a1, a2 = s * a0, s * a1, s * a2
        r0 = w * a0 + x * q + y * a2 - z * a1
        r1 = w * a1 - x * a2 + y * q + z * a0
        r2 = w * a2 + x * a1 - y * a0 + z * q
        rw = w * q - x * a0 - y * a1 - z * a2
        d0, d1, d2 = half * w0, half * w1, half * ez
        s = 1.0 - 0.5 * (d0 * d0 + d1 * d1 + d2 * d2)
        x = s * r0 - d0 * rw - d1 * r2 + d2 * r1
        y = s * r1 - d1 * rw - d2 * r0 + d0 * r2
        z = s * r2 - d2 * rw - d0 * r1 + d1 * r0
        w = s * rw + d0 * r0 + d1 * r1 + d2 * r2
        s = 1.5 - 0.5 * (x * x + y * y + z * z + w * w)  # to length one: one step of Newton's

        state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i] = s * x, s * y, s * z, s * w
        state[4 * LANES + i], state[5 * LANES + i], state[6 * LANES + i] = v0, v1, v2
        state[7 * LANES + i], state[8 * LANES + i], state[9 * LANES + i] = m00, m01, m02
        state[10 * LANES + i], state[11 * LANES + i], state[12 * LANES + i] = m10, m11, m12
        state[13 * LANES + i], state[14 * LANES + i], state[15 * LANES + i] = m20, m21, m22
        state[16 * LANES + i] = height


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _orthonormal(state):  # type: ignore[no-untyped-def]
    """Take out of C_e_w what rounding has put in: rows of length one, at right angles."""
    for i in range(LANES):
        x0, x1, x2 = state[7 * LANES + i], state[8 * LANES + i], state[9 * LANES + i]
        z0, z1, z2 = state[13 * LANES + i], state[14 * LANES + i], state[15 * LANES + i]
        f = 1.0 / math.sqrt(z0 * z0 + z1 * z1 + z2 * z2)
        z0, z1, z2 = f * z0, f * z1, f * z2
        f = x0 * z0 + x1 * z1 + x2 * z2
        x0, x1, x2 = x0 - f * z0, x1 - f * z1, x2 - f * z2
        f = 1.0 / math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
        x0, x1, x2 = f * x0, f * x1, f * x2
        y0, y1, y2 = cross(z0, z1, z2, x0, x1, x2)
        state[7 * LANES + i], state[8 * LANES + i], state[9 * LANES + i] = x0, x1, x2
        state[10 * LANES + i], state[11 * LANES + i], state[12 * LANES + i] = y0, y1, y2
        state[13 * LANES + i], state[14 * LANES + i], state[15 * LANES + i] = z0, z1, z2


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def advance(state, samples, steps, tied, heights, constants, pushed, room):  # type: ignore[no-untyped-def]
    """Advance the states of all lanes over all samples, in place.

    Parameters
    ----------
    state : ndarray, shape (STATE * LANES,)
        Rows as :mod:`sagnac.kernels.strapdown` numbers them.
    samples : ndarray, shape (n * SAMPLE * LANES,)
        Six rows a sample.
    steps : ndarray, shape (n,), s
        Lengths of the sample intervals, of all lanes. A step next to one that is twice as long or more is a gap.
    tied : bool
        Whether the height is given.
    heights : ndarray, shape (n * LANES,) or (0,), m
        If `tied`, a row of heights at the end of each sample interval; without rows the height of each lane stays.
    constants : ndarray, shape (8,)
        `sagnac.earth.ELLIPSOID`, Earth rate (rad/s), excess of the real gravity over the normal one (m/s^2).
    pushed : ndarray, shape (3 * LANES,), m/s
        The velocity gained from the specific force, in w, is added to it.
    room : ndarray, shape (ROOM * LANES,)
        Overwritten.
    """
    n = steps.size
    k = 0
    while k < n:
        h2 = steps[k]
        if k + 1 < n:
            h1, h2 = h2, steps[k + 1]
            c, keep, step = 0.5, 1.0, h1 + h2
            if h1 < _GAP * h2 and h2 < _GAP * h1:
                c = step * step / (6.0 * h1 * h2)
            before, one = samples, k * SAMPLE * LANES
            k += 2
        else:
            h1 = state[_STEP * LANES]
            c, keep, step = 0.0, 0.0, h2
            if h2 < _GAP * h1 and h1 < _GAP * h2:
                c = h2 * h2 / (6.0 * h1 * (h1 + h2))
            before, one = state, _LAST * LANES
            k += 1
        two = (k - 1) * SAMPLE * LANES
        _series(before, one, samples, two, keep, c, room)
        for i in range(LANES):
            room[4 * LANES + i] = state[_HEIGHT * LANES + i]
        if heights.size > 0:
            for i in range(LANES):
                room[4 * LANES + i] = heights[(k - 1) * LANES + i]
        _group(state, before, one, samples, two, keep, c, step, tied, constants, pushed, room)
        if k == n or k == n - 1:
            for r in range(SAMPLE * LANES):
                state[_LAST * LANES + r] = samples[two + r]
            for i in range(LANES):
                state[_STEP * LANES + i] = h2
    if n > 0:
        _orthonormal(state)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _fetch(given, begin, end, first, last, row, samples):  # type: ignore[no-untyped-def]
    """Copy turns or pushes of some groups to their samples, from the row of x on; the last trajectory fills up its group.

    Memory is read as it lies, all trajectories of one instant together.
    """
    count = given.shape[2]
    whole = min(last, count // LANES)
    for k in range(begin, end):
        for r in range(3):
            at = ((k - begin) * SAMPLE + row + r) * LANES
            for g in range(first, whole):
                for i in range(LANES):
                    samples[g - first, at + i] = given[k, r, g * LANES + i]
            for g in range(whole, last):
                for i in range(LANES):
                    samples[g - first, at + i] = given[k, r, min(g * LANES + i, count - 1)]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def advance_groups(states, first, last, turns, pushes, steps, tied, heights, constants, pushed):  # type: ignore[no-untyped-def]
    """Advance some groups of trajectories over all samples, in place.

    Parameters
    ----------
    states : ndarray, shape (groups, STATE * LANES)
        Trajectory t is lane ``t % LANES`` of group ``t // LANES``; the lanes behind the last one are filled with it.
    first, last : int
        Groups to advance, the last one not.
    turns, pushes : ndarray, shape (n, 3, N), rad and m/s
    steps : ndarray, shape (n,), s
    tied : bool
    heights : ndarray, shape (n, N), (n, 1) for all the same, or (0, 0), m
    constants : ndarray, shape (8,)
    pushed : ndarray, shape (groups, 3 * LANES), m/s
        See :func:`advance`.
    """
    n, count = steps.size, turns.shape[2]
    samples = np.empty((last - first, _BLOCK * SAMPLE * LANES))
    aims, room = np.empty(_BLOCK * LANES), np.empty(ROOM * LANES)
    given = heights.shape[0] > 0
    for begin in range(0, n, _BLOCK):
        end = min(begin + _BLOCK, n)
        rows = aims[: (end - begin) * LANES] if given else aims[:0]
        _fetch(turns, begin, end, first, last, 0, samples)
        _fetch(pushes, begin, end, first, last, 3, samples)
        for g in range(first, last):
            if given:
                for k in range(begin, end):
                    for i in range(LANES):
                        column = min(g * LANES + i, count - 1, heights.shape[1] - 1)
                        aims[(k - begin) * LANES + i] = heights[k, column]
            advance(states[g], samples[g - first], steps[begin:end], tied, rows, constants, pushed[g], room)
