"""Two calibrations: what has changed, in units of the uncertainties of both together, one by one and altogether.

The joint covariance of the differences is C = C_1 + C_2, as of independent calibrations; altogether, chi^2 = d^T C^-1 d over
the parameters of the unit that both have (GUM supplement 2, JCGM 102:2011). Errors that both calibrations share are named, for
they are counted twice in C, or hide a change.

Where an uncertainty was scaled by the residuals of a fit, it is no surer than their degrees of freedom. Probabilities are then
those of Student's distribution with the effective degrees of freedom of Welch and Satterthwaite (JCGM 100:2008, G.4.1), and
altogether of Fisher's: chi^2 / p with p and f degrees of freedom, 1 / f = sum w_i^2 / f_i, where w_i is the share of
tr(C_i C^-1) / p that has an uncertainty of f_i degrees of freedom. For one common scale that is exact.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from .. import results
from .._version import __version__
from ..calibration import Calibration
from ..coverage import degrees_of_freedom
from ..frames import Array
from ..results import Record, Software
from .conventions import Alike, alike
from .series import of_the_unit

SCHEMA = "sagnac/comparison/1"
SCHEMA_FILE = Path(__file__).with_name("comparison-1.schema.json")
_NULL = 1e-10
"""Share of the largest principal variance, of scaled differences, below which one is no variance."""
_SURE = 1e-3
"""Standard uncertainties by which calibrations must differ in a direction without variance to be said to."""


class Side(Record):
    """One of the two calibrations."""

    source: str
    model: str
    serial: str
    method: str
    created: str


class Difference(Record):
    """One parameter in both; ``normalised`` is the difference over its standard uncertainty, None where that is zero.

    ``degrees_of_freedom`` are those of the standard uncertainty of the difference, None where it was known.
    ``converted`` says what was done to make it comparable. ``of_the_unit`` is false for parameters of a rig, which do not count
    altogether.
    """

    name: str
    unit: str
    before: float
    before_standard_uncertainty: float
    after: float
    after_standard_uncertainty: float
    difference: float
    standard_uncertainty: float = Field(ge=0)
    normalised: float | None
    degrees_of_freedom: float | None = None
    p_value: float | None
    converted: str = ""
    of_the_unit: bool = True


class LeftOut(Record):
    """A parameter that is not compared, and why."""

    name: str
    reason: str


class Together(Record):
    """All parameters of the unit together: chi-square of the differences, its degrees of freedom and probability.

    ``uncertainty_degrees_of_freedom`` are those of the uncertainties, None where they were known: the probability is that of
    Fisher's distribution, or of chi-square.
    """

    chi2: float
    degrees_of_freedom: int
    uncertainty_degrees_of_freedom: float | None = None
    p_value: float
    parameters: int


class Comparison(Record):
    """What has changed between two calibrations."""

    schema_id: Literal["sagnac/comparison/1"] = Field(default="sagnac/comparison/1", alias="schema")
    before: Side
    after: Side
    parameters: tuple[Difference, ...]
    together: Together | None
    left_out: tuple[LeftOut, ...] = ()
    remarks: tuple[str, ...] = ()
    software: Software
    created: str

    def to_json(self) -> str:
        """The file's text."""
        return results.to_json(self)

    def summary(self) -> str:
        """The comparison as a page of text."""
        from .told import comparison_text

        return comparison_text(self)


def compare(before: Calibration, after: Calibration, *, names: tuple[str, str] = ("first", "second")) -> Comparison:
    """What has changed from one calibration to another.

    Parameters
    ----------
    before, after : Calibration
    names : tuple of str
        Files or numbers that they are from.

    Returns
    -------
    Comparison

    Raises
    ------
    DataError
        When they have no parameter that can be compared.
    """
    from ..errors import DataError

    terms = alike(before, after)
    if not terms.common:
        why = "; ".join(f"{n}: {r}" for n, r in list(terms.left_out.items())[:3])
        raise DataError(f"{names[0]} and {names[1]} have no parameter that can be compared ({why})")
    common = list(terms.common)
    (x, cx), (y, cy) = terms.before.part(common), terms.after.part(common)
    dof = np.maximum([[degrees_of_freedom(c, name) for name in common] for c in (before, after)], 1.0)
    rows = tuple(
        _difference(name, terms, (x[i], y[i]), (cx[i, i], cy[i, i]), dof[:, i]) for i, name in enumerate(common)
    )
    remarks = _remarks(before, after, rows)
    own = [i for i, row in enumerate(rows) if row.of_the_unit]
    both, strange = _together(y[own] - x[own], np.array([c[np.ix_(own, own)] for c in (cx, cy)]), dof[:, own])
    if strange:
        remarks.append(
            "in some combination both calibrations are certain, and yet they differ: one of them has held parameters at values "
            "that the other has not"
        )
    return Comparison(
        schema="sagnac/comparison/1",
        before=_side(before, names[0]),
        after=_side(after, names[1]),
        parameters=rows,
        together=both,
        left_out=tuple(LeftOut(name=n, reason=r) for n, r in terms.left_out.items()),
        remarks=tuple(remarks),
        software=Software(version=__version__),
        created=results.now(),
    )


def _side(calibration: Calibration, name: str) -> Side:
    unit = calibration.unit
    return Side(
        source=name, model=unit.model, serial=unit.serial, method=calibration.method, created=calibration.created
    )


