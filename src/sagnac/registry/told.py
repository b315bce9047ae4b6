"""Trends and comparisons as pages of text, in datasheet units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..printed import printed, probability
from .dates import YEAR

if TYPE_CHECKING:
    from .compare import Comparison, Difference
    from .fleet import FleetParameter, FleetTrend, UnitTrend
    from .trend_records import Known, Leaving, ParameterTrend, Trend

_LEAST = 1e-15
"""Probability below which it is no number any more."""


def columns(rows: Sequence[Sequence[str]], align: str, *, begin: str = "  ", gap: str = "   ") -> list[str]:
    """Rows in columns as wide as they need to be, the first row being the head.

    Parameters
    ----------
    rows : sequence of sequences of str
    align : str
        ``l`` or ``r`` for each column.
    begin, gap : str
        What stands before the first column, and between two of them.
    """
    wide = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        begin
        + gap.join(
            text.ljust(width) if side == "l" else text.rjust(width)
            for text, width, side in zip(row, wide, align, strict=True)
        ).rstrip()
        for row in rows
    ]


def shown_in(value: float, sigma: float, unit: str) -> str:
    """The unit of people that numbers of this size are shown in."""
    return printed(value, sigma, unit)[2]


def with_sigma(value: float, sigma: float, unit: str, shown: str) -> str:
    """``12.3 ± 0.4``, in the unit named."""
    v, s, _ = printed(value, sigma, unit, shown)
    return f"{v} ± {s}"


def trend_text(trend: Trend) -> str:
    """The trend of one unit as a page of text.

    Parameters
    ----------
    trend : Trend
    """
    count = len(trend.calibrations)
    first, last = trend.calibrations[0].created[:10], trend.calibrations[-1].created[:10]
    said = f"{count} calibrations from {first} to {last}" if count > 1 else f"one calibration, of {first}"
    head = f"Trend of {trend.model} {trend.serial}".rstrip() + f": {said}"
    rows: list[tuple[str, ...]] = [
        (
            "parameter",
            "n",
            "at the last",
            "drift a year",
            "white",
            "walk",
            f"expected {trend.at[:10]}",
            "unit",
            "leaves its limits",
        )
    ]
    rows += [_row(p) for p in trend.parameters]
    lines = [head, "", *columns(rows, "lrrrrrrll"), ""]
    lines += [
        "  ±: standard uncertainty. Expected (apart from its own uncertainty), and dates in brackets: with 95 % probability.",
        "  white, walk: scatter beyond the stated uncertainties, run to run and as a random walk within a year.",
    ]
    notes = [line for p in trend.parameters for line in _notes(p)]
    notes += [f"note: {r}" for r in trend.remarks]
    return "\n".join([*lines, *(["", *(f"  {n}" for n in _merged(notes))] if notes else [])]) + "\n"


def _row(p: ParameterTrend) -> tuple[str, ...]:
    n, limit = str(len(p.values)), "" if p.limits is None else "not told"
    if p.level is None or p.drift is None or p.expected is None:
        value, sigma = p.values[-1], p.standard_uncertainties[-1]
        shown = shown_in(value, sigma, p.unit)
        return p.name, n, with_sigma(value, sigma, p.unit, shown), "", "", "", "", shown, limit
    shown = shown_in(p.level.value, min(_sizes(p)), p.unit)
    yearly = with_sigma(YEAR * p.drift.value, YEAR * p.drift.standard_uncertainty, p.unit, shown)
    sigma = p.expected.standard_uncertainty
    low, high = (printed(v, sigma, p.unit, shown)[0] for v in (p.expected.lower, p.expected.upper))
    level = with_sigma(p.level.value, p.level.standard_uncertainty, p.unit, shown)
    leaves = "" if p.leaving is None else leaving_text(p.leaving)
    return p.name, n, level, yearly, *_scatter(p, shown), f"{low} to {high}", shown, leaves


def _sizes(p: ParameterTrend) -> list[float]:
    """Uncertainties that are shown, those of nothing left out."""
    parts: tuple[Known | None, ...] = (p.level, p.expected)
    return [k.standard_uncertainty for k in parts if k is not None and k.standard_uncertainty > 0] or [0.0]


def leaving_text(leaving: Leaving) -> str:
    """When limits are left, in a few words."""
    if leaving.state == "already outside":
        sure = leaving.probability_outside
        return f"already outside ({leaving.bound} limit, probability {probability(sure)})"
    if leaving.state == "stays":
        rarely = f" (at the earliest {_month(leaving.earliest)})" if leaving.earliest else ""
        return f"not within {leaving.horizon_years:g} years{rarely}"
    between = f"{_month(leaving.earliest)} to {_month(leaving.latest)}"
    if leaving.latest is None:
        between = f"not before {_month(leaving.earliest)}"
    return f"{_month(leaving.date)} ({between}), {leaving.bound} limit"


def _month(date: str | None) -> str:
    return "" if date is None else date[:7]


def _notes(p: ParameterTrend) -> list[str]:
    lines = []
    for step in p.steps:
        shown = shown_in(step.change, step.joint_standard_uncertainty, p.unit)
        text, _, _ = printed(step.change, step.joint_standard_uncertainty, p.unit, shown)
        many = _times(step.change, step.joint_standard_uncertainty)
        first, then = step.before.created[:10], step.after.created[:10]
        lines.append(
            f"step: {p.name} changed by {text} {shown} ({many}) from {first} to {then}; after a repair or an adjustment look at "
            f"what came since: --since {then}"
        )
    return lines + [f"note: {p.name}: {r}" for r in p.remarks]


def _times(change: float, sigma: float) -> str:
    if sigma == 0:
        return "stated as exact before and after"
    return f"{abs(change) / sigma:.3g} joint standard uncertainties"


def _scatter(p: ParameterTrend, shown: str) -> tuple[str, str]:
    """White scatter and walk within a year, in the unit named; nothing where the stated uncertainties explain all."""
    if p.scatter is None:
        return "", ""
    both = p.scatter.white, p.scatter.walk * math.sqrt(YEAR)
    white, walk = (printed(v, v / 3, p.unit, shown)[0] if v > 0 else "-" for v in both)
    return white, walk


def _merged(notes: list[str]) -> list[str]:
    """Each note once; those that say the same of several parameters in one line."""
    groups: dict[tuple[str, str], list[str]] = {}
    for note in notes:
        kind, _, rest = note.partition(": ")
        name, colon, words = rest.partition(": ")
        if kind == "note" and colon and " " not in name:
            groups.setdefault((kind, words), []).append(name)
        else:
            groups.setdefault((note, ""), [])
    return [f"{key}: {_listed(names)}: {words}" if names else key for (key, words), names in groups.items()]


def _listed(names: list[str]) -> str:
    return ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:5])} and {len(names) - 5} more"


def model_text(fleet: FleetTrend, most: int) -> str:
    """The drifts of a model's units as a page of text.

    Parameters
    ----------
    fleet : FleetTrend
    most : int
        Units to be named, those nearest to their limits.
    """
    several = (
        len({p.model for p in fleet.parameters}) > 1
    )  # models: their units are not alike, and each has its own rows
    lines = [f"Drift of {fleet.model}: {fleet.units} units, {fleet.calibrations} calibrations".replace("of :", ":"), ""]
    rows: list[tuple[str, ...]] = [
        ("model", "parameter", "units", "mean a year", "spread over units", "unit", "outside", "leaving in 20 years")
    ]
    rows += [(p.model, *_fleet_row(p)) for p in fleet.parameters]
    if len(rows) > 1:
        lines += columns([row if several else row[1:] for row in rows], "llrrrlrr" if several else "lrrrlrr")
        lines += [
            "",
            "  ±: standard uncertainty. Spread: what the drifts differ by beyond their uncertainties, 95 % in brackets.",
        ]
    near = [(p, u) for p in fleet.parameters for u in p.units if u.leaving is not None and u.leaving.state != "stays"]
    near.sort(key=lambda pu: _soon(pu[1]))
    if near:
        head = ("model", "unit", "parameter", "n", "last", "at the last", "drift a year", "unit", "leaves its limits")
        named = [head, *((u.model, *_unit_row(p, u)) for p, u in near[:most])]
        lines += [
            "",
            "  Nearest to their limits",
            "",
            *columns([row if several else row[1:] for row in named], "lllrlrrll" if several else "llrlrrll"),
        ]
        if len(near) > most:
            lines.append(f"  ... and {len(near) - most} more: --json names all")
    elif any(u.limits is not None for p in fleet.parameters for u in p.units):
        lines += ["", "  No unit is expected to leave its limits within 20 years."]
    short = sum(p.untold for p in fleet.parameters)
    if short or fleet.untold:
        lines += ["", "  note: histories of fewer than three calibrations tell no drift and are left out"]
    return "\n".join(lines) + "\n"


def _soon(unit: UnitTrend) -> tuple[str, float]:
    leaving = unit.leaving
    if leaving is None or leaving.date is None:
        return "9999", 0.0
    return ("", -leaving.probability_outside) if leaving.state == "already outside" else (leaving.date, 0.0)


def _fleet_row(p: FleetParameter) -> tuple[str, ...]:
    size = YEAR * (p.spread or p.spread_upper or 0.0), YEAR * (p.mean_standard_uncertainty or 0.0)
    middle = YEAR * (p.median if p.mean is None else p.mean)
    shown = shown_in(middle, max(size) / 10, p.unit)
    mean = with_sigma(middle, size[1], p.unit, shown) if p.mean is not None else printed(middle, 0, p.unit, shown)[0]
    limited = [u.leaving for u in p.units if u.leaving is not None]
    states = [leaving.state for leaving in limited]
    counts = [str(states.count(s)) if limited else "" for s in ("already outside", "leaves")]
    return p.name, str(len(p.units)), mean, _spread(p, shown), shown, *counts


def _spread(p: FleetParameter, shown: str) -> str:
    """``21 (14 to 35)``, or what it is below where the uncertainties explain all."""
    if p.spread is None or p.spread_lower is None or p.spread_upper is None:
        return "-"
    digits = YEAR * p.spread_upper / 2
    low, middle, high = (
        printed(YEAR * v, digits, p.unit, shown)[0] for v in (p.spread_lower, p.spread, p.spread_upper)
    )
    if p.spread_upper == 0:
        return "-"
    return f"{middle} ({low} to {high})" if p.spread > 0 else f"< {high}"


def _unit_row(p: FleetParameter, u: UnitTrend) -> tuple[str, ...]:
    shown = shown_in(u.level.value, u.level.standard_uncertainty, p.unit)
    level = with_sigma(u.level.value, u.level.standard_uncertainty, p.unit, shown)
    yearly = with_sigma(YEAR * u.drift.value, YEAR * u.drift.standard_uncertainty, p.unit, shown)
    leaves = "" if u.leaving is None else leaving_text(u.leaving)
    return u.serial, p.name, str(u.calibrations), u.last[:10], level, yearly, shown, leaves


def comparison_text(comparison: Comparison) -> str:
    """What has changed between two calibrations as a page of text.

    Parameters
    ----------
    comparison : Comparison
    """
    sides = [
        f"  {word:<7} {s.source}: {s.model} {s.serial}".rstrip() + f", {s.method}, {s.created[:10]}"
        for word, s in (("before", comparison.before), ("after", comparison.after))
    ]
    rows: list[tuple[str, ...]] = [
        ("parameter", "before", "after", "difference", "unit", "over its unc.", "probability", "")
    ]
    rows += [_difference_row(d) for d in comparison.parameters]
    lines = ["Comparison of two calibrations", "", *sides, "", *columns(rows, "lrrrlrrl"), ""]
    lines.append("  ±: standard uncertainty, of the difference that of both together")
    both = comparison.together
    if both is not None:
        lines.append(
            f"  altogether: chi-square {both.chi2:.4g} for {both.degrees_of_freedom} degrees of freedom, probability "
            + _chance(both.p_value)
        )
    few = [d.degrees_of_freedom for d in comparison.parameters if d.degrees_of_freedom is not None]
    if few:
        least = f"{min(few):.3g}" + (f" to {max(few):.3g}" if max(few) > 1.01 * min(few) else "")
        lines.append(
            f"  uncertainties estimated with {least} degrees of freedom: probabilities are those of the distributions of Student "
            "and Fisher"
        )
    why: dict[str, list[str]] = {}
    for left in comparison.left_out:
        why.setdefault(left.reason, []).append(left.name)
    notes = [f"not compared, {reason}: {', '.join(names)}" for reason, names in why.items()]
    notes += [f"note: {r}" for r in comparison.remarks]
    return "\n".join([*lines, *(["", *(f"  {n}" for n in notes)] if notes else [])]) + "\n"


def _chance(p: float | None) -> str:
    if p is None:
        return "-"
    return probability(p) if p > _LEAST else "below 1e-15"


def _difference_row(d: Difference) -> tuple[str, ...]:
    shown = shown_in(max(abs(d.before), abs(d.after)), d.standard_uncertainty, d.unit)
    values = [
        printed(v, s, d.unit, shown)[0]
        for v, s in ((d.before, d.before_standard_uncertainty), (d.after, d.after_standard_uncertainty))
    ]
    over = "-" if d.normalised is None else f"{d.normalised + 0.0:.2f}"
    words = [*((d.converted,) if d.converted else ()), *(() if d.of_the_unit else ("of the rig",))]
    changed = with_sigma(d.difference, d.standard_uncertainty, d.unit, shown)
    return d.name, *values, changed, shown, over, _chance(d.p_value), ", ".join(words)
