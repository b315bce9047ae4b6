"""Units at the edge: text in, SI out.

A small registry of our own on top of pint: ``g`` is standard gravity (not gram), the radian and the count are
dimensions of their own, so that an angular rate cannot pass for a frequency, nor a pulse for a number.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Any

from .errors import InputError

# kind of quantity -> (SI unit of it, an example for the message)
KINDS: dict[str, tuple[str, str]] = {
    "acceleration": ("m/s^2", "9.8 m/s^2, 1 g, 50 ug"),
    "angular rate": ("rad/s", "10 deg/s, 0.02 deg/h"),
    "angle": ("rad", "30 deg, 5 arcsec"),
    "time": ("s", "60 s, 2 min"),
    "length": ("m", "380 m"),
    "temperature": ("K", "degC"),
    "accelerometer noise density": ("m/s^2/Hz^0.5", "10 ug/sqrt(Hz)"),
    "gyro noise density": ("rad/s/Hz^0.5", "0.001 deg/sqrt(h)"),
    "acceleration random walk": ("m/s^2/s^0.5", "1 ug/sqrt(h)"),
    "rate random walk": ("rad/s/s^0.5", "0.01 deg/h/sqrt(h)"),
    "quadratic coefficient": ("s^2/m", "12 ug/g^2"),
    "g-squared sensitivity": ("rad*s^3/m^2", "0.01 deg/h/g^2"),
    "ratio": ("", "20 ppm, 0.001"),
    "count": ("count", "count, pulse, LSB"),
    "sample rate": ("Hz", "100 Hz"),
}

_DEFINITIONS = f"""
nano- = 1e-9 = n-
micro- = 1e-6 = u- = µ- = μ-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
second = [time] = s = sec
minute = 60 * second = min
hour = 3600 * second = h = hr
day = 86400 * second = d
hertz = 1 / second = Hz
meter = [length] = m = metre
foot = 0.3048 * meter = ft = feet
inch = 0.0254 * meter = in
nautical_mile = 1852 * meter = nmi
knot = 1852 * meter / hour = kn = kt
radian = [angle] = rad
degree = {math.pi / 180!r} * radian = deg = ° = degrees
arcminute = {math.pi / 10800!r} * radian = arcmin = arc_minute
arcsecond = {math.pi / 648000!r} * radian = arcsec = arc_second = as
turn = {2 * math.pi!r} * radian = revolution = rev
gradian = {math.pi / 200!r} * radian = gon = grad
revolution_per_minute = {math.pi / 30!r} * radian / second = rpm
earth_rate_unit = 7.292115e-5 * radian / second = eru
standard_gravity = 9.80665 * meter / second ** 2 = g = g_0 = g_n = gee
galileo = 0.01 * meter / second ** 2 = Gal = gal
count = [count] = _ = counts = pulse = pulses = LSB = lsb = digit
percent = 0.01 = %
ppm = 1e-6
ppb = 1e-9
kelvin = [temperature]; offset: 0 = K
degree_Celsius = kelvin; offset: 273.15 = degC = °C = celsius = degreeC
degree_Fahrenheit = 5 / 9 * kelvin; offset: 233.15 + 200 / 9 = degF = °F = degreeF
"""


@lru_cache(maxsize=1)
def registry() -> Any:
    """The pint registry of this package (built on first use)."""
    import pint

    ureg: Any = pint.UnitRegistry(None, autoconvert_offset_to_baseunit=True)
    for line in _DEFINITIONS.strip().splitlines():
        ureg.define(line)
    return ureg


_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
# What a unit may be written with. Numbers stand only in small powers and in 1/x: a power of a power could keep the
# parser busy for ever.
_UNIT = re.compile(r"[A-Za-z0-9_°µμ²³%/*^(). -]{0,60}")
_POWER = re.compile(r"\s*(?:(?:\^|\*\*)\s*(?:-?\d(?:\.\d{1,3})?|\(\s*-?\d(?:\.\d{1,3})?\s*\))(?![\w.])|[²³])")
_UNSAFE = re.compile(r"!\s*!|\^|\*\*|\)!.*\)!|(?<![A-Za-z_0-9])[0-9]|\b(?:squared?|sq|cubed|cubic)\b")


def _unit(text: str) -> Any:
    """Pint unit of a text; ``sqrt(x)`` is a power of one half."""
    bare = re.sub(r"(^|\()\s*1\s*/", r"\1/", _POWER.sub("!", text))
    if not _UNIT.fullmatch(text) or _UNSAFE.search(bare):
        raise ValueError("write units as in m/s^2 or deg/sqrt(h)")
    return registry().Unit(re.sub(r"sqrt\(([^()]*)\)", r"((\1)^0.5)", text.strip()))


def quantity(text: str, what: str = "the value") -> Any:
    """A pint quantity from text such as ``10 ug/sqrt(Hz)``.

    Parameters
    ----------
    text : str
    what : str
        What the text stands for, used in the message.

    Raises
    ------
    InputError
        If the text is no finite number with a known unit.
    """
    ureg = registry()
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise InputError(f"{what}: cannot read {text!r} as a number with a unit")
    try:
        value = ureg.Quantity(float(match[1]), _unit(match[2]))
    except Exception as cause:  # pint raises many unrelated types on bad text (tokenizer, attribute, zero division)
        raise InputError(f"{what}: cannot read {match[2]!r} in {text!r} as a unit ({cause})") from cause
    if not math.isfinite(value.magnitude):
        raise InputError(f"{what}: {text!r} is not finite")
    return value


def parse(text: str, kind: str, what: str = "the value") -> float:
    """SI value of a text with a unit.

    Parameters
    ----------
    text : str
        A number and a unit, ``45 deg``.
    kind : str
        One of :data:`KINDS`.
    what : str
        What the text stands for, used in the message.

    Returns
    -------
    float
        In the SI unit of `kind`.

    Raises
    ------
    InputError
        If the text cannot be read, has no unit, or has a unit of another kind.
    """
    si, example = KINDS[kind]
    value = quantity(text, what)
    try:
        result = float(value.to(_unit(si)).magnitude)
    except Exception as cause:
        given = f"{value.units:~}" or "no unit"
        raise InputError(
            f"{what}: {text!r} has {given} where {_article(kind)} is needed (for example {example})"
        ) from cause
    if not math.isfinite(result):
        raise InputError(f"{what}: {text!r} is not finite in {si}")
    return result


def factor(unit_text: str, kind: str, what: str = "the column") -> float:
    """What to multiply by to get SI from the named unit.

    Raises
    ------
    InputError
        If the unit is unknown or of another kind.
    """
    if not re.search(r"[A-Za-z°%µμ]", unit_text):
        raise InputError(f"{what}: {unit_text!r} is not a unit (for example {KINDS[kind][1]})")
    return parse(f"1 {unit_text}", kind, what)


def is_count(unit_text: str) -> bool:
    """Whether the unit is a bare count (count, pulse, LSB)."""
    try:
        return bool(_unit(unit_text).dimensionality == {"[count]": 1.0})
    except Exception:  # noqa: BLE001 - unknown unit: the caller's own conversion names it
        return False


_G, _DEGREE = 9.80665, math.pi / 180
_FACTORS = {
    ("m/s^2", "mg"): 1e3 / _G,
    ("m/s^2", "ug"): 1e6 / _G,
    ("rad/s", "deg/s"): 1 / _DEGREE,
    ("rad/s", "deg/h"): 3600 / _DEGREE,
    ("rad", "deg"): 1 / _DEGREE,
    ("rad", "arcsec"): 3600 / _DEGREE,
    ("1", ""): 1.0,
    ("1", "ppm"): 1e6,
    ("m", "mm"): 1e3,
    ("s", "ms"): 1e3,
    ("s", "us"): 1e6,
}
"""Of what results are printed in most: to know these, nobody waits for the registry, which takes a quarter of a second."""


def convert(value: float, si_unit: str, unit_text: str) -> float:
    """Value in another unit of the same kind, for printing.

    Parameters
    ----------
    value : float
    si_unit, unit_text : str
        Unit of `value` and unit wanted; an empty text or ``1`` is dimensionless.
    """
    known = 1.0 if si_unit == unit_text else _FACTORS.get((si_unit, unit_text))
    if known is not None:
        return value * known
    scale = registry().Quantity(1.0, _unit(_named(si_unit)))
    return float(value * scale.to(_unit(_named(unit_text))).magnitude)


def _named(unit_text: str) -> str:
    return "" if unit_text == "1" else unit_text


def _article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"
