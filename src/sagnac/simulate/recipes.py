"""Plans by name: which segments a scenario asks for, one record a kind of rig."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from ..errors import InputError
from ..plan import AXES, Angle, Plan, Rate, Segment, Time
from ..quantities import AS_LIST, SIZE
from . import positions
from .records import Record

MOST_SEGMENTS = 10_000
"""More segments than this are taken for a slip."""

Wait = Annotated[Time, SIZE]
Set = Annotated[tuple[Angle, ...], Field(min_length=1), AS_LIST]
Rates = Annotated[tuple[Rate, ...], AS_LIST]
Three = tuple[Angle, Angle, Angle]
Named = Literal["icosahedron", "dodecahedron", "cube-6", "cube-12", "cube-24", "check", "four-position"]


class TableRecipe(Record):
    """Static positions on a table, then the same positions with one axis turning."""

    positions: Named | tuple[Three, ...]
    """A set by name, or the angles of outer, middle and inner axis of each."""
    dwell: Wait = 0.0
    """Time of a static segment; zero leaves them out."""
    turning: Wait = 0.0
    """Time of a turning segment; zero leaves them out."""
    rate: Rates = (math.radians(10.0),)
    """Of the turning axis; each of them in every position."""
    turning_axis: str = "outer"
    """Name of the axis that turns."""
    move: Wait = 10.0
    """Time before the first segment and from one to the next."""

    @model_validator(mode="after")
    def _does_something(self) -> Self:
        if self.dwell == 0 and self.turning == 0:
            raise ValueError("give dwell, turning or both: nothing would be done in any position")
        if self.positions == "four-position" and self.turning > 0:
            raise ValueError("turning: the four-position plan is static")
        if self.turning > 0 and (not self.rate or 0.0 in self.rate):
            raise ValueError("rate: a turning segment has a rate other than zero")
        return self

    def segments(self, plan: Plan) -> list[Segment]:
        """Segments of the plan, one after the other."""
        clock = _Clock(self.move)
        if self.positions == "four-position":
            return [
                Segment(
                    name=str(i), x_azimuth=x, y_azimuth=y, z="up" if z == "up" else "down", **clock.next(self.dwell)
                )
                for i, (x, y, z) in enumerate(positions.four_positions(), 1)
            ]
        axes = dict(zip(plan.rig.axes, AXES, strict=False))
        if self.turning_axis not in axes:
            raise InputError(f"plan.turning_axis: this table has no axis {self.turning_axis!r}, but {', '.join(axes)}")
        places: Sequence[Three]
        if isinstance(self.positions, str):
            places = positions.named(self.positions, plan.rig.letters, len(plan.rig.axes))
        else:
            places = self.positions
        turning = f"{axes[self.turning_axis]}_rate"
        out = []
        for prefix, hold, each in (("s", self.dwell, (0.0,)), ("r", self.turning, self.rate)):
            for k, rate in enumerate(each if hold > 0 else ()):
                for i, angles in enumerate(places, 1):
                    name = f"{prefix}{i}" + (f".{k + 1}" if len(each) > 1 else "")
                    there: dict[str, Any] = dict(zip(AXES, angles, strict=True)) | ({turning: rate} if rate else {})
                    out.append(Segment(name=name, **there, **clock.next(hold)))
        return out


class CentrifugeRecipe(Record):
    """Every setting of the gimbals at every rate of the arm."""

    alpha: Set = (0.0,)
    beta: Set = (0.0,)
    gamma: Set = (0.0,)
    """Settings; every combination is run."""
    settings: tuple[Three, ...] | None = None
    """Or the combinations themselves: alpha, beta, gamma."""
    arm_rate: Rates = Field(min_length=1)
    """Rates of the arm; zero for an arm at rest."""
    turns: Annotated[float, SIZE] | None = None
    """Of the arm in each segment that turns."""
    dwell: Wait = 0.0
    """Time of a segment with the arm at rest, or of every segment where turns is not given."""
    phase: Angle = 0.0
    """Of the arm at the start of each segment."""
    state_phase: bool = True
    """Whether the plan states it."""
    move: Wait = 20.0
    """Time before the first segment and from one to the next."""

    @model_validator(mode="after")
    def _does_something(self) -> Self:
        if not self.turns and self.dwell == 0:
            raise ValueError("give turns or dwell: nothing says how long a segment is")
        if 0.0 in self.arm_rate and self.dwell == 0:
            raise ValueError("dwell: an arm at rest makes no turns, so give the time")
        if self.settings is not None and {"alpha", "beta", "gamma"} & self.model_fields_set:
            raise ValueError("settings: give the combinations, or alpha, beta and gamma, not both")
        return self

    def segments(self, plan: Plan) -> list[Segment]:  # noqa: ARG002 - one signature for all recipes
        """Segments of the plan, one after the other."""
        count = len(self.alpha) * len(self.beta) * len(self.gamma) if self.settings is None else len(self.settings)
        _refuse_many(count * len(self.arm_rate))
        clock = _Clock(self.move)
        out = []
        for i, (alpha, beta, gamma) in enumerate(self._combinations(), 1):
            for k, rate in enumerate(self.arm_rate, 1):
                hold = self.turns * 2.0 * math.pi / abs(rate) if rate and self.turns else self.dwell
                out.append(
                    Segment(
                        name=f"{i}" + (f".{k}" if len(self.arm_rate) > 1 else ""),
                        alpha=alpha,
                        beta=beta,
                        gamma=gamma,
                        arm_rate=rate,
                        arm_phase=self.phase if self.state_phase else None,
                        **clock.next(hold),
                    )
                )
        return out

    def _combinations(self) -> Iterator[Three]:
        if self.settings is not None:
            yield from self.settings
            return
        for gamma in self.gamma:
            for beta in self.beta:
                for alpha in self.alpha:
                    yield alpha, beta, gamma


class RollRecipe(Record):
    """The inner cylinder turned alone, then the whole system spun."""

    inner_rate: Rates = ()
    """Rates of the first stage."""
    inner_time: Wait = 60.0
    """Time at each of them."""
    spin_rate: Rates = ()
    """Rates of the carrier in the second stage."""
    spin_time: Wait = 60.0
    """Time at each of them."""
    move: Wait = 10.0
    """Time before the first segment and from one to the next."""

    @model_validator(mode="after")
    def _does_something(self) -> Self:
        if not self.inner_rate and not self.spin_rate:
            raise ValueError("give inner_rate, spin_rate or both: no segment would turn")
        if 0.0 in (*self.inner_rate, *self.spin_rate):
            raise ValueError("inner_rate, spin_rate: a stage turns at a rate other than zero")
        return self

    def segments(self, plan: Plan) -> list[Segment]:  # noqa: ARG002 - one signature for all recipes
        """Segments of the plan, one after the other."""
        clock = _Clock(self.move)
        out = [
            Segment(name=f"inner {i}", stage="inner", inner_rate=rate, **clock.next(self.inner_time))
            for i, rate in enumerate(self.inner_rate, 1)
        ]
        return out + [
            Segment(name=f"spin {i}", stage="spin", spin_rate=rate, **clock.next(self.spin_time))
            for i, rate in enumerate(self.spin_rate, 1)
        ]


RECIPES: dict[str, type[TableRecipe | CentrifugeRecipe | RollRecipe]] = {
    "turntable": TableRecipe,
    "centrifuge": CentrifugeRecipe,
    "roll-isolated": RollRecipe,
}
"""By rig.kind."""


class _Clock:
    """Start and stop of segments that follow each other."""

    def __init__(self, move: float) -> None:
        self._move = move
        self._now = 0.0
        self._count = 0

    def next(self, hold: float) -> dict[str, Any]:
        self._count += 1
        _refuse_many(self._count)
        start = self._now + self._move
        self._now = start + hold
        return {"start": start, "stop": self._now}


def _refuse_many(count: int) -> None:
    if count > MOST_SEGMENTS:
        raise InputError(f"plan: {count} segments or more are asked for; {MOST_SEGMENTS} are the most")
