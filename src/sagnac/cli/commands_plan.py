"""``sagnac plan``: what a plan will see, and better plans, before the rig is booked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from . import options

plan_app = typer.Typer(
    name="plan",
    help="What will a plan be able to see, before the rig is booked?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


@plan_app.command(epilog="Example: `sagnac plan check plan.toml`")
def check(
    plan: Annotated[Path, typer.Argument(help="What is to be done with the unit (TOML).", metavar="PLAN")],
    method: Annotated[
        str | None, typer.Option(help="table, norm, multi-position, centrifuge or roll-isolated; default: the rig's.")
    ] = None,
    sensors: options.Sensors = "",
    as_json: options.Json = False,
) -> None:
    """Predict every parameter's uncertainty; exit status 1 when the plan is not enough."""
    from ..design import check as run
    from ..plan import load

    found = run(load(plan), method, sensors=options.parts(sensors))
    typer.echo(json.dumps(found.to_dict(), indent=1) if as_json else found.summary(), nl=as_json)
    if found.unseen:
        raise typer.Exit(1)


@plan_app.command(epilog="Example: `sagnac plan optimise wanted.toml --out plan.toml`")
def optimise(
    wanted: Annotated[
        Path,
        typer.Argument(help="A plan's header with a table [optimise] (TOML), see the documentation.", metavar="WANTED"),
    ],
    out: Annotated[Path | None, typer.Option("--out", help="Plan to write (TOML).")] = None,
    as_json: options.Json = False,
) -> None:
    """Pick positions, rates, g levels and dwell for the least uncertainty in the time there is."""
    from ..design import load_spec
    from ..design import optimise as run

    options.keep_inputs(("--out", out), inputs=(wanted,))
    done = run(load_spec(wanted))
    if out is not None:
        done.plan.save(out)
    typer.echo(json.dumps(done.to_dict(), indent=1) if as_json else done.summary(), nl=as_json)
