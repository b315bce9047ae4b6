"""One recorded angle of a table over one segment, in a single pass: how far it is from the plan's, and how it got there.

An encoder may lose a sample, wrap, be read more slowly than the sensors and held in between, or be coarse. So the samples are
kept as medians of small groups, and of a turning axis only those count at which the column changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..frames import Array

TURN = 2.0 * math.pi
_GROUPS = 64  # that the samples of a batch are kept as, at most
_SMALLEST = 5  # samples of a standing axis in a group: two bad ones do not move its median


class Stray(NamedTuple):
    """A sample, its difference from the plan, rad, its time, s, and what the column shows, rad."""

    off: float
    time: float
    shown: float


_NONE_LOW, _NONE_HIGH = Stray(math.inf, math.nan, math.nan), Stray(-math.inf, math.nan, math.nan)


@dataclass
class RigReading:
    """Difference of a recorded angle from the plan's over one segment, unwrapped.

    Attributes
    ----------
    start : float, s
        Of the segment.
    angle : float, rad
        Planned at the start.
    rate : float, rad/s
        Planned.
    calm : float, rad
        Samples that scatter by no more are as good as their mean.
    count : int
        Samples taken in.
    first : float, rad
        The first of them as it was read.
    """

    start: float
    angle: float
    rate: float
    calm: float
    count: int = 0
    first: float = math.nan
    _time: list[Array] = field(default_factory=list)
    _off: list[Array] = field(default_factory=list)
    _weight: list[Array] = field(default_factory=list)
    _low: Stray = _NONE_LOW
    _high: Stray = _NONE_HIGH
    _last: float = math.nan
    _shown: float = math.nan

    def add(self, time: Array, shown: Array) -> None:
        """Take in the next samples.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        shown : ndarray, shape (n,), rad
            It may jump by whole turns.
        """
        if self.count == 0:
            self.first = float(shown[0])
        self.count += time.size
        if self.rate:
            self._turn(time, shown)
        else:
            self._stand(time, shown)

    def _stand(self, time: Array, shown: Array) -> None:
        if float(shown.max() - shown.min()) <= self.calm:
            middle = time.size // 2
            off = self._continued(np.array([shown.mean() - self.angle]))
            self._keep(time[middle : middle + 1] - self.start, off, np.array([time.size]))
            return
        off = self._continued(shown - self.angle)
        low, high = int(np.argmin(off)), int(np.argmax(off))
        if off[low] < self._low.off:
            self._low = Stray(float(off[low]), float(time[low]), float(shown[low]))
        if off[high] > self._high.off:
            self._high = Stray(float(off[high]), float(time[high]), float(shown[high]))
        self._group(time - self.start, off, _SMALLEST)

    def _turn(self, time: Array, shown: Array) -> None:
        # a column that is held between its readings lags by up to a whole one, and is right only where it changes
        before = np.concatenate([[self._shown if self.count > time.size else shown[0]], shown[:-1]])
        self._shown = float(shown[-1])
        fresh = shown != before
        if fresh.any():
            x = time[fresh] - self.start
            self._group(x, self._continued(shown[fresh] - self.angle - self.rate * x), 1)

    def _continued(self, off: Array) -> Array:
        """Without jumps of whole turns, within these and from those before."""
        if off.size > 1 and float(np.ptp(off)) >= math.pi:
            off = np.asarray(np.unwrap(off))
        if math.isfinite(self._last):
            off = off + TURN * round((self._last - float(off[0])) / TURN)
        self._last = float(off[-1])
        return off

    def _group(self, x: Array, off: Array, smallest: int) -> None:
        size = max(off.size // _GROUPS, smallest)
        whole = off.size - off.size % size
        middle = np.mean if float(np.ptp(off)) <= self.calm else np.median
        for part, width in ((slice(0, whole), size), (slice(whole, None), off.size - whole)):
            if width and x[part].size:
                groups = off[part].reshape(-1, width)
                self._keep(x[part].reshape(-1, width).mean(axis=1), middle(groups, axis=1), np.full(len(groups), width))

    def _keep(self, x: Array, off: Array, weight: Array) -> None:
        self._time.append(x)
        self._off.append(off)
        self._weight.append(weight)

    @cached_property
    def _offs(self) -> Array:
        return np.concatenate(self._off) if self._off else np.zeros(0)

    @cached_property
    def _shares(self) -> Array:
        weight = np.concatenate(self._weight).astype(np.float64)
        return np.asarray(weight / weight.sum())

    @property
    def changes(self) -> bool:
        """Whether there is anything to compare: the column of a turning axis may never change."""
        return bool(self._off)

    @cached_property
    def off(self) -> float:
        """Median difference, rad, as it was read: whole turns are left in. A column that never changes has its first."""
        if not self._offs.size:
            return self.first - self.angle
        order = np.argsort(self._offs)
        at = int(np.searchsorted(np.cumsum(self._shares[order]), 0.5))
        return float(self._offs[order[min(at, order.size - 1)]])

    @cached_property
    def mean(self) -> float:
        """Mean difference but for bad samples, rad."""
        return float(self._shares @ self._offs)

    @cached_property
    def extent(self) -> tuple[float, float]:
        """Least and greatest difference but for bad samples, rad."""
        return float(self._offs.min()), float(self._offs.max())

    def away(self, limit: float) -> float:
        """Share of the samples that are more than a limit (rad) from the median, but for bad ones."""
        return float(self._shares[np.abs(self._offs - self.off) > limit].sum())

    def moves_at_ends(self, limit: float) -> bool:
        """Whether the first or the last samples are more than a limit (rad) from the median."""
        return bool(np.abs(self._offs[[0, -1]] - self.off).max() > limit)

    @property
    def stray(self) -> Stray:
        """The sample furthest from the median; its difference is from the median, and zero where no sample stands out."""
        low, high = self.off - self._low.off, self._high.off - self.off
        if not math.isfinite(low):
            return Stray(0.0, math.nan, math.nan)
        return self._low._replace(off=-low) if low > high else self._high._replace(off=high)

    @cached_property
    def rate_off(self) -> float:
        """How much faster than planned the angle grows, rad/s; zero where the samples do not tell."""
        n = self._offs.size
        if n == 0:
            return -self.rate  # it never changes
        half = n // 2
        if half == 0:
            return 0.0
        x = np.concatenate(self._time)
        # the median over pairs half of the segment apart: a bad sample spoils no more than two of them
        return float(np.median((self._offs[n - half :] - self._offs[:half]) / (x[n - half :] - x[:half])))
