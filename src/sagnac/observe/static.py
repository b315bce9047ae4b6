"""Static intervals of a log, for a unit that was turned by hand from attitude to attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frames import Array
from ..recording import GAP, Batch, sample_interval

THRESHOLD = 10.0
"""Variance, in units of the quietest windows, up to which a window is static. Sensor noise alone stays under 3; hands
are above 100; between lies a wide empty stretch."""
_WINDOW = 1.0  # s
_FEWEST = 11  # samples in a window
_QUIET = 0.1  # share of the windows that is taken for the floor


@dataclass(frozen=True)
class StaticIntervals:
    """Where the unit stood still.

    Attributes
    ----------
    start, stop : ndarray of int, shape (n,)
        First sample and one past the last.
    ratio : ndarray, shape (samples,)
        Largest moving variance over the axes, in units of the floor (what was compared with the threshold).
    threshold : float
    """

    start: NDArray[np.intp]
    stop: NDArray[np.intp]
    ratio: Array
    threshold: float


def moving_variance(values: Array, width: int) -> Array:
    """Variance in every window of `width` samples.

    Parameters
    ----------
    values : ndarray, shape (n, k)
    width : int

    Returns
    -------
    ndarray, shape (n - width + 1, k)
    """
    centred = values - values.mean(axis=0)
    sums = np.zeros((len(values) + 1, values.shape[1]))
    squares = np.zeros_like(sums)
    np.cumsum(centred, axis=0, out=sums[1:])
    np.multiply(centred, centred, out=centred)
    np.cumsum(centred, axis=0, out=squares[1:])
    mean = (sums[width:] - sums[:-width]) / width
    return np.asarray(np.maximum((squares[width:] - squares[:-width]) / width - mean**2, 0.0))


def static_intervals(batch: Batch, threshold: float = THRESHOLD) -> StaticIntervals:
    """Find the static intervals of a recording.

    Parameters
    ----------
    batch : Batch
        The whole recording, raw or SI.
    threshold : float
        See :data:`THRESHOLD`.

    Returns
    -------
    StaticIntervals

    Raises
    ------
    DataError
        When the recording is shorter than a few windows.
    """
    values = np.hstack([v for v in (batch.accel, batch.gyro) if v is not None])
    interval = sample_interval(batch.time) if batch.time.size > 1 else 1.0
    width = max(_FEWEST, round(_WINDOW / interval) | 1)
    if len(values) < 10 * width:
        raise DataError(
            f"the recording holds {len(values)} samples ({len(values) * interval:.3g} s): too few to find static "
            f"intervals in (at least {10 * width})"
        )
    variance = moving_variance(values, width)
    ratio = np.max(variance / _floor(values, variance), axis=1)
    quiet = ratio < threshold
    for gap in np.flatnonzero(np.diff(batch.time) > GAP * interval):
        quiet[max(gap - width + 2, 0) : gap + 1] = False
    edges = np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]]))
    start, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    long_enough = stop - start >= width
    half = width // 2
    whole = np.concatenate([np.full(half, ratio[0]), ratio, np.full(len(values) - half - len(ratio), ratio[-1])])
    return StaticIntervals(start[long_enough] + half, stop[long_enough] + half, whole, threshold)


def _floor(values: Array, variance: Array) -> Array:
    """Variance of each axis at rest: the median over the quietest tenth of the windows.

    It is never less than what the converter's step leaves unseen.
    """
    low = np.quantile(variance[:: max(1, len(variance) // 20000)], 0.05, axis=0)
    tiny = 1e-12 * values.var(axis=0) + 1e-300
    steps = np.abs(np.diff(values[:20000], axis=0))
    step = np.where(steps > 0, steps, np.inf).min(axis=0)
    tiny = np.maximum(tiny, np.where(np.isfinite(step), step, 0.0) ** 2 / 12.0)
    total = np.max(variance / np.maximum(low, tiny), axis=1)
    quietest = np.argpartition(total, int(_QUIET * (total.size - 1)))[: max(1, int(_QUIET * total.size))]
    return np.asarray(np.maximum(np.median(variance[quietest], axis=0), tiny))
