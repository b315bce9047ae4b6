"""Tables of what a campaign came to, for a person."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from . import grid
from .fleets import FleetSummary, reasons
from .sizes import shown_unit
from .summary import CHANCE, Judged, PointSummary, Squares, Summary
from .tally import NUMBER, general

FULL = 4
"""Points that are told in full when none is asked for; of more there is a line each."""
ANY = "CAMPAIGN.toml"
"""Stands for the campaign's file, where it is not known."""
_MOST = 30
"""Flags that are told one by one."""
_AXIS = 2
"""Letters that the last part of a name has where it is an axis, or two."""


def text(found: Summary | FleetSummary, point: int | None = None, source: str | Path = ANY) -> str:
    """The tables of a summary.

    Parameters
    ----------
    found : Summary or FleetSummary
    point : int, optional
        Tell this point of the grid in full, counted from zero.
    source : path
        The campaign's file, for the command that repeats a run.
    """
    if isinstance(found, FleetSummary):
        return _fleet(found)
    lines = [_head(found), ""]
    wanted = range(len(found.points)) if point is None else [point]
    if len(found.points) > FULL and point is None:
        lines += _brief(found)
    else:
        for number in wanted:
            lines += _point(found, number)
    lines += _refusals(found)
    lines += _notes(found, wanted)
    lines += _flag_lines(_gathered(found, wanted))
    return "\n".join([*lines, *_worst(found, source)]) + "\n"


def where(values: Mapping[str, Any]) -> str:
    """What a point differs in, in words."""
    return ", ".join(f"{k} = {grid.text(v)}" for k, v in values.items())


def unit_of(parameter: Judged) -> tuple[str, float]:
    """Unit in which the errors of a parameter have convenient numbers, and the factor to it from SI."""
    return shown_unit(parameter.bound or parameter.stated or parameter.rmse, parameter.unit)


def _head(found: Summary) -> str:
    runs = found.count // len(found.points)
    grid_ = f"{runs} runs at each of {len(found.points)} points" if len(found.points) > 1 else f"{runs} runs"
    state = "" if found.complete else f"; so far {found.done} of {found.count} are done"
    return f"{found.title}: {found.method}, {grid_}, seed {found.seed}{state}"


def _point(found: Summary, number: int) -> list[str]:
    point = found.points[number]
    lines = []
    if len(found.points) > 1:
        lines.append(f"point {number}: {where(point.values)}")
    if point.remark:
        lines.append(f"  no bound: {point.remark}")
    done = f"{point.runs} runs" + (f", {point.refused} refused" if point.refused else "")
    if point.nees is None:
        return [*lines, f"  {done}", ""]
    some = any(p.runs != point.good for p in point.parameters)
    lines += [f"  {done}; {_nees(point.nees)}", _HEADER + (f"{'found':>9}" if some else "")]
    return [*lines, *(_row(p, some) for p in point.parameters), ""]


def _nees(nees: Squares) -> str:
    if nees.remark:
        return f"NEES {nees.remark}"
    mark = "*" if nees.flags else ""
    return f"NEES {nees.mean:.4g}{mark}, expected {nees.expected:.4g} ({nees.band[0]:.4g} to {nees.band[1]:.4g})"


_HEADER = (
    f"  {'parameter':<26}{'bias':>9}{'RMSE':>10}{'stated':>10}{'bound':>10}  {'unit':<14}{'RMSE/bound (95 %)':<22}"
    f"{'coverage of 50 90 95 99 %':>26}"
)


def _row(p: Judged, found: bool) -> str:
    """One parameter, if need be with the number of runs that found it."""
    unit, size = unit_of(p)
    bound = "-" if p.bound is None else f"{p.bound * size:.3g}"
    ratio = "-"
    if p.ratio is not None and p.ratio_interval is not None:
        ratio = f"{p.ratio:.3f} ({p.ratio_interval[0]:.3f}-{p.ratio_interval[1]:.3f})"
    shares = "".join(f"{100 * c.share:6.1f}" for c in p.coverage) or "-"
    mark = "*" if p.flags else ""
    numbers = (
        f"{p.bias * size:>9.2g}{p.rmse * size:>10.3g}{f'{p.stated * size:.3g}' if p.stated else 'exact':>10}{bound:>10}"
    )
    return f"  {p.name:<26}{numbers}  {unit:<14}{ratio:<22}{shares:>26}{f'{p.runs:>9}' if found else ''}{mark}"


def _brief(found: Summary) -> list[str]:
    """One line a point."""
    lines = [f"  {'point':>5}  {'runs':>7}{'refused':>9}  {'RMSE/bound':<15}{'95 % hold':<15}{'NEES (band)':<26}"]
    for number, point in enumerate(found.points):
        lines.append(_brief_line(number, point))
    return [*lines, "  one point in full: --point N", ""]


def _brief_line(number: int, point: PointSummary) -> str:
    head = f"  {number:>5}  {point.runs:>7}{point.refused:>9}  "
    ratios = [p.ratio for p in point.parameters if p.ratio is not None]
    shares = [c.share for p in point.parameters for c in p.coverage if c.level == 0.95]
    ratio = f"{min(ratios):.3f}-{max(ratios):.3f}" if ratios else "-"
    share = f"{100 * min(shares):.1f}-{100 * max(shares):.1f} %" if shares else "-"
    nees = "-"
    if point.nees is not None and point.nees.remark:
        nees = "not judged"
    elif point.nees is not None:
        nees = f"{point.nees.mean:.4g} ({point.nees.band[0]:.4g}-{point.nees.band[1]:.4g})"
    mark = "*" if point.findings else ""
    return f"{head}{ratio:<15}{share:<15}{nees + mark:<26}{where(point.values)}"


