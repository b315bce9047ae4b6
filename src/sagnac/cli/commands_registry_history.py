"""``sagnac registry trend`` and ``sagnac registry compare``: what a history of calibrations tells."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options
from .commands_registry import Model, RegistryAt, Since

if TYPE_CHECKING:
    from ..calibration import Calibration
    from ..registry.store import Registry

PlotFile = Annotated[Path | None, typer.Option("--plot", help="Draw it: .png, .svg or .pdf file.", metavar="FILE")]


TREND_EXAMPLE = (
    "Example: `sagnac registry trend 0001 --registry fleet.db`, with a picture of some parameters "
    "`sagnac registry trend 0001 --parameter 'accel.bias.*' --at 2027-01-01 --registry fleet.db --plot trend.png`, and of all "
    "units of a model `sagnac registry trend --model LG-1 --registry fleet.db`"
)
COMPARE_EXAMPLE = (
    "Example: `sagnac registry compare last-year.json cal.json`, and of a registry "
    "`sagnac registry compare 0001@2024-12-31 0001 --registry fleet.db`"
)


def trend(
    serial: Annotated[
        str | None, typer.Argument(help="Serial number of the unit; left out: all units.", metavar="SERIAL")
    ] = None,
    model: Model = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option("--parameter", help="Only these, by name or pattern: 'accel.bias.*'.", metavar="NAME"),
    ] = None,
    at: Annotated[
        str | None, typer.Option("--at", help="Predict for this date; default: a year after the last.", metavar="DATE")
    ] = None,
    since: Since = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="A calibration that does not count: id:12.", metavar="ID")
    ] = None,
    k: Annotated[
        float | None,
        typer.Option(
            "-k", min=1.0, help="Joint standard uncertainties from which a change is named a step; default: 5."
        ),
    ] = None,
    limit: Annotated[
        int | None,
        typer.Option(min=1, help="Units of a fleet that are named, nearest to limits first; default: 10."),
    ] = None,
    plot: PlotFile = None,
    registry: RegistryAt = None,
    as_json: options.Json = False,
) -> None:
    """Tell how the parameters of a unit drift, what to expect, when limits are left; or how the units of a model drift."""
    from ..registry import analysis, open_registry
    from ..registry.dates import parse
    from ..registry.series import STEP

    options.check_picture(plot)
    begin = None if since is None else parse(since, "--since")
    end = None if at is None else parse(at, "--at", end=True)
    _check_use(serial, {"--at": at, "-k": k}, {"--limit": limit})
    numbers = [_number(text) for text in without or ()]
    with open_registry(registry) as opened:
        options.keep_inputs(("--plot", plot), inputs=(opened.where.path,))
        if serial is not None:
            unit = opened.unit(serial, model)
            found = analysis.unit_trend(
                opened, unit, parameter, at=end, since=begin, without=numbers, k=STEP if k is None else k
            )
            _tell(found.to_json() if as_json else found.summary(), as_json)
        else:
            fleet = analysis.fleet_trend(opened, model, parameter, since=begin, without=numbers)
            _tell(fleet.to_json() if as_json else fleet.summary(10 if limit is None else limit), as_json)
    if plot is not None:
        from ..report import registry as pictures
        from ..report.style import save

        save(pictures.trend(found) if serial is not None else pictures.fleet(fleet), plot)


def _check_use(serial: str | None, of_unit: dict[str, object], of_fleet: dict[str, object]) -> None:
    """Refuse options of the trend of one unit for that of many, and the other way round."""
    from ..errors import InputError

    one, other = "is for the trend of one unit; name its serial number", "is for the trend of many units; name none"
    for name, given in (of_unit if serial is None else of_fleet).items():
        if given is not None:
            raise InputError(f"{name}: {one if serial is None else other}")


def _number(text: str) -> int:
    """Of a calibration, from ``id:12``."""
    from ..errors import InputError
    from ..registry.entries import numbered

    number = numbered(text)
    if number is None:
        raise InputError(f"--without: {text!r} is no number of a calibration; write id:12")
    return number


def compare(
    before: Annotated[
        str,
        typer.Argument(help="The earlier one: file (JSON), serial number, SERIAL@DATE, id:12, ...", metavar="BEFORE"),
    ],
    after: Annotated[str, typer.Argument(help="The later one, likewise.", metavar="AFTER")],
    model: Model = None,
    plot: PlotFile = None,
    registry: RegistryAt = None,
    as_json: options.Json = False,
) -> None:
    """Compare two calibrations in units of their joint uncertainty; files need no registry."""
    from ..calibration import load
    from ..registry import open_registry
    from ..registry.compare import compare as run

    options.check_picture(plot)
    files = [text.lower().endswith(".json") or Path(text).is_file() for text in (before, after)]
    with nullcontext() if all(files) else open_registry(registry) as opened:
        inputs = [Path(text) for text, own in zip((before, after), files, strict=True) if own]
        options.keep_inputs(("--plot", plot), inputs=(*inputs, None if opened is None else opened.where.path))
        (first, one), (second, other) = (
            (text, load(text)) if opened is None or own else _registered(text, opened, model)
            for text, own in zip((before, after), files, strict=True)
        )
    found = run(one, other, names=(first, second))
    _tell(found.to_json() if as_json else found.summary(), as_json)
    if plot is not None:
        from ..report import registry as pictures
        from ..report.style import save

        save(pictures.comparison(found), plot)


def _registered(text: str, opened: Registry, model: str | None) -> tuple[str, Calibration]:
    """A calibration of a registry with a name for it."""
    entry = opened.resolve(text, model)
    return f"id:{entry.id}", opened.calibration(entry)


def _tell(text: str, as_json: bool) -> None:
    typer.echo(text, nl=as_json and not text.endswith("\n"))
