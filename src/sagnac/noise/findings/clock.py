"""Where samples were lost: told by the clock over many samples, not by a single step of it.

Stamps are often of the moment when a sample reached the logger: they jitter by a share of the interval, come in bursts (USB) or
late, while every sample is there. A lost sample leaves all later ones late for good. So each long step is judged by how late the
samples after it are against those before, in means over 4, 16, 60 and 64: the least of them must be half an interval. Bursts of
a length that divides 60 or 64 leave no trace in these, and of the last two the extreme quarters are left out, so that a logger
that once stalled and caught up makes no gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...frames import Array

AHEAD = 64
"""Samples after a step that judge it, and before."""
_LENGTHS = (4, 16, 60, 64)
_FEW = 16  # samples of which none is left out of a mean
_NEAR = 4  # samples, within which the longer of two steps is the loss
_LONG = 1.25  # intervals, from which a step is looked at
_LATE = 0.5  # intervals that samples are later for good, from which some are lost
_FEW_LOST = 100.0  # samples, up to which a loss is rounded to them
_OTHER = 0.998  # of the interval by means, below which the usual step is tried too
_ROUNDS = 3  # to the interval, each from the gaps that the last one showed
_MAYBE = 0.4  # the same by means, which tell at once where to look


class Clock:
    """Takes the stamps of a log piece by piece and tells where it breaks.

    Parameters
    ----------
    interval : float, s
        Usual distance of the samples, to about 1 %.

    Attributes
    ----------
    gaps : list of (float, float)
        Time of the last sample before each, and its length, s.
    missing : list of int
        Samples that are lost in each.
    lost : float, s
        How much later the samples are at last than they would be without the gaps.
    """

    def __init__(self, interval: float) -> None:
        self.gaps: list[tuple[float, float]] = []
        self.missing: list[int] = []
        self._interval = interval
        self._behind = np.zeros(0)  # stamps before those that are not decided, as they would be without the gaps
        self._waiting = np.zeros(0)
        self.lost = 0.0

    def take(self, time: Array) -> tuple[int, list[int]]:
        """Take the next stamps.

        Parameters
        ----------
        time : ndarray, shape (n,), s

        Returns
        -------
        int
            Samples that are decided now, counted from the first that was not yet: the last :data:`AHEAD` have to wait.
        list of int
            Those of them that a gap comes before, counted likewise.
        """
        open_ = np.concatenate([self._waiting, time])
        return self._decide(open_, max(open_.size - AHEAD, 0))

    def rest(self) -> tuple[int, list[int]]:
        """Decide all that waits: the log is at its end."""
        return self._decide(self._waiting, self._waiting.size)

    def _decide(self, open_: Array, decided: int) -> tuple[int, list[int]]:
        behind = self._behind.size
        whole = np.concatenate([self._behind, open_ - self.lost])
        breaks = []
        for i in self._likely(whole, behind, behind + decided):
            late = self._late(whole, i)
            if late > _LATE and not self._outdone(whole, i):
                at = i - behind
                before = open_[at - 1] if at else self._behind[-1] + self.lost
                self.gaps.append((float(before), float(open_[at] - before)))
                # few are whole numbers of samples: what is off is jitter, or the interval, and would add up
                late = float(round(late)) if late < _FEW_LOST else late
                whole[i:] -= late * self._interval
                self.lost += late * self._interval
                self.missing.append(round(late))
                breaks.append(at)
        self._behind = whole[: behind + decided][-AHEAD:].copy()
        self._waiting = open_[decided:].copy()
        return decided, breaks

    def _likely(self, time: Array, first: int, stop: int) -> Sequence[int]:
        """Places that a loss may lie before, by means."""
        steps = np.diff(time)
        at: NDArray[np.intp] = np.flatnonzero(steps > _LONG * self._interval) + 1
        at = at[(at >= max(first, 1)) & (at < stop)]
        if not at.size:
            return []
        late = (time - time[0]) / self._interval - np.arange(float(time.size))
        total = np.concatenate([[0.0], np.cumsum(late)])
        for length in _LENGTHS[1::2]:
            low, high = np.maximum(at - length, 0), np.minimum(at + length, time.size)
            apart = (total[high] - total[at]) / (high - at) - (total[at] - total[low]) / (at - low)
            at = at[apart > _MAYBE]
        return [int(i) for i in at]

    def _outdone(self, time: Array, i: int) -> bool:
        """Whether there is a longer step close behind the one before `i`, that is a loss."""
        steps = np.diff(time[i - 1 : i + _NEAR])
        j = int(np.argmax(steps))
        return bool(steps[j] > steps[0] + 0.1 * self._interval and self._late(time, i + j) > _LATE)

    def _late(self, time: Array, i: int) -> float:
        """Intervals that samples from `i` on are later than those before."""
        before = (time[max(i - AHEAD, 0) : i][::-1] - time[i]) / self._interval
        before = before + np.arange(1.0, before.size + 1.0)
        after = (time[i : i + AHEAD] - time[i]) / self._interval
        after = after - np.arange(float(after.size))
        return min(_middle(after[:n]) - _middle(before[:n]) for n in _LENGTHS)


def _middle(late: Array) -> float:
    """Mean, of many without the extreme quarters."""
    cut = late.size // 4 if late.size > _FEW else 0
    return float(np.sort(late)[cut : late.size - cut].mean())


def usual_interval(time: Array) -> float:
    """Distance of the samples without the gaps, s.

    Means over many tell it whatever the stamps do, unless there are losses in most of them: then the usual step does. The
    better of the two is that with which the samples, the losses counted, come most evenly.

    Parameters
    ----------
    time : ndarray, shape (n,), s, n > 1
    """
    width = max(1, min(AHEAD, time.size // 4))
    total = np.concatenate([[0.0], np.cumsum(time - time[0])])
    means = (total[width:] - total[:-width]) / width
    wide, step = float(np.median(means[width:] - means[:-width])) / width, float(np.median(np.diff(time)))
    found = _settled(time, wide)
    if 0.5 * wide < step < _OTHER * wide:
        found = min(found, _settled(time, step))
    return found[1]


def _settled(time: Array, interval: float) -> tuple[float, float]:
    """How unevenly the samples come, in intervals, and the interval, from a first guess of it."""
    shifted = time
    for _ in range(_ROUNDS):
        clock = Clock(interval)
        decided, breaks = clock.take(time)
        breaks += [decided + b for b in clock.rest()[1]]
        lost = np.zeros(time.size)
        lost[breaks] = clock.missing
        shifted = time - interval * np.cumsum(lost)
        interval = float(time[-1] - time[0] - clock.lost) / (time.size - 1)
    late = (shifted - time[0]) / interval - np.arange(float(time.size))
    block = max(1, min(AHEAD, time.size // 8))
    means = late[: late.size // block * block].reshape(-1, block).mean(axis=1)
    return float(np.square(np.diff(means)).mean()) if means.size > 1 else 0.0, interval
