"""Files that are to be registered: read, checked, and taken apart into rows."""

from __future__ import annotations

import hashlib
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from . import dates
from .entries import LONGEST, Parameter

if TYPE_CHECKING:
    from ..calibration import Calibration


_AHEAD = timedelta(days=1)
"""That clocks and time zones may be ahead of this machine's."""


@dataclass(frozen=True)
class Reading:
    """A value of a calibration; `dof` is None where the noise was known."""

    parameter: Parameter
    value: float
    standard_uncertainty: float
    dof: float | None = None


@dataclass(frozen=True)
class Candidate:
    """A calibration that may be registered.

    Attributes
    ----------
    file : str
        For messages.
    content : bytes
        Of the file, as it is.
    sha256 : str
        Of the content.
    model, serial : str
        Of the unit.
    created : datetime
        Its date, UTC: what the user says, or else the file.
    method, misalignment, software : str
    readings : tuple of Reading
    stated : datetime or None
        What the file says, which is when it was computed.
    recordings : tuple of str
        SHA-256 of the recordings from which it was computed, sorted; of one picked from a file of several, with its name.
    """

    file: str
    content: bytes
    sha256: str
    model: str
    serial: str
    created: datetime
    method: str
    misalignment: str
    software: str
    readings: tuple[Reading, ...]
    stated: datetime | None = None
    recordings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Lacking:
    """What the user says: the unit, of files that do not say it themselves, and the date, which goes before that in the file."""

    model: str = ""
    serial: str = ""
    created: str = ""


NOTHING = Lacking()


def find(paths: Sequence[str | Path]) -> list[Path]:
    """Files that are meant: those named, and all ``*.json`` in a folder and the folders in it.

    Raises
    ------
    InputError
        For a folder without any.
    """
    found: list[Path] = []
    for given in paths:
        path = Path(given)
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted(p for p in path.rglob("*.json") if p.is_file())
        if not inside:
            raise InputError(f"{path}: no .json files in this folder")
        found += inside
    return found


def read(path: Path, lacking: Lacking = NOTHING) -> Candidate:
    """A candidate from its file.

    Raises
    ------
    InputError
        When it is no calibration, does not say which unit it is of, is dated in the future, or cannot be kept.
    """
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as cause:
        raise InputError(f"{path}: cannot read the calibration: {getattr(cause, 'strerror', None) or cause}") from cause
    return of_content(content, str(path), lacking)


def of_content(content: bytes, source: str, lacking: Lacking = NOTHING) -> Candidate:
    """A candidate from the bytes of a file, see :func:`read`."""
    from ..calibration import loads

    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise InputError(f"{source}: not a JSON file: {cause}") from cause
    calibration = loads(text, source)
    model = _stated(calibration.unit.model, lacking.model, f"{source}: names no model of the unit", "--model", source)
    serial = _stated(
        calibration.unit.serial, lacking.serial, f"{source}: names no serial number of the unit", "--serial", source
    )
    created, stated = _dates(calibration.created, lacking.created, source)
    software = f"{calibration.software.name} {calibration.software.version}".strip()
    for what, name in (("method", calibration.method), ("software", software)):
        check_name(name, what, source)
    return Candidate(
        source,
        content,
        hashlib.sha256(content).hexdigest(),
        model,
        serial,
        created,
        calibration.method,
        calibration.misalignment,
        software,
        tuple(_readings(calibration, source)),
        stated,
        _recordings(calibration),
    )


def _stated(own: str, given: str, lack: str, option: str, source: str) -> str:
    """What the file says, or else the user; a contradiction is refused."""
    own, given = own.strip(), given.strip()
    if own and given and own != given:
        raise InputError(f"{source}: says {own!r} itself, and {option} says {given!r}; leave the option out")
    if not own and not given:
        raise InputError(f"{lack}; say it with {option}")
    check_name(own or given, option.strip("-"), source)
    return own or given


def _dates(own: str, given: str, source: str) -> tuple[datetime, datetime | None]:
    """The date that counts, and that of the file."""
    stated: datetime | None = None
    try:
        stated = dates.parse(own)
    except InputError as cause:
        if not given:
            raise InputError(f"{source}: its date {own!r} cannot be read; say when it was made with --as-of") from cause
    created = dates.parse(given, "--as-of") if given else stated
    assert created is not None
    if created > dates.now() + _AHEAD:
        raise InputError(
            f"{source}: dated {created.isoformat(timespec='seconds')}, in the future; say with --as-of when it was made, "
            "and see that the clock of this machine is right"
        )
    return created, stated


def _recordings(calibration: Calibration) -> tuple[str, ...]:
    found = set[str]()
    for s in calibration.source:
        if s.role == "recording" and s.sha256:
            found.add(hashlib.sha256(f"{s.sha256} {s.select}".encode()).hexdigest() if s.select else s.sha256)
    return tuple(sorted(found))


def _readings(calibration: Calibration, source: str) -> Iterator[Reading]:
    from ..coverage import degrees_of_freedom

    for p in calibration.parameters:
        check_name(p.name, "parameter", source)
        check_name(p.unit, f"unit of {p.name}", source)
        convention = calibration.misalignment if ".misalignment." in p.name else ""
        dof = degrees_of_freedom(calibration, p.name)
        known = None if dof == float("inf") else dof
        yield Reading(Parameter(p.name, p.unit, convention), p.value, p.standard_uncertainty, known)


def check_name(name: str, what: str, source: str) -> None:
    """Refuse a name that no database can keep, or nobody can read.

    Raises
    ------
    InputError
        With the file and the name.
    """
    if not name.strip():
        raise InputError(f"{source}: the {what} is empty")
    if len(name) > LONGEST:
        raise InputError(f"{source}: the {what} {name[:30]!r}... has {len(name)} characters; {LONGEST} are kept")
    for character in name:
        if unicodedata.category(character) in ("Cc", "Cs", "Zl", "Zp"):
            raise InputError(
                f"{source}: the {what} {name!a} has a character that cannot be kept (U+{ord(character):04X})"
            )
