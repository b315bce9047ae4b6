"""A noise test as a page of text: terms by row, axes by column, in the units of data sheets."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .. import units
from ..frames import Array
from ..printed import printed, probability
from .identification.terms import TERMS, density

if TYPE_CHECKING:
    from .record import Axis, Noise

NAMES = {key: term.name for key, term in TERMS.items()} | {"markov_time": "its correlation time"}
"""What the terms are called."""
_GYRO = {"white": "angle random walk", "walk": "rate random walk", "ramp": "rate ramp"}
_ACCEL = {"white": "velocity random walk", "walk": "acceleration random walk", "ramp": "acceleration ramp"}
_COUNT = {
    "quantisation": ("count*s", "count*s"),
    "white": ("count/Hz^0.5", "count/sqrt(Hz)"),
    "instability": ("count", "count"),
    "walk": ("count/s^0.5", "count/sqrt(h)"),
    "ramp": ("count/s", "count/h"),
    "markov": ("count", "count"),
    "markov_time": ("s", "s"),
}
_KINDS = {"allan": "Allan", "modified": "modified Allan", "hadamard": "Hadamard"}
_WIDE = 22
_TOLD = 3


def units_of(key: str, name: str, reading: str) -> tuple[str, str]:
    """Unit inside, and unit of data sheets, of a term of an axis.

    Parameters
    ----------
    key : str
    name : str
        Of the axis, ``gyro_x``.
    reading : str
        Unit of its readings.
    """
    if reading == "count":
        return _COUNT[key]
    from .identification.terms import units as of_term

    return of_term(key, name.partition("_")[0])


def density_of(terms: Mapping[str, float], frequency: Array, interval: float) -> Array:
    """One-sided spectrum of the samples of a sum of terms; a ramp, which is no random process, is left out.

    Parameters
    ----------
    terms : mapping of str to float
        Coefficients by key, SI.
    frequency : ndarray, Hz
    interval : float, s
    """
    total = np.zeros(frequency.size)
    for key, value in terms.items():
        if key not in ("ramp", "markov_time"):
            total += density(key, value, frequency, interval, terms.get("markov_time", 0.0))
    return total


def term_name(key: str, sensor: str) -> str:
    """What a term of ``accel`` or ``gyro`` is called."""
    return (_GYRO if sensor == "gyro" else _ACCEL).get(key, NAMES[key])


def page(noise: Noise) -> str:
    """The text, see :meth:`sagnac.noise.record.Noise.summary`."""
    name = noise.source[0].file if noise.source else "recording"
    how = "every difference of the samples" if noise.method == "exact" else "a pyramid of averages, samples not kept"
    lines = [f"Noise of {name} by its {_KINDS[noise.kind]} deviation ({how})", ""]
    if noise.unit.model or noise.unit.serial:
        lines.append(f"  unit        {noise.unit.model} {noise.unit.serial}".rstrip())
    lines.append(f"  samples     {noise.samples}, {1 / noise.interval:.6g} Hz, {_duration(noise.duration)}")
    lines += ["  terms       from the Allan deviation"] if noise.kind == "modified" else []
    for sensor in ("accel", "gyro"):
        own = [a for a in noise.axes if a.name.startswith(sensor)]
        lines += _triad(sensor, own, [r.name for r in noise.refused if r.name.startswith(sensor)])
    lines += ["", *(f"  refused: {r.name}: {r.reason}" for r in noise.refused)] if noise.refused else []
    by_note: dict[str, list[str]] = {}
    for a in noise.axes:
        for n in a.fit.notes:
            by_note.setdefault(n, []).append(a.name)
    own_notes = [f"  note: {', '.join(names)}: {n}" for n, names in by_note.items()]
    found = _found(noise)
    notes = own_notes + found + [f"  note: {r}" for r in noise.remarks]
    return "\n".join([*lines, *([""] if notes else []), *notes]) + "\n"


def _found(noise: Noise) -> list[str]:
    """What was found in the log and refused no axis, the first of each kind on each axis."""
    judged = {"", *(a.name for a in noise.axes)}
    out, count = [], Counter[tuple[str, str]]()
    for d in noise.disturbances:
        if d.axis in judged:
            count[d.kind, d.axis] += 1
            out += [f"  found: {d.text}"] if count[d.kind, d.axis] <= _TOLD else []
    more = [f"{n - _TOLD} of kind {kind} on {axis}" for (kind, axis), n in count.items() if n > _TOLD]
    return [*out, f"  found: more of the same, {', '.join(more)}"] if more else out


def _duration(seconds: float) -> str:
    if seconds >= 7200:
        return f"{seconds / 3600:.4g} h"
    return f"{seconds:.4g} s"


def _triad(sensor: str, axes: Sequence[Axis], refused: Sequence[str]) -> list[str]:
    """Table of one sensor."""
    columns = sorted({a.name for a in axes} | set(refused))
    if not columns:
        return []
    by_name = {a.name: a for a in axes}
    lines = ["", f"  {sensor:<34}" + "".join(f"{c.rpartition('_')[2]:>{_WIDE}}" for c in columns) + "  unit"]
    keys = [k for k in NAMES if any(_cell(a, k) for a in axes)]
    for key in keys:
        reading = axes[0].unit
        inside, shown = units_of(key, axes[0].name, reading)
        cells = [_cell(by_name[c], key, inside, shown) if c in by_name else "refused" for c in columns]
        symbol = f" {TERMS[key].symbol}" if key in TERMS else ""
        lines.append(
            f"  {term_name(key, sensor) + symbol:<34}" + "".join(f"{c:>{_WIDE}}" for c in cells) + f"  {shown}"
        )
        if key == "white" and sensor == "accel" and reading != "count":
            other = "m/s/sqrt(h)"
            cells = [_cell(by_name[c], key, inside, other) if c in by_name else "refused" for c in columns]
            lines.append(f"  {'':<34}" + "".join(f"{c:>{_WIDE}}" for c in cells) + f"  {other}")
    if not keys:
        lines.append(f"  {'':<34}" + "".join(f"{'refused':>{_WIDE}}" for _ in columns))
    fits = [_fit(by_name[c]) if c in by_name else "" for c in columns]
    return [*lines, f"  {'probability of the fit':<34}" + "".join(f"{f:>{_WIDE}}" for f in fits)] if axes else lines


def _cell(axis: Axis, key: str, inside: str = "", shown: str = "") -> str:
    """One term of one axis: value and standard uncertainty, or its limit; without units whether there is anything to tell."""
    for t in axis.terms:
        if t.key == key:
            value, sigma, _ = printed(t.value, t.standard_uncertainty, inside, shown) if shown else ("x", "", "")
            return f"{value} ± {sigma}"
    for limit in axis.absent:
        if limit.key == key:
            if limit.upper is None:
                return "not seen" if shown else ""
            return f"< {units.convert(limit.upper, inside, shown):.2g}" if shown else "x"
    return "-" if shown else ""


def _fit(axis: Axis) -> str:
    p = axis.fit.p_value
    return "-" if p is None or not math.isfinite(p) else probability(p)
