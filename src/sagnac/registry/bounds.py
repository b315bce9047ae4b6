"""Limits as a registry keeps them, by model or unit, from a date on, never removed but followed by others; and what passes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any

from ..coverage import factor
from ..errors import InputError
from ..limits import RULES, Limit, Limits, bounds, judge, key_of, meets, together
from .candidates import check_name
from .dates import now
from .entries import Bound, Entry, Parameter, State, Unit

if TYPE_CHECKING:
    import sqlalchemy as sa

NONE = "none"
"""Written for a limit that is lifted."""
_UNITS = (
    "m/s^2", "rad/s", "1", "rad", "m", "s", "K", "count", "s^2/m", "s^4/m^2", "rad*s/m", "rad*s^2/m", "rad*s^3/m^2",
)  # fmt: skip
"""Of parameters, to know a limit's by when the model has no calibration yet."""
_WORDS = {True: "pass", False: "fail", None: "undecided"}
"""Of a decision, as in a certificate."""


def read_setting(text: str) -> tuple[str, Any]:
    """A limit as it is written on the command line.

    Parameters
    ----------
    text : str
        ``accel.bias.x=±1 mg``, ``accel.bias.*=-1 mg..2 mg``, ``accel.bias.x=..2 mg``, ``accel.bias.x=none``.

    Returns
    -------
    key : str
    given : str, list or dict
        As in a file of limits.

    Raises
    ------
    InputError
        For another form.
    """
    key, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not key or not value:
        raise InputError(
            f"{text!r}: write parameter=limit, as 'accel.bias.x=±1 mg', 'accel.bias.*=-1 mg..2 mg', or none; or name a .toml file"
        )
    if value.lower() == NONE:
        return key, NONE
    if ".." in value:
        lower, _, upper = (part.strip() for part in value.partition(".."))
        given = {k: v for k, v in (("lower", lower), ("upper", upper)) if v}
        return key, given
    for sign in ("±", "+-", "+/-"):
        value = value.removeprefix(sign)
    return key, value.strip()


def resolve(
    given: Limits,
    known: Sequence[Parameter],
    earlier: Sequence[Bound],
    *,
    model: str,
    serial: str,
    valid_from: datetime | None,
) -> tuple[list[Bound], list[str]]:
    """Limits in SI, as they are to be kept; see :meth:`sagnac.registry.store.Registry.set_limits` for the rest.

    Parameters
    ----------
    given : Limits
    known : sequence of Parameter
        Those that calibrations of the model, or of the unit, have; a limit must meet one of them, if there are any.
    earlier : sequence of Bound
        Lines of the model that there are; what is lifted must be among them.
    model, serial : str
    valid_from : datetime or None
    """
    source = given.source
    if given.rule not in RULES:
        raise InputError(f"{source}: the rule is one of {', '.join(RULES)}, not {given.rule!r}")
    for what, name in (("model", model), *((("serial", serial),) if serial else ())):
        check_name(name, what, source)
    if given.specification:
        check_name(given.specification, "specification", source)
    for name in dict.fromkeys(p.name for p in known):
        key_of(given, name)  # refuses two patterns
    whose = f"{model} {serial}".rstrip()
    remarks = [] if known else [f"no calibration of {whose} is registered yet: names were not checked"]
    added = now()
    start = valid_from or added
    there = [b.key for b in earlier if b.serial == serial and not b.lifts]
    made = []
    for key, value in given.table.items():
        check_name(key, "parameter", source)
        if value == NONE:
            _check_lifted(key, there, whose, source)
            unit, limit = "", Limit(-math.inf, math.inf)
        else:
            unit, limit = _limit(key, value, known, f"{source}: {key}")
            remarks += _bounded(key, unit, known)
        made.append(
            Bound(limit.lower, limit.upper, model, serial, key, unit, given.rule, given.specification, start, added)
        )
    return made, remarks


def _check_lifted(key: str, there: Sequence[str], whose: str, source: str) -> None:
    """Refuse to lift what is not there: a limit of the model stays one of its units."""
    if key not in there:
        every = ", ".join(dict.fromkeys(there)) or "none"
        raise InputError(
            f"{source}: {key}: nothing to lift, {whose} has no limit of this name of its own (there: {every}); "
            "to except a unit from a limit of its model, give it a wider one"
        )


def _limit(key: str, value: Any, known: Sequence[Parameter], where: str) -> tuple[str, Limit]:
    met = list(dict.fromkeys(p.unit for p in known if meets(key, p.name)))
    if known and not met:
        names = ", ".join(dict.fromkeys(p.name for p in known))
        raise InputError(f"{where}: meets no parameter of the calibrations; they have {names}")
    first: InputError | None = None
    for unit in met or _UNITS:
        try:
            return unit, bounds(value, unit, where)
        except InputError as cause:
            first = first or cause
    raise first or InputError(f"{where}: no unit of any parameter")


def _bounded(key: str, unit: str, known: Sequence[Parameter]) -> list[str]:
    """Which parameters a limit is for, where its key meets some of other units too."""
    met = [p for p in known if meets(key, p.name)]
    others = sorted({f"{p.name} ({p.unit})" for p in met if p.unit != unit})
    if not others:
        return []
    own = ", ".join(dict.fromkeys(p.name for p in met if p.unit == unit))
    return [f"{key}: a limit in {unit}, so of {own}, and not of {', '.join(others)}"]