def _refusals(found: Summary) -> list[str]:
    lines = [
        f"  {r.runs} runs{f' at point {r.point}' if len(found.points) > 1 else ''}, the first {r.first}: {r.reason}"
        for r in found.refusals[:_MOST]
    ]
    return ["refused:", *lines, ""] if lines else []


def _gathered(found: Summary, wanted: Sequence[int]) -> list[str]:
    """What is out of its band at some points: the same at several of them, or on several axes, is told once."""
    same: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for number in wanted:
        for name, told in found.points[number].findings:
            same.setdefault((name, _kind(told)), []).append((number, told))
    joined: dict[tuple[str, str, tuple[int, ...]], tuple[list[str], list[str]]] = {}
    for (name, kind), each in same.items():
        stem, _, leaf = name.rpartition(".")
        family, own = (stem, leaf) if stem and len(leaf) <= _AXIS else (name, "")
        names, texts = joined.setdefault((family, kind, tuple(n for n, _ in each)), ([], []))
        names.append(own)
        texts += [told for _, told in each]
    out = []
    for (family, _, numbers), (names, texts) in joined.items():
        told = _ranges(texts)
        who = ".".join(filter(None, (family, "/".join(names))))
        where_ = "" if len(found.points) == 1 else f"{_points(numbers)}: "
        out.append(f"{where_}{who}: {told}" if who else f"{where_}{told}")
    return out


def _kind(told: str) -> str:
    """What is the same of a flag at several points: all but its numbers, and the levels of intervals besides."""
    levels, intervals, rest = told.partition(" % intervals")
    return f"{levels}{intervals}{general(rest)}" if intervals else general(told)


def _ranges(texts: Sequence[str]) -> str:
    """Texts that differ in their numbers alone as one, with the least and the greatest of each."""
    numbers = iter(zip(*(NUMBER.findall(t) for t in texts), strict=True))

    def both(_: re.Match[str]) -> str:
        each = sorted(set(next(numbers)), key=float)
        return each[0] if len(each) == 1 else f"{each[0]} to {each[-1]}"

    return NUMBER.sub(both, texts[0])


def _notes(found: Summary, wanted: Sequence[int]) -> list[str]:
    """What a reader of the numbers has to know."""
    same: dict[str, list[int]] = {}
    for number in wanted:
        for note in found.points[number].notes:
            same.setdefault(note, []).append(number)
    lines = [note if len(each) == len(found.points) else f"{_points(each)}: {note}" for note, each in same.items()]
    return [*(f"note: {line}" for line in lines), ""] if lines else []


def _points(numbers: Sequence[int]) -> str:
    if len(numbers) == 1:
        return f"point {numbers[0]}"
    return f"points {', '.join(map(str, numbers[:8]))}{f' and {len(numbers) - 8} more' if len(numbers) > 8 else ''}"


def _flag_lines(flags: Sequence[str]) -> list[str]:
    if not flags:
        return ["nothing is out of its band"]
    more = [f"  and {len(flags) - _MOST} more"] if len(flags) > _MOST else []
    return [
        f"out of its band (*), which at a point happens by chance in {CHANCE:.1%} of the campaigns for each kind of check:",
        *(f"  {t}" for t in flags[:_MOST]),
        *more,
    ]


def _worst(found: Summary, source: str | Path) -> list[str]:
    if not found.worst:
        return []
    told = ", ".join(f"{w.run} ({w.nees:.3g} for {w.degrees_of_freedom})" for w in found.worst[:5])
    return [
        "",
        f"largest NEES: run {told}",
        f"  any of them again, with all its files: sagnac campaign run {shlex.quote(str(source))} --only RUN",
    ]


def _fleet(found: FleetSummary) -> str:
    state = "" if found.complete else f"; so far {found.done} of {found.count} are done"
    lines = [f"{found.title}: {found.method}, {found.count} recordings{state}", ""]
    if found.parameters:
        heads = f"{'mean':>12}{'spread':>11}{'stated':>11}{'least':>12}{'greatest':>12}  unit"
        lines += [f"  {'parameter':<28}{'units':>6}{heads}"]
        for p in found.parameters:
            unit, f = shown_unit(p.spread or p.stated, p.unit)
            spread = "-" if p.spread is None else f"{p.spread * f:.3g}"
            lines.append(
                f"  {p.name:<28}{p.units:>6}{p.mean * f:>12.4g}{spread:>11}{p.stated * f:>11.3g}"
                f"{p.least * f:>12.4g}{p.greatest * f:>12.4g}  {unit}"
            )
    refused = [
        f"  {', '.join(files[:5])}{f' and {len(files) - 5} more' if len(files) > 5 else ''}: {reason}"
        for reason, files in reasons(found).items()
    ]
    lines += ["", "refused:", *refused] if refused else []
    flags = found.flags
    lines += ["", "worth a look:", *(f"  {t}" for t in flags[:_MOST])] if flags else ["", "no unit stands out"]
    return "\n".join(lines) + "\n"
