"""Harmonics of segments in which the input comes round, as on a centrifuge: coefficients, covariance, noise, rate.

The sums against the harmonics of the angle are all that a fit of a periodic model needs of the samples. They are exact for
parts of turns and through gaps (the Gram matrix of the terms is kept with them), and one pass of the recording makes them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import DataError
from ..frames import Array
from ..plan import Plan, Segment
from ..recording import Recording
from .harmonic_pass import ArmLine, Looked, Pass, go_through, refuse_clipped
from .harmonic_sums import CLEAR, WORKERS, Even, Fit, HarmonicSums, Turn
from .rate import CAPTURE, Rate, estimate
from .samples import axis_names, gaps_inside, refuse_outside, refuse_saturated

HOPELESS = 1e10
"""Condition of the Gram matrix (terms of equal size) from which the terms cannot be told apart."""
_EXACT = 1e-16  # of the signal's power: what sums of squares cannot tell from zero
_LOUD = 6.0  # times the usual residual variance: a restless segment
_FEW = 4  # segments from which one can be called unusual


@dataclass(frozen=True)
class SegmentHarmonics:
    """Harmonics of n segments, in the order of the plan.

    Terms are ``1, cos th, sin th, cos 2 th, ... sin (order th)``, c = 1 + 2 order of them; in the extended form
    ``tau cos th, tau sin th, ... tau sin (order th)`` follow, tau = t - mid_time, c = 1 + 4 order. These carry a small error dw
    of the rate through to first order: ``exp(i h (w + dw) tau) = (1 + i h dw tau) exp(i h w tau)`` less ``(h dw tau)^2 / 2``
    of the harmonic, which stays in the residuals and, where it is not small, biases the other terms.

    Attributes
    ----------
    segments : tuple of Segment
    order : int
    axes : tuple of str
        ``accel_x``, ...: as recorded, in standard order.
    mid_time, interval, duration : ndarray, shape (n,), s
        Mean time of the samples, sample interval, and time that the samples stand for.
    count : ndarray of int, shape (n,)
    rate : ndarray, shape (n,), rad/s
        Rate of th; zero: a segment that does not turn, of which the constant is all there is (the other coefficients are zero,
        of infinite variance).
    phase : ndarray, shape (n,), rad
        th at mid_time; th(t) = phase + rate (t - mid_time). Where the plan gives no phase, th is 0 at the start of the segment.
    coefficient : ndarray, shape (n, axes, c), SI or counts (per s for the terms with tau)
        Least squares. Of sensors that count pulses over each sample interval, the input's: the mean over the interval is undone.
    unit_covariance : ndarray, shape (n, c, c)
        Of the coefficients, for samples of unit variance and no correlation: exact for parts of turns too. The variance of
        samples is ``density**2 / interval``.
    condition : ndarray, shape (n,)
        Of the Gram matrix of the terms, scaled to equal size: 1 for whole turns, large where an arc is short.
    density : ndarray, shape (axes,)
        Noise per sqrt(Hz): of the residuals of samples, or of their slow part where that is clearly more (see remarks); NaN
        where nothing tells.
    noise_degrees_of_freedom : float
        How well `density` is known.
    least_density : ndarray, shape (axes,), or None
        What the white noise is no less than where slow noise is taken out of `density`: of axes whose density is that of the
        slow part what there is from sample to sample (half the density where pulses are counted), of others the density.
    louder : dict of str to float
        Axes that are clearly noisier about the harmonics than from sample to sample, and how many times.
    residual_variance : ndarray, shape (n, axes)
        Of single samples.
    measured_rate, rate_sigma : ndarray, shape (n,), rad/s
        Rate found in the arm column or in the samples, with its standard uncertainty; NaN where none was looked for.
    arm_known : ndarray of bool, shape (n,)
        Where th is the arm column, sample by sample; rate and phase are those of a straight line through it.
    counts : frozenset of str
        Sensors read as raw counts.
    remarks : tuple of str
    span : tuple of float, s
        First and last sample time of the recording.
    """

    segments: tuple[Segment, ...]
    order: int
    axes: tuple[str, ...]
    mid_time: Array
    interval: Array
    duration: Array
    count: Array
    rate: Array
    phase: Array
    coefficient: Array
    unit_covariance: Array
    condition: Array
    density: Array
    noise_degrees_of_freedom: float
    residual_variance: Array
    measured_rate: Array
    rate_sigma: Array
    arm_known: NDArray[np.bool_]
    counts: frozenset[str] = frozenset()
    remarks: tuple[str, ...] = ()
    span: tuple[float, float] = (0.0, 0.0)
    least_density: Array | None = None
    louder: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Segment names."""
        return tuple(s.name for s in self.segments)

    @property
    def extended(self) -> bool:
        """Whether the coefficients include the terms with tau."""
        return bool(self.coefficient.shape[2] > 1 + 2 * self.order)


