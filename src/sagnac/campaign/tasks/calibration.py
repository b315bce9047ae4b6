"""Calibration of a simulated unit on its rig, by any method that has a scenario."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...calibrate import calibrate
from ...calibration import Calibration
from ...coverage import degrees_of_freedom
from ...plan import Plan
from ...recording import SENSORS, Recording
from ...sensors import Triad, triad_of
from ...simulate import scenario as scenarios
from ...simulate.build import Built, build
from ...simulate.scenario import Scenario
from ..spec import Options
from .memory import recording_of, silent, told
from .outcome import Outcome

_NAMES = {"accel": "accelerometers", "gyro": "gyros"}


def read(table: dict[str, Any]) -> Scenario:
    """The scenario of a table."""
    return scenarios.from_table(table)


def run(scenario: Scenario, options: Options, seed: int) -> Outcome:
    """One calibration.

    Parameters
    ----------
    scenario : Scenario
    options : Options
    seed : int
        Of the simulation.

    Raises
    ------
    DataError, InputError
        As :func:`sagnac.calibrate.calibrate` does.
    """
    built = build(scenario, seed)
    recording = recording_of(built, scenario.plan)
    return outcome(calibrated(recording, scenario.plan, options), truth_of(built, options))


def bound(scenario: Scenario, options: Options, seed: int) -> Outcome:
    """The same without noise: standard uncertainties from the noise alone, at the truth (same parameters and errors)."""
    built = build(scenario, seed)
    plan = told(scenario.plan, built)
    # the bound is that of the data, whatever is made of them: of the fit, with all segments
    exact = options.model_copy(update={"closed_form": False, "robust": False})
    found = calibrated(recording_of(silent(built), plan), plan, exact)
    made = outcome(found, truth_of(built, options))
    if found.fit.white is None or _from_noise(found.fit.uncertainty):
        return made
    # errors of the rig that the plan does not allow for scatter the segments: that is no part of the bound
    return Outcome(made.names, made.units, made.values, np.diag(np.square(found.fit.white)), made.truth)


def notes(scenario: Scenario) -> tuple[str, ...]:
    """That the unit has slow noise which the plan does not state."""
    return slow_notes(scenario, scenario.plan)


def slow_notes(scenario: Scenario, plan: Plan) -> tuple[str, ...]:
    """The same of what is recorded of a scenario's unit, and what a plan states."""
    slow = []
    for sensor, axes in SENSORS.items():
        if not set(axes) & set(scenario.recording.columns):
            continue
        model, stated = scenario.unit.noise_of(sensor), plan.unit.noise
        hidden = {
            "bias instability": model.instability > 0 and stated.of(sensor, "instability") is None,
            "bias walk": model.walk > 0 and stated.of(sensor, "walk") is None,
            "Gauss-Markov noise": bool(model.markov),
        }
        slow += [f"{what} of the {_NAMES[sensor]}" for what, here in hidden.items() if here]
    if not slow:
        return ()
    told = (
        f"the unit has {', '.join(slow)}, which the plan does not state: a calibration finds the biases of its own test and "
        "counts white noise alone, so that errors, above all of biases, are larger than stated and intervals hold the truth "
        "too seldom (unit.state_slow_noise = true states what a plan can)"
    )
    return (told,)


def _from_noise(uncertainty: str) -> bool:
    """Whether all uncertainties follow from the noise and from what is stated of the rig."""
    return all(used.rpartition(": ")[2] == "white" for used in uncertainty.split(" / "))


def calibrated(recording: Recording, plan: Plan | None, options: Options) -> Calibration:
    """The calibration that the options ask for."""
    return calibrate(
        options.method,
        recording,
        plan,
        matrix=options.matrix,
        robust=options.robust,
        threshold=options.threshold,
        closed_form=options.closed_form,
        terms=options.terms or None,
        sensors=options.sensors or None,
    )


def outcome(found: Calibration, truth: dict[str, float]) -> Outcome:
    """What a calibration came to."""
    return Outcome(
        tuple(p.name for p in found.parameters),
        tuple(p.unit for p in found.parameters),
        np.array([p.value for p in found.parameters]),
        found.matrix,
        truth,
        found.fit.chi2,
        found.fit.degrees_of_freedom,
        found.fit.p_value,
        found.fit.uncertainty,
        {p.name: degrees_of_freedom(found, p.name) for p in found.parameters},
    )


def truth_of(built: Built, options: Options) -> dict[str, float]:
    """Truth in the frame of the method: gyros alone define their own, x along gyro x and y in the plane of x and y."""
    truth = built.parameters
    if options.method != "norm" or any(c.sensor == "accel" for c in built.job.channels):
        return truth
    whole = triad_of(truth, "gyro")
    if whole is None:
        return truth
    matrix, bias, _ = whole.unpack(np.array([truth[n] for n in whole.names]))
    own = Triad("gyro")
    lower = np.asarray(np.linalg.cholesky(matrix @ matrix.T), dtype=np.float64)
    return truth | dict(zip(own.names, own.pack(lower, bias).tolist(), strict=True))
