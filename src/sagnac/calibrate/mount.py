"""How the unit sits on the table: C_b^k and the tilt of the outer axis, from directions and the table's settings.

[DONG18] takes small-angle differences of four positions (its equations 25 to 27); here all positions are solved with full
rotations::

    a_s = C_k^b Ry(-inner) ... e_3   (third row of C_k^n for the settings of segment s, turned to b)
    C_b^k = Rx(mount.x) Ry(mount.y) Rz(mount.z)
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..estimate import Estimate, Parameter, Rows, estimate
from ..frames import Array, rot_x, rot_y, rot_z, skew, tangents, wahba
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..rigs.turntable import Letters, TableErrors, attitude
from .common import need_angles

_FEWEST = 3
_FREE_TILT = 0.01  # rad: prior where the plan states no axis uncertainty


def matrix(angles: Array) -> Array:
    """C_b^k of the three mounting angles (3,), rad."""
    return np.asarray(rot_x(angles[0]) @ rot_y(angles[1]) @ rot_z(angles[2]))


def angles_of(c_b_k: Array) -> Array:
    """Mounting angles (3,) of C_b^k, the inverse of :func:`matrix`."""
    return np.array(
        [
            np.arctan2(-c_b_k[1, 2], c_b_k[2, 2]),
            np.arcsin(np.clip(c_b_k[0, 2], -1.0, 1.0)),
            np.arctan2(-c_b_k[0, 1], c_b_k[0, 0]),
        ]
    )


def derivatives(angles: Array) -> Array:
    """Derivative of C_b^k to each mounting angle, shape (3, 3, 3)."""
    x, y, z = rot_x(angles[0]), rot_y(angles[1]), rot_z(angles[2])
    ex, ey, ez = skew(np.eye(3))
    return np.stack([ex @ x @ y @ z, x @ ey @ y @ z, x @ y @ z @ ez])


class Mounting(NamedTuple):
    """Result of :func:`find`: the fit, and its covariance with the accelerometer parameters, shape (5, k)."""

    fit: Estimate
    cross: Array


def find(
    means: SegmentMeans, plan: Plan, directions: Array, noise: Array, sensitivity: Array, covariance: Array
) -> Mounting | None:
    """Mounting angles and tilt of the outer axis.

    Parameters
    ----------
    means : SegmentMeans
    plan : Plan
    directions : ndarray, shape (n, 3)
        Direction of up (static) or of the outer axis (turning) in b.
    noise : ndarray, shape (n,), rad
        Standard deviation of each direction from the noise of its readings.
    sensitivity : ndarray, shape (n, 3, k)
        Derivative of the directions to the accelerometer parameters.
    covariance : ndarray, shape (k, k)
        Of the accelerometer parameters.

    Returns
    -------
    Mounting or None
        Parameters ``rig.mount.x, y, z`` and ``rig.tilt.x, y`` in rad; None when the settings are not in the plan or all
        directions are alike.
    """
    if any(s.angles is None for s in means.segments) or len(directions) < _FEWEST:
        return None
    settings = need_angles(means, "the mounting")
    static = np.array([s.turn_rate == 0 for s in means.segments])
    letters = plan.rig.letters
    nominal = attitude(settings, letters=letters)[:, 2, :]
    if np.linalg.svd(nominal, compute_uv=False)[1] < 0.1:
        return None
    first = angles_of(wahba(nominal, directions).T)
    basis = tangents(directions)
    weight = _weights(settings, plan, basis, first, noise)
    stated = plan.rig.angle_uncertainty > 0
    to_enu = attitude(settings, letters=letters)

    def rows(x: Array) -> Rows:
        to_b = matrix(x[:3]).T
        # up in the table's base frame, tilted: Rx Ry transposed applied to e_3, to first order in the small tilt
        lean = np.zeros((len(directions), 3))
        lean[:, 2] = 1.0
        lean[static] += np.array([-x[4], x[3], 0.0])
        in_k = np.einsum("nji,nj->ni", to_enu, lean)
        d_up = np.einsum("kji,nj->nik", derivatives(x[:3]), in_k)
        d_tilt = np.einsum("ij,nkj->nik", to_b, to_enu)[:, :, :2] @ np.array([[0.0, -1.0], [1.0, 0.0]])
        d_tilt[~static] = 0.0
        jac = np.concatenate([d_up, d_tilt], axis=2)
        turned = weight @ np.swapaxes(basis, -1, -2)
        r = (turned @ (directions - in_k @ to_b.T)[..., None])[..., 0]
        return Rows(r.ravel(), -(turned @ jac).reshape(-1, 5), np.repeat(np.arange(len(directions)), 2))

    tilt = plan.rig.axis_uncertainty or _FREE_TILT
    parameters = [Parameter(f"rig.mount.{a}", "rad", float(v), 0.5) for a, v in zip("xyz", first, strict=True)]
    parameters += [Parameter(f"rig.tilt.{a}", "rad", 0.0, 0.5, 0.0, tilt) for a in "xy"]
    fit = estimate(parameters, rows, list(means.names), noise_known=stated)
    whitened = weight @ np.swapaxes(basis, -1, -2)
    # errors of the axes are common to all positions: no averaging makes them less
    axes = -whitened @ (matrix(fit.value[:3]).T @ _axis_effects(_key(settings), letters))
    fit, _ = fit.consider(axes.reshape(-1, 5), plan.rig.axis_uncertainty**2 * np.eye(5))
    turned = whitened @ sensitivity
    return Mounting(*fit.consider(turned.reshape(-1, turned.shape[-1]), covariance))


_Settings = tuple[tuple[float, float, float], ...]


def _key(settings: Array) -> _Settings:
    """Settings as the key of what depends on them alone: the same plan is used for thousands of simulated runs."""
    return tuple((a, b, c) for a, b, c in settings.tolist())


@lru_cache(maxsize=16)
def _axis_effects(key: _Settings, letters: Letters) -> Array:
    """Derivative of up in k to non-perpendicularity (2) and zero errors (3) of the table, shape (n, 3, 5)."""
    settings = np.array(key)
    out = np.zeros((len(settings), 3, 5))
    for i in range(5):
        v = np.where(np.arange(5) == i, 1e-6, 0.0)
        plus, minus = (
            attitude(settings, TableErrors((0.0, 0.0), (w[0], w[1]), (w[2], w[3], w[4])), letters) for w in (v, -v)
        )
        out[:, :, i] = (plus - minus)[:, 2, :] / 2e-6
    return out


@lru_cache(maxsize=16)
def _setting_effects(key: _Settings, letters: Letters) -> Array:
    """Derivative of up in k to the settings of the three axes, shape (n, 3, 3)."""
    settings, step = np.array(key), 1e-6
    moved = []
    for i in range(3):
        shift = np.zeros(3)
        shift[i] = step
        plus, minus = (attitude(settings + v, letters=letters) for v in (shift, -shift))
        moved.append((plus - minus)[:, 2, :] / (2 * step))
    return np.stack(moved, axis=2)


def _weights(settings: Array, plan: Plan, basis: Array, first: Array, noise: Array) -> Array:
    """Whitening (n, 2, 2) of the directions for errors of the settings and the directions' own noise."""
    sigma = plan.rig.angle_uncertainty or 1e-6
    in_b = _setting_effects(_key(settings), plan.rig.letters)
    across = np.swapaxes(basis, -1, -2) @ (matrix(first).T @ in_b)
    covariance = sigma**2 * (across @ np.swapaxes(across, -1, -2)) + (noise**2 + (0.01 * sigma) ** 2)[
        :, None, None
    ] * np.eye(2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
