"""Transfer alignment as one problem of least squares, for mountings of any size: start values and solution.

The problem is that of :mod:`sagnac.align.large.model`. Residuals are whitened for the noise that gathers in the slave's run
(:func:`sagnac.kernels.invariant.normal_equations`), and the maximum of the posterior is found by Gauss-Newton and Newton steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...frames import Array, left_jacobian, rotation_matrix, rotation_vector, wahba
from .model import Problem

_LONGEST_STEP = 1.0
"""rad: the longest step of an iteration."""
_SETTLED = 0.01
"""Standard uncertainties: a step shorter than this is the last one."""
_STEPS = 30
"""At most."""


class _State(NamedTuple):
    """Cost at a point, information, half the slope downwards, and the noise in level readings' worth."""

    cost: float
    normal: Array
    slope: Array
    level: float


class Point(NamedTuple):
    """Unknowns of the problem: attitude at the start, velocity there (both in i), biases, lever arm, delay, mounting."""

    attitude: Array
    velocity: Array
    gyro: Array
    accel: Array
    arm: Array
    delay: float
    mounting: Array


@dataclass(frozen=True)
class Fit:
    """A minimum, or where the iteration gave up.

    Attributes
    ----------
    point : Point
    cost : float
        Sum of squares of whitened residuals and priors.
    normal : ndarray, shape (p, p)
        Information: rotation of the start, velocity, biases, arm, delay, and with attitudes the mounting's turn.
    covariance : ndarray, shape (3, 3), rad^2
        Of the mounting's turn in the slave's axes, see :func:`_spread`.
    settled : bool
    steps : int
    """

    point: Point
    cost: float
    normal: Array
    covariance: Array
    settled: bool
    steps: int

    @property
    def evidence(self) -> float:
        """Logarithm of the posterior's mass about this minimum, up to a constant."""
        return float(-0.5 * self.cost - 0.5 * np.linalg.slogdet(self.normal)[1])


def centre(problem: Problem) -> Point:
    """The middle of what is known beforehand: no mounting, no biases."""
    zero = np.zeros(3)
    return Point(problem.master, problem.velocity, zero, zero, problem.arm, 0.0, np.eye(3))


