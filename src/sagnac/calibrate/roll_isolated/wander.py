"""Slow noise of the gyros in the reduced rows of a roll-isolated rig.

The rows of one channel in one part of a segment are turned to directions that slow noise moves independently: first the mean over
the part, along the column of the gyro's bias, then combinations of sines of different frequencies, which are what is left of the
columns when that is taken out. With N the white noise, n samples and the spectrum S(f) of the slow noise, and the covariance C of
the parts' means about that of the whole test (:meth:`sagnac.calibrate.slow.SlowNoise.parts_covariance`) ::

    means:              N^2 / T_part on the diagonal, + C
    a sine of f Hz:     N^2 + S(f) instead of N^2

The means of all parts of a segment are whitened together, each by those before it, so that a part still answers for its own.

A sine of angular frequency w is an eigenvector of squared differences from sample to sample, of the eigenvalue
``4 sin^2(w dt / 2)``, by which the frequencies are told. In the channel of the encoder, whose rows are innovations of the angle,
a rate of f Hz counts less than a steady one, ``1 / (1 + 4 sin^2(w dt / 2) R / q)`` of it, with R the variance of a reading and
q = N^2 dt.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...frames import Array
from ..slow import SlowNoise

_STRONG = 1e-2
"""Part of the columns' size from which a direction is told from others by its frequency.

Weaker ones turn from step to step of the fit, so that what they weigh less must not change the cost by which steps are judged: it
goes to what is left over.
"""
_LEAST = 1e-9


@dataclass(frozen=True)
class Reduced:
    """Rows of one channel in one part of a segment.

    Attributes
    ----------
    part : int
        Within the segment.
    rows : ndarray, shape (m, k)
        Derivatives.
    residual : ndarray, shape (m,)
    bias : ndarray, shape (m,)
        Derivatives to the bias of the gyro, which its slow noise moves alike.
    rough : ndarray, shape (k, k)
        Products of the differences of the columns from sample to sample, summed over all samples.
    count : int
        Samples.
    """

    part: int
    rows: Array
    residual: Array
    bias: Array
    rough: Array
    count: int


@dataclass(frozen=True)
class Channel:
    """What slow noise needs to know of a channel of a segment.

    Attributes
    ----------
    slow : SlowNoise
    axis : int
        Of the gyro: 0 for the encoder's channel, which compares with gyro x.
    parts : int
        Of the segment.
    duration, whole : float, s
        Of the segment and the test.
    interval : float, s
    rounding : float
        R / q in the encoder's channel, zero in others.
    """

    slow: SlowNoise
    axis: int
    parts: int
    duration: float
    whole: float
    interval: float
    rounding: float = 0.0


class Whitened(NamedTuple):
    """Rows of a part, as many as before, and squares of residuals that go to what is left over."""

    rows: Array
    residual: Array
    rest: float


def whitened(channel: Channel, blocks: Sequence[Reduced]) -> list[Whitened]:
    """Rows of a channel whitened for slow noise as well.

    Parameters
    ----------
    channel : Channel
    blocks : sequence of Reduced
        All parts of the segment that were seen, whitened for white noise.

    Returns
    -------
    list of Whitened
        Of each block.
    """
    turned = [_turned(channel, b) for b in blocks]
    size = np.array([np.linalg.norm(b.bias) for b in blocks])
    at = np.array([b.part for b in blocks])
    means = channel.slow.parts_covariance(channel.axis, channel.duration, channel.whole, channel.parts)[np.ix_(at, at)]
    root = np.linalg.cholesky(np.eye(size.size) + size[:, None] * means * size)
    first = np.linalg.solve(root, np.stack([rows[0] for rows, _ in turned]))
    return [
        Whitened(np.vstack([mean[:-1], rows[1:, :-1]]), np.append(mean[-1], rows[1:, -1]), rest)
        for mean, (rows, rest) in zip(first, turned, strict=True)
    ]


def _turned(channel: Channel, b: Reduced) -> tuple[Array, float]:
    """Rows, residual last, of the mean over the part and of sines, the latter whitened, (m, k + 1), and squares left over."""
    along = b.bias / np.linalg.norm(b.bias)
    # a reflection that takes the bias to the first row, of the same sign in all parts
    mirror = along + np.copysign(1.0, along[0]) * np.eye(along.size)[0]
    turn = np.eye(along.size) - 2.0 * np.outer(mirror, mirror) / (mirror @ mirror)
    turn[0] *= -np.copysign(1.0, along[0])
    rows = turn @ np.column_stack([b.rows, b.residual])
    size = np.maximum(np.linalg.norm(rows[:, :-1], axis=0), 1e-300)
    left, seen, right = np.linalg.svd(rows[1:, :-1] / size, full_matrices=False)
    # what remains of the columns without the bias's part, which differs by nothing from sample to sample
    back = right.T / np.maximum(seen, _LEAST) / size[:, None]
    roughness = back.T @ b.rough @ back
    strong = int(np.count_nonzero(seen > _STRONG))
    values = np.diag(roughness).copy()
    values[:strong], vectors = np.linalg.eigh(roughness[:strong, :strong])
    rows[1:] = left.T @ rows[1:]
    rows[1 : 1 + strong] = vectors.T @ rows[1 : 1 + strong]
    weight = 1.0 / np.sqrt(1.0 + _added(channel, b, np.clip(values, 0.0, 4.0)))
    weak = slice(1 + strong, len(rows))
    rest = float(np.sum((1.0 - weight[strong:] ** 2) * rows[weak, -1] ** 2))
    rows[1:] *= weight[:, None]
    return np.asarray(rows), rest


def _added(channel: Channel, b: Reduced, values: Array) -> Array:
    """Variance that slow noise adds to that of sines, by their eigenvalues, relative to white noise's."""
    slowest = 0.5 * channel.parts / channel.duration
    frequency = np.maximum(np.arcsin(np.sqrt(values) / 2.0) / (math.pi * channel.interval), slowest)
    # of the white noise's density, as the bias has it: n samples of N^2 / dt each make it n dt / N^2
    white = b.count * channel.interval / float(b.bias @ b.bias)
    return np.asarray(channel.slow.density(frequency, channel.axis) / white / (1.0 + values * channel.rounding))
