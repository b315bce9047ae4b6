"""What goes into a norm calibration: readings, plan and first values, made into a model and its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...estimate import Parameter, settle
from ...frames import Array, unit, wahba
from ...observe.means import SegmentMeans
from ...plan import Plan
from ...rigs.turntable import Site, averaging
from ...sensors import Triad
from .. import common, explain, quadric, sanity
from .model import NO_AZIMUTH, Group, NormModel, across

_LEVER_PRIOR = 0.5  # m: no unit sits further from the axis of a turntable
_LEAST_TWIST = 1e-7  # rad: a table stated to be perfect
_FREE_TWIST = 0.3  # rad


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


def model_of(case: Case, start: Start) -> tuple[NormModel, bool]:
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


class Prepared(NamedTuple):
    """A problem before it is solved: what there is, first values, residuals, whether their noise is known, parameters."""

    case: Case
    start: Start
    model: NormModel
    known: bool
    parameters: Sequence[Parameter]


def prepare(means: SegmentMeans, plan: Plan) -> Prepared:
    """Model and parameters of :func:`sagnac.calibrate.norm.solve` (same parameters and errors)."""
    case = Case.of(means, plan)
    explain.refuse_missing_turns(means, common.rates_of(means))
    if case.nominal is not None:
        site = Site(plan.latitude or 0.0, case.gravity, plan.earth_rate if plan.latitude is not None else 0.0)
        for sensor in ("accel",) * case.has_accel + ("gyro",) * case.has_gyro:
            explain.refuse_other_reading(sensor, means, plan, site)
    start = Start(case)
    model, known = model_of(case, start)
    parameters: Sequence[Parameter] = _parameters(case, start, model)
    if model.lever:
        # a lever arm can throw the first directions off by more than h: settle it before h's azimuth is freed
        parameters = settle(parameters, model.without_azimuths(start.to_b is not None).rows)
    return Prepared(case, start, model, known, parameters)
