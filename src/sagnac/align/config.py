"""Settings of a transfer alignment: method, what is matched, what is known beforehand, noise; read from TOML.

Every quantity in the file is a text with its unit; in memory, and in Python calls, everything is SI. Writing a configuration and
reading it back gives an equal one.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    ValidationError,
    field_validator,
    model_validator,
)

from ..earth import EARTH_RATE
from ..errors import InputError
from ..files import write_atomically
from ..navigate.trajectory import read
from ..navigate.trajectory.course import Course
from ..plan import read_toml
from ..quantities import ABOVE_ZERO, SIZE, Reader, si, takes

# unit -> unit that a person would write, and its size
_WRITTEN = {
    "rad": ("deg", math.pi / 180.0),
    "rad/s": ("deg/h", math.pi / 648000.0),
    "rad/s/Hz^0.5": ("deg/sqrt(h)", math.pi / 10800.0),
}


def _up_to(greatest: float, words: str) -> AfterValidator:
    def check(value: float) -> float:
        if value > greatest:
            raise ValueError(f"{value:g} is more than {words}; check its unit")
        return value

    return AfterValidator(check)


def _thrice(given: object) -> object:
    """One value for all three axes."""
    return given if given is None or isinstance(given, list | tuple) else (given,) * 3


def _noisy(value: float) -> float:
    if not value > 0.0:
        raise ValueError(
            f"{value:g} is no noise: no sensor is free of it, and a filter that is told so errs; write its density"
        )
    return value


_NO_NAME = "\0"
_THRICE = BeforeValidator(_thrice)
_DEG = ("rad", "0.2 deg")

Time = Annotated[float, takes("s", "0.1 s")]
Interval = Annotated[float, takes("s", "0.1 s"), ABOVE_ZERO, _up_to(3600.0, "an hour")]
Update = Annotated[float, takes("s", "0.1 s"), ABOVE_ZERO, _up_to(5.0, "5 s, over which errors do not grow linearly")]
Length = Annotated[float, takes("m", "1.5 m")]
AngleSize = Annotated[float, takes(*_DEG), SIZE, _up_to(math.pi, "180 deg")]
LengthSize = Annotated[float, takes("m", "0.1 m"), SIZE]
SpeedSize = Annotated[float, takes("m/s", "0.2 m/s"), SIZE, _up_to(1000.0, "1000 m/s")]
TimeSize = Annotated[float, takes("s", "0.05 s"), SIZE, _up_to(10.0, "10 s")]
AccelSize = Annotated[float, takes("m/s^2", "50 ug"), SIZE, _up_to(9.80665, "1 g")]
RateSize = Annotated[float, takes("rad/s", "0.01 deg/h"), SIZE, _up_to(math.pi, "180 deg/s")]
SpeedNoise = Annotated[float, takes("m/s", "0.01 m/s"), ABOVE_ZERO, _up_to(1000.0, "1000 m/s")]
AngleNoise = Annotated[float, takes("rad", "1 arcmin"), ABOVE_ZERO, _up_to(math.pi, "180 deg")]
GyroDensity = Annotated[float, takes("rad/s/Hz^0.5", "0.001 deg/sqrt(h)"), AfterValidator(_noisy)]
AccelDensity = Annotated[float, takes("m/s^2/Hz^0.5", "0.833 ug/sqrt(Hz)"), AfterValidator(_noisy)]
GyroWalk = Annotated[float, takes("rad/s/s^0.5", "0.001 deg/h/sqrt(h)"), SIZE]
AccelWalk = Annotated[float, takes("m/s^2/s^0.5", "1 ug/sqrt(h)"), SIZE]
Gravity = Annotated[float, takes("m/s^2", "9.81919 m/s^2")]
Rate = Annotated[float, takes("rad/s", "7.292115e-5 rad/s")]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Initial(_Record):
    """What is known before the alignment begins: one sigma each.

    ``misalignment``, ``gyro_bias``, ``accel_bias`` and ``lever_arm`` are those of x, y, z, or one for all three. ``lever_arm``
    and ``delay`` are estimated when they are given; ``position`` and ``height`` belong to the full set of states.
    """

    misalignment: Annotated[tuple[AngleSize, AngleSize, AngleSize], _THRICE]
    velocity: SpeedSize
    gyro_bias: Annotated[tuple[RateSize, RateSize, RateSize], _THRICE]
    accel_bias: Annotated[tuple[AccelSize, AccelSize, AccelSize], _THRICE]
    position: LengthSize = 10.0
    height: LengthSize = 10.0
    lever_arm: Annotated[tuple[LengthSize, LengthSize, LengthSize] | None, _THRICE] = None
    delay: TimeSize | None = None
    wander: AngleSize = 1e-9


class Noise(_Record):
    """Noise of the slave's sensors (densities) and of each sample of the master (one sigma)."""

    gyro: GyroDensity
    accel: AccelDensity
    velocity: SpeedNoise
    attitude: AngleNoise | None = None
    gyro_walk: GyroWalk = 0.0
    accel_walk: AccelWalk = 0.0


