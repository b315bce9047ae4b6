"""Multi-position calibration: inputs known from the table's settings, linear weighted least squares.

The traditional method, the peer of norm calibration and the choice for a good table::

    N_s = S u_s + b,   u_s from the settings of segment s, latitude, gravity and the outer rate

Rows are weighed with the noise of the means and with what the table's stated uncertainty does to the input: each setting's
error is independent, the axes' own errors (tilt, non-perpendicularity, zero) are common to all segments.

``full`` gives S in the table's case frame k. ``triangular`` gives S_a lower triangular in the accelerometers' own frame b with
the three mounting angles of b in k, and S_g full in b: the same nine numbers per triad, told apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calibration import Calibration, Scatter, named
from ..errors import DataError
from ..estimate import Effects, Estimate, Parameter, Rows, estimate
from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..recording import Recording
from ..rigs.turntable import Site, mean_inputs
from ..sensors import Triad
from . import budget, common, explain, mount, sanity, table_noise


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
    remarks = [*means.remarks, *(common.gravity_remarks(plan) if "accel" in means.mean else [])]
    sensors = [s for s in ("accel", "gyro") if s in means.mean]
    rates = common.rates_of(means)
    if "gyro" in sensors and not rates.any():
        remarks.append("no turning segments: the gyros were not calibrated")
        sensors.remove("gyro")
    if not sensors:
        raise DataError("multi-position of gyros needs segments that turn (outer_rate); the plan has none")
    explain.refuse_missing_turns(means, rates)
    first = [
        _displaced(f, means, plan, site, angles) for f in first_solutions(sensors, means, plan, site, angles, remarks)
    ]
    noise, shared = _errors(first, means)
    weight = _whitening(noise, shared)
    model = _Triangular if matrix == "triangular" and "accel" in sensors else _Full
    problem = model(first, weight, site.gravity, float(np.abs(rates).max()))
    known = all(f.known for f in first)
    fit = estimate(problem.parameters(), problem.rows, means.names, noise_known=known, robust=robust)
    remarks += common.misfit_remarks(fit, known and not robust)
    sources = budget.of_fit(fit, problem.rows, [_effects(weight, noise, shared)])
    return _report(fit, sources, means, plan, site, recording, remarks)


@dataclass(frozen=True)
class FirstSolution:
    """One triad: inputs in k, readings, which segments count, first S and b in k, noise."""

    kind: str
    counts: bool
    inputs: Array
    readings: Array
    used: NDArray[np.bool_]
    matrix: Array
    bias: Array
    density: Array
    known: bool
    effects: Array = field(default_factory=lambda: np.zeros((0, 3, 0)))
    """One-sigma effects of the table's errors on the inputs, (n, 3, columns shared by the sensors)."""


class _Linear(NamedTuple):
    """Unweighted solution of one triad: inputs in k (n, 3), which segments count, S and b in k."""

    inputs: Array
    used: NDArray[np.bool_]
    matrix: Array
    bias: Array


def _linear(
    sensor: str, means: SegmentMeans, plan: Plan, site: Site, angles: Array, *, turning: bool = False
) -> _Linear:
    rates = common.rates_of(means)
    left = common.left_of(means, rates)
    felt = mean_inputs(angles, rates, left, site, letters=plan.rig.letters, derivatives=False)
    inputs, rates = felt.force if sensor == "accel" else felt.rate, rates.sum(axis=1)
    # a lever arm would show in the accelerometers of turning segments
    used = np.asarray(rates == 0) if sensor == "accel" else np.ones(len(rates), dtype=np.bool_)
    if turning and not _enough(inputs[used]):
        used = np.ones_like(used)
    if not used.any():
        raise DataError("multi-position needs static segments for the accelerometers; all segments turn")
    if not _enough(inputs[used]):
        raise DataError(
            f"the {used.sum()} segments do not excite all three {sensor} axes in both senses: scale, misalignment and bias "
            "cannot be told apart. Add positions"
        )
    size = float(np.abs(inputs).max())
    design = np.column_stack([inputs[used] / size, np.ones(used.sum())])
    solution = np.linalg.lstsq(design, means.mean[sensor][used], rcond=None)[0]
    return _Linear(inputs, used, solution[:3].T / size, solution[3])


def _enough(inputs: Array) -> bool:
    """Whether inputs (n, 3) determine three gains and a bias of an axis."""
    if len(inputs) == 0:
        return False
    design = np.column_stack([inputs / np.abs(inputs).max(), np.ones(len(inputs))])
    return bool(np.linalg.matrix_rank(design, tol=1e-6 * np.linalg.norm(design)) == 4)


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
    accel, gyro = (_linear(s, means, plan, site, angles) for s in ("accel", "gyro"))
    static = common.rates_of(means).sum(axis=1) == 0
    bias = gyro.bias
    if static.any():  # angle errors times the table's rate would drown the bias in turning segments
        bias = (means.mean["gyro"] - gyro.inputs @ gyro.matrix.T)[static].mean(axis=0)
    to_b = frame_of(accel.matrix)
    first, second = Triad("accel"), Triad("gyro", full=True)
    out = dict(zip(first.names, first.pack(accel.matrix @ to_b.T, accel.bias), strict=True))
    out |= dict(zip(second.names, second.pack(gyro.matrix @ to_b.T, bias), strict=True))
    return out | {f"rig.mount.{a}": v for a, v in zip("xyz", mount.angles_of(to_b.T), strict=True)}


