"""Uncertainty budget, values, influence of segments, and how a calibration differs from an earlier one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import DataError
from ...frames import Array
from ...registry.conventions import alike
from ..style import (
    BAND,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    SMALL,
    TALLEST,
    TEXT,
    TITLE,
    WIDTH,
    blank,
    clean,
    common_unit,
    in_brackets,
    in_family,
    names_below,
    number,
    outlines,
    shortened,
    shown_unit,
    title,
)
from .groups import Member, ordered
from .rows import Row, legend, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...calibration import Calibration

_FILLS = (
    (BLUE, ""),
    ("#ffffff", "////"),
    (SKY, "||||"),
    ("#f3c5a0", "xxxx"),
    ("#b8e0d2", "\\\\\\\\"),
    ("#f0e442", "----"),
    (GREY, ""),
)
"""Colours of the sources of a budget; hatches tell them apart in grey."""
_WAYS = (
    ("white", "from the noise", "o", BLUE),
    ("cluster", "from the scatter of whole segments", "s", ORANGE),
    ("delete_one", "leaving out one segment at a time", "^", GREEN),
)
_UNEXPLAINED = 0.01
"""Share of a variance from which it is shown that the budget leaves it open."""
_SEEN = 0.05
"""Percent of a variance from which a source is drawn."""
COVERAGE = 2.0
"""Standard uncertainties in a bar."""
_BARS = 2.4  # in, height of the bars of influence
_CLEAR = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
_FARTHEST = 3.0
"""E_n number up to which it is drawn to scale."""


def _rows(members: list[Member], words: list[str]) -> list[Row]:
    return [Row(m.sensor, m.label, text) for m, text in zip(members, words, strict=True)]


def _units(members: list[Member], values: Array, sigmas: Array, si_units: list[str]) -> list[str]:
    """Unit of each row, one for all of a term."""
    keys = [(m.sensor, m.term, u) for m, u in zip(members, si_units, strict=True)]
    found = {}
    for key in dict.fromkeys(keys):
        at = [i for i, k in enumerate(keys) if k == key]
        found[key] = common_unit(values[at], sigmas[at], key[2])
    return [found[k] for k in keys]


def _uncertainties(calibration: Calibration, members: list[Member]) -> list[str]:
    out = []
    own = [calibration.parameters[m.index] for m in members]
    sigmas = np.array([p.standard_uncertainty for p in own])
    units = _units(members, sigmas, sigmas, [p.unit for p in own])
    for p, shown in zip(own, units, strict=True):
        _, sigma, unit = number(p.standard_uncertainty, p.standard_uncertainty, p.unit, shown)
        out.append("given exactly" if p.standard_uncertainty == 0 else f"{sigma} {unit}".rstrip())
    return out


@in_family
def budget(calibration: Calibration) -> Figure:
    """What the uncertainty of each parameter is made of.

    With a budget: the share of each source in the variance. Without: the standard uncertainties that the noise, the scatter of
    whole segments and leaving out single segments give, over the one stated.

    Parameters
    ----------
    calibration : Calibration
    """
    members = ordered(list(calibration.values()))
    rows = _rows(members, _uncertainties(calibration, members))
    if calibration.budget:
        return _shares(calibration, members, rows)
    return _ways(calibration, members, rows)


def shares(calibration: Calibration) -> dict[str, Array]:
    """Share of each source of the budget in the variance of each parameter, shape (k,) each.

    What the budget leaves open is its own source; where the parts come to more than the whole, they are taken of their sum.

    Parameters
    ----------
    calibration : Calibration
    """
    whole = np.array([p.standard_uncertainty for p in calibration.parameters]) ** 2
    parts = {line.source: np.array(line.standard_uncertainty) ** 2 for line in calibration.budget}
    total = np.maximum(np.sum(list(parts.values()), axis=0), whole)
    out = {s: np.divide(v, total, out=np.zeros_like(v), where=total > 0) for s, v in parts.items()}
    left = np.where(whole > 0, 1.0 - np.sum(list(out.values()), axis=0), 0.0)
    if np.any(left > _UNEXPLAINED):
        out["not in the budget"] = np.maximum(left, 0.0)
    return out


def _shares(calibration: Calibration, members: list[Member], rows: list[Row]) -> Figure:
    from matplotlib.patches import PathPatch

    figure, axes, y = table(rows, "uncertainty budget", "share of the variance [%]", "standard uncertainty")
    order = [m.index for m in members]
    start = np.zeros(len(order))
    parts = shares(calibration)
    for k, (source, share) in enumerate(parts.items()):
        colour, hatch = _FILLS[k % len(_FILLS)]
        last = source == "not in the budget"
        wide = 100 * share[order]
        shown = wide > _SEEN
        half = np.full(int(shown.sum()), 0.33)
        bars = outlines((start + wide / 2)[shown], np.array(y)[shown], wide[shown] / 2, half)
        fill = {"facecolor": "#ffffff", "hatch": ""} if last else {"facecolor": colour, "hatch": hatch}
        axes.add_patch(PathPatch(bars, edgecolor="black", linewidth=0.4, label=source, **fill))
        start = start + wide
    axes.set_xlim(0, 100)
    legend(figure, axes, min(len(parts), 4))
    return figure


def _ways(calibration: Calibration, members: list[Member], rows: list[Row]) -> Figure:
    used = calibration.fit.uncertainty.rpartition(": ")[2]
    figure, axes, y = table(
        rows,
        f"standard uncertainty found in other ways, over the one stated ({used})",
        "over the standard uncertainty stated",
        "standard uncertainty",
    )
    order = [m.index for m in members]
    stated = np.array([calibration.parameters[i].standard_uncertainty for i in order])
    greatest = 1.0
    for shift, (kind, words, marker, colour) in zip((-0.2, 0.0, 0.2), _WAYS, strict=True):
        found = getattr(calibration.fit, kind)
        if found is None:
            continue
        ratio = np.divide(np.array(found)[order], stated, out=np.full(len(order), np.nan), where=stated > 0)
        greatest = max(greatest, float(np.nanmax(ratio, initial=1.0)))
        axes.plot(ratio, np.array(y) + shift, marker, ms=4.2, mfc="white", mec=colour, mew=1.0, ls="", label=words)
    axes.axvline(1.0, color=GREY, lw=0.9, zorder=0)
    axes.set_xlim(0, 1.08 * greatest)
    legend(figure, axes, 3)
    return figure


@in_family
def parameters(calibration: Calibration, *, k: float | Mapping[str, float] = COVERAGE) -> Figure:
    """Values with their expanded uncertainties, one panel a term of a sensor.

    Parameters
    ----------
    calibration : Calibration
    k : float or mapping of str to float
        Coverage factor, of all parameters or by name.
    """
    factors = _factors(calibration, k)
    members = ordered(list(calibration.values()))
    panels: dict[tuple[str, str], list[Member]] = {}
    for m in members:
        panels.setdefault((m.sensor, m.term), []).append(m)
    across = min(2, len(panels))
    lines = -(-len(panels) // across)
    tallest = [
        max(len(list(panels.values())[k]) for k in range(i * across, min((i + 1) * across, len(panels))))
        for i in range(lines)
    ]
    ratios = [0.55 + 0.16 * n for n in tallest]
    ratios = [r * min(1.0, (TALLEST - 0.35) / sum(ratios)) for r in ratios]
    figure = blank(WIDTH, 0.35 + sum(ratios))
    grid = figure.subplots(lines, across, squeeze=False, height_ratios=ratios).ravel()
    for axes, ((sensor, term), own) in zip(grid, panels.items(), strict=False):
        _values(axes, calibration, own, factors)
        title(axes, f"{sensor} {term.replace('_', ' ')}", TEXT)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    one = factors[0] if np.all(factors == factors[0]) else None
    bars = "the expanded uncertainty, each with its own k" if one is None else f"{one:.3g} standard uncertainties"
    figure.suptitle(f"values, bars of {bars}", fontsize=TITLE, x=0.01, ha="left")
    return figure


def _factors(calibration: Calibration, k: float | Mapping[str, float]) -> Array:
    """Coverage factors in the order of the parameters."""
    return np.array([k[p.name] if isinstance(k, Mapping) else k for p in calibration.parameters], dtype=np.float64)


def _values(axes: Any, calibration: Calibration, own: list[Member], factors: Array) -> None:
    several = [calibration.parameters[m.index] for m in own]
    value = np.array([p.value for p in several])
    sigma = np.array([p.standard_uncertainty for p in several])
    expanded = factors[[m.index for m in own]] * sigma
    unit, size = shown_unit(float(np.max([*np.abs(value), *sigma])), several[0].unit)
    y = np.arange(len(own))
    axes.errorbar(
        size * value,
        y,
        xerr=size * expanded,
        fmt="o",
        ms=3.5,
        color=BLUE,
        ecolor=BLUE,
        elinewidth=1.2,
        capsize=2.5,
    )
    axes.set_yticks(y, [m.label.rpartition(".")[2] for m in own], fontsize=TEXT - 1)
    for where, p, spread in zip(y, several, expanded, strict=True):
        v, s, told = number(p.value, float(spread), p.unit, unit if p.unit == several[0].unit else None)
        text = f"{v} {told}" if p.standard_uncertainty == 0 else f"{v} ± {s} {told}"
        axes.text(1.02, where, text, transform=axes.get_yaxis_transform(), fontsize=SMALL, va="center")
    axes.set_ylim(len(own) - 0.4, -0.6)
    axes.margins(x=0.12)
    axes.locator_params(axis="x", nbins=3)
    axes.set_xlabel(in_brackets(unit).strip() or "[1]", fontsize=TEXT - 1, labelpad=1)
    axes.tick_params(labelsize=SMALL)
    if size * value.min() < 0 < size * value.max():
        axes.axvline(0, color=GREY, lw=0.8)
    clean(axes)


def strongest_shifts(calibration: Calibration) -> dict[str, tuple[float | None, str]]:
    """How far leaving out each segment moves a parameter at most, in standard uncertainties, and which.

    A segment that several fits have used counts with the greatest shift of them; None where it cannot be left out.

    Parameters
    ----------
    calibration : Calibration
    """
    out: dict[str, tuple[float | None, str]] = {}
    for i in calibration.fit.influence:
        known = out.get(i.segment, (-1.0, ""))
        if known[0] is not None and (i.shift is None or i.shift > known[0]):
            out[i.segment] = (i.shift, i.parameter)
    return out


@in_family
def influence(calibration: Calibration) -> Figure:
    """How far leaving out each segment moves the parameter that it moves most, in standard uncertainties.

    Parameters
    ----------
    calibration : Calibration

    Raises
    ------
    DataError
        When the calibration does not tell, or no segment can be left out.
    """
    if not calibration.fit.influence:
        raise DataError("this calibration holds no influence of its segments (fit.influence)")
    worst = strongest_shifts(calibration)
    names = list(worst)
    shift = np.array([np.nan if s is None else s for s, _ in worst.values()])
    if np.all(np.isnan(shift)):
        raise DataError(f"{_undetermined(len(names))}: none can be left out, so that no influence is to be drawn")
    below = names_below(names, width=WIDTH - 0.7)
    figure = blank(WIDTH, _BARS + 0.6 + below.height)
    axes = figure.subplots()
    x = np.arange(len(names), dtype=np.float64)
    known = np.isfinite(shift)
    said = _told(x, shift, [parameter for _, parameter in worst.values()])
    top = max(1.0, *(height / (1.0 - _length(name) / _BARS) for _, height, name in said), 0.0) * 1.05
    axes.bar(x[known], shift[known], width=0.7, color=BLUE)
    axes.axhline(1.0, color=GREY, lw=0.8, ls="--")
    if not known.all():  # no shift, so no bar
        place = np.full(int((~known).sum()), 0.02)
        axes.plot(
            x[~known],
            place,
            "^",
            ms=5,
            mfc="white",
            mec=ORANGE,
            mew=1.1,
            ls="",
            clip_on=False,
            transform=axes.get_xaxis_transform(),
            label=_undetermined(int((~known).sum())),
        )
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", frameon=False)
    for at, height, name in said:
        axes.text(
            at,
            height + 0.015 * top,
            name,
            rotation=90,
            ha="center",
            va="bottom",
            fontsize=SMALL - 0.5,
            bbox=_CLEAR,
        )
    axes.set_ylim(0, top)
    axes.set_ylabel("shift [standard uncertainties]")
    below.write(axes)
    axes.set_xlabel(below.label)
    title(axes, "what leaving out one segment moves, and which parameter most")
    clean(axes)
    axes.grid(False, axis="x")
    return figure


def _undetermined(count: int) -> str:
    """What it means that segments cannot be left out."""
    which = "it" if count == 1 else f"any of these {count} segments"
    return f"without {which} the parameters would not be determined"


def _length(name: str) -> float:
    """Of a name over a bar, inches."""
    return 0.62 * (SMALL - 0.5) / 72.0 * len(name) + 0.1


def _told(x: Array, shift: Array, parameters_: list[str]) -> list[tuple[float, float, str]]:
    """Place, height and name of the highest bars that stand clear of one another."""
    out: list[tuple[float, float, str]] = []
    room = 0.17 / (WIDTH - 0.8) * (len(x) + 0.4)
    bars = [(float(a), float(h), shortened(n, 26)) for a, h, n in zip(x, shift, parameters_, strict=True)]
    for bar in sorted((b for b in bars if np.isfinite(b[1])), key=lambda b: -b[1])[:12]:
        if all(abs(bar[0] - other[0]) > room for other in out):
            out.append(bar)
    return out


@in_family
def as_found(
    earlier: Calibration,
    calibration: Calibration,
    *,
    k: tuple[float | Mapping[str, float], float | Mapping[str, float]] = (COVERAGE, COVERAGE),
) -> Figure:
    """How the unit has changed: differences from an earlier calibration over their joint expanded uncertainty.

    The number drawn is ``E_n = (x2 - x1) / sqrt(U1^2 + U2^2)``, U = k u, of two calibrations whose errors are independent
    (ISO 13528:2015, section 9.6): beyond 1 the unit has changed by more than the uncertainties allow.

    Parameters
    ----------
    earlier, calibration : Calibration
    k : pair of float or mapping of str to float
        Their coverage factors, of all parameters or by name.

    Raises
    ------
    DataError
        When they have no parameter in common.
    """
    same = alike(earlier, calibration).pairs()
    common = [new.name for _, new in same]
    if not common:
        raise DataError("the two calibrations have no parameter in common: there is nothing to compare")
    members = ordered(common)
    factors = [
        dict(zip(c.values(), _factors(c, f), strict=True)) for c, f in zip((earlier, calibration), k, strict=True)
    ]
    pairs = [same[m.index] for m in members]
    change = np.array([new.value - old.value for old, new in pairs])
    joint = np.array(
        [
            math.hypot(*(f[p.name] * p.standard_uncertainty for f, p in zip(factors, pair, strict=True)))
            for pair in pairs
        ]
    )
    si_units = [new.unit for _, new in pairs]
    words = []
    for c, u, si_unit, shown in zip(change, joint, si_units, _units(members, change, joint, si_units), strict=True):
        text, spread, unit = number(float(c), float(u), si_unit, shown)
        words.append(f"{text} ± {spread} {unit}".rstrip())
    numbers = np.divide(change, joint, out=np.full(change.size, np.nan), where=joint > 0)
    rows = [Row(m.sensor, m.label, text) for m, text in zip(members, words, strict=True)]
    figure, axes, y = table(
        rows, "change since the earlier calibration", "Eₙ: change over its expanded uncertainty", "change ± U"
    )
    changes(axes, np.array(y), numbers)
    legend(figure, axes, 3)
    return figure


def changes(axes: Any, y: Array, number_: Array, *, within: float = 1.0, farthest: float = _FARTHEST) -> None:
    """Marks of changes over their uncertainty, on the axes of :func:`.rows.table`.

    Parameters
    ----------
    axes : matplotlib Axes
    y, number_ : ndarray, shape (n,)
        Ordinates, and the changes; NaN where there is none.
    within : float
        Size up to which the uncertainty explains a change.
    farthest : float
        Size up to which it is drawn to scale.
    """
    axes.axvspan(-within, within, color=BAND, zorder=0)
    axes.axvline(0, color=GREY, lw=0.8)
    far = float(np.nanmax(np.abs(number_), initial=within))
    reach = min(1.15 * max(far, 1.3 * within), farthest * 1.15)
    inside = np.abs(number_) <= within
    beyond = (np.abs(number_) > within) & (np.abs(number_) <= farthest)
    axes.plot(number_[inside], y[inside], "o", ms=4.5, color=BLUE, label="within the uncertainty")
    for chosen, words in ((beyond, "more than the uncertainty allows"), (np.abs(number_) > farthest, "")):
        for at, where in zip(number_[chosen], y[chosen], strict=True):
            marker = "D" if words else (">" if at > 0 else "<")
            shown = float(np.clip(at, -1.07 * farthest, 1.07 * farthest))
            axes.plot(shown, where, marker, ms=5, mfc="white", mec=ORANGE, mew=1.3)
            if not words:
                side = -1 if at > 0 else 1
                axes.text(
                    shown + 0.04 * farthest * side,
                    where,
                    f"{at:.3g}".replace("-", "−"),
                    ha="right" if at > 0 else "left",
                    va="center",
                    fontsize=SMALL,
                )
    if np.any(np.abs(number_) > within):
        axes.plot([], [], "D", ms=5, mfc="white", mec=ORANGE, mew=1.3, label="more than the uncertainty allows")
    axes.set_xlim(-reach, reach)
