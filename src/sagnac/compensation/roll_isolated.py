"""Apply a roll-isolated calibration: rates without mounting and cone, the carrier's spin, and attitudes.

Per sample: gyros to rates w2 (bias, scale), to the inner cylinder's w1 (mounting), to those of a cylinder laid onto the spin axis
(:func:`sagnac.rigs.roll_isolated.without_cone`). The encoder's angle comes with its eccentricity undone and at the samples' time.
What encoder and gyro x say together of the carrier's roll is smoothed by local quadratics over a tenth of a second. Their slope
is the spin (a least-squares form of the M/T method: angle over measured time); their value takes the encoder's rounding away.

Attitudes refer to the frame of the laid cylinder at the first sample (x forward, y up, z right). They are integrated with coning
correction as quaternions and written as ``C = rot_y(yaw) rot_z(pitch) rot_x(roll)``. Carrier and laid cylinder share their axis,
hence yaw and pitch; the carrier's roll is that of the cylinder and the encoder's angle.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..calibration import Calibration
from ..errors import DataError, InputError
from ..frames import Array, transform
from ..observe.rolling import half_width, need_rates, polynomial_taps, wrapped
from ..recording import GAP, Batch, Recording, sample_interval
from ..rigs.roll_isolated import RollRig, mount, true_angle, without_cone
from ..sensors import Correction, correction, invert

SPIN_WINDOW = 0.05
"""Half-width of the local quadratics of the carrier's roll, s."""
COLUMNS = ("carrier_rate [rad/s]", "yaw [rad]", "pitch [rad]", "inner_roll [rad]", "carrier_roll [rad]")
_SIZE = 1 << 16
_ENOUGH = 1000  # samples to know their interval by
_NEIGHBOURS = 2  # that an integral over a step needs beside it
_FARTHEST = 0.8 * math.pi


class _Samples(NamedTuple):
    """Time (n,), gyro (n, 3) and encoder (n,)."""

    time: Array
    gyro: Array
    encoder: Array

    def cut(self, start: int | None, stop: int | None) -> _Samples:
        return _Samples(self.time[start:stop], self.gyro[start:stop], self.encoder[start:stop])


@dataclass
class _State:
    """Sample interval; attitude (quaternion, scalar last) and last turn, carried from piece to piece."""

    interval: float
    attitude: Array
    turn: Array


def stream(calibration: Calibration, recording: Recording) -> Iterator[tuple[Batch, dict[str, Array]]]:
    """Compensated samples piece by piece, with the batch that each came from.

    Parameters
    ----------
    calibration : Calibration
        By roll-isolated.
    recording : Recording
        With gyros and the column ``encoder``.

    Yields
    ------
    batch : Batch
    values : dict of str to ndarray
        ``gyro`` (n, 3) rad/s, and the columns of :data:`COLUMNS`, (n,) each.

    Raises
    ------
    InputError
        When gyros or encoder are missing, or the gyros are counts.
    DataError
        When the encoder turns too far from sample to sample.
    """
    need_rates(recording)
    values = calibration.values()
    model, rig = correction(values, "gyro"), RollRig.of(values)
    if model is None:
        raise DataError("the calibration has no gyro parameters")
    interval = _interval(recording)
    state = _State(interval, np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))
    # smoothing of smoothed values, at the ends of a run by whole windows, and integrals over a step
    need = 2 * (half_width(interval, SPIN_WINDOW) + half_width(interval)) + _NEIGHBOURS
    for batch, samples, lead in _with_neighbours(recording, need):
        yield batch, _compensate(batch, samples, lead, model, rig, state)


def _interval(recording: Recording) -> float:
    """Sample interval from the first pieces; one sample alone has any."""
    time = np.zeros(0)
    for batch in recording.batches():
        time = np.concatenate([time, batch.time])
        if time.size > _ENOUGH:
            break
    return sample_interval(time) if time.size > 1 else 1.0


def _with_neighbours(recording: Recording, need: int) -> Iterator[tuple[Batch, _Samples, int]]:
    """Each piece with the samples before and after it that its smoothing needs, and how many stand before it."""
    waiting: deque[Batch] = deque()
    before: _Samples | None = None
    for batch in recording.batches(with_other=True):
        waiting.extend(_pieces(batch))
        while len(waiting) > 1 and sum(b.time.size for b in waiting) - waiting[0].time.size >= need:
            yield _joined(before, waiting, need, recording.name)
            before = _tail(before, waiting.popleft(), need)
    while waiting:
        yield _joined(before, waiting, need, recording.name)
        before = _tail(before, waiting.popleft(), need)


def _pieces(batch: Batch) -> Iterator[Batch]:
    """A batch in pieces of bounded size."""
    for i in range(0, batch.time.size, _SIZE):
        j = min(i + _SIZE, batch.time.size)
        yield replace(
            batch,
            row=batch.row + i,
            time=batch.time[i:j],
            accel=None if batch.accel is None else batch.accel[i:j],
            gyro=None if batch.gyro is None else batch.gyro[i:j],
            rig={k: v[i:j] for k, v in batch.rig.items()},
            other=None if batch.other is None else batch.other.slice(i, j - i),
        )


def _samples(batch: Batch, name: str) -> _Samples:
    if "encoder" not in batch.rig:
        raise InputError(
            f"{name}: a roll-isolated calibration needs the column 'encoder [deg]'; rename it with --map encoder=..."
        )
    assert batch.gyro is not None  # need_rates has looked
    return _Samples(batch.time, batch.gyro, batch.rig["encoder"])


