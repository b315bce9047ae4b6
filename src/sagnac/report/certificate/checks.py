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
from ..shown import Scale, moment, percent, plain_words, quantity, scales_of
from ..style import shown_unit
from .conditions import KEYS
from .context import Context

_ROWS = 60
"""Residuals that a table lists; of more, they are summed up by quantity, and the worst are listed."""
_WORST = 10


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
        reason = plain_words("; ".join(why), KEYS) or "the recording shows none"
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
    if not rows:
        return []
    blocks: list[Block] = [Grid(("residuals", "rms", "number"), tuple(rows), "lrr", "Residuals of the fit")]
    if "rotation" in fit.residuals:
        blocks.append(Text("Of the rotations from rest to rest the calibration keeps the rms alone.", "note"))
    return blocks


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
    scales = _scales(checks)
    blocks: list[Block] = [_by_quantity(checks, scales)]
    listed = list(checks)
    if len(checks) > _ROWS:
        listed = sorted(checks, key=lambda c: -abs(c.z))[:_WORST]
        title = f"{title}: the {_WORST} largest of {len(checks)}, over their standard uncertainties"
    rows = []
    for c in listed:
        scale = scales[c.what]
        ratio = f"{c.z:.1f}".replace("-", "" if abs(c.z) < 0.05 else "−") if math.isfinite(c.z) else "–"
        rows.append(
            (c.segment, c.what, scale.text(c.residual), scale.text(c.standard_uncertainty), scale.unit_text, ratio)
        )
    header = ("segment", "quantity", "residual", "u", "unit", "residual / u")
    blocks.append(Grid(header, tuple(rows), "llrrlr", title))
    if len(listed) < len(checks):
        rest = len(checks) - len(listed)
        blocks.append(
            Text(
                f"The other {rest} are left out here. They follow from the calibration, the recording and its plan, which are "
                "named with their SHA-256 under Software and data.",
                "note",
            )
        )
    return blocks


def _scales(checks: Sequence[Check]) -> dict[str, Scale]:
    """How each quantity is shown: one unit, and the digits of its smallest uncertainty."""
    least = [
        min((c for c in checks if c.what == kind), key=lambda c: c.standard_uncertainty) for kind in _kinds(checks)
    ]
    values = [Value(name=c.what, value=c.residual, unit=c.unit, standard_uncertainty=0.0) for c in least]
    return scales_of(values, [c.standard_uncertainty for c in least])


def _kinds(checks: Sequence[Check]) -> list[str]:
    return list(dict.fromkeys(c.what for c in checks))


def _by_quantity(checks: Sequence[Check], scales: dict[str, Scale]) -> Grid:
    rows = []
    for kind in _kinds(checks):
        here = [c for c in checks if c.what == kind]
        rms = math.sqrt(sum(c.residual**2 for c in here) / len(here))
        u = math.sqrt(sum(c.standard_uncertainty**2 for c in here) / len(here))
        scale = scales[kind]
        rows.append((kind, scale.text(rms, 1), scale.text(u, 1), scale.unit_text, f"{len(here)}"))
    return Grid(("quantity", "rms", "u, rms", "unit", "number"), tuple(rows), "lrrlr", "By quantity")


def verification(context: Context) -> Section:
    """Before and after on a recording that the fit has not seen."""
    outcome, evidence = context.evidence.verification, context.evidence
    recording = evidence.check_recording
    if outcome is None or recording is None:
        text = "Not made: no recording that the fit has not seen was given."
        return Section("Verification", (Text(text, "missing"),))
    hashed = any(s.role == "recording" and s.sha256 for s in context.calibration.source)
    seen = ", which the fit has not seen" if hashed else ""
    limit = "it passes while the probability of a larger chi-square is at least 1\N{NO-BREAK SPACE}%"
    blocks: list[Block] = [
        Text(
            f"The calibration was applied to the recording {_name(recording)}{seen}, and compared with what is known of its "
            f"inputs. All misfits together are judged by one chi-square; {limit}."
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
    if not hashed:
        text = "The calibration holds no SHA-256 of its own recording: that its fit has not seen this one could not be checked."
        blocks.append(Text(text, "warning"))
    blocks.append(
        picture(
            lambda: pictures.before_after(
                pictures.comparison(context.calibration, recording, evidence.check_plan, evidence.earlier)
            ),
            f"Misfit to the known input at each position, {_before(context)}.",
            f"Misfit at each position of the verification recording, {_before(context)}",
        )
    )
    blocks += _table(outcome.checks, "Misfits after compensation")
    if outcome.remarks:
        blocks += [Text("Remarks:"), Bullets(tuple(plain_words(r, KEYS) for r in outcome.remarks))]
    return Section("Verification", tuple(blocks))


def _before(context: Context) -> str:
    earlier = context.evidence.earlier
    if earlier is None:
        return "before and after compensation"
    return f"before with the calibration of {moment(earlier.created).partition(' ')[0]}, after with this one"


def _name(recording: Recording) -> str:
    return recording.path.name if recording.path is not None else recording.name
