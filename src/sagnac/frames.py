"""Rotations and small vector algebra, batched over leading axes.

A matrix named ``C_b_n`` takes coordinates in b to coordinates in n. Euler angles appear
only where the rig has real axes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _plane_rotation(angle: ArrayLike, axis: int) -> Array:
    a = np.asarray(angle, dtype=float)
    c, s = np.cos(a), np.sin(a)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((*a.shape, 3, 3))
    out[..., axis, axis] = 1.0
    out[..., i, i] = c
    out[..., j, j] = c
    out[..., i, j] = -s
    out[..., j, i] = s
    return out


def rot_x(angle: ArrayLike) -> Array:
    """Active rotation about x.

    Parameters
    ----------
    angle : array_like, shape (...), rad

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Takes coordinates in the turned frame to coordinates in the frame it was turned from.
    """
    return _plane_rotation(angle, 0)


def rot_y(angle: ArrayLike) -> Array:
    """Active rotation about y, see :func:`rot_x`."""
    return _plane_rotation(angle, 1)


def rot_z(angle: ArrayLike) -> Array:
    """Active rotation about z, see :func:`rot_x`."""
    return _plane_rotation(angle, 2)


def attitude_matrix(heading: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> Array:
    """C_b_n of heading (clockwise from north), pitch (nose up) and roll (right side down).

    Parameters
    ----------
    heading, pitch, roll : array_like, shape (...), rad

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Takes coordinates in b (x right, y forward, z up) to east, north, up.
    """
    return np.asarray(rot_z(-np.asarray(heading, dtype=float)) @ rot_x(pitch) @ rot_y(roll))


def heading_pitch_roll(C_b_n: Array) -> tuple[Array, Array, Array]:
    """Heading, pitch and roll of attitudes, see :func:`attitude_matrix`.

    Parameters
    ----------
    C_b_n : ndarray, shape (..., 3, 3)

    Returns
    -------
    heading, pitch, roll : ndarray, shape (...), rad
        Heading from 0 to 2 pi. With the nose straight up or down heading and roll are not told apart, and any pair may come.
    """
    pitch = np.arctan2(C_b_n[..., 2, 1], np.hypot(C_b_n[..., 0, 1], C_b_n[..., 1, 1]))
    heading = np.mod(np.arctan2(C_b_n[..., 0, 1], C_b_n[..., 1, 1]), 2.0 * np.pi)
    return heading, pitch, np.arctan2(-C_b_n[..., 2, 0], C_b_n[..., 2, 2])


def rotation_matrix(vector: ArrayLike) -> Array:
    """Matrices of rotation vectors: active, ``exp([v x])``.

    Parameters
    ----------
    vector : array_like, shape (..., 3), rad

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    v = np.asarray(vector, dtype=float)
    if v.ndim == 1:
        return _one_rotation(*v.tolist())
    angle2 = np.einsum("...i,...i->...", v, v)[..., None, None]
    angle = np.sqrt(angle2)
    small = angle2 < 1e-8
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - angle2 / 24.0, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    cross_matrix = skew(v)
    return np.asarray(np.eye(3) + first * cross_matrix + second * (cross_matrix @ cross_matrix))


def _one_rotation(x: float, y: float, z: float) -> Array:
    """The same for one vector, without the cost of stacks."""
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        first, second = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = math.sqrt(angle2)
        first, second = math.sin(angle) / angle, 2.0 * (math.sin(0.5 * angle) / angle) ** 2
    d = 1.0 - second * angle2
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    x_, y_, z_ = first * x, first * y, first * z
    return np.array(
        [
            [d + second * x * x, xy - z_, xz + y_],
            [xy + z_, d + second * y * y, yz - x_],
            [xz - y_, yz + x_, d + second * z * z],
        ]
    )


def rotation_vector(matrix: Array) -> Array:
    """Rotation vectors of matrices, the inverse of :func:`rotation_matrix`.

    Parameters
    ----------
    matrix : ndarray, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3), rad
        Of length pi at most.
    """
    twice = np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        axis=-1,
    )
    cosine = 0.5 * (matrix[..., 0, 0] + matrix[..., 1, 1] + matrix[..., 2, 2] - 1.0)
    if np.any(cosine < -0.9):  # near half a turn the axis is no longer in the antisymmetric part
        from scipy.spatial.transform import Rotation

        flat = Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_rotvec()
        return np.asarray(flat).reshape(*matrix.shape[:-2], 3)
    sine = 0.5 * np.sqrt(np.einsum("...i,...i->...", twice, twice))
    angle = np.arctan2(sine, cosine)
    return np.asarray(np.where(sine > 1e-9, 0.5 * angle / np.maximum(sine, 1e-9), 0.5)[..., None] * twice)


