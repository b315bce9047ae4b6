"""How sure the estimate is: from the noise, from whole segments, from leaving out one segment at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from .problem import Array, Estimate, Influence, Parameter, Rows, prior_rows, stacked
from .unseen import refuse_unseen, refuse_vague

CONSISTENT = 0.01
"""Below this chi-square probability the stated noise does not explain the scatter between segments."""
_MANY = 10  # degrees of freedom from which a delete-one figure is steadier than one common factor


def judge(
    parameters: tuple[Parameter, ...],
    rows: Rows,
    x: Array,
    segments: Sequence[str],
    weights: Array,
    noise_known: bool,
    iterations: int,
) -> Estimate:
    """Uncertainty of a solution `x` whose rows are `rows`, and the figures that go with it.

    The white covariance is used while the chi-square says that the noise explains the scatter; else delete-one-segment, or
    with few degrees of freedom the white one scaled by the scatter. What the priors contribute is in all of them.
    """
    from scipy.special import chdtrc

    _, jac = stacked(parameters, rows, x)
    scale = np.array([p.scale for p in parameters])
    names = [p.name for p in parameters]
    condition = refuse_unseen(parameters, rows)
    values, right, white = _white(jac, scale)
    # data rows only: a prior so wide that it adds nothing must not pass for an observation that fits
    used_up = float(np.einsum("ni,ij,nj->", rows.jacobian, white, rows.jacobian))
    chi2, dof = float(rows.residual @ rows.residual), rows.residual.size - round(used_up)
    if dof <= 0 and not noise_known:
        raise DataError("as many unknowns as readings and no stated noise: nothing is left to judge the uncertainty by")
    p_value = float(chdtrc(dof, chi2)) if dof > 0 else 1.0
    consistent = noise_known and p_value >= CONSISTENT
    factor = 1.0 if consistent else max(chi2 / max(dof, 1), 0.0 if not noise_known else 1.0)
    refuse_vague(
        values / np.sqrt(factor) if factor > 0 else values, right, scale, names, np.sqrt(factor) if noise_known else 1.0
    )
    moves, cluster = _delete_one(rows, white, len(segments))
    _, prior_jac = prior_rows(parameters, x)
    beforehand = white @ (prior_jac.T @ prior_jac) @ white  # what the priors' own uncertainty contributes
    jackknife = None if moves is None else _jackknife(moves) + beforehand
    covariance, used = (white - beforehand) * factor + beforehand, "white" if consistent else "scaled"
    # fewer segments than parameters span only a part of the parameter space when left out one at a time
    if not consistent and moves is not None and jackknife is not None and dof >= _MANY and len(moves) > x.size:
        covariance, used = jackknife, "delete-one-segment"
    return Estimate(
        parameters=parameters,
        value=x,
        covariance=covariance,
        white=_sigma(white),
        cluster=None if cluster is None else _sigma(cluster + beforehand),
        jackknife=None if jackknife is None else _sigma(jackknife),
        used=used,
        chi2=chi2,
        p_value=p_value,
        degrees_of_freedom=dof,
        condition=condition,
        iterations=iterations,
        residual=rows.residual,
        segment=rows.segment,
        influence=_influence(rows, white, moves, covariance, segments, names),
        weights=weights,
        gain=-white @ rows.jacobian.T,
    )


def _white(jac: Array, scale: Array) -> tuple[Array, Array, Array]:
    """Singular values and directions of the scaled problem, and (J'J)^-1 from them."""
    _, values, right = np.linalg.svd(jac * scale, full_matrices=False)
    half = right.T / values * scale[:, None]
    return values, right, half @ half.T


def _sigma(covariance: Array) -> Array:
    return np.asarray(np.sqrt(np.diag(covariance)))


def _groups(rows: Rows, count: int) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Segments with equally many rows, batched: (segment indices (g,), row indices (g, n))."""
    order = np.argsort(rows.segment, kind="stable")
    sizes = np.bincount(rows.segment, minlength=count)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    out = []
    for size in np.unique(sizes[sizes > 0]):
        which = np.flatnonzero(sizes == size)
        out.append((which, order[starts[which][:, None] + np.arange(size)]))
    return out


def _delete_one(rows: Rows, white: Array, count: int) -> tuple[Array | None, Array | None]:
    """Change of the estimate without each segment (exact in the linear model), and the CR2 sandwich.

    Bell & McCaffrey 2002 for CR2; the change is C J_s' (I - H_ss)^-1 r_s by the matrix inversion lemma.
    """
    moves, sandwich = [], np.zeros_like(white)
    for _, index in _groups(rows, count):
        jac, res = rows.jacobian[index], rows.residual[index]
        back = white @ np.swapaxes(jac, -1, -2)
        left, vectors = np.linalg.eigh(np.eye(index.shape[1]) - jac @ back)
        if left.min() < 1e-7:  # without this segment the parameters are not determined
            return None, None
        turned = (np.swapaxes(vectors, -1, -2) @ res[..., None])[..., 0]
        moves.append((back @ (vectors @ (turned / left)[..., None]))[..., 0])
        half = (back @ (vectors @ (turned / np.sqrt(left))[..., None]))[..., 0]
        sandwich += half.T @ half
    return np.vstack(moves), sandwich


def _jackknife(moves: Array) -> Array:
    m = len(moves)
    centred = moves - moves.mean(axis=0)
    return np.asarray((m - 1) / m * centred.T @ centred)


def _influence(
    rows: Rows, white: Array, moves: Array | None, covariance: Array, segments: Sequence[str], names: Sequence[str]
) -> tuple[Influence, ...]:
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    leverage = np.bincount(
        rows.segment, np.einsum("ni,ij,nj->n", rows.jacobian, white, rows.jacobian), minlength=len(segments)
    )
    chi2 = np.bincount(rows.segment, rows.residual**2, minlength=len(segments))
    shift = {}
    if moves is not None:
        order = np.concatenate([which for which, _ in _groups(rows, len(segments))])
        for which, move in zip(order, moves, strict=True):
            worst = int(np.argmax(np.abs(move) / sigma))
            shift[int(which)] = (float(np.abs(move[worst]) / sigma[worst]), names[worst])
    count = np.bincount(rows.segment, minlength=len(segments))
    return tuple(
        Influence(segments[i], float(leverage[i]), float(chi2[i]), *shift.get(int(i), (np.inf, "")), int(count[i]))
        for i in np.unique(rows.segment)
    )
