"""Where the arm points and how fast it turns: as planned, or unknown in one of three ways.

Segments whose arm phase nobody recorded have their angle at mid time from unknowns q, in which it is linear:

1. The arm turns on through all segments of one planned rate: one phase and one rate for each planned rate.
2. The arm passes the same angle at the start of every segment (a trigger): one phase, one rate for each planned rate.
3. Every segment has its own phase and rate.

The plan may say which of the first two it is (``rig.arm_continuous``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...estimate import Parameter
from ...frames import Array
from ...plan import Plan, Segment
from .model import Turning

_PHASE_SCALE, _RATE_SCALE = 0.01, 0.01
_FAR = 5.0  # stated uncertainties up to which the samples set a start value
_LOST = 0.5  # rad: beyond this standard deviation the turns between two segments cannot be counted


@dataclass(frozen=True)
class Seen:
    """What the samples say of the arm in each segment.

    Attributes
    ----------
    mid_time : ndarray, shape (n,), s
    known : ndarray of bool, shape (n,)
        Whether the angle is known from the plan or an arm column.
    angle, angle_sigma : ndarray, shape (n,), rad
        At mid time; from the data where it is not known, infinitely uncertain where they do not tell.
    rate, rate_sigma : ndarray, shape (n,), rad/s
        Found in the samples, or the planned one where the angle is known.
    stated : ndarray, shape (n,), rad/s
        What the plan says of the rate, as far as its uncertainty is that of the plan; zero where an arm column tells.
    measured : ndarray, shape (n,), rad/s
        Rate found in the samples, of the uncertainty `rate_sigma`; of use where that is finite.
    shown, shown_sigma : ndarray, shape (n,), rad
        Angle at mid time that the samples show, whether it is known or not; infinitely uncertain where they do not tell.
    """

    mid_time: Array
    known: NDArray[np.bool_]
    angle: Array
    angle_sigma: Array
    rate: Array
    rate_sigma: Array
    stated: Array
    measured: Array
    shown: Array
    shown_sigma: Array


class Hypothesis(NamedTuple):
    """One way in which the arm may have turned, and its unknowns with start values from the data: one set, or several to try.

    A loose one has unknowns for every segment: worth trying only where no other fits.
    """

    words: str
    turnings: Callable[[], list[Turning]]
    loose: bool = False


def as_planned(seen: Seen, segments: Sequence[Segment], plan: Plan) -> Turning:
    """Angle and rate known, but for the uncertainties that the plan states.

    Parameters
    ----------
    seen : Seen
    segments : sequence of Segment
    plan : Plan
        ``rig.rate_uncertainty`` (of rates from the plan) and ``rig.phase_uncertainty``.
    """
    n = len(segments)
    turning = Turning((), seen.angle.copy(), seen.rate.copy(), np.zeros((n, 0)), np.zeros((n, 0)))
    if plan.rig.rate_uncertainty > 0:
        since = seen.mid_time - np.array([s.start for s in segments])
        first = rate_error(seen, plan)
        error = Parameter("rig.rate_error", "1", first, 0.01, prior_sigma=plan.rig.rate_uncertainty, nuisance=True)
        turning = _with(turning, error, seen.stated * since * seen.known, seen.stated)
    if plan.rig.phase_uncertainty > 0 and seen.known.any():
        first = phase_error(seen, plan, turning)
        offset = Parameter(
            "rig.phase_error", "rad", first, _PHASE_SCALE, prior_sigma=plan.rig.phase_uncertainty, nuisance=True
        )
        turning = _with(turning, offset, seen.known.astype(float), np.zeros(n))
    return turning


def rate_error(seen: Seen, plan: Plan) -> float:
    """Relative error of the plan's rates that the samples show, as far as the plan allows for one.

    Parameters
    ----------
    seen : Seen
    plan : Plan
        ``rig.rate_uncertainty``, five of which are the limit.
    """
    at = np.isfinite(seen.rate_sigma) & (seen.stated != 0)
    if not at.any():
        return 0.0
    relative = seen.measured[at] / seen.stated[at] - 1.0
    weight = (seen.stated[at] / np.maximum(seen.rate_sigma[at], 1e-300)) ** 2
    limit = _FAR * plan.rig.rate_uncertainty
    return float(np.clip(np.average(relative, weights=weight / weight.max()), -limit, limit))


def phase_error(seen: Seen, plan: Plan, turning: Turning) -> float:
    """Error common to the plan's phases that the samples show, as far as the plan allows for one.

    Parameters
    ----------
    seen : Seen
    plan : Plan
        ``rig.phase_uncertainty``, five of which are the limit.
    turning : Turning
        Angles as known, with the start values of its unknowns.
    """
    at = seen.known & np.isfinite(seen.shown_sigma)
    if not at.any():
        return 0.0
    told = turning.angle + turning.to_angle @ np.array([p.start for p in turning.parameters])
    weight = (seen.shown_sigma[at].min() / seen.shown_sigma[at]) ** 2
    limit = _FAR * plan.rig.phase_uncertainty
    return float(np.clip(np.angle(weight @ np.exp(1j * (seen.shown - told)[at])), -limit, limit))


def _with(turning: Turning, parameter: Parameter, to_angle: Array, to_rate: Array) -> Turning:
    """One more unknown."""
    return replace(
        turning,
        parameters=(*turning.parameters, parameter),
        to_angle=np.column_stack([turning.to_angle, to_angle]),
        to_rate=np.column_stack([turning.to_rate, to_rate]),
    )


def freed(turning: Turning, what: str, seen: Seen, segments: Sequence[Segment]) -> Turning:
    """The same with the phase or the rate of the plan in doubt, to see whether that explains the data.

    Parameters
    ----------
    turning : Turning
    what : str
        ``phase`` or ``rate``.
    seen : Seen
    segments : sequence of Segment
    """
    planned = np.array([s.arm_rate for s in segments])
    if what == "phase":
        return _with(
            turning, Parameter("rig.phase_error", "rad", 0.0, _PHASE_SCALE), np.ones(len(planned)), 0.0 * planned
        )
    since = seen.mid_time - np.array([s.start for s in segments])
    return _with(turning, Parameter("rig.rate_error", "1", 0.0, 0.01), planned * since, planned)


def hypotheses(seen: Seen, segments: Sequence[Segment], plan: Plan) -> list[Hypothesis]:
    """The three ways in their order, or the one that the plan says it was.

    Parameters
    ----------
    seen : Seen
    segments : sequence of Segment
    plan : Plan

    Raises
    ------
    DataError
        When no segment shows the arm's angle; asking for the turning of the first one when the turns between segments cannot be
        counted.
    """
    turns = np.array([s.arm_rate != 0 for s in segments])
    if not np.isfinite(seen.angle_sigma[turns & ~seen.known]).any():
        raise DataError(
            "no segment shows where the arm was: in none of them does an accelerometer lie near the arm's plane. Give "
            "arm_phase, or record the arm's angle"
        )
    start = as_planned(seen, segments, plan)
    steady = Hypothesis(
        "the arm turned on steadily through all segments of one rate", lambda: [_steady(start, seen, segments)]
    )
    triggered = Hypothesis(
        "the arm had one and the same angle at the start of every segment", lambda: [_triggered(start, seen, segments)]
    )
    if plan.rig.arm_continuous is not None:
        return [steady if plan.rig.arm_continuous else triggered]
    own = "the arm had a phase and a rate of its own in every segment"
    return [steady, triggered, Hypothesis(own, lambda: _own(start, seen, segments), loose=True)]


def _by_rate(seen: Seen, segments: Sequence[Segment]) -> Iterator[tuple[str, NDArray[np.intp]]]:
    """Name and segments of each planned rate whose phase is unknown; the name is empty where there is one rate only."""
    rates = np.array([s.arm_rate for s in segments])
    open_ones = np.flatnonzero(~seen.known & (rates != 0))
    distinct = list(dict.fromkeys(rates[open_ones].tolist()))
    for rate in distinct:
        at = open_ones[rates[open_ones] == rate]
        at = at[np.argsort([segments[i].start for i in at])]
        yield ("" if len(distinct) == 1 else f".{segments[int(at[0])].name}"), at


def _mean_rate(seen: Seen, at: NDArray[np.intp]) -> tuple[float, float]:
    """Weighted mean of the rates found, and its standard deviation."""
    weight = 1.0 / np.maximum(seen.rate_sigma[at], 1e-300) ** 2
    if not weight.any():
        return float(seen.rate[at].mean()), np.inf
    return float(weight @ seen.rate[at] / weight.sum()), float(1.0 / np.sqrt(weight.sum()))


def _emptied(turning: Turning, at: NDArray[np.intp]) -> Turning:
    """Without the angle and rate that were known beforehand of some segments."""
    angle, rate, to_angle, to_rate = (
        v.copy() for v in (turning.angle, turning.rate, turning.to_angle, turning.to_rate)
    )
    for v in (angle, rate, to_angle, to_rate):
        v[at] = 0.0
    return Turning(turning.parameters, angle, rate, to_angle, to_rate)


def _column(n: int, at: NDArray[np.intp], values: Array | float) -> Array:
    out = np.zeros(n)
    out[at] = values
    return out


def _freed_rates(turning: Turning, seen: Seen, segments: Sequence[Segment]) -> Turning:
    """A rate for each planned rate, that moves the angle from the start of each segment on."""
    n = len(segments)
    for suffix, at in _by_rate(seen, segments):
        rate, _ = _mean_rate(seen, at)
        turning = _with(
            turning,
            Parameter(f"rig.arm_rate{suffix}", "rad/s", rate, _RATE_SCALE * abs(rate)),
            _column(n, at, _since_start(seen, segments)[at]),
            _column(n, at, 1.0),
        )
    return turning


def _steady(turning: Turning, seen: Seen, segments: Sequence[Segment]) -> Turning:
    n = len(segments)
    for suffix, at in _by_rate(seen, segments):
        since = seen.mid_time[at] - segments[int(at[0])].start
        phase, rate = _counted(since, at, seen)
        turning = _with(
            _emptied(turning, at),
            Parameter(f"rig.arm_phase{suffix}", "rad", phase, _PHASE_SCALE),
            _column(n, at, 1.0),
            np.zeros(n),
        )
        turning = _with(
            turning,
            Parameter(f"rig.arm_rate{suffix}", "rad/s", rate, _RATE_SCALE * abs(rate)),
            _column(n, at, since),
            _column(n, at, 1.0),
        )
    return turning


def _triggered(turning: Turning, seen: Seen, segments: Sequence[Segment]) -> Turning:
    at = np.concatenate([at for _, at in _by_rate(seen, segments)])
    turning = _freed_rates(_emptied(turning, at), seen, segments)
    weight = 1.0 / np.maximum(seen.angle_sigma[at], 1e-12) ** 2
    angles = _at_start(seen, segments, turning)[at]
    phase = float(np.angle(weight @ np.exp(1j * angles)))
    common = Parameter("rig.arm_phase", "rad", phase, _PHASE_SCALE)
    return _with(turning, common, _column(len(segments), at, 1.0), np.zeros(len(segments)))


def _own(turning: Turning, seen: Seen, segments: Sequence[Segment]) -> list[Turning]:
    """With the angles that the data do not show near that of the others, or a quarter, half, three quarters of a turn away."""
    at = np.concatenate([at for _, at in _by_rate(seen, segments)])
    common = _triggered(turning, seen, segments)
    shown = _at_start(seen, segments, _freed_rates(_emptied(turning, at), seen, segments))
    hidden = ~np.isfinite(seen.angle_sigma)
    out = []
    for quarter in range(4 if hidden[at].any() else 1):
        angles = np.where(hidden, common.parameters[-1].start + quarter * np.pi / 2.0, shown)
        out.append(_each(turning, at, angles, seen, segments))
    return out


def _each(turning: Turning, at: NDArray[np.intp], angles: Array, seen: Seen, segments: Sequence[Segment]) -> Turning:
    since, n = _since_start(seen, segments), len(segments)
    turning = _emptied(turning, at)
    for i in at.tolist():
        told = float(seen.rate[i])
        name, here = segments[i].name, np.arange(n) == i
        phase = Parameter(f"rig.arm_phase.{name}", "rad", float(angles[i]), _PHASE_SCALE)
        turning = _with(turning, phase, here.astype(float), np.zeros(n))
        rate = Parameter(f"rig.arm_rate.{name}", "rad/s", told, _RATE_SCALE * abs(told))
        turning = _with(turning, rate, here * since, here.astype(float))
    return turning


def _since_start(seen: Seen, segments: Sequence[Segment]) -> Array:
    return np.asarray(seen.mid_time - np.array([s.start for s in segments]))


def _at_start(seen: Seen, segments: Sequence[Segment], turning: Turning) -> Array:
    """Angles found, taken back to the start of each segment with the rates of a turning; zero where none was found."""
    q = np.array([p.start for p in turning.parameters])
    told = np.where(np.isfinite(seen.angle_sigma), seen.angle, 0.0)
    return np.asarray(told - (turning.rate + turning.to_rate @ q) * _since_start(seen, segments))


def _counted(since: Array, at: NDArray[np.intp], seen: Seen) -> tuple[float, float]:
    """Phase at time zero and rate, from angles known up to whole turns: the turns are counted from one to the next."""
    rate = _mean_rate(seen, at)
    sigma, angle = seen.angle_sigma[at], seen.angle[at].copy()
    tells = np.flatnonzero(np.isfinite(sigma))
    if not tells.size:
        return 0.0, rate[0]
    best = int(tells[np.argmin(sigma[tells])])
    order = tells[np.argsort(np.abs(since[tells] - since[best]))]
    for k in range(1, order.size):
        away = since[order[k]]
        (expected, _), spread = _line(since[order[:k]] - away, angle[order[:k]], sigma[order[:k]], rate)
        if spread > _LOST:
            raise DataError("the turns between segments cannot be counted")
        angle[order[k]] = expected + float(np.angle(np.exp(1j * (angle[order[k]] - expected))))
    (phase, slope), _ = _line(since[order], angle[order], sigma[order], rate)
    return float(np.angle(np.exp(1j * phase))), slope


def _line(time: Array, angle: Array, sigma: Array, rate: tuple[float, float]) -> tuple[tuple[float, float], float]:
    """Straight line through angles with a prior of its slope: value at time zero, slope, and how sure the value is."""
    weight = 1.0 / np.maximum(sigma, 1e-12)
    slope_weight = 1.0 / min(max(rate[1], 1e-300), 1e12)
    design = np.vstack([np.column_stack([np.ones_like(time), time]) * weight[:, None], [0.0, slope_weight]])
    inverse = np.linalg.pinv(design)
    value, slope = inverse @ np.append(angle * weight, rate[0] * slope_weight)
    return (float(value), float(slope)), float(np.linalg.norm(inverse[0]))
