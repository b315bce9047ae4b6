"""Norm-observation calibration on a turntable, from the means of a plan's segments (model: :mod:`.norm_model`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calibration import Calibration, Scatter, named
from ..errors import DataError
from ..estimate import Estimate, Parameter, estimate, settle
from ..frames import Array, unit, wahba
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..recording import Recording
from ..rigs.turntable import Site, averaging
from ..sensors import Triad
from . import common, explain, mount, quadric, sanity
from .norm_model import NO_AZIMUTH, Group, NormModel, across

_LEVER_PRIOR = 0.5  # m: no unit sits further from the axis of a turntable
_ASTRAY = 3.0
_LEAST_TWIST = 1e-7  # rad: a table stated to be perfect
_FREE_TWIST = 0.3  # rad


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
    return _report(solution, recording)


class Solution(NamedTuple):
    """The fit with what it was made of."""

    fit: Estimate
    model: NormModel
    case: Case

    def directions(self) -> Array:
        """Most likely direction of up or of the outer axis in b, (n, 3)."""
        out = np.zeros((len(self.case.rates), 3))
        for group in self.model.groups:
            out[group.index] = self.model.locals(group, self.fit.value).a
        return out


def solve(means: SegmentMeans, plan: Plan, *, robust: bool = False) -> Solution:
    """Fit of :func:`calibrate_means` before it is written up (same parameters and errors).

    Segments that scatter by more than their noise are weighed alike in a second fit: what makes them differ is then not
    the noise, and a long segment is no better than a short one.
    """
    case, start, model, known, parameters = prepare(means, plan)
    fit = estimate(parameters, model.rows, means.names, noise_known=known, robust=robust)
    case.remarks.extend(common.misfit_remarks(fit, known and not robust))
    if known and not robust and fit.used != "white" and np.ptp(means.duration) > 0:
        alike = replace(means, duration=np.full_like(means.duration, means.duration.mean()))
        model, _ = _model(replace(case, means=alike), start)
        again = estimate(parameters, model.rows, means.names, noise_known=False, robust=robust)
        fit = replace(again, white=fit.white, chi2=fit.chi2, p_value=fit.p_value)
        case.remarks.append("segments scatter by more than their noise and are weighed alike, whatever their length")
    solution = Solution(fit, model, case)
    case.remarks.extend(_earth_at_rest(solution))
    return solution


class Prepared(NamedTuple):
    """A problem before it is solved: what there is, first values, residuals, whether their noise is known, parameters."""

    case: Case
    start: Start
    model: NormModel
    known: bool
    parameters: Sequence[Parameter]


def prepare(means: SegmentMeans, plan: Plan) -> Prepared:
    """Model and parameters of :func:`solve` (same parameters and errors)."""
    case = Case.of(means, plan)
    explain.refuse_missing_turns(means, common.rates_of(means))
    if case.nominal is not None:
        site = Site(plan.latitude or 0.0, case.gravity, plan.earth_rate if plan.latitude is not None else 0.0)
        for sensor in ("accel",) * case.has_accel + ("gyro",) * case.has_gyro:
            explain.refuse_other_reading(sensor, means, plan, site)
    start = Start(case)
    model, known = _model(case, start)
    parameters: Sequence[Parameter] = _parameters(case, start, model)
    if model.lever:
        # a lever arm can throw the first directions off by more than h: settle it before h's azimuth is freed
        parameters = settle(parameters, model.without_azimuths(start.to_b is not None).rows)
    return Prepared(case, start, model, known, parameters)


def _earth_at_rest(solution: Solution) -> list[str]:
    """The vertical Earth rate that the gyros see at rest, which the fit has not used, against the plan's latitude."""
    fit, model, case = solution
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


