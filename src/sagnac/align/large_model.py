"""Transfer alignment as one problem of least squares, for mountings of any size: its readings, its start values, its solution.

Inertial axes i stand still, east, north, up of the start. There the slave's attitude R and the velocity y that its own forces give it obey

    R' = R [w x],    y' = R f

with nothing but its own readings on the right, and what the master says is one series to compare y with,

    u(t) = N v - integral N (g - w_ie x v),

N from east, north, up to i. With ``R = R^ exp([xi x])`` and ``y = y^ + R^ zeta`` errors propagate by
``xi' = -w x xi - eps, zeta' = -w x zeta - f x xi - nab``, which knows the readings and not the estimate (Barrau & Bonnabel 2017, IEEE TAC
62, 1797: the left-invariant error of a group-affine system). The one nonlinear thing left is the rotation at the start, so that
the whole recording is one problem in it, in the velocity at the start and in the biases. The series is the velocity form of Wu & Pan 2013
(IEEE TAES 49, 1006).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..earth import normal_gravity
from ..frames import Array, cross, rotation_matrix, rotation_vector, wahba
from ..navigate import wander
from .filter import left_jacobian

if TYPE_CHECKING:
    from .config import Config
    from .master import Master
    from .samples import Slave

LOOSE_VERTICAL = 1.0
"""m/s: noise given to the master's vertical velocity where the alignment does not match it: it only tells up from down."""
_LONGEST_STEP = 1.0
"""rad: the longest step of an iteration."""
_SETTLED = 0.01
"""Standard uncertainties: a step shorter than this is the last one."""
_STEPS = (12, 12)
"""At most: Gauss-Newton, Newton."""
_State = tuple[float, Array, Array]
_PROBE = 0.1
"""Gauss-Newton standard uncertainties to look to either side for the curvature of the cost."""
_FLATTEST = 1e-4
"""Of the curvature that Gauss-Newton sees, the least that is believed."""
# what is known exactly would make the equations singular: rad, m/s, rad/s, m/s^2
_LEAST = np.repeat([1e-6, 1e-4, 1e-12, 1e-9], 3)


@dataclass(frozen=True)
class Problem:
    """Readings of both systems up to one time.

    Attributes
    ----------
    time : ndarray, shape (m + 1,), s
        The start, and the master's samples that are matched.
    turns, pushes, steps : ndarray, shape (n, 3), (n, 3), (n,)
        The slave's samples, corrected for coning and sculling and cut at those times.
    last : ndarray of int, shape (m,)
        First sample after each of them.
    gathered, series, axes, rates, attitudes : ndarray
        See :func:`sagnac.kernels.invariant.normal_equations`.
    noise, earth, arm : ndarray
        The same.
    master : ndarray, shape (3, 3)
        The master's attitude at the start, to east, north, up.
    velocity : ndarray, shape (3,), m/s
        Of the slave at the start, as far as the master tells.
    sigma : ndarray, shape (12,)
        Of mounting, velocity and biases, beforehand.
    """

    time: Array
    turns: Array
    pushes: Array
    steps: Array
    last: NDArray[np.int64]
    gathered: Array
    series: Array
    axes: Array
    rates: Array
    attitudes: Array
    noise: Array
    earth: Array
    arm: Array
    master: Array
    velocity: Array
    sigma: Array

    @property
    def matched(self) -> bool:
        """Whether attitudes are matched too."""
        return self.attitudes.shape[0] > 0

    @property
    def count(self) -> int:
        """Readings; a vertical velocity that is hardly weighed is none."""
        vertical = self.noise[2] < LOOSE_VERTICAL**2
        return self.last.size * (3 if vertical else 2) + 3 * self.attitudes.shape[0]

    def until(self, count: int) -> Problem:
        """The same with the first `count` samples of the master."""
        n = int(self.last[count - 1])
        first = {k: getattr(self, k)[:n] for k in ("turns", "pushes", "steps")}
        first |= {k: getattr(self, k)[:count] for k in ("last", "gathered", "series", "axes", "rates")}
        first |= {k: getattr(self, k)[: count + 1] for k in ("time", "attitudes")}
        return replace(self, **first)


