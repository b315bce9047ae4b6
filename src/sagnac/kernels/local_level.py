"""Whitening of readings with white noise on top of a random walk: innovations of the local-level Kalman filter."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy")
def innovations(columns, steps, white, walk, variance, levels):  # type: ignore[no-untyped-def]
    """Innovations over their standard deviation, of every column with the same gains.

    The level, unknown at first, does a random walk; a reading is the level and white noise. The gains do not depend on the
    readings, so that the same recursion takes a linear model's columns to those of the whitened model (Durbin & Koopman,
    *Time Series Analysis by State Space Methods*, 2.3).

    Parameters
    ----------
    columns : ndarray, shape (k, n)
    steps : ndarray, shape (n,), s
        Time since the sample before.
    white : float
        Variance of a reading.
    walk : float
        Variance of the walk per second.
    variance : float
        Of the level after the sample before these; negative when nothing is known of it.
    levels : ndarray, shape (k,)
        After the sample before these; overwritten with those after the last one.

    Returns
    -------
    whitened : ndarray, shape (k, n)
        Zero where the level was not known.
    back : ndarray, shape (n,)
        A reading less `back` times its whitened innovation is the filtered reading.
    variance : float
        Of the level after the last sample.
    """
    k, n = columns.shape
    out = np.empty((k, n))
    gain, scale, back = np.empty(n), np.empty(n), np.empty(n)
    p = variance
    for i in range(n):
        if p < 0.0:
            gain[i], scale[i], back[i], p = 1.0, 0.0, 0.0, white
            continue
        p += walk * steps[i]
        s = p + white
        gain[i], scale[i] = p / s, 1.0 / math.sqrt(s)
        back[i] = white * scale[i]
        p = white * gain[i]
    for c in range(k):
        level = levels[c]
        for i in range(n):
            v = columns[c, i] - level
            level += gain[i] * v
            out[c, i] = v * scale[i]
        levels[c] = level
    return out, back, p
