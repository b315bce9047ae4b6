"""Uncertainty budgets of fits on a table: their lines, and how they come into the result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..calibration import BudgetLine
from ..estimate import Effects, Estimate, Model, contributions, scatter
from ..frames import Array

NOISE = "noise"
SETTINGS = "settings of the table"
AXES = "axes of the table"
RATE = "rate of the table"
GRAVITY = "gravity"
HELD = "known beforehand"
_PRIORS = {
    "rig.tilt": AXES,
    "rig.nonperpendicularity": AXES,
    "rig.zero": AXES,
    "rig.rate_error": RATE,
    "site.gravity_error": GRAVITY,
}
"""Lines of what was known beforehand, by how the names of the unknowns begin."""


def source_of(name: str) -> str:
    """Line of the budget for what was known beforehand of a parameter."""
    return next((line for start, line in _PRIORS.items() if name.startswith(start)), HELD)


def of_fit(fit: Estimate, model: Model, effects: Iterable[Effects]) -> dict[str, Array]:
    """Standard uncertainties of all parameters of a fit by source, from noise and stated uncertainty.

    Parameters
    ----------
    fit : Estimate
    model : callable
        Its rows.
    effects : iterable of Effects

    Returns
    -------
    dict of str to ndarray, shape (k,)
    """
    return contributions(fit, model, effects, source_of)


def lines(
    named: Mapping[str, Array], fit: Estimate, order: Sequence[int], *, before: int = 0, behind: int = 0
) -> tuple[BudgetLine, ...]:
    """Lines of the result's parameters, with what scatters beyond the stated.

    Parameters
    ----------
    named : mapping of str to ndarray, shape (k,)
        See :func:`of_fit`.
    fit : Estimate
        The one that is reported.
    order : sequence of int
        Its parameters in the result.
    before, behind : int
        Number of further parameters of the result, before and behind them, that these sources have nothing to do with.

    Returns
    -------
    tuple of BudgetLine
        Those that contribute something.
    """
    at = list(order)
    # where segments scatter by less than their noise, each source has done less than was stated
    share = np.minimum(1.0, fit.sigma / np.where(fit.white > 0, fit.white, 1.0))
    own = {source: share * v for source, v in named.items()} | scatter(fit)
    padded = {source: np.pad(v[at], (before, behind)) for source, v in own.items()}
    return tuple(
        BudgetLine(source=source, standard_uncertainty=tuple(float(v) for v in values))
        for source, values in padded.items()
        if np.any(values > 0)
    )


def joined(first: Sequence[BudgetLine], second: Sequence[BudgetLine]) -> tuple[BudgetLine, ...]:
    """Two budgets of the same parameters as one; lines of the same name add their variances."""
    out: dict[str, Array] = {}
    for line in (*first, *second):
        out[line.source] = np.hypot(out.get(line.source, 0.0), np.array(line.standard_uncertainty))
    return tuple(BudgetLine(source=s, standard_uncertainty=tuple(float(x) for x in v)) for s, v in out.items())
