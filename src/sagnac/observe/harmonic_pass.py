"""One pass over a recording: harmonic sums of each segment, a look at every sample, and the line through the arm's column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from ..errors import DataError
from ..frames import Array
from ..recording import GAP, SENSORS, Batch, Recording, sample_interval
from .harmonic_sums import WORKERS, Fit, HarmonicSums
from .samples import RESOLVED, Seen

_RUN = 8  # equal samples in a row that the top of a wave never gives an unsaturated axis
_ENOUGH = 16  # samples that tell the usual step
_MANY = 20  # gaps worth a word
_CREST = 3.0  # times the time that a rounded wave stays in its last step


@dataclass
class Looked(Seen):
    """What was seen of one segment; see :class:`Seen`.

    Attributes
    ----------
    usual : float, s
        Usual step from sample to sample; wider ones are gaps.
    holes : list of (float, float), s
        The first gaps: time of the sample before, and length.
    run_low, run_high : ndarray, shape (axes,)
        Most equal samples in a row at the extremes.
    """

    usual: float = math.nan
    holes: list[tuple[float, float]] = field(default_factory=list)
    run_low: Array = field(default_factory=lambda: np.zeros(0))
    run_high: Array = field(default_factory=lambda: np.zeros(0))
    _state: list[Array] = field(default_factory=list)

    def see(self, time: Array, interval: float) -> None:
        """Take in the times of the next samples; of their usual step the first samples themselves tell."""
        if math.isnan(self.usual) and time.size >= _ENOUGH:
            self.usual = sample_interval(time)
        interval = interval if math.isnan(self.usual) else self.usual
        steps = np.diff(time, prepend=self.last if self.count else time[0])
        for i in np.flatnonzero(steps > GAP * interval)[: _MANY - len(self.holes)]:
            self.holes.append((float(time[i] - steps[i]), float(steps[i])))
        super().see(time, interval)

    def look(self, groups: Sequence[Array], pool: ThreadPoolExecutor) -> list[Future[None]]:
        """Take in the next samples, in the background."""
        from ..kernels import harmonics as kernel

        fresh = not self._state
        if fresh:
            self._state = [np.zeros((g.shape[1], kernel.LAST + 1)) for g in groups]
        return [pool.submit(kernel.look, g, s, fresh) for g, s in zip(groups, self._state, strict=True)]

    def settle(self) -> None:
        """Bring what was found into the attributes."""
        from ..kernels import harmonics as kernel

        if not self._state:
            return
        state = np.concatenate(self._state)
        self.low, self.high, self.finest = state[:, kernel.LOW], state[:, kernel.HIGH], state[:, kernel.FINEST]
        self.at_low, self.at_high = state[:, kernel.AT_LOW], state[:, kernel.AT_HIGH]
        self.run_low, self.run_high = state[:, kernel.LONGEST_LOW], state[:, kernel.LONGEST_HIGH]
        self.squared_steps = state[:, kernel.SQUARED_STEPS]


@dataclass
class ArmLine:
    """Straight line through the measured angle of the arm: sums of its difference from the planned turn."""

    start: float
    rate: float
    count: int = 0
    sums: Array = field(default_factory=lambda: np.zeros(5))
    _first: float = 0.0
    _last: float = 0.0

    def add(self, time: Array, angle: Array) -> None:
        """Take in the next samples (s, rad); the angle may jump by whole turns."""
        if self.count == 0:
            self._first = float(angle[0] - self.rate * (time[0] - self.start))
        x = time - self.start
        e = angle - self._first - self.rate * x
        e = np.unwrap(np.concatenate([[self._last], e]))[1:]
        self.count, self._last = self.count + x.size, float(e[-1])
        self.sums += [x.sum(), e.sum(), (x * x).sum(), (x * e).sum(), (e * e).sum()]

    def line(self, time: float) -> tuple[float, float, float]:
        """Angle at some time, rate, and standard uncertainty of the rate (rad, s)."""
        x, e = self.sums[:2] / self.count
        xx, xe, ee = self.sums[2:] / self.count - [x * x, x * e, e * e]
        if not xx > 0:
            return self._first + e, self.rate, math.inf
        slope = xe / xx
        rate = self.rate + slope
        variance = max(ee - slope * xe, 0.0) / max(self.count - 2, 1) / xx
        least = np.finfo(float).eps * (abs(rate) + 1.0 / math.sqrt(xx))
        angle = self._first + self.rate * (time - self.start) + e + slope * (time - self.start - x)
        return float(angle), float(rate), float(max(math.sqrt(variance), least))


@dataclass
class Pass:
    """What one pass found besides the sums.

    Attributes
    ----------
    first, last : float, s
        Sample times.
    interval : float, s
    """

    first: float = math.nan
    last: float = math.nan
    interval: float = math.nan


def go_through(
    recording: Recording,
    parts: Sequence[tuple[HarmonicSums | None, Looked]],
    lines: Sequence[ArmLine | None],
    *,
    look: bool = True,
) -> Pass:
    """One pass.

    Parameters
    ----------
    recording : Recording
    parts : sequence of (HarmonicSums or None, Looked)
        Of each segment; added to. Those without sums are only looked at.
    lines : sequence of ArmLine or None
        Where there is one, the arm column gives the angle of each sample.
    look : bool
        Whether the samples are looked at as well.
    """
    out = Pass()
    with ThreadPoolExecutor(WORKERS) as pool:
        for batch in recording.batches():
            if math.isnan(out.interval) and batch.time.size > 1:
                out.interval = sample_interval(batch.time)
            out.first = float(batch.time[0]) if math.isnan(out.first) else out.first
            out.last = float(batch.time[-1])
            # pulses were counted over the interval before their time stamp
            time = batch.time - out.interval / 2 if recording.increments else batch.time
            groups = _groups(batch)
            for (sums, seen), line in zip(parts, lines, strict=True):
                i, j = np.searchsorted(time, [seen.segment.start, seen.segment.stop])
                if i == j:
                    continue
                piece, stamps = [g[i:j] for g in groups], batch.time[i:j]
                interval = out.interval if math.isfinite(out.interval) else seen.segment.stop - seen.segment.start
                waiting: list[Future[None]] = []
                if look:
                    waiting = seen.look(piece, pool)
                    seen.see(time[i:j], interval)
                    if line is not None:
                        line.add(stamps, batch.rig["arm"][i:j])
                if sums is not None:
                    angle = batch.rig["arm"][i:j] if line is not None and sums.order else None
                    sums.add(piece, stamps, interval, angle=angle, pool=pool)
                for future in waiting:
                    future.result()
    for _, seen in parts:
        seen.settle()
    return out


def _groups(batch: Batch) -> list[Array]:
    """Samples of all axes in standard order, each array of shape (n, axes)."""
    out: list[Array] = []
    for sensor, axes in SENSORS.items():
        whole = getattr(batch, sensor)
        out += [whole] if whole is not None else [batch.single[a][:, None] for a in axes if a in batch.single]
    return out


def refuse_clipped(name: str, seen: Looked, fit: Fit, rate: float, axes: Sequence[str]) -> None:
    """Refuse an axis that stands at its extreme for a run of samples, though its noise moves it from step to step.

    A rounded wave stays in its last step for a time of its own, by its curvature there; such runs are no sign.

    Raises
    ------
    DataError
    """
    scatter = np.sqrt(fit.squares / max(fit.degrees_of_freedom, 1))
    order = np.repeat(np.arange(1, fit.coefficient.shape[1] // 2 + 1), 2)
    bend = rate**2 * np.sqrt(((order**2 * fit.coefficient[:, 1:]) ** 2).sum(axis=1))
    for k, axis in enumerate(axes):
        step = float(seen.finest[k])
        if not (math.isfinite(step) and scatter[k] > RESOLVED * step and bend[k] > 0):
            continue
        crest = 2.0 * math.sqrt(2.0 * step / bend[k]) / seen.interval
        for side, run, value in (("top", seen.run_high[k], seen.high[k]), ("bottom", seen.run_low[k], seen.low[k])):
            if run >= max(_RUN, _CREST * crest):
                raise DataError(
                    f"{name}: {axis} is saturated in segment {seen.segment.name!r}: {int(run)} samples in a row stand exactly at "
                    f"the {side} of its range ({value:g}). Leave the segment out or choose a wider range"
                )
