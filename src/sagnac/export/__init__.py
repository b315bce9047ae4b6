"""Calibrations in the files of other software, one module a target.

Every exporter starts from the one correction of :mod:`.canonical`, writes what its target holds, and says what it does not
hold and how large that is (:mod:`.loss`).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from ..calibration import Calibration
from ..errors import InputError
from . import ardupilot, c_header, imu_calib, imu_tk, kalibr, matlab, openvins, plain_json, px4, vins
from .canonical import Canonical, Linear, canonical
from .record import Dropped, Exported, Options

__all__ = ["TARGETS", "Canonical", "Dropped", "Exported", "Linear", "Options", "Target", "canonical", "export"]

_TOPIC = re.compile(r"[~/A-Za-z][A-Za-z0-9_/]*")


@dataclass(frozen=True)
class Target:
    """Software that a calibration can be written for.

    Attributes
    ----------
    what : str
        What is written.
    build : callable
        Makes the files from the canonical correction and the options.
    ending : str
        Usual ending of the file.
    counts : bool
        Whether it takes readings in raw counts.
    binary : bool
        Whether the file is no text.
    """

    what: str
    build: Callable[[Canonical, Options], Exported]
    ending: str
    counts: bool = False
    binary: bool = False


TARGETS = {
    "px4": Target("PX4 parameters for QGroundControl", px4.build, ".params"),
    "ardupilot": Target("ArduPilot parameters", ardupilot.build, ".param"),
    "ros": Target("YAML file of the ROS package imu_calib", imu_calib.build, ".yaml"),
    "kalibr": Target("Kalibr's imu.yaml: noise only", kalibr.noise_yaml, ".yaml"),
    "kalibr-intrinsics": Target("Kalibr's result with scale and misalignment", kalibr.intrinsics_yaml, ".yaml"),
    "imu_tk": Target("imu_tk's .calib files, one a triad", imu_tk.build, ".calib", counts=True),
    "openvins": Target("OpenVINS' kalibr_imu_chain.yaml, model kalibr", openvins.kalibr_model, ".yaml"),
    "openvins-rpng": Target("OpenVINS' kalibr_imu_chain.yaml, model rpng", openvins.rpng_model, ".yaml"),
    "vins": Target("noise lines of VINS-Mono's configuration", vins.build, ".yaml"),
    "matlab": Target("MATLAB .mat file", matlab.build, ".mat", counts=True, binary=True),
    "c": Target("C header with the correction", c_header.build, ".h", counts=True),
    "json": Target("plain JSON: the correction with its covariance", plain_json.build, ".json", counts=True),
}
"""What can be written, by the name of the target."""


def export(calibration: Calibration, target: str, options: Options | None = None) -> Exported:
    """A calibration in the form of other software.

    Parameters
    ----------
    calibration : Calibration
    target : str
        A key of :data:`TARGETS`.
    options : Options, optional

    Returns
    -------
    Exported
        Content of the files and what they do not hold; :meth:`Exported.save` writes them.

    Raises
    ------
    InputError
        When the target is not known, takes no raw counts, or needs something that is not given.
    DataError
        When the calibration has no correction that could be exported.
    """
    if target not in TARGETS:
        raise InputError(f"no target {target!r}; there are: {', '.join(TARGETS)}")
    options = options or Options()
    if not _TOPIC.fullmatch(options.topic):
        raise InputError(f"--topic {options.topic!r}: a ROS topic has letters, digits, _ and /, as in /imu0")
    correction = canonical(calibration)
    counted = [kind for kind, triad in correction.triads.items() if triad.counts]
    if counted and not TARGETS[target].counts:
        fits = ", ".join(name for name, t in TARGETS.items() if t.counts)
        raise InputError(
            f"the calibration is for {' and '.join(counted)} readings in raw counts, and {target} works on SI readings, which "
            "its drivers make of the counts: calibrate samples of that software's own log, or open the recording with the "
            f"nominal scale (--scale) that it uses. Counts are taken by: {fits}"
        )
    done = TARGETS[target].build(correction, options)
    return replace(done, remarks=(*correction.remarks, *done.remarks))
