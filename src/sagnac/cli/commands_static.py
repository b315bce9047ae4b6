"""``sagnac align static`` and ``sagnac navigate``: where a unit points, and where it finds itself from its own samples."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from . import options
from .opening import Opening, reads_recording

STATIC_EXAMPLE = (
    "Example: `sagnac align static parked.parquet --scale 'gyro=10 pulse/arcsec' --scale 'accel=817.996 pulse/(m/s)' "
    "--latitude '34.246 deg' --longitude '108.91 deg' --height '380 m' --to '300 s' --out alignment.json`"
)
NAVIGATE_EXAMPLE = (
    "Example: `sagnac navigate parked.parquet --scale 'gyro=10 pulse/arcsec' --scale 'accel=817.996 pulse/(m/s)' "
    "--start alignment.json --out track.parquet --plot track.png`"
)


class Method(StrEnum):
    """How a unit at rest is aligned."""

    fine = "fine"
    gyrocompass = "gyrocompass"


class Meaning(StrEnum):
    """What samples of rate and force are."""

    instant = "instant"
    mean = "mean"


class Vertical(StrEnum):
    """What becomes of the height."""

    held = "held"
    free = "free"


From = Annotated[str | None, typer.Option("--from", help="Where to begin: '10 s'.", metavar="TEXT")]
To = Annotated[str | None, typer.Option("--to", help="Where to stop: '300 s'.", metavar="TEXT")]
Samples = Annotated[
    Meaning, typer.Option(help="Samples other than pulses: values at their times, or means since the one before.")
]
Bridge = Annotated[
    bool, typer.Option("--bridge-gaps", help="Fill gaps with the mean of the samples around them, and say so.")
]


def _needed(text: str, kind: str, option: str) -> float:
    """SI value of an option's text."""
    from .. import units

    return units.parse(text, kind, option)


def _si(text: str | None, kind: str, option: str) -> float | None:
    """The same of one that may be left out."""
    return None if text is None else _needed(text, kind, option)


@reads_recording
def static(
    recording: options.RecordingFile,
    latitude: Annotated[str, typer.Option(help="'34.246 deg', north positive.", metavar="TEXT")],
    longitude: Annotated[str, typer.Option(help="'108.91 deg', east positive.", metavar="TEXT")],
    height: Annotated[str, typer.Option(help="Above the ellipsoid: '380 m'.", metavar="TEXT")],
    start: From = None,
    stop: To = None,
    out: Annotated[Path | None, typer.Option("--out", help="Alignment file to write (JSON).")] = None,
    gyro_bias: Annotated[
        str | None, typer.Option(help="What the gyro biases may be, one sigma; default '0.01 deg/h'.", metavar="TEXT")
    ] = None,
    accel_bias: Annotated[
        str | None, typer.Option(help="What the accelerometer biases may be; default '50 ug'.", metavar="TEXT")
    ] = None,
    gyro_noise: Annotated[
        str | None,
        typer.Option(help="White noise, '0.001 deg/sqrt(h)'; found in the samples unless given.", metavar="TEXT"),
    ] = None,
    accel_noise: Annotated[str | None, typer.Option(help="The same, '10 ug/sqrt(Hz)'.", metavar="TEXT")] = None,
    gravity: options.Gravity = None,
    method: Annotated[
        Method, typer.Option(help="fine: all samples, may sway. gyrocompass: from the means, at rest only.")
    ] = Method.fine,
    upside_down: Annotated[bool, typer.Option("--upside-down", help="The z axis may point down.")] = False,
    samples: Samples = Meaning.instant,
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Find the attitude of a unit that stays at its place (it may sway), from its own samples."""
    from ..align.static import align, place_of
    from .terminal import announce_compilation

    options.keep_inputs(("--out", out), inputs=(recording,))
    place = place_of(
        _needed(latitude, "angle", "--latitude"),
        _needed(longitude, "angle", "--longitude"),
        _needed(height, "length", "--height"),
        gravity=_si(gravity, "acceleration", "--gravity"),
    )
    opened = opening.open(recording)
    announce_compilation("align static")
    result = align(
        opened,
        place,
        start=_si(start, "time", "--from"),
        stop=_si(stop, "time", "--to"),
        method=method.value,
        meaning=samples.value,
        gyro_bias=_si(gyro_bias, "angular rate", "--gyro-bias"),
        accel_bias=_si(accel_bias, "acceleration", "--accel-bias"),
        gyro_noise=_si(gyro_noise, "gyro noise density", "--gyro-noise"),
        accel_noise=_si(accel_noise, "accelerometer noise density", "--accel-noise"),
        upside_down=upside_down,
    )
    if out is not None:
        result.save(out)
    typer.echo(result.to_json() if as_json else result.summary(), nl=False)


@reads_recording
def navigate(
    recording: options.RecordingFile,
    start: Annotated[Path, typer.Option("--start", help="Alignment to start from (JSON).")],
    out: Annotated[Path, typer.Option("--out", help="Track to write (.parquet or .csv).")],
    stop: To = None,
    every: Annotated[str, typer.Option(help="Time between rows of the track.", metavar="TEXT")] = "1 s",
    biases: Annotated[
        bool, typer.Option("--biases/--no-biases", help="Take the biases that the alignment found off the samples.")
    ] = True,
    vertical: Annotated[
        Vertical, typer.Option(help="held: the height stays. free: it is integrated, and runs away.")
    ] = Vertical.held,
    gravity: options.Gravity = None,
    samples: Samples = Meaning.instant,
    bridge: Bridge = False,
    plot: Annotated[Path | None, typer.Option(help="Draw drift and track (PNG, SVG, PDF).")] = None,
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Navigate from an aligned start by the unit's own samples alone."""
    from ..align.result import load
    from ..align.start import biases_of, refuse_other_reading, state_of
    from ..earth import gravity_excess
    from ..navigate.free import navigate as run
    from .terminal import announce_compilation, counting

    options.keep_inputs(("--out", out), ("--plot", plot), inputs=(recording, start))
    options.check_picture(plot)
    interval = _needed(every, "time", "--every")
    found = load(start)
    state = state_of(found, str(start))
    gyro_bias, accel_bias = biases_of(found) if biases else (None, None)
    opened = opening.open(recording, told=False)
    refuse_other_reading(found, opened, str(start))
    measured = _si(gravity, "acceleration", "--gravity")
    announce_compilation("navigate")
    with counting(f"navigating {opened.name}") as progress:
        done = run(
            opened,
            state,
            out,
            begin=found.time,
            stop=_si(stop, "time", "--to"),
            interval=interval,
            gyro_bias=gyro_bias,
            accel_bias=accel_bias,
            meaning=samples.value,
            vertical=vertical.value,
            gravity_excess=gravity_excess(measured, float(state.place[0]), float(state.height)),
            bridge=bridge,
            progress=progress,
        )
    if plot is not None:
        from ..report.track import draw_track

        draw_track(out, plot)
    typer.echo(
        json.dumps({"out": str(out), **done.to_dict()}, indent=1) if as_json else f"{done.summary()}\n  track in {out}"
    )
