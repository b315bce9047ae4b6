"""One axis of a noise test: the terms that explain its variances, what they leave unexplained, and its record.

Samples next to one another may not obey the terms: a filter in the sensor takes their noise away, and the rounding of pulses is
no noise where the sensor's own hardly moves it on. Where the terms do not explain all averaging times, the shortest are left
out, an octave at a time, until they do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from .. import units
from ..frames import Array
from ..results import covariance_rows
from .curves.allan import Variances
from .curves.confidence import intervals
from .curves.spectrum import Density
from .findings.disturbances import Disturbance
from .findings.lines import Line, lines_in
from .gather import Correction, Gathered, variances_of
from .identification.identify import Identified, Sought, deviations, seek
from .page import density_of, units_of
from .record import Axis, Curve, Limit, Spectrum, TermFit, TermValue, finite

Kind = Literal["allan", "modified", "hadamard"]

_SHOWN = {"accel": "ug", "gyro": "deg/h"}
_EXPLAINED = 1e-3  # probability from which a fit is good
_LEFT_OUT = 9  # octaves at most
_MORE = 2  # octaves over the first that are explained: chance hides what a filter still takes there
_FAST = 10.0  # shortest averaging times: a shorter correlation time is that of a filter
_KEPT = 6  # octaves at least
_BELOW = 0.1  # over the shortest averaging time: above it a filter or the rounding of pulses makes humps, none of
_CLEAR = 3.0  # times the density around, and
_ABOVE = 1.4  # times that of the terms
_POOR = 1e-9  # probability of a fit, and
_OFF = 0.3  # departure of the deviation from it, that the terms do not describe


@dataclass(frozen=True)
class Judged:
    """One axis.

    Attributes
    ----------
    found : Identified
        Its terms.
    basis : Variances
        That they come from, of all averaging times.
    shown : Variances
        Of the kind that was asked for.
    before : Identified or None
        Terms with the effect of temperature left in, where it was taken off.
    """

    found: Identified
    basis: Variances
    shown: Variances
    before: Identified | None

    @property
    def shortest(self) -> float:
        """Shortest averaging time that the terms explain, s."""
        return float(self.found.tau[0])

    @property
    def expected(self) -> Array:
        """Deviation of all terms together, of the kind and at the averaging times that are shown."""
        terms = {c.key: c.value for c in self.found.coefficients}
        parts = deviations(terms, self.shown.tau, self.found.interval, self.shown.kind)
        return np.asarray(np.sqrt(sum((d**2 for d in parts.values()), np.zeros(self.shown.tau.size))))


def shown_in(axis: str, reading: str) -> tuple[str, float]:
    """Unit that sizes on an axis are told in, and the factor to it.

    Parameters
    ----------
    axis : str
    reading : str
        Unit of its readings.
    """
    if reading == "count":
        return "count", 1.0
    unit = _SHOWN[axis.partition("_")[0]]
    return unit, units.convert(1.0, reading, unit)


def judge(found: Gathered, again: Gathered, k: int, kind: Kind, warm: Correction | None) -> Judged:
    """Variances and terms of one axis.

    Parameters
    ----------
    found, again : Gathered
        As recorded, and with the effect of temperature taken off.
    k : int
        Number of the axis.
    kind : str
    warm : Correction or None
    """
    basis = "hadamard" if kind == "hadamard" else "allan"
    correction = warm if warm is not None and warm.coefficient[k] != 0 else None
    own = again if correction is not None else found
    variances = variances_of(own, k, basis, correction)
    shown = variances if kind == basis else variances_of(own, k, kind, correction)
    before = explained(variances_of(found, k, basis)) if correction is not None else None
    return Judged(explained(variances), variances, shown, before)


def explained(variances: Variances) -> Identified:
    """Terms of one axis, the shortest averaging times left out as far as need be.

    Parameters
    ----------
    variances : Variances
    """
    first = seek(variances)
    if _good(first):
        return first.identified()
    most = min(_LEFT_OUT, int(np.log2(variances.factors[-1])) - _KEPT)
    tried: dict[int, Sought] = {}
    for left_out in range(1, most + 1):
        for octaves in (left_out, min(left_out + _MORE, most)):
            if octaves not in tried:
                rest = _from(variances, int(np.searchsorted(variances.factors, 2**octaves)))
                tried[octaves] = seek(rest, fastest=_FAST)
            found = tried[octaves]
            if not _good(found):
                break
        else:
            note = (
                f"averaging times below {found.tau[0]:.3g} s are left out: no sum of noise terms describes them, as where the "
                "sensor filters its samples, or counts pulses that its noise hardly moves on"
            )
            told = found.identified()
            return replace(told, notes=(*told.notes, note))
    return first.identified()


def _good(found: Sought) -> bool:
    """Whether noise explains the variances, and no correlation as short as that of a filter."""
    fast = 0.0 < found.markov_time < _FAST * found.tau[0]
    return not (found.p_value < _EXPLAINED or fast)


def _from(v: Variances, first: int) -> Variances:
    """Variances without the shortest averaging times."""
    return replace(
        v,
        factors=v.factors[first:],
        variance=v.variance[first:],
        count=v.count[first:],
        stretches=tuple((n, own[first:]) for n, own in v.stretches),
    )


def _lines(spectrum: Density, judged: Judged) -> list[Line]:
    terms = {c.key: c.value for c in judged.found.coefficients}
    expected = density_of(terms, spectrum.frequency, spectrum.interval)
    first = int(np.searchsorted(judged.basis.tau, judged.shortest * (1.0 - 1e-9)))
    if not np.all(expected > 0):
        return []
    found = lines_in(spectrum, expected, _from(judged.basis, first))
    if judged.shortest < 1.5 * judged.basis.interval:
        return found
    over = spectrum.density[:, 0] / expected
    return [n for n in found if n.high < _BELOW / judged.shortest or _clear(n, spectrum.frequency, over)]


def _clear(line: Line, frequency: Array, over: Array) -> bool:
    """Whether a line stands out over the noise of the terms too: the edge of a filter does so over what lies beyond it alone."""
    own = (frequency >= line.low) & (frequency <= line.high)
    return bool(over[own].max() > _ABOVE) and (line.narrow or line.ratio > _CLEAR)


def beyond(axis: str, judged: Judged, spectrum: Density | None, reading: str) -> list[Disturbance]:
    """What the fitted terms leave unexplained: lines of the spectrum, and deviations that no term describes.

    Parameters
    ----------
    axis : str
    judged : Judged
    spectrum : Density or None
    reading : str
        Unit of its readings.
    """
    unit, size = shown_in(axis, reading)
    lines = [] if spectrum is None else _lines(spectrum, judged)
    out = [line.told(axis, unit, size) for line in lines]
    fit, shown = judged.found, judged.shown
    if not fit.p_value < _POOR or any(d.spoils for d in out):
        return out
    lower, upper = (b[:, 0] for b in intervals(shown))
    expected = judged.expected
    outside = ((expected < lower) | (expected > upper)) & (shown.tau >= judged.shortest * (1.0 - 1e-9))
    off = np.where(outside, shown.deviation[:, 0] / expected - 1.0, 0.0)
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > _OFF:
        text = (
            f"no sum of noise terms describes {axis}: at {shown.tau[worst]:.3g} s its deviation is {1 + off[worst]:.2g} times "
            "that of the best one; look at the picture for vibration, sway or interference, and record on a still base"
        )
        out.append(Disturbance("misfit", axis, text, spoils=True, size=float(off[worst])))
    return out


def record_of(axis: str, mean: float, judged: Judged, reading: str, spectrum: Density | None) -> Axis:
    """The record of one axis.

    Parameters
    ----------
    axis : str
    mean : float
        Of its samples.
    judged : Judged
    reading : str
        Unit of its readings.
    spectrum : Density or None
    """
    fit, shown = judged.found, judged.shown
    lower, upper = intervals(shown)
    return Axis(
        name=axis,
        unit=reading,
        mean=mean,
        terms=tuple(
            TermValue(
                key=c.key,
                value=c.value,
                standard_uncertainty=c.standard_uncertainty,
                lower=c.lower,
                upper=c.upper if np.isfinite(c.upper) else None,
                unit=units_of(c.key, axis, reading)[0],
            )
            for c in fit.coefficients
        ),
        covariance=covariance_rows(np.asarray(fit.covariance)),
        absent=tuple(
            # correlated noise stands for a flicker floor as well as for itself: no limit of that beside it
            Limit(
                key=key,
                upper=None if not np.isfinite(limit) or (key == "instability" and fit.value("markov") > 0) else limit,
                unit=units_of(key, axis, reading)[0],
            )
            for key, limit in fit.limits.items()
        ),
        fit=TermFit(
            chi2=fit.chi2,
            degrees_of_freedom=fit.degrees_of_freedom,
            p_value=fit.p_value if np.isfinite(fit.p_value) else None,
            notes=tuple(fit.notes),
            shortest=judged.shortest,
        ),
        curve=Curve(
            tau=finite(shown.tau),
            deviation=finite(shown.deviation[:, 0]),
            lower=finite(lower[:, 0]),
            upper=finite(upper[:, 0]),
            fitted=finite(judged.expected),
        ),
        spectrum=None
        if spectrum is None
        else Spectrum(
            frequency=finite(spectrum.frequency),
            density=finite(spectrum.density[:, 0]),
            degrees_of_freedom=finite(spectrum.freedom),
        ),
    )
