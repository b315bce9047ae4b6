"""Intervals of levels from the profile of the deviance, and upper limits of terms that are absent.

A level known to a few percent has a normal logarithm. Where few independent differences tell it, the interval is where the
deviance, with all other levels fitted anew, stays within the chi-square quantile of its least value: the noise that the level
itself would make is then in its own uncertainty, upwards as much as it is large.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..frames import Array
from .fit import Fit, Model, fit

TWO_SIDED = 3.841458820694124
"""Chi-square with one degree of freedom, 95 %."""

ONE_SIDED = 2.705543454095404
"""The same, 90 %: 95 % to one side."""

_NORMAL = math.sqrt(TWO_SIDED)
_SURE = 0.03  # relative uncertainty of a level below which its logarithm is taken as normal
_CLOSE = 0.02  # of the deviance asked for
_STEPS = 12
_FAR = 100.0  # of the logarithm of a level: no limit
_NOTHING = 1e-6  # of the level: no lower limit


def two_sided(found: Fit, variances: Array, number: int) -> tuple[float, float]:
    """95 % interval of a level above zero.

    Parameters
    ----------
    found : Fit
    variances : ndarray, shape (k,)
    number : int
        Of the term.
    """
    level = float(found.levels[number])
    spread = math.sqrt(found.covariance[number, number]) / level
    # a Gauss-Markov process has a correlation time too, which a profile would hold fast
    if spread < _SURE or "markov" in found.keys:
        return level * math.exp(-_NORMAL * spread), level * math.exp(_NORMAL * spread)
    rise = _rise(found, variances, number)
    upper = _crossing(lambda x: rise(level * math.exp(x)), _NORMAL * spread, TWO_SIDED, _FAR)
    if rise(_NOTHING * level) < TWO_SIDED:
        return 0.0, level * math.exp(upper)
    lower = _crossing(lambda x: rise(level * math.exp(-x)), _NORMAL * spread, TWO_SIDED, _FAR)
    return level * math.exp(-lower), level * math.exp(upper)


def upper_limit(terms: Model, variances: Array, number: int, found: Fit) -> float:
    """Level that an absent term stays below, 95 %.

    Parameters
    ----------
    terms : Model
        The chosen terms and the absent one.
    variances : ndarray, shape (k,)
    number : int
        Of the absent term.
    found : Fit
        Of the chosen terms.
    """
    with_it = fit(terms, variances)
    least = min(with_it.deviance, found.deviance)
    start = np.insert(found.levels, number, 0.0)

    def rise(level: float) -> float:
        return fit(terms, variances, start, (number, level)).deviance - least

    level = float(with_it.levels[number])
    return level + _crossing(lambda x: rise(level + x), _ignorance(terms, start, number), ONE_SIDED)


def _rise(found: Fit, variances: Array, number: int) -> Callable[[float], float]:
    def rise(level: float) -> float:
        return fit(found.model, variances, found.levels, (number, level)).deviance - found.deviance

    return rise


def _ignorance(terms: Model, levels: Array, number: int) -> float:
    """1.64 standard uncertainties of a level at zero, the others free."""
    expected = terms.design @ levels
    relative = terms.covariance(levels) / np.outer(expected, expected)
    root = np.linalg.cholesky(relative + (terms.slack**2 + 1e-13) * np.eye(expected.size))
    white = np.linalg.solve(root, terms.design / expected[:, None])
    size = np.linalg.norm(white, axis=0)
    inverse = np.linalg.pinv((white / size).T @ (white / size), hermitian=True)
    return math.sqrt(ONE_SIDED * float(inverse[number, number])) / float(size[number])


def _crossing(function: Callable[[float], float], start: float, target: float, most: float = math.inf) -> float:
    """Where a function that rises from zero at zero reaches the target, by false position on its root; infinite beyond `most`."""
    goal = math.sqrt(target)
    low, high = (0.0, 0.0), (math.inf, math.inf)
    x = min(start, most)
    for _ in range(_STEPS):
        y = math.sqrt(max(function(x), 0.0))
        if abs(y / goal - 1.0) < _CLOSE:
            break
        if y < goal and x >= most:
            return math.inf
        if y < goal:
            low = (x, y)
        else:
            high = (x, y)
        if math.isinf(high[0]):
            x = min(x * min(max(1.1 * goal / y if y > 0.0 else 2.0, 1.1), 2.0), most)
        else:
            part = (goal - low[1]) / (high[1] - low[1])
            x = low[0] + (high[0] - low[0]) * min(max(part, 0.1), 0.9)
    return x
