"""Which terms a record shows: the number of terms chosen by likelihood ratio, with a stated rate of false alarms.

A term stays if leaving it out raises the deviance by more than a threshold. A level lies at or above zero, so that without the
term the ratio is zero half the time and chi-square with one degree of freedom otherwise (Self & Liang 1987); the threshold of
6.63 is passed by chance once in 200 times. A Gauss-Markov process brings its correlation time along, which nothing tells where
there is no process (Davies 1977): its threshold is from simulation.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...frames import Array
from .fit import Fit, Model, fit, fit_markov, model
from .model_covariance import Layout, design
from .terms import LINEAR, ORDER, variance

THRESHOLD = 6.63
"""Of the deviance for one term: 0.5 % one-sided."""

MARKOV_THRESHOLD = 15.0
"""Of the deviance for a Gauss-Markov process and its correlation time."""

PREFERENCE = 8.0
"""Of the deviance, by which a Gauss-Markov process in the place of a term of the standard has to be better still."""

EQUAL = 6.0
"""Difference of the criterion below which two sets of terms fit alike."""

NEARLY = 2.0
"""The same for one term more than the chosen ones: its limit says the rest."""

_SLOW = ("instability", "walk", "ramp", "markov")
_TIMES_PER_OCTAVE = 2
_REFINED = 2


@dataclass(frozen=True)
class Trial:
    """One set of terms that was tried.

    Attributes
    ----------
    keys : tuple of str
    fit : Fit
    criterion : float
        Deviance and the thresholds of the terms: the smallest is chosen.
    """

    keys: tuple[str, ...]
    fit: Fit
    criterion: float


def criterion(keys: tuple[str, ...], deviance: float) -> float:
    """Deviance, or chi-square where covariances are equal, with the thresholds of the terms added.

    Parameters
    ----------
    keys : tuple of str
    deviance : float
    """
    return deviance + THRESHOLD * sum(key != "markov" for key in keys) + MARKOV_THRESHOLD * ("markov" in keys)


class Search:
    """The sets of terms tried on the variances of one axis.

    Parameters
    ----------
    layout : Layout
    variances : ndarray, shape (k,)
    candidates : tuple of str
        Terms that may be there.
    slack : float
        Relative error of the model at each averaging time.
    fastest : float
        Shortest correlation time of ``markov``, in shortest averaging times.
    """

    def __init__(
        self,
        layout: Layout,
        variances: Array,
        candidates: tuple[str, ...],
        slack: float = 0.0,
        fastest: float = 1.0,
    ) -> None:
        self.layout, self.variances, self.slack = layout, variances, slack
        self.decays = (6.0 / layout.longest, 1.0 / (fastest * layout.factors[0]))
        self.linear = tuple(key for key in LINEAR if key in candidates and (key != "ramp" or ORDER[layout.kind] == 2))
        self.markov = "markov" in candidates
        self.trials: dict[tuple[str, ...], Trial] = {}

    def linear_trial(self, keys: tuple[str, ...]) -> Trial:
        """Trial of terms without ``markov``; one at zero is left out of the result."""
        known = self.trials.get(keys)
        if known is not None:
            return known
        found = fit(model(self.layout, keys, slack=self.slack), self.variances)
        left = tuple(key for key, level in zip(keys, found.levels, strict=True) if level > 0.0)
        trial = self.linear_trial(left) if left and left != keys else self._keep(keys, found)
        self.trials[keys] = trial
        return trial

    def with_terms(self, found: Fit, keys: tuple[str, ...]) -> Model:
        """Other terms, with the correlation time of a fit.

        Parameters
        ----------
        found : Fit
        keys : tuple of str
            In any order.
        """
        return model(self.layout, self._ordered(keys), found.model.decay, self.slack)

    def _keep(self, keys: tuple[str, ...], found: Fit) -> Trial:
        trial = Trial(keys, found, criterion(keys, found.deviance))
        self.trials[keys] = trial
        return trial

    def best(self) -> Trial:
        """The set of terms with the smallest criterion; Gauss-Markov in the place of other terms has to be clearly better."""
        current = self.linear_trial(self.linear)
        while True:
            around = [self.linear_trial(keys) for keys in self._neighbours(current.keys)]
            least = min(around, key=lambda t: t.criterion, default=current)
            if least.criterion >= current.criterion - 1e-9:
                break
            current = least
        if not self.markov:
            return current
        if self.decays[0] < self.decays[1]:
            self._markov_trials(current)
        found = min((t for t in self.trials.values() if "markov" in t.keys), key=lambda t: t.criterion, default=current)
        needed = current.criterion - PREFERENCE * (not set(current.keys) <= set(found.keys))
        return found if found.criterion < needed else current

    def _neighbours(self, keys: tuple[str, ...]) -> list[tuple[str, ...]]:
        """Sets with one term less, one more, or one slow term for another."""
        inside = [key for key in self.linear if key in keys]
        outside = [key for key in self.linear if key not in keys]
        out = [tuple(k for k in inside if k != drop) for drop in inside if len(inside) > 1]
        out += [self._ordered((*inside, more)) for more in outside]
        slow = [(a, b) for a in inside for b in outside if a in _SLOW and b in _SLOW]
        out += [self._ordered((*(k for k in inside if k != a), b)) for a, b in slow]
        return [keys for keys in out if set(keys) != {"ramp"}]

    @staticmethod
    def _ordered(keys: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(key for key in (*LINEAR, "markov") if key in keys)

    def _markov_trials(self, current: Trial) -> None:
        """A Gauss-Markov process beside, or in the place of, slow terms: all correlation times roughly, the best ones exactly."""
        limits = self.decays
        decays, shapes = _grid(self.layout, limits)
        slow = [key for key in current.keys if key in _SLOW]
        fast = tuple(key for key in current.keys if key not in _SLOW)
        sets = [c for r in range(len(slow) + 1) for c in itertools.combinations(slow, r)]
        rough = []
        root = current.fit.root()
        for some in sets:
            keys = self._ordered((*fast, *some, "markov"))
            chi2, decay, levels = self._scan(keys, decays, shapes, root)
            rough.append((criterion(keys, chi2), keys, decay, levels))
        rough.sort(key=lambda r: r[0])
        for _, keys, decay, levels in rough[:_REFINED]:
            self._settle(keys, decay, levels, limits)
        self._refine(limits)

    def _settle(self, keys: tuple[str, ...], decay: float, levels: Array, limits: tuple[float, float]) -> Trial | None:
        """Trial with ``markov`` and its correlation time; terms that go to zero are left out, and without it there is none."""
        while True:
            found = fit_markov(model(self.layout, keys, decay, self.slack), self.variances, levels, limits)
            there = found.levels > 0.0
            if there.all() or not there[-1]:
                break
            keys = tuple(key for key, here in zip(keys, there, strict=True) if here)
            decay, levels = found.model.decay, found.levels[there]
        inside = limits[0] * 1.01 < found.model.decay < limits[1] * 0.99
        return self._keep(keys, found) if inside and there[-1] else None

    def _refine(self, limits: tuple[float, float]) -> None:
        """Terms beside the best Gauss-Markov process: one less or one more, as long as that is better."""
        tried = [t for t in self.trials.values() if "markov" in t.keys]
        while tried:
            current = min(tried, key=lambda t: t.criterion)
            decay, tried = current.fit.model.decay, []
            for keys in self._neighbours(current.keys):
                some = self._ordered((*keys, "markov"))
                if some in self.trials:
                    continue
                found = fit(model(self.layout, some, decay, self.slack), self.variances)
                if criterion(some, found.deviance) < current.criterion:
                    better = self._settle(some, decay, found.levels, limits)
                    tried += [better] if better and better.criterion < current.criterion else []

    def _scan(self, keys: tuple[str, ...], decays: Array, shapes: Array, root: Array) -> tuple[float, float, Array]:
        """Least chi-square over correlation times with the covariance of another model: chi-square, decay, levels."""
        from scipy.optimize import nnls

        best = (np.inf, float(decays[0]), np.zeros(len(keys)))
        rows = design(self.layout, keys[:-1])
        white, right = np.linalg.solve(root, rows), np.linalg.solve(root, self.variances)
        for decay, shape in zip(decays, np.linalg.solve(root, shapes).T, strict=True):
            white = np.column_stack([white[:, : len(keys) - 1], shape])
            size = np.linalg.norm(white, axis=0)
            found, norm = nnls(white / size, right)
            if norm**2 < best[0]:
                best = (float(norm**2), float(decay), np.asarray(found / size))
        return best


@lru_cache(maxsize=64)
def _grid(layout: Layout, limits: tuple[float, float]) -> tuple[Array, Array]:
    """Decays in even steps of their logarithm, and variances of processes of level one, shape (k, decays)."""
    octaves = np.log2(limits[1] / limits[0])
    decays = limits[0] * 2.0 ** (np.arange(int(octaves * _TIMES_PER_OCTAVE) + 1) / _TIMES_PER_OCTAVE)
    m = np.asarray(layout.factors)
    return decays, np.column_stack([variance("markov", m, layout.kind, float(d)) for d in decays])


def rival(trial: Trial, trials: list[Trial]) -> list[Trial]:
    """Sets of other terms that fit as well as the chosen one; sets with one term more only where it is nearly seen.

    Parameters
    ----------
    trial : Trial
        The chosen one.
    trials : list of Trial
    """
    out = []
    for t in trials:
        margin = NEARLY if set(t.keys) > set(trial.keys) else EQUAL
        if not set(t.keys) <= set(trial.keys) and t.criterion - trial.criterion < margin:
            out.append(t)
    return out