@dataclass(frozen=True)
class Case:
    """What there is to work with."""

    means: SegmentMeans
    plan: Plan
    rates: Array
    has_accel: bool
    has_gyro: bool
    gravity: float
    earth: Array
    """Horizontal and vertical Earth rate, rad/s."""
    left: Array
    """What averaging leaves of a turning vector, (n,)."""
    nominal: Array | None
    """C_k^n of the settings, (n, 3, 3)."""
    remarks: list[str]

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Which segments turn."""
        return np.asarray(self.rates != 0.0)

    @classmethod
    def of(cls, means: SegmentMeans, plan: Plan) -> Case:
        """Gather what a plan and its means give."""
        rates = common.outer_rates(means, plan, "norm")
        has_accel = "accel" in means.mean
        has_gyro = "gyro" in means.mean and bool(rates.any())
        remarks = [*means.remarks, *(common.gravity_remarks(plan) if has_accel else [])]
        if not has_accel and not has_gyro:
            raise DataError("norm calibration of gyros needs segments with outer_rate; the plan has none")
        if "gyro" in means.mean and not has_gyro:
            remarks.append("no turning segments: the gyros were not calibrated")
        earth = np.zeros(2)
        if has_gyro:
            latitude = plan.need_latitude("the Earth rate in the turning segments")
            earth = plan.earth_rate * np.array([np.cos(latitude), np.sin(latitude)])
        return cls(
            means,
            plan,
            rates,
            has_accel,
            has_gyro,
            plan.site_gravity,
            earth,
            averaging(rates * means.interval, means.count),
            common.nominal_attitudes(means, plan),
            remarks,
        )


class Start:
    """First matrices and directions: exact for noise-free data without lever arm and tilt.

    Attributes
    ----------
    accel, gyro : (Triad, ndarray) or None
        Parameterisation and first values of each triad.
    to_b : ndarray, shape (3, 3), or None
        C_k^b from the settings, where the plan gives them.
    directions : ndarray, shape (n, 3)
        Up, or the outer axis, in b.
    """

    def __init__(self, case: Case) -> None:
        self.accel: tuple[Triad, Array] | None = None
        self.gyro: tuple[Triad, Array] | None = None
        self.to_b: Array | None = None
        self.directions = np.zeros((len(case.rates), 3))
        if case.has_accel:
            self._accel(case)
        self.level = np.abs(case.left) * case.earth[0]
        self.north = self._north(case)
        if case.has_gyro and case.has_accel:
            self._gyro_in_b(case)
        elif case.has_gyro:
            self._gyro_alone(case)

    def _accel(self, case: Case) -> None:
        readings, counts = case.means.mean["accel"], "accel" in case.means.counts
        matrix, bias = quadric.fit(readings, np.full(len(readings), case.gravity), "accel")
        a = unit(np.asarray(np.linalg.solve(matrix, (readings - bias).T).T))
        if case.nominal is not None:
            up = case.nominal[:, 2, :]
            signs, found = sanity.check_sense("accel", a, up, counts)
            case.remarks.extend(found)
            matrix, a = matrix * signs, a * signs
            self.to_b = wahba(up, a)
        case.remarks.extend(sanity.scale_remarks("accel", matrix, counts))
        triad = Triad("accel", counts)
        self.accel, self.directions = (triad, triad.pack(matrix, bias)), a

    def _north(self, case: Case) -> Array:
        """North in b from the settings, turned round where averaging turns it round; any direction without settings."""
        if self.to_b is None or case.nominal is None:
            return np.asarray(np.roll(self.directions, 1, axis=1) + np.array([0.0, 0.0, 1e-3]))
        sign = np.where(case.left < 0, -1.0, 1.0)
        return np.asarray(sign[:, None] * (case.nominal[:, 1, :] @ self.to_b.T))

    def _gyro_in_b(self, case: Case) -> None:
        """All nine elements of S_g and the bias, linear once the directions are known."""
        at = case.turning
        a, readings, counts = self.directions[at], case.means.mean["gyro"][at], "gyro" in case.means.counts
        along = case.rates[at] + case.earth[1]
        u = along[:, None] * a
        if self.to_b is not None and case.nominal is not None:
            u = u + self.level[at][:, None] * across(self.north[at], a)
        size = np.abs(along).max()
        design = np.column_stack([u / size, np.ones(len(u))])
        if np.linalg.matrix_rank(design, tol=1e-6 * np.linalg.norm(design)) < 4:
            raise DataError(
                f"the {at.sum()} turning segments do not spread over all three axes in both senses: gyro scale, "
                "misalignment and bias cannot be told apart"
            )
        solution = np.linalg.lstsq(design, readings, rcond=None)[0]
        matrix, bias = solution[:3].T / size, solution[3]
        case.remarks.extend(sanity.check_gyro_sense(matrix, counts, "the plan's rates"))
        case.remarks.extend(sanity.scale_remarks("gyro", matrix, counts))
        triad = Triad("gyro", counts, full=True)
        self.gyro = triad, triad.pack(matrix, bias)

    def _gyro_alone(self, case: Case) -> None:
        at = case.turning
        readings, counts = case.means.mean["gyro"], "gyro" in case.means.counts
        along = case.rates[at] + case.earth[1]
        matrix, bias = quadric.fit(readings[at], np.hypot(along, self.level[at]), "gyro")
        case.remarks.extend(sanity.scale_remarks("gyro", matrix, counts))
        if case.nominal is not None:
            seen = unit(np.asarray(np.linalg.solve(matrix, (readings[at] - bias).T).T)) * np.sign(along)[:, None]
            signs, found = sanity.check_sense("gyro", seen, case.nominal[at, 2, :], counts)
            matrix = matrix * signs
            case.remarks.extend(found)
        self.directions = unit(np.asarray(np.linalg.solve(matrix, (readings - bias).T).T))
        case.remarks.append("gyros alone: their frame has x along gyro x and y in the plane of gyros x and y")
        triad = Triad("gyro", counts)
        self.gyro = triad, triad.pack(matrix, bias)


def _model(case: Case, start: Start) -> tuple[NormModel, bool]:
    """The residuals and whether their noise is known."""
    known, sigma = True, {}
    for sensor, first in (("accel", start.accel), ("gyro", start.gyro)):
        if first is None:
            continue
        gain = float(np.mean(np.linalg.norm(first[0].unpack(first[1])[0], axis=1))) if first[0].counts else 1.0
        readings = case.means.mean[sensor][case.turning if sensor == "gyro" else slice(None)]
        size = float(np.abs(readings - readings.mean(axis=0)).max())
        noise = common.noise_of(case.means, case.plan, sensor, gain, size)
        known = known and noise.known
        case.remarks.extend(noise.remarks)
        sigma[sensor] = np.sqrt(case.means.variance(sensor, noise.density))
    groups = [
        _group(case, start, sigma, which, known)
        for which in (np.flatnonzero(~case.turning), np.flatnonzero(case.turning))
        if which.size and (start.accel is not None or case.turning[which].all())
    ]
    both = any(g.accel is not None and g.gyro is not None for g in groups)
    model = NormModel(
        accel=start.accel[0] if start.accel else None,
        gyro=start.gyro[0] if start.gyro else None,
        lever=both,
        tilt=both and start.to_b is not None and case.plan.rig.axis_uncertainty > 0,
        gravity_unknown=case.plan.gravity_uncertainty > 0 and case.has_accel,
        rate_unknown=case.plan.rig.rate_uncertainty > 0 and case.has_gyro,
        gravity=case.gravity,
        up_rate=float(case.earth[1]),
        groups=tuple(groups),
    )
    return model, known


def _group(case: Case, start: Start, sigma: dict[str, Array], which: NDArray[np.intp], known: bool) -> Group:
    turning = bool(case.turning[which].all())
    n, a = which.size, start.directions[which]
    variances, lean, twist = [], np.zeros((n, 3, 2)), None
    if start.accel is not None:
        variances.append(sigma["accel"][which] ** 2)
    if turning and start.gyro is not None:
        variances.append(sigma["gyro"][which] ** 2)
    covariance = np.einsum("ni,ij->nij", np.hstack(variances), np.eye(3 * len(variances)))
    if turning and case.has_accel and case.has_gyro:
        twist = np.full(n, NO_AZIMUTH)
        if start.to_b is not None and case.nominal is not None:
            # outer and inner setting both turn the unit about the vertical: the inner by the sine of the middle angle
            crossed = np.hypot(1.0, case.nominal[which][:, 2, 1])
            # readings of unknown noise carry a nominal one that no prior may outweigh
            twist = np.maximum(case.plan.rig.angle_uncertainty * crossed, _LEAST_TWIST if known else _FREE_TWIST)
            to_b = np.einsum("ij,nkj->nik", start.to_b, case.nominal[which])
            lean = case.left[which][:, None, None] * to_b[:, :, :2] @ np.array([[0.0, -1.0], [1.0, 0.0]])
        elif case.plan.rig.axis_uncertainty > 0 and start.accel is not None:
            matrix = start.accel[0].unpack(start.accel[1])[0]
            tilt = (case.gravity * case.plan.rig.axis_uncertainty * case.left[which]) ** 2
            level = np.eye(3) - a[:, :, None] * a[:, None, :]
            covariance[:, :3, :3] += tilt[:, None, None] * (matrix @ level @ matrix.T)
    return Group(
        index=which,
        accel=case.means.mean["accel"][which] if start.accel is not None else None,
        gyro=case.means.mean["gyro"][which] if turning and start.gyro is not None else None,
        weight=np.linalg.inv(np.linalg.cholesky(covariance)),
        rate=case.rates[which],
        level=start.level[which],
        north=start.north[which],
        twist_sigma=twist,
        lean=lean,
        start=a,
    )


def _parameters(case: Case, start: Start, model: NormModel) -> list[Parameter]:
    out = []
    sizes = {"accel": case.gravity, "gyro": float(np.abs(case.rates).max())}
    for first in (start.accel, start.gyro):
        if first is not None:
            triad, x = first
            scales = triad.scales(triad.unpack(x)[0], sizes[triad.kind])
            out += [Parameter(n, u, v, s) for n, u, v, s in zip(triad.names, triad.units, x, scales, strict=True)]
    rig = case.plan.rig
    if model.lever:
        out += [Parameter(f"rig.lever_arm.{a}", "m", 0.0, 1.0, 0.0, _LEVER_PRIOR) for a in "xyz"]
    if model.tilt:
        out += [Parameter(f"rig.tilt.{a}", "rad", 0.0, 0.5, 0.0, rig.axis_uncertainty, nuisance=True) for a in "xy"]
    if model.gravity_unknown:
        relative = case.plan.gravity_uncertainty / case.gravity
        out.append(Parameter("site.gravity_error", "1", 0.0, 1.0, 0.0, relative, nuisance=True))
    if model.rate_unknown:
        out.append(Parameter("rig.rate_error", "1", 0.0, 1.0, 0.0, rig.rate_uncertainty, nuisance=True))
    return out


def _report(solution: Solution, recording: Recording | None) -> Calibration:
    fit, model, case = solution
    order = [i for i, p in enumerate(fit.parameters) if not p.nuisance]
    names = [fit.names[i] for i in order]
    units = [fit.parameters[i].unit for i in order]
    value, covariance = fit.value[order], fit.covariance[np.ix_(order, order)]
    parts: list[tuple[Estimate, list[int]]] = [(fit, order)]
    found = _mounting(solution)
    if found is not None:
        k, m = found.cross.shape[1], len(order)
        names += list(found.fit.names)
        units += [p.unit for p in found.fit.parameters]
        value = np.concatenate([value, found.fit.value])
        covariance = block_diagonal(covariance, found.fit.covariance)
        covariance[m:, :k], covariance[:k, m:] = found.cross, found.cross.T
        parts.append((found.fit, list(range(len(found.fit.names)))))
        case.remarks.append("rig.mount and rig.tilt rest on the table's angles; nothing else in this result does")
        case.remarks.extend(_settings_remarks(found.fit, model))
    return common.result(
        "norm",
        named(names, units, value, covariance),
        covariance,
        common.fit_record(parts, _scatter(fit, model), ("triads", "mounting")[: len(parts)]),
        plan=case.plan,
        gravity=case.gravity,
        recording=recording,
        means=case.means,
        remarks=case.remarks,
    )


def _settings_remarks(found: Estimate, model: NormModel) -> list[str]:
    """A word where the settings do not fit the directions that the accelerometers show."""
    times = np.sqrt(found.chi2 / max(found.degrees_of_freedom, 1))
    if found.degrees_of_freedom < 1 or times < _ASTRAY or found.p_value > 1e-6:
        return []
    shifted = max(found.influence, key=lambda i: i.chi2)
    text = (
        f"the plan's angles miss the directions found by {times:.3g} times the stated uncertainty, most in segment "
        f"{shifted.segment!r}: rig.mount and rig.tilt are not to be trusted"
    )
    return [text + (", nor is the azimuth that the gyros rest on" if model.gyro is not None else "")]


def _mounting(solution: Solution) -> mount.Mounting | None:
    """Mounting angles from the directions, where settings and geometry give them; a by-product that stops nothing."""
    fit, model, case = solution
    if model.accel is None:
        return None
    p = model.split(fit.value)
    k = len(model.accel.names)
    matrix, _, _ = model.accel.unpack(p.accel)
    d_matrix, d_bias, _ = model.accel.derivatives(p.accel)
    a = solution.directions()
    noise = np.zeros(len(a))
    for group in model.groups:
        readings = np.einsum("nii->ni", np.linalg.inv(group.weight))
        noise[group.index] = np.sqrt(np.mean(readings[:, :3] ** 2, axis=1))
    gain = float(np.mean(np.linalg.norm(matrix, axis=1)))
    level = np.eye(3) - a[:, :, None] * a[:, None, :]
    change = np.einsum("kij,nj->nik", d_matrix, case.gravity * a) + d_bias.T
    sensitivity = -level @ np.linalg.inv(matrix) @ change / case.gravity
    try:
        return mount.find(case.means, case.plan, a, noise / (gain * case.gravity), sensitivity, fit.covariance[:k, :k])
    except DataError:
        case.remarks.append(
            "the mounting angles are not determined (a turn by 90 deg about y leaves two of them alike)"
        )
        return None


def block_diagonal(first: Array, second: Array) -> Array:
    """One matrix of two square ones without coupling."""
    n, m = len(first), len(second)
    out = np.zeros((n + m, n + m))
    out[:n, :n], out[n:, n:] = first, second
    return out


def _scatter(fit: Estimate, model: NormModel) -> dict[str, Scatter]:
    """Misfit of the norms in SI, and of each kind of segment in units of its noise."""
    out = {}
    p = model.split(fit.value)
    for kind, triad, x in (("accel", model.accel, p.accel), ("gyro", model.gyro, p.gyro)):
        if triad is None:
            continue
        matrix, bias, _ = triad.unpack(x)
        misfit = []
        for group in model.groups:
            readings = getattr(group, kind)
            if readings is None or (kind == "accel" and group.gyro is not None):
                continue
            size = np.linalg.norm(np.linalg.solve(matrix, (readings - bias).T), axis=0)
            known = model.gravity if kind == "accel" else np.hypot(group.rate + model.up_rate, group.level)
            misfit.append(size - known)
        if misfit:
            every = np.concatenate(misfit)
            name, unit = ("static norm", "m/s^2") if kind == "accel" else ("rate norm", "rad/s")
            out[name] = Scatter(rms=float(np.sqrt(np.mean(every**2))), unit=unit, count=every.size)
    for group in model.groups:
        here = np.isin(fit.segment, group.index)
        kind = "static" if group.gyro is None else "turning"
        rms = float(np.sqrt(np.mean(fit.residual[here] ** 2)))
        out[f"{kind} segments, in units of their noise"] = Scatter(rms=rms, unit="", count=int(here.sum()))
    return out
