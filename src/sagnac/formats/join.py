"""Accelerometers and gyros that were logged at different times become one table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..frames import Array

Ticks = NDArray[np.int64]
GAP = 1.5
"""No value is found between neighbours that lie further apart than this many usual steps."""
_BUNCH = 64
"""Samples that a bunch may have: chips and their drivers collect up to 32."""
_PENDING = 1 << 18  # samples that wait for the other sensor: what bounds the memory when one falls silent


@dataclass(frozen=True)
class Stream:
    """Samples of one sensor.

    Attributes
    ----------
    time : ndarray of int64, shape (n,), us
    values : ndarray, shape (n, 3)
    other : ndarray, shape (n, m)
        Numbers that go along and between which nothing lies: counters.
    """

    time: Ticks
    values: Array
    other: Array

    def __getitem__(self, which: Any) -> Stream:
        return Stream(self.time[which], self.values[which], self.other[which])

    def then(self, more: Stream) -> Stream:
        """These samples and what follows them."""
        return Stream(*(np.concatenate((getattr(self, k), getattr(more, k))) for k in ("time", "values", "other")))

    @classmethod
    def empty(cls, other: int = 0) -> Stream:
        """No samples, with `other` numbers that go along."""
        return cls(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, other)))


class Joiner:
    """Accelerometers at the times of the gyros, piece by piece.

    Where both have a sample at the same time it is taken as it is; elsewhere the accelerometers are interpolated linearly
    between neighbours no further apart than :data:`GAP` usual steps. Gyro samples for which there is no such pair are left out.

    Parameters
    ----------
    name : str
        For messages.
    step : float, us
        Usual step of the accelerometers, see :func:`usual_step`.
    other : int
        Numbers that go along with the accelerometers; those of the sample before.

    Attributes
    ----------
    lost : int
        Gyro samples left out so far.
    """

    def __init__(self, name: str, step: float, other: int = 0) -> None:
        self._name, self._limit = name, GAP * step
        self._accel, self._gyro = Stream.empty(other), Stream.empty()
        none = np.empty(0, dtype=np.int64)
        self._last = {"accelerometers": none, "gyros": none}  # times of the last samples
        self.lost = 0

    def add(self, accel: Stream | None, gyro: Stream | None) -> tuple[Stream, Stream]:
        """Take what came in; accelerometers and gyros, at the same times, of all that can be told now.

        Raises
        ------
        InputError
            When the time of one of them does not increase.
        """
        if accel is not None and accel.time.size:
            self._check("accelerometers", accel.time)
            self._accel = self._accel.then(accel)
        if gyro is not None and gyro.time.size:
            self._check("gyros", gyro.time)
            self._gyro = gyro if not self._gyro.time.size else self._gyro.then(gyro)
        waiting = self._gyro.time
        last = self._last["accelerometers"]
        ready = int(np.searchsorted(waiting, last[0], "right")) if last.size else 0
        joined = self._joined(self._gyro[:ready])
        self._gyro = self._gyro[ready:]
        if ready:  # neither the sample before the last row nor those after it are done with
            self._accel = self._accel[max(int(np.searchsorted(self._accel.time, waiting[ready - 1], "right")) - 1, 0) :]
        self._forget()
        return joined

    def finish(self) -> None:
        """Nothing follows: the gyro samples behind the last of the accelerometers are lost."""
        self.lost += self._gyro.time.size
        self._gyro = self._gyro[:0]

    @np.errstate(invalid="ignore", over="ignore")  # values that are no numbers are refused where rows are checked
    def _joined(self, gyro: Stream) -> tuple[Stream, Stream]:
        time, known = gyro.time, self._accel.time
        if not known.size:
            self.lost += time.size
            return self._accel[:0], gyro[:0]
        before = np.searchsorted(known, time, "right") - 1
        after = np.minimum(before + 1, known.size - 1)
        before = np.maximum(before, 0)
        met = known[before] == time
        near = met | ((known[before] < time) & (time < known[after]) & (known[after] - known[before] <= self._limit))
        self.lost += int(time.size - near.sum())
        gyro, before, after, met = gyro[near], before[near], after[near], met[near]
        span = np.where(met, 1, known[after] - known[before])
        share = np.where(met, 0.0, (gyro.time - known[before]) / span)[:, None]
        first, second = self._accel.values[before], self._accel.values[after]
        values = np.where(met[:, None], first, first * (1.0 - share) + second * share)
        return Stream(gyro.time, values, self._accel.other[before]), gyro

    def _check(self, sensors: str, time: Ticks) -> None:
        known = np.concatenate((self._last[sensors], time))
        wrong = np.flatnonzero(known[1:] <= known[:-1])
        if wrong.size:
            times = "from {:.6f} s to {:.6f} s".format(*(known[wrong[0] :][:2] * 1e-6))
            raise InputError(f"{self._name}: the time of the {sensors} goes {times}; it must increase")
        self._last[sensors] = time[-1:].copy()

    def _forget(self) -> None:
        surplus = self._gyro.time.size - _PENDING
        if surplus > 0:
            self._gyro, self.lost = self._gyro[surplus:], self.lost + surplus
        self._accel = self._accel[max(self._accel.time.size - _PENDING, 0) :]


def usual_step(time: Ticks) -> float:
    """Usual step, in us; of samples that are logged in bunches that between the bunches, so that these are no gaps.

    It is the step that holds the middle of the time: few steps are those between bunches, and most of the time lies in them.
    Steps as rare as one in :data:`_BUNCH` count no longer than the longest of the others, so that a real gap does not hold
    the middle. Nor is it shorter than what nine steps in ten do not exceed, however irregular these are.
    """
    steps = np.sort(np.diff(time.astype(float)))
    steps = steps[steps > 0]  # others are refused where samples are joined
    if not steps.size:
        return 0.0
    held = np.minimum(steps, steps[(steps.size - 1) * (_BUNCH - 1) // _BUNCH])
    until = np.cumsum(held)
    return float(max(held[np.searchsorted(until, until[-1] / 2.0)], np.quantile(steps, 0.9)))


def rate(time: Ticks) -> float:
    """Samples per second."""
    span = float(time[-1]) - float(time[0]) if time.size else 0.0
    return (time.size - 1) / span * 1e6 if span > 0 else 0.0


def remark(accel: Ticks, gyro: Ticks) -> str | None:
    """What joining does to these samples; None when the times are the same."""
    if not accel.size or not gyro.size:
        return None
    first, last = max(accel[0], gyro[0]), min(accel[-1], gyro[-1])
    if np.array_equal(*(time[(time >= first) & (time <= last)] for time in (accel, gyro))):
        return None
    after = np.minimum(np.searchsorted(accel, gyro), accel.size - 1)
    before = np.maximum(after - 1, 0)
    apart = np.where(gyro - accel[before] < accel[after] - gyro, gyro - accel[before], gyro - accel[after])
    return (
        f"gyros at {rate(gyro):.4g} Hz and accelerometers at {rate(accel):.4g} Hz have times of their own, the gyros' "
        f"{np.median(apart) * 1e-3:+.3f} ms from the nearest of the accelerometers; these were interpolated to the gyros' times"
    )