class Point(NamedTuple):
    """Unknowns of the problem: attitude at the start, velocity there (both in i), biases, mounting."""

    attitude: Array
    velocity: Array
    gyro: Array
    accel: Array
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
        Information: rotation of the start, velocity, biases, and with attitudes the mounting's turn.
    slope : ndarray, shape (p,)
        Half the derivative of the cost, downwards.
    settled : bool
    steps : int
    """

    point: Point
    cost: float
    normal: Array
    slope: Array
    settled: bool
    steps: int

    @property
    def covariance(self) -> Array:
        """Of the mounting's turn in the slave's axes, (3, 3), rad^2."""
        scale = 1.0 / np.sqrt(np.diag(self.normal))
        inverse = np.linalg.inv(self.normal * scale * scale[:, None]) * scale * scale[:, None]
        where = slice(12, 15) if self.normal.shape[0] > 12 else slice(0, 3)
        return np.asarray(0.5 * (inverse + inverse.T)[where, where])

    @property
    def evidence(self) -> float:
        """Logarithm of the posterior's mass about this minimum, up to a constant."""
        return float(-0.5 * self.cost - 0.5 * np.linalg.slogdet(self.normal)[1])


def prepare(config: Config, slave: Slave, master: Master, chosen: NDArray[np.intp]) -> Problem:
    """The problem of a slave and its master.

    Parameters
    ----------
    config : Config
    slave : Slave
    master : Master
        With attitude.
    chosen : ndarray of int, shape (m + 1,)
        Samples of the master: the one to start at, and those to match; all of them within the slave's time.

    Returns
    -------
    Problem
    """
    assert master.attitude is not None  # the caller's task
    time = master.time[chosen] - config.latency
    first, noise = config.initial, config.noise
    turns, pushes, steps, last, rates = _cut(slave, time)
    N, u, earth = _inertial(config, master, slice(int(chosen[0]), int(chosen[-1]) + 1))
    at = chosen - chosen[0]
    C_m_n = master.attitude[chosen]
    arm, flexure = np.array(config.lever_arm), _largest(config.flexure.sigma if config.flexure else None)
    attitude = np.hypot(noise.attitude or 0.0, flexure)
    matched = config.matching == "velocity+attitude"
    # with velocities alone the mounting stands for the slave's attitude against what the master said at the start
    mounting = np.array(first.misalignment) if matched else np.hypot(first.misalignment, attitude)
    # the slave's own velocity differs by that of its arm, in a direction that is not known yet
    velocity = np.hypot(first.velocity, np.linalg.norm(rates[0]) * np.linalg.norm(arm))
    matching = np.full(3, np.hypot(noise.velocity, _unmodelled(config, rates, master.velocity[chosen], time)))
    if config.states != "full":
        matching[2] = np.hypot(matching[2], LOOSE_VERTICAL)
    return Problem(
        time,
        turns,
        pushes,
        steps,
        last,
        np.array([noise.gyro**2, noise.accel**2]) * np.diff(time)[:, None] + _gaps(slave, time),
        u[at[1:]],
        N[at[1:]],
        rates[1:],
        N[at] @ C_m_n if matched else np.empty((0, 3, 3)),
        np.array([*matching, attitude]) ** 2,
        earth,
        arm,
        C_m_n[0],
        u[0],
        np.maximum([*mounting, *[velocity] * 3, *first.gyro_bias, *first.accel_bias], _LEAST),
    )


def _largest(given: tuple[float, ...] | None) -> float:
    return 0.0 if given is None else float(max(given))


def _unmodelled(config: Config, rates: Array, velocity: Array, time: Array) -> float:
    """Velocity that an unknown lever arm and an unknown delay of the master make, rms, m/s: both are small beside the start's task."""
    gains = np.gradient(velocity, time, axis=0)
    turning, pushing = (float(np.sqrt(np.mean(v**2) * 3.0)) for v in (rates, gains))
    return float(np.hypot(turning * _largest(config.initial.lever_arm), pushing * (config.initial.delay or 0.0)))


