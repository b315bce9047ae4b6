"""Limits on parameters, and the rule by which a result with an uncertainty is judged against them.

Sources: ISO/IEC Guide 98-4 = JCGM 106:2012 (section 7, probability of conformity; section 8, guard bands) and ILAC-G8:09/2019
(guarded acceptance with a guard band of the expanded uncertainty; simple acceptance).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from ...calibration import Calibration, Value
from ...errors import InputError
from ...plan import read_toml
from ...quantities import checked, si

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


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    rule: Rule = "guarded acceptance"
    specification: str = ""
    limits: dict[str, Any] = Field(min_length=1)


@dataclass(frozen=True)
class Limit:
    """What a parameter may be, in its own SI unit; infinite where there is no bound."""

    lower: float
    upper: float


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
    table = checked(_Table, read_toml(path, "limits"), str(path))
    return Limits(table.limits, table.rule, table.specification, str(path))


def assign(limits: Limits, calibration: Calibration) -> dict[str, Limit]:
    """Limits of the parameters of a calibration that have one, by name.

    An exact name goes before a pattern.

    Raises
    ------
    InputError
        When a key meets no parameter, two patterns meet the same one, or a bound is of another unit.
    """
    found: dict[str, str] = {}
    for p in calibration.parameters:
        keys = [k for k in limits.table if k == p.name] or [k for k in limits.table if fnmatchcase(p.name, k)]
        if len(keys) > 1:
            raise InputError(
                f"{limits.source}: {p.name} is met by {keys[0]!r} and {keys[1]!r}; give it a line of its own"
            )
        if keys:
            found[p.name] = keys[0]
    for key in limits.table:
        meets = [p.name for p in calibration.parameters if key == p.name or fnmatchcase(p.name, key)]
        if not meets:
            raise InputError(
                f"{limits.source}: {key!r} meets no parameter of the calibration; it has "
                f"{', '.join(calibration.values())}"
            )
    return {
        name: _limit(limits.table[key], calibration[name], f"{limits.source}: {key}") for name, key in found.items()
    }


def _limit(given: Any, parameter: Value, where: str) -> Limit:
    def bound(text: Any) -> float:
        try:
            return si(text, parameter.unit, _example(parameter.unit))
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
    guard = expanded if rule == "guarded acceptance" else 0.0
    value = parameter.value
    passed: bool | None = None
    if limit.lower + guard <= value <= limit.upper - guard:
        passed = True
    elif rule == "simple acceptance" or value < limit.lower - guard or value > limit.upper + guard:
        passed = False
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
    every = [d.passed for d in decisions.values()]
    if any(p is False for p in every):
        return False
    return None if any(p is None for p in every) else True
