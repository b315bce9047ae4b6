"""``sagnac noise``: Allan deviation and noise coefficients of a unit at rest, and what a record would have to be to tell them."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from . import options
from .opening import Opening, reads_recording

if TYPE_CHECKING:
    from ..noise.record import Noise
    from ..plan import Plan

NOISE_EXAMPLE = (
    "Example: `sagnac noise still.parquet --out noise.json --plot noise.png`, into a plan: "
    "`sagnac noise still.parquet --into plan.toml --out plan-with-noise.toml`; before a test: "
    "`sagnac noise --expect gyro='N=0.2 deg/sqrt(h), B=5 deg/h' --rate '100 Hz'`"
)


class Kind(StrEnum):
    """Which deviation."""

    allan = "allan"
    modified = "modified"
    hadamard = "hadamard"


@reads_recording
def noise(
    recording: Annotated[
        Path | None,
        typer.Argument(
            help="Recording of a unit at rest: CSV, Parquet, ROS bag, ULog, .BIN, .mat, ... Left out: see --plan.",
            metavar="RECORDING",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File to write: the noise (JSON), or with --into the new plan or calibration."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw deviation and spectrum (PNG, SVG, PDF).")] = None,
    kind: Annotated[Kind, typer.Option(help="Deviation; hadamard sees no steady drift.")] = Kind.allan,
    start: Annotated[str | None, typer.Option("--from", help="Where to begin: '10 s'.", metavar="TEXT")] = None,
    stop: Annotated[str | None, typer.Option("--to", help="Where to stop: '2 h'.", metavar="TEXT")] = None,
    plan: Annotated[
        Path | None,
        typer.Option(
            "--plan",
            help="Plan of the recording (TOML), for its scale and segments. Without a recording: a plan that states noise, or "
            "the noise of an earlier test (JSON), to tell how long a record has to be.",
        ),
    ] = None,
    segment: Annotated[str | None, typer.Option(help="Segment of the plan to look at.", metavar="NAME")] = None,
    into: Annotated[
        Path | None,
        typer.Option(help="Plan (TOML) or calibration (JSON) to write the noise into; --out takes the result."),
    ] = None,
    despite: Annotated[
        str, typer.Option(help="Disturbances to put up with: step,motion,line,... (else their axis is refused).")
    ] = "",
    memory: Annotated[
        float,
        typer.Option(
            min=0.0, help="Samples to keep at most, GB; of more the deviation is that of a pyramid of averages."
        ),
    ] = 2.0,
    expect: Annotated[
        list[str] | None,
        typer.Option(
            "--expect", help="Without a recording: gyro='N=0.2 deg/sqrt(h), B=5 deg/h', once a sensor.", metavar="TEXT"
        ),
    ] = None,
    within: Annotated[str, typer.Option(help="Without a recording: uncertainty to reach.", metavar="TEXT")] = "10 %",
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Find the noise of a unit at rest, or tell how long it has to be recorded for that."""
    options.keep_inputs(("--out", out), ("--plot", plot), inputs=(recording, plan, into))
    options.check_picture(plot)
    if recording is None:
        _before(plan, expect or [], opening.rate, within, out, plot, as_json)
        return
    if expect:
        raise InputError("--expect tells of a record that there is not yet: leave out the recording, or --expect")
    if into is not None and out is None:
        raise InputError(f"--into {into}: give the file to write with --out; inputs are never modified")
    from .. import plan as plans
    from ..noise.study import study
    from .terminal import note

    done = None if plan is None else plans.load(plan)
    first, last = _window(start, stop, done, segment)
    found = study(
        opening.open(recording, plan=done),
        kind=kind.value,
        start=first,
        stop=last,
        memory=int(memory * 1e9),
        despite=options.parts(despite) or (),
        unit=None if done is None else done.unit,
    )
    written = []
    if out is not None:
        _write(found, out, into)
        written.append(out)
    if plot is not None:
        from ..report.noise import noise_figure
        from ..report.style import save

        save(noise_figure(found), plot)
        written.append(plot)
    for path in written:
        note(f"written: {path}")
    typer.echo(found.to_json() if as_json else found.summary(), nl=False)
    if found.refused:
        raise typer.Exit(1)


def _window(
    start: str | None, stop: str | None, plan: Plan | None, segment: str | None
) -> tuple[float | None, float | None]:
    """Times to look at, from the options or from a segment of the plan."""
    from .. import units

    if segment is None:
        first = None if start is None else units.parse(start, "time", "--from")
        last = None if stop is None else units.parse(stop, "time", "--to")
        if first is not None and last is not None and not last > first:
            raise InputError(f"--to {stop} is not after --from {start}")
        return first, last
    if start is not None or stop is not None:
        raise InputError("--segment says where to begin and stop: leave out --from and --to, or --segment")
    if plan is None:
        raise InputError(f"--segment {segment}: give the plan that it stands in, --plan")
    for s in plan.segment:
        if s.name == segment:
            return s.start, s.stop
    raise InputError(f"--segment {segment}: the plan has {', '.join(s.name for s in plan.segment) or 'no segments'}")


def _write(found: Noise, out: Path, into: Path | None) -> None:
    """The test itself, or the plan or calibration that it goes into."""
    from ..noise.into import into_calibration, into_plan, remarks_of
    from .terminal import note

    if into is None:
        found.save(out)
    elif into.suffix.lower() == ".json":
        into_calibration(found, into, out)
    else:
        into_plan(found, into, out)
    for remark in remarks_of(found) if into is not None else ():
        note(remark)


def _before(
    plan: Path | None,
    expect: list[str],
    rate: str | None,
    within: str,
    out: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """What a record has to be, told without one."""
    from .. import units
    from ..noise import expected
    from .terminal import note

    if plan is None and not expect:
        raise InputError(
            "give a RECORDING, or what noise is expected to hear how long to record: --plan plan.toml, --plan noise.json, or "
            "--expect gyro='N=0.2 deg/sqrt(h), B=5 deg/h'"
        )
    given, interval = ([], None) if plan is None else expected.from_file(plan)
    said = [expected.from_text(text) for text in expect]
    given = [e for e in given if e.sensor not in {s.sensor for s in said}] + said
    if rate is not None:
        interval = 1.0 / units.parse(rate, "sample rate", "--rate")
    if interval is None:
        raise InputError("the length of a record depends on the rate of its samples: give --rate '100 Hz'")
    found = expected.needs(given, interval, target=units.parse(within, "ratio", "--within"))
    if out is not None:
        from ..files import write_atomically

        with write_atomically(out) as temporary:
            temporary.write_text(json.dumps(expected.to_dict(found), indent=1) + "\n", encoding="utf-8")
        note(f"written: {out}")
    if plot is not None:
        from ..report.noise import needs_figure
        from ..report.style import save

        save(needs_figure(found), plot)
        note(f"written: {plot}")
    typer.echo(json.dumps(expected.to_dict(found), indent=1) if as_json else expected.told(found), nl=as_json)
