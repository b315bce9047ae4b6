"""A recording as increments of angle and velocity, piece by piece, whatever its length.

Pulses are increments already: what was counted over a sample interval is handed on as it was counted, whatever the time
stamps say about the length of that interval. The first sample only says when the first increment begins.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import DataError, InputError
from ..frames import Array
from ..recording import GAP, Batch, Recording, sample_interval
from .strapdown import Meaning, increments

LONGEST_GAP = 10.0
"""s: what a unit does in a longer time cannot be guessed from the samples around it, even when one is told to bridge gaps."""
_AROUND = 1.0  # s of samples on each side whose mean stands for a gap
_GROUP = 12  # pieces are whole groups of one to four samples, so that nobody's coning sums break off
_ROWS = 1365 * _GROUP  # of a piece at most, so that memory does not depend on the file's batches
_SLACK = 1e-6  # of a sample interval, for times that were rounded when they were written


class Gap(NamedTuple):
    """A time without samples, s."""

    start: float
    stop: float


@dataclass(frozen=True)
class Piece:
    """Consecutive increments.

    Attributes
    ----------
    begin : float, s
        Time before the first one.
    time : ndarray, shape (n,), s
        At the end of each.
    steps : ndarray, shape (n,), s
    turns, pushes : ndarray, shape (n, 3), rad and m/s
        Integrals of angular rate and specific force, x right, y forward, z up.
    """

    begin: float
    time: Array
    steps: Array
    turns: Array
    pushes: Array


class Stream:
    """Increments of a recording between two times. Iterate over it, as often as wanted, for :class:`Piece`.

    Parameters
    ----------
    recording : Recording
        With both triads, in SI or with a nominal scale.
    meaning : {"instant", "mean"}
        What a sample in units of rate and force is: the value at its time or the mean since the sample before. Says nothing
        of pulses.
    start, stop : float, s, optional
        Increments that lie between these times; all unless given.
    bridge : bool
        Fill gaps with the mean of the samples around them instead of refusing them.

    Attributes
    ----------
    gaps : list of Gap
        The gaps that were filled, once the stream has passed them.

    Raises
    ------
    InputError
        When a triad is missing, or raw counts have no scale.
    DataError
        While it runs: at a gap, unless it is to be bridged; when a gap is longer than ten seconds all the same; when there are no
        samples between the times, or they end before `stop`.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        meaning: Meaning = "instant",
        start: float | None = None,
        stop: float | None = None,
        bridge: bool = False,
    ) -> None:
        for sensor in ("gyro", "accel"):
            recording.need(sensor)
            if sensor in recording.counts:
                raise InputError(
                    f"{recording.name}: the {sensor} columns are counts of unknown size; give --scale, "
                    f"for example --scale '{'gyro=1.1866 pulse/arcsec' if sensor == 'gyro' else 'accel=800 pulse/(m/s)'}'"
                )
        if meaning not in ("instant", "mean"):
            raise InputError(
                f"samples are 'instant' (values at their times) or 'mean' (since the one before), not {meaning!r}"
            )
        self.recording, self.gaps = recording, list[Gap]()
        self._meaning, self._bridge = meaning, bridge
        self._between = (-math.inf if start is None else start, math.inf if stop is None else stop)
        if not self._between[0] < self._between[1]:
            raise InputError(f"{recording.name}: from {start} s to {stop} s is no stretch of time")

    def __iter__(self) -> Iterator[Piece]:
        """Piece by piece, in one pass over the file."""
        self.gaps.clear()
        seen, first, last = False, math.nan, math.nan
        for piece in self._filled(self._raw()):
            first = piece.begin if math.isnan(first) else first
            last, usual = float(piece.time[-1]), float(np.median(piece.steps))
            part = self._cut(piece)
            if part is not None:
                seen = True
                yield from _chopped(part)
            if last > self._between[1]:
                break
        low, high = self._between
        if not seen:
            asked = f" between {low:.9g} s and {high:.9g} s"
            if math.isinf(low) or math.isinf(high):
                asked = f" from {low:.9g} s on" * math.isfinite(low) + f" up to {high:.9g} s" * math.isfinite(high)
            there = "fewer than two" if math.isnan(first) else f"they go from {first:.9g} s to {last:.9g} s"
            raise DataError(f"{self.recording.name}: no samples{asked}: {there}")
        if math.isfinite(high) and high - last > GAP * usual:
            raise DataError(
                f"{self.recording.name}: the samples end at {last:.9g} s, before the {high:.9g} s that were asked for (--to)"
            )

    def _cut(self, piece: Piece) -> Piece | None:
        """What of a piece lies between the times."""
        slack = _SLACK * float(np.median(piece.steps))
        begins = np.concatenate([[piece.begin], piece.time[:-1]])
        inside = np.flatnonzero((begins >= self._between[0] - slack) & (piece.time <= self._between[1] + slack))
        if not inside.size:
            return None
        cut = slice(int(inside[0]), int(inside[-1]) + 1)
        return Piece(float(begins[cut][0]), piece.time[cut], piece.steps[cut], piece.turns[cut], piece.pushes[cut])

    def _raw(self) -> Iterator[Piece]:
        """All increments; samples are held back until a group is whole and its neighbour has come, which integrals need."""
        time, gyro, accel = np.empty(0), np.empty((0, 3)), np.empty((0, 3))
        done, interval = 0, math.nan
        for batch in self.recording.batches():
            rates, forces = _triads(batch)
            time, gyro, accel = (np.concatenate(pair) for pair in ((time, batch.time), (gyro, rates), (accel, forces)))
            if math.isnan(interval) and batch.time.size > 1:
                interval = sample_interval(batch.time)  # the one that pulses were divided by
            ready = done + (time.size - 2 - done) // _GROUP * _GROUP
            if ready > done:
                yield self._between_samples(time, gyro, accel, done, ready, interval)
                keep = ready - 1
                time, gyro, accel, done = time[keep:], gyro[keep:], accel[keep:], 1
        if time.size > 1:
            yield self._between_samples(time, gyro, accel, done, time.size - 1, interval)

    def _between_samples(self, time: Array, gyro: Array, accel: Array, a: int, b: int, interval: float) -> Piece:
        """Increments a to b of those between the samples at hand; across a gap only what belongs to the sample at its end."""
        steps, turns, pushes = increments(time, gyro, accel, self._meaning)
        wide = steps > GAP * interval
        for sensor, sums, values in (("gyro", turns, gyro), ("accel", pushes, accel)):
            own = slice(None) if sensor in self.recording.increments else wide
            sums[own] = values[1:][own] * interval  # pulses come as counts over this interval
        return Piece(float(time[a]), time[a + 1 : b + 1], steps[a:b], turns[a:b], pushes[a:b])

    def _filled(self, pieces: Iterator[Piece]) -> Iterator[Piece]:
        """The same with gaps refused or filled."""
        usual, before = math.nan, None
        for piece in pieces:
            usual = float(np.median(piece.steps)) if math.isnan(usual) else usual
            wide = [int(i) for i in np.flatnonzero(piece.steps > GAP * usual) if self._meets(piece, int(i))]
            self._judge([Gap(float(piece.time[i] - piece.steps[i]), float(piece.time[i])) for i in wide])
            before = _fill(piece, wide, usual, before) if wide else piece
            yield before

    def _meets(self, piece: Piece, i: int) -> bool:
        """Whether an increment meets the times asked for."""
        low, high = self._between
        return bool(piece.time[i] > low and piece.time[i] - piece.steps[i] < high)

    def _judge(self, gaps: list[Gap]) -> None:
        for gap in gaps:
            span = gap.stop - gap.start
            told = f"{self.recording.name}: no samples from {gap.start:.9g} s to {gap.stop:.9g} s"
            if not self._bridge:
                raise DataError(
                    f"{told}: what the unit did in that time is not known. Take the part before or after it "
                    f"(--from, --to); navigation may fill it with the mean of the samples around it, a guess (--bridge-gaps)"
                )
            if span > LONGEST_GAP:
                raise DataError(f"{told}: {span:.3g} s are too long to be bridged; at most {LONGEST_GAP:g} s are")
            self.gaps.append(gap)


