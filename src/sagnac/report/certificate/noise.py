"""The noise of the unit as a calibration knows it, in the units of data sheets, with where it is known from."""

from __future__ import annotations

from ...calibration import Calibration, NoiseLevel
from ...plan import Plan
from ..document import Block, Grid, Text
from ..shown import convert
from ..style import pretty
from .context import Context
from .methods import by_hand

Triple = tuple[float, float, float]
Row = tuple[str, ...]
_SHOWN = {
    ("m/s^2", "density"): ("m/s^2/Hz^0.5", "ug/sqrt(Hz)"),
    ("rad/s", "density"): ("rad/s/Hz^0.5", "deg/sqrt(h)"),
    ("m/s^2", "instability"): ("m/s^2", "ug"),
    ("rad/s", "instability"): ("rad/s", "deg/h"),
    ("m/s^2", "walk"): ("m/s^2/s^0.5", "ug/sqrt(h)"),
    ("rad/s", "walk"): ("rad/s/s^0.5", "deg/h/sqrt(h)"),
}
_RAW = {"density": "{}/sqrt(Hz)", "instability": "{}", "walk": "{}/sqrt(s)"}
_SENSORS = {"accel": "accelerometers", "gyro": "gyros"}
_FROM = {"plan": "the plan", "recording": "found in the data", "noise test": "a noise test"}
_CAPTION = "Noise of the axes"


def noise(context: Context) -> list[Block]:
    """A table of the noise, and how it was used.

    White noise N, bias instability B and random walk K of IEEE Std 952, as far as they are known, and what K stays below where a
    noise test has said so.

    Parameters
    ----------
    context : Context
    """
    calibration, plan = context.calibration, context.evidence.plan
    rows = [row for sensor, level in calibration.noise.items() for row in _rows(sensor, level, plan)]
    if not rows:
        return [Text("No noise of the sensors is on record.", "note")]
    header = ("sensor", "noise", "x", "y", "z", "unit", "from")
    words = " ".join(_words(calibration, plan))
    return [Grid(header, tuple(rows), "llrrrll", _CAPTION), *([Text(words, "note")] if words else [])]


def _rows(sensor: str, level: NoiseLevel, plan: Plan | None) -> list[Row]:
    reading = level.unit.partition("/sqrt(Hz)")[0]
    origin = _FROM[level.origin]
    # means show white noise alone: what is known of slow noise besides was stated
    slow = origin if level.origin == "noise test" else _FROM["plan"]
    rows = [_row(sensor, "white noise", "density", level.density, reading, origin)]
    stated = None if plan is None or level.origin == "plan" else plan.unit.noise.of(sensor)
    if stated is not None and reading != "count":
        rows.append(_row(sensor, "white noise, stated", "density", stated, reading, _FROM["plan"]))
    for values, words, term in (
        (level.instability, "bias instability", "instability"),
        (level.walk, "random walk", "walk"),
    ):
        if values is not None and (max(values) > 0 or level.origin == "noise test"):
            rows.append(_row(sensor, words, term, values, reading, slow))
    if level.walk_limit is not None:
        rows.append(_row(sensor, "random walk, below (95 %)", "walk", level.walk_limit, reading, slow))
    return rows


def _row(sensor: str, words: str, term: str, values: Triple, reading: str, origin: str) -> Row:
    inside, unit = _SHOWN.get((reading, term), (reading, _RAW[term].format(reading)))
    numbers = (convert(v, inside, unit) if (reading, term) in _SHOWN else v for v in values)
    texts = (f"{v:#.3g}" if v > 0 else "none" for v in numbers)
    printed = pretty(unit).replace("sqrt(h)", "√h").replace("sqrt(s)", "√s")
    return (_SENSORS.get(sensor, sensor), words, *texts, printed, origin)


def _words(calibration: Calibration, plan: Plan | None) -> list[str]:
    """What the numbers were used for."""
    out = []
    own = {s: level for s, level in calibration.noise.items() if level.origin != "noise test"}
    if len(own) < len(calibration.noise):
        out.append("What a noise test says was written into the calibration afterwards and has not weighed its data.")
    told = plan is not None and any(
        level.origin == "recording" and plan.unit.noise.of(sensor) is not None for sensor, level in own.items()
    )
    if told:
        out.append("White noise that the plan states has weighed the data, unless a remark says otherwise.")
    slow = any(_slow(sensor, level, plan) for sensor, level in own.items())
    if slow and not by_hand(calibration):
        out.append("Slow noise is in the weights, and with them in the uncertainties.")
    if own and not slow:
        out.append("No slow noise was stated: the uncertainties have of it what the scatter of the data shows.")
    return out


def _slow(sensor: str, level: NoiseLevel, plan: Plan | None) -> bool:
    """Whether slow noise of a sensor was stated: it stands in the record, or of raw counts perhaps in the plan alone."""
    stated = [level.instability, level.walk]
    if plan is not None:
        stated += [plan.unit.noise.of(sensor, term) for term in ("instability", "walk")]
    return any(max(v) > 0 for v in stated if v is not None)
