"""Whitened Gauss-Newton with priors and step halving."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import DataError
from .problem import Array, Estimate, Model, Parameter, Rows, stacked
from .uncertainty import judge
from .unseen import refuse_unseen


def estimate(
    parameters: Sequence[Parameter],
    model: Model,
    segments: Sequence[str],
    *,
    noise_known: bool = True,
    robust: bool = False,
    max_iterations: int = 60,
    tolerance: float = 1e-9,
) -> Estimate:
    """Fit named parameters to whitened residuals.

    Parameters
    ----------
    parameters : sequence of Parameter, length k
    model : callable
        Takes the parameter vector (k,), returns :class:`Rows`.
    segments : sequence of str
        Names that ``Rows.segment`` points into.
    noise_known : bool
        Whether the whitening used the true noise; otherwise its size comes from the residuals.
    robust : bool
        Turn down segments that disagree with the rest (Huber weights on whole segments).
    max_iterations : int
    tolerance : float
        A step that moves the residuals by less than this, relative to their size, is the last one. Coarser where each
        evaluation of the model costs a pass over a recording.

    Returns
    -------
    Estimate

    Raises
    ------
    DataError
        When the data do not determine the parameters (the message names the combination), when there is nothing
        left to judge the noise by, or when the iteration does not settle.
    """
    parameters, model = tuple(parameters), _remembering(model)
    weights = np.ones(len(segments))
    x = np.array([p.start for p in parameters])
    refuse_unseen(parameters, model(x))
    iterations = 0
    for _ in range(20 if robust else 1):
        weighted = _weighted(model, weights)
        x, used, settled = _gauss_newton(parameters, weighted, x, max_iterations, tolerance)
        if not settled:
            raise DataError(f"the fit did not settle in {used} iterations: no result is better than a wrong one")
        iterations += used
        previous, weights = weights, _huber(model(x), len(segments)) if robust else weights
        if np.allclose(previous, weights, atol=1e-3):
            break
    return judge(parameters, _weighted(model, weights)(x), x, segments, weights, noise_known and not robust, iterations)


def settle(parameters: Sequence[Parameter], model: Model, *, max_iterations: int = 15) -> tuple[Parameter, ...]:
    """Better start values from a simpler model of the same parameters, without judging them.

    Parameters
    ----------
    parameters : sequence of Parameter
    model : callable
        See :func:`estimate`.
    max_iterations : int

    Returns
    -------
    tuple of Parameter
        The same with new start values.
    """
    x, _, _ = _gauss_newton(parameters, model, np.array([p.start for p in parameters]), max_iterations)
    return tuple(replace(p, start=float(v)) for p, v in zip(parameters, x, strict=True))


def _remembering(model: Model) -> Model:
    """The same model, which does not compute twice in a row for one and the same vector."""
    last: list[tuple[Array, Rows]] = []

    def rows(x: Array) -> Rows:
        if not last or not np.array_equal(last[0][0], x):
            last[:] = [(x.copy(), model(x))]
        return last[0][1]

    return rows


def _weighted(model: Model, weights: Array) -> Model:
    if np.all(weights == 1.0):
        return model

    def rows(x: Array) -> Rows:
        r, jac, seg, rest = model(x)
        w = np.sqrt(weights[seg])
        return Rows(r * w, jac * w[:, None], seg, None if rest is None else rest * weights)

    return rows


def _huber(rows: Rows, count: int) -> Array:
    n = np.maximum(np.bincount(rows.segment, minlength=count), 1)
    size = np.sqrt(np.bincount(rows.segment, rows.residual**2, minlength=count) / n)
    present = np.bincount(rows.segment, minlength=count) > 0
    limit = 2.0 * max(float(np.median(size[present])), 1e-300) / 0.674
    return np.minimum(1.0, limit / np.maximum(size, 1e-300))


def _gauss_newton(
    parameters: Sequence[Parameter], model: Model, x: Array, limit: int, tolerance: float = 1e-9
) -> tuple[Array, int, bool]:
    """Gauss-Newton with step halving; stops when a step moves no residual and no parameter any more."""
    scale = np.array([p.scale for p in parameters])
    rows = model(x)
    r, jac = stacked(parameters, rows, x)
    before = np.inf
    for iteration in range(1, limit + 1):
        step = scale * np.linalg.lstsq(jac * scale, -r, rcond=None)[0]
        cost, fraction = r @ r + rows.left, 1.0
        for _ in range(12):
            trial = x + fraction * step
            rows = model(trial)
            new_r, new_jac = stacked(parameters, rows, trial)
            new_cost = new_r @ new_r + rows.left
            if np.isfinite(new_cost) and new_cost <= cost * (1 + 1e-9) + 1e-18:
                break
            fraction /= 2
        else:
            return x, iteration, _at_the_bottom(jac, step, r)
        moved, size = float(np.linalg.norm(jac @ step)), max(1.0, float(np.linalg.norm(r)))
        x, r, jac = trial, new_r, new_jac
        if (
            moved < tolerance * size or 0.9 * before < moved < 1e-3 * size
        ):  # nothing moves any more, or only rounding does
            return x, iteration, True
        before = moved
    return x, limit, False


def _at_the_bottom(jac: Array, step: Array, r: Array) -> bool:
    """Whether a step of which no fraction lowers the cost is only rounding; on a slope the model does not describe the data."""
    return float(np.linalg.norm(jac @ step)) < 1e-4 * max(1.0, float(np.linalg.norm(r)))
