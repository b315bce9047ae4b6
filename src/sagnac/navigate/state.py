"""What a navigation system knows: attitude, velocity, position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..frames import Array, attitude_matrix, heading_pitch_roll, transform
from . import wander


@dataclass(frozen=True)
class State:
    """Attitude, velocity and position in the wander frame; one, or many at once.

    Attributes
    ----------
    C_b_w : ndarray, shape (..., 3, 3)
        Takes body coordinates to w.
    velocity : ndarray, shape (..., 3), m/s
        Over the Earth, in w.
    C_e_w : ndarray, shape (..., 3, 3)
        Takes Earth-fixed coordinates to w: latitude, longitude and wander angle, see :mod:`sagnac.navigate.wander`.
    height : ndarray, shape (...), m
    """

    C_b_w: Array
    velocity: Array
    C_e_w: Array
    height: Array

    @classmethod
    def at(
        cls,
        latitude: float,
        longitude: float,
        height: float,
        velocity_enu: Array,
        C_b_n: Array,
        wander_angle: float = 0.0,
    ) -> State:
        """A state from latitude, longitude, height (rad, m), velocity in east, north, up (m/s) and attitude."""
        C_n_w = wander.to_enu(wander_angle).T
        return cls(
            C_n_w @ C_b_n,
            C_n_w @ np.asarray(velocity_enu, dtype=float),
            wander.direction_cosines(latitude, longitude, wander_angle),
            np.asarray(height, dtype=float),
        )

    @classmethod
    def from_angles(
        cls,
        latitude: float,
        longitude: float,
        height: float,
        velocity_enu: Array,
        angles: tuple[float, float, float],
        wander_angle: float = 0.0,
    ) -> State:
        """The same with heading, pitch and roll, rad."""
        return cls.at(latitude, longitude, height, velocity_enu, attitude_matrix(*angles), wander_angle)

    @property
    def place(self) -> tuple[Array, Array, Array]:
        """Latitude, longitude and wander angle, rad."""
        return wander.place(self.C_e_w)

    @property
    def C_w_n(self) -> Array:
        """Takes coordinates in w to east, north, up, shape (..., 3, 3)."""
        return wander.to_enu(self.place[2])

    @property
    def velocity_enu(self) -> Array:
        """Velocity in east, north, up, shape (..., 3), m/s."""
        return transform(self.C_w_n, self.velocity)

    @property
    def C_b_n(self) -> Array:
        """Takes body coordinates to east, north, up, shape (..., 3, 3)."""
        return np.asarray(self.C_w_n @ self.C_b_w)

    @property
    def angles(self) -> tuple[Array, Array, Array]:
        """Heading, pitch and roll, rad."""
        return heading_pitch_roll(self.C_b_n)
