"""The result: values with expanded uncertainty, correlations, conformity with limits."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ... import limits as rules
from ...calibration import Calibration, Value
from ...limits import Decision, Limit
from .. import pictures
from ..document import Block, Grid, Section, Text, Verdict
from ..parts import picture
from ..shown import Scale, percent
from .budget import ASSUMED, GIVEN, exactly, standing
from .context import Context

_WORDS = {True: "pass", False: "fail", None: "undecided"}
_LARGE = 0.5
"""Correlations that the text names, by size."""


def results(context: Context) -> Section:
    """Values, expanded uncertainties, coverage factors."""
    calibration = context.calibration
    many = not context.coverage.one_factor
    not_measured = standing(context)
    header = ("parameter", "value", "U", "unit", *(("k", "ν") if many else ()), "u", *([""] if not_measured else ()))
    rows = tuple(_row(context, p, many, not_measured) for p in calibration.parameters)
    align = "lrrl" + "rr" * many + "r" + "l" * bool(not_measured)
    blocks: list[Block] = [
        Grid(header, rows, align, "Values with expanded uncertainty U and standard uncertainty u"),
        Text(context.coverage.statement()),
    ]
    if many:
        blocks.append(Text("ν: degrees of freedom of u; ∞ where the noise was known.", "note"))
    blocks += [Text(_MEANING[word], "note") for word in dict.fromkeys(not_measured.values())]
    factors = set(context.coverage.factors.values())
    said = f", k = {factors.pop():.3g}" if len(factors) == 1 else ", each with the k of the table"
    blocks.append(
        picture(
            lambda: pictures.parameters(calibration, k=context.coverage.factors),
            f"Values with expanded uncertainty{said}.",
            "Values of all parameters with bars of the expanded uncertainty, by sensor",
        )
    )
    return Section("Results", tuple(blocks))


_MEANING = {
    GIVEN: "given: stated beforehand and taken as exact, no result of this calibration.",
    ASSUMED: (
        "assumed, not measured: what was stated beforehand, of which the recording has shown hardly anything; no result of this "
        "calibration."
    ),
}


def _row(context: Context, p: Value, many: bool, not_measured: Mapping[str, str]) -> tuple[str, ...]:
    scale = context.scales[p.name]
    dof = context.coverage.dof[p.name]
    last = (not_measured.get(p.name, ""),) if not_measured else ()
    if p.standard_uncertainty == 0:
        return (p.name, exactly(p, scale), "–", scale.unit_text, *(("–", "–") if many else ()), "–", *last)
    extra = (f"{context.coverage.factors[p.name]:.2f}", "∞" if math.isinf(dof) else f"{dof:.0f}") if many else ()
    return (
        p.name,
        scale.text(p.value),
        scale.text(context.expanded(p)),
        scale.unit_text,
        *extra,
        scale.text(p.standard_uncertainty, 1),
        *last,
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
        return "–" if math.isinf(bound) else f"{bound * scale.size + 0.0:.9g}".replace("-", "−")

    return text(limit.lower), text(limit.upper)