def _triads(batch: Batch) -> tuple[Array, Array]:
    assert batch.gyro is not None  # the stream was refused otherwise
    assert batch.accel is not None
    return batch.gyro, batch.accel


def _chopped(piece: Piece) -> Iterator[Piece]:
    for a in range(0, piece.time.size, _ROWS):
        cut = slice(a, a + _ROWS)
        begin = piece.begin if a == 0 else float(piece.time[a - 1])
        yield Piece(begin, piece.time[cut], piece.steps[cut], piece.turns[cut], piece.pushes[cut])


def _fill(piece: Piece, wide: list[int], usual: float, before: Piece | None) -> Piece:
    """Each gap as two increments: the missing time, with the mean of the samples around it, and that of the sample at its end."""
    whole = np.setdiff1d(np.arange(piece.time.size), wide)
    around = [Piece(piece.begin, piece.time[whole], piece.steps[whole], piece.turns[whole], piece.pushes[whole])]
    around += [before] if before is not None else []
    missing = piece.steps[wide] - usual
    turns, pushes = np.empty((len(wide), 3)), np.empty((len(wide), 3))
    for k, i in enumerate(wide):
        low, high = piece.time[i] - piece.steps[i] - _AROUND, piece.time[i] + _AROUND
        near = [(p, (p.time > low) & (p.time <= high)) for p in around]
        duration = sum(float(p.steps[m].sum()) for p, m in near)
        if duration == 0.0:
            raise DataError(f"no samples within {_AROUND:g} s of the gap before {piece.time[i]:.9g} s to fill it with")
        turns[k], pushes[k] = (
            sum(values[m].sum(axis=0) for values, m in pairs) * missing[k] / duration
            for pairs in ([(p.turns, m) for p, m in near], [(p.pushes, m) for p, m in near])
        )
    steps = piece.steps.copy()
    steps[wide] = usual
    return Piece(
        piece.begin,
        np.insert(piece.time, wide, piece.time[wide] - usual),
        np.insert(steps, wide, missing),
        np.insert(piece.turns, wide, turns, axis=0),
        np.insert(piece.pushes, wide, pushes, axis=0),
    )
