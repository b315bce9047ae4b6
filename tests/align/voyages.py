"""Made-up voyages: a course, what an imperfect slave measures on it and what a noisy master logs, all with their truth known."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from sagnac.align.config import Config, from_table
from sagnac.align.master import Master, from_arrays
from sagnac.align.samples import Slave
from sagnac.frames import heading_pitch_roll, rotation_matrix
from sagnac.navigate.trajectory import Trajectory, read

DEG = math.pi / 180
HOUR = 3600.0
G = 9.80665

START = {"latitude": "60 deg", "longitude": "108 deg", "speed": "10 m/s", "heading": "70 deg"}
STRAIGHT = {**START, "leg": [{"duration": "120 s"}]}
S_TURN = {
    **START,
    "leg": [
        {
            "repeat": 2,
            "legs": [
                {"duration": "15 s", "turn_rate": "3 deg/s"},
                {"duration": "30 s", "turn_rate": "-3 deg/s"},
                {"duration": "15 s", "turn_rate": "3 deg/s"},
            ],
        }
    ],
}
SWAYING = {
    **S_TURN,
    "ease": "2 s",
    "sway": {"roll": "4 deg", "roll_period": "9 s", "pitch": "2 deg", "pitch_period": "6 s", "heave": "0.3 m"},
}

PARKED = {
    "latitude": "48 deg",
    "speed": "0 m/s",
    "heading": "30 deg",
    "leg": [{"duration": "60 s"}],
    "sway": {"roll": "2 deg"},
}
AIRCRAFT = {
    "latitude": "48 deg",
    "longitude": "179.95 deg",
    "height": "3000 m",
    "speed": "200 m/s",
    "heading": "30 deg",
    "bank": "coordinated",
    "leg": [
        {"duration": "30 s"},
        {"duration": "60 s", "turn_rate": "3 deg/s"},
        {"duration": "30 s", "climb": "5 m/s"},
        {"duration": "30 s", "acceleration": "1 m/s^2"},
    ],
}
POLE = {
    "latitude": "89.9 deg",
    "height": "8000 m",
    "speed": "250 m/s",
    "heading": "0 deg",
    "path": "great-circle",
    "leg": [{"duration": "90 s"}],
}
WAYS = {
    "straight": STRAIGHT,
    "s-turn": S_TURN,
    "swaying": SWAYING,
    "parked": PARKED,
    "aircraft": AIRCRAFT,
    "pole": POLE,
}

CONFIG = {
    "initial": {
        "misalignment": ["0.2 deg", "0.2 deg", "0.5 deg"],
        "velocity": "0.2 m/s",
        "gyro_bias": "0.01 deg/h",
        "accel_bias": "50 ug",
    },
    "noise": {"gyro": "0.001 deg/sqrt(h)", "accel": "0.833 ug/sqrt(Hz)", "velocity": "0.01 m/s"},
}


def config(**changes: object) -> Config:
    """The usual settings; ``initial__delay="0.1 s"`` changes one of a table."""
    table = {k: dict(v) for k, v in CONFIG.items()}
    for key, value in changes.items():
        part, _, name = key.partition("__")
        if name:
            table.setdefault(part, {})[name] = value
        else:
            table[key] = value
    return from_table(table)


@dataclass(frozen=True)
class Voyage:
    """Arrays of both logs, SI.

    ``time, gyro, accel``: means of the slave over each interval that ends at its time. ``stamps, place, velocity, angles``: the
    master's.
    """

    time: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    stamps: np.ndarray
    place: np.ndarray
    velocity: np.ndarray
    angles: np.ndarray
    truth: dict[str, float] = field(default_factory=dict)

    @property
    def slave(self) -> Slave:
        steps = np.diff(self.time)
        return Slave(self.time, steps, self.gyro[1:] * steps[:, None], self.accel[1:] * steps[:, None])

    @property
    def master(self) -> Master:
        return from_arrays(self.stamps, *self.place.T, self.velocity, self.angles)

    def write(self, folder: Path, **drop: bool) -> tuple[Path, Path]:
        """Master and slave as Parquet files with the usual headers."""
        columns = {
            "time [s]": self.stamps,
            "latitude [deg]": self.place[:, 0] / DEG,
            "longitude [deg]": self.place[:, 1] / DEG,
        }
        columns |= {"height [m]": self.place[:, 2]}
        columns |= {f"v_{n} [m/s]": self.velocity[:, i] for i, n in enumerate(("east", "north", "up"))}
        if not drop.get("attitude"):
            columns |= {f"{n} [deg]": self.angles[:, i] / DEG for i, n in enumerate(("heading", "pitch", "roll"))}
        parquet.write_table(pa.table(columns), folder / "master.parquet")
        columns = {"time [s]": self.time}
        columns |= {f"accel_{n} [g]": self.accel[:, i] / G for i, n in enumerate("xyz")}
        columns |= {f"gyro_{n} [deg/s]": self.gyro[:, i] / DEG for i, n in enumerate("xyz")}
        parquet.write_table(pa.table(columns), folder / "slave.parquet")
        return folder / "master.parquet", folder / "slave.parquet"


@lru_cache(maxsize=64)
def _true(way: str, frequency: float, rate: float, lever: tuple[float, float, float]):
    base = Trajectory.of(read.from_table(WAYS[way]))
    slave = base.carry(lever_arm=lever) if any(lever) else base
    counted = slave.increments(frequency)
    stamps = np.arange(int(base.duration * rate + 1e-9) + 1) / rate
    return counted, stamps, base.state(stamps)


def voyage(
    way: str = "s-turn",
    *,
    seed: int = 1,
    frequency: float = 100.0,
    rate: float = 10.0,
    mounting: tuple[float, float, float] = (0.2, -0.15, 0.4),
    gyro_bias: tuple[float, float, float] = (0.01, -0.008, 0.006),
    accel_bias: tuple[float, float, float] = (40.0, -30.0, 20.0),
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0),
    late: float = 0.0,
    velocity_noise: float = 0.01,
    attitude_noise: float = 0.0,
) -> Voyage:
    """A voyage; mounting in deg, biases in deg/h and ug, lever arm in m, attitude noise in arcmin."""
    rng = np.random.default_rng(seed)
    counted, stamps, state = _true(way, frequency, rate, lever)
    mu = np.array(mounting) * DEG
    steps = counted.steps[:, None]
    C = rotation_matrix(mu)
    w, f = np.array(gyro_bias) * DEG / HOUR, np.array(accel_bias) * 1e-6 * G
    noise = [0.001 * DEG / 60 * np.sqrt(steps), 0.833e-6 * G * np.sqrt(steps)]
    gyro = (counted.turns @ C + w * steps + noise[0] * rng.standard_normal(counted.turns.shape)) / steps
    accel = (counted.pushes @ C + f * steps + noise[1] * rng.standard_normal(counted.pushes.shape)) / steps
    velocity = state.velocity_enu + velocity_noise * rng.standard_normal((stamps.size, 3))
    angles = np.column_stack(heading_pitch_roll(state.C_b_n))
    angles = angles + attitude_noise * DEG / 60 * rng.standard_normal(angles.shape)
    place = np.column_stack([*state.place[:2], state.height])
    truth = {f"misalignment.{n}": float(mu[i]) for i, n in enumerate("xyz")}
    truth |= {f"gyro.bias.{n}": float(w[i]) for i, n in enumerate("xyz")}
    truth |= {f"accel.bias.{n}": float(f[i]) for i, n in enumerate("xyz")}
    first = np.zeros((1, 3))
    return Voyage(
        counted.time,
        np.concatenate([gyro[:1] + first, gyro]),
        np.concatenate([accel[:1] + first, accel]),
        stamps + late,
        place,
        velocity,
        angles,
        truth,
    )
