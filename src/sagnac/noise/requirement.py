"""Before a test: how long a record has to be for each coefficient, and what a record of a given length would see.

Nothing but the model is needed. The uncertainty that a record will give is that of the fit at the true levels. Whether a term
will be seen follows from variances as an unlucky record gives them, one in twenty: the deviance has to rise by its threshold
without the term even then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..frames import Array
from .identification.evidence import THRESHOLD
from .identification.fit import Model, fit, judged, model
from .identification.model_covariance import whole
from .identification.terms import LINEAR, ORDER, TERMS, level, value

_POWER = 1.6448536269514722
"""Standard uncertainties below the mean that 95 of 100 records lie above."""

_DURATIONS: Array = np.array([60.0 * 2.0**k for k in range(17)])
"""A minute to 45 days."""

_SHORTEST = 16  # samples
_CLOSE = 1e-3


@dataclass(frozen=True)
class Requirement:
    """Uncertainty of each coefficient against the length of the record.

    Attributes
    ----------
    keys : tuple of str
        Coefficients, ``markov_time`` too.
    durations : ndarray, shape (k,), s
    relative : ndarray, shape (k, keys)
        Standard uncertainty of each coefficient over the coefficient; infinite where the record tells nothing.
    target : float
        Relative standard uncertainty wanted.
    lengths : dict of str to float
        Shortest record for the target, s; infinite if none of the durations does.
    """

    keys: tuple[str, ...]
    durations: Array
    relative: Array
    target: float
    lengths: dict[str, float]


def requirement(
    coefficients: dict[str, float],
    interval: float,
    durations: Array | None = None,
    *,
    target: float = 0.1,
    kind: str = "allan",
) -> Requirement:
    """What record length each expected coefficient needs.

    Parameters
    ----------
    coefficients : dict of str to float
        Expected values, SI; ``markov_time`` [s] goes with ``markov``. Zeros are left out.
    interval : float, s
        Of the samples.
    durations : ndarray, shape (k,), s, optional
        In rising order; a minute to 45 days when there are none.
    target : float
        Relative standard uncertainty wanted.
    kind : str
        ``allan`` or ``hadamard``.

    Returns
    -------
    Requirement

    Raises
    ------
    InputError
        For a coefficient without a term, none at all, or an interval or duration that is not positive.
    """
    names = _checked(coefficients, interval)
    times: Array = _DURATIONS if durations is None else np.asarray(durations, dtype=float)
    if times.size == 0 or not np.all(times > 0.0) or not np.all(np.diff(times) > 0.0):
        raise InputError("Durations of records have to be positive and in rising order.")
    rows = [_relative(coefficients, interval, float(t), kind) for t in times]
    relative = np.array(rows, dtype=np.float64)
    lengths = {key: _reached(times, relative[:, i], target) for i, key in enumerate(names)}
    return Requirement(names, times, relative, target, lengths)


def smallest(key: str, others: dict[str, float], interval: float, duration: float, *, kind: str = "allan") -> float:
    """Smallest coefficient of a term that a record would show in 95 of 100 cases (89 to 95 in simulated logs).

    Parameters
    ----------
    key : str
        Any but ``markov``.
    others : dict of str to float
        Coefficients expected besides, SI.
    interval, duration : float, s
        Of the samples, and length of the record.
    kind : str
        ``allan`` or ``hadamard``.

    Returns
    -------
    float
        SI; infinite if the record cannot show the term whatever its size.

    Raises
    ------
    InputError
        As :func:`requirement`.
    """
    if key not in LINEAR:
        raise InputError(f"The smallest {key!r} depends on its correlation time: ask for one of {', '.join(LINEAR)}.")
    rest = {k: v for k, v in others.items() if k != key}
    _checked(rest, interval)
    if duration < _SHORTEST * interval:
        return math.inf
    terms, levels = _model({**rest, key: 1.0}, interval, duration, kind)
    at = terms.keys.index(key)
    without = model(terms.layout, tuple(k for k in terms.keys if k != key), terms.decay)
    floor = np.delete(levels, at)
    ease = float(np.min((without.design @ floor) / terms.design[:, at]))  # as large as all others at its best time

    def rise(size: float) -> float:
        levels[at] = size
        unlucky = _unlucky(terms, levels, at)
        return fit(without, unlucky, floor).deviance - fit(terms, unlucky, levels).deviance - THRESHOLD

    low, high = math.log(ease) - 20.0, math.log(ease) + 14.0
    if rise(math.exp(high)) < 0.0:
        return math.inf
    while high - low > _CLOSE:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if rise(math.exp(middle)) > 0.0 else (middle, high)
    return value(key, math.exp(high), interval)


def _unlucky(terms: Model, levels: Array, at: int) -> Array:
    """Variances from which a level comes out smaller than it is in 5 of 100 records, others as is then most likely."""
    expected = terms.design @ levels
    known = judged(terms, expected, levels)
    column = known.covariance[: levels.size, at] / math.sqrt(known.covariance[at, at])
    share = np.diag(terms.covariance(levels)) / expected**2
    root = 1.0 - share / 9.0 - _POWER / 3.0 * (terms.design @ column) / expected
    return np.asarray(expected * np.maximum(root, 0.1) ** 3)


def _checked(coefficients: dict[str, float], interval: float) -> tuple[str, ...]:
    """Names of the coefficients in the order of the terms."""
    if not interval > 0.0:
        raise InputError(f"The interval of samples is {interval} s: it has to be positive.")
    unknown = [key for key in coefficients if key not in TERMS and key != "markov_time"]
    if unknown:
        raise InputError(f"Noise term {unknown[0]!r}: there are {', '.join(TERMS)}.")
    names = [key for key in TERMS if coefficients.get(key, 0.0) != 0.0]
    if not any(key != "ramp" for key in names):
        raise InputError("Give the noise that is expected: at least one coefficient above zero besides a ramp.")
    if "markov" in names:
        if not coefficients.get("markov_time", 0.0) > 0.0:
            raise InputError("Correlated noise (markov) needs its correlation time (markov_time), in seconds.")
        names.append("markov_time")
    return tuple(names)


def _model(coefficients: dict[str, float], interval: float, duration: float, kind: str) -> tuple[Model, Array]:
    """Terms over a record, and their levels."""
    samples = max(round(duration / interval), _SHORTEST)
    keys = tuple(key for key in TERMS if coefficients.get(key, 0.0) != 0.0 and (key != "ramp" or ORDER[kind] == 2))
    plan = whole(kind, samples)
    decay = interval / coefficients["markov_time"] if "markov" in keys else 0.0
    return model(plan, keys, decay), np.array([level(key, coefficients[key], interval) for key in keys])


def _relative(coefficients: dict[str, float], interval: float, duration: float, kind: str) -> Array:
    """Relative standard uncertainty of each coefficient."""
    names = _checked(coefficients, interval)
    out = np.full(len(names), np.inf)
    if duration < _SHORTEST * interval:
        return out
    terms, levels = _model(coefficients, interval, duration, kind)
    if terms.design.shape[0] <= len(names):
        return out
    covariance = judged(terms, terms.design @ levels, levels).covariance
    spread = np.sqrt(np.diag(covariance))
    for i, key in enumerate(terms.keys):
        out[names.index(key)] = 0.5 * spread[i] / levels[i]
    if "markov" in terms.keys:
        out[names.index("markov_time")] = spread[-1]
    return out


def _reached(times: Array, relative: Array, target: float) -> float:
    """Where a falling curve reaches the target, straight in logarithms."""
    below = np.flatnonzero(relative <= target)
    if below.size == 0:
        return math.inf
    i = int(below[0])
    if i == 0 or not np.isfinite(relative[i - 1]):
        return float(times[i])
    x = np.log(times[i - 1 : i + 1])
    y = np.log(relative[i - 1 : i + 1])
    return math.exp(float(x[0] + (x[1] - x[0]) * (math.log(target) - y[0]) / (y[1] - y[0])))
