"""The result of a fit on a centrifuge: record, uncertainty by source, and what deserves a word."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...calibration import BudgetLine, Calibration, Scatter, named
from ...estimate import Effects, contributions, eliminate
from ...frames import Array
from ...plan import Plan
from ...recording import Recording
from .. import budget, common
from .model import with_setting_prior
from .task import Fitted, Task

_FAR = 4.0
"""Standard deviations from which what was known beforehand and the data contradict each other."""
_FOURTH = 5.0
"""Standard deviations from which a fourth harmonic is more than noise."""
SOURCES = {
    "rig.radius": "arm radius",
    "rig.tilt.x": "tilt of the arm's axis",
    "rig.tilt.y": "tilt of the arm's axis",
    "rig.gravity": "gravity",
    "rig.rate_error": "arm rate",
    "rig.phase_error": "arm phase",
}
"""Lines of the budget, by the unknown of the rig that they come from."""


def report(
    fitted: Fitted, plan: Plan, recording: Recording | None, span: tuple[float, float], remarks: Sequence[str]
) -> Calibration:
    """The result record.

    Parameters
    ----------
    fitted : Fitted
    plan : Plan
    recording : Recording, optional
    span : tuple of float, s
    remarks : sequence of str
        Those made before.

    Returns
    -------
    Calibration
    """
    found = fitted.estimate
    order = [i for i, p in enumerate(found.parameters) if not p.nuisance]
    value = found.value.copy()
    for i in order:
        if found.names[i].startswith("rig.arm_phase"):
            value[i] = float(np.angle(np.exp(1j * value[i])))
    covariance = found.covariance[np.ix_(order, order)]
    own = [found.parameters[i] for i in order]
    whole, residuals = _leftover(fitted)
    budget = _budget(fitted, order)
    result = common.result(
        "centrifuge",
        named([p.name for p in own], [p.unit for p in own], value[order], covariance),
        covariance,
        common.fit_record([(found, order)], residuals),
        plan=plan,
        gravity=fitted.task.site.gravity,
        recording=recording,
        span=span,
        budget=budget,
        remarks=[
            *remarks,
            *common.misfit_remarks(found, fitted.task.noise_known),
            *_pulled(fitted),
            *_contradicted(fitted),
            *_fourth(fitted.task, whole),
            *_gyros_alone(fitted.task),
        ],
    )
    return result.model_copy(update={"misalignment": "input-axis"})


def _leftover(fitted: Fitted) -> tuple[dict[int, Array], dict[str, Scatter]]:
    """Residuals of the segments used as a whole, by segment, in their unit (m, c), and the scatter of each sensor."""
    model, x = fitted.model, fitted.estimate.value
    whole: dict[int, Array] = {}
    squares = np.zeros(len(model.sensors))
    count = np.zeros(len(model.sensors), dtype=int)
    for group in model.groups:
        local = model.locals(group, x) if model.setting_sigma > 0 else np.zeros((len(group.index), 3))
        left = group.coefficient - model.predicted(group, x, local).value
        white = (group.weight @ left[..., None])[..., 0]
        squares += np.sum(white**2, axis=(0, 2))
        count += white.shape[0] * white.shape[2]
        if group.order:
            whole |= dict(zip(group.index.tolist(), left, strict=True))
    scatter = {
        f"{s.sensor.replace('.', '_')} harmonics (in units of their noise)": Scatter(
            rms=float(np.sqrt(q / n)), unit="", count=int(n)
        )
        for s, q, n in zip(model.sensors, squares, count, strict=True)
    }
    return whole, scatter


def _budget(fitted: Fitted, order: Sequence[int]) -> tuple[BudgetLine, ...]:
    """Standard uncertainties of the parameters by what they come from."""
    found = fitted.estimate
    named = contributions(found, fitted.model.rows, _effects(fitted), lambda name: SOURCES.get(name, budget.HELD))
    return budget.lines(named, found, order)


def _effects(fitted: Fitted) -> Iterator[Effects]:
    """How noise, gimbal settings and a prior calibration move the rows."""
    model, found = fitted.model, fitted.estimate
    for group in model.groups:
        local = model.locals(group, found.value) if model.setting_sigma > 0 else np.zeros((len(group.index), 3))
        r, jac, d = model.whitened(group, found.value, local)
        rows = _rows_of(found.segment, group.index).reshape(len(group.index), -1)
        width = jac.shape[1]
        matrix = np.broadcast_to(np.eye(width), (len(r), width, width))
        sources = [budget.NOISE] * width
        if model.setting_sigma > 0:
            r, d = with_setting_prior(r, d, local, model.setting_sigma)
            _, matrix = eliminate(r, np.broadcast_to(np.eye(width + 3), (len(r), width + 3, width + 3)), d)
            sources += ["gimbal settings"] * 3
        yield Effects(rows, matrix, sources)
    if model.prior is not None:
        rows = _rows_of(found.segment, np.array([len(model.settings)]))
        yield Effects(rows[None], np.eye(rows.size)[None], ["prior calibration"] * rows.size)


def _rows_of(segment: NDArray[np.intp], index: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows of some segments, segment by segment."""
    return np.concatenate([np.flatnonzero(segment == i) for i in index])


