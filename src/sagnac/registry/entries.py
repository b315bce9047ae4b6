"""What a registry holds, as records."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any, NamedTuple

from ..limits import Limit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..frames import Array
    from ..limits import Rule

LONGEST = 200
"""Characters of a name: a key of more would not fit into an index of every database."""
_DIGITS = 19
"""Of a number that no database can hold any more."""


def numbered(text: str) -> int | None:
    """Number of a calibration from ``id:12``, or from its digits alone; None where it is none."""
    digits = text.strip().removeprefix("id:")
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) < _DIGITS else None


@dataclass(frozen=True)
class Unit:
    """A unit: what a history is of."""

    id: int
    model: str
    serial: str

    def __str__(self) -> str:
        """Model and serial number."""
        return f"{self.model} {self.serial}"


@dataclass(frozen=True)
class Entry:
    """A calibration in the registry, without its values.

    Attributes
    ----------
    id : int
        Number in the registry.
    unit : Unit
    created, added : datetime
        When it was made, and when it came into the registry; UTC.
    method, software : str
    misalignment : str
        Convention, see :class:`sagnac.calibration.Calibration`.
    sha256 : str
        Of its file.
    stated : datetime or None
        When its file says that it was computed, if it says so; `created` may be another date, that of the test.
    recordings : tuple of str
        SHA-256 of the recordings from which it was computed, sorted; empty where its file names none.
    """

    id: int
    unit: Unit
    created: datetime
    method: str
    misalignment: str
    software: str
    sha256: str
    added: datetime
    stated: datetime | None = None
    recordings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "id": self.id,
            "model": self.unit.model,
            "serial": self.unit.serial,
            "created": self.created.isoformat(),
            "stated": None if self.stated is None else self.stated.isoformat(),
            "method": self.method,
            "misalignment": self.misalignment,
            "software": self.software,
            "sha256": self.sha256,
            "added": self.added.isoformat(),
            "recordings": list(self.recordings),
        }


@dataclass(frozen=True)
class Parameter:
    """A parameter; the same name in another unit or convention is another parameter.

    Attributes
    ----------
    name, unit : str
    misalignment : str
        Convention of a misalignment, ``element`` or ``input-axis``; empty for all else.
    """

    name: str
    unit: str
    misalignment: str = ""


@dataclass(frozen=True)
class History:
    """Values over time, sorted by unit, parameter, time and number of the calibration. Arrays of one length, n.

    Attributes
    ----------
    item : array of int, shape (n,)
        :attr:`Unit.id`.
    time : array of datetime64[us], shape (n,)
        UTC.
    calibration : array of int, shape (n,)
        :attr:`Entry.id`.
    parameter : array of int, shape (n,)
        Index into `parameters`.
    value, standard_uncertainty : array, shape (n,)
        In the unit of the parameter.
    parameters : tuple of Parameter
        Those that occur, by name.
    units : dict of int to Unit
        Those that occur.
    """

    item: NDArray[np.int64]
    time: NDArray[np.datetime64]
    calibration: NDArray[np.int64]
    parameter: NDArray[np.int64]
    value: Array
    standard_uncertainty: Array
    parameters: tuple[Parameter, ...]
    units: dict[int, Unit]


@dataclass(frozen=True)
class Bound(Limit):
    """A limit as the registry holds it: with neither bound, the earlier lines of its key are lifted.

    Attributes
    ----------
    model : str
    serial : str
        Of the one unit that it is for; empty: all of the model.
    key : str
        Parameter or pattern.
    unit : str
        Of both bounds.
    rule : str
        How it is decided, see :mod:`sagnac.limits`.
    specification : str
        Where it is from.
    valid_from, added : datetime
        UTC.
    """

    model: str
    serial: str
    key: str
    unit: str
    rule: Rule
    specification: str
    valid_from: datetime
    added: datetime

    @property
    def lifts(self) -> bool:
        """Whether it bounds nothing, and only ends what was before."""
        return math.isinf(self.lower) and math.isinf(self.upper)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "model": self.model,
            "serial": self.serial,
            "key": self.key,
            **self.written(),
            "unit": self.unit,
            "rule": self.rule,
            "specification": self.specification,
            "valid_from": self.valid_from.isoformat(),
            "added": self.added.isoformat(),
        }


class State(NamedTuple):
    """A calibration against the limits in force.

    Attributes
    ----------
    word : str
        ``pass``, ``fail`` or ``undecided``; empty where no limit is meant for it.
    beyond : tuple of str
        Parameters that fail.
    unjudged : tuple of str
        Parameters with a limit that is in another unit of measurement, so that nothing can be said.
    """

    word: str = ""
    beyond: tuple[str, ...] = ()
    unjudged: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"state": self.word or None, "beyond": list(self.beyond), "unjudged": list(self.unjudged)}


@dataclass(frozen=True)
class Listed:
    """A unit in a list.

    Attributes
    ----------
    unit : Unit
    count : int
        Of its calibrations.
    latest : Entry
    state : State
        How the latest stands against the limits in force now.
    """

    unit: Unit
    count: int
    latest: Entry
    state: State

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "model": self.unit.model,
            "serial": self.unit.serial,
            "calibrations": self.count,
            "latest": self.latest.to_dict(),
            **self.state.to_dict(),
        }


@dataclass(frozen=True)
class Added:
    """What became of one file.

    Attributes
    ----------
    file : str
    entry : Entry
        A new one, or the one that is there already.
    new : bool
    same : bool
        Whether an entry that is there is of this very file; else of one that says the same in other bytes.
    refused : str
        Why it was not taken; empty where it was, or was there.
    """

    file: str
    entry: Entry
    new: bool
    same: bool = True
    refused: str = ""

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"file": self.file, "new": self.new, "same": self.same, **self.entry.to_dict()}


@dataclass(frozen=True)
class Filed:
    """What became of files that were to be registered.

    Attributes
    ----------
    added : tuple of Added
        Those registered now, and those that were before.
    refused : tuple of str
        Why, with the name of the file.
    """

    added: tuple[Added, ...]
    refused: tuple[str, ...]
