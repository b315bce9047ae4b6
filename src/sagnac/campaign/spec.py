"""What a campaign is about, read from TOML: a scenario, a grid of its values and a number of runs, or the logs of a fleet."""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from .. import plan as plans
from ..errors import InputError
from ..files import sha256
from ..quantities import AS_LIST, problem
from ..simulate import scenario as scenarios
from ..simulate.scenario import Scenario
from . import grid as grids

Method = Literal[
    "", "four-position", "multi-position", "norm", "table", "centrifuge", "roll-isolated", "transfer", "hand", "noise"
]
METHODS: tuple[str, ...] = get_args(Method)[1:]
"""Kinds of run."""
OPTIONS = ("method", "matrix", "robust", "closed_form", "terms", "sensors", "threshold")
"""Keys of a campaign that a grid may vary besides those of the scenario."""
MOST_POINTS = 10_000
"""More points than this are taken for a slip."""
_TOLD = 8
"""Problems of grid points that are told one by one."""
_FLEET = ("plan", "units", "scale", "map", "select", "rate", "partial", "serial")
_SIMULATED = ("runs", "seed", "set", "grid", "point", "parameters")

Texts = Annotated[tuple[str, ...], AS_LIST]


class Options(BaseModel):
    """How each run is calibrated: the arguments of :func:`sagnac.calibrate.calibrate`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Method = ""
    """Left out: that of the scenario."""
    matrix: Literal["full", "triangular"] = "full"
    robust: bool = False
    closed_form: bool = False
    terms: Texts = ()
    sensors: Texts = ()
    threshold: float | None = Field(default=None, ge=1.0)


class Settings(Options):
    """The file of a campaign."""

    title: str = ""
    scenario: str | None = None
    """File, relative to the campaign's own folder, or name of a shipped scenario."""
    runs: int = Field(default=1000, ge=1, le=10**9)
    """At each point of the grid."""
    set: Annotated[dict[str, Any], BeforeValidator(grids.single)] = {}
    """Values of the scenario that are other ones at all points, by dotted key."""
    seed: int = Field(default=1, ge=0)
    grid: Annotated[dict[str, tuple[Any, ...]], BeforeValidator(grids.lists)] = {}
    """Values by dotted key; all combinations are run."""
    point: Annotated[tuple[dict[str, Any], ...], BeforeValidator(grids.combinations)] = ()
    """Chosen combinations instead."""
    parameters: Texts = ()
    """Beginnings of the names that are judged against the truth (``accel``, ``gyro.bias``); none: all that have one."""
    recordings: Texts = ()
    """Of a fleet: patterns of files, relative to the campaign's own folder."""
    plan: str | None = None
    """Of a fleet: one plan for all, or with ``{stem}``, the recording's name without its ending, one for each."""
    units: dict[str, str] = {}
    scale: dict[str, str] = {}
    map: dict[str, str] = {}
    select: str | None = None
    rate: str | None = None
    partial: bool = False
    serial: Literal["plan", "file"] | None = None
    """Where a unit's serial number is from; left out: the plan, where each recording has one of its own, or else the file."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.scenario is None) == (not self.recordings):
            raise ValueError("scenario, recordings: give one of them: what is simulated, or the logs of a fleet")
        other, why = (
            (_FLEET, "a fleet (recordings)") if self.scenario is not None else (_SIMULATED, "a simulation (scenario)")
        )
        wrong = [k for k in other if k in self.model_fields_set]
        if wrong:
            raise ValueError(f"{', '.join(wrong)}: belongs to {why}")
        empty = [k for k in ("grid", "point") if k in self.model_fields_set and not getattr(self, k)]
        if empty:
            raise ValueError(f"{empty[0]}: is empty; name keys and their values, or leave it out")
        if self.grid and self.point:
            raise ValueError("grid, point: give one of them: all combinations, or chosen ones")
        if self.recordings and not self.method:
            raise ValueError("method: is missing; it says how the recordings are calibrated")
        if self.recordings and self.method in ("transfer", "hand", "noise"):
            raise ValueError(
                f'method: {self.method!r} is not for a fleet; a unit turned by hand is method = "norm" without plan'
            )
        return self

    @property
    def serial_from(self) -> Literal["plan", "file"]:
        """Where a unit's serial number is from."""
        return self.serial or ("plan" if self.plan is not None and "{stem}" in self.plan else "file")

    def options(self, values: dict[str, Any]) -> Options:
        """Options of a point of the grid; raises as pydantic does."""
        given = {k: getattr(self, k) for k in OPTIONS} | {k: v for k, v in values.items() if k in OPTIONS}
        return Options.model_validate(given)


@dataclass(frozen=True)
class Point:
    """One point of the grid.

    Attributes
    ----------
    values : dict
        What differs from the scenario, by dotted key, as it stands in the file.
    options : Options
        With the method named.
    table : dict
        Of the scenario as it is run.
    """

    values: dict[str, Any]
    options: Options
    table: dict[str, Any] = field(repr=False)


