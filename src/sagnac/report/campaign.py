"""Pictures of a campaign: errors against their bounds, coverage, NEES, and a fleet's parameters over its units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..campaign import grid
from ..campaign.fleets import FleetSummary, Spread
from ..campaign.show import where
from ..campaign.sizes import shown_unit
from ..campaign.summary import Judged, PointSummary, Squares, Summary
from ..campaign.tally import LEVELS
from ..errors import DataError, InputError
from ..frames import Array
from .style import (
    BAND,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    SMALL,
    TALLEST,
    WIDTH,
    blank,
    check_ending,
    clean,
    in_brackets,
    in_family,
    names_below,
    powers,
    pretty,
    save,
    shortened,
    title,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (BLUE, ORANGE, GREEN, SKY, GREY)
_MARKS = "os^vD"
_ROW = 0.19
"""Height of a parameter's row, inches."""
_MOST = 40
"""Parameters in one picture."""
_ALL = 3.5
"""Where a coverage of all runs is drawn: half-width of an interval in standard deviations."""
_LINES = 8
"""Pictures along one key, one for each combination of the other keys."""
_DECADES = 2e3
"""Ratio of values up to which a logarithmic axis has ticks within its decades."""
_WIDE = 3.0
"""RMSE over bound up to which the axis is linear."""


def draw(found: Summary | FleetSummary, target: str | Path, point: int = 0) -> list[Path]:
    """Draw what a campaign came to.

    Parameters
    ----------
    found : Summary or FleetSummary
    target : path
        A ``.png``, ``.svg`` or ``.pdf`` file for the one picture that tells most, or a folder for all of them.
    point : int
        Of the grid, for the pictures of a single one.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        When the file cannot be drawn, or nothing is done yet.
    """
    target = Path(target)
    if target.suffix and not target.is_dir():
        check_ending(target, "--plot")
        single = fleet(found) if isinstance(found, FleetSummary) else overview(found, point)
        save(single, target)
        return [target]
    if target.exists() and not target.is_dir():
        raise InputError(f"--plot {target}: is a file; name a folder, or a .png, .svg or .pdf file")
    pictures = _all(found)
    for name, figure in pictures.items():
        save(figure, target / f"{name}.png")
    return [target / f"{name}.png" for name in pictures]


def _all(found: Summary | FleetSummary) -> dict[str, Figure]:
    if isinstance(found, FleetSummary):
        return {"fleet": fleet(found)}
    done = [n for n, p in enumerate(found.points) if p.parameters]
    out = {f"point-{n}" if len(found.points) > 1 else "runs": overview(found, n) for n in done}
    for key in axes_of(found):
        for k, fixed in enumerate(others_of(found, key)[:_LINES]):
            out[f"along-{key.replace('.', '-')}{f'-{k + 1}' if k else ''}"] = along(found, key, fixed)
    if not out:
        raise DataError(f"{found.title}: no run is done yet that gave a result")
    return out


# ------------------------------------------------------------------------------------------------- one grid point


@in_family
def overview(found: Summary, point: int = 0) -> Figure:
    """RMSE over bound, coverage and NEES at one point of the grid.

    Parameters
    ----------
    found : Summary
    point : int
    """
    here = found.points[point]
    if not here.parameters:
        raise DataError(f"{found.title}: no run is done yet at point {point} that gave a result")
    shown = here.parameters[:_MOST]
    rows = min(0.9 + _ROW * len(shown), TALLEST - 2.6)
    figure = blank(WIDTH, rows + 2.4)
    parts: Any = figure.subfigures(2, 1, height_ratios=[rows, 2.2])
    top, bottom = parts
    left, right = top.subplots(1, 2, sharey=True, width_ratios=[1.0, 1.25])
    _ratios(left, shown)
    _coverages(right, shown)
    left.set_yticks(range(len(shown)), [shortened(p.name, 28) for p in shown])
    left.set_ylim(len(shown) - 0.4, -0.6)
    _squares(bottom.subplots(1, 1), here)
    told = f"{found.title}" + (f", {where(here.values)}" if here.values else "")
    state = "" if found.complete else f" (so far; {found.done} of {found.count} in all)"
    top.suptitle(
        f"{shortened(told, 95)}\n{here.runs} runs, {here.refused} refused{state}", fontsize=9, x=0.01, ha="left"
    )
    return figure


