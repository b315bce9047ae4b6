"""The pictures that an engineer looks for first. Every function returns a matplotlib figure; :func:`save` writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import write_atomically
from ..frames import Array
from ..recording import SENSORS, Batch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..observe.static import StaticIntervals
    from ..plan import Plan
    from ..recording import Recording

# readable in print and to the colour-blind (Okabe & Ito)
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
_STYLE = {"norm": (BLUE, "o"), "multi-position": (ORANGE, "s"), "table": (GREEN, "^")}
_DRAWN = 4000  # points a curve is thinned to, keeping the extremes of each stretch


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=120)


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, SVG or PDF by its ending, whole or not at all."""
    with write_atomically(path) as temporary:
        figure.savefig(temporary, format=Path(path).suffix.removeprefix(".") or "png")


def _clean(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def demo_figure(
    names: Sequence[str],
    errors: Mapping[str, Array],
    angles: Array,
    curves: Mapping[str, Array],
    published: Mapping[str, Array],
) -> Figure:
    """Errors of the demo's calibrations, and how they depend on the table's angle error.

    Parameters
    ----------
    names : sequence of str, length k
    errors : mapping of method to ndarray, shape (k,)
        Error over the standard uncertainty.
    angles : ndarray, shape (n,), rad
        Angle errors of the table.
    curves, published : mapping of method to ndarray, shape (n,)
        Size of the error of the accelerometer scale at each angle error: ours, and as published.
    """
    figure = _figure(10.0, 5.2)
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1.0])
    y = np.arange(len(names))[::-1]
    left.axvspan(-1, 1, color="#e8f1f8", zorder=0)
    left.axvline(0, color=GREY, linewidth=0.8)
    for shift, (method, values) in zip((0.16, -0.16), errors.items(), strict=False):
        colour, marker = _STYLE[method]
        left.errorbar(values, y + shift, xerr=1.0, fmt=marker, ms=4, lw=0.9, color=colour, label=method)
    left.set_yticks(y, names, fontsize=7)
    left.set_xlabel("error / standard uncertainty")
    left.set_xlim(-4, 4)
    left.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=8, frameon=False)
    left.set_title("one calibration against the truth", fontsize=10, loc="left")
    _clean(left)
    ppm = [{m: v * 1e6 for m, v in c.items()} for c in (curves, published)]
    _angle_panel(right, angles, "accelerometer scale error, rms [ppm]", ppm[0], ppm[1])
    right.set_title("trusting the norm, or the table's angles", fontsize=10, loc="left")
    return figure


def _angle_panel(
    axes: Any, angles: Array, label: str, ours: Mapping[str, Array], published: Mapping[str, Array]
) -> None:
    seconds = np.degrees(angles) * 3600
    for line, curves, suffix in (("-", ours, ""), (":", published, ", published")):
        for method, values in curves.items():
            colour, marker = _STYLE[method]
            face = "white" if suffix else colour
            axes.loglog(
                seconds, np.abs(values), line, marker=marker, ms=6, mfc=face, color=colour, label=method + suffix
            )
    axes.set_xticks([1, 60, 600, 3600, 36000], ['1"', "1'", "10'", "1°", "10°"])
    axes.minorticks_off()
    axes.set_xlabel("angle error of the table")
    axes.set_ylabel(label)
    axes.legend(fontsize=8, frameon=True)
    _clean(axes)


def angle_error_figure(angles: Array, panels: Sequence[tuple[str, Mapping[str, Array], Mapping[str, Array]]]) -> Figure:
    """Errors against the table's angle error, one panel a parameter.

    Parameters
    ----------
    angles : ndarray, shape (n,), rad
    panels : sequence of (label, ours, published)
        Curves by method, in the unit of the label.
    """
    figure = _figure(5.0 * len(panels), 4.2)
    for axes, (label, ours, published) in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        _angle_panel(axes, angles, label, ours, published)
    return figure


def envelope(time: Array, values: Array, points: int = _DRAWN) -> tuple[Array, Array]:
    """Thin a curve to its least and greatest value in each of `points` / 2 stretches.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
    points : int

    Returns
    -------
    time, values : ndarray, shape (m,)
        m is about `points`, or n when the curve is short already.
    """
    size = len(values) // (points // 2)
    if size < 2:
        return time, values
    count = len(values) // size
    blocks = values[: count * size].reshape(count, size)
    low, high = blocks.argmin(axis=1), blocks.argmax(axis=1)
    index = np.sort(np.column_stack([low, high]), axis=1) + np.arange(count)[:, None] * size
    rest = np.arange(count * size, len(values))
    chosen = np.concatenate([index.ravel(), rest])
    return time[chosen], values[chosen]


def intervals_figure(batch: Batch, found: StaticIntervals, units: Mapping[str, str], what: str) -> Figure:
    """Log of a hand-turned unit with its static intervals shaded, and the statistic that found them.

    Parameters
    ----------
    batch : Batch
    found : StaticIntervals
    units : mapping of sensor to unit, for the labels
    what : str
        Name of the shaded stretches.
    """
    shown = [s for s in SENSORS if getattr(batch, s) is not None]
    figure = _figure(11.0, 2.2 * (len(shown) + 1))
    panels = figure.subplots(len(shown) + 1, 1, sharex=True)
    for axes, sensor in zip(panels, shown, strict=False):
        for i, colour in enumerate((BLUE, ORANGE, GREEN)):
            axes.plot(*envelope(batch.time, getattr(batch, sensor)[:, i]), lw=0.7, color=colour, label="xyz"[i])
        axes.set_ylabel(f"{sensor} [{units[sensor]}]")
        axes.legend(loc="upper right", ncols=3, fontsize=8)
    last = panels[-1]
    last.semilogy(*envelope(batch.time, found.ratio), lw=0.7, color=GREY)
    last.axhline(found.threshold, color=ORANGE, lw=1.0)
    last.annotate(
        f"threshold {found.threshold:g}",
        (0.005, found.threshold),
        xycoords=("axes fraction", "data"),
        va="bottom",
        fontsize=8,
    )
    last.set_ylabel("variance ratio")
    last.set_xlabel("time [s]")
    for axes in panels:
        _clean(axes)
        for a, b in zip(found.start, found.stop, strict=True):
            axes.axvspan(batch.time[a], batch.time[b - 1], color="#cfe3d6", alpha=0.6, lw=0)
    panels[0].set_title(f"{len(found.start)} {what}", fontsize=10, loc="left")
    return figure


def draw_log(recording: Recording, plan: Plan | None, path: str | Path, threshold: float | None = None) -> None:
    """Draw a recording with the segments of its plan, or with the static intervals found without one.

    Parameters
    ----------
    recording : Recording
    plan : Plan, optional
    path : path
        PNG, SVG or PDF.
    threshold : float, optional
        See :func:`sagnac.observe.static.static_intervals`.
    """
    from ..observe.static import THRESHOLD, static_intervals

    batch = recording.read()
    found = static_intervals(batch, threshold or THRESHOLD)
    if plan is not None and plan.segment:
        start = np.searchsorted(batch.time, [s.start for s in plan.segment])
        stop = np.searchsorted(batch.time, [s.stop for s in plan.segment])
        found = replace(found, start=start, stop=stop)
    units = {s: "count" if s in recording.counts else u for s, u in (("accel", "m/s$^2$"), ("gyro", "rad/s"))}
    what = "segments of the plan" if plan is not None and plan.segment else "static intervals"
    save(intervals_figure(batch, found, units, what), path)