def _gaps(slave: Slave, time: Array) -> Array:
    """What the gaps of the slave leave unknown of each interval, shape (m, 2), rad^2 and (m/s)^2."""
    out = np.zeros((time.size - 1, 2))
    for gap in slave.gaps():
        within = min(max(int(np.searchsorted(time, slave.time[gap + 1])) - 1, 0), time.size - 2)
        out[within] += [_largest(tuple(v)) ** 2 for v in slave.doubt(gap)]
    return out


def _cut(slave: Slave, time: Array) -> tuple[Array, Array, Array, NDArray[np.int64], Array]:
    """The slave's samples, cut at the master's times, and its rate about each of them."""
    steps = slave.steps
    # coning and sculling with the sample before, steps may differ: the rate is linear over both (1/12 for equal ones)
    share = steps[1:] ** 2 / (6.0 * steps[:-1] * (steps[:-1] + steps[1:]))
    a, b, f, g = slave.turns[:-1], slave.turns[1:], slave.pushes[:-1], slave.pushes[1:]
    turns, pushes = slave.turns.copy(), slave.pushes.copy()
    turns[1:] += share[:, None] * cross(a, b)
    pushes[1:] += share[:, None] * (cross(a, g) + cross(f, b))
    edges = np.concatenate([slave.time, time])
    edges = np.unique(edges[(edges >= time[0]) & (edges <= time[-1])])
    edges = edges[np.concatenate([[True], np.diff(edges) > 0.0])]
    sums = [_running(slave.time, v, edges) for v in (turns, pushes)]
    half = max(float(np.median(steps)), min(0.05, 0.5 * float(np.median(np.diff(time)))))
    around = np.clip([time - half, time + half], slave.time[0], slave.time[-1])
    turned = _running(slave.time, slave.turns, around.ravel()).reshape(2, -1, 3)
    rates = (turned[1] - turned[0]) / (around[1] - around[0])[:, None]
    last = np.searchsorted(edges, time[1:]).astype(np.int64)
    return np.diff(sums[0], axis=0), np.diff(sums[1], axis=0), np.diff(edges), last, rates


def _running(time: Array, increments: Array, at: Array) -> Array:
    """Sum of increments up to given times, shape (k, 3); within a sample by its share."""
    total = np.vstack([np.zeros(3), np.cumsum(increments, axis=0)])
    return np.stack([np.interp(at, time, total[:, i]) for i in range(3)], axis=-1)


def _inertial(config: Config, master: Master, part: slice) -> tuple[Array, Array, Array]:
    """Axes N (k, 3, 3) and series u (k, 3) of the master's samples, and the Earth rate in i."""
    time, height = master.time[part], master.height[part]
    lat, v = master.latitude[part], master.velocity[part]
    C_e_n = wander.direction_cosines(lat, master.longitude[part] + config.earth_rate * (time - time[0]))
    N = C_e_n[0] @ np.swapaxes(C_e_n, -1, -2)
    places = np.array([normal_gravity(float(a), float(h)) for a, h in zip(lat, height, strict=True)])
    gravity = places + (config.gravity - places[0] if config.gravity is not None else 0.0)
    own = cross(config.earth_rate * C_e_n[:, :, 2], v)
    own[:, 2] += gravity
    pulled = np.einsum("kij,kj->ki", N, own)
    gained = np.vstack([np.zeros(3), np.cumsum(0.5 * np.diff(time)[:, None] * (pulled[1:] + pulled[:-1]), axis=0)])
    return N, np.einsum("kij,kj->ki", N, v) + gained, config.earth_rate * C_e_n[0, :, 2]


def centre(problem: Problem) -> Point:
    """The middle of what is known beforehand: no mounting, no biases."""
    zero = np.zeros(3)
    return Point(problem.master, problem.velocity, zero, zero, np.eye(3))