def by_vectors(problem: Problem) -> Point:
    """Closed form without biases and priors: the rotation that best takes the slave's velocities to the master's (Wahba).

    Less their means, which takes out the velocity at the start: the maximum of the likelihood where nothing but white noise of
    the master's velocity is in the way. With attitudes, rotations over a quarter of the time are vectors as well, the same
    ones in both axes.
    """
    from ...kernels.invariant import intervals

    zero = np.zeros(3)
    turn, push, _ = intervals(problem.turns, problem.pushes, problem.steps, problem.last, zero, zero)
    attitude, velocity = np.empty((problem.last.size + 1, 3, 3)), np.zeros((problem.last.size + 1, 3))
    attitude[0] = np.eye(3)
    for k in range(problem.last.size):
        velocity[k + 1] = velocity[k] + attitude[k] @ push[k]
        attitude[k + 1] = attitude[k] @ turn[k]
    here = velocity[1:] - velocity[1:].mean(axis=0)
    there = (problem.series - problem.series.mean(axis=0)) @ problem.master
    if problem.matched:
        lag = max(1, problem.last.size // 4)
        weight = np.sqrt(problem.noise[0] / problem.noise[3] / 2.0)
        own, base = (_turned(a, lag) for a in (attitude, problem.master.T @ problem.attitudes))
        here, there = np.vstack([here, weight * own]), np.vstack([there, weight * base])
    mounting = wahba(here, there)
    return Point(problem.master @ mounting, problem.velocity, zero, zero, problem.arm, 0.0, mounting)


def _turned(attitude: Array, lag: int) -> Array:
    """Rotations over `lag` steps in the axes of the start, of those that are well below half a turn."""
    later, earlier = attitude[lag:], attitude[:-lag]
    vectors = rotation_vector(later @ np.swapaxes(earlier, -1, -2))
    return np.asarray(vectors * (np.linalg.norm(vectors, axis=1) < 2.5)[:, None])


def by_filter(problem: Problem) -> Point:
    """End of a left-invariant filter that starts with no mounting, carried back to the start."""
    from ...kernels.invariant import intervals
    from ...kernels.left_invariant import left_invariant

    zero, point = np.zeros(3), centre(problem)
    pieces = intervals(problem.turns, problem.pushes, problem.steps, problem.last, zero, zero)
    sigma2 = problem.sigma[:12] ** 2
    spread = np.diag(np.concatenate([sigma2, sigma2[:3] if problem.matched else []]))
    if problem.matched:
        # the slave's attitude is the mounting on the master's true attitude, which the master's first sample shows
        spread[:3, :3] += problem.noise[3] * np.eye(3)
        spread[:3, 12:] = spread[12:, :3] = spread[12:, 12:]
    p = problem
    readings = p.gathered, p.series, p.axes, p.rates, p.attitudes, p.earth, p.arm, p.noise
    kernel: Callable[..., Any] = left_invariant
    attitude, bias, mounting = kernel(*pieces, *readings, point.attitude, point.velocity, point.mounting, spread)
    return Point(attitude, point.velocity, bias[:3], bias[3:], problem.arm, 0.0, mounting)


def descend(problem: Problem, point: Point) -> Fit:
    """Gauss-Newton from a point down to the maximum of the posterior, steps halved where the cost would rise.

    Parameters
    ----------
    problem : Problem
    point : Point
    """
    state = _evaluate(problem, point)
    used, moved = 0, np.inf
    while moved >= _SETTLED**2 and used < _STEPS:
        used += 1
        step = _scaled(np.linalg.solve, state.normal, state.slope)
        turn = step[16:] if problem.matched else step[:3]
        fraction = min(1.0, _LONGEST_STEP / max(float(np.linalg.norm(step[:3])), float(np.linalg.norm(turn)), 1e-300))
        moved = float(turn @ np.linalg.solve(_spread(problem, point, state), turn))
        for _ in range(12):
            trial = _moved(problem, point, fraction * step)
            found = _evaluate(problem, trial)
            if found.cost <= state.cost * (1.0 + 1e-9):
                point, state = trial, found
                break
            fraction /= 2.0
    return Fit(point, state.cost, state.normal, _spread(problem, point, state), moved < _SETTLED**2, used)


def _spread(problem: Problem, point: Point, state: _State) -> Array:
    """Covariance of the mounting's turn in the slave's axes, (3, 3), rad^2.

    That of the normal equations, but for the azimuth. There they take noise for a manoeuvre: what has gathered in the run turns
    with the azimuth, and its derivative looks like information, one unit for each reading's worth of it (`level`), while a
    true turn about the vertical changes nothing. After 300 s of a small tactical unit on a straight course that makes 7 deg of
    an azimuth of which nothing is known. The unit is taken off, as in least squares with errors in both variables, and what
    is left is not believed to be worse than what was known beforehand: sigma about no mounting.
    """
    inverse = _scaled(np.linalg.inv, state.normal)
    where = slice(16, 19) if problem.matched else slice(0, 3)
    covariance = 0.5 * (inverse + inverse.T)[where, where]
    up = point.attitude[2]
    vector = rotation_vector(point.mounting)
    seen, right = 1.0 / (up @ covariance @ up), left_jacobian(vector).T
    beforehand = up @ (right * problem.sigma[:3] ** 2) @ right.T @ up + (up @ vector) ** 2
    left = seen - state.level
    variance = max(min(seen / left**2, beforehand) if left > 0.0 else beforehand, 1.0 / seen)
    along = covariance @ up * seen
    return np.asarray(covariance + (variance - 1.0 / seen) * np.outer(along, along))


def _scaled(function: Callable[..., Array], normal: Array, *slope: Array) -> Array:
    """Inverse or solution of normal equations, unknowns scaled to the same size."""
    scale = 1.0 / np.sqrt(np.diag(normal))
    found = function(normal * scale * scale[:, None], *(scale * v for v in slope))
    return np.asarray(scale[:, None] * found * scale if found.ndim == 2 else scale * found)


def _evaluate(problem: Problem, point: Point) -> _State:
    from ...kernels.invariant import intervals, normal_equations

    p = problem
    pieces = intervals(p.turns, p.pushes, p.steps, p.last, point.gyro, point.accel)
    readings = p.gathered, p.series, p.axes, p.rates, p.gains, p.attitudes, p.earth, p.noise
    kernel: Callable[..., Any] = normal_equations
    whole, level = kernel(*pieces, *readings, point.attitude, point.velocity, point.arm, point.delay, point.mounting)
    normal, slope, cost = whole[:-1, :-1], whole[:-1, -1], float(whole[-1, -1])
    angle = rotation_vector(point.mounting)
    known = [angle, point.velocity - p.velocity, point.gyro, point.accel, point.arm - p.arm, np.array([point.delay])]
    left = -np.concatenate(known) / p.sigma
    rows = np.zeros((16, slope.size))
    rows[3:, 3:16] = np.diag(1.0 / p.sigma[3:])
    rows[:3, -3 if p.matched else 0 :][:, :3] = np.linalg.inv(left_jacobian(angle).T) / p.sigma[:3, None]
    return _State(cost + float(left @ left), normal + rows.T @ rows, slope + rows.T @ left, float(level))


def _moved(problem: Problem, point: Point, step: Array) -> Point:
    attitude = point.attitude @ rotation_matrix(step[:3])
    mounting = point.mounting @ rotation_matrix(step[16:]) if problem.matched else problem.master.T @ attitude
    return Point(
        attitude,
        point.velocity + step[3:6],
        point.gyro + step[6:9],
        point.accel + step[9:12],
        point.arm + step[12:15],
        point.delay + float(step[15]),
        mounting,
    )
