"""What a trend says of a unit, as records: JSON in and out."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from .. import results
from ..results import Record, Software
from .drift import Model
from .entries import Parameter
from .series import Series

SCHEMA = "sagnac/trend/1"
SCHEMA_FILE = Path(__file__).with_name("trend-1.schema.json")


class Moment(Record):
    """A calibration in the history: its number, when, by which method."""

    id: int
    created: str
    method: str = ""


class Known(Record):
    """A value with its standard uncertainty and 95 % interval.

    The standard uncertainty is half the interval over 1.96, so that it may be taken for that of a normal distribution.
    """

    value: float
    standard_uncertainty: float = Field(ge=0)
    lower: float
    upper: float


class Expected(Known):
    """What a calibration at a date is expected to find, apart from its own uncertainty."""

    at: str


class Scatter(Record):
    """What scatters about the straight line.

    ``chi2``, ``degrees_of_freedom`` and ``p_value`` are those of a straight line with the stated uncertainties alone, None where
    one of them is zero. ``model`` describes the history best, with white scatter [unit] and random walk [unit/s^0.5] of greatest
    likelihood.
    """

    model: Model
    white: float
    walk: float
    chi2: float | None
    degrees_of_freedom: int
    p_value: float | None


class Bounds(Record):
    """Limits in force; None where there is no bound."""

    lower: float | None
    upper: float | None


class Leaving(Record):
    """When a parameter leaves its limits for the first time.

    ``state`` says what is likelier than not; `earliest` and `latest` enclose the date with 95 % probability, each None where it
    is beyond the horizon. ``probability_outside`` is that at the last calibration.
    """

    state: Literal["already outside", "leaves", "stays"]
    bound: Literal["lower", "upper"]
    probability_outside: float
    date: str | None
    earliest: str | None
    latest: str | None
    horizon_years: float


class Step(Record):
    """A change between two calibrations in a row of more than the uncertainties and the usual changes explain."""

    before: Moment
    after: Moment
    change: float
    joint_standard_uncertainty: float


class ParameterTrend(Record):
    """One parameter; numbers in `unit` and s. What a history of two calibrations or fewer cannot tell is None.

    Of a misalignment, `misalignment` is the convention and `frame` that in which its matrix stands.
    """

    name: str
    unit: str
    misalignment: str = ""
    frame: str = ""
    calibrations: tuple[int, ...]
    times: tuple[str, ...]
    values: tuple[float, ...]
    standard_uncertainties: tuple[float, ...]
    level: Known | None = None
    drift: Known | None = None
    scatter: Scatter | None = None
    expected: Expected | None = None
    limits: Bounds | None = None
    leaving: Leaving | None = None
    steps: tuple[Step, ...] = ()
    remarks: tuple[str, ...] = ()

    def series(self) -> Series:
        """The calibrations as arrays."""
        return Series(
            0,
            Parameter(self.name, self.unit, self.misalignment),
            np.array([datetime.fromisoformat(t).timestamp() for t in self.times]),
            np.array(self.calibrations, dtype=np.int64),
            np.array(self.values),
            np.array(self.standard_uncertainties),
        )


class Trend(Record):
    """The trend of one unit."""

    schema_id: Literal["sagnac/trend/1"] = Field(default="sagnac/trend/1", alias="schema")
    model: str
    serial: str
    at: str
    since: str | None
    calibrations: tuple[Moment, ...]
    parameters: tuple[ParameterTrend, ...]
    remarks: tuple[str, ...] = ()
    software: Software
    created: str

    def __getitem__(self, name: str) -> ParameterTrend:
        """Parameter by name."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise KeyError(f"{name!r} is not in this trend; it has: {', '.join(p.name for p in self.parameters)}")

    def to_json(self) -> str:
        """The file's text."""
        return results.to_json(self)

    def summary(self) -> str:
        """The trend as a page of text."""
        from .told import trend_text

        return trend_text(self)


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above; published as :data:`SCHEMA_FILE`."""
    return results.json_schema(Trend, SCHEMA)
