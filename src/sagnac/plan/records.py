"""What a plan holds: site, unit, rig and segments. In memory, and in Python calls, everything is SI."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from .. import earth
from ..errors import InputError
from ..files import write_atomically
from .quantities import (
    SIZE,
    AccelDensity,
    Acceleration,
    AccelInstability,
    AccelWalk,
    Angle,
    GSquared,
    GyroDensity,
    GyroInstability,
    GyroWalk,
    Length,
    Quadratic,
    Rate,
    Ratio,
    Time,
    Triple,
    plain,
)


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Noise(_Record):
    """Noise of the sensors, each number for all axes of a triad or three for its x, y, z.

    `accel` and `gyro` are the density of white noise per sqrt(Hz), so that a mean over T seconds has density^2 / T. Slow noise
    may be stated besides, as `sagnac noise` finds it: the bias instability B of IEEE Std 952 and the random walk K of the bias,
    per sqrt(s).
    """

    accel: AccelDensity | None = None
    gyro: GyroDensity | None = None
    accel_instability: AccelInstability | None = None
    gyro_instability: GyroInstability | None = None
    accel_walk: AccelWalk | None = None
    gyro_walk: GyroWalk | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        for key in ("accel", "gyro"):
            each = getattr(self, key)
            if isinstance(each, tuple) and max(each) > 0 and not min(each) > 0:
                raise ValueError(
                    f"{key}: no axis is without white noise; for one that shows none state what it stays below"
                )
        return self

    def of(self, sensor: str, term: str = "") -> tuple[float, float, float] | None:
        """One term of the axes x, y, z of a sensor, SI; None where it is not stated.

        Parameters
        ----------
        sensor : str
            ``accel`` or ``gyro``.
        term : str
            Empty for the density of white noise, which no axis is without: zero for all three states nothing. Or
            ``instability``, ``walk``.
        """
        stated = getattr(self, f"{sensor}_{term}" if term else sensor)
        if stated is None:
            return None
        each = stated if isinstance(stated, tuple) else (stated,) * 3
        return each if term or min(each) > 0 else None


class Limits(_Record):
    """Bounds (one sigma) of what a method cannot see; they go into its uncertainty budget."""

    accel_k2: Annotated[Quadratic, SIZE] | None = None
    gyro_g_squared: Annotated[GSquared, SIZE] | None = None
    accel_drift: Annotated[Acceleration, SIZE] | None = None
    """Change of an accelerometer bias over the whole test."""
    gyro_drift: Annotated[Rate, SIZE] | None = None
    gyro_scale: Annotated[Ratio, SIZE] | None = None
    """Scale error of a gyro whose scale the rig cannot show (roll-isolated y and z)."""


class Unit(_Record):
    """The unit under test."""

    model: str = ""
    serial: str = ""
    noise: Noise = Noise()
    scale: dict[str, str] = {}
    """Nominal scale factors of pulse or count columns: ``{ gyro = "1.1866 pulse/arcsec" }``, or one per axis."""
    accel_k2: Triple | None = None
    """Known quadratic coefficients of the accelerometers x, y, z."""
    limits: Limits = Limits()


Letter = Literal["x", "y", "z"]
AXES: dict[str, Letter] = {"outer": "z", "middle": "x", "inner": "y"}
"""Axes of a turntable from the base to the unit, and the axis of the case that each turns about at zero."""


class Rig(_Record):
    """The rig and how far its settings can be trusted (one sigma)."""

    kind: Literal["turntable", "centrifuge", "roll-isolated"] = "turntable"
    angle_uncertainty: Annotated[Angle, SIZE] = 0.0
    """Each setting of each table axis or gimbal."""
    axis_uncertainty: Annotated[Angle, SIZE] = 0.0
    """Tilt, non-perpendicularity and zero of a turntable; tilt of a centrifuge's arm axis."""
    rate_uncertainty: Annotated[Ratio, SIZE] = 0.0
    """Relative error of the rate, common to all segments."""
    axes: dict[str, Letter] = Field(default=AXES, min_length=1, max_length=3)
    """Names of a turntable's axes in order from the base to the unit, and what each turns about at zero."""
    radius: Length | None = None
    """Effective radius of a centrifuge's arm."""
    radius_uncertainty: Annotated[Length, SIZE] = 0.0
    counter_rotating: bool = True
    """Whether the platform on the arm keeps its direction (or else turns with the arm)."""
    phase_uncertainty: Annotated[Angle, SIZE] = 0.0
    """Of a centrifuge's arm_phase, common to all segments."""
    arm_continuous: bool | None = None
    """How a centrifuge's arm got from segment to segment where arm_phase is not given: turning on steadily (true), or so as to
    pass the same angle at every start (false); left out: as the data fit."""
    encoder_resolution: Annotated[Angle, SIZE] = 0.0
    """Step of a roll-isolated rig's encoder."""
    encoder_uncertainty: Annotated[Angle, SIZE] | None = None
    """Of each harmonic of the encoder's eccentricity; left out: nothing is known of it."""
    encoder_delay: Time | None = None
    """How much later the encoder is read than the samples' time says; left out: estimated."""

    @model_validator(mode="after")
    def _built(self) -> Self:
        letters = list(self.axes.values())
        if any(a == b for a, b in pairwise(letters)):
            raise ValueError(f"axes: two axes in a row turn about {', '.join(letters)}: they would be one axis")
        if self.radius is not None and not self.radius > 0:
            raise ValueError(f"radius: {self.radius:g} m is no radius")
        return self

    @property
    def letters(self) -> tuple[Letter, Letter, Letter]:
        """What the three axes of a turntable turn about; those that it lacks stay at zero."""
        given = list(self.axes.values())
        while len(given) < 3:
            given.append(next(a for a in ("x", "y", "z") if a != given[-1]))
        return given[0], given[1], given[2]

    def texts(self) -> dict[str, str]:
        """What is stated of the rig, by key, as a plan would write it."""
        said = plain(self)
        axes = said.pop("axes", None)
        return {"kind": self.kind, **{k: str(v) for k, v in said.items()}} | ({"axes": ", ".join(axes)} if axes else {})


