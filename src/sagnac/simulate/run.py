"""A scenario to files: recording, plan and truth."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .._version import __version__
from ..errors import InputError
from ..files import write_atomically
from . import vehicle, writer
from .build import Built, build
from .engine import stream
from .scenario import Scenario

TRUTH_SCHEMA = "sagnac/truth/1"


@dataclass(frozen=True)
class Simulated:
    """What was written.

    Attributes
    ----------
    scenario : Scenario
    seed : int
    files : tuple of Path
        The recording first.
    samples : int
    duration : float, s
    truth : dict of str to float
        Parameters by name, SI.
    """

    scenario: Scenario
    seed: int
    files: tuple[Path, ...]
    samples: int
    duration: float
    truth: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """A plain table for JSON."""
        return {
            "scenario": self.scenario.name,
            "method": self.scenario.method,
            "seed": self.seed,
            "files": [str(f) for f in self.files],
            "samples": self.samples,
            "duration": self.duration,
            "truth": self.truth,
        }

    def summary(self) -> str:
        """What was written, and what can be done with it, as text."""
        lines = [f"{self.scenario.title or self.scenario.name}, seed {self.seed}"]
        lines += [
            f"  {f}" + (f"  {self.samples} samples, {self.duration:g} s" if i == 0 else "")
            for i, f in enumerate(self.files)
        ]
        follow = follow_up(self.scenario, self.files[0].parent, self.files[0].name)
        return "\n".join(lines + [f"next: {follow}"] * bool(follow)) + "\n"


def follow_up(scenario: Scenario, folder: Path, recording: str) -> str:
    """The command that a scenario is for, empty when it names none."""
    if not scenario.method:
        return ""
    if scenario.kind == "vehicle":
        files = f"--master {folder / 'master.parquet'} --slave {folder / recording} --config {folder / 'config.toml'}"
        scale = "".join(" --scale " + shlex.quote(f"{n}={v}") for n, v in scenario.unit.scale.items())
        return f"sagnac align {scenario.method} {files}{scale} --out {folder / 'alignment'}"
    if scenario.method == "noise":
        return f"sagnac noise {folder / recording} --plot {folder / 'noise.png'}"
    return f"sagnac calibrate {scenario.method} {folder / recording} --plan {folder / 'plan.toml'} --out {folder / 'cal.json'}"


def run(
    scenario: Scenario,
    folder: str | Path,
    *,
    seed: int = 1,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Simulated:
    """Simulate a scenario and write its files, all of them or none.

    Parameters
    ----------
    scenario : Scenario
        See :func:`sagnac.simulate.scenario.load`.
    folder : path
        Gets ``recording.parquet`` (or ``.csv``), ``plan.toml`` and ``truth.json``; for a vehicle ``master.parquet``,
        ``recording.parquet``, ``config.toml`` and ``truth.json``. Files of these names are replaced.
    seed : int
        The same seed gives the same files, on any number of threads.
    threads : int, optional
        All processors unless given.
    progress : callable, optional
        Takes the number of samples written so far.

    Returns
    -------
    Simulated

    Raises
    ------
    InputError
        When the scenario cannot be run as it stands, or its recording would not fit on the disk.
    """
    folder = Path(folder)
    built = build(scenario, seed)
    columns = {c.name: c.worth != 0.0 for c in built.job.channels}
    rig = _rig_columns(built)
    clock, kind = built.job.clock, scenario.recording.format
    _refuse_too_large(scenario, folder, writer.size(clock.count, columns, rig, kind))
    listed = names(scenario)
    with ExitStack() as stack:
        # entered last, left first: the recording is moved into place at the very end
        files = {name: stack.enter_context(write_atomically(folder / name)) for name in listed}
        for name, path in files.items():
            if name in _TEXTS:
                path.write_text(_TEXTS[name](scenario, built), encoding="utf-8")
        if scenario.kind == "vehicle":
            vehicle.write_master(files["master.parquet"], scenario, seed)
        write = stack.enter_context(writer.writing(files[listed[0]], columns, rig, kind))
        done = 0
        for piece in stream(built.job, threads=threads):
            try:
                write(piece)
            except InputError as cause:
                raise InputError(f"{scenario.name}: {cause}") from cause
            done += piece.time.size
            if progress is not None:
                progress(done)
    return Simulated(
        scenario, seed, tuple(folder / n for n in listed), clock.count, clock.count / clock.frequency, built.parameters
    )


def names(scenario: Scenario) -> tuple[str, ...]:
    """Names of the files that a scenario becomes, the recording first."""
    others = ("master.parquet", "config.toml") if scenario.kind == "vehicle" else ("plan.toml",)
    return (f"recording.{scenario.recording.format}", *others, "truth.json")


def truth_text(scenario: Scenario, built: Built) -> str:
    """The truth as JSON: parameters by name in SI, and what else was drawn."""
    table = {
        "schema": TRUTH_SCHEMA,
        "scenario": {"name": scenario.name, "title": scenario.title, "sha256": scenario.sha256},
        "seed": built.job.seed,
        "method": scenario.method,
        "misalignment": built.misalignment,
        "frame": built.frame,
        "parameters": built.parameters,
        "noise": {sensor: asdict(model) for sensor, model in built.noise.items()},
        **built.details,
        "software": {"name": "sagnac", "version": __version__},
    }
    return json.dumps(table, indent=1, allow_nan=False) + "\n"


_TEXTS: dict[str, Callable[[Scenario, Built], str]] = {
    "plan.toml": lambda scenario, _: scenario.plan.to_toml(),
    "config.toml": lambda scenario, _: vehicle.config_text(scenario),
    "truth.json": truth_text,
}


def _rig_columns(built: Built) -> tuple[str, ...]:
    """Names of the rig's own columns."""
    import numpy as np

    names = tuple(built.job.motion.columns(np.array([0.0]))) if built.job.rig else ()
    return (*names, *(["temperature"] if built.job.drift is not None else []))


def _refuse_too_large(scenario: Scenario, folder: Path, needed: int) -> None:
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    if needed > free:
        raise InputError(
            f"{scenario.name}: recording: some {needed / 1e9:.3g} GB would be written, {free / 1e9:.3g} GB are free in {place}; "
            "lower recording.frequency, the times of the plan, or the number of segments"
        )
