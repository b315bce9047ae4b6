"""What was done, where, and how the result follows from it."""

from __future__ import annotations

import math

from ...calibration import Calibration
from ...plan import Plan, Segment
from .. import pictures
from ..document import Block, Bullets, Equation, Facts, Grid, Section, Text
from ..parts import not_drawn, picture
from ..shown import MINUS, NOT_STATED, or_not_stated, plain_words, quantity
from .context import Context
from .methods import by_hand, method_of, uncertainty_in_words
from .noise import noise

_KINDS = {"turntable": "turntable", "centrifuge": "centrifuge", "roll-isolated": "roll-isolated measurement"}
_LABELS = {
    "angle_uncertainty": "Uncertainty of each setting",
    "axis_uncertainty": "Uncertainty of the axes",
    "rate_uncertainty": "Relative uncertainty of the rate",
    "axes": "Axes from the base",
    "radius": "Radius of the arm",
    "radius_uncertainty": "Uncertainty of the radius",
    "counter_rotating": "Counter-rotating platform",
    "phase_uncertainty": "Uncertainty of the arm's phase",
    "arm_continuous": "Arm turned on steadily between segments",
    "encoder_resolution": "Step of the encoder",
    "encoder_uncertainty": "Uncertainty of the encoder's eccentricity",
    "encoder_delay": "Delay of the encoder",
}
KEYS = {
    **{f"rig.{key}": f"the {label[:1].lower()}{label[1:]}" for key, label in _LABELS.items()},
    "unit.limits.accel_k2": "the limit of the accelerometers' K2",
    "unit.limits.gyro_g_squared": "the limit of the gyros' g-squared sensitivity",
    "unit.limits.accel_drift": "the limit of the accelerometers' drift",
    "unit.limits.gyro_drift": "the limit of the gyros' drift",
    "unit.limits.gyro_scale": "the limit of the gyros' scale errors",
    "unit.limits": "the limits of the unit",
    "unit.accel_k2": "the known K2 of the accelerometers",
    "unit.noise": "the noise of the unit",
    "gravity_uncertainty": "the uncertainty of gravity",
}
"""Keys of a plan in plain words."""
_ANGLES = ("outer", "middle", "inner", "x_azimuth", "y_azimuth", "alpha", "beta", "gamma", "arm_phase")
_RATES = ("outer_rate", "middle_rate", "inner_rate", "arm_rate", "spin_rate")
_WORDS = ("z", "stage")
_SMALL_ANGLE = 0.5  # deg, below which an angle is told in arcsec


def rig(context: Context) -> Section:
    """The rig and the plan, segment by segment."""
    calibration, plan = context.calibration, context.evidence.plan
    blocks: list[Block] = []
    if by_hand(calibration):
        blocks.append(Text("The unit was turned by hand; no rig was used."))
    else:
        said = calibration.rig or (plan.rig.texts() if plan is not None else {})
        kind = said.get("kind", "")
        rows = [("Rig", _KINDS.get(kind, or_not_stated(kind)))]
        rows += [(_LABELS.get(k, k), tidy(v)) for k, v in said.items() if k != "kind"]
        blocks.append(Facts(tuple(rows)))
        if said:
            blocks.append(Text("Uncertainties are standard uncertainties, as stated in the plan.", "note"))
    blocks += _segments(context)
    blocks.append(_log(context))
    return Section("Rig and plan", tuple(blocks))


def tidy(text: str) -> str:
    """A quantity as a plan writes it, in a unit and with digits that a person would write.

    Parameters
    ----------
    text : str
    """
    number, _, unit = text.partition(" ")
    try:
        value = float(number)
    except ValueError:
        return {"True": "yes", "False": "no"}.get(text, text)
    if unit in ("deg", "rad"):
        degrees = value if unit == "deg" else math.degrees(value)
        return quantity(degrees * 3600, "arcsec", 7) if abs(degrees) < _SMALL_ANGLE else quantity(degrees, "deg", 9)
    if not unit:
        return quantity(value * 1e6, "ppm", 7)
    return quantity(value, unit, 10)


def _segments(context: Context) -> list[Block]:
    plan = context.evidence.plan
    if plan is None:
        if by_hand(context.calibration):
            return []
        return [
            Text(
                f"Table of segments not shown. {_sentence(plain_words(context.evidence.absent.get('plan', 'No plan')))}",
                "missing",
            )
        ]
    if not plan.segment:
        return []
    used = [k for k in (*_ANGLES, *_RATES, *_WORDS) if any(_said(s, k) for s in plan.segment)]
    own = _own_names(plan)
    units = {**dict.fromkeys(_ANGLES, "deg"), **dict.fromkeys(_RATES, "deg/s")}
    header = ("segment", "start [s]", "stop [s]", *(own.get(k, k).replace("_", " ") + _unit(units, k) for k in used))
    rows = tuple((s.name, f"{s.start:.10g}", f"{s.stop:.10g}", *(_cell(s, k) for k in used)) for s in plan.segment)
    title = f"{len(plan.segment)} segments of the plan"
    return [Grid(header, rows, "lrr" + "".join("l" if k in _WORDS else "r" for k in used), title)]


