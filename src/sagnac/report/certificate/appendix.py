"""What a machine reads: software, hashes, the whole covariance, the calibration itself."""

from __future__ import annotations

import hashlib
import math
from pathlib import PurePath

from ... import __version__
from ..document import Attachment, Block, Facts, Grid, Section, Text
from ..parts import correlation_grids
from ..shown import or_not_stated
from .context import Context
from .evidence import AS_GIVEN, Evidence


def digest(evidence: Evidence) -> str:
    """SHA-256 of the calibration's file."""
    return hashlib.sha256(evidence.data).hexdigest()


def attachments(evidence: Evidence) -> tuple[Attachment, ...]:
    """The calibration's file as it was read."""
    return (Attachment(evidence.name, "application/json", evidence.data, "the calibration"),)


def data(context: Context) -> Section:
    """Software and hashes of everything that went in."""
    evidence, calibration = context.evidence, context.calibration
    software = calibration.software
    facts = Facts(
        (
            ("Evaluated with", f"{software.name} {software.version}"),
            ("Certificate made with", f"sagnac {__version__}"),
            ("Calibration file", f"{evidence.name} ({calibration.schema_id})"),
            ("SHA-256 of it", digest(evidence)),
        )
    )
    rows = [
        (s.role, PurePath(s.file.replace("\\", "/")).name, or_not_stated(s.sha256 or "")) for s in calibration.source
    ]
    blocks: list[Block] = [facts]
    if rows:
        blocks.append(
            Grid(("made from", "file", "SHA-256"), tuple(rows), "lll", "Files that the calibration was made from")
        )
    own = {s.sha256 for s in calibration.source}
    more = tuple(f for f in evidence.files if f[2] not in own)
    if more:
        blocks.append(
            Grid(("used as", "file", "SHA-256"), more, "lll", "Further files that this certificate was made from")
        )
    if any(role.endswith(AS_GIVEN) for role, _, _ in more):
        blocks.append(
            Text("As given: the calibration holds no SHA-256 of this file, so that it could not be compared.", "note")
        )
    blocks.append(
        Text(
            f"The file {evidence.name} is attached to this certificate, byte for byte. It is the result in full "
            "precision.",
            "note",
        )
    )
    return Section("Software and data", tuple(blocks))


def matrix(context: Context) -> Section:
    """Correlations of all parameters; with the standard uncertainties they are the covariance."""
    calibration = context.calibration
    words = (
        "Correlation coefficients times 100; the covariance of two parameters is their coefficient times both standard "
        "uncertainties u. Columns have the numbers of the rows. The attached file holds the covariance in full precision, in SI."
    )
    grids = correlation_grids(calibration.parameters, calibration.covariance)
    return Section("Appendix: correlation matrix", (Text(words), *grids, _standard(context)))


def _standard(context: Context) -> Grid:
    """Values and standard uncertainties in SI, with digits to compute with."""
    rows = tuple(
        (
            str(i + 1),
            p.name,
            f"{p.value:.9g}".replace("-", "−"),
            f"{p.standard_uncertainty:.4g}".replace("-", "−"),
            p.unit,
        )
        for i, p in enumerate(context.calibration.parameters)
        if math.isfinite(p.value)
    )
    return Grid(
        ("", "parameter", "value", "u", "SI unit"),
        rows,
        "rlrrl",
        "Values and standard uncertainties in SI or counts",
        dense=True,
    )
