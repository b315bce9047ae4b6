"""What the results of a campaign are about: grid, parameters and their bounds, kept beside the rows."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from ...results import Record


class Parameter(Record):
    """One parameter that is judged, with its SI unit."""

    name: str
    unit: str


class PointAbout(Record):
    """One point of the grid: what differs from the scenario, and the bound of each parameter, in their order."""

    values: dict[str, Any]
    bound: tuple[float | None, ...] = ()
    """Standard uncertainty of the run without noise, SI; null where that run gives none."""
    sure: tuple[bool, ...] = ()
    """Whether the bound says that no run could miss the parameter, in their order."""
    remark: str = ""
    """Why there is no bound."""
    notes: tuple[str, ...] = ()
    """What a reader of the numbers has to know."""


class About(Record):
    """What the rows are about."""

    schema_id: Literal["sagnac/campaign-about/1"] = Field(default="sagnac/campaign-about/1", alias="schema")
    title: str
    kind: Literal["simulation", "fleet"]
    method: str
    runs: int
    """At each point, or recordings of a fleet."""
    seed: int | None = None
    keys: tuple[str, ...] = ()
    parameters: tuple[Parameter, ...]
    points: tuple[PointAbout, ...]

    @property
    def count(self) -> int:
        """Number of runs in all."""
        return self.runs * len(self.points)
