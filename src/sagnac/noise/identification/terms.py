"""The terms that the noise of an inertial sensor is made of, and what each does to the variances of its samples.

A term is a process of one coefficient: its variance, in units of the samples, is ``level`` times a shape that depends on nothing
but whole numbers of samples (and, for a Gauss-Markov process, on its correlation time in samples). The shapes are exact for
what an instrument gives: each sample is the mean of the rate over one interval.

A term is described by what a second difference over m samples leaves of the generalised autocovariance G(h) of the running sum
of its samples (:func:`second_difference`): G may grow without bound, the differences of it do not. Every covariance between
differences of the sum, of any order from two and any two averaging times, is a sum of few values of that function.

Sources: IEEE Std 952-1997 annex C and IEEE Std 1293-1998 annex I (terms and their Allan variances), Greenhall & Riley 2003
(generalised autocovariances).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...frames import Array
from .panels import graded

FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Allan deviation of flicker noise over its coefficient B: 0.664."""


@dataclass(frozen=True)
class Term:
    """One term.

    Attributes
    ----------
    key : str
    name, symbol : str
        As in IEEE Std 952.
    power : float
        ``level = (value * interval**power)**2`` takes a coefficient in SI units to the variance of its samples.
    units : dict of str to (str, str)
        Of sensor to unit inside and unit of data sheets.
    """

    key: str
    name: str
    symbol: str
    power: float
    units: dict[str, tuple[str, str]]


TERMS: dict[str, Term] = {
    t.key: t
    for t in (
        Term("quantisation", "quantisation noise", "Q", -1.0, {"gyro": ("rad", "arcsec"), "accel": ("m/s", "mm/s")}),
        Term(
            "white",
            "angle (velocity) random walk",
            "N",
            -0.5,
            {"gyro": ("rad/s/Hz^0.5", "deg/sqrt(h)"), "accel": ("m/s^2/Hz^0.5", "ug/sqrt(Hz)")},
        ),
        Term("instability", "bias instability", "B", 0.0, {"gyro": ("rad/s", "deg/h"), "accel": ("m/s^2", "ug")}),
        Term(
            "walk",
            "rate (acceleration) random walk",
            "K",
            0.5,
            {"gyro": ("rad/s/s^0.5", "deg/h/sqrt(h)"), "accel": ("m/s^2/s^0.5", "ug/sqrt(h)")},
        ),
        Term(
            "ramp", "rate (acceleration) ramp", "R", 1.0, {"gyro": ("rad/s^2", "deg/h/h"), "accel": ("m/s^3", "ug/h")}
        ),
        Term(
            "markov",
            "correlated noise (Gauss-Markov)",
            "q",
            0.0,
            {"gyro": ("rad/s", "deg/h"), "accel": ("m/s^2", "ug")},
        ),
    )
}
"""The terms by their keys, in the order of their slopes. ``markov`` has a second coefficient, ``markov_time`` [s]."""

LINEAR = ("quantisation", "white", "instability", "walk", "ramp")
"""Terms whose variances are proportional to their levels: all but Gauss-Markov."""

ORDER = {"allan": 2, "hadamard": 3}
"""Differences of the running sum that a variance is the mean square of."""

DIVISOR = {"allan": 2.0, "hadamard": 6.0}
"""Of the mean square, so that the variance of white noise of one sample is its own."""


def level(key: str, value: float, interval: float) -> float:
    """Variance, in units of the samples, of a coefficient.

    Parameters
    ----------
    key : str
        One of :data:`TERMS`.
    value : float
        SI, see the units of the term.
    interval : float, s
        Of the samples.
    """
    return float((value * interval ** TERMS[key].power) ** 2)


def value(key: str, level: float, interval: float) -> float:
    """Coefficient of a variance: the inverse of :func:`level`."""
    return float(math.sqrt(level) / interval ** TERMS[key].power)


