"""Passes over samples in the cache: stretches under a window, their power, samples at a quarter of the rate, and blocks.

What the spectrum and the blocks of a noise test are made of. Sums may be made in any order, side by side, so that the compiler
makes vector instructions of them; each is over a few thousand numbers, less a value close to them.
"""

from __future__ import annotations

import numba as nb
import numpy as np

_SUMS = {"reassoc", "contract", "nsz"}


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def window_stretches(values, hop, window, trend, out):  # type: ignore[no-untyped-def]
    """Stretches of samples, each less its mean or its trend, under a window.

    Parameters
    ----------
    values : ndarray, shape (n,)
    hop : int
        Samples from the start of one stretch to that of the next.
    window : ndarray, shape (length,)
    trend : bool
        Whether the trend is taken out, else the mean alone.
    out : ndarray, shape (count, length)
        Filled.
    """
    length = window.size
    middle = 0.5 * (length - 1)
    spread = length * (length * length - 1.0) / 12.0  # sum of the squared times from the middle
    for s in range(out.shape[0]):
        x = values[s * hop : s * hop + length]
        mean = 0.0
        for i in range(length):
            mean += x[i]
        mean /= length
        if trend:
            slope = 0.0
            for i in range(length):
                slope += (x[i] - mean) * (i - middle)
            slope /= spread
            for i in range(length):
                out[s, i] = (x[i] - mean - slope * (i - middle)) * window[i]
        else:
            for i in range(length):
                out[s, i] = (x[i] - mean) * window[i]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def add_power(found, power):  # type: ignore[no-untyped-def]
    """Add the squared magnitudes of transforms.

    Parameters
    ----------
    found : ndarray of float, shape (count, 2 bins)
        Real and imaginary parts, side by side.
    power : ndarray, shape (bins,)
        Added to.
    """
    for s in range(found.shape[0]):
        x = found[s]
        for i in range(power.size):
            power[i] += x[2 * i] * x[2 * i] + x[2 * i + 1] * x[2 * i + 1]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def filter_quarter(values, taps, out):  # type: ignore[no-untyped-def]
    """Every fourth of the filtered samples, ``out[j] = sum(taps * values[4 j : 4 j + taps.size])``."""
    for j in range(out.size):
        x = values[4 * j : 4 * j + taps.size]
        total = 0.0
        for i in range(taps.size):
            total += taps[i] * x[i]
        out[j] = total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def block_sums(values, before, out):  # type: ignore[no-untyped-def]
    """Mean, scatter and steps of blocks of samples.

    Parameters
    ----------
    values : ndarray, shape (blocks, size)
    before : float
        Sample before the first.
    out : ndarray, shape (blocks, 3)
        Filled: mean, sum of the squared departures from it, and mean square of the steps from the sample before.
    """
    blocks, size = values.shape
    for b in range(blocks):
        x = values[b]
        first = x[0]
        step = first - before
        total, steps = 0.0, 0.0
        for i in range(size):
            total += x[i] - first
        for i in range(1, size):
            d = x[i] - x[i - 1]
            steps += d * d
        mean = total / size
        scatter = 0.0
        for i in range(size):
            d = (x[i] - first) - mean
            scatter += d * d
        out[b, 0], out[b, 1], out[b, 2] = first + mean, scatter, (steps + step * step) / size
        before = x[size - 1]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def steps_between(values, rounding, out):  # type: ignore[no-untyped-def]
    """Sizes of the steps from sample to sample, infinite where neighbours are equal.

    Parameters
    ----------
    values : ndarray, shape (n,)
    rounding : float
        Steps up to here are none.
    out : ndarray, shape (n - 1,)
        Filled.

    Returns
    -------
    int
        Neighbours that are equal.
    """
    equal = 0
    for i in range(out.size):
        step = abs(values[i + 1] - values[i])
        equal += step <= rounding
        out[i] = step if step > rounding else np.inf
    return equal


@nb.njit(cache=True, nogil=True, error_model="numpy")
def count_equal(values, value):  # type: ignore[no-untyped-def]
    """How many samples are this value."""
    number = 0
    for i in range(values.size):
        number += values[i] == value
    return number


@nb.njit(cache=True, nogil=True, error_model="numpy")
def follow_runs(values, time, before, rounding, run, ended):  # type: ignore[no-untyped-def]
    """Runs of samples that equal the one before: the longest, and how many there are of each length.

    Parameters
    ----------
    values, time : ndarray, shape (n,)
    before : float
        Sample before the first.
    rounding : float
        Steps up to here are none.
    run : ndarray, shape (4,)
        Followed on: samples in the run that goes on, time of the sample that it repeats, and both of the longest.
    ended : ndarray of int, shape (k,)
        Counted on: runs of 2^j to 2^(j + 1) - 1 samples that have ended; the last counts longer ones too.
    """
    for i in range(values.size):
        if abs(values[i] - before) <= rounding:
            run[0] += 1.0
            if run[0] > run[2]:
                run[2], run[3] = run[0], run[1]
        else:
            if run[0] > 0.0:
                j, size = 0, int(run[0])
                while size > 1 and j < ended.size - 1:
                    size >>= 1
                    j += 1
                ended[j] += 1
            run[0], run[1] = 0.0, time[i]
            before = values[i]
