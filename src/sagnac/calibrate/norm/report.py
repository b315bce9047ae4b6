"""The result of a norm calibration: its record, the mounting angles by the way, the budget."""

from __future__ import annotations

import numpy as np

from ...calibration import BudgetLine, Calibration, Scatter, named
from ...errors import DataError
from ...estimate import Estimate
from ...frames import Array
from ...recording import Recording
from .. import budget, common, mount
from .model import NormModel
from .solution import Solution

_ASTRAY = 3.0


def report(solution: Solution, recording: Recording | None) -> Calibration:
    """The result record of a solution."""
    fit, model, case, _ = solution
    order = [i for i, p in enumerate(fit.parameters) if not p.nuisance]
    names = [fit.names[i] for i in order]
    units = [fit.parameters[i].unit for i in order]
    value, covariance = fit.value[order], fit.covariance[np.ix_(order, order)]
    parts: list[tuple[Estimate, list[int]]] = [(fit, order)]
    found = _mounting(solution)
    sources = budget.lines(solution.budget(), fit, order, behind=0 if found is None else len(found.fit.names))
    if found is not None:
        k, m = found.cross.shape[1], len(order)
        names += list(found.fit.names)
        units += [p.unit for p in found.fit.parameters]
        value = np.concatenate([value, found.fit.value])
        covariance = block_diagonal(covariance, found.fit.covariance)
        covariance[m:, :k], covariance[:k, m:] = found.cross, found.cross.T
        parts.append((found.fit, list(range(len(found.fit.names)))))
        sigma = np.append(np.zeros(m), found.fit.sigma)
        mounted = BudgetLine(source=budget.SETTINGS, standard_uncertainty=tuple(float(v) for v in sigma))
        sources = budget.joined(sources, [mounted])
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
        budget=sources,
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
    fit, model, case, _ = solution
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
