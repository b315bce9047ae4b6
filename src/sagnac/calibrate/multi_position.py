"""Multi-position calibration: inputs known from the table's settings, linear weighted least squares.

The traditional method (section 2 of the methods), the peer of norm calibration and the choice for a good table::

    N_s = S u_s + b,   u_s from the settings of segment s, latitude, gravity and the outer rate

Rows are weighed with the noise of the means and with what the table's stated uncertainty does to the input: each setting's
error is independent, the axes' own errors (tilt, non-perpendicularity, zero) are common to all segments.

``full`` gives S in the table's case frame k. ``triangular`` gives S_a lower triangular in the accelerometers' own frame b with
the three mounting angles of b in k, and S_g full in b: the same nine numbers per triad, told apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calibration import Calibration, Scatter, named
from ..errors import DataError
from ..estimate import Estimate, Parameter, Rows, estimate
from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..recording import Recording
from ..rigs.turntable import Site, TableErrors, attitude, averaging, mean_inputs
from ..sensors import AXES, Triad, signed_permutation
from . import common, mount, sanity

_STEP = 1e-6  # rad, central differences of the rig's model: error 1e-12


def calibrate_means(
    means: SegmentMeans,
    plan: Plan,
    *,
    matrix: str = "full",
    recording: Recording | None = None,
    robust: bool = False,
) -> Calibration:
    """Calibration with inputs known from the table's settings.

    Parameters
    ----------
    means : SegmentMeans
        Static segments for accelerometers and gyro biases, turning ones for gyro scale and misalignment.
    plan : Plan
    matrix : str
        ``full`` or ``triangular``, see the module.
    recording : Recording, optional
    robust : bool
        Turn down segments that disagree with the rest.

    Returns
    -------
    Calibration

    Raises
    ------
    DataError
        When the positions do not determine the parameters, or signs, columns or units are wrong.
    InputError
        When a segment lacks a table angle.
    """
    angles = common.need_angles(means, "multi-position")
    site = common.site_of(plan, "the Earth rate on the gyros")
    remarks = list(means.remarks)
    sensors = [s for s in ("accel", "gyro") if s in means.mean]
    rates = np.array([s.outer_rate for s in means.segments])
    if "gyro" in sensors and not rates.any():
        remarks.append("no turning segments: the gyros were not calibrated")
        sensors.remove("gyro")
    if not sensors:
        raise DataError("multi-position of gyros needs segments with outer_rate; the plan has none")
    first: dict[str, _Sensor] = {}
    for sensor in sensors:
        first[sensor] = _first(sensor, means, plan, site, angles, rates, remarks)
    if matrix == "triangular" and "accel" in first:
        problem: _Full | _Triangular = _Triangular(first, site.gravity, float(np.abs(rates).max()))
    else:
        problem = _Full(first, site.gravity, float(np.abs(rates).max()))
    fit = estimate(
        problem.parameters(), problem.rows, means.names, noise_known=all(f.known for f in first.values()), robust=robust
    )
    return _report(fit, means, plan, site, recording, remarks)


@dataclass(frozen=True)
class _Sensor:
    """One triad: inputs in k, readings, whitening of all its rows together, first S and b in k."""

    kind: str
    counts: bool
    inputs: Array
    readings: Array
    weight: Array
    matrix: Array
    bias: Array
    known: bool


class _Linear(NamedTuple):
    """Unweighted solution of one triad: inputs in k (n, 3), which segments count, S and b in k."""

    inputs: Array
    used: NDArray[np.bool_]
    matrix: Array
    bias: Array


def _linear(sensor: str, means: SegmentMeans, site: Site, angles: Array, rates: Array) -> _Linear:
    inputs = mean_inputs(angles, rates, rates * means.interval, means.count, site)[0 if sensor == "accel" else 1]
    # a lever arm would show in the accelerometers of turning segments
    used = np.asarray(rates == 0) if sensor == "accel" else np.ones(len(rates), dtype=np.bool_)
    if not used.any():
        raise DataError("multi-position needs static segments for the accelerometers; all segments turn")
    size = float(np.abs(inputs).max())
    design = np.column_stack([inputs[used] / size, np.ones(used.sum())])
    if np.linalg.matrix_rank(design, tol=1e-6 * np.linalg.norm(design)) < 4:
        raise DataError(
            f"the {used.sum()} segments do not excite all three {sensor} axes in both senses: scale, misalignment and bias "
            "cannot be told apart. Add positions"
        )
    solution = np.linalg.lstsq(design, means.mean[sensor][used], rcond=None)[0]
    return _Linear(inputs, used, solution[:3].T / size, solution[3])


def closed_form(means: SegmentMeans, plan: Plan) -> dict[str, float]:
    """The traditional unweighted solution, which trusts every setting: baseline of the comparison in [DONG18].

    Parameters
    ----------
    means : SegmentMeans
        With both triads, SI.
    plan : Plan

    Returns
    -------
    dict of str to float
        Parameters as ``triangular`` names them, without uncertainties.
    """
    angles = common.need_angles(means, "multi-position")
    site = common.site_of(plan, "the Earth rate on the gyros")
    rates = np.array([s.outer_rate for s in means.segments])
    accel, gyro = (_linear(s, means, site, angles, rates) for s in ("accel", "gyro"))
    static = rates == 0
    bias = gyro.bias
    if static.any():  # angle errors times the table's rate would drown the bias in turning segments
        bias = (means.mean["gyro"] - gyro.inputs @ gyro.matrix.T)[static].mean(axis=0)
    to_b = _frame_of(accel.matrix)
    first, second = Triad("accel"), Triad("gyro", full=True)
    out = dict(zip(first.names, first.pack(accel.matrix @ to_b.T, accel.bias), strict=True))
    out |= dict(zip(second.names, second.pack(gyro.matrix @ to_b.T, bias), strict=True))
    return out | {f"rig.mount.{a}": v for a, v in zip("xyz", mount.angles_of(to_b.T), strict=True)}


def _frame_of(matrix: Array) -> Array:
    """C_k^b of the accelerometers' own frame: S_k = L C_k^b with L lower triangular, its diagonal of S_k's signs."""
    q, r = np.linalg.qr(matrix.T)
    return np.asarray((q * np.sign(np.diag(r) * np.diag(matrix))).T)


def _first(
    sensor: str, means: SegmentMeans, plan: Plan, site: Site, angles: Array, rates: Array, remarks: list[str]
) -> _Sensor:
    """Unweighted linear solution, then the whitening that follows from it."""
    counts = sensor in means.counts
    inputs, used, matrix, bias = _linear(sensor, means, site, angles, rates)
    readings = means.mean[sensor]
    if sensor == "gyro":
        remarks += sanity.check_gyro_sense(matrix, counts, "the plan's rates")
    else:
        remarks += _accel_sense(matrix, counts)
    if not counts:
        sanity.check_scale(sensor, matrix)
    gain = float(np.mean(np.linalg.norm(matrix, axis=1))) if counts else 1.0
    noise = common.noise_of(means, plan, sensor, gain, float(np.abs(readings - bias).max()))
    remarks += noise.remarks
    covariance = _covariance(sensor, means, plan, site, angles, rates, matrix, noise.density)
    keep = np.repeat(used, 3)
    weight = np.zeros_like(covariance)
    weight[np.ix_(keep, keep)] = np.linalg.inv(np.linalg.cholesky(covariance[np.ix_(keep, keep)]))
    return _Sensor(sensor, counts, inputs, readings, weight, matrix, bias, noise.known)


def _accel_sense(matrix: Array, counts: bool) -> list[str]:
    axes, signs = signed_permutation(matrix)
    if axes != (0, 1, 2):
        answers = ", ".join(f"accel_{AXES[i]} answers to {AXES[axes[i]]}" for i in range(3) if axes[i] != i)
        raise DataError(
            f"the accelerometers do not answer to the plan's axes: {answers}. Columns are permuted (--map) or the plan's angles "
            "are in another order"
        )
    negative = [f"accel_{AXES[i]}" for i, s in enumerate(signs) if s < 0]
    if not negative:
        return []
    text = f"{', '.join(negative)}: reads minus the specific force (at rest an upward axis must read +g)"
    if not counts:
        raise DataError(f"{text}. Change the sign of the column, or the plan's angles")
    return [f"negative gain of {text}"]


def _covariance(
    sensor: str, means: SegmentMeans, plan: Plan, site: Site, angles: Array, rates: Array, matrix: Array, density: Array
) -> Array:
    """Covariance (3n, 3n) of all mean readings: noise, errors of the settings, errors of the axes, of the rate."""
    n = len(rates)
    total = np.diag(means.variance(sensor, density).ravel())
    which = 0 if sensor == "accel" else 1
    turned = rates * means.interval

    def readings(shift: Array) -> Array:
        return mean_inputs(angles + shift, rates, turned, means.count, site)[which] @ matrix.T

    if plan.rig.angle_uncertainty > 0:
        for i in range(3):
            shift = np.zeros(3)
            shift[i] = _STEP
            d = (readings(shift) - readings(-shift)) / (2 * _STEP) * plan.rig.angle_uncertainty
            for s in range(n):
                at = slice(3 * s, 3 * s + 3)
                total[at, at] += np.outer(d[s], d[s])
    if plan.rig.axis_uncertainty > 0:
        for d in _axis_effects(which, angles, rates, turned, means.count, site):
            column = (d @ matrix.T).ravel() * plan.rig.axis_uncertainty
            total += np.outer(column, column)
    if sensor == "gyro" and plan.rig.rate_uncertainty > 0:
        up = attitude(angles)[:, 2, :]
        column = ((rates * plan.rig.rate_uncertainty)[:, None] * up @ matrix.T).ravel()
        total += np.outer(column, column)
    if sensor == "accel" and plan.gravity_uncertainty > 0:
        column = (plan.gravity_uncertainty * attitude(angles)[:, 2, :] @ matrix.T).ravel()
        total += np.outer(column, column)
    return total


def _axis_effects(which: int, angles: Array, rates: Array, turned: Array, count: Array, site: Site) -> list[Array]:
    """Derivative of the mean inputs (n, 3) to each of the table's tilts, non-perpendicularities and zero errors."""
    up_rate = (rates + site.enu[2])[:, None]
    left = averaging(turned, count)[:, None]

    def inputs(errors: TableErrors) -> Array:
        to_enu = attitude(angles, errors)
        axis = attitude(angles, TableErrors((0.0, 0.0), errors.nonperpendicularity, errors.zero))[:, 2, :]
        if which == 0:
            return np.asarray(site.gravity * (axis + left * (to_enu[:, 2, :] - axis)))
        level = np.einsum("nji,j->ni", to_enu, site.enu) - site.enu[2] * axis
        return np.asarray(up_rate * axis + left * level)

    out = []
    for k in range(7):
        values = np.zeros(7)
        values[k] = _STEP
        forward = TableErrors(tuple(values[:2]), tuple(values[2:4]), tuple(values[4:]))
        backward = TableErrors(tuple(-values[:2]), tuple(-values[2:4]), tuple(-values[4:]))
        out.append((inputs(forward) - inputs(backward)) / (2 * _STEP))
    return out