def segment_harmonics(
    recording: Recording,
    plan: Plan,
    *,
    order: int = 4,
    rate: Literal["known", "estimate"] = "known",
    extended: bool = False,
    capture: float = CAPTURE,
) -> SegmentHarmonics:
    """Harmonics of every segment of a plan.

    Parameters
    ----------
    recording : Recording
        Whole triads and single axes. A rig column ``arm`` is the angle of each sample.
    plan : Plan
        With the rate of each segment; its sign is the sense of the turn.
    order : int
        Highest harmonic.
    rate : str
        ``known``: as the plan says, in one pass. ``estimate``: found in the samples, starting from the plan's, in four passes or
        a few more; not for segments that do not turn, nor with an arm column.
    extended : bool
        With the terms that carry a small error of the rate, see :class:`SegmentHarmonics`.
    capture : float
        Relative error of the plan's rate up to which the true one is found.

    Returns
    -------
    SegmentHarmonics

    Raises
    ------
    DataError
        When a segment lies outside the data, holds too few samples or too short a part of a turn, an axis is dead or saturated,
        or a rate cannot be found.
    InputError
        When a sample cannot be read (see :meth:`Recording.batches`).
    """
    if not plan.segment:
        raise DataError("the plan has no [[segment]]; this method needs to know which samples belong to which rate")
    axes = axis_names(recording)
    run = _Run(recording, plan, axes, order)
    found = run.rates(capture) if rate == "estimate" and not run.column else {}
    turns = [replace(t, rate=found[i].rate) if i in found else t for i, t in enumerate(run.turns)]
    sums = [HarmonicSums(t, len(axes), order if t.rate else 0, extended=extended and t.rate != 0) for t in turns]
    run.go(dict(enumerate(sums)))
    # time stamps of counted pulses are half an interval later than what they stand for
    late = [0.5 * s.interval if recording.increments else 0.0 for s in run.seen]
    fits = [s.fit(seen.mid_time + d) for s, seen, d in zip(sums, run.seen, late, strict=True)]
    for seen, turn, fit in zip(run.seen, turns, fits, strict=True):
        _refuse_unfit(seen, turn, fit, order)
        refuse_clipped(recording.name, seen, fit, turn.rate, axes)
    return _gather(run, turns, fits, found, extended=extended)


class _Run:
    """The passes over one recording; the first of them looks at the samples and refuses what cannot be used."""

    def __init__(self, recording: Recording, plan: Plan, axes: tuple[str, ...], order: int) -> None:
        self.recording, self.axes, self.order = recording, axes, order
        self.turns = [Turn(s.start, s.stop, s.turn_rate, s.arm_phase or 0.0) for s in plan.segment]
        self.seen = [Looked(s, len(axes)) for s in plan.segment]
        self.column = "arm" in recording.rig
        self.lines = [ArmLine(s.start, s.turn_rate) if self.column else None for s in plan.segment]
        self.told: Pass | None = None

    def go(self, sums: Mapping[int, HarmonicSums]) -> None:
        """One pass, adding to the sums of some segments."""
        parts = [(sums.get(i), s) for i, s in enumerate(self.seen)]
        told = go_through(self.recording, parts, self.lines, look=self.told is None)
        if self.told is None:
            self.told = told
            refuse_outside(self.recording.name, self.seen, told.first, told.last, told.interval)
            refuse_saturated(self.recording.name, self.seen, self.axes)
            for seen, turn in zip(self.seen, self.turns, strict=True):
                _refuse_undersampled(f"segment {seen.segment.name!r}", turn.rate, seen.interval, self.order)

    def rates(self, capture: float) -> dict[int, Rate]:
        """Rates of the segments that turn, from the samples."""
        at = [i for i, t in enumerate(self.turns) if t.rate]
        found = estimate(
            lambda parts: self.go(dict(zip(at, parts, strict=True))),
            [self.turns[i] for i in at],
            [f"segment {self.seen[i].segment.name!r}" for i in at],
            len(self.axes),
            self.order,
            capture=capture,
        )
        return dict(zip(at, found, strict=True))


def _refuse_undersampled(name: str, rate: float, interval: float, order: int) -> None:
    if order * abs(rate) * interval >= math.pi:
        raise DataError(
            f"{name}: harmonic {order} of {rate:.6g} rad/s lies above half the sampling frequency ({0.5 / interval:.4g} Hz): "
            "take a lower order"
        )


