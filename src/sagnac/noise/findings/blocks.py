"""Means and scatter of a log in a few thousand blocks, taken in one pass and bounded memory: what disturbances are found in.

All blocks hold the same number of samples. When there are too many of them, neighbours are joined (Chan, Golub and LeVeque 1983
for the scatter of joined parts), so that a log of any length ends with between half as many and as many as are kept at most.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from ..curves.side_by_side import each_axis

MOST = 8192
"""Blocks kept at most."""
_FIRST = 8  # samples of a block to begin with
_LENGTHS = 24  # powers of two by which runs are told apart
_ROUNDING = 1e-9  # of the range: a step that is a rounding error


@dataclass(frozen=True)
class Blocks:
    """A log in `k` blocks of equal numbers of samples, `a` axes.

    Attributes
    ----------
    size : int
        Samples of a block.
    interval : float, s
        From sample to sample.
    start, stop : ndarray, shape (k,), s
        Times of the first and last sample of each.
    mean, variance : ndarray, shape (k, a)
        Of the samples of each, the variance about the block's own mean.
    steps : ndarray, shape (k, a)
        Mean square of the differences of neighbouring samples: the fast part of the noise.
    temperature : ndarray, shape (k,), K, or None
        NaN where none was recorded.
    low, high : ndarray, shape (a,)
        Extremes of the samples.
    at_low, at_high : ndarray, shape (a,)
        Samples that stand exactly there.
    equal : ndarray, shape (a,)
        Share of the samples that equal the one before.
    run, run_start : ndarray, shape (a,)
        Most samples in a row that are equal, and the time [s] of the first of them.
    runs : ndarray of int, shape (a, lengths)
        How many times a sample was repeated from 2^j to 2^(j + 1) - 1 times.
    finest : ndarray, shape (a,)
        Smallest difference of neighbours that differ; infinite where none do.
    """

    size: int
    interval: float
    start: Array
    stop: Array
    mean: Array
    variance: Array
    steps: Array
    temperature: Array | None
    low: Array
    high: Array
    at_low: Array
    at_high: Array
    equal: Array
    run: Array
    run_start: Array
    runs: NDArray[np.int64]
    finest: Array

    @property
    def count(self) -> int:
        """Number of blocks."""
        return self.start.size

    @property
    def mid(self) -> Array:
        """Middle of each block, s, shape (k,)."""
        return np.asarray((self.start + self.stop) / 2)

    @property
    def noise(self) -> Array:
        """Noise of single samples from their differences, shape (a,)."""
        usual = np.median(self.steps, axis=0) if self.count else np.full(self.low.shape, np.nan)
        return np.asarray(np.sqrt(usual / 2))


@dataclass
class _Kept:
    """Blocks so far; one row a block."""

    start: Array
    stop: Array
    mean: Array
    scatter: Array
    steps: Array
    warmth: Array

    def joined(self, size: int) -> _Kept:
        """Neighbours joined, two blocks of `size` samples each; there must be an even number."""
        first, second = slice(0, None, 2), slice(1, None, 2)
        apart = self.mean[second] - self.mean[first]
        return _Kept(
            self.start[first],
            self.stop[second],
            (self.mean[first] + self.mean[second]) / 2,
            self.scatter[first] + self.scatter[second] + apart**2 * (size / 2),
            (self.steps[first] + self.steps[second]) / 2,
            _mean_of_known(self.warmth[first], self.warmth[second]),
        )


def _mean_of_known(a: Array, b: Array) -> Array:
    return np.where(np.isnan(a), b, np.where(np.isnan(b), a, (a + b) / 2))


def _stacked(parts: list[_Kept]) -> _Kept:
    return _Kept(
        *(
            np.concatenate([getattr(p, n) for p in parts])
            for n in ("start", "stop", "mean", "scatter", "steps", "warmth")
        )
    )


@dataclass
class Ledger:
    """Takes the samples of a log piece by piece; :meth:`blocks` is what was seen.

    Parameters
    ----------
    axes : int
    interval : float, s
        From sample to sample.
    most : int
        Blocks kept at most, an even number.
    """

    axes: int
    interval: float
    most: int = MOST
    _size: int = _FIRST
    _parts: list[_Kept] = field(default_factory=list)
    _count: int = 0
    _open: list[Array] = field(default_factory=list)
    _edge: Array = field(default_factory=lambda: np.zeros(0))
    _last: Array = field(default_factory=lambda: np.zeros(0))
    _samples: int = 0
    _low: Array = field(default_factory=lambda: np.zeros(0))
    _high: Array = field(default_factory=lambda: np.zeros(0))
    _at: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    _equal: Array = field(default_factory=lambda: np.zeros(0))
    _finest: Array = field(default_factory=lambda: np.zeros(0))
    _runs: Array = field(default_factory=lambda: np.zeros(0))
    _ended: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        """Start with nothing seen."""
        a = self.axes
        self._last = np.full(a, np.nan)
        self._low, self._high = np.full(a, np.inf), np.full(a, -np.inf)
        self._at = np.zeros((2, a), dtype=np.int64)
        self._equal, self._finest = np.zeros(a), np.full(a, np.inf)
        self._runs = np.tile([0.0, np.nan, 0.0, np.nan], (a, 1))
        self._ended = np.zeros((a, _LENGTHS), dtype=np.int64)

    def add(self, time: Array, values: Array, temperature: Array | None = None) -> None:
        """Take consecutive samples.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        values : ndarray, shape (n, axes)
            Taken as it is where the samples of an axis stand side by side in memory, else copied.
        temperature : ndarray, shape (n,), K, optional
        """
        if not time.size:
            return
        warmth = np.full(time.size, np.nan) if temperature is None else temperature
        rows = np.ascontiguousarray(values.T)
        if not self._samples:
            self._edge = rows[:, 0].copy()
        each_axis(lambda k: self._see(k, time, rows[k]), self.axes, rows.size)
        self._samples += time.size
        done = 0
        while done < time.size:
            waiting = self._open[0].size if self._open else 0
            room = (self.most - self._count) * self._size - waiting  # an even number of blocks, when it is full
            cut = slice(done, min(done + room, time.size))
            self._add(time[cut], rows[:, cut], warmth[cut])
            done = cut.stop

    def _add(self, time: Array, rows: Array, warmth: Array) -> None:
        """The block that was begun, whole ones, and the begin of another."""
        given, first = (time, rows, warmth), 0
        if self._open:
            first = min(self._size - self._open[0].size, time.size)
            begun = zip(self._open, given, strict=True)
            self._open = [np.concatenate([a, b[..., :first]], axis=-1) for a, b in begun]
            if self._open[0].size == self._size:
                self._reduce(*self._open)
                self._open = []
        whole = (time.size - first) // self._size * self._size
        if whole:
            self._reduce(*(part[..., first : first + whole] for part in given))
        if first + whole < time.size:
            self._open = [part[..., first + whole :].copy() for part in given]
        if self._count == self.most:
            self._parts = [_stacked(self._parts).joined(self._size)]
            self._count, self._size = self._count // 2, 2 * self._size

    def _reduce(self, time: Array, rows: Array, warmth: Array) -> None:
        """Whole blocks, taken in."""
        from ...kernels.stretches import block_sums

        whole = time.size // self._size
        shape = (whole, self._size)
        found = np.empty((self.axes, whole, 3))
        each_axis(lambda k: block_sums(rows[k].reshape(shape), self._edge[k], found[k]), self.axes, rows.size)
        self._edge = rows[:, -1].copy()
        known = np.isfinite(warmth).reshape(shape)
        number = known.sum(axis=1)
        total = np.where(known, warmth.reshape(shape), 0.0).sum(axis=1)
        mean, scatter, steps = found.transpose(2, 1, 0)
        usual = np.where(number > 0, total / np.maximum(number, 1), np.nan)
        start, stop = time.reshape(shape)[:, [0, -1]].T  # a copy: a view would keep the whole batch
        self._parts.append(_Kept(start, stop, mean, scatter, steps, usual))
        self._count += whole

    def _see(self, k: int, time: Array, values: Array) -> None:
        """Extremes, smallest steps and runs of equal samples of one axis."""
        from ...kernels.stretches import count_equal, follow_runs, steps_between

        before = self._last[k]
        for side, known, new in ((0, self._low, values.min()), (1, self._high, values.max())):
            if new == known[k]:
                self._at[side, k] += count_equal(values, new)
            elif (new < known[k]) == (side == 0):
                self._at[side, k], known[k] = count_equal(values, new), new
        # samples that were computed, as rates from angles, are on their lattice but for rounding errors
        rounding = _ROUNDING * (self._high[k] - self._low[k])
        steps = np.empty(values.size)
        equal = steps_between(values, rounding, steps[1:])
        first = abs(values[0] - before) if self._samples else np.inf
        steps[0] = first if first > rounding else np.inf
        equal += first <= rounding
        self._finest[k] = min(self._finest[k], steps.min())
        self._equal[k] += equal
        if equal or self._runs[k, 0]:
            follow_runs(values, time, before, rounding, self._runs[k], self._ended[k])
        else:
            self._runs[k, :2] = 0.0, time[-1]
        self._last[k] = values[-1]

    def blocks(self) -> Blocks:
        """What was seen so far; samples that fill no block are left out of the blocks."""
        a = self.axes
        empty = np.zeros((0, a))
        none = _Kept(np.zeros(0), np.zeros(0), empty, empty, empty, np.zeros(0))
        every = _stacked(self._parts) if self._parts else none
        return Blocks(
            size=self._size,
            interval=self.interval,
            start=every.start,
            stop=every.stop,
            mean=every.mean,
            variance=every.scatter / self._size,
            steps=every.steps,
            temperature=every.warmth if np.isfinite(every.warmth).any() else None,
            low=self._low,
            high=self._high,
            at_low=self._at[0],
            at_high=self._at[1],
            equal=self._equal / max(self._samples, 1),
            run=self._runs[:, 2] + 1,
            run_start=self._runs[:, 3].copy(),
            runs=self._ended.copy(),
            finest=self._finest,
        )
