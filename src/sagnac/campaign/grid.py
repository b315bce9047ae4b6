"""Grids of values laid over a scenario's table: dotted keys to lists of values, every combination or chosen ones."""

from __future__ import annotations

import copy
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

_BY_NAME = (("unit", "parameters"), ("unit", "temperature", "coefficients"))
"""Tables whose keys are names of parameters, which have dots of their own."""
_LAW = re.compile(r"\s*(?:(normal|uniform|sign)\s+)?(.*)", re.DOTALL)


def flat(table: Mapping[str, Any], place: str = "") -> dict[str, Any]:
    """Entries of nested tables by dotted key: ``[grid.unit.noise] gyro = [...]`` is ``"unit.noise.gyro" = [...]``."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        full = f"{place}.{key}" if place else key
        out |= flat(value, full) if isinstance(value, Mapping) and value else {full: value}
    return out


def product(axes: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Every combination of the values, the last key changing first; one without values where there are no keys."""
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def parts(key: str) -> list[str]:
    """Keys of the nested tables that a dotted key leads through."""
    given = key.split(".")
    for place in _BY_NAME:
        if tuple(given[: len(place)]) == place and len(given) > len(place):
            return [*place, ".".join(given[len(place) :])]
    return given


def replaced(table: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a scenario's table with other values.

    Parameters
    ----------
    table : mapping
    values : mapping
        By dotted key. A part that is a number picks an entry of a list, counted from one: ``trajectory.leg.2.duration``.

    Raises
    ------
    ValueError
        When a key leads through something that is no table, with the key.
    """
    out = copy.deepcopy(dict(table))
    for key, value in values.items():
        *way, last = parts(key)
        here: Any = out
        for step in way:
            here = _entered(here, step, key)
        _put(here, last, value, key)
    return out


def _entered(here: Any, step: str, key: str) -> Any:
    """The table or list one step further; one that is not there yet begins empty."""
    if isinstance(here, list):
        return here[_place(here, step, key)]
    found = here.setdefault(step, {})
    if not isinstance(found, dict | list):
        raise ValueError(f"{key}: {step!r} is a value of the scenario, not a table")  # noqa: TRY004 - the user's error
    return found


def _put(here: Any, last: str, value: Any, key: str) -> None:
    if isinstance(here, list):
        here[_place(here, last, key)] = value
    else:
        here[last] = value


def _place(here: list[Any], step: str, key: str) -> int:
    if not step.isdigit() or not 1 <= int(step) <= len(here):
        raise ValueError(f"{key}: {step!r} is none of the {len(here)} entries, counted from 1")
    return int(step) - 1


def text(value: Any) -> str:
    """A value as it stands in a column of results: a text as it is, anything else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def numbers(values: Sequence[Any]) -> tuple[list[float], str] | None:
    """Values of one key as numbers, and what they are in: ``arcmin``, or ``uniform arcmin`` of laws; None where they are no such.

    Parameters
    ----------
    values : sequence
        Numbers, or texts with units of one kind.
    """
    from .. import units
    from ..errors import InputError

    if all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        return [float(v) for v in values], ""
    if not all(isinstance(v, str) for v in values):
        return None
    laws, texts = zip(*(_LAW.fullmatch(v).groups() for v in values), strict=True)  # type: ignore[union-attr]
    units_ = {t.strip().partition(" ")[2].strip() for t in texts}
    try:
        found = [units.quantity(t, "it") for t in texts]
        unit = min(units_)
        size = units.quantity(f"1 {unit}").units
        sizes = [float(q.to(size).magnitude) for q in found]
    except (InputError, ValueError, TypeError):
        return None
    except Exception as cause:
        if type(cause).__module__.startswith("pint"):
            return None
        raise
    law = set(laws)
    return (sizes, f"{laws[0] or ''} {unit}".strip()) if len(law) == 1 else None


def lists(given: object) -> object:
    """Lists of values by dotted key, for a record; ValueError where a value is none, as it would be no axis."""
    if not isinstance(given, dict):
        return given
    out = flat(given)
    wrong = []
    for key, values in out.items():
        if not isinstance(values, list) or not values:
            wrong.append(f"{key}: write a list of values, [...]; got {values!r}")
        elif len({text(v) for v in values}) < len(values):
            wrong.append(f"{key}: a value stands twice")
    if wrong:
        raise ValueError("; ".join(wrong))
    return out


def combinations(given: object) -> object:
    """Single values by dotted key, for each of several points."""
    return [flat(p) if isinstance(p, dict) else p for p in given] if isinstance(given, list) else given


def single(given: object) -> object:
    """Single values by dotted key."""
    return flat(given) if isinstance(given, dict) else given
