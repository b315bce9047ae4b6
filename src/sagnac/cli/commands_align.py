"""``sagnac align``: how a unit is mounted and what its biases are, from a master's log; and how well that would be known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options
from .commands_monte_carlo import MONTE_CARLO_EXAMPLE, monte_carlo
from .commands_static import STATIC_EXAMPLE, static
from .opening import Opening, reads_recording

align_app = typer.Typer(
    name="align",
    help="Align a unit: from its master's log, at rest, or without data to see how well it would do.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
align_app.command(epilog=STATIC_EXAMPLE)(static)
align_app.command("monte-carlo", epilog=MONTE_CARLO_EXAMPLE)(monte_carlo)

ConfigFile = Annotated[
    Path, typer.Option("--config", help="Method, what is known beforehand, noise (TOML).", metavar="C.TOML")
]


@align_app.command(
    epilog="Example: `sagnac align transfer --master master.parquet --slave recording.parquet --config config.toml --out aligned`"
)
@reads_recording
def transfer(
    master: Annotated[Path, typer.Option("--master", help="The master's log (CSV or Parquet).", metavar="FILE")],
    slave: Annotated[Path, typer.Option("--slave", help="Recording of the slave.", metavar="FILE")],
    config: ConfigFile,
    out: Annotated[Path, typer.Option("--out", help="Folder for alignment.json, history.parquet and pictures.")],
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Align a slave from its master's velocity, and attitude if wanted; exit status 1 when the logs do not support it."""
    from ..align.transfer import transfer as run
    from ..report.alignment import PICTURES
    from .terminal import announce_compilation, counting

    opened = opening.open(slave, told=False)
    announce_compilation("align transfer")
    with counting(f"aligning {slave.name}", "s") as progress:
        found = run(master, opened, config, out, draw=PICTURES, progress=progress)
    typer.echo(found.to_json() if as_json else f"{found.summary()}  written to {out}", nl=not as_json)


@align_app.command(epilog="Example: `sagnac align covariance --config config.toml --out predicted`")
def covariance(
    config: ConfigFile,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the result, as of a transfer.")] = None,
    as_json: options.Json = False,
) -> None:
    """Predict how well an alignment along the course of [trajectory] would do, without data."""
    from ..align.transfer import covariance as run
    from ..report.alignment import COVARIANCE_PICTURES
    from .terminal import announce_compilation

    announce_compilation("align covariance")
    found = run(config, out, draw=COVARIANCE_PICTURES)
    told = f"{found.summary()}  written to {out}" if out is not None else found.summary()
    typer.echo(found.to_json() if as_json else told.rstrip("\n"), nl=not as_json)
