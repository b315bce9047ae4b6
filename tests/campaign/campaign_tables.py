"""Campaigns that take milliseconds a run."""

from __future__ import annotations

from typing import Any

SMALL = {
    "plan.dwell": "1 s",
    "plan.turning": "0 s",
    "plan.move": "0.5 s",
    "recording.frequency": "16 Hz",
    "recording.rest": "0.2 s",
    "recording.sensors": "accel",
    "rig.errors.setting": "normal 1 arcmin",
    "rig.errors.tilt": "normal 5 arcsec",
    "rig.errors.nonperpendicularity": "normal 5 arcsec",
    "rig.errors.zero": "normal 5 arcsec",
    "unit.scale": {},
}
"""The shipped norm scenario with one second in each static position, as in the published case: 10 ug/sqrt(Hz) are 1e-5 g."""


def norm(**more: Any) -> dict[str, Any]:
    """Table of a campaign of accelerometer calibrations."""
    return {"scenario": "norm", "runs": 4, "set": SMALL, **more}
