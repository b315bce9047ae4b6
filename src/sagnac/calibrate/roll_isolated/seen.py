"""What a first pass over a recording of a roll-isolated rig finds, before there is a model.

Per segment: means, noise, the encoder's mean rate, how it answers to the swing, its jumps and steps, and the first harmonic of
gyros y and z in its angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...frames import Array
from ...observe.rolling import windows, wrapped
from ...observe.saturation import refuse_saturated_motion
from ...plan import Segment
from ...recording import Batch, Recording

_EXCITED = 25.0
"""Variance of the swing rate over that of its noise from which the swing says something about the encoder's delay."""
_AVERAGED = 0.04  # s: long against the rounding of the encoder, short against a swing
_FEW = 0.1  # of the steps that could have been seen
_FOURTH = 70.0  # variance of a fourth difference of independent values over theirs
_ROUNDING = 1e-9  # rad: differences of the same reading written in other turns or digits


@dataclass
class Seen:
    """Running sums over one segment, and what they say.

    Attributes
    ----------
    segment : Segment
    interval : float, s
    count : int
    first, last : float, s
        Times of the first and last sample.
    jump : tuple
        Largest unexplained step of the encoder: size in rad, time in s, row.
    finest : float, rad
        Smallest difference of two readings of the encoder: its step, if it has one.
    """

    segment: Segment
    interval: float
    count: int = 0
    first: float = math.nan
    last: float = math.nan
    jump: tuple[float, float, int] = (0.0, math.nan, 0)
    finest: float = math.inf
    low: Array = field(default_factory=lambda: np.full(3, np.inf))
    high: Array = field(default_factory=lambda: np.full(3, -np.inf))
    sums: Array = field(default_factory=lambda: np.zeros(3))
    rough: Array = field(default_factory=lambda: np.zeros(3))
    """Squares of the gyros' fourth differences."""
    swing: Array = field(default_factory=lambda: np.zeros((5, 5)))
    """Moments of 1, cos r, sin r, gyro x and rate of the encoder, averaged over 0.04 s, with r the encoder's reading."""
    turned: Array = field(default_factory=lambda: np.zeros(2))
    """Encoder's turn and the time it took, over the centre samples."""
    normal: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """Moments of 1, gyro x, cos r, sin r, gyro y, gyro z."""
    codes: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """Which of its steps the encoder was seen to stand on; empty where the plan states no step."""

    @property
    def mean(self) -> Array:
        """Mean of the gyros, rad/s."""
        return self.sums / self.count

    @property
    def noise(self) -> Array:
        """Noise density from fourth differences, which motion hardly has, rad/s/sqrt(Hz)."""
        return np.asarray(np.sqrt(self.rough / _FOURTH / max(self.count, 1) * self.interval))

    @property
    def encoder_rate(self) -> float:
        """Mean rate of the encoder, rad/s."""
        return float(self.turned[0] / self.turned[1])

    @property
    def spin(self) -> float:
        """Spin of the carrier from encoder and gyro x, rad/s."""
        return self.encoder_rate + float(self.mean[0])

    @property
    def left_of_swing(self) -> Array:
        """Covariance of gyro x and rate of the encoder without means and what goes with the turn, (2, 2), (rad/s)^2."""
        known, both = self.swing[:3, :3], self.swing[:3, 3:]
        explained = both.T @ np.linalg.lstsq(known, both, rcond=None)[0]
        return np.asarray((self.swing[3:, 3:] - explained) / max(self.swing[0, 0], 1.0))

    @property
    def swing_variance(self) -> float:
        """Of the roll rate, (rad/s)^2."""
        return max(float(self.left_of_swing[0, 0]), 0.0)

    def answer(self) -> tuple[float, float]:
        """Rate that the encoder shows for a swing of one rad/s, -1 on a sound rig, and its standard error."""
        (xx, xe), (_, ee) = self.left_of_swing
        slope = float(xe / xx)
        return slope, math.sqrt(max(ee - slope * xe, 0.0) / xx / max(self.swing[0, 0] - 5.0, 1.0))

    def excited(self, density: float) -> bool:
        """Whether the cylinder swings by more than the noise of gyro x (rad/s/sqrt(Hz)) would have it."""
        return self.swing_variance > _EXCITED * density**2 / (_averaged(self.interval) * self.interval)

    @property
    def repeated(self) -> float:
        """How many samples stand on each step of the encoder that was seen, where far fewer were seen than could have been.

        A carrier that turns by the same few angles again and again has the same rounding errors again and again, which no
        averaging takes away. One where that is not so.
        """
        could, seen = min(self.count, self.codes.size), int(self.codes.sum())
        return self.count / seen if 0 < seen < _FEW * could else 1.0

    def harmonics(self) -> tuple[complex, complex]:
        """Parts of gyros y + iz that turn with the encoder, forward and backward, rad/s at the encoder's zero."""
        solution = np.linalg.lstsq(self.normal[:4, :4], self.normal[:4, 4:], rcond=None)[0]
        (cos_y, cos_z), (sin_y, sin_z) = solution[2], solution[3]
        forward = complex(cos_y + sin_z, cos_z - sin_y) / 2.0
        return forward, complex(cos_y - sin_z, cos_z + sin_y) / 2.0


