"""ROS package imu_calib: ``SM`` row by row and ``bias``, corrected = SM raw - bias (``src/accel_calib/accel_calib.cpp``)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..frames import Array
from .canonical import Canonical, Linear
from .loss import lost, nothing, whole
from .record import Exported, Options
from .wording import comments, encoded, header, row, spread

_REMARK = "imu_calib corrects accelerometers only; its node takes the mean of the gyros at rest off them at each start"


class _Numbers(NamedTuple):
    matrix: Array
    bias: Array


def build(canonical: Canonical, options: Options) -> Exported:  # noqa: ARG001 - every builder takes the options
    """The YAML file.

    Raises
    ------
    InputError
        When the calibration has no accelerometers.
    """
    if "accel" not in canonical.triads:
        raise InputError("imu_calib corrects accelerometers, and this calibration has none")
    held = {k: whole(t) if k == "accel" else nothing() for k, t in canonical.triads.items()}
    dropped = lost(canonical.triads, held)
    remarks = (_REMARK,)
    numbers = _numbers(canonical.triads["accel"])
    sigma = [canonical.uncertainty(lambda triads, i=i: _numbers(triads["accel"])[i]) for i in (0, 1)]  # type: ignore[misc]
    lines = comments(header(canonical, dropped, remarks))
    lines += [
        f"# standard uncertainties: {spread(sigma[0])}",
        f"SM: {row(numbers.matrix.ravel())}",
        f"# m/s^2; standard uncertainties: {spread(sigma[1])}",
        f"bias: {row(numbers.bias)}",
    ]
    return Exported({"": encoded(lines)}, dropped, remarks)


def _numbers(triad: Linear) -> _Numbers:
    return _Numbers(triad.matrix, np.asarray(triad.matrix @ triad.bias))
