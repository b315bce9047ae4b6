"""``sagnac campaign``: a scenario many times over a grid, or the recordings of a fleet; and what came of it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import InputError
from . import options

if TYPE_CHECKING:
    from ..campaign.fleets import FleetSummary
    from ..campaign.summary import Summary

campaign_app = typer.Typer(
    name="campaign",
    help="Run a scenario thousands of times over a grid, or calibrate the recordings of a fleet, and judge the results.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

File = Annotated[Path, typer.Argument(help="What is run, how often, over which values (TOML).", metavar="C.TOML")]


@campaign_app.command(
    epilog="Example: `sagnac campaign run campaign.toml --out runs`, and one of its runs with all its files: "
    "`sagnac campaign run campaign.toml --only 3 --out run-3`"
)
def run(
    campaign: File,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the results; default: the name of C.TOML without its ending."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes to use; one for each core unless given.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler whose workers do the runs: tcp://host:8786.", metavar="ADDRESS")
    ] = None,
    only: Annotated[int | None, typer.Option(min=0, help="This run alone, with all its files.", metavar="RUN")] = None,
    as_json: options.Json = False,
) -> None:
    """Do the runs of a campaign that are missing; one that was stopped or killed goes on where it was.

    The exit status is 1 when a recording of a fleet was refused; the results of the others are written.
    """
    from ..campaign import run as campaigns
    from ..campaign import spec
    from ..campaign.progress import telling

    read = spec.load(campaign)
    name = campaign.with_suffix("")
    if only is not None:
        folder = out or name.with_name(f"{name.name}-{only}")
        _keep_inputs(folder, campaign, read)
        done = campaigns.again(read, only, folder)
        _tell_row(done.row, done.units, folder, as_json)
        return
    folder = out or name
    _keep_inputs(folder, campaign, read)
    with telling(read.title) as watch:
        found = campaigns.run(read, folder, workers=workers, scheduler=scheduler, watch=watch, source=str(campaign))
    _tell(found, folder, as_json, source=campaign)
    if found.kind == "fleet" and found.refused:
        raise typer.Exit(1)


@campaign_app.command(
    epilog="Example: `sagnac campaign show runs`, with pictures: `sagnac campaign show runs --plot pictures`, "
    "or all of them on one page: `sagnac campaign show runs --plot campaign.png`"
)
def show(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign, be it still running.", metavar="DIR")],
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Picture of the first kind (.png, .svg, .pdf), or a folder for all.")
    ] = None,
    point: Annotated[int | None, typer.Option(min=0, help="One point of the grid in full.", metavar="N")] = None,
    as_json: options.Json = False,
) -> None:
    """Tell what a campaign came to so far: RMSE against bound, coverage, NEES, and what is out of its band."""
    from ..campaign import run as campaigns

    found = campaigns.show(folder)
    if point is not None and (found.kind == "fleet" or point >= len(found.points)):
        raise InputError(f"--point {point}: {folder} has no such point of a grid")
    files = _draw(found, plot, point) if plot is not None else []
    _tell(found, folder, as_json, point, files)


def _draw(found: Summary | FleetSummary, target: Path, point: int | None) -> list[Path]:
    from ..report import campaign as pictures

    return pictures.draw(found, target, point or 0)


def _tell(
    found: Summary | FleetSummary,
    folder: Path,
    as_json: bool,
    point: int | None = None,
    files: list[Path] | None = None,
    source: Path | None = None,
) -> None:
    from ..campaign import show as shown

    if as_json:
        more: dict[str, Any] = {
            "out": str(folder),
            "complete": found.complete,
            "pictures": [str(f) for f in files or []],
        }
        typer.echo(json.dumps({**found.model_dump(mode="json", by_alias=True), **more}, indent=1))
        return
    typer.echo(shown.text(found, point, source or shown.ANY), nl=False)
    for file in files or []:
        typer.echo(f"written: {file}")
    if files is None:
        quoted, pictures = shlex.quote(str(folder)), shlex.quote(str(folder / "pictures"))
        typer.echo(f"\nwritten to {folder}; pictures of it: sagnac campaign show {quoted} --plot {pictures}")


def _tell_row(row: dict[str, Any], units: dict[str, str], folder: Path, as_json: bool) -> None:
    from ..campaign.sizes import shown_unit

    if as_json:
        typer.echo(json.dumps({k: v for k, v in row.items() if k != "calibration"}, indent=1))
        return
    for name, value in row.items():
        if value is None or name == "calibration":
            continue
        if name in units:
            # an error and its standard uncertainty in the same unit: that of the latter
            other = row.get(f"sigma.{name.partition('.')[2]}")
            unit, size = shown_unit(other or abs(value), units[name])
            typer.echo(f"  {name:<32}{value * size:<14.6g}{unit}")
        else:
            typer.echo(f"  {name:<32}{f'{value:.6g}' if isinstance(value, float) else value}")
    typer.echo(f"files of the run: {folder}")


def _keep_inputs(folder: Path, file: Path, read: Any) -> None:
    """Refuse a folder that is an input or holds one under a name that is written."""
    inputs = (file, *read.inputs)
    names: tuple[str, ...] = (
        "campaign.json",
        "results.parquet",
        "summary.json",
        "scenario.toml",
        "plan.toml",
        "config.toml",
        "truth.json",
    )
    names += ("recording.parquet", "recording.csv", "master.parquet", "calibration.json", "alignment.json", "row.json")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; the results need a folder")
    for name in names:
        options.keep_inputs(("--out", folder / name), inputs=inputs)
