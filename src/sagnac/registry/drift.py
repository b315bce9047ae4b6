"""Straight line, random walk and excess scatter through calibrations at irregular times: one model, many histories at once.

The model of one parameter of one unit, calibrated at the times t_i with the stated standard uncertainties s_i, is ::

    y_i = x(t_i) + e_i,         e_i ~ N(0, s_i^2 + w^2)
    dx  = b dt + sqrt(q) dW

with the drift b, the white scatter w beyond what is stated (run to run) and the random walk q. The level of x at the first
calibration is diffuse, b is estimated by generalised least squares inside the filter (the augmented filter of de Jong 1991),
which gives the exact restricted likelihood of (w, q) for any times (Harvey 1989, sections 3.4 and 4.4).

A handful of calibrations does not tell w and q, and a drift with the uncertainty of the best pair alone is too sure of itself.
So (w, q) is integrated over a grid that closes in on where the likelihood is, and every answer is a mixture of normal
distributions. The prior of w and of sqrt(q T), T the length of the history, has the density 1 / (u + c), flat up to the scale c
of the stated uncertainties and scale-free beyond, with a share for exactly nothing (:data:`sagnac.registry.scatter.SHARES`).

References
----------
P. de Jong, The diffuse Kalman filter, Annals of Statistics 19 (1991) 1073-1083.
A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, Cambridge 1989.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..frames import Array
from .probability import normal_below
from .scatter import Axis, Filtered, Grid, Scaled, axes_of, run, scaled, smooth

_In = TypeVar("_In")
_Out = TypeVar("_Out")
Model = Literal["stated", "white", "walk", "white and walk"]
MODELS: tuple[Model, ...] = ("stated", "white", "walk", "white and walk")
"""What scatters: no more than the stated uncertainties, white scatter besides, a random walk, both."""
_STAGES = (8, 9, 12)
"""Cells of w and of q in each round of closing in."""
_SEEN = 1e-4
"""Weight of a pair from which it is drawn."""
_REST = 1e-6
"""Weight of the components of a mixture that are left out, all together."""
_SETTLED = 1e-7
"""Probability within which a quantile is found."""
_LARGE = 100_000
"""Calibrations from which compiled filters are worth loading."""
_LANES = 8192
"""Filters run side by side, so that their states stay in the cache."""


@dataclass(frozen=True)
class Histories:
    """Histories side by side, one row each, shorter ones filled up at the end.

    Attributes
    ----------
    time : ndarray, shape (s, n)
        s, ascending in each row; the filling repeats the last one.
    value, sigma : ndarray, shape (s, n)
        SI; the filling has an infinite `sigma`. Each row has three calibrations or more, at two or more times.
    """

    time: Array
    value: Array
    sigma: Array

    @property
    def many(self) -> bool:
        """Whether loading compiled filters is worth it."""
        return self.time.size > _LARGE

    def rows(self, chosen: slice | list[int]) -> Histories:
        """Some of them."""
        return Histories(self.time[chosen], self.value[chosen], self.sigma[chosen])


@dataclass(frozen=True)
class Posterior:
    """What is known of each history: a mixture over pairs (w, q).

    Attributes
    ----------
    weight : ndarray, shape (s, g)
        Of the pairs, adding up to one.
    white, walk : ndarray, shape (s, g)
        w [unit] and q [unit^2/s].
    drift, drift_sigma : ndarray, shape (s, g)
        b given the pair [unit/s].
    level, lever, variance : ndarray, shape (s, g)
        At `last`, given the pair and b: x = level + b lever [s], with this variance.
    last : ndarray, shape (s,)
        Time of the last calibration, s.
    model : ndarray of int, shape (s,)
        Which of :data:`MODELS` describes the history best (Akaike's criterion on the restricted likelihood).
    best : ndarray of int, shape (s,)
        The likeliest pair of that model.
    """

    weight: Array
    white: Array
    walk: Array
    drift: Array
    drift_sigma: Array
    level: Array
    lever: Array
    variance: Array
    last: Array
    model: NDArray[np.int64]
    best: NDArray[np.int64]

    def at(self, time: Array, *, white: bool = False) -> tuple[Array, Array]:
        """Components of the mixture of x at a time not before the last calibration.

        Parameters
        ----------
        time : ndarray, shape (s,)
        white : bool
            Whether with the white scatter, as another calibration would find it.

        Returns
        -------
        mean, sigma : ndarray, shape (s, g)
        """
        ahead = (time - self.last)[:, None]
        lever = self.lever + ahead
        variance = self.variance + self.walk * ahead + (lever * self.drift_sigma) ** 2
        return self.level + self.drift * lever, np.sqrt(variance + self.white**2 if white else variance)


def quantiles(weight: Array, mean: Array, sigma: Array, levels: tuple[float, ...]) -> Array:
    """Quantiles of mixtures of normal distributions.

    Parameters
    ----------
    weight, mean, sigma : ndarray, shape (s, g)
    levels : tuple of float

    Returns
    -------
    ndarray, shape (len(levels), s)
    """
    size = max(1, _LANES // weight.shape[1])
    pieces = [slice(i, i + size) for i in range(0, len(weight), size)]
    found = in_threads(lambda rows: _quantiles(*_heaviest(weight[rows], mean[rows], sigma[rows]), levels), pieces)
    return np.concatenate(found, axis=1)


def _heaviest(weight: Array, mean: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """The components that make up all but :data:`_REST` of each mixture."""
    order = np.argsort(-weight, axis=1)
    heavy = np.take_along_axis(weight, order, axis=1)
    count = 1 + int((np.cumsum(heavy, axis=1) < 1.0 - _REST).sum(axis=1).max())
    chosen = order[:, :count]
    own = heavy[:, :count] / heavy[:, :count].sum(axis=1, keepdims=True)
    return own, np.take_along_axis(mean, chosen, axis=1), np.take_along_axis(sigma, chosen, axis=1)


def _quantiles(weight: Array, mean: Array, sigma: Array, levels: tuple[float, ...]) -> Array:
    """Quantiles by Newton's method, by halving where a step would leave the bracket."""
    least, most = (mean - 9 * sigma).min(axis=1), (mean + 9 * sigma).max(axis=1)
    sharpest = 1e-12 * (np.abs(mean).max(axis=1) + most - least) + 1e-290  # a number is no sharper than its rounding
    spread = np.maximum(sigma, sharpest[:, None])
    out = []
    middle = (weight * mean).sum(axis=1)
    around = np.sqrt((weight * (sigma**2 + (mean - middle[:, None]) ** 2)).sum(axis=1))
    for level in levels:
        low, high = least - 9 * sharpest, most + 9 * sharpest
        at = middle + 4.91 * (level**0.14 - (1 - level) ** 0.14) * around  # near that of one normal distribution
        left = np.arange(len(at))
        for _ in range(60):
            here, share, wide = at[left], weight[left], spread[left]
            below, bell = normal_below(np.clip((here[:, None] - mean[left]) / wide, -25, 25))
            over = (share * below).sum(axis=1) - level
            low[left], high[left] = np.where(over < 0, here, low[left]), np.where(over < 0, high[left], here)
            density = (share / wide * bell).sum(axis=1)
            step = here - over / np.maximum(density, 1e-300)
            new = np.where((step > low[left]) & (step < high[left]), step, (low[left] + high[left]) / 2)
            going = np.abs(over) > _SETTLED
            left = left[going]
            at[left] = new[going]
            if not left.size:
                break
        out.append(at)
    return np.array(out)


def in_threads(job: Callable[[_In], _Out], pieces: Sequence[_In]) -> list[_Out]:
    """A job over pieces: in the threads that there are, where there are several pieces."""
    if len(pieces) < 2:
        return [job(piece) for piece in pieces]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(job, pieces))


