"""Where the uncertainty comes from, what was taken as exact, and which values were not measured."""

from __future__ import annotations

import math

from ...calibrate.budget import GRAVITY, HELD
from ...calibrate.roll_isolated import GYRO_SCALE
from ...calibration import BudgetLine, Calibration, Value
from ...units import parse
from .. import pictures
from ..document import Block, Bullets, Grid, Section, Text
from ..parts import picture
from ..shown import MINUS, Scale, quantity
from .conditions import tidy
from .context import Context
from .evidence import Evidence
from .methods import Input, by_hand, method_of

_NEGLIGIBLE = 1e-3
"""Share of a standard uncertainty that a line of the budget must have to be worth a number."""
_OPEN = 0.01
"""Share of a standard uncertainty that a budget may leave open before it is said."""
_HARDLY = 0.7
"""Part of the standard uncertainty beforehand above which a value counts as not measured."""
GIVEN, ASSUMED = "given", "assumed, not measured"
_NOT_COUNTED = "not counted"
"""In the name of a line of the budget that is no part of u."""
_KINDS = (
    ("white", "from noise and stated uncertainty"),
    ("cluster", "from the scatter of segments"),
    ("delete_one", "from leaving out a segment"),
)


def budget(context: Context) -> Section:
    """Where the uncertainty comes from: by source, or where there is no such account by its three evaluations."""
    calibration = context.calibration
    method = method_of(calibration)
    drawn = picture(
        lambda: pictures.budget(calibration),
        "Uncertainty budget." if calibration.budget else "Standard uncertainties by their evaluations.",
        "Bars of the parts of each parameter's standard uncertainty",
    )
    negligible: list[str] = []
    if calibration.budget:
        words = (
            "Contributions of the sources to the standard uncertainty u of each parameter. They are independent: u is the "
            "square root of the sum of their squares."
        )
        told = [line for line in calibration.budget if _counts(line, calibration)]
        header = tuple(line.source for line in told)
        columns = [line.standard_uncertainty for line in told]
        negligible = [line.source for line in calibration.budget if line not in told]
    else:
        there = [(label, getattr(calibration.fit, kind)) for kind, label in _KINDS]
        header = tuple(label for label, values in there if values is not None)
        columns = [values for _, values in there if values is not None]
        words = f"{method.budget} The standard uncertainty by its evaluations; the last column is the one that counts.".strip()
    rows = tuple(_row(p, context.scales[p.name], [c[i] for c in columns]) for i, p in enumerate(calibration.parameters))
    grid = Grid(
        ("parameter", "unit", *header, "u"), rows, "ll" + "r" * (len(header) + 1), "Uncertainty budget", len(header) > 5
    )
    blocks: list[Block] = [Text(words), grid]
    if negligible:
        blocks.append(Text(f"Less than a thousandth of every u comes from: {', '.join(negligible)}.", "note"))
    if calibration.budget and method.budget_note:
        blocks.append(Text(method.budget_note, "note"))
    left = _unexplained(calibration)
    if left:
        blocks.append(Text(left))
    return Section("Uncertainty budget", (*blocks, *_exact(context), drawn))


def _counts(line: BudgetLine, calibration: Calibration) -> bool:
    return any(
        part > _NEGLIGIBLE * p.standard_uncertainty
        for part, p in zip(line.standard_uncertainty, calibration.parameters, strict=True)
    )


def _row(p: Value, scale: Scale, parts: list[float]) -> tuple[str, ...]:
    u = p.standard_uncertainty
    return (
        p.name,
        scale.unit_text,
        *("–" if part <= _NEGLIGIBLE * u else scale.text(part, 1) for part in parts),
        scale.text(u, 1) if u > 0 else GIVEN,
    )


def _unexplained(calibration: Calibration) -> str:
    """A word on standard uncertainties that the columns do not come to."""
    lines = [b.standard_uncertainty for b in calibration.budget if _NOT_COUNTED not in b.source]
    evaluations = [v for kind, _ in _KINDS if (v := getattr(calibration.fit, kind)) is not None]
    off = []
    for i, p in enumerate(calibration.parameters):
        u = p.standard_uncertainty
        told = math.sqrt(sum(v[i] ** 2 for v in lines)) if lines else max((v[i] for v in evaluations), default=u)
        if u - told > _OPEN * u or (lines and told - u > _OPEN * u):
            off.append(p.name)
    if not off:
        return ""
    if lines:
        return f"The lines of the budget do not come to u for {', '.join(off)}; u is the one that counts."
    return f"For {', '.join(off)} u is larger than all evaluations: it holds also what was brought in from before."


