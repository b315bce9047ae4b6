"""Joint calibration on a turntable: accelerometers, gyros, mounting and the table's own errors in one fit.

The estimator between multi-position calibration (settings exact) and norm calibration (settings unknown): it weighs the
settings by the table's stated uncertainty, and is at least as precise as either (model: :mod:`.table_model`).
"""

from __future__ import annotations

import numpy as np

from ..calibration import Calibration, Scatter, named
from ..errors import DataError, InputError
from ..estimate import Estimate, Parameter, estimate, settle
from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..recording import Recording
from ..sensors import Triad
from . import budget, common, explain, mount, multi_position
from .norm.case import Case, Start
from .table_model import RIG, TableModel

_FEWEST = 8  # segments of which one can be missed
_RIGHTED, _WORSE = 3.0, 10.0  # mean square of the residuals without a bad segment, and with it in units of that
_LEVER_PRIOR = 0.5  # m: no unit sits further from the axis of a turntable


def calibrate_means(
    means: SegmentMeans, plan: Plan, *, recording: Recording | None = None, robust: bool = False
) -> Calibration:
    """Joint calibration from the means of a plan's segments.

    Parameters
    ----------
    means : SegmentMeans
        Static segments and segments in which one axis turns.
    plan : Plan
        ``rig.angle_uncertainty`` and ``rig.axis_uncertainty`` say how far the table is trusted.
    recording : Recording, optional
        Where the means came from, for the record.
    robust : bool
        Turn down segments that disagree with the rest.

    Returns
    -------
    Calibration
        With the table's tilt, non-perpendicularity and zero errors where they are uncertain.

    Raises
    ------
    DataError
        When the positions do not determine the parameters, when signs, columns, units or the plan's angles are wrong, or the
        noise is not known.
    InputError
        When a segment lacks a table angle.

    References
    ----------
    [DONG18] for the two methods that this one joins.
    """
    model, parameters, remarks = prepare(means, plan)
    try:
        fit = estimate(parameters, model.rows, means.names, robust=robust)
    except DataError as error:
        raise DataError(f"{error}{_suspect(model, parameters, means)}") from error
    remarks += common.misfit_remarks(fit, not robust)
    if remarks and remarks[-1].startswith("the fit is poor"):
        remarks[-1] += _suspect(model, parameters, means)
    remarks += common.prior_remarks(fit)
    return _report(fit, model, means, plan, recording, remarks)


def prepare(means: SegmentMeans, plan: Plan) -> tuple[TableModel, list[Parameter], list[str]]:
    """Model, parameters with start values, and remarks (parameters and errors as for :func:`calibrate_means`)."""
    angles = common.need_angles(means, "table")
    site = common.site_of(plan, "the Earth rate on the gyros")
    rates = common.rates_of(means)
    remarks = [*means.remarks, *(common.gravity_remarks(plan) if "accel" in means.mean else [])]
    sensors = [s for s in ("accel", "gyro") if s in means.mean]
    explain.refuse_missing_turns(means, rates)
    if "gyro" in sensors and not rates.any():
        remarks.append("no turning segments: the gyros were not calibrated")
        sensors.remove("gyro")
    if not sensors:
        raise DataError("table calibration of gyros needs segments that turn (outer_rate); the plan has none")
    linear = multi_position.first_solutions(sensors, means, plan, site, angles, remarks, turning=True)
    to_b = multi_position.frame_of(linear[0].matrix)
    triads, start, sigma = {}, {}, {}
    free = _free_of_settings(means, plan)
    for s in linear:
        if not s.known:
            raise InputError(
                f"the noise of the {s.kind} readings is neither stated nor to be seen in one sample a segment; the table's "
                "uncertainty cannot be weighed against it: state unit.noise in the plan"
            )
        triads[s.kind] = Triad(s.kind, s.counts, full=s.kind != sensors[0])
        start[s.kind] = triads[s.kind].pack(s.matrix @ to_b.T, s.bias)
        if free is not None and free.to_b is not None:
            to_b = free.to_b
            first = free.accel if s.kind == "accel" else free.gyro
            start[s.kind] = first[1] if first is not None else start[s.kind]
        sigma[s.kind] = np.sqrt(means.variance(s.kind, s.density))
    rig = plan.rig
    model = TableModel(
        triads=triads,
        readings={s: means.mean[s] for s in sensors},
        sigma=sigma,
        angles=angles,
        rates=rates,
        left=common.left_of(means, rates),
        site=site,
        letters=rig.letters,
        setting_sigma=rig.angle_uncertainty,
        lever="accel" in sensors and bool(rates.any()),
        rig=rig.axis_uncertainty > 0,
        gravity_unknown=plan.gravity_uncertainty > 0 and "accel" in sensors,
        rate_unknown=rig.rate_uncertainty > 0 and "gyro" in sensors,
    )
    return model, _parameters(model, plan, start, mount.angles_of(to_b.T)), remarks