def add_all(seen: Sequence[Seen], recording: Recording, interval: float, half: int) -> None:
    """Take in a whole recording.

    Raises
    ------
    InputError
        When the encoder is missing where the carrier spins.
    DataError
        When a gyro is saturated in motion.
    """
    for w in windows(recording, [s.segment for s in seen], interval, half):
        refuse_saturated_motion(recording.name, Batch(w.row, w.time, None, w.gyro))
        s, centre = seen[w.segment], w.centre
        time, gyro = w.time[centre], w.gyro[centre]
        s.first = time[0] if s.count == 0 else s.first
        s.last = float(time[-1])
        s.sums += gyro.sum(axis=0)
        s.low, s.high = np.minimum(s.low, gyro.min(axis=0)), np.maximum(s.high, gyro.max(axis=0))
        rough = np.diff(w.gyro[centre.start - 2 : centre.stop + 2], n=4, axis=0)
        s.rough, s.count = s.rough + (rough**2).sum(axis=0), s.count + time.size
        if s.segment.stage == "spin":
            if w.encoder is None:
                raise InputError(
                    f"{recording.name}: the spin stage needs the column 'encoder [deg]', the roll of the carrier against the "
                    "inner cylinder; rename it with --map encoder=..."
                )
            _add_encoder(s, w.row + half, w.time, w.encoder, gyro[:, 0], half)
            basis = np.stack([np.ones(time.size), gyro[:, 0], np.cos(w.encoder[centre]), np.sin(w.encoder[centre])])
            rows = np.vstack([basis, gyro[:, 1:].T])
            s.normal += rows @ rows.T


def _add_encoder(s: Seen, row: int, time: Array, encoder: Array, gyro: Array, half: int) -> None:
    """Steps of the encoder between centre samples, and how they go with gyro x there."""
    n = gyro.size
    steps = wrapped(np.diff(encoder[half - 1 : half + n]))
    dt = np.diff(time[half - 1 : half + n])
    s.turned += [steps.sum(), dt.sum()]
    apart = np.diff(np.unique(np.mod(encoder, 2.0 * math.pi)))
    s.finest = min(s.finest, float(np.min(apart, where=apart > _ROUNDING, initial=math.inf)))
    odd = np.abs(wrapped(steps - float(np.median(steps))))
    worst = int(np.argmax(odd))
    if odd[worst] > s.jump[0]:
        s.jump = (float(odd[worst]), float(time[half + worst]), row + worst)
    if s.codes.size:
        s.codes[
            np.round(np.mod(encoder, 2.0 * math.pi) / (2.0 * math.pi / s.codes.size)).astype(int) % s.codes.size
        ] = True
    m = _averaged(s.interval)
    rows = n // m
    if rows:
        here = encoder[half : half + n]
        columns = np.stack([np.ones(n), np.cos(here), np.sin(here), gyro, steps / dt])[:, : rows * m]
        means = columns.reshape(5, rows, m).mean(axis=-1)
        s.swing += means @ means.T


def _averaged(interval: float) -> int:
    """Samples averaged to see the swing in the encoder."""
    return max(1, round(_AVERAGED / interval))
