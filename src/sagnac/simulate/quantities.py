"""Texts with units in a scenario: one reader for every unit, and sizes that are drawn."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from .. import units
from ..errors import InputError

_LAW = re.compile(r"\s*(normal|uniform|sign)\s+(.*)", re.DOTALL)


@dataclass(frozen=True)
class Drawn:
    """A truth that is given, or drawn with the seed.

    Attributes
    ----------
    law : str
        ``exact`` is the value itself, ``normal`` has it as standard deviation, ``uniform`` as bound on both sides, and
        ``sign`` is the value with either sign.
    size : float, SI
    """

    law: Literal["exact", "normal", "uniform", "sign"]
    size: float

    def draw(self, rng: np.random.Generator) -> float:
        """A value, SI; random numbers are used whatever the law is, so that one law does not shift the other draws."""
        normal, uniform = float(rng.standard_normal()), float(rng.uniform(-1.0, 1.0))
        shape = {"exact": 1.0, "normal": normal, "uniform": uniform, "sign": math.copysign(1.0, uniform)}
        return self.size * shape[self.law]


def si(text: object, unit: str, example: str) -> float:
    """SI value of a text with a unit.

    Parameters
    ----------
    text : object
        What the file holds; anything but a text (or a plain number where the unit is ``1``) is refused.
    unit : str
        SI unit wanted, ``1`` for ratios.
    example : str
        For the message.

    Raises
    ------
    ValueError
        With what is wrong and how to write it.
    """
    if unit == "1" and isinstance(text, int | float) and not isinstance(text, bool):
        text = repr(text)
    if not isinstance(text, str):
        raise ValueError(f"write it as a text with its unit, for example {example!r}; got {text!r}")  # noqa: TRY004 - pydantic's
    try:
        value = units.quantity(text, "it")
    except InputError as cause:
        raise ValueError(str(cause).removeprefix("it: ")) from cause
    wanted = units.quantity("1" if unit == "1" else f"1 {unit}").units
    try:
        result = float(value.to(wanted).magnitude)
    except Exception as cause:
        given = f"{value.units:~}" or "no unit"
        raise ValueError(f"{text!r} has {given} where {unit} is needed (for example {example!r})") from cause
    if not math.isfinite(result):
        raise ValueError(f"{text!r} is not finite in {unit}")
    return result


def reads(unit: str, example: str) -> BeforeValidator:
    """Reader of a text with a unit, for ``Annotated[float, reads("Hz", "100 Hz")]``."""
    return BeforeValidator(lambda given: si(given, unit, example))


def drawn(unit: str, example: str) -> BeforeValidator:
    """Reader of a :class:`Drawn`: ``"5 arcsec"``, ``"normal 5 arcsec"``, ``"uniform 1 arcmin"``, ``"sign 5 arcsec"``."""
    return BeforeValidator(lambda given: draws(given, unit, example))


def drawn_each(count: int, unit: str, example: str) -> BeforeValidator:
    """Reader of several :class:`Drawn`: a list, or one text for all of them."""

    def read(given: object) -> tuple[Drawn, ...]:
        parts = given if isinstance(given, list | tuple) else [given] * count
        if len(parts) != count:
            raise ValueError(f"{len(parts)} values where {count} are needed")
        return tuple(draws(part, unit, example) for part in parts)

    return BeforeValidator(read)


def draws(given: object, unit: str, example: str) -> Drawn:
    """A :class:`Drawn` from its text; raises ValueError as :func:`si` does."""
    if isinstance(given, Drawn):
        return given
    match = _LAW.fullmatch(given) if isinstance(given, str) else None
    if match is None:
        return Drawn("exact", si(given, unit, example))
    size = si(match[2], unit, example)
    if size < 0:
        raise ValueError(f"{given!r}: a drawn value has a size, which is not negative")
    law: Any = match[1]
    return Drawn(law, size)


def as_list(given: object) -> object:
    """A single value as a list of one."""
    return given if isinstance(given, list | tuple) else [given]


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError(f"{value:g} is negative; it is a size")
    return value


def _positive(value: float) -> float:
    if not value > 0:
        raise ValueError(f"{value:g} is not above zero")
    return value


SIZE = AfterValidator(_not_negative)
"""Refuses a negative value."""
ABOVE_ZERO = AfterValidator(_positive)
"""Refuses a value that is not above zero."""
AS_LIST = BeforeValidator(as_list)

Frequency = Annotated[float, reads("Hz", "100 Hz"), ABOVE_ZERO]
Duration = Annotated[float, reads("s", "60 s"), SIZE]
Temperature = Annotated[float, reads("K", "25 degC")]
Ratio = Annotated[float, reads("1", "100 ppm")]
Acceleration = Annotated[float, reads("m/s^2", "50 ug"), SIZE]
Rate = Annotated[float, reads("rad/s", "0.01 deg/h"), SIZE]
AccelDensity = Annotated[float, reads("m/s^2/Hz^0.5", "10 ug/sqrt(Hz)"), SIZE]
GyroDensity = Annotated[float, reads("rad/s/Hz^0.5", "0.001 deg/sqrt(h)"), SIZE]
AccelWalk = Annotated[float, reads("m/s^2/s^0.5", "1 ug/sqrt(h)"), SIZE]
GyroWalk = Annotated[float, reads("rad/s/s^0.5", "0.001 deg/h/sqrt(h)"), SIZE]
