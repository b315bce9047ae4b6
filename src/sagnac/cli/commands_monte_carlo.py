"""``sagnac align monte-carlo``: does the filter know as much as it says, over many runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from . import options

MONTE_CARLO_EXAMPLE = "Example: `sagnac align monte-carlo --config config.toml --runs 1000`"


def monte_carlo(
    config: Annotated[
        Path, typer.Option("--config", help="As for a transfer, with a course in [trajectory].", metavar="C.TOML")
    ],
    runs: Annotated[int, typer.Option(min=2, help="How many.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same runs, on any number of threads.")] = 0,
    frequency: Annotated[float, typer.Option(min=0.1, help="Of the slave's samples, Hz.")] = 100.0,
    threads: Annotated[int | None, typer.Option(min=1, help="Processors to use; all of them unless given.")] = None,
    as_json: options.Json = False,
) -> None:
    """Run many alignments along the course of [trajectory], whole chains with errors drawn, and compare errors with sigmas."""
    from ..align import config as configs
    from ..align.monte_carlo import monte_carlo as run
    from .terminal import announce_compilation, counting

    settings = configs.load(config)
    announce_compilation("align monte-carlo")
    with counting(f"{runs} runs", "%") as progress:
        done = run(
            settings,
            runs=runs,
            seed=seed,
            frequency=frequency,
            threads=threads,
            progress=lambda part: progress(round(100.0 * part)),
        )
    typer.echo(json.dumps(done.to_dict(), indent=1) if as_json else done.summary())
