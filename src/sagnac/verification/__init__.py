"""Check a calibration on a recording that its fit has not seen.

Static segments must show the norm of gravity, turning ones the norm of rate and Earth rate, attitudes found in a
hand-turned log besides must be joined by the integrated rate. Each misfit is compared with what the calibration's
covariance, the noise of the new means and (where its own fit scattered by more than noise) that scatter allow; all of them
together pass or fail by one chi-square.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calibrate import common, four_position, hand_turned
from ..calibrate.hand_gyros import rotation_misfit
from ..calibration import Calibration, printed
from ..compensation import corrections
from ..errors import DataError
from ..files import sha256
from ..frames import Array, tangents, unit
from ..observe.means import SegmentMeans, segment_means
from ..observe.static import THRESHOLD, static_intervals
from ..plan import Plan
from ..recording import Recording
from ..rigs.turntable import Site, averaging, mean_inputs
from ..sensors import Correction, correction, invert, triad_of

PASS = 0.01
"""Probability below which the misfits are more than the stated uncertainty allows."""
_QUANTITY = {"accel": ("static norm", "m/s^2"), "gyro": ("rate norm", "rad/s"), "axis": ("rate axis", "rad")}
_LEVER = 0.5  # m, one sigma where the calibration does not know the lever arm


@dataclass(frozen=True)
class Check:
    """One comparison with what is known: residual and its standard uncertainty, SI."""

    segment: str
    what: str
    residual: float
    standard_uncertainty: float
    unit: str

    @property
    def z(self) -> float:
        """Residual in standard uncertainties."""
        return self.residual / self.standard_uncertainty if self.standard_uncertainty > 0 else math.inf


@dataclass(frozen=True)
class Verification:
    """Outcome of :func:`verify`.

    Attributes
    ----------
    checks : tuple of Check
    chi2, p_value : float
    degrees_of_freedom : int
    passed : bool
    rotation_rms : float or None
        Closure of the rotations of a hand-turned log, rad.
    remarks : tuple of str
    """

    checks: tuple[Check, ...]
    chi2: float
    degrees_of_freedom: int
    p_value: float
    passed: bool
    rotation_rms: float | None = None
    remarks: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain table for JSON."""
        return asdict(self)

    def summary(self) -> str:
        """The outcome as a page of text."""
        lines = [f"  {'segment':<12}{'quantity':<14} {'residual':>12}  {'std. unc.':>10}  {'unit':<8}{'ratio':>6}"]
        for c in self.checks:
            value, sigma, unit = printed(c.residual, c.standard_uncertainty, c.unit)
            lines.append(f"  {c.segment:<12}{c.what:<14} {value:>12}  {sigma:>10}  {unit:<8}{c.z:>6.1f}")
        for kind in dict.fromkeys(c.what for c in self.checks):
            here = [c for c in self.checks if c.what == kind]
            if len(here) == 1:
                continue
            rms = math.sqrt(sum(c.residual**2 for c in here) / len(here))
            text, _, unit = printed(rms, rms / 30, here[0].unit)
            lines.append(f"  {kind}: {text} {unit} rms over {len(here)}")
        if self.rotation_rms is not None:
            lines.append(f"  rotation closure: {math.degrees(self.rotation_rms):.3g} deg rms")
        verdict = "PASS" if self.passed else "FAIL"
        if self.rotation_rms is not None and not self.passed and self.p_value >= PASS:
            lines.append("  the norms agree; the rotations do not close as well as those of the fit did")
        lines.append(
            f"  {verdict}: chi-square {self.chi2:.4g} for {self.degrees_of_freedom}, probability {self.p_value:.2g} "
            f"(limit {PASS:g})"
        )
        return "\n".join([*lines, *(f"  note: {r}" for r in self.remarks)]) + "\n"


def verify(
    calibration: Calibration, recording: Recording, plan: Plan | None = None, *, threshold: float = THRESHOLD
) -> Verification:
    """Compare a recording, compensated, with what is known of its inputs.

    Parameters
    ----------
    calibration : Calibration
    recording : Recording
        In the same units as the calibration's own.
    plan : Plan, optional
        Its segments; without segments (or plan) the static intervals are found as for a hand-turned unit.
    threshold : float
        See :func:`sagnac.observe.static.static_intervals`.

    Returns
    -------
    Verification

    Raises
    ------
    DataError
        When there is nothing to compare.
    InputError
        When units do not match.
    """
    found = _verified(calibration, recording, plan, threshold)
    notes = (*_same_source(calibration, recording), *_other_unit(calibration, plan))
    return replace(found, remarks=(*found.remarks, *notes)) if notes else found


