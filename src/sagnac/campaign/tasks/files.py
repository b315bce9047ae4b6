"""All files of one run, as a user would have them: what went in, the truth, what came out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ... import plan as plans
from ...align.transfer import transfer
from ...errors import SagnacError
from ...files import write_atomically
from ...recording import open_recording
from ...simulate.build import build
from ...simulate.run import run as simulate
from ...simulate.run import truth_text
from ...simulate.table import write_recording
from .. import spec
from ..spec import Campaign, Options, Point
from . import hand, noise
from .calibration import calibrated
from .fleet import Fleet
from .outcome import OK, Cell

RESULT = "calibration.json"


def write(campaign: Campaign, task: object, index: int, folder: Path, row: dict[str, Cell]) -> None:
    """Write the files of a run.

    Parameters
    ----------
    campaign : Campaign
    task : Task
        Of the campaign.
    index : int
    folder : Path
    row : dict
        Of the run.

    Raises
    ------
    InputError
        When they cannot be written.
    """
    if isinstance(task, Fleet):
        if row["status"] == OK:
            task.calibration(index).save(folder / RESULT)
        return
    import tomlkit

    point = campaign.points[campaign.point(index)[0]]
    if point.options.method == "noise":
        point = replace(point, table=noise.completed(point.table))
    with write_atomically(folder / "scenario.toml") as temporary:
        temporary.write_text(tomlkit.dumps(point.table), encoding="utf-8")
    seed = row["seed"]
    assert isinstance(seed, int)  # every simulated run has one
    _WRITERS.get(point.options.method, _calibration)(point, folder, seed)


def _calibration(point: Point, folder: Path, seed: int) -> None:
    recording, *_ = simulate(spec.scenario(point), folder, seed=seed, threads=1).files
    _result(recording, folder / "plan.toml", point.options)


def _result(recording: Path, plan_file: Path, options: Options) -> None:
    """The calibration of a recording that was written; of one that is refused the row says why."""
    plan = plans.load(plan_file)
    with suppress(SagnacError):
        found = calibrated(open_recording(recording, scale=plan.unit.scale), plan, options)
        found.with_source(plan_file, "plan").save(plan_file.with_name(RESULT))


def _alignment(point: Point, folder: Path, seed: int) -> None:
    recording, *_ = simulate(spec.scenario(point), folder, seed=seed, threads=1).files
    with suppress(SagnacError):
        transfer(folder / "master.parquet", recording, folder / "config.toml", folder)


def _noise(point: Point, folder: Path, seed: int) -> None:
    simulate(spec.scenario(point), folder, seed=seed, threads=1)


def _hand(point: Point, folder: Path, seed: int) -> None:
    turned = hand.read(point.table)
    built = build(turned.scenario, seed)
    write_recording(folder / "recording.parquet", *hand.samples(turned, built), {})
    for name, text in (("plan.toml", turned.site.to_toml()), ("truth.json", truth_text(turned.scenario, built))):
        with write_atomically(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    options = point.options.model_copy(update={"method": "norm"})
    _result(folder / "recording.parquet", folder / "plan.toml", options)


_WRITERS: dict[str, Callable[[Point, Path, int], None]] = {"transfer": _alignment, "noise": _noise, "hand": _hand}
"""By method; any other is a calibration."""
