"""Power spectral density of noise in one streaming pass, finely resolved where frequencies are low.

Welch's method (1967) with stretches of several lengths side by side, each four times the one before: half overlapping,
under a Hann window, each less its mean or its trend. Every frequency is taken from the shortest stretch that resolves it to
a sixteenth, so that points lie about evenly on a logarithmic scale and high frequencies are averaged most.

The shortest stretches are of the samples as they are. Four times as long ones tell frequencies up to a sixteenth of the rate,
for which every fourth sample of a filtered record does: so all transforms have one length, and those of all longer
stretches take a third of the work of the shortest. The filter is the mean of four, twelve times over. What lies above folds
onto these frequencies weaker than they are by 100 dB or more, infinitely so near zero, where quantisation noise would need
it, and what the filter takes off them is known and divided out.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import DataError, InputError
from ...frames import Array
from .checks import check_finite, check_interval, table
from .side_by_side import each_axis

REMOVED = ("mean", "trend")
"""What is taken out of each stretch before it is transformed."""

_GROWTH = 4
_RESOLVED = 16  # bins of a stretch below which a longer one is asked
_LOWEST = 2  # bin of the longest that is the first to be shown: below, the window mixes the mean in
_LEAST = 3  # stretches from which a longer length takes part: two without overlap
_BLOCK = 1 << 16  # samples that are passed on at a time, whatever they come in
_PIECE = 1 << 12  # samples of lower rates that are worth looking at
_ROWS = 256  # stretches that are transformed at a time: they stay in the cache
_SMOOTH = 12  # times that the mean of four is taken before every fourth sample is
_MARGIN = 3 * _SMOOTH // 2  # samples on both sides of one that the filter looks at
_MANY = 256  # samples in a stretch, from which its lower half of frequencies is that of one of four times the length
_NEIGHBOUR = 1.0 / 36.0  # squared correlation of the transforms of half overlapping stretches under a Hann window


@dataclass(frozen=True)
class Density:
    """One-sided power spectral density.

    Attributes
    ----------
    interval : float, s
        Of the samples.
    samples : int
        How many were taken in.
    frequency : ndarray, shape (m,), Hz
        Ascending, below half the rate of the samples.
    density : ndarray, shape (m, axes)
        Unit of the samples squared per Hz.
    resolution : ndarray, shape (m,), Hz
        Distance of the bins of the transform that a frequency was taken from.
    averages : ndarray of int, shape (m,)
        Stretches that were averaged.
    freedom : ndarray, shape (m,)
        Equivalent degrees of freedom of the chi-square distribution that the density has.
    """

    interval: float
    samples: int
    frequency: Array
    density: Array
    resolution: Array
    averages: NDArray[np.int64]
    freedom: Array

    def intervals(self, level: float = 0.95) -> tuple[Array, Array]:
        """Confidence interval of the density at each frequency.

        Parameters
        ----------
        level : float
            Probability that an interval contains the truth.

        Returns
        -------
        lower, upper : ndarray, shape (m, axes)
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"Level {level:g}: an interval's probability lies between 0 and 1.")
        from scipy.special import chdtri

        side, freedom = 0.5 * (1.0 - level), self.freedom[:, None]
        return freedom * self.density / chdtri(freedom, side), freedom * self.density / chdtri(freedom, 1.0 - side)