class Flexure(_Record):
    """Bending between master and slave: a second-order Markov process about each axis."""

    sigma: Annotated[tuple[AngleSize, AngleSize, AngleSize], _THRICE]
    time: Interval
    """Correlation time."""


class Config(_Record):
    """Settings of a transfer alignment, SI. See :func:`load`.

    Attributes
    ----------
    method : str
        ``wander``: error model in the wander frame; ``geographic``: in east, north, up, over the wander mechanisation;
        ``north-then-wander``: north-slaved mechanisation and model.
    matching : str
        ``velocity`` or ``velocity+attitude``.
    states : str
        ``short``: the states of Huang et al. 2011 (level velocity, attitude, biases, wander angle); ``full``: with vertical
        velocity, position and height.
    correction : str
        ``feedback``: estimates are taken out of the slave at every update; ``output``: at the end.
    update_interval : float, s
    lever_arm : tuple of 3 floats, m
        From the master to the slave, in body axes.
    gate : float
        Probability inside which an innovation is used; zero uses all.
    latency : float, s
        How much later than true the master's samples are stamped.
    smooth : bool
        Smooth backwards after the filter.
    samples : str
        ``instant``: samples that are no pulses were taken at their time; ``mean``: they are means over the interval before.
    coning : int
        Samples in a group of the coning and sculling correction, 1 to 4.
    gravity : float or None, m/s^2
        Measured at the start; None takes that of the ellipsoid.
    earth_rate : float, rad/s
    initial : Initial
    noise : Noise
    flexure : Flexure or None
    trajectory : Course or None
        For a covariance analysis without data.
    """

    method: Literal["wander", "geographic", "north-then-wander"] = "wander"
    matching: Literal["velocity", "velocity+attitude"] = "velocity"
    states: Literal["short", "full"] = "short"
    correction: Literal["feedback", "output"] = "feedback"
    update_interval: Update = 0.1
    lever_arm: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    gate: float = 0.9999
    latency: Time = 0.0
    smooth: bool = False
    samples: Literal["instant", "mean"] = "instant"
    coning: Literal[1, 2, 3, 4] = 2
    gravity: Gravity | None = None
    earth_rate: Rate = EARTH_RATE
    initial: Initial
    noise: Noise
    flexure: Flexure | None = None
    trajectory: Course | None = None

    @field_validator("gate", mode="before")
    @classmethod
    def _probability(cls, given: object) -> float:
        if given == "off":
            return 0.0
        if not isinstance(given, int | float) or isinstance(given, bool) or not 0.0 <= given < 1.0:
            raise ValueError(f'write a probability below 1, for example 0.9999, or "off"; got {given!r}')
        return float(given)

    @field_validator("trajectory", mode="before")
    @classmethod
    def _course(cls, given: object) -> object:
        if given is None or isinstance(given, Course):
            return given
        try:
            return read.from_table(given, _NO_NAME)
        except InputError as cause:
            raise ValueError(str(cause).removeprefix(f"{_NO_NAME}: ")) from cause

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.matches_attitude and self.noise.attitude is None:
            raise ValueError(
                'noise.attitude is missing: matching = "velocity+attitude" needs the master\'s attitude noise, '
                'for example attitude = "1 arcmin"'
            )
        if self.gravity is not None and not 9.7 < self.gravity < 9.9:
            raise ValueError(f"gravity {self.gravity:g} m/s^2 is not found on Earth (9.76 to 9.84); check its unit")
        if abs(self.latency) > 10.0:
            raise ValueError(f"latency {self.latency:g} s is no lateness of a log; check its unit")
        if max(map(abs, self.lever_arm)) > 1000.0:
            raise ValueError(f"lever_arm {self.lever_arm} m is longer than any vehicle; check its unit")
        if not any(self.initial.misalignment):
            raise ValueError("initial.misalignment is zero on all axes: then nothing is left to align")
        return self

    @property
    def matches_attitude(self) -> bool:
        """Whether the master's attitude is matched too, not its velocity alone."""
        return self.matching == "velocity+attitude"

    def to_toml(self) -> str:
        """The configuration as TOML text; reading it back gives an equal one."""
        import tomlkit

        return tomlkit.dumps(_plain(self))

    def save(self, path: str | Path) -> None:
        """Write the configuration, whole or not at all."""
        with write_atomically(path) as temporary:
            temporary.write_text(self.to_toml(), encoding="utf-8")


