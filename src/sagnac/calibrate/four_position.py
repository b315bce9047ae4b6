"""Biases from positions whose inputs cancel ([ZHOU13], four-position method).

In the set of four (or any set that cancels) the Earth rate and the specific force sum to zero on every axis, so that all terms
linear in the inputs leave the mean::

    gyro bias_i  = mean over positions of mean(gyro_i)
    accel bias_i = mean over positions of mean(accel_i) - K2_i Q_i^2 g^2

Both are solved as one least-squares problem with the linear terms L as unknowns of their own, ::

    N_s - u_s = b + L u_s,

of which the mean is the solution for equal positions, and which stays right when they are held for unequal times. What does
not cancel goes into the budget.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .. import calibration as record
from ..calibration import BudgetLine, Calibration, Scatter, named
from ..errors import DataError, InputError
from ..estimate import Estimate, Parameter, Rows, estimate
from ..frames import Array, skew
from ..observe.means import SegmentMeans
from ..plan import Plan, Segment
from ..recording import Recording
from ..rigs.turntable import Letters, attitude
from . import common, sanity
from .budget import NOISE, SETTINGS

_CANCELS = 1e-4
"""Largest mean input, relative to gravity and to the Earth rate, of a set that counts as cancelling (20 arcsec)."""
_LINEAR_PRIOR = 1.0  # wide: the linear terms are found where they can be seen and do not matter where they cannot
_LINEAR_TYPICAL = 0.01
_SEEN = 0.05  # a linear term known to this is worth a look
_AXES = "xyz"


@dataclass
class _Budget:
    """Variances by source, for biases x, y, z of one sensor."""

    lines: dict[str, Array] = field(default_factory=dict)

    def add(self, source: str, sigma: Array | float) -> None:
        self.lines[source] = np.hypot(self.lines.get(source, np.zeros(3)), np.broadcast_to(sigma, 3))

    def total(self) -> Array:
        return np.asarray(np.sqrt(sum((s**2 for s in self.lines.values()), np.zeros(3))))


def calibrate_means(
    means: SegmentMeans, plan: Plan, *, recording: Recording | None = None, robust: bool = False
) -> Calibration:
    """Biases from a set of static positions whose inputs cancel.

    Parameters
    ----------
    means : SegmentMeans
        SI readings of static segments.
    plan : Plan
        Attitudes as ``x_azimuth``, ``y_azimuth``, ``z`` or as table angles; known K2 in ``unit.accel_k2``; limits of what
        does not cancel in ``unit.limits``.
    recording : Recording, optional
    robust : bool
        Turn down positions that disagree.

    Returns
    -------
    Calibration
        With an uncertainty budget.

    Raises
    ------
    DataError
        When the inputs do not cancel: the axis and the input left over.
    InputError
        When a position is not right-handed or lacks its attitude, or the readings are raw counts.
    """
    moving = [s.name for s in means.segments if s.turn_rate != 0]
    if moving:
        raise DataError(f"four-position works on static positions; these turn: {', '.join(moving)}")
    if means.counts:
        raise InputError("four-position needs readings in units of the input; give the nominal scale with --scale")
    site = common.site_of(plan, "the Earth rate that must cancel")
    to_enu = np.array([_attitude(s, plan.rig.letters) for s in means.segments])
    inputs = {
        "accel": site.gravity * to_enu[:, 2, :],
        "gyro": np.einsum("nji,j->ni", to_enu, site.enu),
    }
    sizes = {"accel": site.gravity, "gyro": site.earth_rate}
    remarks = list(means.remarks)
    for sensor in ("gyro", "accel"):
        if sensor in means.mean:
            _refuse_uncancelled(sensor, inputs[sensor], sizes[sensor], means.names)
    done = [
        _solve(sensor, means, plan, inputs[sensor], sizes[sensor], robust, remarks)
        for sensor in ("gyro", "accel")
        if sensor in means.mean
    ]
    return _report(done, means, plan, site.gravity, recording, remarks)


def _attitude(segment: Segment, letters: Letters) -> Array:
    """C_b^n of a position."""
    if segment.x_azimuth is not None and segment.y_azimuth is not None and segment.z is not None:
        x = np.array([math.sin(segment.x_azimuth), math.cos(segment.x_azimuth), 0.0])
        y = np.array([math.sin(segment.y_azimuth), math.cos(segment.y_azimuth), 0.0])
        z = np.array([0.0, 0.0, 1.0 if segment.z == "up" else -1.0])
        if abs(float(x @ y)) > 1e-3:
            raise InputError(f"segment {segment.name!r}: the azimuths of x and y are not 90 deg apart")
        if float(np.cross(x, y) @ z) < 0:
            other = "down" if segment.z == "up" else "up"
            raise InputError(
                f"segment {segment.name!r} is left-handed: with these azimuths of x and y, z points {other}. Correct one of them"
            )
        return np.column_stack([x, y, z])
    if segment.angles is not None:
        return attitude(np.array(segment.angles), letters=letters)
    raise InputError(
        f"segment {segment.name!r} gives no attitude: write x_azimuth, y_azimuth and z, or outer, middle and inner"
    )


def _refuse_uncancelled(sensor: str, u: Array, size: float, names: Sequence[str]) -> None:
    left = u.mean(axis=0)
    worst = int(np.argmax(np.abs(left)))
    if abs(left[worst]) <= _CANCELS * size:
        return
    kind, value, unit = (
        ("specific force", left[worst] / 9.80665, "g")
        if sensor == "accel"
        else ("Earth rate", math.degrees(left[worst]) * 3600.0, "deg/h")
    )
    raise DataError(
        f"the inputs of these {len(names)} positions do not cancel: on axis {_AXES[worst]} a mean {kind} of {value:.4g} {unit} "
        "is left, which would pass for bias. Add the missing position or correct the attitudes"
    )


@dataclass(frozen=True)
class _Solved:
    sensor: str
    fit: Estimate
    value: Array
    budget: _Budget


def _solve(
    sensor: str, means: SegmentMeans, plan: Plan, u: Array, size: float, robust: bool, remarks: list[str]
) -> _Solved:
    readings = means.mean[sensor]
    noise = common.noise_of(means, plan, sensor, 1.0, size)
    remarks += noise.remarks
    white = means.variance(sensor, noise.density)
    # an angle error turns the input: u x error, independent in each position
    sigma = plan.rig.angle_uncertainty
    turned = np.einsum("nij,nkj->nik", skew(u), skew(u)) * sigma**2 + np.einsum("ni,nj->nij", u, u) * sigma**4
    covariance = np.einsum("ni,ij->nij", white, np.eye(3)) + turned
    weight = np.linalg.inv(np.linalg.cholesky(covariance))
    design = np.zeros((len(u), 3, 12))
    for i in range(3):
        design[:, i, i] = 1.0
        design[:, i, 3 + 3 * i : 6 + 3 * i] = u / size
    known = plan.unit.accel_k2 if sensor == "accel" else None
    quadratic = np.array(known) * u**2 if known is not None else np.zeros_like(u)
    observed = readings - u * (1.0 - sigma**2) - quadratic  # turned by random angles, the mean input is shorter

    def rows(x: Array) -> Rows:
        r = (weight @ (observed - design @ x)[..., None])[..., 0]
        return Rows(r.ravel(), -(weight @ design).reshape(-1, 12), np.repeat(np.arange(len(u)), 3))

    unit = "m/s^2" if sensor == "accel" else "rad/s"
    start = float(np.abs(observed).max())
    parameters = [
        Parameter(f"{sensor}.bias.{a}", unit, float(observed[:, i].mean()), max(size, start))
        for i, a in enumerate(_AXES)
    ]
    parameters += [
        Parameter(
            f"{sensor}.linear.{i}{j}", unit, 0.0, 10.0 * _LINEAR_PRIOR * size, 0.0, _LINEAR_PRIOR * size, nuisance=True
        )
        for i in _AXES
        for j in _AXES
    ]
    measured = noise.known or means.noise_degrees_of_freedom > 0  # or measured to be nothing
    fit = estimate(parameters, rows, means.names, noise_known=measured, robust=robust)
    seen = fit.white[3:].reshape(3, 3) < _SEEN * size
    sanity.check_linear(sensor, np.eye(3) + fit.value[3:].reshape(3, 3) / size, seen)
    return _Solved(sensor, fit, fit.value[:3], _budget(sensor, fit, weight, white, turned, u, plan, remarks))


def _budget(
    sensor: str, fit: Estimate, weight: Array, white: Array, turned: Array, u: Array, plan: Plan, remarks: list[str]
) -> _Budget:
    """Uncertainty of the biases by source."""
    n = len(u)
    # change of the biases for a change of each reading: gain of the whitened residual times the whitening
    gain = np.einsum("pni,nij->pnj", fit.gain[:3].reshape(3, n, 3), weight)
    budget = _Budget()
    budget.add(NOISE, np.sqrt(np.einsum("pni,ni->p", gain**2, white)))
    budget.add(SETTINGS, np.sqrt(np.maximum(np.einsum("pni,nij,pnj->p", gain, turned, gain), 0.0)))
    explained = np.sqrt(budget.lines[NOISE] ** 2 + budget.lines[SETTINGS] ** 2)
    extra = np.maximum(fit.sigma[:3] ** 2 - explained**2, 0.0)
    if fit.used != "white" and np.any(extra > 0):
        budget.add("scatter between positions beyond both", np.sqrt(extra))
    limits = plan.unit.limits
    quadratic = np.mean(u**2, axis=0)
    if sensor == "accel":
        if limits.accel_k2 is not None:
            budget.add("quadratic coefficient K2", limits.accel_k2 * quadratic)
        elif plan.unit.accel_k2 is None:
            remarks.append(
                "K2 of the accelerometers is not stated: an unknown K2 adds K2 g^2 to the bias of the vertical axis; state "
                "unit.accel_k2, or its limit in unit.limits"
            )
        if limits.accel_drift is not None:
            budget.add("drift during the turn-over", limits.accel_drift / np.sqrt(12.0))
    else:
        if limits.gyro_g_squared is not None:
            budget.add("g-squared sensitivity", limits.gyro_g_squared * plan.site_gravity**2)
        else:
            remarks.append(
                "the gyros' g-squared sensitivity is not stated (unit.limits.gyro_g_squared): it does not cancel and is "
                "not in the budget"
            )
        if limits.gyro_drift is not None:
            budget.add("drift during the turn-over", limits.gyro_drift / np.sqrt(12.0))
    left = np.abs(u.mean(axis=0)) * _LINEAR_TYPICAL
    if left.max() > 1e-3 * explained.max():
        budget.add("input that does not quite cancel", left)
    return budget


def _report(
    done: list[_Solved],
    means: SegmentMeans,
    plan: Plan,
    gravity: float,
    recording: Recording | None,
    remarks: list[str],
) -> Calibration:
    names = [f"{d.sensor}.bias.{a}" for d in done for a in _AXES]
    units = [u for d in done for u in (["m/s^2"] * 3 if d.sensor == "accel" else ["rad/s"] * 3)]
    value = np.concatenate([d.value for d in done])
    covariance = np.zeros((value.size, value.size))
    for k, d in enumerate(done):
        at = slice(3 * k, 3 * k + 3)
        fitted = d.fit.covariance[:3, :3]
        added = np.maximum(d.budget.total() ** 2 - np.diag(fitted), 0.0)
        covariance[at, at] = fitted + np.diag(added)
    sources = list(dict.fromkeys(s for d in done for s in d.budget.lines))
    budget = tuple(
        BudgetLine(
            source=s,
            standard_uncertainty=tuple(float(v) for d in done for v in d.budget.lines.get(s, np.zeros(3))),
        )
        for s in sources
    )
    residuals = {
        f"{d.sensor} (in units of its noise and the table's angles)": Scatter(
            rms=float(np.sqrt(np.mean(d.fit.residual**2))), unit="", count=d.fit.residual.size
        )
        for d in done
    }
    fit: record.Fit = common.fit_record([(d.fit, [0, 1, 2]) for d in done], residuals, [d.sensor for d in done])
    return common.result(
        "four-position",
        named(names, units, value, covariance),
        covariance,
        fit,
        plan=plan,
        gravity=gravity,
        recording=recording,
        means=means,
        budget=budget,
        remarks=remarks,
    )
