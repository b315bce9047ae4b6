"""``sagnac registry``: calibrations of a fleet over the years."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from . import options, registry_text

if TYPE_CHECKING:
    from ..limits import Limits

registry_app = typer.Typer(
    name="registry",
    help="Calibrations of a fleet over the years: which there are, which was in force when, how parameters drift.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

RegistryAt = Annotated[
    str | None,
    typer.Option(
        "--registry",
        help="File, or URL such as postgresql://user@host/database; default: SAGNAC_REGISTRY, or a file in the user's folder.",
        metavar="WHERE",
    ),
]
Model = Annotated[str | None, typer.Option("--model", help="Model of the unit.", metavar="TEXT")]
Serial = Annotated[str | None, typer.Option("--serial", help="Serial number of the unit.", metavar="TEXT")]
Since = Annotated[
    str | None, typer.Option("--since", help="Only calibrations made on this day (UTC) or later.", metavar="DATE")
]
Reference = Annotated[
    str,
    typer.Argument(
        help="Serial number (its latest), SERIAL@DATE, id:12, or the begin of a SHA-256.", metavar="CALIBRATION"
    ),
]


class Decision(StrEnum):
    """How a limit is decided."""

    guarded = "guarded"
    simple = "simple"


@registry_app.command(
    epilog="Example: `sagnac registry add cal.json last-year.json --registry fleet.db`; of a file that does not say which unit "
    "it is of, `sagnac registry add hand.json --model MTi --serial 0042 --registry fleet.db`"
)
def add(
    files: Annotated[list[Path], typer.Argument(help="Calibrations (JSON), or folders of them.", metavar="FILE...")],
    model: Annotated[str, typer.Option(help="Model of the unit, for files that name none.", metavar="TEXT")] = "",
    serial: Annotated[
        str, typer.Option(help="Serial number of the unit, for files that name none.", metavar="TEXT")
    ] = "",
    as_of: Annotated[
        str,
        typer.Option("--as-of", help="Date of the test; left out: when the file says it was computed.", metavar="DATE"),
    ] = "",
    registry: RegistryAt = None,
    as_json: options.Json = False,
) -> None:
    """Register calibrations; exit status 2 when a file was refused, and the others are registered all the same."""
    from contextlib import nullcontext

    from ..registry import add_files
    from ..registry.address import address
    from ..registry.candidates import Lacking
    from .terminal import counting, note

    many = len(files) > 1 or files[0].is_dir()
    with counting("registering", "files") if many else nullcontext() as progress:
        done = add_files(registry, files, Lacking(model, serial, as_of), progress=progress)
    where = address(registry)
    if as_json:
        typer.echo(
            json.dumps(
                {"registry": str(where), "files": [a.to_dict() for a in done.added], "refused": list(done.refused)}
            )
        )
    elif done.added:
        new = sum(a.new for a in done.added)
        typer.echo("\n".join([*registry_text.added_text(done.added), f"{where}: {new} new"]))
    if len(done.refused) == 1 and not done.added:
        raise InputError(done.refused[0])
    for text in done.refused:
        note(f"refused: {text}")
    if done.refused:
        files_text = registry_text.counted(len(done.refused), "file")
        raise InputError(f"{files_text} refused, see above; {len(done.added)} are in the registry")


@registry_app.command(
    "list",
    epilog="Example: `sagnac registry list --registry fleet.db`, and the calibrations of one unit: "
    "`sagnac registry list --serial 0001 --registry fleet.db`",
)
def list_(
    model: Model = None,
    serial: Serial = None,
    since: Since = None,
    method: Annotated[str | None, typer.Option(help="Only calibrations by this method.", metavar="TEXT")] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Lines at most.")] = None,
    registry: RegistryAt = None,
    as_json: options.Json = False,
) -> None:
    """List the units with their latest calibrations, or the calibrations of one unit."""
    from ..registry import open_registry
    from ..registry.dates import parse

    start = None if since is None else parse(since, "--since")
    with open_registry(registry) as opened:
        if serial is None:
            found = opened.listing(model=model, since=start, method=method, at_most=limit)
            as_dict: object = {"registry": str(opened.where), "units": [f.to_dict() for f in found]}
            lines = registry_text.units_text(found, opened.where)
        else:
            every = opened.entries(opened.unit(serial, model))
            of_unit = [e for e in every if (start is None or e.created >= start) and method in (None, e.method)]
            of_unit = of_unit[-limit:] if limit else of_unit
            states = opened.states(of_unit)
            dicts = [e.to_dict() | (states[e.id].to_dict() if e.id in states else {}) for e in of_unit]
            as_dict = {"registry": str(opened.where), "calibrations": dicts}
            lines = registry_text.entries_text(of_unit, states)
    typer.echo(json.dumps(as_dict) if as_json else "\n".join(lines))


@registry_app.command(
    epilog="Example: `sagnac registry show 0001 --registry fleet.db`, or its file as it was registered: "
    "`sagnac registry show id:1 --registry fleet.db --out again.json`"
)
def show(
    calibration: Reference,
    model: Model = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write its file (JSON), byte for byte as it was registered.")
    ] = None,
    registry: RegistryAt = None,
    as_json: options.Json = False,
) -> None:
    """Show one calibration, or write its file."""
    from ..files import write_atomically
    from ..registry import open_registry
    from .terminal import note

    with open_registry(registry) as opened:
        options.keep_inputs(("--out", out), inputs=(opened.where.path,))
        entry = opened.resolve(calibration, model)
        content = opened.content(entry)
        found = opened.calibration(entry)
        where = opened.where
    if out is not None:
        with write_atomically(out) as temporary:
            temporary.write_bytes(content)
        note(f"written: {out}")
    if as_json:
        typer.echo(json.dumps(entry.to_dict() | {"calibration": json.loads(content.decode("utf-8-sig"))}))
    else:
        typer.echo("\n".join([*registry_text.shown_text(entry, where), found.summary()]), nl=False)


@registry_app.command(epilog="Example: `sagnac registry find --at 2025-12-31 --registry fleet.db`")
def find(
    at: Annotated[
        str, typer.Option("--at", help="Date or moment; a bare date is the end of that day in UTC.", metavar="DATE")
    ],
    model: Model = None,
    serial: Serial = None,
    registry: RegistryAt = None,
    as_json: options.Json = False,
) -> None:
    """Find the calibration in force at a date: the latest that was made until then, of each unit or of one."""
    from ..errors import DataError
    from ..registry import open_registry
    from ..registry.dates import parse

    moment = parse(at, "--at", end=True)
    with open_registry(registry) as opened:
        if serial is not None:
            unit = opened.unit(serial, model)
            model = unit.model
        found = opened.find(moment, model=model, serial=serial)
        where = opened.where
    if not found:
        whose = f"unit with serial number {serial!r}" if serial is not None else "unit"
        raise DataError(f"{where}: no {whose} had a calibration yet at {registry_text.moment(moment)} UTC")
    typer.echo(
        json.dumps({"registry": str(where), "at": moment.isoformat(), "calibrations": [e.to_dict() for e in found]})
        if as_json
        else "\n".join(registry_text.entries_text(found))
    )


@registry_app.command(
    epilog="Example: `sagnac registry limits 'accel.bias.*=±1 mg' 'gyro.bias.z=-0.5 deg/h..1 deg/h' --model LG-1 "
    "--registry fleet.db`, from a file as of certificates `sagnac registry limits limits.toml --model LG-1 --registry fleet.db`, "
    "and to see those in force `sagnac registry limits --registry fleet.db`"
)
def limits(
    given: Annotated[
        list[str] | None,
        typer.Argument(
            help="Limits to set: a .toml file, or parameter=limit: ±1 mg, -1 mg..2 mg, ..2 mg, none.",
            metavar="[LIMIT...]",
        ),
    ] = None,
    model: Model = None,
    serial: Annotated[str, typer.Option(help="Only for this unit of the model.", metavar="TEXT")] = "",
    start: Annotated[
        str | None, typer.Option("--from", help="Date from which on they are in force; default: now.", metavar="DATE")
    ] = None,
    rule: Annotated[
        Decision | None, typer.Option(help="How limits given here are decided, default guarded; a file says it itself.")
    ] = None,
    specification: Annotated[str, typer.Option(help="Where limits given here are from.", metavar="TEXT")] = "",
    at: Annotated[
        str | None, typer.Option("--at", help="Show those in force at this date; default: now.", metavar="DATE")
    ] = None,
    registry: RegistryAt = None,
    as_json: options.Json = False,
) -> None:
    """Set limits on parameters, for a model or one unit, or show those in force."""
    from ..registry import open_registry
    from ..registry.dates import parse
    from .terminal import note

    _check_limit_options(bool(given), at, start, rule, specification)
    if not given:
        with open_registry(registry) as opened:
            moment = None if at is None else parse(at, "--at", end=True)
            unit = opened.unit(serial, model) if serial else None
            found = opened.limits(unit, model=model, at=moment)
            where = opened.where
    else:
        if model is None:
            raise InputError("--model: say which model the limits are for (and --serial, if for one unit of it)")
        parsed = _limits(given, rule, specification)
        begin = None if start is None else parse(start, "--from")
        with open_registry(registry, write=True) as opened:
            found, remarks = opened.set_limits(parsed, model=model, serial=serial, valid_from=begin)
            where = opened.where
        for text in remarks:
            note(f"note: {text}")
    if as_json:
        typer.echo(json.dumps({"registry": str(where), "limits": [b.to_dict() for b in found]}))
    else:
        typer.echo("\n".join(registry_text.bounds_text(found)) if found else f"no limits in {where}")


def _check_limit_options(
    setting: bool, at: str | None, start: str | None, rule: Decision | None, specification: str
) -> None:
    """Refuse options that would say nothing."""
    idle = {"--at": at} if setting else {"--from": start, "--rule": rule, "--specification": specification}
    useless = [name for name, value in idle.items() if value]
    if useless:
        why = "limits are set, not shown" if setting else "no limits are given"
        raise InputError(f"{', '.join(useless)}: has no meaning here, {why}")


def _limits(given: list[str], rule: Decision | None, specification: str) -> Limits:
    """Limits from a file, or from texts."""
    from ..limits import Limits, load
    from ..registry.bounds import read_setting

    if len(given) == 1 and given[0].lower().endswith(".toml"):
        if specification or rule is not None:
            raise InputError(f"{given[0]}: says rule and specification itself; leave --rule and --specification out")
        return load(given[0])
    table = dict[str, object]()
    for text in given:
        key, value = read_setting(text)
        if key in table:
            raise InputError(f"{text!r}: {key} is given twice")
        table[key] = value
    return Limits(
        table, "simple acceptance" if rule is Decision.simple else "guarded acceptance", specification, "limits"
    )


@registry_app.command(epilog="Example: `sagnac registry upgrade --registry fleet.db`")
def upgrade(registry: RegistryAt = None, as_json: options.Json = False) -> None:
    """Bring a registry of an earlier version up to this one; earlier versions cannot read it then."""
    from ..registry import upgrade as run
    from ..registry.address import address

    before, after = run(registry)
    where = address(registry)
    if as_json:
        typer.echo(json.dumps({"registry": str(where), "before": before, "after": after}))
    else:
        typer.echo(
            f"{where}: " + (f"tables are at {after}" if before == after else f"brought from {before} to {after}")
        )
