"""A course: where a vehicle starts and what it does then, leg by leg, read from TOML."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ...quantities import ABOVE_ZERO, SIZE, Reader, si, takes

_MOST_LEGS = 20_000
_LONGEST = 1e7  # s: four months


def _within(least: float, greatest: float, words: str) -> AfterValidator:
    def check(value: float) -> float:
        if not least <= value <= greatest:
            raise ValueError(f"{value:g} is not within {words}; check its unit")
        return value

    return AfterValidator(check)


@dataclass(frozen=True)
class Climb:
    """How a leg climbs.

    Attributes
    ----------
    kind : str
        ``speed`` (vertical), ``angle`` (of the path) or ``height`` (gained over the leg).
    value : float
        m/s, rad or m.
    """

    kind: Literal["speed", "angle", "height"]
    value: float


_CLIMBS = {"speed": ("m/s", 1000.0), "angle": ("rad", math.radians(80.0)), "height": ("m", 1e5)}


def _climb(given: object) -> Climb:
    if isinstance(given, Climb):
        return given
    for kind, (unit, most) in _CLIMBS.items():
        try:
            value = si(given, unit, "2 m/s")
        except ValueError:
            continue
        if abs(value) > most:
            raise ValueError(f"{given!r} is beyond all sense; check its unit")
        name: Any = kind
        return Climb(name, value)
    raise ValueError(
        f"write a vertical speed, the angle of the path or the height gained over the leg, for example '2 m/s', '3 deg' or "
        f"'300 m'; got {given!r}"
    )


_DEG = ("rad", "5 deg")
_LEVEL = _within(-math.radians(80.0), math.radians(80.0), "80 deg of level")
Time = Annotated[float, takes("s", "300 s"), ABOVE_ZERO]
Ease = Annotated[float, takes("s", "3 s"), SIZE]
Angle = Annotated[float, takes(*_DEG)]
Swing = Annotated[float, takes(*_DEG), SIZE, _within(0.0, math.radians(60.0), "60 deg")]
Speed = Annotated[float, takes("m/s", "10 m/s"), SIZE, Field(le=1000.0)]
TurnRate = Annotated[float, takes("rad/s", "3 deg/s"), _within(-10.0, 10.0, "10 rad/s")]
Thrust = Annotated[float, takes("m/s^2", "0.5 m/s^2"), _within(-100.0, 100.0, "100 m/s^2")]


class _Record(BaseModel):
    """A table of the file: what it does not know is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Leg(_Record):
    """A part of a course, or a group of parts.

    What a leg does not say is zero: it goes straight on at a steady speed and level.
    """

    duration: Time | None = None
    turn_rate: TurnRate = 0.0
    """Of the track; positive to starboard, so that the heading grows."""
    acceleration: Thrust = 0.0
    """Change of the speed over the ground."""
    climb: Annotated[Climb | None, BeforeValidator(lambda given: None if given is None else _climb(given))] = None
    """Vertical speed, angle of the path, or height gained over the leg, by its unit."""
    ease: Ease | None = None
    """Overrides that of the course."""
    repeat: Annotated[int, Field(ge=1, le=_MOST_LEGS)] = 1
    """How often the leg, or the group, is gone through."""
    legs: tuple[Leg, ...] = ()
    """In place of a duration: a group."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if self.legs and self.model_fields_set - {"legs", "repeat"}:
            own = ", ".join(sorted(self.model_fields_set - {"legs", "repeat"}))
            raise ValueError(f"{own}: a group has legs and repeat only; write it in its legs")
        if not self.legs and self.duration is None:
            raise ValueError('duration is missing, for example duration = "60 s"')
        return self

    def flat(self, name: str) -> Iterator[tuple[str, Leg]]:
        """Its legs in their order, each with its key in the file."""
        for _ in range(self.repeat):
            if not self.legs:
                yield name, self
            for i, leg in enumerate(self.legs):
                yield from leg.flat(f"{name}.legs.{i}")

    @property
    def count(self) -> int:
        """Number of legs that :meth:`flat` yields."""
        return self.repeat * (sum(leg.count for leg in self.legs) or 1)


class Sway(_Record):
    """How the vehicle sways: ``amplitude sin(2 pi t / period + phase)`` is added to roll, pitch, heading and height."""

    roll: Swing = 0.0
    roll_period: Time = 9.0
    roll_phase: Angle = 0.0
    pitch: Swing = 0.0
    pitch_period: Time = 6.0
    pitch_phase: Angle = 0.0
    yaw: Swing = 0.0
    yaw_period: Time = 12.0
    yaw_phase: Angle = 0.0
    heave: Annotated[float, takes("m", "0.5 m"), SIZE, _within(0.0, 100.0, "100 m")] = 0.0
    heave_period: Time = 7.0
    heave_phase: Angle = 0.0


class Course(_Record):
    """A course.

    Attributes
    ----------
    latitude, longitude, height : float, rad and m
        Of the start.
    speed : float, m/s
        Over the ground, at the start.
    heading, pitch, roll : float, rad
        At the start; pitch and roll are kept, the bank comes on top.
    path : str
        ``rhumb``: headings are against north and a straight leg keeps its own. ``great-circle``: a straight leg is a geodesic,
        also over a pole.
    bank : str
        ``level``: turns and climbs leave pitch and roll as they are (a ship). ``coordinated``: the vehicle leans into its turns,
        so that nothing pulls sideways, and its nose follows the path (an aircraft).
    ease : float or None, s
        Time in which turn rate, acceleration and climb of a leg come in. None: at once, where velocity and attitude do not step;
        3 s (or a third of the leg) for a climb, and for all of them with a coordinated bank.
    leg : tuple of Leg
    sway : Sway
    """

    latitude: Annotated[float, takes("rad", "60 deg"), _within(-math.pi / 2, math.pi / 2, "90 deg")]
    longitude: Annotated[float, takes("rad", "108 deg"), _within(-2 * math.pi, 2 * math.pi, "360 deg")] = 0.0
    height: Annotated[float, takes("m", "0 m"), _within(-12e3, 100e3, "-12 km and 100 km")] = 0.0
    speed: Speed
    heading: Annotated[float, takes("rad", "90 deg")]
    pitch: Annotated[float, takes(*_DEG), _LEVEL] = 0.0
    roll: Annotated[float, takes(*_DEG), _LEVEL] = 0.0
    path: Literal["rhumb", "great-circle"] = "rhumb"
    bank: Literal["level", "coordinated"] = "level"
    ease: Ease | None = None
    leg: tuple[Leg, ...]
    sway: Sway = Sway()

    @model_validator(mode="after")
    def _of_sensible_length(self) -> Self:
        count = sum(leg.count for leg in self.leg)
        if not count:
            raise ValueError("leg: a course has one leg at least")
        if count > _MOST_LEGS:
            raise ValueError(f"leg: {count} legs, with all repetitions, are more than {_MOST_LEGS}")
        if self.duration > _LONGEST:
            raise ValueError(
                f"leg: together they take {self.duration:.3g} s, longer than {_LONGEST:g} s; check the units"
            )
        return self

    @property
    def legs(self) -> list[tuple[str, Leg]]:
        """All legs in their order, groups and repetitions resolved, each with its key."""
        return [part for i, leg in enumerate(self.leg) for part in leg.flat(f"leg.{i}")]

    @property
    def duration(self) -> float:
        """Time of all legs, s."""
        return math.fsum(leg.duration or 0.0 for _, leg in self.legs)

    def to_table(self) -> dict[str, Any]:
        """Table of texts with units, defaults left out; ``read.from_table`` gives an equal course."""
        return _plain(self)


def _plain(record: BaseModel) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, info in type(record).model_fields.items():
        value = getattr(record, key)
        if value == info.default and not info.is_required():
            continue
        if isinstance(value, Climb):
            out[key] = _text(value.value, _CLIMBS[value.kind][0])
        elif isinstance(value, BaseModel):
            out[key] = _plain(value)
        elif isinstance(value, tuple):
            out[key] = [_plain(part) for part in value]
        else:
            out[key] = _text(value, _unit_of(info)) if isinstance(value, float) else value
    return out


def _unit_of(info: Any) -> str:
    """Unit of a field that holds a quantity."""
    for part in (
        *info.metadata,
        *(m for a in getattr(info.annotation, "__args__", ()) for m in getattr(a, "__metadata__", ())),
    ):
        if isinstance(getattr(part, "func", None), Reader):
            return str(part.func.unit)
    raise AssertionError(info)


def _text(value: float, unit: str) -> str:
    """A text that reads back as the same number, in degrees where that can be."""
    if unit.startswith("rad"):
        written = unit.replace("rad", "deg")
        for shown in (round(math.degrees(value), 9), math.degrees(value)):
            if si(f"{shown!r} {written}", unit, "") == value:
                return f"{shown!r} {written}"
    return f"{value!r} {unit}"
