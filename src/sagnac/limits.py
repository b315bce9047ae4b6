"""Limits on parameters, and the rule by which a result with an uncertainty is judged against them.

Sources: ISO/IEC Guide 98-4 = JCGM 106:2012 (section 7, probability of conformity; section 8, guard bands) and ILAC-G8:09/2019
(guarded acceptance with a guard band of the expanded uncertainty; simple acceptance).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .errors import InputError

if TYPE_CHECKING:
    from .calibration import Calibration, Value

Rule = Literal["guarded acceptance", "simple acceptance"]
RULES: dict[Rule, str] = {
    "guarded acceptance": (
        "Guarded acceptance (ISO/IEC Guide 98-4, 8.3; ILAC-G8:09/2019, 4.2.3) with a guard band w = U on both sides: "
        "a parameter passes "
        "where its value lies inside the limits by at least U, fails where it lies outside by more than U, and is "
        "undecided in between. The "
        "probability that a parameter that passes is outside its limits is at most {risk}."
    ),
    "simple acceptance": (
        "Simple acceptance (ISO/IEC Guide 98-4, 8.2; ILAC-G8:09/2019, 4.2.1), without a guard band: a parameter "
        "passes where its value lies "
        "inside the limits or on them, and fails otherwise. The probability that a parameter that passes is outside "
        "its limits may "
        "be as high as 50 %; it is stated for each."
    ),
}


@dataclass(frozen=True)
class Limit:
    """What a parameter may be, in its own SI unit; infinite where there is no bound."""

    lower: float
    upper: float

    def written(self) -> dict[str, float | None]:
        """Both bounds as JSON has them, which knows no infinite numbers: None where there is none."""
        return {k: v if math.isfinite(v) else None for k, v in (("lower", self.lower), ("upper", self.upper))}


@dataclass(frozen=True)
class Limits:
    """Limits by name or pattern of parameters, as written, and the rule to judge by."""

    table: Mapping[str, Any]
    rule: Rule = "guarded acceptance"
    specification: str = ""
    source: str = "limits"


@dataclass(frozen=True)
class Decision:
    """What came of one limit.

    Attributes
    ----------
    parameter : Value
    limit : Limit
    passed : bool or None
        None: undecided.
    probability : float
        That the parameter lies inside its limits (JCGM 106:2012, 7.2 and 7.4).
    """

    parameter: Value
    limit: Limit
    passed: bool | None
    probability: float


def load(path: str | Path) -> Limits:
    """Read limits.

    Parameters
    ----------
    path : path of a TOML file
        ``rule``, ``specification`` and a table ``[limits]`` with a parameter or a pattern (``accel.bias.*``) a line: the
        largest size (``"1 mg"``), both bounds (``["-1 mg", "2 mg"]``), or one (``{ upper = "2 mg" }``).

    Raises
    ------
    InputError
        With the key at fault and what to write instead.
    """
    from pydantic import ConfigDict, Field, create_model

    from .plan import read_toml
    from .quantities import checked

    table = create_model(  # made here: who only judges needs no pydantic
        "Table",
        __config__=ConfigDict(frozen=True, extra="forbid"),
        rule=(Rule, "guarded acceptance"),
        specification=(str, ""),
        limits=(dict[str, Any], Field(min_length=1)),
    )
    given: Any = checked(table, read_toml(path, "limits"), str(path))
    return Limits(given.limits, given.rule, given.specification, str(path))


def assign(limits: Limits, calibration: Calibration) -> dict[str, Limit]:
    """Limits of the parameters of a calibration that have one, by name.

    An exact name goes before a pattern.

    Raises
    ------
    InputError
        When a key meets no parameter, two patterns meet the same one, or a bound is of another unit.
    """
    keys = {p.name: key_of(limits, p.name) for p in calibration.parameters}
    found = {name: key for name, key in keys.items() if key is not None}
    for key in limits.table:
        if not any(meets(key, name) for name in keys):
            raise InputError(
                f"{limits.source}: {key!r} meets no parameter of the calibration; it has "
                f"{', '.join(calibration.values())}"
            )
    return {
        name: bounds(limits.table[key], calibration[name].unit, f"{limits.source}: {key}")
        for name, key in found.items()
    }


def meets(key: str, name: str) -> bool:
    """Whether a key, a name or a pattern, means a parameter."""
    return key == name or fnmatchcase(name, key)


def key_of(limits: Limits, name: str) -> str | None:
    """The key that counts for a parameter: its name, or else the pattern that meets it; None where none does.

    Raises
    ------
    InputError
        When two patterns do.
    """
    if name in limits.table:
        return name
    keys = [k for k in limits.table if fnmatchcase(name, k)]
    if len(keys) > 1:
        raise InputError(f"{limits.source}: {name} is met by {keys[0]!r} and {keys[1]!r}; give it a line of its own")
    return keys[0] if keys else None


def bounds(given: Any, unit: str, where: str) -> Limit:
    """The bounds of one limit, as a file of limits has them.

    Parameters
    ----------
    given : str, list or dict
        The largest size, both bounds, or a table of ``lower`` and ``upper``.
    unit : str
        SI unit of the parameter.
    where : str
        For messages.

    Raises
    ------
    InputError
        For what is no limit, or is of another unit.
    """
    from .quantities import si

    def bound(text: Any) -> float:
        try:
            return si(text, unit, _example(unit))
        except ValueError as cause:
            raise InputError(f"{where}: {cause}") from cause

    if isinstance(given, dict):
        if not given or set(given) - {"lower", "upper"}:
            raise InputError(f"{where}: write lower, upper or both; got {', '.join(given) or 'nothing'}")
        lower = bound(given["lower"]) if "lower" in given else -math.inf
        upper = bound(given["upper"]) if "upper" in given else math.inf
    elif isinstance(given, list):
        if len(given) != 2:
            raise InputError(f"{where}: write the lower and the upper bound in the brackets")
        lower, upper = bound(given[0]), bound(given[1])
    else:
        size = bound(given)
        if size < 0:
            raise InputError(f"{where}: {given!r} is negative; one bound alone is the largest size")
        lower, upper = -size, size
    if not lower < upper:
        raise InputError(f"{where}: the lower bound is not below the upper one")
    return Limit(lower, upper)


def _example(unit: str) -> str:
    return {"m/s^2": "1 mg", "rad/s": "0.1 deg/h", "rad": "10 arcsec", "1": "100 ppm"}.get(unit, f"1 {unit}")


def judge(value: float, limit: Limit, expanded: float, rule: Rule) -> bool | None:
    """Whether a value keeps its limits: yes, no, or None for undecided.

    Parameters
    ----------
    value, expanded : float
        SI; the expanded uncertainty is the guard band of guarded acceptance.
    limit : Limit
    rule : str
    """
    guard = expanded if rule == "guarded acceptance" else 0.0
    if limit.lower + guard <= value <= limit.upper - guard:
        return True
    if rule == "simple acceptance" or value < limit.lower - guard or value > limit.upper + guard:
        return False
    return None


def decide(parameter: Value, limit: Limit, expanded: float, dof: float, rule: Rule) -> Decision:
    """Judge one parameter.

    Parameters
    ----------
    parameter : Value
    limit : Limit
    expanded : float
        Its expanded uncertainty, the guard band of guarded acceptance.
    dof : float
        Degrees of freedom of its standard uncertainty; infinite for a normal distribution.
    rule : str

    Returns
    -------
    Decision
    """
    passed = judge(parameter.value, limit, expanded, rule)
    return Decision(parameter, limit, passed, _probability(parameter, limit, dof))


def _probability(parameter: Value, limit: Limit, dof: float) -> float:
    """Probability of conformity: normal, or Student's for few degrees of freedom."""
    from scipy.special import ndtr, stdtr

    sigma = parameter.standard_uncertainty
    if sigma == 0:
        return float(limit.lower <= parameter.value <= limit.upper)

    def below(bound: float) -> float:
        if math.isinf(bound):
            return 1.0 if bound > 0 else 0.0
        z = (bound - parameter.value) / sigma
        return float(ndtr(z) if math.isinf(dof) else stdtr(dof, z))

    return below(limit.upper) - below(limit.lower)


def outcome(decisions: Mapping[str, Decision]) -> bool | None:
    """All of them together: failed where one fails, undecided where one is."""
    return together([d.passed for d in decisions.values()])


def together(every: Sequence[bool | None]) -> bool | None:
    """False where one is, None where one is undecided, else True."""
    if any(p is False for p in every):
        return False
    return None if any(p is None for p in every) else True