def left_jacobian(vector: ArrayLike) -> Array:
    """Left Jacobian Jl of the rotations: ``exp(v + d) = exp(Jl(v) d) exp(v)`` to first order in d.

    The right one is ``Jl(-v) = Jl(v)'``.

    Parameters
    ----------
    vector : array_like, shape (..., 3), rad

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``I + (1 - cos a) / a^2 [v x] + (a - sin a) / a^3 [v x]^2`` with a the length of v.
    """
    v = np.asarray(vector, dtype=float)
    a2 = np.einsum("...i,...i->...", v, v)[..., None, None]
    small = a2 < 1e-4
    a = np.sqrt(np.where(small, 1.0, a2))
    first = np.where(small, 0.5 - a2 / 24.0 * (1.0 - a2 / 30.0), 2.0 * (np.sin(0.5 * a) / a) ** 2)
    second = np.where(small, 1.0 / 6.0 - a2 / 120.0 * (1.0 - a2 / 42.0), (a - np.sin(a)) / a**3)
    across = skew(v)
    return np.asarray(np.eye(3) + first * across + second * (across @ across))


def skew(v: ArrayLike) -> Array:
    """Matrix of the cross product, ``skew(v) @ w == cross(v, w)``.

    Parameters
    ----------
    v : array_like, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def unit(v: Array) -> Array:
    """Vectors scaled to length one, shape (..., 3)."""
    return np.asarray(v / np.sqrt(np.einsum("...i,...i->...", v, v))[..., None])


def tangents(a: Array) -> Array:
    """Two unit vectors perpendicular to each unit vector.

    Parameters
    ----------
    a : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 3, 2)
        Columns span the tangent plane of the sphere at `a`.
    """
    # branchless orthonormal basis, Duff et al. 2017 (JCGT 6, 1)
    x, y, z = np.moveaxis(a, -1, 0)
    s = np.where(z < 0, -1.0, 1.0)
    q = -1.0 / (s + z)
    out = np.empty((*a.shape, 2))
    out[..., 0, 0], out[..., 1, 0], out[..., 2, 0] = 1.0 + s * x * x * q, s * x * y * q, -s * x
    out[..., 0, 1], out[..., 1, 1], out[..., 2, 1] = x * y * q, s + y * y * q, -y
    return out


def cross(v: Array, w: Array) -> Array:
    """Cross product of vectors (..., 3); several times faster than numpy's on small stacks."""
    out = np.empty(np.broadcast_shapes(v.shape, w.shape))
    out[..., 0] = v[..., 1] * w[..., 2] - v[..., 2] * w[..., 1]
    out[..., 1] = v[..., 2] * w[..., 0] - v[..., 0] * w[..., 2]
    out[..., 2] = v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]
    return out


def transform(matrix: Array, v: Array) -> Array:
    """``matrix @ v`` for long lists of vectors: one matrix for all, or one for each.

    Not a matrix product on purpose: on tall thin operands BLAS wakes its threads, which then spin idle for longer than the
    whole sum takes.

    Parameters
    ----------
    matrix : ndarray, shape (k, 3) or (..., k, 3)
    v : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., k)
    """
    return np.asarray(np.einsum("...ij,...j->...i", matrix, v))


def wahba(here: Array, there: Array) -> Array:
    """Rotation that best takes one set of directions to another (Wahba's problem, SVD solution).

    Parameters
    ----------
    here, there : ndarray, shape (n, 3)
        Matching vectors; the longer the heavier.

    Returns
    -------
    ndarray, shape (3, 3)
        C with ``there ~ C @ here``, a proper rotation.
    """
    left, _, right = np.linalg.svd(there.T @ here)
    sign = np.sign(np.linalg.det(left @ right))
    return np.asarray(left @ np.diag([1.0, 1.0, sign]) @ right)