def frame_of(matrix: Array) -> Array:
    """C_k^b of the accelerometers' own frame: S_k = L C_k^b with L lower triangular, its diagonal of S_k's signs."""
    q, r = np.linalg.qr(matrix.T)
    return np.asarray((q * np.sign(np.diag(r) * np.diag(matrix))).T)


def first_solutions(
    sensors: Sequence[str],
    means: SegmentMeans,
    plan: Plan,
    site: Site,
    angles: Array,
    remarks: list[str],
    *,
    turning: bool = False,
) -> list[FirstSolution]:
    """Unweighted linear solutions, looked at for signs, columns and units, and the noise to weigh with.

    With `turning`, accelerometers that lack static segments are solved from those that turn as well, as a first value.

    Raises
    ------
    DataError
        When the positions do not excite all axes, or signs, columns, units or the plan's angles are wrong.
    """
    return [_first(s, means, plan, site, angles, remarks, turning) for s in sensors]


def _first(
    sensor: str,
    means: SegmentMeans,
    plan: Plan,
    site: Site,
    angles: Array,
    remarks: list[str],
    turning: bool,
) -> FirstSolution:
    explain.refuse_other_reading(sensor, means, plan, site)
    counts = sensor in means.counts
    inputs, used, matrix, bias = _linear(sensor, means, plan, site, angles, turning=turning)
    readings = means.mean[sensor]
    if sensor == "gyro":
        remarks += sanity.check_gyro_sense(matrix, counts, "the plan's rates")
    else:
        remarks += sanity.check_accel_sense(matrix, counts)
    remarks += sanity.scale_remarks(sensor, matrix, counts)
    gain = float(np.mean(np.linalg.norm(matrix, axis=1))) if counts else 1.0
    noise = common.noise_of(means, plan, sensor, gain, float(np.abs(readings - bias).max()))
    remarks += noise.remarks
    return FirstSolution(sensor, counts, inputs, readings, used, matrix, bias, noise.density, noise.known)


def _displaced(first: FirstSolution, means: SegmentMeans, plan: Plan, site: Site, angles: Array) -> FirstSolution:
    """The same with what the table's uncertainty does to the inputs."""
    displacement, effects = table_noise.effects(first.kind, means, plan, site, angles)
    return replace(first, inputs=first.inputs + displacement, effects=effects)


def _errors(sensors: Sequence[FirstSolution], means: SegmentMeans) -> tuple[Array, Array]:
    """Noise of all rows that count, all sensors together, (r,), and what the table's errors of one sigma do to them, (r, c)."""
    white, columns = [], []
    for s in sensors:
        keep = np.repeat(s.used, 3)
        white.append(means.variance(s.kind, s.density).ravel()[keep])
        columns.append((s.matrix @ s.effects).reshape(keep.size, -1)[keep])
    return np.sqrt(np.concatenate(white)), np.vstack(columns)


def _whitening(noise: Array, shared: Array) -> Array:
    """Inverse square root of the covariance of all rows."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(np.diag(noise**2) + shared @ shared.T)))


def _effects(weight: Array, noise: Array, shared: Array) -> Effects:
    """How noise and the table's errors move the whitened rows."""
    matrix = weight @ np.hstack([np.diag(noise), shared])
    settings = shared.shape[1] - len(table_noise.AXES_AND_SITE)
    sources = [*[budget.NOISE] * noise.size, *[budget.SETTINGS] * settings, *table_noise.AXES_AND_SITE]
    return Effects(np.arange(noise.size)[None], matrix[None], sources)


class _Full:
    """S full in k for each sensor; linear."""

    def __init__(self, sensors: Sequence[FirstSolution], weight: Array, gravity: float, rate: float) -> None:
        self.sensors, self.weight = sensors, weight
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
        return out.rows(self.weight)


class _Triangular:
    """S_a lower triangular in b, mounting angles of b in k, S_g full in b."""

    def __init__(self, sensors: Sequence[FirstSolution], weight: Array, gravity: float, rate: float) -> None:
        self.sensors, self.weight = sensors, weight
        self.triads = [Triad(s.kind, s.counts, full=s.kind == "gyro") for s in self.sensors]
        self.sizes = {"accel": gravity, "gyro": rate}
        self.to_b = frame_of(self.sensors[0].matrix)
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
        return out.rows(self.weight)


class _Stack:
    """Rows of several sensors that count, one under the other, whitened together."""

    def __init__(self) -> None:
        self.parts: list[Rows] = []

    def add(self, s: FirstSolution, predicted: Array, jac: Array) -> None:
        """Append residual and derivative of a sensor's readings."""
        keep = np.repeat(s.used, 3)
        index = np.repeat(np.arange(len(s.readings)), 3)[keep]
        self.parts.append(Rows((s.readings - predicted).ravel()[keep], -jac[keep], index))

    def rows(self, weight: Array) -> Rows:
        """All of them."""
        return Rows(
            weight @ np.concatenate([p.residual for p in self.parts]),
            weight @ np.vstack([p.jacobian for p in self.parts]),
            np.concatenate([p.segment for p in self.parts]),
        )


def _report(
    fit: Estimate,
    sources: dict[str, Array],
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
        means=means,
        budget=budget.lines(sources, fit, order),
        remarks=remarks,
    )
