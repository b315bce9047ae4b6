"""Distribution of a weighted sum of Allan (or Hadamard) variances of Gaussian noise: its tails by a saddle point.

Each variance is a mean of squares, so that a weighted sum of them is a sum of squares of independent normal numbers, each times
an eigenvalue. Skewness comes from the few differences at the longest averaging times. These are taken at few places of the
record, with their exact covariance, and everything else counts as normal. Lugannani and Rice's formula then gives the tail
to a few percent of itself.

Sources: R. Lugannani, S. Rice, "Saddle point approximation for the distribution of the sum of independent random variables",
Adv. Appl. Prob. 12 (1980) 475; D. Kuonen, "Saddlepoint approximations for distributions of quadratic forms in normal variables",
Biometrika 86 (1999) 929.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from .model_covariance import Layout, Stretch
from .terms import DIVISOR, ORDER, lag_covariance

MOST = 8.0
"""Normal score that stands for a tail of no probability."""

_PLACES = (4.0, 4.0, 3.0, 2.0)
"""Differences taken in each averaging time, of the longest averaging time first: all others count as normal."""

_FEW = 2  # different stretches; of more, half as many places of each
_JITTER = 1e-9  # of the variance of a difference: differences at neighbouring places are nearly the same
_STEPS = 60
_SETTLED = 1e-9
_MIDDLE = 1e-4  # standard deviations from the mean within which the formula loses its digits
_EDGE = 1e-9
_UNBOUNDED = 1e6


@dataclass(frozen=True)
class Squares:
    """Squares of independent normal numbers, less their mean, and a normal number: sum f s ((z + d)^2 - 1 - d^2) + r z'.

    Attributes
    ----------
    size : ndarray, shape (k,)
        s, of either sign.
    shift : ndarray, shape (k,)
        d.
    often : ndarray, shape (k,)
        How many squares of this size there are.
    rest : float
        Variance of the normal number.
    """

    size: Array
    shift: Array
    often: Array
    rest: float

    def derivatives(self, s: float) -> tuple[float, float, float]:
        """Logarithm of the moment-generating function at s, its first and its second derivative."""
        size, square = self.size, self.shift**2
        u = 1.0 - 2.0 * size * s
        value = float(self.often @ (square * size * s / u - 0.5 * np.log(u) - s * size * (1.0 + square)))
        slope = float(self.often @ (size / u + square * size / u**2 - size * (1.0 + square)))
        bend = float(self.often @ (2.0 * size**2 / u**2 + 4.0 * square * size**2 / u**3))
        return value + 0.5 * self.rest * s * s, slope + self.rest * s, bend + self.rest

    def ends(self) -> tuple[float, float]:
        """Between which s the moment-generating function is finite."""
        low, high = float(self.size.min(initial=0.0)), float(self.size.max(initial=0.0))
        return (
            0.5 / low * (1.0 - _EDGE) if low < -_EDGE else -_UNBOUNDED,
            0.5 / high * (1.0 - _EDGE) if high > _EDGE else _UNBOUNDED,
        )


def normal_score(value: float, squares: Squares) -> float:
    """Number that a standard normal one is as likely to stay below as the sum is to stay below a value.

    Parameters
    ----------
    value : float
        In standard deviations of the sum, whose variance is one.
    squares : Squares

    Returns
    -------
    float
        From minus to plus :data:`MOST`.
    """
    t = value if abs(value) > _MIDDLE else math.copysign(_MIDDLE, value)
    s = _saddle(t, squares)
    if s is None:
        return math.copysign(MOST, t)
    rise, _, bend = squares.derivatives(s)
    root = math.copysign(math.sqrt(max(2.0 * (s * t - rise), 0.0)), s)
    other = s * math.sqrt(bend)
    if abs(root) < _MIDDLE:
        return root
    return min(max(root + math.log(other / root) / root, -MOST), MOST)


def _saddle(t: float, squares: Squares) -> float | None:
    """Where the slope of the logarithm of the moment-generating function is t; none where the sum does not reach t."""
    low, high = squares.ends()
    low, high = (low, 0.0) if t < 0.0 else (0.0, high)
    s = min(max(t, 0.5 * low), 0.5 * high) if t > 0.0 else max(t, 0.5 * low)
    if not squares.derivatives(low)[1] < t < squares.derivatives(high)[1]:
        return None
    for _ in range(_STEPS):
        _, slope, bend = squares.derivatives(s)
        if abs(slope - t) < _SETTLED:
            break
        low, high = (low, s) if slope > t else (s, high)
        s += (t - slope) / bend
        if not low < s < high:
            s = 0.5 * (low + high)
    return s


@dataclass(frozen=True)
class _Places:
    """Differences of one stretch that are looked at one by one.

    Attributes
    ----------
    often : int
        Stretches of this kind.
    factor, middle : ndarray, shape (p,)
        Averaging factor, and middle in the stretch, samples.
    of : ndarray of int, shape (p,)
        Number of the averaging factor.
    share : ndarray, shape (p,)
        Part that the square has in the variance of that factor.
    """

    often: int
    factor: Array
    middle: Array
    of: NDArray[np.int64]
    share: Array


def squares(
    plan: Layout, keys: tuple[str, ...], decay: float, levels: Array, weights: Array, variance: float
) -> Squares:
    """The sum of variances with given weights, in standard deviations.

    Parameters
    ----------
    plan : Layout
    keys : tuple of str
        Terms of the noise.
    decay : float
        Of ``markov``.
    levels : ndarray, shape (terms,)
    weights : ndarray, shape (k,)
        Of the variances.
    variance : float
        Of the sum, exact.
    """
    ramp = math.sqrt(float(levels[keys.index("ramp")])) if "ramp" in keys else 0.0
    random = [(key, level) for key, level in zip(keys, levels, strict=True) if key != "ramp" and level > 0.0]
    parts = [np.zeros((3, 0))]
    for i, places in enumerate(_places(plan)):
        if random and places.factor.size:
            shape = sum(level * _shape(plan, key, decay if key == "markov" else 0.0)[i] for key, level in random)
            size, shift = _principal(np.asarray(shape), weights[places.of] * places.share, ramp * places.factor)
            parts.append(np.stack([size, shift, np.full(size.size, float(places.often))]))
    size, shift, often = np.concatenate(parts, axis=1)
    size = size / math.sqrt(variance)
    spread = float(often @ (2.0 * size**2 * (1.0 + 2.0 * shift**2)))
    # few places tell a little less than all differences
    return Squares(size / math.sqrt(max(spread, 1.0)), shift, often, max(1.0 - spread, 0.0))


def _principal(covariance: Array, weights: Array, mean: Array) -> tuple[Array, Array]:
    """Sizes and shifts of the independent squares of y' diag(weights) y."""
    root = np.linalg.cholesky(covariance + _JITTER * np.diag(np.diag(covariance)))
    product = root.T @ (weights[:, None] * root)
    if not mean.any():
        size = np.linalg.eigvalsh(product)
        return np.asarray(size), np.zeros_like(size)
    size, turn = np.linalg.eigh(product)
    return np.asarray(size), np.asarray(turn.T @ np.linalg.solve(root, mean))


