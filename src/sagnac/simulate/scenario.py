"""A scenario: the unit as it truly is, the rig with its errors, what is done with them, read from TOML.

Every quantity is a text with its unit, as in a plan. What a plan holds (site, ``[rig]``, ``[[segment]]``, nominal scales) is
written as in a plan and checked by it; the rest is truth that nobody at the rig would know.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from .. import plan as plans
from ..errors import InputError
from ..navigate.trajectory import read
from ..navigate.trajectory.course import Course
from ..plan import Plan
from ..quantities import checked, problem
from ..recording import SENSORS
from . import grades
from .recipes import RECIPES
from .records import ERRORS, Errors, Master, Record, SampleFile, TrueUnit


class _File(Record):
    """The file as it stands; what belongs to a kind of rig is read once the kind is known."""

    title: str = ""
    method: Literal[
        "", "four-position", "multi-position", "norm", "table", "centrifuge", "roll-isolated", "transfer", "noise"
    ] = ""
    latitude: Any = None
    height: Any = None
    gravity: Any = None
    gravity_uncertainty: Any = None
    earth_rate: Any = None
    unit: TrueUnit = TrueUnit()
    rig: dict[str, Any] = Field(default={})
    plan: dict[str, Any] | None = None
    segment: list[dict[str, Any]] = Field(default=[])
    recording: SampleFile
    trajectory: Any = None
    master: Master | None = None
    config: dict[str, Any] = Field(default={})


@dataclass(frozen=True)
class Scenario:
    """A scenario, see :func:`load`.

    Attributes
    ----------
    name : str
        File name or shipped name.
    sha256 : str
        Of the file.
    title, method : str
        What it is, and the calibration or alignment that it is for.
    unit : TrueUnit
    kind : str
        ``turntable``, ``centrifuge``, ``roll-isolated`` or ``vehicle``.
    errors : one of :data:`ERRORS`
    recording : SampleFile
    plan : Plan
        Site, unit, rig and segments as the person at the rig states them; empty for a vehicle.
    trajectory, master, config
        Of a vehicle: the course, the master's log, the settings of the alignment.
    """

    name: str
    sha256: str
    title: str
    method: str
    unit: TrueUnit
    kind: str
    errors: Errors
    recording: SampleFile
    plan: Plan
    trajectory: Course | None
    master: Master
    config: dict[str, Any]


def shipped() -> dict[str, str]:
    """Names of the scenarios that come with the package, and what each is."""
    entries = resources.files("sagnac.simulate").joinpath("scenarios").iterdir()
    texts = {e.name.removesuffix(".toml"): e.read_text(encoding="utf-8") for e in entries if e.name.endswith(".toml")}
    return {name: str(tomllib.loads(texts[name])["title"]) for name in sorted(texts)}


def text(source: str | Path) -> str:
    """The file of a scenario, or of a shipped one by its name; raises as :func:`load` does."""
    with _file(source) as path:
        plans.read_toml(path, "scenario")
        return path.read_text(encoding="utf-8-sig")


@contextmanager
def _file(source: str | Path) -> Iterator[Path]:
    path = Path(source)
    if path.suffix == ".toml" or path.is_file():
        yield path
        return
    entry = resources.files("sagnac.simulate").joinpath("scenarios", f"{path.name}.toml")
    if path.name != str(source) or not entry.is_file():
        raise InputError(f"there is no scenario {source}; shipped are {', '.join(shipped())}; or give a .toml file")
    with resources.as_file(entry) as file:
        yield file


def load(source: str | Path) -> Scenario:
    """Read a scenario.

    Parameters
    ----------
    source : str or path
        A TOML file, or the name of a shipped scenario (see :func:`shipped`).

    Raises
    ------
    InputError
        With the key at fault and what to write instead.
    """
    with _file(source) as path:
        table = plans.read_toml(path, "scenario")
        return from_table(table, str(source), hashlib.sha256(path.read_bytes()).hexdigest())


def from_table(table: dict[str, Any], name: str = "scenario", sha256: str = "") -> Scenario:
    """A scenario from the table that a TOML file holds, see :func:`load`."""
    file = checked(_File, table, name)
    rig = dict(file.rig)
    given_errors = rig.pop("errors", {})
    kind = rig.get("kind", "turntable")
    if kind not in ERRORS:
        raise InputError(f"{name}: rig.kind: {kind!r} is none of {', '.join(ERRORS)}")
    if file.method and _RIG_OF.get(file.method, "turntable") != kind:
        raise InputError(f"{name}: method: {file.method!r} is not for a {kind} (rig.kind)")
    errors = checked(ERRORS[kind], given_errors, name, "rig.errors")
    return Scenario(
        name=name,
        sha256=sha256,
        title=file.title,
        method=file.method,
        unit=file.unit,
        kind=kind,
        errors=errors,
        recording=file.recording,
        plan=_vehicle_plan(file, rig, name) if kind == "vehicle" else _plan(file, rig, kind, name),
        trajectory=read.from_table(file.trajectory, name) if kind == "vehicle" else None,
        master=file.master or Master(),
        config=_config(file) if kind == "vehicle" else {},
    )


def _vehicle_plan(file: _File, rig: Mapping[str, Any], name: str) -> Plan:
    """A vehicle has no plan; refuse what belongs to one."""
    if set(rig) - {"kind"}:
        raise InputError(f"{name}: rig: {', '.join(sorted(set(rig) - {'kind'}))} says nothing on a vehicle")
    if file.plan is not None or file.segment:
        raise InputError(f"{name}: plan, segment: a vehicle has a [trajectory] in place of a plan")
    if file.trajectory is None:
        raise InputError(f"{name}: trajectory: is missing; it says where the vehicle goes")
    site = {k: getattr(file, k) for k in ("gravity", "earth_rate") if getattr(file, k) is not None}
    return plans.from_table(site, name)


def _config(file: _File) -> dict[str, Any]:
    """Settings of the alignment: those of the file, with what it says of site and course."""
    site = {k: getattr(file, k) for k in ("gravity", "earth_rate") if getattr(file, k) is not None}
    return {**site, **file.config, "trajectory": file.trajectory}


def _plan(file: _File, rig: Mapping[str, Any], kind: str, name: str) -> Plan:
    """The plan that the person at the rig would write."""
    if file.trajectory is not None or file.master is not None or file.config:
        raise InputError(f'{name}: trajectory, master, config: they belong to a vehicle (rig.kind = "vehicle")')
    if (file.plan is None) == (not file.segment):
        raise InputError(f"{name}: plan: give [plan] or [[segment]], one of them, to say what is done")
    u = file.unit
    stated = {s: getattr(u.noise, s) for s in SENSORS}
    if u.grade is not None:
        stated = {s: v if v is not None else grades.grade(u.grade).noise[s].density for s, v in stated.items()}
    unit = {
        "model": u.model,
        "serial": u.serial,
        "scale": u.scale,
        "limits": u.limits,
        "noise": {s: f"{v!r} {_DENSITY[s]}" for s, v in stated.items() if v and u.state_noise} | _slow(u),
    } | ({"accel_k2": u.accel_k2} if u.accel_k2 is not None else {})
    table = {k: getattr(file, k) for k in _SITE if getattr(file, k) is not None}
    plan = plans.from_table({**table, "unit": unit, "rig": dict(rig), "segment": file.segment}, name)
    if file.plan is None:
        return plan
    recipe = checked(RECIPES[kind], file.plan, name, "plan")
    try:
        return Plan.model_validate({**dict(plan), "segment": tuple(recipe.segments(plan))})
    except InputError as cause:
        raise InputError(f"{name}: {cause}") from cause
    except ValidationError as cause:
        raise InputError(f"{name}: " + "; ".join(problem(e, "plan") for e in cause.errors())) from cause


def _slow(unit: TrueUnit) -> dict[str, str]:
    """The slow noise that the plan states."""
    if not unit.state_slow_noise:
        return {}
    out = {}
    for sensor, (signal, walk) in _SLOW.items():
        model = unit.noise_of(sensor)
        if model.instability:
            out[f"{sensor}_instability"] = f"{model.instability!r} {signal}"
        if model.walk:
            out[f"{sensor}_walk"] = f"{model.walk!r} {walk}"
    return out


_RIG_OF = {"centrifuge": "centrifuge", "roll-isolated": "roll-isolated", "transfer": "vehicle"}
_SITE = ("latitude", "height", "gravity", "gravity_uncertainty", "earth_rate")
_SLOW = {"accel": ("m/s^2", "m/s^2/s^0.5"), "gyro": ("rad/s", "rad/s/s^0.5")}
_DENSITY = {"accel": "m/s^2/Hz^0.5", "gyro": "rad/s/Hz^0.5"}