def _exact(context: Context) -> list[Block]:
    """What was taken as exact for want of a stated uncertainty."""
    calibration, evidence = context.calibration, context.evidence
    items = tuple(_told(i, evidence) for i in method_of(calibration).exact if _is_exact(i, evidence))
    if not items:
        return []
    words = "Taken as exact, as no uncertainty of it was stated; an error of these is in the values and not in U:"
    return [Text(words), Bullets(items)]


def _rig(evidence: Evidence) -> dict[str, str]:
    if evidence.calibration.rig:
        return dict(evidence.calibration.rig)
    return evidence.plan.rig.texts() if evidence.plan is not None else {}


def _is_exact(given: Input, evidence: Evidence) -> bool:
    calibration, rig = evidence.calibration, _rig(evidence)
    if not any(p.name.startswith(given.of) for p in calibration.parameters):
        return False
    if given.when:
        return given.when in rig if given.when != "latitude" else calibration.site.latitude is not None
    if given.shows == "scale" and not calibration.unit.scale:
        return False
    if given.unless == "gravity_uncertainty":
        return not _gravity_uncertain(evidence)
    return given.unless not in rig


def _gravity_uncertain(evidence: Evidence) -> bool:
    """Whether the uncertainty of gravity was stated: by the plan, or as the budget shows where there is none."""
    if evidence.plan is not None and not by_hand(evidence.calibration):
        return evidence.plan.gravity_uncertainty > 0
    return any(line.source == GRAVITY for line in evidence.calibration.budget)


def _told(given: Input, evidence: Evidence) -> str:
    site, value = evidence.calibration.site, ""
    match given.shows:
        case "gravity":
            value = f"{site.gravity:.7g} m/s²" + (f" ({site.gravity_source})" if site.gravity_source else "")
        case "latitude" if site.latitude is not None:
            value = f"{math.degrees(site.latitude) + 0.0:.9g}°".replace("-", MINUS)
        case "scale":
            value = ", ".join(f"{k} {v}" for k, v in evidence.calibration.unit.scale.items())
        case key if key in _rig(evidence):
            value = tidy(_rig(evidence)[key])
    return f"{given.what}: {value}" if value else given.what


def standing(context: Context) -> dict[str, str]:
    """Parameters whose values were not measured, and what they are instead: :data:`GIVEN` or :data:`ASSUMED`.

    Given are those without uncertainty, assumed those of which hardly more is known than was stated beforehand.
    """
    calibration = context.calibration
    out = {}
    held = [line.standard_uncertainty for line in calibration.budget if line.source == HELD]
    for i, p in enumerate(calibration.parameters):
        u = p.standard_uncertainty
        if u == 0:
            out[p.name] = GIVEN
        elif u > _HARDLY * _beforehand(p.name, context.evidence) or any(v[i] > _HARDLY * u for v in held):
            out[p.name] = ASSUMED
    return out


def _beforehand(name: str, evidence: Evidence) -> float:
    """Standard uncertainty that the plan states of a parameter; infinite where it states none."""
    calibration, rig = evidence.calibration, _rig(evidence)
    if name in ("gyro.scale_error.y", "gyro.scale_error.z") and calibration.method == "roll-isolated":
        limit = evidence.plan.unit.limits.gyro_scale if evidence.plan is not None else None
        return GYRO_SCALE if limit is None else limit
    keys = {
        "rig.tilt.": "axis_uncertainty",
        "rig.nonperpendicularity.": "axis_uncertainty",
        "rig.zero.": "axis_uncertainty",
        "rig.encoder_eccentricity.": "encoder_uncertainty",
    }
    key = next((k for start, k in keys.items() if name.startswith(start)), "")
    return parse(rig[key], "angle", key) if key in rig else math.inf


def exactly(p: Value, scale: Scale) -> str:
    """A value that was given, in full."""
    return quantity(p.value * scale.size, "", 9)
