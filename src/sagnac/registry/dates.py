"""Dates of a registry: UTC, ISO 8601.

A bare date stands for the whole day in UTC: as the begin of a period it is the first moment of the day, as its end (and as the
moment at which something is in force) its last. A time without a zone is UTC.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

from ..errors import InputError

YEAR = 31557600.0
"""Julian year, s."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_WEEK = re.compile(r"\d{4}-?W\d{2}(?!-?\d)")
_DAY = re.compile(r"\d{4}-?\d{2}-?\d{2}|\d{4}-?W\d{2}-?\d")


def parse(text: str, what: str = "the date", *, end: bool = False) -> datetime:
    """A moment from its text.

    Parameters
    ----------
    text : str
        ``2026-11-22`` or ``2026-11-22T08:30:00+01:00``.
    what : str
        For messages.
    end : bool
        Whether a bare date is the last moment of its day, not the first.

    Returns
    -------
    datetime
        In UTC.

    Raises
    ------
    InputError
        For what is no date.
    """
    day = "" if _WEEK.match(text.strip()) else text.strip()  # of a week, fromisoformat would take the Monday
    try:
        at = datetime.fromisoformat(day)
        at = at.replace(tzinfo=UTC) if at.tzinfo is None else at.astimezone(UTC)
        if end and _DAY.fullmatch(day):
            at += timedelta(days=1) - _MICROSECOND
    except (ValueError, OverflowError) as cause:
        raise InputError(f"{what}: {text!r} is no date; write 2026-11-22, or 2026-11-22T08:30:00Z (UTC)") from cause
    return at


def to_microseconds(at: datetime) -> int:
    """Since 1970, as the tables keep it.

    Raises
    ------
    InputError
        For a moment without a time zone.
    """
    if at.tzinfo is None:
        raise InputError(f"{at}: has no time zone; write datetime(..., tzinfo=UTC)")
    return (at - _EPOCH) // _MICROSECOND


def from_microseconds(number: int) -> datetime:
    """The moment in UTC.

    Raises
    ------
    OverflowError
        When no calendar has it.
    """
    return _EPOCH + number * _MICROSECOND


def now() -> datetime:
    """The present moment."""
    return datetime.now(UTC)
