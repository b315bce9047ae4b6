"""PX4: offsets and accelerometer scales as parameters, a QGroundControl ``.params`` file.

``src/lib/sensor_calibration/Accelerometer.hpp`` of PX4-Autopilot corrects ``(data - thermal - offset).emult(scale)``,
``Gyroscope.hpp`` ``data - thermal - offset``; the board's rotation comes after that. The file is read by
``ParameterManager::readParametersFromStream`` of QGroundControl: five fields with tabs between.
"""

from __future__ import annotations

import math

import numpy as np

from ..errors import InputError
from ..sensors import AXES
from . import autopilot
from .canonical import Canonical, Linear
from .loss import lost
from .record import Exported, Options
from .wording import comments, encoded, header, single

_LOG = "PX4 ULog"
_SLOTS = 4
_SENSORS = {"accel": "ACC", "gyro": "GYRO"}
_LEAST_CHANGE = 0.01
_LEAST_SCALE = float(np.finfo(np.float32).tiny)
_REAL32, _INT32 = 9, 6


def build(canonical: Canonical, options: Options) -> Exported:
    """The parameter file.

    Raises
    ------
    InputError
        When PX4 has no such slot, or would not take a scale.
    """
    first = _SENSORS[next(iter(canonical.triads))]
    slot, told = autopilot.instance(
        canonical.calibration, _LOG, options.instance, 0, lambda number: f"CAL_{first}{number}_XOFF, ..."
    )
    if not 0 <= slot < _SLOTS:
        raise InputError(f"--instance {slot}: PX4 has the calibration slots 0 to {_SLOTS - 1}")
    for triad in canonical.triads.values():
        autopilot.check_gain(triad, _LEAST_SCALE, math.inf, "PX4 takes positive scales only")
    dropped = lost(canonical.triads, {k: autopilot.held(t) for k, t in canonical.triads.items()})
    remarks = [*told, *(text for triad in canonical.triads.values() for text in _ignored(triad))]
    absent = [kind for kind in canonical.triads if kind not in options.device_id]
    if absent:
        names = " and ".join(f"CAL_{_SENSORS[kind]}{slot}_ID" for kind in absent)
        remarks.append(
            f"{names} not in the file: PX4 applies these numbers to the sensors whose identifiers it holds there already; "
            f"--device-id {','.join(f'{kind}=N' for kind in absent)} writes them"
        )
    remarks.append(_changed_by_itself(canonical))
    lines = comments(["Onboard parameters for Vehicle 1", "", *header(canonical, dropped, remarks), ""])
    lines += ["# Vehicle-Id Component-Id Name Value Type"]
    lines += [line for kind in canonical.triads for line in _parameters(canonical, kind, slot, options)]
    return Exported({"": encoded(lines)}, dropped, tuple(remarks))


def _parameters(canonical: Canonical, kind: str, slot: int, options: Options) -> list[str]:
    prefix = f"CAL_{_SENSORS[kind]}{slot}"
    values = np.stack(autopilot.offset_and_scale(canonical.triads[kind]))
    sigma = canonical.uncertainty(lambda triads: np.stack(autopilot.offset_and_scale(triads[kind])))
    out = []
    if kind in options.device_id:
        out.append(f"1\t1\t{prefix}_ID\t{options.device_id[kind]}\t{_INT32}")
    for word, unit, number, uncertainty in zip(
        ("OFF", "SCALE"), ("m/s^2" if kind == "accel" else "rad/s", "1"), values, sigma, strict=True
    ):
        if kind == "gyro" and word == "SCALE":
            continue
        for axis, value, u in zip(AXES.upper(), number, uncertainty, strict=True):
            out += [
                f"# {prefix}_{axis}{word}: standard uncertainty {u:.1e} {unit}",
                f"1\t1\t{prefix}_{axis}{word}\t{single(value)}\t{_REAL32}",
            ]
    return out


def _ignored(triad: Linear) -> list[str]:
    """Small corrections that PX4 of some years does not take: ``ParametersUpdate`` called ``set_offset`` and ``set_scale``."""
    offset, gain = autopilot.offset_and_scale(triad)
    small = [
        word
        for word, size in (("offsets", offset), ("scales", gain - 1.0))
        if 0 < np.linalg.norm(size) <= _LEAST_CHANGE
    ]
    if not small:
        return []
    remark = (
        f"the {triad.kind} {' and '.join(small)} change less than {_LEAST_CHANGE}: PX4 versions that read parameters through "
        "set_offset and set_scale (2020 to 2022) leave so small a change out"
    )
    return [remark]


def _changed_by_itself(canonical: Canonical) -> str:
    """``VehicleIMU.cpp`` (``SensorCalibrationSaveAccel``, ``..Gyro``) and the module ``gyro_calibration``, on by default."""
    text = "PX4 goes on changing these offsets by itself, by what its estimator finds, unless SENS_IMU_AUTOCAL is 0"
    return text + (", and those of the gyros at rest unless IMU_GYRO_CAL_EN is 0" if "gyro" in canonical.triads else "")
