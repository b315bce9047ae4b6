"""What every method needs: the noise to weigh with, and the result record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from .. import calibration as record
from .._version import __version__
from ..calibration import Calibration
from ..earth import STANDARD_GRAVITY
from ..errors import InputError
from ..estimate import Estimate
from ..files import sha256
from ..frames import Array
from ..observe.means import SegmentMeans
from ..observe.sums import BLOCKS
from ..plan import Plan
from ..recording import Recording
from ..results import Software, Source, covariance_rows, now
from ..rigs.turntable import Site, attitude, averaging
from .slow import slow_noise

_POOR = 2.0
_FAR = 4.0  # times the stated uncertainty of what the plan says
_LEAST_WHITE = 0.25  # of the power found in blocks: white noise that slow noise leaves there at least
_NOMINAL = 1e-10
"""Noise, relative to the readings, that stands in until the residuals tell: so small that no prior outweighs data."""


@dataclass(frozen=True)
class Noise:
    """Noise to weigh the means of one sensor with.

    Attributes
    ----------
    density : ndarray, shape (3,) or (n, 3)
        Per sqrt(Hz), in the unit of the readings; of each of n segments where slow noise is stated: that white noise which their
        means would scatter with as they do, see :func:`slow_variance`.
    known : bool
        Whether it was stated or measured; otherwise only the residuals can tell.
    remarks : tuple of str
    """

    density: Array
    known: bool
    remarks: tuple[str, ...] = ()


def noise_of(means: SegmentMeans, plan: Plan, sensor: str, gain: float = 1.0, size: float = 1.0) -> Noise:
    """Noise of a sensor: as stated in the plan unless the data show clearly more, else as found in the data.

    Parameters
    ----------
    means : SegmentMeans
    plan : Plan
    sensor : str
    gain : float
        Counts per SI unit for raw readings.
    size : float
        Size of the readings, which sets a nominal noise when nothing is known.
    """
    stated = plan.unit.noise.of(sensor)
    slow = slow_variance(means, plan, sensor) * gain**2
    found = means.density[sensor]
    dof = means.noise_degrees_of_freedom
    usable = dof > 0 and bool(np.all(np.isfinite(found))) and float(found.max()) > 1e-13 * abs(size)
    if usable:
        found = np.where(found > 0, found, found.max())
        white = _without_slow(found, means, plan, sensor, gain)
    if stated is None:
        return (
            Noise(_with_slow(white, slow, means), True)
            if usable
            else Noise(np.full(3, max(_NOMINAL * abs(size), 1e-14 * float(np.abs(means.mean[sensor]).max()))), False)
        )
    density = np.array(stated) * gain
    if not usable:
        return Noise(_with_slow(density, slow, means), True)
    # what pulses lost or won at the ends of the blocks leave uncertain is no sign of more noise
    pulses = means.pulse.get(sensor, np.zeros(3)) ** 2 / (6.0 * float(np.median(means.duration)) / 16.0)
    inside = slow_inside(means, plan, sensor) * gain**2
    ratio = found / np.sqrt(density**2 + pulses + inside)
    limit = max(1.5, np.sqrt(1.0 + 5.0 * np.sqrt(2.0 / dof)))
    if np.any(ratio > limit):
        text = (
            f"the {sensor} data show up to {ratio.max():.2g} times the noise stated in the plan: the data's own is used"
        )
        return Noise(_with_slow(np.maximum(white, density), slow, means), True, (text,))
    if np.all(ratio < 0.5):
        text = (
            f"the {sensor} data show only {ratio.max():.2g} of the noise stated in the plan, which is used all the same"
        )
        return Noise(_with_slow(density, slow, means), True, (text,))
    return Noise(_with_slow(density, slow, means), True)


class Timed(Protocol):
    """Segments of a test: means or harmonics of them."""

    @property
    def mid_time(self) -> Array:
        """Of each segment, s."""

    @property
    def duration(self) -> Array:
        """Of each segment, s."""


def whole_time(means: Timed) -> float:
    """Time from the start of the first segment to the end of the last, s.

    Parameters
    ----------
    means : SegmentMeans or SegmentHarmonics
    """
    return float((means.mid_time + means.duration / 2).max() - (means.mid_time - means.duration / 2).min())


def slow_variance(means: Timed, plan: Plan, sensor: str) -> Array:
    """What the slow noise that a plan states adds to the variance of the means of segments, shape (n, 3), SI.

    A constant bias is estimated or compared with, so that what counts is how far the mean over a segment of T seconds lies from
    that over the whole test of T' seconds, in the mean over all places of the segment in the test ::

        B^2 / pi ln(T' / T) + K^2 (T' - T) / 6

    which is the difference of the variances of both means: for flicker noise, of one-sided spectrum B^2 / (pi f), an integral of
    Frullani's, and K^2 T / 6 is the mean squared deviation of a random walk over T seconds from its mean. The bias that is found
    is then that of the test, its mean over it. Neglected is that means of neighbouring segments err alike: plans whose positions
    follow one another in no order of their inputs suffer least.

    Parameters
    ----------
    means : SegmentMeans or SegmentHarmonics
    plan : Plan
    sensor : str
    """
    slow = slow_noise(plan, sensor)
    return np.zeros((means.duration.size, 3)) if slow is None else slow.mean_variance(means.duration, whole_time(means))


def _with_slow(density: Array, slow: Array, means: SegmentMeans) -> Array:
    """White noise that the means of segments would scatter with as they do with slow noise too."""
    return np.sqrt(density**2 + slow * means.duration[:, None]) if slow.any() else density


def _without_slow(found: Array, means: SegmentMeans, plan: Plan, sensor: str, gain: float) -> Array:
    """White noise in the density found in the blocks of segments: less what is expected there of the slow noise stated."""
    slow = slow_noise(plan, sensor)
    if slow is None:
        return found
    turned = rates_of(means).sum(axis=1) * means.duration
    inside = slow.blocks_density(means.duration, turned, BLOCKS) * gain**2
    return np.asarray(np.sqrt(np.maximum(found**2 - inside, _LEAST_WHITE * found**2)))


def slow_inside(means: Timed, plan: Plan, sensor: str) -> Array:
    """What slow noise adds to the squared density found in the blocks of segments, at most, shape (3,), SI.

    Parameters
    ----------
    means : SegmentMeans or SegmentHarmonics
    plan : Plan
    sensor : str
    """
    B, K = plan.unit.noise.of(sensor, "instability"), plan.unit.noise.of(sensor, "walk")
    T = float(np.median(means.duration))
    out = np.zeros(3) if B is None else np.array(B) ** 2 / math.pi * math.log(BLOCKS)
    return np.asarray((out + (0.0 if K is None else np.array(K) ** 2 * T / 6.0)) * T / BLOCKS)


def site_of(plan: Plan, why: str) -> Site:
    """Site of a plan for methods that need the Earth rate."""
    return Site(plan.need_latitude(why), plan.site_gravity, plan.earth_rate)


def nominal_attitudes(means: SegmentMeans, plan: Plan) -> Array | None:
    """C_k^n at the middle of each segment from the table's settings, shape (n, 3, 3), or None when an angle is missing."""
    if any(s.angles is None for s in means.segments):
        return None
    return attitude(need_angles(means, "norm"), letters=plan.rig.letters)