def _difference(
    name: str, terms: Alike, values: tuple[float, float], variances: tuple[float, float], dof: Array
) -> Difference:
    from scipy.special import stdtr

    variance = max(variances[0], 0.0) + max(variances[1], 0.0)
    sigma, change = float(np.sqrt(variance)), float(values[1] - values[0])
    over = change / sigma if sigma > 0 else None
    effective = _effective(np.maximum(variances, 0.0), dof)
    return Difference(
        name=name,
        unit=terms.after.units[name],
        before=float(values[0]),
        before_standard_uncertainty=float(np.sqrt(max(variances[0], 0.0))),
        after=float(values[1]),
        after_standard_uncertainty=float(np.sqrt(max(variances[1], 0.0))),
        difference=change,
        standard_uncertainty=sigma,
        normalised=over,
        degrees_of_freedom=effective if math.isfinite(effective) else None,
        p_value=None if over is None else 2 * float(stdtr(effective, -abs(over))),
        converted=terms.converted.get(name, ""),
        of_the_unit=of_the_unit(name),
    )


def _effective(shares: Array, dof: Array) -> float:
    """Degrees of freedom of a sum of variances that have their own (Welch and Satterthwaite); infinite where all are known."""
    if not np.any(estimated := np.isfinite(dof) & (shares > 0)):
        return math.inf
    return float(shares.sum() ** 2 / np.sum(shares[estimated] ** 2 / dof[estimated]))


def _together(difference: Array, covariances: Array, dof: Array) -> tuple[Together | None, bool]:
    """Chi-square over the directions that have a variance, and whether there is a difference in one that has none.

    Parameters
    ----------
    difference : ndarray, shape (k,)
    covariances : ndarray, shape (2, k, k)
        Of both sides.
    dof : ndarray, shape (2, k)
        Degrees of freedom of their uncertainties.
    """
    from scipy.special import chdtrc, fdtrc

    covariance = covariances.sum(axis=0)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = sigma > 0
    if not known.any():
        return None, False
    size = np.outer(sigma[known], sigma[known])
    variance, axes = np.linalg.eigh(covariance[np.ix_(known, known)] / size)
    along = axes.T @ (difference[known] / sigma[known])
    there = variance > _NULL * variance[-1]
    chi2, count = float(np.sum(along[there] ** 2 / variance[there])), int(there.sum())
    inverse = axes[:, there] / variance[there] @ axes[:, there].T
    shares = np.array([np.einsum("ij,ji->i", c[np.ix_(known, known)] / size, inverse) for c in covariances]) / count
    groups = np.unique(dof)
    each = np.array(
        [np.where(side == f, own, 0.0).sum() for side, own in zip(dof[:, known], shares, strict=True) for f in groups]
    )
    effective = _effective(each, np.tile(groups, 2))
    made = Together(
        chi2=chi2,
        degrees_of_freedom=count,
        uncertainty_degrees_of_freedom=effective if math.isfinite(effective) else None,
        p_value=float(fdtrc(count, effective, chi2 / count) if math.isfinite(effective) else chdtrc(count, chi2)),
        parameters=int(known.sum()),
    )
    return made, bool(np.any(np.abs(along[~there]) > _SURE))


def _remarks(before: Calibration, after: Calibration, rows: tuple[Difference, ...]) -> list[str]:
    out = []
    units = before.unit, after.unit
    serials = [u.serial.strip() for u in units]
    if not all(serials):
        out.append("that both are of one unit is not known: one or both name no serial number")
    elif (units[0].model, serials[0]) != (units[1].model, serials[1]):
        out.append(
            f"of different units: {units[0].model} {serials[0]} and {units[1].model} {serials[1]}".replace("  ", " ")
        )
    if before.method != after.method:
        out.append(
            f"made by different methods ({before.method}, {after.method}), which may define a parameter differently and have "
            "systematic errors of their own"
        )
    exact = [r.name for r in rows if r.normalised is None and r.difference != 0]
    if exact:
        out.append(f"stated as exact in both and yet different: {', '.join(exact)}")
    return [*out, *_sites(before, after), *_shared(before, after)]


def _sites(before: Calibration, after: Calibration) -> list[str]:
    one, other = before.site, after.site
    if one.gravity == other.gravity and one.latitude == other.latitude:
        return []
    gravity = f"{one.gravity:.6f} and {other.gravity:.6f} m/s^2"
    return [f"made at different sites, or with another gravity ({gravity}): an error of it shows in the accelerometers"]


def _shared(before: Calibration, after: Calibration) -> list[str]:
    """Errors that both calibrations have in common."""
    out = []
    if before.rig and before.rig == after.rig:
        out.append(
            "made on a rig described in the same words: errors that it makes alike in both cancel in the difference, which "
            "is then better known than it says, and a change of the rig shows as one of the unit"
        )
    if _hashes(before, "prior") & _hashes(after, "prior"):
        out.append("both rest on the same prior, which draws them together: a change may be larger than it looks")
    if _hashes(before, "recording") & _hashes(after, "recording"):
        out.append("made from the same recording: not independent, so that no joint uncertainty is right")
    return out


def _hashes(calibration: Calibration, role: str) -> set[str]:
    return {s.sha256 for s in calibration.source if s.role == role and s.sha256}


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above; published as :data:`SCHEMA_FILE`."""
    return results.json_schema(Comparison, SCHEMA)
