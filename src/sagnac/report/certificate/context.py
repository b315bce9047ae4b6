"""What all sections of a certificate are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...calibration import Calibration, Value
from ...coverage import Coverage, cover
from ...limits import Decision, Limits, assign, decide
from ..shown import Scale, scales_of
from .details import Details
from .evidence import Evidence


@dataclass(frozen=True)
class Context:
    """A calibration, what is known besides, and how its numbers are shown.

    Attributes
    ----------
    evidence : Evidence
    details : Details
    coverage : Coverage
    scales : mapping of str to Scale
        By parameter.
    limits : Limits or None
    decisions : mapping of str to Decision
        Of the parameters that have a limit.
    """

    evidence: Evidence
    details: Details
    coverage: Coverage
    scales: Mapping[str, Scale]
    limits: Limits | None
    decisions: Mapping[str, Decision]

    @property
    def calibration(self) -> Calibration:
        """The calibration that the certificate is of."""
        return self.evidence.calibration

    def expanded(self, parameter: Value) -> float:
        """Expanded uncertainty, SI."""
        return self.coverage.expanded(parameter)


def prepare(evidence: Evidence, details: Details, limits: Limits | None, k: float) -> Context:
    """Coverage factors, digits and decisions.

    Raises
    ------
    InputError
        For limits that do not fit the calibration, or a coverage factor of no use.
    """
    calibration = evidence.calibration
    coverage = cover(calibration, k)
    scales = scales_of(calibration.parameters, [coverage.expanded(p) for p in calibration.parameters])
    decisions = {
        name: decide(calibration[name], limit, coverage.expanded(calibration[name]), coverage.dof[name], limits.rule)
        for name, limit in (assign(limits, calibration) if limits is not None else {}).items()
        if limits is not None
    }
    return Context(evidence, details, coverage, scales, limits, decisions)
