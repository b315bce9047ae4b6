"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError

if TYPE_CHECKING:
    from ..plan import Plan

RecordingFile = Annotated[
    Path, typer.Argument(help="Recording: CSV, Parquet, ROS bag, ULog, .BIN, .mat, ...", metavar="RECORDING")
]
PlanFile = Annotated[Path | None, typer.Option("--plan", help="What was done with the unit (TOML).")]
Gravity = Annotated[str | None, typer.Option(help="Measured gravity of the site: '9.81744 m/s^2'.", metavar="TEXT")]
Latitude = Annotated[str | None, typer.Option(help="Latitude of the site: '48.1 deg'.", metavar="TEXT")]
Height = Annotated[str | None, typer.Option(help="Height of the site: '500 m'.", metavar="TEXT")]
Threshold = Annotated[
    float | None,
    typer.Option(
        min=1.0,
        help="Hand-turned units: variance, over that of the quietest windows, up to which a window is static.",
    ),
]
Sensors = Annotated[
    str,
    typer.Option(help="Recorded triads or single sensors: accel,gyro or accel_z; default: those with noise stated."),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for machines.")]


def pairs(text: str | None, option: str) -> dict[str, str]:
    """``a=b,c=d`` as a table.

    Raises
    ------
    InputError
        When a part has no equals sign.
    """
    out = {}
    for part in (text or "").split(","):
        if not part.strip():
            continue
        name, equals, value = part.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise InputError(f"{option} {text!r}: write name=value pairs with commas between, not {part.strip()!r}")
        out[name.strip()] = value.strip()
    return out


def parts(text: str) -> tuple[str, ...] | None:
    """Names with commas between; None when there are none."""
    return tuple(part.strip() for part in text.split(",") if part.strip()) or None


def keep_inputs(*outputs: tuple[str, Path | None], inputs: tuple[Path | None, ...]) -> None:
    """Refuse an output file that is one of the inputs, or another output.

    Raises
    ------
    InputError
        With the option and the file.
    """
    taken = [(path, "an input; inputs are never modified") for path in inputs if path is not None]
    for option, path in outputs:
        if path is None:
            continue
        for other, reason in taken:
            if path.resolve() == other.resolve() or (path.exists() and other.exists() and path.samefile(other)):
                raise InputError(f"{option} {path}: is {reason}")
        taken.append((path, f"written by {option} already"))


def check_picture(path: Path | None) -> None:
    """Refuse a picture of a kind that cannot be drawn, before any work is done."""
    if path is not None and path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"--plot {path}: write to a .png, .svg or .pdf file")


def plan_with(path: Path | None, gravity: str | None, latitude: str | None, height: str | None) -> Plan | None:
    """The plan, with site options laid over it; None when there is neither."""
    from .. import plan as plans

    site = {k: v for k, v in (("gravity", gravity), ("latitude", latitude), ("height", height)) if v is not None}
    if path is None:
        return plans.from_table(site, "site options") if site else None
    plan = plans.load(path)
    return plan.model_copy(update={k: getattr(plans.from_table(site, "site options"), k) for k in site})
