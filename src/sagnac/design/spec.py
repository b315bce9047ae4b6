"""What to optimise: a plan's header with a table ``[optimise]`` in place of the segments, read from TOML."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from .. import plan as plans
from .. import units
from ..errors import InputError
from ..plan import Angle, Plan, Rate, Time

Angles = tuple[Angle, ...]
Rates = tuple[Rate, ...]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Grid(_Record):
    """Settings and rates to choose from: every combination is a candidate."""

    directions: Annotated[int, Field(ge=0, le=5000)] = 0
    """Turntable: directions of the vertical spread evenly over the sphere, in place of middle and inner."""
    outer: Angles = (0.0,)
    middle: Angles = (0.0,)
    inner: Angles = (0.0,)
    outer_rate: Rates = (0.0,)
    arm_rate: Rates = ()
    alpha: Angles = (0.0,)
    beta: Angles = (0.0,)
    gamma: Angles = (0.0,)


class Optimise(_Record):
    """The table ``[optimise]``."""

    method: Literal["norm", "table", "centrifuge"]
    sensors: tuple[str, ...] = ("accel", "gyro")
    criterion: Literal["D", "A"] = "D"
    positions: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Number of segments; left out, as many as the time allows."""
    dwell: Time
    """Of a segment; one that turns is held for the next whole number of turns."""
    move: Time = 10.0
    time_budget: Time | None = None
    required: dict[str, str] = {}
    """Largest standard uncertainties by (beginning of) name: met with as few segments as possible, or, where their number is
    given, with as short a dwell as possible."""
    candidates: Grid
    seed: int = 1

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        if self.positions is None and self.time_budget is None:
            raise ValueError("give positions (how many segments), time_budget, or both")
        if not self.dwell > 0 or self.move < 0 or (self.time_budget is not None and not self.time_budget > 0):
            raise ValueError("dwell and time_budget must be positive, move not negative")
        axes = {f"{kind}_{a}" for kind in ("accel", "gyro") for a in "xyz"}
        wrong = [s for s in self.sensors if s not in {"accel", "gyro", *(axes if self.method == "centrifuge" else ())}]
        if wrong or not self.sensors:
            raise ValueError(
                f"sensors are accel and gyro (or accel_x ... gyro_z on a centrifuge), not {', '.join(wrong)}"
            )
        return self


@dataclass(frozen=True)
class Spec:
    """A plan without segments, and what to look for."""

    plan: Plan
    optimise: Optimise

    def required(self) -> dict[str, float]:
        """Required standard uncertainties as they compare with those of parameters, SI.

        Raises
        ------
        InputError
            When a text cannot be read.
        """
        return {name: _si(name, text) for name, text in self.optimise.required.items()}


def _si(name: str, text: str) -> float:
    value = units.quantity(text, f"required.{name}").to_base_units().magnitude
    if not value > 0:
        raise InputError(f"required.{name}: {text!r} is no uncertainty that can be reached")
    return float(value)


def load_spec(path: str | Path) -> Spec:
    """Read what to optimise.

    Parameters
    ----------
    path : path of a TOML file

    Returns
    -------
    Spec

    Raises
    ------
    InputError
        With the key at fault and what to write instead.
    """
    try:
        table: dict[str, Any] = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, ValueError, RecursionError) as cause:
        raise InputError(f"{path}: cannot read it: {cause}") from cause
    return spec_of(table, str(path))


def spec_of(table: dict[str, Any], source: str = "specification") -> Spec:
    """The same from the table that a TOML file holds."""
    asked = table.get("optimise")
    if not isinstance(asked, dict):
        raise InputError(f"{source}: lacks the table [optimise]; without it, `plan check` says what a plan will see")
    header = {k: v for k, v in table.items() if k != "optimise"}
    if "segment" in header:
        raise InputError(f"{source}: has segments; they are what is to be found. Leave them out, or use `plan check`")
    try:
        optimise = Optimise.model_validate(asked, context={"file": True})
    except ValidationError as cause:
        first = cause.errors()[0]
        place = ".".join(str(p) for p in ("optimise", *first["loc"]))
        what = "no such key" if first["type"] == "extra_forbidden" else str(first["msg"]).removeprefix("Value error, ")
        raise InputError(f"{source}: {place}: {what}") from cause
    return Spec(plans.from_table(header, source), optimise)
