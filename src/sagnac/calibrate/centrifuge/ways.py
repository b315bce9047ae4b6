"""The fit with the arm's angle as known, or with the way the arm turned found by what each way leaves of the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import DataError
from ...estimate import combination
from ...frames import Array
from .model import Turning
from .task import Fitted, Task, fit
from .turning import Hypothesis, as_planned, hypotheses

_LIKELY = 1e-3
"""Chi-square probability from which a way the arm may have turned explains the data."""
_NEARLY = 1.3
"""Times the smallest misfit up to which a way with few unknowns is preferred where none is likely."""
_TOLD = 12.0
"""Difference of chi-square (3.5 standard deviations) from which the data tell one way from another."""
_MOVED = 3.0
"""Standard uncertainties by which another way that fits as well may move a parameter."""
_BLIND = 1e-4
"""Smallest singular value of a gyro's drift model, relative to the largest, that counts as seen."""


class AmbiguousError(DataError):
    """Data that fit more than one way the arm may have turned, with results that differ."""


def solve(task: Task, remarks: list[str] | None = None, *, robust: bool = False) -> Fitted:
    """The fit, with the arm's angle as known or as the way the arm turned that fits best gives it.

    Parameters
    ----------
    task : Task
    remarks : list of str, optional
        Gets a word on how the arm turned.
    robust : bool

    Returns
    -------
    Fitted

    Raises
    ------
    AmbiguousError
        When another way fits nearly as well and gives something else.
    DataError
        When the segments do not determine the parameters.
    """
    seen = task.look()
    if seen.known.all():
        turning = as_planned(seen, task.segments, task.plan)
        _refuse_blind_gyros(task, turning)
        return fit(task, turning, robust=robust)
    simple: list[Fitted] = []
    loose: list[Fitted] = []
    refused: list[DataError] = []
    for way in hypotheses(seen, task.segments, task.plan):
        if way.loose and any(_likely(f) for f in simple):
            continue
        (loose if way.loose else simple).extend(_fits(task, way, refused, robust=robust))
    if not simple and not loose:
        raise refused[0]
    chosen = _chosen(simple, loose)
    _refuse_rivals(chosen, [f for f in simple if f is not chosen])
    if remarks is not None:
        told = task.plan.rig.arm_continuous is not None
        remarks.append(f"arm_phase was not given; as {'the plan says' if told else 'the data fit'}: {chosen.words}")
    return chosen


def _fits(task: Task, way: Hypothesis, refused: list[DataError], *, robust: bool) -> list[Fitted]:
    """Fits of one way from its start values, up to the first that explains the data."""
    out: list[Fitted] = []
    try:
        turnings = way.turnings()
    except DataError as error:
        refused.append(error)
        return out
    for turning in turnings:
        _refuse_blind_gyros(task, turning)
        try:
            out.append(fit(task, turning, way.words, robust=robust))
        except DataError as error:
            refused.append(error)
            continue
        if _likely(out[-1]):
            break
    return out


def _likely(fitted: Fitted) -> bool:
    return fitted.estimate.p_value >= _LIKELY


def _excess(fitted: Fitted) -> float:
    """Chi-square beyond what is expected: ways with more unknowns compare with those that have fewer."""
    return fitted.estimate.chi2 - fitted.estimate.degrees_of_freedom


def _chosen(simple: Sequence[Fitted], loose: Sequence[Fitted]) -> Fitted:
    """The best of the simple ways, or the best of all where it is clearly better."""
    best = min(simple, key=_excess) if simple else None
    other = min(loose, key=lambda f: f.misfit) if loose else None
    if best is None or other is None:
        return best or other  # type: ignore[return-value]
    return other if _likely(other) or other.misfit * _NEARLY < best.misfit else best


def _refuse_rivals(chosen: Fitted, others: Sequence[Fitted]) -> None:
    """Refuse a choice that the data hardly make and that matters."""
    found, task = chosen.estimate, chosen.task
    own = [i for i, n in enumerate(found.names) if not n.startswith("rig.")]
    noise = max(chosen.misfit, 1.0 if task.noise_known else 0.0)  # of which all chi-squares are multiples
    for other in others:
        if not own or _excess(other) - _excess(chosen) > _TOLD * noise:
            continue
        values = np.array([other[found.names[i]] for i in own])
        moved = np.abs(values - found.value[own]) / found.sigma[own]
        k = int(np.argmax(moved))
        if moved[k] > _MOVED:
            p = found.parameters[own[k]]
            raise AmbiguousError(
                f"arm_phase was not given, and the data fit two ways the arm may have turned: {chosen.words} (chi-square "
                f"{found.chi2:.4g}), or {other.words} ({other.estimate.chi2:.4g}). {p.name} is {found.value[own[k]]:.7g} in the "
                f"one and {values[k]:.7g} {p.unit} in the other, {moved[k]:.3g} standard uncertainties apart. Give arm_phase, "
                "record the arm's angle (a column arm), let the times from start to start differ from whole turns, record a "
                "second accelerometer that sees the arm, or say in the plan which it was: rig.arm_continuous = true (steadily) "
                "or false (same angle at every start)"
            )


def _refuse_blind_gyros(task: Task, turning: Turning) -> None:
    """Refuse segments that cannot tell terms of a gyro apart but for the minute difference that the Earth's rotation makes."""
    gyros = [s for s in task.sensors if s.kind == "gyro"]
    if not gyros:
        return
    parameters = task.parameters(turning)
    scale = {p.name: p.scale for p in parameters}
    model = task.model(turning)
    jacobian = model.rows(np.array([p.start for p in parameters])).jacobian
    for gyro in gyros:
        at = [model.places[n] for n in gyro.names]
        own = jacobian[:, at] * [scale[n] for n in gyro.names]
        length = np.linalg.norm(own, axis=0)
        if not length.all():
            continue  # the estimator names a term that nothing excites
        _, values, right = np.linalg.svd(own / length, full_matrices=False)
        unseen = [v for s, v in zip(values, right, strict=True) if s < _BLIND * values[0]]
        if unseen:
            raise DataError(_blind_words(gyro.axis, gyro.names, unseen, length))


def _blind_words(axis: str, names: Sequence[str], unseen: list[Array], length: Array) -> str:
    bias, squares = f"gyro.bias.{axis}", [f"gyro.d_{t}.{axis}" for t in ("ii", "oo", "ss")]
    if len(unseen) == 1 and {bias, *squares} <= set(names):
        pattern = np.array([1.0 if n == bias else -1.0 if n in squares else 0.0 for n in names])
        change = unseen[0] / length
        if abs(float(pattern @ change)) > 0.95 * np.linalg.norm(change) * np.linalg.norm(pattern):
            return (
                f"gyro_{axis}: {bias} (DF) and the sum {' + '.join(squares)} cannot be told apart: with one arm rate a_I^2 + "
                "a_O^2 + a_S^2 is the same in all segments. Add segments at another arm rate, give a prior calibration "
                "(--prior) with the bias, or leave the gyros out (--sensors accel)"
            )
    said = "; ".join(combination(v, names) for v in unseen)
    return (
        f"gyro_{axis}: the segments cannot tell these apart (in shares of what each adds to them): {said}. Add "
        "segments at other arm rates or gimbal settings, or leave the gyros out"
    )
