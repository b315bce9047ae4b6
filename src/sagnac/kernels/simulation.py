"""Recursions of the simulator: a table in motion, slowly wandering biases, pulse counters."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _into(v, axis, c, s):  # type: ignore[no-untyped-def]
    """Coordinates of `v` in a frame turned about `axis` by the angle with cosine `c` and sine `s`, in place."""
    i = (axis + 1) % 3
    j = (axis + 2) % 3
    a = c * v[i] + s * v[j]
    v[j] = c * v[j] - s * v[i]
    v[i] = a


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _crossed(m, v, w):  # type: ignore[no-untyped-def]
    """``v = m v``, with `w` as room to work in."""
    for i in range(3):
        w[i] = m[i, 0] * v[0] + m[i, 1] * v[1] + m[i, 2] * v[2]
    for i in range(3):
        v[i] = w[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def table_inputs(time, starts, cubics, axes, up, earth, links, lever, force, rate):  # type: ignore[no-untyped-def]
    """Specific force and angular rate of the case of a table that follows cubics in time.

    Parameters
    ----------
    time : ndarray, shape (n,), s, increasing
    starts : ndarray, shape (p,), s
        Where each piece of the motion begins; the first holds before that too.
    cubics : ndarray, shape (p, 4, 3), rad, rad/s, ...
        Angles of the three axes as polynomials in the time since the start of the piece, constant term first.
    axes : ndarray of int, shape (3,)
        What the axes turn about: 0, 1, 2 for x, y, z.
    up, earth : ndarray, shape (3,), m/s^2 and rad/s
        Specific force of the table at rest and Earth rate in the frame that carries the first axis.
    links : ndarray, shape (2, 3, 3)
        Take coordinates behind the first axis to those ahead of the second, and behind the second to ahead of the third.
    lever : ndarray, shape (3,), m
        From where the axes meet to the unit, in the case.
    force, rate : ndarray, shape (n, 3), m/s^2 and rad/s
        Filled.
    """
    piece = 0
    last = starts.size - 1
    swings = lever[0] != 0.0 or lever[1] != 0.0 or lever[2] != 0.0
    f, e, w, a, room = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    angle = np.full(3, np.nan)
    cosine, sine = np.empty(3), np.empty(3)
    for k in range(time.size):
        while piece < last and time[k] >= starts[piece + 1]:
            piece += 1
        t = time[k] - starts[piece]
        for i in range(3):
            f[i] = up[i]
            e[i] = earth[i]
            w[i] = 0.0
            a[i] = 0.0
        for place in range(3):
            c0, c1 = cubics[piece, 0, place], cubics[piece, 1, place]
            c2, c3 = cubics[piece, 2, place], cubics[piece, 3, place]
            now = c0 + t * (c1 + t * (c2 + t * c3))
            if now != angle[place]:
                angle[place] = now
                cosine[place] = math.cos(now)
                sine[place] = math.sin(now)
            if place > 0:
                _crossed(links[place - 1], f, room)
                _crossed(links[place - 1], e, room)
                _crossed(links[place - 1], w, room)
            axis, c, s = axes[place], cosine[place], sine[place]
            _into(f, axis, c, s)
            _into(e, axis, c, s)
            _into(w, axis, c, s)
            speed = c1 + t * (2.0 * c2 + t * 3.0 * c3)
            if swings:
                if place > 0:
                    _crossed(links[place - 1], a, room)
                _into(a, axis, c, s)
                # derivative of the turning frame's own share: (C' w) x (speed axis)
                i, j = (axis + 1) % 3, (axis + 2) % 3
                a[i] += w[j] * speed
                a[j] -= w[i] * speed
                a[axis] += 2.0 * c2 + 6.0 * c3 * t
            w[axis] += speed
        if swings:
            lw = lever[0] * w[0] + lever[1] * w[1] + lever[2] * w[2]
            ww = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                f[i] += a[j] * lever[m] - a[m] * lever[j] + w[i] * lw - lever[i] * ww
        for i in range(3):
            force[k, i] = f[i]
            rate[k, i] = e[i] + w[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def wander(state, decay, step, normals, values):  # type: ignore[no-untyped-def]
    """Add ``x_k = decay x_(k-1) + step z_k`` to `values` and return the last state.

    Parameters
    ----------
    state : float
        Before the first sample.
    decay, step : float
        A decay of one is a random walk.
    normals, values : ndarray, shape (n,)
    """
    for k in range(values.size):
        state = decay * state + step * normals[k]
        values[k] += state
    return state


@nb.njit(cache=True, nogil=True, error_model="numpy")
def count(residue, interval, per_second, values):  # type: ignore[no-untyped-def]
    """Turn `values` into whole pulses counted over each interval, the rest carried on, and return what is left over.

    Parameters
    ----------
    residue : float
        Part of a pulse left over before the first sample.
    interval : ndarray, shape (n,), s
    per_second : float
        Pulses in a second for each unit of the values.
    values : ndarray, shape (n,)
    """
    for k in range(values.size):
        residue += values[k] * interval[k] * per_second
        whole = math.floor(residue)
        residue -= whole
        values[k] = whole
    return residue
