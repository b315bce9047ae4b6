"""Records of a scenario: the unit as it truly is, errors of rigs, master's log of a vehicle, file of samples."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ..navigate.trajectory.legs import MARGIN
from ..quantities import (
    ABOVE_ZERO,
    AS_LIST,
    SIZE,
    AccelDensity,
    Acceleration,
    AccelWalk,
    Duration,
    Frequency,
    GyroDensity,
    GyroWalk,
    Rate,
    Temperature,
    reads,
    si,
)
from ..recording import SENSORS
from . import grades
from .drawn import Drawn, drawn, drawn_each, draws
from .noise import NO_NOISE, NoiseModel

AXES = tuple(axis for axes in SENSORS.values() for axis in axes)
"""Names of the six sensor columns."""
Sensor = Literal["accel", "gyro", "accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z"]
_ANGLE = ("rad", "5 arcsec")
Time = Annotated[float, reads("s", "300 s"), ABOVE_ZERO]
Two = Annotated[tuple[Drawn, ...], drawn_each(2, *_ANGLE)]
Three = Annotated[tuple[Drawn, ...], drawn_each(3, *_ANGLE)]
Angle = Annotated[Drawn, drawn(*_ANGLE)]
_ZERO = Drawn("exact", 0.0)


class Record(BaseModel):
    """A table of the file: what it does not know is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def _coefficients(given: object, per: str = "") -> object:
    """Texts of coefficients by name as :class:`Drawn`; a name without axis stands for all axes that are not named."""
    if not isinstance(given, dict):
        return given
    whole: dict[str, Drawn] = {}
    single: dict[str, Drawn] = {}
    for name, text in given.items():
        full = grades.names_of(name) if name in grades.FAMILIES else [name]
        unit = grades.unit_of_name(full[0])
        try:
            value = draws(text, f"{unit}{per}", _EXAMPLES.get(unit, f"1 {unit}") + per)
        except ValueError as cause:
            raise ValueError(f"{name}: {cause}") from cause
        (single if full == [name] else whole).update(dict.fromkeys(full, value))
    return whole | single


_WIDEST = 200.0  # K: 5 degC as a difference would be read as 278 K
_EXAMPLES = {
    "m/s^2": "0.8 mg",
    "rad/s": "0.1 deg/h",
    "1": "100 ppm",
    "rad": "1e-4 rad",
    "s^2/m": "12 ug/g^2",
    "s^4/m^2": "3 ug/g^3",
    "rad*s/m": "1 deg/h/g",
    "rad*s^3/m^2": "0.06 deg/h/g^2",
}


class Markov(Record):
    """A first-order Gauss-Markov process of the bias of every axis of a triad."""

    sensor: Literal["accel", "gyro"]
    size: str
    """Standard deviation."""
    time: Time
    """Correlation time."""

    @model_validator(mode="after")
    def _sized(self) -> Self:
        if self.sigma < 0:
            raise ValueError("size: a standard deviation is not negative")
        return self

    @property
    def sigma(self) -> float:
        """Standard deviation, SI."""
        unit, example = {"accel": ("m/s^2", "5 ug"), "gyro": ("rad/s", "0.01 deg/h")}[self.sensor]
        return si(self.size, unit, example)


class TrueNoise(Record):
    """Noise of all axes of a triad; see :class:`sagnac.simulate.noise.NoiseModel`."""

    accel: AccelDensity | None = None
    gyro: GyroDensity | None = None
    accel_instability: Acceleration | None = None
    gyro_instability: Rate | None = None
    instability_band: tuple[Time, Time] = (10.0, 3000.0)
    accel_walk: AccelWalk | None = None
    gyro_walk: GyroWalk | None = None
    markov: tuple[Markov, ...] = ()

    @model_validator(mode="after")
    def _banded(self) -> Self:
        if not self.instability_band[1] > self.instability_band[0]:
            raise ValueError("instability_band: the second correlation time must be longer than the first")
        return self

    def model(self, sensor: str, grade: NoiseModel) -> NoiseModel:
        """Noise of a triad; what the file does not say is that of the grade."""
        of_grade = {"": grade.density, "_instability": grade.instability, "_walk": grade.walk}
        given = {end: getattr(self, sensor + end) for end in of_grade}
        density, instability, walk = (given[e] if given[e] is not None else v for e, v in of_grade.items())
        slow = tuple((m.sigma, m.time) for m in self.markov if m.sensor == sensor)
        return NoiseModel(density, instability, self.instability_band, walk, slow)


