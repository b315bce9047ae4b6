"""The result of a noise test: terms of every axis with their uncertainty, curves, what disturbed the log. JSON in and out.

The JSON Schema of the file is :data:`SCHEMA_FILE`, published with the package. All numbers are SI or counts.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from .. import results
from ..calibration import Environment, UnitName
from ..frames import Array
from ..results import Record, Software, Source

SCHEMA = "sagnac/noise/1"
SCHEMA_FILE = Path(__file__).with_name("noise-1.schema.json")
Found = Literal[
    "dead",
    "stuck",
    "saturated",
    "rounded",
    "repeated",
    "motion",
    "restless",
    "step",
    "drift",
    "shock",
    "temperature",
    "line",
    "gap",
    "misfit",
]
"""Kinds of disturbances."""


class TermValue(Record):
    """One coefficient: standard uncertainty and 95 % interval, in `unit`."""

    key: str
    """``quantisation``, ``white``, ``instability``, ``walk``, ``ramp``, ``markov``, ``markov_time``."""
    value: float
    standard_uncertainty: float = Field(ge=0)
    lower: float
    upper: float | None
    """None where nothing in the log keeps it from being larger."""
    unit: str


class Limit(Record):
    """A term that the log does not show: it is below `upper` with 95 % probability."""

    key: str
    upper: float | None
    unit: str


class TermFit(Record):
    """How well the terms describe the variances."""

    chi2: float
    degrees_of_freedom: int
    p_value: float | None = None
    notes: tuple[str, ...] = ()
    shortest: float = 0.0
    """Averaging time from which on the terms were found, s; shorter ones they do not describe."""


class Curve(Record):
    """Deviation against averaging time [s], its 95 % band, and the deviation of the fitted terms."""

    tau: tuple[float, ...]
    deviation: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    fitted: tuple[float, ...]


class Spectrum(Record):
    """One-sided power spectral density (unit of the readings squared per Hz) against frequency [Hz]."""

    frequency: tuple[float, ...]
    density: tuple[float, ...]
    degrees_of_freedom: tuple[float, ...]


class Axis(Record):
    """One axis that could be judged."""

    name: str
    unit: str
    """Of its readings: m/s^2, rad/s or count."""
    mean: float
    terms: tuple[TermValue, ...]
    covariance: tuple[tuple[float, ...], ...]
    """Of the terms, in their order."""
    absent: tuple[Limit, ...] = ()
    fit: TermFit
    curve: Curve
    spectrum: Spectrum | None = None
    """None where no stretch of the log is long enough."""

    def __getitem__(self, key: str) -> TermValue:
        """Term by key."""
        for t in self.terms:
            if t.key == key:
                return t
        raise KeyError(f"{key!r} is not among the terms of {self.name}: {', '.join(t.key for t in self.terms)}")

    def value(self, key: str) -> float:
        """Value of a term, zero where the log does not show it."""
        return next((t.value for t in self.terms if t.key == key), 0.0)


class Refused(Record):
    """An axis whose result a disturbance would make wrong, and why."""

    name: str
    reason: str


class Disturbed(Record):
    """See :class:`sagnac.noise.findings.disturbances.Disturbance`."""

    kind: Found
    axis: str
    text: str
    spoils: bool
    start: float | None = None
    stop: float | None = None
    size: float | None = None
    significance: float | None = None
    frequency: float | None = None
    stretches: tuple[tuple[float, float], ...] = ()


class Noise(Record):
    """A noise test. :func:`load` reads one, :meth:`save` writes it."""

    schema_id: Literal["sagnac/noise/1"] = Field(default="sagnac/noise/1", alias="schema")
    unit: UnitName = UnitName()
    kind: Literal["allan", "modified", "hadamard"]
    method: Literal["exact", "pyramid"]
    interval: float
    """From sample to sample, s."""
    samples: int
    stretches: tuple[int, ...]
    """Samples between the gaps."""
    axes: tuple[Axis, ...]
    refused: tuple[Refused, ...] = ()
    disturbances: tuple[Disturbed, ...] = ()
    environment: Environment = Environment()
    source: tuple[Source, ...] = ()
    remarks: tuple[str, ...] = ()
    software: Software
    created: str

    def __getitem__(self, name: str) -> Axis:
        """Axis by name."""
        for a in self.axes:
            if a.name == name:
                return a
        raise KeyError(f"{name!r} is not in this result; it has: {', '.join(a.name for a in self.axes) or 'nothing'}")

    @property
    def duration(self) -> float:
        """Time that the samples stand for, s."""
        return self.samples * self.interval

    def triad(self, sensor: str, key: str) -> tuple[float, float, float] | None:
        """A term of the axes x, y, z of a sensor, zero where the log does not show it; None unless all three were judged."""
        found = {a.name: a for a in self.axes}
        names = [f"{sensor}_{a}" for a in "xyz"]
        if not all(n in found for n in names):
            return None
        x, y, z = (found[n].value(key) for n in names)
        return x, y, z

    def to_json(self) -> str:
        """The file's text; numbers are written so that they read back exactly."""
        return results.to_json(self)

    def save(self, path: str | Path) -> None:
        """Write the JSON file, whole or not at all."""
        results.save(self, path)

    def summary(self) -> str:
        """The result as a page of text."""
        from .page import page

        return page(self)


def loads(text: str, source: str = "noise test") -> Noise:
    """A noise test from JSON text, see :func:`load`."""
    return results.loads(Noise, SCHEMA, "a noise test", text, source)


def load(path: str | Path) -> Noise:
    """Read the file of a noise test.

    Raises
    ------
    InputError
        When the file cannot be read, is no noise test, or is of a version that this one does not know.
    """
    return loads(results.read_text(path, "noise test"), str(path))


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above."""
    return results.json_schema(Noise, SCHEMA)


def finite(values: Array) -> tuple[float, ...]:
    """Numbers of a curve for a record."""
    return tuple(float(v) if math.isfinite(v) else 0.0 for v in values.ravel())
