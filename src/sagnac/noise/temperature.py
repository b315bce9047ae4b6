"""Is the drift of a log explained by its temperature? Regression of its slow part on temperature and time, against slow noise.

The means y of some ninety stretches are modelled, axis by axis, as ::

    y = a + b t + c T + e,    cov(e) proportional to I + f F + w W,

with F the covariance of flicker noise (processes of equal variance with correlation times in geometric progression) and W that
of a random walk. Slow noise drifts with anything that drifts, so that an ordinary regression finds temperature effects where
there are none (Granger and Newbold 1974, Journal of Econometrics 2, 111). Here the weights f and w are not fixed: the restricted
likelihood (Patterson and Thompson 1971, Biometrika 58, 545) averages the coefficient over all of them.

One axis tells little of its weights. Those of a triad are of one make, and their weights much alike: each axis has weights of its
own that lie about common ones, as a prior says, and what all of them tell of the common ones is taken together (a hierarchical
model: Gelman et al., Bayesian Data Analysis, 3rd ed., chapter 5). Whether temperature acts is then asked of the triad: what
chance makes of its coefficients together at given common weights, averaged over these. A normal distribution of the averaged
coefficients would not do: where the weights are uncertain it has tails far too thin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..frames import Array
from .axis import shown_in
from .findings.blocks import Blocks
from .findings.disturbances import Disturbance
from .gather import Correction

_STRETCHES = 96
_FEWEST = 24
_LEAST = 0.05  # K
_WEIGHTS = (0.0, *(10.0**e for e in np.arange(-3.0, 2.6, 0.5)))
_ALIKE = (
    1.0  # steps of the weights, of half a decade: how far those of one axis lie from those common to its triad, and
)
_UNLIKE = 0.03  # share of axes whose weights may be any
_BY_CHANCE = 1e-4  # probability of effects on a triad that are none
_EXPLAINED = 0.2  # share of the drift of one axis at least, from which the effects on its triad are told
_CLEAR = 1e-3  # probability of the effect on an axis by chance, below which it is taken off
_COLLINEAR = 0.995  # correlation of temperature and time, from which they cannot be told apart


@dataclass(frozen=True)
class Effect:
    """What temperature does to one axis.

    Attributes
    ----------
    coefficient, standard_uncertainty : float
        Unit of the axis per K.
    change : float, K
        Between the extremes of the stretches.
    with_time : float
        Correlation of temperature and time.
    explained : float
        Share of the drift of the means that goes with it: one less the ratio of the mean squared second differences of the means,
        over an eighth of the log, without and with it. Negative where taking it out makes the means wander more.
    p_value : float
        Of an effect as large as this by chance.
    of_triad : float
        The same of effects on all axes of its triad as large as theirs.
    """

    coefficient: float
    standard_uncertainty: float
    change: float
    with_time: float
    explained: float
    p_value: float
    of_triad: float

    @property
    def helps(self) -> bool:
        """Whether an axis that temperature acts on is better off without what was found.

        What is taken off brings its own error in; on average that is less than what goes where the coefficient is above sqrt(2)
        times its standard uncertainty (Mallows 1973, Technometrics 15, 661). More is asked for, so that it hardly ever does harm.
        """
        return self.explained > 0 and self.p_value < _CLEAR

    @property
    def told_apart(self) -> bool:
        """Whether the temperature did anything but rise or fall steadily with time."""
        return abs(self.with_time) < _COLLINEAR


def taken_off(
    blocks: Blocks, axes: Sequence[str], judging: Sequence[int], readings: Sequence[str]
) -> tuple[Correction | None, dict[int, Disturbance]]:
    """What goes with the temperature and is taken off, and words on it by number of the axis.

    Temperature is asked for sensor by sensor. Where it acts on one, each of its axes is told with its coefficient, and the effect
    is taken off those where that helps.

    Parameters
    ----------
    blocks : Blocks
    axes : sequence of str
    judging : sequence of int
        Numbers of the axes to look at.
    readings : sequence of str
        Unit of the samples of each axis.
    """
    sensors: dict[str, list[int]] = {}
    for k in judging:
        sensors.setdefault(axes[k].partition("_")[0], []).append(k)
    known = effects(blocks, list(sensors.values()))
    if known is None or blocks.temperature is None:
        return None, {}
    told: dict[int, Disturbance] = {}
    coefficient = np.zeros(len(axes))
    for triad in sensors.values():
        clear = [k for k in triad if known[k].helps]
        if known[triad[0]].of_triad > _BY_CHANCE or not any(known[k].explained >= _EXPLAINED for k in clear):
            continue
        coefficient[clear] = [known[k].coefficient for k in clear]
        told |= {k: _told(axes[k], known[k], readings[k], [axes[c] for c in clear]) for k in triad}
    if not told:
        return None, {}
    good = np.isfinite(blocks.temperature)
    warmth = blocks.temperature[good]
    return Correction(blocks.mid[good], warmth - warmth.mean(), coefficient), told


def _told(axis: str, effect: Effect, reading: str, clear: Sequence[str]) -> Disturbance:
    """Words on the effect on one axis; it is taken off the axes in `clear`."""
    unit, size = shown_in(axis, reading)
    value = f"{effect.coefficient * size:.3g} ± {effect.standard_uncertainty * size:.2g} {unit}/K"
    if axis in clear:
        text = (
            f"{axis} follows the temperature by {value}, which makes {effect.explained:.0%} of its drift (the temperature "
            f"changed by {effect.change:.2g} K): taken off before the terms were found"
        )
    else:
        text = (
            f"{axis} may follow the temperature, by {value}: not clear enough to be taken off, as it was off "
            f"{', '.join(clear)}"
        )
    text += (
        "" if effect.told_apart else "; the temperature changed so steadily that it may be a drift with time as well"
    )
    significance = abs(effect.coefficient) / effect.standard_uncertainty if effect.standard_uncertainty > 0 else None
    return Disturbance("temperature", axis, text, size=effect.coefficient, significance=significance)


class _Fits(NamedTuple):
    """Restricted log likelihood, coefficient and its variance for each pair of weights, shape (weights, axes) each."""

    log: Array
    value: Array
    variance: Array


def effects(blocks: Blocks, triads: Sequence[Sequence[int]]) -> dict[int, Effect] | None:
    """Effect of temperature on axes; None where it was not recorded, did not change, or the log is too short.

    Parameters
    ----------
    blocks : Blocks
    triads : sequence of sequence of int
        Numbers of the axes to look at, those of one sensor together.
    """
    found = _stretches(blocks)
    if found is None:
        return None
    time, warmth, mean = found
    change = float(np.ptp(warmth))
    if change < _LEAST:
        return None
    t = (time - time.mean()) / np.ptp(time)
    T = (warmth - warmth.mean()) / change
    size = mean.std(axis=0)
    y = (mean - mean.mean(axis=0)) / np.where(size > 0, size, 1.0)
    fits = _regressed(y, np.column_stack([np.ones_like(t), t, T]))
    with_time = float(np.corrcoef(t, T)[0, 1])
    out = {}
    for triad in map(list, triads):
        value, sigma, p_value, of_triad = _judged(fits, triad, t.size - 3)
        unit = size[triad] / change
        for k, c, s, p in zip(triad, value * unit, sigma * unit, p_value, strict=True):
            share = _explained(mean[:, k], c * warmth)
            out[k] = Effect(float(c), float(s), change, with_time, share, float(p), of_triad)
    return out


def _stretches(blocks: Blocks) -> tuple[Array, Array, Array] | None:
    """Times (n,), temperatures (n,) and means (n, axes) of the stretches."""
    if blocks.temperature is None:
        return None
    each = max(1, blocks.count // _STRETCHES)
    n = blocks.count // each
    if n < _FEWEST:
        return None
    cut = n * each
    warmth = blocks.temperature[:cut].reshape(n, each)
    known = np.isfinite(warmth).all(axis=1)
    if known.sum() < max(_FEWEST, 0.9 * n):
        return None
    mean = blocks.mean[:cut].reshape(n, each, -1).mean(axis=1)
    return blocks.mid[:cut].reshape(n, each).mean(axis=1)[known], warmth.mean(axis=1)[known], mean[known]


def _covariances(n: int) -> tuple[Array, Array]:
    """Of flicker noise and of a random walk at n places, shape (n, n) each, of order one."""
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n))).astype(float)
    times = 3.0 ** np.arange(0, math.ceil(math.log(4 * n, 3)) + 1)
    flicker = sum((np.exp(-apart / q) for q in times), np.zeros((n, n))) / times.size
    walk = np.minimum.outer(np.arange(1, n + 1), np.arange(1, n + 1)) / n
    return flicker, walk


def _regressed(y: Array, X: Array) -> _Fits:
    """Last coefficient of a regression for all weights of the slow noise; y (n, axes), X (n, p)."""
    n, p = X.shape
    flicker, walk = _covariances(n)
    logs, values, variances = [], [], []
    for f in _WEIGHTS:
        for w in _WEIGHTS:
            L = np.linalg.cholesky(np.eye(n) + n * f * flicker + n * w * walk)
            white = np.linalg.solve(L, np.column_stack([X, y]))
            Xw, yw = white[:, :p], white[:, p:]
            q, r = np.linalg.qr(Xw)
            along = q.T @ yw
            rest = np.maximum((yw**2).sum(axis=0) - (along**2).sum(axis=0), 1e-300)
            logs.append(-np.log(np.diag(L)).sum() - np.log(np.abs(np.diag(r))).sum() - 0.5 * (n - p) * np.log(rest))
            values.append(along[-1] / r[-1, -1])
            variances.append(rest / (n - p) / r[-1, -1] ** 2)
    return _Fits(np.array(logs), np.array(values), np.array(variances))


def _about_common() -> Array:
    """Probability of the weights of an axis (columns) for each pair of common ones (rows)."""
    place = np.arange(len(_WEIGHTS), dtype=float)
    near = np.exp(-0.5 * (np.subtract.outer(place, place) / _ALIKE) ** 2)
    near /= near.sum(axis=1, keepdims=True)
    both = np.kron(near, near)
    return np.asarray((1.0 - _UNLIKE) * both + _UNLIKE / both.shape[1])


def _judged(fits: _Fits, triad: list[int], freedom: int) -> tuple[Array, Array, Array, float]:
    """Coefficients of the axes of a triad, standard deviations and probabilities (axes,), and the probability of them all."""
    from scipy.special import chdtrc, chdtri, stdtr

    value, variance = fits.value[:, triad], fits.variance[:, triad]
    likelihood = np.exp(fits.log[:, triad] - fits.log[:, triad].max(axis=0))
    prior = _about_common()
    told = prior @ likelihood  # of the common weights, by each axis
    log = np.log(told).sum(axis=1)
    common = np.exp(log - log.max())
    common /= common.sum()
    chance = 2.0 * stdtr(freedom, -np.abs(value) / np.sqrt(np.maximum(variance, 1e-300)))
    # at given common weights the axes are independent: normal deviates as likely as each of them, their squares added
    squares = chdtri(1, np.clip((prior @ (likelihood * chance)) / told, 1e-300, 1.0)).sum(axis=1)
    together = float(common @ chdtrc(len(triad), squares))
    # over all weights of each axis
    own = likelihood * (prior.T @ (common[:, None] / told))
    p_value = (own * chance).sum(axis=0)
    # an effect on all axes shows in the sum, one on a single axis in the least of them: two chances, as Bonferroni counts them
    least = len(triad) * float(p_value.min())
    of_triad = together if len(triad) == 1 else min(1.0, 2.0 * min(together, least))
    best = (own * value).sum(axis=0)
    sigma = np.sqrt((own * (variance + (value - best) ** 2)).sum(axis=0))
    return best, sigma, p_value, of_triad


def _explained(mean: Array, effect: Array) -> float:
    """How far taking the effect out quietens the means."""
    width = max(mean.size // 8, 1)

    def wandering(x: Array) -> float:
        total = np.concatenate([[0.0], np.cumsum(x - x.mean())])
        means = (total[width:] - total[:-width]) / width
        return float(np.mean((means[width:] - means[:-width]) ** 2))

    whole = wandering(mean)
    return 1.0 - wandering(mean - effect) / whole if whole > 0 else 0.0
