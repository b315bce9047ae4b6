"""What slow noise that a plan states does to means, parts and harmonics of segments.

A bias that is estimated takes up what is constant, so that only the covariance of sums without mean is asked for. It follows from
a generalised covariance of the noise at two times a lag u apart, for the two-sided spectrum ``B^2 / (2 pi f) + K^2 / (2 pi f)^2``
(flicker noise of bias instability B of IEEE Std 952, random walk K) ::

    R(u) = -B^2 / pi ln |u| - K^2 |u| / 2 + what drops out

The difference of the variances of the means over T and T' seconds is then ``B^2 / pi ln(T' / T) + K^2 (T' - T) / 6``. Everything
here is exact for such noise, at finite times, but for the mean that is taken as independent of what goes on about it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..frames import Array
from ..plan import Plan
from ..sensors.series import basis

_EXACT = 64  # cells apart, from which the logarithm hardly bends within two of them
_FINE = 16  # cells in a period of the highest harmonic: it is off by (pi / 16)^2 / 6
_CELLS = 512  # at least
_SEEN = 1e-9  # of the largest eigenvalue: what a part can tell, as in the sums
_TURNS = 128.0
"""Turns beyond which variances go on as one over the turns (flicker noise) and over their square (random walk)."""


@dataclass(frozen=True)
class SlowNoise:
    """Slow noise of the axes x, y, z of a sensor.

    Attributes
    ----------
    instability : ndarray, shape (3,)
        B, in the unit of the readings.
    walk : ndarray, shape (3,)
        K, the same per sqrt(s).
    """

    instability: Array
    walk: Array

    def density(self, frequency: Array, axis: int) -> Array:
        """Two-sided spectral density at frequencies in Hz, as white noise N has N^2.

        Parameters
        ----------
        frequency : ndarray
        axis : int
        """
        turn = 2.0 * math.pi * frequency
        return np.asarray(self.instability[axis] ** 2 / turn + self.walk[axis] ** 2 / turn**2)

    def mean_variance(self, duration: Array, whole: float) -> Array:
        """Variance of means about that of the whole test, shape (n, 3), see :func:`sagnac.calibrate.common.slow_variance`.

        Parameters
        ----------
        duration : ndarray, shape (n,), s
        whole : float, s
        """
        T = np.asarray(duration, dtype=float)[:, None]
        longer = np.maximum(whole, T)
        flicker = self.instability**2 / math.pi * np.log(longer / T)
        return np.asarray(flicker + self.walk**2 * (longer - T) / 6.0)

    def parts_covariance(self, axis: int, duration: float, whole: float, parts: int) -> Array:
        """Covariance of the means of equal parts of a segment about that of the whole test, shape (parts, parts).

        That of the segment's mean, and of the parts about it, which is taken as independent of it.

        Parameters
        ----------
        axis : int
        duration, whole : float, s
            Of the segment and of the test.
        parts : int
        """
        flicker, walk = kernels(parts)
        length = duration / parts
        lag = np.abs(np.arange(parts)[:, None] - np.arange(parts))
        about = self.instability[axis] ** 2 * flicker[lag] + self.walk[axis] ** 2 * length * walk[lag]
        about = about - about.mean(axis=0) - about.mean(axis=1)[:, None] + about.mean()
        return np.asarray(about + self.mean_variance(np.array([duration]), whole)[0, axis])

    def blocks_density(self, duration: Array, turning: Array, blocks: int) -> Array:
        """What is expected of slow noise in the squared density that blocks of segments show, shape (3,).

        That of :attr:`sagnac.observe.means.SegmentMeans.density`: residuals of the blocks' means about mean and drift and, where
        an axis turns, cosine and sine, of all segments together.

        Parameters
        ----------
        duration : ndarray, shape (n,), s
        turning : ndarray, shape (n,), rad
            By which the axis turns in a segment.
        blocks : int
            In each segment.
        """
        flicker, walk = kernels(blocks)
        lag = np.abs(np.arange(blocks)[:, None] - np.arange(blocks))
        x = (np.arange(blocks) + 0.5) / blocks - 0.5
        squares, freedom = np.zeros(3), 0
        for T, arc in zip(np.asarray(duration).tolist(), np.asarray(turning).tolist(), strict=True):
            design = np.column_stack([np.ones(blocks), x, *([np.cos(arc * x), np.sin(arc * x)] if arc else [])])
            left = np.eye(blocks) - design @ np.linalg.pinv(design)
            length, own = T / blocks, blocks - design.shape[1]
            seen = self.instability**2 * np.sum(left * flicker[lag]) + self.walk**2 * length * np.sum(left * walk[lag])
            squares, freedom = squares + length * seen, freedom + own
        return np.asarray(squares / freedom)


def slow_noise(plan: Plan, sensor: str) -> SlowNoise | None:
    """Slow noise that a plan states of a sensor, SI, or None.

    Parameters
    ----------
    plan : Plan
    sensor : str
        ``accel`` or ``gyro``.
    """
    B, K = plan.unit.noise.of(sensor, "instability"), plan.unit.noise.of(sensor, "walk")
    none = (0.0, 0.0, 0.0)
    found = SlowNoise(np.array(B or none), np.array(K or none))
    return found if found.instability.any() or found.walk.any() else None


def kernels(count: int) -> tuple[Array, Array]:
    """Generalised covariances of means over neighbouring cells of length one, by how many cells they are apart.

    Parameters
    ----------
    count : int

    Returns
    -------
    flicker, walk : ndarray, shape (count,)
        For B = 1 and for K = 1: the means of ``-ln |u| / pi`` and ``-|u| / 2`` over pairs of points in both cells, that is second
        differences of ``-(u^2 ln |u| / 2 - 3 u^2 / 4) / pi`` and ``-|u|^3 / 12``. In cells of T seconds the latter is T times as
        large, and the former differs by a constant.
    """
    k = np.arange(count, dtype=float)
    walk = -k / 2.0
    walk[0] = -1.0 / 6.0
    near = k[:_EXACT]
    second = np.zeros(near.size)
    for shift, weight in ((1.0, 0.5), (0.0, -1.0), (-1.0, 0.5)):
        u = np.abs(near + shift)
        second += weight * u**2 * np.log(np.where(u > 0, u, 1.0))
    far = k[_EXACT:]
    flicker = -np.concatenate([second - 1.5, np.log(far) - 1.0 / (12.0 * far**2)]) / math.pi
    return flicker, walk


def harmonics_covariance(
    arc: float, phase: float, duration: float, order: int, *, extended: bool = False
) -> tuple[Array, Array]:
    """What slow noise does to the least-squares coefficients of the terms of :class:`sagnac.observe.harmonics.SegmentHarmonics`.

    The covariance of ``sum a_i(t) y(t)`` and ``sum a_j(t) y(t)`` is the sum of ``a_i(t) a_j(s) R(t - s)`` over both times. Over
    many turns that of harmonic h is what white noise of the density at h times the rate would give; a random walk, whose ends
    differ, gives three times as much to the term that is odd about them.

    Parameters
    ----------
    arc, phase : float, rad
        Turn of the angle over the segment, and the angle in its middle.
    duration : float, s
    order : int
    extended : bool

    Returns
    -------
    flicker, walk : ndarray, shape (c, c)
        For B = 1 and K = 1, without the variance of the segment's own mean, which is that of the constant alone.
    """
    turns = abs(arc) / (2.0 * math.pi)
    spared = 2.0 * math.floor(max(turns - _TURNS, 0.0) / 2.0)  # as many at both ends, where the angles then stay
    fewer = (turns - spared) / turns if turns else 1.0
    cells = max(_CELLS, math.ceil(_FINE * order * (turns - spared)))
    x = (np.arange(cells) + 0.5) / cells - 0.5
    terms = basis(phase + arc * fewer * x, order)
    if extended:
        terms = np.hstack([terms, (duration * x)[:, None] * terms[:, 1:]])
    size = np.linalg.norm(terms, axis=0)
    sums = np.linalg.pinv(terms / size) / size[:, None]
    # the constant is the mean less what the other terms have of one, and the mean is a matter of the whole test; what they have
    # falls with the turns as well
    sums[0] = fewer * (sums[0] - 1.0 / cells)
    flicker, walk = (sums @ smooth.T for smooth in _smoothed(sums))
    return fewer * (flicker + flicker.T) / 2.0, fewer**2 * duration / cells * (walk + walk.T) / 2.0


def _smoothed(sums: Array) -> list[Array]:
    """Convolutions of rows (r, n) with both kernels, each (r, n)."""
    n = sums.shape[1]
    spectrum = np.fft.rfft(sums, 2 * n)
    waves = [np.fft.rfft(np.concatenate([kernel, [0.0], kernel[:0:-1]])) for kernel in kernels(n)]
    return [np.fft.irfft(spectrum * wave, 2 * n)[:, :n] for wave in waves]


@lru_cache(maxsize=256)
def scatter_density(
    arc: float, duration: float, order: int, parts: int, *, extended: bool = False
) -> tuple[float, float, int]:
    """What is expected of slow noise in the slow scatter of a segment (:attr:`sagnac.observe.harmonic_sums.Fit.slow_squares`).

    The scatter is that of the projections of the samples on the terms part by part, about one fit to all parts and a drift.

    Parameters
    ----------
    arc : float, rad
        Turn of the angle over the segment; where it starts makes no difference. Zero: a segment that does not turn.
    duration : float, s
    order : int
    parts : int
    extended : bool

    Returns
    -------
    flicker, walk : float, s and s^2
        Added to the squared density, for B = 1 and K = 1.
    degrees_of_freedom : int
    """
    turns = min(abs(arc) / (2.0 * math.pi), _TURNS)
    each = max(_CELLS, math.ceil(_FINE * order * turns)) // parts
    cells = each * parts
    x = (np.arange(cells) + 0.5) / cells - 0.5
    terms = basis(2.0 * math.pi * turns * x, order) if arc else np.ones((cells, 1))
    if extended and arc:
        terms = np.hstack([terms, x[:, None] * terms[:, 1:]])
    rows = []
    for i in range(parts):
        own = terms[i * each : (i + 1) * each]
        left, size, _ = np.linalg.svd(own / np.linalg.norm(own, axis=0), full_matrices=False)
        row = np.zeros((int(np.count_nonzero(size**2 > _SEEN * size[0] ** 2)), cells))
        row[:, i * each : (i + 1) * each] = left[:, : len(row)].T
        rows.append(row)
    told = np.vstack(rows)
    drift = np.repeat(x.reshape(parts, each).mean(axis=1), each)
    design = told @ np.column_stack([terms, drift])
    fitted, size, _ = np.linalg.svd(design / np.linalg.norm(design, axis=0), full_matrices=False)
    fitted = fitted[:, size > _SEEN * size[0]]
    told -= fitted @ (fitted.T @ told)
    freedom = len(told) - fitted.shape[1]
    flicker, walk = (float(np.sum(told * smooth)) for smooth in _smoothed(told))
    length = duration / cells
    return length * flicker / freedom, length**2 * walk / freedom, freedom