class _Full:
    """S full in k for each sensor; linear."""

    def __init__(self, sensors: dict[str, _Sensor], gravity: float, rate: float) -> None:
        self.sensors = list(sensors.values())
        self.triads = [Triad(s.kind, s.counts, full=True) for s in self.sensors]
        self.sizes = {"accel": gravity, "gyro": rate}

    def parameters(self) -> list[Parameter]:
        out = []
        for s, t in zip(self.sensors, self.triads, strict=True):
            x, scales = t.pack(s.matrix, s.bias), t.scales(s.matrix, self.sizes[s.kind])
            out += [Parameter(n, u, float(v), c) for n, u, v, c in zip(t.names, t.units, x, scales, strict=True)]
        return out

    def rows(self, x: Array) -> Rows:
        out, at = _Stack(), 0
        for s, t in zip(self.sensors, self.triads, strict=True):
            k = len(t.names)
            matrix, bias, _ = t.unpack(x[at : at + k])
            d_matrix, d_bias, _ = t.derivatives(x[at : at + k])
            jac = np.zeros((s.readings.size, x.size))
            jac[:, at : at + k] = (np.einsum("kij,nj->nik", d_matrix, s.inputs) + d_bias.T).reshape(-1, k)
            out.add(s, s.inputs @ matrix.T + bias, jac)
            at += k
        return out.rows()


