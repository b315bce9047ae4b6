"""Steps and drifts of the mean of a log, found in the means of its blocks.

The noise that a step of the mean is held against is that of the log itself at the same averaging time, slow terms included: the
differences of neighbouring means of m blocks are stationary under white noise, flicker noise and a random walk alike, so that
none of them makes a step by growing slowly. What is a step is told from the largest of the differences over their robust spread.
Noise goes on while nothing is recorded: no difference is taken across a gap. What changes fast at first and slowly later is no
step but a drift, as of a unit that warms up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from .blocks import Blocks

FEWEST = 32
"""Blocks that anything is judged by."""
_MOST = 10
_BACK = 0.6  # share of a step that is taken back at once: a shock
_APART = 0.5  # of the length of a block, from which a gap parts the means


def between(blocks: Blocks, gaps: Sequence[tuple[float, float]]) -> tuple[slice, ...]:
    """Runs of blocks without a gap that is long against them; a block that holds such a gap is in none.

    Parameters
    ----------
    blocks : Blocks
    gaps : sequence of (float, float)
        Time of the last sample before each, and its length, s.
    """
    at = np.array([start for start, length in gaps if length > _APART * blocks.size * blocks.interval])
    before, after = np.searchsorted(at, blocks.start), np.searchsorted(at, blocks.stop)
    whole = np.flatnonzero(before == after)
    runs = np.split(whole, np.flatnonzero(np.diff(before[whole])) + 1)
    return tuple(slice(int(run[0]), int(run[-1]) + 1) for run in runs if run.size)


@dataclass(frozen=True)
class Step:
    """A step of the mean: the block that it comes before, its size and that over the spread, and whether it is taken back."""

    at: int
    size: float
    significance: float
    width: int
    back: bool


def limit_of(independent: float) -> float:
    """Largest difference of neighbouring means, over their robust spread, that noise gives with a probability below 1e-4.

    With the averaging times of one axis together below 1e-3, from simulation of white noise, flicker noise and random walks; with
    few independent means their spread is itself uncertain, which asks for more.

    Parameters
    ----------
    independent : float
        Number of means in the log.
    """
    return 5.7 + 25.0 / independent


def steps(mean: Array, grain: float = 0.0, parts: Sequence[slice] | None = None) -> list[Step]:
    """Steps of the mean in a series of block means.

    Parameters
    ----------
    mean : ndarray, shape (k,)
    grain : float
        Smallest difference that two means of quantised samples can have.
    parts : sequence of slice, optional
        Means that no gap parts; all of them, where it is left out.

    Returns
    -------
    list of Step
        The strongest first; at most ten.
    """
    out: list[Step] = []
    left = mean - np.median(mean)
    parts = (slice(0, mean.size),) if parts is None else parts
    while len(out) < _MOST:
        found = _strongest(left, grain, parts)
        if found is None:
            break
        out.append(found)
        left = left.copy()
        own = next(p for p in parts if p.start <= found.at < p.stop)
        if found.back:
            first, last = max(found.at - found.width, own.start), min(found.at + 2 * found.width, own.stop)
            around = np.concatenate(
                [left[max(first - found.width, own.start) : first], left[last : min(last + found.width, own.stop)]]
            )
            left[first:last] = np.median(around) if around.size else 0.0
        else:
            left[found.at : own.stop] -= found.size
    return out


def _all_differences(mean: Array, width: int, parts: Sequence[slice]) -> tuple[Array, NDArray[np.intp]]:
    """Differences within the parts, and the place that each comes before."""
    long = [p for p in parts if p.stop - p.start >= 2 * width]
    if not long:
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    at = [np.arange(p.start + width, p.stop - width + 1) for p in long]
    return np.concatenate([_differences(mean[p], width) for p in long]), np.concatenate(at)


def _differences(mean: Array, width: int) -> Array:
    """Mean of the next `width` less that of the last, at each place where there are so many on both sides."""
    total = np.concatenate([[0.0], np.cumsum(mean)])
    means = (total[width:] - total[:-width]) / width
    return np.asarray(means[width:] - means[:-width])


def _strongest(mean: Array, grain: float, parts: Sequence[slice]) -> Step | None:
    best: tuple[float, int, int, float] | None = None
    number = sum(p.stop - p.start for p in parts)
    width = 1
    while width * FEWEST <= number:
        d, _ = _all_differences(mean, width, parts)
        # parts that are short against the averaging time tell too little of its scatter
        if 2 * d.size < number:
            break
        d = d - np.median(d)
        # on a lattice the median may fall short of the scatter by as much as a step of it
        spread = 1.4826 * float(np.median(np.abs(d))) + grain / width
        if spread > 0:
            i = int(np.argmax(np.abs(d)))
            over = abs(float(d[i])) / spread / limit_of(d.size / width)
            if over > 1.0 and (best is None or over > best[0]):
                best = (over, width, i, float(d[i]) / spread)
        width *= 2
    if best is None:
        return None
    _, width, i, significance = best
    d, at = _all_differences(mean, width, parts)
    d = d - np.median(d)
    near = d[np.abs(at - at[i]) <= 2 * width]
    opposite = -np.sign(d[i]) * near
    back = float(opposite.max()) > _BACK * abs(float(d[i]))
    return Step(int(at[i]), float(d[i]), abs(significance), width, back)


def harm(step: Step, mean: Array, parts: Sequence[slice] | None = None) -> float:
    """Share of the Allan variance of block means that a step makes, at the averaging time where it is largest.

    A step adds to the mean of the squared differences of means of m blocks ``size^2 (2/3) m / k``: they rise to it and fall again
    over 2 m of k places.

    Parameters
    ----------
    step : Step
    mean : ndarray, shape (k,)
    parts : sequence of slice, optional
        Means that no gap parts.
    """
    worst, width = 0.0, 1
    parts = (slice(0, mean.size),) if parts is None else parts
    while 4 * width <= mean.size:
        d, _ = _all_differences(mean, width, parts)
        if not d.size:
            break
        total = float(np.mean(d**2))
        # a push that is shorter than the averaging time is averaged away, and makes a rise and a fall
        size = step.size * (min(1.0, step.width / width) if step.back else 1.0)
        if total > 0:
            worst = max(worst, (1 + step.back) * size**2 * (2.0 / 3.0) * width / d.size / total)
        width *= 2
    return min(worst, 1.0)


def drift_in(b: Blocks, mean: Array, found: Sequence[Step], parts: Sequence[slice]) -> tuple[float, float] | None:
    """Size and time constant of an exponential drift, where it describes the means better than the steps found in them do."""
    if not found:
        return None
    whole = np.concatenate([np.arange(p.start, p.stop) for p in parts])
    y, t = mean[whole] - mean[whole].mean(), b.mid[whole] - b.start[0]

    def rest(columns: Array) -> tuple[float, Array]:
        x = np.linalg.lstsq(columns, y, rcond=None)[0]
        return float(np.sum((y - columns @ x) ** 2)), x

    stepped, _ = rest(np.column_stack([np.ones_like(t), *((whole >= s.at).astype(float) for s in found)]))
    best = (np.inf, 0.0, 0.0)
    for tau in t[-1] * 2.0 ** np.arange(-6.0, 2.1, 0.25):
        left, x = rest(np.column_stack([np.ones_like(t), np.exp(-t / tau)]))
        best = min(best, (left, float(x[1]), float(tau)))
    # an exponential has two coefficients besides the mean, a step two (its place and size)
    return best[1:] if best[0] < stepped else None


def share_of(drift: tuple[float, float], b: Blocks, mean: Array, parts: Sequence[slice]) -> float:
    """Share of the Allan variance of the means that a drift makes, at the averaging time where it is largest."""
    size, tau = drift
    without = mean - size * np.exp(-(b.mid - b.start[0]) / tau)
    worst, width = 0.0, 1
    while 4 * width <= mean.size:
        whole, rest = (float(np.sum(_all_differences(x, width, parts)[0] ** 2)) for x in (mean, without))
        worst = max(worst, 1.0 - rest / whole) if whole > 0 else worst
        width *= 2
    return worst
