"""Spectrum of residuals in one streaming pass, and its lines with their names.

Overlapping stretches under a Hann window, averaged (Welch 1967). A line is what stands out of the floor around it; it is named
after the known frequency that it lies at.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..frames import Array

LOUD = 2.5
"""Amplitude over that of the floor around it from which a bin is a line: noise averaged as here hardly ever gets there."""
_LOBE = 2  # bins at each side that a line spreads over under a Hann window
_AROUND = 32  # bins at each side that the floor is judged by
_STRETCHES = 4
_LONGEST = 1 << 18  # samples in a stretch: what a longer recording adds goes into the average


@dataclass(frozen=True)
class Spectrum:
    """One-sided power spectral density of k channels.

    Attributes
    ----------
    frequency : ndarray, shape (m,), Hz
    density : ndarray, shape (m, k)
        Unit of the values squared per Hz.
    mean : ndarray, shape (k,)
        Mean of the values, which the density does not contain.
    floor : ndarray, shape (m, k)
        Density around each bin without its lines (moving median).
    averages : int
        Stretches that were averaged.
    """

    frequency: Array
    density: Array
    mean: Array
    floor: Array
    averages: int

    @property
    def resolution(self) -> float:
        """Distance of bins, Hz."""
        return float(self.frequency[1] - self.frequency[0])


@dataclass(frozen=True)
class Line:
    """A line of a spectrum.

    Attributes
    ----------
    name : str
        Of the known frequency that it lies at; empty when it lies at none.
    frequency : float, Hz
    amplitude : float
        Of the sinusoid, in the unit of the values; at zero frequency their mean.
    loudness : float
        Its highest bin over the floor there, as a ratio of amplitudes; infinite at zero frequency.
    """

    name: str
    frequency: float
    amplitude: float
    loudness: float


@dataclass
class SpectrumSums:
    """Running sums; add values piece by piece, then ask for the result.

    Attributes
    ----------
    interval : float, s
        Of the samples.
    length : int
        Samples in a stretch, which sets the resolution: ``1 / (length * interval)``.
    """

    interval: float
    length: int
    _held: list[Array] = field(default_factory=list)
    _power: Array = field(default_factory=lambda: np.zeros(0))
    _total: Array = field(default_factory=lambda: np.zeros(0))
    _count: int = 0
    _averages: int = 0

    @classmethod
    def fitting(cls, count: int, interval: float) -> SpectrumSums:
        """Stretches of a quarter of `count` samples, so that some can be averaged."""
        return cls(interval, max(16, min(count // _STRETCHES, _LONGEST) // 2 * 2))

    def add(self, values: Array) -> None:
        """Take in the next samples, shape (n, k)."""
        if self._count == 0:
            self._total = np.zeros(values.shape[1])
            self._power = np.zeros((self.length // 2 + 1, values.shape[1]))
        self._total, self._count = self._total + values.sum(axis=0), self._count + len(values)
        self._held.append(values)
        if sum(map(len, self._held)) < self.length:
            return
        held = np.concatenate(self._held)
        window, hop = np.hanning(self.length + 1)[:-1, None], self.length // 2
        while len(held) >= self.length:
            stretch = held[: self.length]
            self._power += np.abs(np.fft.rfft(window * (stretch - stretch.mean(axis=0)), axis=0)) ** 2
            self._averages += 1
            held = held[hop:]
        self._held = [held.copy()]

    def result(self) -> Spectrum | None:
        """The spectrum of all that was added; None when it was less than one stretch."""
        if not self._averages:
            return None
        from scipy.ndimage import median_filter

        energy = float((np.hanning(self.length + 1) ** 2).sum())
        density = 2.0 * self.interval / energy * self._power / self._averages
        density[0] /= 2.0
        # the median of a chi-square of 2 degrees of freedom per stretch over its mean (Wilson & Hilferty)
        freedom = 2.0 * max(1.0, 0.6 * self._averages)
        floor = median_filter(density, size=(2 * _AROUND + 1, 1), mode="nearest") / (1.0 - 2.0 / (9.0 * freedom)) ** 3
        frequency = np.fft.rfftfreq(self.length, self.interval)
        return Spectrum(np.asarray(frequency, dtype=float), density, self._total / self._count, floor, self._averages)


def folded(frequency: float, interval: float) -> float:
    """Where a frequency shows in samples taken every `interval` seconds, Hz."""
    rate = 1.0 / interval
    return abs(frequency - rate * round(frequency / rate))


def find_lines(spectrum: Spectrum, channel: int, known: Mapping[str, float], loud: float = LOUD) -> tuple[Line, ...]:
    """Lines of one channel in order of frequency, the mean first.

    Parameters
    ----------
    spectrum : Spectrum
    channel : int
    known : mapping of str to float
        Names and their frequencies, Hz, folded already. The name of frequency zero is that of the mean.
    loud : float
        See :data:`LOUD`.
    """
    density, floor = spectrum.density[:, channel], spectrum.floor[:, channel]
    mean_name = next((n for n, f in known.items() if f == 0), "")
    out = [Line(mean_name, 0.0, float(spectrum.mean[channel]), math.inf)]
    left = density > loud**2 * np.maximum(floor, 1e-300)
    left[: _LOBE + 1] = False  # what leaks from zero
    while left.any():
        peak = int(np.argmax(np.where(left, density, 0.0)))
        lobe = slice(max(peak - _LOBE, 0), peak + _LOBE + 1)
        extra = float(np.maximum(density[lobe] - floor[lobe], 0.0).sum()) * spectrum.resolution
        at = float(spectrum.frequency[lobe] @ density[lobe] / density[lobe].sum())
        amplitude = math.sqrt(2.0 * extra)
        loudness = math.sqrt(float(density[peak]) / max(float(floor[peak]), 1e-300))
        out.append(Line(_name(at, known, spectrum.resolution), at, amplitude, loudness))
        left[max(peak - 2 * _LOBE, 0) : peak + 2 * _LOBE + 1] = False
    return tuple(sorted(out, key=lambda line: line.frequency))


def _name(frequency: float, known: Mapping[str, float], resolution: float) -> str:
    near = [(abs(frequency - f), name) for name, f in known.items() if f > 0]
    distance, name = min(near, default=(math.inf, ""))
    return name if distance < 1.5 * resolution else ""
