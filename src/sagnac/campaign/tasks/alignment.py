"""Transfer alignment of a simulated vehicle's slave from its master's log."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...align import config as configs
from ...align import master as masters
from ...align.result import Alignment
from ...align.transfer import align, covariance
from ...simulate import scenario as scenarios
from ...simulate.build import build
from ...simulate.scenario import Scenario
from ...simulate.vehicle import master_log
from ..spec import Options
from .memory import recording_of
from .outcome import Outcome


def read(table: dict[str, Any]) -> Scenario:
    """The scenario of a table."""
    return scenarios.from_table(table)


def run(scenario: Scenario, options: Options, seed: int) -> Outcome:  # noqa: ARG001 - an alignment has its own settings
    """One alignment.

    Parameters
    ----------
    scenario : Scenario
        Of a vehicle; its ``[config]`` holds the settings of the alignment.
    options : Options
    seed : int
        Of the simulation.

    Raises
    ------
    DataError, InputError
        As :func:`sagnac.align.transfer.transfer` does.
    """
    built = build(scenario, seed)
    settings = configs.from_table(scenario.config)
    log = masters.from_arrays(*master_log(scenario, seed), name="simulated master")
    found, judged = align(recording_of(built, scenario.plan, "simulated slave"), log, settings)
    return _outcome(judged.record(settings, found), built.parameters)


def bound(scenario: Scenario, options: Options, seed: int) -> Outcome:  # noqa: ARG001 - as above
    """What the covariance along the true course says without data (same parameters and errors)."""
    predicted = covariance(configs.from_table(scenario.config))
    return _outcome(predicted, build(scenario, seed).parameters)


def notes(scenario: Scenario) -> tuple[str, ...]:  # noqa: ARG001 - as above
    """None: an alignment's config states the noise that it counts on."""
    return ()


def _outcome(found: Alignment, truth: dict[str, float]) -> Outcome:
    innovations = found.innovations
    return Outcome(
        tuple(p.name for p in found.parameters),
        tuple(p.unit for p in found.parameters),
        np.array([np.nan if p.value is None else p.value for p in found.parameters]),
        np.array(found.covariance).reshape(len(found.parameters), -1),
        truth,
        None if innovations is None else innovations.mean * innovations.updates,
        None if innovations is None else round(innovations.expected * innovations.updates),
    )
