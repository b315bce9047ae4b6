"""A carried vehicle: what its slave unit feels along a course, and the master's log."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import earth
from ..errors import InputError
from ..frames import Array, rotation_matrix
from ..navigate.trajectory import Trajectory
from ..navigate.trajectory.carried import MARKOV_2, Flexure
from ..navigate.trajectory.course import Course
from ..navigate.trajectory.legs import MARGIN
from .engine import STREAMS
from .noise import generator
from .records import VehicleErrors
from .scenario import Scenario

_DEG = 180.0 / math.pi
_KNOTS = 20
"""Of a flexure, in a correlation time."""


class VehicleMotion:
    """A unit on a vehicle (a :class:`sagnac.simulate.engine.Averaged`).

    Parameters
    ----------
    trajectory : Trajectory
        Of the unit.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """Specific force and angular rate, (n, 3) each, m/s^2 and rad/s."""
        return self.trajectory.inputs(time)

    def means(self, edges: Array) -> tuple[Array, Array]:
        """Their means over the intervals between instants (n + 1,), (n, 3) each."""
        counted = self.trajectory.increments(edges)
        steps = counted.steps[:, None]
        return counted.pushes / steps, counted.turns / steps

    def columns(self, time: Array) -> dict[str, Array]:  # noqa: ARG002 - a vehicle has no channels of its own
        """Nothing."""
        return {}


def course_of(scenario: Scenario) -> Course:
    """The course of a vehicle's scenario."""
    assert scenario.trajectory is not None  # a vehicle without one is refused when it is read
    return scenario.trajectory


def vehicle_of(scenario: Scenario) -> Trajectory:
    """Motion of the master.

    Raises
    ------
    InputError
        When the course cannot be followed.
    """
    course, plan = course_of(scenario), scenario.plan
    excess = earth.gravity_excess(plan.gravity, course.latitude, course.height)
    return Trajectory.of(course, earth_rate=plan.earth_rate, gravity_excess=excess)


def motion_of(scenario: Scenario, misalignment: Array, lever_arm: Array, rng: np.random.Generator) -> VehicleMotion:
    """Motion of the slave.

    Parameters
    ----------
    scenario : Scenario
    misalignment : ndarray, shape (3,), rad
        Rotation vector from the master's body axes to the slave's.
    lever_arm : ndarray, shape (3,), m
        From the master to the slave, in the master's body axes.
    rng : numpy.random.Generator
        For the flexure.

    Raises
    ------
    InputError
        When the course cannot be followed, or not with a lever arm.
    """
    vehicle = vehicle_of(scenario)
    flexure = flexing(scenario, rng, vehicle.duration)
    return VehicleMotion(vehicle.carry(lever_arm=lever_arm, mounting=rotation_matrix(misalignment), flexure=flexure))


def flexing(scenario: Scenario, rng: np.random.Generator, duration: float) -> Flexure | None:
    """Flexure between master and slave: each axis a second-order Gauss-Markov process, None where there is none.

    The process is exact at knots, twenty to a correlation time, and a cubic of the right values and rates between them.
    """
    from scipy.interpolate import CubicHermiteSpline
    from scipy.linalg import expm

    given = scenario.errors
    assert isinstance(given, VehicleErrors)
    if not any(given.flexure):
        return None
    beta, step = MARKOV_2 / given.flexure_time, given.flexure_time / _KNOTS
    knots = np.arange(-MARGIN, duration + MARGIN + step, step)
    # angle over sigma and rate over beta sigma: covariance I when steady, so that what a step adds is I - F F'
    F = expm(beta * step * np.array([[0.0, 1.0], [-1.0, -2.0]]))
    added = np.linalg.cholesky(np.eye(2) - F @ F.T)
    normals = rng.standard_normal((knots.size, 3, 2))
    state = np.empty_like(normals)
    state[0] = normals[0]
    for k in range(1, knots.size):
        state[k] = state[k - 1] @ F.T + normals[k] @ added.T
    size = np.array(given.flexure)
    spline = CubicHermiteSpline(knots, state[..., 0] * size, state[..., 1] * (beta * size))
    rates = spline.derivative()
    return Flexure(lambda time: (spline(time), rates(time)), math.inf, knots)


def log_times(scenario: Scenario) -> tuple[Array, NDArray[np.bool_]]:
    """Time stamps of the master's log before its gaps, (n,), s, and which of them it holds.

    Raises
    ------
    InputError
        When the gaps leave less than two samples.
    """
    master = scenario.master
    end = course_of(scenario).duration
    time = np.arange(math.floor(end * master.frequency * (1.0 + 1e-15)) + 1) / master.frequency
    held = np.ones(time.size, dtype=bool)
    for start, stop in master.gap:
        held &= (time < start) | (time >= stop)
    if held.sum() < 2:
        raise InputError(f"master: {held.sum()} samples of {time.size} are left; make frequency higher, or gap shorter")
    return time, held


class MasterLog(NamedTuple):
    """What the master says, m samples."""

    time: Array
    """(m,), s, as stamped."""
    latitude: Array
    longitude: Array
    height: Array
    velocity: Array
    """(m, 3), m/s: east, north, up."""
    angles: Array
    """(m, 3), rad: heading, pitch, roll."""


def master_log(scenario: Scenario, seed: int) -> MasterLog:
    """The master's log: position, velocity and attitude with the noise of each sample, SI."""
    master = scenario.master
    time, held = log_times(scenario)
    rng = generator(seed, STREAMS["master"])
    noise = [size * rng.standard_normal((time.size, 3))[held] for size in (master.velocity, master.attitude)]
    time = time[held]
    state = vehicle_of(scenario).state(time - master.latency)
    latitude, longitude, _ = state.place
    angles = np.column_stack(state.angles) + noise[1]
    return MasterLog(time, latitude, longitude, state.height, state.velocity_enu + noise[0], angles)


def write_master(path: Path, scenario: Scenario, seed: int) -> None:
    """The master's log as Parquet, see :func:`master_log`."""
    import pyarrow as pa
    from pyarrow import parquet

    log = master_log(scenario, seed)
    heading, pitch, roll = log.angles.T
    columns = {
        "time [s]": log.time,
        "latitude [deg]": log.latitude * _DEG,
        "longitude [deg]": log.longitude * _DEG,
        "height [m]": log.height,
        **{f"v_{n} [m/s]": log.velocity[:, i] for i, n in enumerate(("east", "north", "up"))},
        "heading [deg]": np.mod(heading * _DEG, 360.0),
        "pitch [deg]": pitch * _DEG,
        "roll [deg]": roll * _DEG,
    }
    parquet.write_table(pa.table(columns), path)


def config_text(scenario: Scenario) -> str:
    """The alignment's settings as TOML."""
    import tomlkit

    return tomlkit.dumps(scenario.config)
