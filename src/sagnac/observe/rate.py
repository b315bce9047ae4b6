"""The rate of a periodic signal from its samples: nonlinear least squares over all axes and harmonics together.

A first pass keeps sums of a few turns each, at the rate that is roughly known. Sums of the harmonic h go round at h times the
error of the rate from one to the next: the error is where the spectra of these sums have most power together (capture),
sharpened by Newton's method. Further passes at the rate found give the rest of the error to first order (refinement), until it
does not matter. This is the estimate of maximum likelihood (for one harmonic: IEEE Std 1057, four-parameter sine fit).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import DataError
from ..frames import Array
from .harmonic_sums import Complex, HarmonicSums, Turn, inverted

CAPTURE = 0.02
"""Relative error of the rate at the start that is made good."""
_PASSES = 6  # refinements; two do, as each squares the error
_BEYOND = 3  # points of the spectra beyond the capture range: a maximum at their end is none
_ENOUGH = 1e-6  # rad that the highest harmonic is off at the ends of the segment
_IMMATERIAL = 0.05  # of the standard uncertainty
_WEAK = 0.5  # rad over the segment: an uncertainty of the rate with which the angle is lost
_CHANCE = 1e-6  # probability of noise alone to show as much, at any rate within the capture range
_FLOOR = 1e-28  # least residual variance, in units of the signal's


@dataclass(frozen=True)
class Rate:
    """A rate and its standard uncertainty, rad/s."""

    rate: float
    sigma: float


def estimate(
    fill: Callable[[Sequence[HarmonicSums]], None],
    turns: Sequence[Turn],
    names: Sequence[str],
    axes: int,
    order: int,
    *,
    capture: float = CAPTURE,
) -> list[Rate]:
    """Rates of some segments.

    Parameters
    ----------
    fill : callable
        Goes through the samples once and adds those of each segment to its sums.
    turns : sequence of Turn
        With the rates to start from, none zero.
    names : sequence of str
        For messages.
    axes, order : int
        See :class:`HarmonicSums`.
    capture : float
        Relative error of the rates to start from.

    Returns
    -------
    list of Rate
        The uncertainty is that of white noise of the residuals' size.

    Raises
    ------
    DataError
        When a segment shows no periodic signal at a rate within the capture range.
    """
    if not turns:
        return []
    coarse = [HarmonicSums(t, axes, order, cells=_cells(t, order, capture), compare=False) for t in turns]
    fill(coarse)
    turns = [replace(t, rate=t.rate + _captured(s, n, capture)) for t, s, n in zip(turns, coarse, names, strict=True)]
    for _ in range(_PASSES):
        fine = [HarmonicSums(t, axes, order, extended=True) for t in turns]
        fill(fine)
        steps = [_refined(s) for s in fine]
        for (step, _), name in zip(steps, names, strict=True):
            if math.isnan(step):
                raise DataError(
                    f"{name}: no rate can be found in the samples: too short a part of a turn, or no signal at all"
                )
        turns = [replace(t, rate=t.rate + step) for t, (step, _) in zip(turns, steps, strict=True)]
        if all(_settled(t, order, *step) for t, step in zip(turns, steps, strict=True)):
            break
    else:
        raise DataError("the rate does not settle: the signal is not periodic at a constant rate")
    for turn, sums, (_, sigma), name in zip(turns, fine, steps, names, strict=True):
        if not (sigma * (turn.stop - turn.start) < _WEAK and _by_chance(sums, capture) < _CHANCE):
            raise DataError(
                f"{name}: the samples do not show the rate: no harmonic stands out of the noise; give the rate"
            )
    return [Rate(t.rate, sigma) for t, (_, sigma) in zip(turns, steps, strict=True)]


def _cells(turn: Turn, order: int, capture: float) -> int:
    """So many that the highest harmonic drifts by a quarter of its turn in each, at the end of the capture range."""
    around = abs(turn.rate) * (turn.stop - turn.start) / (2.0 * math.pi)
    return max(1, math.ceil(4.0 * order * capture * around))


def _settled(turn: Turn, order: int, step: float, sigma: float) -> bool:
    """Whether what a step left, second order in itself, is immaterial."""
    half = 0.5 * order * (turn.stop - turn.start)
    left = (step * half) ** 2
    return left < max(_ENOUGH, _IMMATERIAL * sigma * half)


def _captured(sums: HarmonicSums, name: str, capture: float) -> float:
    """Error of the rate from the spectra of the cells."""
    spectra = _around(sums)
    harmonic = np.arange(1, sums.order + 1)
    if sums.cells < 4:
        return 0.0  # a few turns: the refinement reaches as far
    period = (sums.turn.stop - sums.turn.start) / sums.cells
    length = 1 << math.ceil(math.log2(2 * sums.order * sums.cells))
    step = 2.0 * math.pi / (length * period)
    reach = math.floor(capture * abs(sums.turn.rate) / step) + _BEYOND
    at = np.arange(-reach, reach + 1)
    power = np.abs(np.fft.fft(spectra, length, axis=0)) ** 2
    together = sum(power[(h * at) % length, :, h - 1].sum(axis=1) for h in harmonic)
    best = int(np.argmax(together))
    if best in (0, at.size - 1):
        raise DataError(
            f"{name}: no periodic signal within {100 * capture:g} % of the rate given ({sums.turn.rate:.6g} rad/s): check the "
            "rate, and the sample times"
        )
    times = sums.time_sums / np.maximum(sums.moments[:, 0, 0].real, 1.0)
    return _sharpened(spectra, times, float(at[best] * step), step)


def _around(sums: HarmonicSums) -> Complex:
    """Sums of each cell against the harmonics, the mean taken out, shape (cells, axes, order), axes of equal power."""
    count = max(sums.count, 1)
    mean = sums.sums[:, :, 0].sum(axis=0) / count
    variance = sums.squares / count - mean**2
    pairs = sums.sums[:, :, 1 : sums.plain]
    waves = pairs[:, :, 0::2] - 1j * pairs[:, :, 1::2]
    waves = waves - mean[:, None] * sums.moments[:, 0, None, 1 : sums.order + 1].conj()
    alive = variance > 0
    return np.asarray(waves * np.where(alive, 1.0 / np.sqrt(np.where(alive, variance, 1.0)), 0.0)[:, None])


def _sharpened(spectra: Complex, times: Array, start: float, step: float) -> float:
    """The maximum of the power near `start`, by Newton's method."""
    slope = -1j * np.arange(1, spectra.shape[2] + 1) * times[:, None, None]
    found = start
    for _ in range(8):
        turned = spectra * np.exp(slope * found)
        value, first, second = (np.sum(turned * slope**p, axis=0) for p in range(3))
        gradient = 2.0 * np.sum((value.conj() * first).real)
        curvature = 2.0 * np.sum(np.abs(first) ** 2 + (value.conj() * second).real)
        if not curvature < 0:
            return start
        found -= gradient / curvature
        if abs(found - start) > step:
            return start
    return float(found)


