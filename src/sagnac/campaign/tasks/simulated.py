"""Runs of a simulated scenario: what each draws, what is estimated from it, how far that is from the truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any, NamedTuple, Protocol

import numpy as np

from ...errors import DataError, SagnacError
from .. import grid
from ..spec import Campaign, Options
from .about import About, Parameter, PointAbout
from .memory import seed_of
from .outcome import OK, Cell, Outcome, cells, columns

_SURE = 5.0
"""Times its bound from which a parameter cannot be missed."""
_MODULES = {"transfer": "alignment", "hand": "hand", "noise": "noise"}
"""Module of each method; any other is a calibration."""


class Kind(Protocol):
    """A module of this folder that knows how to do one kind of run."""

    def read(self, table: dict[str, Any]) -> Any:
        """What is run, from a scenario's table."""

    def run(self, scenario: Any, options: Options, seed: int) -> Outcome:
        """One run."""

    def bound(self, scenario: Any, options: Options, seed: int) -> Outcome:
        """Estimates whose covariance is the bound, see :func:`prepare`."""

    def notes(self, scenario: Any) -> tuple[str, ...]:
        """What a reader of the results has to know of a scenario."""


def kind(method: str) -> Kind:
    """The module of a method."""
    found: Any = import_module(f"{__package__}.{_MODULES.get(method, 'calibration')}")
    kind_: Kind = found
    return kind_


@lru_cache(maxsize=16)
def _read(method: str, table: str) -> Any:
    """What is run at a point, read once in each process."""
    return kind(method).read(json.loads(table))


@dataclass(frozen=True)
class Simulation:
    """Runs of a simulated scenario over a grid; a task of the campaign's engine.

    Attributes
    ----------
    about : About
    seed, runs : int
        Of the campaign; runs at each point.
    wanted : tuple of str
        Beginnings of the names that are judged.
    tables : tuple of str
        Scenario of each point, as JSON.
    options : tuple of Options
        Of each point.
    """

    about: About
    seed: int
    runs: int
    wanted: tuple[str, ...]
    tables: tuple[str, ...]
    options: tuple[Options, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that are judged."""
        return tuple(p.name for p in self.about.parameters)

    @property
    def columns(self) -> dict[str, str]:
        """Columns of the rows, by the names of their Arrow types."""
        return columns(self.about.keys, self.names)

    def row(self, index: int) -> dict[str, Cell]:
        """One run; a refusal is a row whose status says why."""
        number = index // self.runs
        values = self.about.points[number].values
        out: dict[str, Cell] = dict.fromkeys(self.columns)
        out |= {"run": index, "point": number, "seed": seed_of(self.seed, index)}
        out |= {f"grid.{k}": grid.text(v) for k, v in values.items()}
        try:
            found = self.outcome(index)
        except SagnacError as refused:
            return out | {"status": refusal(refused)}
        return out | {"status": OK} | cells(found, self.names, self.wanted)

    def outcome(self, index: int) -> Outcome:
        """Estimates and truth of one run; raises as the method does."""
        number = index // self.runs
        options = self.options[number]
        return kind(options.method).run(_read(options.method, self.tables[number]), options, seed_of(self.seed, index))


def refusal(error: SagnacError) -> str:
    """Status of a run that gave no result: the first line of what is told."""
    return str(error).splitlines()[0]


class _Bound(NamedTuple):
    """What is known of a point before its runs."""

    sigma: dict[str, float]
    sure: frozenset[str]
    remark: str
    notes: tuple[str, ...]


def prepare(campaign: Campaign, say: Callable[[str], object] | None = None) -> Simulation:
    """The task of a simulated campaign, with the bound at each point.

    The bound of a parameter is its Cramer-Rao bound at the truth: the standard uncertainty that follows from the white
    noise alone when the recording has none of it and the plan states it as it is. It is that of the first run's truth;
    where the truth is drawn, those of other runs differ from it by as much as their units and rigs differ.

    Parameters
    ----------
    campaign : Campaign
    say : callable, optional
        Takes a line on what is done.

    Raises
    ------
    DataError
        When no point's run without noise gives a result: then none with noise would.
    """
    tables = tuple(json.dumps(p.table) for p in campaign.points)
    names: dict[str, str] = {}
    bounds: list[_Bound] = []
    for number, point in enumerate(campaign.points):
        if say is not None and number:
            say(f"bound at point {number} of {len(campaign.points)}")
        seed = seed_of(campaign.settings.seed, number * campaign.settings.runs)
        method = point.options.method
        notes: tuple[str, ...] = ()
        try:
            scenario = _read(method, tables[number])
            notes = kind(method).notes(scenario)
            found = kind(method).bound(scenario, point.options, seed)
        except SagnacError as refused:
            bounds.append(_Bound({}, frozenset(), refusal(refused), notes))
            continue
        at = found.judged(campaign.settings.parameters)
        names |= {found.names[i]: found.units[i] for i in at}
        sigma = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
        own = {found.names[i]: float(sigma[i]) for i in at if np.isfinite(sigma[i])}
        sure = frozenset(n for n, s in own.items() if abs(found.truth[n]) >= _SURE * s)
        bounds.append(_Bound(own, sure, "", notes))
    if not names:
        told = next((b.remark for b in bounds if b.remark), "no parameter has a truth to be judged against")
        raise DataError(f"{campaign.name}: not even a run without noise gives a result: {told}")
    about = About(
        title=campaign.title,
        kind="simulation",
        method=" / ".join(dict.fromkeys(p.options.method for p in campaign.points)),
        runs=campaign.settings.runs,
        seed=campaign.settings.seed,
        keys=campaign.keys,
        parameters=tuple(Parameter(name=n, unit=u) for n, u in names.items()),
        points=tuple(
            PointAbout(
                values=p.values,
                bound=tuple(b.sigma.get(n) for n in names),
                sure=tuple(n in b.sure for n in names),
                remark=b.remark,
                notes=b.notes,
            )
            for p, b in zip(campaign.points, bounds, strict=True)
        ),
    )
    options = tuple(p.options for p in campaign.points)
    return Simulation(
        about, campaign.settings.seed, campaign.settings.runs, campaign.settings.parameters, tables, options
    )
