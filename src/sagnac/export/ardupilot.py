"""ArduPilot: ``INS_`` parameters, a ``.param`` file.

``libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp`` corrects ``accel -= offset; accel *= scale`` axis by axis and
``gyro -= offset``; the board's rotation comes after that.
"""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..sensors import AXES
from . import autopilot
from .canonical import Canonical, Linear
from .loss import lost
from .record import Exported, Options
from .wording import comments, encoded, header, single

_INSTANCES = {1: "", 2: "2", 3: "3"}
_SENSORS = {"accel": ("ACC", "m/s^2"), "gyro": ("GYR", "rad/s")}
_ZERO_CELSIUS = 273.15
_SCALE = (0.8, 1.2)
_OFFSET, _USUAL_OFFSET = 9.80665, 3.5


def build(canonical: Canonical, options: Options) -> Exported:
    """The parameter file.

    Raises
    ------
    InputError
        When the instance is not there, or ArduPilot's own calibration would refuse the numbers.
    """
    instance = 1 if options.instance is None else options.instance
    if instance not in _INSTANCES:
        raise InputError(f"--instance {instance}: ArduPilot's INS_ parameters are of the instances 1, 2 and 3")
    if "accel" in canonical.triads:
        _check(canonical.triads["accel"])
    dropped = lost(canonical.triads, {k: autopilot.held(t) for k, t in canonical.triads.items()})
    temperature, remarks = _temperature(canonical, options)
    remarks += [text for triad in canonical.triads.values() for text in _advice(triad)]
    lines = comments(header(canonical, dropped, remarks))
    for kind in canonical.triads:
        lines += _parameters(canonical, kind, instance, temperature)
    return Exported({"": encoded(lines)}, dropped, tuple(remarks))


def _parameters(canonical: Canonical, kind: str, instance: int, temperature: float | None) -> list[str]:
    word, unit = _SENSORS[kind]
    # the first instance has older names: INS_ACCOFFS_X, INS_GYROFFS_X, but INS_ACC2OFFS_X, INS_GYR2OFFS_X
    names = [f"INS_{word}{_INSTANCES[instance]}OFFS", f"INS_{word}{_INSTANCES[instance]}SCAL"]
    if kind == "gyro":
        names = ["INS_GYROFFS" if instance == 1 else names[0]]
    values = np.stack(autopilot.offset_and_scale(canonical.triads[kind]))
    sigma = canonical.uncertainty(lambda triads: np.stack(autopilot.offset_and_scale(triads[kind])))
    out = []
    for name, own, number, uncertainty in zip(names, (unit, "1"), values, sigma, strict=False):
        for axis, value, u in zip(AXES.upper(), number, uncertainty, strict=True):
            out += [f"# {name}_{axis}: standard uncertainty {u:.1e} {own}", f"{name}_{axis},{single(value)}"]
    if temperature is not None:
        out.append(f"INS_{word}{instance}_CALTEMP,{single(temperature - _ZERO_CELSIUS)}")
    return out


def _check(accel: Linear) -> None:
    """Limits of ``AccelCalibrator::accept_result`` (libraries/AP_AccelCal/AccelCalibrator.cpp)."""
    autopilot.check_gain(accel, *_SCALE, f"ArduPilot's own calibration accepts {_SCALE[0]} to {_SCALE[1]}")
    for axis, offset in zip(AXES, accel.bias, strict=True):
        if abs(offset) > _OFFSET:
            raise InputError(
                f"the offset of accel {axis} is {offset:.4g} m/s^2; ArduPilot's own calibration accepts up to {_OFFSET} m/s^2"
            )


def _temperature(canonical: Canonical, options: Options) -> tuple[float | None, list[str]]:
    """Temperature of the calibration [K], and a word when it is not known."""
    recorded = canonical.calibration.environment.temperature
    if options.temperature is not None:
        return options.temperature, []
    if recorded is not None:
        return recorded.mean, []
    return None, [
        "the CALTEMP parameters are not in the file: the recording has no temperature; --temperature '25 degC' writes them"
    ]


def _advice(triad: Linear) -> list[str]:
    """What ArduPilot makes of the numbers that the user would not expect."""
    offset, _ = autopilot.offset_and_scale(triad)
    if triad.kind == "gyro":
        return ["ArduPilot finds the gyro offsets anew at each start unless INS_GYR_CAL is 0"]
    if not np.any(np.float32(offset)):
        return ["all accelerometer offsets are zero, which ArduPilot takes for 'never calibrated' and refuses to arm"]
    if np.abs(offset).max() > _USUAL_OFFSET:
        return [f"an accelerometer offset is beyond the documented range of {_USUAL_OFFSET} m/s^2"]
    return []
