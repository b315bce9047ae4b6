"""Centrifuge: the coefficients that 1 g cannot excite, from the harmonics of the readings in the arm's angle [XU18].

All sensors and segments are fitted at once, with the exact model of :mod:`.model`, to the Fourier coefficients of each
segment, which hold all that the samples say. Accelerometers: bias, scale error, K2, K3, Kip and misalignments; gyros: the drift
model with ten coefficients, and on a unit fixed to the arm scale error and misalignments as well. The arm's phase and rate, its
radius and tilt, gravity and every gimbal setting are unknowns as far as the plan says that they are uncertain.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ...calibration import Calibration
from ...errors import DataError
from ...estimate import CONSISTENT, combination
from ...frames import Array
from ...observe.harmonics import SegmentHarmonics
from ...plan import Plan
from ...recording import Recording
from . import closed_form as baseline
from . import explain
from .model import Turning
from .prepare import harmonics_of, prepare
from .prior import prior_of
from .report import report
from .task import Fitted, Task, fit
from .turning import as_planned, hypotheses

_LIKELY = 1e-3
"""Chi-square probability from which a way the arm may have turned is taken as the right one."""
_MOUNTED = 25.0
"""Fall of the chi-square that three angles of mounting do not bring about by chance."""
_NEARLY = 1.3
"""Times the smallest misfit up to which an earlier way is preferred where none is likely."""
_POOR = 1e-6
"""Chi-square probability below which other readings of the plan are tried."""
_MOVED = 3.0
"""Standard uncertainties by which another way would have to move a parameter to be worth a word."""
_BLIND = 1e-4
"""Smallest singular value of a gyro's drift model, relative to the largest, that counts as seen."""


def calibrate_recording(
    recording: Recording,
    plan: Plan,
    *,
    robust: bool = False,
    closed_form: bool = False,
    prior: Calibration | None = None,
    terms: Sequence[str] | None = None,
    sensors: Collection[str] | None = None,
) -> Calibration:
    """Calibration from samples, see :func:`calibrate_harmonics`."""
    return calibrate_harmonics(
        harmonics_of(recording, plan),
        plan,
        recording=recording,
        robust=robust,
        closed_form=closed_form,
        prior=prior,
        terms=terms,
        sensors=sensors,
    )


def calibrate_harmonics(
    harmonics: SegmentHarmonics,
    plan: Plan,
    *,
    recording: Recording | None = None,
    robust: bool = False,
    closed_form: bool = False,
    prior: Calibration | None = None,
    terms: Sequence[str] | None = None,
    sensors: Collection[str] | None = None,
) -> Calibration:
    """Calibration from the harmonics of segments.

    Parameters
    ----------
    harmonics : SegmentHarmonics
        As :func:`harmonics_of` finds them.
    plan : Plan
        With rig.kind ``centrifuge``.
    recording : Recording, optional
        Named in the result.
    robust : bool
        Turn down segments that disagree with the rest.
    closed_form : bool
        The published closed form of the accelerometers instead of the fit.
    prior : Calibration, optional
        Of the same unit at 1 g: known beforehand as far as its covariance says.
    terms : sequence of str, optional
        Which terms to estimate, see :func:`.task.sensor_axes`.
    sensors : collection of str, optional
        ``accel``, ``gyro_x``, ...: only these; otherwise all that were recorded.

    Returns
    -------
    Calibration
        Misalignments are directions of the input axes.

    Raises
    ------
    DataError
        When the segments do not determine the parameters, or contradict the plan: what would explain them is named.
    InputError
        When the plan or the recording cannot be used.
    """
    known = None if prior is None else prior_of(prior, plan)
    task, remarks = prepare(harmonics, plan, known, terms, sensors)
    explain.refuse_other_reading(task)
    if closed_form:
        return baseline.calibrate(task, plan, recording, harmonics.span, remarks)
    try:
        fitted = solve_mounted(task, remarks, robust=robust)
    except DataError:
        explain.refuse_poor(task, solve, np.inf)
        raise
    if fitted.estimate.p_value < _POOR and not robust:
        explain.refuse_poor(fitted.task, solve, fitted.misfit)
    explain.refuse_no_gain(fitted)
    return report(fitted, plan, recording, harmonics.span, remarks)