@dataclass
class _Level:
    """Samples of one axis at one rate, and the power of their stretches."""

    power: Array
    averages: int = 0
    pieces: list[Array] = field(default_factory=list)
    waiting: Array = field(default_factory=lambda: np.empty(0))
    tail: Array = field(default_factory=lambda: np.empty(0))
    taken: int = 0
    made: int = 0

    def piece(self, values: Array, *, last: bool) -> Array | None:
        """These samples and those held back, None while they are few and more will come."""
        self.pieces.append(values)
        if not last and sum(p.size for p in self.pieces) < _PIECE:
            return None
        piece, self.pieces = np.concatenate(self.pieces), []
        return piece

    def transform(self, values: Array, length: int, removed: str) -> None:
        """Add the power of the stretches that these samples complete."""
        from ...kernels.stretches import add_power, window_stretches

        x = np.concatenate([self.waiting, values])
        hop = length // 2
        count = max((x.size - length) // hop + 1, 0)
        for first in range(0, count, _ROWS):
            stretches = np.empty((min(_ROWS, count - first), length))
            window_stretches(x[first * hop :], hop, _window(length), removed == "trend", stretches)
            add_power(np.fft.rfft(stretches, axis=1).view(np.float64), self.power)
        self.averages += count
        self.waiting = x[count * hop :].copy()

    def quarter(self, values: Array, *, last: bool) -> Array:
        """Every fourth of the filtered samples; those beyond the ends of the record are taken to be as its ends are."""
        from ...kernels.stretches import filter_quarter

        if not self.taken:
            self.tail = np.full(_MARGIN, values[0]) if values.size else self.tail
        self.taken += values.size
        x = np.concatenate([self.tail, values])
        if last and x.size:
            x = np.concatenate([x, np.full(_MARGIN, x[-1])])
        most = self.taken // _GROWTH - self.made
        out = np.empty(max(min((x.size - 2 * _MARGIN - 1) // _GROWTH + 1, most), 0))
        filter_quarter(x, _taps(), out)
        self.made += out.size
        self.tail = x[_GROWTH * out.size :].copy()
        return out

    def part(self) -> None:
        """Begin anew, what was added up stays."""
        self.pieces, self.waiting, self.tail, self.taken, self.made = [], np.empty(0), np.empty(0), 0, 0


class _Chain:
    """One axis at all rates."""

    def __init__(self, length: int, levels: int, removed: str) -> None:
        self._length, self._removed = length, removed
        self.levels = [_Level(np.zeros(length // 2 + 1)) for _ in range(levels)]
        self._held, self._filled = np.empty(_BLOCK), 0

    def add(self, values: Array, reference: float) -> None:
        """Take in samples, less the reference."""
        at = 0
        while at < values.size:
            size = min(values.size - at, _BLOCK - self._filled)
            np.subtract(values[at : at + size], reference, out=self._held[self._filled : self._filled + size])
            self._filled += size
            at += size
            if self._filled == _BLOCK:
                self._pass(last=False)

    def finish(self) -> None:
        """Pass on what is held; what comes next does not follow it."""
        self._pass(last=True)
        for level in self.levels:
            level.part()

    def _pass(self, *, last: bool) -> None:
        values, self._filled = self._held[: self._filled], 0
        for i, level in enumerate(self.levels):
            piece = values if i == 0 else level.piece(values, last=last)
            if piece is None:
                return
            level.transform(piece, self._length, self._removed)
            if i + 1 < len(self.levels):
                values = level.quarter(piece, last=last)


class SpectrumPass:
    """Power spectral density of a record that comes batch by batch.

    Memory is less than 1 MB an axis, whatever the length of the record, and the result does not depend on how the record is
    parted.

    Parameters
    ----------
    interval : float, s
        Of the samples.
    axes : int
    shortest, longest : int
        Samples in the shortest and at most in the longest stretch; where there are several lengths, 256 at least.
    removed : str
        One of :data:`REMOVED`, out of every stretch.

    Raises
    ------
    InputError
        An argument that cannot be.
    """

    def __init__(
        self, interval: float, axes: int, *, shortest: int = 256, longest: int = 1 << 18, removed: str = "mean"
    ) -> None:
        check_interval(interval)
        if axes < 1 or shortest < 2 * _LOWEST or shortest % 2 or longest < shortest:
            raise InputError(
                f"Spectrum of {axes} axes from stretches of {shortest} to {longest} samples: there is none."
            )
        if removed not in REMOVED:
            raise InputError(f"Out of each stretch goes {' or '.join(REMOVED)}, not {removed!r}.")
        levels = 1
        while shortest * _GROWTH**levels <= longest:
            levels += 1
        if levels > 1 and shortest < _MANY:
            raise InputError(f"Stretches of several lengths have {_MANY} samples or more, not {shortest}.")
        self.interval, self.samples = float(interval), 0
        self._length = shortest
        self._chains = [_Chain(shortest, levels, removed) for _ in range(axes)]
        self._reference = np.zeros(axes)

    def add(self, values: ArrayLike) -> None:
        """Take in the next samples.

        Parameters
        ----------
        values : array_like, shape (n,) or (n, axes)

        Raises
        ------
        DataError
            Samples that are no numbers; none of the batch is taken in.
        InputError
            Another number of axes.
        """
        y = table(values, axes=len(self._reference))
        check_finite(y, self.samples)
        if self.samples == 0 and len(y):
            self._reference = y[0].astype(float)
        self.samples += len(y)
        each_axis(lambda k: self._chains[k].add(y[:, k], self._reference[k]), len(self._chains), y.size)

    def gap(self) -> None:
        """End a stretch of the record: what is added next does not follow what was added before."""
        for chain in self._chains:
            chain.finish()

    def result(self) -> Density:
        """The density of all that was added; more may be added after.

        Raises
        ------
        DataError
            Less samples than the shortest stretch has.
        """
        chains = deepcopy(self._chains)
        for chain in chains:
            chain.finish()
        used = [i for i, each in enumerate(chains[0].levels) if each.averages >= (_LEAST if i else 1)]
        if not used:
            raise DataError(
                f"{self.samples} samples are too few for a spectrum: it takes {self._length} in a row, without gaps."
            )
        parts = [self._part(chains, i, longest=i == used[-1]) for i in reversed(used)]
        frequency, density, resolution, averages, freedom = (
            np.concatenate(columns) for columns in zip(*parts, strict=True)
        )
        return Density(self.interval, self.samples, frequency, density, resolution, averages, freedom)

    def _part(
        self, chains: list[_Chain], i: int, *, longest: bool
    ) -> tuple[Array, Array, Array, NDArray[np.int64], Array]:
        """Columns of the frequencies that are taken from stretches of one length."""
        end = self._length // 2  # half the rate of the samples, which has one side only, is left out
        bins = np.arange(_LOWEST if longest else _RESOLVED, min(_GROWTH * _RESOLVED, end) if i else end)
        interval = self.interval * _GROWTH**i
        step = 1.0 / (self._length * interval)
        k = chains[0].levels[i].averages
        power = np.stack([chain.levels[i].power[bins] for chain in chains], axis=1)
        density = 2.0 * interval * power / (k * _energy(self._length) * _passed(bins / self._length, i)[:, None])
        freedom = 2.0 * k / (1.0 + 2.0 * (1.0 - 1.0 / k) * _NEIGHBOUR)
        resolution, averages, degrees = np.full(bins.size, step), np.full(bins.size, k), np.full(bins.size, freedom)
        return np.asarray(step * bins, dtype=float), density, resolution, averages, degrees


@lru_cache(maxsize=8)
def _window(length: int) -> Array:
    window = np.hanning(length + 1)[:-1]
    window.flags.writeable = False
    return window


def _energy(length: int) -> float:
    window = _window(length)
    return float(window @ window)


@lru_cache(maxsize=1)
def _taps() -> Array:
    """The filter before every fourth sample is taken, its sum 1."""
    taps = np.ones(1)
    for _ in range(_SMOOTH):
        taps = np.convolve(taps, np.full(_GROWTH, 1.0 / _GROWTH))
    taps.flags.writeable = False
    return taps


def _passed(frequency: Array, level: int) -> Array:
    """Share of the power at a frequency, a multiple of the rate of a level, that the filters before it have left."""
    share = np.ones(frequency.size)
    for i in range(1, level + 1):
        angle = np.pi * frequency / _GROWTH**i
        share *= (np.sin(_GROWTH * angle) / (_GROWTH * np.sin(angle))) ** (2 * _SMOOTH)
    return share


def spectrum(values: ArrayLike, interval: float, *, removed: str = "mean") -> Density:
    """Power spectral density of an array of samples, see :class:`SpectrumPass`.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, axes)
        Samples without gaps.
    interval : float, s
        Of the samples.
    removed : str
        One of :data:`REMOVED`, out of every stretch.

    Raises
    ------
    DataError, InputError
        See :class:`SpectrumPass`.
    """
    y = np.asarray(values)
    running = SpectrumPass(interval, 1 if y.ndim == 1 else y.shape[-1], removed=removed)
    running.add(y)
    return running.result()