def rates_of(means: SegmentMeans) -> Array:
    """Rates of outer, middle and inner axis, shape (n, 3), rad/s."""
    return np.array([s.rates for s in means.segments])


def left_of(means: SegmentMeans, rates: Array) -> Array:
    """What averaging leaves of a turning vector in each segment, shape (n,)."""
    return averaging(rates.sum(axis=1) * means.interval, means.count)


def outer_rates(means: SegmentMeans, plan: Plan, method: str) -> Array:
    """Rates of the outer axis, shape (n,), for methods that take no other and need it vertical.

    Raises
    ------
    InputError
        When another axis turns, or the outer axis is not vertical.
    """
    rates = rates_of(means)
    for s in means.segments:
        if s.middle_rate or s.inner_rate:
            raise InputError(
                f"segment {s.name!r} turns the {'middle' if s.middle_rate else 'inner'} axis; {method} takes turns of the "
                "outer axis only: use table"
            )
    if rates.any() and plan.rig.letters[0] != "z":
        raise InputError(f"{method} needs a vertical outer axis for turning segments (rig.axes); use table")
    return np.asarray(rates[:, 0])


def need_angles(means: SegmentMeans, method: str) -> Array:
    """Table angles at mid time, shape (n, 3), or an error that names the segment without them."""
    for s in means.segments:
        if s.angles is None:
            raise InputError(f"segment {s.name!r} lacks outer, middle or inner; {method} knows the input from them")
    angles = np.array([s.angles for s in means.segments], dtype=float)
    since = means.mid_time - np.array([s.start for s in means.segments])
    return np.asarray(angles + rates_of(means) * since[:, None])


