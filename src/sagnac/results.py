"""What every file of results shares: named quantities with a covariance, JSON in and out, where they came from."""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from .errors import InputError
from .files import write_atomically
from .frames import Array

_Model = TypeVar("_Model", bound=BaseModel)


class Record(BaseModel):
    """A frozen, typed part of a file; unknown keys and numbers that are not finite are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Source(Record):
    """A file that went in, and as what; of recordings the format, and which one in a file that may hold several."""

    file: str
    role: Literal["recording", "plan", "prior", "master", "configuration", "noise test"] = "recording"
    format: str | None = None
    select: str | None = None
    sha256: str | None = None
    start: float | None = None
    stop: float | None = None


class Software(Record):
    """What made the result."""

    name: str = "sagnac"
    version: str


class Uncertain(Protocol):
    """A quantity with a name and a standard uncertainty."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def standard_uncertainty(self) -> float:
        """Its standard uncertainty, in the unit of its value."""


def check_covariance(parameters: Sequence[Uncertain], covariance: Sequence[Sequence[float]]) -> None:
    """Refuse a covariance that does not belong to the parameters, or is not that of any quantities.

    Raises
    ------
    ValueError
        With the parameters at fault.
    """
    n = len(parameters)
    if len(covariance) != n or any(len(row) != n for row in covariance):
        raise ValueError(f"the covariance is not {n} by {n} as the parameters ask")
    names = [p.name for p in parameters]
    if len(set(names)) != n:
        raise ValueError("a parameter stands twice")
    for i, p in enumerate(parameters):
        variance = covariance[i][i]
        sigma = math.sqrt(variance) if variance >= 0 else math.nan
        if not math.isclose(sigma, p.standard_uncertainty, rel_tol=1e-6, abs_tol=1e-150):
            raise ValueError(f"the covariance of {p.name} does not agree with its standard uncertainty")
    for i, row in enumerate(covariance):
        for j in range(i):
            bound = math.sqrt(row[i]) * math.sqrt(covariance[j][j])
            both = row[j], covariance[j][i]
            if abs(both[0] - both[1]) > 1e-9 * bound + 1e-300 or abs(row[j]) > (1 + 1e-6) * bound + 1e-300:
                raise ValueError(f"the covariance of {names[i]} and {names[j]} is not that of two quantities")


def covariance_rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    """Symmetric matrix as nested tuples for a record."""
    return tuple(tuple(float(v) for v in row) for row in (matrix + matrix.T) / 2)


def to_json(record: BaseModel) -> str:
    """The text of a file; numbers are written so that they read back exactly."""
    return json.dumps(record.model_dump(by_alias=True, mode="json"), indent=1, allow_nan=False) + "\n"


def save(record: BaseModel, path: str | Path) -> None:
    """Write the JSON file, whole or not at all."""
    with write_atomically(path) as temporary:
        temporary.write_text(to_json(record), encoding="utf-8")


def loads(model: type[_Model], schema: str, what: str, text: str, source: str) -> _Model:
    """A record from JSON text.

    Parameters
    ----------
    model : type of record
    schema : str
        Name and version that the text must state.
    what : str
        Article and noun for messages, ``a calibration``.
    text : str
    source : str
        Where the text is from, for messages.

    Raises
    ------
    InputError
        When the text is no such record, or of a version that this one does not know.
    """
    try:
        table = json.loads(text)
    except (ValueError, RecursionError) as cause:
        raise InputError(f"{source}: not a JSON file: {cause}") from cause
    version = table.get("schema") if isinstance(table, dict) else None
    if version != schema:
        found = f"its schema is {version!r}" if version else "it names no schema"
        raise InputError(f"{source}: not {what} that this version reads ({schema!r}); {found}")
    try:
        return model.model_validate(table)
    except ValidationError as cause:
        first = cause.errors()[0]
        place = ".".join(str(p) for p in first["loc"]) or "file"
        noun = what.partition(" ")[2]
        raise InputError(f"{source}: damaged {noun}: {place}: {first['msg']}") from cause


def read_text(path: str | Path, what: str) -> str:
    """Text of a file of results.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as cause:
        raise InputError(f"{path}: cannot read the {what}: {cause}") from cause


def json_schema(model: type[BaseModel], schema: str) -> dict[str, Any]:
    """JSON Schema of a file, made from its record."""
    made = model.model_json_schema(by_alias=True)
    made["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    made["$id"] = schema
    made["required"] = ["schema", *made["required"]]  # the record fills it in, a file must name it
    return made


def now() -> str:
    """The present moment for a record, UTC, to the second."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
