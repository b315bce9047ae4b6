"""Writes the noise that a test found into the plan or the calibration of the unit.

Both know white noise N, bias instability B and random walk K. Correlated noise, which a test may have found in place of B, goes
there as the B whose floor is as high as its peak: it must not vanish on the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .. import calibration as calibrations
from .. import plan as plans
from .. import units
from ..calibration import Calibration, NoiseLevel
from ..errors import DataError, InputError
from ..files import write_atomically
from ..plan.toml import one_key_a_line
from .record import Axis, Noise

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

Sensor = Literal["accel", "gyro"]

_KEYS = (("", "white"), ("_instability", "instability"), ("_walk", "walk"))
_SHOWN = {
    "accel": ("m/s^2/Hz^0.5", "ug/sqrt(Hz)"),
    "gyro": ("rad/s/Hz^0.5", "deg/sqrt(h)"),
    "accel_instability": ("m/s^2", "ug"),
    "gyro_instability": ("rad/s", "deg/h"),
    "accel_walk": ("m/s^2/s^0.5", "ug/sqrt(h)"),
    "gyro_walk": ("rad/s/s^0.5", "deg/h/sqrt(h)"),
}
_AS_INSTABILITY = 0.6173 / 0.6643
"""Bias instability over the rms of the correlated noise whose Allan deviation peaks, at 1.89 correlation times, at its floor."""
_ALIKE = 2.0
"""Axes that differ by less than this many standard uncertainties of their difference are stated as one."""


Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Stated:
    """Noise of a sensor in the terms that a plan or a calibration knows, for its axes x, y, z.

    Attributes
    ----------
    density, instability, walk : tuple of float
        N, B and K; B and K are zero where the test saw none.
    walk_limit : tuple of float, or None
        95 % limit of K.
    remarks : tuple of str
        What stands for something else.
    """

    density: Triple
    instability: Triple
    walk: Triple
    walk_limit: Triple | None
    remarks: tuple[str, ...]


def stated(noise: Noise, sensor: Sensor) -> Stated | None:
    """What a test says of the noise of a sensor.

    Parameters
    ----------
    noise : Noise
    sensor : {"accel", "gyro"}

    Returns
    -------
    Stated or None
        None unless all three axes were judged, with white noise or a limit of it.
    """
    found = {a.name: a for a in noise.axes}
    names = [f"{sensor}_{a}" for a in "xyz"]
    if not all(n in found for n in names):
        return None
    axes = [found[n] for n in names]
    density = [a.value("white") or _limit(a, "white") for a in axes]
    if not min(density) > 0:
        return None
    remarks = [f"{a.name} shows no white noise: the limit of it is written" for a in axes if not a.value("white") > 0]
    correlated = [a for a in axes if a.value("markov") > 0]
    remarks += [
        f"{a.name} has correlated noise of {a.value('markov_time'):.3g} s: written as the bias instability whose floor is as "
        "high as its peak"
        for a in correlated
    ]
    limit = [_limit(a, "walk") for a in axes]
    return Stated(
        _triple(density),
        _triple([math.hypot(a.value("instability"), _AS_INSTABILITY * a.value("markov")) for a in axes]),
        _triple([a.value("walk") for a in axes]),
        _triple(limit) if min(limit) > 0 else None,
        tuple(remarks),
    )


def remarks_of(noise: Noise) -> list[str]:
    """What is written in other words than the test's, for the person who writes it."""
    found = (stated(noise, "accel"), stated(noise, "gyro"))
    return [r for s in found if s is not None for r in s.remarks]


def _triple(values: list[float]) -> Triple:
    x, y, z = values
    return x, y, z


def _limit(axis: Axis, key: str) -> float:
    """What a term stays below with 95 % probability, seen or not; zero where nothing is known of that."""
    bounds = {t.key: t.upper for t in axis.terms} | {m.key: m.upper for m in axis.absent}
    return bounds.get(key) or 0.0


def into_plan(noise: Noise, path: str | Path, out: str | Path) -> plans.Plan:
    """Write a plan with the noise of a test in ``[unit] noise``; all else in it, comments too, stays as it is.

    Parameters
    ----------
    noise : Noise
    path, out : path
        Of the plan, and of the plan to write.

    Returns
    -------
    Plan
        As written.

    Raises
    ------
    InputError
        When the plan cannot be read.
    DataError
        When the test has judged all axes of no sensor, or read raw counts.
    """
    import tomlkit

    plans.load(path)  # with all that may be wrong with it
    document = tomlkit.parse(one_key_a_line(Path(path).read_text(encoding="utf-8-sig"))[0])
    said = _texts(noise)
    unit: Any = document.setdefault("unit", tomlkit.table())
    own: Any = unit.setdefault("noise", tomlkit.inline_table())
    for key in list(own):
        if key.partition("_")[0] in {k.partition("_")[0] for k in said}:
            del own[key]
    own.update(said)
    text = tomlkit.dumps(document)
    _check(document, str(out))
    with write_atomically(out) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return plans.load(out)


