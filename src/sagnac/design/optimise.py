"""Better plans: segments chosen from candidates for the least uncertainty in the time there is."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..calibrate import norm, table
from ..calibrate.centrifuge.prepare import prepare
from ..calibrate.centrifuge.turning import as_planned
from ..errors import DataError, InputError
from ..estimate import Parameter, Rows
from ..plan import Plan, Segment
from . import ideal
from .check import PlanCheck, check, worst_ratio
from .exchange import Candidates, Design, choose
from .spec import Spec

_MOST = 4000  # candidates
_LONGEST = 1e6  # s of dwell


@dataclass(frozen=True)
class Optimised:
    """Outcome of :func:`optimise`.

    Attributes
    ----------
    plan : Plan
    found : PlanCheck
        What the plan will see.
    candidates : int
    efficiency : float
        D-efficiency: share of the information that the best division of the same time among all candidates would give.
    remarks : tuple of str
    """

    plan: Plan
    found: PlanCheck
    candidates: int
    efficiency: float
    remarks: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain table for JSON, without the plan."""
        return {
            "candidates": self.candidates,
            "efficiency": self.efficiency,
            "remarks": list(self.remarks),
            **self.found.to_dict(),
        }

    def summary(self) -> str:
        """The outcome as a page of text."""
        lines = [f"Chosen {len(self.plan.segment)} of {self.candidates} candidates"]
        lines.append(
            f"D-efficiency {self.efficiency:.3f} against the best division of the same time among all candidates"
        )
        lines += [*(f"note: {r}" for r in self.remarks), "", self.found.summary()]
        return "\n".join(lines)


def optimise(spec: Spec) -> Optimised:
    """Pick positions, rates, g levels and dwell from candidates.

    Parameters
    ----------
    spec : Spec

    Returns
    -------
    Optimised
        With a plan that ``calibrate`` takes.

    Raises
    ------
    DataError
        When no choice from the candidates determines the parameters (naming what cannot be told apart), or none meets the
        required uncertainties in the time.
    InputError
        When the specification lacks something.

    References
    ----------
    Atkinson, Donev & Tobias 2007, *Optimum Experimental Designs*, chapters 11 and 12.
    """
    asked = spec.optimise
    segments = candidate_segments(spec, asked.dwell)
    plan = _scheduled(spec, segments)
    parameters, rows = linearised(plan, asked.method, asked.sensors)
    remarks = _speeds_needed(spec, segments)
    candidates = _candidates(spec, segments, parameters, rows)
    design = _choice(spec, candidates, asked.positions)
    if spec.required() and asked.positions is None:
        design, remarks = _few_enough(spec, segments, candidates, design, remarks)
    elif spec.required():
        dwell, remarks = _long_enough(spec, design, remarks)
        segments = candidate_segments(spec, dwell)
    picked = [segments[i] for i in design.chosen]
    best = _scheduled(spec, _in_order(picked))
    found = check(best, asked.method, sensors=asked.sensors)
    if found.unseen:
        raise DataError(
            f"the best {len(picked)} of {len(segments)} candidates are not enough: {found.unseen} Offer more candidates, "
            "more positions or more time"
        )
    return Optimised(best, found, len(segments), design.efficiency, tuple(remarks))


def candidate_segments(spec: Spec, dwell: float) -> list[Segment]:
    """Every combination of the candidates' settings and rates, held for `dwell` or the next whole number of turns."""
    grid, kind = spec.optimise.candidates, spec.plan.rig.kind
    if kind == "centrifuge":
        if not grid.arm_rate:
            raise InputError("optimise.candidates: arm_rate is missing: which rates can the arm turn at?")
        names = ("arm_rate", "alpha", "beta", "gamma")
        combined = itertools.product(*(getattr(grid, n) for n in names))
        out = [dict(zip(names, values, strict=True)) | {"arm_phase": 0.0} for values in combined]
    elif kind == "turntable":
        pairs = directions(grid.directions) if grid.directions else list(itertools.product(grid.middle, grid.inner))
        out = [
            {"outer": outer, "middle": middle, "inner": inner, "outer_rate": rate}
            for (middle, inner), outer, rate in itertools.product(pairs, grid.outer, grid.outer_rate)
        ]
    else:
        raise InputError("plans of a roll-isolated rig are not searched; see what one gives with `plan check`")
    if len(out) > _MOST:
        raise InputError(f"optimise.candidates: {len(out)} combinations; offer at most {_MOST}")
    return [
        Segment(name=str(i + 1), start=0.0, stop=_hold(dwell, s.get("arm_rate", 0.0) or s.get("outer_rate", 0.0)), **s)
        for i, s in enumerate(out)
    ]


