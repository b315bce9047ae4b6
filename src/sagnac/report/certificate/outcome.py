"""The result: values with expanded uncertainty, correlations, uncertainty budget, conformity with limits."""

from __future__ import annotations

import math

from ...calibration import Calibration, Value
from .. import pictures
from ..document import Block, Grid, Section, Text, Verdict
from ..parts import picture
from ..shown import Scale, moment, percent, quantity, scale_of
from . import limits as rules
from .context import Context
from .limits import Decision, Limit

_WORDS = {True: "pass", False: "fail", None: "undecided"}
_LARGE = 0.5
"""Correlations that the text names, by size."""
_NEGLIGIBLE = 1e-3
"""Share of a standard uncertainty that a line of the budget must have to be worth a number."""


def results(context: Context) -> Section:
    """Values, expanded uncertainties, coverage factors."""
    calibration = context.calibration
    many = not context.coverage.one_factor
    header = ("parameter", "value", "U", "unit", *(("k", "ν") if many else ()), "u")
    rows = tuple(_row(context, p, many) for p in calibration.parameters)
    blocks: list[Block] = [
        Grid(header, rows, "lrrl" + "rr" * many + "r", "Values with expanded uncertainty U and standard uncertainty u"),
        Text(context.coverage.statement()),
    ]
    if many:
        blocks.append(Text("ν: degrees of freedom of u; ∞ where the noise was known.", "note"))
    blocks.append(
        picture(
            lambda: pictures.parameters(calibration),
            "Values with expanded uncertainty, k = 2.",
            "Values of all parameters with bars of two standard uncertainties, by sensor",
        )
    )
    return Section("Results", tuple(blocks))


def _row(context: Context, p: Value, many: bool) -> tuple[str, ...]:
    scale = context.scales[p.name]
    dof = context.coverage.dof[p.name]
    known = p.standard_uncertainty > 0
    extra = (f"{context.coverage.factors[p.name]:.2f}", "∞" if math.isinf(dof) else f"{dof:.0f}") if many else ()
    expanded = scale.text(context.expanded(p)) if known else "0"
    return (
        p.name,
        scale.text(p.value) if known else quantity(p.value * scale.size, "", 9),
        expanded,
        scale.unit_text,
        *extra,
        scale.text(p.standard_uncertainty, 1) if known else "0",
    )


def correlation(context: Context) -> Section:
    """The correlations, as a picture and as a list of the strong ones."""
    calibration = context.calibration
    strong = _strong(calibration)
    if strong:
        named = ", ".join(f"{a} and {b} ({r:+.2f})".replace("-", "−") for a, b, r in strong[:12])
        more = f", and {len(strong) - 12} more" if len(strong) > 12 else ""
        text = f"Parameters are correlated; those with a coefficient beyond ±{_LARGE:g}: {named}{more}."
    else:
        text = f"No two parameters are correlated by more than ±{_LARGE:g}."
    text += (
        " Quantities computed from several parameters need the whole covariance; it is in the data of this certificate."
    )
    drawn = picture(
        lambda: pictures.correlation(calibration),
        "Correlation of the parameters.",
        f"Matrix of the correlation coefficients of {len(calibration.parameters)} parameters. {text}",
    )
    return Section("Correlation", (Text(text), drawn), 2)


def _strong(calibration: Calibration) -> list[tuple[str, str, float]]:
    sigma = [p.standard_uncertainty for p in calibration.parameters]
    names = [p.name for p in calibration.parameters]
    out = []
    for i, row in enumerate(calibration.covariance):
        for j in range(i):
            size = sigma[i] * sigma[j]
            if size > 0 and abs(row[j] / size) >= _LARGE:
                out.append((names[j], names[i], row[j] / size))
    return sorted(out, key=lambda r: -abs(r[2]))


def budget(context: Context) -> Section:
    """Where the uncertainty comes from: by source, or where there is no such account by its three evaluations."""
    calibration = context.calibration
    drawn = picture(
        lambda: pictures.budget(calibration),
        "Uncertainty budget." if calibration.budget else "Standard uncertainties by their evaluations.",
        "Bars of the parts of each parameter's standard uncertainty",
    )
    if calibration.budget:
        words = "Contributions of the sources to the standard uncertainty u of each parameter."
        header = tuple(line.source for line in calibration.budget)
        columns = [line.standard_uncertainty for line in calibration.budget]
    else:
        kinds = {
            "white": ("from noise and stated uncertainty", calibration.fit.white),
            "cluster": ("from the scatter of segments", calibration.fit.cluster),
            "delete_one": ("from leaving out a segment", calibration.fit.delete_one),
        }
        there = [(label, values) for label, values in kinds.values() if values is not None]
        words = (
            "This method combines noise and the stated uncertainties of the rig in one weighted fit, which parts the "
            "result no further. The "
            "standard uncertainty by its evaluations; the last column is the one that counts."
        )
        header = tuple(label for label, _ in there)
        columns = [values for _, values in there]
    rows = tuple(
        _budget_row(p, context.scales[p.name], [c[i] for c in columns]) for i, p in enumerate(calibration.parameters)
    )
    grid = Grid(
        ("parameter", "unit", *header, "u"), rows, "ll" + "r" * (len(header) + 1), "Uncertainty budget", len(header) > 5
    )
    return Section("Uncertainty budget", (Text(words), grid, drawn))


