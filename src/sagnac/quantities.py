"""Quantities in records that are read from TOML: a text with its unit becomes SI, and a wrong one is refused with an example."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ValidationError, ValidationInfo

from . import units
from .errors import InputError

_Model = TypeVar("_Model", bound=BaseModel)


def checked(model: type[_Model], table: object, name: str, place: str = "") -> _Model:
    """A record of the table that a file holds.

    Parameters
    ----------
    model : type of record
    table : object
    name : str
        Of the file, for messages.
    place : str
        Key of the table in the file.

    Raises
    ------
    InputError
        With the keys at fault and what to write instead.
    """
    try:
        return model.model_validate(table, context={"file": True})
    except ValidationError as cause:
        told = [problem(e, place) for e in cause.errors() if not _other_choice(e)]
        raise InputError(f"{name}: " + "; ".join(dict.fromkeys(told))) from cause


def problem(error: Mapping[str, Any], place: str) -> str:
    """One complaint of pydantic with the key in front, `place` being the key of the table."""
    own = [str(p) for p in error["loc"] if "[" not in str(p)]
    what = {"extra_forbidden": "no such key", "missing": "is missing"}.get(
        error["type"], str(error["msg"]).removeprefix("Value error, ")
    )
    return f"{'.'.join([place] * bool(place) + own) or 'the file'}: {what}"


def _other_choice(error: Mapping[str, Any]) -> bool:
    """Whether pydantic complains only that a name is no list, or a list no name."""
    branch = {str(p).partition("[")[0] for p in error["loc"] if "[" in str(p)}
    a_name = isinstance(error["input"], str)
    return ("literal" in branch and not a_name) or ("tuple" in branch and a_name and error["type"] == "tuple_type")


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


@dataclass(frozen=True)
class Reader:
    """Reads a text with a unit, or in Python, where there is no file, a number in SI; knows its unit, for writing."""

    unit: str
    example: str

    def __call__(self, given: object, info: ValidationInfo) -> float:
        """The value in SI; raises as :func:`si` does."""
        from_file = info.context is not None and "file" in info.context
        if isinstance(given, int | float) and not isinstance(given, bool) and not from_file:
            if not math.isfinite(given):
                raise ValueError(f"{given} is not finite")
            return float(given)
        return si(given, self.unit, self.example)


def takes(unit: str, example: str) -> BeforeValidator:
    """A :class:`Reader` for ``Annotated[float, takes("m", "1.5 m")]``."""
    return BeforeValidator(Reader(unit, example))


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