def last_lines(lines: Iterable[Bound]) -> list[Bound]:
    """Lines that are in force: of those of one model, serial, key and unit of measurement the last, where it was not lifted.

    Parameters
    ----------
    lines : iterable of Bound
        Valid by then, in the order in which they were registered.

    Returns
    -------
    list of Bound
        By the date from which they hold.
    """
    kept = dict[tuple[str, str, str], dict[str, Bound]]()
    for b in sorted(lines, key=lambda b: b.valid_from):
        of_key = kept.setdefault((b.model, b.serial, b.key), {})
        if b.lifts:
            of_key.clear()
        else:
            of_key[b.unit] = b
    return sorted((b for of_key in kept.values() for b in of_key.values()), key=lambda b: (b.valid_from, b.added))


def bound_of(found: Iterable[Bound], name: str, unit: str) -> Bound | None:
    """The limit that counts for a parameter.

    One for the unit goes before one for its model, an exact name before a pattern, and then a later one before an earlier one.

    Parameters
    ----------
    found : iterable of Bound
        Those in force, see :func:`last_lines`.
    name, unit : str
        Of the parameter; a limit of another unit of measurement does not count.
    """
    meeting = [b for b in found if b.unit == unit and meets(b.key, name)]
    return max(reversed(meeting), key=lambda b: (bool(b.serial), b.key == name, b.valid_from, b.added), default=None)


def finder(found: Sequence[Bound]) -> Callable[[Unit, Parameter], Bound | None]:
    """The limit of a parameter of a unit, of many; units without limits of their own share the answer.

    Parameters
    ----------
    found : sequence of Bound
        Those in force, of any models and units.
    """
    lines = _of_unit(found)

    @cache
    def own(model: str, serial: str, p: Parameter) -> Bound | None:
        return bound_of(lines(model, serial), p.name, p.unit)

    special = {(b.model, b.serial) for b in found}
    return lambda u, p: own(u.model, u.serial if (u.model, u.serial) in special else "", p)


def _of_unit(found: Sequence[Bound]) -> Callable[[str, str], list[Bound]]:
    @cache
    def lines(model: str, serial: str) -> list[Bound]:
        return [b for b in found if b.model == model and b.serial in ("", serial)]

    return lines


def states(connection: sa.Connection, entries: Sequence[Entry]) -> dict[int, State]:
    """What the limits in force now make of calibrations.

    The guard band is the expanded uncertainty of a certificate (k = 2). A limit of which a calibration gives every parameter that
    it means in another unit of measurement (counts, where it is in SI) leaves it undecided.

    Parameters
    ----------
    connection : Connection
    entries : sequence of Entry

    Returns
    -------
    dict of int to State
        By number of the entry. Without limits nothing.
    """
    from . import queries  # here, for limits are found without a database

    found = last_lines(queries.limits_until(connection, now()))
    if not found or not entries:
        return {}
    known = queries.every_parameter(connection)
    wanted = [number for number, p in known.items() if any(meets(b.key, p.name) for b in found)]
    values = dict[int, list[tuple[int, float, float, float]]]()
    for calibration, number, value, sigma, dof in queries.values_of(connection, [e.id for e in entries], wanted):
        values.setdefault(calibration, []).append((number, value, sigma, dof))
    limit_of, lines, factor_of = finder(found), _of_unit(found), cache(factor)

    @cache
    def unjudged(model: str, serial: str, numbers: tuple[int, ...]) -> tuple[str, ...]:
        return _unjudged(lines(model, serial), [known[n] for n in numbers], known.values())

    special = {(b.model, b.serial) for b in found}
    made = dict[int, State]()
    for e in entries:
        own = values.get(e.id, [])
        serial = e.unit.serial if (e.unit.model, e.unit.serial) in special else ""
        missed = unjudged(e.unit.model, serial, tuple(number for number, *_ in own))
        passed = dict[str, bool | None]()
        for number, value, sigma, dof in own:
            bound = limit_of(e.unit, known[number])
            if bound is not None:
                passed[known[number].name] = judge(value, bound, factor_of(dof) * sigma, bound.rule)
        if passed or missed:
            word = _WORDS[together([*passed.values(), *(None for _ in missed)])]
            made[e.id] = State(word, tuple(sorted(name for name, p in passed.items() if p is False)), missed)
    return made


def _unjudged(lines: Sequence[Bound], given: Sequence[Parameter], known: Iterable[Parameter]) -> tuple[str, ...]:
    """Names for which there are limits that judge nothing of a calibration, and none that does.

    A pattern is meant for those of the names it meets that are known in its unit of measurement, if there are any.
    """
    judged = {p.name for p in given if bound_of(lines, p.name, p.unit) is not None}
    missed = set[str]()
    for b in lines:
        met = [p for p in given if meets(b.key, p.name)]
        if all(p.unit != b.unit for p in met):
            meant = {p.name for p in known if p.unit == b.unit and meets(b.key, p.name)}
            missed |= {p.name for p in met if not meant or p.name in meant}
    return tuple(sorted(missed - judged))
