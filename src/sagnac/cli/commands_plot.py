"""``sagnac plot``: one picture of a calibration, a recording or an alignment."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options
from .opening import Opening, reads_recording

if TYPE_CHECKING:
    from ..calibration import Calibration
    from ..plan import Plan
    from ..recording import Recording
    from ..report.plot import Offer

PLOT_EXAMPLE = (
    "Example: `sagnac plot cal.json` tells what can be drawn, `sagnac plot cal.json correlation --out correlation.svg` draws "
    "it; `sagnac plot cal.json before-after --recording check.parquet --plan check.toml --out gain.png`, of a recording "
    "`sagnac plot recording.csv log --plan plan.toml --out log.png`, "
    "of an alignment `sagnac plot aligned estimates --out estimates.pdf`"
)


@reads_recording
def plot(
    file: Annotated[
        Path, typer.Argument(help="Calibration (JSON), recording, or folder of an alignment.", metavar="FILE")
    ],
    picture: Annotated[
        str | None, typer.Argument(help="Which picture; left out: tell what can be drawn.", metavar="[PICTURE]")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="File to write, .png, .svg or .pdf; default PICTURE.png.")
    ] = None,
    recording: Annotated[
        Path | None, typer.Option(help="Recording; default: the calibration's own, if it lies beside it unchanged.")
    ] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Plan of the recording (TOML); default: the calibration's own likewise.")
    ] = None,
    earlier: Annotated[Path | None, typer.Option(help="Earlier calibration of the same unit (JSON).")] = None,
    static_threshold: options.Threshold = None,
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Draw one picture of a calibration, a recording or an alignment, or tell which there are."""
    from ..observe.static import THRESHOLD
    from ..report import plot as plots
    from ..report.style import check_ending, save
    from .terminal import note

    given = plots.Given(recording, plan, earlier, static_threshold or THRESHOLD)
    if picture is None:
        _tell(file, plots.offers(file, given), as_json)
        return
    out = out or Path(f"{picture}.png")
    check_ending(out)
    options.keep_inputs(("--out", out), inputs=(file, recording, plan, earlier))

    def opened(path: Path, with_plan: Plan | None, calibration: Calibration | None) -> Recording:
        return opening.open(path, plan=with_plan, calibration=calibration)

    drawn = plots.plot(file, picture, given, opener=opened)
    save(drawn.figure, out)
    for remark in drawn.remarks:
        note(f"note: {remark}")
    typer.echo(json.dumps({"out": str(out), "remarks": list(drawn.remarks)}) if as_json else str(out))


def _tell(file: Path, offered: list[Offer], as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps([{"name": o.name, "shows": o.shows, "missing": o.missing.split()} for o in offered]))
        return
    wide = max(len(o.name) for o in offered) + 2
    lines = [f"  {o.name:<{wide}}{o.shows}" + (f" (needs {o.missing})" if o.missing else "") for o in offered]
    typer.echo(
        "\n".join([f"Pictures of {file}:", *lines, f"Draw one: sagnac plot {file} {offered[0].name} --out x.png"])
    )
