"""The commands. Heavy imports stand inside them, so that ``--help`` is quick."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .._version import __version__
from . import options
from .commands_align import align_app
from .commands_campaign import campaign_app
from .commands_export import EXAMPLE as EXPORT_EXAMPLE
from .commands_export import export
from .commands_noise import NOISE_EXAMPLE, noise
from .commands_plan import plan_app
from .commands_plot import PLOT_EXAMPLE, plot
from .commands_registry import registry_app
from .commands_registry_history import COMPARE_EXAMPLE, TREND_EXAMPLE, compare, trend
from .commands_report import REPORT_EXAMPLE, certify, check_certificates, report
from .commands_simulate import EXAMPLE as SIMULATE_EXAMPLE
from .commands_simulate import simulate
from .commands_static import NAVIGATE_EXAMPLE, navigate
from .opening import Opening, reads_recording

app = typer.Typer(
    name="sagnac",
    help="Calibrate inertial sensors, align and run inertial navigation systems, and say how sure the result is.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    epilog="Example: `sagnac demo --out sagnac-demo`, and `sagnac COMMAND --help` for each of the commands.",
)


app.add_typer(plan_app)
app.add_typer(align_app)
app.add_typer(registry_app)
registry_app.command(epilog=TREND_EXAMPLE)(trend)
registry_app.command(epilog=COMPARE_EXAMPLE)(compare)
app.add_typer(campaign_app)
app.command(epilog=SIMULATE_EXAMPLE)(simulate)
app.command(epilog=NAVIGATE_EXAMPLE)(navigate)
app.command(epilog=NOISE_EXAMPLE)(noise)
app.command(epilog=PLOT_EXAMPLE)(plot)
app.command(epilog=EXPORT_EXAMPLE)(export)
app.command(epilog=REPORT_EXAMPLE)(report)


class Matrix(StrEnum):
    """Shape of the scale and misalignment matrix."""

    full = "full"
    triangular = "triangular"


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"sagnac {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


@app.command(epilog="Example: `sagnac demo --out sagnac-demo --seed 1`")
def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for recordings, results and plots.")] = Path("sagnac-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Of the simulation.")] = 1,
    as_json: options.Json = False,
) -> None:
    """Run the main job end to end on a simulated laser-gyro unit."""
    from ..demo import run
    from .terminal import note

    done = run(out, seed=seed, say=note if as_json else typer.echo)
    if as_json:
        typer.echo(json.dumps(done.to_dict(), indent=1))


@app.command(
    epilog="Example: `sagnac calibrate norm recording.csv --plan plan.toml --out cal.json --certificate cal.html`, or for a "
    "unit turned by hand: "
    "`sagnac calibrate norm log.csv --gravity '9.81744 m/s^2' --out hand.json`, or on a centrifuge: "
    "`sagnac calibrate centrifuge spun.csv --plan arm.toml --sensors accel_z --out arm.json`"
)
@reads_recording
def calibrate(
    method: Annotated[
        str,
        typer.Argument(
            help="four-position, multi-position, norm, table, centrifuge or roll-isolated.", metavar="METHOD"
        ),
    ],
    recording: options.RecordingFile,
    plan: options.PlanFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="Calibration file to write (JSON).")] = None,
    certificate: Annotated[
        list[Path] | None,
        typer.Option(
            "--certificate", help="Certificate to write besides (HTML, PDF); may be given twice. Needs --out."
        ),
    ] = None,
    gravity: options.Gravity = None,
    latitude: options.Latitude = None,
    height: options.Height = None,
    matrix: Annotated[
        Matrix, typer.Option(help="Multi-position: in the table's frame, or the triad's own.")
    ] = Matrix.full,
    robust: Annotated[bool, typer.Option("--robust", help="Turn down segments that disagree with the rest.")] = False,
    static_threshold: options.Threshold = None,
    closed_form: Annotated[
        bool, typer.Option("--closed-form", help="Centrifuge: the published closed form instead of the fit.")
    ] = False,
    prior: Annotated[
        Path | None, typer.Option(help="Centrifuge: the unit's calibration at 1 g (JSON), known beforehand.")
    ] = None,
    terms: Annotated[
        str, typer.Option(help="Centrifuge: terms to estimate, accel.k2,accel.kio,...; default: all but Kio and Kpo.")
    ] = "",
    sensors: Annotated[str, typer.Option(help="Centrifuge: only these, accel or gyro_x,gyro_y.")] = "",
    plot: Annotated[
        Path | None, typer.Option(help="Draw the log with its segments or static intervals (PNG, SVG, PDF).")
    ] = None,
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Calibrate a unit from a recording.

    The method norm without segments in the plan, or without plan, is for a unit turned by hand.
    """
    from ..calibrate import calibrate as run
    from ..calibration import load
    from .terminal import announce_compilation, note

    pages = certificate or []
    outputs = [("--out", out), ("--plot", plot), *(("--certificate", page) for page in pages)]
    options.keep_inputs(*outputs, inputs=(recording, plan, prior))
    options.check_picture(plot)
    if pages:
        check_certificates(pages, out)
    done = options.plan_with(plan, gravity, latitude, height)
    opened = opening.open(recording, plan=done)
    hand_turned = method == "norm" and (done is None or not done.segment) and "gyro" in opened.has
    announce_compilation("hand-turned" if hand_turned else method)
    result = run(
        method,
        opened,
        done,
        matrix=matrix.value,
        robust=robust,
        threshold=static_threshold,
        closed_form=closed_form,
        prior=None if prior is None else load(prior),
        terms=options.parts(terms),
        sensors=options.parts(sensors),
    )
    if plan is not None:
        result = result.with_source(plan, "plan")
    if prior is not None:
        result = result.with_source(prior, "prior")
    if out is not None:
        result.save(out)
    if plot is not None:
        from ..report.plots import draw_log

        draw_log(opened, done, plot, static_threshold)
    if out is not None and pages:
        certify(out, pages, recording=recording, plan=plan, opening=opening)
    for path in (*(p for p in (out, plot) if p is not None), *pages):
        note(f"written: {path}")
    typer.echo(result.to_json() if as_json else result.summary(), nl=False)


