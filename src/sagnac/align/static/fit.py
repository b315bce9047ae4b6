r"""The maximum-likelihood attitude of a unit that stays at its place, with the noise that the data themselves show.

Unknowns: attitude psi (3, small, about its latest value), place r_0 (3) and velocity v_0 (3) at the start, gyro bias eps (3) and
accelerometer bias nab (3) in body axes, of which something is known beforehand. Data: the twice integrated specific force, block
by block, see :mod:`sagnac.align.static.model`; its errors are correlated, see :mod:`sagnac.align.static.noise`. The problem is
linear but for the attitude and is solved by Gauss-Newton on whitened rows. It is a batch estimate: with Gaussian noise of
these kinds no filter does better, and it reaches the Cramer-Rao bound (with the priors: van Trees').

Attitude and velocity at the end also contain what the gyros' and accelerometers' noise has added since the start. The residuals
know part of it: it is predicted from them by its covariance with them (Goldberger 1962, the best linear unbiased prediction).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...earth import earth_rate_enu
from ...frames import Array, rotation_matrix, skew
from .model import Blocks, to_enu_of_inertial, upward
from .noise import End, Kernels, Noise, at_the_end, covariances, kernels, whiten, whitener

_UNKNOWNS = 15
_PSI, _R, _V, _EPS, _NAB = (slice(3 * i, 3 * i + 3) for i in range(5))
_ITERATIONS = 12
_SETTLED = 1e-3  # standard uncertainties
_LOOSE = 1000.0
_WINDOWS = 120
_WHITE = Noise(1e-2, 0.0, 1e-2, 0.0, 0.0, 0.0)  # any size does: it only stands in for the first attitude


@dataclass(frozen=True)
class Place:
    """Where the unit stands.

    Attributes
    ----------
    latitude, longitude : float, rad
    height : float, m
    gravity : float, m/s^2
    earth_rate : float, rad/s
    """

    latitude: float
    longitude: float
    height: float
    gravity: float
    earth_rate: float

    @property
    def rate(self) -> Array:
        """Earth rate in east, north, up, shape (3,), rad/s."""
        return earth_rate_enu(self.latitude, self.earth_rate)


@dataclass(frozen=True)
class Solution:
    """What the samples say.

    Attributes
    ----------
    C_b_n : ndarray, shape (3, 3)
        At the end.
    velocity : ndarray, shape (3,), m/s
        At the end, east, north, up: that of the sway.
    eps, nab : ndarray, shape (3,), rad/s and m/s^2
        Biases in body axes.
    covariance : ndarray, shape (12, 12)
        Of what is still wrong: phi and velocity, computed less true, in east, north, up; eps and nab, true less estimated.
    noise : Noise
    place : ndarray, shape (m, 3), m
        Displacement of the unit, block by block, as far as the unknowns do not explain it: east, north, up at the middle time.
    innovations : ndarray, shape (m, 3)
        The same whitened: independent, of size one.
    """

    C_b_n: Array
    velocity: Array
    eps: Array
    nab: Array
    covariance: Array
    noise: Noise
    place: Array
    innovations: Array


@dataclass(frozen=True)
class Data:
    """What enters the fit: the blocks' places in windows.

    Attributes
    ----------
    blocks : Blocks
    site : Place
    weights : sparse array, shape (m, n)
        See :func:`windows`.
    middle : ndarray, shape (m,), s
        Middles of the windows from the start.
    place, gyro, accel : ndarray, shape (m, 3) and (m, 3, 3)
        Of the blocks, see :class:`sagnac.align.static.model.Blocks`.
    fallen : ndarray, shape (m, 3), s^2
        The upward direction integrated twice.
    kernel : Kernels
    end : End
    """

    blocks: Blocks
    site: Place
    weights: Any
    middle: Array
    place: Array
    gyro: Array
    accel: Array
    fallen: Array
    kernel: Kernels
    end: End

    @classmethod
    def of(cls, blocks: Blocks, site: Place) -> Data:
        """The data of a unit at a place."""
        stop = float(blocks.end[-1])
        direction, _, fallen = upward(blocks.middle, 0.5 * stop, site.rate)
        fallen += direction * (blocks.length**2 / 24.0)[:, None]  # from the middle to the mean
        W = windows(blocks)
        return cls(
            blocks,
            site,
            W,
            W @ blocks.middle,
            *_in_windows(W, blocks),
            W @ fallen,
            kernels(blocks.middle, blocks.length, W),
            at_the_end(blocks.middle, stop, W),
        )

    def read_otherwise(self, blocks: Blocks) -> Data:
        """The same times with other blocks."""
        place, gyro, accel = _in_windows(self.weights, blocks)
        return replace(self, blocks=blocks, place=place, gyro=gyro, accel=accel)


def _in_windows(weights: Any, blocks: Blocks) -> tuple[Array, Array, Array]:
    """Place (m, 3) and its derivatives (m, 3, 3) in windows."""
    flat = (weights @ v.reshape(blocks.end.size, -1) for v in (blocks.place, blocks.gyro, blocks.accel))
    place, gyro, accel = flat
    return place, gyro.reshape(-1, 3, 3), accel.reshape(-1, 3, 3)


def windows(blocks: Blocks) -> Any:
    """Weights of the blocks in windows of triangular shape, each half over its neighbours.

    The mean over a time T lets sway of frequency f through by ``sin(pi f T) / (pi f T)``, a triangle of twice the length by its
    square, and both nothing at the frequencies that samples at steps of T would show as standing still.

    Parameters
    ----------
    blocks : Blocks

    Returns
    -------
    sparse array, shape (m, n)
        Rows of sum one.
    """
    from scipy.sparse import csr_array

    count = min(_WINDOWS, blocks.end.size // 2)
    step = float(blocks.end[-1]) / count
    centres = step * np.arange(1, count)
    weights = np.maximum(0.0, 1.0 - np.abs(blocks.middle - centres[:, None]) / step) * blocks.length
    weights = weights[weights.any(axis=1)]  # a gap that was filled is one long block
    return csr_array(weights / weights.sum(axis=1)[:, None])


def rows(data: Data, C: Array) -> Array:
    """Derivatives of the place to the unknowns, and the place itself in the last column, at an attitude C_s_i.

    Returns
    -------
    ndarray, shape (m, 3, 16)
    """
    out = np.zeros((data.middle.size, 3, _UNKNOWNS + 1))
    P = data.place @ C.T
    out[:, :, _PSI] = -skew(P)
    out[:, :, _R] = -np.eye(3)
    out[:, :, _V] = -np.eye(3) * data.middle[:, None, None]
    out[:, :, _EPS] = C @ data.gyro
    out[:, :, _NAB] = -C @ data.accel
    out[:, :, -1] = P - data.site.gravity * data.fallen
    return out


class _Fit:
    """Gauss-Newton with a given noise."""

    def __init__(self, data: Data, noise: Noise, prior: Array) -> None:
        level, up = covariances(noise, data.kernel, data.site.gravity)
        self.factors = whitener(level), whitener(up)
        self.data, self.noise, self.prior = data, noise, prior

    def solve(self, C: Array) -> tuple[Array, Array, Array, Array]:
        """Attitude C_s_i, unknowns (15,), their covariance, and whitened residuals (m, 3).

        Samples that no attitude explains may let it go round and round; then their residuals say so.
        """
        for _ in range(_ITERATIONS):
            white = whiten(self.factors, rows(self.data, C))
            x, covariance = _least_squares(white.reshape(-1, _UNKNOWNS + 1), self.prior)
            C = rotation_matrix(x[_PSI]) @ C
            if np.all(np.abs(x[_PSI]) < _SETTLED * np.sqrt(np.diag(covariance)[_PSI])):
                break
        return C, x, covariance, np.asarray(white[..., :-1] @ x + white[..., -1])


def _least_squares(white: Array, prior: Array) -> tuple[Array, Array]:
    """Unknowns and covariance of rows (n, k + 1) that shall vanish, with rows of priors at zero (k, k)."""
    J = np.vstack([white[:, :-1], prior])
    z = np.concatenate([white[:, -1], np.zeros(len(prior))])
    scale = 1.0 / np.linalg.norm(J, axis=0)
    q, r = np.linalg.qr(J * scale)
    inverse = np.linalg.inv(r)
    x = -scale * (inverse @ (q.T @ z))
    return x, (inverse @ inverse.T) * np.outer(scale, scale)


class Look(NamedTuple):
    """What the samples say when next to nothing is taken for granted of the biases."""

    C: Array
    """C_s_i, shape (3, 3)."""
    place: Array
    """Displacements that are left over, shape (m, 3), m."""
    eps: Array
    nab: Array
    """Biases in body axes, shape (3,), rad/s and m/s^2."""
    covariance: Array
    """Of both, shape (6, 6)."""


def stated(gyro_bias: Array, accel_bias: Array) -> Array:
    """Priors as rows over their standard deviation, shape (15, 15), of what the biases may be, (3,) each."""
    return np.diag(np.concatenate([np.zeros(9), 1.0 / gyro_bias, 1.0 / accel_bias]))


def loose(place: Place, C: Array, gyro_bias: Array, accel_bias: Array) -> Array:
    """The same, with next to nothing taken for granted of the biases that a unit at rest sees.

    These are the gyros' along north and up and the accelerometers' along up; those that look like heading and level stay as
    stated. They may be a thousand times larger than stated, up to half the Earth rate and a twentieth of gravity.
    """
    out = np.zeros((_UNKNOWNS, _UNKNOWNS))
    for part, sizes, limit, seen in (
        (_EPS, gyro_bias, 0.5 * place.earth_rate, (1, 2)),
        (_NAB, accel_bias, 0.05 * place.gravity, (2,)),
    ):
        along = np.sqrt(C**2 @ sizes**2)
        for i in seen:
            along[i] = max(along[i], min(_LOOSE * along[i], limit))
        out[part, part] = C / along[:, None]
    return out


def look(data: Data, C: Array, prior: Array, noise: Noise = _WHITE) -> Look:
    """A fit with a given noise, for what it leaves over.

    Parameters
    ----------
    data : Data
    C : ndarray, shape (3, 3)
        C_s_i to start from.
    prior : ndarray, shape (15, 15)
        From :func:`loose`.
    noise : Noise
        By default white noise of some size, before any is known.
    """
    C, x, covariance, _ = _Fit(data, noise, prior).solve(C)
    return Look(C, _left(data, C, x), x[_EPS], x[_NAB], covariance[9:, 9:])


def _left(data: Data, C: Array, x: Array) -> Array:
    """Displacements that the unknowns do not explain at the latest attitude, shape (m, 3)."""
    table = rows(data, C)
    return np.asarray(table[..., -1] + table[..., 3:-1] @ x[3:])


def settled(data: Data, C: Array, noise: Noise, prior: Array) -> Solution:
    """Attitude, velocity and biases at the end of the blocks, with their covariance.

    Parameters
    ----------
    data : Data
    C : ndarray, shape (3, 3)
        C_s_i to start from, :func:`sagnac.align.static.coarse.inertial`.
    noise : Noise
        From :func:`sagnac.align.static.noise.found_noise`.
    prior : ndarray, shape (15, 15)
        From :func:`stated`.

    Returns
    -------
    Solution
    """
    done = _Fit(data, noise, prior)
    C, x, covariance, innovations = done.solve(C)
    return _at_end(done, C, x, covariance, innovations)


# ------------------------------------------------------------------------------------------------------------ the end


def _at_end(done: _Fit, C: Array, x: Array, covariance: Array, innovations: Array) -> Solution:
    """From the unknowns at the start to attitude, velocity and biases at the end.

    The true tilt is the computed one less W, the integral of the gyros' noise; that displaces the computed place by
    ``g int int (W_N, -W_E, 0)``.
    """
    data, noise = done.data, done.noise
    blocks, place = data.blocks, data.site
    stop, middle = float(blocks.end[-1]), 0.5 * float(blocks.end[-1])
    end, g = data.end, place.gravity
    tilt, speed = g * noise.gyro**2 * end.tilt, g**2 * noise.gyro**2 * end.speed
    drift = noise.accel**2 * end.drift
    # covariance of (W, speed) with the places (m, 3), six quantities
    c = np.zeros((data.middle.size, 3, 6))
    c[:, 0, 1], c[:, 1, 0] = tilt, -tilt
    c[:, 0, 3] = c[:, 1, 4] = speed + drift
    c[:, 2, 5] = drift
    white_c = whiten(done.factors, c).reshape(-1, 6)
    own = _own(noise, g, stop)
    L = np.zeros((12, _UNKNOWNS))
    A, V = C @ blocks.turned[-1], C @ blocks.speed[-1]
    L[:3, _PSI], L[:3, _EPS] = -np.eye(3), A  # phi: computed less true
    L[3:6, _PSI], L[3:6, _V] = -skew(V), -np.eye(3)
    L[3:6, _EPS], L[3:6, _NAB] = C @ blocks.speed_gyro[-1], -A
    L[6:9, _EPS] = L[9:, _NAB] = np.eye(3)
    white = whiten(done.factors, rows(data, C)[..., :-1]).reshape(-1, _UNKNOWNS)
    # what the unknowns make of attitude and velocity lacks the noise: phi gets W with plus, the velocity its speed with minus
    sign = np.repeat([1.0, -1.0], 3)
    seen = sign[:, None] * (white_c.T @ innovations.reshape(-1, 1))
    lever = L.copy()
    lever[:6] += sign[:, None] * (white_c.T @ white)
    total = lever @ covariance @ lever.T
    total[:6, :6] += np.outer(sign, sign) * (own - white_c.T @ white_c)
    phi = A @ x[_EPS] + seen[:3, 0]
    one = upward(np.array([stop]), middle, place.rate)[1][0]
    v = V + L[3:6, _V] @ x[_V] + L[3:6, _EPS] @ x[_EPS] + L[3:6, _NAB] @ x[_NAB] - g * one + seen[3:, 0]
    C_i_n = to_enu_of_inertial(stop, middle, place.rate)
    turn = np.diag(
        np.repeat([1.0, -1.0], 6)
    )  # biases: true less estimated, as the errors of navigation are computed less true
    turn[:3, :3] = turn[3:6, 3:6] = C_i_n
    return Solution(
        C_i_n @ rotation_matrix(-phi) @ C @ blocks.C_b_s[-1],
        C_i_n @ v,
        x[_EPS],
        x[_NAB],
        turn @ (0.5 * (total + total.T)) @ turn.T,
        noise,
        _left(data, C, x),
        innovations,
    )


def _own(noise: Noise, gravity: float, stop: float) -> Array:
    """Covariance of W and of the speed at the end, before any place is looked at, shape (6, 6)."""
    out = np.zeros((6, 6))
    q, a = noise.gyro**2, noise.accel**2
    out[:3, :3] = q * stop * np.eye(3)
    level = q * gravity**2 * stop**3 / 3.0 + a * stop
    out[3:, 3:] = np.diag([level, level, a * stop])
    out[1, 3] = out[3, 1] = gravity * q * stop**2 / 2.0
    out[0, 4] = out[4, 0] = -gravity * q * stop**2 / 2.0
    return out