def units(key: str, sensor: str) -> tuple[str, str]:
    """Unit inside and unit of data sheets of a coefficient, ``markov_time`` too.

    Parameters
    ----------
    key : str
    sensor : str
        ``gyro`` or ``accel``.
    """
    return ("s", "s") if key == "markov_time" else TERMS[key].units[sensor]


def second_difference(key: str, factor: Array, lag: Array, decay: float = 0.0) -> Array:
    """``G(h + m) - 2 G(h) + G(h - m)`` of a term of level one, up to what further second differences take away.

    Free of cancellation: what is small against G comes from an expression of its own size. A ramp is no random process; its
    row is what it adds to each product of two second differences, see
    :func:`sagnac.noise.identification.model_covariance.covariance_table`.

    Parameters
    ----------
    key : str
    factor : ndarray
        m, whole numbers of samples.
    lag : ndarray, same shape
        h, samples; halves are allowed.
    decay : float
        Of ``markov``: interval over correlation time.

    Raises
    ------
    InputError
        For an unknown term.
    """
    h, m = np.abs(lag), np.asarray(factor, dtype=float)
    if key == "quantisation":  # G = 1 at h = 0: the sum carries one error at each end
        return np.asarray((h == m) - 2.0 * (h == 0.0))
    if key == "white":  # G = -|h| / 2
        return np.asarray(-np.maximum(m - h, 0.0))
    if key == "walk":  # G = |h|^3 / 12: the mean over each interval of a walk
        near = (m**3 + 3.0 * m * h**2 - h**3) / 6.0
        return np.where(h >= m, m**2 * h / 2.0, near)
    if key == "instability":
        return _flicker(m, h)
    if key == "markov":
        return _markov(m, h, decay)
    raise InputError(f"Noise term {key!r}: there are {', '.join(TERMS)}.")


def _flicker(m: Array, h: Array) -> Array:
    """Of G = h^2 ln|h| / (2 pi): the mean over each interval of a process of spectrum 1 / (2 pi f), f from 0 to infinity."""
    far = h > m
    safe = np.where(far, h, 1.0)
    e = np.where(far, m / safe, 0.5)
    out = m**2 * 2.0 * np.log(safe) + safe**2 * ((1.0 + e**2) * np.log1p(-(e**2)) + 4.0 * e * np.arctanh(e))
    near = _square_log(m + h) + _square_log(m - h) - 2.0 * _square_log(h)
    return np.asarray(np.where(far, out, near) / (2.0 * np.pi))


def _square_log(u: Array) -> Array:
    return np.asarray(u**2 * np.log(np.where(u > 0.0, u, 1.0)))


def _markov(m: Array, h: Array, a: float) -> Array:
    """Of G = -(e^(-a|h|) - 1 + |h| sinh a) / (2 (cosh a - 1)): the sum of samples with covariance e^(-a|h|)."""
    out = np.exp(-a * np.maximum(h - m, 0.0)) * np.expm1(-a * m) ** 2
    near = h < m
    m, h = m[near], h[near]
    plain = np.exp(-a * (m + h)) + np.exp(-a * (m - h)) - 2.0 * np.exp(-a * h) + 2.0 * (m - h) * math.sinh(a)
    short = a * m < 1.0  # the same less what cancels
    k, g = m[short], h[short]
    bent = _third(a * (k + g)) + _third(a * (k - g)) - 2.0 * _third(a * g)
    plain[short] = bent + (a * k) ** 2 + 2.0 * (k - g) * _sinh_excess(a)
    out[near] = plain
    return np.asarray(-0.25 / math.sinh(0.5 * a) ** 2 * out)


def _third(u: Array) -> Array:
    """``exp(-u) - 1 + u - u^2/2``, which begins with -u^3/6."""
    out = np.exp(-u) - 1.0 + u - 0.5 * u**2
    small = u < 0.5
    v = u[small]
    series = np.ones_like(v)
    for k in range(16, 3, -1):
        series = 1.0 - v / k * series
    out[small] = -(v**3) / 6.0 * series
    return np.asarray(out)