def _ratios(axes: Any, shown: Sequence[Judged]) -> None:
    """RMSE over bound, or over what is stated where there is no bound, each with its interval."""
    axes.axvline(1.0, color=GREY, lw=0.9)
    for y, p in enumerate(shown):
        if p.ratio is None or p.ratio_interval is None:
            continue
        low, high = p.ratio_interval
        colour, mark = (ORANGE, "D") if any("RMSE" in f for f in p.flags) else (BLUE, "o")
        axes.errorbar(
            p.ratio, y, xerr=[[p.ratio - low], [high - p.ratio]], fmt=mark, ms=3.2, lw=1.0, color=colour, capsize=0
        )
        if p.bound:
            axes.plot(p.stated / p.bound, y, "|", ms=7, mew=1.2, color=GREEN)
    reach = [p.ratio_interval[1] for p in shown if p.ratio_interval is not None]
    near = [p.ratio_interval[0] for p in shown if p.ratio_interval is not None]
    if max(reach, default=1.0) > _WIDE:
        axes.set_xscale("log")
        axes.set_xlim(min(0.8, 0.9 * min(near)), 1.1 * max(reach))
        _ticks(axes.xaxis, np.array(axes.get_xlim()))
    else:
        axes.set_xlim(min(0.85, *near, 1.0) - 0.03, max(1.15, *reach, 1.0) + 0.03)
    axes.set_xlabel("RMSE / bound, 95 % (◆ out of its band);   | stated")
    title(axes, "errors against the bound")
    clean(axes)


def _coverages(axes: Any, shown: Sequence[Judged]) -> None:
    """Shares of runs with the truth inside their intervals, on a scale where normal errors lie evenly."""
    from scipy.stats import norm

    def place(share: float) -> float:
        return float(min(norm.ppf(0.5 + 0.5 * min(share, 1.0 - 1e-12)), _ALL))

    for k, level in enumerate(LEVELS):
        colour = _COLOURS[k]
        axes.axvline(place(level), color=colour, lw=0.9, ls=":")
        axes.plot([], [], _MARKS[k], ms=3.2, color=colour, label=f"{level:.0%}")
        for y, p in enumerate(shown):
            if not p.coverage:  # stated as exact
                continue
            c = p.coverage[k]
            low, high = (place(v) for v in c.interval)
            axes.plot([low, high], [y, y], lw=1.0, color=colour, alpha=0.7)
            axes.plot(place(c.share), y, _MARKS[k], ms=3.2, color=colour)
    ticks = [place(level) for level in LEVELS]
    axes.set_xticks([*ticks, _ALL], [*(f"{level:.0%}" for level in LEVELS), "all"])
    axes.set_xlim(0.0, _ALL + 0.15)
    axes.set_xlabel("runs with the truth in their interval")
    axes.legend(
        ncols=len(LEVELS),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
        handletextpad=0.0,
        columnspacing=0.5,
        frameon=False,
    )
    title(axes, "coverage")
    clean(axes)


def _squares(axes: Any, here: PointSummary) -> None:
    """Histogram of NEES with the density that it should have."""
    nees = here.nees
    if nees is None:
        axes.set_axis_off()
        return
    _density(axes, nees)
    end = axes.get_xlim()[1]
    if not nees.remark:
        axes.axvspan(*nees.band, color=BAND, zorder=0, label="95 % band of the mean")
        told = f"mean {nees.mean:.3g}, expected {nees.expected:.3g}"
        if nees.mean < end:
            axes.axvline(nees.mean, color=ORANGE, lw=1.6, ls="--", label=told)
        else:  # an arrow at the edge
            axes.plot(
                0.99 * end, 0.0, ">", color=ORANGE, ms=6, clip_on=False, label=f"{told}: the mean lies beyond the axis"
            )
        axes.legend(loc="upper right")
    beyond = nees.histogram[-1]
    lie = "run lies" if beyond == 1 else "runs lie"
    axes.set_xlabel("NEES of a run" + (f"  ({beyond} {lie} beyond)" if beyond else ""))
    axes.set_ylabel("runs")
    title(axes, "normalised estimation error squared" + (f", {nees.remark}" if nees.remark else ""))
    clean(axes)


def _density(axes: Any, nees: Squares) -> None:
    from scipy.stats import chi2

    counts = np.array(nees.histogram[:-1])
    edges = nees.width * np.arange(counts.size + 1)
    axes.stairs(counts, edges, fill=True, color=SKY, alpha=0.6)
    axes.set_xlim(0.0, edges[-1])
    axes.set_ylim(0.0, 1.08 * max(1, counts.max()))
    if nees.remark:
        return
    x = np.linspace(0.0, edges[-1], 400)[1:]
    y = sum(n * nees.width * chi2.pdf(x, d) for d, n in nees.ranks.items() if d > 0)
    degrees = f", {', '.join(str(d) for d in nees.ranks)} degrees of freedom" if len(nees.ranks) < 4 else ""
    axes.plot(x, y, color=BLUE, lw=1.2, label=f"chi-square{degrees}")
    axes.set_ylim(0.0, 1.08 * max(1.0, counts.max(), float(np.max(y))))


