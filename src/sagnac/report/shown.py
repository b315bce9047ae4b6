"""Numbers as a report shows them: a unit and as many digits as the expanded uncertainty deserves."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .. import units
from ..calibration import Value
from ..errors import InputError
from ..printed import printed
from .style import common_unit, pretty

BLANK = "\N{NO-BREAK SPACE}"
MINUS = "\N{MINUS SIGN}"
NOT_STATED = "not stated"
_FAR = 30.0
"""Times the smallest uncertainty of a group up to which a parameter has the digits of the group."""
_OPTION = re.compile(r"\s*\((?:[^()]*\s)?--[a-z][^()]*\)|;?\s*see --[a-z-]+")
_KEY_ALONE = re.compile(r"\s*\((?:unit|rig)\.[a-z_.]+\)")


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


def term_of(name: str) -> str:
    """The name without its axes, which like parameters share: ``gyro.misalignment`` of ``gyro.misalignment.xy``."""
    head, _, axes = name.rpartition(".")
    return head if head and len(axes) <= 2 and not set(axes) - set("xyz") else name


def scales_of(parameters: Sequence[Value], expanded: Sequence[float]) -> dict[str, Scale]:
    """How parameters are shown: those of one term of a sensor in one unit, and with the same digits.

    Unit and digits are those of the smallest uncertainty of the term; a parameter that is known far worse has digits of its own.
    Where all are exact, each is by itself.

    Parameters
    ----------
    parameters : sequence of Value
    expanded : sequence of float
        SI.

    Returns
    -------
    dict of str to Scale
        By name.
    """
    groups: dict[tuple[str, str], list[tuple[Value, float]]] = {}
    for p, size in zip(parameters, expanded, strict=True):
        groups.setdefault((term_of(p.name), p.unit), []).append((p, size))
    out: dict[str, Scale] = {}
    for own in groups.values():
        sizes = np.array([size for _, size in own])
        known = sizes[sizes > 0]
        if not known.size:
            out |= {p.name: scale_of(p, size) for p, size in own}
            continue
        si_unit, least = own[0][0].unit, float(known.min())
        unit = common_unit(np.array([p.value for p, _ in own]), known.min(keepdims=True), si_unit)
        factor = convert(1.0, si_unit, unit)
        for p, size in own:
            deserved = size if size > _FAR * least else least
            out[p.name] = Scale(unit, factor, max(0, 1 - math.floor(math.log10(deserved * factor))))
    return out


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
    return f"{value + 0.0:.{digits}g}{BLANK}{pretty(unit)}".replace("-", MINUS).strip()


def moment(text: str) -> str:
    """A time of ISO 8601 as a person reads it; other texts as they are."""
    try:
        at = datetime.datetime.fromisoformat(text)
    except ValueError:
        return text
    return f"{at:%Y-%m-%d %H:%M:%S}" + (" UTC" if at.utcoffset() == datetime.timedelta(0) else f" {at:%z}".rstrip())


def plain_words(text: str, words: Mapping[str, str] | None = None) -> str:
    """A message of the program in the words of a report: without options of the command line and keys of files.

    Parameters
    ----------
    text : str
    words : mapping of str to str, optional
        What stands for which key; longer keys go first.
    """
    text = _KEY_ALONE.sub("", _OPTION.sub("", text))
    for key, said in sorted((words or {}).items(), key=lambda kv: -len(kv[0])):
        text = re.sub(rf"(?<![\w.]){re.escape(key)}(?![\w.]*\w)", said, text)
    return text
