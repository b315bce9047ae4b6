"""The registry itself: what can be asked of it, and how it grows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from difflib import get_close_matches
from itertools import islice
from types import TracebackType
from typing import TYPE_CHECKING, Self

from ..errors import DataError, InputError
from . import bounds, dates, queries, writer
from .address import Address
from .candidates import Candidate
from .database import Database
from .entries import Added, Bound, Entry, History, Listed, State, Unit, numbered
from .tables import calibrations

if TYPE_CHECKING:
    from ..calibration import Calibration
    from ..limits import Limits

BATCH = 500
"""Calibrations that are written in one transaction."""
_HASH = 8
"""Digits of a hash that are enough to mean a calibration."""


class Registry:
    """Calibrations of a fleet. :func:`sagnac.registry.open_registry` opens one.

    It only grows: what it holds is never changed nor removed, and the database refuses to.

    Parameters
    ----------
    where : Address
    write : bool

    Raises
    ------
    InputError
        When it is not there, cannot be reached, is damaged, no registry, or of another version.
    """

    def __init__(self, where: Address, *, write: bool = False) -> None:
        self.where = where
        self._database = Database(where, write=write)
        try:
            if write:
                self._database.make()
            else:
                with self._database.reading() as connection:
                    self._database.check(self._database.revision(connection))
        except BaseException:
            self._database.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    # ------------------------------------------------------------------------------------------------- growing

    def add(self, candidates: Iterable[Candidate]) -> Iterator[Added]:
        """Register calibrations, each batch of them in one transaction: what has been told is on the disk.

        Parameters
        ----------
        candidates : iterable of Candidate
            See :func:`sagnac.registry.candidates.read`.

        Yields
        ------
        Added
            One for each; what is there already, be it in other bytes, is not added again, and refused as that of another unit
            or date.

        Raises
        ------
        InputError
            When the database cannot be written to; nothing of the batch is kept.
        """
        left = iter(candidates)
        while batch := list(islice(left, BATCH)):
            with self._database.writing() as connection:
                made = writer.add(connection, batch)
            told = set[int]()
            for c in batch:
                entry, new = made[c.sha256]
                refused = "" if c.sha256 != entry.sha256 else _conflict(c, entry)
                yield Added(c.file, entry, new and entry.id not in told, c.sha256 == entry.sha256, refused)
                told.add(entry.id)

    def set_limits(
        self, given: Limits, *, model: str, serial: str = "", valid_from: datetime | None = None
    ) -> tuple[list[Bound], list[str]]:
        """Register limits; those that there are stay, and are followed by these from their date on.

        Parameters
        ----------
        given : Limits
        model, serial : str
            What they are for; an empty serial: all units of the model.
        valid_from : datetime, optional
            UTC; left out: at once.

        Returns
        -------
        bounds : list of Bound
        remarks : list of str

        Raises
        ------
        InputError
            For a key that meets no parameter of the calibrations that are registered, patterns that meet the same one, a bound of
            another unit, and where there is nothing to lift.
        """
        if serial:
            self.unit(serial, model)
        with self._database.writing() as connection:
            known = queries.parameters_of(connection, model, serial)
            earlier = queries.limits_until(connection, model=model)
            made, remarks = bounds.resolve(given, known, earlier, model=model, serial=serial, valid_from=valid_from)
            writer.add_limits(connection, made)
        return made, remarks

    # -------------------------------------------------------------------------------------------------- asking

    def unit(self, serial: str, model: str | None = None) -> Unit:
        """A unit by its serial number.

        Raises
        ------
        InputError
            When there is none, or several models have it.
        """
        with self._database.reading() as connection:
            found = queries.units_where(connection, model, serial)
            if len(found) == 1:
                return found[0]
            if found:
                models = ", ".join(u.model for u in found)
                raise InputError(
                    f"{self.where}: {serial!r} is the serial number of units of several models, {models}; say which one"
                )
            every = queries.units_where(connection, model, None)
        raise InputError(f"{self.where}: no unit{_of(model)} with serial number {serial!r}{_like(serial, every)}")

    def entries(self, unit: Unit) -> list[Entry]:
        """Calibrations of a unit, oldest first."""
        with self._database.reading() as connection:
            return queries.entries_of(connection, unit)

    def listing(
        self,
        *,
        model: str | None = None,
        serial: str | None = None,
        since: datetime | None = None,
        method: str | None = None,
        at_most: int | None = None,
    ) -> list[Listed]:
        """Units with the number of their calibrations, the latest, and how it stands against the limits.

        Parameters
        ----------
        model, serial : str, optional
        since : datetime, optional
            Only calibrations from then on count.
        method : str, optional
            Only calibrations by it count.
        at_most : int, optional
            Units.

        Returns
        -------
        list of Listed
        """
        with self._database.reading() as connection:
            found = queries.latest(
                connection, model=model, serial=serial, since=since, until=None, method=method, at_most=at_most
            )
            state = bounds.states(connection, [e for _, e in found])
        return [Listed(e.unit, count, e, state.get(e.id, State())) for count, e in found]

    def states(self, entries: Sequence[Entry]) -> dict[int, State]:
        """By number of the entry how it stands against the limits in force now; without limits nothing."""
        with self._database.reading() as connection:
            return bounds.states(connection, entries)

    def find(self, at: datetime, *, model: str | None = None, serial: str | None = None) -> list[Entry]:
        """The calibration in force at a moment, of each unit that has one: the latest that was made until then."""
        with self._database.reading() as connection:
            found = queries.latest(
                connection, model=model, serial=serial, since=None, until=at, method=None, at_most=None
            )
        return [e for _, e in found]

    def resolve(self, reference: str, model: str | None = None) -> Entry:
        """The calibration that a text means.

        Parameters
        ----------
        reference : str
            A serial number (its latest calibration), ``SERIAL@DATE`` (the one in force then), ``id:12``, or the first digits of
            the SHA-256 of its file, eight or more.
        model : str, optional
            Of the serial number, where several have it.

        Raises
        ------
        InputError
            When nothing is meant, or several are.
        DataError
            When the unit had no calibration at that date.
        """
        text = reference.strip()
        if text.startswith("id:"):
            return self._numbered(text)
        with self._database.reading() as connection:
            found = queries.units_where(connection, model, text)
        if found:
            return self.entries(self.unit(text, model))[-1]
        digits = text.lower().removeprefix("sha256:")
        if len(digits) >= _HASH and not set(digits) - set("0123456789abcdef"):
            with self._database.reading() as connection:
                meant = queries.by_hash(connection, digits, 2)
            if len(meant) > 1:
                raise InputError(
                    f"{self.where}: several calibrations have a hash that begins with {digits}; give more digits"
                )
            if meant:
                return meant[0]
        serial, sign, date = text.rpartition("@")
        if not sign:
            with self._database.reading() as connection:
                every = queries.units_where(connection, model, None)
            raise InputError(
                f"{self.where}: no unit{_of(model)} has the serial number {text!r}, and no calibration's hash begins so"
                + _like(text, every)
            )
        return self._in_force(self.unit(serial, model), dates.parse(date, reference, end=True))

    def _numbered(self, text: str) -> Entry:
        number = numbered(text)
        if number is not None:
            with self._database.reading() as connection:
                found = queries.entries_where(connection, calibrations.c.id, [number])
            if found:
                return found[0]
        raise InputError(f"{self.where}: no calibration has the number {text.removeprefix('id:')!r}")

    def _in_force(self, unit: Unit, at: datetime) -> Entry:
        with self._database.reading() as connection:
            found = queries.entries_of(connection, unit, at)
        if not found:
            raise DataError(f"{self.where}: {unit} had no calibration yet at {at.isoformat(timespec='seconds')}")
        return found[-1]

    def content(self, entry: Entry) -> bytes:
        """The file of a calibration, byte for byte.

        Raises
        ------
        InputError
            When it is not what was registered any more.
        """
        with self._database.reading() as connection:
            found = queries.content(connection, entry.id)
        if found is None or hashlib.sha256(found).hexdigest() != entry.sha256:
            raise InputError(
                f"{self.where}: the registry is damaged: the file of calibration id:{entry.id} does not have its SHA-256"
            )
        return found

    def calibration(self, entry: Entry) -> Calibration:
        """A calibration, read from its file."""
        from ..calibration import loads

        return loads(self.content(entry).decode("utf-8-sig"), f"{self.where}: id:{entry.id}")

    def history(
        self,
        unit: Unit | None = None,
        names: Sequence[str] | None = None,
        *,
        model: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
    ) -> History:
        """Values over time of a unit, of all units of a model, or of all.

        Parameters
        ----------
        unit : Unit, optional
        names : sequence of str, optional
            Parameters, or patterns such as ``accel.bias.*``; left out: all.
        model : str, optional
        since, until : datetime, optional
            Only calibrations made between these.

        Returns
        -------
        History

        Raises
        ------
        InputError
            When no calibration has such a parameter.
        """
        with self._database.reading() as connection:
            return queries.history(connection, unit, names, model=model, since=since, until=until)

    def limits(self, unit: Unit | None = None, *, model: str | None = None, at: datetime | None = None) -> list[Bound]:
        """Limits in force for a unit or a model, by the date from which they hold.

        Those that were lifted, or followed by others, are not among them. :func:`sagnac.registry.bounds.finder` picks the one
        that counts for a parameter.

        Parameters
        ----------
        unit : Unit, optional
            With those of its model; left out: all limits of the model, or of all models.
        model : str, optional
        at : datetime, optional
            Left out: now.
        """
        with self._database.reading() as connection:
            lines = queries.limits_until(
                connection,
                at or dates.now(),
                model if unit is None else unit.model,
                None if unit is None else unit.serial,
            )
        return bounds.last_lines(lines)


def _conflict(c: Candidate, entry: Entry) -> str:
    if (c.model, c.serial) != (entry.unit.model, entry.unit.serial):
        return f"{c.file}: the same file is registered as a calibration of {entry.unit} already, not of {c.model} {c.serial}"
    if c.created not in (c.stated, entry.created):
        return f"{c.file}: the same file is registered with the date {entry.created} already, not {c.created}"
    return ""


def _of(model: str | None) -> str:
    return f" of model {model!r}" if model else ""


def _like(serial: str, every: Sequence[Unit]) -> str:
    """What might have been meant."""
    if not every:
        return "; it holds no such units yet"
    near = get_close_matches(serial, sorted({u.serial for u in every}), 3, 0.5)
    return f"; did you mean {' or '.join(near)}?" if near else ""
