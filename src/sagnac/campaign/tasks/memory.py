"""A simulated recording in memory, as a file of it would be read: no file is written for a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...frames import Array
from ...plan import Plan
from ...recording import SENSORS, Recording, from_arrays, sample_interval
from ...simulate.build import Built
from ...simulate.engine import stream
from ...simulate.noise import NoiseModel

_FAINT = 1e-3


def seed_of(seed: int, index: int) -> int:
    """Seed of a run: the first 63 bits of ``SeedSequence(seed, spawn_key=(index,))``, which any integer column holds.

    ``sagnac simulate`` with this seed and the scenario of the run's grid point gives the run's recording.

    Parameters
    ----------
    seed : int
        Of the campaign.
    index : int
        Of the run.
    """
    state = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(1))


def recording_of(built: Built, plan: Plan, name: str = "simulated recording") -> Recording:
    """The recording of a job; counts become SI by the plan's nominal scale as when a file of them is opened.

    Parameters
    ----------
    built : Built
    plan : Plan
    name : str
        Used in messages.
    """
    job = built.job
    channels = {c.name: c for c in job.channels}
    whole = {s: np.empty((job.clock.count, 3)) for s, own in SENSORS.items() if channels.keys() >= {*own}}
    single = {n: np.empty(job.clock.count) for n, c in channels.items() if c.sensor not in whole}
    axes = {a: v[:, i] for s, v in whole.items() for i, a in enumerate(SENSORS[s])} | single
    time = np.empty(job.clock.count)
    rig: dict[str, Array] = {}
    first = 0
    for piece in stream(job, threads=1):
        here = slice(first, first + piece.time.size)
        first = here.stop
        time[here] = piece.time
        for name_, values in piece.sensors.items():
            axes[name_][here] = values
        for name_, values in piece.rig.items():
            rig.setdefault(name_, np.empty(job.clock.count))[here] = values
    interval = sample_interval(time) if any(c.increment for c in job.channels) else np.nan
    for name_, c in channels.items():
        if c.worth != 0.0:
            axes[name_] *= c.worth / interval if c.increment else c.worth
    recording = from_arrays(time, whole.get("accel"), whole.get("gyro"), name=name, rig=rig, single=single)
    summed = frozenset(c.sensor for c in job.channels if c.increment)
    return replace(recording, increments=summed, scale=dict(plan.unit.scale)) if plan.unit.scale else recording


def silent(built: Built) -> Built:
    """The same job with a thousandth of its noise, and without rounding.

    Without any noise an axis at rest would look dead. Pulses are counted all the same: they bound what a mean can tell.
    """
    channels = tuple(
        replace(c, noise=_fainter(c.noise), worth=c.worth if c.increment else 0.0) for c in built.job.channels
    )
    return replace(built, job=replace(built.job, channels=channels))


def _fainter(noise: NoiseModel) -> NoiseModel:
    slow = tuple((_FAINT * sigma, time) for sigma, time in noise.markov)
    return NoiseModel(_FAINT * noise.density, _FAINT * noise.instability, noise.band, _FAINT * noise.walk, slow)


def told(plan: Plan, built: Built) -> Plan:
    """The plan with the true densities of white noise stated."""
    density = {sensor: model.density or None for sensor, model in built.noise.items()}
    noise = plan.unit.noise.model_copy(update=density)
    return plan.model_copy(update={"unit": plan.unit.model_copy(update={"noise": noise})})
