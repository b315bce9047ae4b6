"""The sections of a certificate in the order in which an engineer looks for them."""

from __future__ import annotations

from ...limits import Limits
from ..document import Document, Section
from . import appendix, budget, change, checks, conditions, identity, outcome
from .context import prepare
from .details import Details
from .evidence import Evidence


def certificate(
    evidence: Evidence, details: Details | None = None, limits: Limits | None = None, *, k: float = 2.0
) -> Document:
    """The certificate of a calibration.

    Parameters
    ----------
    evidence : Evidence
        See :func:`~sagnac.report.certificate.evidence.gather`, or for a calibration alone
        :func:`~sagnac.report.certificate.evidence.of`.
    details : Details, optional
        What no log knows; what is left out is shown as not stated.
    limits : Limits, optional
        Then the conformity of the parameters that have one is stated.
    k : float
        Coverage factor.

    Returns
    -------
    Document
        Its date is that of the details, or else that of the calibration: the same input gives the same document.

    Raises
    ------
    InputError
        When the limits do not fit the calibration, or `k` is of no use.
    """
    given = details or Details()
    context = prepare(evidence, given, limits, k)
    calibration = evidence.calibration
    sections: list[Section | None] = [
        identity.identification(context),
        identity.summary(context),
        conditions.rig(context),
        conditions.site(context),
        conditions.method(context),
        outcome.results(context),
        outcome.correlation(context),
        outcome.conformity(context),
        budget.budget(context),
        checks.residuals(context),
        checks.verification(context),
        change.as_found(context),
        change.since_earlier(context),
        identity.remarks(context),
        identity.traceability(context),
        identity.statements(context),
        appendix.data(context),
        appendix.matrix(context),
    ]
    unit = " ".join(t for t in (calibration.unit.model, calibration.unit.serial) if t.strip()) or "unit not named"
    sha = appendix.digest(evidence)
    return Document(
        title="Calibration certificate",
        subtitle=unit,
        number=given.number,
        created=given.issued or calibration.created,
        sections=tuple(s for s in sections if s is not None),
        attachments=appendix.attachments(evidence),
        foot=f"{given.laboratory.name + ' · ' if given.laboratory.name else ''}calibration data SHA-256 {sha[:16]}…",
    )
