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
from .curves.allan import Ints, Variances
from .curves.bridges import LEAST, SHORT, Losses, Run, losses, of_runs
from .curves.filled_spectrum import FilledSpectrum
from .curves.spectrum import Density
from .curves.streamed import Stream, Streamed
from .findings.blocks import Blocks, Ledger
from .findings.clock import Clock, usual_interval

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
    """Samples of a run between long gaps, as they came: putting them together would take their memory twice.

    Attributes
    ----------
    start : float, s
        Time of the first.
    parts : tuple of ndarray, each of shape (axes, m)
        One after the other.
    lengths : ndarray of int, shape (k,)
        Samples of the pieces between single losses, in all parts together.
    lost : ndarray of int, shape (k - 1,)
        Samples lost after each piece but the last.
    """

    start: float
    parts: tuple[Array, ...]
    lengths: Ints
    lost: Ints

    def column(self, axis: int, interval: float, correction: Correction | None) -> Array:
        """Samples of one axis in a row, those that are there, shape (n,), the correction taken off."""
        column = np.concatenate([part[axis] for part in self.parts])
        if correction is not None and correction.coefficient[axis] != 0:
            place = np.arange(float(column.size)) + np.repeat(np.concatenate([[0], np.cumsum(self.lost)]), self.lengths)
            column -= correction.at(self.start + interval * place) * correction.coefficient[axis]
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
        Samples between the gaps, of those that are long enough to tell anything by themselves.
    span : tuple of float, s
        Times of the first and last sample.
    gaps : tuple of (float, float)
        Time of the last sample before each, and its length, s.
    mean : ndarray, shape (axes,)
    blocks : Blocks
    short : int
        Samples in stretches that are too short.
    losses : Losses
        What is lost in the gaps that are short enough to be bridged.
    kept : list of Samples or None
        Those of each run between the other gaps.
    streamed : dict of str to list of Streamed, or None
        By kind, of each axis, where the samples are not kept.
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
    losses: Losses
    kept: list[Samples] | None
    streamed: dict[str, list[Streamed]] | None
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
        Of the pyramids, see :data:`sagnac.noise.curves.allan.KINDS`.
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
class _Run:
    """Samples without a long gap: kept, or gone on."""

    start: float
    lengths: list[int] = field(default_factory=lambda: [0])
    lost: list[int] = field(default_factory=list)
    parts: list[Array] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Samples."""
        return sum(self.lengths)


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
        self._runs: list[_Run] = []
        self._bytes = 0
        self._spectra: FilledSpectrum | None = None
        self._stream: Stream | None = None
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
            self._spectra = FilledSpectrum(self._interval, len(self._axes))
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
        missing = self._clock.missing[len(self._clock.missing) - len(breaks) :]
        # those that waited and the new ones are handed on one after the other: nothing is copied
        for part, stamps, first in ((self._waiting, self._waiting_time, 0), (values, time, held)):
            last = min(decided - first, len(part))
            own = {b - first: n for b, n in zip(breaks, missing, strict=True) if 0 <= b - first < last}
            if last > 0 and not self._runs:
                self._runs.append(_Run(float(stamps[0])))
            for i, j in pairwise([*([0] if 0 not in own else []), *own, max(last, 0)]):
                if i in own:
                    self._break(own[i], float(stamps[i]))
                if j > i:
                    self._append(part[i:j])
        ahead = max(decided - held, 0)
        self._waiting = np.concatenate([self._waiting[decided:], values[ahead:]])
        self._waiting_time = np.concatenate([self._waiting_time[decided:], time[ahead:]])

    def _break(self, lost: int, start: float) -> None:
        """A gap before the sample at this time."""
        assert self._spectra is not None
        if lost > SHORT:
            self._spectra.gap()
            self._runs.append(_Run(start))
            if self._stream is not None:
                self._stream.gap()
            return
        self._spectra.loss(lost)
        self._runs[-1].lost.append(lost)
        self._runs[-1].lengths.append(0)
        if self._stream is not None:
            self._stream.loss(lost)

    def _append(self, values: Array) -> None:
        assert self._spectra is not None
        run = self._runs[-1]
        self._spectra.add(values)
        run.lengths[-1] += len(values)
        if self._stream is not None:
            self._stream.add(values)
            return
        run.parts.append(values.T)
        self._bytes += values.nbytes
        if self._bytes > self._memory:
            self._stream = Stream(
                self._interval, len(self._axes), self._kinds, per_octave=PER_OCTAVE, shortest=SHORTEST
            )
            for i, one in enumerate(self._runs):
                if i:
                    self._stream.gap()
                _hand_on(one, self._stream)

    def done(self, name: str) -> Gathered:
        """What was found.

        Raises
        ------
        DataError
            When there are too few samples.
        """
        if self._ledger is not None:
            self._part(np.zeros(0), self._waiting[:0])
        runs = [r for r in self._runs if r.count >= SHORTEST]
        given = losses([n for r in runs for n in r.lost], sum(r.count for r in runs))
        stretches = [n for r in runs for n in r.lengths if n >= LEAST]
        if self._ledger is None or not (runs if given.bridged else max(stretches, default=0) >= SHORTEST):
            few = [n for r in self._runs for n in r.lengths]
            found = max(few, default=sum(t.size for t, _, _ in self._pending))
            gaps = len(self._clock.gaps)
            parted = f"; by its times the log has {gaps} gaps: look at what loses samples, or how they are stamped"
            raise DataError(
                f"{name}: {found} samples without a gap are too few to tell anything of their noise (at least {SHORTEST})"
                + (parted if gaps > 1 else "")
            )
        interval = (self._last - self._first - self._clock.lost) / (self._count - 1)
        kept = [
            Samples(r.start, tuple(r.parts), np.array(r.lengths, dtype=np.int64), np.array(r.lost, dtype=np.int64))
            for r in runs
        ]
        return Gathered(
            axes=self._axes,
            interval=interval,
            samples=sum(r.count for r in runs) if given.bridged else sum(stretches),
            stretches=tuple(stretches),
            span=(self._first, self._last),
            gaps=tuple(self._clock.gaps),
            mean=self._reference + self._sum / self._count,
            blocks=replace(self._ledger.blocks(), interval=interval),
            short=self._count - sum(stretches),
            losses=given,
            kept=kept if self._stream is None else None,
            streamed=None if self._stream is None else self._stream.done(),
            spectrum=_result(self._spectra),
        )


def _hand_on(run: _Run, stream: Stream) -> None:
    """What was kept of a run goes into the stream, piece by piece."""
    ends = np.cumsum(run.lengths).tolist()
    piece, at = 0, 0
    parts, run.parts = run.parts[::-1], []
    while parts:
        values = parts.pop().T
        first = 0
        while first < len(values):
            if at == ends[piece]:
                stream.loss(run.lost[piece])
                piece += 1
            size = min(len(values) - first, ends[piece] - at)
            stream.add(values[first : first + size])
            first, at = first + size, at + size


def _result(spectra: FilledSpectrum | None) -> Density | None:
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
        return replace(found.streamed[kind][axis].result(found.losses), interval=found.interval)
    runs = [Run(s.column(axis, found.interval, correction), s.lengths, s.lost) for s in found.kept or []]
    return of_runs(runs, found.interval, kind, found.losses, per_octave=PER_OCTAVE)


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
        running = FilledSpectrum(found.interval, 1)
        for samples in found.kept:
            running.gap()
            column = samples.column(axis, found.interval, correction)[:, None]
            for i, piece in enumerate(np.split(column, np.cumsum(samples.lengths)[:-1])):
                if i:
                    running.loss(int(samples.lost[i - 1]))
                running.add(piece)
        return _result(running)
    if found.spectrum is None:
        return None
    return replace(found.spectrum, density=found.spectrum.density[:, axis : axis + 1])
