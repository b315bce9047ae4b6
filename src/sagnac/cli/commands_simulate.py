"""``sagnac simulate``: a scenario to a recording, its plan and the truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from . import options

EXAMPLE = (
    "Example: `sagnac simulate norm --out norm --seed 1`, or with a scenario of your own: "
    "`sagnac simulate scenario.toml --out simulated`"
)


def simulate(
    scenario: Annotated[
        str | None,
        typer.Argument(help="Scenario (TOML), or the name of a shipped one.", metavar="SCENARIO", show_default=False),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for recording, plan and truth.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same files.")] = 1,
    threads: Annotated[int | None, typer.Option(min=1, help="Processors to use; all of them unless given.")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the shipped scenarios and exit.")] = False,
    show: Annotated[bool, typer.Option("--show", help="Print the scenario's file and exit.")] = False,
    as_json: options.Json = False,
) -> None:
    """Simulate a unit on a rig whose errors are known: recording, plan and truth."""
    from ..simulate import scenario as scenarios

    if listed:
        table = scenarios.shipped()
        width = max(map(len, table))
        typer.echo(
            json.dumps(table, indent=1) if as_json else "\n".join(f"{n:<{width}}  {t}" for n, t in table.items())
        )
        return
    if scenario is None:
        raise InputError("simulate: name a SCENARIO (--list shows the shipped ones)")
    if show:
        typer.echo(scenarios.text(scenario), nl=False)
        return
    if out is None:
        raise InputError("simulate: give the folder with --out DIR")
    from ..simulate.run import names, run
    from .terminal import counting

    read = scenarios.load(scenario)
    source = Path(scenario)
    for name in names(read):
        options.keep_inputs(("--out", out / name), inputs=(source if source.suffix == ".toml" else None,))
    _announce_compilation()
    with counting(f"simulating {read.name}") as progress:
        done = run(read, out, seed=seed, threads=threads, progress=progress)
    typer.echo(json.dumps(done.to_dict(), indent=1) if as_json else done.summary(), nl=as_json)


def _announce_compilation() -> None:
    """Say that the kernels are being compiled, when they are."""
    from ..kernels import is_cold
    from ..kernels.simulation import table_inputs
    from .terminal import note

    if is_cold(table_inputs):
        note("compiling the simulation kernels (some seconds, once on this machine) ...")
