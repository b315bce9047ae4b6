"""Sums over the rows of a campaign: rows come in any order and any parts.

Means and variances are those of Welford and of Chan, Golub and LeVeque (1983): nothing is lost where the spread is small beside
the mean, and memory does not grow with the runs.
"""

from __future__ import annotations

import heapq
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..coverage import MANY
from ..frames import Array
from .chunks import OK
from .tasks.about import About

LEVELS = (0.5, 0.9, 0.95, 0.99)
"""Probabilities of the intervals whose coverage is counted."""
BINS = 60
"""Of the histogram of NEES, from zero to :func:`widest`; one more takes what lies beyond."""
WORST = 10
_SCATTER = ("scaled", "delete-one-segment")
"""Uncertainties that follow from the scatter of residuals or of segments."""
NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


class Bad(NamedTuple):
    """A run with a large NEES: how many standard deviations it lies above what is expected."""

    excess: float
    run: int
    point: int
    nees: float
    degrees_of_freedom: int


@dataclass
class Moments:
    """Count, mean and sum of squared deviations of many columns at once.

    Attributes
    ----------
    count, mean, squares : ndarray, shape (k,)
    """

    count: Array
    mean: Array
    squares: Array

    @classmethod
    def none(cls, columns: int) -> Moments:
        """Of no rows."""
        return cls(np.zeros(columns), np.zeros(columns), np.zeros(columns))

    def add(self, values: Array) -> None:
        """Add rows, shape (n, k); what is no number is not there."""
        there = np.isfinite(values)
        count = there.sum(axis=0).astype(float)
        mean = np.divide(np.where(there, values, 0.0).sum(axis=0), count, out=np.zeros_like(count), where=count > 0)
        squares = (np.where(there, values - mean, 0.0) ** 2).sum(axis=0)
        total = self.count + count
        share = np.divide(count, total, out=np.zeros_like(total), where=total > 0)
        apart = mean - self.mean
        self.squares = self.squares + squares + apart**2 * self.count * share
        self.mean = self.mean + apart * share
        self.count = total

    @property
    def second(self) -> Array:
        """Mean of the squares themselves."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.squares / self.count + self.mean**2)


@dataclass
class PointTally:
    """Sums at one point of the grid, k parameters.

    Attributes
    ----------
    errors : Moments
    variances : Moments
        Of the squared standard uncertainties.
    inside : ndarray, shape (levels, k)
        Runs whose interval of each level holds the truth.
    doubt : ndarray, shape (k,)
        Sums of one over the degrees of freedom of the standard uncertainties.
    runs, refused : int
    scattered : int
        Runs whose uncertainties follow from the scatter of residuals or of segments.
    nees, degrees : float
        Sums over the runs that gave a result.
    histogram : ndarray of int, shape (bins + 1,)
    ranks : Counter
        Runs by the degrees of freedom of their NEES.
    """

    errors: Moments
    variances: Moments
    inside: Array
    doubt: Array
    histogram: NDArray[np.int64]
    runs: int = 0
    refused: int = 0
    scattered: int = 0
    nees: float = 0.0
    degrees: float = 0.0
    ranks: Counter[int] = field(default_factory=Counter)

    @classmethod
    def none(cls, columns: int) -> PointTally:
        """Of no rows."""
        return cls(
            Moments.none(columns),
            Moments.none(columns),
            np.zeros((len(LEVELS), columns)),
            np.zeros(columns),
            np.zeros(BINS + 1, dtype=np.int64),
        )


def widest(parameters: int) -> float:
    """End of the histogram of NEES over so many parameters: six standard deviations beyond its mean."""
    return float(parameters + 6.0 * np.sqrt(2.0 * max(parameters, 1)))


class Tally:
    """Sums over the rows of a simulated campaign.

    Parameters
    ----------
    about : About
        What the rows are about.
    """

    def __init__(self, about: About) -> None:
        from scipy.special import ndtri

        self.about = about
        self._names = [p.name for p in about.parameters]
        self._tails = 0.5 + 0.5 * np.array(LEVELS)
        self._normal = np.asarray(ndtri(self._tails))
        self.points = [PointTally.none(len(self._names)) for _ in about.points]
        self.refusals: dict[tuple[int, str], tuple[int, int]] = {}
        self.worst: list[Bad] = []

    def add(self, table: Any) -> None:
        """Add rows.

        Parameters
        ----------
        table : pyarrow Table
            With the columns of the task.
        """
        status, point, run = (table.column(name).to_numpy() for name in ("status", "point", "run"))
        good = status == OK
        for number, count in Counter(point.tolist()).items():
            self.points[number].runs += count
        for i in np.flatnonzero(~good):
            self.points[int(point[i])].refused += 1
            self._refuse(int(point[i]), general(str(status[i])), int(run[i]))
        rows = np.flatnonzero(good)
        rows = rows[np.argsort(point[rows], kind="stable")]
        if not rows.size:
            return

        def of(name: str) -> Array:
            return np.asarray(table.column(name).to_numpy(), dtype=float)[rows]

        values = {w: np.stack([of(f"{w}.{n}") for n in self._names], axis=1) for w in ("error", "sigma", "dof")}
        values |= {name: of(name) for name in ("nees", "nees_degrees_of_freedom")}
        used = table.column("uncertainty").to_numpy()[rows]
        values["scattered"] = np.array([scattered(u) for u in used.tolist()], dtype=float)
        numbers, starts = np.unique(point[rows], return_index=True)
        for number, first, last in zip(numbers.tolist(), starts, [*starts[1:], rows.size], strict=True):
            self._add_point(number, {n: v[first:last] for n, v in values.items()}, run[rows[first:last]])

    def _add_point(self, number: int, values: Mapping[str, Array], run: NDArray[np.int64]) -> None:
        part = self.points[number]
        error, sigma, dof = (values[what] for what in ("error", "sigma", "dof"))
        part.errors.add(error)
        part.variances.add(sigma**2)
        part.scattered += int(values["scattered"].sum())
        part.doubt += np.where(dof >= 1.0, 1.0 / np.maximum(dof, 1.0), 0.0).sum(axis=0)
        with np.errstate(invalid="ignore"):  # a parameter that a run does not give is inside nothing
            part.inside += (np.abs(error) <= self._widths(dof) * sigma).sum(axis=1)
        nees, degrees = values["nees"], values["nees_degrees_of_freedom"]
        part.nees += float(nees.sum())
        part.degrees += float(degrees.sum())
        place = np.minimum(nees / widest(len(self._names)) * BINS, BINS).astype(np.int64)
        part.histogram += np.bincount(place, minlength=BINS + 1)
        part.ranks.update(Counter(degrees.astype(int).tolist()))
        excess = (nees - degrees) / np.sqrt(2.0 * np.maximum(degrees, 1.0))
        for i in np.argsort(-excess, kind="stable")[:WORST]:
            bad = Bad(float(excess[i]), int(run[i]), number, float(nees[i]), int(degrees[i]))
            self.worst = _largest([*self.worst, bad])

    def _widths(self, dof: Array) -> Array:
        """Half-widths of the intervals of all levels, shape (levels, n, k), in standard uncertainties."""
        normal = np.broadcast_to(self._normal[:, None, None], (len(LEVELS), *dof.shape))
        few = (dof >= 1.0) & (dof < MANY)
        if not few.any():
            return normal
        from scipy.special import stdtrit

        return np.where(few, stdtrit(np.where(few, dof, 1.0), self._tails[:, None, None]), normal)

    def _refuse(self, point: int, reason: str, run: int) -> None:
        before, earlier = self.refusals.get((point, reason), (0, run))
        self.refusals[point, reason] = before + 1, min(run, earlier)


def scattered(uncertainty: str | None) -> bool:
    """Whether some uncertainties follow from the scatter of residuals or of segments.

    Parameters
    ----------
    uncertainty : str
        Of a calibration's fit.
    """
    return any(part.rpartition(": ")[2] in _SCATTER for part in (uncertainty or "").split(" / "))


def general(status: str) -> str:
    """A refusal without its numbers: the same reason in many runs is one."""
    return NUMBER.sub("#", status)


def _largest(bad: list[Bad]) -> list[Bad]:
    return heapq.nsmallest(WORST, bad, key=lambda b: (-b.excess, b.run))
