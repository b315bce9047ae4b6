"""How the calibration fits its own recording and one that it has not seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...calibration import Value
from ...recording import Recording
from ...verification import Check
from .. import pictures
from ..document import Block, Bullets, Grid, Section, Text, Verdict
from ..parts import picture
from ..shown import percent, quantity, scale_of
from ..style import shown_unit
from .context import Context

_ROWS = 240
"""Residuals that the table lists; more are summed up by quantity."""


def residuals(context: Context) -> Section:
    """Residuals per position, and what each segment does to the result."""
    calibration, evidence = context.calibration, context.evidence
    checks = evidence.fit_checks
    blocks: list[Block] = [*_scatter(context)]
    blocks.append(
        picture(
            lambda: pictures.residuals(calibration, checks or None),
            "Residuals per position." if checks else "Chi-square of each segment.",
            "Residuals of the fit, position by position",
        )
    )
    if checks:
        blocks += _table(checks, "Residuals on the recording of the calibration")
    else:
        why = [evidence.absent[k] for k in ("recording", "plan", "residuals") if k in evidence.absent]
        reason = "; ".join(why) or "the recording shows none"
        blocks.append(Text(f"Residuals in their own units are not shown: {reason}.", "missing"))
    if calibration.fit.influence:
        blocks += _influence(context)
    return Section("Residuals", tuple(blocks))


def _scatter(context: Context) -> list[Block]:
    fit = context.calibration.fit
    rows = []
    for kind, s in fit.residuals.items():
        unit, size = shown_unit(s.rms, s.unit) if s.unit else ("", 1.0)
        rows.append((kind, quantity(s.rms * size, unit), f"{s.count}"))
    return [Grid(("residuals", "rms", "number"), tuple(rows), "lrr", "Residuals of the fit")] if rows else []


def _influence(context: Context) -> list[Block]:
    calibration = context.calibration
    top = max(calibration.fit.influence, key=lambda i: math.inf if i.shift is None else i.shift)
    words = (
        f"Without segment {top.segment} the parameters would not be determined."
        if top.shift is None
        else f"Most influence has segment {top.segment}: without it {top.parameter} would move by {top.shift:.2g} of its "
        "standard uncertainties."
    )
    if all(i.shift is None for i in calibration.fit.influence):
        return [
            Text("None of the segments can be spared: without any one of them the parameters would not be determined.")
        ]
    drawn = picture(
        lambda: pictures.influence(calibration),
        "Largest move of a parameter, in standard uncertainties, if a segment is left out.",
        f"Influence of each segment on the result. {words}",
    )
    return [Text(words), drawn]


def _table(checks: Sequence[Check], title: str) -> list[Block]:
    summed = _by_quantity(checks)
    if len(checks) > _ROWS:
        return [summed, Text(f"The {len(checks)} single residuals are not listed.", "note")]
    rows = []
    for c in checks:
        scale = scale_of(
            Value(name=c.what, value=c.residual, unit=c.unit, standard_uncertainty=c.standard_uncertainty),
            c.standard_uncertainty,
        )
        ratio = f"{c.z:.1f}".replace("-", "−") if math.isfinite(c.z) else "–"
        rows.append(
            (c.segment, c.what, scale.text(c.residual), scale.text(c.standard_uncertainty), scale.unit_text, ratio)
        )
    header = ("segment", "quantity", "residual", "u", "unit", "residual / u")
    return [summed, Grid(header, tuple(rows), "llrrlr", title, len(rows) > 40)]


def _by_quantity(checks: Sequence[Check]) -> Grid:
    rows = []
    for kind in dict.fromkeys(c.what for c in checks):
        here = [c for c in checks if c.what == kind]
        rms = math.sqrt(sum(c.residual**2 for c in here) / len(here))
        u = math.sqrt(sum(c.standard_uncertainty**2 for c in here) / len(here))
        scale = scale_of(Value(name=kind, value=rms, unit=here[0].unit, standard_uncertainty=u), u)
        rows.append((kind, scale.text(rms, 1), scale.text(u, 1), scale.unit_text, f"{len(here)}"))
    return Grid(("quantity", "rms", "u, rms", "unit", "number"), tuple(rows), "lrrlr", "By quantity")


def verification(context: Context) -> Section:
    """Before and after on a recording that the fit has not seen."""
    outcome, evidence = context.evidence.verification, context.evidence
    recording = evidence.check_recording
    if outcome is None or recording is None:
        text = "Not made. A recording that the fit has not seen (--check, with its plan: --check-plan) gives it."
        return Section("Verification", (Text(text, "missing"),))
    limit = "it passes while the probability of a larger chi-square is at least 1 %"
    blocks: list[Block] = [
        Text(
            f"The calibration was applied to the recording {_name(recording)}, which the fit has not seen, and "
            "compared with the known norms of gravity "
            f"and rate. All misfits together are judged by one chi-square; {limit}."
        ),
        Verdict(
            outcome.passed,
            f"Chi-square {outcome.chi2:.4g} for {outcome.degrees_of_freedom} degrees of freedom, probability "
            f"{percent(outcome.p_value)}.",
        ),
    ]
    if outcome.rotation_rms is not None:
        blocks.append(
            Text(f"Rotations between the attitudes close to {math.degrees(outcome.rotation_rms):.3g} deg rms.")
        )
    blocks.append(
        picture(
            lambda: pictures.before_after(
                pictures.comparison(context.calibration, recording, evidence.check_plan, evidence.earlier)
            ),
            "Misfit to the known input at each position, before and after compensation.",
            "Misfit at each position of the verification recording, before and after compensation",
        )
    )
    blocks += _table(outcome.checks, "Misfits after compensation")
    if outcome.remarks:
        blocks += [Text("Remarks:"), Bullets(outcome.remarks)]
    return Section("Verification", tuple(blocks))


def _name(recording: Recording) -> str:
    return recording.path.name if recording.path is not None else recording.name
