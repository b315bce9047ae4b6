"""A unit turned by hand from rest to rest: a log without rig or plan."""

from __future__ import annotations

import numpy as np

from ..frames import Array, rot_x, rot_y, rot_z, skew
from ..sensors import Correction, forward


def simulate_hand_turned(
    accel: Correction,
    gyro: Correction,
    rng: np.random.Generator,
    *,
    attitudes: int = 24,
    rest: float = 4.0,
    turn: float = 2.0,
    first_rest: float = 10.0,
    frequency: float = 100.0,
    gravity: float = 9.80665,
    accel_noise: float = 0.0,
    gyro_noise: float = 0.0,
    shake: float = 0.5,
) -> tuple[Array, Array, Array]:
    """Readings of a unit that stands still in random attitudes and is turned by 60 to 150 deg between them.

    Parameters
    ----------
    accel, gyro : Correction
        Models of the triads (the gyros' with g-sensitivity).
    rng : numpy Generator
    attitudes : int
    rest, turn, first_rest : float, s
        Time in each attitude, between two, and in the first.
    frequency : float, Hz
    gravity : float, m/s^2
    accel_noise, gyro_noise : float
        Standard deviation of each sample, in the unit of the readings.
    shake : float, m/s^2
        Amplitude of the hand's own acceleration while it turns the unit.

    Returns
    -------
    time : ndarray, shape (n,), s
    accel, gyro : ndarray, shape (n, 3)
        Readings.
    """
    start = rot_z(rng.uniform(0, 2 * np.pi)) @ rot_y(rng.uniform(-1.5, 1.5)) @ rot_x(rng.uniform(0, 2 * np.pi))
    forces, rates = [_still(start, first_rest, frequency, gravity)], [np.zeros((round(first_rest * frequency), 3))]
    attitude = start
    for _ in range(attitudes - 1):
        axis = rng.standard_normal(3)
        angle = axis / np.linalg.norm(axis) * np.radians(rng.uniform(60, 150))
        u = (np.arange(round(turn * frequency)) + 1) / round(turn * frequency)
        progress, speed = u**3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / turn
        turning = attitude @ _exponential(progress[:, None] * angle)
        push = (
            shake
            * np.sin(np.pi * u)[:, None] ** 2
            * np.sin(2 * np.pi * 1.5 * turn * u)[:, None]
            * rng.standard_normal(3)
        )
        forces.append(gravity * turning[:, 2, :] + push)
        rates.append(speed[:, None] * angle)
        attitude = attitude @ _exponential(angle[None])[0]
        forces.append(_still(attitude, rest, frequency, gravity))
        rates.append(np.zeros((round(rest * frequency), 3)))
    force, rate = np.concatenate(forces), np.concatenate(rates)
    time = np.arange(1, len(force) + 1) / frequency
    shape = force.shape
    return (
        time,
        forward(accel, force) + accel_noise * rng.standard_normal(shape),
        forward(gyro, rate, force) + gyro_noise * rng.standard_normal(shape),
    )


def _still(attitude: Array, time: float, frequency: float, gravity: float) -> Array:
    return np.asarray(np.tile(gravity * attitude[2], (round(time * frequency), 1)))


def _exponential(v: Array) -> Array:
    """Rotation matrices of rotation vectors (n, 3)."""
    t = np.linalg.norm(v, axis=1)[:, None, None]
    k = skew(v / np.maximum(t[:, 0], 1e-300))
    return np.asarray(np.eye(3) + np.sin(t) * k + (1 - np.cos(t)) * (k @ k))