def _pulled(fitted: Fitted) -> list[str]:
    """What the plan states with an uncertainty and the data put elsewhere."""
    found, out = fitted.estimate, []
    for p, value, sigma in zip(found.parameters, found.value, found.white, strict=True):
        room = p.prior_sigma**2 - sigma**2
        if not np.isfinite(p.prior_sigma) or room <= 1e-6 * p.prior_sigma**2:
            continue
        times = abs(value - p.prior) / np.sqrt(room)
        if times > _FAR:
            out.append(
                f"{p.name}: the data say {value:.9g} +- {sigma:.2g} {p.unit}, the plan {p.prior:.9g} +- {p.prior_sigma:.2g}: "
                f"{times:.1f} standard deviations apart"
            )
    return out


def _contradicted(fitted: Fitted) -> list[str]:
    """Parameters that the prior calibration and the data put apart."""
    prior, found = fitted.task.prior, fitted.estimate
    if prior is None:
        return []
    out = []
    for i, name in enumerate(prior.names):
        at = found.names.index(name)
        before = np.sqrt(prior.covariance[i, i])
        room = before**2 - found.white[at] ** 2
        if room <= 1e-6 * before**2:
            continue
        times = abs(found.value[at] - prior.mean[i]) / np.sqrt(room)
        if times > _FAR:
            unit = found.parameters[at].unit
            out.append(
                f"{name}: the prior calibration says {prior.mean[i]:.6g} +- {before:.2g}, the data move it to "
                f"{found.value[at]:.6g} +- {found.white[at]:.2g} {unit}: {times:.1f} standard deviations apart"
            )
    return out


def _fourth(task: Task, whole: dict[int, Array]) -> list[str]:
    """Fourth harmonics, of which the model has none."""
    if task.order < 4 or not task.noise_known:
        return []
    out = []
    for i, left in whole.items():
        for j, sensor in enumerate(task.sensors):
            variance = task.covariance[i, [7, 8], [7, 8]] * task.variance[i, j]
            if task.slow is not None:
                variance = variance + task.slow[i, j, [7, 8], [7, 8]]
            amplitude = float(np.hypot(*left[j, 7:9]))
            if amplitude > _FOURTH * np.sqrt(variance.max()) * np.sqrt(2.0):
                out.append(
                    f"{sensor.sensor.replace('.', '_')} has a fourth harmonic of {amplitude:.3g} SI in segment "
                    f"{task.names[i]!r}: a vibration of the arm, or terms beyond those of the model"
                )
    return out[:6]


def _gyros_alone(task: Task) -> list[str]:
    """A word where nothing checks the acceleration that the gyros' terms are referred to."""
    if any(s.kind == "accel" for s in task.sensors):
        return []
    text = (
        "gyros alone hardly show the arm's radius and sense of rotation: an error of rig.radius or a wrong sign of arm_rate "
        "would be in their terms unseen; record an accelerometer as well"
    )
    return [text]
