"""Pictures of an alignment: estimates with their bands, innovations, what was observed.

:data:`PICTURES` are those of a transfer alignment, :data:`COVARIANCE_PICTURES` those of a covariance analysis, by file name:
to be given to :func:`sagnac.align.transfer.transfer` and :func:`sagnac.align.transfer.covariance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..frames import Array
from .plots import BLUE, GREEN, GREY, ORANGE, _clean, _figure, envelope, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..align.history import Run
    from ..align.result import Alignment

_COLOURS = (BLUE, ORANGE, GREEN)
_AXES = ("x", "y", "z")
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
_SIGMAS = 3.0
_LEAST = 1e-3  # of the singular values that are drawn
_POINTS = 1500  # a band is thinned to


def _members(run: Run, prefix: str) -> list[int]:
    """States of a panel; the rate of a bending is not one of the bending."""
    return [i for i, n in enumerate(run.names) if n == prefix or n.startswith(f"{prefix}.")]


def _thin(count: int) -> Any:
    return np.unique(np.linspace(0, count - 1, min(count, _POINTS)).astype(int))


def _colour(name: str) -> str:
    axis = name.rpartition(".")[2]
    return _COLOURS[_AXES.index(axis)] if axis in _AXES else BLUE


def _clock(run: Run) -> tuple[Array, str]:
    """Times to draw over, and their label; long clocks are shown from the first update."""
    if run.time[0] > 10.0 * (run.time[-1] - run.time[0]):
        return run.time - run.time[0], f"time after {run.time[0]:.9g} s [s]"
    return run.time, "time [s]"


def estimates_figure(run: Run) -> Figure:
    """Parameters over time with bands of three standard deviations; without data the standard deviations alone.

    Parameters
    ----------
    run : sagnac.align.history.Run
    """
    panels = [(p, _members(run, p[0])) for p in _PANELS]
    panels = [(p, members) for p, members in panels if members]
    figure = _figure(9.0, 2.5 * len(panels) + 0.4)
    known = bool(np.isfinite(run.values).any())
    _, label = _clock(run)
    every = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    for axes, ((_, title, unit, size), members) in zip(every, panels, strict=True):
        said = _estimates(axes, run, members, size) if known else _deviations(axes, run, members, size)
        axes.set_ylabel(f"[{unit}]" if known else f"1 σ [{unit}]")
        axes.set_title(title + said, fontsize=10, loc="left")
        _legend(axes)
        _clean(axes)
    every[-1].set_xlabel(label)
    return figure


def _deviations(axes: Any, run: Run, members: Sequence[int], size: float) -> str:
    """Curves of the standard deviations; returns what the title adds."""
    time, some = _clock(run)[0], _thin(run.time.size)
    for i in members:
        name = run.names[i].rpartition(".")[2]
        style = _LINES.get(name, "-")
        axes.semilogy(time[some], run.sigmas[some, i] / size, color=_colour(name), lw=1.4, ls=style, label=name)
    _decade(axes)
    return ", standard deviation"


def _estimates(axes: Any, run: Run, members: Sequence[int], size: float) -> str:
    """Curves with their bands; returns what the title adds."""
    time, some = _clock(run)[0], _thin(run.time.size)
    last, first = run.values[-1, members] / size, run.sigmas[0, members] / size
    apart = bool(np.ptp(last) > 20.0 * first.max())  # a long lever arm: then only what was found of it is in sight
    zero = last if apart else np.zeros_like(last)
    for i, base in zip(members, zero, strict=True):
        name = run.names[i].rpartition(".")[2]
        colour, label = _colour(name), f"{name} - {base:.4g}".replace("- -", "+ ") if apart else name
        value, reach = run.values[some, i] / size - base, _SIGMAS * run.sigmas[some, i] / size
        axes.plot(time[some], value, color=colour, lw=1.2, label=label)
        axes.fill_between(time[some], value - reach, value + reach, color=colour, alpha=0.15, lw=0)
        if run.smoothed is not None:
            axes.plot(time[some], run.smoothed[some, i] / size - base, color=colour, lw=1.0, ls="--")
    _focus(axes, run.values[:, members] / size - zero, run.sigmas[:, members] / size)
    return ", bands of 3 σ" + ", smoothed dashed" * (run.smoothed is not None)


def _legend(axes: Any) -> None:
    """In one line above the panel, where no curve is."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.96), ncols=3, fontsize=8, frameon=False)


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
    """Show the whole way of the estimates, and of the first bands as much as leaves the last ones visible."""
    reach = np.maximum(_SIGMAS * sigmas[-1], 0.3 * _SIGMAS * sigmas[0])
    low = min(float(np.nanmin(values)), float((values[-1] - reach).min()))
    high = max(float(np.nanmax(values)), float((values[-1] + reach).max()))
    margin = 0.05 * (high - low) or 1.0
    axes.set_ylim(low - margin, high + margin)


