"""Fit of levels of noise terms to the variances of one axis: generalised least squares with the covariance of the model.

Estimates solve A' C^-1 (v - A theta) = 0 with the covariance C of the variances v at theta itself, levels at or above zero:
the step is repeated until nothing moves. For Gaussian noise the covariance is exact, so that no weight is guessed from the data.

Fits are compared, and judged, on the cube roots of the variances, which are nearly normal even where few independent differences
stand behind one (Wilson & Hilferty 1931): :attr:`Fit.deviance` is minus twice the logarithm of their likelihood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from .model_covariance import Layout, covariance_table, design
from .terms import markov_slope, variance

_STEPS = 60
_SETTLED = 1e-7  # relative change of the variances of the model
_LEAST = 1e-13  # relative variance that no record goes below
_LONGEST_JUMP = 0.7  # of the logarithm of a correlation time, under one covariance
_REFRESHED = 5  # covariances, until
_CLOSE = 2e-3  # the logarithm of the correlation time stays


@dataclass(frozen=True)
class Model:
    """Terms with all that does not depend on their levels.

    Attributes
    ----------
    layout : Layout
    keys : tuple of str
    decay : float
        Of ``markov``, interval over correlation time; zero without it.
    design : ndarray, shape (k, terms)
        Variances of the terms at level one.
    table : ndarray, shape (terms, terms, k, k)
        See :func:`~sagnac.noise.identification.model_covariance.covariance_table`.
    slack : float
        Relative error that the model itself has at each averaging time, independently.
    """

    layout: Layout
    keys: tuple[str, ...]
    decay: float
    design: Array
    table: Array
    slack: float = 0.0

    def covariance(self, levels: Array) -> Array:
        """Covariance of the variances, shape (k, k)."""
        t = levels.size
        return np.asarray(np.outer(levels, levels).reshape(t * t) @ self.table.reshape(t * t, -1)).reshape(
            self.design.shape[0], -1
        )


@dataclass(frozen=True)
class Fit:
    """Levels of terms fitted to the variances of one axis.

    Attributes
    ----------
    model : Model
    levels : ndarray, shape (terms,)
        At or above zero.
    covariance : ndarray, shape (p, p)
        Of the levels, and of the logarithm of the decay where there is ``markov``; zero for levels at zero.
    expected : ndarray, shape (k,)
        Variances of the model.
    residuals : ndarray, shape (k,)
        Of the cube roots, each over its own standard deviation.
    chi2 : float
        Of the cube roots, with their correlations.
    deviance : float
        Minus twice the logarithm of the likelihood of the cube roots, up to a constant of the data.
    """

    model: Model
    levels: Array
    covariance: Array
    expected: Array
    residuals: Array
    chi2: float
    deviance: float

    @property
    def keys(self) -> tuple[str, ...]:
        """Terms of the model."""
        return self.model.keys

    def root(self) -> Array:
        """Lower triangular root of the covariance of the variances, shape (k, k)."""
        return self.expected[:, None] * _root(_relative(self.model, self.levels, self.expected))


def model(layout: Layout, keys: tuple[str, ...], decay: float = 0.0, slack: float = 0.0) -> Model:
    """Terms ready to be fitted.

    Parameters
    ----------
    layout : Layout
    keys : tuple of str
    decay : float
        Of ``markov``.
    slack : float
        Relative error of the model, see :class:`Model`.
    """
    own = decay if "markov" in keys else 0.0
    return Model(layout, keys, own, design(layout, keys, own), covariance_table(layout, keys, own), slack)


def fit(terms: Model, variances: Array, start: Array | None = None, fixed: tuple[int, float] | None = None) -> Fit:
    """Levels of terms, the correlation time of ``markov`` staying as it is.

    Parameters
    ----------
    terms : Model
    variances : ndarray, shape (k,)
        Above zero.
    start : ndarray, shape (terms,), optional
    fixed : tuple of (int, float), optional
        Number of a term and the level that it keeps.
    """
    levels = _start(terms, variances) if start is None else start.copy()
    free = np.ones(levels.size, dtype=bool)
    if fixed is not None:
        levels[fixed[0]] = fixed[1]
        free[fixed[0]] = False
    expected = terms.design @ levels
    for _ in range(_STEPS if free.any() else 0):
        root = _root(_relative(terms, levels, expected))
        known = terms.design[:, ~free] @ levels[~free]
        new = levels.copy()
        new[free] = _bounded(root, terms.design[:, free] / expected[:, None], (variances - known) / expected)
        before, levels = expected, new
        expected = _positive(terms, levels, before)
        if np.abs(expected / before - 1.0).max() < _SETTLED:
            break
    return judged(terms, variances, levels)


def fit_markov(terms: Model, variances: Array, start: Array, limits: tuple[float, float]) -> Fit:
    """Levels of terms and the correlation time of ``markov``.

    Parameters
    ----------
    terms : Model
        With ``markov``; its decay is where the search starts.
    variances : ndarray, shape (k,)
    start : ndarray, shape (terms,)
    limits : tuple of float
        Least and largest decay.
    """
    from scipy.optimize import minimize_scalar

    at = terms.keys.index("markov")
    ends = (math.log(limits[0]), math.log(limits[1]))
    found = fit(terms, variances, start)
    for _ in range(_REFRESHED):
        # the covariance stays as the last fit has it, and the correlation time moves under it
        root = found.root()
        both = np.column_stack([found.model.design, variances])
        white = np.asarray(np.linalg.solve(root, both), dtype=np.float64)

        x = math.log(found.model.decay)
        near = (max(ends[0], x - _LONGEST_JUMP), min(ends[1], x + _LONGEST_JUMP))
        search = minimize_scalar(
            _misfit, args=(terms, root, white), bounds=near, method="bounded", options={"xatol": 0.1 * _CLOSE}
        )
        best = float(search.x)
        found = fit(model(terms.layout, terms.keys, math.exp(best), terms.slack), variances, found.levels)
        if abs(best - x) < _CLOSE or found.levels[at] == 0.0:
            break
    return found


def _misfit(logarithm: float, terms: Model, root: Array, white: Array) -> float:
    """Root of chi-square at a decay under one covariance, whatever the levels are."""
    shape = variance("markov", np.asarray(terms.layout.factors), terms.layout.kind, math.exp(logarithm))
    white[:, terms.keys.index("markov")] = np.linalg.solve(root, shape)
    return _nonnegative(white[:, :-1], white[:, -1])[1]


def _start(terms: Model, variances: Array) -> Array:
    """Levels by least squares of relative residuals, each averaging time with the weight of its independent differences."""
    weight = 1.0 / np.sqrt(np.asarray(terms.layout.factors) / terms.layout.samples + 1e-4)
    levels, _ = _nonnegative(terms.design / variances[:, None] * weight[:, None], weight)
    return levels if levels.any() else np.median(variances[:, None] / terms.design, axis=0) / levels.size


def _relative(terms: Model, levels: Array, expected: Array) -> Array:
    out = terms.covariance(levels) / np.outer(expected, expected)
    out[np.diag_indices_from(out)] += terms.slack**2 + _LEAST  # a ramp without noise has no covariance
    return np.asarray(out, dtype=np.float64)


def _positive(terms: Model, levels: Array, before: Array) -> Array:
    """Variances of the model; a step to nothing at all is half a step."""
    expected = terms.design @ levels
    return np.asarray(np.where(expected > 0.0, expected, 0.5 * before))


def _root(covariance: Array) -> Array:
    """Lower triangular root."""
    return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)


def _bounded(root: Array, rows: Array, right: Array) -> Array:
    """Solution at or above zero of the whitened equations."""
    both: Array = np.linalg.solve(root, np.column_stack([rows, right])).astype(np.float64)
    return _nonnegative(both[:, :-1], both[:, -1])[0]


def _nonnegative(rows: Array, right: Array) -> tuple[Array, float]:
    """Solution at or above zero, and the root of the sum of squares that is left."""
    from scipy.optimize import nnls

    size = np.linalg.norm(rows, axis=0)
    size[size == 0.0] = 1.0
    solution, left = nnls(rows / size, right)
    return np.asarray(solution / size), float(left)


def judged(terms: Model, variances: Array, levels: Array) -> Fit:
    """Levels as they are, with their uncertainty and what the variances say to them.

    Parameters
    ----------
    terms : Model
    variances : ndarray, shape (k,)
    levels : ndarray, shape (terms,)
    """
    expected = terms.design @ levels
    relative = _relative(terms, levels, expected)
    root = _root(relative)
    share = np.diag(relative)  # 2 over the equivalent degrees of freedom
    off = 3.0 * (np.cbrt(variances / expected) - (1.0 - share / 9.0))
    white = np.linalg.solve(root, off)
    chi2 = float(white @ white)
    deviance = chi2 + 2.0 * float(np.log(np.diag(root)).sum()) + 2.0 / 3.0 * float(np.log(expected).sum())
    return Fit(
        terms, levels, _uncertainty(terms, levels, expected, root), expected, off / np.sqrt(share), chi2, deviance
    )


@dataclass(frozen=True)
class Estimate:
    """One level by least squares, the others free.

    Attributes
    ----------
    weights : ndarray, shape (k,)
        Of the variances: one for the level itself, nothing for the others.
    offset : float
        From the level of the fit.
    variance : float
        If the fit is true, of the estimate.
    """

    weights: Array
    offset: float
    variance: float


def estimate_at(found: Fit, variances: Array, number: int) -> Estimate:
    """Estimate of one level with the covariance of a fit, whether the fit is the best one or not.

    Parameters
    ----------
    found : Fit
        Terms at zero in it are left out.
    variances : ndarray, shape (k,)
    number : int
        Of the term.
    """
    terms, root = found.model, found.root()
    there: NDArray[np.bool_] = found.levels > 0.0
    there[number] = True
    rows = terms.design[:, there]
    if "markov" in terms.keys and found.levels[terms.keys.index("markov")] > 0.0:
        rows = np.column_stack([rows, _slope(terms, found.levels)])
    white = np.linalg.solve(root, rows)
    size = np.linalg.norm(white, axis=0)
    inverse = np.linalg.pinv((white / size).T @ (white / size), hermitian=True)
    own = int(np.count_nonzero(there[:number]))
    row = (inverse @ (white / size).T)[own] / size[own]
    weights = np.asarray(np.linalg.solve(root.T, row))
    return Estimate(weights, float(weights @ (variances - found.expected)), float(row @ row))


def _slope(terms: Model, levels: Array) -> Array:
    """Derivative of the variances by the logarithm of the decay."""
    return np.asarray(levels[terms.keys.index("markov")] * markov_slope(np.asarray(terms.layout.factors), terms.decay))


def _uncertainty(terms: Model, levels: Array, expected: Array, root: Array) -> Array:
    """Covariance of the levels above zero, and of the logarithm of the decay."""
    rows = terms.design
    active: NDArray[np.bool_] = levels > 0.0
    if "markov" in terms.keys:
        rows = np.column_stack([rows, _slope(terms, levels)])
        active = np.append(active, active[terms.keys.index("markov")])
    white = np.linalg.solve(root, rows[:, active] / expected[:, None])
    size = np.linalg.norm(white, axis=0)
    inverse = np.linalg.pinv((white / size).T @ (white / size), hermitian=True) / np.outer(size, size)
    out = np.zeros((active.size, active.size))
    out[np.ix_(active, active)] = inverse
    return out