def _hold(dwell: float, rate: float) -> float:
    """Time of a segment: whole turns leave nothing of what turns."""
    if rate == 0:
        return dwell
    turn = 2 * math.pi / abs(rate)
    return turn * max(1, math.ceil(dwell / turn - 1e-9))


def directions(count: int) -> list[tuple[float, float]]:
    """Middle and inner angle (rad) that point evenly spread directions of the case up (Fibonacci lattice)."""
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * i
    x, y = np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn)
    # up in the case is (-cos m sin i, sin m, cos m cos i)
    return list(zip(np.arcsin(y).tolist(), np.arctan2(-x, z).tolist(), strict=True))


def _scheduled(spec: Spec, segments: list[Segment]) -> Plan:
    """The plan with these segments one after the other."""
    now, out = spec.optimise.move, []
    for i, s in enumerate(segments):
        hold = s.stop - s.start
        out.append(s.model_copy(update={"name": str(i + 1), "start": now, "stop": now + hold}))
        now += hold + spec.optimise.move
    return spec.plan.model_copy(update={"segment": tuple(out)})


def _in_order(segments: list[Segment]) -> list[Segment]:
    """Rates together and short moves: sorted by rate, then by setting."""
    return sorted(
        segments, key=lambda s: (s.turn_rate, s.alpha, s.beta, s.gamma, s.middle or 0, s.inner or 0, s.outer or 0)
    )


def linearised(plan: Plan, method: str, sensors: tuple[str, ...]) -> tuple[list[Parameter], Rows]:
    """Parameters and whitened derivatives at the truth of an ideal unit, the unknowns of segments projected out."""
    ideal.need_noise(plan, list(dict.fromkeys(s.partition("_")[0] for s in sensors)))
    if method == "centrifuge":
        return _on_centrifuge(plan, sensors)
    means = ideal.table_means(plan, sensors)
    if method == "norm":
        _, _, model, _, given = norm.prepare(means, plan)
        return list(given), model.rows(np.array([p.start for p in given]))
    table_model, parameters, _ = table.prepare(means, plan)
    return parameters, table_model.rows(np.array([p.start for p in parameters]))


def _on_centrifuge(plan: Plan, sensors: tuple[str, ...]) -> tuple[list[Parameter], Rows]:
    harmonics = ideal.centrifuge_harmonics(plan, sensors)
    task, _ = prepare(harmonics, plan, None, None, None)
    turning = as_planned(task.look(), task.segments, plan)
    parameters = task.parameters(turning)
    return parameters, task.model(turning).rows(np.array([p.start for p in parameters]))


def _candidates(spec: Spec, segments: list[Segment], parameters: list[Parameter], rows: Rows) -> Candidates:
    """Information of each segment in units of what matters."""
    scale = np.array([p.scale for p in parameters])
    sigma = np.array([p.prior_sigma for p in parameters])
    counts = np.bincount(rows.segment, minlength=len(segments))
    blocks = np.zeros((len(segments), int(counts.max()), len(parameters)))
    for i in range(len(segments)):
        blocks[i, : counts[i]] = rows.jacobian[rows.segment == i] * scale
    interest = np.array([i for i, p in enumerate(parameters) if p.name.startswith(("accel.", "gyro."))])
    return Candidates(
        blocks,
        np.array([s.stop - s.start for s in segments]) + spec.optimise.move,
        np.diag(np.where(np.isfinite(sigma), (scale / sigma) ** 2, 0.0)),
        interest,
    )


