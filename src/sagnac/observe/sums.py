"""Running sums over one segment: what a single pass over its samples keeps of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..frames import Array
from .samples import Seen

BLOCKS = 16
"""Stretches of equal time that a segment is divided into, to judge the noise of its mean by theirs."""


@dataclass
class Sums(Seen):
    """Running sums of one segment over the axes of all sensors."""

    reference: Array = field(default_factory=lambda: np.zeros(0))
    previous: Array = field(default_factory=lambda: np.zeros(0))
    block_sum: Array = field(default_factory=lambda: np.zeros(0))
    block_count: Array = field(default_factory=lambda: np.zeros(BLOCKS))
    shape: Array = field(default_factory=lambda: np.zeros((BLOCKS, 3)))
    """Sums over each block of time, and of cosine and sine of the turn: what is no noise goes like these."""

    def add(self, time: Array, values: Array, interval: float) -> None:
        """Take in the next samples of the segment.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        values : ndarray, shape (n, axes)
        interval : float, s
            Usual step from sample to sample; wider ones are gaps.
        """
        if self.count == 0:
            self._begin(values)
        self.see(time, interval)
        span = self.segment.stop - self.segment.start
        block = np.clip(((time - self.segment.start) / span * BLOCKS).astype(int), 0, BLOCKS - 1)
        edges = np.searchsorted(block, np.arange(BLOCKS))
        present = np.flatnonzero(np.diff(edges, append=time.size) > 0)
        self.block_sum[present] += np.add.reduceat(values - self.reference, edges[present], axis=0)
        self.block_count += np.diff(edges, append=time.size)
        when = time - self.segment.start
        turn = self.segment.turn_rate * when
        known = [when, np.cos(turn), np.sin(turn)] if self.segment.turn_rate else [when]
        for i, values_of in enumerate(known):
            self.shape[present, i] += np.add.reduceat(values_of, edges[present])
        columns = np.ascontiguousarray(values.T)  # several times quicker to go through, axis by axis
        self._extremes(columns)
        self._steps(columns)
        self.previous = values[-1].copy()

    def _begin(self, values: Array) -> None:
        self.reference, self.previous = values[0].copy(), values[0].copy()
        self.block_sum = np.zeros((BLOCKS, self.axes))
        self.squared_steps = np.zeros(self.axes)
        self.low, self.high = np.full(self.axes, np.inf), np.full(self.axes, -np.inf)
        self.at_low, self.at_high = np.zeros(self.axes), np.zeros(self.axes)
        self.finest = np.full(self.axes, np.inf)

    def _steps(self, columns: Array) -> None:
        """Differences of neighbours; samples (axes, n)."""
        steps = np.diff(columns, axis=1, prepend=self.previous[:, None])
        np.abs(steps, out=steps)
        least = steps.min(axis=1)
        for k in np.flatnonzero(least == 0):  # neighbours that are equal have no step
            least[k] = np.min(steps[k], where=steps[k] > 0, initial=np.inf)
        self.finest = np.minimum(self.finest, least)
        np.square(steps, out=steps)
        self.squared_steps += steps.sum(axis=1)

    def _extremes(self, columns: Array) -> None:
        for bound, at, value in (
            ("low", "at_low", columns.min(axis=1)),
            ("high", "at_high", columns.max(axis=1)),
        ):
            old = getattr(self, bound)
            new = np.minimum(old, value) if bound == "low" else np.maximum(old, value)
            here = np.array([np.count_nonzero(c == v) for c, v in zip(columns, new, strict=True)])
            setattr(self, at, np.where(new == old, getattr(self, at) + here, here))
            setattr(self, bound, new)

    @property
    def mean(self) -> Array:
        """Mean of all samples, shape (axes,)."""
        return np.asarray(self.reference + self.block_sum.sum(axis=0) / self.count)

    def block_density(self, interval: float) -> tuple[Array, int]:
        """Noise density squared from full blocks, and the degrees of freedom it rests on."""
        usual = self.count / BLOCKS
        full = np.flatnonzero(self.block_count >= max(0.8 * usual, 1.0))
        columns = 3 if self.segment.turn_rate else 1
        dof = full.size - columns - 1
        if self.count < BLOCKS or dof < 2:
            return np.zeros(self.axes), 0
        means = self.block_sum[full] / self.block_count[full][:, None]
        shape = self.shape[full, :columns] / self.block_count[full][:, None]
        shape[:, 0] /= shape[:, 0].max()
        design = np.column_stack([np.ones(full.size), shape])
        residual = means - design @ np.linalg.lstsq(design, means, rcond=None)[0]
        return (residual**2).sum(axis=0) / dof * usual * interval, dof
