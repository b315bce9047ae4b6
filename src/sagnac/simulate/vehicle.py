"""A carried vehicle on a straight course: what its slave unit feels, and the master's log.

Along a parallel at a steady speed the inputs are constant in the body, so that the ideal slave is exact.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from .. import earth
from ..errors import InputError
from ..frames import Array
from .engine import STREAMS
from .noise import generator
from .scenario import Scenario

_DEG = 180.0 / math.pi
_ALONG = 1e-9  # rad: how far a course may be off due east or west


class VehicleMotion:
    """A unit on a vehicle that follows a parallel at a steady speed: constant inputs.

    Parameters
    ----------
    force, rate : ndarray, shape (3,), m/s^2 and rad/s
        In the master's body axes.
    """

    def __init__(self, force: Array, rate: Array) -> None:
        self._force, self._rate = force, rate

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """Specific force and angular rate, (n, 3) each, m/s^2 and rad/s."""
        shape = (time.size, 3)
        return np.broadcast_to(self._force, shape), np.broadcast_to(self._rate, shape)

    def columns(self, time: Array) -> dict[str, Array]:  # noqa: ARG002 - a vehicle has no channels of its own
        """Nothing."""
        return {}


# WGS-84 (NIMA TR8350.2, table 3.1)
_SEMI_MAJOR = 6378137.0
_ECCENTRICITY2 = (2.0 - 1.0 / 298.257223563) / 298.257223563


def along_a_parallel(
    latitude: float, height: float, east: float, gravity: float, earth_rate: float = earth.EARTH_RATE
) -> tuple[Array, Array, float]:
    """What a vehicle feels that goes along a parallel at a steady speed.

    Parameters
    ----------
    latitude, height : float, rad and m
    east : float, m/s
        Speed to the east.
    gravity : float, m/s^2
    earth_rate : float, rad/s

    Returns
    -------
    force, rate : ndarray, shape (3,), m/s^2 and rad/s
        In east, north, up: ``f = -g + (2 w_ie + w_en) x v`` and ``w_ie + w_en``.
    longitude_rate : float, rad/s
    """
    normal = _SEMI_MAJOR / math.sqrt(1.0 - _ECCENTRICITY2 * math.sin(latitude) ** 2)
    ie = earth.earth_rate_enu(latitude, earth_rate)
    en = east / (normal + height) * np.array([0.0, 1.0, math.tan(latitude)])
    force = np.array([0.0, 0.0, gravity]) + np.cross(2.0 * ie + en, [east, 0.0, 0.0])
    return force, ie + en, east / ((normal + height) * math.cos(latitude))


def body_axes(heading: float) -> Array:
    """C_b^n of a level vehicle, (3, 3): x right, y forward, z up; the heading is clockwise from north."""
    s, c = math.sin(heading), math.cos(heading)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation(vector: Array) -> Array:
    """Matrix of a rotation vector (3,), rad: takes coordinates in the turned axes to those in the axes turned from."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def motion_of(scenario: Scenario, misalignment: Array) -> tuple[VehicleMotion, float]:
    """Motion of the slave, and the vehicle's rate along its parallel, rad/s of longitude.

    Parameters
    ----------
    scenario : Scenario
    misalignment : ndarray, shape (3,), rad
        Rotation vector from the master's body axes to the slave's.

    Raises
    ------
    InputError
        When the course is not along a parallel.
    """
    way = scenario.trajectory
    assert way is not None  # a vehicle without one is refused when it is read
    if abs(math.cos(way.heading)) > _ALONG:
        raise InputError(
            f"trajectory.heading: {math.degrees(way.heading):g} deg: only courses due east or west are simulated"
        )
    if abs(way.latitude) > 1.57:
        raise InputError(f"trajectory.latitude: {math.degrees(way.latitude):g} deg has no parallel to follow")
    gravity = scenario.plan.gravity or earth.normal_gravity(way.latitude, way.height)
    east = way.speed * math.sin(way.heading)
    force, rate, turning = along_a_parallel(way.latitude, way.height, east, gravity, scenario.plan.earth_rate)
    to_slave = (body_axes(way.heading) @ rotation(misalignment)).T
    return VehicleMotion(to_slave @ force, to_slave @ rate), turning


def write_master(path: Path, scenario: Scenario, seed: int) -> None:
    """The master's log as Parquet: position, velocity and attitude with the noise of each sample."""
    import pyarrow as pa
    from pyarrow import parquet

    way, master = scenario.trajectory, scenario.master
    assert way is not None  # a vehicle without one is refused when it is read
    _, turning = motion_of(scenario, np.zeros(3))
    time = np.arange(math.floor(way.duration * master.frequency) + 1) / master.frequency
    rng = generator(seed, STREAMS["master"])
    velocity = np.array([way.speed * math.sin(way.heading), 0.0, 0.0])
    velocity = velocity + master.velocity * rng.standard_normal((time.size, 3))
    attitude = np.array([way.heading, 0.0, 0.0]) + master.attitude * rng.standard_normal((time.size, 3))
    true_time = time - master.latency
    columns = {
        "time [s]": time,
        "latitude [deg]": np.full(time.size, way.latitude * _DEG),
        "longitude [deg]": (way.longitude + turning * true_time) * _DEG,
        "height [m]": np.full(time.size, way.height),
        **{f"v_{n} [m/s]": velocity[:, i] for i, n in enumerate(("east", "north", "up"))},
        **{f"{n} [deg]": attitude[:, i] * _DEG for i, n in enumerate(("heading", "pitch", "roll"))},
    }
    parquet.write_table(pa.table(columns), path)


def config_text(scenario: Scenario) -> str:
    """The alignment's settings as TOML."""
    import tomlkit

    return tomlkit.dumps(scenario.config)