def _own_names(plan: Plan) -> dict[str, str]:
    """Axes by the names that the plan gives them."""
    pairs = list(zip(plan.rig.axes, ("outer", "middle", "inner"), strict=False))
    return {standard + end: own + end for own, standard in pairs for end in ("", "_rate")}


def _unit(units: dict[str, str], key: str) -> str:
    return f" [{units[key]}]" if key in units else ""


def _said(segment: Segment, key: str) -> bool:
    value = getattr(segment, key)
    return value is not None and (value != 0 or (key in _ANGLES and key in segment.model_fields_set))


def _cell(segment: Segment, key: str) -> str:
    value = getattr(segment, key)
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    return f"{round(math.degrees(value), 6) + 0.0:g}".replace("-", MINUS)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _log(context: Context) -> Block:
    evidence = context.evidence
    recording = evidence.recording
    what = "Static intervals" if by_hand(context.calibration) else "Segments"
    caption = f"{what} over the log of the recording."
    if recording is None:
        return not_drawn(caption, evidence.absent.get("recording", "there is no recording"))
    return picture(
        lambda: pictures.log(recording, evidence.plan, context.calibration),
        caption,
        f"{what} shaded over the accelerometer and gyro readings of the whole recording",
    )


def site(context: Context) -> Section:
    """Where the unit was, and what surrounded it."""
    calibration, given = context.calibration, context.details.environment
    at = calibration.site
    latitude = NOT_STATED if at.latitude is None else f"{math.degrees(at.latitude):.6g}°".replace("-", MINUS)
    gravity = f"{at.gravity:.7f} m/s²" + (f" ({at.gravity_source})" if at.gravity_source else "")
    rows = [("Latitude", latitude)]
    if at.latitude is not None:
        rows.append(("Height", f"{at.height:g} m".replace("-", MINUS)))
    rows.append(("Gravity and its source", gravity))
    uncertainty = context.evidence.plan.gravity_uncertainty if context.evidence.plan is not None else None
    if uncertainty is not None:
        text = quantity(uncertainty, "m/s^2") if uncertainty > 0 else "not stated: gravity is taken as exact"
        rows.append(("Uncertainty of gravity", text))
    if at.earth_rate is not None:
        rows.append(("Earth rate", f"{at.earth_rate:.7g} rad/s ({math.degrees(at.earth_rate) * 3600:.6f} deg/h)"))
    rows += [
        ("Ambient temperature", or_not_stated(given.temperature.replace("degC", "°C"))),
        ("Temperature of the unit", _temperature(calibration)),
        ("Relative humidity", or_not_stated(given.humidity)),
        ("Pressure", or_not_stated(given.pressure)),
    ]
    if given.remarks:
        rows.append(("Environment, remarks", given.remarks))
    return Section("Site, gravity and environment", (Facts(tuple(rows)),))


def _temperature(calibration: Calibration) -> str:
    seen = calibration.environment.temperature
    if seen is None:
        return "not recorded"
    mean, low, high = (t - 273.15 for t in (seen.mean, seen.minimum, seen.maximum))
    return f"{mean:.2f} °C ({low:.2f} to {high:.2f} °C), as recorded".replace("-", MINUS)


def method(context: Context) -> Section:
    """The method in words and equations, with its sources."""
    calibration = context.calibration
    known = method_of(calibration)
    blocks: list[Block] = [Text(f"Method: {known.title}.")]
    for words, equations in known.parts:
        blocks += [Text(words, "maths"), Equation(equations)]
    if not known.parts:
        blocks.append(Text("This version of the software has no description of this method.", "missing"))
    blocks += [Text(" ".join(uncertainty_in_words(calibration))), *noise(context), *_scales(calibration)]
    if any(".misalignment." in p.name for p in calibration.parameters):
        blocks.append(Text(_MISALIGNMENT[calibration.misalignment], "maths"))
    if known.sources:
        blocks += [Text("Sources:"), Bullets(known.sources)]
    return Section("Method", tuple(blocks))


_MISALIGNMENT = {
    "element": "misalignment.ij is the element S_ij of the matrix S (with raw counts S_ij/S_ii): what output i shows of input j.",
    "input-axis": "misalignment.ij is S_ij/S_ii: what the input axis of sensor i has along axis j.",
}


def _scales(calibration: Calibration) -> list[Block]:
    if not calibration.unit.scale:
        return []
    said = ", ".join(f"{k} {v}" for k, v in calibration.unit.scale.items())
    return [Text(f"Nominal scale factors that turned the counts of the unit into SI: {said}.")]