# ------------------------------------------------------------------------------------------------- along the grid


def axes_of(found: Summary) -> list[str]:
    """Keys of the grid that take more than one value, among points with results."""
    done = [p for p in found.points if p.parameters]
    keys = dict.fromkeys(k for p in done for k in p.values)
    return [k for k in keys if len({grid.text(p.values.get(k)) for p in done}) > 1]


def others_of(found: Summary, key: str) -> list[dict[str, Any]]:
    """Combinations of the other keys' values, among points with results that have this one, in their order.

    Parameters
    ----------
    found : Summary
    key : str
        Of the grid.
    """
    out: dict[str, dict[str, Any]] = {}
    for p in found.points:
        if p.parameters and key in p.values:
            other = {k: v for k, v in p.values.items() if k != key}
            out.setdefault(where(other), other)
    return list(out.values())


@in_family
def along(found: Summary, key: str, fixed: Mapping[str, Any] | None = None) -> Figure:
    """RMSE with its interval, what is stated and the bound along one key of the grid, a panel for each kind of parameter.

    Parameters
    ----------
    found : Summary
    key : str
    fixed : mapping, optional
        Values of the other keys, see :func:`others_of`; those of the first point with results if left out.
    """
    other = dict(others_of(found, key)[0] if fixed is None else fixed)
    line = _line(found, key, other)
    texts = [grid.text(p.values[key]) for p in line]
    read = grid.numbers([p.values[key] for p in line])
    x = np.arange(len(line), dtype=float) if read is None else np.array(read[0])
    groups: dict[str, list[str]] = {}
    for p in line[0].parameters[:_MOST]:
        groups.setdefault(p.name.rpartition(".")[0] or p.name, []).append(p.name)
    columns = min(3, len(groups))
    rows = -(-len(groups) // columns)
    figure = blank(WIDTH if columns > 1 else 4.2, min(2.35 * rows + 0.6, TALLEST))
    panels = figure.subplots(rows, columns, squeeze=False)
    log = _spans_much(line, groups.values())
    for axes, (group, names) in zip(panels.flat, groups.items(), strict=False):
        _along_panel(axes, line, x, group, names, log)
        if read is None:
            axes.set_xticks(x, [shortened(t, 14) for t in texts], rotation=30, ha="right", fontsize=SMALL)
        elif x.min() > 0 and x.max() > 8 * x.min():
            axes.set_xscale("log")
            _ticks(axes.xaxis, x)
    for axes in panels.flat[len(groups) :]:
        axes.set_axis_off()
    unit = in_brackets(read[1]) if read is not None else ""
    figure.supxlabel(f"{key}{unit}", fontsize=8)
    told = f"{shortened(found.title, 45)}: RMSE (marks, 95 %), stated (dashed) and bound (lines)"
    told += f"\n{shortened(where(other), 110)}" if other else ""
    figure.suptitle(told, fontsize=9, x=0.01, ha="left")
    return figure


def _line(found: Summary, key: str, other: Mapping[str, Any]) -> list[PointSummary]:
    """Points with these values of the other keys."""
    done = [p for p in found.points if p.parameters and key in p.values]
    same = [p for p in done if where({k: v for k, v in p.values.items() if k != key}) == where(other)]
    read = grid.numbers([p.values[key] for p in same])
    order = range(len(same)) if read is None else np.argsort(read[0], kind="stable").tolist()
    return [same[i] for i in order]


def _spans_much(line: Sequence[PointSummary], groups: Iterable[Sequence[str]]) -> bool:
    """Whether some panel needs a logarithmic axis, and all can have one: they are alike, to be compared."""
    sizes = [np.array([p.rmse for point in line for p in point.parameters if p.name in names]) for names in groups]
    return all(s.min() > 0 for s in sizes) and any(s.max() > 8 * s.min() for s in sizes)


def _along_panel(
    axes: Any, line: Sequence[PointSummary], x: Array, group: str, names: Sequence[str], log: bool
) -> None:
    """One kind of parameter."""
    every = [{p.name: p for p in point.parameters} for point in line]
    first = next(e[names[0]] for e in every if names[0] in e)
    sizes = [e[n].rmse for e in every for n in names if n in e]
    unit, f = shown_unit(float(np.median(sizes)), first.unit)
    for k, name in enumerate(names):
        colour, mark = _COLOURS[k % len(_COLOURS)], _MARKS[k % len(_MARKS)]
        at = [i for i, e in enumerate(every) if name in e]
        own = [every[i][name] for i in at]
        rmse = f * np.array([p.rmse for p in own])
        spread = [_bars(p, f) for p in own]
        label = name.rpartition(".")[2] if len(names) > 1 else None
        axes.errorbar(x[at], rmse, yerr=np.array(spread).T, fmt=mark, ms=3.5, lw=0.9, color=colour, label=label)
        bounds = [np.nan if p.bound is None else f * p.bound for p in own]
        axes.plot(x[at], bounds, lw=1.0, color=colour, alpha=0.8)
        stated = [f * p.stated if p.stated else np.nan for p in own]
        axes.plot(x[at], stated, lw=0.9, ls="--", color=colour, alpha=0.8)
    if log:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        _ticks(axes.yaxis, np.array([low, high]))
    else:
        axes.set_ylim(bottom=0.0)
    if len(names) > 1:
        axes.legend(ncols=3 if len(names) > 3 else 1, fontsize=SMALL, loc="best", handletextpad=0.2, columnspacing=0.6)
    title(axes, f"{group}{in_brackets(unit)}", 8)
    clean(axes)


def _ticks(axis: Any, values: Array) -> None:
    """Ticks of a logarithmic axis: 1, 2, 5, 10 over a few decades, powers of ten over more."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if values.max() > _DECADES * values.min():
        powers(axis)
        return
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())


def _bars(p: Judged, f: float) -> tuple[float, float]:
    """Lengths of the bars below and above an RMSE."""
    from ..campaign.summary import CONFIDENCE, ratio_interval

    low, high = ratio_interval(p.rmse, p.runs, CONFIDENCE)
    return f * (p.rmse - low), f * (high - p.rmse)


# ------------------------------------------------------------------------------------------------------ the fleet


@in_family
def fleet(found: FleetSummary) -> Figure:
    """Each parameter over the units of a fleet, with their standard uncertainties.

    Parameters
    ----------
    found : FleetSummary

    Raises
    ------
    DataError
        When no recording has been calibrated yet.
    """
    shown = found.parameters[:_MOST]
    if not shown:
        raise DataError(f"{found.title}: no recording has been calibrated yet")
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    below = names_below([u.serial for u in found.units], width=(WIDTH - 0.5 * columns) / columns, most=14)
    figure = blank(WIDTH, max(min(1.35 * rows + 0.7, 1.6 * TALLEST), 2.4) + below.height)
    panels = figure.subplots(rows, columns, squeeze=False)
    place = {u.run: i for i, u in enumerate(found.units)}
    for k, (axes, p) in enumerate(zip(panels.flat, shown, strict=False)):
        _fleet_panel(axes, p, place, [place[u.run] for u in found.refused])
        below.write(axes)
        if k + columns < len(shown):  # names stand below the lowest panel of each column
            axes.tick_params(labelbottom=False)
    for axes in panels.flat[len(shown) :]:
        axes.set_axis_off()
    state = "" if found.complete else f" (so far; {found.done} of {found.count})"
    odd = "; orange: some unit stands out" if any(p.flags for p in shown) else ""
    told = f"{found.title}: {len(found.units) - len(found.refused)} units{state}, standard uncertainties, spread shaded{odd}"
    figure.suptitle(shortened(told, 100), fontsize=9, x=0.01, ha="left")
    own = f"unit ({below.pattern})" if below.pattern else "unit"
    figure.supxlabel(f"{own};   ×: refused" if found.refused else own, fontsize=8)
    return figure


def _fleet_panel(axes: Any, p: Spread, place: Mapping[int, int], refused: Sequence[int]) -> None:
    """One parameter, each unit at its place."""
    unit, f = shown_unit(p.spread or p.stated, p.unit)
    values, sigmas = f * np.array(p.values), f * np.array(p.uncertainties)
    if p.spread is not None:
        axes.axhspan(f * (p.mean - p.spread), f * (p.mean + p.spread), color=BAND, zorder=0)
    axes.axhline(f * p.mean, color=GREY, lw=0.8)
    axes.errorbar(
        [place[r] for r in p.runs], values, yerr=sigmas, fmt="o", ms=2.6, lw=0.8, color=ORANGE if p.flags else BLUE
    )
    title(axes, f"{p.name}{in_brackets(pretty(unit))}", 7.5)
    axes.plot(refused, [0.06] * len(refused), "x", ms=4, color=GREY, transform=axes.get_xaxis_transform())
    clean(axes)
