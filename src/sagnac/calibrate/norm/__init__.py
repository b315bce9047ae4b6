"""Norm-observation calibration on a turntable, from the means of a plan's segments (residuals: :mod:`.model`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...calibration import Calibration
from ...estimate import estimate
from ...observe.means import SegmentMeans
from ...plan import Plan
from ...recording import Recording
from .. import common
from .case import model_of, prepare
from .report import report
from .solution import Solution

__all__ = ["Solution", "calibrate_means", "prepare", "solve"]


def calibrate_means(
    means: SegmentMeans, plan: Plan, *, recording: Recording | None = None, robust: bool = False
) -> Calibration:
    """Norm calibration from the means of a plan's segments.

    Parameters
    ----------
    means : SegmentMeans
        Static segments (outer rate zero) for the accelerometers, turning ones for the gyros.
    plan : Plan
    recording : Recording, optional
        Where the means came from, for the record.
    robust : bool
        Turn down segments that disagree with the rest.

    Returns
    -------
    Calibration

    Raises
    ------
    DataError
        When positions are too few or badly spread, when signs, columns or units are wrong, or the fit does not settle.

    References
    ----------
    [DONG18], equations 10 to 27; what is corrected in them is listed with the method's documentation.
    """
    solution = solve(means, plan, robust=robust)
    return report(solution, recording)


def solve(means: SegmentMeans, plan: Plan, *, robust: bool = False) -> Solution:
    """Fit of :func:`calibrate_means` before it is written up (same parameters and errors).

    Segments that scatter by more than their noise are weighed alike in a second fit: what makes them differ is then not
    the noise, and a long segment is no better than a short one.
    """
    case, start, model, known, parameters = prepare(means, plan)
    fit = estimate(parameters, model.rows, means.names, noise_known=known, robust=robust)
    stated = fit, model
    case.remarks.extend(common.misfit_remarks(fit, known and not robust, planned=case.nominal is not None))
    if known and not robust and fit.used != "white" and np.ptp(means.duration) > 0:
        alike = replace(means, duration=np.full_like(means.duration, means.duration.mean()))
        model, _ = model_of(replace(case, means=alike), start)
        again = estimate(parameters, model.rows, means.names, noise_known=False, robust=robust)
        fit = replace(again, white=fit.white, chi2=fit.chi2, p_value=fit.p_value)
        case.remarks.append("segments scatter by more than their noise and are weighed alike, whatever their length")
    solution = Solution(fit, model, case, stated)
    case.remarks.extend(_earth_at_rest(solution))
    return solution


def _earth_at_rest(solution: Solution) -> list[str]:
    """The vertical Earth rate that the gyros see at rest, which the fit has not used, against the plan's latitude."""
    fit, model, case, _ = solution
    rest = np.flatnonzero(~case.turning)
    if model.gyro is None or model.accel is None or rest.size == 0 or "gyro" not in case.means.mean:
        return []
    p = model.split(fit.value)
    matrix, bias, _ = model.gyro.unpack(p.gyro)
    a = solution.directions()[rest]
    inverse = np.linalg.inv(matrix)
    seen = np.einsum("ni,ij,nj->n", a, inverse, case.means.mean["gyro"][rest] - bias)
    at = [fit.names.index(f"gyro.bias.{axis}") for axis in "xyz"]
    weight = -(a @ inverse).mean(axis=0)
    rounding = case.means.rounding.get("gyro", np.zeros((1, 3)))
    spread = float(np.std(seen)) / np.sqrt(rest.size) + float(np.sqrt(rounding.max())) / np.abs(np.diag(matrix)).min()
    sigma = float(np.sqrt(weight @ fit.covariance[np.ix_(at, at)] @ weight)) + spread
    missed = float(seen.mean()) - model.up_rate
    if abs(missed) < 6.0 * sigma or abs(missed) < 0.02 * case.plan.earth_rate:
        return []
    hourly = np.degrees([seen.mean(), model.up_rate]) * 3600.0
    text = (
        f"at rest the gyros see a vertical rate of {hourly[0]:.3g} deg/h where latitude and Earth rate say {hourly[1]:.3g} "
        "deg/h: check latitude and its sign, and outer_rate"
    )
    return [text]
