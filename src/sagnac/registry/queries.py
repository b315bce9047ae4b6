"""What is asked of the tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any, TypeVar

import sqlalchemy as sa

from ..errors import InputError
from ..limits import meets
from .dates import from_microseconds, to_microseconds
from .entries import Bound, Entry, History, Parameter, Unit
from .tables import calibrations, documents, limits, parameters, units, values

if TYPE_CHECKING:
    import numpy as np

_T = TypeVar("_T")
_PART = 5000
"""Values in one question: SQLite takes 32 766 of them."""
_ROW = [("item", "i8"), ("time", "i8"), ("calibration", "i8"), ("parameter", "i8"), ("value", "f8"), ("sigma", "f8")]
"""Of a history, as NumPy takes it."""
_ENTRY = (
    calibrations.c.id,
    calibrations.c.created,
    calibrations.c.method,
    calibrations.c.misalignment,
    calibrations.c.software,
    calibrations.c.sha256,
    calibrations.c.added,
    calibrations.c.stated,
    calibrations.c.recordings,
    units.c.id.label("unit_id"),
    units.c.model,
    units.c.serial,
)


def in_parts(every: Sequence[_T]) -> Iterator[Sequence[_T]]:
    """Lists as long as one question may be."""
    for start in range(0, len(every), _PART):
        yield every[start : start + _PART]


class DamagedError(Exception):
    """The tables hold what was never written to them."""


def made(rows: Iterable[Any], make: Callable[[Any], _T]) -> list[_T]:
    """Records from rows.

    Raises
    ------
    DamagedError
        When a row holds something that none can be made of.
    """
    try:
        return [make(row) for row in rows]
    except (ValueError, TypeError, OverflowError) as cause:
        raise DamagedError(str(cause)) from cause


def entry(row: Any) -> Entry:
    """An entry from its row."""
    return Entry(
        int(row.id),
        Unit(int(row.unit_id), row.model, row.serial),
        from_microseconds(row.created),
        row.method,
        row.misalignment,
        row.software,
        row.sha256,
        from_microseconds(row.added),
        None if row.stated is None else from_microseconds(row.stated),
        tuple(row.recordings.split()),
    )


def entries_where(
    connection: sa.Connection, column: sa.Column[Any], wanted: Sequence[Any], serials: Sequence[str] | None = None
) -> list[Entry]:
    """Entries of which a column has one of the values wanted; of units of some serial numbers (as many as one question takes)."""
    found = []
    for part in in_parts(wanted):
        asked = sa.select(*_ENTRY).join(units).where(column.in_(part))
        if serials is not None:
            asked = asked.where(units.c.serial.in_(serials))
        found += made(connection.execute(asked), entry)
    return found


def entries_of(connection: sa.Connection, unit: Unit, until: datetime | None = None) -> list[Entry]:
    """Entries of a unit, oldest first."""
    asked = sa.select(*_ENTRY).join(units).where(calibrations.c.unit_id == unit.id)
    if until is not None:
        asked = asked.where(calibrations.c.created <= to_microseconds(until))
    return made(connection.execute(asked.order_by(calibrations.c.created, calibrations.c.id)), entry)


def by_hash(connection: sa.Connection, prefix: str, at_most: int) -> list[Entry]:
    """Entries whose hash begins so."""
    asked = sa.select(*_ENTRY).join(units).where(calibrations.c.sha256.between(prefix, prefix + "g"))
    return made(connection.execute(asked.limit(at_most)), entry)


def units_where(connection: sa.Connection, model: str | None, serial: str | None) -> list[Unit]:
    """Units of a model, of a serial number, or all."""
    asked = sa.select(units.c.id, units.c.model, units.c.serial).order_by(units.c.model, units.c.serial)
    if model is not None:
        asked = asked.where(units.c.model == model)
    if serial is not None:
        asked = asked.where(units.c.serial == serial)
    return made(connection.execute(asked), lambda row: Unit(int(row.id), row.model, row.serial))


def latest(
    connection: sa.Connection,
    *,
    model: str | None,
    serial: str | None,
    since: datetime | None,
    until: datetime | None,
    method: str | None,
    at_most: int | None,
) -> list[tuple[int, Entry]]:
    """For each unit how many calibrations it has, and the latest; of those that the conditions let through.

    Two of the same moment: the one that was registered last.
    """
    c = calibrations.alias()
    conditions: list[sa.ColumnElement[bool]] = []
    if since is not None:
        conditions.append(c.c.created >= to_microseconds(since))
    if until is not None:
        conditions.append(c.c.created <= to_microseconds(until))
    if method is not None:
        conditions.append(c.c.method == method)
    own = sa.and_(c.c.unit_id == units.c.id, *conditions)
    count = sa.select(sa.func.count()).select_from(c).where(own).correlate(units).scalar_subquery()
    last = (
        sa.select(c.c.id).where(own).order_by(c.c.created.desc(), c.c.id.desc()).limit(1).correlate(units)
    ).scalar_subquery()
    asked = (
        sa.select(count.label("of_unit"), *_ENTRY)
        .select_from(units.join(calibrations, calibrations.c.id == last))
        .order_by(units.c.model, units.c.serial)
        .limit(at_most)
    )
    if model is not None:
        asked = asked.where(units.c.model == model)
    if serial is not None:
        asked = asked.where(units.c.serial == serial)
    return made(connection.execute(asked), lambda row: (int(row.of_unit), entry(row)))


def content(connection: sa.Connection, number: int) -> bytes | None:
    """The file of a calibration."""
    asked = sa.select(documents.c.content).where(documents.c.calibration_id == number)
    found = connection.execute(asked).scalar_one_or_none()
    return None if found is None else made([found], bytes)[0]


def every_parameter(connection: sa.Connection) -> dict[int, Parameter]:
    """All parameters by number."""
    rows = connection.execute(sa.select(parameters))
    return dict(made(rows, lambda row: (int(row.id), _parameter(row))))


def _parameter(row: Any) -> Parameter:
    return Parameter(row.name, row.unit, row.misalignment)


def parameters_of(connection: sa.Connection, model: str, serial: str) -> list[Parameter]:
    """Those that calibrations of a model have, or of one unit of it."""
    own = sa.select(calibrations.c.id).join(units).where(units.c.model == model)
    if serial:
        own = own.where(units.c.serial == serial)
    used = sa.select(values.c.parameter_id).where(values.c.calibration_id.in_(own)).distinct()
    asked = sa.select(parameters).where(parameters.c.id.in_(used)).order_by(parameters.c.name)
    return made(connection.execute(asked), _parameter)


def limits_until(
    connection: sa.Connection, at: datetime | None = None, model: str | None = None, serial: str | None = None
) -> list[Bound]:
    """Lines of limits valid from a moment or before, or all, in the order in which they were registered."""
    asked = sa.select(limits).order_by(limits.c.id)
    if at is not None:
        asked = asked.where(limits.c.valid_from <= to_microseconds(at))
    if model is not None:
        asked = asked.where(limits.c.model == model)
    if serial is not None:
        asked = asked.where(limits.c.serial.in_(["", serial]))
    return made(connection.execute(asked), _bound)


def _bound(row: Any) -> Bound:
    return Bound(
        -math.inf if row.lower is None else row.lower,
        math.inf if row.upper is None else row.upper,
        row.model,
        row.serial,
        row.key,
        row.unit,
        row.rule,
        row.specification,
        from_microseconds(row.valid_from),
        from_microseconds(row.added),
    )


def values_of(
    connection: sa.Connection, numbers: Sequence[int], wanted: Sequence[int]
) -> Iterator[tuple[int, int, float, float, float]]:
    """Of calibrations the values of the parameters wanted: both numbers, value, standard uncertainty, degrees of freedom."""
    for part in in_parts(numbers):
        asked = sa.select(
            values.c.calibration_id, values.c.parameter_id, values.c.value, values.c.standard_uncertainty, values.c.dof
        ).where(values.c.calibration_id.in_(part), values.c.parameter_id.in_(wanted))
        yield from made(connection.execute(asked), _value)


def _value(row: Any) -> tuple[int, int, float, float, float]:
    number, parameter, value, sigma, dof = row
    return int(number), int(parameter), float(value), float(sigma), math.inf if dof is None else float(dof)


def history(
    connection: sa.Connection,
    unit: Unit | None,
    names: Sequence[str] | None,
    *,
    model: str | None,
    since: datetime | None,
    until: datetime | None,
) -> History:
    """See :meth:`sagnac.registry.store.Registry.history`."""
    import numpy as np  # here, for a list does without

    known = every_parameter(connection)
    asked = (
        sa.select(
            calibrations.c.unit_id,
            calibrations.c.created,
            calibrations.c.id,
            values.c.parameter_id,
            values.c.value,
            values.c.standard_uncertainty,
        )
        .select_from(calibrations)
        .join(values, values.c.calibration_id == calibrations.c.id)
    )
    if unit is not None:
        asked = asked.where(calibrations.c.unit_id == unit.id)
    elif model is not None:
        asked = asked.where(calibrations.c.unit_id.in_(sa.select(units.c.id).where(units.c.model == model)))
    if names is not None:
        asked = asked.where(values.c.parameter_id.in_(_wanted(known, names)))
    if since is not None:
        asked = asked.where(calibrations.c.created >= to_microseconds(since))
    if until is not None:
        asked = asked.where(calibrations.c.created <= to_microseconds(until))
    every = {u.id: u for u in units_where(connection, model, None)}
    cursor: Any = connection.execute(asked).cursor  # of the driver: its rows need no more than to be put into an array
    try:
        return _sorted(np.fromiter(cursor, _ROW), known, every)
    except (ValueError, TypeError, OverflowError, KeyError) as cause:
        raise DamagedError(str(cause)) from cause
    except connection.dialect.loaded_dbapi.Error as cause:
        raise sa.exc.DBAPIError("", None, cause) from cause


def _wanted(known: dict[int, Parameter], names: Sequence[str]) -> list[int]:
    found = []
    for wanted in names:
        met = [number for number, p in known.items() if meets(wanted, p.name)]
        if not met:
            every = ", ".join(sorted({p.name for p in known.values()}))
            raise InputError(f"no calibration has a parameter {wanted!r}; there are {every or 'none'}")
        found += met
    return sorted(set(found))


def _sorted(rows: np.ndarray, known: dict[int, Parameter], every: dict[int, Unit]) -> History:
    import numpy as np

    numbers = np.flatnonzero(np.bincount(rows["parameter"]))
    index = np.searchsorted(numbers, rows["parameter"])
    met = [known[int(number)] for number in numbers]
    order = sorted(range(len(met)), key=lambda i: (met[i].name, met[i].unit, met[i].misalignment))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    parameter = rank[index]
    by = np.lexsort((rows["calibration"], rows["time"], parameter, rows["item"]))
    rows, parameter = rows[by], parameter[by]
    return History(
        item=rows["item"].copy(),
        time=rows["time"].astype("datetime64[us]"),
        calibration=rows["calibration"].copy(),
        parameter=parameter,
        value=rows["value"].copy(),
        standard_uncertainty=rows["sigma"].copy(),
        parameters=tuple(met[i] for i in order),
        units={i: every[i] for i in np.flatnonzero(np.bincount(rows["item"])).tolist()},
    )
