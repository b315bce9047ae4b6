"""What a fleet's calibrations came to: each parameter over the units, and units that stand out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from .. import results
from .._version import __version__
from ..frames import Array
from ..results import Record, Software
from .chunks import OK
from .summary import CHANCE
from .tasks.about import About

SCHEMA = "sagnac/campaign-fleet/1"
SCHEMA_FILE = Path(__file__).with_name("campaign-fleet-1.schema.json")
_FAR = 6.0
"""Times the spread of the units (and its own uncertainty) at which a unit stands out."""
_FEWEST = 8
"""Units that tell how they spread."""
_NORMAL = 1.482602218505602
"""Standard deviation of a normal distribution over its median absolute deviation."""


class Unit(Record):
    """One recording, in the order of the runs."""

    run: int
    recording: str
    serial: str
    status: str
    p_value: float | None = None


class Spread(Record):
    """One parameter over the units that have it, SI."""

    name: str
    unit: str
    units: int
    mean: float
    spread: float | None
    """Standard deviation over the units."""
    stated: float
    """Root mean square of their standard uncertainties."""
    least: float
    greatest: float
    runs: tuple[int, ...]
    values: tuple[float, ...]
    uncertainties: tuple[float, ...]
    flags: tuple[str, ...] = ()


class FleetSummary(Record):
    """What a fleet's campaign came to so far."""

    schema_id: Literal["sagnac/campaign-fleet/1"] = Field(default="sagnac/campaign-fleet/1", alias="schema")
    kind: Literal["fleet"] = "fleet"
    title: str
    method: str
    done: int
    count: int
    units: tuple[Unit, ...]
    parameters: tuple[Spread, ...]
    software: Software

    @property
    def complete(self) -> bool:
        """Whether all runs are done."""
        return self.done == self.count

    @property
    def refused(self) -> tuple[Unit, ...]:
        """Recordings that gave no calibration."""
        return tuple(u for u in self.units if u.status != OK)

    @property
    def flags(self) -> tuple[str, ...]:
        """What stands out, in words."""
        poor = [
            f"{u.serial}: the residuals do not fit their noise (probability {u.p_value:.1g})"
            for u in self.units
            if u.p_value is not None and u.p_value < CHANCE
        ]
        return (*poor, *(f"{p.name}: {text}" for p in self.parameters for text in p.flags))


class FleetTally:
    """Rows of a fleet, in any order and any parts.

    Parameters
    ----------
    about : About
        What the rows are about.
    """

    def __init__(self, about: About) -> None:
        self.about = about
        self.rows: dict[int, dict[str, Any]] = {}

    def add(self, table: Any) -> None:
        """Add rows, a pyarrow Table; calibrations are left where they are."""
        for row in table.drop_columns(["calibration"]).to_pylist():
            self.rows[row["run"]] = row


def summarise(tally: FleetTally) -> FleetSummary:
    """The summary of the rows in a tally."""
    about = tally.about
    rows = [tally.rows[i] for i in sorted(tally.rows)]
    return FleetSummary(
        title=about.title,
        method=about.method,
        done=len(rows),
        count=about.count,
        units=tuple(
            Unit(run=r["run"], recording=r["recording"], serial=r["serial"], status=r["status"], p_value=r["p_value"])
            for r in rows
        ),
        parameters=tuple(s for p in about.parameters if (s := _spread(p.name, p.unit, rows)) is not None),
        software=Software(version=__version__),
    )


def loads(text: str, source: str) -> FleetSummary:
    """A summary from JSON text; raises InputError as :func:`sagnac.results.loads` does."""
    return results.loads(FleetSummary, SCHEMA, "the summary of a fleet", text, source)


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above; published as :data:`SCHEMA_FILE`."""
    return results.json_schema(FleetSummary, SCHEMA)


def reasons(summary: FleetSummary) -> dict[str, list[str]]:
    """Recordings that gave no calibration, by the reason, their own names left out."""
    out: dict[str, list[str]] = {}
    for unit in summary.refused:
        out.setdefault(unit.status.replace(f"{unit.recording}: ", ""), []).append(unit.recording)
    return out


def _spread(name: str, unit: str, rows: list[dict[str, Any]]) -> Spread | None:
    there = [r for r in rows if r[f"value.{name}"] is not None]
    if not there:
        return None
    values, sigmas = (np.array([r[f"{what}.{name}"] for r in there]) for what in ("value", "sigma"))
    return Spread(
        name=name,
        unit=unit,
        units=len(there),
        mean=float(values.mean()),
        spread=float(values.std(ddof=1)) if len(there) > 1 else None,
        stated=float(np.sqrt(np.mean(sigmas**2))),
        least=float(values.min()),
        greatest=float(values.max()),
        runs=tuple(int(r["run"]) for r in there),
        values=tuple(values.tolist()),
        uncertainties=tuple(sigmas.tolist()),
        flags=tuple(_outliers([r["serial"] for r in there], values, sigmas)),
    )


def _outliers(serials: list[str], values: Array, sigmas: Array) -> list[str]:
    """Units far from the middle of the others, for how these spread."""
    if values.size < _FEWEST:
        return []
    off = values - np.median(values)
    spread = _NORMAL * float(np.median(np.abs(off)))
    times = np.abs(off) / np.maximum(np.hypot(spread, sigmas), 1e-300)
    return [
        f"{serials[i]} is {times[i]:.3g} times the spread of the others from their middle"
        for i in np.flatnonzero(times > _FAR)
    ]
