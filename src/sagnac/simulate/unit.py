"""A unit with known errors."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..earth import STANDARD_GRAVITY
from ..frames import Array, rot_x, rot_y, rot_z
from ..sensors import Triad

_ARCMIN = np.pi / 10800
_DEG_H = np.pi / 648000


@dataclass(frozen=True)
class SimulatedUnit:
    """Truth of one unit.

    Attributes
    ----------
    accel_matrix, gyro_matrix : ndarray, shape (3, 3)
        S in b; the accelerometers' is lower triangular.
    accel_bias, gyro_bias : ndarray, shape (3,), m/s^2 and rad/s
    mount : tuple of float, rad
        C_b^k = Rx Ry Rz of the three.
    accel_density, gyro_density : float
        White noise, per sqrt(Hz).
    accel_pulse, gyro_pulse : tuple of str or None
        Nominal scale of each axis as a plan writes it; None for readings in SI.
    """

    accel_matrix: Array
    accel_bias: Array
    gyro_matrix: Array
    gyro_bias: Array
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_density: float = 0.0
    gyro_density: float = 0.0
    pulses: dict[str, str] = field(default_factory=dict)

    @property
    def to_b(self) -> Array:
        """C_k^b."""
        x, y, z = self.mount
        return np.asarray((rot_x(x) @ rot_y(y) @ rot_z(z)).T)

    def truth(self) -> dict[str, float]:
        """Parameters by name, SI."""
        accel, gyro = Triad("accel"), Triad("gyro", full=True)
        out = dict(zip(accel.names, accel.pack(self.accel_matrix, self.accel_bias), strict=True))
        out |= dict(zip(gyro.names, gyro.pack(self.gyro_matrix, self.gyro_bias), strict=True))
        out |= {f"rig.mount.{a}": v for a, v in zip("xyz", self.mount, strict=True)}
        return {k: float(v) for k, v in out.items()}


def laser_gyro_unit(
    *, accel_density: float = 1e-5 * STANDARD_GRAVITY, gyro_density: float = 0.06 * _DEG_H
) -> SimulatedUnit:
    """The laser-gyro unit of [DONG18], table 1.

    Parameters
    ----------
    accel_density : float, m/s^2/sqrt(Hz)
        10 ug/sqrt(Hz): the published 1e-5 g in one second.
    gyro_density : float, rad/s/sqrt(Hz)
        0.001 deg/sqrt(h): the published 0.01 deg/h in 36 s.
    """
    return SimulatedUnit(
        accel_matrix=np.array([[1.002, 0, 0], [1e-4, 1.008, 0], [1e-4, 1e-4, 1.006]]),
        accel_bias=np.array([0.0008, -0.001, -0.0032]) * STANDARD_GRAVITY,
        gyro_matrix=np.array([[1.002, 1e-4, 1e-4], [2e-4, 0.9985, 1e-4], [-6e-4, 5e-4, 0.9985]]),
        gyro_bias=np.array([-0.34, 0.17, -0.02]) * _DEG_H,
        mount=(12 * _ARCMIN, 2 * _ARCMIN, -5 * _ARCMIN),
        accel_density=accel_density,
        gyro_density=gyro_density,
        pulses={
            "accel_x": "10800 pulse/g/s",
            "accel_y": "10400 pulse/g/s",
            "accel_z": "10600 pulse/g/s",
            "gyro": "1.1866 pulse/arcsec",
        },
    )