@app.command(epilog="Example: `sagnac apply cal.json recording.csv --out compensated.parquet`")
@reads_recording
def apply(
    calibration: Annotated[Path, typer.Argument(help="Calibration file (JSON).", metavar="CAL.JSON")],
    recording: options.RecordingFile,
    out: Annotated[Path, typer.Option("--out", help="Compensated recording to write (.parquet or .csv).")],
    plan: options.PlanFile = None,
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Compensate a recording: readings in, specific force and angular rate out."""
    from ..calibration import load
    from ..compensation import apply as run
    from .terminal import announce_compilation, counting

    options.keep_inputs(("--out", out), inputs=(recording, calibration, plan))
    model = load(calibration)
    announce_compilation(f"apply {model.method}")
    opened = opening.open(recording, plan=options.plan_with(plan, None, None, None), calibration=model, told=False)
    with counting(f"compensating {recording.name}") as progress:
        rows = run(model, opened, out, progress=progress)
    typer.echo(json.dumps({"out": str(out), "samples": rows}) if as_json else f"{out}: {rows} samples")


@app.command(epilog="Example: `sagnac verify cal.json check.csv --plan check.toml`")
@reads_recording
def verify(
    calibration: Annotated[Path, typer.Argument(help="Calibration file (JSON).", metavar="CAL.JSON")],
    recording: options.RecordingFile,
    plan: options.PlanFile = None,
    gravity: options.Gravity = None,
    latitude: options.Latitude = None,
    height: options.Height = None,
    static_threshold: options.Threshold = None,
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Check a calibration on a recording that its fit has not seen; exit status 1 when it fails."""
    from ..calibration import load
    from ..observe.static import THRESHOLD
    from ..verification import verify as run
    from .terminal import announce_compilation

    done = options.plan_with(plan, gravity, latitude, height)
    model = load(calibration)
    opened = opening.open(recording, plan=done, calibration=model)
    announce_compilation(model.method)
    outcome = run(model, opened, done, threshold=static_threshold or THRESHOLD)
    typer.echo(json.dumps(outcome.to_dict(), indent=1) if as_json else outcome.summary())
    if not outcome.passed:
        raise typer.Exit(1)