class TemperatureProfile(Record):
    """Temperature of the unit over the recording, and what it does to biases and scale errors."""

    profile: Literal["constant", "ramp", "sine"]
    start: Temperature
    """At the beginning; of a sine its mean."""
    stop: Temperature | None = None
    """Of a ramp, at the end of the recording."""
    amplitude: Annotated[float, reads("K", "5 K"), SIZE] = 0.0
    """Of a sine; a difference of temperatures, in K."""
    period: Time = 3600.0
    reference: Temperature = 298.15
    """Temperature at which the coefficients are those of the truth."""
    coefficients: Annotated[dict[str, Drawn], BeforeValidator(lambda given: _coefficients(given, "/K"))] = {}
    """Change of accel.bias.x, gyro.scale_error.y, ... per kelvin; they override those of the grade."""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.profile == "ramp") != (self.stop is not None):
            raise ValueError("stop: a ramp has one, the other profiles do not")
        if (self.profile == "sine") != (self.amplitude != 0):
            raise ValueError("amplitude: a sine has one, the other profiles do not")
        if self.amplitude > _WIDEST:
            raise ValueError(f"amplitude: {self.amplitude:g} K is too wide; write a difference of temperatures in K")
        for name in self.coefficients:
            if name.split(".")[1] not in ("bias", "scale_error"):
                raise ValueError(f"coefficients: {name}: only biases and scale errors change with temperature here")
        return self


class TrueUnit(Record):
    """The unit as it truly is."""

    model: str = ""
    serial: str = ""
    grade: Literal["mems", "tactical", "navigation"] | None = None
    """What is not given is drawn from it; without one it is zero."""
    parameters: Annotated[dict[str, Drawn], BeforeValidator(_coefficients)] = {}
    """Coefficients by name; they override those of the grade."""
    noise: TrueNoise = TrueNoise()
    temperature: TemperatureProfile | None = None
    scale: dict[str, str] = {}
    """Nominal scale factors, as in a plan: such axes are recorded as whole pulses or counts."""
    state_noise: bool = True
    """Whether the plan states the density of the white noise."""
    state_slow_noise: bool = False
    """Whether the plan states bias instability and walk besides."""
    accel_k2: Any = None
    """As in a plan: what the person at the rig knows of it."""
    limits: dict[str, Any] = {}

    def noise_of(self, sensor: str) -> NoiseModel:
        """Noise of a triad, given or that of the grade.

        Parameters
        ----------
        sensor : str
            ``accel`` or ``gyro``.
        """
        return self.noise.model(sensor, NO_NOISE if self.grade is None else grades.grade(self.grade).noise[sensor])


class TurntableErrors(Record):
    """Errors of a turntable."""

    tilt: Two = (_ZERO, _ZERO)
    nonperpendicularity: Two = (_ZERO, _ZERO)
    zero: Three = (_ZERO, _ZERO, _ZERO)
    setting: Angle = _ZERO
    """Of each setting of each axis."""
    rate: Annotated[Drawn, drawn("1", "10 ppm")] = _ZERO
    """Relative error of all rates."""
    lever_arm: Annotated[tuple[Drawn, ...], drawn_each(3, "m", "10 cm")] = (_ZERO, _ZERO, _ZERO)
    """From where the axes meet to the unit, in the case."""


class CentrifugeErrors(Record):
    """Errors of a centrifuge."""

    radius: Annotated[Drawn, drawn("m", "0.1 mm")] = _ZERO
    tilt: Two = (_ZERO, _ZERO)
    setting: Angle = _ZERO
    """Of each setting of each gimbal."""
    rate: Annotated[Drawn, drawn("1", "100 ppm")] = _ZERO
    """Relative error of all rates of the arm."""
    phase: Angle = _ZERO
    """Of the arm's phase."""
    continuous: bool = False
    """Whether the arm turns on from segment to segment from the first one's phase; otherwise each starts at its own."""


