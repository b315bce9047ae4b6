"""How sure a variance is: equivalent degrees of freedom, chi-square intervals, and the kind of noise that they depend on.

The estimate of a variance from overlapping differences of Gaussian noise is distributed nearly as chi-square over its degrees
of freedom ``2 E^2 / var``, which follow from the correlation of the differences: Greenhall & Riley, "Uncertainty of stability
variances based on finite differences", PTTI 2003, equations 9 and 10. They put the generalised autocovariance of noise in
continuous time in (equation 7) and bridge long records by tables. Here stands that of sampled noise whose spectrum is
``(2 sin(pi f interval))^alpha``. It is exact at any averaging time, and no table is needed:

    alpha    2     1          0   -1                    -2             -3                              -4
    R(j)     j=0   psi(j+1/2) j   (j^2-1/4) psi(j+1/2)  j (j^2 - 1)    (j^2-1/4)(j^2-9/4) psi(j+1/2)   j (j^2-1)(j^2-4)

(psi is the digamma function, each R is that of the cumulative sum, up to a factor and to powers of j that no difference sees).
The exponents are 2 for quantisation of the angle, 0 for white noise (random walk of the angle), -1 for bias instability,
-2 for random walk of the rate.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ...errors import DataError, InputError
from ...frames import Array
from .allan import KINDS, SPAN, Variances, largest_step

_LOWEST = {"allan": -2.0, "modified": -2.0, "hadamard": -4.0}
_ALL = 4096  # lags up to which each is summed; of more, a graded choice
_REACH = 1.0 + 1e-9  # octaves at each side of an averaging time that the slope is taken over
_SURE = 32  # share of the record up to which slopes are told


def edf(kind: str, alpha: float, factor: int, samples: int, step: int = 1) -> float:
    """Equivalent degrees of freedom of an overlapping variance.

    Parameters
    ----------
    kind : str
        One of :data:`sagnac.noise.curves.allan.KINDS`.
    alpha : float
        Exponent of the spectrum of the rate, from 2 down to -2, for Hadamard to -4. Between integers the logarithm of the
        degrees is interpolated.
    factor : int
        Samples in an averaging time.
    samples : int
        In the record.
    step : int
        Samples from the begin of one difference to that of the next: 1 when all are counted.

    Returns
    -------
    float
        ``2 E^2 / var`` of the mean of the squared differences.

    Raises
    ------
    InputError
        An argument that cannot be: the kind, an exponent at which the variance diverges, a factor or a step that does not
        go into the record.
    """
    if kind not in KINDS:
        raise InputError(f"There is no variance of kind {kind!r}. Kinds: {', '.join(KINDS)}.")
    if not _LOWEST[kind] <= alpha <= 2.0:
        raise InputError(f"Exponent {alpha:g}: the {kind} variance is told for {_LOWEST[kind]:g} to 2.")
    if factor < 1 or step < 1 or factor % step or _count(kind, factor, samples) < 1:
        raise InputError(
            f"An averaging time of {factor} samples in steps of {step} does not go into a record of {samples} samples."
        )
    low = math.floor(alpha)
    part = alpha - low
    value = math.log(_edf(kind, low, factor, samples, step))
    if part:
        value = (1.0 - part) * value + part * math.log(_edf(kind, low + 1, factor, samples, step))
    return math.exp(value)


def degrees_of_freedom(found: Variances, alpha: ArrayLike | None = None) -> Array:
    """Equivalent degrees of freedom of each variance.

    Stretches that were pooled by the number of their differences are independent: the variance of the weighted mean is
    the sum of theirs.

    Parameters
    ----------
    found : Variances
    alpha : array_like, optional
        Exponents, of a shape that spreads to (k, axes); those of :func:`exponents` when there are none.

    Returns
    -------
    ndarray, shape (k, axes)
    """
    exponent = np.zeros(found.variance.shape) + (exponents(found) if alpha is None else np.asarray(alpha, dtype=float))
    out = np.zeros_like(found.variance)
    parts = found.stretches or ((found.samples, found.count),)
    often = found.often or (1,) * len(parts)
    for i, factor in enumerate(found.factors.tolist()):
        step = largest_step(factor) if found.method == "pyramid" else 1
        given = [(n, int(counts[i]), k) for (n, counts), k in zip(parts, often, strict=True) if counts[i]]
        for a in range(len(out[i])):
            each = np.array([k * edf(found.kind, float(exponent[i, a]), factor, n, step) for n, _, k in given])
            weights = np.array([float(count) for _, count, _ in given])
            out[i, a] = weights.sum() ** 2 / (weights**2 / each).sum()
    return out


def intervals(found: Variances, level: float = 0.95, alpha: ArrayLike | None = None) -> tuple[Array, Array]:
    """Confidence intervals of the deviations (NIST SP 1065, equation 45).

    Parameters
    ----------
    found : Variances
    level : float
        Probability that an interval contains the truth.
    alpha : array_like, optional
        Exponents of the noise, see :func:`degrees_of_freedom`.

    Returns
    -------
    lower, upper : ndarray, shape (k, axes)

    Raises
    ------
    InputError
        The level is no probability, or an exponent is out of range.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"Level {level:g}: an interval's probability lies between 0 and 1.")
    from scipy.special import chdtri

    freedom = degrees_of_freedom(found, alpha)
    side = 0.5 * (1.0 - level)
    total = freedom * found.variance
    return np.sqrt(total / chdtri(freedom, side)), np.sqrt(total / chdtri(freedom, 1.0 - side))


