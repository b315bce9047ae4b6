"""Centrifuge: the coefficients that 1 g cannot excite, from the harmonics of the readings in the arm's angle [XU18].

All sensors and segments are fitted at once, with the exact model of :mod:`.model`, to the Fourier coefficients of each
segment, which hold all that the samples say. Accelerometers: bias, scale error, K2, K3, Kip and misalignments; gyros: the drift
model with ten coefficients, and on a unit fixed to the arm scale error and misalignments as well. The arm's phase and rate, its
radius and tilt, gravity and every gimbal setting are unknowns as far as the plan says that they are uncertain.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ...calibration import Calibration
from ...errors import DataError
from ...estimate import CONSISTENT
from ...observe.harmonics import SegmentHarmonics
from ...plan import Plan
from ...recording import Recording
from .. import common
from . import closed_form as baseline
from . import explain
from .prepare import harmonics_of, prepare
from .prior import prior_of
from .report import report
from .task import Fitted, Task
from .ways import AmbiguousError, solve

_MOUNTED = 25.0
"""Fall of the chi-square that three angles of mounting do not bring about by chance."""
_POOR = 1e-6
"""Chi-square probability below which other readings of the plan are tried."""


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
        return _with_noise(baseline.calibrate(task, plan, recording, harmonics.span, remarks), task, harmonics, plan)
    try:
        fitted = solve_mounted(task, remarks, robust=robust)
    except AmbiguousError:
        raise  # the data do fit the plan, and more than once
    except DataError:
        explain.refuse_poor(task, solve, np.inf, remarks)
        raise
    if fitted.estimate.p_value < _POOR and not robust:
        explain.refuse_poor(fitted.task, solve, fitted.misfit, remarks)
    explain.refuse_no_gain(fitted)
    return _with_noise(report(fitted, plan, recording, harmonics.span, remarks), task, harmonics, plan)


def _with_noise(result: Calibration, task: Task, harmonics: SegmentHarmonics, plan: Plan) -> Calibration:
    """The result with the white noise of the triads of which the data's own was used."""
    density = np.sqrt(task.variance[0] * harmonics.interval[0])
    both: tuple[Literal["accel", "gyro"], ...] = ("accel", "gyro")
    for sensor in both:
        at = [j for j, s in enumerate(task.sensors) if s.kind == sensor]
        stated = plan.unit.noise.of(sensor)
        if task.noise_known and len(at) == 3 and (stated is None or np.any(density[at] > 1.01 * np.array(stated))):
            result = common.with_found_noise(result, plan, sensor, density[at])
    return result


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
