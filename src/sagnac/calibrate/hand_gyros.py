"""Gyros of a unit turned by hand from rest to rest.

Two things need no rig::

    rest        N_g = b + G f + S_g w_E                  static means: bias and 3x3 g-sensitivity
    rotation    f_after ~ R(S_g, b, G)' f_before         gravity turned by the integrated rate, interval to interval

with R from :mod:`sagnac.kernels.rotation`. No start value is asked for: S_g^-1 follows linearly from the change of the
specific force over short stretches of the motion, ::

    f(t2) - f(t1) = sum [f x] A (N_g - b - G f) dt,

which knows scale, axes and sense at once (the hand's own acceleration is noise in it). The published method (Tedaldi et al.
2014) starts a descent at S = I, b = 0 instead, and has no g-sensitivity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..estimate import Estimate, Parameter, Rows, estimate
from ..frames import Array, skew, tangents, transform, unit
from ..observe.means import SegmentMeans
from ..observe.static import StaticIntervals
from ..recording import GAP, Batch, sample_interval
from ..sensors import Correction, Triad
from . import sanity

_STRETCH = 0.5  # s: long enough for the hand's acceleration to average out, short enough to see the turn
_FEWEST_ROTATIONS = 6
_LEAST = 1e-9  # noise, relative to the range of the readings, below which only rounding is left
_WORST = np.radians(5.0)  # a residual above this is no calibration


@dataclass(frozen=True)
class GyroFit:
    """Gyros of a hand-turned unit.

    Attributes
    ----------
    fit : Estimate
        Parameters of `triad`.
    triad : Triad
    angle_rms : float, rad
        Residual of gravity's direction after a rotation.
    rotations : int
    static_rms : float
        Residual of the static means, in the unit of the readings.
    cross : ndarray, shape (k, 9)
        Covariance between the gyro and the accelerometer parameters.
    remarks : list of str
        What the signs of the gains say.
    """

    fit: Estimate
    triad: Triad
    angle_rms: float
    rotations: int
    static_rms: float
    cross: Array
    remarks: list[str]


@dataclass(frozen=True)
class _Motion:
    """What the gyro fit works on."""

    time: Array
    gyro: Array
    force: Array
    """Specific force of every sample, m/s^2."""
    static_gyro: Array
    """Mean gyro reading of each static interval, (n, 3)."""
    static_force: Array
    first: NDArray[np.intp]
    last: NDArray[np.intp]
    interval: NDArray[np.intp]
    """Static interval before each rotation."""
    up_rate: float


def calibrate_gyros(
    batch: Batch,
    found: StaticIntervals,
    means: SegmentMeans,
    accel: Estimate,
    accel_triad: Triad,
    counts: bool,
    up_rate: float,
) -> GyroFit:
    """Gyro scale, misalignment, bias and g-sensitivity in the accelerometers' frame.

    Parameters
    ----------
    batch : Batch
    found : StaticIntervals
    means : SegmentMeans
        Of the static intervals.
    accel : Estimate
        Accelerometer fit, its first nine parameters those of `accel_triad`.
    accel_triad : Triad
    counts : bool
        Whether the gyros read raw counts.
    up_rate : float, rad/s
        Vertical Earth rate, zero when the latitude is not known.

    Returns
    -------
    GyroFit

    Raises
    ------
    DataError
        When there are too few rotations, a gyro does not answer, or the rotations do not fit.
    """
    matrix, bias, _ = accel_triad.unpack(accel.value[: len(accel_triad.names)])
    motion = _motion(batch, found, means, matrix, bias, up_rate)
    if motion.first.size < _FEWEST_ROTATIONS:
        raise DataError(
            f"{motion.first.size} rotations between static intervals (without gaps): the gyros need at least {_FEWEST_ROTATIONS}"
        )
    triad = Triad("gyro", counts, full=True, g_sensitivity=True)
    x, sigma_static = _start(motion, triad)
    remarks = sanity.check_hand_turned_sense(triad.unpack(x)[0], counts)
    scales = triad.scales(triad.unpack(x)[0], 1.0)
    sigma_turn = np.radians(0.5)
    for _ in range(3):  # the noise of rotations and of static means from their own residuals
        rows = _Rows(motion, triad, sigma_static, sigma_turn)
        parameters = [Parameter(n, u, v, s) for n, u, v, s in zip(triad.names, triad.units, x, scales, strict=True)]
        fit = estimate(parameters, rows, means.names, noise_known=False)
        x = fit.value
        turns = fit.residual[: 2 * motion.first.size]
        rest = fit.residual[2 * motion.first.size :]
        sigma_turn = max(sigma_turn * float(np.sqrt(turns @ turns / max(turns.size - 9, 1))), _LEAST)
        least = _LEAST * float(np.ptp(motion.gyro, axis=0).max())
        sigma_static = max(sigma_static * float(np.sqrt(rest @ rest / max(rest.size - 12, 1))), least)
    fit, cross = fit.consider(rows.to_accel(x, matrix, accel_triad, accel), accel.covariance[:9, :9])
    angles = rows.angles(x)
    rms = float(np.sqrt(np.mean(angles**2)))
    if rms > _WORST:
        raise DataError(
            f"the rotations measured by the gyros miss the turns of gravity by {np.degrees(rms):.1f} deg rms: a gyro "
            "saturates or is dead, samples are missing, or the time stamps are wrong"
        )
    static_rms = float(np.sqrt(np.mean(rest**2))) * rows.sigma_static
    return GyroFit(fit, triad, rms, motion.first.size, static_rms, cross, remarks)


def _motion(
    batch: Batch, found: StaticIntervals, means: SegmentMeans, matrix: Array, bias: Array, up_rate: float
) -> _Motion:
    assert batch.accel is not None and batch.gyro is not None  # noqa: PT018 - the caller has looked
    inverse = np.asarray(np.linalg.inv(matrix))
    first, last = found.stop[:-1] - 1, found.start[1:]
    gaps = np.flatnonzero(np.diff(batch.time) > 2 * GAP * sample_interval(batch.time))
    whole = np.array([not np.any((gaps >= a) & (gaps < b)) for a, b in zip(first, last, strict=True)], dtype=bool)
    return _Motion(
        time=batch.time,
        gyro=batch.gyro,
        force=transform(inverse, batch.accel - bias),
        static_gyro=means.mean["gyro"],
        static_force=(means.mean["accel"] - bias) @ inverse.T,
        first=first[whole].astype(np.int64),
        last=last[whole].astype(np.int64),
        interval=np.flatnonzero(whole),
        up_rate=up_rate,
    )


def rotation_misfit(
    batch: Batch, found: StaticIntervals, means: SegmentMeans, accel: Correction, gyro: Correction
) -> Array:
    """Angle between gravity turned by the integrated rate and gravity measured, after each rotation of a log.

    Parameters
    ----------
    batch : Batch
    found : StaticIntervals
    means : SegmentMeans
        Of the static intervals.
    accel, gyro : Correction
        Models of a calibration.

    Returns
    -------
    ndarray, shape (rotations,), rad
    """
    from ..kernels.rotation import integrate

    m = _motion(batch, found, means, accel.matrix, accel.bias, 0.0)
    rotation, *_ = integrate(
        m.time, m.gyro, m.force, np.linalg.inv(gyro.matrix), gyro.bias, gyro.g_matrix, m.first, m.last
    )
    up = unit(m.static_force)
    return _turned(rotation, up[m.interval], up[m.interval + 1])


def _turned(rotation: Array, before: Array, after: Array) -> Array:
    """Angle (n,) between directions `before` turned into the end frame and `after`."""
    predicted = np.einsum("nji,nj->ni", rotation, before)
    return np.asarray(2.0 * np.arcsin(np.clip(np.linalg.norm(predicted - after, axis=1) / 2.0, 0.0, 1.0)))


def _start(motion: _Motion, triad: Triad) -> tuple[Array, float]:
    """Start values by two linear solutions, and the scatter of the static means."""
    design = np.column_stack([np.ones(len(motion.static_force)), motion.static_force])
    solution = np.linalg.lstsq(design, motion.static_gyro, rcond=None)[0]
    bias, g_matrix = solution[0], np.asarray(solution[1:].T)
    scatter = float(np.sqrt(np.mean((motion.static_gyro - design @ solution) ** 2)))
    moving = np.concatenate([np.arange(a, b) for a, b in zip(motion.first, motion.last, strict=True)])
    step = max(1, round(_STRETCH / float(np.median(np.diff(motion.time[:10000])))))
    starts = np.concatenate([np.arange(a, b, step) for a, b in zip(motion.first, motion.last, strict=True)])
    ends = np.concatenate(
        [np.append(np.arange(a, b, step)[1:], b) for a, b in zip(motion.first, motion.last, strict=True)]
    )
    dt = (motion.time[moving + 1] - motion.time[moving])[:, None]
    force = 0.5 * (motion.force[moving] + motion.force[moving + 1])
    rate = (0.5 * (motion.gyro[moving] + motion.gyro[moving + 1]) - bias - transform(g_matrix, force)) * dt
    offsets = np.concatenate([[0], np.cumsum(ends - starts)[:-1]])
    products = np.add.reduceat((force[:, :, None] * rate[:, None, :]).reshape(-1, 9), offsets).reshape(-1, 3, 3)
    rows = np.einsum("ijk,nkl->nijl", _CROSS, products).reshape(-1, 9)
    change = (motion.force[ends] - motion.force[starts]).ravel()
    size = np.abs(rows).max(axis=0)
    if not np.all(size > 0):
        raise DataError("a gyro does not change while the unit is turned: it is dead or not connected")
    scaled = rows / size
    normal = scaled.T @ scaled  # normal equations will do for a start; a tall lstsq would wake BLAS's threads
    inverse = (np.linalg.lstsq(normal, scaled.T @ change, rcond=None)[0] / size).reshape(3, 3)
    norms = np.linalg.norm(inverse, axis=0)
    if np.linalg.cond(inverse / norms) > 50.0:
        raise DataError("the three gyros do not see three axes: one is dead, or two columns carry the same signal")
    x = triad.pack(np.asarray(np.linalg.inv(inverse)), bias, np.asarray(g_matrix))
    return x, max(scatter, _LEAST * float(np.ptp(motion.gyro, axis=0).max()))


# d/dA of [f x] A r is linear in f_k r_l: component i of the cross product takes k with j
_CROSS = np.zeros((3, 3, 3))
for _i, _k, _j, _s in ((0, 1, 2, 1), (0, 2, 1, -1), (1, 2, 0, 1), (1, 0, 2, -1), (2, 0, 1, 1), (2, 1, 0, -1)):
    _CROSS[_i, _j, _k] = _s


class _Rows:
    """Residuals of rotations (two each, then) and static means (three each)."""

    def __init__(self, motion: _Motion, triad: Triad, sigma_static: float, sigma_turn: float) -> None:
        self.motion, self.triad = motion, triad
        self.sigma_static, self.sigma_turn = sigma_static, sigma_turn
        up = unit(motion.static_force)
        self.before, self.after = up[motion.interval], up[motion.interval + 1]
        self.basis = np.swapaxes(tangents(self.after), -1, -2)
        self.up = up

    def _integrated(self, x: Array) -> tuple[Array, ...]:
        from ..kernels.rotation import integrate

        matrix, bias, g_matrix = self.triad.unpack(x)
        inverse = np.linalg.inv(matrix)
        m = self.motion
        rotation, sum_1, sum_w, sum_f = integrate(m.time, m.gyro, m.force, inverse, bias, g_matrix, m.first, m.last)
        return np.asarray(inverse), rotation, sum_1, sum_w, sum_f

    def __call__(self, x: Array) -> Rows:
        inverse, rotation, sum_1, sum_w, sum_f = self._integrated(x)
        matrix, bias, g_matrix = self.triad.unpack(x)
        d_matrix, d_bias, d_g = self.triad.derivatives(x)
        m = self.motion
        predicted = np.einsum("nji,nj->ni", rotation, self.before)
        # body-frame error of the end attitude for dw = -A (dS w + db + dG f)
        inner = (
            np.einsum("nijl,jm,kml->nik", sum_w, inverse, d_matrix, optimize=True)
            + np.einsum("nij,jm,km->nik", sum_1, inverse, d_bias, optimize=True)
            + np.einsum("nijl,jm,kml->nik", sum_f, inverse, d_g, optimize=True)
        )
        error = -np.swapaxes(rotation, -1, -2) @ inner
        turn = self.basis @ (predicted - self.after)[..., None] / self.sigma_turn
        d_turn = self.basis @ skew(predicted) @ error / self.sigma_turn
        u = m.up_rate * self.up
        rest = (m.static_gyro - bias - m.static_force @ g_matrix.T - u @ matrix.T) / self.sigma_static
        d_rest = (
            -(d_bias.T + np.einsum("kij,nj->nik", d_g, m.static_force) + np.einsum("kij,nj->nik", d_matrix, u))
            / self.sigma_static
        )
        index = np.concatenate([np.repeat(m.interval + 1, 2), np.repeat(np.arange(len(rest)), 3)])
        return Rows(
            np.concatenate([turn.ravel(), rest.ravel()]),
            np.vstack([d_turn.reshape(-1, x.size), d_rest.reshape(-1, x.size)]),
            index,
        )

    def angles(self, x: Array) -> Array:
        """Angle between predicted and measured gravity after each rotation, rad."""
        rotation = self._integrated(x)[1]
        return _turned(rotation, self.before, self.after)

    def to_accel(self, x: Array, matrix: Array, triad: Triad, accel: Estimate) -> Array:
        """Derivative of the residuals to the nine accelerometer parameters (through the directions of gravity)."""
        rotation = self._integrated(x)[1]
        d_matrix, d_bias, _ = triad.derivatives(accel.value[:9])
        force = self.motion.static_force
        d_force = -np.einsum("ij,njk->nik", np.linalg.inv(matrix), np.einsum("kij,nj->nik", d_matrix, force) + d_bias.T)
        length = np.linalg.norm(force, axis=1)[:, None, None]
        d_up = (d_force - self.up[:, :, None] * np.einsum("ni,nik->nk", self.up, d_force)[:, None, :]) / length
        i = self.motion.interval
        turn = self.basis @ (np.swapaxes(rotation, -1, -2) @ d_up[i] - d_up[i + 1]) / self.sigma_turn
        _, _, g_matrix = self.triad.unpack(x)
        rest = -np.einsum("ij,njk->nik", g_matrix, d_force) / self.sigma_static
        return np.vstack([turn.reshape(-1, 9), rest.reshape(-1, 9)])
