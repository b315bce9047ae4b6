"""Sums over all lags between the differences of two averaging times, from few nodes.

The covariance of two variances is a sum over up to hundreds of millions of lags of a function that is smooth but for kinks at
sums and differences of the averaging times. Between the kinks the lags are summed in panels
(:mod:`sagnac.noise.identification.panels`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from .panels import gauss, panels_between
from .terms import DIVISOR, ORDER


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
            panels += panels_between(a + 2, (b - a) // 2 - 1, 2, both=b != end)
    lag, weight = gauss(panels, 2)
    return 0.5 * lag, np.where(lag == 0.0, weight, 2.0 * weight)
