"""The filter behind :mod:`sagnac.registry.drift`, and the grid of scatters that it is run over: plain arrays, many lanes at once.

Each lane is one history with one pair (w, q) of white scatter and random walk, in the history's own units: its length is one,
its scatter about the straight line about one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..frames import Array

SHARES = (0.02, 0.02, 0.48, 0.48)
"""Of each model before the data: no scatter besides the stated one, white, walk, both.

What a few calibrations have not shown may be there all the same. With a quarter each, intervals of units without scatter would
be half as long, but those of 95 % would hold the drift in 79 % of the cases where a random walk hides among the stated
uncertainties, instead of in 91 % and more. To learn the shares from the other parameters of a unit is no way out: one of them
that wanders would be taken for one that does not.
"""
WALK_SCALE = 2.0
"""Scale of the prior of the walk over the whole history, in stated uncertainties."""
_FAR = 30.0
"""Largest scatter considered, in scatters about the straight line."""
_CLOSER = 3.0
"""Power by which cells that reach down to nothing widen."""
_NATS = 9.0
"""Log-likelihood below the greatest from which a cell does not count."""
_TOGETHER = 8
"""Numbers whose product is taken before its logarithm: each is within 1e-18 and 1e5."""
_FLOOR = 1e-9
"""Least standard uncertainty, in scatters: of values that are stated as exact."""


@dataclass(frozen=True)
class Scaled:
    """Histories in their own units.

    Attributes
    ----------
    time, value, variance : ndarray, shape (s, n)
        Of infinite variance where there is no calibration.
    length, middle, size : ndarray, shape (s,)
        One unit of time [s]; what was taken from the values and what they were divided by.
    stated : ndarray, shape (s,)
        The typical stated uncertainty.
    count : ndarray of int, shape (s,)
    """

    time: Array
    value: Array
    variance: Array
    length: Array
    middle: Array
    size: Array
    stated: Array
    count: NDArray[np.int64]


def scaled(time: Array, value: Array, sigma: Array) -> Scaled:
    """Histories in their own units.

    Parameters
    ----------
    time, value, sigma : ndarray, shape (s, n)
        s, SI; `sigma` is infinite where there is no calibration.
    """
    real = np.isfinite(sigma)
    count = real.sum(axis=1)
    length = time[:, -1] - time[:, 0]
    own = (time - time[:, :1]) / length[:, None]
    middle = np.where(real, value, 0.0).sum(axis=1) / count
    level = np.where(real, value - middle[:, None], 0.0)
    around = np.where(real, own - np.where(real, own, 0.0).sum(axis=1, keepdims=True) / count[:, None], 0.0)
    slope = (around * level).sum(axis=1) / (around**2).sum(axis=1)
    scatter = np.sqrt(((level - slope[:, None] * around) ** 2).sum(axis=1) / (count - 2))
    stated = medians(sigma, count)
    rounding = 1e-12 * np.abs(np.where(real, value, 0.0)).max(axis=1)
    size = np.maximum(np.maximum(scatter, stated), rounding)
    size = np.where(size > 0, size, 1.0)
    stated = np.where(stated > _FLOOR * size, stated, np.maximum(scatter, rounding)) / size
    variance = np.maximum(sigma / size[:, None], _FLOOR) ** 2
    return Scaled(own, level / size[:, None], variance, length, middle, size, np.maximum(stated, _FLOOR), count)


def medians(rows: Array, count: NDArray[np.int64]) -> Array:
    """Median of the `count` least numbers of each row, shape (s,); that of NumPy loads masked arrays for it."""
    ascending, row = np.sort(rows, axis=1), np.arange(len(rows))
    return np.asarray((ascending[row, (count - 1) // 2] + ascending[row, count // 2]) / 2)


@dataclass(frozen=True)
class Axis:
    """Values of one kind of scatter, the first of them nothing, the others in the middles of cells.

    Attributes
    ----------
    edges : ndarray, shape (s, k + 1)
        Of the cells, ascending; the first cell reaches down to nothing where `edges` begins with zero.
    scale, top : ndarray, shape (s,)
        Of the prior: its density is 1 / (u + scale) up to `top`.
    """

    edges: Array
    scale: Array
    top: Array

    @property
    def values(self) -> Array:
        """Shape (s, k + 1)."""
        low, high = self.edges[:, :-1], self.edges[:, 1:]
        middles = np.where(low > 0, np.sqrt(low * high), high / 2)
        return np.concatenate([np.zeros((len(low), 1)), middles], axis=1)

    @property
    def prior(self) -> Array:
        """Logarithm of the probability of each cell, given that there is scatter; zero for none. Shape (s, k + 1)."""
        scale = self.scale[:, None]
        cells = np.diff(np.log(self.edges + scale), axis=1) / np.log1p(self.top[:, None] / scale)
        return np.concatenate([np.zeros((len(cells), 1)), np.log(cells)], axis=1)

    def over_all(self) -> Axis:
        """One axis for all histories, in stated uncertainties, up to the farthest of any of them."""
        top = (self.top / self.scale).max()
        return Axis(self.edges[:1] / self.edges[0, -1] * top, np.ones(1), np.array([top]))

    def closer(self, score: Array, cells: int) -> Axis:
        """The stretch of cells that count, divided anew, with a cell more on each side.

        Parameters
        ----------
        score : ndarray, shape (s, k + 1)
            Greatest logarithm of the posterior of each value over the other kind of scatter, less the greatest of all.
        cells : int
        """
        counts = score[:, 1:] > -_NATS
        some, k = counts.any(axis=1), counts.shape[1]
        first = np.where(some, np.maximum(counts.argmax(axis=1) - 1, 0), 0)
        last = np.where(some, np.minimum(k - counts[:, ::-1].argmax(axis=1), k - 1), 0)
        row = np.arange(len(first))
        low, high = self.edges[row, first], self.edges[row, last + 1]
        inside = (low > 0)[:, None]
        start = np.where(low > 0, low, high)
        edges = np.where(inside, _between(start, high, cells), _from_nothing(high, cells))
        return Axis(edges, self.scale, self.top)


def _between(low: Array, high: Array, cells: int) -> Array:
    """Geometric edges, shape (s, cells + 1)."""
    return np.asarray(low[:, None] * (high / low)[:, None] ** (np.arange(cells + 1) / cells))


def _from_nothing(top: Array, cells: int) -> Array:
    """Edges from nothing on, closer at the lower end, shape (s, cells + 1): a scatter that hardly shows has a flat likelihood."""
    return np.asarray(top[:, None] * (np.arange(cells + 1) / cells) ** _CLOSER)


def axes_of(own: Scaled, cells: int) -> tuple[Axis, Axis]:
    """Axes of the white scatter and of the walk over a whole history.

    Parameters
    ----------
    own : Scaled
    cells : int
    """
    far = np.full(len(own.stated), _FAR)
    farther = _FAR * np.sqrt(own.count)
    return (
        Axis(_from_nothing(far, cells), own.stated, far),
        Axis(_from_nothing(farther, cells), WALK_SCALE * own.stated, farther),
    )


@dataclass(frozen=True)
class Grid:
    """All pairs of two axes.

    Attributes
    ----------
    white, walk : ndarray, shape (s, g)
        Both as standard deviations, that of the walk over the length of the history.
    prior : ndarray, shape (s, g)
        Its logarithm.
    """

    white: Array
    walk: Array
    prior: Array

    @classmethod
    def of(cls, white: Axis, walk: Axis) -> Grid:
        """The pairs."""
        s, k = white.values.shape
        shares = np.full((k, k), SHARES[3])
        shares[0, 0], shares[1:, 0], shares[0, 1:] = SHARES[:3]
        prior = np.log(shares) + white.prior[:, :, None] + walk.prior[:, None, :]
        both = np.broadcast_to(white.values[:, :, None], (s, k, k)), np.broadcast_to(walk.values[:, None, :], (s, k, k))
        return cls(both[0].reshape(s, -1), both[1].reshape(s, -1), prior.reshape(s, -1))


@dataclass(frozen=True)
class Filtered:
    """What a filter has come to, shape (s, g) each.

    With the drift b, the level at the last time is ``value + b (time of the last - lever)``.

    Attributes
    ----------
    likelihood : ndarray
        Logarithm of the restricted likelihood, up to a constant of the history.
    drift, information : ndarray
        Estimate and inverse variance.
    value, lever, variance : ndarray
        Filtered values and times, variance of the level given the drift.
    """

    likelihood: Array
    drift: Array
    information: Array
    value: Array
    lever: Array
    variance: Array


def run(own: Scaled, white: Array, walk: Array, *, compiled: bool = False) -> Filtered:
    """The augmented filter: values and times are filtered by the same gains, and the drift is what regresses one on the other.

    Parameters
    ----------
    own : Scaled
        With a calibration at the first time.
    white, walk : ndarray, shape (s, g)
        Variances.
    compiled : bool
        Whether by the compiled loop, whose library takes a quarter of a second to load.
    """
    if compiled:
        from ..kernels.wander import filter_rows

        out = np.empty((6, *white.shape))
        filter_rows(own.time, own.value, own.variance, white, walk, 0, len(white), out)
        return Filtered(*out)
    shape = white.shape
    seen, state = np.stack([own.value, own.time]), np.empty((2, *shape))
    state[:] = seen[:, :, :1]
    variance = own.variance[:, :1] + white
    logs, product, cross = np.zeros(shape), np.ones(shape), np.zeros(shape)
    squares = np.zeros_like(state)  # of values, and of times: the information about the drift
    total, ahead, weighted = np.empty(shape), np.empty_like(state), np.empty_like(state)
    between, there = np.diff(own.time, axis=1), np.isfinite(own.variance)
    whole = np.asarray(there.all(axis=0))
    for k in range(1, own.time.shape[1]):  # in place: making arrays anew would take a third of the time
        variance += np.multiply(walk, between[:, k - 1 : k], out=total)
        np.add(own.variance[:, k : k + 1], white, out=total)
        total += variance
        product *= total if whole[k] else np.where(there[:, k : k + 1], total, 1.0)
        if k % _TOGETHER == 0:
            logs += np.log(product)
            product[:] = 1.0
        np.subtract(seen[:, :, k : k + 1], state, out=ahead)
        np.divide(ahead, total, out=weighted)
        cross += weighted[1] * ahead[0]
        squares += np.multiply(weighted, ahead, out=ahead)
        weighted *= variance
        state += weighted
        np.divide(variance, total, out=total)  # the gain
        total *= variance
        variance -= total
    information = squares[1]
    drift = cross / information
    likelihood = -0.5 * (logs + np.log(product) + np.log(information) + squares[0] - drift * cross)
    return Filtered(likelihood, drift, information, state[0], state[1], variance)


def smooth(own: Scaled, white: Array, walk: Array, filtered: Filtered) -> tuple[Array, Array]:
    """The level of one history at all its times, also those without a calibration, given pairs of scatters.

    Filter and smoother of Rauch, Tung and Striebel (1965) on values and times alike.

    Parameters
    ----------
    own : Scaled
        One history; the variance is infinite where there is no calibration.
    white, walk : ndarray, shape (1, g)
        Variances.
    filtered : Filtered
        What :func:`run` has come to with them.

    Returns
    -------
    mean, sigma : ndarray, shape (n, g)
    """
    time, n = own.time[0], own.time.shape[1]
    lanes = white.shape[1]
    states, variances, ahead = np.empty((n, 2, lanes)), np.empty((n, lanes)), np.empty((n, lanes))
    states[0], variances[0] = np.array([own.value[0, 0], time[0]])[:, None], own.variance[0, 0] + white[0]
    for k in range(1, n):
        ahead[k] = variances[k - 1] + walk[0] * (time[k] - time[k - 1])
        noise = own.variance[0, k] + white[0]
        gain = ahead[k] / (ahead[k] + noise)
        states[k] = states[k - 1] + gain * (np.array([own.value[0, k], time[k]])[:, None] - states[k - 1])
        variances[k] = 1.0 / (1.0 / ahead[k] + 1.0 / noise)  # never nothing, however sure the calibration is
    for k in range(n - 2, -1, -1):
        back = variances[k] / ahead[k + 1]
        states[k] += back * (states[k + 1] - states[k])
        variances[k] += back**2 * (variances[k + 1] - ahead[k + 1])
    lever = time[:, None] - states[:, 1]
    mean = states[:, 0] + filtered.drift * lever
    return mean, np.sqrt(np.maximum(variances, 0.0) + lever**2 / filtered.information)