class _Triangular:
    """S_a lower triangular in b, mounting angles of b in k, S_g full in b."""

    def __init__(self, sensors: dict[str, _Sensor], gravity: float, rate: float) -> None:
        self.sensors = list(sensors.values())
        self.triads = [Triad(s.kind, s.counts, full=s.kind == "gyro") for s in self.sensors]
        self.sizes = {"accel": gravity, "gyro": rate}
        self.to_b = _frame_of(self.sensors[0].matrix)
        self.mount = mount.angles_of(self.to_b.T)

    def parameters(self) -> list[Parameter]:
        out = []
        for s, t in zip(self.sensors, self.triads, strict=True):
            matrix = s.matrix @ self.to_b.T
            x, scales = t.pack(matrix, s.bias), t.scales(matrix, self.sizes[s.kind])
            out += [Parameter(n, u, float(v), c) for n, u, v, c in zip(t.names, t.units, x, scales, strict=True)]
        return out + [
            Parameter(f"rig.mount.{a}", "rad", float(v), 0.01) for a, v in zip("xyz", self.mount, strict=True)
        ]

    def rows(self, x: Array) -> Rows:
        out, at = _Stack(), 0
        to_b, d_mount = mount.matrix(x[-3:]).T, mount.derivatives(x[-3:])
        for s, t in zip(self.sensors, self.triads, strict=True):
            k = len(t.names)
            matrix, bias, _ = t.unpack(x[at : at + k])
            d_matrix, d_bias, _ = t.derivatives(x[at : at + k])
            u = s.inputs @ to_b.T
            jac = np.zeros((s.readings.size, x.size))
            jac[:, at : at + k] = (np.einsum("kij,nj->nik", d_matrix, u) + d_bias.T).reshape(-1, k)
            jac[:, -3:] = np.einsum("ij,klj,nl->nik", matrix, d_mount, s.inputs).reshape(-1, 3)
            out.add(s, u @ matrix.T + bias, jac)
            at += k
        return out.rows()


