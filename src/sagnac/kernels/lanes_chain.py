"""Transfer alignment of many slaves at once, from true motion to corrected slaves: see :mod:`sagnac.kernels.lanes`.

Each lane is a slave with errors of its own: mounting, biases, noise. It navigates, is matched with the master's
velocity, and takes the estimated errors out at each update.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from .lanes import LANES, SAMPLE, advance
from .lanes import ROOM as ADVANCE_ROOM
from .lanes_filter import MOTION, STATES, step
from .lanes_filter import ROOM as FILTER_ROOM
from .lanes_random import normals

_ROW = STATES * LANES
_QUICK = {"contract"}  # a product and a sum may become one instruction


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _feel(turns, pushes, steps, begin, mounting, biases, drawn, generator, samples):  # type: ignore[no-untyped-def]
    """Samples of the slaves: the master's true increments in their own axes, biases and noise."""
    for k in range(steps.size):
        h = steps[k]
        root = math.sqrt(h)
        own = samples[k * SAMPLE * LANES : (k + 1) * SAMPLE * LANES]
        for r in range(0, SAMPLE, 2):
            normals(generator, own, r)
        for s in range(2):
            given = turns if s == 0 else pushes
            t0, t1, t2 = given[begin + k, 0], given[begin + k, 1], given[begin + k, 2]
            noise = root * drawn[s]
            for r in range(3):
                for i in range(LANES):
                    felt = mounting[3 * r * LANES + i] * t0 + mounting[(3 * r + 1) * LANES + i] * t1
                    felt += mounting[(3 * r + 2) * LANES + i] * t2 + h * biases[(3 * s + r) * LANES + i]
                    own[(3 * s + r) * LANES + i] = felt + noise * own[(3 * s + r) * LANES + i]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _walk(biases, time, drawn, generator, samples):  # type: ignore[no-untyped-def]
    """Random walk of the biases over an interval; the first rows of `samples` are overwritten."""
    root = math.sqrt(time)
    for r in range(0, 6, 2):
        normals(generator, samples, r)
    for r in range(6):
        size = root * drawn[2 + r // 3]
        for i in range(LANES):
            biases[r * LANES + i] += size * samples[r * LANES + i]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _half(state, motion, keep):  # type: ignore[no-untyped-def]
    """Add half of the attitude's matrix and of the velocity to `keep` times what `motion` holds."""
    for i in range(LANES):
        x, y, z, w = state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i]
        motion[i] = keep * motion[i] + 0.5 - y * y - z * z
        motion[LANES + i] = keep * motion[LANES + i] + x * y - w * z
        motion[2 * LANES + i] = keep * motion[2 * LANES + i] + x * z + w * y
        motion[3 * LANES + i] = keep * motion[3 * LANES + i] + x * y + w * z
        motion[4 * LANES + i] = keep * motion[4 * LANES + i] + 0.5 - x * x - z * z
        motion[5 * LANES + i] = keep * motion[5 * LANES + i] + y * z - w * x
        motion[6 * LANES + i] = keep * motion[6 * LANES + i] + x * z - w * y
        motion[7 * LANES + i] = keep * motion[7 * LANES + i] + y * z + w * x
        motion[8 * LANES + i] = keep * motion[8 * LANES + i] + 0.5 - x * x - y * y
    for r in range(3):
        for i in range(LANES):
            motion[(9 + r) * LANES + i] = keep * motion[(9 + r) * LANES + i] + 0.5 * state[(4 + r) * LANES + i]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _moved(state, pushed, time, geographic, motion, north):  # type: ignore[no-untyped-def]
    """What a transition needs at the end of an interval; `north` becomes cosine and sine of the wander angle."""
    for r in range(3):
        for i in range(LANES):
            motion[(12 + r) * LANES + i] = pushed[r * LANES + i] / time
            motion[(15 + r) * LANES + i] = state[(9 + 3 * r) * LANES + i]
    for i in range(LANES):
        motion[18 * LANES + i] = state[16 * LANES + i]
        u0, u1 = motion[15 * LANES + i], motion[16 * LANES + i]
        level = math.sqrt(u0 * u0 + u1 * u1)
        north[i] = u1 / level
        north[LANES + i] = u0 / level
        north[2 * LANES + i] = level
    if geographic:
        for r in range(5):
            # rows x and y of three columns of C, of v and of f
            x = r if r < 3 else 3 * r
            y = x + (3 if r < 3 else 1)
            for i in range(LANES):
                a, b = motion[x * LANES + i], motion[y * LANES + i]
                motion[x * LANES + i] = north[i] * a - north[LANES + i] * b
                motion[y * LANES + i] = north[LANES + i] * a + north[i] * b
        for i in range(LANES):
            motion[15 * LANES + i] = 0.0
            motion[16 * LANES + i] = north[2 * LANES + i]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _difference(state, north, east_speed, north_speed, sigma, geographic, seen):  # type: ignore[no-untyped-def]
    """Slave's velocity less the master's, and what a wander angle that is off adds to it: rows 0, 1 and 2, 3 of `seen`.

    Before, rows 0 and 1 hold normal numbers for the master's noise, which has no direction.
    """
    for i in range(LANES):
        c, s = north[i], north[LANES + i]
        x, y = state[4 * LANES + i], state[5 * LANES + i]
        v0, v1 = c * east_speed + s * north_speed, c * north_speed - s * east_speed
        t0, t1 = -y, x
        if geographic:
            x, y = c * x - s * y, s * x + c * y
            v0, v1, t0, t1 = east_speed, north_speed, 0.0, 0.0
        seen[i] = x - v0 - sigma * seen[i]
        seen[LANES + i] = y - v1 - sigma * seen[LANES + i]
        seen[2 * LANES + i] = t0
        seen[3 * LANES + i] = t1


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _take_out(state, biases, x, north, geographic):  # type: ignore[no-untyped-def]
    """Take estimated errors out: ``C = exp([phi x]) C~``, ``v = v~ - dv``, the wander angle by a turn of w."""
    for i in range(LANES):
        v0, v1 = x[i], x[LANES + i]
        p0, p1, p2 = x[2 * LANES + i], x[3 * LANES + i], x[4 * LANES + i]
        if geographic:
            c, s = north[i], north[LANES + i]
            v0, v1 = c * v0 + s * v1, c * v1 - s * v0
            p0, p1 = c * p0 + s * p1, c * p1 - s * p0
        state[4 * LANES + i] -= v0
        state[5 * LANES + i] -= v1
        quarter = 0.25 * (p0 * p0 + p1 * p1 + p2 * p2)
        s = 0.5 - quarter / 12.0 * (1.0 - quarter / 20.0 * (1.0 - quarter / 42.0 * (1.0 - quarter / 72.0)))
        q = 1.0 - quarter / 2.0 * (1.0 - quarter / 12.0 * (1.0 - quarter / 30.0 * (1.0 - quarter / 56.0)))
        d0, d1, d2 = s * p0, s * p1, s * p2
        r0, r1, r2, rw = state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i]
        state[i] = q * r0 + d0 * rw + d1 * r2 - d2 * r1
        state[LANES + i] = q * r1 + d1 * rw + d2 * r0 - d0 * r2
        state[2 * LANES + i] = q * r2 + d2 * rw + d0 * r1 - d1 * r0
        state[3 * LANES + i] = q * rw - d0 * r0 - d1 * r1 - d2 * r2
    for r in range(3):
        for i in range(LANES):
            d = x[5 * LANES + i]
            c, s = 1.0 - 0.5 * d * d, d - d * d * d / 6.0
            a, b = state[(7 + r) * LANES + i], state[(10 + r) * LANES + i]
            state[(7 + r) * LANES + i] = c * a - s * b
            state[(10 + r) * LANES + i] = s * a + c * b
    for r in range(5):
        for i in range(LANES):
            biases[r * LANES + i] -= x[(6 + r) * LANES + i]


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turned(p0, p1, p2, c1, c2, a0, a1, a2):  # type: ignore[no-untyped-def]
    """``a + c1 p x a + c2 p x (p x a)``."""
    t0, t1, t2 = p1 * a2 - p2 * a1, p2 * a0 - p0 * a2, p0 * a1 - p1 * a0
    r0, r1, r2 = p1 * t2 - p2 * t1, p2 * t0 - p0 * t2, p0 * t1 - p1 * t0
    return a0 + c1 * t0 + c2 * r0, a1 + c1 * t1 + c2 * r1, a2 + c1 * t2 + c2 * r2


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def turn_covariance(P, x):  # type: ignore[no-untyped-def]
    """Covariance of the attitude errors that are left when those of `x` were taken out.

    The true rotation vector ``phi^ + d`` leaves ``log(exp(phi^ + d) exp(-phi^)) = Jl(phi^) d`` with the left Jacobian
    ``Jl = I + (1 - cos a) / a^2 [phi^ x] + (a - sin a) / a^3 [phi^ x]^2`` of SO(3).

    Parameters
    ----------
    P : ndarray, shape (STATES * STATES * LANES,)
        In place.
    x : ndarray, shape (STATES * LANES,)
        What was taken out, phi^ in rows 2 to 4, rad.
    """
    for turn in range(2):
        # first the rows of the attitude in every column, then in what came of them the columns of the attitude
        first, count = (0, STATES) if turn == 0 else (2, 3)
        apart, along = (_ROW, LANES) if turn == 0 else (LANES, _ROW)
        for j in range(first, first + count):
            own = P[2 * apart + j * along :]
            for i in range(LANES):
                p0, p1, p2 = x[2 * LANES + i], x[3 * LANES + i], x[4 * LANES + i]
                angle2 = p0 * p0 + p1 * p1 + p2 * p2
                c1 = 0.5 - angle2 / 24.0 * (1.0 - angle2 / 30.0)
                c2 = (1.0 - angle2 / 20.0 * (1.0 - angle2 / 42.0)) / 6.0
                own[i], own[apart + i], own[2 * apart + i] = _turned(
                    p0, p1, p2, c1, c2, own[i], own[apart + i], own[2 * apart + i]
                )
    for r in range(2, 5):
        for j in range(STATES):
            if j > r or j < 2:
                for i in range(LANES):
                    P[j * _ROW + r * LANES + i] = P[r * _ROW + j * LANES + i]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def align(  # type: ignore[no-untyped-def]
    state,
    P,
    biases,
    mounting,
    generator,
    turns,
    pushes,
    steps,
    heights,
    velocities,
    geographic,
    drawn,
    driving,
    variance,
    constants,
    nis,
):
    """Navigate over some intervals of equally many samples, and match the velocity at the end of each.

    Parameters
    ----------
    state : ndarray, shape (STATE * LANES,)
        Of the slaves' navigation, see :func:`sagnac.kernels.lanes.advance`.
    P : ndarray, shape (STATES * STATES * LANES,)
        Covariance, see :mod:`sagnac.kernels.lanes_filter`.
    biases : ndarray, shape (6 * LANES,), rad/s and m/s^2
        What is left of the biases after the corrections; all but the last row are estimated. These three in place.
    mounting : ndarray, shape (9 * LANES,)
        Matrix that takes the master's body axes to the slave's, row by row.
    generator : ndarray of uint64, shape (4 * LANES,)
        See :mod:`sagnac.kernels.lanes_random`; in place.
    turns, pushes : ndarray, shape (m * n, 3), rad and m/s
        True increments of the master in its body axes, n samples an interval.
    steps : ndarray, shape (m * n,), s
    heights : ndarray, shape (m * n,), m
        True, at the ends of the samples: the vertical channel follows the master.
    velocities : ndarray, shape (m, 2), m/s
        True, east and north, at the end of each interval.
    geographic : bool
        Errors in east, north, up with no error of the wander angle; else in the wander frame.
    drawn : ndarray, shape (5,)
        What is drawn: noise density of gyros, rad/sqrt(s), and accelerometers, m/s/sqrt(s), random walks of their
        biases, rad/s/sqrt(s) and m/s^2/sqrt(s), and the master's noise, m/s.
    driving : ndarray, shape (STATES,)
        What the filter takes it for: spectral density of the noise that drives each state, SI squared per second,
    variance : float, (m/s)^2
        and variance of each component of the master's velocity.
    constants : ndarray, shape (8,)
        `sagnac.earth.ELLIPSOID`, Earth rate (rad/s), excess of the real gravity over the normal one (m/s^2).
    nis : ndarray, shape (LANES,)
        Squared innovations over their variances are added to it, two an interval.
    """
    n = steps.size // velocities.shape[0]
    samples, aims, pushed = np.empty(n * SAMPLE * LANES), np.empty(n * LANES), np.empty(3 * LANES)
    motion, x, seen, north = np.zeros(MOTION * LANES), np.empty(_ROW), np.empty(4 * LANES), np.empty(3 * LANES)
    first, room, noise = np.empty(ADVANCE_ROOM * LANES), np.empty(2 * FILTER_ROOM * LANES), np.zeros(STATES)
    for k in range(velocities.shape[0]):
        begin = k * n
        own = steps[begin : begin + n]
        time = own.sum()
        for j in range(n):
            for i in range(LANES):
                aims[j * LANES + i] = heights[begin + j]
        _half(state, motion, 0.0)
        pushed[:] = 0.0
        _feel(turns, pushes, own, begin, mounting, biases, drawn, generator, samples)
        advance(state, samples, own, True, aims, constants, pushed, first)
        _walk(biases, time, drawn, generator, samples)
        _half(state, motion, 1.0)
        _moved(state, pushed, time, geographic, motion, north)
        normals(generator, seen, 0)
        _difference(state, north, velocities[k, 0], velocities[k, 1], drawn[4], geographic, seen)
        for j in range(STATES):
            noise[j] = time * driving[j]
        x[:] = 0.0
        step(P, x, motion, seen, time, constants[6], constants, geographic, noise, variance, nis, room)
        _take_out(state, biases, x, north, geographic)
        turn_covariance(P, x)