def _verified(calibration: Calibration, recording: Recording, plan: Plan | None, threshold: float) -> Verification:
    if calibration.method == "roll-isolated":
        from . import roll_isolated

        return roll_isolated.verify(calibration, recording, plan)
    if plan is not None and plan.rig.kind == "centrifuge":
        from . import centrifuge

        return centrifuge.verify(calibration, recording, plan)
    models = corrections(calibration, recording)
    site = plan or Plan(latitude=calibration.site.latitude, gravity=calibration.site.gravity)
    if site.segment:
        means = segment_means(recording, site)
        if all(triad_of(calibration.values(), kind) is None for kind in models):
            if any(m.terms for m in models.values()):
                raise DataError(
                    f"this calibration by {calibration.method} holds terms but no whole triad with scale and misalignment: "
                    "it can only be verified on the rig that it is from"
                )
            return _biases(calibration, means, site)
        return _judge(calibration, means, site, models, None)
    batch = recording.read()
    found = static_intervals(batch, threshold)
    if "accel" not in models or len(found.start) == 0:
        raise DataError(
            "without a plan's segments there must be static intervals of a calibrated accelerometer triad; none found"
        )
    means, site = hand_turned.means_of(batch, found, site, recording.counts, recording.name)
    closure = None
    if "gyro" in models and len(found.start) > 1:
        closure = rotation_misfit(batch, found, means, models["accel"], models["gyro"])
    return _judge(calibration, means, site, models, closure)


def _biases(calibration: Calibration, means: SegmentMeans, plan: Plan) -> Verification:
    """Biases alone say nothing about norms: compare them with those that the new recording gives by the same method."""
    from scipy.special import chdtrc

    fresh = four_position.calibrate_means(means, plan)
    names = [n for n in calibration.values() if n in fresh.values()]
    old, new = ([list(c.values()).index(n) for n in names] for c in (calibration, fresh))
    difference = np.array([fresh[n].value - calibration[n].value for n in names])
    covariance = calibration.matrix[np.ix_(old, old)] + fresh.matrix[np.ix_(new, new)]
    chi2 = float(difference @ np.linalg.solve(covariance, difference))
    p_value = float(chdtrc(len(names), chi2))
    checks = tuple(
        Check("all", name, float(d), float(s), calibration[name].unit)
        for name, d, s in zip(names, difference, np.sqrt(np.diag(covariance)), strict=True)
    )
    return Verification(checks, chi2, len(names), p_value, p_value >= PASS, None, fresh.remarks)


@dataclass(frozen=True)
class _Norms:
    """Norm misfits of one triad: residual (n,), derivative to all parameters (n, k), variance of noise (n,)."""

    kind: str
    names: Sequence[str]
    residual: Array
    jacobian: Array
    variance: Array
    common: Array
    """One-sigma effect of what all segments share: the rate's error, gravity's."""


def _judge(
    calibration: Calibration, means: SegmentMeans, plan: Plan, models: dict[str, Correction], closure: Array | None
) -> Verification:
    from scipy.linalg import block_diag
    from scipy.special import chdtrc

    names = calibration.values()
    whole = [k for k in ("accel", "gyro") if k in models and triad_of(names, k) is not None]
    parts = [_norms(k, calibration, means, plan, models) for k in whole]
    parts.append(_axes(calibration, means, plan, models))
    parts = [p for p in parts if p.residual.size]
    if not parts:
        raise DataError("nothing to compare: static segments need accelerometers, turning ones gyros")
    r = np.concatenate([p.residual for p in parts])
    jac = np.vstack([p.jacobian for p in parts])
    covariance = np.diag(np.concatenate([p.variance for p in parts])) + jac @ calibration.matrix @ jac.T
    shared = block_diag(*(p.common[:, None] for p in parts))
    covariance += shared @ shared.T
    covariance += 1e-24 * np.eye(r.size) * float(np.trace(covariance)) / r.size
    white = np.linalg.solve(np.linalg.cholesky(covariance), r)
    chi2 = float(white @ white)
    checks = tuple(
        Check(name, _QUANTITY[p.kind][0], float(v), float(s), _QUANTITY[p.kind][1])
        for p, sigma in zip(
            parts, np.split(np.sqrt(np.diag(covariance)), np.cumsum([p.residual.size for p in parts])[:-1]), strict=True
        )
        for name, v, s in zip(p.names, p.residual, sigma, strict=True)
    )
    p_value = float(chdtrc(r.size, chi2))
    rms = None if closure is None else float(np.sqrt(np.mean(closure**2)))
    closed, remarks = _closure(calibration, closure, [*means.remarks, *_left_out(whole, models)])
    return Verification(checks, chi2, r.size, p_value, p_value >= PASS and closed, rms, tuple(remarks))


