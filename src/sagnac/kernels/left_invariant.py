"""Left-invariant extended Kalman filter of attitude and velocity in inertial axes, with biases."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from .invariant import apply, arm_slopes, carry, logarithm, spread, times, times_t, turn_over
from .kalman import take
from .rotation import exponential


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _correct(error, attitude, velocity):  # type: ignore[no-untyped-def]
    """State corrected along the group: ``y = y + R Jl(xi) zeta, R = R exp([xi x])``."""
    turn, left = np.empty((3, 3)), np.empty((3, 3))
    exponential(error[0], error[1], error[2], turn, left)
    left = times(attitude, left)
    for i in range(3):
        velocity[i] += left[i, 0] * error[3] + left[i, 1] * error[4] + left[i, 2] * error[5]
    attitude[:] = times(attitude, turn)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _flow(turn, push, slope, square):  # type: ignore[no-untyped-def]
    """``F square`` for all states (xi, zeta, gyro bias, accelerometer bias, ...)."""
    carry(turn, push, square)
    for c in range(square.shape[1]):
        for i in range(3):
            for j in range(3):
                square[i, c] += slope[0, i, j] * square[6 + j, c]
                square[3 + i, c] += slope[1, i, j] * square[6 + j, c] + slope[2, i, j] * square[9 + j, c]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _predict(turn, push, slopes, bias, gathered, attitude, velocity, back, covariance):  # type: ignore[no-untyped-def]
    """One interval of the filter; `back` takes coordinates now to those of the start."""
    shift, nothing = np.zeros(6), np.zeros(3)
    for i in range(3):
        for j in range(3):
            velocity[i] += attitude[i, j] * push[j]
            shift[i] += slopes[0, i, j] * bias[j]
            shift[3 + i] += slopes[1, i, j] * bias[j] + slopes[2, i, j] * bias[3 + j]
    attitude[:] = times(attitude, turn)
    back[:] = times(back, turn)
    _correct(shift, attitude, velocity)
    _correct(shift, back, nothing)
    _flow(turn, push, slopes, covariance)
    turn_over(covariance)
    _flow(turn, push, slopes, covariance)
    spread(covariance, turn, push, gathered[0], gathered[1])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _take_velocity(  # type: ignore[no-untyped-def]
    left, axes, rate, arm, earth, variances, attitude, back, covariance, error
):
    """A reading of the master's velocity, `left` of it by the state; without attitudes the mounting turns with the start."""
    n = error.size
    row, gain, w, offset, slope = np.zeros(n), np.empty(n), np.empty(3), np.empty(3), np.empty((3, 3))
    arm_slopes(rate, arm, attitude, earth, w, offset, slope)
    view = times(axes.T, attitude)
    at = 12 if n > 12 else 0
    slope = times(view, slope if n > 12 else times(slope, back))
    for e in range(3):
        if not math.isfinite(variances[e]):
            continue
        value = 0.0
        row[:] = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            row[3 + i] = view[e, i]
            row[i] = view[e, j] * offset[k] - view[e, k] * offset[j]
            value += axes[i, e] * left[i] + view[e, i] * offset[i]
        for i in range(3):
            row[at + i] -= slope[e, i]
        take(error, covariance, row, variances[e], value, gain)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def left_invariant(  # type: ignore[no-untyped-def]
    turn,
    push,
    slopes,
    gathered,
    series,
    axes,
    rates,
    attitudes,
    earth,
    arm,
    noise,
    attitude,
    velocity,
    mounting,
    covariance,
):
    """Left-invariant extended Kalman filter with feedback over the readings of :func:`sagnac.kernels.invariant.normal_equations`.

    Barrau & Bonnabel 2017 (IEEE TAC 62, 1797), with the biases beside the group ("imperfect" form): the error of attitude and
    velocity propagates linearly whatever the estimate is, and a correction moves the state along the group.

    Parameters
    ----------
    turn, ..., mounting
        See :func:`sagnac.kernels.invariant.normal_equations`; the intervals are those with no bias taken off.
    covariance : ndarray, shape (n, n)
        Of (xi, zeta, gyro bias, accelerometer bias, and with attitudes the mounting's turn) at the start, xi and zeta in the
        slave's axes. Overwritten with that at the end.

    Returns
    -------
    start : ndarray, shape (3, 3)
        Attitude at the start: that at the end carried back with the turns and the estimated bias.
    biases : ndarray, shape (6,)
        Of gyros and accelerometers.
    mounting : ndarray, shape (3, 3)
    """
    matched = attitudes.shape[0] > 0
    n = covariance.shape[0]
    r, y, m0, bias, back = attitude.copy(), velocity.copy(), mounting.copy(), np.zeros(6), np.eye(3)
    error, row, gain, seen, body_arm = np.zeros(n), np.zeros(n), np.empty(n), np.empty(3), np.empty(3)
    turned, left = np.empty((3, 3)), np.empty((3, 3))
    for k in range(gathered.shape[0] + 1):
        if k > 0:
            _predict(turn[k - 1], push[k - 1], slopes[k - 1], bias, gathered[k - 1], r, y, back, covariance)
        error[:] = 0.0
        if matched:
            logarithm(times(times(r.T, attitudes[k]), m0), seen)
            for i in range(3):
                row[:] = 0.0
                row[i], row[12 + i] = 1.0, -1.0
                take(error, covariance, row, noise[3], seen[i], gain)
        if k > 0:
            apply(m0.T, arm, body_arm)
            left_over = series[k - 1] - y
            _take_velocity(left_over, axes[k - 1], rates[k], body_arm, earth, noise, r, back, covariance, error)
        _correct(error, r, y)
        for i in range(6):
            bias[i] += error[6 + i]
        if matched:
            exponential(error[12], error[13], error[14], turned, left)
            m0[:] = times(m0, turned)
        else:
            # what the master said of its attitude at the start stands, and the mounting is the slave's attitude against it
            m0[:] = times(mounting, times(attitude.T, times_t(r, back)))
    return times_t(r, back), bias, m0
