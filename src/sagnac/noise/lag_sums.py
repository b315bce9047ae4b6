"""Sums over all lags between the differences of two averaging times, from few nodes.

The covariance of two variances is a sum over up to hundreds of millions of lags of a function that is smooth but for kinks at
sums and differences of the averaging times. Between the kinks the lags are cut in panels that double away from each end, and a
panel is summed by the Gauss rule of its own integers: the rule that is exact for *sums* of polynomials over that many
equidistant points (orthogonal polynomials of Chebyshev, also Gram). No panel takes a sum for an integral.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..frames import Array
from .terms import DIVISOR, ORDER

_NODES = 8
"""Of a panel: exact for polynomials up to degree 15."""


@dataclass(frozen=True)
class Lags:
    """Nodes of all pairs of averaging factors, one pair after the other.

    Attributes
    ----------
    first, second, lag : ndarray, shape (nodes,)
        Averaging factors of the pair and distance of the middles of their differences, samples.
    weight : ndarray, shape (nodes,)
        The covariance of the pair's variances is the sum of ``weight * covariance(lag)**2``.
    starts : ndarray of int, shape (k (k + 1) / 2,)
        First node of each pair i <= j, in the order of ``numpy.triu_indices``.
    size : int
        k, number of factors.
    """

    first: Array
    second: Array
    lag: Array
    weight: Array
    starts: NDArray[np.int64]
    size: int


def nodes(samples: int, factors: tuple[int, ...], kind: str) -> Lags:
    """Nodes for the variances of one uninterrupted record.

    Parameters
    ----------
    samples : int
        n.
    factors : tuple of int
        Averaging factors in rising order; a difference of the longest fits in the record.
    kind : str
        ``allan`` or ``hadamard``.
    """
    order, divisor = ORDER[kind], DIVISOR[kind]
    count = [samples + 1 - order * m for m in factors]
    first, second, lags, weights, sizes = [], [], [], [], []
    for i, m in enumerate(factors):
        for j in range(i, len(factors)):
            lag, weight = _pair(m, factors[j], count[i], count[j], order)
            pairs = np.minimum(float(count[j]), 0.5 * (count[i] + count[j]) - lag)
            weights.append(weight * pairs * 2.0 / (divisor**2 * count[i] * count[j]))
            lags.append(lag)
            sizes.append(lag.size)
            first.append(m)
            second.append(factors[j])
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    return Lags(
        np.repeat(np.asarray(first, dtype=float), sizes),
        np.repeat(np.asarray(second, dtype=float), sizes),
        np.concatenate(lags),
        np.concatenate(weights),
        starts,
        len(factors),
    )


def _pair(m1: int, m2: int, n1: int, n2: int, order: int) -> tuple[Array, Array]:
    """Distances u >= 0 of the middles and how many lags each stands for; the other half of the lags lies at -u."""
    # in half samples: the middles lie (order / 2) (m2 - m1) + whole samples apart
    begin = (order * (m2 - m1)) % 2
    end = n1 + n2 - 2  # the last lag with a pair
    kinks = {0, end, n1 - n2}
    for shift in range(order + 1):  # the middle of a difference and its points, from both
        for other in range(order + 1):
            kinks.add(abs((2 * shift - order) * m1 + (2 * other - order) * m2))
            kinks.add(abs((2 * shift - order) * m1 - (2 * other - order) * m2))
    if order == 2:
        kinks |= {2 * m1, 2 * m2}
    stops = sorted(k for k in kinks if begin <= k <= end and (k - begin) % 2 == 0)
    stops = stops if stops[:1] == [begin] else [begin, *stops]
    panels: list[tuple[int, int]] = []
    for a, b in zip(stops, [*stops[1:], None], strict=True):
        panels.append((a, 1))
        if b is not None:
            panels += _graded(a + 2, (b - a) // 2 - 1, 2, both=b != end)
    lag, weight = _gauss(panels, 2)
    return 0.5 * lag, np.where(lag == 0.0, weight, 2.0 * weight)


def graded(start: int, length: int, smallest: int = _NODES) -> tuple[Array, Array]:
    """Nodes and weights of a sum over `length` integers from `start` on, in panels that double.

    Parameters
    ----------
    start, length : int
    smallest : int
        Integers in the first panel.
    """
    return _gauss(_graded(start, length, 1, both=False, smallest=smallest), 1)


def _graded(start: int, length: int, step: int, *, both: bool, smallest: int = _NODES) -> list[tuple[int, int]]:
    """Panels (first point, number of points), doubling away from the beginning, and from the end where that is a kink."""
    left: list[int] = []
    right: list[int] = []
    size, rest = smallest, length
    while rest > 0:
        for side in (left, right) if both else (left,):
            take = min(size, rest)
            side.append(take)
            rest -= take
        size *= 2
    out = []
    for take in (*left, *reversed(right)):
        if take:
            out.append((start, take))
            start += step * take
    return out


def _gauss(panels: list[tuple[int, int]], step: int) -> tuple[Array, Array]:
    """Points and weights of the panels, whose points lie `step` apart."""
    lags, weights = [], []
    for start, length in panels:
        x, w = rule(length)
        lags.append(start + step * x)
        weights.append(w)
    return np.concatenate(lags), np.concatenate(weights)


@lru_cache(maxsize=8192)
def rule(length: int) -> tuple[Array, Array]:
    """Gauss rule of the sum over 0, 1, ..., length - 1: nodes and weights, the points themselves if they are few.

    The recurrence of the orthogonal polynomials is beta_k = k^2 (L^2 - k^2) / (4 (4 k^2 - 1)) (discrete Chebyshev, Gautschi
    2004, section 1.5); nodes are the eigenvalues of the Jacobi matrix (Golub & Welsch 1969).
    """
    if length <= _NODES:
        return np.arange(float(length)), np.ones(length)
    k = np.arange(1.0, _NODES)
    off = 0.5 * np.sqrt(k**2 * (1.0 - (k / length) ** 2) / (4.0 * k**2 - 1.0))  # in units of the length
    values, vectors = np.linalg.eigh(np.diag(off, 1) + np.diag(off, -1))
    return np.asarray(0.5 * (length - 1) + length * values), np.asarray(length * vectors[0] ** 2)
