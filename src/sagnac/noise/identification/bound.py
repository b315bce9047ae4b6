"""The Cramer-Rao bound of noise coefficients: what a whole Gaussian record of unknown mean can tell, by any method.

The differences of neighbouring samples do not know the mean, and those of a random walk are stationary. In their sine transform
(frequencies pi j / n, j = 1 to n - 1) white noise and random walk are independent exactly, and stationary noise nearly so
(Whittle 1953): the information is ::

    I_tu = 1/2 sum over j of S_t(w_j) S_u(w_j) / S(w_j)^2,

with the spectra of the terms S_t and of the whole S (3 % off for noise that is seen in its lowest frequencies alone). A ramp
is the mean of the differences: its information stands alone, and is exact for means of a thousandth of the record.
"""

from __future__ import annotations

import math

import numpy as np

from ...frames import Array
from .panels import graded
from .terms import lag_covariance, sample_spectrum

_SINGLE = 4096  # frequencies summed one by one, from the lowest
_BLOCKS = 1000


def information(levels: dict[str, float], samples: int, decay: float = 0.0) -> tuple[tuple[str, ...], Array]:
    """Fisher information of the logarithms of the levels, and of the logarithm of the decay last where there is ``markov``.

    Parameters
    ----------
    levels : dict of str to float
        Of the terms, see :func:`sagnac.noise.identification.terms.level`; above zero.
    samples : int
        n.
    decay : float
        Of ``markov``: interval over correlation time.

    Returns
    -------
    names : tuple of str
        ``markov_time`` stands for the decay.
    information : ndarray, shape (names, names)
    """
    j, weight = _frequencies(samples)
    omega = math.pi * j / samples
    random = [key for key in levels if key != "ramp"]
    parts = [levels[key] * sample_spectrum(key, omega, decay) for key in random]
    whole = np.sum(parts, axis=0)
    names = list(random)
    if "markov" in levels:
        parts.append(levels["markov"] * _markov_slope(omega, decay))
        names.append("markov_time")
    relative = np.stack(parts) / whole
    out = 0.5 * (relative * weight) @ relative.T
    if "ramp" in levels:
        names.append("ramp")
        wide = np.zeros((len(names), len(names)))
        wide[:-1, :-1] = out
        wide[-1, -1] = 0.25 * levels["ramp"] * _slope_information(levels, samples, decay)
        out = wide
    return tuple(names), out


def _slope_information(levels: dict[str, float], samples: int, decay: float) -> float:
    """Inverse variance of the best slope, per sample, of a record: means of blocks of it lose next to nothing."""
    from scipy.linalg import solve_toeplitz

    block = max(1, samples // _BLOCKS)
    number = samples // block - 1
    m, lag = np.full(number, float(block)), block * np.arange(float(number))
    row = np.zeros(number)
    for key, level in levels.items():
        if key != "ramp":
            row += level * lag_covariance(key, "allan", m, m, lag, decay)
    step = np.full(number, float(block))  # of the means, at a slope of one
    return float(step @ solve_toeplitz(row, step))


def _frequencies(samples: int) -> tuple[Array, Array]:
    """Numbers of frequencies 1 to n - 1 and how many each stands for: the lowest one by one, then panels that double."""
    single = min(_SINGLE, samples - 1)
    low = np.arange(1.0, single + 1.0)
    if single == samples - 1:
        return low, np.ones(single)
    high, weight = graded(single + 1, samples - 1 - single, smallest=_SINGLE // 8)
    return np.concatenate([low, high]), np.concatenate([np.ones(single), weight])


def _markov_slope(omega: Array, a: float) -> Array:
    """Derivative of the spectrum of ``markov`` by the logarithm of its decay."""
    p, q = math.exp(-a), -math.expm1(-a)
    comb = 4.0 * np.sin(0.5 * omega) ** 2
    top, bottom = -math.expm1(-2.0 * a), q**2 + p * comb
    return np.asarray(a * p * (2.0 * p / bottom + top * (comb - 2.0 * q) / bottom**2))
