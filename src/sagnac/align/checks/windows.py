"""What the master says that the slave should feel, and what it felt: over the master's sample intervals, and in windows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...earth import gravity_excess, normal_gravity
from ...frames import Array, cross, rotation_matrix, rotation_vector, transform
from ...navigate import wander
from ..samples import running

if TYPE_CHECKING:
    from ..config import Config
    from ..master import Master
    from ..samples import Slave

_MOST = 3000  # windows that are looked at


@dataclass(frozen=True)
class Intervals:
    """The master's sample intervals that the slave covers without a gap.

    Attributes
    ----------
    number : ndarray of int, shape (n,)
        Of the master's sample at the beginning of each.
    start, steps : ndarray, shape (n,), s
        On the slave's clock; the known latency is taken out.
    turn, push : ndarray, shape (n, 3), rad and m/s
        Sums of the slave's increments, in its axes as they turn.
    """

    number: NDArray[np.int64]
    start: Array
    steps: Array
    turn: Array
    push: Array


@dataclass(frozen=True)
class Apart:
    """How far slave and master part from sample to sample of the master, exact however the slave turns in between.

    Attributes
    ----------
    attitude : ndarray, shape (n, 3, 3)
        C_b_e of the master at the beginning of each interval: Earth-fixed, in which sums make sense near a pole too.
    gained : ndarray, shape (n, 3), m/s
        Integral of the slave's specific force in its axes at the beginning.
    turned : ndarray, shape (n, 3), rad
        Rotation vector of the slave over the interval.
    velocity : ndarray, shape (n, 3), m/s
        Change of the slave's velocity, turned to Earth-fixed axes by the master's attitude, less that of the master's.
    angle : ndarray, shape (n, 3), rad
        The same of the rotation, in body axes.
    rate : ndarray, shape (n, 3), rad/s
        Of the slave at the end of each interval.
    """

    attitude: Array
    gained: Array
    turned: Array
    velocity: Array
    angle: Array
    rate: Array


@dataclass(frozen=True)
class Windows:
    """Means over windows, slave against master.

    Attributes
    ----------
    force, rate : ndarray, shape (n, 3), m/s^2 and rad/s
        Predicted by the master for a slave that is mounted as the master is.
    felt, turned : ndarray, shape (n, 3), m/s^2 and rad/s
        By the slave.
    span : float, s
        Length of a window.
    """

    force: Array
    rate: Array
    felt: Array
    turned: Array
    span: float


def intervals(slave: Slave, master: Master, latency: float) -> Intervals:
    """The slave's increments over the master's sample intervals.

    Parameters
    ----------
    slave : Slave
    master : Master
    latency : float, s
        Taken off the master's stamps.
    """
    stamps = master.time - latency
    in_gaps = np.concatenate([[0.0], np.cumsum(np.where(slave.wide, slave.steps, 0.0))])
    lost = np.diff(np.interp(stamps, slave.time, in_gaps)) > 1e-6
    inside = (stamps[:-1] >= slave.time[0] - 1e-9) & (stamps[1:] <= slave.time[-1] + 1e-9)
    number = np.flatnonzero(inside & ~master.wide & ~lost)
    turn, push = (np.diff(running(slave.time, v, stamps), axis=0)[number] for v in (slave.turns, slave.pushes))
    return Intervals(number, stamps[number], np.diff(stamps)[number], turn, push)


def apart(slave: Slave, given: Intervals, master: Master, config: Config) -> Apart:
    """Differences of slave and master over the intervals.

    Parameters
    ----------
    slave : Slave
    given : Intervals
        Of both.
    master : Master
        With attitude.
    config : Config
        Earth rate and gravity.
    """
    C0, C1, push, ground = _moved(master, given.number, config)
    R, gained = _carried(slave, given)
    turn = rotation_vector(np.swapaxes(C0, -1, -2) @ rotation_matrix(ground) @ C1)
    turned = rotation_vector(R)
    end = given.start + given.steps
    reach = np.maximum(0.5 * np.minimum(given.steps, 0.1), float(np.median(slave.steps)))
    around = np.clip([end - reach, end + reach], slave.time[0], slave.time[-1])
    before, after = (running(slave.time, slave.turns, t) for t in around)
    rate = (after - before) / (around[1] - around[0])[:, None]
    to_earth = np.swapaxes(wander.direction_cosines(master.latitude, master.longitude), -1, -2)[given.number]
    return Apart(to_earth @ C0, gained, turned, transform(to_earth, transform(C0, gained) - push), turned - turn, rate)


def _carried(slave: Slave, given: Intervals) -> tuple[Array, Array]:
    """Rotation (n, 3, 3) and gain of velocity (n, 3) of the slave over each interval, in its axes at the beginning."""
    time, stop = slave.time, given.start + given.steps
    first = np.maximum(np.searchsorted(time, given.start + 1e-9, side="right") - 1, 0)
    last = np.minimum(np.searchsorted(time, stop - 1e-9, side="left") - 1, slave.steps.size - 1)
    R, gained = np.broadcast_to(np.eye(3), (first.size, 3, 3)).copy(), np.zeros((first.size, 3))
    for j in range(int((last - first).max()) + 1):
        at = np.minimum(first + j, last)
        inside = np.minimum(stop, time[at + 1]) - np.maximum(given.start, time[at])
        share = np.where(first + j <= last, inside / slave.steps[at], 0.0)[:, None]
        turn, push = share * slave.turns[at], share * slave.pushes[at]
        gained += transform(R, push + 0.5 * cross(turn, push))
        R = R @ rotation_matrix(turn)
    return R, gained


def predicted(master: Master, number: NDArray[np.int64], config: Config) -> tuple[Array, Array]:
    """Integrals of specific force and angular rate over the master's sample intervals, in its body axes as they turn.

    Parameters
    ----------
    master : Master
        With attitude.
    number : ndarray of int, shape (n,)
        Of the intervals.
    config : Config
        Earth rate and gravity.

    Returns
    -------
    push, turn : ndarray, shape (n, 3), m/s and rad
        To the order that matters for windows of some seconds.
    """
    C0, C1, push, ground = _moved(master, number, config)
    to_body = 0.5 * np.swapaxes(C0 + C1, -1, -2)
    return transform(to_body, push), rotation_vector(np.swapaxes(C0, -1, -2) @ C1) + transform(to_body, ground)


def _moved(master: Master, number: NDArray[np.int64], config: Config) -> tuple[Array, Array, Array, Array]:
    """What the master's log says of each interval, in axes that stay on the Earth: the east, north, up of its beginning.

    Returns
    -------
    before, after : ndarray, shape (n, 3, 3)
        Attitude at the beginning and at the end.
    push, ground : ndarray, shape (n, 3), m/s and rad
        Integrals of ``f = dv/dt + 2 w_ie x v - g`` and of the Earth's rate.
    """
    assert master.attitude is not None  # refused before
    steps = np.diff(master.time)[number, None]
    C_e_n = wander.direction_cosines(master.latitude, master.longitude)
    to_first = C_e_n[number] @ np.swapaxes(C_e_n[number + 1], -1, -2)
    v0, v1 = master.velocity[number], transform(to_first, master.velocity[number + 1])
    ground = config.earth_rate * steps * C_e_n[number, :, 2]
    up = 0.5 * (np.array([0.0, 0.0, 1.0]) + to_first[:, :, 2])
    gravity = normal_gravity(master.latitude, master.height)
    gravity += gravity_excess(config.gravity, master.latitude[0], master.height[0])
    push = v1 - v0 + cross(ground, v0 + v1) + steps * gravity[number, None] * up
    # while the Earth turns on, what is felt is compared in the axes of the beginning
    push += 0.5 * cross(ground, push)
    return master.attitude[number], to_first @ master.attitude[number + 1], push, ground


def windows(given: Intervals, push: Array, turn: Array, span: float) -> Windows:
    """Means over windows of about a length; those with less than three quarters of their time are left out.

    Parameters
    ----------
    given : Intervals
    push, turn : ndarray, shape (n, 3)
        Of :func:`predicted`.
    span : float, s
    """
    label = np.floor((given.start - given.start[0]) / span).astype(np.int64)
    edges = np.flatnonzero(np.diff(label, prepend=-1))
    time = np.add.reduceat(given.steps, edges)
    means = [np.add.reduceat(v, edges, axis=0) / time[:, None] for v in (push, turn, given.push, given.turn)]
    good = np.flatnonzero(time > 0.75 * min(span, time.max()))
    good = good[:: max(1, len(good) // _MOST)]
    return Windows(means[0][good], means[1][good], means[2][good], means[3][good], span)