def _by_chance(sums: HarmonicSums, capture: float) -> float:
    """Probability of white noise to have harmonics of such size at the best of all rates within the capture range."""
    from scipy.special import chdtrc

    inverse, _ = inverted(sums.rest()[0][: sums.plain, : sums.plain])
    waves, noise = sums.reference[:, 1:], np.maximum(sums.fit().noise, 1e-300)
    told = float(np.sum((waves @ np.linalg.inv(inverse[1:, 1:]) * waves).sum(axis=1) / noise))
    around = abs(sums.turn.rate) * (sums.turn.stop - sums.turn.start) / (2.0 * math.pi)
    return float(chdtrc(waves.size, told)) * max(1.0, 4.0 * sums.order * capture * around)


def _refined(sums: HarmonicSums) -> tuple[float, float]:
    """Error of the rate to first order, and its standard uncertainty, from sums with the terms in tau.

    The signal at the rate w + dw is ``B c + dw tau B' c``, B' the derivative of the terms to th: a linear fit in c for each
    axis and in dw for all of them, from which c is eliminated.
    """
    fit = sums.fit()
    products, rest = sums.rest()
    c = sums.plain
    inverse, condition = inverted(products[:c, :c])
    if not (np.isfinite(condition) and np.isfinite(fit.condition)):
        return math.nan, math.nan
    cross = products[:c, c:]
    own = products[c:, c:] - cross.T @ inverse @ cross
    plain = rest[:, :c] @ inverse
    other = rest[:, c:] - plain @ cross
    still = sums.reference[:, 1:] + plain[:, 1:]
    harmonic = np.repeat(np.arange(1, sums.order + 1), 2)
    variance = np.maximum(fit.noise, _FLOOR * (still**2).sum(axis=1) + 1e-300)
    step, sigma, signal = 0.0, math.inf, still
    for _ in range(3):  # the terms in tau go with the harmonics themselves, which move a little with the step
        swapped = (signal * harmonic).reshape(len(signal), -1, 2)[:, :, ::-1] * np.array([1.0, -1.0])
        derivative = swapped.reshape(len(signal), -1)
        information = float(np.einsum("ai,ij,aj,a->", derivative, own, derivative, 1.0 / variance))
        if not information > 0:
            return math.nan, math.nan
        step = float(np.sum(derivative * other / variance[:, None])) / information
        sigma = 1.0 / math.sqrt(information)
        signal = still - step * (derivative @ cross.T @ inverse)[:, 1:]
    return step, sigma
