"""Noise coefficients identified from a simulated rest."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import InputError
from ...frames import Array
from ...noise.curves.allan import octaves, variances
from ...noise.identification.bound import information
from ...noise.identification.identify import identify
from ...noise.identification.terms import level, units
from ...plan import Segment
from ...recording import SENSORS, sample_interval
from ...sensors import AXES
from ...simulate import scenario as scenarios
from ...simulate.build import Built, build
from ...simulate.noise import NoiseModel
from ...simulate.scenario import Scenario
from ..spec import Options
from .memory import recording_of
from .outcome import Outcome

BEYOND = 30.0
"""Longest correlation time of ideal flicker noise, in lengths of the rest."""
_CLOSE = 1e-6
"""Relative difference of correlation times that is none."""


def read(table: dict[str, Any]) -> Scenario:
    """The scenario of a table, see :func:`completed`."""
    return scenarios.from_table(completed(table))


def completed(table: dict[str, Any]) -> dict[str, Any]:
    """The table of a scenario with a band of the bias instability: ideal flicker noise where it states none.

    What `identify` looks for has the spectrum of flicker noise at every frequency that the rest can tell: correlation times
    from the sample interval to 30 times the rest. In the simulator's default band it is not that.

    Parameters
    ----------
    table : dict
        Of a scenario.
    """
    scenario = scenarios.from_table(table)
    if "instability_band" in scenario.unit.noise.model_fields_set or not _still(scenario):
        return table
    rest = _rest(scenario)
    interval = 1.0 / scenario.recording.frequency
    band = [f"{interval!r} s", f"{BEYOND * (rest.stop - rest.start)!r} s"]
    unit = dict(table.get("unit", {}))
    return table | {"unit": unit | {"noise": dict(unit.get("noise", {})) | {"instability_band": band}}}


def notes(scenario: Scenario) -> tuple[str, ...]:
    """That the bias instability is not flicker noise over the whole of the rest."""
    rest = _rest(scenario)
    shortest, longest = scenario.unit.noise.instability_band
    ideal = shortest <= 1.0 / scenario.recording.frequency * (1.0 + _CLOSE) and longest >= BEYOND * (
        rest.stop - rest.start
    ) * (1.0 - _CLOSE)
    if ideal or not any(scenario.unit.noise_of(s).instability > 0 for s in SENSORS):
        return ()
    told = (
        f"unit.noise.instability_band is stated, {shortest:g} s to {longest:g} s: outside of it the bias instability is no "
        "flicker noise, as the identification takes it to be; B then comes out biased, and its intervals miss the stated value"
    )
    return (told,)


def run(scenario: Scenario, options: Options, seed: int) -> Outcome:  # noqa: ARG001 - there is one way to identify noise
    """Coefficients of every axis, from the longest segment at rest.

    Parameters
    ----------
    scenario : Scenario
        On a turntable.
    options : Options
    seed : int
        Of the simulation.

    Raises
    ------
    DataError, InputError
        As :func:`sagnac.noise.identification.identify.identify` does, and when nothing rests.
    """
    built = build(scenario, seed)
    rest = _rest(scenario)
    batch = recording_of(built, scenario.plan).read()
    inside = slice(*np.searchsorted(batch.time, [rest.start, rest.stop]))
    interval = sample_interval(batch.time[inside])
    names: list[str] = []
    given: list[str] = []
    values: list[float] = []
    blocks: list[Array] = []
    chi2, degrees = 0.0, 0
    for sensor in SENSORS:
        samples = getattr(batch, sensor)
        if samples is None:
            continue
        found = variances(samples[inside], interval, octaves(len(samples[inside])))
        for axis, letter in enumerate(AXES):
            one = identify(found, axis)
            names += [f"{sensor}.{c.key}.{letter}" for c in one.coefficients]
            given += [units(c.key, sensor)[0] for c in one.coefficients]
            values += [c.value for c in one.coefficients]
            blocks.append(one.covariance)
            chi2, degrees = chi2 + one.chi2, degrees + one.degrees_of_freedom
    covariance = _block_diagonal(blocks)
    return Outcome(tuple(names), tuple(given), np.array(values), covariance, _truth(built), chi2, degrees)


def bound(scenario: Scenario, options: Options, seed: int) -> Outcome:  # noqa: ARG001 - as above
    """Bound of each coefficient that is there, from the Fisher information of its spectrum (same parameters and errors)."""
    built = build(scenario, seed)
    rest = _rest(scenario)
    interval = 1.0 / built.job.clock.frequency
    samples = int((rest.stop - rest.start) / interval)
    truth = _truth(built)
    names: list[str] = []
    given: list[str] = []
    sigmas: list[float] = []
    for channel in built.job.channels:
        there = _coefficients(built.noise[channel.sensor])
        levels = {k: level(k, v, interval) for k, v in there.items() if k != "markov_time"}
        if not levels:
            continue
        decay = interval / there["markov_time"] if "markov_time" in there else 0.0
        keys, matrix = information(levels, samples, decay)
        spread = np.sqrt(np.diag(np.linalg.inv(matrix)))
        for key, relative in zip(keys, spread, strict=True):
            names.append(f"{channel.sensor}.{key}.{AXES[channel.axis]}")
            given.append(units(key, channel.sensor)[0])
            # a coefficient goes with the root of its level, a correlation time with the decay itself
            sigmas.append(there[key] * float(relative) * (1.0 if key == "markov_time" else 0.5))
    if not names:
        raise InputError("unit.noise: there is none to identify")
    values = np.array([truth[n] for n in names])
    return Outcome(tuple(names), tuple(given), values, np.diag(np.square(sigmas)), truth)


def _rest(scenario: Scenario) -> Segment:
    """The longest segment at rest."""
    still = _still(scenario)
    if not still:
        raise InputError("plan: no segment is at rest, from which noise could be identified")
    return max(still, key=lambda s: s.stop - s.start)


def _still(scenario: Scenario) -> list[Segment]:
    return [s for s in scenario.plan.segment if s.turn_rate == 0]


def _truth(built: Built) -> dict[str, float]:
    return {
        f"{c.sensor}.{key}.{AXES[c.axis]}": value
        for c in built.job.channels
        for key, value in _coefficients(built.noise[c.sensor]).items()
    }


def _coefficients(model: NoiseModel) -> dict[str, float]:
    """What is there, by the keys of the terms that are identified; of several Gauss-Markov processes none has a name."""
    out = {"white": model.density, "instability": model.instability, "walk": model.walk}
    if len(model.markov) == 1:
        out |= dict(zip(("markov", "markov_time"), model.markov[0], strict=True))
    return {key: value for key, value in out.items() if value > 0}


def _block_diagonal(blocks: list[Array]) -> Array:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks), dtype=float)
