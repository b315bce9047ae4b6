"""Units in which errors are told to a person."""

from __future__ import annotations

from .. import units
from ..printed import printed

_DENSITIES = {
    "m/s^2/Hz^0.5": "ug/sqrt(Hz)",
    "rad/s/Hz^0.5": "deg/sqrt(h)",
    "m/s^2/s^0.5": "ug/sqrt(h)",
    "rad/s/s^0.5": "deg/h/sqrt(h)",
}
"""Noise coefficients in the units of data sheets."""


def shown_unit(size: float, si_unit: str) -> tuple[str, float]:
    """Unit in which something of this size has a convenient number, and the factor to it from SI.

    Parameters
    ----------
    size : float
        SI.
    si_unit : str
    """
    unit = _DENSITIES.get(si_unit) or printed(0.0, size / 30.0, si_unit)[2]
    return unit, units.convert(1.0, si_unit, unit) if unit != si_unit else 1.0
