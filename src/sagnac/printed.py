"""Numbers with their uncertainty as text, with as many digits as it deserves, in a unit of convenient size."""

from __future__ import annotations

import math

from . import units

# SI unit -> units to print it in, coarse to fine
_PRINTED = {
    "m/s^2": ("mg", "ug"),
    "rad/s": ("deg/s", "deg/h"),
    "1": ("", "ppm"),
    "rad": ("deg", "arcsec"),
    "count": ("count",),
    "m": ("m", "mm"),
    "rad*s/m": ("deg/h/g",),
    "s^2/m": ("ug/g^2",),
    "s^4/m^2": ("ug/g^3",),
    "rad*s^3/m^2": ("deg/h/g^2",),
    "s": ("ms", "us"),
}
_LARGE, _LARGEST = ("rad", "rad/s"), 5e4
"""Angles and rates of more than this many fine units are printed in the coarse one, with more digits."""


def printed(value: float, sigma: float, si_unit: str, unit: str | None = None) -> tuple[str, str, str]:
    """Value and uncertainty as text with as many digits as the uncertainty deserves, and their unit.

    Parameters
    ----------
    value, sigma : float
    si_unit : str
        Unit of both.
    unit : str, optional
        To print in; left out, one in which the uncertainty has a convenient size.

    Returns
    -------
    value, sigma, unit : str
    """
    unit_text = _unit_for(value, sigma, si_unit) if unit is None else unit
    size = units.convert(1.0, si_unit, unit_text) if unit_text != si_unit else 1.0
    v, s = value * size, sigma * size
    if s > 0 and math.isfinite(s):
        digits = max(0, 1 - math.floor(math.log10(s)))
        if digits > 9:
            return f"{v:.12g}", f"{s:.1e}", unit_text
        return f"{round(v, digits) + 0.0:.{digits}f}", f"{s:.{digits}f}", unit_text  # no minus before nothing
    return f"{v + 0.0:.9g}", "-" if s == 0 else f"{s:.2g}", unit_text


def _unit_for(value: float, sigma: float, si_unit: str) -> str:
    """The coarsest unit in which the uncertainty is not lost in the decimals."""
    choices = _PRINTED.get(si_unit)
    if choices is None:
        return si_unit
    found = choices[-1]
    for choice in choices:
        size = abs(units.convert(1.0, si_unit, choice))
        if sigma * size >= 0.01 or (sigma == 0 and abs(value) * size >= 1):
            found = choice
            break
    return choices[0] if si_unit in _LARGE and abs(value * units.convert(1.0, si_unit, found)) >= _LARGEST else found


def probability(p_value: float) -> str:
    """A probability as text: that of a chi-square far below its degrees of freedom does not read as certainty.

    Parameters
    ----------
    p_value : float

    Returns
    -------
    str
        To follow the word "probability".
    """
    if p_value > 0.999:
        return "> 0.999"
    return f"{p_value:.3g}" if p_value > 0.99 else f"{p_value:.2g}"
