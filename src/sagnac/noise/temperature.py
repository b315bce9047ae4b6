"""Is the drift of a log explained by its temperature? Regression of its slow part on temperature and time, against slow noise.

The means y of some ninety stretches are modelled as ::

    y = a + b t + c T + e,    cov(e) proportional to I + f F + w W,

with F the covariance of flicker noise (processes of equal variance with correlation times in geometric progression) and W that
of a random walk. Slow noise drifts with anything that drifts, so that an ordinary regression finds temperature effects where
there are none (Granger and Newbold 1974, Journal of Econometrics 2, 111). Here the weights f and w are not fixed: the restricted
likelihood (Patterson and Thompson 1971, Biometrika 58, 545) averages the coefficient over all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..frames import Array
from .blocks import Blocks

_STRETCHES = 96
_FEWEST = 24
_LEAST = 0.05  # K
_WEIGHTS = (0.0, *(10.0**e for e in np.arange(-3.0, 2.6, 0.5)))
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
    """

    coefficient: float
    standard_uncertainty: float
    change: float
    with_time: float
    explained: float
    p_value: float

    @property
    def told_apart(self) -> bool:
        """Whether the temperature did anything but rise or fall steadily with time."""
        return abs(self.with_time) < _COLLINEAR


def effects(blocks: Blocks) -> list[Effect] | None:
    """Effect of temperature on each axis; None where it was not recorded, did not change, or the log is too short.

    Parameters
    ----------
    blocks : Blocks
    """
    found = _stretches(blocks)
    if found is None:
        return None
    time, warmth, mean = found
    if np.ptp(warmth) < _LEAST:
        return None
    t = (time - time.mean()) / np.ptp(time)
    T = (warmth - warmth.mean()) / np.ptp(warmth)
    size = mean.std(axis=0)
    y = (mean - mean.mean(axis=0)) / np.where(size > 0, size, 1.0)
    coefficient, spread = _regressed(y, np.column_stack([np.ones_like(t), t, T]))
    together = float(np.corrcoef(t, T)[0, 1])
    to_unit = size / np.ptp(warmth)
    out = []
    for k in range(y.shape[1]):
        c, s = float(coefficient[k] * to_unit[k]), float(spread[k] * to_unit[k])
        share = _explained(mean[:, k], c * warmth)
        out.append(Effect(c, s, float(np.ptp(warmth)), together, share, _p_value(c, s, t.size - 3)))
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


def _regressed(y: Array, X: Array) -> tuple[Array, Array]:
    """Last coefficient and its standard deviation, averaged over the weights of the slow noise; y (n, axes), X (n, p)."""
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
    log, value, variance = np.array(logs), np.array(values), np.array(variances)
    weight = np.exp(log - log.max(axis=0))
    weight /= weight.sum(axis=0)
    mean = (weight * value).sum(axis=0)
    return mean, np.sqrt((weight * (variance + (value - mean) ** 2)).sum(axis=0))


def _explained(mean: Array, effect: Array) -> float:
    """How far taking the effect out quietens the means."""
    width = max(mean.size // 8, 1)

    def wandering(x: Array) -> float:
        total = np.concatenate([[0.0], np.cumsum(x - x.mean())])
        means = (total[width:] - total[:-width]) / width
        return float(np.mean((means[width:] - means[:-width]) ** 2))

    whole = wandering(mean)
    return 1.0 - wandering(mean - effect) / whole if whole > 0 else 0.0


def _p_value(value: float, sigma: float, freedom: int) -> float:
    from scipy.special import stdtr

    return float(2.0 * stdtr(freedom, -abs(value) / sigma)) if sigma > 0 else 0.0
