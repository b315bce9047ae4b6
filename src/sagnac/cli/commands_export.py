"""``sagnac export``: a calibration in the files of other software."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import InputError
from . import options

if TYPE_CHECKING:
    from ..export import Exported, Options

EXAMPLE = (
    "Example: `sagnac export cal.json --to px4 --out unit.params`, or for Kalibr: "
    "`sagnac export cal.json --to kalibr --rate '200 Hz' --noise accel_density='80 ug/sqrt(Hz)' "
    "--noise accel_random_walk='2e-5 m/s^3/sqrt(Hz)' --noise gyro_density='0.3 deg/sqrt(h)' "
    "--noise gyro_random_walk='1e-6 rad/s^2/sqrt(Hz)' --out imu.yaml`"
)


class To(StrEnum):
    """Software that a calibration can be written for; what each file is stands in ``sagnac.export.TARGETS``."""

    px4 = "px4"
    ardupilot = "ardupilot"
    ros = "ros"
    kalibr = "kalibr"
    kalibr_intrinsics = "kalibr-intrinsics"
    imu_tk = "imu_tk"
    openvins = "openvins"
    openvins_rpng = "openvins-rpng"
    vins = "vins"
    matlab = "matlab"
    c = "c"
    json = "json"


def export(
    calibration: Annotated[Path, typer.Argument(help="Calibration file (JSON).", metavar="CAL.JSON")],
    to: Annotated[To, typer.Option("--to", help="The software to write for.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File to write; without it, text is printed and the rest goes to stderr."),
    ] = None,
    noise: Annotated[
        list[str] | None,
        typer.Option(
            "--noise",
            help="Noise that the target needs, once a number: accel_density, accel_random_walk, gyro_density, "
            "gyro_random_walk, as in gyro_random_walk='1e-6 rad/s^2/sqrt(Hz)'.",
            metavar="TEXT",
        ),
    ] = None,
    rate: Annotated[str | None, typer.Option("--rate", help="Samples per second: '200 Hz'.", metavar="TEXT")] = None,
    topic: Annotated[str, typer.Option(help="ROS topic of the samples.", metavar="TEXT")] = "/imu0",
    device_id: Annotated[
        str | None,
        typer.Option(help="PX4: identifiers of the sensors, accel=N,gyro=N, or one number for both.", metavar="TEXT"),
    ] = None,
    instance: Annotated[
        int | None,
        typer.Option(
            help="Which sensor of the autopilot: PX4 0 to 3, ArduPilot 1 to 5; default: that of the log, else the first."
        ),
    ] = None,
    temperature: Annotated[
        str | None, typer.Option(help="Of the unit when it was calibrated: '25 degC'.", metavar="TEXT")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Write a calibration for other software, and say what that software cannot hold."""
    from ..calibration import load
    from ..export import TARGETS
    from ..export import export as run
    from .terminal import note

    options.keep_inputs(("--out", out), inputs=(calibration,))
    given = _options(noise, rate, topic, device_id, instance, temperature)
    done = run(load(calibration), to.value, given)
    if out is None:
        if TARGETS[to.value].binary or len(done.files) > 1:
            raise InputError(
                f"--to {to.value} writes {'binary data' if len(done.files) == 1 else 'two files'}: say where with --out"
            )
        text = done.files[""].decode()
        typer.echo(json.dumps({"text": text, **done.to_dict()}, indent=1) if as_json else text, nl=as_json)
        if not as_json:
            note(done.summary())
        return
    for path in done.paths(out):
        options.keep_inputs(("--out", path), inputs=(calibration,))
    written = done.save(out)
    typer.echo(_told(to.value, written, done, as_json))


def _told(target: str, written: tuple[Path, ...], done: Exported, as_json: bool) -> str:
    if as_json:
        return json.dumps({"to": target, "out": [str(p) for p in written], **done.to_dict()}, indent=1)
    return f"{', '.join(str(p) for p in written)}\n{done.summary()}"


def _options(
    noise: list[str] | None,
    rate: str | None,
    topic: str,
    device_id: str | None,
    instance: int | None,
    temperature: str | None,
) -> Options:
    from .. import units
    from ..export import Options
    from ..export.noise import parse

    texts: dict[str, str] = {}
    for text in noise or []:
        texts |= options.pairs(text, "--noise")
    frequency = None if rate is None else units.parse(rate, "sample rate", "--rate")
    if frequency is not None and not frequency > 0:
        raise InputError(f"--rate {rate!r} must be more than zero")
    return Options(
        noise=parse(texts),
        rate=frequency,
        topic=topic,
        device_id=_identifiers(device_id),
        instance=instance,
        temperature=None if temperature is None else units.parse(temperature, "temperature", "--temperature"),
    )


def _identifiers(text: str | None) -> dict[str, int]:
    """``accel=N,gyro=N``, or one number for both."""
    if text is None:
        return {}
    given: dict[str, Any] = (
        options.pairs(text, "--device-id") if "=" in text else dict.fromkeys(("accel", "gyro"), text.strip())
    )
    for sensor, number in given.items():
        if sensor not in ("accel", "gyro") or not str(number).isdecimal() or not 0 < int(number) < 2**31:
            raise InputError(f"--device-id {text!r}: write accel=N,gyro=N with the numbers that the autopilot shows")
    return {sensor: int(number) for sensor, number in given.items()}
