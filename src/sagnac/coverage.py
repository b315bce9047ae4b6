"""Expanded uncertainty: coverage factor, coverage probability, degrees of freedom.

JCGM 100:2008 (GUM) 6.2 and 6.3 for ``U = k u``; G.3 and G.6.4 for few degrees of freedom, where the factor is that of Student's
distribution at the probability that `k` has in a normal one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .errors import InputError

if TYPE_CHECKING:
    from .calibration import Calibration, Value

MANY = 100.0
"""Degrees of freedom from which Student's factor is the normal one within 3 %."""


@dataclass(frozen=True)
class Coverage:
    """How the uncertainties of a certificate are expanded.

    Attributes
    ----------
    k : float
        As asked for.
    probability : float
        That a normal distribution has within k standard deviations.
    dof : mapping of str to float
        Degrees of freedom of each parameter's standard uncertainty; infinite where the noise was known.
    factors : mapping of str to float
        Coverage factor of each parameter.
    """

    k: float
    probability: float
    dof: Mapping[str, float]
    factors: Mapping[str, float]

    def expanded(self, parameter: Value) -> float:
        """Expanded uncertainty of a parameter, SI."""
        return self.factors[parameter.name] * parameter.standard_uncertainty

    @property
    def one_factor(self) -> bool:
        """Whether all parameters share the factor that was asked for."""
        return all(f == self.k for f in self.factors.values())

    def statement(self) -> str:
        """What a certificate has to say about its uncertainties, in a few sentences."""
        text = (
            "The reported expanded uncertainty U = k u is the standard uncertainty u multiplied by the coverage factor "
            f"k = {self.k:g}, which for a normal distribution corresponds to a coverage probability of approximately "
            f"{100 * self.probability:.4g} %. It was evaluated according to JCGM 100:2008 (GUM)."
        )
        if not self.one_factor:
            text += (
                f" Where the standard uncertainty rests on the scatter of few data, with fewer than {MANY:g} degrees of freedom "
                "ν, k is that of Student's t-distribution with ν for the same coverage probability (GUM G.3), and it is stated "
                "with the parameter."
            )
        without = [name for name, v in self.dof.items() if v < 1]
        if without:
            text += (
                f" Of {', '.join(without)} the scatter has no degrees of freedom left: no coverage probability can be stated, "
                f"and k = {self.k:g} is a number only."
            )
        return text


def cover(calibration: Calibration, k: float = 2.0) -> Coverage:
    """Coverage factors of the parameters.

    Parameters
    ----------
    calibration : Calibration
    k : float
        Coverage factor in a normal distribution.

    Raises
    ------
    InputError
        When `k` is not between 1 and 5.
    """
    if not 1.0 <= k <= 5.0:
        raise InputError(f"a coverage factor of {k:g} is of no use: 2 is usual, 1 to 5 can be stated")
    dof = {p.name: degrees_of_freedom(calibration, p.name) for p in calibration.parameters}
    return Coverage(k, _probability(k), dof, {name: factor(v, k) for name, v in dof.items()})


def factor(dof: float, k: float = 2.0) -> float:
    """Coverage factor of a standard uncertainty that has so many degrees of freedom.

    Parameters
    ----------
    dof : float
    k : float
        Coverage factor in a normal distribution.

    Returns
    -------
    float
        Student's at the same probability; `k` where they are many, and where there are none to speak of.
    """
    if not 1 <= dof < MANY:
        return k
    from scipy.special import stdtrit

    return float(stdtrit(dof, 0.5 * (1.0 + _probability(k))))


def _probability(k: float) -> float:
    """That a normal distribution has within k standard deviations."""
    return math.erf(k / math.sqrt(2.0))


def degrees_of_freedom(calibration: Calibration, name: str) -> float:
    """Degrees of freedom of one standard uncertainty.

    White uncertainties follow from a noise that was stated or measured over many samples, the others from the scatter of
    segments: of the fit's degrees of freedom, but of no more than one less than there are segments to leave out.

    Parameters
    ----------
    calibration : Calibration
    name : str
        Of the parameter.

    Returns
    -------
    float
        Infinite where the noise was known.
    """
    used = _kind(calibration.fit.uncertainty, name)
    if used == "white":
        return math.inf
    dof = float(calibration.fit.degrees_of_freedom)
    if used == "delete-one-segment" and calibration.fit.influence:
        dof = min(dof, len({i.segment for i in calibration.fit.influence}) - 1.0)
    return dof


def _kind(stated: str, name: str) -> str:
    """Which uncertainty a parameter has, where ``fit.uncertainty`` names several (``accelerometers: white / gyros: scaled``)."""
    parts = dict(_labelled(p) for p in stated.split(" / "))
    own = [
        used for label, used in parts.items() if label and name.startswith(("accel", "gyro")) and label[:4] == name[:4]
    ]
    if own:
        return own[0]
    return next((used for used in parts.values() if used != "white"), "white")


def _labelled(part: str) -> tuple[str, str]:
    label, _, used = part.rpartition(": ")
    return label, used
