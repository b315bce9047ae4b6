"""What one run came to, against the truth, and the row that it becomes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...frames import Array
from ..chunks import OK

__all__ = ["OK", "Cell", "Outcome", "cells", "chosen", "columns", "nees"]

Cell = float | int | str | None

WHITE = "white"
"""How uncertainties are stated that follow from a known noise."""
_SEEN = 1e-12
"""Of the largest eigenvalue of a correlation matrix: what lies below belongs to what is known exactly."""


@dataclass(frozen=True)
class Outcome:
    """Estimates of one run, k parameters.

    Attributes
    ----------
    names, units : tuple of str
    values : ndarray, shape (k,), SI
    covariance : ndarray, shape (k, k)
    truth : mapping of str to float
        By name, SI.
    chi2 : float or None
    degrees_of_freedom : int or None
    p_value : float or None
    uncertainty : str
        How the uncertainties were found, as in a calibration's ``fit.uncertainty``.
    dof : mapping of str to float
        Degrees of freedom of standard uncertainties by name; infinite for those that are not in it.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    truth: Mapping[str, float]
    chi2: float | None = None
    degrees_of_freedom: int | None = None
    p_value: float | None = None
    uncertainty: str = WHITE
    dof: Mapping[str, float] = field(default_factory=dict)

    def judged(self, wanted: Sequence[str]) -> list[int]:
        """Which parameters have a truth and a name with one of these beginnings."""
        return [i for i, n in enumerate(self.names) if n in self.truth and chosen(n, wanted)]


def chosen(name: str, wanted: Sequence[str]) -> bool:
    """Whether a dotted name begins with one of these; with none of them every name counts."""
    return not wanted or any(name == w or name.startswith(w + ".") for w in wanted)


def columns(keys: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """Columns of the results of simulated runs, by the names of their Arrow types.

    Parameters
    ----------
    keys : sequence of str
        Of the grid.
    names : sequence of str
        Of the parameters that are judged.
    """
    head = {"run": "int64", "point": "int64", **{f"grid.{k}": "string" for k in keys}, "seed": "int64"}
    fit = {"status": "string", "chi2": "float64", "degrees_of_freedom": "int64", "p_value": "float64"}
    nees = {"nees": "float64", "nees_degrees_of_freedom": "int64", "uncertainty": "string"}
    return head | fit | nees | {f"{what}.{n}": "float64" for n in names for what in ("error", "sigma", "dof")}


def cells(outcome: Outcome, names: Sequence[str], wanted: Sequence[str]) -> dict[str, Cell]:
    """The part of a row that a result fills: fit, NEES, error and standard uncertainty of each parameter.

    The degrees of freedom of a standard uncertainty are left out where the noise was known.

    Parameters
    ----------
    outcome : Outcome
    names : sequence of str
        Of the parameters that have a column.
    wanted : sequence of str
        Beginnings of names that count.
    """
    at = outcome.judged(wanted)
    truth = np.array([outcome.truth[outcome.names[i]] for i in at])
    error = outcome.values[at] - truth
    covariance = outcome.covariance[np.ix_(at, at)]
    square, rank = nees(error, covariance)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    out: dict[str, Cell] = {
        "chi2": outcome.chi2,
        "degrees_of_freedom": outcome.degrees_of_freedom,
        "p_value": outcome.p_value,
        "nees": square,
        "nees_degrees_of_freedom": rank,
        "uncertainty": outcome.uncertainty,
    }
    for i, e, s in zip(at, error.tolist(), sigma.tolist(), strict=True):
        if outcome.names[i] in names:
            name = outcome.names[i]
            out |= {f"error.{name}": e, f"sigma.{name}": s}
            if np.isfinite(outcome.dof.get(name, np.inf)):
                out[f"dof.{name}"] = float(outcome.dof[name])
    return out


def nees(error: Array, covariance: Array) -> tuple[float, int]:
    """Normalised estimation error squared ``e' P^-1 e`` and its degrees of freedom, the rank of P.

    What is stated as exact has no part in it: its error is told by itself.

    Parameters
    ----------
    error : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    free = sigma > 0.0
    if not free.any():
        return 0.0, 0
    scaled = covariance[np.ix_(free, free)] / np.outer(sigma[free], sigma[free])
    values, vectors = np.linalg.eigh(scaled)
    along = vectors.T @ (error[free] / sigma[free])
    seen = values > _SEEN * values[-1]
    return float((along[seen] ** 2 / values[seen]).sum()), int(seen.sum())