def _sinh_excess(a: float) -> float:
    """``sinh a - a``."""
    if a > 1.0:
        return math.sinh(a) - a
    out = 1.0
    for k in range(18, 3, -2):
        out = 1.0 + a**2 / (k * (k + 1)) * out
    return a**3 / 6.0 * out


def stencil(kind: str, first: Array, second: Array) -> list[tuple[Array, float]]:
    """Where, and how often, second differences over m1 samples make the covariance of two differences.

    The covariance of the differences over m1 and m2 whose middles lie u samples apart is the sum over the pairs (s, w) of
    ``w * second_difference(m1, u + s)``, over m1 m2 in mean rates.

    Parameters
    ----------
    kind : str
        ``allan`` or ``hadamard``.
    first, second : ndarray
        m1 and m2.
    """
    outer = [(second, 1.0), (np.zeros_like(second), -2.0), (-second, 1.0)]
    if ORDER[kind] == 2:
        return outer
    plus, minus = 0.5 * (first + second), 0.5 * (first - second)
    inner = [(plus, -1.0), (minus, 1.0), (-minus, 1.0), (-plus, -1.0)]
    return [(s + t, v * w) for s, v in inner for t, w in outer]


def lag_covariance(key: str, kind: str, first: Array, second: Array, lag: Array, decay: float = 0.0) -> Array:
    """Covariance of the differences of two averaging factors against the distance of their middles, level one.

    Parameters
    ----------
    key : str
        A ramp, which is no random process, gives the product of what it adds to both.
    kind : str
    first, second : ndarray
        Averaging factors.
    lag : ndarray
        Samples.
    decay : float
        See :func:`second_difference`.

    Returns
    -------
    ndarray
        Of mean rates, unit of the samples squared.
    """
    if key == "ramp":
        return np.asarray(first * second * np.ones_like(lag) * (ORDER[kind] == 2))
    total = np.zeros_like(lag)
    # a walk in sixths: these are whole numbers, or eighths of them, and their sums, which nearly cancel, are exact
    parts = 6.0 if key == "walk" else 1.0
    for shift, weight in stencil(kind, first, second):
        total += weight * (parts * second_difference(key, first, lag + shift, decay))
    return np.asarray(total / (parts * first * second))


def variance(key: str, factors: Array | NDArray[np.int64], kind: str = "allan", decay: float = 0.0) -> Array:
    """Variance of a term of level one, shape (k,): exact for samples that are means over their intervals.

    Parameters
    ----------
    key : str
    factors : ndarray, shape (k,)
        Samples in each averaging time.
    kind : str
        ``allan``, ``hadamard``, which does not see a ramp, or ``modified``.
    decay : float
        Of ``markov``: interval over correlation time.
    """
    m = np.asarray(factors, dtype=float)
    if kind == "modified":
        return _modified(key, m, decay)
    if key == "ramp":
        return lag_covariance(key, kind, m, m, np.zeros_like(m)) / DIVISOR[kind]
    # the stencil of equal factors at lag zero
    outer = np.array([-2.0, 2.0] if ORDER[kind] == 2 else [-6.0, 8.0, -2.0])
    lags = np.arange(outer.size)[:, None] * m
    found = second_difference(key, np.broadcast_to(m, lags.shape).ravel(), lags.ravel(), decay).reshape(lags.shape)
    return np.asarray(outer @ found / (m**2 * DIVISOR[kind]))