def _budget_row(p: Value, scale: Scale, parts: list[float]) -> tuple[str, ...]:
    u = p.standard_uncertainty
    return (
        p.name,
        scale.unit_text,
        *("–" if part <= _NEGLIGIBLE * u else scale.text(part, 1) for part in parts),
        scale.text(u, 1) if u > 0 else "0",
    )


def conformity(context: Context) -> Section | None:
    """The limits, the decision rule and the decisions (ISO/IEC 17025:2017, 7.8.6)."""
    given = context.limits
    if given is None or not context.decisions:
        return None
    risk = percent(0.5 * (1.0 - context.coverage.probability)) + " for a normal distribution (one limit)"
    rows = tuple(_decision_row(context, d) for d in context.decisions.values())
    grid = Grid(
        ("parameter", "value", "U", "lower limit", "upper limit", "unit", "conforms with", "decision"),
        rows,
        "lrrrrlrl",
        "Decisions",
    )
    passed = rules.outcome(context.decisions)
    counts = (f"{sum(d.passed is s for d in context.decisions.values())} {word}" for s, word in _WORDS.items())
    text = f"{', '.join(counts)}; of {len(rows)} parameters with limits."
    blocks: list[Block] = [
        Verdict(passed, text),
        Text("Decision rule. " + rules.RULES[given.rule].format(risk=risk)),
        Text(
            "The column 'conforms with' is the probability that the parameter lies inside its limits (JCGM 106:2012, "
            "7.2 to 7.4)."
        ),
        grid,
    ]
    if given.specification:
        blocks.insert(1, Text(f"Limits from: {given.specification}."))
    free = len(context.calibration.parameters) - len(rows)
    if free:
        blocks.append(
            Text(f"For {free} other parameters no limits were given: nothing is stated on their conformity.", "note")
        )
    return Section("Conformity with limits", tuple(blocks))


def _decision_row(context: Context, d: Decision) -> tuple[str, ...]:
    p = d.parameter
    scale = context.scales[p.name]
    return (
        p.name,
        scale.text(p.value),
        scale.text(context.expanded(p)),
        *_bounds(d.limit, scale),
        scale.unit_text,
        percent(d.probability),
        _WORDS[d.passed],
    )


def _bounds(limit: Limit, scale: Scale) -> tuple[str, str]:
    """Bounds as short as they were written: nothing is gained by the digits of the uncertainty."""

    def text(bound: float) -> str:
        return "–" if math.isinf(bound) else f"{bound * scale.size:.9g}".replace("-", "−")

    return text(limit.lower), text(limit.upper)


def as_found(context: Context) -> Section | None:
    """An earlier calibration of the unit against this one.

    The normalised error is that of ISO 13528:2015 (9.7), ``Eₙ = (x - X) / sqrt(U_x² + U_X²)``.
    """
    earlier = context.evidence.earlier
    if earlier is None:
        return None
    calibration, rows, beyond, left_out = context.calibration, [], [], []
    from .coverage import cover

    before = cover(earlier, context.coverage.k)
    for p in calibration.parameters:
        old = _counterpart(earlier, calibration, p)
        if old is None:
            left_out.append(p.name)
            continue
        difference = p.value - old.value
        joint = math.hypot(context.expanded(p), before.expanded(old))
        en = difference / joint if joint > 0 else math.nan
        scale = scale_of(p, joint)
        if abs(en) > 1:
            beyond.append(p.name)
        rows.append(
            (
                p.name,
                scale.text(old.value),
                scale.text(p.value),
                scale.text(difference),
                scale.text(joint),
                scale.unit_text,
                f"{en:.2f}".replace("-", "−") if math.isfinite(en) else "–",
            )
        )
    words = (
        f"As found: the calibration of {moment(earlier.created)} by {earlier.method}. As left: this one. The "
        "difference is compared with the "
        "expanded uncertainties of both together, Eₙ = (as left − as found) / √(U² + U²); beyond ±1 a difference is "
        "more than the "
        "uncertainties explain. What both calibrations share, as the gravity of the site, makes Eₙ smaller than it "
        "seems."
    )
    verdict = (
        f"All {len(rows)} common parameters agree within the expanded uncertainties."
        if not beyond
        else f"{len(beyond)} of {len(rows)} parameters have changed by more than the uncertainties explain: {', '.join(beyond)}."
    )
    blocks: list[Block] = [
        Text(words),
        Text(verdict),
        Grid(
            ("parameter", "as found", "as left", "difference", "its U", "unit", "Eₙ"),
            tuple(rows),
            "lrrrrlr",
            "As found, as left",
        ),
        picture(
            lambda: pictures.as_found(earlier, calibration),
            "Change of the common parameters, as Eₙ with k = 2.",
            "Change of each parameter over its joint expanded uncertainty",
        ),
    ]
    if left_out:
        blocks.append(
            Text(
                f"Not in the earlier calibration, or in another unit or convention there: {', '.join(left_out)}.",
                "note",
            )
        )
    return Section("As found, as left", tuple(blocks))


def _counterpart(earlier: Calibration, calibration: Calibration, p: Value) -> Value | None:
    """The same quantity in the earlier calibration; a misalignment only where it means the same there."""
    if p.name not in earlier.values() or earlier[p.name].unit != p.unit:
        return None
    if ".misalignment." in p.name and earlier.misalignment != calibration.misalignment:
        return None
    return earlier[p.name]
