"""Before a test: how long to record, for noise that is expected from a plan, an earlier test, or in words.

See :mod:`sagnac.noise.requirement` for the mathematics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import plan as plans
from .. import units
from ..errors import InputError
from ..frames import Array
from .identification.terms import TERMS
from .page import term_name, units_of
from .record import load
from .requirement import Requirement, requirement, smallest

_SYMBOLS = {term.symbol: key for key, term in TERMS.items()} | {"T": "markov_time"}
_READING = {"accel": "m/s^2", "gyro": "rad/s"}
_NOTHING = 1e9
_MINUTE, _HOUR, _DAY = 60.0, 3600.0, 86400.0
_SHOWN = (10 * _MINUTE, _HOUR, 4 * _HOUR, _DAY)
_SOUGHT = ("instability", "walk")  # that a test is made for


@dataclass(frozen=True)
class Expected:
    """Noise that one sensor is expected to have.

    Attributes
    ----------
    sensor : str
        ``accel`` or ``gyro``.
    coefficients : dict of str to float
        By key of :data:`sagnac.noise.identification.terms.TERMS`, SI. Of a plan those of the quietest axis, of a
        test those of the axis that shows most terms.
    """

    sensor: str
    coefficients: dict[str, float]


@dataclass(frozen=True)
class Need:
    """What a record has to be for one sensor.

    Attributes
    ----------
    expected : Expected
    interval : float, s
        Of the samples.
    found : Requirement
    smallest : dict of str to tuple of float
        Bias instability and random walk, where they are not expected: the smallest that records of 10 min, 1 h, 4 h and 24 h
        would show in 95 of 100 cases, SI.
    """

    expected: Expected
    interval: float
    found: Requirement
    smallest: dict[str, tuple[float, ...]]


def from_text(text: str) -> Expected:
    """Expected noise from ``gyro=N=0.2 deg/sqrt(h), B=5 deg/h``.

    Parameters
    ----------
    text : str
        Symbols of IEEE Std 952: Q, N, B, K, R, and q with its correlation time T for correlated noise.

    Raises
    ------
    InputError
        With what cannot be read and how to write it.
    """
    sensor, equals, rest = text.partition("=")
    sensor = sensor.strip()
    if sensor not in _READING or not equals:
        raise InputError(f"--expect {text!r}: begin with accel= or gyro=, as in gyro='N=0.2 deg/sqrt(h), B=5 deg/h'")
    coefficients: dict[str, float] = {}
    for part in rest.split(","):
        symbol, equals, quantity = part.partition("=")
        key = _SYMBOLS.get(symbol.strip())
        if key is None or not equals:
            raise InputError(
                f"--expect {text!r}: {part.strip()!r} is no term: there are {', '.join(_SYMBOLS)}, as in N=0.2 deg/sqrt(h)"
            )
        coefficients[key] = _si(
            quantity.strip(), units_of(key, f"{sensor}_x", _READING[sensor]), f"--expect {symbol.strip()}"
        )
    return Expected(sensor, coefficients)


def _si(text: str, unit: tuple[str, str], what: str) -> float:
    given = units.quantity(text, what)
    try:
        value = float(given.to(units.quantity(f"1 {unit[0]}").units).magnitude)
    except Exception as cause:  # pint's errors share no base with each other
        raise InputError(f"{what}: {text!r} is not in {unit[1]} or a unit of that kind") from cause
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{what}: {text!r} must be more than zero")
    return value


def from_file(path: str | Path) -> tuple[list[Expected], float | None]:
    """Expected noise from a plan that states it, or from an earlier test; the latter's sample interval too.

    Parameters
    ----------
    path : path
        TOML or JSON.

    Raises
    ------
    InputError
        When it is neither, or states no noise.
    """
    if Path(path).suffix.lower() == ".json":
        return _of_test(path)
    noise = plans.load(path).unit.noise
    out = []
    for sensor in _READING:
        stated = {
            "white": noise.of(sensor),
            "instability": noise.of(sensor, "instability"),
            "walk": noise.of(sensor, "walk"),
        }
        coefficients = {key: _least(each) for key, each in stated.items() if each is not None}
        out.append(Expected(sensor, {k: v for k, v in coefficients.items() if v > 0}))
    out = [e for e in out if e.coefficients]
    if not out:
        raise InputError(
            f'{path}: states no noise: write noise = {{ gyro = "0.2 deg/sqrt(h)", gyro_instability = "5 deg/h" }} under [unit]'
        )
    return out, None


def _of_test(path: str | Path) -> tuple[list[Expected], float]:
    test = load(path)
    out = []
    for sensor in _READING:
        own = [a for a in test.axes if a.name.startswith(sensor)]
        if any(a.unit == "count" for a in own):
            raise InputError(f"{path}: its noise is in raw counts; open the log with the nominal scale (--scale) first")
        if own:  # of the axis that shows most terms
            axis = max(own, key=lambda a: len(a.terms))
            out.append(Expected(sensor, {t.key: t.value for t in axis.terms}))
    return out, test.interval


def _least(each: Sequence[float]) -> float:
    return min((v for v in each if v > 0), default=0.0)


def needs(
    expected: Sequence[Expected], interval: float, target: float = 0.1, durations: Array | None = None
) -> list[Need]:
    """What each sensor needs.

    Parameters
    ----------
    expected : sequence of Expected
        At most one a sensor.
    interval : float, s
        Of the samples.
    target : float
        Relative standard uncertainty wanted.
    durations : ndarray, shape (k,), s, optional
        See :func:`sagnac.noise.requirement.requirement`.

    Raises
    ------
    InputError
        When a sensor is expected twice, or its noise cannot be.
    """
    names = [e.sensor for e in expected]
    if len(set(names)) < len(names):
        raise InputError(f"--expect: {max(names, key=names.count)} is given twice; write its terms with commas between")
    return [_need(e, interval, requirement(e.coefficients, interval, durations, target=target)) for e in expected]


def _need(given: Expected, interval: float, found: Requirement) -> Need:
    known = given.coefficients
    seen = {
        key: tuple(smallest(key, known, interval, duration) for duration in _SHOWN)
        for key in _SOUGHT
        if key not in found.keys
    }
    return Need(given, interval, found, seen)


def told(found: Sequence[Need]) -> str:
    """A table: the length of record that each coefficient needs, and how well some lengths tell it."""
    lines = []
    for need in found:
        sensor, target = need.expected.sensor, 100 * need.found.target
        whose = f"{sensor} triad at {1 / need.interval:.6g} Hz"
        lines += [
            f"Length of record for the noise of the {whose}, each coefficient to {target:.3g} %",
            "",
            f"  {'':<38}{'expected':>24}  {'needs':>10}    " + "".join(f"{_length(t):>9}" for t in _SHOWN),
        ]
        for i, key in enumerate(need.found.keys):
            inside, unit = units_of(key, f"{sensor}_x", _READING[sensor])
            value = f"{units.convert(need.expected.coefficients[key], inside, unit):.4g} {unit}"
            at = [_between(t, need.found.durations, need.found.relative[:, i]) for t in _SHOWN]
            symbol = f" {TERMS[key].symbol}" if key in TERMS else ""
            name = f"{term_name(key, sensor)}{symbol}"
            lines.append(
                f"  {name:<38}{value:>24}  {_length(need.found.lengths[key], float(need.found.durations[0])):>10}    "
                + "".join(f"{_percent(a):>9}" for a in at)
            )
        for key, sizes in need.smallest.items():
            inside, unit = units_of(key, f"{sensor}_x", _READING[sensor])
            worth = units.convert(1.0, inside, unit)
            name = f"{term_name(key, sensor)} {TERMS[key].symbol}"
            lines.append(
                f"  {name:<38}{'none':>24}  {'shown from':>10}    "
                + "".join(f"{_size(size * worth):>9}" for size in sizes)
                + f"  {unit}"
            )
        longest = max(need.found.lengths.values())
        lines += ["", f"  all of them: {_length(longest)} at rest, at steady temperature", ""]
    return "\n".join(lines) + "\n"


def _between(time: float, durations: Array, relative: Array) -> float:
    """The uncertainty at a time between those worked out, straight in logarithms."""
    known = np.where(np.isfinite(relative), relative, _NOTHING)
    return float(np.exp(np.interp(np.log(time), np.log(durations), np.log(known))))


def _percent(relative: float) -> str:
    return "-" if relative > 1.0 else f"{100 * relative:.2g} %"


def _size(value: float) -> str:
    return f"{value:.2g}" if math.isfinite(value) else "-"


def _length(seconds: float, shortest: float = 0.0) -> str:
    """A time as a person plans it."""
    if seconds == shortest:
        return f"< {_length(seconds)}"
    if not math.isfinite(seconds):
        return "> 45 d"
    for size, unit in ((_DAY, "d"), (_HOUR, "h"), (_MINUTE, "min")):
        if seconds >= 1.5 * size or (size != _DAY and seconds >= size):
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"


def to_dict(found: Sequence[Need]) -> list[dict[str, Any]]:
    """The same for machines, SI; lengths that no record of 45 days reaches are null."""
    return [
        {
            "sensor": need.expected.sensor,
            "interval": need.interval,
            "target": need.found.target,
            "expected": dict(need.expected.coefficients),
            "lengths": _known(need.found.lengths),
            "durations": [float(t) for t in need.found.durations],
            "relative": {
                key: [float(v) if math.isfinite(v) else None for v in need.found.relative[:, i]]
                for i, key in enumerate(need.found.keys)
            },
            "smallest": {
                key: [
                    {"duration": t, "value": v if math.isfinite(v) else None}
                    for t, v in zip(_SHOWN, sizes, strict=True)
                ]
                for key, sizes in need.smallest.items()
            },
        }
        for need in found
    ]


def _known(lengths: Mapping[str, float]) -> dict[str, float | None]:
    return {key: v if math.isfinite(v) else None for key, v in lengths.items()}
