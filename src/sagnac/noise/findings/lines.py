"""Periodic disturbances in a spectrum: lines of mains, fans or dither, and broad peaks of sway and vibration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from ..curves.allan import Variances
from ..curves.spectrum import Density
from .disturbances import Disturbance

_CHANCE = 1e-7  # that noise raises one frequency so far
_AROUND = 28  # frequencies on each side that the floor is taken from
_OWN = 3  # of these, next to a line, that belong to it
_FEWEST = 6  # on a side that tell a floor
_NARROW = 6  # frequencies that a line of no width covers at most
_SKIRT = 0.02  # of the peak, below which the window's own side lobes lie
_HARM = 0.3
_PEAK = 0.371  # of the period: averaging time at which the Allan deviation of a sine is largest
_MOST = 8


@dataclass(frozen=True)
class Line:
    """A line, or a broad peak.

    Attributes
    ----------
    frequency : float, Hz
        Its middle.
    low, high : float, Hz
        Its ends.
    amplitude : float
        Of a sine of the same power.
    ratio : float
        Of the density to that around, at the most.
    narrow : bool
        As narrow as the spectrum resolves.
    share : float
        Of the Allan variance where it disturbs most.
    """

    frequency: float
    low: float
    high: float
    amplitude: float
    ratio: float
    narrow: bool
    share: float

    def told(self, axis: str, unit: str, size: float) -> Disturbance:
        """In words, sizes in `unit`, which is `size` times the unit of the samples."""
        spoils = self.share > _HARM
        if self.narrow:
            text = f"{axis} has a line at {self.frequency:.4g} Hz of {self.amplitude * size:.3g} {unit} amplitude"
            remedy = (
                "; find what shakes or disturbs the unit at this rate (mains, fan, dither), or record on a still base"
            )
        else:
            rms = self.amplitude / math.sqrt(2.0) * size
            text = f"{axis} has a broad peak from {self.low:.3g} to {self.high:.3g} Hz of {rms:.3g} {unit} rms"
            remedy = "; sway or vibration: record on a still base"
        text += (
            f", {self.share:.0%} of its Allan variance at {_PEAK / self.frequency:.2g} s" if self.share > 0.01 else ""
        )
        return Disturbance(
            "line", axis, text + remedy * spoils, spoils=spoils, size=self.amplitude, frequency=self.frequency
        )


def lines_in(density: Density, expected: Array, variances: Variances) -> list[Line]:
    """Lines of the spectrum of one axis, the strongest first.

    Parameters
    ----------
    density : Density
        Of one axis.
    expected : ndarray, shape (m,)
        Density of the fitted noise at its frequencies: gives the slope, not the level.
    variances : Variances
        Allan or Hadamard variances of the axis.
    """
    ratio = density.density[:, 0] / expected
    floor = _floor(ratio, density.freedom)
    over = ratio / floor
    from scipy.special import chdtri

    most = np.array([chdtri(f, _CHANCE) / f for f in density.freedom])
    above = np.flatnonzero(over > most)
    if not above.size:
        return []
    # what stands out over the floor belongs to it as well
    sides = over > 1.0 + 3.0 * np.sqrt(2.0 / density.freedom)
    found = [_line(density, over, floor * expected, group, variances) for group in _groups(above, sides)]
    return sorted(found, key=lambda line: -line.share)[:_MOST]


def _floor(ratio: Array, freedom: Array) -> Array:
    """What the ratios are around each frequency: the mean, in logarithms, of the lower quartiles on both sides.

    Each ratio counts by its own over the lower quartile of its chi-square: a peak may be as broad as half a side. Infinite where
    too little lies below a frequency to tell.
    """
    from scipy.special import chdtri

    usual = ratio * freedom / chdtri(freedom, 0.75)
    out = np.full(ratio.size, np.inf)
    for i in range(_OWN + _FEWEST, ratio.size):
        below, above = usual[max(i - _AROUND, 0) : i - _OWN], usual[i + _OWN + 1 : i + _AROUND + 1]
        low = float(np.quantile(below, 0.25))
        out[i] = math.sqrt(low * float(np.quantile(above, 0.25))) if above.size >= _FEWEST else low
    return out


def _groups(above: NDArray[np.intp], sides: NDArray[np.bool_]) -> list[slice]:
    """Runs of frequencies that stand out, each with at least one that is `above`."""
    out: list[slice] = []
    for peak in above.tolist():
        if out and peak < out[-1].stop:
            continue
        first = last = peak
        while first > 0 and sides[first - 1]:
            first -= 1
        while last + 1 < sides.size and sides[last + 1]:
            last += 1
        out.append(slice(first, last + 1))
    return out


def _line(density: Density, over: Array, floor: Array, group: slice, variances: Variances) -> Line:
    excess = np.maximum(density.density[group, 0] - floor[group], 0.0)
    frequency = density.frequency[group]
    width = np.gradient(density.frequency)[group] if density.frequency.size > 1 else density.resolution[group]
    core = excess > _SKIRT * excess.max()
    excess, width, frequency = excess[core], width[core], frequency[core]
    power = float((excess * width).sum())
    middle = float((excess * width * frequency).sum() / power)
    share = _share(2.0 * power, middle, variances)
    narrow = frequency.size <= _NARROW
    return Line(
        middle,
        float(frequency[0]),
        float(frequency[-1]),
        math.sqrt(2.0 * power),
        float(over[group].max()),
        narrow,
        share,
    )


def _share(squared: float, frequency: float, variances: Variances) -> float:
    """Share of the Allan variance that a sine of this squared amplitude makes, where it is largest."""
    tau = variances.tau
    phase = math.pi * frequency * tau
    made = squared * np.sin(phase) ** 4 / phase**2
    near = np.abs(np.log(tau * frequency / _PEAK)) < 1.0
    near |= tau == tau[np.argmin(np.abs(np.log(tau * frequency / _PEAK)))]
    return float(np.clip((made / variances.variance[:, 0])[near].max(), 0.0, 1.0))
