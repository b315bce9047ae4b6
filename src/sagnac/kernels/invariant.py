"""Attitude and velocity in inertial axes from increments, with the left-invariant error: batch and filter."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from .rotation import exponential

_UPRIGHT = np.eye(3)
"""Axes that do not turn."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def logarithm(r, out):  # type: ignore[no-untyped-def]
    """Rotation vector of a matrix; within 1e-7 rad of half a turn its direction is lost in rounding, its length is not."""
    out[0] = 0.5 * (r[2, 1] - r[1, 2])
    out[1] = 0.5 * (r[0, 2] - r[2, 0])
    out[2] = 0.5 * (r[1, 0] - r[0, 1])
    sine = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    if sine > 1e-12:
        scale = math.atan2(sine, 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0)) / sine
        for i in range(3):
            out[i] *= scale


@nb.njit(cache=True, nogil=True, error_model="numpy")
def times(a, b):  # type: ignore[no-untyped-def]
    """``a b`` of 3x3 matrices."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def times_t(a, b):  # type: ignore[no-untyped-def]
    """``a b'``."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def carry(turn, push, columns):  # type: ignore[no-untyped-def]
    """Columns of (xi, zeta) over one interval: ``xi = Q' xi, zeta = Q' (zeta - D x xi)``. Nothing here knows the estimate."""
    d0, d1, d2 = push[0], push[1], push[2]
    for j in range(columns.shape[1]):
        x0, x1, x2 = columns[0, j], columns[1, j], columns[2, j]
        z0 = columns[3, j] - (d1 * x2 - d2 * x1)
        z1 = columns[4, j] - (d2 * x0 - d0 * x2)
        z2 = columns[5, j] - (d0 * x1 - d1 * x0)
        for i in range(3):
            columns[i, j] = turn[0, i] * x0 + turn[1, i] * x1 + turn[2, i] * x2
            columns[3 + i, j] = turn[0, i] * z0 + turn[1, i] * z1 + turn[2, i] * z2