def gravity_remarks(plan: Plan) -> list[str]:
    """A word where the scale of the accelerometers rests on normal gravity without an uncertainty."""
    if plan.gravity is not None or plan.gravity_uncertainty > 0 or plan.latitude is None:
        return []
    text = (
        "gravity was not given: normal gravity of the site is taken as exact, where the real one differs by some 30 ppm; "
        "state gravity, or gravity_uncertainty"
    )
    return [text]


def gravity_source(plan: Plan | None) -> str:
    """Where gravity came from, in words."""
    if plan is None or (plan.gravity is None and plan.latitude is None):
        return f"standard gravity {STANDARD_GRAVITY}, no site given"
    return "given" if plan.gravity is not None else "normal gravity, WGS-84"


def fit_record(
    parts: Sequence[tuple[Estimate, Sequence[int]]], residuals: dict[str, record.Scatter], labels: Sequence[str] = ()
) -> record.Fit:
    """The fit part of the result.

    Parameters
    ----------
    parts : sequence of (Estimate, indices)
        The fits that the result came from, and which of their parameters it reports, in the result's order.
    residuals : dict of str to Scatter
    labels : sequence of str
        Names of the parts, for where their uncertainties come from different figures.
    """
    from scipy.special import chdtrc

    fits = [e for e, _ in parts]
    chi2, dof = sum(e.chi2 for e in fits), sum(e.degrees_of_freedom for e in fits)
    conditions = [e.condition for e in fits if np.isfinite(e.condition)]

    def picked(kind: str) -> tuple[float, ...] | None:
        values = [getattr(e, kind) for e in fits]
        if any(v is None for v in values):
            return None
        return tuple(float(v[i]) for v, (_, order) in zip(values, parts, strict=True) for i in order)

    return record.Fit(
        chi2=chi2,
        degrees_of_freedom=dof,
        residual_rms=float(np.sqrt(np.mean(np.concatenate([e.residual for e in fits]) ** 2))),
        converged=True,
        iterations=sum(e.iterations for e in fits),
        p_value=float(chdtrc(dof, chi2)) if dof > 0 else None,
        condition=max(conditions) if conditions else None,
        uncertainty=_used(fits, labels),
        white=picked("white"),
        cluster=picked("cluster"),
        delete_one=picked("jackknife"),
        residuals=residuals,
        influence=tuple(
            record.Influence(
                segment=i.segment,
                leverage=i.leverage,
                chi2=i.chi2,
                shift=i.shift if np.isfinite(i.shift) else None,
                parameter=i.parameter,
                rows=i.rows,
            )
            for e in fits
            for i in e.influence
        ),
    )


def _used(fits: Sequence[Estimate], labels: Sequence[str]) -> str:
    if len({e.used for e in fits}) == 1:
        return fits[0].used
    return " / ".join(f"{label}: {e.used}" for e, label in zip(fits, labels, strict=True))


def prior_remarks(fit: Estimate) -> list[str]:
    """A word on what came out far from what the plan says of it, in units of its stated uncertainty."""
    return [
        f"{p.name} came out {abs(v - p.prior) / p.prior_sigma:.3g} times its stated uncertainty away from the plan"
        for p, v in zip(fit.parameters, fit.value, strict=True)
        if np.isfinite(p.prior_sigma) and p.prior_sigma > 0 and abs(v - p.prior) > _FAR * p.prior_sigma
    ]


def misfit_remarks(fit: Estimate, noise_known: bool, poor: float = _POOR, *, planned: bool = True) -> list[str]:
    """A word where the residuals are far beyond what the stated noise and uncertainty allow, by `poor` times at least.

    What to check depends on whether a plan says how the unit stood.
    """
    times = np.sqrt(fit.chi2 / max(fit.degrees_of_freedom, 1))
    if not noise_known or fit.degrees_of_freedom < 1 or times < poor or fit.p_value > 1e-6:
        return []
    advice = (
        "check the plan's angles, rates and times, and what the segment with most influence was"
        if planned
        else "sensors of this kind hardly ever obey the linear model to their noise, or the unit was not quite at rest"
    )
    return [f"the fit is poor: residuals are {times:.3g} times what noise and stated uncertainty allow; {advice}"]


