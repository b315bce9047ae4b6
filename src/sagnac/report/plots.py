"""Pictures of the demo, and of the log that a calibration is from; :mod:`sagnac.report.pictures` has those of a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..frames import Array
from ..recording import SENSORS, Batch
from .style import BLUE, GREEN, GREY, ORANGE, blank, clean, envelope, in_family, powers, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..observe.static import StaticIntervals
    from ..plan import Plan
    from ..recording import Recording

__all__ = ["angle_error_figure", "demo_figure", "draw_log", "envelope", "intervals_figure", "save"]

_STYLE = {"norm": (BLUE, "o"), "multi-position": (ORANGE, "s"), "table": (GREEN, "^")}


@in_family
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
    figure = blank(10.0, 5.2)
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
    left.legend(loc="upper right", bbox_to_anchor=(1.0, -0.08), ncols=2, fontsize=8, frameon=False)
    left.set_title("one calibration against the truth", fontsize=10, loc="left")
    clean(left)
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
    powers(axes.yaxis)
    axes.minorticks_off()
    axes.set_xlabel("angle error of the table")
    axes.set_ylabel(label)
    axes.legend(fontsize=8, frameon=True)
    clean(axes)


@in_family
def angle_error_figure(angles: Array, panels: Sequence[tuple[str, Mapping[str, Array], Mapping[str, Array]]]) -> Figure:
    """Errors against the table's angle error, one panel a parameter.

    Parameters
    ----------
    angles : ndarray, shape (n,), rad
    panels : sequence of (label, ours, published)
        Curves by method, in the unit of the label.
    """
    figure = blank(5.0 * len(panels), 4.2)
    for axes, (label, ours, published) in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        _angle_panel(axes, angles, label, ours, published)
    return figure


@in_family
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
    figure = blank(11.0, 2.2 * (len(shown) + 1))
    panels = figure.subplots(len(shown) + 1, 1, sharex=True)
    for axes, sensor in zip(panels, shown, strict=False):
        for i, colour in enumerate((BLUE, ORANGE, GREEN)):
            axes.plot(*envelope(batch.time, getattr(batch, sensor)[:, i]), lw=0.7, color=colour, label="xyz"[i])
        axes.set_ylabel(f"{sensor} [{units[sensor]}]")
        axes.legend(loc="upper right", ncols=3, fontsize=8)
    last = panels[-1]
    last.semilogy(*envelope(batch.time, found.ratio), lw=0.7, color=GREY)
    powers(last.yaxis)
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
        clean(axes)
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
    from .pictures import log

    if plan is not None and plan.segment:
        save(log(recording, plan), path)
        return
    batch = recording.read()
    units = {s: "count" if s in recording.counts else u for s, u in (("accel", "m/s²"), ("gyro", "rad/s"))}
    found = static_intervals(batch, threshold or THRESHOLD)
    save(intervals_figure(batch, found, units, "static intervals"), path)