class _Stack:
    """Whitened rows of several sensors, one under the other."""

    def __init__(self) -> None:
        self.parts: list[Rows] = []

    def add(self, s: _Sensor, predicted: Array, jac: Array) -> None:
        """Append the rows of a sensor that count."""
        used = np.any(s.weight != 0, axis=1)
        index = np.repeat(np.arange(len(s.readings)), 3)[used]
        self.parts.append(Rows(s.weight[used] @ (s.readings - predicted).ravel(), -s.weight[used] @ jac, index))

    def rows(self) -> Rows:
        """All of them."""
        residual, jacobian, segment = zip(*self.parts, strict=True)
        return Rows(np.concatenate(residual), np.vstack(jacobian), np.concatenate(segment))


def _report(
    fit: Estimate,
    means: SegmentMeans,
    plan: Plan,
    site: Site,
    recording: Recording | None,
    remarks: list[str],
) -> Calibration:
    order = list(range(len(fit.names)))
    residuals = {
        "all (in units of noise and table uncertainty)": Scatter(
            rms=float(np.sqrt(np.mean(fit.residual**2))), unit="", count=fit.residual.size
        )
    }
    return common.result(
        "multi-position",
        named(fit.names, [p.unit for p in fit.parameters], fit.value, fit.covariance),
        fit.covariance,
        common.fit_record([(fit, order)], residuals),
        plan=plan,
        gravity=site.gravity,
        recording=recording,
        span=means.span,
        remarks=remarks,
    )
