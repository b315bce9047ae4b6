"""Pictures of a registry: parameters over the years, drifts over a fleet, two calibrations side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DataError
from ..frames import Array
from ..registry.dates import YEAR
from ..registry.drift import course, infer
from ..registry.series import side_by_side, tells_drift
from ..registry.told import leaving_text, shown_in
from .pictures.bars import changes
from .pictures.groups import ordered
from .pictures.rows import Row, legend, table
from .shown import convert
from .style import (
    BAND,
    BLUE,
    GREY,
    ORANGE,
    SMALL,
    TALLEST,
    TEXT,
    TITLE,
    WIDTH,
    blank,
    clean,
    in_brackets,
    in_family,
    number,
    shortened,
    title,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..registry.compare import Comparison, Difference
    from ..registry.fleet import FleetParameter, FleetTrend, UnitTrend
    from ..registry.trend_records import ParameterTrend, Trend

MOST = 6
"""Parameters in one picture."""
_SHOWN = 60
"""Units of a fleet that are drawn, those nearest to their limits."""
_95 = (0.025, 0.5, 0.975)
_STEPS = 160
"""Points of a curve."""
_REACH = 2.5
"""Times the extent of the values at which a limit is still drawn."""


@in_family
def trend(found: Trend, names: Sequence[str] | None = None) -> Figure:
    """Parameters of a unit over time: calibrations, level with its 95 % band, limits, and when they are left.

    Parameters
    ----------
    found : Trend
    names : sequence of str, optional
        Which; left out: all, or where there are more the :data:`MOST` that leave their limits soonest, then those that drift
        most surely.

    Raises
    ------
    DataError
        When there is none of the names.
    """
    chosen = [p for p in found.parameters if names is None or p.name in names]
    if not chosen:
        raise DataError(f"there is no parameter to draw; there are {', '.join(p.name for p in found.parameters)}")
    some = sorted(chosen, key=_interest)[:MOST]
    some = [p for p in chosen if any(p is s for s in some)]
    height = min(1.75, (TALLEST - 0.8) / len(some))
    figure = blank(WIDTH, 0.8 + height * len(some))
    panels = figure.subplots(len(some), 1, sharex=True, squeeze=False)[:, 0]
    for axes, p in zip(panels, some, strict=True):
        _panel(axes, p, _end(found, some))
    unit = f"{found.model} {found.serial}".strip() or "unit"
    more = f", {len(some)} of {len(chosen)} parameters" if len(some) < len(chosen) else ""
    _one_legend(figure, panels, 3)
    figure.suptitle(
        f"{unit}: bars of 2 standard uncertainties, level with its 95 % band{more}", fontsize=TITLE, x=0.01, ha="left"
    )
    return figure


def _one_legend(figure: Figure, panels: Any, columns: int) -> None:
    """What the marks of all panels mean, each once, below them."""
    found: dict[str, Any] = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        found |= {words: handle for words, handle in zip(labels, handles, strict=True) if words not in found}
    figure.legend(
        list(found.values()), list(found), loc="outside lower left", ncols=columns, frameon=False, fontsize=SMALL
    )


def _interest(p: ParameterTrend) -> tuple[float, float]:
    """What is drawn first."""
    soon = np.inf
    if p.leaving is not None and p.leaving.date is not None:
        soon = float(_times([p.leaving.date])[0].astype(np.int64))
    sure = (
        0.0
        if p.drift is None or p.drift.standard_uncertainty == 0
        else abs(p.drift.value) / p.drift.standard_uncertainty
    )
    return soon, -sure


def _times(texts: Sequence[str]) -> Any:
    """Texts of ISO 8601 with their zone as datetime64[s] in UTC."""
    from datetime import datetime

    return np.array([int(datetime.fromisoformat(t).timestamp()) for t in texts], dtype="datetime64[s]")


def _end(found: Trend, some: Sequence[ParameterTrend]) -> float:
    """How far ahead is drawn, POSIX time [s]: as asked, and to departures that are not farther than the past is long."""
    first, last = (float(t.astype(np.int64)) for t in _times([found.calibrations[i].created for i in (0, -1)]))
    far = [float(_times([found.at])[0].astype(np.int64))]
    ahead = last + max(last - first, 2 * YEAR)
    for p in some:
        if p.leaving is not None:
            dates = [d for d in (p.leaving.date, p.leaving.latest) if d is not None]
            far += [float(t) for t in _times(dates).astype(np.int64)] if dates else []
    return max([far[0], *(1.02 * t - 0.02 * last for t in far if t <= ahead)])


def _panel(axes: Any, p: ParameterTrend, end: float) -> None:
    series = p.series()
    value, sigma = series.value, series.sigma
    unit = shown_in(float(np.max(np.abs(value))), _typical(sigma), p.unit)
    size = convert(1.0, p.unit, unit)
    at = series.time.astype(np.int64).astype("datetime64[s]")
    many = value.size > 60
    axes.errorbar(
        at,
        size * value,
        yerr=2 * size * sigma,
        fmt="o",
        ms=2.0 if many else 3.6,
        color="black",
        ecolor=GREY,
        elinewidth=0.5 if many else 0.9,
        capsize=0 if many else 2,
        zorder=4,
        label="calibrations",
    )
    extent = [*(size * (value - 2 * sigma)), *(size * (value + 2 * sigma))]
    if tells_drift(series):
        extent += _course(axes, p, end, size)
    for step in p.steps:
        between = _times([step.before.created, step.after.created]).astype(np.int64).mean()
        axes.axvline(np.datetime64(int(between), "s"), color=ORANGE, lw=0.9, ls=":", zorder=2)
        axes.text(
            np.datetime64(int(between), "s"),
            0.97,
            " step",
            transform=axes.get_xaxis_transform(),
            fontsize=SMALL,
            va="top",
        )
    said = _bounds(axes, p, size, (min(extent), max(extent)))
    words = p.name + (f"  —  {said}" if said else "")
    title(axes, words, TEXT)
    axes.set_ylabel(in_brackets(unit).strip() or "[1]")
    axes.margins(x=0.02)
    clean(axes)


def _typical(sigma: Array) -> float:
    known = sigma[sigma > 0]
    return float(np.median(known)) if known.size else 0.0


def _course(axes: Any, p: ParameterTrend, end: float, size: float) -> list[float]:
    """The level with its band, solid over the past and dashed ahead; returns the ordinates that it spans."""
    series = p.series()
    history = side_by_side([series])
    posterior = infer(history)
    first, last = float(series.time[0]), float(series.time[-1])
    past, ahead = np.linspace(first, last, _STEPS), np.linspace(last, max(end, last), _STEPS)
    time = np.concatenate([past, ahead])
    low, middle, high = size * course(history, posterior, time, _95)
    at = time.astype(np.int64).astype("datetime64[s]")
    axes.fill_between(at, low, high, color=BAND, ec="#9dbcd4", lw=0.5, zorder=1, label="95 % band of the level")
    axes.plot(at[:_STEPS], middle[:_STEPS], color=BLUE, lw=1.3, zorder=3, label="level")
    axes.plot(at[_STEPS:], middle[_STEPS:], color=BLUE, lw=1.3, ls=(0, (4, 2)), zorder=3, label="predicted")
    return [float(low.min()), float(high.max())]


def _bounds(axes: Any, p: ParameterTrend, size: float, extent: tuple[float, float]) -> str:
    """Limits where they are near enough, and when they are left; returns what is said of them in words."""
    low, high = extent
    margin = 0.06 * (high - low) or abs(high) or 1.0
    if p.limits is None:
        axes.set_ylim(low - margin, high + margin)
        return ""
    reach = _REACH * (high - low)
    drawn = []
    for bound in (p.limits.lower, p.limits.upper):
        if bound is not None and low - reach <= size * bound <= high + reach:
            axes.axhline(size * bound, color=ORANGE, lw=1.1, ls="--", zorder=2, label="limit")
            drawn.append(size * bound)
    bottom, top = min([low, *drawn]), max([high, *drawn])
    margin = 0.08 * (top - bottom) or margin
    axes.set_ylim(bottom - margin, top + margin)
    for bound, outer in ((p.limits.lower, bottom - margin), (p.limits.upper, top + margin)):
        if bound is not None and size * bound in drawn:
            axes.axhspan(size * bound, outer, facecolor="none", edgecolor="#e6b393", hatch="////", lw=0, zorder=0)
    if p.leaving is None:
        return ""
    _departure(axes, p, size)
    return f"limits left: {leaving_text(p.leaving)}"


def _departure(axes: Any, p: ParameterTrend, size: float) -> None:
    """A mark at the date at which a limit is left, with a bar over its 95 % interval."""
    if p.leaving is None or p.leaving.state != "leaves" or p.leaving.date is None or p.limits is None:
        return
    bound = p.limits.upper if p.leaving.bound == "upper" else p.limits.lower
    if bound is None:
        return
    date, first = _times([p.leaving.date, p.leaving.earliest or p.leaving.date])
    right = np.datetime64(round(86400 * axes.get_xlim()[1]), "s")  # of an axis of dates, in days
    if date > right:
        return
    last = min(_times([p.leaving.latest])[0], right) if p.leaving.latest else right
    axes.plot([first, last], [size * bound] * 2, color=ORANGE, lw=4, alpha=0.45, solid_capstyle="butt", zorder=4)
    mark = {"mfc": "white", "mec": ORANGE, "mew": 1.4, "ls": "", "label": "limit left: median, 95 % interval"}
    axes.plot([date], [size * bound], "D", ms=5, zorder=5, clip_on=False, **mark)


@in_family
def fleet(found: FleetTrend, names: Sequence[str] | None = None) -> Figure:
    """Drifts of the units of a model: one panel a parameter, a row a unit, those nearest to their limits on top.

    Parameters
    ----------
    found : FleetTrend
    names : sequence of str, optional
        Which; left out: all, or the first :data:`MOST`.

    Raises
    ------
    DataError
        When there is none.
    """
    some = [p for p in found.parameters if names is None or p.name in names][:MOST]
    if not some:
        raise DataError("no unit has three calibrations or more: there is no drift to draw")
    across = min(3, len(some))
    lines = -(-len(some) // across)
    rows = max(min(len(p.units), _SHOWN) for p in some)
    height = min(max(1.6, 0.75 + 0.135 * rows), (TALLEST - 0.75) / lines)
    figure = blank(WIDTH, 0.75 + height * lines)
    panels = figure.subplots(lines, across, squeeze=False).ravel()
    several = len({p.model for p in found.parameters}) > 1
    for axes, p in zip(panels, some, strict=False):
        words = f"{shortened(p.model, 12)} {p.name}" if several else p.name
        _drifts(axes, p, words, pitch=(height - 0.75) * 72 / rows)
    for axes in panels[len(some) :]:
        axes.set_visible(False)
    _one_legend(figure, panels, 5)
    figure.suptitle(
        f"{found.model}: drift a year with 2 standard uncertainties, units nearest to their limits on top",
        fontsize=TITLE,
        x=0.01,
        ha="left",
    )
    return figure


_MARKS = {
    "already outside": ("X", "outside its limits"),
    "leaves": ("D", "leaves them within 20 years"),
    "stays": ("o", "stays inside, or has none"),
}


def _drifts(axes: Any, p: FleetParameter, words: str, pitch: float) -> None:
    own = p.units[:_SHOWN]
    rate = YEAR * np.array([u.drift.value for u in own])
    sigma = YEAR * np.array([u.drift.standard_uncertainty for u in own])
    unit = shown_in(float(np.max(np.abs(rate))), _typical(sigma), p.unit)
    size = convert(1.0, p.unit, unit)
    y = np.arange(len(own))
    axes.errorbar(size * rate, y, xerr=2 * size * sigma, fmt="none", ecolor=GREY, elinewidth=0.9, zorder=2)
    for state, (marker, meaning) in _MARKS.items():
        at = np.array([_state(u) == state for u in own])
        if at.any():
            colours = {"mfc": BLUE, "mec": BLUE} if state == "stays" else {"mfc": "white", "mec": ORANGE}
            axes.plot(size * rate[at], y[at], marker, ms=4.2, ls="", zorder=3, label=meaning, **colours)
    if p.mean is not None and p.spread is not None:
        middle, wide = size * YEAR * p.mean, size * YEAR * p.spread
        axes.axvspan(middle - wide, middle + wide, color=BAND, zorder=0, label="spread over the units")
        axes.axvline(middle, color=BLUE, lw=0.9, zorder=1, label="mean")
    axes.axvline(0, color="black", lw=0.7, zorder=1)
    letters = min(SMALL, max(3.5, pitch * 0.85))
    step = max(1, int(np.ceil(letters / max(pitch, 0.1) / 1.15)))
    axes.set_yticks(y[::step], [shortened(u.serial, 12) for u in own[::step]], fontsize=letters)
    axes.set_ylim(len(own) - 0.4, -0.6)
    more = f", {len(own)} of {len(p.units)} units" if len(own) < len(p.units) else ""
    title(axes, words + more, TEXT)
    axes.set_xlabel(f"drift{in_brackets((unit or '1') + ' a year')}")
    axes.locator_params(axis="x", nbins=4)
    clean(axes)


def _state(unit: UnitTrend) -> str:
    return "stays" if unit.leaving is None else unit.leaving.state


@in_family
def comparison(found: Comparison) -> Figure:
    """Differences of two calibrations in units of their joint standard uncertainty.

    Parameters
    ----------
    found : Comparison
    """
    members = ordered([d.name for d in found.parameters])
    own = [found.parameters[m.index] for m in members]
    over = np.array([np.nan if d.normalised is None else d.normalised for d in own])
    rows = [Row(m.sensor, m.label + ("*" if d.converted else ""), _words(d)) for m, d in zip(members, own, strict=True)]
    heading = (
        f"from {found.before.source} ({found.before.created[:10]}) to {found.after.source} ({found.after.created[:10]})"
    )
    both = found.together
    if both is not None:
        heading += f": χ² = {both.chi2:.4g} for {both.degrees_of_freedom}"
    figure, axes, y = table(
        rows,
        heading,
        "difference over its standard uncertainty" + (", * converted first" if any(d.converted for d in own) else ""),
        "difference ± standard uncertainty",
    )
    changes(axes, np.array(y), over, within=2.0, farthest=6.0)
    legend(figure, axes, 3)
    return figure


def _words(d: Difference) -> str:
    unit = shown_in(max(abs(d.before), abs(d.after)), d.standard_uncertainty, d.unit)
    change, sigma, told = number(d.difference, d.standard_uncertainty, d.unit, unit)
    return f"{change} ± {sigma} {told}".rstrip()
