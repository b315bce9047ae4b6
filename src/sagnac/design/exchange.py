"""Optimal choice of segments: exchange algorithm on their information, linear algebra only.

Each candidate adds ``J'J`` to the information of the parameters. For the parameters of interest s with covariance C_ss,
D-optimality makes ``det C_ss`` small and A-optimality the sum of squared uncertainties in units of what matters
(Fedorov 1972; Atkinson, Donev & Tobias 2007, chapters 11 and 12).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..frames import Array

_STEPS = 300
_RIDGE = 1e-9  # of the information of all candidates: makes the first choices possible


@dataclass(frozen=True)
class Candidates:
    """What there is to choose from, c candidates of at most m rows for k parameters.

    Attributes
    ----------
    rows : ndarray, shape (c, m, k)
        Whitened derivatives, in units of what matters; shorter blocks end in zeros.
    cost : ndarray, shape (c,), s
    prior : ndarray, shape (k, k)
        Information that is there already.
    interest : ndarray of int
        Parameters that count; the others are nuisance.
    """

    rows: Array
    cost: Array
    prior: Array
    interest: NDArray[np.intp]

    @cached_property
    def ridge(self) -> Array:
        """Information that makes every covariance exist, (k, k)."""
        every = np.einsum("cij,cij->j", self.rows, self.rows) + np.diag(self.prior)
        return np.asarray(_RIDGE * np.diag(np.maximum(every, 1e-300 + _RIDGE * every.max())))

    def covariance(self, chosen: list[int]) -> Array:
        """Of the parameters after the chosen candidates, (k, k)."""
        return np.asarray(np.linalg.inv(self.information(chosen) + self.ridge), dtype=np.float64)

    def information(self, chosen: list[int]) -> Array:
        """Of the chosen candidates and the prior, (k, k)."""
        rows = self.rows[chosen].reshape(-1, self.rows.shape[2])
        return np.asarray(self.prior + rows.T @ rows)


@dataclass(frozen=True)
class Design:
    """A choice, and how good it is."""

    chosen: tuple[int, ...]
    criterion: float
    """log det of the covariance of the parameters of interest (D), or its trace (A)."""
    efficiency: float
    """D-efficiency: share of the information that the best division of the same time among all candidates would give."""


def value(c: Array, interest: NDArray[np.intp], criterion: str) -> float:
    """Criterion of a covariance; smaller is better."""
    own = c[np.ix_(interest, interest)]
    return float(np.linalg.slogdet(own)[1]) if criterion == "D" else float(np.trace(own))


def _changes(c: Array, candidates: Candidates, criterion: str) -> Array:
    """Change of the criterion by adding each candidate, (c,); by the matrix inversion lemma."""
    s = candidates.interest
    left = candidates.rows @ c
    inner = np.eye(candidates.rows.shape[1]) + left @ np.swapaxes(candidates.rows, 1, 2)
    own = left[:, :, s]
    if criterion == "A":
        return np.asarray(-np.einsum("cij,cji->c", np.linalg.inv(inner), own @ np.swapaxes(own, 1, 2)))
    rest = inner - own @ np.linalg.inv(c[np.ix_(s, s)]) @ np.swapaxes(own, 1, 2)
    return np.asarray(np.linalg.slogdet(rest)[1] - np.linalg.slogdet(inner)[1])


def choose(
    candidates: Candidates,
    criterion: str,
    *,
    count: int | None = None,
    budget: float = np.inf,
    starts: int = 12,
    seed: int = 1,
) -> Design:
    """Best choice found by greedy or random starts and exchanges.

    Parameters
    ----------
    candidates : Candidates
    criterion : str
        ``D`` or ``A``.
    count : int, optional
        Number of segments; without it as many as the budget allows.
    budget : float, s
        Sum of costs.
    starts : int
        One greedy start and the rest at random.
    seed : int

    Returns
    -------
    Design
    """
    rng = np.random.default_rng(seed)
    best: tuple[float, list[int]] = (np.inf, [])
    for start in range(starts):
        first = _greedy(candidates, criterion, count, budget, rng if start else None)
        chosen = _exchange(candidates, criterion, first, budget)
        chosen = _greedy(candidates, criterion, count, budget, None, chosen)
        reached = value(candidates.covariance(chosen), candidates.interest, criterion)
        if reached < best[0] - 1e-12:
            best = (reached, chosen)
    return Design(tuple(sorted(best[1])), best[0], _efficiency(candidates, best[1]))


def _greedy(
    candidates: Candidates,
    criterion: str,
    count: int | None,
    budget: float,
    rng: np.random.Generator | None,
    chosen: list[int] | None = None,
) -> list[int]:
    """Add the candidate that helps most for its cost (or one at random) until nothing more fits."""
    chosen = list(chosen or [])
    while count is None or len(chosen) < count:
        left = budget - float(candidates.cost[chosen].sum())
        allowed = candidates.cost <= left + 1e-9
        allowed[chosen] = False
        if not allowed.any():
            break
        if rng is not None:
            chosen.append(int(rng.choice(np.flatnonzero(allowed))))
            continue
        gain = _changes(candidates.covariance(chosen), candidates, criterion) / candidates.cost
        chosen.append(int(np.argmin(np.where(allowed, gain, np.inf))))
    return chosen


def _exchange(candidates: Candidates, criterion: str, chosen: list[int], budget: float) -> list[int]:
    """Swap one chosen candidate for another as long as that helps."""
    chosen = list(chosen)
    current = value(candidates.covariance(chosen), candidates.interest, criterion)
    for _ in range(100):
        best: tuple[float, int, int] | None = None
        total = float(candidates.cost[chosen].sum())
        for place, out in enumerate(chosen):
            c = candidates.covariance([i for i in chosen if i != out])
            after = value(c, candidates.interest, criterion) + _changes(c, candidates, criterion)
            after[candidates.cost > budget - total + candidates.cost[out] + 1e-9] = np.inf
            after[chosen] = np.inf
            into = int(np.argmin(after))
            if best is None or after[into] < best[0]:
                best = (float(after[into]), place, into)
        if best is None or not best[0] < current - 1e-9 * max(1.0, abs(current)):
            break
        current, chosen[best[1]] = best[0], best[2]
    return chosen


def _efficiency(candidates: Candidates, chosen: list[int]) -> float:
    """D-efficiency against the best shares of the same time on all candidates.

    The best shares come from the multiplicative algorithm, which raises the determinant in every step (Silvey, Titterington &
    Torsney 1978).
    """
    s, time = candidates.interest, float(candidates.cost[chosen].sum())
    rows = candidates.rows * np.sqrt(time / candidates.cost)[:, None, None]
    share = np.full(len(rows), 1.0 / len(rows))
    other = np.setdiff1d(np.arange(rows.shape[2]), s)
    best = np.inf
    for _ in range(_STEPS):
        information = candidates.prior + candidates.ridge + np.einsum("c,cij,cik->jk", share, rows, rows, optimize=True)
        best = min(best, value(np.linalg.inv(information), s, "D"))
        sensitivity = _squares(rows, np.linalg.inv(information))
        if other.size:
            sensitivity -= _squares(rows[:, :, other], np.linalg.inv(information[np.ix_(other, other)]))
        share = share * np.maximum(sensitivity, 0.0)
        share /= share.sum()
    return float(np.exp((best - value(candidates.covariance(chosen), s, "D")) / s.size))


def _squares(rows: Array, inverse: Array) -> Array:
    """Trace of J C J' of each candidate, (c,)."""
    return np.asarray(np.sum((rows @ inverse) * rows, axis=(1, 2)))
