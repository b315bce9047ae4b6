"""What an alignment found: named parameters with their covariance, attitude, how the filter fared. JSON in and out.

The JSON Schema of the file is :data:`SCHEMA_FILE`, published with the package.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from .. import results, units
from ..frames import Array
from ..results import Record, Software, Source

if TYPE_CHECKING:
    from ..recording import Recording

SCHEMA = "sagnac/alignment/1"
SCHEMA_FILE = Path(__file__).parents[1] / "alignment-1.schema.json"


class Value(Record):
    """One quantity in SI; the value is null where there are no data (covariance analysis)."""

    name: str
    value: float | None
    unit: str
    standard_uncertainty: float = Field(ge=0)


class Innovations(Record):
    """How the measurements fared: normalised innovations squared, which are chi-square when the model is true.

    ``mean`` is that of the updates, ``expected`` the number of components of one, ``band`` where the mean lies in 99.9 % of all
    alignments whose noise is as stated, ``rejected`` the updates with a component outside the gate, ``ratio`` the rms of each
    component over its standard deviation.
    """

    updates: int = Field(ge=0)
    rejected: int = Field(ge=0)
    mean: float = Field(ge=0)
    expected: float = Field(gt=0)
    band: tuple[float, float]
    ratio: dict[str, float] = Field(default_factory=dict)


class Observed(Record):
    """How far the uncertainty of a state fell: standard uncertainty at the start and at the end, SI."""

    name: str
    unit: str
    initial: float = Field(ge=0)
    final: float = Field(ge=0)


class NotObserved(Record):
    """A quantity of which the data say next to nothing: why, and what would show it."""

    name: str
    remains: float = Field(ge=0)
    """Share of the initial standard uncertainty that is left."""
    reason: str
    shown_by: str


class Stretch(Record):
    """A part of the time that was left out."""

    start: float
    stop: float
    reason: str


class Column(Record):
    """An axis of a sensor (``gyro_x``), its column in the recording, and what the numbers there were multiplied by."""

    axis: str
    column: str
    factor: float


class Moment(Record):
    """Standard uncertainties of the parameters some time after the start, s, in their order."""

    after: float
    standard_uncertainty: tuple[float, ...]


class Alignment(Record):
    """An alignment. :func:`load` reads one, :meth:`save` writes it."""

    schema_id: Literal["sagnac/alignment/1"] = Field(default="sagnac/alignment/1", alias="schema")
    kind: Literal["transfer", "covariance", "static"]
    method: str
    matching: str = ""
    states: str = ""
    correction: str = ""
    time: float
    """Of the last update, s, on the clock of the recording; all results belong to it."""
    parameters: tuple[Value, ...] = Field(min_length=1)
    covariance: tuple[tuple[float, ...], ...]
    attitude: tuple[Value, ...] = ()
    """Heading, pitch and roll of the unit."""
    place: tuple[Value, ...] = ()
    """Latitude, longitude, height and velocity (v_east, v_north, v_up) of the unit, where navigation can start from them."""
    innovations: Innovations | None = None
    observed: tuple[Observed, ...] = ()
    singular_values: tuple[float, ...] = ()
    """Of the observability Gramian, in states over their initial standard uncertainties and innovations over theirs."""
    not_observed: tuple[NotObserved, ...] = ()
    not_separated: tuple[str, ...] = ()
    """Directions, in states over their initial standard uncertainties, that the data say less of than was known before."""
    skipped: tuple[Stretch, ...] = ()
    course: tuple[Moment, ...] = ()
    """How the uncertainty fell."""
    source: tuple[Source, ...] = ()
    columns: tuple[Column, ...] = ()
    """How the samples of the unit were read: another recording of it that is read otherwise does not go with this."""
    remarks: tuple[str, ...] = ()
    software: Software
    created: str

    @model_validator(mode="after")
    def _square(self) -> Self:
        n = len(self.parameters)
        results.check_covariance(self.parameters, self.covariance)
        if any(len(m.standard_uncertainty) != n for m in self.course):
            raise ValueError(f"course: each time needs the standard uncertainties of {n} parameters")
        return self

    def values(self) -> dict[str, float | None]:
        """Parameter values by name, SI."""
        return {p.name: p.value for p in self.parameters}

    def __getitem__(self, name: str) -> Value:
        """Parameter or angle of the attitude by name."""
        for p in (*self.parameters, *self.attitude):
            if p.name == name:
                return p
        raise KeyError(f"{name!r} is not in this alignment; it has: {', '.join(self.values())}")

    @property
    def matrix(self) -> Array:
        """Covariance as an array, shape (k, k)."""
        return np.array(self.covariance).reshape(len(self.parameters), -1)

    def to_json(self) -> str:
        """The file's text; numbers are written so that they read back exactly."""
        return results.to_json(self)

    def save(self, path: str | Path) -> None:
        """Write the JSON file, whole or not at all."""
        results.save(self, path)

    def summary(self) -> str:
        """The result as a page of text."""
        return _summary(self)


def loads(text: str, source: str = "alignment") -> Alignment:
    """An alignment from JSON text, see :func:`load`."""
    return results.loads(Alignment, SCHEMA, "an alignment", text, source)


