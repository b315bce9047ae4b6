"""The whole log, each axis in its own strip, with the segments or static intervals that were used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import DataError, InputError
from ...frames import Array
from ...observe.static import THRESHOLD, static_intervals
from ...recording import SENSORS, Batch
from ..style import (
    BLUE,
    ORANGE,
    SMALL,
    STILL,
    TEXT,
    TITLE,
    TURNING,
    WIDTH,
    blank,
    clean,
    in_brackets,
    in_family,
    outlines,
    shortened,
    shown_unit,
)
from .bars import strongest_shifts
from .envelope import Envelope, Extremes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...calibration import Calibration
    from ...plan import Plan
    from ...recording import Recording

LONGEST = 4_000_000
"""Samples up to which a log without a plan is searched for static intervals; that takes all of it into memory."""
_ACROSS = 400
"""Stretches that a curve is drawn with."""
_STRIP, _AROUND = 0.62, 0.95  # in
_SHORT = {"temperature": "temp."}
_SI = {"accel": "m/s^2", "gyro": "rad/s"}


@dataclass(frozen=True)
class Span:
    """A stretch of the log that was used: name, from and to, s, and whether the unit turned."""

    name: str
    start: float
    stop: float
    turning: bool = False


@dataclass(frozen=True)
class Seen:
    """A log in one pass.

    Attributes
    ----------
    columns : tuple of (group, label, unit)
    extremes : Extremes
    samples : int
    whole : Batch or None
        All of it where it is short enough.
    """

    columns: tuple[tuple[str, str, str], ...]
    extremes: Extremes
    samples: int
    whole: Batch | None


def _columns(recording: Recording) -> list[tuple[str, str, str]]:
    """Group, label and SI unit of what is drawn."""
    out = []
    for sensor, axes in SENSORS.items():
        unit = "count" if sensor in recording.counts else _SI[sensor]
        out += [(sensor, a[-1], unit) for a in axes if sensor in recording.has or a in recording.single]
    if "temperature" in recording.rig:
        out.append(("temperature", "", "K"))
    return out


def _values(batch: Batch, columns: Sequence[tuple[str, str, str]]) -> Array:
    out = []
    for group, label, _ in columns:
        triad = getattr(batch, group, None)
        if group == "temperature":
            out.append(batch.rig["temperature"] - 273.15)
        elif triad is not None:
            out.append(triad[:, "xyz".index(label)])
        else:
            out.append(batch.single[f"{group}_{label}"])
    return np.column_stack(out)


def look(recording: Recording, *, keep: int = 0) -> Seen:
    """Extremes of every axis over time, in bounded memory.

    Parameters
    ----------
    recording : Recording
    keep : int
        Samples up to which the recording is kept as a whole.

    Raises
    ------
    InputError
        When it holds no sample, or one that cannot be read.
    """
    columns = _columns(recording)
    envelope = Envelope(len(columns))
    kept: list[Batch] | None = [] if keep else None
    samples = 0
    for batch in recording.batches():
        envelope.add(batch.time, _values(batch, columns))
        samples += batch.time.size
        if kept is not None:
            kept.append(batch)
            kept = kept if samples <= keep else None
    if samples == 0:
        raise InputError(f"{recording.name}: no samples")
    return Seen(tuple(columns), envelope.result(), samples, None if kept is None else _whole(kept))


def _whole(kept: list[Batch]) -> Batch:
    def joined(sensor: str) -> Array | None:
        parts = [getattr(b, sensor) for b in kept]
        return None if parts[0] is None else np.concatenate(parts)

    return Batch(1, np.concatenate([b.time for b in kept]), joined("accel"), joined("gyro"))


def spans_of_plan(plan: Plan) -> list[Span]:
    """Segments of a plan."""
    return [Span(s.name, s.start, s.stop, bool(s.turn_rate)) for s in plan.segment]


def static_spans(whole: Batch, threshold: float = THRESHOLD) -> list[Span]:
    """Static intervals of a log, named as a hand-turned calibration names them.

    Parameters
    ----------
    whole : Batch
    threshold : float
        See :func:`sagnac.observe.static.static_intervals`.
    """
    if whole.accel is None and whole.gyro is None:
        return []
    try:
        found = static_intervals(whole, threshold)
    except DataError:  # too short: there is a picture without them
        return []
    return [
        Span(str(i + 1), float(whole.time[a]), float(whole.time[b - 1]))
        for i, (a, b) in enumerate(zip(found.start, found.stop, strict=True))
    ]


@in_family
def log(
    recording: Recording,
    plan: Plan | None = None,
    calibration: Calibration | None = None,
    *,
    threshold: float = THRESHOLD,
) -> Figure:
    """The whole log with its segments, or without a plan with the static intervals that are in it.

    The log is read once, in bounded memory; static intervals are looked for up to :data:`LONGEST` samples.

    Parameters
    ----------
    recording : Recording
    plan : Plan, optional
    calibration : Calibration, optional
        Marks the segment that its result depends on most.
    threshold : float
        Of the static intervals.

    Raises
    ------
    InputError
        When the recording holds no sample, or one that cannot be read.
    """
    planned = plan is not None and bool(plan.segment)
    seen = look(recording, keep=0 if planned else LONGEST)
    if plan is not None and planned:
        spans = spans_of_plan(plan)
        what = f"{len(spans)} segment{'s' * (len(spans) > 1)} of the plan"
    elif seen.whole is not None:
        spans = static_spans(seen.whole, threshold)
        what = f"{len(spans) or 'no'} static interval{'s' * (len(spans) != 1)}"
    else:
        spans, what = [], f"too long to look for static intervals ({seen.samples} samples)"
    figure = blank(WIDTH, _AROUND + _STRIP * len(seen.columns))
    strips = np.atleast_1d(figure.subplots(len(seen.columns), 1, sharex=True))
    _strips(strips, seen)
    for axes in strips:
        _shade(axes, spans)
    marked = _marked(spans, calibration)
    _names(strips[0], spans, marked)
    strips[-1].set_xlabel("time [s]")
    _heading(figure, what, spans, marked)
    return figure


def _marked(spans: Sequence[Span], calibration: Calibration | None) -> str | None:
    """Name of the segment with most influence, where the calibration's segments are those of the log."""
    if calibration is None:
        return None
    shifts = {n: s for n, (s, _) in strongest_shifts(calibration).items() if s is not None}
    names = {s.name for s in spans}
    if not shifts or not set(shifts) <= names:
        return None
    return max(shifts, key=lambda n: shifts[n])