def _joined(before: _Samples | None, waiting: deque[Batch], need: int, name: str) -> tuple[Batch, _Samples, int]:
    parts = [_samples(b, name) for b in waiting]
    behind = sum(p.time.size for p in parts[1:])
    lead = 0 if before is None else before.time.size
    joined = _Samples(*(np.concatenate(c) for c in zip(*([] if before is None else [before]), *parts, strict=True)))
    return waiting[0], joined.cut(None, joined.time.size - max(behind - need, 0)), lead


def _tail(before: _Samples | None, batch: Batch, need: int) -> _Samples:
    here = _samples(batch, "")
    both = here if before is None else _Samples(*(np.concatenate(c) for c in zip(before, here, strict=True)))
    return both.cut(-need, None)


def _compensate(
    batch: Batch, samples: _Samples, lead: int, model: Correction, rig: RollRig, state: _State
) -> dict[str, Array]:
    """Rates, spin and attitudes of one piece."""
    rates = transform(mount(rig.mount_yaw, rig.mount_pitch).T, invert(model, samples.gyro))
    angle, carrier = np.empty(samples.time.size), np.empty(samples.time.size)
    gaps = np.flatnonzero(np.diff(samples.time) > GAP * state.interval) + 1
    edges = [0, *gaps, samples.time.size]
    for i, j in pairwise(edges):
        angle[i:j], carrier[i:j] = _carrier(samples.cut(i, j), rates[i:j, 0], rig, state.interval)
    laid, spin = without_cone(rates, angle, carrier - rates[:, 0], rig)
    here = slice(lead, lead + batch.time.size)
    attitude = _integrated(samples.time, laid, here, state)
    yaw, pitch, roll = _angles(attitude)
    out = {"gyro": laid[here]}
    return out | dict(zip(COLUMNS, (spin[here], yaw, pitch, roll, wrapped(roll + angle[here])), strict=True))


def _carrier(samples: _Samples, roll_rate: Array, rig: RollRig, interval: float) -> tuple[Array, Array]:
    """Encoder's angle at the samples' time and the carrier's rate about the cylinder's axis, (n,) each, of a run."""
    time = samples.time
    reading = np.unwrap(true_angle(samples.encoder, rig.eccentricity))
    steps = np.abs(np.diff(reading))
    if steps.size and steps.max() > _FARTHEST:
        raise DataError(
            f"the encoder turns by {math.degrees(steps.max()):.0f} deg from sample to sample at "
            f"{time[int(np.argmax(steps))]:.6g} s: its turns cannot be counted, or it jumps"
        )
    rolled = np.concatenate([[0.0], np.cumsum(np.diff(time) * (roll_rate[1:] + roll_rate[:-1]) / 2.0)])
    rate, slope, _ = _smoothed(roll_rate, half_width(interval), interval)
    d = rig.delay
    # roll of the carrier at the time of reading: steady, whatever the cylinder does
    value, along, bend = _smoothed(
        reading + rolled + d * (rate + d / 2.0 * slope), half_width(interval, SPIN_WINDOW), interval
    )
    return value - d * along + d * d * bend - rolled, along - 2.0 * d * bend


def _smoothed(values: Array, half: int, interval: float) -> Array:
    """Local quadratic at every sample of a run, (3, n): value, slope, half the curvature; at its ends the nearest whole one."""
    n = values.size
    half = min(half, (n - 1) // 2)
    if half < 1:
        return np.stack([values, np.zeros(n), np.zeros(n)])
    origin = values[0]  # long turned angles would lose digits
    inside = np.stack(
        [np.convolve(values - origin, weights[::-1], mode="valid") for weights in polynomial_taps(half, interval)]
    )
    out = np.empty((3, n))
    out[:, half : n - half] = inside
    for at, target in ((half, np.arange(half)), (n - half - 1, np.arange(n - half, n))):
        value, slope, bend = out[:, at]
        s = (target - at) * interval
        out[:, target] = np.stack([value + slope * s + bend * s * s, slope + 2.0 * bend * s, np.full(s.size, bend)])
    out[0] += origin
    return out


def _integrated(time: Array, rates: Array, here: slice, state: _State) -> Array:
    """Attitude at each sample of a piece, (n, 4)."""
    from ..kernels.attitude import compose

    steps = np.diff(time)[:, None]
    turns = np.zeros_like(rates)
    turns[1:] = steps * (rates[1:] + rates[:-1]) / 2.0
    # the cubic through four samples, where no gap lies between them
    whole = steps[:, 0] <= GAP * state.interval
    k = np.arange(2, time.size - 1)
    k = k[whole[k - 2] & whole[k - 1] & whole[k]]
    turns[k] += steps[k - 1] * (rates[k] + rates[k - 1] - rates[k - 2] - rates[k + 1]) / 24.0
    own = turns[here]
    out = np.asarray(compose(np.ascontiguousarray(own), state.turn, state.attitude))
    state.attitude, state.turn = out[-1].copy(), own[-1].copy()
    return out


def _angles(attitude: Array) -> tuple[Array, Array, Array]:
    """Yaw, pitch and roll of ``rot_y(yaw) rot_z(pitch) rot_x(roll)``, (n,) each."""
    x, y, z, w = attitude.T
    pitch = np.arcsin(np.clip(2.0 * (x * y + z * w), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (y * w - x * z), 1.0 - 2.0 * (y * y + z * z))
    roll = np.arctan2(2.0 * (x * w - y * z), 1.0 - 2.0 * (x * x + z * z))
    return yaw, pitch, roll
