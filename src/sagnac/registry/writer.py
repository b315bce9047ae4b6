"""Writing to a registry: calibrations and limits, each call in one transaction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa

from .candidates import Candidate, Reading
from .dates import now, to_microseconds
from .entries import Bound, Entry, Parameter
from .queries import entries_where, every_parameter, in_parts, values_of
from .tables import calibrations, documents, limits, parameters, units, values


def add(connection: sa.Connection, candidates: Sequence[Candidate]) -> dict[str, tuple[Entry, bool]]:
    """Register calibrations, but none that is there: the same file, or the same unit, date, method and values in other bytes.

    Parameters
    ----------
    connection : Connection
        In a transaction of a writer: no other one writes meanwhile.
    candidates : sequence of Candidate

    Returns
    -------
    dict of str to (Entry, bool)
        By hash; whether it is new. The entry of a calibration in other bytes has another hash.
    """
    different = dict[str, Candidate]()
    for c in candidates:
        different.setdefault(c.sha256, c)
    there = {e.sha256: e for e in entries_where(connection, calibrations.c.sha256, list(different))}
    alike = _alike(connection, [c for sha256, c in different.items() if sha256 not in there])
    firsts, fresh = dict[Any, str](), list[Candidate]()
    for c in different.values():
        if c.sha256 not in there and c.sha256 not in alike and firsts.setdefault(_said(c), c.sha256) == c.sha256:
            fresh.append(c)
    if fresh:
        _insert(connection, fresh)
    made = {e.sha256: e for e in entries_where(connection, calibrations.c.sha256, [c.sha256 for c in fresh])}
    twins = {c.sha256: (made[firsts[_said(c)]], False) for c in different.values() if firsts.get(_said(c)) in made}
    return twins | {k: (e, False) for k, e in (there | alike).items()} | {k: (e, True) for k, e in made.items()}


def _said(c: Candidate) -> tuple[Any, ...]:
    """What a calibration says of which unit, whatever its bytes."""
    return c.model, c.serial, c.created, c.method, frozenset(c.readings)


def _alike(connection: sa.Connection, candidates: Sequence[Candidate]) -> dict[str, Entry]:
    """Entries that say the same as candidates do, by the hash of these."""
    moments = list({to_microseconds(c.created) for c in candidates})
    near = dict[tuple[Any, ...], list[Entry]]()
    for e in entries_where(connection, calibrations.c.created, moments, [c.serial for c in candidates]):
        near.setdefault((e.unit.model, e.unit.serial, e.created, e.method), []).append(e)
    if not near:
        return {}
    known = every_parameter(connection)
    readings = dict[int, set[Reading]]()
    for number, parameter, value, sigma, dof in values_of(
        connection, [e.id for some in near.values() for e in some], list(known)
    ):
        reading = Reading(known[parameter], value, sigma, None if math.isinf(dof) else dof)
        readings.setdefault(number, set()).add(reading)
    found = dict[str, Entry]()
    for c in candidates:
        for e in near.get((c.model, c.serial, c.created, c.method), ()):
            if readings.get(e.id) == set(c.readings):
                found[c.sha256] = e
    return found


def _insert(connection: sa.Connection, fresh: Sequence[Candidate]) -> None:
    unit_of = _units(connection, fresh)
    parameter_of = _parameters(connection, fresh)
    added = to_microseconds(now())
    connection.execute(
        sa.insert(calibrations),
        [
            {
                "unit_id": unit_of[c.model, c.serial],
                "created": to_microseconds(c.created),
                "method": c.method,
                "misalignment": c.misalignment,
                "software": c.software,
                "sha256": c.sha256,
                "added": added,
                "stated": None if c.stated is None else to_microseconds(c.stated),
                "recordings": " ".join(c.recordings),
            }
            for c in fresh
        ],
    )
    number = dict[str, int]()
    for part in in_parts([c.sha256 for c in fresh]):
        asked = sa.select(calibrations.c.sha256, calibrations.c.id).where(calibrations.c.sha256.in_(part))
        number |= {row.sha256: row.id for row in connection.execute(asked)}
    connection.execute(
        sa.insert(documents), [{"calibration_id": number[c.sha256], "content": c.content} for c in fresh]
    )
    connection.execute(
        sa.insert(values),
        [
            {
                "calibration_id": number[c.sha256],
                "parameter_id": parameter_of[r.parameter],
                "value": r.value,
                "standard_uncertainty": r.standard_uncertainty,
                "dof": r.dof,
            }
            for c in fresh
            for r in c.readings
        ],
    )


def _units(connection: sa.Connection, fresh: Sequence[Candidate]) -> dict[tuple[str, str], int]:
    wanted = list(dict.fromkeys((c.model, c.serial) for c in fresh))

    def known() -> dict[tuple[str, str], int]:
        found = dict[tuple[str, str], int]()
        for part in in_parts(list(dict.fromkeys(serial for _, serial in wanted))):
            rows = connection.execute(sa.select(units).where(units.c.serial.in_(part)))
            found |= {(row.model, row.serial): row.id for row in rows}
        return found

    there = known()
    new = [{"model": m, "serial": s} for m, s in wanted if (m, s) not in there]
    if not new:
        return there
    connection.execute(sa.insert(units), new)
    return known()


def _parameters(connection: sa.Connection, fresh: Sequence[Candidate]) -> dict[Parameter, int]:
    wanted = dict.fromkeys(r.parameter for c in fresh for r in c.readings)

    def known() -> dict[Parameter, int]:
        rows = connection.execute(sa.select(parameters))
        return {Parameter(row.name, row.unit, row.misalignment): row.id for row in rows}

    there = known()
    new: list[dict[str, Any]] = [
        {"name": p.name, "unit": p.unit, "misalignment": p.misalignment} for p in wanted if p not in there
    ]
    if not new:
        return there
    connection.execute(sa.insert(parameters), new)
    return known()


def add_limits(connection: sa.Connection, made: Sequence[Bound]) -> None:
    """Register limits."""
    connection.execute(
        sa.insert(limits),
        [b.to_dict() | {"valid_from": to_microseconds(b.valid_from), "added": to_microseconds(b.added)} for b in made],
    )
