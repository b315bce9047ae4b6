"""One pass over a recording: its blocks, its gaps, and its samples, or pyramids of them where they are too many to keep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ..errors import DataError
from ..frames import Array
from ..observe.samples import axis_names
from ..recording import SENSORS, Batch, Recording
from .allan import Pyramid, Variances, octaves, pooled, variances
from .blocks import Blocks, Ledger
from .clock import Clock, usual_interval
from .spectrum import Density, SpectrumPass

MEMORY = 2**31
"""Bytes of samples that are kept, by default; while an axis is worked on, its samples in a row and their sums come on top."""
SHORTEST = 64
"""Samples of a stretch that is worth taking."""
PER_OCTAVE = 2
"""Averaging times to the octave."""


@dataclass(frozen=True)
class Correction:
    """What goes along with the temperature: taken off the samples.

    Attributes
    ----------
    time, temperature : ndarray, shape (k,)
        s and K, the latter less its mean.
    coefficient : ndarray, shape (axes,)
        Per K.
    """

    time: Array
    temperature: Array
    coefficient: Array

    def at(self, time: Array) -> Array:
        """Temperature at these times, K from its mean."""
        return np.interp(time, self.time, self.temperature)

    def off(self, time: Array, values: Array) -> Array:
        """Samples (n, axes) without it."""
        return np.asarray(values - self.at(time)[:, None] * self.coefficient)


@dataclass(frozen=True)
class Samples:
    """Samples without a gap, as they came: putting them together would take their memory twice.

    Attributes
    ----------
    start : float, s
        Time of the first.
    parts : tuple of ndarray, each of shape (axes, m)
    """

    start: float
    parts: tuple[Array, ...]

    def column(self, axis: int, interval: float, correction: Correction | None) -> Array:
        """Samples of one axis in a row, shape (n,), the correction taken off."""
        column = np.concatenate([part[axis] for part in self.parts])
        if correction is not None and correction.coefficient[axis] != 0:
            time = self.start + interval * np.arange(float(column.size))
            column -= correction.at(time) * correction.coefficient[axis]
        return column


@dataclass(frozen=True)
class Gathered:
    """What a pass has found.

    Attributes
    ----------
    axes : tuple of str
    interval : float, s
        Mean, without the gaps.
    samples : int
        Those of all stretches.
    stretches : tuple of int
        Samples between the gaps.
    span : tuple of float, s
        Times of the first and last sample.
    gaps : tuple of (float, float)
        Time of the last sample before each, and its length, s.
    mean : ndarray, shape (axes,)
    blocks : Blocks
    short : int
        Samples in stretches that are too short to be taken.
    kept : list of Samples or None
        Those of each stretch.
    streamed : list of dict of str to list of Pyramid, or None
        Of each stretch, kind and axis, where the samples are not kept.
    spectrum : Density or None
        Of all axes; None where no stretch is long enough.
    """

    axes: tuple[str, ...]
    interval: float
    samples: int
    stretches: tuple[int, ...]
    span: tuple[float, float]
    gaps: tuple[tuple[float, float], ...]
    mean: Array
    blocks: Blocks
    short: int
    kept: list[Samples] | None
    streamed: list[dict[str, list[Pyramid]]] | None
    spectrum: Density | None


def column_matrix(batch: Batch, axes: Sequence[str]) -> Array:
    """Samples of these axes, shape (n, axes), those of an axis side by side in memory."""
    rows = np.empty((len(axes), batch.time.size))
    for row, axis in zip(rows, axes, strict=True):
        sensor = axis.partition("_")[0]
        whole = batch.accel if sensor == "accel" else batch.gyro
        row[:] = batch.single[axis] if whole is None else whole[:, SENSORS[sensor].index(axis)]
    return rows.T


def gather(
    recording: Recording,
    *,
    kinds: tuple[str, ...] = ("allan",),
    start: float | None = None,
    stop: float | None = None,
    memory: int = MEMORY,
    correction: Correction | None = None,
) -> Gathered:
    """Read a recording once.

    Parameters
    ----------
    recording : Recording
    kinds : tuple of str
        Of the pyramids, see :data:`sagnac.noise.allan.KINDS`.
    start, stop : float, s, optional
        Samples before and from here on are left out.
    memory : int
        Bytes of samples that may be kept.
    correction : Correction, optional
        Taken off the samples.

    Raises
    ------
    InputError
        When a sample cannot be read.
    DataError
        When there are too few samples.
    """
    axes = axis_names(recording)
    reader: _Reader | None = None
    with ThreadPoolExecutor(1) as pool:  # takes a batch while the next one is read
        taking: Future[None] | None = None
        for batch in recording.batches():
            time, values, warmth = _cut(batch, axes, start, stop)
            if not time.size:
                continue
            if reader is None:
                reader = _Reader(axes, kinds, memory, correction)
            if taking is not None:
                taking.result()
            taking = pool.submit(reader.take, time, values, warmth)
        if taking is not None:
            taking.result()
    if reader is None:
        raise DataError(f"{recording.name}: no samples between --from and --to")
    return reader.done(recording.name)


def _cut(
    batch: Batch, axes: Sequence[str], start: float | None, stop: float | None
) -> tuple[Array, Array, Array | None]:
    i = 0 if start is None else int(np.searchsorted(batch.time, start))
    j = batch.time.size if stop is None else int(np.searchsorted(batch.time, stop))
    warmth = batch.rig.get("temperature")
    return batch.time[i:j], column_matrix(batch, axes)[i:j], None if warmth is None else warmth[i:j]


@dataclass
class _Stretch:
    """Samples without a gap: kept, or gone into pyramids."""

    start: float
    count: int = 0
    parts: list[Array] = field(default_factory=list)
    pyramids: dict[str, list[Pyramid]] = field(default_factory=dict)


class _Reader:
    """Takes batches one after the other."""

    def __init__(
        self, axes: tuple[str, ...], kinds: tuple[str, ...], memory: int, correction: Correction | None
    ) -> None:
        self._axes, self._kinds, self._memory, self._correction = axes, kinds, memory, correction
        self._pending: list[tuple[Array, Array, Array | None]] = []
        self._interval = math.nan
        self._ledger: Ledger | None = None
        self._first = self._last = math.nan
        self._clock = Clock(math.nan)
        self._waiting = np.zeros((0, len(axes)))
        self._waiting_time = np.zeros(0)
        self._stretches: list[_Stretch] = []
        self._bytes = 0
        self._spectra: SpectrumPass | None = None
        self._streaming = False
        self._count = 0
        self._reference = np.zeros(len(axes))
        self._sum = np.zeros(len(axes))

    def take(self, time: Array, values: Array, warmth: Array | None) -> None:
        """Take the next samples; the first few wait until they tell how far apart samples are."""
        if self._ledger is None:
            self._pending.append((time, values, warmth))
            if sum(t.size for t, _, _ in self._pending) < SHORTEST:
                return
            known = np.concatenate([t for t, _, _ in self._pending])
            self._interval = usual_interval(known)
            self._clock = Clock(self._interval)
            self._ledger = Ledger(len(self._axes), self._interval)
            self._spectra = SpectrumPass(self._interval, len(self._axes))
            self._first, self._reference = float(known[0]), self._pending[0][1][0].copy()
            for part in self._pending:
                self._take(*part)
            self._pending = []
            return
        self._take(time, values, warmth)

    def _take(self, time: Array, values: Array, warmth: Array | None) -> None:
        assert self._ledger is not None
        assert self._spectra is not None
        if self._correction is not None:
            values = self._correction.off(time, values)
        self._ledger.add(time, values, warmth)
        self._sum += (values.mean(axis=0) - self._reference) * time.size
        self._count += time.size
        self._part(time, values)
        self._last = float(time[-1])

    def _part(self, time: Array, values: Array) -> None:
        """Hand samples on, parted where the clock says that some were lost; the last ones wait until it has seen more."""
        assert self._spectra is not None
        held = len(self._waiting)
        decided, breaks = self._clock.take(time) if time.size else self._clock.rest()
        # those that waited and the new ones are handed on one after the other: nothing is copied
        for part, stamps, first in ((self._waiting, self._waiting_time, 0), (values, time, held)):
            last = min(decided - first, len(part))
            own = dict.fromkeys(b - first for b in breaks if 0 <= b - first < last)
            if last > 0 and not self._stretches:
                self._stretches.append(_Stretch(float(stamps[0])))
            for i, j in pairwise([*([0] if 0 not in own else []), *own, max(last, 0)]):
                if i in own:
                    self._stretches.append(_Stretch(float(stamps[i])))
                    self._spectra.gap()
                if j > i:
                    self._append(part[i:j])
        ahead = max(decided - held, 0)
        self._waiting = np.concatenate([self._waiting[decided:], values[ahead:]])
        self._waiting_time = np.concatenate([self._waiting_time[decided:], time[ahead:]])

    def _append(self, values: Array) -> None:
        assert self._spectra is not None
        stretch = self._stretches[-1]
        self._spectra.add(values)
        stretch.count += len(values)
        if self._streaming:
            self._feed(stretch, values)
            return
        stretch.parts.append(values.T)
        self._bytes += values.nbytes
        if self._bytes > self._memory:
            self._streaming = True
            for one in self._stretches:
                parts, one.parts = one.parts[::-1], []
                while parts:
                    self._feed(one, parts.pop().T)

    def _feed(self, stretch: _Stretch, values: Array) -> None:
        columns = range(len(self._axes))
        if not stretch.pyramids:
            stretch.pyramids = {
                kind: [Pyramid(self._interval, 1, kind, per_octave=PER_OCTAVE) for _ in columns] for kind in self._kinds
            }
        with ThreadPoolExecutor() as pool:
            for own in stretch.pyramids.values():
                list(pool.map(lambda p, k: p.add(np.ascontiguousarray(values[:, k])), own, columns))

    def done(self, name: str) -> Gathered:
        """What was found.

        Raises
        ------
        DataError
            When there are too few samples.
        """
        if self._ledger is not None:
            self._part(np.zeros(0), self._waiting[:0])
        whole = [s for s in self._stretches if s.count >= SHORTEST]
        if self._ledger is None or not whole:
            found = max((s.count for s in self._stretches), default=sum(t.size for t, _, _ in self._pending))
            raise DataError(
                f"{name}: {found} samples without a gap are too few to tell anything of their noise (at least {SHORTEST})"
            )
        gaps = self._clock.gaps
        interval = (self._last - self._first - self._clock.lost) / (self._count - 1)
        kept = None if self._streaming else [Samples(s.start, tuple(s.parts)) for s in whole]
        return Gathered(
            axes=self._axes,
            interval=interval,
            samples=sum(s.count for s in whole),
            stretches=tuple(s.count for s in whole),
            span=(self._first, self._last),
            gaps=tuple(gaps),
            mean=self._reference + self._sum / self._count,
            blocks=replace(self._ledger.blocks(), interval=interval),
            short=self._count - sum(s.count for s in whole),
            kept=kept,
            streamed=[s.pyramids for s in whole] if self._streaming else None,
            spectrum=_result(self._spectra),
        )


def _result(spectra: SpectrumPass | None) -> Density | None:
    try:
        return None if spectra is None else spectra.result()
    except DataError:
        return None


def variances_of(found: Gathered, axis: int, kind: str, correction: Correction | None = None) -> Variances:
    """Variances of one axis, those of all stretches pooled.

    Parameters
    ----------
    found : Gathered
    axis : int
    kind : str
        That of the pyramids, where the samples were not kept.
    correction : Correction, optional
        Taken off the samples that were kept.

    Raises
    ------
    DataError
        When the samples of a stretch are all the same.
    """
    if found.streamed is not None:
        return replace(pooled([p[kind][axis].result() for p in found.streamed]), interval=found.interval)
    parts = []
    for samples in found.kept or []:
        column = samples.column(axis, found.interval, correction)
        factors = octaves(column.size, kind, per_octave=PER_OCTAVE)
        parts.append(variances(column, found.interval, factors, kind))
    return pooled(parts)


def spectrum_of(found: Gathered, axis: int, correction: Correction | None = None) -> Density | None:
    """Power spectral density of one axis, None where no stretch is long enough.

    Parameters
    ----------
    found : Gathered
    axis : int
    correction : Correction, optional
        Taken off the samples that were kept.
    """
    if correction is not None and found.kept is not None and correction.coefficient[axis] != 0:
        running = SpectrumPass(found.interval, 1)
        for samples in found.kept:
            running.gap()
            running.add(samples.column(axis, found.interval, correction))
        return _result(running)
    if found.spectrum is None:
        return None
    return replace(found.spectrum, density=found.spectrum.density[:, axis : axis + 1])
