"""Matrices parted into a rotation and a triangular factor with a positive diagonal; a triangular one stays as it is."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..frames import Array

_FLIP = np.eye(3)[::-1]


def rotation_times_lower(matrix: Array) -> tuple[Array, Array]:
    """M = Q L with a rotation Q and a lower triangular L.

    Raises
    ------
    InputError
        When the axes form a left-handed frame, which no rotation turns into a right-handed one.
    """
    if not np.triu(matrix, 1).any() and np.all(np.diag(matrix) > 0):
        return np.eye(3), matrix
    Q, U = rotation_times_upper(matrix @ _FLIP, hand=-1.0)
    return Q @ _FLIP, _FLIP @ U @ _FLIP


def rotation_times_upper(matrix: Array, hand: float = 1.0) -> tuple[Array, Array]:
    """M = Q U with a rotation Q and an upper triangular U; `hand` is the sign of the determinant."""
    if hand > 0 and not np.tril(matrix, -1).any() and np.all(np.diag(matrix) > 0):
        return np.eye(3), matrix
    if not np.linalg.det(matrix) * hand > 0:
        raise InputError(
            "the sensor axes form a left-handed frame (an axis is labelled with the wrong sign, or two are exchanged): the "
            "target has only rotations and positive scales for them. Correct the labels and calibrate again"
        )
    Q, U = np.linalg.qr(matrix)
    sign = np.where(np.diag(U) < 0, -1.0, 1.0)
    return np.asarray(Q * sign), np.triu(sign[:, None] * U)


def lower_times_rotation(matrix: Array) -> tuple[Array, Array]:
    """M = L Q with a lower triangular L and a rotation Q."""
    Q, U = rotation_times_upper(matrix.T)
    return U.T, Q.T


def angle(rotation: Array) -> float:
    """Angle of a rotation, rad, exact for small ones."""
    twice_sine = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    return float(np.arctan2(np.linalg.norm(twice_sine), np.trace(rotation) - 1.0))
