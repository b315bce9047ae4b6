"""A look at every sample of a segment: time, gaps, extremes; what no method can use is refused here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..errors import DataError
from ..frames import Array
from ..plan import Segment
from ..recording import GAP, SENSORS, Recording

_STUCK = 10  # equal samples that no noisy axis shows by chance
_FROZEN_SHARE = 0.2
RESOLVED = 1.5
"""Noise in steps of the converter from which a run of equal samples is suspicious."""


@dataclass
class Seen:
    """What was seen of one segment over the axes of all sensors; the arrays have shape (axes,).

    Attributes
    ----------
    segment : Segment
    axes : int
    count : int
    time_sum : float, s
        Of the times since the start of the segment.
    first, last : float, s
        Time of the first and last sample.
    lost : float, s
    gaps : int
        Steps that are gaps, their sum and number.
    squared_steps : ndarray
        Sum of the squared differences of neighbours.
    low, high, at_low, at_high : ndarray
        Extremes, and how many samples stand exactly there.
    finest : ndarray
        Smallest difference of neighbours that differ.
    """

    segment: Segment
    axes: int
    count: int = 0
    time_sum: float = 0.0
    first: float = np.nan
    last: float = np.nan
    lost: float = 0.0
    gaps: int = 0
    squared_steps: Array = field(default_factory=lambda: np.zeros(0))
    low: Array = field(default_factory=lambda: np.zeros(0))
    high: Array = field(default_factory=lambda: np.zeros(0))
    at_low: Array = field(default_factory=lambda: np.zeros(0))
    at_high: Array = field(default_factory=lambda: np.zeros(0))
    finest: Array = field(default_factory=lambda: np.zeros(0))

    def see(self, time: Array, interval: float) -> None:
        """Take in the times of the next samples.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        interval : float, s
            Usual step from sample to sample; wider ones are gaps.
        """
        if self.count == 0:
            self.first = self.last = float(time[0])
        steps = np.diff(time, prepend=self.last)
        wide = steps > GAP * interval
        self.lost, self.gaps = self.lost + float(steps[wide].sum()), self.gaps + int(wide.sum())
        self.count += time.size
        self.time_sum += float((time - self.segment.start).sum())
        self.last = float(time[-1])

    @property
    def interval(self) -> float:
        """Mean sample interval without the gaps, s; a lone sample stands for the whole segment."""
        if self.count == 1:
            return self.segment.stop - self.segment.start
        return (self.last - self.first - self.lost) / max(self.count - 1 - self.gaps, 1)

    @property
    def mid_time(self) -> float:
        """Mean time of the samples, s."""
        return self.segment.start + self.time_sum / self.count

    @property
    def sample_noise(self) -> Array:
        """Noise of single samples from their differences, shape (axes,)."""
        return np.asarray(np.sqrt(0.5 * self.squared_steps / max(self.count - 1, 1)))


def axis_names(recording: Recording) -> tuple[str, ...]:
    """Axes of a recording in standard order, single ones with those of whole triads."""
    return tuple(a for s, axes in SENSORS.items() for a in axes if s in recording.has or a in recording.single)


def gaps_inside(found: Sequence[tuple[float, float]], segments: Sequence[Segment]) -> list[tuple[Segment, str]]:
    """The first gaps that lie in a segment, each in words."""
    inside = [(s, t, g) for t, g in found for s in segments if s.start <= t and t + g <= s.stop]
    return [(s, f"gap of {g:.3g} s at {t:.6g} s in segment {s.name!r}: excluded") for s, t, g in inside[:20]]


def refuse_outside(name: str, parts: Sequence[Seen], first: float, last: float, interval: float) -> None:
    """Refuse segments without samples or beyond the data.

    Raises
    ------
    DataError
    """
    slack = GAP * interval if np.isfinite(interval) else 0.0
    if np.isnan(first):
        raise DataError(f"{name}: the recording holds no samples")
    for part in parts:
        s = part.segment
        if part.count == 0 or s.start < first - slack or s.stop > last + slack:
            raise DataError(
                f"segment {s.name!r} ({s.start:g} s to {s.stop:g} s) lies outside the data of {name} "
                f"({first:g} s to {last:g} s, {part.count} samples in the segment): check the plan's times"
            )


def refuse_saturated(name: str, parts: Sequence[Seen], axes: Sequence[str]) -> None:
    """Refuse an axis that stays on one extreme value while it is noisy elsewhere: it is saturated, stuck or dead.

    Raises
    ------
    DataError
    """
    noise = np.array([p.sample_noise for p in parts])
    turning = np.array([p.segment.turn_rate != 0 for p in parts])
    finest = np.min([p.finest for p in parts], axis=0)
    low, high = np.min([p.low for p in parts], axis=0), np.max([p.high for p in parts], axis=0)
    alive = noise.max(axis=0) > 0
    # among its like: what the turn itself changes from sample to sample is no noise
    usual = {turns: np.median(noise[turning == turns], axis=0) for turns in set(turning.tolist())}
    for k, axis in enumerate(axes):
        if low[k] == high[k] and alive.any() and len(parts) > 1:
            raise DataError(f"{name}: {axis} never changes (always {low[k]:g}): the axis is dead or not connected")
        for part, turns in zip(parts, turning, strict=True):
            if not usual[bool(turns)][k] > RESOLVED * finest[k]:
                continue
            for side, value, held in (("top", high[k], part.at_high[k]), ("bottom", low[k], part.at_low[k])):
                extreme = (part.high if side == "top" else part.low)[k] == value
                if extreme and held >= max(_STUCK, _FROZEN_SHARE * part.count):
                    raise DataError(
                        f"{name}: {axis} is saturated in segment {part.segment.name!r}: {int(held)} of {part.count} "
                        f"samples stand exactly at the {side} of its range ({value:g}). Leave the segment out or "
                        "choose a wider range"
                    )
            if part.count >= _STUCK and part.low[k] == part.high[k]:
                raise DataError(
                    f"{name}: {axis} is stuck at {part.low[k]:g} through segment {part.segment.name!r}: "
                    "the axis or its channel stopped"
                )
