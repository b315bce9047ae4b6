"""Probabilities of normal and chi-square distributions, without the quarter of a second that loading a library for them takes."""

from __future__ import annotations

import math

import numpy as np

from ..frames import Array

# Abramowitz and Stegun (1964), 7.1.26: erfc to 1.5e-7
_P = 0.3275911
_A = (0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429)


def normal_below(z: Array) -> tuple[Array, Array]:
    """Probability that a standard normal number is below z, to 1e-7 (Abramowitz and Stegun 7.1.26), and its density.

    Parameters
    ----------
    z : ndarray

    Returns
    -------
    probability, density : ndarray
        Of the same shape.
    """
    bell = np.exp(-0.5 * z * z)
    t = 1.0 / (1.0 + _P * math.sqrt(0.5) * np.abs(z))
    tail = 0.5 * t * (_A[0] + t * (_A[1] + t * (_A[2] + t * (_A[3] + t * _A[4])))) * bell
    return np.asarray(np.where(z > 0, 1.0 - tail, tail)), bell / math.sqrt(2.0 * math.pi)


def chi_square_above(chi2: float, dof: int) -> float:
    """Probability that a chi-square of so many degrees of freedom is larger (Abramowitz and Stegun 26.4.4 and 26.4.5).

    Parameters
    ----------
    chi2 : float
    dof : int
        One or more.
    """
    half, odd = chi2 / 2.0, dof % 2
    if half <= 0:
        return 1.0
    powers = np.arange(dof // 2) + (0.5 if odd else 0.0)
    gammas = np.array([math.lgamma(k + 1.0) for k in powers])
    with np.errstate(under="ignore"):
        rest = float(np.exp(powers * math.log(half) - half - gammas).sum())
    return min(1.0, rest + (math.erfc(math.sqrt(half)) if odd else 0.0))
