"""Least and greatest samples of a recording of any length, stretch by stretch, in one pass and bounded memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...frames import Array

_STRETCHES = 4096
"""Kept at most; when they are full, neighbours are joined."""


@dataclass(frozen=True)
class Extremes:
    """What was seen of each stretch of samples.

    Attributes
    ----------
    first, last : ndarray, shape (n,), s
        Times of its first and last sample.
    low, high : ndarray, shape (n, k)
    """

    first: Array
    last: Array
    low: Array
    high: Array


class Envelope:
    """Takes samples piece by piece and keeps their extremes.

    Parameters
    ----------
    columns : int
        k.
    stretches : int
        Kept at most.
    """

    def __init__(self, columns: int, stretches: int = _STRETCHES) -> None:
        self._most = stretches
        self._size = 1
        self._columns = columns
        self._parts: list[Extremes] = []
        self._count = 0
        self._open_time = np.zeros(0)
        self._open_values = np.zeros((0, columns))

    def add(self, time: Array, values: Array) -> None:
        """Take consecutive samples.

        Parameters
        ----------
        time : ndarray, shape (m,), s
        values : ndarray, shape (m, k)
        """
        time = np.concatenate([self._open_time, time])
        values = np.concatenate([self._open_values, values])
        whole = time.size // self._size
        cut = whole * self._size
        if whole:
            self._parts.append(_reduced(time[:cut], values[:cut], self._size))
            self._count += whole
        self._open_time, self._open_values = time[cut:].copy(), values[cut:].copy()
        while self._count >= self._most:
            self._halve()

    def _halve(self) -> None:
        """Join neighbours; an odd one out stays as it is, half as long as the others."""
        every = _joined(self._parts)
        even = every.first.size // 2 * 2
        joined = Extremes(
            every.first[:even:2],
            every.last[1:even:2],
            np.minimum(every.low[:even:2], every.low[1:even:2]),
            np.maximum(every.high[:even:2], every.high[1:even:2]),
        )
        left = Extremes(every.first[even:], every.last[even:], every.low[even:], every.high[even:])
        self._parts = [joined, left] if left.first.size else [joined]
        self._count = joined.first.size + left.first.size
        self._size *= 2

    def result(self) -> Extremes:
        """Stretches so far, the last one perhaps shorter."""
        parts = list(self._parts)
        if self._open_time.size:
            parts.append(_reduced(self._open_time, self._open_values, self._open_time.size))
        if not parts:
            nothing = np.zeros((0, self._columns))
            return Extremes(np.zeros(0), np.zeros(0), nothing, nothing)
        return _joined(parts)


def _reduced(time: Array, values: Array, size: int) -> Extremes:
    blocks = values.reshape(-1, size, values.shape[1])
    return Extremes(time[::size], time[size - 1 :: size], blocks.min(axis=1), blocks.max(axis=1))


def _joined(parts: list[Extremes]) -> Extremes:
    return Extremes(*(np.concatenate([getattr(p, k) for p in parts]) for k in ("first", "last", "low", "high")))
