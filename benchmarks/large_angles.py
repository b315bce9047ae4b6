"""How far off a mounting may be: fraction of runs that find it, against the angle, for the start of :mod:`sagnac.align.large` and others.

``python benchmarks/large_angles.py`` prints the table of docs/methods/large_angles.md. Every run draws a mounting of the given size
about the given axis, biases and noise, and is given the same first 60 s. A run counts when the attitude that it ends with is within
1 deg of the truth, which is where a linear filter can begin.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np

from sagnac import earth
from sagnac.align import large, large_model
from sagnac.align.config import Config
from sagnac.align.master import Master
from sagnac.align.samples import Slave
from sagnac.frames import attitude_matrix, rotation_matrix, rotation_vector, skew

MIN = 60.0
DEG = np.pi / 180.0


class Truth(NamedTuple):
    """What ideal sensors in the master's axes count, and the master's true log."""

    time: np.ndarray
    turns: np.ndarray
    pushes: np.ndarray
    master: Master


def s_turn(rate):
    """Heading and its two derivatives: starboard 15 s, port 30 s, starboard 15 s, over and over."""

    def heading(t):
        late = np.mod(t + 15.0, 60.0)
        return rate * np.where(late < 30.0, late - 15.0, 45.0 - late), rate * np.where(late < 30.0, 1.0, -1.0), 0.0 * t

    return heading


def weave(rate, period=20.0):
    """A heading rate that swings smoothly, for what needs its derivative."""
    w = 2.0 * np.pi / period

    def heading(t):
        return rate / w * (1.0 - np.cos(w * t)), rate * np.sin(w * t), rate * w * np.cos(w * t)

    return heading


def straight(t):
    return 0.0 * t, 0.0 * t, 0.0 * t


def motion(duration, heading=straight, *, speed=10.0, latitude=60.0 * DEG, lever=(0.0, 0.0, 0.0), frequency=100.0, rate=10.0):
    """A level vehicle at a steady speed, first due east; increments by Gauss-Legendre, legs end at samples.

    ``v' = C f - (2 w_ie + w_en) x v + g`` turned round for f, in east, north, up. The lever arm takes the sensors to another place.
    """
    n = round(duration * frequency)
    time = np.arange(n + 1) / frequency
    nodes, weights = np.polynomial.legendre.leggauss(4)
    t = (time[:-1, None] + (0.5 + 0.5 * nodes) / frequency).ravel()
    both = np.concatenate([t, np.arange(round(duration * rate) + 1) / rate])
    order = np.argsort(both, kind="stable")
    angle, turning, bending = (v[order] for v in heading(both))
    east, north = speed * np.cos(-angle), speed * np.sin(-angle)
    gaps = np.diff(both[order], prepend=0.0)
    meridian, normal = earth.radii(latitude)
    lat = latitude + np.cumsum(gaps * north) / meridian
    lon = np.cumsum(gaps * east / np.cos(lat)) / normal
    meridian, normal = earth.radii(lat)
    ie = earth.EARTH_RATE * np.stack([0.0 * lat, np.cos(lat), np.sin(lat)], axis=-1)
    en = np.stack([-north / meridian, east / normal, east / normal * np.tan(lat)], axis=-1)
    v = np.stack([east, north, 0.0 * east], axis=-1)
    gained = turning[:, None] * np.stack([north, -east, 0.0 * east], axis=-1)
    gravity = np.array([earth.normal_gravity(x) for x in lat[:: max(1, lat.size // 200)]])
    gravity = np.interp(np.arange(lat.size), np.arange(lat.size)[:: max(1, lat.size // 200)], gravity)
    force = gained + np.cross(2.0 * ie + en, v)
    force[:, 2] += gravity
    C = attitude_matrix(angle + 0.5 * np.pi, 0.0 * angle, 0.0 * angle)
    f = np.einsum("kji,kj->ki", C, force)
    w = np.einsum("kji,kj->ki", C, ie + en)
    w[:, 2] -= turning
    arm = np.array(lever)
    f += np.cross(w, np.cross(w, arm)) + np.cross(-bending[:, None] * [0.0, 0.0, 1.0], arm)
    back = np.argsort(order, kind="stable")
    inside, log = back[: t.size], back[t.size :]
    total = [np.einsum("q,kqi->ki", 0.5 * weights / frequency, x[inside].reshape(n, 4, 3)) for x in (w, f)]
    master = Master(both[order][log], lat[log], lon[log], 0.0 * lat[log], v[log], C[log])
    return Truth(time, *total, master)


LASER = {"gyro_bias": 0.01 * DEG / 3600, "accel_bias": 50e-6 * 9.80665, "gyro": 0.001 * DEG / 60, "accel": 0.833e-6 * 9.80665}
"""The unit of the published transfer alignment (Huang et al. 2011): rad/s, m/s^2, rad/sqrt(s), m/s/sqrt(s)."""
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
    pushes = truth.pushes @ C_s_m + accel * steps[:, None] + noise.accel * root * rng.standard_normal(truth.pushes.shape)
    m = truth.master
    velocity = m.velocity + noise.velocity * rng.standard_normal(m.velocity.shape)
    attitude = m.attitude
    if config.matching == "velocity+attitude":
        attitude = attitude @ rotation_matrix(noise.attitude * rng.standard_normal((m.time.size, 3)))
    return Slave(truth.time, steps, turns, pushes), Master(m.time, m.latitude, m.longitude, m.height, velocity, attitude), (gyro, accel)


def plain_filter(problem, *, feedback=True):
    """The linear error-state filter, started with no mounting; returns the slave's attitude at the start.

    Attitude ``R = exp([phi x]) R^`` and velocity ``y = y^ + dy`` with both errors in the axes of navigation, so that
    ``dy' = -(R^ f) x phi``, whose matrix is taken at the estimate; feedback after each update, or output correction.
    """
    from sagnac.kernels.invariant import intervals

    turn, push, slopes = intervals(problem.turns, problem.pushes, problem.steps, problem.last, np.zeros(3), np.zeros(3))
    R, y, bias = problem.master.copy(), problem.velocity.copy(), np.zeros(6)
    P, x = np.diag(problem.sigma**2), np.zeros(12)
    C = np.eye(12)
    C[:3, :3] = R
    P = C @ P @ C.T
    back, F, Q = np.eye(3), np.eye(12), np.zeros((12, 12))
    for k in range(problem.last.size):
        q, d, s = turn[k], push[k], slopes[k]
        F[3:6, :3] = -skew(R @ d)
        y = y + R @ d
        R = R @ q
        F[:3, 6:9], F[3:6, 6:9], F[3:6, 9:] = R @ s[0], R @ s[1], R @ s[2]
        shift = s[0] @ bias[:3]
        y = y + R @ (s[1] @ bias[:3] + s[2] @ bias[3:])
        R = R @ rotation_matrix(shift)
        back = back @ q @ rotation_matrix(shift)
        Q[:3, :3], Q[3:6, 3:6] = problem.gathered[k, 0] * np.eye(3), problem.gathered[k, 1] * np.eye(3)
        P, x = F @ P @ F.T + Q, F @ x
        H = np.zeros((3, 12))
        H[:, 3:6] = problem.axes[k].T
        S = H @ P @ H.T + np.diag(problem.noise[:3])
        K = np.linalg.solve(S, H @ P).T
        x = x + K @ (problem.axes[k].T @ (problem.series[k] - y) - H @ x)
        P = P - K @ S @ K.T
        P = 0.5 * (P + P.T)
        if feedback:
            R, y, bias = rotation_matrix(x[:3]) @ R, y + x[3:6], bias + x[6:]
            x = np.zeros(12)
    return rotation_matrix(x[:3]) @ R @ back.T


def wrong(problem, attitude, C_s_m):
    """Angle between an attitude at the start and the true one, rad."""
    return float(np.linalg.norm(rotation_vector(C_s_m.T @ problem.master.T @ attitude)))


def mounting(rng, level, azimuth):
    """A mounting of two given angles: about a level axis in any direction, and then about the vertical, rad."""
    way = rng.uniform(0.0, 2.0 * np.pi)
    return rotation_matrix([0.0, 0.0, azimuth * rng.choice([-1.0, 1.0])]) @ rotation_matrix(
        level * np.array([np.cos(way), np.sin(way), 0.0])
    )
