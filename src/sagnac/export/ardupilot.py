"""ArduPilot: ``INS_`` parameters, a ``.param`` file.

``libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp`` corrects ``accel -= offset; accel *= scale`` axis by axis and
``gyro -= offset``; the board's rotation comes after that.
"""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..formats.ardupilot.correction import names
from ..sensors import AXES
from . import autopilot
from .canonical import Canonical, Linear
from .loss import lost
from .record import Exported, Options
from .wording import comments, encoded, header, single

_LOG = "ArduPilot DataFlash"
_INSTANCES = 5
_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}
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
    kind = next(iter(canonical.triads))
    instance, told = autopilot.instance(
        canonical.calibration, _LOG, options.instance, 1, lambda number: f"{names(number - 1)[kind]}_X, ..."
    )
    if not 1 <= instance <= _INSTANCES:
        raise InputError(f"--instance {instance}: ArduPilot's INS_ parameters are of the instances 1 to {_INSTANCES}")
    if "accel" in canonical.triads:
        _check(canonical.triads["accel"])
    dropped = lost(canonical.triads, {k: autopilot.held(t) for k, t in canonical.triads.items()})
    temperature, remarks = _temperature(canonical, options)
    remarks = [*told, *remarks, *(text for triad in canonical.triads.values() for text in _advice(triad))]
    lines = comments(header(canonical, dropped, remarks))
    for kind in canonical.triads:
        lines += _parameters(canonical, kind, instance, temperature)
    return Exported({"": encoded(lines)}, dropped, tuple(remarks))


def _parameters(canonical: Canonical, kind: str, instance: int, temperature: float | None) -> list[str]:
    own = names(instance - 1)
    written = [(own[kind], _UNITS[kind])] + ([(own["scale"], "1")] if kind == "accel" else [])
    values = np.stack(autopilot.offset_and_scale(canonical.triads[kind]))
    sigma = canonical.uncertainty(lambda triads: np.stack(autopilot.offset_and_scale(triads[kind])))
    out = []
    for (name, unit), number, uncertainty in zip(written, values, sigma, strict=False):  # gyros have no scale
        for axis, value, u in zip(AXES.upper(), number, uncertainty, strict=True):
            out += [f"# {name}_{axis}: standard uncertainty {u:.1e} {unit}", f"{name}_{axis},{single(value)}"]
    if temperature is not None:
        out.append(f"{own[f'{kind}_calibrated']},{single(temperature - _ZERO_CELSIUS)}")
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