def solve_mounted(task: Task, remarks: list[str], *, robust: bool = False) -> Fitted:
    """:func:`solve` for a unit that sits square on its gimbals, or where the data say otherwise, also for how it sits.

    Parameters
    ----------
    task : Task
    remarks : list of str
        Gets a word on how the arm turned and how the unit sits.
    robust : bool

    Returns
    -------
    Fitted

    Raises
    ------
    DataError
        When the segments do not determine the parameters.
    """
    said: list[str] = []
    square: Fitted | DataError
    try:
        square = solve(task, said, robust=robust)
    except DataError as error:
        square = error
    if isinstance(square, Fitted) and (square.estimate.p_value >= CONSISTENT or not task.mountable):
        remarks += said
        return square
    if task.mountable:
        words: list[str] = []
        try:
            turned = solve(replace(task, free=task.free | {"mount"}), words, robust=robust)
        except DataError:
            turned = None
        if turned is not None and (
            isinstance(square, DataError) or turned.estimate.chi2 < square.estimate.chi2 - _MOUNTED
        ):
            remarks += [*words, "the unit does not sit square on its gimbals: rig.mount was estimated"]
            return turned
    if isinstance(square, DataError):
        raise square
    remarks += said
    return square


def solve(task: Task, remarks: list[str] | None = None, *, robust: bool = False) -> Fitted:
    """The fit, with the arm's angle as known or found in the first way that explains the data.

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
    DataError
        When the segments do not determine the parameters.
    """
    seen = task.look()
    if seen.known.all():
        turning = as_planned(seen, task.segments, task.plan)
        _refuse_blind_gyros(task, turning)
        return fit(task, turning, robust=robust)
    tried: list[Fitted] = []
    refused: list[DataError] = []
    for way in hypotheses(seen, task.segments, task.plan):
        try:
            turnings = way.turnings()
        except DataError as error:
            refused.append(error)
            continue
        for turning in turnings:
            _refuse_blind_gyros(task, turning)
            try:
                tried.append(fit(task, turning, way.words, robust=robust))
            except DataError as error:
                refused.append(error)
                continue
            if tried[-1].estimate.p_value >= _LIKELY:
                break
        if tried and tried[-1].estimate.p_value >= _LIKELY:
            break
    if not tried:
        raise refused[0]
    best = min(f.misfit for f in tried)
    chosen = (
        tried[-1] if tried[-1].estimate.p_value >= _LIKELY else next(f for f in tried if f.misfit <= _NEARLY * best)
    )
    if remarks is not None:
        remarks.append(f"arm_phase was not given; as the data fit: {chosen.words}")
        remarks += _ambiguous(chosen)
    return chosen


def _ambiguous(chosen: Fitted) -> list[str]:
    """A word where another way the arm may have turned fits as well and gives something else."""
    task, found = chosen.task, chosen.estimate
    out = []
    for way in hypotheses(task.look(), task.segments, task.plan)[:2]:
        if way.words == chosen.words:
            continue
        try:
            other = fit(task, way.turnings()[0], way.words).estimate
        except DataError:
            continue
        if other.p_value < _LIKELY:
            continue
        own = [i for i, n in enumerate(found.names) if not n.startswith("rig.")]
        moved = [abs(found.value[i] - other.value[other.names.index(found.names[i])]) / found.sigma[i] for i in own]
        worst = int(np.argmax(moved))
        if moved[worst] > _MOVED:
            out.append(
                f"the data would also fit if {way.words}: {found.names[own[worst]]} would then change by {moved[worst]:.3g} of "
                "its standard uncertainties. Give arm_phase, or record the arm's angle, to be sure"
            )
    return out


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
