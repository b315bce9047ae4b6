"""A campaign from its file to a folder of results, one of its runs again, and what a folder holds."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .. import results
from ..errors import DataError, InputError
from ..files import write_atomically
from . import engine, fleets, store, summary
from .fleets import FleetSummary, FleetTally
from .progress import Watch
from .spec import Campaign
from .store import Store
from .summary import Summary
from .tally import Tally
from .tasks import Task, prepare
from .tasks.about import About, PointAbout
from .tasks.fleet import Fleet, write_calibrations
from .tasks.fleet import known as fleet_of
from .tasks.outcome import OK, Cell, chosen
from .tasks.simulated import Simulation

if TYPE_CHECKING:
    import pyarrow as pa

SUMMARY = "summary.json"
"""Name of the summary in the folder of a campaign."""


def run(
    campaign: Campaign,
    folder: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Watch | None = None,
    source: str = "C.toml",
) -> Summary | FleetSummary:
    """Do what is missing of a campaign, and sum it up.

    Parameters
    ----------
    campaign : Campaign
        See :func:`sagnac.campaign.spec.load`.
    folder : path
        For ``campaign.json``, ``chunks/``, ``results.parquet`` and ``summary.json``; of a fleet ``calibrations/`` besides.
        One with a part of the same campaign is gone on with.
    workers, scheduler, watch
        See :func:`sagnac.campaign.engine.run`.
    source : str
        The campaign's file, for messages that say how to repeat a run.

    Returns
    -------
    Summary or FleetSummary

    Raises
    ------
    InputError, DataError
        As :func:`sagnac.campaign.tasks.prepare` and :func:`sagnac.campaign.engine.run` do.
    """
    listener = watch or Watch()
    engine.check_crew(workers, scheduler)
    # who else is at work on the folder, and what it holds, is looked at before anything that takes time
    with Store(folder, campaign.identity, campaign.index_count) as opened:
        _tell_first(campaign, listener)
        if opened.about is None:
            task = _prepared(campaign, listener.note)
            opened.describe(task.columns, task.about.model_dump(mode="json", by_alias=True))
        else:
            task = _known(campaign, About.model_validate(opened.about))
        tally = _tally(task.about)

        def take(table: pa.Table) -> None:
            tally.add(table)
            if isinstance(task, Fleet):
                write_calibrations(folder, _rows(table), campaign.folder)

        engine.run(
            task,
            opened,
            workers=workers,
            scheduler=scheduler,
            watch=listener,
            take=take,
            again=lambda index: f"sagnac campaign run {shlex.quote(source)} --only {index}",
            seed=None if campaign.is_fleet else campaign.settings.seed,
        )
        made = _summary(tally)
        results.save(made, Path(folder) / SUMMARY)
    return made


def show(folder: str | Path) -> Summary | FleetSummary:
    """The summary of a folder, of all its runs or of those that are done so far.

    Raises
    ------
    InputError
        When the folder holds no campaign.
    """
    folder = Path(folder)
    if not (folder / store.MANIFEST).exists() and store.is_begun(folder):
        raise InputError(
            f"{folder}: the campaign has only just begun, or was stopped before anything of it was safe; look again in a moment"
        )
    manifest = store.read_manifest(folder)
    if manifest.results is not None and (folder / SUMMARY).is_file():
        text = results.read_text(folder / SUMMARY, "summary")
        read = fleets.loads if manifest.about["kind"] == "fleet" else summary.loads
        return read(text, str(folder / SUMMARY))
    tally = _tally(About.model_validate(manifest.about))
    for chunk in store.read_chunks(folder, manifest):
        tally.add(chunk.table)
    return _summary(tally)


class Again(NamedTuple):
    """One run done again."""

    row: dict[str, Cell]
    units: dict[str, str]
    """SI units of the columns that have one."""


def again(campaign: Campaign, index: int, folder: str | Path) -> Again:
    """One run of a campaign with all its files: what went in, the truth, and what came out.

    Parameters
    ----------
    campaign : Campaign
    index : int
        Number of the run.
    folder : path
        Gets the scenario, ``recording``, ``plan.toml`` or ``config.toml``, ``truth.json`` and the result, and ``row.json``.

    Returns
    -------
    Again
        Its row.

    Raises
    ------
    InputError
        When there is no such run, or the folder cannot be written or is that of a campaign.
    DataError
        When the run is one that is refused; its files are written all the same.
    """
    from .tasks.files import write

    if not 0 <= index < campaign.index_count:
        raise InputError(f"--only {index}: the runs of {campaign.name} are 0 to {campaign.index_count - 1}")
    if (Path(folder) / store.MANIFEST).exists() or store.is_begun(folder):
        raise InputError(f"{folder}: holds a campaign; take another folder for the files of one run")
    task = _at_one_point(campaign, index)
    row = dict(task.row(index))
    write(campaign, task, index, Path(folder), row)
    with write_atomically(Path(folder) / "row.json") as temporary:
        told = {k: v for k, v in row.items() if k != "calibration"}
        temporary.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    if row["status"] != OK:
        raise DataError(f"run {index}: {row['status']}; its files are in {folder}")
    units = {f"{what}.{p.name}": p.unit for p in task.about.parameters for what in ("error", "sigma", "value")}
    return Again(row, units)


def _tell_first(campaign: Campaign, watch: Watch) -> None:
    """What somebody may not have meant."""
    if not campaign.is_fleet and "runs" not in campaign.settings.model_fields_set:
        runs, points = campaign.settings.runs, len(campaign.points)
        watch.note(f"runs is not given: {runs}" + (f" at each of {points} points" if points > 1 else ""))
    for same in campaign.doubles:
        watch.note(f"{', '.join(same[:-1])} and {same[-1]} are the same recording, byte for byte")


def _prepared(campaign: Campaign, say: Callable[[str], object] | None = None) -> Task:
    """The task of a campaign; InputError where it asks for parameters that there are not."""
    wanted = campaign.settings.parameters
    try:
        task = prepare(campaign, say)
    except DataError:
        _need_parameters(campaign, wanted)
        raise
    names = [p.name for p in task.about.parameters]
    _need_parameters(campaign, [w for w in wanted if not any(chosen(n, [w]) for n in names)])
    return task


def _need_parameters(campaign: Campaign, strange: Sequence[str]) -> None:
    if not strange:
        return
    try:
        names = [p.name for p in prepare(_judging_all(campaign)).about.parameters]
    except DataError:  # nothing can be judged, whatever it is called
        return
    wrong = [w for w in strange if not any(chosen(n, [w]) for n in names)]
    if wrong:
        raise InputError(f"{campaign.name}: parameters: no parameter {', '.join(wrong)}; there are {', '.join(names)}")


def _judging_all(campaign: Campaign) -> Campaign:
    """The first point of a campaign, all of whose parameters are judged."""
    settings = campaign.settings.model_copy(update={"parameters": ()})
    return replace(campaign, settings=settings, points=campaign.points[:1])


def _at_one_point(campaign: Campaign, index: int) -> Task:
    """The task for one run: the bounds of other points are not looked for, unless those at its own tell no parameters."""
    if campaign.is_fleet or len(campaign.points) == 1:
        return _prepared(campaign)
    point = campaign.points[campaign.point(index)[0]]
    try:
        about = _prepared(replace(campaign, points=(point,))).about
    except DataError:
        return _prepared(campaign)
    points = tuple(PointAbout(values=p.values) for p in campaign.points)
    return _known(campaign, about.model_copy(update={"points": points, "keys": campaign.keys}))


def _known(campaign: Campaign, about: About) -> Task:
    """The task of a campaign whose bounds are known."""
    about = about.model_copy(update={"title": campaign.title})
    if campaign.is_fleet:
        return fleet_of(campaign, about)
    settings = campaign.settings
    tables, options = tuple(json.dumps(p.table) for p in campaign.points), tuple(p.options for p in campaign.points)
    return Simulation(about, settings.seed, settings.runs, settings.parameters, tables, options)


def _tally(about: About) -> Tally | FleetTally:
    return FleetTally(about) if about.kind == "fleet" else Tally(about)


def _summary(tally: Tally | FleetTally) -> Summary | FleetSummary:
    return fleets.summarise(tally) if isinstance(tally, FleetTally) else summary.summarise(tally)


def _rows(table: pa.Table) -> Iterator[dict[str, Any]]:
    yield from table.select(["recording", "calibration"]).to_pylist()
