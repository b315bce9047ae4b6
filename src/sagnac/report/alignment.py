"""Pictures of an alignment: estimates with their bands, innovations, what was observed.

:data:`PICTURES` are those of a transfer alignment, :data:`COVARIANCE_PICTURES` those of a covariance analysis, by file name:
to be given to :func:`sagnac.align.transfer.transfer` and :func:`sagnac.align.transfer.covariance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..frames import Array
from .style import (
    BAND,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    TEXT,
    TITLE,
    WIDTH,
    End,
    blank,
    clean,
    end_labels,
    envelope,
    in_family,
    powers,
    save,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..align.history import Run
    from ..align.result import Alignment

_COLOURS = (BLUE, ORANGE, GREEN)
_AXES = ("x", "y", "z")
_STYLES = ("-", "--", ":", "-.", (0, (1, 3)), (0, (5, 1)))
_LINES = {"y": (0, (4, 2))}
"""Standard deviations of x and y often coincide."""
_HOUR = math.pi / 648000.0  # deg/h in rad/s
# prefix of the states, title, unit shown, its size in SI
_PANELS = (
    ("misalignment", "mounting of the slave against the master", "arcmin", math.pi / 10800.0),
    ("gyro.bias", "gyro biases", "deg/h", _HOUR),
    ("accel.bias", "accelerometer biases", "µg", 9.80665e-6),
    ("lever_arm", "lever arm from master to slave", "m", 1.0),
    ("flexure", "bending", "arcmin", math.pi / 10800.0),
    ("delay", "delay of the master", "ms", 1e-3),
)
_SHORT = {
    "misalignment": "mounting",
    "gyro.bias": "gyro bias",
    "accel.bias": "accelerometer bias",
    "lever_arm": "lever arm",
}
"""Titles of single panels."""
_SIGMAS = 3.0
_LEAST = 1e-3  # of the singular values that are drawn
_POINTS = 1500  # a band is thinned to


class Seen(Protocol):
    """What is drawn of an observability, see :class:`sagnac.align.observability.Observability`."""

    @property
    def names(self) -> tuple[str, ...]: ...  # noqa: D102 - told there
    @property
    def ratio(self) -> Array: ...  # noqa: D102
    @property
    def directions(self) -> Array: ...  # noqa: D102
    @property
    def times(self) -> Array: ...  # noqa: D102
    @property
    def over_time(self) -> Array: ...  # noqa: D102


class Course(Protocol):
    """What is drawn of an alignment: a :class:`sagnac.align.history.Run`, or what its files have kept of one."""

    @property
    def names(self) -> tuple[str, ...]: ...  # noqa: D102 - told there
    @property
    def time(self) -> Array: ...  # noqa: D102
    @property
    def values(self) -> Array: ...  # noqa: D102
    @property
    def sigmas(self) -> Array: ...  # noqa: D102
    @property
    def smoothed(self) -> Array | None: ...  # noqa: D102
    @property
    def innovation_names(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def innovations(self) -> Array: ...  # noqa: D102
    @property
    def innovation_sigmas(self) -> Array: ...  # noqa: D102
    @property
    def used(self) -> NDArray[np.bool_]: ...  # noqa: D102
    @property
    def nis(self) -> Array: ...  # noqa: D102
    @property
    def observability(self) -> Seen: ...  # noqa: D102


def _members(run: Course, prefix: str) -> list[int]:
    """States of a panel; the rate of a bending is not one of the bending."""
    return [i for i, n in enumerate(run.names) if n == prefix or n.startswith(f"{prefix}.")]


def _thin(count: int) -> Any:
    return np.unique(np.linspace(0, count - 1, min(count, _POINTS)).astype(int))


def _colour(name: str) -> str:
    axis = name.rpartition(".")[2]
    return _COLOURS[_AXES.index(axis)] if axis in _AXES else BLUE


def _clock(run: Course) -> tuple[Array, str]:
    """Times to draw over, and their label; long clocks are shown from the first update."""
    if run.time[0] > 10.0 * (run.time[-1] - run.time[0]):
        return run.time - run.time[0], f"time after {run.time[0]:.9g} s [s]"
    return run.time, "time [s]"


@in_family
def estimates_figure(run: Course) -> Figure:
    """Parameters over time with bands of three standard deviations; without data the standard deviations alone.

    Parameters
    ----------
    run : Course
    """
    panels = [(p, _members(run, p[0])) for p in _PANELS]
    panels = [(p, members) for p, members in panels if members]
    if not np.isfinite(run.values).any():
        return _deviations_figure(run, panels)
    figure = blank(WIDTH, 1.55 * len(panels) + 0.5)
    every = figure.subplots(len(panels), 3, sharex=True, squeeze=False)
    for row, ((_, title, unit, size), members) in zip(every, panels, strict=True):
        for axes, i in zip(row, members, strict=False):
            _estimate(axes, run, i, size)
            axes.set_title(_told(run, i, title, unit, size), fontsize=TEXT - 1, loc="left")
            clean(axes)
        for axes in row[len(members) :]:
            axes.set_visible(False)
        row[0].set_ylabel(f"[{unit}]")
    for column in every.T:
        shown = [axes for axes in column if axes.get_visible()]
        if shown:
            shown[-1].tick_params(labelbottom=True)
            shown[-1].set_xlabel(_clock(run)[1])
    smoothed = ", smoothed dashed" * (run.smoothed is not None)
    figure.suptitle(f"estimates, bands of {_SIGMAS:g} σ{smoothed}; last value ± 1 σ", fontsize=TITLE, x=0.01, ha="left")
    return figure


def _told(run: Course, i: int, title: str, unit: str, size: float) -> str:
    """Name of a panel with the last value."""
    value, sigma = run.values[-1, i] / size, run.sigmas[-1, i] / size
    digits = int(np.clip(1 - math.floor(math.log10(sigma)), 0, 7)) if sigma > 0 else 4
    name = run.names[i].rpartition(".")[2]
    what = _SHORT.get(run.names[i].removesuffix(f".{name}"), title)
    head = f"{what}, {name}" if name in _AXES else what
    return f"{head}\n{value:.{digits}f} ± {sigma:.{digits}f} {unit}".replace("-", "−")


def _deviations_figure(run: Course, panels: Sequence[tuple[tuple[str, str, str, float], list[int]]]) -> Figure:
    figure = blank(WIDTH, 2.1 * len(panels) + 0.4)
    every = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    ends = []
    for axes, ((_, title, unit, size), members) in zip(every, panels, strict=True):
        ends.append((axes, _deviations(axes, run, members, size)))
        axes.set_ylabel(f"1 σ [{unit}]")
        axes.set_title(f"{title}, standard deviation", fontsize=TITLE, loc="left")
        clean(axes)
    every[-1].set_xlabel(_clock(run)[1])
    end_labels(figure, ends)
    return figure


def _deviations(axes: Any, run: Course, members: Sequence[int], size: float) -> list[End]:
    """Curves of the standard deviations; returns their ends."""
    time, some = _clock(run)[0], _thin(run.time.size)
    for i in members:
        name = run.names[i].rpartition(".")[2]
        axes.semilogy(
            time[some], run.sigmas[some, i] / size, color=_colour(name), lw=1.4, ls=_LINES.get(name, "-"), label=name
        )
    _decade(axes)
    axes.set_xlim(time[0], time[-1])
    return [(run.sigmas[-1, i] / size, run.names[i], _colour(run.names[i])) for i in members]


def _estimate(axes: Any, run: Course, i: int, size: float) -> None:
    """A parameter with its band."""
    time, some = _clock(run)[0], _thin(run.time.size)
    value, reach = run.values[some, i] / size, _SIGMAS * run.sigmas[some, i] / size
    axes.fill_between(time[some], value - reach, value + reach, color=BAND, lw=0)
    for edge in (value - reach, value + reach):
        axes.plot(time[some], edge, color=BLUE, lw=0.5, alpha=0.6)
    axes.plot(time[some], value, color=BLUE, lw=1.2)
    if run.smoothed is not None:
        axes.plot(time[some], run.smoothed[some, i] / size, color=ORANGE, lw=1.0, ls="--")
    _focus(axes, run.values[:, i] / size, run.sigmas[:, i] / size)
    axes.locator_params(axis="both", nbins=4)


def _legend(axes: Any) -> None:
    """In one line above the panel, where no curve is."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.96), ncols=3, frameon=False)