def load(path: str | Path) -> Alignment:
    """Read an alignment file.

    Raises
    ------
    InputError
        When the file cannot be read, is no alignment, or is of a version that this one does not know.
    """
    return loads(results.read_text(path, "alignment"), str(path))


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above."""
    return results.json_schema(Alignment, SCHEMA)


# --------------------------------------------------------------------------------------------------- the page of text

_SHOWN = {"rad": "arcmin", "rad/s": "deg/h", "m/s^2": "ug", "s": "ms"}
_WIDTH = 110
_COLUMNS = 4  # of the table over time: what fits into a terminal


def _unit_of(value: Value) -> tuple[float, str]:
    """Factor from SI to the unit that an alignment is told in, and that unit."""
    unit = "deg" if value.name in _DEGREES else _SHOWN.get(value.unit, value.unit)
    return units.convert(1.0, value.unit, unit) if unit != value.unit else 1.0, unit


_DEGREES = ("heading", "pitch", "roll", "latitude", "longitude")


def _line(value: Value) -> str:
    size, unit = _unit_of(value)
    sigma = value.standard_uncertainty * size
    digits = 4 if sigma == 0 else min(9, max(0, 1 - math.floor(math.log10(sigma))))
    shown = "-" if value.value is None else f"{value.value * size:.{digits}f}"
    return f"  {value.name:<22}{shown:>14}  {sigma:>11.{digits}f}  {unit}"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")


def _summary(found: Alignment) -> str:
    title = {"transfer": "Transfer alignment", "covariance": "Covariance analysis", "static": "Static alignment"}[
        found.kind
    ]
    how = [f"method {found.method}", *([f"matching {found.matching}"] if found.matching else [])]
    how += [f"{found.states} states"] * bool(found.states) + [f"{found.correction} correction"] * bool(found.correction)
    head = [f"{title}, {', '.join(how)}", ""]
    head += [f"  {s.file}" + (f"  sha256 {s.sha256[:12]}..." if s.sha256 else "") for s in found.source]
    head += [""] * bool(found.source) + [
        f"  at {found.time:.3f} s",
        f"  {'quantity':<22}{'value':>14}  {'std. unc.':>11}  unit",
    ]
    head += [_line(value) for value in (*found.attitude, *found.parameters)]
    return "\n".join([*head, *_course_lines(found), *_innovation_lines(found), *_end_lines(found)]) + "\n"


def _course_lines(found: Alignment) -> list[str]:
    """How the uncertainties fell: one line a time, one column a parameter."""
    if not found.course:
        return []
    scales = [_unit_of(p) for p in found.parameters]
    lines = ["", "  standard uncertainty over time"]
    for begin in range(0, len(scales), _COLUMNS):
        part = range(begin, min(begin + _COLUMNS, len(scales)))
        lines.append("  " + f"{'after [s]':>10}" + "".join(f"{found.parameters[i].name:>18}" for i in part))
        lines.append("  " + " " * 10 + "".join(f"{'[' + scales[i][1] + ']':>18}" for i in part))
        for moment in found.course:
            row = "".join(f"{moment.standard_uncertainty[i] * scales[i][0]:>18.4g}" for i in part)
            lines.append("  " + f"{moment.after:>10.1f}" + row)
    return lines


def _innovation_lines(found: Alignment) -> list[str]:
    i = found.innovations
    if i is None:
        return []
    low, high = i.band
    lines = ["", f"  innovations: {i.updates} updates, {i.rejected} with a component outside the gate"]
    lines.append(
        f"  normalised innovations squared {i.mean:.4g} where {i.expected:.4g} is expected (99.9 % band {low:.4g} to {high:.4g})"
    )
    return lines


def _end_lines(found: Alignment) -> list[str]:
    lines = [f"left out: {s.start:.9g} s to {s.stop:.9g} s: {s.reason}" for s in found.skipped]
    alike: dict[tuple[str, str], list[str]] = {}
    for n in found.not_observed:
        alike.setdefault((n.reason, n.shown_by), []).append(
            f"{n.name} ({100 * n.remains:.0f} % of its uncertainty is left)"
        )
    lines += [f"not observed: {', '.join(names)}: {reason}; {shown}" for (reason, shown), names in alike.items()]
    lines += [f"not told apart: {words}" for words in found.not_separated]
    lines += [f"note: {r}" for r in found.remarks]
    return ["", *(part for line in lines for part in _wrapped(line))] if lines else []


def columns_of(recording: Recording) -> tuple[Column, ...]:
    """How a recording is read."""
    return tuple(Column(axis=a, column=c, factor=f) for a, (c, f) in recording.axes.items())


def values_of(names: Sequence[str], given: Sequence[str], values: Array | None, sigmas: Array) -> tuple[Value, ...]:
    """Records from parallel arrays (names, units, values (k,) or None, standard uncertainties (k,))."""
    known: Sequence[float | None] = [None] * len(names) if values is None else [float(v) for v in values]
    return tuple(
        Value(name=n, value=v, unit=u, standard_uncertainty=float(s))
        for n, u, v, s in zip(names, given, known, sigmas, strict=True)
    )