def innovations_figure(run: Run) -> Figure:
    """What each sample of the master differed by from its prediction, with bands, and the normalised squares.

    Parameters
    ----------
    run : sagnac.align.history.Run
        With data.
    """
    names = run.innovation_names
    there = np.isfinite(run.nis)
    clock, label = _clock(run)
    time = clock[there]
    out = ~run.used[there]
    figure = _figure(9.0, 1.8 * (len(names) + 1) + 0.4)
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
        axes.set_title(f"innovation of {name.replace('.', ', ')}, band of 3 σ", fontsize=10, loc="left")
        _clean(axes)
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
    axes.axhspan(band[0], band[1], color="#e8f1f8", zorder=0)
    axes.axhline(rows, color=GREY, lw=0.8)
    axes.plot(*envelope(time[~out][size - 1 :], mean), color=BLUE, lw=1.0)
    axes.set_ylim(0.0, max(2.0 * rows, 1.1 * float(mean.max())))
    axes.set_title(
        f"normalised innovations squared, mean of {size} updates, and its 95 % band", fontsize=10, loc="left"
    )
    _clean(axes)


def observability_figure(run: Run) -> Figure:
    """How far the standard deviation of each parameter fell, and the singular values of the Gramian over time.

    Parameters
    ----------
    run : sagnac.align.history.Run
    """
    figure = _figure(10.0, 5.2)
    left, right = figure.subplots(1, 2, width_ratios=[1.7, 1.0])
    clock, label = _clock(run)
    some = _thin(clock.size)
    ratio = dict(zip(run.observability.names, run.observability.ratio, strict=True))
    styles = dict(zip((p[0] for p in _PANELS), ("-", "--", ":", "-.", (0, (1, 3)), (0, (5, 1))), strict=True))
    for prefix, style in styles.items():
        for i in _members(run, prefix):
            if not ratio[run.names[i]] > 0:
                continue
            first = run.sigmas[-1, i] / ratio[run.names[i]]
            left.semilogy(
                clock[some],
                run.sigmas[some, i] / first,
                ls=style,
                color=_colour(run.names[i]),
                lw=1.4,
                label=run.names[i],
            )
    left.axhline(1.0, color=GREY, lw=0.8)
    left.set_xlabel(label)
    left.set_ylabel("standard deviation over the initial one")
    figure.legend(fontsize=8, ncols=6, frameon=False, loc="outside lower center")
    left.set_title("what the data took away", fontsize=10, loc="left")
    seen = run.observability
    values = np.sqrt(np.maximum(seen.over_time, _LEAST**2))
    right.axhspan(0.1 * _LEAST, 1.0, color="#f6e6dc", zorder=0)
    right.semilogy(seen.times + clock[0] - run.time[0], values, color=BLUE, lw=1.0)
    right.set_ylim(_LEAST, 3.0 * max(1.0, float(np.max(values, initial=1.0))))
    right.set_xlabel(label)
    right.set_title("singular values (shaded: not observed)", fontsize=10, loc="left")
    for axes in (left, right):
        _clean(axes)
    return figure


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