class RollErrors(Record):
    """Parameters and errors of a roll-isolated rig."""

    mount_yaw: Angle = _ZERO
    mount_pitch: Angle = _ZERO
    cone_half_angle: Angle = _ZERO
    cone_phase: Angle = _ZERO
    encoder_delay: Annotated[Drawn, drawn("s", "0.1 ms")] = _ZERO
    encoder_eccentricity: Annotated[tuple[Drawn, ...], drawn_each(4, *_ANGLE)] = (_ZERO,) * 4
    """Cosine and sine of the first, then of the second harmonic."""
    rate: Annotated[Drawn, drawn("1", "100 ppm")] = _ZERO
    """Relative error of all rates."""
    swing: Annotated[float, reads("rad", "5 deg")] = 0.0
    """Amplitude of the inner cylinder's swing while the carrier spins."""
    swing_frequency: Annotated[float, reads("Hz", "1.7 Hz"), ABOVE_ZERO] = 1.7


def _thrice(given: object) -> object:
    """One value for all three axes."""
    return given if isinstance(given, list | tuple) else [given] * 3


Bend = Annotated[float, reads("rad", "1 arcmin"), SIZE, Field(le=0.1)]


class VehicleErrors(Record):
    """How the slave sits on the master's vehicle."""

    misalignment: Three = (_ZERO, _ZERO, _ZERO)
    """Rotation vector from the master's body axes to the slave's."""
    lever_arm: Annotated[tuple[Drawn, ...], drawn_each(3, "m", "10 cm")] = (_ZERO, _ZERO, _ZERO)
    """From the master to the slave, in the master's body axes."""
    flexure: Annotated[tuple[Bend, Bend, Bend], BeforeValidator(_thrice)] = (0.0, 0.0, 0.0)
    """Standard deviation of how the slave's foot turns against the master, about each axis."""
    flexure_time: Time = 1.0
    """Its correlation time."""


ERRORS: dict[str, type[TurntableErrors | CentrifugeErrors | RollErrors | VehicleErrors]] = {
    "turntable": TurntableErrors,
    "centrifuge": CentrifugeErrors,
    "roll-isolated": RollErrors,
    "vehicle": VehicleErrors,
}
"""By rig.kind."""


class Master(Record):
    """What the master's log holds, and its noise."""

    frequency: Annotated[Frequency, Field(le=1000.0)] = 10.0
    velocity: Annotated[float, reads("m/s", "0.01 m/s"), SIZE] = 0.0
    """White noise of each sample."""
    attitude: Annotated[float, reads("rad", "1 arcmin"), SIZE] = 0.0
    latency: Annotated[Duration, Field(le=MARGIN)] = 0.0
    """How much before its time stamp a sample was true."""
    gap: tuple[tuple[Duration, Time], ...] = ()
    """Parts of the log that are missing, each from its first time up to its second."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for start, stop in self.gap:
            if not stop > start:
                raise ValueError(f"gap: from {start:g} s to {stop:g} s is no time; write the earlier one first")
        return self


class SampleFile(Record):
    """The file of samples."""

    frequency: Frequency
    jitter: Duration = 0.0
    """Each sample is taken up to this much early or late (uniform); its time stamp tells."""
    timestamp_jitter: Duration = 0.0
    """Each time stamp is wrong by up to this much (uniform)."""
    format: Literal["parquet", "csv"] = "parquet"
    sensors: Annotated[tuple[Sensor, ...], AS_LIST] = ("accel", "gyro")
    rig: bool | None = None
    """Whether the rig's own channels are recorded (table angles, arm angle, encoder); left out: the encoder only."""
    rest: Duration = 1.0
    """Time recorded after the last segment."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Sensor columns in their usual order."""
        wanted = {axis for s in self.sensors for axis in SENSORS.get(s, (s,))}
        return tuple(axis for axis in AXES if axis in wanted)

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if 2.0 * (self.jitter + self.timestamp_jitter) * self.frequency >= 1.0:
            raise ValueError(
                f"jitter, timestamp_jitter: together {self.jitter + self.timestamp_jitter:g} s, with samples "
                f"{1 / self.frequency:g} s apart: time would not increase"
            )
        if not self.sensors:
            raise ValueError("sensors: none is recorded")
        return self


Errors = TurntableErrors | CentrifugeErrors | RollErrors | VehicleErrors
