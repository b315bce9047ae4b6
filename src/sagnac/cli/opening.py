"""How a command opens recordings: one set of options, given to every command that reads one."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import pairs

if TYPE_CHECKING:
    from ..calibration import Calibration
    from ..plan import Plan
    from ..recording import Recording


@dataclass(frozen=True)
class Opening:
    """What the user said about the files of a recording; the texts are those of the options."""

    units: Annotated[
        str | None,
        typer.Option("--units", help="Units of columns that name none: accel=g,gyro=deg/s,time=s", metavar="TEXT"),
    ] = None
    scale: Annotated[
        list[str] | None,
        typer.Option(
            "--scale",
            help="Nominal scale of count or pulse columns, once a sensor or axis: gyro=1.1866pulse/arcsec",
            metavar="TEXT",
        ),
    ] = None
    names: Annotated[
        str | None,
        typer.Option("--map", help="Other column names: accel_x=AX,... or, of a matrix, accel=acc", metavar="TEXT"),
    ] = None
    select: Annotated[
        str | None,
        typer.Option("--select", help="One of several recordings in a file: topic or instance.", metavar="TEXT"),
    ] = None
    rate: Annotated[
        str | None, typer.Option("--rate", help="Sample rate of a file without time: '100 Hz'.", metavar="TEXT")
    ] = None
    partial: Annotated[bool, typer.Option("--partial", help="Take a damaged file up to the damage.")] = False

    def open(
        self, path: Path, *, plan: Plan | None = None, calibration: Calibration | None = None, told: bool = True
    ) -> Recording:
        """The recording, with the nominal scale of the calibration, the plan and the options, the last one counting.

        How far the reading has come is `told`, unless the command itself counts.
        """
        from ..recording import open_recording
        from .terminal import reading

        given = dict(calibration.unit.scale) if calibration is not None else {}
        given |= plan.unit.scale if plan is not None else {}
        for text in self.scale or []:
            given |= pairs(text, "--scale")
        return open_recording(
            path,
            units_of=pairs(self.units, "--units"),
            scale=given,
            rename=pairs(self.names, "--map"),
            select=self.select,
            rate=self.rate,
            partial=self.partial,
            watch=reading if told else None,
        )


def reads_recording(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of :class:`Opening`, which it takes as its last argument `opening`."""
    own = inspect.signature(command, eval_str=True)
    hints = inspect.get_annotations(Opening, eval_str=True)
    offered = [
        inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default, annotation=hints[f.name])
        for f in fields(Opening)
    ]

    @wraps(command)
    def run(**given: Any) -> None:
        opening = Opening(**{f.name: given.pop(f.name) for f in fields(Opening)})
        command(**given, opening=opening)

    kept = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own.parameters.values() if p.name != "opening"]
    last = [p for p in kept if p.name == "as_json"]
    parameters = [*(p for p in kept if p.name != "as_json"), *offered, *last]
    run.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters} | {"return": None}
    return run
