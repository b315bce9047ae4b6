"""Kalibr: ``imu.yaml`` with the noise, and the result of its extended calibration with the intrinsics.

``kalibr_common/ConfigReader.py`` (ImuParameters) reads the noise. The extended model is that of
``kalibr_imu_camera_calibration/IccSensors.py``, class IccScaledMisalignedImu, forward and lower triangular ::

    y_a = M_a C_i_b f + b_a,    y_w = M_w C_gyro_i C_i_b w + A C_gyro_i C_i_b f + b_w

with C_i_b of ``T_i_b``. The body b is our frame; Kalibr's frame i is that in which the accelerometers' matrix is triangular. The
biases are splines in time, which the file does not hold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..frames import Array
from . import factors, noise
from .canonical import Canonical, Linear
from .loss import Held, lost, nothing
from .record import Exported, Options
from .wording import comments, encoded, header, real, row, spread

_ARCSEC = np.pi / 648000
_FIELDS = {"accel": "accelerometer", "gyro": "gyroscope"}
_NO_BIAS = "Kalibr estimates the biases as functions of time; its files do not hold them"


class _Intrinsics(NamedTuple):
    """Numbers of the file, each shape (3, 3)."""

    C_i_b: Array
    M_accel: Array
    M_gyro: Array
    C_gyro_i: Array
    A: Array


def noise_yaml(canonical: Canonical, options: Options) -> Exported:
    """``imu.yaml``: noise, topic and rate; nothing is corrected.

    Raises
    ------
    InputError
        When a number is not known.
    """
    numbers, rate = noise.complete(canonical, options)
    dropped = lost(canonical.triads, {kind: nothing() for kind in canonical.triads})
    remarks = ("imu.yaml states noise and corrects nothing: hand Kalibr compensated samples (`sagnac apply`)",)
    lines = comments(header(canonical, dropped, remarks)) + noise_lines(numbers, "")
    return Exported(
        {"": encoded([*lines, f"rostopic: {options.topic}", f"update_rate: {real(rate)}"])}, dropped, remarks
    )


def intrinsics_yaml(canonical: Canonical, options: Options) -> Exported:
    """The result of the extended calibration, model ``scale-misalignment``.

    Raises
    ------
    InputError
        When the calibration lacks a triad, or its axes are left-handed.
    """
    if len(canonical.triads) < 2:
        raise InputError(
            "Kalibr's intrinsics are of accelerometers and gyros together; this calibration has one of them"
        )
    parts = _intrinsics(canonical.triads)
    sigma = _Intrinsics(*canonical.uncertainty(lambda triads: np.stack(_intrinsics(triads))))
    held = {}
    for kind, triad in canonical.triads.items():
        held[kind] = Held(triad.matrix, np.zeros(3), triad.matrix @ triad.g_matrix)
    dropped = lost(canonical.triads, held)
    remarks = [_NO_BIAS, *_frame(parts.C_i_b)]
    numbers = noise.known(canonical, options)
    if len(numbers) < len(noise.UNITS) or options.rate is None:
        remarks.append("noise or rate that is not known is not in the file: --noise and --rate write it")
    T = np.eye(4)
    T[:3, :3] = parts.C_i_b
    lines = comments(header(canonical, dropped, remarks))
    lines += ["imu0:", *_matrix("T_i_b", T, sigma.C_i_b)]
    lines += ["  accelerometers:", *_matrix("M", parts.M_accel, sigma.M_accel, 4)]
    lines += [
        "  gyroscopes:",
        *_matrix("A", parts.A, sigma.A, 4),
        *_matrix("C_gyro_i", parts.C_gyro_i, sigma.C_gyro_i, 4),
    ]
    lines += [*_matrix("M", parts.M_gyro, sigma.M_gyro, 4), *noise_lines(numbers, "  ")]
    lines += ["  model: scale-misalignment", f"  rostopic: {options.topic}", "  time_offset: 0.0"]
    lines += [f"  update_rate: {real(options.rate)}"] if options.rate is not None else []
    return Exported({"": encoded(lines)}, dropped, tuple(remarks))


def noise_lines(numbers: dict[str, float], indent: str) -> list[str]:
    """The noise fields that Kalibr and OpenVINS read, of those that are known."""
    out = []
    for kind, field in _FIELDS.items():
        for ours, theirs in (("density", "noise_density"), ("random_walk", "random_walk")):
            name = f"{kind}_{ours}"
            if name in numbers:
                out += [f"{indent}# {noise.UNITS[name]}", f"{indent}{field}_{theirs}: {real(numbers[name])}"]
    return out


def _intrinsics(triads: dict[str, Linear]) -> _Intrinsics:
    accel, gyro = triads["accel"], triads["gyro"]
    M_accel, C_i_b = factors.lower_times_rotation(accel.forward)
    M_gyro, C_gyro_b = factors.lower_times_rotation(gyro.forward)
    return _Intrinsics(C_i_b, M_accel, M_gyro, C_gyro_b @ C_i_b.T, gyro.g_matrix @ C_gyro_b.T)


def _frame(C_i_b: Array) -> list[str]:
    turned = factors.angle(C_i_b) / _ARCSEC
    if turned < 1e-6:
        return []
    remark = (
        f"Kalibr's frame is that of the accelerometers, {turned:.3g} arcsec from the calibration's: T_i_b holds the rotation; "
        "software that leaves T_i_b out works in Kalibr's frame"
    )
    return [remark]


def _matrix(name: str, values: Array, sigma: Array, indent: int = 2) -> list[str]:
    space = " " * indent
    return [
        f"{space}# standard uncertainties: {spread(sigma)}",
        f"{space}{name}:",
        *(f"{space}- {row(line)}" for line in values),
    ]