@nb.njit(cache=True, nogil=True, error_model="numpy")
def turn_over(square):  # type: ignore[no-untyped-def]
    """Transposed in place."""
    for i in range(square.shape[0]):
        for j in range(i):
            square[i, j], square[j, i] = square[j, i], square[i, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spread(covariance, turn, push, gyro, accel):  # type: ignore[no-untyped-def]
    """Add what white noise of an interval (`gyro` rad^2, `accel` (m/s)^2 in all) leaves in (xi, zeta).

    The force of an interval is taken as steady: noise of the gyros reaches zeta through ``-[f x]`` for the rest of the interval.
    """
    d = np.empty(3)
    for i in range(3):
        d[i] = turn[0, i] * push[0] + turn[1, i] * push[1] + turn[2, i] * push[2]
    d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    for i in range(3):
        covariance[i, i] += gyro
        covariance[3 + i, 3 + i] += accel + gyro / 3.0 * d2
        for j in range(3):
            covariance[3 + i, 3 + j] -= gyro / 3.0 * d[i] * d[j]
    half = 0.5 * gyro
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # -[d x] / 2: d x e_j = -d_k e_i + ..., and its mirror image
        covariance[3 + i, j] += half * d[k]
        covariance[j, 3 + i] += half * d[k]
        covariance[3 + i, k] -= half * d[j]
        covariance[k, 3 + i] -= half * d[j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def intervals(turns, pushes, steps, last, gyro_bias, accel_bias):  # type: ignore[no-untyped-def]
    """Rotation and velocity gained over each interval, in the body axes at its start, and what biases do to them.

    Parameters
    ----------
    turns, pushes : ndarray, shape (n, 3), rad and m/s
        Of each sample, already corrected for what the rate and the force change within it.
    steps : ndarray, shape (n,), s
    last : ndarray of int, shape (m,)
        Interval k has the samples from ``last[k - 1]`` (0 for the first) up to, not with, ``last[k]``.
    gyro_bias, accel_bias : ndarray, shape (3,), rad/s and m/s^2
        Taken off.

    Returns
    -------
    turn : ndarray, shape (m, 3, 3)
        Q: body coordinates at the end to those at the start.
    push : ndarray, shape (m, 3), m/s
        D.
    slopes : ndarray, shape (m, 3, 3, 3)
        At the end of the interval, in body axes there: xi for the gyros' biases, zeta for the gyros' and zeta for the
        accelerometers'. A bias larger than the one taken off, by b, leaves ``xi = slopes[0] b``.
    """
    m = last.size
    turn, push, slopes = np.empty((m, 3, 3)), np.empty((m, 3)), np.empty((m, 3, 3, 3))
    q, left, d = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    columns = np.empty((6, 6))
    begin = 0
    for k in range(m):
        r, total = np.eye(3), np.zeros(3)
        columns[:] = 0.0
        for s in range(begin, last[k]):
            dt = steps[s]
            p0 = pushes[s, 0] - accel_bias[0] * dt
            p1 = pushes[s, 1] - accel_bias[1] * dt
            p2 = pushes[s, 2] - accel_bias[2] * dt
            a0 = turns[s, 0] - gyro_bias[0] * dt
            a1 = turns[s, 1] - gyro_bias[1] * dt
            a2 = turns[s, 2] - gyro_bias[2] * dt
            exponential(a0, a1, a2, q, left)
            for i in range(3):
                d[i] = left[i, 0] * p0 + left[i, 1] * p1 + left[i, 2] * p2
            for i in range(3):
                total[i] += r[i, 0] * d[0] + r[i, 1] * d[1] + r[i, 2] * d[2]
            carry(q, d, columns)
            # the right Jacobian is the left one transposed
            for i in range(3):
                for j in range(3):
                    columns[i, j] -= dt * left[j, i]
                    columns[3 + i, 3 + j] -= dt * left[j, i]
            # a bias turns the axes on the way: zeta = dt ([p x] / 2 - ([a x][p x] + [p x][a x]) / 6) b, to second order
            sixth, along = dt / 6.0, dt / 3.0 * (a0 * p0 + a1 * p1 + a2 * p2)
            columns[3, 0] += along - 2.0 * sixth * a0 * p0
            columns[4, 1] += along - 2.0 * sixth * a1 * p1
            columns[5, 2] += along - 2.0 * sixth * a2 * p2
            x, y, z = a1 * p2 + a2 * p1, a2 * p0 + a0 * p2, a0 * p1 + a1 * p0
            columns[3, 1] -= sixth * (3.0 * p2 + z)
            columns[3, 2] += sixth * (3.0 * p1 - y)
            columns[4, 0] += sixth * (3.0 * p2 - z)
            columns[4, 2] -= sixth * (3.0 * p0 + x)
            columns[5, 0] -= sixth * (3.0 * p1 + y)
            columns[5, 1] += sixth * (3.0 * p0 - x)
            r[:] = times(r, q)
        turn[k], push[k] = r, total
        for i in range(3):
            for j in range(3):
                slopes[k, 0, i, j] = columns[i, j]
                slopes[k, 1, i, j] = columns[3 + i, j]
                slopes[k, 2, i, j] = columns[3 + i, 3 + j]
        begin = last[k]
    return turn, push, slopes


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _whiten(row, seen, columns, walk, size, variance, gain):  # type: ignore[no-untyped-def]
    """One scalar reading through the filter of the noise that has gathered: `seen` in, whitened `seen` out.

    `row` (6,) on (xi, zeta) is what the reading sees; ``columns[:, size:]`` the filter's means, one for each entry of `seen`, and
    `walk` their covariance. Returns which share of the reading's variance is what has gathered.
    """
    total = variance
    for i in range(6):
        gain[i] = 0.0
        for j in range(6):
            gain[i] += walk[i, j] * row[j]
    for i in range(6):
        total += row[i] * gain[i]
    scale = 1.0 / total
    root = math.sqrt(scale)
    for c in range(seen.size):
        v = seen[c]
        for i in range(6):
            v -= row[i] * columns[i, size + c]
        for i in range(6):
            columns[i, size + c] += gain[i] * scale * v
        seen[c] = v * root
    for i in range(6):
        for j in range(6):
            walk[i, j] -= gain[i] * scale * gain[j]
    return 1.0 - variance * scale


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _gather(seen, size, normal):  # type: ignore[no-untyped-def]
    """Add a whitened reading to the normal equations; the residual is the last row and column."""
    for i in range(size + 1):
        for j in range(i, size + 1):
            normal[i, j] += seen[i] * seen[j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def arm_slopes(rate, arm, attitude, earth, w, offset, slope):  # type: ignore[no-untyped-def]
    """Rate over the Earth ``w = rate - R' w_ie``, velocity about the master ``w x l``, and its derivative ``[w x][l x]``.

    All of the slave, in its axes. The derivative is to a turn of the mounting, ``M exp([eta x])`` with ``l = M' arm``.
    """
    for i in range(3):
        w[i] = rate[i] - (attitude[0, i] * earth[0] + attitude[1, i] * earth[1] + attitude[2, i] * earth[2])
    dot = w[0] * arm[0] + w[1] * arm[1] + w[2] * arm[2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        offset[i] = w[j] * arm[k] - w[k] * arm[j]
        for c in range(3):
            slope[i, c] = arm[i] * w[c]
        slope[i, i] -= dot


@nb.njit(cache=True, nogil=True, error_model="numpy")
def apply(matrix, vector, out):  # type: ignore[no-untyped-def]
    """``out = matrix vector``; `out` is not `vector`."""
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _advance(attitude, velocity, turn, push, slopes, columns, gained):  # type: ignore[no-untyped-def]
    """Run and the columns of its errors over one interval, all in inertial axes; `gained` is the velocity of the interval."""
    apply(attitude, push, gained)
    velocity += gained
    attitude[:] = times(attitude, turn)
    carry(_UPRIGHT, gained, columns)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                columns[i, 6 + j] += attitude[i, k] * slopes[0, k, j]
                columns[3 + i, 6 + j] += attitude[i, k] * slopes[1, k, j]
                columns[3 + i, 9 + j] += attitude[i, k] * slopes[2, k, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _see_attitude(  # type: ignore[no-untyped-def]
    attitude, mounting, reading, rate, delay, variance, size, columns, walk, normal
):
    """A reading of the master's attitude: ``Log(A M R')`` is what the slave turned too little, less the mounting's own error."""
    row, gain, seen = np.zeros(6), np.empty(6), np.empty(size + 1)
    left, turning, share = np.empty(3), np.empty(3), 0.0
    apply(attitude, rate, turning)
    logarithm(times_t(times(reading, mounting), attitude), left)
    for i in range(3):
        row[:] = 0.0
        row[i] = 1.0
        for c in range(size):
            seen[c] = columns[i, c]
        seen[15] -= turning[i]
        for c in range(3):
            seen[16 + c] -= attitude[i, c]
        seen[size] = left[i] + delay * turning[i]
        part = _whiten(row, seen, columns, walk, size, variance, gain)
        share += part if i < 2 else 0.0
        _gather(seen, size, normal)
    return share


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _see_velocity(  # type: ignore[no-untyped-def]
    attitude, mounting, left, axes, rate, gain_of_speed, earth, arm, delay, variances, size, columns, walk, normal
):
    """A reading of the master's velocity, `left` of it by the run; the slave's own arm makes ``R (w x M' l)`` more of it."""
    row, gain, seen = np.empty(6), np.empty(6), np.empty(size + 1)
    body_arm, w, body, offset, slope = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    apply(mounting.T, arm, body_arm)
    arm_slopes(rate, body_arm, attitude, earth, w, body, slope)
    apply(attitude, body, offset)
    slope = times(attitude, slope)
    across = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    across = times(attitude, times_t(across, mounting))
    tie = 16 if size > 16 else 0  # where a turn of the mounting stands
    share = 0.0
    for e in range(3):
        if not math.isfinite(variances[e]):
            continue
        seen[size] = delay * gain_of_speed[e]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            row[3 + i] = axes[i, e]
            row[i] = axes[j, e] * offset[k] - axes[k, e] * offset[j]  # a turn of the slave turns its arm: offset x phi
            seen[size] += axes[i, e] * (left[i] + offset[i])
        for c in range(size):
            seen[c] = 0.0
            for i in range(6):
                seen[c] += row[i] * columns[i, c]
        seen[15] -= gain_of_speed[e]
        for c in range(3):
            for i in range(3):
                seen[tie + c] -= axes[i, e] * slope[i, c]
                seen[12 + c] -= axes[i, e] * across[i, c]
        part = _whiten(row, seen, columns, walk, size, variances[e], gain)
        share += part if e < 2 else 0.0
        _gather(seen, size, normal)
    return share


@nb.njit(cache=True, nogil=True, error_model="numpy")
def normal_equations(  # type: ignore[no-untyped-def]
    turn,
    push,
    slopes,
    gathered,
    series,
    axes,
    rates,
    gains,
    attitudes,
    earth,
    noise,
    attitude,
    velocity,
    arm,
    delay,
    mounting,
):
    """Sum of squares of the whitened residuals of a run that knows no noise, with its Gauss-Newton normal equations.

    The run starts at `attitude` and `velocity` and never looks at the readings. White noise of the sensors gathers in it and
    correlates the readings; a filter of that noise alone (its covariance starts at nothing) whitens the residuals and each
    column of their derivative with the same gains (Durbin & Koopman, *Time Series Analysis by State Space Methods*, 6.2.4).
    The left-invariant errors of the run are written in inertial axes, ``R^ xi`` and ``R^ zeta``.

    Parameters
    ----------
    turn, push, slopes : ndarray
        From :func:`intervals`, m of each.
    gathered : ndarray, shape (m, 2), rad^2 and (m/s)^2
        Variance that the white noise of gyros and accelerometers gathers over each interval, on each axis.
    series : ndarray, shape (m, 3), m/s
        Master's velocity in inertial axes less all that gravitation and Earth rate do, at the end of each interval.
    axes : ndarray, shape (m, 3, 3)
        East, north, up to inertial axes, there.
    rates : ndarray, shape (m + 1, 3), rad/s
        Of the slave against inertial space, in its axes, at the start and there.
    gains : ndarray, shape (m, 3), m/s^2
        Derivative of the master's velocity, east, north, up, at the end of each interval.
    attitudes : ndarray, shape (m + 1, 3, 3) or (0, 3, 3)
        Of the master against the inertial axes, at the start and at the end of each interval.
    earth : ndarray, shape (3,), rad/s
        Earth rate in inertial axes.
    noise : ndarray, shape (4,), (m/s)^2 and rad^2
        Variances of the velocity east, north, up (infinite: not used) and of the attitude.
    attitude, velocity : ndarray, shape (3, 3) and (3,)
        Start of the run, in inertial axes.
    arm : ndarray, shape (3,), m
        From the master to the slave, in the master's axes.
    delay : float, s
        How much earlier than said the master's readings were true.
    mounting : ndarray, shape (3, 3)
        Slave to master coordinates.

    Returns
    -------
    normal : ndarray, shape (p + 1, p + 1)
        ``[J r]' [J r]``, symmetric, residual = r - J parameters. Parameters: turn of the start in its own axes, velocity,
        biases of gyros and accelerometers, arm, delay, and with attitudes a turn of the mounting in the slave's axes; without
        them the mounting turns with the start.
    level : float
        How many level readings' worth of noise has gathered: the sum of its shares in their variances.
    """
    p = 19 if attitudes.shape[0] > 0 else 16
    normal = np.zeros((p + 1, p + 1))
    # parameters; means of the noise for each of them and for the residual
    columns, walk = np.zeros((6, 2 * p + 1)), np.zeros((6, 6))
    columns[:3, :3] = attitude
    columns[3:, 3:6] = np.eye(3)
    r, y, gained, level = attitude.copy(), velocity.copy(), np.empty(3), 0.0
    for k in range(gathered.shape[0] + 1):
        if k > 0:
            _advance(r, y, turn[k - 1], push[k - 1], slopes[k - 1], columns, gained)
            carry(_UPRIGHT, gained, walk)
            turn_over(walk)
            carry(_UPRIGHT, gained, walk)
            spread(walk, _UPRIGHT, gained, gathered[k - 1, 0], gathered[k - 1, 1])
        if p > 16:
            level += _see_attitude(r, mounting, attitudes[k], rates[k], delay, noise[3], p, columns, walk, normal)
        if k > 0:
            left, n = series[k - 1] - y, axes[k - 1]
            level += _see_velocity(
                r, mounting, left, n, rates[k], gains[k - 1], earth, arm, delay, noise, p, columns, walk, normal
            )
    for i in range(p + 1):
        for j in range(i):
            normal[i, j] = normal[j, i]
    return normal, level
