"""A master and a slave on a true course, with errors drawn as a configuration says."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass

import numpy as np

from sagnac.align import config as configs
from sagnac.align import master as masters
from sagnac.align.samples import Slave
from sagnac.frames import rotation_matrix
from sagnac.navigate.trajectory import Trajectory

BASE = """
method = "wander"
matching = "velocity"
[initial]
misalignment = ["0.2 deg", "0.2 deg", "0.5 deg"]
velocity = "0.2 m/s"
gyro_bias = "0.01 deg/h"
accel_bias = "50 ug"
[noise]
gyro = "0.001 deg/sqrt(h)"
accel = "0.833 ug/sqrt(Hz)"
velocity = "0.01 m/s"
attitude = "1 arcmin"
[trajectory]
latitude = "60 deg"
longitude = "108 deg"
height = "0 m"
speed = "10 m/s"
heading = "90 deg"
"""
ARCMIN = np.pi / 10800


def legs(*parts):
    """TOML of legs: duration, turn rate in deg/s, and other keys."""
    rows = []
    for duration, turn, *more in parts:
        rows.append(f'[[trajectory.leg]]\nduration = "{duration} s"\nturn_rate = "{turn} deg/s"\n' + "\n".join(more))
    return "\n".join(rows)


S_TURN = legs((15, 3), (30, -3), (15, 3), (15, 3), (30, -3), (15, 3))
"""Of methods.md: 3 deg/s to starboard for 15 s, 30 s to port, 15 s to starboard, repeated."""


def config(more="", base=BASE, **changes):
    """Settings with a course, and other values for some keys."""
    return configs.from_table(tomllib.loads(base + more)).model_copy(update=changes)


@dataclass(frozen=True)
class Scene:
    slave: Slave
    master: masters.Master
    truth: dict[str, np.ndarray]
    course: Trajectory


def drawn(settings, rng):
    """Mounting, gyro bias and accelerometer bias from their sigmas."""
    first = settings.initial
    return [rng.standard_normal(3) * np.array(s) for s in (first.misalignment, first.gyro_bias, first.accel_bias)]


def scene(settings, seed=1, *, errors=None, rate=100.0, master_rate=10.0, noise=True, delay=0.0, lever=(0.0, 0.0, 0.0)):
    """Samples of both; `errors` are mounting, gyro bias, accelerometer bias, drawn unless given."""
    rng = np.random.default_rng(seed)
    mounting, gyro, accel = errors if errors is not None else drawn(settings, rng)
    course = Trajectory.of(settings.trajectory)
    carried = course.carry(lever_arm=lever, mounting=rotation_matrix(mounting))
    exact = carried.increments(rate)
    n, dt = exact.turns.shape[0], 1.0 / rate
    size = np.sqrt(dt) if noise else 0.0
    turns = exact.turns + gyro * dt + settings.noise.gyro * size * rng.standard_normal((n, 3))
    pushes = exact.pushes + accel * dt + settings.noise.accel * size * rng.standard_normal((n, 3))
    stamps = np.arange(int(course.duration * master_rate + 1e-9) + 1) / master_rate
    true = course.state(stamps - delay)  # courses are known from some seconds before their start
    velocity = true.velocity_enu + settings.noise.velocity * noise * rng.standard_normal((stamps.size, 3))
    tilt = (settings.noise.attitude or 0.0) * noise * (settings.matching != "velocity")
    attitude = true.C_b_n @ rotation_matrix(tilt * rng.standard_normal((stamps.size, 3)))
    latitude, longitude, _ = true.place
    master = masters.Master(stamps, latitude, longitude, true.height, velocity, attitude)
    truth = {"misalignment": mounting, "gyro.bias": gyro, "accel.bias": accel}
    return Scene(Slave(exact.time, exact.steps, turns, pushes), master, truth, carried)


def deviations(run, truth, k=-1):
    """Errors of the parameters over their sigmas, by name."""
    out = {}
    for name, value in truth.items():
        for i, axis in enumerate("xyz"):
            full = f"{name}.{axis}"
            if full in run.names:
                j = run.names.index(full)
                out[full] = (run.values[k, j] - value[i]) / run.sigmas[k, j]
    return out