def _heading(figure: Figure, what: str, spans: Sequence[Span], marked: str | None) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    kinds = {s.turning for s in spans}
    words = {False: ("at rest", STILL), True: ("turning", TURNING)}
    handles: list[Any] = [
        Patch(facecolor=words[k][1], edgecolor="#999999", lw=0.4, label=words[k][0]) for k in sorted(kinds)
    ]
    if marked is not None:
        handles.append(Line2D([], [], ls="", marker="v", ms=4, color=ORANGE, label="influences the result most"))
    figure.suptitle(what, fontsize=TITLE, x=0.01, ha="left")
    if handles:
        figure.legend(
            handles=handles,
            loc="upper right",
            ncols=3,
            frameon=False,
            fontsize=TEXT - 1,
            borderpad=0,
            bbox_to_anchor=(1.0, 0.995),
        )


def _strips(strips: Any, seen: Seen) -> None:
    """Curves, each triad on one scale."""
    e = _coarse(seen.extremes)
    for group in dict.fromkeys(c[0] for c in seen.columns):
        at = [i for i, c in enumerate(seen.columns) if c[0] == group]
        unit, size = ("degC", 1.0) if group == "temperature" else _unit_of(seen, at)
        low, high = size * e.low[:, at].min(), size * e.high[:, at].max()
        together = high - low < 8 * max(float(np.max(e.high[:, i] - e.low[:, i], initial=0.0)) for i in at) * size
        for i in at:
            axes = strips[i]
            _curve(axes, e, i, size)
            if together and high > low:
                axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
            name = " ".join(seen.columns[i][:2]).strip()
            axes.set_ylabel(f"{_SHORT.get(name, name)}\n{in_brackets(unit).strip()}", fontsize=TEXT - 1)
            axes.locator_params(axis="y", nbins=3)
            axes.tick_params(axis="y", labelsize=SMALL)
            clean(axes)
    time = e.first[0], e.last[-1]
    margin = 0.005 * (time[1] - time[0]) or 1.0
    strips[0].set_xlim(time[0] - margin, time[1] + margin)