@dataclass(frozen=True)
class Campaign:
    """A campaign, see :func:`load`.

    Attributes
    ----------
    name : str
        Of the file, for messages.
    folder : Path
        That relative names start from; of a fleet absolute, without detours.
    settings : Settings
    points : tuple of Point
        Of the grid; none of a fleet.
    recordings : tuple of Path
        Of a fleet, absolute without detours, in order of their names from the campaign's folder.
    plans : tuple of Path or None
        Of each recording; some may be missing.
    source : Path or None
        File of the scenario; none of a shipped one.
    """

    name: str
    folder: Path
    settings: Settings
    points: tuple[Point, ...] = ()
    recordings: tuple[Path, ...] = ()
    plans: tuple[Path | None, ...] = ()
    source: Path | None = None

    @property
    def inputs(self) -> tuple[Path, ...]:
        """All files that it names."""
        return tuple(dict.fromkeys(p for p in (self.source, *self.recordings, *self.plans) if p is not None))

    @property
    def title(self) -> str:
        """What it is, in words."""
        return self.settings.title or Path(self.name).stem

    @property
    def is_fleet(self) -> bool:
        """Whether recordings are calibrated, and nothing is simulated."""
        return bool(self.settings.recordings)

    @property
    def index_count(self) -> int:
        """Number of runs."""
        return len(self.recordings) if self.is_fleet else len(self.points) * self.settings.runs

    @property
    def keys(self) -> tuple[str, ...]:
        """What the grid varies, by dotted key."""
        return tuple(dict.fromkeys(k for p in self.points for k in p.values))

    def point(self, index: int) -> tuple[int, int]:
        """Number of the grid point of a run, and which of its runs it is, both from zero."""
        return (0, index) if self.is_fleet else divmod(index, self.settings.runs)

    @cached_property
    def identity(self) -> dict[str, str]:
        """Everything that the results depend on, as texts by name: what differs between two campaigns can be told."""
        settings = self.settings.model_dump(mode="json", exclude={"title", "scenario", "set", "recordings", "plan"})
        out = {f"campaign.{k}": json.dumps(v, sort_keys=True) for k, v in settings.items()}
        for i, p in enumerate(self.points):
            out[f"point {i}"] = json.dumps([p.values, p.options.model_dump(mode="json"), p.table], sort_keys=True)
        if self.is_fleet:
            out["campaign.serial"] = json.dumps(self.settings.serial_from)
        return out | self.digests

    @cached_property
    def digests(self) -> dict[str, str]:
        """SHA-256 of the recordings and plans of a fleet by their shown names, as they are when this is asked for first."""
        files = sorted({*self.inputs} - {self.source})
        return {shown(f, self.folder): sha256(f) if f.exists() else "missing" for f in files}

    @property
    def doubles(self) -> tuple[tuple[str, ...], ...]:
        """Shown names of recordings that are the same, byte for byte."""
        names: dict[str, list[str]] = {}
        for file in self.recordings:
            name = shown(file, self.folder)
            names.setdefault(self.digests[name], []).append(name)
        return tuple(tuple(same) for same in names.values() if len(same) > 1)


def load(path: str | Path) -> Campaign:
    """Read a campaign; every point of its grid is built once.

    Parameters
    ----------
    path : path
        Of a TOML file.

    Raises
    ------
    InputError
        With all keys at fault and what to write instead.
    """
    return from_table(plans.read_toml(path, "campaign"), str(path), Path(path).absolute().parent)


def from_table(table: dict[str, Any], name: str = "campaign", folder: str | Path = ".") -> Campaign:
    """A campaign from the table that a TOML file holds, see :func:`load`; `folder` is where relative names start from."""
    try:
        settings = Settings.model_validate(table)
    except ValidationError as cause:
        told = dict.fromkeys(problem(e, "").removeprefix("the file: ") for e in cause.errors())
        raise InputError(f"{name}: " + "; ".join(told)) from cause
    folder = Path(folder)
    if settings.recordings:
        return _fleet(name, folder, settings)
    file = _scenario_file(folder, settings)
    return Campaign(name, folder, settings, points=_points_of(name, file, settings), source=file)


def scenario(point: Point, name: str = "scenario") -> Scenario:
    """The scenario of a point; raises as :func:`sagnac.simulate.scenario.load` does."""
    return scenarios.from_table(point.table, name)


# ------------------------------------------------------------------------------------------------------- the grid