def _check(document: TOMLDocument, name: str) -> None:
    plans.from_table(document.unwrap(), name)


def _texts(noise: Noise) -> dict[str, str | list[str]]:
    """Keys of the plan's noise and what to write there."""
    out: dict[str, str | list[str]] = {}
    for sensor, own in _whole(noise).items():
        for end, term in _KEYS:
            key = f"{sensor}{end}"
            each = {"white": own.density, "instability": own.instability, "walk": own.walk}[term]
            if not max(each) > 0:
                continue
            inside, shown = _SHOWN[key]
            texts = [f"{units.convert(v, inside, shown):.4g} {shown}" for v in each]
            alike = _common(noise, sensor, term, each)
            out[key] = texts if alike is None else f"{units.convert(alike, inside, shown):.4g} {shown}"
    return out


def _whole(noise: Noise) -> dict[Sensor, Stated]:
    """Sensors of which all axes were judged, in SI.

    Raises
    ------
    DataError
        When there are none.
    """
    both: tuple[Sensor, Sensor] = ("accel", "gyro")
    whole = {s: own for s in both if (own := stated(noise, s)) is not None}
    if not whole:
        raise DataError("the noise of no sensor was found on all of its three axes: there is nothing to write")
    counted = [s for s in whole if noise[f"{s}_x"].unit == "count"]
    if counted:
        raise DataError(
            f"the noise of the {counted[0]} triad is in raw counts, a plan states it in SI: give the nominal scale of the counts "
            f"(--scale {counted[0]}=...)"
        )
    return whole


def _common(noise: Noise, sensor: str, term: str, each: Triple) -> float | None:
    """One value for the three axes where they agree within their uncertainty, the mean by weight."""
    found = []
    for axis in "xyz":
        try:
            found.append(noise[f"{sensor}_{axis}"][term])
        except KeyError:
            return None
    # what stands for another term has no uncertainty of its own
    if any(not t.standard_uncertainty > 0 or t.value != v for t, v in zip(found, each, strict=True)):
        return None
    for a in found:
        for b in found:
            if abs(a.value - b.value) > _ALIKE * math.hypot(a.standard_uncertainty, b.standard_uncertainty):
                return None
    weight = [t.standard_uncertainty**-2 for t in found]
    return sum(w * t.value for w, t in zip(weight, found, strict=True)) / sum(weight)


def into_calibration(noise: Noise, path: str | Path, out: str | Path) -> Calibration:
    """Write a calibration with the noise of a test, the log among its sources.

    Parameters
    ----------
    noise : Noise
    path, out : path
        Of the calibration, and of the one to write.

    Returns
    -------
    Calibration
        As written.

    Raises
    ------
    InputError
        When the calibration cannot be read.
    DataError
        When the test has judged all axes of no sensor, or its readings are in another unit than the calibration's.
    """
    calibration = calibrations.load(path)
    levels: dict[Sensor, NoiseLevel] = dict(calibration.noise)
    both: tuple[Sensor, Sensor] = ("accel", "gyro")
    found = False
    remarks = list(calibration.remarks)
    for sensor in both:
        own = stated(noise, sensor)
        if own is None:
            continue
        reading = noise[f"{sensor}_x"].unit
        _refuse_other_unit(calibration, sensor, reading, str(path))
        levels[sensor] = NoiseLevel(
            density=own.density,
            unit=f"{reading}/sqrt(Hz)",
            origin="noise test",
            instability=own.instability,
            walk=own.walk,
            walk_limit=own.walk_limit,
        )
        remarks += own.remarks
        found = True
    if not found:
        raise DataError("the noise of no sensor was found on all of its three axes: there is nothing to write")
    logs = tuple(s.model_copy(update={"role": "noise test"}) for s in noise.source)
    kept = tuple(s for s in calibration.source if s.role != "noise test")
    written = calibration.model_copy(
        update={"noise": levels, "source": (*kept, *logs), "remarks": tuple(dict.fromkeys(remarks))}
    )
    written.save(out)
    return written


def _refuse_other_unit(calibration: Calibration, sensor: str, reading: str, name: str) -> None:
    """Refuse counts where the calibration reads SI, and the other way round."""
    names = [p.name for p in calibration.parameters if p.name.startswith(f"{sensor}.")]
    if not names:
        return
    counts = any(".scale_factor." in n for n in names)
    if counts != (reading == "count"):
        said = "raw counts" if counts else "SI"
        raise InputError(
            f"{name}: reads its {sensor} triad in {said} and the log is in {reading}: open the log with the same --scale"
        )
