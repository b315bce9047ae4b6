"""Norm calibration of a unit turned by hand: no rig and no plan, only rests in random attitudes.

The scenario has ``[unit]``, ``[recording]`` and ``gravity`` as any other, and ``[hand]`` in place of rig and plan, see
:class:`Hand`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ... import plan as plans
from ...errors import InputError
from ...frames import Array
from ...plan import Plan
from ...quantities import checked, reads
from ...recording import SENSORS, from_arrays
from ...sensors import Correction
from ...simulate import scenario as scenarios
from ...simulate.build import Built, build
from ...simulate.hand import simulate_hand_turned
from ...simulate.noise import AxisNoise, generator
from ...simulate.records import Record, Time
from ...simulate.scenario import Scenario
from ..spec import Options
from .calibration import calibrated, outcome, slow_notes
from .memory import seed_of, silent, told
from .outcome import Outcome

_MOTION, _NOISE = 7, 2
"""Streams of random numbers: of the hand, and of the noise as in :data:`sagnac.simulate.engine.STREAMS`."""
_GRAVITY = 9.80665
_DRAWS = 40
"""Of attitudes that a bound is taken over."""
_NOWHERE = {"latitude": "45 deg", "plan": {"positions": "check", "dwell": "1 s"}}
"""Stands for rig and plan where a scenario needs some."""


class Hand(Record):
    """How the unit is turned, see :func:`sagnac.simulate.hand.simulate_hand_turned`."""

    attitudes: int = Field(default=24, ge=2, le=10_000)
    rest: Time = 4.0
    """In each attitude."""
    turn: Time = 2.0
    """From one to the next."""
    first_rest: Time = 10.0
    shake: Annotated[float, reads("m/s^2", "0.5 m/s^2"), Field(ge=0)] = 0.5
    """Of the hand's own acceleration."""


@dataclass(frozen=True)
class Turned:
    """A scenario of a unit turned by hand.

    Attributes
    ----------
    scenario : Scenario
        For the unit; its rig and plan stand for nothing.
    hand : Hand
    site : Plan
        With the gravity, and what is stated of the unit.
    """

    scenario: Scenario
    hand: Hand
    site: Plan


def read(table: dict[str, Any]) -> Turned:
    """What is turned, from a scenario's table.

    Raises
    ------
    InputError
        With the keys at fault.
    """
    given = dict(table)
    hand = checked(Hand, given.pop("hand", {}), "scenario", "hand")
    wrong = sorted({"rig", "plan", "segment", "trajectory", "latitude"} & given.keys())
    if wrong:
        raise InputError(f"{', '.join(wrong)}: say nothing on a unit turned by hand; its motion is [hand]")
    given.pop("method", None)
    scenario = scenarios.from_table(given | _NOWHERE)
    if scenario.unit.scale or scenario.unit.temperature is not None:
        raise InputError("unit.scale, unit.temperature: not with a unit turned by hand")
    gravity = {"gravity": given["gravity"]} if "gravity" in given else {"gravity": f"{_GRAVITY} m/s^2"}
    if "gravity_uncertainty" in given:
        gravity["gravity_uncertainty"] = given["gravity_uncertainty"]
    site = plans.from_table(gravity, "scenario")
    return Turned(scenario, hand, site.model_copy(update={"unit": scenario.plan.unit}))


def run(scenario: Turned, options: Options, seed: int) -> Outcome:
    """One calibration.

    Parameters
    ----------
    scenario : Turned
    options : Options
    seed : int
        Of the simulation.

    Raises
    ------
    DataError, InputError
        As :func:`sagnac.calibrate.hand_turned.calibrate` does.
    """
    built = build(scenario.scenario, seed)
    return _calibrated(scenario, built, scenario.site, options)


def bound(scenario: Turned, options: Options, seed: int) -> Outcome:
    """Bound of the accelerometers' parameters: root mean square over some draws, as each run has attitudes of its own.

    The gyros are weighed by their own residuals, which tell no bound.
    """
    built = build(scenario.scenario, seed)
    first = _calibrated(scenario, silent(built), told(scenario.site, built), options)
    own = [n.startswith("accel") for n in first.names]
    variance = np.full(len(own), np.nan)
    variance[own] = np.mean([_variances(scenario, options, seed_of(seed, k)) for k in range(_DRAWS)], axis=0)
    return Outcome(first.names, first.units, first.values, np.diag(variance), first.truth)


def notes(scenario: Turned) -> tuple[str, ...]:
    """As for any calibration."""
    return slow_notes(scenario.scenario, scenario.site)


def _variances(scenario: Turned, options: Options, seed: int) -> Array:
    """Of the accelerometers' parameters, without noise."""
    built = silent(build(scenario.scenario, seed))
    alone = replace(built, job=replace(built.job, channels=tuple(c for c in built.job.channels if c.sensor == "accel")))
    return np.diag(_calibrated(scenario, alone, told(scenario.site, built), options).covariance)


def _calibrated(scenario: Turned, built: Built, site: Plan, options: Options) -> Outcome:
    time, readings = samples(scenario, built)
    recording = from_arrays(time, readings.get("accel"), readings.get("gyro"), name="simulated recording")
    asked = options.model_copy(update={"method": "norm"})
    truth = built.parameters | {f"gyro.g_sensitivity.{i}{j}": 0.0 for i in "xyz" for j in "xyz"}
    return outcome(calibrated(recording, site, asked), truth)


def samples(scenario: Turned, built: Built) -> tuple[Array, dict[str, Array]]:
    """Time, shape (n,), and readings, shape (n, 3), of the triads that are recorded."""
    job, hand = built.job, scenario.hand
    models: dict[str, Correction] = dict(job.models)
    time, *clean = simulate_hand_turned(
        models["accel"],
        models["gyro"],
        generator(job.seed, _MOTION),
        attitudes=hand.attitudes,
        rest=hand.rest,
        turn=hand.turn,
        first_rest=hand.first_rest,
        frequency=job.clock.frequency,
        gravity=scenario.site.site_gravity,
        shake=hand.shake,
    )
    readings = dict(zip(SENSORS, clean, strict=True))
    for channel in job.channels:
        number = list(SENSORS).index(channel.sensor) * 3 + channel.axis
        noise = AxisNoise(channel.noise, 1.0 / job.clock.frequency, job.seed, (_NOISE, number))
        values = np.ascontiguousarray(readings[channel.sensor][:, channel.axis])
        noise.add(values)
        readings[channel.sensor][:, channel.axis] = values
    recorded = {c.sensor for c in job.channels}
    return time, {s: v for s, v in readings.items() if s in recorded}
