"""What ArduPilot does to the samples before it logs them, and how it is taken back.

Source: ArduPilot, ``libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp`` (``_rotate_and_correct_accel``,
``_rotate_and_correct_gyro``), ``AP_InertialSensor_tempcal.cpp`` (``correct_sensor``, ``polynomial_eval``), names of parameters:
``AP_InertialSensor.cpp`` and ``AP_InertialSensor_Params.cpp``, orientations: ``libraries/AP_Math/rotations.h`` with the angles of
``libraries/AP_Math/tests/test_rotations.cpp``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...frames import Array

REFERENCE = 35.0
"""degC at which the polynomials of temperature are zero."""
_AXES = ("X", "Y", "Z")
_YAWS = tuple(range(0, 360, 45))
_ANGLES = (
    *((0, 0, yaw) for yaw in _YAWS),
    *((180, 0, yaw) if yaw != 180 else (0, 180, 0) for yaw in _YAWS),
    *((roll, 0, yaw) for roll in (90, 270) for yaw in (0, 45, 90, 135)),
    *((0, 90, 0), (0, 270, 0), (0, 180, 90), (0, 180, 270)),
    *((90, 90, 0), (180, 90, 0), (270, 90, 0), (90, 180, 0), (270, 180, 0)),
    *((90, 270, 0), (180, 270, 0), (270, 270, 0), (90, 180, 90), (90, 0, 270)),
    *((90, 68.8, 293.3), (0, 315, 0), (90, 315, 0), (0, 7, 0), (45, 0, 0), (315, 0, 0)),
)
"""Roll, pitch, yaw in deg of the numbered orientations of the board."""
_CUSTOM = {
    100: ("AHRS_CUSTOM_ROLL", "AHRS_CUSTOM_PIT", "AHRS_CUSTOM_YAW"),
    101: ("CUST_ROT1_ROLL", "CUST_ROT1_PITCH", "CUST_ROT1_YAW"),
    102: ("CUST_ROT2_ROLL", "CUST_ROT2_PITCH", "CUST_ROT2_YAW"),
}
Parameters = Mapping[str, float]


@dataclass(frozen=True)
class Thermal:
    """Polynomials of temperature of one sensor.

    Attributes
    ----------
    coefficients : ndarray, shape (3, 3)
        Of the first, second and third power, one column an axis, in 1e-6 of the sensor's unit per degC, degC^2, degC^3.
    lowest, highest : float, degC
        Temperatures outside count as these.
    calibrated : float, degC
        At which offset and scale were found.
    """

    coefficients: Array
    lowest: float
    highest: float
    calibrated: float

    def __call__(self, temperature: Array) -> Array:
        """What was taken off at these temperatures (degC, shape (n,)), shape (n, 3)."""
        return self._at(temperature) - self._at(np.array([self.calibrated]))

    def _at(self, temperature: Array) -> Array:
        t = np.clip(temperature, self.lowest, self.highest)[:, None] - REFERENCE
        first, second, third = self.coefficients
        taken: Array = 1e-6 * t * (first + t * (second + t * third))
        return taken


@dataclass(frozen=True)
class Correction:
    """How the samples of one sensor became those that were logged: ``R diag(scale) (raw - thermal(T) - offset)``.

    Attributes
    ----------
    offset, scale : ndarray, shape (3,)
        In the sensor's unit; the scale of gyros is one.
    turn : ndarray, shape (3, 3)
        From the axes of the sensor to those of the vehicle.
    thermal : Thermal or None
    """

    offset: Array
    scale: Array
    turn: Array
    thermal: Thermal | None

    def undo(self, values: Array, temperature: Array) -> Array:
        """Samples as they were before.

        Parameters
        ----------
        values : ndarray, shape (n, 3)
        temperature : ndarray, shape (n,), degC
        """
        raw = values @ self.turn / self.scale + self.offset
        return raw if self.thermal is None else raw + self.thermal(temperature)


def corrections(parameters: Parameters, instance: int) -> dict[str, Correction]:
    """Corrections of ``accel`` and ``gyro`` of one instance, counted from zero.

    Raises
    ------
    InputError
        With the names of the parameters that are missing or make no sense.
    """
    prefix = names(instance)
    turn = _turn(parameters)
    thermal = {kind: _thermal(parameters, prefix, kind) for kind in ("accel", "gyro")}
    accel = Correction(
        _vector(parameters, prefix["accel"]), _vector(parameters, prefix["scale"]), turn, thermal["accel"]
    )
    if not np.all(accel.scale):
        raise InputError(f"{prefix['scale']}_X, _Y, _Z are {_text(accel.scale)}: what was logged cannot be taken back")
    return {"accel": accel, "gyro": Correction(_vector(parameters, prefix["gyro"]), np.ones(3), turn, thermal["gyro"])}


def names(instance: int) -> dict[str, str]:
    """Beginnings of the names of the parameters of one instance, counted from zero."""
    m = instance + 1
    n, group, calibrated = (
        ("" if instance == 0 else str(m)),
        f"INS_TCAL{m}_",
        ("INS_ACC{}_CALTEMP", "INS_GYR{}_CALTEMP"),
    )
    plain = f"INS_ACC{n}OFFS", f"INS_ACC{n}SCAL", f"INS_GYR{n}OFFS"
    if instance > 2:  # a group of their own since there are more than three
        plain, group = (f"INS{m}_ACCOFFS", f"INS{m}_ACCSCAL", f"INS{m}_GYROFFS"), f"INS{m}_TCAL_"
        calibrated = "INS{}_ACC_CALTEMP", "INS{}_GYR_CALTEMP"
    whole = (*plain, group, *(text.format(m) for text in calibrated))
    return dict(zip(("accel", "scale", "gyro", "thermal", "accel_calibrated", "gyro_calibrated"), whole, strict=True))


def concerns(name: str, instance: int) -> bool:
    """Whether a parameter takes part in the corrections of an instance."""
    return name.startswith((*names(instance).values(), "AHRS_ORIENTATION", "AHRS_CUSTOM_", "CUST_ROT"))


def text(found: Mapping[str, Correction], parameters: Parameters) -> str:
    """What was taken back, with numbers."""
    accel, gyro = found["accel"], found["gyro"]
    number = int(parameters["AHRS_ORIENTATION"])
    warm = [(what, c.thermal.calibrated) for what, c in (("accelerometers", accel), ("gyros", gyro)) if c.thermal]
    return (
        f"accelerometers offset {_text(accel.offset)} m/s^2, scale {_text(accel.scale)}; gyros offset {_text(gyro.offset)} "
        f"rad/s; orientation of the board {number}{' (none)' if number == 0 else ''}"
        + "".join(f"; polynomials of temperature of the {what}, calibrated at {t:.4g} degC" for what, t in warm)
    )


def _turn(parameters: Parameters) -> Array:
    number = _get(parameters, "AHRS_ORIENTATION")
    if number in _CUSTOM:
        roll, pitch, yaw = (_get(parameters, name) for name in _CUSTOM[int(number)])
    elif number in range(len(_ANGLES)):
        roll, pitch, yaw = _ANGLES[int(number)]
    else:
        raise InputError(f"AHRS_ORIENTATION is {number:g}, which is no orientation that is known")
    (cr, cp, cy), (sr, sp, sy) = (f(np.radians([roll, pitch, yaw])) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    turn = about_z @ about_y @ about_x
    return np.where(np.abs(turn) < 1e-12, 0.0, turn)  # quarter turns exchange axes and mix nothing


def _thermal(parameters: Parameters, prefix: Mapping[str, str], kind: str) -> Thermal | None:
    p = prefix["thermal"]
    if parameters.get(f"{p}ENABLE", 0.0) != 1.0:  # 2: is being learned, and not applied
        return None
    part = {"accel": "ACC", "gyro": "GYR"}[kind]
    coefficients = np.array([_vector(parameters, f"{p}{part}{power}") for power in (1, 2, 3)])
    limits = _get(parameters, f"{p}TMIN"), _get(parameters, f"{p}TMAX")
    return Thermal(coefficients, *limits, _get(parameters, prefix[f"{kind}_calibrated"]))


def _vector(parameters: Parameters, name: str) -> Array:
    return np.array([_get(parameters, f"{name}_{axis}") for axis in _AXES])


def _get(parameters: Parameters, name: str) -> float:
    if not math.isfinite(value := parameters.get(name, math.nan)):
        raise InputError(
            f"the parameter {name} is {'not a number' if name in parameters else 'not there'}: without it the autopilot's "
            "correction of the samples cannot be taken back; let the log begin at the start of the autopilot"
        )
    return value


def _text(vector: Array) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in vector) + ")"
