"""One transfer alignment from samples to estimates: the slave's increments against the master's log, update by update."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..earth import earth_rate_enu, radii
from ..frames import Array, rotation_matrix
from ..navigate.state import State
from . import model
from .filter import Filter, Reference, parted
from .history import History, Run
from .samples import Feed, Slave, chosen

if TYPE_CHECKING:
    from .config import Config
    from .master import Master


def transfer(
    config: Config,
    slave: Slave,
    master: Master,
    *,
    mounting: Array | None = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Align a slave from its master.

    Parameters
    ----------
    config : Config
    slave : Slave
    master : Master
    mounting : ndarray, shape (3,), rad, optional
        Where to linearise first, for mountings of tens of degrees (see :mod:`sagnac.align.large`). It is no prior knowledge:
        that stays centred at zero.
    progress : callable, optional
        Takes the time reached, s.

    Raises
    ------
    InputError
        When the two do not overlap, or the master gives no attitude to start with.
    DataError
        When a gap in the slave's samples is too long to bridge, or the covariance is lost.
    """
    stamps = master.time - config.latency
    first, *samples = chosen(config, slave, master).tolist()
    gaps = slave.gaps()
    model.refuse_poles(config, master.latitude, master.name)
    rate, force = _felt(slave, float(stamps[first]))
    start = _start(config, master, first, rate, mounting)
    filter_ = Filter(config, model.layout_of(config), start, rate, force, mounting)
    walk = _Walk(config, slave, master, stamps, gaps, filter_, float(stamps[first]))
    history = History(config, filter_, walk.raw)
    for k in samples:
        target = float(stamps[k]) - filter_.delay
        if target > slave.time[-1]:
            break
        while target - walk.now > 1.5 * config.update_interval:
            walk.to(walk.now + config.update_interval)
            history.note(walk.now, None)
        if target - walk.now < 1e-9:
            continue
        walk.to(target)
        history.note(walk.now, filter_.match(_reference(master, k)))
        if progress is not None:
            progress(walk.now)
    bridged = ((float(slave.time[i]), float(slave.time[i + 1]), "no samples of the slave, bridged") for i in gaps)
    return history.run(float(stamps[first]), tuple(bridged))


class _Walk:
    """The slave from time to time: the filter's navigation, and the one that goes on alone."""

    def __init__(
        self,
        config: Config,
        slave: Slave,
        master: Master,
        stamps: Array,
        gaps: list[int],
        filter_: Filter,
        start: float,
    ) -> None:
        self._slave, self._gaps, self._filter = slave, set(gaps), filter_
        self._feed = Feed(slave, start)
        self.now = start
        self.raw = filter_.twin() if config.correction == "output" else None
        self._follows = config.states == "short"  # the height then follows the master's vertical velocity
        risen = 0.5 * (master.velocity[1:, 2] + master.velocity[:-1, 2]) * np.diff(stamps)
        self._risen = stamps, np.concatenate([[0.0], np.cumsum(risen)])
        self._base = float(filter_.state.height) - float(np.interp(start, *self._risen))

    def to(self, stop: float) -> None:
        """Go on to a time."""
        steps, turns, pushes, part = self._feed.until(stop)
        heights = None
        if self._follows:
            heights = self._base + np.interp(self.now + np.cumsum(steps), *self._risen)
        self._filter.advance(turns, pushes, steps, heights)
        if self.raw is not None:
            self.raw.advance(turns, pushes, steps, heights)
        for gap in self._gaps.intersection(part):
            self._filter.bridged(*self._slave.doubt(gap))
        self._gaps.difference_update(part)
        self.now = stop


def _felt(slave: Slave, time: float) -> tuple[Array, Array]:
    """Rate and specific force of the slave, (3,) each, over the first tenth of a second."""
    first, last = np.searchsorted(slave.time[1:], [time + 1e-9, time + 0.1])
    part = slice(first, max(last, first + 1))
    span = slave.steps[part].sum()
    return slave.turns[part].sum(axis=0) / span, slave.pushes[part].sum(axis=0) / span


def _start(config: Config, master: Master, k: int, rate: Array, mounting: Array | None) -> State:
    """Of the slave: the master's position, velocity and attitude, moved over the lever arm."""
    assert master.attitude is not None  # refused before
    C_m_n, latitude = master.attitude[k], float(master.latitude[k])
    turned = np.eye(3) if mounting is None else rotation_matrix(mounting)
    lever = np.array(config.lever_arm)
    shift = C_m_n @ lever
    meridian, normal = radii(latitude)
    height = master.height[k] + shift[2]
    longitude = float(master.longitude[k])
    if lever.any():
        longitude += shift[0] / ((normal + height) * np.cos(latitude))
    there = latitude + shift[1] / (meridian + height)
    carried = master.velocity[k] + C_m_n @ np.cross(
        turned @ rate - C_m_n.T @ earth_rate_enu(latitude, config.earth_rate), lever
    )
    at_master = State.at(there, longitude, height, carried, C_m_n @ turned)
    turn = parted(at_master, shift)
    return State.at(there, longitude, height, turn @ carried, turn @ C_m_n @ turned)


def _reference(master: Master, k: int) -> Reference:
    attitude = master.attitude[k] if master.attitude is not None else None
    return Reference(float(master.latitude[k]), float(master.longitude[k]), master.velocity[k], attitude)
