"""What the commands of the registry print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..registry import Added, Bound, Entry, Listed, State

_DIGITS = 12
"""Of a hash."""


def columns(rows: Sequence[Sequence[str]], align: str) -> list[str]:
    """Rows as a list has them, see :func:`sagnac.registry.told.columns`."""
    from ..registry.told import columns

    return columns(rows, align, begin="", gap="  ")


def moment(at: datetime) -> str:
    """A time as the registry tells it: UTC, to the second."""
    return f"{at:%Y-%m-%d %H:%M:%S}"


def added_text(added: Sequence[Added]) -> list[str]:
    """What became of each file."""
    return [
        f"{one.file}: {'registered as' if one.new else 'already there as'} id:{one.entry.id}, {one.entry.unit}, "
        f"{moment(one.entry.created)} UTC"
        + ("" if one.same else " (another file of the same unit, date, method and values)")
        + _stated(one.entry)
        for one in added
    ]


def _stated(entry: Entry) -> str:
    """The date in the file, where it is not the one that counts."""
    if entry.stated is None or entry.stated == entry.created:
        return ""
    return f" (its file says {moment(entry.stated)} UTC)"


def units_text(found: Sequence[Listed], where: object) -> list[str]:
    """Units, one a line."""
    if not found:
        return [f"no calibrations of this kind in {where}"]
    head = ("model", "serial", "calibrations", "latest (UTC)", "method", "id", "limits")
    rows = [
        (
            f.unit.model,
            f.unit.serial,
            str(f.count),
            moment(f.latest.created),
            f.latest.method,
            f"id:{f.latest.id}",
            state_text(f.state),
        )
        for f in found
    ]
    total = sum(f.count for f in found)
    return [
        *columns([head, *rows], "llrllll"),
        "",
        f"{counted(len(found), 'unit')} with {counted(total, 'calibration')} in {where}",
    ]


def entries_text(found: Sequence[Entry], state: Mapping[int, State] | None = None) -> list[str]:
    """Calibrations, one a line; with what the limits make of them where that is given."""
    head = ("model", "serial", "id", "created (UTC)", "method", "software", "sha256")
    rows = [
        (
            e.unit.model,
            e.unit.serial,
            f"id:{e.id}",
            moment(e.created),
            e.method,
            e.software,
            e.sha256[:_DIGITS],
        )
        for e in found
    ]
    if state is None:
        return columns([head, *rows], "lllllll")
    judged = [(*row, state_text(state.get(e.id))) for row, e in zip(rows, found, strict=True)]
    return columns([(*head, "limits"), *judged], "llllllll")


def state_text(state: State | None) -> str:
    """``fail: accel.bias.x``, or ``undecided: accel.bias.x in another unit than its limit``."""
    if state is None or not state.word:
        return "-"
    if state.beyond:
        return f"{state.word}: {_first(state.beyond)}"
    return state.word + (f": {_first(state.unjudged)} in another unit than the limit" if state.unjudged else "")


def _first(names: Sequence[str]) -> str:
    return ", ".join(names[:2]) + (f" and {len(names) - 2} more" if len(names) > 2 else "")


def counted(number: int, what: str) -> str:
    """``1 unit``, ``2 units``."""
    return f"{number} {what}" + ("" if number == 1 else "s")


def shown_text(entry: Entry, where: object) -> list[str]:
    """Where a calibration stands in the registry."""
    return [
        f"id:{entry.id} of {where}",
        f"  made        {moment(entry.created)} UTC{_stated(entry)}",
        f"  registered  {moment(entry.added)} UTC",
        f"  sha256      {entry.sha256}",
        "",
    ]


def bounds_text(found: Sequence[Bound]) -> list[str]:
    """Limits in units of a datasheet, one a line."""
    head = ("model", "serial", "parameter", "lower", "upper", "unit", "rule", "from (UTC)", "specification")
    rows = []
    for b in found:
        lower, upper, unit = _bounds(b)
        rows.append(
            (
                b.model,
                b.serial or "all",
                b.key,
                lower,
                upper,
                unit,
                b.rule.partition(" ")[0],
                moment(b.valid_from),
                b.specification,
            )
        )
    return columns([head, *rows], "lllrrllll")


def _bounds(b: Bound) -> tuple[str, str, str]:
    import math

    from ..printed import printed
    from ..units import convert

    finite = [abs(v) for v in (b.lower, b.upper) if math.isfinite(v)]
    if not finite:
        return "none", "none", "-"
    unit = printed(max(finite), 0.0, b.unit)[2]
    size = 1.0 if unit == b.unit else convert(1.0, b.unit, unit)
    lower, upper = (f"{v * size:.6g}" if math.isfinite(v) else "-" for v in (b.lower, b.upper))
    return lower, upper, unit or "1"