def _left_out(whole: Sequence[str], models: Collection[str]) -> list[str]:
    """A word on sensors of which the calibration holds too little to judge them here."""
    return [
        f"the {kind} triad was not judged: the calibration lacks its scale or misalignments"
        for kind in sorted(set(models) - set(whole))
    ]


def _same_source(calibration: Calibration, recording: Recording) -> list[str]:
    """A word where the recording is one that the fit has seen."""
    known = {s.sha256 for s in calibration.source if s.sha256}
    if recording.path is None or not known or sha256(recording.path) not in known:
        return []
    return ["this is the recording that the calibration was made from: that it fits says nothing about another one"]


def _other_unit(calibration: Calibration, plan: Plan | None) -> list[str]:
    """A word where the serial numbers of calibration and plan differ."""
    theirs = plan.unit.serial if plan is not None else ""
    if not theirs or not calibration.unit.serial or theirs == calibration.unit.serial:
        return []
    return [f"the calibration is of unit {calibration.unit.serial!r}, the plan names {theirs!r}"]


def _closure(calibration: Calibration, closure: Array | None, remarks: list[str]) -> tuple[bool, list[str]]:
    """Whether the rotations close as well as those of the fit did (F test at the same level)."""
    expected = calibration.fit.residuals.get("rotation")
    if closure is None or expected is None:
        return True, remarks
    from scipy.special import fdtrc

    # the fit's own residuals are too small and fresh ones too large by what nine fitted parameters took from them
    rows, fitted = 2 * expected.count, 9
    left = max(rows - fitted, 1)
    allowed = math.radians(expected.rms) ** 2 * rows / left * (1.0 + fitted / rows)
    p_value = float(fdtrc(2 * closure.size, left, float(np.mean(closure**2)) / allowed))
    remarks.append(
        f"rotations close to {math.degrees(math.sqrt(np.mean(closure**2))):.3g} deg rms, in the fit {expected.rms:.3g} deg "
        f"(probability {p_value:.2g})"
    )
    return p_value >= PASS, remarks


def _norms(
    kind: str, calibration: Calibration, means: SegmentMeans, plan: Plan, models: dict[str, Correction]
) -> _Norms:
    rates = common.rates_of(means).sum(axis=1)
    at = np.flatnonzero(rates == 0 if kind == "accel" else rates != 0)
    names = [means.names[i] for i in at]
    if at.size == 0:
        return _Norms(kind, names, np.zeros(0), np.zeros((0, len(calibration.parameters))), np.zeros(0), np.zeros(0))
    model = models[kind]
    readings = means.mean[kind][at]
    force = None
    if kind == "gyro" and "accel" in models:
        force = invert(models["accel"], means.mean["accel"][at])
    u = invert(model, readings, force)
    size = np.linalg.norm(u, axis=1)
    known = np.full(at.size, plan.site_gravity) if kind == "accel" else _known_rates(means, plan)[at]
    along = (u / size[:, None]) @ np.linalg.inv(model.matrix)  # d|u| / dN
    variance = np.einsum("ni,ni->n", along**2, _variance(kind, means, plan, model)[at])
    scatter = calibration.fit.residuals.get("static norm" if kind == "accel" else "rate norm")
    if scatter is not None and "white" not in calibration.fit.uncertainty.split(" / ")[0]:
        variance = variance + scatter.rms**2
    common_error = (
        np.abs(rates[at]) * plan.rig.rate_uncertainty if kind == "gyro" else np.full(at.size, plan.gravity_uncertainty)
    )
    return _Norms(kind, names, size - known, _jacobian(kind, calibration, u, along, force), variance, common_error)


def _known_rates(means: SegmentMeans, plan: Plan) -> Array:
    """Size of the mean rate in each segment; it hardly depends on the settings, and not at all about a vertical axis."""
    rates, latitude = common.rates_of(means), plan.need_latitude("the rate norm")
    left = common.left_of(means, rates)
    if all(s.angles is not None for s in means.segments):
        site = Site(latitude, plan.site_gravity, plan.earth_rate)
        angles = common.need_angles(means, "verify")
        felt = mean_inputs(angles, rates, left, site, letters=plan.rig.letters, derivatives=False)
        return np.asarray(np.linalg.norm(felt.rate, axis=1), dtype=np.float64)
    outer = common.outer_rates(means, plan, "verify without the table's angles")
    return np.hypot(outer + plan.earth_rate * math.sin(latitude), left * plan.earth_rate * math.cos(latitude))


def _variance(kind: str, means: SegmentMeans, plan: Plan, model: Correction) -> Array:
    """Variance of the new means from their noise, (n, 3), in the unit of the readings."""
    gain = float(np.mean(np.linalg.norm(model.matrix, axis=1))) if model.counts else 1.0
    noise = common.noise_of(means, plan, kind, gain, float(np.abs(means.mean[kind]).max()))
    return means.variance(kind, noise.density if noise.known else np.zeros(3))