def _refuse_unfit(seen: Looked, turn: Turn, fit: Fit, order: int) -> None:
    """Refuse a segment whose samples do not determine its terms."""
    name, terms = seen.segment.name, len(fit.unit_covariance)
    if fit.degrees_of_freedom < 1:
        raise DataError(
            f"segment {name!r} holds {seen.count} samples: too few for {terms} terms (DC, {order} harmonics)"
        )
    if not fit.condition < HOPELESS:
        around = abs(turn.rate) * seen.count * seen.interval / (2.0 * math.pi)
        raise DataError(
            f"segment {name!r} shows {around:.3g} turns, too little to tell DC and {order} harmonics apart (condition "
            f"{fit.condition:.2g}): take a lower order or a longer arc, or look at the arm column if there is one"
        )


def _gather(
    run: _Run, turns: Sequence[Turn], fits: Sequence[Fit], found: Mapping[int, Rate], *, extended: bool
) -> SegmentHarmonics:
    assert run.told is not None
    seen, n = run.seen, len(run.seen)
    mid = np.array([s.mid_time for s in seen])
    interval = np.array([s.interval for s in seen])
    rate = np.array([t.rate for t in turns])
    phase = np.array([t.phase + t.rate * (m - t.start) for t, m in zip(turns, mid, strict=True)])
    measured, sigma = np.full(n, np.nan), np.full(n, np.nan)
    for i, f in found.items():
        measured[i], sigma[i] = f.rate, f.sigma
    for i, line in enumerate(run.lines):
        if line is not None:
            angle, measured[i], sigma[i] = line.line(mid[i])
            phase[i], rate[i] = (angle, measured[i]) if turns[i].rate else (angle, 0.0)
    terms = 1 + (4 if extended else 2) * run.order
    coefficient, covariance = np.zeros((n, len(run.axes), terms)), np.zeros((n, terms, terms))
    covariance[:, range(1, terms), range(1, terms)] = np.inf
    counting = np.array([a.partition("_")[0] in run.recording.increments for a in run.axes])
    for i, fit in enumerate(fits):
        k = len(fit.unit_covariance)
        mean = _averaging(k, run.order, rate[i] * interval[i])
        undone = np.where(counting[:, None, None], np.linalg.inv(mean), np.eye(k))
        coefficient[i, :, :k] = np.einsum("akj,aj->ak", undone, fit.coefficient)
        # where some sensors count and others do not, that the former see a little less is no matter to the covariance
        both = undone[0] if counting.all() else np.eye(k)
        covariance[i, :k, :k] = both @ fit.unit_covariance @ both.T
    density, least, dof, louder = _noise(fits, interval, run.axes, counting)
    variance = np.array([f.squares / f.degrees_of_freedom for f in fits])
    return SegmentHarmonics(
        segments=tuple(s.segment for s in seen),
        order=run.order,
        axes=run.axes,
        mid_time=mid,
        interval=interval,
        duration=interval * [s.count for s in seen],
        count=np.array([s.count for s in seen]),
        rate=rate,
        phase=phase,
        coefficient=coefficient,
        unit_covariance=covariance,
        condition=np.array([f.condition for f in fits]),
        density=density,
        noise_degrees_of_freedom=dof,
        residual_variance=variance,
        measured_rate=measured,
        rate_sigma=sigma,
        arm_known=np.full(n, run.column),
        counts=run.recording.counts,
        remarks=(
            *([louder_remark(louder)] if louder else []),
            *(text for s in seen for _, text in gaps_inside(s.holes, [s.segment])),
            *_restless(variance, _EXACT * _power(fits), run),
        ),
        span=(run.told.first, run.told.last),
        least_density=least,
        louder=louder,
    )


