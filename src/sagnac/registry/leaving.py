"""When a drifting, wandering level leaves its limits for the first time: its distribution over what is not known.

Given drift b, random walk q and a distance d to a limit, the first passage is at d / b without a walk. With one it has an
inverse Gaussian distribution of mean d / abs(b) and shape d² / q, and happens at all with probability one or, where b leads away
from the limit, exp(-2 abs(b) d / q) (Cox and Miller 1965, section 5.7).

Between two limits a level that wanders must not meet the other one first. Its path is followed by leaps: from where it is to one
of the ends of the interval about it that reaches to the nearer limit, and so on until a limit is met. The end is the upper one
with probability 1 / (1 + exp(-2 b r / q)), r half the interval, and the time does not depend on which; its density is that
without a drift times cosh(b r / q) exp(-b² t / 2q) (Girsanov), which is kept as a table. Nothing is approximated but by that
table.

What is known of b, q and the level is a mixture (:class:`sagnac.registry.drift.Posterior`), from which the same draws are taken
for every history.

References
----------
D. R. Cox, H. D. Miller, The Theory of Stochastic Processes, Methuen 1965.
J. R. Michael, W. R. Schucany, R. W. Haas, Generating random variates using transformations with multiple roots, The American
Statistician 30 (1976) 88-90.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..frames import Array
from .drift import Posterior, in_threads
from .probability import normal_below

_DRAWS = 4000
"""The 2.5 % quantile of so many lies where the probability is 2.5 % within 0.25 %."""
_SEED = 1913
_STRAIGHT = 6.0
"""Drift over half an interval, in q, from which its other end is met with a probability below 1e-5 only."""
_DRIFTS = np.linspace(0.0, _STRAIGHT, 49)
_NORMALS = np.linspace(-5.0, 5.0, 201)
"""Where the table of times is made: drifts, and quantiles as those of a standard normal number."""
_PIECE = 32
"""Histories that one thread takes: to take turns over single ones costs more than it spares."""
LEVELS = (0.025, 0.5, 0.975)
"""Of the quantiles that are given."""
_RANKS = [round(level * _DRAWS) - 1 for level in LEVELS]


@dataclass(frozen=True)
class Passage:
    """When limits are left, counted from the last calibration.

    Attributes
    ----------
    outside : ndarray, shape (s,)
        Probability of being outside already.
    within : ndarray, shape (3, s)
        Quantiles at :data:`LEVELS` of the time until then, s; infinite where it is farther than anyone asked.
    upper : ndarray of bool, shape (s,)
        Whether the upper limit is the likelier one to be left.
    """

    outside: Array
    within: Array
    upper: NDArray[np.bool_]


def passage(posterior: Posterior, lower: Array, upper: Array, horizon: float) -> Passage:
    """First passage of each history through its limits.

    Parameters
    ----------
    posterior : Posterior
        Of s histories.
    lower, upper : ndarray, shape (s,)
        In the unit of the values, infinite where there is none.
    horizon : float
        Farthest time of interest, s.

    Returns
    -------
    Passage
    """
    rng = np.random.default_rng(_SEED)
    normal, uniform = rng.standard_normal((4, _DRAWS)), rng.random((4, _DRAWS))
    outside, within = np.zeros(len(lower)), np.full((len(LEVELS), len(lower)), np.inf)
    side = np.ones(len(lower), dtype=bool)

    def each(piece: list[int]) -> None:
        for s in piece:
            first, up = _met(posterior, s, (float(lower[s]), float(upper[s])), normal, uniform)
            outside[s] = np.mean(first == 0)
            within[:, s] = np.partition(first, _RANKS)[_RANKS]
            soon = first <= horizon
            side[s] = 2 * np.count_nonzero(up[soon]) >= np.count_nonzero(soon) if soon.any() else up.mean() >= 0.5

    limited = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper)).tolist()
    in_threads(each, [limited[i : i + _PIECE] for i in range(0, len(limited), _PIECE)])
    return Passage(outside, np.where(within > horizon, np.inf, within), side)


def _met(
    posterior: Posterior, s: int, limits: tuple[float, float], normal: Array, uniform: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """When a limit of one history is met, and whether it is the upper one, over draws of what is not known of it."""
    place = (np.arange(_DRAWS) + 0.5) / _DRAWS
    one = np.searchsorted(np.cumsum(posterior.weight[s]), place).clip(max=posterior.weight.shape[1] - 1)
    drift = posterior.drift[s, one] + posterior.drift_sigma[s, one] * normal[0]
    level = posterior.level[s, one] + drift * posterior.lever[s, one]
    level += np.sqrt(posterior.variance[s, one]) * normal[1]
    walk = posterior.walk[s, one]
    above, below = limits[1] - level, level - limits[0]
    first, upper = np.empty(_DRAWS), np.empty(_DRAWS, dtype=bool)
    both = np.isfinite(above) & np.isfinite(below) & (above > 0) & (below > 0) & (walk > 0)
    if both.any():
        first[both], upper[both] = _between(above[both], below[both], drift[both], walk[both])
    if not both.all():
        one = ~both
        up = _first(above[one], drift[one], walk[one], normal[2, one], uniform[:2, one])
        down = _first(below[one], -drift[one], walk[one], normal[3, one], uniform[2:, one])
        first[one], upper[one] = np.minimum(up, down), (up < down) | ((up == down) & (above[one] < below[one]))
    return first, upper


def _between(above: Array, below: Array, drift: Array, walk: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Times at which the first of two limits is met, and whether it is the upper one.

    Parameters
    ----------
    above, below : ndarray, shape (m,)
        Distances to the limits, both larger than nothing.
    drift, walk : ndarray, shape (m,)
        The walk larger than nothing.
    """
    rng = np.random.default_rng(_SEED)
    above, below, time = above.copy(), below.copy(), np.zeros(above.size)
    upper, left = np.zeros(above.size, dtype=bool), np.arange(above.size)
    while left.size:
        reach = np.minimum(above[left], below[left])
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            lean = drift[left] * reach / walk[left]
            rises = rng.random(left.size) * (1.0 + np.exp(-2.0 * lean)) < 1.0
            time[left] += reach**2 / walk[left] * _leap(np.abs(lean), rng)
        upper[left] = rises
        met = np.where(rises, above[left] <= below[left], below[left] <= above[left])
        move = np.where(rises, reach, -reach)
        above[left] -= move
        below[left] += move
        left = left[~met]
    return time, upper