def by_vectors(problem: Problem) -> Point:
    """Closed form without biases and priors: the rotation that best takes the slave's velocities to the master's (Wahba).

    Less their means, which takes out the velocity at the start: the maximum of the likelihood where nothing but white noise of the
    master's velocity is in the way. With attitudes, rotations over a quarter of the time are vectors as well, the same ones in
    both axes.
    """
    from ..kernels.invariant import intervals

    zero = np.zeros(3)
    turn, push, _ = intervals(problem.turns, problem.pushes, problem.steps, problem.last, zero, zero)
    attitude, velocity = np.empty((problem.last.size + 1, 3, 3)), np.zeros((problem.last.size + 1, 3))
    attitude[0] = np.eye(3)
    for k in range(problem.last.size):
        velocity[k + 1] = velocity[k] + attitude[k] @ push[k]
        attitude[k + 1] = attitude[k] @ turn[k]
    here, there = (
        velocity[1:] - velocity[1:].mean(axis=0),
        (problem.series - problem.series.mean(axis=0)) @ problem.master,
    )
    if problem.matched:
        lag = max(1, problem.last.size // 4)
        weight = np.sqrt(problem.noise[0] / problem.noise[3] / 2.0)
        own, base = (_turned(a, lag) for a in (attitude, problem.master.T @ problem.attitudes))
        here, there = np.vstack([here, weight * own]), np.vstack([there, weight * base])
    mounting = wahba(here, there)
    return Point(problem.master @ mounting, problem.velocity, zero, zero, mounting)


def _turned(attitude: Array, lag: int) -> Array:
    """Rotations over `lag` steps in the axes of the start, of those that are well below half a turn."""
    later, earlier = attitude[lag:], attitude[:-lag]
    vectors = rotation_vector(later @ np.swapaxes(earlier, -1, -2))
    return np.asarray(vectors * (np.linalg.norm(vectors, axis=1) < 2.5)[:, None])


def by_filter(problem: Problem) -> Point:
    """End of a left-invariant filter that starts with no mounting, carried back to the start."""
    from ..kernels.invariant import intervals, left_invariant

    zero, point = np.zeros(3), centre(problem)
    pieces = intervals(problem.turns, problem.pushes, problem.steps, problem.last, zero, zero)
    sigma2 = problem.sigma**2
    spread = np.diag(np.concatenate([sigma2, sigma2[:3] if problem.matched else []]))
    if problem.matched:
        # the slave's attitude is the mounting on the master's true attitude, which the master's first sample shows
        spread[:3, :3] += problem.noise[3] * np.eye(3)
        spread[:3, 12:] = spread[12:, :3] = spread[12:, 12:]
    attitude, bias, mounting = left_invariant(
        *pieces, *_readings(problem), point.attitude, point.velocity, point.mounting, spread
    )
    return Point(attitude, point.velocity, bias[:3], bias[3:], mounting)


def descend(problem: Problem, point: Point) -> Fit:
    """Gauss-Newton from a point down towards the maximum of the posterior, steps halved where the cost would rise."""
    state = _evaluate(problem, point)
    moved, used = np.inf, 0
    while moved >= _SETTLED and used < _STEPS[0]:
        step = _scaled_solve(state[1], state[2])
        moved = _length(step, state[1])
        point, state, _ = _down(problem, point, state, step)
        used += 1
    return Fit(point, *state, moved < _SETTLED, used)


def finish(problem: Problem, fit: Fit) -> Fit:
    """Newton from where Gauss-Newton ended, with the curvature of the cost itself.

    Where the readings say next to nothing about the azimuth the two curvatures differ: noise that has gathered in the run turns with the
    azimuth and leaves the cost as it is, but its derivative is as large as if it told something (7 deg of false certainty after 300 s
    of a small tactical unit on a straight course), and Gauss-Newton steps are too short by the same factor.

    Parameters
    ----------
    problem : Problem
    fit : Fit
        From :func:`descend`.
    """
    point, state, curvature = fit.point, (fit.cost, fit.normal, fit.slope), fit.normal
    moved = before = np.inf
    for used in range(1, _STEPS[1] + 1):
        if used == 1 or moved > 0.2 * before:
            curvature = _curvature(problem, point, state[1])
        step, before = np.linalg.solve(curvature, state[2]), moved
        moved = _length(step, curvature)
        point, state, whole = _down(problem, point, state, step)
        if moved < _SETTLED and whole:
            break
    return Fit(point, state[0], curvature, state[2], moved < _SETTLED, fit.steps + used)


def _down(problem: Problem, point: Point, state: _State, step: Array) -> tuple[Point, _State, bool]:
    """The point after a step, or after the largest half, quarter, ... of it that does not raise the cost, and whether it was whole."""
    fraction = min(1.0, _LONGEST_STEP / max(*(float(np.linalg.norm(v)) for v in (step[:3], step[12:])), 1e-300))
    whole = fraction == 1.0
    for _ in range(12):
        trial = _moved(problem, point, fraction * step)
        found = _evaluate(problem, trial)
        if found[0] <= state[0] * (1.0 + 1e-9):
            return trial, found, whole
        fraction, whole = fraction / 2.0, False
    return point, state, False


def _length(step: Array, information: Array) -> float:
    """In standard uncertainties."""
    return float(np.sqrt(max(step @ information @ step, 0.0)))


def _scaled_solve(normal: Array, slope: Array) -> Array:
    """Solution of the normal equations, unknowns scaled to the same size."""
    scale = 1.0 / np.sqrt(np.diag(normal))
    return np.asarray(scale * np.linalg.solve(normal * scale * scale[:, None], scale * slope))


def _curvature(problem: Problem, point: Point, normal: Array) -> Array:
    """Half the second derivative of the cost, from differences of its slope along the axes of the Gauss-Newton uncertainty."""
    scale = 1.0 / np.sqrt(np.diag(normal))
    root = scale[:, None] * np.linalg.inv(np.linalg.cholesky(normal * scale * scale[:, None])).T
    own = np.empty_like(normal)
    for i, axis in enumerate(root.T):
        there, back = (_evaluate(problem, _moved(problem, point, sign * _PROBE * axis))[2] for sign in (1.0, -1.0))
        own[i] = root.T @ (back - there) / (2.0 * _PROBE)
    values, vectors = np.linalg.eigh(0.5 * (own + own.T))
    back = np.linalg.inv(root)
    half = back.T @ vectors * np.sqrt(np.maximum(values, _FLATTEST))
    return np.asarray(half @ half.T)


def _readings(problem: Problem) -> tuple[Array, ...]:
    p = problem
    return p.gathered, p.series, p.axes, p.rates, p.attitudes, p.earth, p.arm, p.noise


def _evaluate(problem: Problem, point: Point) -> tuple[float, Array, Array]:
    """Cost at a point, information and slope there."""
    from ..kernels.invariant import intervals, normal_equations

    pieces = intervals(problem.turns, problem.pushes, problem.steps, problem.last, point.gyro, point.accel)
    whole = normal_equations(*pieces, *_readings(problem), point.attitude, point.velocity, point.mounting)
    normal, slope, cost = whole[:-1, :-1], whole[:-1, -1], float(whole[-1, -1])
    angle = rotation_vector(point.mounting)
    left = np.concatenate([-angle, problem.velocity - point.velocity, -point.gyro, -point.accel]) / problem.sigma
    rows = np.zeros((12, slope.size))
    rows[:, :12] = np.diag(1.0 / problem.sigma)
    turned = np.linalg.inv(left_jacobian(angle).T) / problem.sigma[:3, None]
    rows[:3] = 0.0
    rows[:3, -3 if problem.matched else 0 :][:, :3] = turned
    return cost + float(left @ left), normal + rows.T @ rows, slope + rows.T @ left


def _moved(problem: Problem, point: Point, step: Array) -> Point:
    attitude = point.attitude @ rotation_matrix(step[:3])
    mounting = point.mounting @ rotation_matrix(step[12:]) if problem.matched else problem.master.T @ attitude
    return Point(attitude, point.velocity + step[3:6], point.gyro + step[6:9], point.accel + step[9:12], mounting)
