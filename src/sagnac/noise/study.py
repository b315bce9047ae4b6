"""A noise test of all recorded axes: what ``sagnac noise`` does.

One pass over the recording (:mod:`sagnac.noise.gather`), the disturbances in it (:mod:`sagnac.noise.findings.disturbances`), the
variances of each axis, and the terms that explain them (:mod:`sagnac.noise.identification.identify`). An axis whose result a
disturbance would make wrong is refused; the others are given.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .. import units
from .._version import __version__
from ..calibration import Environment, Range, UnitName
from ..errors import DataError, InputError
from ..files import sha256
from ..recording import Recording
from ..results import Software, Source, now
from .axis import Judged, Kind, beyond, judge, record_of, shown_in
from .curves.allan import KINDS
from .curves.bridges import MOST, SHORT
from .findings import disturbances as clues
from .findings.disturbances import Disturbance
from .gather import MEMORY, Gathered, gather, spectrum_of
from .page import units_of
from .record import Axis, Disturbed, Noise, Refused
from .temperature import taken_off

if TYPE_CHECKING:
    from ..plan import Unit

_READING = {"accel": "m/s^2", "gyro": "rad/s"}
DESPITE = (
    "saturated",
    "stuck",
    "repeated",
    "rounded",
    "motion",
    "restless",
    "step",
    "drift",
    "shock",
    "line",
    "misfit",
)
"""Disturbances that the caller may put up with."""


def study(
    recording: Recording,
    *,
    kind: Kind = "allan",
    start: float | None = None,
    stop: float | None = None,
    memory: int = MEMORY,
    despite: Collection[str] = (),
    unit: Unit | None = None,
) -> Noise:
    """Find the noise of every recorded axis of a unit at rest.

    Parameters
    ----------
    recording : Recording
        Of a unit that nothing moves; SI or counts, whole triads or single axes. A temperature column is made use of.
    kind : {"allan", "modified", "hadamard"}
        Deviation that is shown. The terms come from the Allan variances, or from Hadamard's, which see no ramp.
    start, stop : float, s, optional
        Samples before and from here on are left out.
    memory : int
        Bytes of samples that may be kept (and twice those of an axis, one after the other). Where they do not fit, the
        variances come from a pyramid of averages, which are as good to a few percent of their scatter.
    despite : collection of str
        Disturbances to put up with, see :data:`DESPITE`: they are named, and refuse no axis.
    unit : Unit, optional
        Whose it is, for the record.

    Returns
    -------
    Noise
        With the axes that can be judged, those that were refused and why, and all that was found in the log.

    Raises
    ------
    InputError
        When a sample cannot be read, or an argument is unknown.
    DataError
        When there are too few samples, or no axis can be judged.

    Examples
    --------
    >>> import numpy as np
    >>> from sagnac.recording import from_arrays
    >>> time = np.arange(20000) / 100
    >>> gyro = 1e-4 * np.random.default_rng(1).normal(size=(20000, 3))
    >>> found = study(from_arrays(time, gyro=gyro))
    >>> [f"{found[a]['white'].value:.2g}" for a in ("gyro_x", "gyro_y", "gyro_z")]  # 1e-4 / sqrt(100 Hz)
    ['1e-05', '1e-05', '1e-05']
    """
    _check(kind, despite)
    kinds = ("allan",) if kind == "allan" else (kind, "allan") if kind == "modified" else (kind,)
    found = gather(recording, kinds=kinds, start=start, stop=stop, memory=memory)
    readings = [
        "count" if a.partition("_")[0] in recording.counts else _READING[a.partition("_")[0]] for a in found.axes
    ]
    seen = _disturbances(found, recording, readings)
    refused = _refusals(seen, despite)
    judging = [k for k, axis in enumerate(found.axes) if axis not in refused]
    warm, told = taken_off(found.blocks, found.axes, judging, readings)
    again = found
    if warm is not None and found.streamed is not None:
        again = gather(recording, kinds=kinds, start=start, stop=stop, memory=0, correction=warm)
    axes: list[Axis] = []
    for k in judging:
        try:
            judged = judge(found, again, k, kind, warm)
            spectrum = spectrum_of(again, k, warm)
            own = beyond(found.axes[k], judged, spectrum, readings[k])
        except DataError as error:  # of this axis alone: it shows no noise
            refused[found.axes[k]] = f"{found.axes[k]}: {error}"
            seen.append(Disturbance("dead", found.axes[k], refused[found.axes[k]], spoils=True))
            told.pop(k, None)
            continue
        seen += own
        spoilt = _refusals(own, despite)
        if spoilt:
            refused |= spoilt
            continue
        if judged.before is not None:
            told[k] = replace(told[k], text=told[k].text + _without(judged, found.axes[k], readings[k]))
        axes.append(record_of(found.axes[k], float(found.mean[k]), judged, readings[k], spectrum))
    seen += list(told.values())
    words = clues.advice(found.blocks, [d for d in seen if d.kind not in despite])
    if not axes:
        raise DataError(
            f"{recording.name}: no axis can be judged: {_reasons(seen, despite)}" + (f"; {words}" if words else "")
        )
    return _noise(recording, found, kind, axes, refused, seen, unit, words)


def _check(kind: str, despite: Collection[str]) -> None:
    if kind not in KINDS:
        raise InputError(f"there is no deviation {kind!r}; choose from {', '.join(KINDS)}")
    unknown = [d for d in despite if d not in DESPITE]
    if unknown:
        raise InputError(f"--despite {unknown[0]}: there are {', '.join(DESPITE)}")


def _disturbances(found: Gathered, recording: Recording, readings: Sequence[str]) -> list[Disturbance]:
    """What the blocks show."""
    axes, blocks = found.axes, found.blocks
    pulses = [a.partition("_")[0] in recording.increments for a in axes]
    shown = [shown_in(a, r) for a, r in zip(axes, readings, strict=True)]
    texts, sizes = [u for u, _ in shown], [s for _, s in shown]
    return [*_gaps(found), *clues.find(blocks, axes, pulses, texts, sizes, found.gaps)]


def _gaps(found: Gathered) -> list[Disturbance]:
    """What was lost: single samples, that are bridged, and gaps, that part the log."""
    if not found.gaps:
        return []
    lost, interval = found.losses, found.interval
    long_ = [g for g in found.gaps if not lost.bridged or round(g[1] / interval) - 1 > SHORT]
    parts: list[str] = []
    if lost.bridged:
        places = "1 place" if lost.places == 1 else f"{lost.places} places"
        told = f"{lost.lost} samples lost in {places} ({lost.share:.2%}, {lost.longest} in a row at most)"
        parts.append(
            f"{told}: bridged for averaging times that are long against this, from {lost.begin * interval:.3g} s on"
        )
    if long_:
        at, longest = max(long_, key=lambda g: g[1])
        number = "1 gap" if len(long_) == 1 else f"{len(long_)} gaps"
        text = f"{number}, {sum(g[1] for g in long_):.3g} s in all, the longest of {longest:.3g} s at {at:.6g} s: "
        ends = [found.span[0], *(t for g in long_ for t in (g[0], g[0] + g[1])), found.span[1]]
        stretch = max(b - a for a, b in zip(ends[::2], ends[1::2], strict=True))
        parts.append(text + f"the stretches between them are pooled, the longest is {stretch:.4g} s")
    if lost.places and not lost.bridged:
        parts.append(
            f"{lost.share:.1%} of the samples are lost a few at a time, too many to be bridged (at most {MOST:.0%}): averaging "
            "times longer than the stretches hold are not told"
        )
    if found.short and not lost.bridged:
        parts.append(f"{found.short} samples lie in stretches too short to use")
    first, total = found.gaps[0][0], sum(length for _, length in found.gaps)
    return [Disturbance("gap", "", "; ".join(parts), start=first, size=total)]


def _refusals(seen: Sequence[Disturbance], despite: Collection[str]) -> dict[str, str]:
    """Axes that cannot be judged, and why."""
    out: dict[str, str] = {}
    for d in seen:
        if d.spoils and d.kind not in despite:
            out.setdefault(d.axis, d.text)
    return out


def _reasons(seen: Sequence[Disturbance], despite: Collection[str]) -> str:
    """Why no axis could be judged, kind by kind."""
    kinds: dict[str, list[Disturbance]] = {}
    for d in seen:
        if d.spoils and d.kind not in despite:
            kinds.setdefault(d.kind, []).append(d)
    told = []
    for own in kinds.values():
        others = list(dict.fromkeys(d.axis for d in own if d.axis != own[0].axis))
        told.append(own[0].text + (f" (likewise {', '.join(others)})" if others else ""))
    return "; ".join(told)


# ------------------------------------------------------------------------------------------------- temperature


def _without(judged: Judged, axis: str, reading: str) -> str:
    """What the slow terms would be with the temperature left in."""
    assert judged.before is not None
    parts = []
    for key, symbol in (("instability", "B"), ("walk", "K"), ("ramp", "R")):
        inside, shown = units_of(key, axis, reading)
        before, after = judged.before.value(key), judged.found.value(key)
        if before != after:
            size = units.convert(1.0, inside, shown)
            parts.append(f"{symbol} {before * size:.3g} instead of {after * size:.3g} {shown}")
    return f"; with it there would be {', '.join(parts)}" if parts else ""


# ------------------------------------------------------------------------------------------------- the record


def _noise(
    recording: Recording,
    found: Gathered,
    kind: Kind,
    axes: Sequence[Axis],
    refused: dict[str, str],
    seen: Sequence[Disturbance],
    unit: Unit | None,
    words: str,
) -> Noise:
    digest = sha256(recording.path) if recording.path is not None else None
    source = Source(
        file=recording.name,
        format=recording.format,
        select=recording.select,
        sha256=digest,
        start=found.span[0],
        stop=found.span[1],
    )
    warmth = found.blocks.temperature
    known = np.zeros(0) if warmth is None else warmth[np.isfinite(warmth)]
    environment = Environment()
    if known.size:
        span = Range(mean=float(known.mean()), minimum=float(known.min()), maximum=float(known.max()))
        environment = Environment(temperature=span)
    return Noise(
        unit=UnitName(
            model=unit.model if unit is not None else "",
            serial=unit.serial if unit is not None else "",
            scale=dict(recording.scale),
        ),
        kind=kind,
        method="exact" if found.kept is not None else "pyramid",
        interval=found.interval,
        samples=found.samples,
        stretches=found.stretches,
        axes=tuple(axes),
        refused=tuple(Refused(name=name, reason=reason) for name, reason in refused.items()),
        disturbances=tuple(Disturbed(**d.__dict__) for d in seen),
        environment=environment,
        source=(source,),
        remarks=tuple(dict.fromkeys([*([words] if words else []), *recording.remarks])),
        software=Software(version=__version__),
        created=now(),
    )
