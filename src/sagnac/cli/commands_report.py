"""``sagnac report``: the certificate of a calibration, or the page of an alignment."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from . import options
from .opening import Opening, reads_recording

if TYPE_CHECKING:
    from ..calibration import Calibration
    from ..plan import Plan
    from ..recording import Recording
    from ..report.certificate.evidence import Opener

REPORT_EXAMPLE = (
    "Example: `sagnac report cal.json --out certificate.html --out certificate.pdf`, with what a laboratory adds: "
    "`sagnac report cal.json --details details.toml --limits limits.toml --check check.csv --check-plan check.toml "
    "--earlier last-year.json --out certificate.html`, or of an alignment: `sagnac report alignment.json --out alignment.html`"
)


@reads_recording
def report(
    result: Annotated[Path, typer.Argument(help="Calibration or alignment file (JSON).", metavar="RESULT.JSON")],
    out: Annotated[list[Path], typer.Option("--out", help="File to write, .html or .pdf; may be given twice.")],
    recording: Annotated[
        Path | None, typer.Option(help="Recording of the calibration; default: the one that it names, if found.")
    ] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Plan of the calibration (TOML); default: the one that it names, if found.")
    ] = None,
    check: Annotated[Path | None, typer.Option(help="Recording that the fit has not seen, to verify on.")] = None,
    check_plan: Annotated[Path | None, typer.Option(help="Plan of that recording (TOML).")] = None,
    earlier: Annotated[
        Path | None, typer.Option(help="Earlier calibration of the same unit (JSON): as found, as left.")
    ] = None,
    limits: Annotated[Path | None, typer.Option(help="Limits on parameters and the decision rule (TOML).")] = None,
    details: Annotated[
        Path | None, typer.Option(help="Number, laboratory, customer, dates, standards, environment (TOML).")
    ] = None,
    k: Annotated[float, typer.Option("-k", help="Coverage factor.")] = 2.0,
    as_json: options.Json = False,
    *,
    opening: Opening,
) -> None:
    """Write the certificate of a calibration, or the page of an alignment, as HTML or PDF."""
    from ..report.certificate import check_output, write

    for path in out:
        check_output(path)
    inputs = (result, recording, plan, check, check_plan, earlier, limits, details)
    options.keep_inputs(*(("--out", path) for path in out), inputs=inputs)
    if _is_alignment(result):
        foreign = {
            "--recording": recording,
            "--plan": plan,
            "--check": check,
            "--check-plan": check_plan,
            "--earlier": earlier,
            "--limits": limits,
            "--details": details,
        }
        given = [name for name, value in foreign.items() if value is not None]
        if given:
            raise InputError(f"{result}: of an alignment, which takes no {', '.join(given)}")
        from ..report.alignment_page import page

        document = page(result)
    else:
        from ..report.certificate import certificate, gather, load_details, load_limits

        given_details = None if details is None else load_details(details)
        bounds = None if limits is None else load_limits(limits)
        evidence = gather(
            result,
            recording=recording,
            plan=plan,
            check=check,
            check_plan=check_plan,
            earlier=earlier,
            opener=_opener(opening),
        )
        document = certificate(evidence, given_details, bounds, k=k)
    for path in out:
        write(document, path)
    written = [str(path) for path in out]
    typer.echo(json.dumps({"out": written}) if as_json else "\n".join(written))


def check_certificates(pages: Sequence[Path], calibration: Path | None) -> None:
    """Refuse certificates that could not be written, before any work is done."""
    from ..report.certificate import check_output

    for page in pages:
        check_output(page, "--certificate")
    if pages and calibration is None:
        raise InputError("--certificate: give the calibration's file too (--out); the certificate is of that file")


def certify(calibration: Path, pages: Sequence[Path], *, recording: Path, plan: Path | None, opening: Opening) -> None:
    """Write the certificate of a calibration that has just been made."""
    from ..report.certificate import certificate, gather, write

    document = certificate(gather(calibration, recording=recording, plan=plan, opener=_opener(opening)))
    for page in pages:
        write(document, page)


def _opener(opening: Opening) -> Opener:
    from .terminal import announce_compilation

    def opened(path: Path, plan: Plan | None, calibration: Calibration) -> Recording:
        announce_compilation(calibration.method)
        return opening.open(path, plan=plan, calibration=calibration)

    return opened


def _is_alignment(path: Path) -> bool:
    """Whether the file says that it is an alignment; files that say nothing are refused where calibrations are read."""
    try:
        table = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(table, dict) and str(table.get("schema", "")).startswith("sagnac/alignment/")