def _choice(spec: Spec, candidates: Candidates, count: int | None, starts: int = 8) -> Design:
    asked = spec.optimise
    budget = math.inf if asked.time_budget is None else asked.time_budget - asked.move
    return choose(candidates, asked.criterion, count=count, budget=budget, seed=asked.seed, starts=starts)


def _speeds_needed(spec: Spec, segments: list[Segment]) -> list[str]:
    """A word where no single arm rate among the candidates would do."""
    speeds = sorted({abs(s.arm_rate) for s in segments if s.arm_rate})
    if len(speeds) < 2:
        return []
    alone = []
    for v in speeds:
        plan = _scheduled(spec, [s for s in segments if abs(s.arm_rate) in (0.0, v)])
        alone.append(check(plan, spec.optimise.method, sensors=spec.optimise.sensors).unseen)
    return [f"one arm rate is not enough: {alone[0]}"] if all(alone) else []


def _few_enough(
    spec: Spec, segments: list[Segment], candidates: Candidates, design: Design, remarks: list[str]
) -> tuple[Design, list[str]]:
    """Fewest segments that meet the required uncertainties, by bisection."""
    asked, required = spec.optimise, spec.required()

    def at(chosen: Design) -> tuple[float, str]:
        found = check(_scheduled(spec, [segments[i] for i in chosen.chosen]), asked.method, sensors=asked.sensors)
        return (math.inf, found.unseen) if found.unseen else worst_ratio(found, required)

    ratio, name = at(design)
    if ratio > 1.0:
        raise DataError(
            f"all {len(design.chosen)} segments that fit into the time leave {name} uncertain by {ratio:.3g} times what is "
            "required: allow more time or a longer dwell, or ask for less"
            if math.isfinite(ratio)
            else f"the best choice in the time is not enough: {name}"
        )
    few, many = 0, len(design.chosen)
    while many - few > 1:
        trial = _choice(spec, candidates, (few + many) // 2, starts=2)
        reached, trial_name = at(trial)
        if reached <= 1.0:
            design, name, many = trial, trial_name, (few + many) // 2
        else:
            few = (few + many) // 2
    return design, [*remarks, f"{many} segments meet what is required; {name} decides"]


def _long_enough(spec: Spec, design: Design, remarks: list[str]) -> tuple[float, list[str]]:
    """Shortest dwell that meets the required uncertainties, by bisection."""
    asked, required = spec.optimise, spec.required()

    def at(dwell: float) -> tuple[float, str, PlanCheck]:
        every = candidate_segments(spec, dwell)
        found = check(_scheduled(spec, [every[i] for i in design.chosen]), asked.method, sensors=asked.sensors)
        if found.unseen:
            raise DataError(f"the best choice of candidates is not enough: {found.unseen}")
        return (*worst_ratio(found, required), found)

    low, high = min(1.0, asked.dwell), asked.dwell
    while at(high)[0] > 1.0:
        low, high = high, high * 4
        if high > _LONGEST:
            ratio, name, found = at(_LONGEST)
            raise DataError(
                f"no dwell meets what is required: even after {_LONGEST:.0e} s a segment, {name} is left uncertain by "
                f"{found[name]:.3g} ({ratio:.2g} times what is required); the table's uncertainty or the candidates set the limit"
            )
    while high > 1.01 * low and at(low)[0] > 1.0:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if at(middle)[0] <= 1.0 else (middle, high)
    dwell = high if at(low)[0] > 1.0 else low
    _, name, found = at(dwell)
    if asked.time_budget is not None and found.time_on_rig > asked.time_budget * (1 + 1e-9):
        raise DataError(
            f"what is required of {name} takes {found.time_on_rig / 3600:.3g} h, more than the budget of "
            f"{asked.time_budget / 3600:.3g} h: allow more time or ask for less"
        )
    return dwell, [*remarks, f"a dwell of {dwell:.4g} s meets what is required; {name} decides"]