@lru_cache(maxsize=32)
def _places(plan: Layout) -> tuple[_Places, ...]:
    every = np.sum([s.often * np.asarray(s.counts) for s in plan.stretches], axis=0)
    dense = 1.0 if len(plan.stretches) <= _FEW else 0.5
    return tuple(_of_stretch(plan, s, every, dense) for s in plan.stretches)


def _of_stretch(plan: Layout, s: Stretch, every: Array, dense: float) -> _Places:
    rows = [np.zeros((4, 0))]
    span = ORDER[plan.kind]
    for i, often in zip(range(len(plan.factors) - 1, -1, -1), _PLACES, strict=False):
        m = plan.factors[i]
        count = s.samples + 1 - span * m
        if count <= 0 or not s.counts[i] > 0.0:
            continue
        number = min(count, math.ceil(dense * often * count / m) + 1)
        # whole samples, so that their distances are lags
        first = np.floor((np.arange(number) + 0.5) * count / number)
        share = s.counts[i] / (every[i] * DIVISOR[plan.kind] * number)
        rows.append(
            np.stack([np.full(number, float(m)), first + 0.5 * span * m, np.full(number, i), np.full(number, share)])
        )
    factor, middle, of, share_of = np.concatenate(rows, axis=1)
    return _Places(s.often, factor, middle, of.astype(np.int64), share_of)


@lru_cache(maxsize=64)
def _shape(plan: Layout, key: str, decay: float) -> tuple[Array, ...]:
    """Covariance of the differences of each stretch, of a term of level one."""
    out = []
    for places in _places(plan):
        first, second = np.meshgrid(places.factor, places.factor, indexing="ij")
        lag = np.abs(places.middle[:, None] - places.middle[None, :])
        low, high = np.minimum(first, second), np.maximum(first, second)
        found = lag_covariance(key, plan.kind, low.ravel(), high.ravel(), lag.ravel(), decay)
        out.append(found.reshape(lag.shape))
    return tuple(out)
