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
    from ..report.document import Document

REPORT_EXAMPLE = (
    "Example: `sagnac report cal.json --out certificate.html --out certificate.pdf`, with what a laboratory adds: "
    "`sagnac report cal.json --details details.toml --limits limits.toml --check check.csv --check-plan check.toml "
    "--earlier last-year.json --as-found as-found.json --out certificate.html`, or of an alignment: "
    "`sagnac report alignment.json --out alignment.html`"
)


@reads_recording
def report(
    result: Annotated[
        Path,
        typer.Argument(help="Calibration or alignment file (JSON), or an alignment's folder.", metavar="RESULT.JSON"),
    ],
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
        Path | None, typer.Option(help="Calibration of the same unit of an earlier visit (JSON), to compare with.")
    ] = None,
    as_found: Annotated[
        Path | None,
        typer.Option(help="Calibration of this visit before the unit was adjusted (JSON): as found, as left."),
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
    from ..report.certificate import check_output
    from .terminal import note

    for path in out:
        check_output(path)
    result = _file_of(result)
    inputs = (result, recording, plan, check, check_plan, earlier, as_found, limits, details)
    options.keep_inputs(*(("--out", path) for path in out), inputs=inputs)
    if _is_alignment(result):
        foreign = {
            "--recording": recording,
            "--plan": plan,
            "--check": check,
            "--check-plan": check_plan,
            "--earlier": earlier,
            "--as-found": as_found,
            "--limits": limits,
            "--details": details,
        }
        given = [name for name, value in foreign.items() if value is not None]
        if given:
            raise InputError(f"{result}: of an alignment, which takes no {', '.join(given)}")
        from ..report.alignment_page import page

        document = page(result)
    else:
        from ..report.certificate import certificate, concerns, gather, hints, load_details, load_limits

        given_details = None if details is None else load_details(details)
        bounds = None if limits is None else load_limits(limits)
        evidence = gather(
            result,
            recording=recording,
            plan=plan,
            check=check,
            check_plan=check_plan,
            earlier=earlier,
            as_found=as_found,
            opener=_opener(opening),
        )
        document = certificate(evidence, given_details, bounds, k=k)
        for text in hints(evidence):
            note(f"note: {text}")
        for text in concerns(given_details, evidence.calibration) if given_details is not None else ():
            note(f"warning: {text}")
    _write(document, out)
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
    from ..report.certificate import certificate, gather

    _write(certificate(gather(calibration, recording=recording, plan=plan, opener=_opener(opening))), pages)


def _write(document: Document, pages: Sequence[Path]) -> None:
    from ..report.certificate import write
    from .terminal import note

    for page in pages:
        for text in write(document, page):
            note(f"warning: {page}: {text}")


def _opener(opening: Opening) -> Opener:
    from .terminal import announce_compilation

    def opened(path: Path, plan: Plan | None, calibration: Calibration) -> Recording:
        announce_compilation(calibration.method)
        return opening.open(path, plan=plan, calibration=calibration)

    return opened


def _file_of(result: Path) -> Path:
    """The file, or that of the alignment in a folder.

    Raises
    ------
    InputError
        For what holds no JSON, a recording, say. What JSON says something else is refused where calibrations are read.
    """
    file = result
    if result.is_dir():
        from ..align.record import RESULT

        file = result / RESULT
    try:
        json.loads(file.read_bytes())
    except OSError as cause:
        raise InputError(f"{file}: cannot be read: {cause.strerror}") from cause
    except (ValueError, RecursionError) as cause:
        raise InputError(f"{file}: is no calibration or alignment file (JSON)") from cause
    return file


def _is_alignment(path: Path) -> bool:
    """Whether the file says that it is an alignment."""
    table = json.loads(path.read_bytes())
    return isinstance(table, dict) and str(table.get("schema", "")).startswith("sagnac/alignment/")