def _suspect(model: TableModel, parameters: list[Parameter], means: SegmentMeans) -> str:
    """Words on the one segment without which the rest would fit; empty when there is none such."""
    n = len(means.segments)
    if n <= _FEWEST:
        return ""
    fitting = []
    for i in range(n):
        some = model.without(i)
        try:
            settled = settle(parameters, some.rows)
        except (DataError, np.linalg.LinAlgError):
            continue
        rows = some.rows(np.array([p.start for p in settled]))
        fitting.append((float(np.mean(rows.residual**2)), i))
    if not fitting:
        return ""
    best, at = min(fitting)
    others = sorted(chi2 for chi2, _ in fitting)[1:]
    if not others or best > _RIGHTED or others[0] < _WORSE * best:
        return ""
    return f". Without segment {means.segments[at].name!r} all the others fit: check its angles, rate and times"


def _free_of_settings(means: SegmentMeans, plan: Plan) -> Start | None:
    """Start values that settings off by many degrees do not spoil; None where the positions give none."""
    try:
        return Start(Case.of(means, plan))
    except (DataError, InputError):
        return None


def _parameters(model: TableModel, plan: Plan, start: dict[str, Array], mounted: Array) -> list[Parameter]:
    out = []
    sizes = {"accel": model.site.gravity, "gyro": float(np.abs(model.rates).max())}
    for kind, triad in model.triads.items():
        x = start[kind]
        scales = triad.scales(triad.unpack(x)[0], sizes[kind])
        out += [Parameter(n, u, float(v), c) for n, u, v, c in zip(triad.names, triad.units, x, scales, strict=True)]
    out += [Parameter(f"rig.mount.{a}", "rad", float(v), 0.05) for a, v in zip("xyz", mounted, strict=True)]
    if model.lever:
        out += [Parameter(f"rig.lever_arm.{a}", "m", 0.0, 1.0, 0.0, _LEVER_PRIOR) for a in "xyz"]
    if model.rig:
        out += [Parameter(name, "rad", 0.0, 0.5, 0.0, plan.rig.axis_uncertainty) for name in RIG]
    if model.gravity_unknown:
        relative = plan.gravity_uncertainty / model.site.gravity
        out.append(Parameter("site.gravity_error", "1", 0.0, 1.0, 0.0, relative, nuisance=True))
    if model.rate_unknown:
        out.append(Parameter("rig.rate_error", "1", 0.0, 1.0, 0.0, plan.rig.rate_uncertainty, nuisance=True))
    return out


def _report(
    fit: Estimate,
    model: TableModel,
    means: SegmentMeans,
    plan: Plan,
    recording: Recording | None,
    remarks: list[str],
) -> Calibration:
    order = [i for i, p in enumerate(fit.parameters) if not p.nuisance]
    covariance = fit.covariance[np.ix_(order, order)]
    residuals = {
        "all, in units of their noise": Scatter(
            rms=float(np.sqrt(np.mean(fit.residual**2))), unit="", count=fit.residual.size
        )
    }
    if model.setting_sigma > 0:
        settings = np.degrees(model.settings(fit.value)) * 60.0
        residuals["errors of the settings"] = Scatter(
            rms=float(np.sqrt(np.mean(settings**2))), unit="arcmin", count=settings.size
        )
    return common.result(
        "table",
        named([fit.names[i] for i in order], [fit.parameters[i].unit for i in order], fit.value[order], covariance),
        covariance,
        common.fit_record([(fit, order)], residuals),
        plan=plan,
        gravity=model.site.gravity,
        recording=recording,
        means=means,
        budget=budget.lines(budget.of_fit(fit, model.rows, model.effects(fit.value)), fit, order),
        remarks=remarks,
    )
