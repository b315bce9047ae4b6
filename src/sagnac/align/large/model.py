"""Transfer alignment as one problem of least squares, for mountings of any size: its readings.

Inertial axes i stand still, east, north, up of the start. There the slave's attitude R and the velocity y that its own forces
give it obey

    R' = R [w x],    y' = R f

with nothing but its own readings on the right, and what the master says is one series to compare y with,

    u(t) = N v - integral N (g - w_ie x v),

N from east, north, up to i (the velocity form of Wu & Pan 2013, IEEE TAES 49, 1006). With ``R = R^ exp([xi x])`` and
``y = y^ + R^ zeta`` errors propagate by ``xi' = -w x xi - eps, zeta' = -w x zeta - f x xi - nab``, which knows the readings and
not the estimate (Barrau & Bonnabel 2017, IEEE TAC 62, 1797: the left-invariant error of a group-affine system). The one
nonlinear thing left is the rotation at the start, so that the whole recording is one problem in it, in the velocity at the
start and in the biases: :mod:`sagnac.align.large.fit`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...earth import gravity_excess, normal_gravity
from ...frames import Array, cross, transform
from ...navigate import wander
from ..samples import running

if TYPE_CHECKING:
    from ..config import Config
    from ..master import Master
    from ..samples import Slave

_LOOSE = 1.0
"""m/s: noise given to the master's vertical velocity where the alignment does not match it: it only tells up from down."""
# what is known exactly would make the equations singular: rad, m/s, rad/s, m/s^2, m, s
_LEAST = np.repeat([1e-6, 1e-4, 1e-12, 1e-9, 1e-6, 1e-6], [3, 3, 3, 3, 3, 1])
_SLOW = 0.5
"""s: to either side, over which the master's acceleration is taken."""


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
    gathered, series, axes, rates, gains, attitudes : ndarray
        See :func:`sagnac.kernels.invariant.normal_equations`.
    noise, earth : ndarray
        The same.
    arm : ndarray, shape (3,), m
        Lever arm from the master to the slave as far as it is known, in the master's axes.
    master : ndarray, shape (3, 3)
        The master's attitude at the start, to east, north, up.
    velocity : ndarray, shape (3,), m/s
        Of the slave at the start, as far as the master tells.
    sigma : ndarray, shape (16,)
        Of mounting, velocity, biases, lever arm and delay, beforehand.
    vertical : bool
        Whether the vertical velocity counts.
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
    gains: Array
    attitudes: Array
    noise: Array
    earth: Array
    arm: Array
    master: Array
    velocity: Array
    sigma: Array
    vertical: bool

    @property
    def matched(self) -> bool:
        """Whether attitudes are matched too."""
        return len(self.attitudes) > 0

    @property
    def count(self) -> int:
        """Readings; a vertical velocity that is hardly weighed is none."""
        return self.last.size * (3 if self.vertical else 2) + 3 * len(self.attitudes)


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
    matched = config.matches_attitude
    # with velocities alone the mounting stands for the slave's attitude against what the master said at the start
    mounting = np.array(first.misalignment) if matched else np.hypot(first.misalignment, attitude)
    reach = first.lever_arm or (0.0, 0.0, 0.0)
    # the slave's own velocity differs by that of its arm, in a direction that is not known yet
    velocity = np.hypot(first.velocity, np.linalg.norm(rates[0]) * np.linalg.norm([*arm, *reach]))
    matching = np.full(3, noise.velocity)
    vertical = config.states == "full"
    if not vertical:
        matching[2] = np.hypot(matching[2], _LOOSE)
    return Problem(
        time,
        turns,
        pushes,
        steps,
        last,
        np.array([noise.gyro**2, noise.accel**2]) * np.diff(time)[:, None] + _gaps(slave, time),
        u[at[1:]],
        N[at[1:]],
        rates,
        _gains(master, config.latency, time[1:]),
        N[at] @ C_m_n if matched else np.empty((0, 3, 3)),
        np.array([*matching, attitude]) ** 2,
        earth,
        arm,
        C_m_n[0],
        u[0],
        np.maximum(
            [*mounting, *[velocity] * 3, *first.gyro_bias, *first.accel_bias, *reach, first.delay or 0.0], _LEAST
        ),
        vertical,
    )


def _largest(given: tuple[float, ...] | None) -> float:
    return 0.0 if given is None else float(max(given))


def _gains(master: Master, latency: float, time: Array) -> Array:
    """The master's acceleration, (m, 3), m/s^2, from its velocities around."""
    around = np.clip([time - _SLOW, time + _SLOW], master.time[0] - latency, master.time[-1] - latency)
    v = [np.stack([np.interp(t, master.time - latency, u) for u in master.velocity.T], axis=-1) for t in around]
    return np.asarray((v[1] - v[0]) / (around[1] - around[0])[:, None])


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
    sums = [running(slave.time, v, edges) for v in (turns, pushes)]
    half = max(float(np.median(steps)), min(0.05, 0.5 * float(np.median(np.diff(time)))))
    around = np.clip([time - half, time + half], slave.time[0], slave.time[-1])
    turned = running(slave.time, slave.turns, around.ravel()).reshape(2, -1, 3)
    rates = (turned[1] - turned[0]) / (around[1] - around[0])[:, None]
    last = np.searchsorted(edges, time[1:]).astype(np.int64)
    return np.diff(sums[0], axis=0), np.diff(sums[1], axis=0), np.diff(edges), last, rates


def _inertial(config: Config, master: Master, part: slice) -> tuple[Array, Array, Array]:
    """Axes N (k, 3, 3) and series u (k, 3) of the master's samples, and the Earth rate in i."""
    time, height = master.time[part], master.height[part]
    lat, v = master.latitude[part], master.velocity[part]
    C_e_n = wander.direction_cosines(lat, master.longitude[part] + config.earth_rate * (time - time[0]))
    N = C_e_n[0] @ np.swapaxes(C_e_n, -1, -2)
    own = cross(config.earth_rate * C_e_n[:, :, 2], v)
    own[:, 2] += normal_gravity(lat, height) + gravity_excess(config.gravity, lat[0], height[0])
    pulled = transform(N, own)
    gained = np.vstack([np.zeros(3), np.cumsum(0.5 * np.diff(time)[:, None] * (pulled[1:] + pulled[:-1]), axis=0)])
    return N, transform(N, v) + gained, config.earth_rate * C_e_n[0, :, 2]