def _leap(lean: Array, rng: np.random.Generator) -> Array:
    """Times in which a Wiener process of variance one a unit of time and of these drifts leaves (-1, 1)."""
    normal, uniform = rng.standard_normal(lean.size), rng.random((2, lean.size))
    table = _times()
    i = (lean / (_DRIFTS[1] - _DRIFTS[0])).clip(max=_DRIFTS.size - 1.001)
    k = ((normal - _NORMALS[0]) / (_NORMALS[1] - _NORMALS[0])).clip(0, _NORMALS.size - 1.001)
    row, column = i.astype(np.int64), k.astype(np.int64)
    i, k = i - row, k - column
    low, high = (table[r, column] * (1 - k) + table[r, column + 1] * k for r in (row, row + 1))
    time = np.exp(low * (1 - i) + high * i)
    if (straight := np.flatnonzero(lean >= _STRAIGHT)).size:
        one = np.ones(straight.size)
        time[straight] = _first(one, lean[straight], one, normal[straight], uniform[:, straight])
    return np.asarray(time)


@cache
def _times() -> Array:
    """Logarithms of the quantiles of the time to leave (-1, 1) at :data:`_NORMALS`, a row for each of :data:`_DRIFTS`.

    The density without a drift is a series of images, for short times, and one of eigenfunctions, for long ones (Cox and Miller
    1965, section 5.7).
    """
    log = np.linspace(np.log(0.008), np.log(60.0), 3000)
    t, k = np.exp(log), np.arange(8)[:, None]
    odd, sign = 2 * k + 1, (-1.0) ** k
    with np.errstate(under="ignore"):
        short = 2 * (sign * odd * np.exp(-(odd**2) / (2 * t))).sum(axis=0) / np.sqrt(2 * np.pi * t**3)
        long = np.pi / 2 * (sign * odd * np.exp(-(odd**2) * np.pi**2 * t / 8)).sum(axis=0)
        density = np.where(t < 0.5, short, long) * t * np.exp(-0.5 * np.outer(_DRIFTS**2, t))
    below = np.cumsum((density[:, 1:] + density[:, :-1]) / 2, axis=1)
    below = np.concatenate([np.zeros((len(below), 1)), below], axis=1) / below[:, -1:]
    above = np.cumsum(((density[:, 1:] + density[:, :-1]) / 2)[:, ::-1], axis=1)[:, ::-1]
    above = np.concatenate([above / above[:, :1], np.zeros((len(above), 1))], axis=1)
    share, _ = normal_below(_NORMALS)
    late = _NORMALS > 0  # by what is still to come, whose digits the sum from the begin has lost
    rest = share[::-1][late]
    return np.array(
        [
            np.concatenate([np.interp(share[~late], b, log), np.interp(-rest, -a, log)])
            for b, a in zip(below, above, strict=True)
        ]
    )


def _first(distance: Array, speed: Array, walk: Array, normal: Array, uniform: Array) -> Array:
    """Times of first passage over distances, towards which the speeds lead; zero where it lies behind.

    Parameters
    ----------
    distance, speed, walk : ndarray, shape (m,)
    normal : ndarray, shape (m,)
    uniform : ndarray, shape (2, m)

    Returns
    -------
    ndarray, shape (m,)
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        straight = np.where(speed > 0, distance / speed, np.inf)
        mean = distance / np.abs(speed)
        w = 0.5 * mean * walk / distance**2 * normal**2
        root = mean / (1.0 + w + np.sqrt(w * (w + 2.0)))  # the smaller of two roots of Michael, Schucany and Haas
        root = np.where(np.isfinite(w), root, distance**2 / (walk * normal**2))
        wandering = np.where(uniform[0] * (mean + root) <= mean, root, mean * (mean / root))
        arrives = (speed > 0) | (uniform[1] < np.exp(2.0 * speed * distance / walk))
        time = np.where(walk > 0, np.where(arrives, wandering, np.inf), straight)
    time = np.where(np.isinf(distance), np.inf, time)
    return np.asarray(np.where(distance <= 0, 0.0, time))
