r"""Noise of a place that is found by integrating twice: covariances over time, and their sizes by restricted maximum likelihood.

With m the lesser and d the difference of the middles of two short blocks of time, the errors of the place have the covariances

================================  ==========================  ============================================
what                              size                        covariance of two blocks
================================  ==========================  ============================================
sway about the place              sigma^2 of a window, m^2    only with itself, ~ 1/length
slow displacement (random walk)   q^2, m^2/s                  m (a sixth of a block less with itself)
accelerometers' white noise       N_a^2, (m/s^2)^2/Hz         m^3/3 + d m^2/2
gyros' white noise, level         g^2 N_g^2, (rad/s)^2/Hz     m^5/20 + d m^4/8 + d^2 m^3/12
================================  ==========================  ============================================

Blocks are summed up in windows (:func:`sagnac.align.static.fit.windows`). Spectra fall with the zeroth, second, fourth and
sixth power of the frequency, so that some minutes of data tell them apart. The likelihood is that of the residuals after the
unknowns are taken out (Patterson & Thompson 1971; Harville 1977), so that the freedom that the unknowns take up makes the noise
no smaller.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...frames import Array

_LEAST = 1e-4
"""A noise this many times smaller than what its start value explains counts as none."""
_SHARES = ((0.25, 0.25, 0.25, 0.25), (0.9, 0.05, 0.04, 0.01), (0.01, 0.04, 0.9, 0.05), (0.01, 0.04, 0.05, 0.9))
"""What sway, slow displacement, accelerometers and gyros explain of the scatter, where the search for their sizes starts."""
_ROUNDING = 1e-13
"""Of the greatest variance, added to all: rounding leaves covariances of large smooth noise not positive definite."""
_SIZES, _NARROWER, _UNLIKELY = 24, 12, 1e-4


@dataclass(frozen=True)
class Noise:
    """Sizes of the noise, one sigma.

    Attributes
    ----------
    sway, sway_up : float, m
        Of the displacement in a window, horizontally and vertically.
    walk, walk_up : float, m/s^0.5
        Random walk of the displacement.
    accel : float, m/s^2/Hz^0.5
    gyro : float, rad/s/Hz^0.5
    """

    sway: float
    walk: float
    sway_up: float
    walk_up: float
    accel: float
    gyro: float


class Kernels(NamedTuple):
    """Covariances of unit size, shape (m, m): of sway, random walk, and white noise integrated twice and three times."""

    sway: Array
    walk: Array
    accel: Array
    gyro: Array


def kernels(middle: Array, length: Array, windows: Any) -> Kernels:
    """Covariances of the places in windows.

    Parameters
    ----------
    middle, length : ndarray, shape (n,), s
        Middles of the blocks from the start, and lengths.
    windows : sparse array, shape (m, n)
        Weights of the blocks in each window.
    """
    m = np.minimum.outer(middle, middle)
    d = np.abs(np.subtract.outer(middle, middle))
    walk = m - np.diag(length / 6.0)  # the mean over a block: begin + length / 3 with itself
    sway, walk, accel, gyro = (
        np.asarray(windows @ (windows @ k).T)
        for k in (
            np.diag(1.0 / length),
            walk,
            m**3 / 3.0 + d * m**2 / 2.0,
            m**5 / 20.0 + d * m**4 / 8.0 + d**2 * m**3 / 12.0,
        )
    )
    return Kernels(sway / np.diag(sway).mean(), walk, accel, gyro)


def covariances(noise: Noise, kernel: Kernels, gravity: float) -> tuple[Array, Array]:
    """Covariance of the places, horizontal (each axis) and vertical, shape (m, m), m^2."""
    both = noise.accel**2 * kernel.accel
    level = noise.sway**2 * kernel.sway + noise.walk**2 * kernel.walk + both + (gravity * noise.gyro) ** 2 * kernel.gyro
    up = noise.sway_up**2 * kernel.sway + noise.walk_up**2 * kernel.walk + both
    for covariance in (level, up):
        covariance.flat[:: covariance.shape[0] + 1] += _ROUNDING * covariance.diagonal().max()
    return level, up


class End(NamedTuple):
    """Noise at the end: how it goes with the places, for unit noise.

    Tilt is the integral of the gyros' noise, speed that of tilt; drift is the integral of the accelerometers' noise.
    """

    tilt: Array
    """Covariance of the tilt with the places that it displaces, shape (m,)."""
    speed: Array
    """Of the speed with them, from the gyros, shape (m,)."""
    drift: Array
    """Of the speed with them, from the accelerometers, shape (m,)."""


def at_the_end(middle: Array, stop: float, windows: Any) -> End:
    """Covariances between the end and the places, per unit of noise (and of gravity for the gyros').

    Parameters
    ----------
    middle : ndarray, shape (n,), s
    stop : float, s
    windows : sparse array, shape (m, n)
    """
    t, d = middle, stop - middle
    return End(*(windows @ v for v in (t**3 / 6.0, d * t**3 / 6.0 + t**4 / 8.0, t**2 / 2.0)))


def whitener(covariance: Array) -> Array:
    """Lower Cholesky factor, shape (m, m)."""
    return np.asarray(np.linalg.cholesky(covariance))


def whiten(factors: tuple[Array, Array], rows: Array) -> Array:
    """Rows (m, 3, k) of east, north, up over their noise."""
    from scipy.linalg import solve_triangular

    level, up = factors
    m, _, k = rows.shape
    out = np.empty_like(rows)
    flat = solve_triangular(level, rows[:, :2].reshape(m, 2 * k), lower=True, check_finite=False)
    out[:, :2] = flat.reshape(m, 2, k)
    out[:, 2] = solve_triangular(up, rows[:, 2], lower=True, check_finite=False)
    return out


def minus_log_likelihood(noise: Noise, kernel: Kernels, gravity: float, rows: Array, prior: Array) -> float:
    """Restricted likelihood of linear rows: minus its logarithm, but for a constant.

    Parameters
    ----------
    noise, kernel, gravity
    rows : ndarray, shape (m, 3, k + 1)
        Derivatives to the k unknowns, and the residual at zero in the last column.
    prior : ndarray, shape (k, k)
        Priors of the unknowns at zero, as rows over their standard deviation.

    Returns
    -------
    float
        Infinite where the covariance is not positive definite.
    """
    try:
        factors = tuple(whitener(c) for c in covariances(noise, kernel, gravity))
    except np.linalg.LinAlgError:
        return np.inf
    white = whiten((factors[0], factors[1]), rows).reshape(-1, rows.shape[-1])
    J, z = white[:, :-1], white[:, -1]
    normal = J.T @ J + prior.T @ prior
    scale = 1.0 / np.sqrt(np.diag(normal))
    root = np.linalg.cholesky(normal * np.outer(scale, scale))
    explained = np.linalg.solve(root, scale * (J.T @ z))
    logs = 2.0 * np.log(np.diag(factors[0])).sum() + np.log(np.diag(factors[1])).sum()
    logs += np.log(np.diag(root)).sum() - np.log(scale).sum()
    return float(logs + 0.5 * (z @ z - explained @ explained))


def fit(start: Noise, free: tuple[str, ...], kernel: Kernels, gravity: float, rows: Array, prior: Array) -> Noise:
    """Noise of the greatest restricted likelihood.

    Parameters
    ----------
    start : Noise
        Start values; those that are not free stay.
    free : tuple of str
        Names of the sizes to find.
    kernel, gravity, rows, prior
        As :func:`minus_log_likelihood` takes them.
    """
    from scipy.optimize import minimize

    begin = np.log([getattr(start, name) for name in free])

    def at(x: Array) -> Noise:
        return replace(start, **dict(zip(free, np.exp(x).tolist(), strict=True)))

    def cost(x: Array) -> float:
        return minus_log_likelihood(at(x), kernel, gravity, rows, prior)

    low = np.log(_LEAST)
    found = minimize(
        cost,
        begin,
        method="L-BFGS-B",
        bounds=[(b + low, b - low) for b in begin],
        options={"eps": 1e-4, "ftol": 1e-8, "maxiter": 60},
    )
    return at(np.asarray(found.x))


def found_noise(
    middle: Array,
    kernel: Kernels,
    table: Array,
    prior: Array,
    gravity: float,
    *,
    gyro: float | None = None,
    accel: float | None = None,
) -> Noise:
    """The noise that the places show, but for what is stated.

    The likelihood may have more than one top: it is climbed from several sides. Where the gyros' noise is not stated and the data
    hardly show it, the size taken is the mean of its square over all sizes as likely as the data make them, so that the
    uncertainty does not leave it out.

    Parameters
    ----------
    middle : ndarray, shape (m,), s
        Of the windows, from the start.
    kernel : Kernels
    table : ndarray, shape (m, 3, k + 1)
        Derivatives to the unknowns and the places, as :func:`minus_log_likelihood` takes them.
    prior : ndarray, shape (k, k)
        Priors of the unknowns, the same.
    gravity : float, m/s^2
    gyro, accel : float, rad/s/Hz^0.5 and m/s^2/Hz^0.5, optional
        Stated noise.

    Returns
    -------
    Noise
    """
    g = gravity
    free = ("sway", "walk", "sway_up", "walk_up", *["accel"] * (accel is None), *["gyro"] * (gyro is None))
    unit = (kernel.sway, kernel.walk, kernel.accel, g**2 * kernel.gyro)
    left = _smooth_part(middle / middle[-1])
    z = left.T @ table[..., -1]
    level, up = (z[:, :2] ** 2).mean(), (z[:, 2] ** 2).mean()
    sway, walk, by_accel, by_gyro = (left.shape[1] / np.einsum("ij,jk,ki->", left.T, k, left) for k in unit)
    found = []
    for shares in _SHARES if gyro is None or accel is None else _SHARES[:2]:
        a, b, c, d = np.sqrt(shares)
        start = Noise(
            a * np.sqrt(level * sway),
            b * np.sqrt(level * walk),
            a * np.sqrt(up * sway),
            b * np.sqrt(up * walk),
            c * np.sqrt(level * by_accel) if accel is None else accel,
            d * np.sqrt(level * by_gyro) if gyro is None else gyro,
        )
        noise = fit(start, free, kernel, g, table, prior)
        found.append((minus_log_likelihood(noise, kernel, g, table, prior), noise))
    noise = min(found, key=lambda pair: pair[0])[1]
    if gyro is None:
        most = np.sqrt(level * by_gyro)
        noise = replace(noise, gyro=_mean_size(noise, float(max(most, 3.0 * noise.gyro)), kernel, g, table, prior))
    return noise


def _smooth_part(x: Array) -> Array:
    """Orthonormal columns to which polynomials up to x^3, what attitude, place and velocity do, have nothing to say."""
    return np.linalg.qr(np.vander(x, 4), mode="complete")[0][:, 4:]


def _mean_size(noise: Noise, most: float, kernel: Kernels, gravity: float, table: Array, prior: Array) -> float:
    """Gyro noise, rms over sizes up to `most`, each as likely as the residuals make it."""
    for _ in range(_NARROWER):
        sizes = most * (np.arange(_SIZES) + 0.5) / _SIZES
        costs = np.array(
            [minus_log_likelihood(replace(noise, gyro=float(s)), kernel, gravity, table, prior) for s in sizes]
        )
        weight = np.exp(costs.min() - costs)
        seen = sizes[weight > _UNLIKELY]
        if seen.size > _SIZES // 3:
            break
        most = float(seen[-1]) + most / _SIZES
    return float(np.sqrt((weight * sizes**2).sum() / weight.sum()))
