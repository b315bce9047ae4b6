"""The uncertainty budget of an estimate: what each independent source of error contributes.

The estimate is a function of the readings and of what was known beforehand, x = x(y, q). To first order its covariance is the
sum of what each of them brings (GUM, 5.1.2): readings and shared effects through the gain -C J', a prior of standard deviation
s through the column of C over s. The squares add up to the white covariance C exactly, because C = C J'J C + C P C.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .problem import Array, Estimate, Model, stacked

SCATTER = "scatter beyond noise and stated uncertainty"
"""The line that holds what honest uncertainties add to those of the stated noise."""


class Effects(NamedTuple):
    """How independent errors of unit variance move the whitened residuals of some blocks of rows.

    Attributes
    ----------
    rows : ndarray of int, shape (b, m)
        Rows of the model in each block.
    matrix : ndarray, shape (b, m, n)
        Change of these rows for each of the n errors of the block.
    sources : sequence of str, length n
        Line of the budget that each error belongs to.
    """

    rows: NDArray[np.intp]
    matrix: Array
    sources: Sequence[str]


def contributions(
    found: Estimate, model: Model, effects: Iterable[Effects], prior_source: Callable[[str], str]
) -> dict[str, Array]:
    """Standard uncertainties of all parameters from noise and stated uncertainty, by source.

    Parameters
    ----------
    found : Estimate
    model : callable
        That it was estimated with.
    effects : iterable of Effects
        Of all rows.
    prior_source : callable
        Line of the budget for what was known beforehand of a parameter, by its name.

    Returns
    -------
    dict of str to ndarray, shape (k,)
    """
    # a segment that was turned down brings less of its noise
    gain = -found.gain * np.sqrt(found.weights)[found.segment]
    variance: dict[str, Array] = {}

    def add(source: str, squares: Array) -> None:
        variance[source] = variance.get(source, np.zeros(len(found.parameters))) + squares

    for block in effects:
        squares = np.einsum("kbm,bmn->kbn", gain[:, block.rows], block.matrix) ** 2
        each = squares.sum(axis=1)
        for source in dict.fromkeys(block.sources):
            add(source, each[:, [s == source for s in block.sources]].sum(axis=1))
    inner = white_covariance(found, model)
    for i, p in enumerate(found.parameters):
        if np.isfinite(p.prior_sigma):
            add(prior_source(p.name), (inner[:, i] / p.prior_sigma) ** 2)
    return {source: np.sqrt(v) for source, v in variance.items()}


def scatter(found: Estimate) -> dict[str, Array]:
    """What the honest uncertainties of an estimate have beyond those of the stated noise, as a line; empty when nothing."""
    extra = np.maximum(np.diag(found.covariance) - found.white**2, 0.0)
    return {SCATTER: np.sqrt(extra)} if found.used != "white" and np.any(extra > 0) else {}


def white_covariance(found: Estimate, model: Model) -> Array:
    """Covariance (k, k) from noise and priors alone."""
    rows = model(found.value)
    weighted = rows._replace(jacobian=rows.jacobian * np.sqrt(found.weights)[rows.segment][:, None])
    _, jac = stacked(found.parameters, weighted, found.value)
    scale = np.array([p.scale for p in found.parameters])
    _, values, right = np.linalg.svd(jac * scale, full_matrices=False)
    half = right.T / values * scale[:, None]
    return np.asarray(half @ half.T)
