"""Samples of a roll-isolated rig piece by piece, with the neighbours that smoothing and integrating need.

A run is a stretch of samples of one segment without gap. Of each run the first and last `half` samples serve only as
neighbours of the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..errors import DataError, InputError
from ..frames import Array
from ..plan import Segment
from ..recording import GAP, Batch, Recording, sample_interval

SMOOTHING = 0.025
"""Half-width of the local polynomials in s: a swing of some hertz passes, the noise of single samples does not."""
_SIZE = 1 << 14  # samples worked on at once


@dataclass(frozen=True)
class Window:
    """Consecutive samples of one run; the centre ones are dealt with, `half` at each end are neighbours.

    Attributes
    ----------
    segment : int
        Index of the segment.
    fresh : bool
        Whether a run begins here.
    row : int
        Number of the first sample of the arrays in the file, counted from one.
    half : int
    time : ndarray, shape (n + 2 half,), s
    gyro : ndarray, shape (n + 2 half, 3), rad/s
    encoder : ndarray, shape (n + 2 half,), rad, or None
    """

    segment: int
    fresh: bool
    row: int
    half: int
    time: Array
    gyro: Array
    encoder: Array | None

    @property
    def centre(self) -> slice:
        """The samples between the neighbours."""
        return slice(self.half, self.time.size - self.half)


def need_rates(recording: Recording) -> None:
    """Refuse a recording whose gyros are not sampled rates.

    Raises
    ------
    InputError
    """
    recording.need("gyro")
    if "gyro" in recording.counts:
        raise InputError(
            f"{recording.name}: the gyros are raw counts; give their nominal scale (--scale gyro='131 LSB/(deg/s)')"
        )
    if "gyro" in recording.increments:
        raise InputError(
            f"{recording.name}: the gyros count pulses over each sample interval; this method reads sampled rates"
        )


def interval_of(recording: Recording) -> float:
    """Sample interval of a recording, from its first piece, in s."""
    first = next(recording.batches(), None)
    if first is None or first.time.size < 2:
        raise DataError(f"{recording.name}: the recording holds too few samples")
    return sample_interval(first.time)


def half_width(interval: float, reach: float = SMOOTHING) -> int:
    """Neighbours at each side for a sample interval and a half-width in s."""
    return max(2, math.floor(reach / interval + 0.5001))  # whatever the last digits of the interval


def windows(recording: Recording, segments: Sequence[Segment], interval: float, half: int) -> Iterator[Window]:
    """All samples of the segments in one pass.

    Parameters
    ----------
    recording : Recording
    segments : sequence of Segment
    interval : float, s
        Usual step from sample to sample; one of more than 1.5 of it ends a run.
    half : int
        Neighbours at each side.
    """
    carry: Window | None = None
    for batch in recording.batches():
        for at, segment in enumerate(segments):
            i, j = np.searchsorted(batch.time, [segment.start, segment.stop])
            for start in range(int(i), int(j), _SIZE):
                piece = _cut(batch, at, half, start, min(start + _SIZE, int(j)))
                for part in _runs(piece, carry, interval):
                    if part.time.size > 2 * half:
                        yield part
                    carry = part


def _cut(batch: Batch, segment: int, half: int, i: int, j: int) -> Window:
    assert batch.gyro is not None  # need_rates has looked
    encoder = batch.rig.get("encoder")
    return Window(
        segment, True, batch.row + i, half, batch.time[i:j], batch.gyro[i:j], None if encoder is None else encoder[i:j]
    )


def _runs(piece: Window, carry: Window | None, interval: float) -> Iterator[Window]:
    """A piece cut at its gaps, the first part with what went before it where no gap lies between."""
    edges = [0, *(np.flatnonzero(np.diff(piece.time) > GAP * interval) + 1), piece.time.size]
    for number, (i, j) in enumerate(pairwise(edges)):
        encoder = None if piece.encoder is None else piece.encoder[i:j]
        part = Window(piece.segment, True, piece.row + int(i), piece.half, piece.time[i:j], piece.gyro[i:j], encoder)
        follows = (
            number == 0
            and carry is not None
            and carry.segment == piece.segment
            and part.time[0] - carry.time[-1] <= GAP * interval
        )
        yield _joined(carry, part) if follows and carry is not None else part


def _joined(before: Window, part: Window) -> Window:
    """A part with the last neighbours of the one before it in front."""
    keep = min(2 * part.half, before.time.size)
    encoder = None
    if part.encoder is not None and before.encoder is not None:
        encoder = np.concatenate([before.encoder[-keep:], part.encoder])
    return Window(
        part.segment,
        before.time.size <= 2 * part.half and before.fresh,  # nothing of this run was dealt with yet
        part.row - keep,
        part.half,
        np.concatenate([before.time[-keep:], part.time]),
        np.concatenate([before.gyro[-keep:], part.gyro]),
        encoder,
    )


def polynomial_taps(half: int, interval: float) -> Array:
    """Weights of the quadratic that fits 2 half + 1 samples best: value, slope and half the curvature at the middle.

    Savitzky & Golay 1964.

    Returns
    -------
    ndarray, shape (3, 2 half + 1)
        Times the samples give g0, g1, g2 of ``y(t + s) = g0 + g1 s + g2 s^2``.
    """
    s = np.arange(-half, half + 1) * interval
    return np.linalg.pinv(np.column_stack([np.ones(s.size), s, s * s]))


def local_polynomial(values: Array, taps: Array) -> Array:
    """Local quadratic of samples (n + 2 half,) at the n centre ones, shape (3, n); `taps` from :func:`polynomial_taps`."""
    return np.stack([np.convolve(values, weights[::-1], mode="valid") for weights in taps])


def step_integrals(time: Array, values: Array, half: int) -> Array:
    """Integral of sampled values over the step that ends at each centre sample.

    From the cubic through four samples; error (11/720) of the fourth difference times the step.

    Parameters
    ----------
    time : ndarray, shape (n + 2 half,), s
    values : ndarray, shape (n + 2 half, ...)
    half : int
        At least 2.

    Returns
    -------
    ndarray, shape (n, ...)
    """
    n = time.size - 2 * half
    before, here, after = half - 1, half, half + 1
    steps = (time[here : here + n] - time[before : before + n]).reshape((n,) + (1,) * (values.ndim - 1))
    inner = values[before : before + n] + values[here : here + n]
    outer = values[before - 1 : before - 1 + n] + values[after : after + n]
    return np.asarray(steps * (13.0 * inner - outer) / 24.0)


def wrapped(angle: Array | float) -> Array:
    """Angles within -pi and pi."""
    return np.asarray(angle - 2.0 * math.pi * np.round(np.asarray(angle) / (2.0 * math.pi)))
