"""Intervals of levels, and upper limits of terms that are absent: levels that the variances do not contradict.

A level known to a few percent has a normal logarithm. Where few independent differences tell it, each level is asked whether
the variances could have come from it: all other levels are fitted anew beside it, and the estimate of the level by least
squares, with the covariance that *this* level would give, has a distribution that is known
(:mod:`sagnac.noise.identification.quadratic`). A level belongs to the interval unless the estimate lies in a tail of it. Nothing
of that is read off the data but the other levels, which the estimate does not depend on, so that a record that happened to show
little does not also seem to know it well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...frames import Array
from .fit import Fit, Model, estimate_at, fit, judged
from .quadratic import normal_score, squares

TWO_SIDED = 1.959963984540054
"""Standard deviations that a normal number stays within, 95 %."""

_SURE = 0.03  # relative uncertainty of a level below which its logarithm is taken as normal
_CLOSE = 0.01  # of a standard deviation
_STEPS = 16
_FIRST = 0.5  # step of the logarithm of a level
_WIDEN = 1.6  # each step further
_FAR = 30.0  # of the logarithm of a level: no limit
_NOTHING = 1e-6  # of the level: no lower limit


def score(terms: Model, variances: Array, number: int, level: float, start: Array) -> float:
    """How the estimate of a level lies in the distribution that the level itself gives it, as a normal number would.

    Parameters
    ----------
    terms : Model
    variances : ndarray, shape (k,)
    number : int
        Of the term.
    level : float
        Above zero.
    start : ndarray, shape (terms,)
        Where the fit of the others begins.

    Returns
    -------
    float
        Below -1.64 once in 20 records of that level, below -1.96 once in 40.
    """
    beside = fit(terms, variances, start, (number, level))
    found = estimate_at(beside, variances, number)
    spread = math.sqrt(found.variance)
    parts = squares(terms.layout, terms.keys, terms.decay, beside.levels, found.weights, found.variance)
    return normal_score(found.offset / spread, parts)


def two_sided(found: Fit, variances: Array, number: int, others: Sequence[Model] = ()) -> tuple[float, float]:
    """95 % interval of a level above zero.

    Parameters
    ----------
    found : Fit
    variances : ndarray, shape (k,)
    number : int
        Of the term.
    others : sequence of Model
        More terms, this one among them, that the variances may hide: the interval holds beside these too.
    """
    level = float(found.levels[number])
    spread = math.sqrt(found.covariance[number, number]) / level
    # the score of a Gauss-Markov process would hold its correlation time fast
    if spread < _SURE or found.keys[number] == "markov":
        return level * math.exp(-TWO_SIDED * spread), level * math.exp(TWO_SIDED * spread)
    tests = _tests((found.model, *others), found.keys[number], variances, found)
    far = math.exp(TWO_SIDED * min(spread, 1.0))
    upper = _outermost(tests, level * far, -TWO_SIDED)
    if any(at(_NOTHING * level) < TWO_SIDED for at in tests):
        return 0.0, upper
    return _outermost(tests, level / far, TWO_SIDED), upper


def upper_limit(terms: Model, variances: Array, number: int, found: Fit, others: Sequence[Model] = ()) -> float:
    """Level that an absent term stays below: the upper end of the 95 % interval that begins at zero.

    It is the end that a term has whether it was found or not: with 95 % to one side for terms that were not found, and 95 % to
    both sides for those that were, more than one record in twenty would be wrong about a term that is just visible.

    Parameters
    ----------
    terms : Model
        The chosen terms and the absent one.
    variances : ndarray, shape (k,)
    number : int
        Of the absent term.
    found : Fit
        Of the chosen terms.
    others : sequence of Model
        Sets of terms with the absent one among them that cannot be ruled out: the level may be as large as it is there.
    """
    start = np.insert(found.levels[: len(found.keys)], number, 0.0)
    unknown = _ignorance(terms, start, number)
    tests = _tests((terms, *others), terms.keys[number], variances, found)
    guess = float(fit(terms, variances, start).levels[number]) + TWO_SIDED * unknown
    # chance may contradict every level: no limit says more than the record could tell (power-constrained: Cowan et al. 2011)
    return _outermost(tests, guess, -TWO_SIDED, unknown)


def _tests(models: Sequence[Model], key: str, variances: Array, found: Fit) -> list[Callable[[float], float]]:
    """Score of a level under each of some sets of terms, begun at the levels that are known."""
    known = dict(zip(found.keys, found.levels.tolist(), strict=True))

    def test(terms: Model) -> Callable[[float], float]:
        start = np.array([known.get(k, 0.0) for k in terms.keys])
        return lambda x: score(terms, variances, terms.keys.index(key), x, start)

    return [test(terms) for terms in models]


def _outermost(tests: Sequence[Callable[[float], float]], start: float, target: float, least: float = 0.0) -> float:
    """The end of an interval that lies furthest out, of those that each test has."""
    end = max(_crossing(tests[0], start, target), least)
    for at in tests[1:]:
        # scores fall with the level: inside is above the target at the upper end, below it at the lower one
        if math.isfinite(end) and (at(end) - target) * target < 0.0:
            end = _crossing(at, end, target)
    return end


def _ignorance(terms: Model, levels: Array, number: int) -> float:
    """Standard uncertainty of a level at zero, the others free."""
    at_zero = estimate_at(judged(terms, terms.design @ levels, levels), terms.design @ levels, number)
    return math.sqrt(at_zero.variance)


def _crossing(falling: Callable[[float], float], start: float, target: float) -> float:
    """Level at which a score that falls with it reaches the target, by false position on its logarithm; infinite if none does."""
    x, step = math.log(start), _FIRST
    near, far = x - _FAR, x + _FAR
    above: tuple[float, float] | None = None
    below: tuple[float, float] | None = None
    for _ in range(_STEPS):
        y = falling(math.exp(x)) - target
        if abs(y) < _CLOSE:
            break
        if y > 0.0:
            above = (x, y)
        else:
            below = (x, y)
        if above and below:
            part = above[1] / (above[1] - below[1])
            x = above[0] + (below[0] - above[0]) * min(max(part, 0.1), 0.9)
        else:
            x += math.copysign(step, y)
            step *= _WIDEN
        if not near < x < far:
            break
    return math.exp(x) if x < far else math.inf