def load(path: str | Path) -> Config:
    """Read a configuration.

    Parameters
    ----------
    path : path of a TOML file

    Raises
    ------
    InputError
        With the key at fault and what to write instead.
    """
    return from_table(read_toml(path, "configuration"), str(path))


def from_table(table: dict[str, Any], source: str = "configuration") -> Config:
    """A configuration from the table that a TOML file holds, see :func:`load`."""
    try:
        return Config.model_validate(table, context={"file": True})
    except ValidationError as cause:
        told = dict.fromkeys(f"{_where(e['loc'])}{_what(e)}" for e in cause.errors())
        raise InputError(f"{source}: " + "; ".join(told)) from cause


def _where(location: tuple[int | str, ...]) -> str:
    own = ".".join(str(part) for part in location if part != "tuple[float, float, float]")
    return f"{own}: " if own and own != "trajectory" else ""  # a course names its keys in full


def _what(error: Any) -> str:
    if error["type"] == "extra_forbidden":
        return "no such key"
    if error["type"] == "missing":
        return "is missing"
    if error["type"] == "literal_error":
        return f"{error['input']!r} is none of {error['ctx']['expected'].replace(' or ', ', ')}"
    if error["type"] == "tuple_type":
        return f"write a list of three texts, for x, y and z; got {error['input']!r}"
    return str(error["msg"]).removeprefix("Value error, ")


def _plain(record: BaseModel) -> dict[str, Any]:
    """Table of texts with units, defaults left out."""
    out: dict[str, Any] = {}
    for name, info in type(record).model_fields.items():
        value = getattr(record, name)
        if value is None or (value == info.default and not info.is_required()):
            continue
        out[name] = _plain_value(value, _unit_of(*info.metadata, info.annotation))
    return out


def _plain_value(value: Any, unit: str | None) -> Any:
    if isinstance(value, Course):
        return value.to_table()
    if isinstance(value, BaseModel):
        return _plain(value)
    if isinstance(value, tuple):
        return [_plain_value(v, unit) for v in value]
    return value if unit is None else _text(value, unit)


def _unit_of(*parts: Any) -> str | None:
    """Unit of the quantity that a type, such as a tuple or an optional, is made of."""
    for part in parts:
        if isinstance(getattr(part, "func", None), Reader):
            return str(part.func.unit)
        found = _unit_of(*getattr(part, "__metadata__", ()), *get_args(part))
        if found:
            return found
    return None


def _text(value: float, unit: str) -> str:
    """The shortest text that reads back as the same number, in the unit that a person would write where that can be."""
    if unit in _WRITTEN:
        written, size = _WRITTEN[unit]
        for shown in (round(value / size, 9), value / size):
            if si(f"{shown!r} {written}", unit, "") == value:
                return f"{shown!r} {written}"
    return f"{value!r} {unit}"