class Segment(_Record):
    """One position or rate; angles are those at `start`."""

    name: str
    start: Time
    stop: Time
    outer: Angle | None = None
    middle: Angle | None = None
    inner: Angle | None = None
    outer_rate: Rate = 0.0
    middle_rate: Rate = 0.0
    inner_rate: Rate = 0.0
    """Of a turntable's inner axis, or of a roll-isolated rig's inner cylinder on its own."""
    x_azimuth: Angle | None = None
    y_azimuth: Angle | None = None
    z: Literal["up", "down"] | None = None
    arm_rate: Rate = 0.0
    arm_phase: Angle | None = None
    """Of a centrifuge's arm from east at `start`; None: estimated or taken from the arm column."""
    alpha: Angle = 0.0
    beta: Angle = 0.0
    gamma: Angle = 0.0
    stage: Literal["inner", "spin"] | None = None
    spin_rate: Rate = 0.0
    """Of a roll-isolated rig's carrier."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.stop > self.start:
            raise ValueError(f"segment {self.name!r} stops at {self.stop:g} s, not after its start {self.start:g} s")
        return self

    @property
    def angles(self) -> tuple[float, float, float] | None:
        """Outer, middle and inner angle in rad, or None when one is missing."""
        if self.outer is None or self.middle is None or self.inner is None:
            return None
        return self.outer, self.middle, self.inner

    @property
    def rates(self) -> tuple[float, float, float]:
        """Rates of outer, middle and inner axis, rad/s."""
        return self.outer_rate, self.middle_rate, self.inner_rate

    @property
    def turn_rate(self) -> float:
        """Rate of the one axis that turns, rad/s; zero in a static segment."""
        return self.arm_rate or self.spin_rate or self.outer_rate or self.middle_rate or self.inner_rate


# keys that belong to one kind of rig, in [[segment]] and in [rig]
_OWN_KEYS = {
    "turntable": (
        {"outer", "middle", "inner", "outer_rate", "middle_rate", "inner_rate", "x_azimuth", "y_azimuth", "z"},
        {"axes"},
    ),
    "centrifuge": (
        {"arm_rate", "arm_phase", "alpha", "beta", "gamma"},
        {"radius", "radius_uncertainty", "counter_rotating", "phase_uncertainty", "arm_continuous"},
    ),
    "roll-isolated": (
        {"stage", "inner_rate", "spin_rate"},
        {"encoder_resolution", "encoder_uncertainty", "encoder_delay"},
    ),
}


def _foreign(record: BaseModel, kind: str, which: int) -> list[str]:
    """Keys of another kind of rig that were given."""
    others = set().union(*(keys[which] for keys in _OWN_KEYS.values())) - _OWN_KEYS[kind][which]
    return sorted(
        name
        for name in others & record.model_fields_set
        if getattr(record, name) != type(record).model_fields[name].default
    )


def _check_rig(segment: Segment, kind: str) -> None:
    """Refuse a segment that the rig could not run."""
    foreign = _foreign(segment, kind, 0)
    if foreign:
        raise ValueError(f"segment {segment.name!r}: {', '.join(foreign)} says nothing on a {kind} rig (rig.kind)")
    if kind == "turntable" and sum(r != 0 for r in segment.rates) > 1:
        raise ValueError(f"segment {segment.name!r} turns two axes at once; one rate a segment can be calibrated with")
    if kind == "centrifuge" and "arm_rate" not in segment.model_fields_set:
        raise ValueError(f"segment {segment.name!r} lacks arm_rate (0 deg/s for an arm at rest)")
    if kind == "roll-isolated":
        if segment.stage is None:
            raise ValueError(f'segment {segment.name!r} lacks stage ("inner": inner cylinder alone, "spin": carrier)')
        wanted, other = ("inner_rate", "spin_rate") if segment.stage == "inner" else ("spin_rate", "inner_rate")
        if getattr(segment, wanted) == 0 or getattr(segment, other) != 0:
            raise ValueError(f"segment {segment.name!r} of stage {segment.stage!r} needs {wanted}, and no {other}")


class Plan(_Record):
    """Site, unit, rig and segments. See :func:`sagnac.plan.load`."""

    latitude: Angle | None = None
    height: Length = 0.0
    gravity: Acceleration | None = None
    gravity_uncertainty: Annotated[Acceleration, SIZE] = 0.0
    earth_rate: Rate = earth.EARTH_RATE
    unit: Unit = Unit()
    rig: Rig = Rig()
    segment: tuple[Segment, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _own_axis_names(cls, given: Any) -> Any:
        """Keys of a table whose axes have names of their own become outer, middle, inner; axes it lacks stay at zero."""
        rig = given.get("rig") if isinstance(given, dict) else None
        axes = rig.get("axes") if isinstance(rig, dict) else None
        segments = given.get("segment") if isinstance(given, dict) else None
        if not isinstance(axes, dict) or not 0 < len(axes) <= 3 or not isinstance(segments, list | tuple):
            return given
        return {**given, "segment": [_renamed(s, list(axes)) if isinstance(s, dict) else s for s in segments]}

    @model_validator(mode="after")
    def _sound(self) -> Self:
        foreign = _foreign(self.rig, self.rig.kind, 1)
        if foreign:
            raise ValueError(f"rig: {', '.join(foreign)} says nothing on a {self.rig.kind} rig (rig.kind)")
        for s in self.segment:
            _check_rig(s, self.rig.kind)
        if self.rig.kind == "centrifuge" and self.rig.radius is None and any(s.arm_rate for s in self.segment):
            raise ValueError("rig: radius is missing: the arm's radius sets the centripetal acceleration")
        names = [s.name for s in self.segment]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"segment names must differ; used more than once: {', '.join(twice)}")
        in_time = sorted(self.segment, key=lambda s: s.start)
        for first, second in pairwise(in_time):
            if second.start < first.stop - 1e-9:
                raise ValueError(f"segments {first.name!r} and {second.name!r} overlap in time")
        if self.latitude is not None and abs(self.latitude) > math.pi / 2:
            raise ValueError(f"latitude {math.degrees(self.latitude):g} deg is beyond a pole")
        if self.gravity is not None and not 9.7 < self.gravity < 9.9:
            raise ValueError(f"gravity {self.gravity:g} m/s^2 is not found on Earth (9.76 to 9.84); check its unit")
        return self

    @property
    def site_gravity(self) -> float:
        """Measured gravity, else normal gravity of the site.

        Raises
        ------
        InputError
            When neither gravity nor latitude is given.
        """
        if self.gravity is not None:
            return self.gravity
        if self.latitude is None:
            raise InputError("the plan gives neither gravity nor latitude: one of them sets the accelerometers' scale")
        return earth.normal_gravity(self.latitude, self.height)

    def need_latitude(self, why: str) -> float:
        """Latitude in rad, or an :class:`InputError` that says what needs it."""
        if self.latitude is None:
            raise InputError(f"the plan gives no latitude, and {why} needs it")
        return self.latitude

    def to_toml(self) -> str:
        """The plan as TOML text; reading it back gives an equal plan."""
        import tomlkit

        table = plain(self)
        if self.rig.kind == "centrifuge":
            for segment in table.get("segment", []):
                segment.setdefault("arm_rate", "0 deg/s")  # a default, yet nothing to leave to the reader
        names = list(self.rig.axes)
        if names != list(AXES):
            table["segment"] = [_renamed(s, names, back=True) for s in table.get("segment", [])]
        return tomlkit.dumps(table)

    def save(self, path: str | Path) -> None:
        """Write the plan, whole or not at all."""
        with write_atomically(path) as temporary:
            temporary.write_text(self.to_toml(), encoding="utf-8")


def _renamed(segment: dict[str, Any], names: list[str], *, back: bool = False) -> dict[str, Any]:
    """A segment's table with the axes' own names as outer, middle, inner, or the other way round."""
    foreign = [k for k in segment if k.removesuffix("_rate") in AXES and k.removesuffix("_rate") not in names]
    if foreign and not back:
        raise ValueError(
            f"segment {segment.get('name')!r}: {', '.join(foreign)}: the axes are {', '.join(names)} (rig.axes)"
        )
    pairs = [(own + end, standard + end) for own, standard in zip(names, AXES, strict=False) for end in ("", "_rate")]
    to = {standard: own for own, standard in pairs} if back else dict(pairs)
    absent = list(AXES)[len(names) :]
    out = {to.get(key, key): value for key, value in segment.items() if not (back and key in absent)}
    return out if back else {**dict.fromkeys(absent, "0 deg"), **out}