def _decade(axes: Any) -> None:
    """A logarithmic axis of half a decade at least, with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.3 * high), 1.2 * high)
    decades = math.log10(axes.get_ylim()[1] / axes.get_ylim()[0])
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _focus(axes: Any, values: Array, sigmas: Array) -> None:
    """Show the whole way of the estimate, and of the first band as much as leaves the last one visible."""
    reach = max(_SIGMAS * float(sigmas[-1]), 0.3 * _SIGMAS * float(sigmas[0]))
    low = min(float(np.nanmin(values)), float(values[-1]) - reach)
    high = max(float(np.nanmax(values)), float(values[-1]) + reach)
    margin = 0.05 * (high - low) or 1.0
    axes.set_ylim(low - margin, high + margin)


@in_family
def innovations_figure(run: Course) -> Figure:
    """What each sample of the master differed by from its prediction, with bands, and the normalised squares.

    Parameters
    ----------
    run : Course
        With data.
    """
    names = run.innovation_names
    there = np.isfinite(run.nis)
    clock, label = _clock(run)
    time = clock[there]
    out = ~run.used[there]
    figure = blank(WIDTH, 1.5 * (len(names) + 1) + 0.4)
    panels = figure.subplots(len(names) + 1, 1, sharex=True)
    some = _thin(time.size)
    for i, (axes, name) in enumerate(zip(panels, names, strict=False)):
        unit, size = ("cm/s", 0.01) if name.startswith("velocity") else ("arcmin", math.pi / 10800.0)
        value, sigma = run.innovations[there, i] / size, run.innovation_sigmas[there, i] / size
        inside = ~out
        axes.plot(*envelope(time[inside], value[inside]), color=BLUE, lw=0.6)
        for sign in (-_SIGMAS, _SIGMAS):
            axes.plot(time[some], sign * sigma[some], color=ORANGE, lw=1.0)
        reach = 1.3 * _SIGMAS * float(np.median(sigma))
        if out.any():
            axes.plot(
                time[out], np.clip(value[out], -reach, reach), "x", color=GREY, ms=4, label="shut out by the gate"
            )
            _legend(axes)
        axes.set_ylim(-1.05 * reach, 1.05 * reach)
        axes.set_ylabel(f"[{unit}]")
        axes.set_title(f"innovation of {name.replace('.', ', ')}, band of 3 σ", fontsize=TITLE, loc="left")
        clean(axes)
    _squares(panels[-1], time, run.nis[there], len(names), out)
    panels[-1].set_xlabel(label)
    return figure


def _squares(axes: Any, time: Array, nis: Array, rows: int, out: Any) -> None:
    """Running mean of the normalised squares against the band where it should stay."""
    from scipy.stats import chi2

    kept = nis[~out]
    size = max(1, min(len(kept), len(kept) // 50 + 20))
    if len(kept) < size:
        return
    total = np.concatenate([[0.0], np.cumsum(kept)])
    mean = (total[size:] - total[:-size]) / size
    band = np.asarray(chi2.ppf([0.025, 0.975], rows * size)) / size
    axes.axhspan(band[0], band[1], color=BAND, zorder=0)
    axes.axhline(rows, color=GREY, lw=0.8)
    axes.plot(*envelope(time[~out][size - 1 :], mean), color=BLUE, lw=1.0)
    axes.set_ylim(0.0, max(2.0 * rows, 1.1 * float(mean.max())))
    axes.set_title(
        f"normalised innovations squared, mean of {size} updates, and its 95 % band", fontsize=TITLE, loc="left"
    )
    clean(axes)


@in_family
def observability_figure(run: Course) -> Figure:
    """How far the standard deviation of each parameter fell, and the singular values of the Gramian over time.

    Parameters
    ----------
    run : Course
        The singular values are drawn where it has them at several times.
    """
    seen = run.observability
    both = seen.times.size > 1
    figure = blank(WIDTH, 6.2 if both else 3.4)
    every = np.atleast_1d(figure.subplots(1 + both, 1, height_ratios=[1.25, 1.0][: 1 + both]))
    clock, label = _clock(run)
    ends = [(every[0], _fallen(every[0], run, clock))]
    if both:
        ends.append((every[1], _singular(every[1], run, clock)))
    every[-1].set_xlabel(label)
    for axes in every:
        clean(axes)
    end_labels(figure, ends)
    return figure


def _fallen(axes: Any, run: Course, clock: Array) -> list[End]:
    """Standard deviations over the initial ones; returns the ends of the curves."""
    some = _thin(clock.size)
    ratio = dict(zip(run.observability.names, run.observability.ratio, strict=True))
    ends = []
    for k, i in enumerate(i for p in _PANELS for i in _members(run, p[0]) if ratio[run.names[i]] > 0):
        name = run.names[i]
        first = run.sigmas[-1, i] / ratio[name]
        style = _STYLES[k // 3 % len(_STYLES)] if name.rpartition(".")[2] in _AXES else "-"
        axes.semilogy(clock[some], run.sigmas[some, i] / first, ls=style, color=_colour(name), lw=1.4, label=name)
        ends.append((run.sigmas[-1, i] / first, name, _colour(name)))
    axes.axhline(1.0, color=GREY, lw=0.8)
    axes.set_xlim(clock[0], clock[-1])
    powers(axes.yaxis)
    axes.set_ylabel("σ over the initial one")
    axes.set_title("what the data took away", fontsize=TITLE, loc="left")
    return ends


def _singular(axes: Any, run: Course, clock: Array) -> list[End]:
    """Square roots of the gains; returns their ends, with the states that each direction is made of there."""
    seen = run.observability
    values = np.sqrt(np.maximum(seen.over_time, _LEAST**2))
    axes.axhspan(0.1 * _LEAST, 1.0, color="#f6e6dc", zorder=0)
    lines = axes.semilogy(seen.times + clock[0] - run.time[0], values, lw=1.0)
    for k, line in enumerate(lines):
        line.set(color=_COLOURS[k % 3], linestyle=("-", "--", ":")[k // 3 % 3])
    axes.set_xlim(clock[0], clock[-1])
    axes.set_ylim(_LEAST, 3.0 * max(1.0, float(np.max(values, initial=1.0))))
    powers(axes.yaxis)
    axes.set_ylabel("singular value")
    axes.set_title("what was seen, and of which states it is made (shaded: not observed)", fontsize=TITLE, loc="left")
    return [
        (float(v), words, _COLOURS[k % 3])
        for k, (v, words) in enumerate(zip(values[-1], _directions(seen), strict=False))
        if v > 1.01 * _LEAST
    ]


def _directions(seen: Seen) -> list[str]:
    """The one or two states that each direction is mostly made of."""
    out = []
    for direction in seen.directions:
        strong = np.argsort(-np.abs(direction), kind="stable")[:2]
        kept = [i for i in strong if abs(direction[i]) > 0.6 * abs(direction[strong[0]])]
        out.append(", ".join(seen.names[i] for i in kept))
    return out


def draw_estimates(result: Alignment, run: Run, path: Path) -> None:  # noqa: ARG001 - all pictures are called alike
    """:func:`estimates_figure` to a file."""
    save(estimates_figure(run), path)


def draw_innovations(result: Alignment, run: Run, path: Path) -> None:  # noqa: ARG001 - all pictures are called alike
    """:func:`innovations_figure` to a file."""
    save(innovations_figure(run), path)


def draw_observability(result: Alignment, run: Run, path: Path) -> None:  # noqa: ARG001 - all pictures are called alike
    """:func:`observability_figure` to a file."""
    save(observability_figure(run), path)


COVARIANCE_PICTURES = {"estimates.png": draw_estimates, "observability.png": draw_observability}
PICTURES = {**COVARIANCE_PICTURES, "innovations.png": draw_innovations}