def exponents(found: Variances) -> Array:
    """Exponent of the spectrum that rules each averaging time, by the local slope of the variance.

    The variance goes with the averaging time to the power ``-1 - alpha``. Allan and Hadamard variances have the same slope
    for exponents 1 and 2: it counts as 1, of which the degrees of freedom are less. What lies out of a kind's range is put
    to its end. Averaging times beyond a thirty-second of the record have the exponent of that one: a slope of few averages
    is chance, and it goes with the error of the variance that it is to judge.

    Parameters
    ----------
    found : Variances

    Returns
    -------
    ndarray, shape (k, axes)
        Not rounded. White noise where there is only one averaging time.

    Raises
    ------
    DataError
        A variance is zero.
    """
    if not (found.variance > 0).all():
        at, axis = np.argwhere(~(found.variance > 0))[0]
        raise DataError(
            f"The variance of axis {axis + 1} at {found.tau[at]:g} s is zero: its samples repeat a pattern, and are no noise."
        )
    octave, height = np.log2(found.factors), np.log2(found.variance)
    last = max(octave[0], np.log2(found.samples / _SURE))
    out = np.zeros_like(height)
    for i, own in enumerate(octave):
        near = np.abs(octave - min(own, last)) <= _REACH
        if near.sum() < 2:  # averaging times far apart: the two nearest
            near = np.argsort(np.abs(octave - min(own, last)), kind="stable")[:2]
        x = octave[near] - octave[near].mean()
        if len(octave) > 1:
            out[i] = -1.0 - x @ height[near] / (x @ x)
    return np.asarray(np.clip(out, _LOWEST[found.kind], 2.0 if found.kind == "modified" else 1.0))


def _count(kind: str, factor: int, samples: int) -> int:
    return samples + (2 if kind == "modified" else 1) - SPAN[kind] * factor


@lru_cache(maxsize=4096)
def _edf(kind: str, alpha: int, factor: int, samples: int, step: int) -> float:
    # averaging over m neighbours and a second difference are a third difference of the sums of sums
    order, exponent = (3, alpha - 2) if kind == "modified" else (SPAN[kind], alpha)
    terms = (_count(kind, factor, samples) - 1) // step + 1
    lags = _lags(factor // step, min(terms, 2 * (order + 1) * factor // step))
    covariance = np.zeros(lags.size)
    for k in range(-order, order + 1):
        covariance += (-1) ** k * math.comb(2 * order, order + k) * _autocovariance(lags * step + k * factor, exponent)
    # the sum over all lags of both signs with half of the last one is what the trapezoid rule makes of unit steps
    total = 2.0 * np.trapezoid((1.0 - lags / terms) * (covariance / covariance[0]) ** 2, lags)
    return float(terms / total)


def _autocovariance(lag: Array, alpha: int) -> Array:
    """Generalised, of the cumulative sum of noise of exponent alpha; see the head of the module."""
    j = np.abs(lag)
    if alpha == 2:
        return np.asarray(j == 0, dtype=float)
    # the product over the steps from j - reach to j + reach by ones: (j^2 - 1/4)(j^2 - 9/4) or j (j^2 - 1)(j^2 - 4)
    out = np.ones(j.size)
    for at in np.arange(0.5 * (alpha % 2) + (alpha % 2 == 0), 0.5 * (2 - alpha), 1.0):
        out *= j * j - at * at
    if alpha % 2 == 0:
        return j * out
    from scipy.special import digamma

    return np.asarray(out * digamma(j + 0.5))


def _lags(stride: int, longest: int) -> Array:
    """Lags to sum over: all, or a choice that is dense where differences have samples in common at their edges."""
    if longest <= _ALL:
        return np.arange(longest + 1.0)
    away = np.concatenate([np.arange(16.0), np.geomspace(16.0, max(0.5 * stride, 17.0), 80)])
    edges = stride * np.arange(longest // stride + 2.0)[:, None]
    lags = np.unique(np.round(np.concatenate([(edges + away).ravel(), (edges - away).ravel(), [longest]])))
    return lags[(lags >= 0) & (lags <= longest)]
