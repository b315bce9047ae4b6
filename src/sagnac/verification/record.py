"""What a verification says: single comparisons and the verdict on all of them."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from ..printed import printed, probability

PASS = 0.01
"""Probability below which the misfits are more than the stated uncertainty allows."""


@dataclass(frozen=True)
class Check:
    """One comparison with what is known: residual and its standard uncertainty, SI."""

    segment: str
    what: str
    residual: float
    standard_uncertainty: float
    unit: str

    @property
    def z(self) -> float:
        """Residual in standard uncertainties."""
        return self.residual / self.standard_uncertainty if self.standard_uncertainty > 0 else math.inf


@dataclass(frozen=True)
class Verification:
    """Outcome of :func:`verify`.

    Attributes
    ----------
    checks : tuple of Check
    chi2, p_value : float
    degrees_of_freedom : int
    passed : bool
    rotation_rms : float or None
        Closure of the rotations of a hand-turned log, rad.
    remarks : tuple of str
    """

    checks: tuple[Check, ...]
    chi2: float
    degrees_of_freedom: int
    p_value: float
    passed: bool
    rotation_rms: float | None = None
    remarks: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain table for JSON."""
        return asdict(self)

    def summary(self) -> str:
        """The outcome as a page of text."""
        lines = [f"  {'segment':<12}{'quantity':<14} {'residual':>12}  {'std. unc.':>10}  {'unit':<8}{'ratio':>6}"]
        for c in self.checks:
            value, sigma, unit = printed(c.residual, c.standard_uncertainty, c.unit)
            lines.append(
                f"  {c.segment:<12}{c.what:<14} {value:>12}  {sigma:>10}  {unit:<8}{round(c.z, 1) + 0.0:>6.1f}"
            )
        for kind in dict.fromkeys(c.what for c in self.checks):
            here = [c for c in self.checks if c.what == kind]
            if len(here) == 1:
                continue
            rms = math.sqrt(sum(c.residual**2 for c in here) / len(here))
            text, _, unit = printed(rms, rms / 30, here[0].unit)
            lines.append(f"  {kind}: {text} {unit} rms over {len(here)}")
        if self.rotation_rms is not None:
            lines.append(f"  rotation closure: {math.degrees(self.rotation_rms):.3g} deg rms")
        verdict = "PASS" if self.passed else "FAIL"
        if self.rotation_rms is not None and not self.passed and self.p_value >= PASS:
            lines.append("  the norms agree; the rotations do not close as well as those of the fit did")
        lines.append(
            f"  {verdict}: chi-square {self.chi2:.4g} for {self.degrees_of_freedom}, probability {probability(self.p_value)} "
            f"(limit {PASS:g})"
        )
        return "\n".join([*lines, *(f"  note: {r}" for r in self.remarks)]) + "\n"
