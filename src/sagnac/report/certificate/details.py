"""What a certificate says that no log knows: laboratory, customer, dates, people, standards; read from TOML."""

from __future__ import annotations

import datetime
import math
import re
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, model_validator

from ... import units
from ...calibration import Calibration
from ...errors import InputError
from ...plan import read_toml
from ...quantities import checked
from ...results import Record

# pascals of the units that a barometer shows; the registry of units has no pressure
_PRESSURES = {"Pa": 1.0, "hPa": 100.0, "kPa": 1e3, "mbar": 100.0, "bar": 1e5, "mmHg": 133.322, "inHg": 3386.39}
_POSSIBLE = {"temperature": (0.0, math.inf), "ratio": (0.0, 1.0), "pressure": (math.ulp(0.0), math.inf)}
"""Least and greatest, SI."""
_IMPOSSIBLE = {
    "temperature": "there is no such temperature",
    "ratio": "relative humidity lies between 0 % and 100 %",
    "pressure": "a pressure is positive",
}
_RANGE = re.compile(r"\s*(-?[\d.]+(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)


def _day(given: Any) -> str:
    """A day as TOML date or ISO text; anything else is refused."""
    if isinstance(given, datetime.datetime):
        return given.date().isoformat()
    if isinstance(given, datetime.date):
        return given.isoformat()
    try:
        return datetime.date.fromisoformat(str(given)).isoformat()
    except ValueError as cause:
        raise ValueError(f"write a date as 2026-11-22; got {given!r}") from cause


def _days(given: Any) -> str:
    """A day, or the first and the last of some."""
    if not isinstance(given, list | tuple):
        return _day(given)
    if len(given) != 2:
        raise ValueError("write one date, or the first and the last in brackets")
    first, last = _day(given[0]), _day(given[1])
    if last < first:
        raise ValueError(f"{last} is before {first}")
    return f"{first} to {last}"


def _measured(kind: str) -> BeforeValidator:
    """Reader of one quantity, or of the least and the greatest in brackets; kept as the person wrote it."""

    def read(given: Any) -> str:
        both = list(given) if isinstance(given, list | tuple) else [given]
        if len(both) not in (1, 2) or not all(isinstance(b, str) for b in both):
            raise ValueError("write a text with its unit, or the least and the greatest in brackets")
        values = [_value(b, kind) for b in both]
        low, high = _POSSIBLE[kind]
        for said, value in zip(both, values, strict=True):
            if not low <= value <= high:
                raise ValueError(f"{said!r}: {_IMPOSSIBLE[kind]}")
        if len(values) == 2 and values[1] < values[0]:
            raise ValueError(f"{both[1]!r} is below {both[0]!r}")
        return " to ".join(b.strip() for b in both)

    return BeforeValidator(read)


def _value(text: str, kind: str) -> float:
    if kind != "pressure":
        try:
            return units.parse(text, kind, "it")
        except InputError as cause:
            raise ValueError(str(cause).removeprefix("it: ")) from cause
    match = _RANGE.fullmatch(text)
    if match is None or match[2] not in _PRESSURES:
        raise ValueError(f"{text!r} is no pressure (for example 1013 hPa; known: {', '.join(_PRESSURES)})")
    value = float(match[1]) * _PRESSURES[match[2]]
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value


Day = Annotated[str, BeforeValidator(_day)]
Days = Annotated[str, BeforeValidator(_days)]


class Party(Record):
    """The laboratory or the customer."""

    name: str = ""
    address: str = ""
    contact: str = ""
    accreditation: str = ""


class Item(Record):
    """The unit, as far as the calibration file does not name it."""

    description: str = ""
    manufacturer: str = ""
    condition: str = ""
    adjustment: str = ""
    received: Day = ""


class Environment(Record):
    """Conditions during the calibration, as written by the operator."""

    temperature: Annotated[str, _measured("temperature")] = ""
    humidity: Annotated[str, _measured("ratio")] = ""
    pressure: Annotated[str, _measured("pressure")] = ""
    remarks: str = ""


class Standard(Record):
    """A standard or an instrument that the calibration rests on."""

    name: str
    identifier: str = ""
    certificate: str = ""
    valid_until: Day = ""
    issued_by: str = ""


class Details(Record):
    """What a certificate says besides the calibration; an empty text is shown as not stated. See :func:`load`."""

    number: str = ""
    issued: Day = ""
    calibrated: Days = ""
    place: str = ""
    operator: str = ""
    approved_by: str = ""
    approver_function: str = ""
    traceability: str = ""
    remarks: tuple[str, ...] = ()
    laboratory: Party = Party()
    customer: Party = Party()
    item: Item = Item()
    environment: Environment = Environment()
    standard: tuple[Standard, ...] = ()

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        """Received, calibrated and issued follow one another; ISO dates are in the order of their texts."""
        first, last = self.calibrated[:10], self.calibrated[-10:]
        steps = (
            ("item.received", self.item.received, "calibrated", first),
            ("calibrated", last, "issued", self.issued),
            ("item.received", self.item.received, "issued", self.issued),
        )
        for earlier, day, later, other in steps:
            if day and other and other < day:
                raise ValueError(f"{later}: {other} is before {day} ({earlier})")
        return self


def load(path: str | Path) -> Details:
    """Read the details of a certificate.

    Parameters
    ----------
    path : path of a TOML file

    Raises
    ------
    InputError
        With the key at fault and what to write instead.
    """
    return checked(Details, read_toml(path, "details"), str(path))


def concerns(details: Details, calibration: Calibration) -> tuple[str, ...]:
    """What speaks against the certificate and does not prevent it: standards that were no longer valid.

    Parameters
    ----------
    details : Details
    calibration : Calibration
        Its date counts where the details give none.
    """
    day, what = (
        (details.calibrated[-10:], "the calibration")
        if details.calibrated
        else (
            calibration.created[:10],
            "the evaluation",
        )
    )
    return tuple(
        f"the standard {s.name!r} was valid until {s.valid_until}, before {what} of {day}"
        for s in details.standard
        if s.valid_until and s.valid_until < day
    )
