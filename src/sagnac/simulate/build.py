"""From a scenario and a seed to the job of the engine and the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from ..frames import Array, rot_x, rot_y, rot_z
from ..navigate.trajectory.legs import MARGIN
from ..plan import Plan
from ..recording import SENSORS, nominal_scale
from ..rigs import turntable
from ..rigs.roll_isolated import DELAY, ECCENTRICITY, HALF_ANGLE, MOUNT_PITCH, MOUNT_YAW, PHASE, RollRig
from ..sensors import AXES, Correction, Triad, correction
from . import grades
from .centrifuge import SimulatedCentrifuge
from .drawn import Drawn
from .engine import STREAMS, Channel, Clock, Drift, Job, Motion, no_drift
from .motions import CentrifugeMotion, RollMotion
from .noise import NoiseModel, generator
from .records import CentrifugeErrors, RollErrors, TemperatureProfile, TurntableErrors, VehicleErrors
from .scenario import Scenario
from .table import site_of
from .track import TableMotion
from .vehicle import log_times, motion_of

_MOST_SAMPLES = 2**53
_PER_SAMPLE = math.pi
"""A sample must see less than this of a turn, or the turn could not be told from one the other way round."""
_PER_SAMPLE_HARMONICS = math.pi / 3.0
"""The same on a centrifuge, whose third harmonic matters."""


@dataclass(frozen=True)
class Built:
    """What the engine needs, and what is true.

    Attributes
    ----------
    job : Job
    parameters : dict of str to float
        Of unit and rig by name, SI.
    misalignment : str
        ``element`` or ``input-axis``, as in :class:`sagnac.calibration.Calibration`.
    frame : str
        Of the parameters: ``accelerometers`` (their own triad) or ``case`` (of the table, for a method that gives full matrices).
    noise : dict of str to NoiseModel
    details : dict
        Further truth that has no name in conventions: errors of single settings, temperature.
    """

    job: Job
    parameters: dict[str, float]
    misalignment: str
    frame: str
    noise: dict[str, NoiseModel]
    details: dict[str, object] = field(default_factory=dict)


_IN_CASE = ("multi-position",)
_MOUNTED = ("turntable", "centrifuge")


def build(scenario: Scenario, seed: int) -> Built:
    """Draw the truth and set up the job.

    Parameters
    ----------
    scenario : Scenario
    seed : int

    Raises
    ------
    InputError
        When rig, plan and recording do not go together; the key is named.
    """
    try:
        return _build(scenario, seed)
    except InputError as cause:
        raise InputError(f"{scenario.name}: {cause}") from cause


def _build(scenario: Scenario, seed: int) -> Built:
    parameters, slopes = _unit_truth(scenario, seed)
    ratio = scenario.kind == "centrifuge"
    models = {s: _model(parameters, s, ratio=ratio) for s in SENSORS}
    noise = {s: scenario.unit.noise_of(s) for s in SENSORS}
    clock = _clock(scenario)
    motion, rig_truth, details = _MOTIONS[scenario.kind](scenario, generator(seed, STREAMS["rig"]))
    profile = scenario.unit.temperature
    drift = None
    if profile is not None:
        drift = _drift(profile, slopes, clock.count / clock.frequency)
        details["temperature_coefficients"] = {n: v for n, v in slopes.items() if v != 0}
        details["temperature_reference"] = profile.reference
    mount = [parameters[f"rig.mount.{a}"] for a in AXES]
    job = Job(
        motion=motion,
        to_unit=np.asarray((rot_x(mount[0]) @ rot_y(mount[1]) @ rot_z(mount[2])).T),
        models=models,
        channels=_channels(scenario, noise),
        clock=clock,
        seed=seed,
        drift=drift,
        rig=scenario.kind == "roll-isolated" if scenario.recording.rig is None else scenario.recording.rig,
    )
    frame = "case" if scenario.method in _IN_CASE else "accelerometers"
    own = _in_case(parameters, job) if frame == "case" else _of_rig(parameters, scenario.kind)
    return Built(job, {**own, **rig_truth}, "input-axis" if ratio else "element", frame, noise, details)


def _in_case(parameters: dict[str, float], job: Job) -> dict[str, float]:
    """Parameters in the frame of the case, whose matrices are full and hold the mounting angles."""
    out = {
        n: v for n, v in parameters.items() if n.split(".")[1] not in ("scale_error", "misalignment", "bias", "mount")
    }
    for sensor, model in job.models.items():
        triad = Triad(sensor, full=True)
        whole = triad.pack(model.matrix @ job.to_unit, model.bias)
        out |= dict(zip(triad.names, whole.tolist(), strict=True))
    return out


def _of_rig(parameters: dict[str, float], kind: str) -> dict[str, float]:
    """Parameters without the mounting angles that a rig does not have."""
    return {n: v for n, v in parameters.items() if kind in _MOUNTED or not n.startswith("rig.mount.")}


def _unit_truth(scenario: Scenario, seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Coefficients and temperature coefficients: drawn from the grade, then those of the file."""
    told = sorted(grades.FAMILIES) if scenario.kind == "centrifuge" else _ALWAYS
    parameters = {n: 0.0 for term in told for n in grades.names_of(term)}
    slopes: dict[str, float] = {}
    unit = scenario.unit
    if unit.grade is not None:
        drawn, slopes = grades.draw(unit.grade, generator(seed, STREAMS["unit"]))
        parameters |= _of_rig(drawn, scenario.kind)
    if unit.temperature is not None:
        slopes |= _draw(unit.temperature.coefficients, generator(seed, STREAMS["unit"], 2))
    turned = [n for n in unit.parameters if n.startswith("rig.mount.")]
    if turned and scenario.kind not in _MOUNTED:
        raise InputError(f"unit.parameters: {turned[0]}: on this rig the mounting stands in rig.errors")
    return parameters | _draw(unit.parameters, generator(seed, STREAMS["unit"], 1)), slopes


