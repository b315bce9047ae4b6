"""Covariance of the overlapping variances of a record under a model of its noise, exact for Gaussian noise.

A variance is the mean of N squares of Gaussian differences; the covariance of two of them is ::

    cov(v1, v2) = 2 / (N1 N2 d^2) sum over lags of (number of pairs) R12(lag)^2,

R12 being the covariance of the differences and d the divisor of the variance (2 for Allan, 6 for Hadamard). R12 is the sum of the
levels times the shapes of the terms, so that one table of products of shapes serves all levels, axes and steps of a fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...frames import Array
from ..curves.allan import Variances, octaves
from .lag_sums import Lags, nodes
from .terms import LINEAR, ORDER, lag_covariance, variance

_MOST_LENGTHS = 6
"""Different lengths of stretches that are worked out one by one; of more, those within an octave are taken at their mean."""


@dataclass(frozen=True)
class Stretch:
    """Uninterrupted stretches of equal length.

    Attributes
    ----------
    samples : int
    often : int
        How many there are.
    counts : tuple of float
        Differences that one gave to each averaging time.
    """

    samples: int
    often: int
    counts: tuple[float, ...]


@dataclass(frozen=True)
class Layout:
    """What the covariance depends on besides the noise.

    Attributes
    ----------
    kind : str
        ``allan`` or ``hadamard``.
    factors : tuple of int
        Averaging factors in rising order.
    stretches : tuple of Stretch
        The longest last.
    """

    kind: str
    factors: tuple[int, ...]
    stretches: tuple[Stretch, ...]

    @property
    def samples(self) -> int:
        """Of all stretches together."""
        return sum(s.samples * s.often for s in self.stretches)

    @property
    def longest(self) -> int:
        """Samples of the longest stretch."""
        return self.stretches[-1].samples


def layout(v: Variances, used: list[int] | None = None) -> Layout:
    """Layout of variances, of one stretch or pooled.

    Parameters
    ----------
    v : Variances
    used : list of int, optional
        Numbers of the averaging times that are taken; all when there is no list.

    Raises
    ------
    InputError
        For a kind without a model.
    """
    if v.kind not in ORDER:
        raise InputError(f"The terms are identified from the allan or hadamard variance, not from the {v.kind} one.")
    pick = list(range(len(v.factors))) if used is None else used
    parts = v.stretches or ((v.samples, v.count),)
    often = v.often or (1,) * len(parts)
    given = [(n, counts[pick], k) for (n, counts), k in zip(parts, often, strict=True) if counts[pick].any()]
    given.sort(key=lambda s: s[0])
    few = len({n for n, _, _ in given}) <= _MOST_LENGTHS
    groups: dict[tuple[int, bytes], list[tuple[int, NDArray[np.int64], int]]] = {}
    for n, counts, k in given:
        # of many lengths, those of an octave that tell the same averaging times: their mean tells these as well; what a run
        # tells between its losses and across them never goes together, that would be two runs of half the differences
        key = (n if few else math.floor(math.log2(n)), (counts > 0).tobytes())
        groups.setdefault(key, []).append((n, counts, k))
    stretches = []
    for group in groups.values():
        number = sum(k for _, _, k in group)
        mean = sum(n * k for n, _, k in group) / number
        counts = np.sum([c for _, c, _ in group], axis=0) / number
        stretches.append(Stretch(round(mean), number, tuple(float(c) for c in counts)))
    return Layout(v.kind, tuple(int(m) for m in v.factors[pick]), tuple(stretches))


def whole(kind: str, samples: int) -> Layout:
    """Layout of one record at octaves of the averaging time.

    Parameters
    ----------
    kind : str
    samples : int
    """
    if kind not in ORDER:
        raise InputError(f"The terms are identified from the allan or hadamard variance, not from the {kind} one.")
    factors = octaves(samples, kind)
    count = samples + 1 - ORDER[kind] * factors
    return Layout(kind, tuple(int(m) for m in factors), (Stretch(samples, 1, tuple(float(c) for c in count)),))


def design(plan: Layout, keys: tuple[str, ...], decay: float = 0.0) -> Array:
    """Variances of terms of level one, shape (k, terms).

    Parameters
    ----------
    plan : Layout
    keys : tuple of str
    decay : float
        Of ``markov``: interval over correlation time.
    """
    m = np.asarray(plan.factors, dtype=float)
    return np.column_stack([variance(key, m, plan.kind, decay) for key in keys]) if keys else np.zeros((m.size, 0))


def covariance_table(plan: Layout, keys: tuple[str, ...], decay: float = 0.0) -> Array:
    """Products of shapes, shape (terms, terms, k, k): the covariance is their sum, each times two levels.

    A ramp, which is no random process, multiplies each other term: (g1 + d1)^2 and (g2 + d2)^2 with Gaussian g have the
    covariance 2 R12^2 + 4 d1 d2 R12.

    Parameters
    ----------
    plan : Layout
    keys : tuple of str
    decay : float
    """
    names = (*LINEAR, "markov") if "markov" in keys else LINEAR
    total = np.zeros((len(names), len(names), len(plan.factors), len(plan.factors)))
    every = np.sum([s.often * np.asarray(s.counts) for s in plan.stretches], axis=0)
    for s in plan.stretches:
        inside = [i for i, m in enumerate(plan.factors) if s.counts[i] > 0.0 and s.samples + 1 > ORDER[plan.kind] * m]
        factors = tuple(plan.factors[i] for i in inside)
        share = (np.asarray(s.counts) / every)[inside]
        own = _table(s.samples, factors, plan.kind, decay if "markov" in keys else 0.0)
        at = np.asarray(inside)
        total[:, :, at[:, None], at] += s.often * own * np.outer(share, share)
    pick = [names.index(key) for key in keys]
    return total[np.ix_(pick, pick)]


@lru_cache(maxsize=32)
def _shapes(samples: int, factors: tuple[int, ...], kind: str) -> tuple[Lags, Array]:
    """Nodes of a stretch, and the covariances of the linear terms there, shape (5, nodes)."""
    lags = nodes(samples, factors, kind)
    return lags, np.stack([lag_covariance(key, kind, lags.first, lags.second, lags.lag) for key in LINEAR])


@lru_cache(maxsize=256)
def _table(samples: int, factors: tuple[int, ...], kind: str, decay: float) -> Array:
    """Table of the linear terms over one stretch, and of Gauss-Markov as the last one where its decay is not zero."""
    lags, rows = _shapes(samples, factors, kind)
    size = len(LINEAR) + (decay > 0.0)
    out = np.empty((size, size, lags.size, lags.size))
    if decay > 0.0:
        out[:-1, :-1] = _table(samples, factors, kind, 0.0)
        rows = np.vstack([rows, lag_covariance("markov", kind, lags.first, lags.second, lags.lag, decay)])
    for j in range(len(LINEAR) if decay > 0.0 else 0, size):
        for i in range(j + 1):
            out[i, j] = out[j, i] = _sums(lags, rows[i] * rows[j])
    ramp = LINEAR.index("ramp")
    out[ramp, ramp] = 0.0
    return out


def _sums(lags: Lags, products: Array) -> Array:
    """Weighted sums over the nodes of each pair, shape (k, k)."""
    out = np.empty((lags.size, lags.size))
    i, j = np.triu_indices(lags.size)
    out[i, j] = out[j, i] = np.add.reduceat(lags.weight * products, lags.starts)
    return out
