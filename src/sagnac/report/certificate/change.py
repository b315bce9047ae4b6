"""What has changed: since the result as found at the same visit, and since an earlier calibration."""

from __future__ import annotations

import math

from ...calibration import Calibration
from ...coverage import cover
from ...registry.conventions import alike
from .. import pictures
from ..document import Block, Grid, Section, Text
from ..parts import picture
from ..shown import moment, scales_of
from .context import Context


def as_found(context: Context) -> Section | None:
    """The result of this visit before the adjustment, against this one."""
    before = context.evidence.as_found
    if before is None:
        return None
    words = f"As found: the calibration of {_day(before)} by {before.method}, before the item was adjusted. As left: this one."
    return _section(context, before, "As found, as left", words, ("as found", "as left"))


def since_earlier(context: Context) -> Section | None:
    """An earlier calibration of the unit against this one."""
    earlier = context.evidence.earlier
    if earlier is None:
        return None
    day = _day(earlier)
    words = f"Before: the calibration of {day} by {earlier.method}. Now: this one."
    return _section(context, earlier, f"Change since the calibration of {day}", words, ("before", "now"))


def _day(calibration: Calibration) -> str:
    return moment(calibration.created).partition(" ")[0]


def _section(context: Context, earlier: Calibration, title: str, words: str, columns: tuple[str, str]) -> Section:
    """Differences over their joint uncertainty.

    The normalised error is that of ISO 13528:2015 (9.7), ``Eₙ = (x - X) / sqrt(U_x² + U_X²)``.
    """
    calibration, before = context.calibration, cover(earlier, context.coverage.k)
    same = alike(earlier, calibration)
    pairs = same.pairs()
    left_out = [n for n in same.left_out if n in calibration.values()]
    joint = [math.hypot(context.expanded(p), before.expanded(old)) for old, p in pairs]
    scales = scales_of([p for _, p in pairs], joint)
    rows, beyond = [], []
    for (old, p), size in zip(pairs, joint, strict=True):
        difference, scale = p.value - old.value, scales[p.name]
        en = difference / size if size > 0 else math.nan
        if abs(en) > 1:
            beyond.append(p.name)
        numbers = tuple(scale.text(v) for v in (old.value, p.value, difference, size))
        rows.append(
            (p.name, *numbers, scale.unit_text, f"{en + 0.0:.2f}".replace("-", "−") if math.isfinite(en) else "–")
        )
    words += (
        " The difference is compared with the expanded uncertainties of both together, "
        f"Eₙ = ({columns[1]} − {columns[0]}) / √(U² + U²); beyond ±1 a difference is more than the uncertainties explain. What "
        "both calibrations share, as the gravity of the site, makes Eₙ smaller than it seems."
    )
    verdict = (
        f"All {len(rows)} common parameters agree within the expanded uncertainties."
        if not beyond
        else f"{len(beyond)} of {len(rows)} parameters have changed by more than the uncertainties explain: {', '.join(beyond)}."
    )
    blocks: list[Block] = [Text(words), Text(verdict), *_identity(calibration, earlier)]
    blocks += [
        Grid(("parameter", *columns, "difference", "its U", "unit", "Eₙ"), tuple(rows), "lrrrrlr", title),
        picture(
            lambda: pictures.as_found(earlier, calibration, k=(before.factors, context.coverage.factors)),
            f"Change of the common parameters, from {columns[0]} to {columns[1]}, as Eₙ.",
            "Change of each parameter over its joint expanded uncertainty",
        ),
    ]
    if same.converted:
        text = "; ".join(f"{name}: {how}" for name, how in same.converted.items())
        blocks.append(Text(f"Converted before they were compared: {text}.", "note"))
    if left_out:
        text = f"Not in the other calibration, or in another unit or convention there: {', '.join(left_out)}."
        blocks.append(Text(text, "note"))
    return Section(title, tuple(blocks))


def _identity(calibration: Calibration, earlier: Calibration) -> list[Block]:
    """A word where nothing says that both calibrations are of one unit."""
    which = [what for what, c in (("this", calibration), ("the other", earlier)) if not c.unit.serial.strip()]
    if not which:
        return []
    lack = "neither calibration names" if len(which) == 2 else f"{which[0]} calibration does not name"
    return [Text(f"That both are of the same unit is not known: {lack} a serial number.", "warning")]