def _draw(laws: dict[str, Drawn], rng: np.random.Generator) -> dict[str, float]:
    """Values by name; they do not depend on the order in the file."""
    return {name: laws[name].draw(rng) for name in sorted(laws)}


_ALWAYS = (
    "accel.scale_error",
    "accel.misalignment",
    "accel.bias",
    "gyro.scale_error",
    "gyro.misalignment",
    "gyro.bias",
    "rig.mount",
)
"""Coefficients that stand in the truth even where they are zero; for a centrifuge all of them do."""


def _model(parameters: dict[str, float], sensor: str, *, ratio: bool) -> Correction:
    model = correction(parameters, sensor, ratio=ratio)
    assert model is not None  # the parameters hold both triads
    return model


def _channels(scenario: Scenario, noise: dict[str, NoiseModel]) -> tuple[Channel, ...]:
    out = []
    for sensor, axes in SENSORS.items():
        for i, name in enumerate(axes):
            if name not in scenario.recording.columns:
                continue
            text = scenario.unit.scale.get(name, scenario.unit.scale.get(sensor))
            worth, increment = nominal_scale(text, sensor, "unit.scale") if text is not None else (0.0, False)
            out.append(Channel(sensor, i, noise[sensor], worth, increment))
        kinds = {(c.worth != 0.0, c.increment) for c in out if c.sensor == sensor}
        if len(kinds) > 1:
            raise InputError(
                f"unit.scale: the axes of the {sensor} triad are read in different ways; give all of them a scale"
            )
    unknown = set(scenario.unit.scale) - {*SENSORS, *(a for axes in SENSORS.values() for a in axes)}
    if unknown:
        raise InputError(f"unit.scale: {', '.join(sorted(unknown))}: none of {', '.join(SENSORS)} or of their axes")
    return tuple(out)


def _clock(scenario: Scenario) -> Clock:
    recording = scenario.recording
    if scenario.trajectory is not None:
        end = scenario.trajectory.duration
    else:
        end = max((s.stop for s in scenario.plan.segment), default=0.0) + recording.rest
    count = math.floor(end * recording.frequency * (1.0 + 1e-15))
    if count < 2:
        raise InputError(f"recording.frequency: {recording.frequency:g} Hz for {end:g} s are less than two samples")
    if count > _MOST_SAMPLES:
        raise InputError(f"recording.frequency: {count:.4g} samples are more than any file holds")
    _refuse_too_fast(scenario)
    if scenario.kind == "vehicle" and recording.jitter > MARGIN:
        raise InputError(
            f"recording.jitter: {recording.jitter:g} s; a vehicle is known only {MARGIN:g} s beyond its course"
        )
    return Clock(recording.frequency, count, recording.jitter, recording.timestamp_jitter)


def _refuse_too_fast(scenario: Scenario) -> None:
    most = _PER_SAMPLE_HARMONICS if scenario.kind == "centrifuge" else _PER_SAMPLE
    rates = [(f"segment {s.name!r}", s.turn_rate) for s in scenario.plan.segment]
    if scenario.trajectory is not None:
        rates = [(f"trajectory.{name}", leg.turn_rate) for name, leg in scenario.trajectory.legs]
    for name, rate in rates:
        turned = abs(rate) / scenario.recording.frequency
        if turned >= most:
            raise InputError(
                f"recording.frequency: {name} turns {math.degrees(turned):.3g} deg from sample to sample at "
                f"{scenario.recording.frequency:g} Hz; this rig needs less than {math.degrees(most):g} deg"
            )


def _drift(profile: TemperatureProfile, slopes: dict[str, float], end: float) -> Drift:
    bias, scale = no_drift(), no_drift()
    for name, value in slopes.items():
        sensor, term, axis = name.split(".")
        {"bias": bias, "scale_error": scale}[term][sensor][AXES.index(axis)] = value
    return Drift(_temperature(profile, end), profile.reference, bias, scale)


