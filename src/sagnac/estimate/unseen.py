"""What the data cannot see, named in terms of the parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import DataError
from .problem import Array, Parameter, Rows, stacked

_RANK = 1e-9
_MISFIT = 5.0


def null_space(jacobian: Array, names: Sequence[str], threshold: float = _RANK) -> tuple[float, list[str]]:
    """Condition of a column-scaled Jacobian, and what it cannot see in words.

    Parameters
    ----------
    jacobian : ndarray, shape (n, k)
    names : sequence of str
    threshold : float
        Smallest singular value, relative to the largest, that counts as seen.

    Returns
    -------
    condition : float
    unseen : list of str
        Combinations such as ``0.71 accel.bias.z - 0.71 accel.scale_error.z``.
    """
    length = np.linalg.norm(jacobian, axis=0)
    dead = length == 0.0
    unseen = [name for name, d in zip(names, dead, strict=True) if d]
    alive = np.flatnonzero(~dead)
    if alive.size == 0:
        return np.inf, unseen
    scaled = jacobian[:, alive] / length[alive]
    if scaled.shape[0] < scaled.shape[1]:
        scaled = np.vstack([scaled, np.zeros((scaled.shape[1] - scaled.shape[0], scaled.shape[1]))])
    _, values, right = np.linalg.svd(scaled, full_matrices=False)
    for value, vector in zip(values, right, strict=True):
        if value <= threshold * values[0]:
            unseen.append(combination(vector / length[alive], [names[int(i)] for i in alive]))
    condition = np.inf if unseen else float(values[0] / values[-1])
    return condition, unseen


def combination(vector: Array, names: Sequence[str]) -> str:
    """A direction in parameter space in words, largest part first."""
    vector = vector / np.linalg.norm(vector)
    order = np.argsort(-np.abs(vector))
    parts = [i for i in order if abs(vector[i]) > 0.15 * abs(vector[order[0]])]
    first = np.sign(vector[parts[0]])
    text = ""
    for i in parts:
        weight = first * vector[i]
        sign = "" if not text and weight > 0 else (" + " if weight > 0 else " - ")
        text += f"{sign}{abs(weight):.2g} {names[int(i)]}"
    return text


def refuse_unseen(parameters: Sequence[Parameter], rows: Rows) -> float:
    """Condition of the problem at these rows; refused when a combination does not show in them at all."""
    _, jac = stacked(parameters, rows, np.array([p.start for p in parameters]))
    if not np.all(np.isfinite(jac)):
        raise DataError("the start values make no sense of these data: the model is not finite there")
    scale = np.array([p.scale for p in parameters])
    condition, unseen = null_space(jac * scale, [p.name for p in parameters])
    if unseen:
        raise DataError(
            f"the data cannot tell these apart (a change along each leaves every reading as it is): {'; '.join(unseen)}. "
            "Add positions (attitudes) or rates that excite them."
        )
    return condition


def refuse_vague(values: Array, right: Array, scale: Array, names: Sequence[str], misfit: float) -> None:
    """Refuse a combination that is seen in principle but left wider than anything of use.

    `misfit` is the size of the residuals in units of what the stated noise allows: far above one, the model is at fault
    rather than the choice of positions.
    """
    vague = [
        f"{combination(v * scale, names)} (left uncertain by {1 / s:.2g} of what would be of any use)"
        for s, v in zip(values, right, strict=True)
        if s < 1.0
    ]
    if vague and misfit > _MISFIT:
        raise DataError(
            f"the readings miss the model by {misfit:.3g} times what noise and stated uncertainty allow, which leaves nothing of "
            "use: check angles, rates, times and units of the plan against what was done, and the rig's stated uncertainty"
        )
    if vague:
        raise DataError(
            f"the data say next to nothing about: {'; '.join(vague)}. Add positions (attitudes) or rates that excite it."
        )