def _unit_of(seen: Seen, at: list[int]) -> tuple[str, float]:
    unit = seen.columns[at[0]][2]
    if unit == "count":
        return unit, 1.0
    if unit == "m/s^2":
        return unit, 1.0
    greatest = float(np.abs([seen.extremes.low[:, at], seen.extremes.high[:, at]]).max())
    return shown_unit(greatest, unit)


def _coarse(e: Extremes) -> Extremes:
    """As many stretches as a picture can show."""
    n = e.first.size
    size = -(-n // _ACROSS)
    if size < 2:
        return e
    edges = np.arange(0, n, size)
    ends = np.append(edges[1:], n) - 1
    return Extremes(e.first[edges], e.last[ends], np.minimum.reduceat(e.low, edges), np.maximum.reduceat(e.high, edges))


def _curve(axes: Any, e: Extremes, i: int, size: float) -> None:
    """All between least and greatest, so that every extreme is in sight; gaps are open."""
    time = (e.first + e.last) / 2
    low, high = size * e.low[:, i], size * e.high[:, i]
    jumps = e.first[1:] - e.last[:-1]
    usual = float(np.median(np.diff(time))) if jumps.size else 0.0
    holes = np.flatnonzero(jumps > 3.0 * max(usual, 1e-300)) + 1
    time, low, high = (np.insert(v, holes, np.nan) for v in (time, low, high))
    axes.fill_between(time, low, high, facecolor=BLUE, edgecolor=BLUE, lw=0.6, zorder=2)


def _shade(axes: Any, spans: Sequence[Span]) -> None:
    """All spans of a kind as one outline."""
    from matplotlib.patches import PathPatch

    for turning, colour in ((False, STILL), (True, TURNING)):
        own = np.array([(s.start, s.stop) for s in spans if s.turning == turning])
        if own.size:
            half = np.diff(own, axis=1)[:, 0] / 2
            path = outlines(own.mean(axis=1), np.full(len(own), 0.5), half, np.full(len(own), 0.5))
            axes.add_patch(
                PathPatch(path, facecolor=colour, edgecolor="none", transform=axes.get_xaxis_transform(), zorder=0)
            )


def _names(axes: Any, spans: Sequence[Span], marked: str | None) -> None:
    """Names above the first strip, as many as stand clear of one another; the marked one in any case."""
    if not spans:
        return
    begin, end = axes.get_xlim()
    inch = (WIDTH - 0.9) / (end - begin)
    names = [shortened(s.name, 14) for s in spans]
    middles = [inch * (s.start + s.stop) / 2 for s in spans]
    letter = 0.62 * SMALL / 72.0
    flat = all(
        b - a > letter * (len(m) + len(n)) / 2 + 0.04
        for a, b, m, n in zip(middles[:-1], middles[1:], names[:-1], names[1:], strict=True)
    )
    taken: list[float] = []
    first = sorted(range(len(spans)), key=lambda i: (spans[i].name != marked, i))
    for i in first:
        if not flat and any(abs(middles[i] - t) < 1.15 * SMALL / 72.0 for t in taken):
            continue
        taken.append(middles[i])
        axes.annotate(
            names[i] + (" ◂" if not flat else " ▾") * (spans[i].name == marked),
            ((spans[i].start + spans[i].stop) / 2, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 1.5),
            textcoords="offset points",
            rotation=0 if flat else 90,
            ha="center",
            va="bottom",
            fontsize=SMALL,
            fontweight="bold" if spans[i].name == marked else "normal",
            color=ORANGE if spans[i].name == marked else "black",
        )
