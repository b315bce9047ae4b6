"""Numbers as a report shows them: a unit and as many digits as the expanded uncertainty deserves."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass

from .. import units
from ..calibration import Value, printed
from ..errors import InputError
from .style import pretty

BLANK = "\N{NO-BREAK SPACE}"
MINUS = "\N{MINUS SIGN}"
NOT_STATED = "not stated"


@dataclass(frozen=True)
class Scale:
    """How one parameter is shown.

    Attributes
    ----------
    unit : str
        As printed; empty for a plain number.
    size : float
        Factor from SI.
    digits : int
        After the point.
    """

    unit: str
    size: float
    digits: int

    def text(self, value: float, more: int = 0) -> str:
        """A value in SI as a text, with some more digits if asked for."""
        if not math.isfinite(value):
            return "–"
        number = value * self.size
        digits = self.digits + more
        if digits > 9:
            return f"{number:.3g}".replace("-", MINUS)
        text = f"{number:.{digits}f}"
        return text.removeprefix("-") if not text.strip("-0.") else text.replace("-", MINUS)

    @property
    def unit_text(self) -> str:
        """The unit as it is set in print, ``1`` for a plain number."""
        return pretty(self.unit) or "1"


def scale_of(parameter: Value, expanded: float) -> Scale:
    """How a parameter with this expanded uncertainty is shown: two digits of the uncertainty (GUM 7.2.6).

    Parameters
    ----------
    parameter : Value
    expanded : float
        SI.
    """
    _, sigma, unit = printed(parameter.value, expanded, parameter.unit)
    size = convert(1.0, parameter.unit, unit)
    if "e" in sigma or not sigma[:1].isdigit():
        shown = expanded * size
        return Scale(unit, size, 1 - math.floor(math.log10(shown)) if shown > 0 else 6)
    return Scale(unit, size, len(sigma.partition(".")[2]))


def convert(value: float, si_unit: str, unit: str) -> float:
    """:func:`sagnac.units.convert`, leaving alone what is in no known unit."""
    if unit == si_unit:
        return value
    try:
        return units.convert(value, si_unit, unit)
    except InputError:
        return value


def or_not_stated(text: str) -> str:
    """The text, or the words that it was not given."""
    return text.strip() or NOT_STATED


def percent(probability: float) -> str:
    """A probability in percent, never rounded to certainty."""
    if probability > 0.9995:
        return f">{BLANK}99.9{BLANK}%"
    return f"<{BLANK}0.1{BLANK}%" if probability < 0.0005 else f"{100 * probability:.1f}{BLANK}%"


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A number with its unit."""
    return f"{value:.{digits}g}{BLANK}{pretty(unit)}".replace("-", MINUS).strip()


def moment(text: str) -> str:
    """A time of ISO 8601 as a person reads it; other texts as they are."""
    try:
        at = datetime.datetime.fromisoformat(text)
    except ValueError:
        return text
    return f"{at:%Y-%m-%d %H:%M:%S}" + (" UTC" if at.utcoffset() == datetime.timedelta(0) else f" {at:%z}".rstrip())