def _axes(calibration: Calibration, means: SegmentMeans, plan: Plan, models: dict[str, Correction]) -> _Norms:
    """About the vertical both triads must see one axis turn: angle between them, two components a segment.

    Both come out of a function of the parameters, whose derivative is taken by central differences.
    """
    rates = common.rates_of(means)[:, 0] * (plan.rig.letters[0] == "z")
    at = np.flatnonzero(rates)
    k = len(calibration.parameters)
    names = list(calibration.values())
    triads = {s: triad_of(names, s, ratio=calibration.misalignment == "input-axis") for s in ("accel", "gyro")}
    both = (
        set(models) == {"accel", "gyro"} and all(triads.values()) and triads["gyro"] is not None and triads["gyro"].full
    )
    if not both or at.size == 0 or any(m.terms for m in models.values()):
        return _Norms("axis", [], np.zeros(0), np.zeros((0, k)), np.zeros(0), np.zeros(0))
    values = np.array([p.value for p in calibration.parameters])
    basis = np.swapaxes(tangents(_seen(calibration, means, at, rates[at], values)[0]), -1, -2)

    def apart(x: Array) -> Array:
        a, w = _seen(calibration, means, at, rates[at], x)
        out = (basis @ (w - a)[..., None])[..., 0]
        out[:, 0] += np.where(np.einsum("ni,ni->n", a, w) < 0, np.pi, 0.0)  # turned right round
        return np.asarray(out.ravel())

    jacobian = np.zeros((2 * at.size, k))
    for i in np.flatnonzero([n.startswith(("accel.", "gyro.", "rig.lever")) for n in names]):
        step = np.where(np.arange(k) == i, 1e-6 * max(abs(values[i]), 1.0), 0.0)
        jacobian[:, i] = (apart(values + step) - apart(values - step)) / (2 * step[i])
    variance = np.zeros(at.size)
    for sensor, size in (("accel", np.full(at.size, plan.site_gravity)), ("gyro", np.abs(rates[at]))):
        model = models[sensor]
        gain = float(np.mean(np.linalg.norm(model.matrix, axis=1)))
        variance += _variance(sensor, means, plan, model)[at].mean(axis=1) / (gain * size) ** 2
    left = np.abs(averaging(rates[at] * means.interval[at], means.count[at]))
    latitude = plan.need_latitude("the rate's axis")
    variance += (left * plan.earth_rate * math.cos(latitude) / rates[at]) ** 2 / 2 + (
        left * plan.rig.axis_uncertainty
    ) ** 2
    if "rig.lever_arm.x" not in names:
        variance += (rates[at] ** 2 * _LEVER / plan.site_gravity) ** 2
    named = [means.names[i] for i in np.repeat(at, 2)]
    return _Norms("axis", named, apart(values), jacobian, np.repeat(variance, 2), np.zeros(2 * at.size))


def _seen(
    calibration: Calibration, means: SegmentMeans, at: NDArray[np.intp], rates: Array, x: Array
) -> tuple[Array, Array]:
    """Direction of the outer axis from the accelerometers and from the gyros, (n, 3) each, for parameter values x."""
    values = dict(zip(calibration.values(), x, strict=True))
    ratio = calibration.misalignment == "input-axis"
    accel, gyro = (correction(values, sensor, ratio=ratio) for sensor in ("accel", "gyro"))
    assert accel is not None and gyro is not None  # noqa: PT018 - the caller has looked
    force = invert(accel, means.mean["accel"][at])
    lever = np.array([values.get(f"rig.lever_arm.{axis}", 0.0) for axis in "xyz"])
    up = unit(force)
    force = force - (rates**2)[:, None] * (up * (up @ lever)[:, None] - lever)
    return unit(force), unit(invert(gyro, means.mean["gyro"][at], force)) * np.sign(rates)[:, None]


def _jacobian(kind: str, calibration: Calibration, u: Array, along: Array, force: Array | None) -> Array:
    """Derivative of the norm to every parameter of the calibration: -d|u|/dN (dS u + db + dG f)."""
    names = list(calibration.values())
    out = np.zeros((len(u), len(names)))
    triad = triad_of(names, kind, ratio=calibration.misalignment == "input-axis")
    if triad is None:
        raise DataError(f"the calibration lacks parts of the {kind} triad: its norm cannot be judged")
    x = np.array([calibration[n].value for n in triad.names])
    d_matrix, d_bias, d_g = triad.derivatives(x)
    change = np.einsum("kij,nj->nik", d_matrix, u) + d_bias.T
    if force is not None:
        change = change + np.einsum("kij,nj->nik", d_g, force)
    out[:, [names.index(n) for n in triad.names]] = -np.einsum("ni,nik->nk", along, change)
    return out