def _modified(key: str, factors: Array, decay: float) -> Array:
    """Modified Allan variance: that of the mean of m neighbouring second differences.

    With the covariance R of second differences over m whose middles lie u apart it is half of the mean of R over the distances
    of all pairs of the m: ``(m R(0) + 2 sum of (m - u) R(u)) / (2 m^2)``, u from 1 to m - 1. For white noise that is
    ``(m^2 + 1) / (2 m^3)`` (NIST SP 1065, section 5.5). What lies between whole numbers is interpolated, for drawing a line.
    """
    whole = np.unique(np.concatenate([np.floor(factors), np.ceil(factors)]))
    lags, weights = [], []
    for m in whole:
        away, often = graded(1, int(m) - 1, both=True) if m > 1.0 else (np.zeros(0), np.zeros(0))
        lags.append(np.append(0.0, away))
        weights.append(np.append(m, 2.0 * often * (m - away)))
    number = [lag.size for lag in lags]
    size, weight = np.repeat(whole, number), np.concatenate(weights)
    covariance = lag_covariance(key, "allan", size, size, np.concatenate(lags), decay)
    out = np.add.reduceat(weight * covariance, np.cumsum([0, *number[:-1]])) / (2.0 * whole**2)
    return np.asarray(np.exp(np.interp(np.log(factors), np.log(whole), np.log(out))))


def markov_slope(factors: Array | NDArray[np.int64], decay: float) -> Array:
    """Derivative of the Allan variance of ``markov`` by the logarithm of `decay`, shape (k,).

    With E(u) = exp(-u) - 1 + u - u^2/2 and c = cosh a - 1 the variance is
    (8 E(am) - 2 E(2am) + 4 m (sinh a - a)) / (4 c m^2), and E' = -(exp(-u) - 1 + u).

    Parameters
    ----------
    factors : ndarray, shape (k,)
    decay : float
        a.
    """
    m, a = np.asarray(factors, dtype=float), decay
    c = 2.0 * math.sinh(0.5 * a) ** 2
    inner = 4.0 * m * (_ramp_excess(2.0 * a * m) - 2.0 * _ramp_excess(a * m) + c)
    return np.asarray(a * (inner / (4.0 * c * m**2) - math.sinh(a) / c * variance("markov", m, decay=a)))


def _ramp_excess(u: Array) -> Array:
    """``exp(-u) - 1 + u``."""
    return np.asarray(np.where(u < 0.5, _third(u) + 0.5 * u**2, np.expm1(-u) + u))


def sample_spectrum(key: str, omega: Array, decay: float = 0.0) -> Array:
    """Spectrum of the samples of a term of level one: its mean over the circle is their variance, where they have one.

    Parameters
    ----------
    key : str
        Any but the ramp.
    omega : ndarray
        Radians per sample, above zero and at most pi.
    decay : float

    Notes
    -----
    Flicker noise of spectrum ``1 / |omega|`` and averaged over each interval folds to ``4 sin^2(omega/2)`` times the sum over
    k of ``1 / |omega + 2 pi k|^3``. A walk has fourth powers there, which sum up to ``(1 - c/6) / c^2`` with that factor c.
    """
    comb = 4.0 * np.sin(0.5 * omega) ** 2
    if key == "quantisation":
        return np.asarray(comb)
    if key == "white":
        return np.ones_like(omega)
    if key == "walk":
        return np.asarray(1.0 / comb - 1.0 / 6.0)
    if key == "markov":
        return -math.expm1(-2.0 * decay) / (math.expm1(-decay) ** 2 + math.exp(-decay) * comb)
    if key != "instability":
        raise InputError(f"Noise term {key!r} has no spectrum.")
    from scipy.special import zeta

    turn = omega / (2.0 * np.pi)
    return np.asarray(comb * (zeta(3.0, turn) + zeta(3.0, 1.0 - turn)) / (2.0 * np.pi) ** 3)


def density(key: str, value: float, frequency: Array, interval: float, time: float = 0.0) -> Array:
    """One-sided power spectral density of the samples of a term, unit of the samples squared per Hz.

    Parameters
    ----------
    key : str
    value : float
        Coefficient, SI.
    frequency : ndarray, Hz
        Above zero and at most half the sample rate.
    interval : float, s
        Of the samples.
    time : float, s
        Correlation time of ``markov``.
    """
    omega = 2.0 * np.pi * frequency * interval
    shape = sample_spectrum(key, omega, interval / time if key == "markov" else 0.0)
    return np.asarray(2.0 * interval * level(key, value, interval) * shape)
