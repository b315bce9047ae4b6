"""What a plan will see: predicted uncertainty of every parameter, what cannot be told apart, time on the rig.

The prediction is the calibration itself, run on what an ideal unit would give: the same model, weights and refusals, so that
a plan that passes here is one that ``calibrate`` takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..calibrate import centrifuge, multi_position, norm, roll_isolated, table
from ..calibration import Calibration
from ..errors import DataError, InputError
from ..plan import Plan
from ..printed import printed
from . import ideal

METHODS = {
    "turntable": ("table", "norm", "multi-position"),
    "centrifuge": ("centrifuge",),
    "roll-isolated": ("roll-isolated",),
}
"""Methods that can be predicted on each rig, the usual one first."""


@dataclass(frozen=True)
class Predicted:
    """One parameter: its standard uncertainty, SI, after the plan has been run."""

    name: str
    unit: str
    standard_uncertainty: float


@dataclass(frozen=True)
class PlanCheck:
    """Outcome of :func:`check`.

    Attributes
    ----------
    method : str
    parameters : tuple of Predicted
        Empty when the plan cannot be calibrated with.
    condition : float or None
        Of the scaled problem.
    unseen : str
        Why the plan is not enough, the combinations that it cannot see among it; empty when all is seen.
    time_on_rig, time_measuring : float, s
    segments : int
    remarks : tuple of str
    """

    method: str
    parameters: tuple[Predicted, ...]
    condition: float | None
    unseen: str
    time_on_rig: float
    time_measuring: float
    segments: int
    remarks: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> float:
        """Predicted standard uncertainty of a parameter, SI."""
        return {p.name: p.standard_uncertainty for p in self.parameters}[name]

    def to_dict(self) -> dict[str, Any]:
        """Plain table for JSON."""
        return asdict(self)

    def summary(self) -> str:
        """The outcome as a page of text."""
        lines = [
            (
                f"Plan for {self.method}: {self.segments} segments, {_duration(self.time_on_rig)} on the rig "
                f"({_duration(self.time_measuring)} of it measuring)"
            ),
            "",
        ]
        if self.unseen:
            return "\n".join([*lines, f"  not enough: {self.unseen}", *(f"  note: {r}" for r in self.remarks)]) + "\n"
        lines.append(f"  {'parameter':<32}{'std. unc.':>12}  unit")
        for p in self.parameters:
            _, sigma, unit = printed(0.0, p.standard_uncertainty, p.unit)
            lines.append(f"  {p.name:<32}{sigma:>12}  {unit}".rstrip())
        if self.condition is not None:
            lines += ["", f"  condition {self.condition:.3g}"]
        return "\n".join([*lines, *(f"  note: {r}" for r in self.remarks)]) + "\n"


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def method_of(plan: Plan, method: str | None) -> str:
    """The method to predict: the one asked for, or the usual one of the plan's rig.

    Raises
    ------
    InputError
        When the method is not for this rig.
    """
    known = METHODS[plan.rig.kind]
    if method is None:
        return known[0]
    if method not in known:
        raise InputError(f"a {plan.rig.kind} is predicted for {', '.join(known)}, not for {method!r}")
    return method


def check(plan: Plan, method: str | None = None, *, sensors: Sequence[str] | None = None) -> PlanCheck:
    """Predict what a calibration with this plan will give.

    Parameters
    ----------
    plan : Plan
        With the unit's noise and the rig's uncertainties.
    method : str, optional
        Default: the usual one of the rig.
    sensors : sequence of str, optional
        Triads (``accel``, ``gyro``) or single sensors (``accel_z``, on a centrifuge) that are recorded; default: the triads
        whose noise the plan states.

    Returns
    -------
    PlanCheck

    Raises
    ------
    InputError
        When the plan does not state the noise, has no segments, or the method is not for its rig.
    """
    method = method_of(plan, method)
    if not plan.segment:
        raise InputError("the plan has no [[segment]]: there is nothing to predict")
    sensors = tuple(sensors or [s for s in ("accel", "gyro") if plan.unit.noise.of(s)] or ("accel", "gyro"))
    _refuse_sensors(sensors, plan.rig.kind)
    measuring = sum(s.stop - s.start for s in plan.segment)
    whole = max(s.stop for s in plan.segment) - min(0.0, *(s.start for s in plan.segment))
    try:
        found = predicted(plan, method, sensors)
    except DataError as refusal:
        return PlanCheck(method, (), None, str(refusal), whole, measuring, len(plan.segment))
    own = {p.name: p for p in found.parameters}
    return PlanCheck(
        method=method,
        parameters=tuple(Predicted(p.name, p.unit, p.standard_uncertainty) for p in own.values()),
        condition=found.fit.condition,
        unseen="",
        time_on_rig=whole,
        time_measuring=measuring,
        segments=len(plan.segment),
        remarks=found.remarks,
    )


def _refuse_sensors(sensors: Sequence[str], kind: str) -> None:
    single = {f"{s}_{a}" for s in ("accel", "gyro") for a in "xyz"} if kind == "centrifuge" else set()
    wrong = [s for s in sensors if s not in {"accel", "gyro"} | single]
    if wrong:
        raise InputError(
            f"sensors of a {kind}: accel, gyro{', accel_x ... gyro_z' if single else ''}; not {', '.join(wrong)}"
        )


def predicted(plan: Plan, method: str, sensors: Sequence[str]) -> Calibration:
    """The calibration that an ideal unit would get; its uncertainties are the prediction."""
    if method == "roll-isolated":
        ideal.need_noise(plan, ("gyro",))
        recording, words = ideal.roll_recording(plan)
        found = roll_isolated.calibrate_recording(recording, plan)
        return found.model_copy(update={"remarks": (*found.remarks, words)})
    ideal.need_noise(plan, list(dict.fromkeys(s.partition("_")[0] for s in sensors)))
    if method == "centrifuge":
        return centrifuge.calibrate_harmonics(ideal.centrifuge_harmonics(plan, sensors), plan)
    means = ideal.table_means(plan, sensors)
    if method == "norm":
        return norm.calibrate_means(means, plan)
    if method == "multi-position":
        return multi_position.calibrate_means(means, plan, matrix="triangular" if "accel" in sensors else "full")
    return table.calibrate_means(means, plan)


def worst_ratio(found: PlanCheck, required: dict[str, float]) -> tuple[float, str]:
    """Largest predicted uncertainty over what is required, and the parameter.

    Parameters
    ----------
    found : PlanCheck
    required : dict of str to float
        Standard uncertainty, SI, by name or by the beginning of names (``accel.bias``).

    Raises
    ------
    InputError
        When a name matches no parameter.
    """
    worst = (0.0, "")
    for name, limit in required.items():
        own = [p for p in found.parameters if p.name == name or p.name.startswith(f"{name}.")]
        if not own:
            raise InputError(
                f"required: {name!r} is no parameter of this plan; it has {', '.join(p.name for p in found.parameters)}"
            )
        top = max(own, key=lambda p: p.standard_uncertainty)
        worst = max(worst, (float(np.asarray(top.standard_uncertainty / limit)), top.name))
    return worst
