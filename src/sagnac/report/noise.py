"""Picture of a noise test: deviations with their 95 % bands and the fitted terms, spectra beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import units
from ..frames import Array
from ..noise.identification.identify import deviations as deviations_of
from ..noise.identification.terms import TERMS
from ..noise.page import density_of
from .style import BLUE, GREEN, GREY, ORANGE, SMALL, TEXT, WIDTH, blank, clean, in_brackets, in_family, powers, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..noise.expected import Need
    from ..noise.record import Axis, Disturbed, Noise

_STYLE = {"x": (BLUE, "o", "-"), "y": (ORANGE, "s", "--"), "z": (GREEN, "^", "-.")}
_SENSORS = {"accel": "Accelerometers", "gyro": "Gyros"}
_SHOWN = {"accel": "ug", "gyro": "deg/h"}
_KINDS = {"allan": "Allan", "modified": "Modified Allan", "hadamard": "Hadamard"}
_HEIGHT = 3.1
_LABELLED = 4
"""Lines of a spectrum that are named at most."""


@in_family
def noise_figure(noise: Noise) -> Figure:
    """Deviation (left) and spectrum (right) of every axis that was judged, one row a sensor.

    Marks and the band about them are what the log shows; the line through them is the sum of the fitted terms, the dotted ones
    are the terms, with their symbols of IEEE Std 952.

    Parameters
    ----------
    noise : Noise
    """
    sensors = [s for s in _SENSORS if any(a.name.startswith(s) for a in noise.axes)]
    figure = blank(WIDTH, _HEIGHT * len(sensors) + 0.2)
    rows = figure.subplots(len(sensors), 2, squeeze=False)
    for (left, right), sensor in zip(rows, sensors, strict=True):
        own = [a for a in noise.axes if a.name.startswith(sensor)]
        unit = own[0].unit if own[0].unit == "count" else _SHOWN[sensor]
        size = 1.0 if unit == "count" else units.convert(1.0, own[0].unit, unit)
        missing = [r.name for r in noise.refused if r.name.startswith(sensor)]
        _deviations(left, own, noise, unit, size)
        said = [f"{', '.join(missing)} refused"] if missing else []
        said += ["terms by Allan deviation"] if noise.kind == "modified" else []
        title(left, _SENSORS[sensor] + (f" ({'; '.join(said)})" if said else ""))
        _spectra(right, own, noise, unit, size)
    return figure


def _style(axis: Axis) -> tuple[str, str, str]:
    return _STYLE[axis.name.rpartition("_")[2]]


def _deviations(axes: Any, own: Sequence[Axis], noise: Noise, unit: str, size: float) -> None:
    for axis in own:
        colour, marker, line = _style(axis)
        tau, curve = np.array(axis.curve.tau), axis.curve
        axes.fill_between(
            tau, np.array(curve.lower) * size, np.array(curve.upper) * size, color=colour, alpha=0.22, lw=0
        )
        axes.loglog(
            tau, np.array(curve.deviation) * size, marker, ms=3.2, mfc="white", mew=0.9, color=colour, label=axis.name
        )
        if curve.fitted:
            smooth = np.geomspace(max(tau[0], axis.fit.shortest), tau[-1], 200)
            axes.loglog(smooth, _total(axis, smooth, noise) * size, line, lw=1.1, color=colour)
    low = min(min(a.curve.lower) for a in own) * size
    high = max(min(a.curve.upper[i], 3 * a.curve.deviation[i]) for a in own for i in range(len(a.curve.tau))) * size
    axes.set_ylim(low / 2.5, high * 1.6)
    if own[0].curve.fitted:
        _terms(axes, own, noise, size)
    _finish(axes, "averaging time [s]", f"{_KINDS[noise.kind]} deviation{in_brackets(unit)}")
    axes.legend(loc="best", frameon=False, handletextpad=0.2, borderaxespad=0.2)


def _total(axis: Axis, tau: Array, noise: Noise) -> Array:
    parts = deviations_of({t.key: t.value for t in axis.terms}, tau, noise.interval, noise.kind)
    return np.asarray(np.sqrt(sum((p**2 for p in parts.values()), np.zeros_like(tau))))


def _terms(axes: Any, own: Sequence[Axis], noise: Noise, size: float) -> None:
    """Each term as a thin line, its symbol once at the place where it rises most over the rest."""
    ends = axes.get_ylim()
    named: dict[str, tuple[float, float, float]] = {}
    for axis in own:
        tau = np.geomspace(max(axis.curve.tau[0], axis.fit.shortest), axis.curve.tau[-1], 120)
        total = _total(axis, tau, noise)
        parts = deviations_of({t.key: t.value for t in axis.terms}, tau, noise.interval, noise.kind)
        for key, part in parts.items():
            axes.loglog(tau, part * size, ":", lw=0.9, color=_style(axis)[0])
            inside = (part * size > ends[0] * 1.3) & (part * size < ends[1] / 1.3)
            if not inside.any():
                continue
            share = np.where(inside, part / total, -1.0)
            at = int(np.argmax(share))
            if share[at] > named.get(key, (0.0, 0.0, -1.0))[2]:
                named[key] = (float(tau[at]), float(part[at] * size), float(share[at]))
    for key, (x, y, _) in named.items():
        axes.annotate(
            TERMS[key].symbol,
            (x, y),
            xytext=(0, -4),
            textcoords="offset points",
            fontsize=TEXT,
            fontweight="bold",
            ha="center",
            va="top",
            bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )


def _spectra(axes: Any, own: Sequence[Axis], noise: Noise, unit: str, size: float) -> None:
    """Two-sided densities (those of the record are one-sided), so that white noise lies at its coefficient N."""
    for axis in own:
        if axis.spectrum is None:
            continue
        colour, _, line = _style(axis)
        # the last frequency has no second side: half the density of its neighbours
        frequency, density = np.array(axis.spectrum.frequency)[:-1], np.array(axis.spectrum.density)[:-1]
        axes.loglog(frequency, np.sqrt(0.5 * density) * size, lw=0.6, color=colour, alpha=0.75)
        frequency = frequency[frequency < 0.5001 / max(axis.fit.shortest, noise.interval)]
        fitted = density_of({t.key: t.value for t in axis.terms}, frequency, noise.interval)
        if np.all(fitted > 0):
            axes.loglog(frequency, np.sqrt(0.5 * fitted) * size, line, lw=1.3, color="black")
    if all(a.spectrum is None for a in own):
        axes.loglog([1.0, 0.5 / noise.interval], [np.nan, np.nan])  # scales to write on
        axes.set_ylim(0.1, 10.0)
        axes.text(0.5, 0.5, "the log is too short", transform=axes.transAxes, ha="center", color=GREY)
    _finish(axes, "frequency [Hz]", f"root of two-sided density [{_root(unit)}]")
    title(axes, "Spectrum, fitted in black")
    _name_lines(axes, [d for d in noise.disturbances if d.kind == "line" and d.axis in [a.name for a in own]])


def _root(unit: str) -> str:
    return {"ug": "µg/√Hz", "deg/h": "deg/h/√Hz"}.get(unit, f"{unit}/√Hz")


def _name_lines(axes: Any, lines: Sequence[Disturbed]) -> None:
    told: list[float] = []
    for line in sorted(lines, key=lambda d: -(d.size or 0.0)):
        at = line.frequency or 0.0
        if len(told) < _LABELLED and all(abs(math.log(at / t)) > 0.35 for t in told):
            told.append(at)
            axes.annotate(
                f"{at:.3g} Hz", (at, 1.0), xycoords=("data", "axes fraction"), xytext=(0, -2), textcoords="offset points",
                fontsize=SMALL, ha="center", va="top", rotation=90,
            )  # fmt: skip


def _finish(axes: Any, x: str, y: str) -> None:
    clean(axes)
    powers(axes.xaxis)
    powers(axes.yaxis)
    low, high = axes.get_ylim()
    if high < 40.0 * low:  # hardly more than a decade: ticks between
        from matplotlib.ticker import FuncFormatter, LogLocator

        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.set_xlabel(x)
    axes.set_ylabel(y)


@in_family
def needs_figure(found: Sequence[Need]) -> Figure:
    """Uncertainty of each expected coefficient against the length of the record, one panel a sensor.

    Parameters
    ----------
    found : sequence of Need
    """
    figure = blank(WIDTH, _HEIGHT)
    panels = figure.subplots(1, len(found), squeeze=False, sharey=True)[0]
    for axes, need in zip(panels, found, strict=True):
        hours = need.found.durations / 3600.0
        for i, key in enumerate(need.found.keys):
            colour, marker, line = list(_STYLE.values())[i % 3] if i < 3 else (GREY, "D", ":")
            relative = np.where(need.found.relative[:, i] < 2.0, need.found.relative[:, i], np.nan)
            label = TERMS[key].symbol if key in TERMS else "T"
            axes.loglog(
                hours, 100 * relative, line, marker=marker, ms=3.2, mfc="white", lw=1.1, color=colour, label=label
            )
        axes.axhline(100 * need.found.target, color="black", lw=0.8)
        title(axes, f"{_SENSORS[need.expected.sensor]} at {1 / need.interval:.6g} Hz")
        _finish(axes, "length of the record [h]", "standard uncertainty [%]")
        axes.set_ylim(top=200.0)
        axes.legend(frameon=False, ncols=2)
    return figure