def result(
    method: str,
    parameters: tuple[record.Value, ...],
    covariance: Array,
    fit: record.Fit,
    *,
    plan: Plan | None,
    gravity: float,
    recording: Recording | None = None,
    span: tuple[float, float] | None = None,
    means: SegmentMeans | None = None,
    budget: tuple[record.BudgetLine, ...] = (),
    remarks: Sequence[str] = (),
) -> Calibration:
    """Assemble the result record; `span` of the samples used and their noise are those of the `means` where there are any."""
    source: tuple[Source, ...] = ()
    if recording is not None:
        digest = sha256(recording.path) if recording.path is not None else None
        if span is None and means is not None:
            span = means.span
        start, stop = span if span is not None else (None, None)
        which, chosen = recording.format, recording.select
        source = (Source(file=recording.name, format=which, select=chosen, sha256=digest, start=start, stop=stop),)
    return Calibration(
        method=method,
        unit=record.UnitName(
            model=plan.unit.model if plan else "",
            serial=plan.unit.serial if plan else "",
            scale=dict(recording.scale) if recording else {},
        ),
        parameters=parameters,
        covariance=covariance_rows(covariance),
        fit=fit,
        budget=budget,
        noise=_noise_levels(means, plan, parameters),
        rig=plan.rig.texts() if plan is not None and plan.segment else {},
        environment=_environment(recording),
        site=record.Site(
            latitude=plan.latitude if plan else None,
            height=plan.height if plan else 0.0,
            gravity=gravity,
            gravity_source=gravity_source(plan),
            earth_rate=plan.earth_rate if plan else None,
        ),
        source=source,
        remarks=tuple(dict.fromkeys([*remarks, *(recording.remarks if recording else ())])),
        software=Software(version=__version__),
        created=now(),
    )


def _noise_levels(
    means: SegmentMeans | None, plan: Plan | None, parameters: Sequence[record.Value]
) -> dict[Literal["accel", "gyro"], record.NoiseLevel]:
    """Noise of each sensor in the unit of its readings.

    White as found in the means, or as the plan states it where they cannot tell; slow as the plan states it.
    """
    kinds: tuple[tuple[Literal["accel", "gyro"], str], ...] = (("accel", "m/s^2"), ("gyro", "rad/s"))
    out: dict[Literal["accel", "gyro"], record.NoiseLevel] = {}
    for sensor, given in kinds:
        reading, gain = given, 1.0
        if means is not None and sensor in means.counts:
            scales = [abs(p.value) for p in parameters if p.name.startswith(f"{sensor}.scale_factor.")]
            reading, gain = "count", float(np.mean(scales)) if scales else math.nan
        stated = _stated(plan, sensor, "", gain)
        slow = {t: _stated(plan, sensor, t, gain) for t in ("instability", "walk")}
        found = np.zeros(3)
        if means is not None and means.noise_degrees_of_freedom > 0 and sensor in means.density:
            found = means.density[sensor]
            if plan is not None and math.isfinite(gain):
                found = _without_slow(found, means, plan, sensor, gain)
        x, y, z = (float(v) for v in found)
        if min(x, y, z) > 0 and math.isfinite(x + y + z):
            out[sensor] = record.NoiseLevel(density=(x, y, z), unit=f"{reading}/sqrt(Hz)", origin="recording", **slow)
        elif stated:
            out[sensor] = record.NoiseLevel(density=stated, unit=f"{reading}/sqrt(Hz)", origin="plan", **slow)
    return out


def _stated(plan: Plan | None, sensor: str, term: str, gain: float) -> tuple[float, float, float] | None:
    """Noise that a plan states (:meth:`sagnac.plan.Noise.of`), in the unit of readings with this gain, or None."""
    each = plan.unit.noise.of(sensor, term) if plan is not None and math.isfinite(gain) else None
    return None if each is None else (gain * each[0], gain * each[1], gain * each[2])


def with_found_noise(
    calibration: Calibration, plan: Plan, sensor: Literal["accel", "gyro"], density: Array
) -> Calibration:
    """A result with the white noise that was found in the data and has weighed them, where no means tell it.

    Parameters
    ----------
    calibration : Calibration
    plan : Plan
        Of which slow noise is taken along.
    sensor : str
    density : ndarray, shape (3,), SI
    """
    x, y, z = (float(v) for v in density)
    reading = {"accel": "m/s^2", "gyro": "rad/s"}[sensor]
    slow = {t: plan.unit.noise.of(sensor, t) for t in ("instability", "walk")}
    level = record.NoiseLevel(density=(x, y, z), unit=f"{reading}/sqrt(Hz)", origin="recording", **slow)
    return calibration.model_copy(update={"noise": {**calibration.noise, sensor: level}})


def _environment(recording: Recording | None) -> record.Environment:
    """What the recording tells of its surroundings."""
    if recording is None or recording.temperature is None:
        return record.Environment()
    mean, least, greatest = recording.temperature
    return record.Environment(temperature=record.Range(mean=mean, minimum=least, maximum=greatest))
