"""What each segment leaves over: residuals, and residuals before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import DataError
from ...frames import Array
from ...printed import probability
from ..style import (
    BAND,
    BLUE,
    GREY,
    ORANGE,
    TITLE,
    WIDTH,
    blank,
    clean,
    common_unit,
    in_brackets,
    in_family,
    names_below,
    number,
    powers,
    shown_unit,
    title,
)
from .comparison import Comparison, Pair
from .rows import Row, below_heading, legend, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...calibration import Calibration
    from ...verification import Check

_PANELS = 8
"""Quantities that get a panel each; more go into a list."""
_LISTED = 66
"""Rows of a list; of more, those that stand out most."""
_FEW = 4
"""Segments up to which quantities go into a list."""
_LEAST = 0.01
"""Standard uncertainties below which a residual on a logarithmic scale is only marked."""
_LOOKS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("s", {"mfc": "white", "mec": ORANGE, "mew": 1.0}),
    ("o", {"mfc": BLUE, "mec": BLUE}),
)
"""Before and after."""
_ALIKE = 0.2
"""Relative difference of expected chi-squares up to which one line stands for all."""
_WIDE = 50.0
"""Ratio of chi-squares from which they are drawn on a logarithmic scale."""
_PANEL, _AROUND = 1.15, 0.7  # in


@dataclass(frozen=True)
class _Quantity:
    """All checks of one quantity."""

    what: str
    unit: str
    at: list[int]
    """Places of the segments."""
    index: list[int]
    """Of the checks."""


def _quantities(whats: Sequence[tuple[str, str]], segments: Sequence[str]) -> tuple[list[_Quantity], list[str]]:
    """Checks by quantity, and the segments in order; one place may hold several components."""
    names = list(dict.fromkeys(segments))
    place = {n: i for i, n in enumerate(names)}
    out: dict[tuple[str, str], _Quantity] = {}
    for i, (key, segment) in enumerate(zip(whats, segments, strict=True)):
        q = out.setdefault(key, _Quantity(*key, [], []))
        q.at.append(place[segment])
        q.index.append(i)
    return list(out.values()), names


def _spread(at: list[int]) -> Array:
    """Abscissae at which several components of one segment stand beside each other."""
    x = np.array(at, dtype=np.float64)
    for place in np.unique(x):
        here = np.flatnonzero(x == place)
        x[here] += 0.3 * (np.arange(here.size) - (here.size - 1) / 2) / max(here.size - 1, 1)
    return x


def _panels(
    quantities: Sequence[_Quantity], names: Sequence[str], draw: Callable[[Any, _Quantity, Array], None]
) -> Figure:
    """One panel a quantity over its segments, which are named below the last panel that shows the same ones."""
    own = [sorted(set(q.at)) for q in quantities]
    below = [names_below([names[a] for a in at], width=WIDTH - 0.9) for at in own]
    last = [k + 1 == len(own) or own[k + 1] != at for k, at in enumerate(own)]
    room = [_PANEL + (0.0 if named else -0.15) for named in last]
    under = sum(b.height for b, named in zip(below, last, strict=True) if named)
    figure = blank(WIDTH, _AROUND + max(sum(room), 1.5 * _PANEL) + under)
    every = np.atleast_1d(figure.subplots(len(quantities), 1))
    for axes, q, at, names_, named in zip(every, quantities, own, below, last, strict=True):
        place = {a: i for i, a in enumerate(at)}
        draw(axes, q, _spread([place[a] for a in q.at]))
        names_.write(axes)
        if named:
            axes.set_xlabel(names_.label if names_.pattern or axes is every[-1] else "")
        else:
            axes.tick_params(labelbottom=False)
        clean(axes)
    return figure


def _uprights(axes: Any, x: Array, low: Array, high: Array, colour: str) -> None:
    """Vertical lines, as one curve with gaps."""
    gaps = np.full(x.size, np.nan)
    axes.plot(
        np.column_stack([x, x, gaps]).ravel(),
        np.column_stack([low, high, gaps]).ravel(),
        color=colour,
        lw=0.8,
        zorder=1.5,
        solid_capstyle="butt",
    )


def _listed(quantities: Sequence[_Quantity], names: Sequence[str]) -> bool:
    return len(quantities) > _PANELS or len(names) <= _FEW


@in_family
def residuals(calibration: Calibration, checks: Sequence[Check] | None = None) -> Figure:
    """What is left in each segment, by quantity, with bars of two standard uncertainties.

    Without `checks` the chi-square of each segment in the fit, over the average that is expected of one.

    Parameters
    ----------
    calibration : Calibration
    checks : sequence of Check, optional
        Of :func:`sagnac.verification.verify` on a recording, the fit's own for example.

    Raises
    ------
    DataError
        When there are neither checks nor what the fit found of its segments.
    """
    if not checks:
        return _of_fit(calibration)
    quantities, names = _quantities([(c.what, c.unit) for c in checks], [c.segment for c in checks])
    if _listed(quantities, names):
        return _list(checks)

    def draw(axes: Any, q: _Quantity, x: Array) -> None:
        own = [checks[i] for i in q.index]
        value = np.array([c.residual for c in own])
        sigma = np.array([c.standard_uncertainty for c in own])
        unit, size = shown_unit(float(np.median(sigma)) * 10, q.unit)
        axes.axhline(0, color=GREY, lw=0.8)
        out = np.abs(value) > 2 * sigma
        _uprights(axes, x, size * (value - 2 * sigma), size * (value + 2 * sigma), BLUE)
        for chosen, face in ((~out, BLUE), (out, "white")):
            axes.plot(x[chosen], size * value[chosen], "o", ms=3.6, mfc=face, mec=BLUE)
        rms, _, told = number(*_rms(value), q.unit, unit)
        title(axes, f"{q.what}: {rms} {told} rms" + _outside(int(out.sum()), len(own)))
        axes.set_ylabel(in_brackets(unit).strip())

    figure = _panels(quantities, names, draw)
    figure.suptitle("residuals with bars of 2 standard uncertainties", fontsize=TITLE, x=0.01, ha="left")
    return figure


def _rms(value: Array) -> tuple[float, float]:
    """Root mean square, and an uncertainty that gives it three digits."""
    rms = float(np.sqrt(np.mean(value**2)))
    return rms, rms / 12


def _outside(out: int, count: int) -> str:
    return f"; {out} of {count} beyond their bar (open)" if out else ""


def _largest(sizes: Sequence[float], segments: Sequence[str]) -> list[int]:
    """As many of the largest as a page has rows for, with a row for each segment, in their own order."""
    out: list[int] = []
    for i in sorted(range(len(sizes)), key=lambda i: -sizes[i]):
        if len(out) + 1 + 1.25 * len({segments[k] for k in (*out, i)}) > _LISTED:
            break
        out.append(i)
    return sorted(out)


def _named(segment: str) -> str:
    return f"segment {segment}" if segment[:1].isdigit() else segment


def _units(rows: Sequence[tuple[str, float, float]]) -> dict[str, str]:
    """One unit in print for each SI unit, from that, value and standard uncertainty of each row."""
    out = {}
    for si_unit in dict.fromkeys(r[0] for r in rows):
        own = np.array([r[1:] for r in rows if r[0] == si_unit])
        out[si_unit] = common_unit(own[:, 0], own[:, 1], si_unit)
    return out


def _list(checks: Sequence[Check]) -> Figure:
    """Few segments or many quantities: a row each, over its standard uncertainty."""
    own = [checks[i] for i in _largest([abs(c.z) for c in checks], [c.segment for c in checks])]
    order = {s: i for i, s in enumerate(dict.fromkeys(c.segment for c in own))}
    own.sort(key=lambda c: order[c.segment])
    units = _units([(c.unit, c.residual, c.standard_uncertainty) for c in own])
    rows = []
    for c in own:
        value, sigma, unit = number(c.residual, c.standard_uncertainty, c.unit, units[c.unit])
        rows.append(Row(_named(c.segment), c.what, f"{value} ± {sigma} {unit}".rstrip()))
    heading = "residuals over their standard uncertainties"
    heading += f", the largest {len(own)} of {len(checks)}" if len(own) < len(checks) else ""
    figure, axes, y = table(rows, heading, "residual / standard uncertainty", "residual ± standard unc.")
    z = np.array([c.z for c in own])
    reach = max(3.2, 1.08 * float(np.max(np.abs(z[np.isfinite(z)]), initial=0.0)))
    axes.axvspan(-2, 2, color=BAND, zorder=0)
    axes.axvline(0, color=GREY, lw=0.8)
    at = np.array(y)
    inside = np.abs(z) <= 2
    axes.plot(z[inside], at[inside], "o", ms=4, color=BLUE, label="within 2 standard uncertainties")
    if not inside.all():
        shown = np.clip(z[~inside], -reach, reach)
        axes.plot(shown, at[~inside], "D", ms=4.5, mfc="white", mec=ORANGE, mew=1.2, label="beyond")
    axes.set_xlim(-reach if z.min() < 0 else -0.4, reach)
    legend(figure, axes, 2)
    return figure


def chi_squares(calibration: Calibration) -> dict[str, float]:
    """Chi-square of each segment, of all fits that have used it.

    Parameters
    ----------
    calibration : Calibration
    """
    out: dict[str, float] = {}
    for i in calibration.fit.influence:
        out[i.segment] = out.get(i.segment, 0.0) + i.chi2
    return out


def expected_chi_squares(calibration: Calibration) -> dict[str, float]:
    """What the chi-square of each segment is expected to be, of all fits that have used it; nothing where that is not told.

    The expectation of a segment's sum of squared whitened residuals is the trace of ``I - H`` over its rows: their number less
    the leverage.

    Parameters
    ----------
    calibration : Calibration
    """
    out: dict[str, float] = {}
    for i in calibration.fit.influence:
        if i.rows is None:
            return {}
        out[i.segment] = out.get(i.segment, 0.0) + i.rows - i.leverage
    return out


def _of_fit(calibration: Calibration) -> Figure:
    found = chi_squares(calibration)
    if not found:
        raise DataError("this calibration holds no chi-square of its segments (fit.influence)")
    value = np.array(list(found.values()))
    own = np.array(list(expected_chi_squares(calibration).values()))
    expected = float(np.mean(own)) if own.size else calibration.fit.degrees_of_freedom / len(value)
    alike = own.size == 0 or bool(np.ptp(own) < _ALIKE * max(expected, 1e-12))
    below = names_below(list(found), width=WIDTH - 0.8)
    figure = blank(WIDTH, 2.7 + below.height)
    axes = figure.subplots()
    axes.bar(np.arange(len(value)), value, width=0.7, color=BLUE)
    look: dict[str, Any] = {"color": ORANGE, "lw": 1.2, "zorder": 3}
    if alike:
        words = f"expected of one on average: {expected:.3g} (degrees of freedom / segments)"
        axes.axhline(expected, ls="--", label=words, **look)
    else:
        at = np.arange(len(value))
        axes.hlines(own, at - 0.42, at + 0.42, label="expected of each (its readings less its leverage)", **look)
    highest = max(float(value.max()), float(own.max(initial=expected)), 1e-12)
    axes.set_ylabel("chi-square")
    axes.set_ylim(0, 1.25 * highest)
    if highest > _WIDE * max(float(value.min()), 1e-12) and not alike:
        axes.set_yscale("log")
        powers(axes.yaxis)
        axes.set_ylim(0.5 * max(float(min(value.min(), own.min())), 1e-3 * highest), 3.0 * highest)
    axes.legend(loc="upper right", frameon=False)
    below.write(axes)
    axes.set_xlabel(below.label)
    p = calibration.fit.p_value
    said = "" if p is None or calibration.fit.degrees_of_freedom == 0 else f", probability {probability(p)}"
    title(
        axes,
        f"chi-square of each segment; of the fit {calibration.fit.chi2:.4g} for {calibration.fit.degrees_of_freedom}{said}",
    )
    clean(axes)
    axes.grid(False, axis="x")
    return figure


@in_family
def before_after(comparison: Comparison) -> Figure:
    """Size of what is left in each segment before and after, on a logarithmic scale.

    Parameters
    ----------
    comparison : Comparison
    """
    pairs = comparison.pairs
    quantities, names = _quantities([(p.what, p.unit) for p in pairs], [p.segment for p in pairs])
    if _listed(quantities, names):
        return _list_before_after(comparison)

    def draw(axes: Any, q: _Quantity, x: Array) -> None:
        own = [pairs[i] for i in q.index]
        before, after = (np.array([getattr(p, k) for p in own]) for k in ("before", "after"))
        unit, size = shown_unit(float(np.median(np.abs(after))) + 1e-300, q.unit)
        least = _least(own)
        drawn = [size * np.maximum(np.abs(v), least) for v in (before, after)]
        below = [np.abs(v) < least for v in (before, after)]
        _uprights(axes, x, drawn[1], drawn[0], "#bbbbbb")
        for y, under, (marker, look) in zip(drawn, below, _LOOKS, strict=True):
            axes.semilogy(x[~under], y[~under], marker, ms=3.8, **look)
            axes.semilogy(x[under], y[under], "v", ms=4.6, **look)
        hidden.append(bool(np.any(below)))
        title(axes, _fall(q.what, before, after, q.unit, unit))
        axes.set_ylabel(f"|residual|{in_brackets(unit)}")
        powers(axes.yaxis)
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom / 1.3, max(top * 1.3, bottom * 20))

    hidden: list[bool] = []
    figure = _panels(quantities, names, draw)
    handles = _explained(comparison, below=any(hidden))
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), frameon=False)
    return figure


def _explained(comparison: Comparison, *, below: bool) -> list[Any]:
    """Marks of a legend."""
    from matplotlib.lines import Line2D

    words = (comparison.before, comparison.after)
    out = [Line2D([], [], ls="", marker=m, ms=4, label=w, **k) for w, (m, k) in zip(words, _LOOKS, strict=True)]
    if below:
        mark: dict[str, Any] = {"mfc": "white", "mec": GREY, "mew": 1.0}
        out.append(Line2D([], [], ls="", marker="v", ms=4.6, label="smaller than is drawn", **mark))
    return out


def _least(own: Sequence[Pair]) -> float:
    """A hundredth of the uncertainty, below which a residual that happens to be nothing is only marked."""
    sigma = [p.standard_uncertainty for p in own if p.standard_uncertainty > 0]
    return _LEAST * float(np.median(sigma)) if sigma else 1e-300


def _fall(what: str, before: Array, after: Array, si_unit: str, unit: str) -> str:
    first, _, unit_first = number(*_rms(before), si_unit, unit)
    last, _, unit_last = number(*_rms(after), si_unit, unit)
    return f"{what}: rms {first} {unit_first} → {last} {unit_last}".replace("  ", " ")


def _list_before_after(comparison: Comparison) -> Figure:
    every = comparison.pairs
    gain = [abs(p.before) / (p.standard_uncertainty or math.inf) for p in every]
    pairs = [every[i] for i in _largest(gain, [p.segment for p in every])]
    order = {s: i for i, s in enumerate(dict.fromkeys(p.segment for p in pairs))}
    pairs.sort(key=lambda p: order[p.segment])
    units = _units([(p.unit, p.after, p.standard_uncertainty) for p in pairs])
    rows = []
    for p in pairs:
        after, _, unit = number(p.after, p.standard_uncertainty, p.unit, units[p.unit])
        spread = max(p.standard_uncertainty, abs(p.before) / 30)
        before, _, unit_before = number(p.before, spread, p.unit, units[p.unit])
        rows.append(Row(_named(p.segment), p.what, f"{before} {unit_before} → {after} {unit}".replace("  ", " ")))
    figure, axes, y = table(
        rows,
        "before and after" + f", the largest {len(pairs)} of {len(every)}" * (len(pairs) < len(every)),
        "size of the residual / its standard uncertainty afterwards",
        "before → after",
    )
    sizes = [
        np.array([max(abs(getattr(p, k)), 1e-300) / (p.standard_uncertainty or math.nan) for p in pairs])
        for k in ("before", "after")
    ]
    drawn = [np.maximum(s, _LEAST) for s in sizes]
    below = [s < _LEAST for s in sizes]
    at = np.array(y)
    axes.set_xscale("log")
    powers(axes.xaxis)
    axes.axvspan(1e-3, 2, color=BAND, zorder=0)
    axes.hlines(y, drawn[1], drawn[0], color="#bbbbbb", lw=0.8, zorder=1)
    for x, under, (marker, look) in zip(drawn, below, _LOOKS, strict=True):
        axes.plot(x[~under], at[~under], marker, ms=4, **look)
        axes.plot(x[under], at[under], "<", ms=4.6, **look)
    ends = np.concatenate(drawn)
    axes.set_xlim(max(0.75 * float(np.nanmin(ends)), 0.75 * _LEAST), 1.6 * max(float(np.nanmax(ends)), 5.0))
    handles = _explained(comparison, below=bool(np.any(below)))
    for handle in handles[2:]:
        handle.set_marker("<")
    below_heading(figure, handles, 3)
    return figure