def infer(histories: Histories) -> Posterior:
    """Drift, scatter and level of each history.

    Parameters
    ----------
    histories : Histories

    Returns
    -------
    Posterior
    """
    size = max(1, _LANES // (max(_STAGES) + 1) ** 2)
    pieces = [histories.rows(slice(i, i + size)) for i in range(0, len(histories.time), size)]
    found = in_threads(lambda piece: _piece(piece, compiled=histories.many), pieces)
    return Posterior(*(np.concatenate([getattr(f, k.name) for f in found]) for k in fields(Posterior)))


def _piece(histories: Histories, *, compiled: bool) -> Posterior:
    own = scaled(histories.time, histories.value, histories.sigma)
    grid, found, weight = _closed_in(
        *axes_of(own, _STAGES[0]),
        lambda grid: run(own, grid.white**2, grid.walk**2, compiled=compiled),
        lambda likelihood: likelihood,
    )
    model, best = _best(found.likelihood, _STAGES[-1] + 1)
    size, length = own.size[:, None], own.length[:, None]
    return Posterior(
        weight=weight,
        white=grid.white * size,
        walk=(grid.walk * size) ** 2 / length,
        drift=found.drift * size / length,
        drift_sigma=size / length / np.sqrt(found.information),
        level=own.middle[:, None] + found.value * size,
        lever=(1.0 - found.lever) * length,
        variance=found.variance * size**2,
        last=histories.time[:, -1],
        model=model,
        best=best,
    )


def pooled(histories: Histories, *, compiled: bool = False) -> tuple[Array, Array]:
    """Drift of each of several histories, all of which scatter alike.

    One w, in stated uncertainties, and one q, in squares of them per time, are estimated from all histories together: a scatter
    that one of them alone cannot rule out, many of them can.

    Parameters
    ----------
    histories : Histories
    compiled : bool
        Whether by compiled filters.

    Returns
    -------
    drift, sigma : ndarray, shape (s,)
        Mean and standard deviation over what w and q may be [unit/s].
    """
    own = scaled(histories.time, histories.value, histories.sigma)
    size, longest = own.stated[:, None], own.length.max()
    wander = size * np.sqrt(own.length[:, None] / longest)
    white, walk = (a.over_all() for a in axes_of(own, _STAGES[0]))

    def filtered(grid: Grid) -> Filtered:
        shape = len(size), grid.white.shape[1]
        pairs = np.broadcast_to((size * grid.white) ** 2, shape), np.broadcast_to((wander * grid.walk) ** 2, shape)
        return run(own, *pairs, compiled=compiled)

    _, found, weight = _closed_in(white, walk, filtered, lambda likelihood: likelihood.sum(axis=0, keepdims=True))
    drift = (weight * found.drift).sum(axis=1)
    variance = (weight * (1.0 / found.information + (found.drift - drift[:, None]) ** 2)).sum(axis=1)
    return drift * own.size / own.length, np.sqrt(variance) * own.size / own.length


def _closed_in(
    white: Axis, walk: Axis, filtered: Callable[[Grid], Filtered], together: Callable[[Array], Array]
) -> tuple[Grid, Filtered, Array]:
    """The pairs that count, what the filter has come to with them, and their weights, which add up to one in each row.

    Parameters
    ----------
    white, walk : Axis
        All that is considered.
    filtered : callable
        Runs the filter over a grid.
    together : callable
        Likelihood of each row of the axes from that of the histories.
    """
    grid = Grid.of(white, walk)
    found = filtered(grid)
    for cells in _STAGES[1:]:
        k = white.edges.shape[1]
        table = _scores(grid, together(found.likelihood)).reshape(-1, k, k)
        white, walk = white.closer(table.max(axis=2), cells), walk.closer(table.max(axis=1), cells)
        grid = Grid.of(white, walk)
        found = filtered(grid)
    weight = np.exp(_scores(grid, together(found.likelihood)))
    return grid, found, weight / weight.sum(axis=1, keepdims=True)


def _scores(grid: Grid, likelihood: Array) -> Array:
    """Logarithm of the posterior, less its greatest value, shape (s, g)."""
    score = likelihood + grid.prior
    return np.asarray(score - score.max(axis=1, keepdims=True))


def _best(likelihood: Array, k: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The model with the least Akaike criterion and its likeliest pair, shape (s,) each."""
    index = np.arange(k * k).reshape(k, k)
    parts = index[:1, :1].ravel(), index[1:, 0], index[0, 1:], index[1:, 1:].ravel()
    top = np.array([likelihood[:, own].max(axis=1) for own in parts])
    likeliest = np.array([own[likelihood[:, own].argmax(axis=1)] for own in parts])
    model = (top - np.array([0.0, 1.0, 1.0, 2.0])[:, None]).argmax(axis=0)
    return model, likeliest[model, np.arange(len(model))]


def course(history: Histories, posterior: Posterior, time: Array, levels: tuple[float, ...]) -> Array:
    """Quantiles of the level of one history at any times from the first calibration on, as known from all of it.

    Parameters
    ----------
    history : Histories
        One row.
    posterior : Posterior
        Of it.
    time : ndarray, shape (m,)
        POSIX time, s.
    levels : tuple of float

    Returns
    -------
    ndarray, shape (len(levels), m)
    """
    own = scaled(history.time, history.value, history.sigma)
    asked = (np.maximum(time, history.time[0, 0]) - history.time[0, 0]) / own.length
    every = np.concatenate([own.time[0], asked])
    order = np.argsort(every, kind="stable")
    there = np.concatenate([own.variance[0], np.full(asked.size, np.inf)])[order]
    value = np.concatenate([own.value[0], np.zeros(asked.size)])[order]
    wide = Scaled(every[order][None], value[None], there[None], own.length, own.middle, own.size, own.stated, own.count)
    seen = posterior.weight[0] > _SEEN * posterior.weight[0].max()
    size, length = own.size[0], own.length[0]
    white = (posterior.white[:, seen] / size) ** 2
    walk = posterior.walk[:, seen] * length / size**2
    mean, sigma = smooth(wide, white, walk, run(own, white, walk))
    place = np.argsort(order)[own.time.shape[1] :]
    weight = posterior.weight[:, seen] / posterior.weight[0, seen].sum()
    rows = np.broadcast_to(weight, (asked.size, weight.shape[1]))
    return np.asarray(own.middle[0] + size * quantiles(rows, mean[place], sigma[place], levels))