def _temperature(profile: TemperatureProfile, end: float) -> Callable[[Array], Array]:
    """Temperature as a function of time."""
    if profile.profile == "sine":
        w = 2.0 * math.pi / profile.period
        return lambda time: profile.start + profile.amplitude * np.sin(w * time)
    slope = 0.0 if profile.stop is None else (profile.stop - profile.start) / end
    return lambda time: profile.start + slope * time


# --------------------------------------------------------------------------------------------------- the rigs

_Rig = tuple[Motion, dict[str, float], dict[str, object]]


def _each(parts: tuple[Drawn, ...], rng: np.random.Generator) -> list[float]:
    return [part.draw(rng) for part in parts]


def setting_errors(law: Drawn, count: int, rng: np.random.Generator) -> Array:
    """Errors of the three settings of each segment, (count, 3)."""
    return np.array([[law.draw(rng) for _ in range(3)] for _ in range(count)]).reshape(count, 3)


def _table(scenario: Scenario, rng: np.random.Generator) -> _Rig:
    given, plan = scenario.errors, scenario.plan
    assert isinstance(given, TurntableErrors)
    tilt, cross, zero = (_each(v, rng) for v in (given.tilt, given.nonperpendicularity, given.zero))
    rate, lever = given.rate.draw(rng), np.array(_each(given.lever_arm, rng))
    errors = turntable.TableErrors((tilt[0], tilt[1]), (cross[0], cross[1]), (zero[0], zero[1], zero[2]))
    settings = setting_errors(given.setting, len(plan.segment), rng)
    motion = TableMotion(plan, site_of(plan), errors, settings, rate, lever)
    truth = {
        **{f"rig.tilt.{a}": v for a, v in zip("xy", tilt, strict=True)},
        **{f"rig.nonperpendicularity.{a}": v for a, v in zip(("middle", "inner"), cross, strict=True)},
        **{f"rig.zero.{a}": v for a, v in zip(("outer", "middle", "inner"), zero, strict=True)},
        **{f"rig.lever_arm.{a}": float(v) for a, v in zip(AXES, lever, strict=True)},
        "rig.rate_error": rate,
    }
    return motion, truth, _named_settings(plan, settings)


def _centrifuge(scenario: Scenario, rng: np.random.Generator) -> _Rig:
    given, plan = scenario.errors, scenario.plan
    assert isinstance(given, CentrifugeErrors)
    radius, rate, phase = given.radius.draw(rng), given.rate.draw(rng), given.phase.draw(rng)
    tilt = _each(given.tilt, rng)
    settings = setting_errors(given.setting, len(plan.segment), rng)
    rig = SimulatedCentrifuge(radius, (tilt[0], tilt[1]), settings, rate, phase, given.continuous)
    truth = {
        "rig.radius": (plan.rig.radius or 0.0) + radius,
        **{f"rig.tilt.{a}": v for a, v in zip("xy", tilt, strict=True)},
        "rig.rate_error": rate,
        "rig.phase_error": phase,
    }
    return CentrifugeMotion(plan, rig), truth, _named_settings(plan, settings)


def _roll(scenario: Scenario, rng: np.random.Generator) -> _Rig:
    given, plan = scenario.errors, scenario.plan
    assert isinstance(given, RollErrors)
    drawn = [given.mount_yaw, given.mount_pitch, given.cone_half_angle, given.cone_phase, given.encoder_delay]
    names = [MOUNT_YAW, MOUNT_PITCH, HALF_ANGLE, PHASE, DELAY, *ECCENTRICITY]
    truth = dict(zip(names, _each((*drawn, *given.encoder_eccentricity), rng), strict=True))
    rate = given.rate.draw(rng)
    motion = RollMotion(plan, RollRig.of(truth), rate, given.swing, given.swing_frequency)
    return motion, {**truth, "rig.rate_error": rate}, {}


def _vehicle(scenario: Scenario, rng: np.random.Generator) -> _Rig:
    given = scenario.errors
    assert isinstance(given, VehicleErrors)
    turned, arm = (np.array(_each(v, rng)) for v in (given.misalignment, given.lever_arm))
    log_times(scenario)  # refuses a log without samples before anything is written
    motion = motion_of(scenario, turned, arm, rng)
    truth = {
        f"{n}.{a}": float(v)
        for n, of in (("misalignment", turned), ("lever_arm", arm))
        for a, v in zip(AXES, of, strict=True)
    }
    flexure = {"sigma": list(given.flexure), "time": given.flexure_time}
    return motion, truth, {"flexure": flexure} if any(given.flexure) else {}


def _named_settings(plan: Plan, settings: Array) -> dict[str, object]:
    return {"setting_errors": {s.name: e for s, e in zip(plan.segment, settings.tolist(), strict=True)}}


_MOTIONS: dict[str, Callable[[Scenario, np.random.Generator], _Rig]] = {
    "turntable": _table,
    "centrifuge": _centrifuge,
    "roll-isolated": _roll,
    "vehicle": _vehicle,
}
"""By rig.kind."""
