"""Plans of positions and rates on a three-axis table."""

from __future__ import annotations

import numpy as np

from ..plan import Noise, Plan, Rig, Segment, Unit
from .unit import SimulatedUnit

# [DONG18], table of positions: middle and inner angle of the twelve vertices of an icosahedron, outer of the static part
_MIDDLE = (0, 0, 0, 0, 58.2825, 121.7175, -58.2825, 238.2825, 148.2825, 211.7175, 31.7175, -31.7175)
_INNER = (-31.7175, 211.7175, 148.2825, 31.7175, 0, 0, 0, 0, 90, 90, 90, 90)
_OUTER = (30, 60, 90, 120, 150, 180, 210, 240, 270, 300, 330, 0)
# six faces of a cube and two tumbled positions, none of them a vertex above: for verification
_CHECK = (
    (10, 0, 0),
    (50, 90, 0),
    (80, 180, 0),
    (130, -90, 0),
    (200, 45, 45),
    (250, 20, 90),
    (300, 70, -90),
    (340, 135, 30),
)

ICOSAHEDRON = tuple(zip(_OUTER, _MIDDLE, _INNER, strict=True))
CHECK = _CHECK


def table_plan(
    unit: SimulatedUnit,
    positions: tuple[tuple[float, float, float], ...] = ICOSAHEDRON,
    *,
    dwell: float = 300.0,
    turning: float = 360.0,
    rate: float = 10.0,
    move: float = 10.0,
    angle_uncertainty: float = np.pi / 10800,
    axis_uncertainty: float = 5 * np.pi / 648000,
    gravity: float = 9.80665,
    latitude: float = 45.0,
) -> Plan:
    """Static and turning segments in the same positions, one after the other.

    Parameters
    ----------
    unit : SimulatedUnit
        Its noise and nominal scale go into the plan.
    positions : tuple of (outer, middle, inner), deg
    dwell, turning, move : float, s
        Time of a static segment, of a turning one, and from one to the next.
    rate : float, deg/s
    angle_uncertainty, axis_uncertainty : float, rad
        Of each setting and of the axes, one sigma.
    gravity : float, m/s^2
    latitude : float, deg

    Returns
    -------
    Plan
    """
    segments, now = [], move
    for prefix, hold, outer_rate in (("s", dwell, 0.0), ("r", turning, rate)):
        if hold <= 0:
            continue
        for i, (outer, middle, inner) in enumerate(positions):
            segments.append(
                Segment(
                    name=f"{prefix}{i + 1}",
                    start=now,
                    stop=now + hold,
                    outer=float(np.radians(outer)),
                    middle=float(np.radians(middle)),
                    inner=float(np.radians(inner)),
                    outer_rate=float(np.radians(outer_rate)),
                )
            )
            now += hold + move
    noise = Noise(accel=unit.accel_density or None, gyro=unit.gyro_density or None)
    return Plan(
        latitude=float(np.radians(latitude)),
        gravity=gravity,
        unit=Unit(model="simulated laser-gyro unit", serial="0001", noise=noise, scale=unit.pulses),
        rig=Rig(angle_uncertainty=angle_uncertainty, axis_uncertainty=axis_uncertainty),
        segment=tuple(segments),
    )
