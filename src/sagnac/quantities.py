"""Quantities in records that are read from TOML: a text with its unit becomes SI, and a wrong one is refused with an example."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator

from . import units
from .errors import InputError


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