def _averaging(terms: int, order: int, step: float) -> Array:
    """What the mean over the sample interval before the time stamp makes of each term, (terms, terms).

    Parameters
    ----------
    terms, order : int
    step : float, rad
        Turn of the angle in a sample interval.
    """
    out = np.eye(terms)
    for first in range(1, terms, 2):
        h = (first // 2) % order + 1
        less, c, s = np.sinc(h * step / (2.0 * math.pi)), math.cos(0.5 * h * step), math.sin(0.5 * h * step)
        out[first : first + 2, first : first + 2] = less * np.array([[c, -s], [s, c]])
    return out


def _noise(
    fits: Sequence[Fit], interval: Array, axes: Sequence[str], counting: NDArray[np.bool_]
) -> tuple[Array, Array, float, dict[str, float]]:
    """Density of each axis and its least, the degrees of freedom it rests on, and axes that are louder about the harmonics.

    What pulses lose and win from sample to sample is little of the noise at the harmonics: of sensors that count them, the
    slow scatter alone tells.
    """
    dof = float(sum(f.degrees_of_freedom for f in fits))
    slow_dof = float(sum(f.slow_degrees_of_freedom for f in fits))
    quick = sum(f.squares * dt for f, dt in zip(fits, interval, strict=True)) / dof
    if not slow_dof:
        return np.sqrt(quick), np.sqrt(quick), dof, {}
    slow = sum(f.slow_squares * dt for f, dt in zip(fits, interval, strict=True)) / slow_dof
    least = np.maximum(quick, _EXACT * interval.max() * _power(fits))
    louder = ~counting & (slow > (1.0 + CLEAR * math.sqrt(2.0 / slow_dof)) * least)
    told = {axes[k]: math.sqrt(float(slow[k] / least[k])) for k in np.flatnonzero(louder).tolist()}
    used = louder | counting
    density, white = np.sqrt(np.where(used, slow, quick)), np.sqrt(np.where(counting, slow / 4.0, quick))
    return density, white, slow_dof if used.any() else dof, told


def louder_remark(louder: Mapping[str, float], used: str = "the larger noise is used") -> str:
    """A word on axes that are clearly noisier about the harmonics than from sample to sample.

    Parameters
    ----------
    louder : mapping of str to float
        Axes, and how many times.
    used : str
        What is made of it.
    """
    return (
        f"{', '.join(louder)}: up to {max(louder.values()):.2g} times as noisy about the harmonics as from sample to sample "
        f"(disturbances that last, or an angle that is not quite the one assumed); {used}"
    )


def _power(fits: Sequence[Fit]) -> Array:
    """Largest mean square of each axis in any segment."""
    return np.asarray(np.max([(f.coefficient**2).sum(axis=1) for f in fits], axis=0))


def _restless(variance: Array, least: Array, run: _Run) -> list[str]:
    """Segments with far more noise than the others of their kind, turning or not."""
    out = []
    turning = np.array([t.rate != 0 for t in run.turns])
    for kind in (turning, ~turning):
        at = np.flatnonzero(kind)
        if at.size < _FEW:
            continue
        ratio = variance[at] / np.maximum(np.maximum(np.median(variance[at], axis=0), least), 1e-300)
        for i, k in zip(at.tolist(), ratio.argmax(axis=1).tolist(), strict=True):
            times = math.sqrt(ratio[at == i, k][0])
            if times**2 > _LOUD:
                name = run.seen[i].segment.name
                out.append(f"segment {name!r} is restless: {run.axes[k]} has {times:.1f} times its usual noise")
    return out


def harmonics_of(
    values: ArrayLike, interval: float, rate: float, *, order: int = 3, phase: float = 0.0, extended: bool = False
) -> Fit:
    """Harmonics of evenly spaced samples in memory.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, axes)
    interval : float, s
        From sample to sample.
    rate : float, rad/s
    order : int
        Highest harmonic.
    phase : float, rad
        Of the first sample.
    extended : bool
        With the terms ``tau cos th, tau sin th, ...``, tau the time from the middle of the samples.

    Returns
    -------
    Fit

    Raises
    ------
    DataError
        When there are too few samples or too short a part of a turn.
    """
    samples = _columns(values)
    _refuse_undersampled("samples", rate, interval, order)
    with ThreadPoolExecutor(WORKERS) as pool:
        # the span of time ends half an interval after the last sample, so that tau is zero in the middle of the samples
        turn = Turn(0.0, (len(samples) - 1) * interval, rate, phase)
        sums = HarmonicSums(turn, samples.shape[1], order, extended=extended)
        sums.add([samples], Even(0.0, interval), interval, pool=pool)
    fit = sums.fit()
    if fit.degrees_of_freedom < 1 or not fit.condition < HOPELESS:
        raise DataError(
            f"{len(samples)} samples over {abs(rate) * turn.stop / (2 * math.pi):.3g} turns do not determine DC and {order} "
            f"harmonics (condition {fit.condition:.2g})"
        )
    return fit


def rate_of(values: ArrayLike, interval: float, rate: float, *, order: int = 3, capture: float = CAPTURE) -> Rate:
    """Rate of a periodic signal in evenly spaced samples in memory.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, axes)
    interval : float, s
    rate : float, rad/s
        Roughly.
    order : int
        Highest harmonic of the signal.
    capture : float
        Relative error of `rate` up to which the true one is found.

    Raises
    ------
    DataError
        When there is no periodic signal within the capture range.
    """
    samples = _columns(values)
    _refuse_undersampled("samples", rate, interval, order)
    with ThreadPoolExecutor(WORKERS) as pool:

        def fill(parts: Sequence[HarmonicSums]) -> None:
            parts[0].add([samples], Even(0.0, interval), interval, pool=pool)

        turn = Turn(0.0, (len(samples) - 1) * interval, rate)
        return estimate(fill, [turn], ["samples"], samples.shape[1], order, capture=capture)[0]


def _columns(values: ArrayLike) -> Array:
    samples = np.ascontiguousarray(values, dtype=float)
    return samples if samples.ndim > 1 else samples[:, None]