def _points_of(name: str, file: Path | None, settings: Settings) -> tuple[Point, ...]:
    """Points of the grid, each with its scenario built to see whether it can be run."""
    try:
        table = grids.replaced(_scenario_table(name, file, settings), settings.set)
    except ValueError as cause:
        raise InputError(f"{name}: set: {cause}") from cause
    given = list(settings.point) if settings.point else grids.product(settings.grid)
    if len(given) > MOST_POINTS:
        raise InputError(f"{name}: grid: {len(given)} points are more than {MOST_POINTS}; take fewer values")
    out: list[Point] = []
    wrong: dict[str, str] = {}
    for values in given:
        try:
            out.append(_point(table, settings, values))
        except (InputError, ValueError) as cause:
            told = ", ".join(f"{k} = {grids.text(v)}" for k, v in values.items())
            wrong.setdefault(_said(cause), f"grid: {told}: " if told else "")
    if wrong:
        lines = [where + what for what, where in wrong.items()]
        more = f"; and {len(lines) - _TOLD} more" if len(lines) > _TOLD else ""
        raise InputError(f"{name}: " + "; ".join(lines[:_TOLD]) + more)
    return tuple(out)


def _said(cause: Exception) -> str:
    if isinstance(cause, ValidationError):
        return "; ".join(dict.fromkeys(problem(e, "") for e in cause.errors()))
    return str(cause).removeprefix("scenario: ")


def _point(table: dict[str, Any], settings: Settings, values: dict[str, Any]) -> Point:
    """One point, built once; raises InputError, or ValueError where a key is wrong."""
    from ..simulate.build import build

    options = settings.options(values)
    own = grids.replaced(table, {k: v for k, v in values.items() if k not in OPTIONS})
    method = options.method or own.get("method", "")
    if method not in METHODS:
        raise InputError(f"method: is missing: the scenario names {method!r}; choose from {', '.join(METHODS)}")
    options = options.model_copy(update={"method": method})
    if method == "hand":
        from .tasks.hand import read

        read(own)
        return Point(values, options, own)
    own["method"] = _truth_of(options)
    point = Point(values, options, own)
    build(scenario(point), 0)
    return point


def _truth_of(options: Options) -> str:
    """Method that a scenario takes for its own: it says in which frame the truth is given."""
    if options.method == "noise":
        return ""
    # triangular matrices are those of the accelerometers' own frame, which is that of the norm method's truth
    return "norm" if options.method == "multi-position" and options.matrix == "triangular" else options.method


def _scenario_file(folder: Path, settings: Settings) -> Path | None:
    """File of the scenario; none of a shipped one."""
    file = folder / str(settings.scenario)
    return file if file.suffix == ".toml" or file.is_file() else None


def _scenario_table(name: str, file: Path | None, settings: Settings) -> dict[str, Any]:
    try:
        return plans.read_toml(file, "scenario") if file else tomllib.loads(scenarios.text(str(settings.scenario)))
    except InputError as cause:
        raise InputError(f"{name}: scenario: {cause}") from cause


# ------------------------------------------------------------------------------------------------------ the fleet


def _fleet(name: str, folder: Path, settings: Settings) -> Campaign:
    """The recordings of a fleet and their plans."""
    folder = _plain(folder)
    found: set[Path] = set()
    for pattern in settings.recordings:
        here = [_plain(p) for p in _matching(folder, pattern)]
        if not here:
            raise InputError(f"{name}: recordings: no file matches {pattern!r} in {folder}")
        found |= set(here)
    files = sorted(found, key=lambda f: shown(f, folder))
    stems = [f.stem for f in files]
    double = sorted({s for s in stems if stems.count(s) > 1})
    if double:
        raise InputError(f"{name}: recordings: several files are called {double[0]!r}: their results would be too")
    own = [None if settings.plan is None else _plain(folder / settings.plan.replace("{stem}", s)) for s in stems]
    _need_a_plan(name, list(dict.fromkeys(p for p in own if p is not None)))
    return Campaign(name, folder, settings, recordings=tuple(files), plans=tuple(own))


def _need_a_plan(name: str, files: list[Path]) -> None:
    """Refuse a fleet none of whose plans can be read; where one can, the others cost their own recordings alone."""
    first: InputError | None = None
    for plan in files:
        if not plan.is_file():
            more = f" and {len(files) - 1} more" if len(files) > 1 else ""
            first = first or InputError(f"{name}: plan: there is no {plan}{more}")
            continue
        try:
            plans.load(plan)
        except InputError as cause:
            first = first or cause
        else:
            return
    if first is not None:
        raise first


def _matching(folder: Path, pattern: str) -> list[Path]:
    """Files of a pattern, or the file or folder (a bag may be one) of that very name."""
    exact = folder / pattern
    if exact.exists():
        return [exact]
    if Path(pattern).is_absolute():
        root = Path(Path(pattern).anchor)
        return list(root.glob(str(Path(pattern).relative_to(root))))
    return list(folder.glob(pattern))


def _plain(file: Path) -> Path:
    """Absolute and without detours; links stay: the name that somebody gave a file is that of its results."""
    return Path(os.path.abspath(file))  # noqa: PTH100 - resolve() would follow links


def shown(file: Path, folder: Path) -> str:
    """A file's name from the campaign's folder: the same wherever the campaign and its logs are moved together."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return file.as_posix()
