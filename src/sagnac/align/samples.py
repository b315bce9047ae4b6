"""The slave's increments, handed out between any two times, and the master's samples that they are matched with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, InputError
from ..frames import Array
from ..recording import GAP

if TYPE_CHECKING:
    from .config import Config
    from .master import Master

_LONGEST_GAP = 1.0
"""s: what a vehicle does in a longer time cannot be told from the samples around it."""


@dataclass(frozen=True)
class Slave:
    """Increments of the slave.

    Attributes
    ----------
    time : ndarray, shape (n + 1,), s
        Ends of the intervals, that of the first one's beginning in front.
    steps : ndarray, shape (n,), s
    turns, pushes : ndarray, shape (n, 3), rad and m/s
        Integrals of angular rate and specific force over each interval; x right, y forward, z up.
    name : str
        For messages.
    """

    time: Array
    steps: Array
    turns: Array
    pushes: Array
    name: str = "slave"

    @property
    def wide(self) -> NDArray[np.bool_]:
        """Which intervals are gaps, shape (n,)."""
        return np.asarray(self.steps > GAP * np.median(self.steps))

    def gaps(self) -> list[int]:
        """Numbers of the intervals that are gaps.

        Raises
        ------
        DataError
            When one of them is too long for its increments to be guessed.
        """
        wide = np.flatnonzero(self.wide)
        for i in wide:
            if self.steps[i] > _LONGEST_GAP:
                raise DataError(
                    f"{self.name}: no samples from {self.time[i]:.6g} s to {self.time[i + 1]:.6g} s: how the slave turned in "
                    f"that time is not known, so that no alignment goes on over it. Align before it or after it"
                )
        return [int(i) for i in wide]

    def doubt(self, gap: int) -> tuple[Array, Array]:
        """What an interval without samples leaves unknown: rotation (3,), rad, and velocity (3,), m/s, one sigma.

        Half the difference between the samples before and after it, times its length.
        """
        around = [i for i in (gap - 1, gap + 1) if 0 <= i < self.steps.size]
        rates, forces = ([v[i] / self.steps[i] for i in around] for v in (self.turns, self.pushes))
        span = self.steps[gap]
        return 0.5 * span * np.abs(rates[0] - rates[-1]), 0.5 * span * np.abs(forces[0] - forces[-1])


def running(time: Array, increments: Array, at: Array) -> Array:
    """Sums of increments from the first time on; within an interval by its share.

    Parameters
    ----------
    time : ndarray, shape (n + 1,), s
        Ends of the intervals, that of the first one's beginning in front.
    increments : ndarray, shape (n, 3)
    at : ndarray, shape (k,), s

    Returns
    -------
    ndarray, shape (k, 3)
    """
    total = np.vstack([np.zeros(3), np.cumsum(increments, axis=0)])
    return np.stack([np.interp(at, time, column) for column in total.T], axis=-1)


def chosen(config: Config, slave: Slave, master: Master, longest: float = np.inf) -> NDArray[np.intp]:
    """The master's samples: the one to start at, and those to match, as far apart as the updates are to be.

    Parameters
    ----------
    config : Config
    slave : Slave
    master : Master
    longest : float, s
        From the first one on.

    Returns
    -------
    ndarray of int, shape (m + 1,)

    Raises
    ------
    InputError
        When the two do not overlap, or the master gives no attitude to start with.
    """
    if master.attitude is None:
        raise InputError(
            f"{master.name}: heading, pitch and roll are missing: the slave starts with the master's attitude"
        )
    stamps = master.time - config.latency
    inside = np.flatnonzero((stamps >= slave.time[0] - 1e-9) & (stamps <= slave.time[-1] + 1e-9))
    if inside.size < 2:
        raise InputError(
            f"{master.name} ({stamps[0]:g} to {stamps[-1]:g} s) and {slave.name} ({slave.time[0]:g} to {slave.time[-1]:g} s) "
            f"have {inside.size} samples of the master in common: are they of the same run, on the same clock?"
        )
    out, least = [inside[0]], config.update_interval - 0.5 * master.interval - 1e-9
    for k in inside[stamps[inside] <= stamps[inside[0]] + longest + 1e-9][1:]:
        if stamps[k] - stamps[out[-1]] > least:
            out.append(k)
    return np.array(out)


class Feed:
    """Increments from where the last call stopped; a sample that is cut is shared out by time.

    Parameters
    ----------
    slave : Slave
    start : float, s
        Where the first call begins.
    """

    def __init__(self, slave: Slave, start: float) -> None:
        self._slave = slave
        self._at = int(np.searchsorted(slave.time, start + 1e-9, side="right")) - 1
        self._left = (slave.time[self._at + 1] - start) / (slave.time[self._at + 1] - slave.time[self._at])

    def until(self, stop: float) -> tuple[Array, Array, Array, range]:
        """Steps (k,), turns and pushes (k, 3) up to a time, and the numbers of the samples they are of."""
        time = self._slave.time
        last = max(self._at, int(np.searchsorted(time, stop - 1e-9, side="left")) - 1)
        share = np.ones(last - self._at + 1)
        share[0] = self._left
        done = min(1.0, (stop - time[last]) / (time[last + 1] - time[last]))
        share[-1] -= 1.0 - done
        part = range(self._at, last + 1)
        self._at, self._left = (last + 1, 1.0) if done > 1.0 - 1e-9 else (last, 1.0 - done)
        cut = slice(part.start, part.stop)
        given = self._slave
        return given.steps[cut] * share, given.turns[cut] * share[:, None], given.pushes[cut] * share[:, None], part
