"""How far off a mounting may be: fraction of runs that find it, against its size, for :mod:`sagnac.align.large` and others.

``python benchmarks/large_angles.py [runs]`` prints the tables of docs/methods/large_angles.md. Every run draws a mounting of
the given size, biases and noise; all methods get the same samples and the same prior, 30 deg in level and 60 deg in azimuth.
A run counts when the mounting in the end is within 1 deg of the truth, and in the last column when the linear filter is off by
less than 4.6 of its own sigma (0.9999 of three Gaussian errors).
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np

from sagnac.align import large
from sagnac.align import run as linear
from sagnac.align.config import Config
from sagnac.align.large import fit as large_fit
from sagnac.align.large import model as large_model
from sagnac.align.master import Master
from sagnac.align.samples import Slave
from sagnac.frames import rotation_matrix, rotation_vector
from sagnac.navigate.trajectory import Trajectory, read

DEG = np.pi / 180.0


class Truth(NamedTuple):
    """What ideal sensors in the master's axes count, and the master's true log."""

    time: np.ndarray
    turns: np.ndarray
    pushes: np.ndarray
    master: Master


S_TURN = (
    {"duration": "15 s", "turn_rate": "3 deg/s"},
    {"duration": "30 s", "turn_rate": "-3 deg/s"},
    {"duration": "15 s", "turn_rate": "3 deg/s"},
)


def motion(*legs, lever=(0.0, 0.0, 0.0), frequency=100.0, rate=10.0, start=0.0, **more):
    """Increments and log of a vehicle at 60 N and 10 m/s, first due east; the log begins at `start`."""
    table = {"latitude": "60 deg", "speed": "10 m/s", "heading": "90 deg", "leg": list(legs), **more}
    way = Trajectory.of(read.from_table(table))
    counted = way.carry(lever_arm=lever).increments(frequency)
    time = start + np.arange(int((way.duration - start) * rate + 1e-9) + 1) / rate
    state = way.state(time)
    latitude, longitude, _ = state.place
    master = Master(time, latitude, longitude, state.height, state.velocity_enu, state.C_b_n)
    return Truth(counted.time, counted.turns, counted.pushes, master)


def straight(duration, **more):
    """The same on a straight course."""
    return motion({"duration": f"{duration} s"}, **more)


LASER = {
    "gyro_bias": 0.01 * DEG / 3600,
    "accel_bias": 50e-6 * 9.80665,
    "gyro": 0.001 * DEG / 60,
    "accel": 0.833e-6 * 9.80665,
}
"""The unit of the published transfer alignment [HUANG11]: rad/s, m/s^2, rad/sqrt(s), m/s/sqrt(s)."""
MEMS = {"gyro_bias": 20.0 * DEG / 3600, "accel_bias": 2e-3 * 9.80665, "gyro": 0.15 * DEG / 60, "accel": 50e-6 * 9.80665}
"""A small tactical one."""


def settings(sigma, grade=LASER, **more):
    """Configuration with the prior of the mounting in rad."""
    return Config(
        initial={
            "misalignment": tuple(sigma),
            "velocity": 0.2,
            "gyro_bias": grade["gyro_bias"],
            "accel_bias": grade["accel_bias"],
            **more.pop("initial", {}),
        },
        noise={"gyro": grade["gyro"], "accel": grade["accel"], "velocity": 0.01, **more.pop("noise", {})},
        **more,
    )


def run(truth, config, C_s_m, rng):
    """A slave and a master with the errors that the configuration speaks of: (slave, master, biases)."""
    steps = np.diff(truth.time)
    noise, first = config.noise, config.initial
    gyro, accel = (np.array(s) * rng.standard_normal(3) for s in (first.gyro_bias, first.accel_bias))
    root = np.sqrt(steps)[:, None]
    turns = truth.turns @ C_s_m + gyro * steps[:, None] + noise.gyro * root * rng.standard_normal(truth.turns.shape)
    pushes = (
        truth.pushes @ C_s_m + accel * steps[:, None] + noise.accel * root * rng.standard_normal(truth.pushes.shape)
    )
    m = truth.master
    velocity = m.velocity + noise.velocity * rng.standard_normal(m.velocity.shape)
    attitude = m.attitude
    if config.matching == "velocity+attitude":
        attitude = attitude @ rotation_matrix(noise.attitude * rng.standard_normal((m.time.size, 3)))
    master = Master(m.time, m.latitude, m.longitude, m.height, velocity, attitude)
    return Slave(truth.time, steps, turns, pushes), master, (gyro, accel)


def mounting(rng, level, azimuth):
    """A mounting of two given angles: about a level axis in any direction, and then about the vertical, rad."""
    way = rng.uniform(0.0, 2.0 * np.pi)
    return rotation_matrix([0.0, 0.0, azimuth * rng.choice([-1.0, 1.0])]) @ rotation_matrix(
        level * np.array([np.cos(way), np.sin(way), 0.0])
    )


def linear_filter(config, slave, master, first=None):
    """Mounting from the linear filter of the alignment, started with none or a given one, and its covariance."""
    found = linear.transfer(config, slave, master, mounting=first)
    where = [found.names.index(f"misalignment.{a}") for a in "xyz"]
    return rotation_matrix(found.values[-1, where]), found.covariance[np.ix_(where, where)]


def batch(config, slave, master):
    """The problem of all samples."""
    stamps = master.time
    chosen = np.flatnonzero(stamps <= slave.time[-1] + 1e-9)
    return large_model.prepare(config, slave, master, chosen)


METHODS = {
    "linear filter": linear_filter,
    "left-invariant filter": lambda *given: (large_fit.by_filter(batch(*given)).mounting, None),
    "vectors (Wahba)": lambda *given: (large_fit.by_vectors(batch(*given)).mounting, None),
    "start": lambda *given: (large.start(*given, target=0.0).C_s_m, None),
}
SIZES = ((1, 2), (2, 4), (3, 6), (5, 10), (10, 20), (15, 30), (22.5, 45), (30, 60), (45, 90), (60, 135), (90, 180))
"""Level and azimuth, deg."""


def fractions(truth, config, size, runs):
    """Fraction of runs in which each method ends within 1 deg, and the linear one within its own sigma."""
    rng = np.random.default_rng(round(10 * size[0]))
    hits = np.zeros(len(METHODS) + 1)
    for _ in range(runs):
        C_s_m = mounting(rng, size[0] * DEG, size[1] * DEG)
        slave, master, _ = run(truth, config, C_s_m, rng)
        found = [method(config, slave, master) for method in METHODS.values()]
        errors = [rotation_vector(C_s_m.T @ C) for C, _ in found]
        hits[:-1] += [np.linalg.norm(error) < DEG for error in errors]
        hits[-1] += errors[0] @ np.linalg.solve(found[0][1], errors[0]) < 4.6**2
    return hits / runs


def table(title, truth, config, runs):
    """One table."""
    names = ["level, azimuth [deg]", *METHODS, "linear, in its sigma"]
    print(f"\n{title}, {runs} runs a row\n\n| {' | '.join(names)} |\n|{' --- |' * len(names)}")
    for size in SIZES:
        row = fractions(truth, config, size, runs)
        print(f"| {size[0]:g}, {size[1]:g} | " + " | ".join(f"{100 * x:.0f} %" for x in row) + " |", flush=True)


def honesty(truth, runs):
    """Squared errors of the linear filter against its covariance, with and without a start, mountings drawn from its prior."""
    print(f"\nS-turn, laser-gyro unit, 60 s, {runs} runs a row: normalised squared error, median and mean")
    print("\n| sigma of level, azimuth [deg] | linear filter | after a start |\n| --- | --- | --- |")
    for level, azimuth in ((0.2, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 2.0), (3.0, 3.0), (10.0, 20.0), (30.0, 60.0)):
        config, rng = settings(np.array([level, level, azimuth]) * DEG), np.random.default_rng(1)
        squares = []
        for _ in range(runs):
            C_s_m = rotation_matrix(np.array(config.initial.misalignment) * rng.standard_normal(3))
            slave, master, _ = run(truth, config, C_s_m, rng)
            ends = [
                linear_filter(config, slave, master, m) for m in (None, large.start(config, slave, master).mounting)
            ]
            errors = [rotation_vector(C_s_m.T @ C) for C, _ in ends]
            squares.append([e @ np.linalg.solve(P, e) for e, (_, P) in zip(errors, ends, strict=True)])
        both = [f"{np.median(v):.3g}, {np.mean(v):.3g}" for v in np.transpose(squares)]
        print(f"| {level:g}, {azimuth:g} | {both[0]} | {both[1]} |", flush=True)


def main(runs=100):
    """All of them."""
    sigma = np.array([30.0, 30.0, 60.0]) * DEG
    honesty(motion(*S_TURN), runs)
    laser, mems = (settings(sigma, grade, gate="off") for grade in (LASER, MEMS))
    table("S-turn, laser-gyro unit, 60 s", motion(*S_TURN), laser, runs)
    table("S-turn, small tactical unit, 60 s", motion(*S_TURN), mems, runs)
    table("Straight course, laser-gyro unit, 120 s", straight(120), laser, runs)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
