"""Courses of all kinds, with units on the vehicle."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from sagnac.earth import ELLIPSOID
from sagnac.frames import rotation_matrix
from sagnac.navigate.trajectory import Trajectory
from sagnac.navigate.trajectory.carried import Flexure
from sagnac.navigate.trajectory.read import from_table

DEG = math.pi / 180.0
A, E2 = ELLIPSOID[:2]
WEAVE = [
    {"duration": "15 s", "turn_rate": "3 deg/s"},
    {"duration": "30 s", "turn_rate": "-3 deg/s"},
    {"duration": "15 s", "turn_rate": "3 deg/s"},
]
SHIP = {"latitude": "55 deg", "longitude": "10 deg", "height": "20 m", "speed": "5 m/s", "heading": "30 deg"}
SWAY = {
    "roll": "10 deg", "roll_period": "9 s", "pitch": "3 deg", "pitch_period": "6.3 s", "pitch_phase": "70 deg",
    "yaw": "2 deg", "heave": "1 m",
}  # fmt: skip
PLANE = {
    "latitude": "48 deg",
    "height": "1 km",
    "speed": "100 m/s",
    "heading": "250 deg",
    "bank": "coordinated",
    "pitch": "2 deg",
}
TABLES = {
    "straight": SHIP | {"leg": [{"duration": "100 s"}]},
    "weave": SHIP | {"leg": [{"duration": "20 s"}, {"repeat": 2, "legs": WEAVE}, {"duration": "20 s"}]},
    "eased": SHIP | {"ease": "2 s", "leg": [{"duration": "20 s"}, {"repeat": 2, "legs": WEAVE}, {"duration": "20 s"}]},
    "great circle": SHIP | {"path": "great-circle", "leg": [{"duration": "20 s"}, {"repeat": 2, "legs": WEAVE}]},
    "speed": SHIP
    | {
        "leg": [
            {"duration": "40 s", "acceleration": "0.3 m/s^2"},
            {"duration": "9 s"},
            {"duration": "40 s", "acceleration": "-0.4 m/s^2"},
        ]
    },
    "sway": SHIP | {"sway": SWAY, "ease": "2 s", "leg": [{"duration": "60 s"}, {"duration": "40 s", "turn_rate": "1 deg/s"}]},
    "plane": PLANE
    | {
        "leg": [
            {"duration": "20 s"},
            {"duration": "40 s", "climb": "200 m", "turn_rate": "3 deg/s"},
            {"duration": "30 s", "climb": "5 deg", "acceleration": "0.5 m/s^2"},
            {"duration": "30 s", "climb": "-3 m/s", "turn_rate": "-6 deg/s"},
            {"duration": "20 s"},
        ]
    },
    "over the pole": PLANE
    | {
        "latitude": "89.95 deg", "longitude": "30 deg", "heading": "0 deg", "path": "great-circle", "speed": "250 m/s",
        "leg": [{"duration": "60 s"}],
    },
    "beside the pole": SHIP | {"latitude": "-89.8 deg", "heading": "80 deg", "speed": "50 m/s", "leg": [{"duration": "100 s"}]},
}  # fmt: skip
ARM = (1.0, -20.0, 4.0)
BEND = np.array([1e-2, -2e-2, 3e-2])
FLEXURE = Flexure(lambda t: (np.outer(np.sin(t), BEND), np.outer(np.cos(t), BEND)), 2.0 * math.pi)
UNITS = {
    "vehicle": {},
    "arm": {"lever_arm": ARM},
    "turned": {"mounting": rotation_matrix([0.1, 0.2, -0.5]), "flexure": FLEXURE, "lever_arm": ARM},
}
STEPPED = ("weave", "great circle")  # what begins a turn at once carries no lever arm


@cache
def trajectory(name: str, unit: str = "vehicle") -> Trajectory:
    vehicle = Trajectory.of(from_table(TABLES[name]), earth_rate=7.3e-5, gravity_excess=1e-3)
    return vehicle.carry(**UNITS[unit]) if unit != "vehicle" else vehicle


every = pytest.mark.parametrize("name", TABLES)
carried = pytest.mark.parametrize(
    ("name", "unit"), [(n, u) for n in TABLES for u in UNITS if u == "vehicle" or n not in STEPPED]
)

# central differences of eighth order
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
