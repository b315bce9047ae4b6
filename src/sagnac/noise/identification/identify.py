"""Coefficients of the noise of one axis from its Allan (or Hadamard) variances.

Generalised least squares of the variances at octaves of the averaging time with the covariance that the noise itself gives them,
which comes within a few percent of the Cramer-Rao bound of the whole record; terms chosen by likelihood ratio. The method of
moments of wavelet variances (Guerrier et al. 2013) with its best weights, in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ...errors import DataError, InputError
from ...frames import Array
from ..curves.allan import Variances
from .evidence import Search, Trial, rival
from .fit import Fit, Model, fit, judged
from .intervals import two_sided, upper_limit
from .model_covariance import layout
from .terms import LINEAR, TERMS, value, variance

_STEP = 1.9  # least ratio of neighbouring averaging times that are used
_FEWEST = 3
_POOR = 1e-3
_FAIR = 0.05
_SLACKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
_STRIKING = 3.0
_TIED = 0.95
_SLOW = ("instability", "walk", "ramp")
_HIDING = ("instability", "walk")  # that a record may hold unseen, and a neighbour with it
_POSSIBLE = 0.01  # probability of the chi-square of terms that are not ruled out
_STRAIGHT = 1e-6  # share of noise in the variances, at every averaging time


@dataclass(frozen=True)
class Coefficient:
    """One coefficient, SI.

    Attributes
    ----------
    key : str
        Of :data:`sagnac.noise.identification.terms.TERMS`, or ``markov_time``.
    value, standard_uncertainty : float
    lower, upper : float
        95 % interval.
    """

    key: str
    value: float
    standard_uncertainty: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Tried:
    """A set of terms that was tried.

    Attributes
    ----------
    keys : tuple of str
    criterion : float
        Above that of the chosen set.
    chi2, p_value : float
    """

    keys: tuple[str, ...]
    criterion: float
    chi2: float
    p_value: float


@dataclass(frozen=True)
class Identified:
    """Noise of one axis.

    Attributes
    ----------
    kind : str
        Of the variances.
    interval : float, s
        Of the samples.
    coefficients : tuple of Coefficient
        Of the terms that are there.
    covariance : ndarray, shape (p, p)
        Of their values, in the same order.
    limits : dict of str to float
        Of the terms that are absent: what the coefficient stays below, 95 %.
    chi2, p_value : float
        Of the cube roots of the variances, and probability of a larger one (NaN without degrees of freedom).
    degrees_of_freedom : int
    tau, residuals : ndarray, shape (k,)
        Averaging times that were used, s; residuals over their standard deviations.
    evidence : tuple of Tried
        The best first.
    notes : tuple of str
        What cannot be told apart, and where the model misses.
    """

    kind: str
    interval: float
    coefficients: tuple[Coefficient, ...]
    covariance: Array
    limits: dict[str, float]
    chi2: float
    degrees_of_freedom: int
    p_value: float
    tau: Array
    residuals: Array
    evidence: tuple[Tried, ...]
    notes: tuple[str, ...]

    def value(self, key: str) -> float:
        """Value of a coefficient, zero where it is absent."""
        return next((c.value for c in self.coefficients if c.key == key), 0.0)

    def terms(self, tau: Array) -> dict[str, Array]:
        """Deviation of each term at averaging times, unit of the samples.

        Parameters
        ----------
        tau : ndarray, shape (k,), s
        """
        return deviations({c.key: c.value for c in self.coefficients}, tau, self.interval, self.kind)

    def model(self, tau: Array) -> Array:
        """Deviation of all terms together, shape (k,)."""
        total = sum((d**2 for d in self.terms(tau).values()), np.zeros_like(np.asarray(tau, dtype=float)))
        return np.asarray(np.sqrt(total))


def deviations(coefficients: dict[str, float], tau: Array, interval: float, kind: str = "allan") -> dict[str, Array]:
    """Deviation of each term at averaging times.

    Parameters
    ----------
    coefficients : dict of str to float
        SI values; ``markov_time`` [s] goes with ``markov``.
    tau : ndarray, shape (k,), s
    interval : float, s
        Of the samples.
    kind : str
        ``allan`` or ``hadamard``.
    """
    factors = np.asarray(tau, dtype=float) / interval
    decay = interval / coefficients["markov_time"] if "markov" in coefficients else 0.0
    return {
        key: np.abs(size) * interval ** TERMS[key].power * np.sqrt(variance(key, factors, kind, decay))
        for key, size in coefficients.items()
        if key in TERMS
    }


def identify(
    v: Variances, axis: int = 0, terms: tuple[str, ...] = (*LINEAR, "markov"), *, fastest: float = 1.0
) -> Identified:
    """Noise coefficients of one axis.

    Parameters
    ----------
    v : Variances
        ``allan`` or ``hadamard`` (which does not see a ramp), of octaves or more.
    axis : int
    terms : tuple of str
        Terms that may be there.
    fastest : float
        Shortest correlation time of ``markov``, in shortest averaging times.

    Returns
    -------
    Identified

    Raises
    ------
    DataError
        When the variances are zero or not finite, or of fewer than three averaging times.
    InputError
        For a kind or a term without a model.
    """
    return seek(v, axis, terms, fastest=fastest).identified()


@dataclass(frozen=True)
class Sought:
    """Terms that explain the variances best, before intervals and limits, which take most of the time.

    Attributes
    ----------
    p_value : float
        As of :class:`Identified`.
    tau : ndarray, shape (k,)
        Averaging times that were used, s.
    markov_time : float, s
        Zero where there is no such term.
    """

    p_value: float
    tau: Array
    markov_time: float
    _search: Search = field(repr=False)
    _chosen: Trial = field(repr=False)
    _strict: Fit = field(repr=False)
    _variances: Variances = field(repr=False)
    _unit: float = field(repr=False)

    def identified(self) -> Identified:
        """With all that is known of the coefficients."""
        search, chosen, v = self._search, self._chosen, self._variances
        coefficients, covariance = _coefficients(search, chosen.fit, v.interval, self._unit)
        notes = [
            *_rivals(chosen, search),
            *_ties(coefficients, covariance),
            *_misses(self._strict, self.tau, self.p_value, search.slack),
        ]
        return Identified(
            v.kind,
            v.interval,
            coefficients,
            covariance,
            _limits(search, chosen, v.interval, self._unit),
            self._strict.chi2,
            search.variances.size - covariance.shape[0],
            self.p_value,
            self.tau,
            self._strict.residuals,
            _tried(search, chosen),
            tuple(notes),
        )


def seek(v: Variances, axis: int = 0, terms: tuple[str, ...] = (*LINEAR, "markov"), *, fastest: float = 1.0) -> Sought:
    """The terms of one axis alone; parameters and errors as of :func:`identify`."""
    unknown = [key for key in terms if key not in TERMS]
    if unknown:
        raise InputError(f"Noise term {unknown[0]!r}: there are {', '.join(TERMS)}.")
    if not set(terms) & (set(LINEAR) - {"ramp"}):
        raise InputError(f"Noise terms {', '.join(terms)}: let there be one of {', '.join(LINEAR[:4])} at least.")
    used = _octaves(v)
    values = np.ascontiguousarray(v.variance[used, axis])
    _refuse(values, v.tau[used], v.kind)
    plan = layout(v, used)
    # in units of the first variance, so that no number is tiny
    unit = float(values[0])
    search = Search(plan, values / unit, terms, fastest=fastest)
    chosen = search.best()
    slack = _slack(chosen, search.variances)
    if slack > 0.0:
        search = Search(plan, values / unit, terms, slack, fastest)
        chosen = search.best()
    # what noise alone says of the same levels
    strict = judged(replace(chosen.fit.model, slack=0.0), search.variances, chosen.fit.levels)
    return Sought(
        _probability(strict.chi2, len(used) - chosen.fit.covariance.shape[0]),
        v.tau[used],
        v.interval / chosen.fit.model.decay if "markov" in chosen.keys else 0.0,
        search,
        chosen,
        strict,
        v,
        unit,
    )


def _slack(chosen: Trial, variances: Array) -> float:
    """Relative error of the model with which a poor fit is a fair one; zero where it is fair as it is."""
    terms, found = chosen.fit.model, chosen.fit
    dof = variances.size - found.covariance.shape[0]
    if not _probability(found.chi2, dof) < _POOR:
        return 0.0
    for slack in _SLACKS:
        found = fit(replace(terms, slack=slack), variances)
        if _probability(found.chi2, dof) > _FAIR:
            break
    return slack


def _octaves(v: Variances) -> list[int]:
    """Averaging times at least nearly an octave apart: more tell next to nothing, and their covariance is nearly singular."""
    used = [0]
    for i, m in enumerate(v.factors):
        if m >= _STEP * v.factors[used[-1]]:
            used.append(i)
    return used


def _refuse(values: Array, tau: Array, kind: str) -> None:
    if values.size < _FEWEST:
        raise DataError(
            f"Variances of {values.size} averaging times are too few to tell noise terms apart: record for longer."
        )
    bad = ~np.isfinite(values) | (values <= 0.0)
    if bad.any():
        at = tau[int(np.argmax(bad))]
        raise DataError(
            f"The variance at tau = {at:.4g} s is {values[bad][0]:g}: the axis is constant, repeats a pattern, "
            "or holds values that are no numbers."
        )
    slopes = values / tau**2
    if kind == "allan" and np.ptp(slopes) < _STRAIGHT * slopes[0]:
        raise DataError(
            "The samples lie on a straight line: there is no noise to see. Look at what made them: a simulation without noise, "
            "or a filter that has taken it all away."
        )


def _coefficients(search: Search, found: Fit, interval: float, unit: float) -> tuple[tuple[Coefficient, ...], Array]:
    """Coefficients and their covariance, from levels in units of the first variance."""
    out, slopes = [], []
    for i, (key, level) in enumerate(zip(found.keys, found.levels, strict=True)):
        size = value(key, level * unit, interval)
        slopes.append(0.5 * size / level)
        low, high = two_sided(found, search.variances, i, _hidden(search, found, found.keys, key))
        spread = slopes[-1] * math.sqrt(float(found.covariance[i, i]))
        out.append(Coefficient(key, size, spread, value(key, low * unit, interval), value(key, high * unit, interval)))
    if "markov" in found.keys:
        time, spread = interval / found.model.decay, math.sqrt(float(found.covariance[-1, -1]))
        slopes.append(-time)
        wide = math.exp(1.96 * spread)
        out.append(Coefficient("markov_time", time, time * spread, time / wide, time * wide))
    return tuple(out), np.asarray(found.covariance * np.outer(slopes, slopes))


def _hidden(search: Search, found: Fit, keys: tuple[str, ...], key: str) -> list[Model]:
    """Terms with those that a flicker floor or a walk among them, whose level is asked for, may hide."""
    more = tuple(k for k in _HIDING if k in search.linear and k not in keys)
    return [search.with_terms(found, (*keys, *more))] if key in _HIDING and more else []


def _instead(search: Search, found: Fit, key: str) -> list[Model]:
    """Sets of terms with an absent slow one in the place of another, as far as they fit by themselves."""
    out = []
    for other in [k for k in found.keys if k in _SLOW and key in _SLOW]:
        keys = (*(k for k in found.keys if k != other), key)
        terms = search.with_terms(found, keys)
        chi2 = fit(terms, search.variances).chi2
        if _probability(chi2, search.variances.size - len(keys) - ("markov" in keys)) > _POSSIBLE:
            out.append(terms)
    return out


def _limits(search: Search, chosen: Trial, interval: float, unit: float) -> dict[str, float]:
    out = {}
    rivals = rival(chosen, list({t.keys: t for t in search.trials.values()}.values()))
    for key in search.linear:
        if key not in chosen.keys:
            terms = search.with_terms(chosen.fit, (*chosen.keys, key))
            # where another set of terms cannot be ruled out, the level may be as large as it is there
            others = [t.fit.model for t in rivals if key in t.keys]
            others += [*_hidden(search, chosen.fit, terms.keys, key), *_instead(search, chosen.fit, key)]
            limit = upper_limit(terms, search.variances, terms.keys.index(key), chosen.fit, others)
            out[key] = value(key, limit * unit, interval)
    return out


def _probability(chi2: float, dof: int) -> float:
    from scipy.stats import chi2 as distribution

    return float(distribution.sf(chi2, dof)) if dof > 0 else math.nan


def _tried(search: Search, chosen: Trial) -> tuple[Tried, ...]:
    distinct = {t.keys: t for t in search.trials.values()}
    out = []
    for t in sorted(distinct.values(), key=lambda t: t.criterion):
        dof = search.variances.size - len(t.keys) - ("markov" in t.keys)
        out.append(Tried(t.keys, t.criterion - chosen.criterion, t.fit.chi2, _probability(t.fit.chi2, dof)))
    return tuple(out)


def _named(keys: tuple[str, ...]) -> str:
    return " + ".join(TERMS[key].name for key in keys)


def _rivals(chosen: Trial, search: Search) -> list[str]:
    """A word for each set of terms that the record cannot tell from the chosen one."""
    out = []
    for other in rival(chosen, list({t.keys: t for t in search.trials.values()}.values())):
        here = tuple(key for key in chosen.keys if key not in other.keys)
        there = tuple(key for key in other.keys if key not in chosen.keys)
        what = f"{_named(there)} instead of {_named(here)}" if here else f"{_named(there)} beside the others"
        out.append(
            f"{what} fits nearly as well (criterion {other.criterion - chosen.criterion:+.1f}): "
            "this record cannot tell, a longer one may"
        )
    return out


def _ties(coefficients: tuple[Coefficient, ...], covariance: Array) -> list[str]:
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(spread, spread)
    return [
        f"{a.key} and {b.key} are told apart hardly (correlation {correlation[i, i + 1 + j]:.2f})"
        for i, a in enumerate(coefficients)
        for j, b in enumerate(coefficients[i + 1 :])
        if abs(correlation[i, i + 1 + j]) > _TIED
    ]


def _misses(found: Fit, tau: Array, probability: float, slack: float) -> list[str]:
    """Where the model misses, if it does."""
    if not probability < _POOR:
        return []
    size = np.abs(found.residuals)
    worst = np.flatnonzero(size > _STRIKING) if (size > _STRIKING).any() else np.array([int(np.argmax(size))])
    where = ", ".join(f"{tau[i]:.3g} s ({found.residuals[i]:+.1f} sigma)" for i in worst)
    word = (
        f"the terms do not explain the variances (p = {probability:.1g}): the model misses at tau = {where}; "
        f"look for disturbances, lines in the spectrum or a drift with temperature. The coefficients stand with an error of the "
        f"model of {100.0 * slack:.0f} % of each variance"
    )
    return [word]
