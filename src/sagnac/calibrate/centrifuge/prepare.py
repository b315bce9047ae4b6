"""Harmonics and plan of a centrifuge brought together: which columns, which noise, where the arm pointed."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError, InputError
from ...frames import Array
from ...observe.harmonics import SegmentHarmonics, louder_remark, segment_harmonics
from ...observe.rig_angles import arm_remarks
from ...observe.sums import BLOCKS
from ...plan import Plan
from ...recording import Recording
from ...rigs.centrifuge import Arm
from ...sensors.series import basis
from .. import common
from ..slow import harmonics_covariance, scatter_density, slow_noise
from .prior import Prior
from .task import Task, sensor_axes, without_tau

Flags = NDArray[np.bool_]

_DIFFERENT = 5.0
"""Standard deviations from which a measured rate is not the planned one,"""
_ROUNDING = 1e-8
"""and the part of it that rounding of noise-free samples may change."""
_ASTRAY = 0.1
"""Part of the planned rate by which that of an arm column may differ."""
_TOLD = 5e9
"""Condition up to which the terms of a segment are told apart."""
_RESTLESS = 30.0
"""Times the usual scatter that a segment at rest does not show."""
_NOMINAL = 1e-10
"""Noise, relative to the readings, that stands in until the residuals tell."""


def harmonics_of(recording: Recording, plan: Plan) -> SegmentHarmonics:
    """Harmonics of a recording as this plan needs them.

    Parameters
    ----------
    recording : Recording
        With a column of the arm's angle (``arm``) or without.
    plan : Plan

    Returns
    -------
    SegmentHarmonics
        With the rate found in the samples where the plan gives no phase or an uncertain rate; with the terms that show an error
        of the rate, wherever the segments are long enough for them.
    """
    if not plan.segment:
        raise DataError(
            "the plan has no [[segment]]: which samples belong to which arm rate and setting of the gimbals?"
        )
    if recording.counts:
        raise InputError("centrifuge needs readings in units of the input; give the nominal scale with --scale")
    unsure = plan.rig.rate_uncertainty > 0 or any(s.arm_rate and s.arm_phase is None for s in plan.segment)
    order, extended = _terms(plan, always=unsure)
    if not plan.rig.counter_rotating:
        return segment_harmonics(recording, plan, order=order)
    if unsure:
        return segment_harmonics(recording, plan, order=order, rate="estimate", extended=True)
    found = segment_harmonics(recording, plan, order=order, extended=extended)
    if extended:
        return found
    note = "a segment is too short a part of a turn to compare its rate with the plan's: arm_rate is taken as exact"
    return replace(found, remarks=(*found.remarks, note))


def _terms(plan: Plan, *, always: bool) -> tuple[int, bool]:
    """Highest harmonic, and whether with the terms with tau (`always`: they are needed), that the shortest arc can tell."""
    arc = min((abs(s.arm_rate) * (s.stop - s.start) for s in plan.segment if s.arm_rate), default=2.0 * np.pi)
    angle = np.linspace(-0.5, 0.5, 400) * arc
    for order, extended in ((4, True), (3, True), (4, False), (3, False)):
        terms = basis(angle, order)
        if extended:
            terms = np.hstack([terms, angle[:, None] * terms[:, 1:]])
        if np.linalg.cond(terms / np.linalg.norm(terms, axis=0)) ** 2 < _TOLD or (
            always and (order, extended) == (3, True)
        ):
            return order, extended
    return 3, False


def prepare(
    harmonics: SegmentHarmonics,
    plan: Plan,
    prior: Prior | None,
    terms: Sequence[str] | None,
    sensors: Collection[str] | None,
) -> tuple[Task, list[str]]:
    """Harmonics and plan as a task, with remarks.

    Parameters
    ----------
    harmonics : SegmentHarmonics
    plan : Plan
    prior : Prior, optional
    terms : sequence of str, optional
        See :func:`.task.sensor_axes`.
    sensors : collection of str, optional
        Which sensors or columns.

    Raises
    ------
    InputError
        When readings are raw counts, no such column was recorded, or the plan lacks what the model needs.
    """
    _refuse_unfit(harmonics, plan)
    columns = _columns(harmonics, sensors)
    # which noise is used is said where it is chosen
    general = louder_remark(harmonics.louder) if harmonics.louder else None
    remarks = [*(r for r in harmonics.remarks if r != general), *common.gravity_remarks(plan)]
    told = frozenset(prior.names if prior is not None else ())
    if prior is not None:
        prior = _in_gimbals(prior, columns)
        remarks += prior.remarks
    bounds = _bounds(columns, plan, prior)
    known = told | frozenset(bounds)
    axes = sensor_axes(columns, plan.rig.counter_rotating, known, None if terms is None else tuple(terms))
    own = {n for s in axes for n in s.names}
    variance, noise_known = _noise(harmonics, plan, columns, remarks)
    rates = np.where(harmonics.arm_known, harmonics.rate, [s.arm_rate for s in harmonics.segments])
    angle, mean_only = _angles(harmonics, plan, columns, remarks)
    slow = _slow(harmonics, plan, extended=harmonics.extended)
    _refuse_other_rate(harmonics, plan, mean_only, slow)
    _refuse_moving(harmonics)
    remarks += arm_remarks(
        harmonics.segments,
        harmonics.phase,
        harmonics.mid_time,
        harmonics.rate,
        harmonics.arm_known,
        plan.rig.phase_uncertainty,
    )
    at = [harmonics.axes.index(c) for c in columns]
    coefficient, covariance, extended = harmonics.coefficient[:, at], harmonics.unit_covariance, harmonics.extended
    if extended and np.all(np.isfinite(angle) | mean_only) and not plan.rig.rate_uncertainty > 0:
        coefficient, covariance = without_tau(coefficient, covariance, harmonics.order)
        extended = False
        slow = None if slow is None else _slow(harmonics, plan, extended=False)
    task = Task(
        plan=plan,
        segments=harmonics.segments,
        sensors=axes,
        coefficient=coefficient,
        covariance=covariance,
        variance=variance,
        noise_known=noise_known,
        order=harmonics.order,
        extended=extended,
        phase=harmonics.phase,
        rate=harmonics.rate,
        mid_time=harmonics.mid_time,
        planned_rate=rates,
        planned_angle=angle,
        mean_only=mean_only,
        rate_sigma=np.where(np.isfinite(harmonics.rate_sigma), harmonics.rate_sigma, np.inf),
        by_column=harmonics.arm_known,
        settings=np.array([[s.alpha, s.beta, s.gamma] for s in harmonics.segments]),
        setting_sigma=plan.rig.angle_uncertainty,
        arm=Arm(plan.rig.radius or 0.0, plan.rig.counter_rotating),
        site=common.site_of(plan, "the Coriolis force on the arm and the Earth rate on the gyros"),
        fixed={},
        bounds=bounds,
        prior=None if prior is None else prior.only(sorted(own)),
        slow=None if slow is None else slow[:, at],
    )
    return task, remarks


def _refuse_unfit(harmonics: SegmentHarmonics, plan: Plan) -> None:
    if harmonics.counts:
        raise InputError("centrifuge needs readings in units of the input; give the nominal scale with --scale")
    if not any(s.arm_rate for s in plan.segment):
        raise InputError("no segment of the plan has an arm_rate other than zero: nothing excites the higher terms")


def _columns(harmonics: SegmentHarmonics, sensors: Collection[str] | None) -> tuple[str, ...]:
    if sensors is None:
        return tuple(harmonics.axes)
    for asked in sensors:
        if not any(asked in (a, a.partition("_")[0]) for a in harmonics.axes):
            raise InputError(f"sensors: {asked!r} was not recorded; there are {', '.join(harmonics.axes)}")
    return tuple(a for a in harmonics.axes if a in sensors or a.partition("_")[0] in sensors)


def _in_gimbals(prior: Prior, columns: Sequence[str]) -> Prior:
    """Without the accelerometers' misalignments where they refer to x and y, and those were not recorded."""
    told = [n for n in prior.names if n.startswith("accel.misalignment.")]
    framed = {"accel.bias.x", "accel.bias.y"} <= set(prior.names)
    if not told or not framed or {"accel_x", "accel_y"} <= set(columns) or not any(c[0] == "a" for c in columns):
        return prior
    note = "the accelerometers' misalignments of the prior calibration are not used: they refer to x and y, not in use here"
    return prior.only([n for n in prior.names if n not in told])._replace(remarks=(*prior.remarks, note))


def _bounds(columns: Sequence[str], plan: Plan, prior: Prior | None) -> dict[str, float]:
    """Scale errors that the rig cannot show and the plan bounds."""
    limit = plan.unit.limits.gyro_scale
    if limit is None or not plan.rig.counter_rotating:
        return {}
    names = [f"gyro.scale_error.{c[-1]}" for c in columns if c.startswith("gyro")]
    return {n: limit for n in names if prior is None or n not in prior.names}


def _stated(plan: Plan, column: str) -> float:
    """Noise that the plan states of an axis, NaN where it states none."""
    sensor, _, axis = column.partition("_")
    each = plan.unit.noise.of(sensor)
    return math.nan if each is None else each["xyz".index(axis)]


def _noise(harmonics: SegmentHarmonics, plan: Plan, columns: Sequence[str], remarks: list[str]) -> tuple[Array, bool]:
    """Variance of the samples' white noise (n, m), and whether it is known: as stated unless the data clearly show more."""
    interval = harmonics.interval[:, None]
    at = [harmonics.axes.index(c) for c in columns]
    found, size = harmonics.density[at], np.abs(harmonics.coefficient[:, at]).max(axis=(0, 2))
    dof = harmonics.noise_degrees_of_freedom
    usable = dof > 0 and bool(np.all(np.isfinite(found))) and bool(np.any(found > 1e-12 * size.max()))
    stated = np.array([_stated(plan, c) for c in columns])
    if not usable:
        density = np.where(np.isfinite(stated), stated, _NOMINAL * np.maximum(size, 1e-6 * size.max()))
        return density**2 / interval, bool(np.all(np.isfinite(stated)))
    least = found if harmonics.least_density is None else harmonics.least_density[at]
    inside = _slow_inside(harmonics, plan, columns)
    limit = max(1.5, float(np.sqrt(1.0 + 5.0 * np.sqrt(2.0 / dof))))
    expected = np.sqrt(np.where(np.isfinite(stated), stated, least) ** 2 + inside)
    loud = np.isfinite(stated) & (found > limit * expected)
    own = loud | ~np.isfinite(stated)
    remarks += _louder_remarks(harmonics, columns, own, (inside > 0) & (found <= limit * expected))
    remarks += [
        f"{columns[k]} shows {found[k] / expected[k]:.2g} times the noise stated in the plan: the data's own is used"
        for k in np.flatnonzero(loud).tolist()
    ]
    # of the slow scatter, which the least is less than, slow noise has its part, and is counted for itself
    white = np.sqrt(np.maximum(found**2 - _slow_expected(harmonics, plan, columns), np.minimum(least, found) ** 2))
    return np.where(own, white, stated) ** 2 / interval, True


def _louder_remarks(harmonics: SegmentHarmonics, columns: Sequence[str], own: Flags, explained: Flags) -> list[str]:
    """A word on axes that are noisier about the harmonics than the slow noise stated explains, and the noise used of them."""
    out = []
    for used, words in ((own, "the larger noise is used"), (~own, "the noise stated in the plan is used")):
        loud = {
            c: harmonics.louder[c]
            for c, here in zip(columns, used & ~explained, strict=True)
            if here and c in harmonics.louder
        }
        out += [louder_remark(loud, words)] if loud else []
    return out


def _slow_inside(harmonics: SegmentHarmonics, plan: Plan, columns: Sequence[str]) -> Array:
    """What slow noise adds to the squared density found in parts of segments, at most, (m,)."""
    by_sensor = {s: common.slow_inside(harmonics, plan, s) for s in dict.fromkeys(c.partition("_")[0] for c in columns)}
    return np.array([by_sensor[c.partition("_")[0]]["xyz".index(c[-1])] for c in columns])


def _slow_expected(harmonics: SegmentHarmonics, plan: Plan, columns: Sequence[str]) -> Array:
    """What is expected of slow noise in the squared density of the slow scatter, of all segments together, (m,)."""
    stated = {s: slow_noise(plan, s) for s in ("accel", "gyro")}
    if all(stated[c.partition("_")[0]] is None for c in columns):
        return np.zeros(len(columns))
    parts = [
        # rates that are found differ by next to nothing, and what is computed for one serves all
        scatter_density(round(rate * T, 3), round(T, 6), harmonics.order, BLOCKS, extended=harmonics.extended)
        for rate, T in zip(harmonics.rate.tolist(), harmonics.duration.tolist(), strict=True)
    ]
    flicker, walk, freedom = np.array(parts).T
    weight = freedom / freedom.sum()
    out = np.zeros(len(columns))
    for j, c in enumerate(columns):
        noise, k = stated[c.partition("_")[0]], "xyz".index(c[-1])
        if noise is not None:
            out[j] = noise.instability[k] ** 2 * (weight @ flicker) + noise.walk[k] ** 2 * (weight @ walk)
    return out


def _slow(harmonics: SegmentHarmonics, plan: Plan, *, extended: bool) -> Array | None:
    """What slow noise that the plan states adds to the covariance of the coefficients, (n, axes, c, c), or None.

    The segments' means have it as in all methods (:func:`sagnac.calibrate.common.slow_variance`), and independently of what
    goes on about them the harmonics their own.
    """
    columns = harmonics.axes
    stated = {s: slow_noise(plan, s) for s in ("accel", "gyro")}
    if all(stated[c.partition("_")[0]] is None for c in columns):
        return None
    mean = {s: common.slow_variance(harmonics, plan, s) for s in stated}
    size = 1 + (4 if extended else 2) * harmonics.order
    out = np.zeros((len(harmonics.segments), len(columns), size, size))
    turning = [
        harmonics_covariance(rate * T, phase, float(T), harmonics.order, extended=extended) if rate else None
        for rate, phase, T in zip(harmonics.rate, harmonics.phase, harmonics.duration, strict=True)
    ]
    for j, column in enumerate(columns):
        sensor, k = column.partition("_")[0], "xyz".index(column[-1])
        noise = stated[sensor]
        if noise is None:
            continue
        out[:, j, 0, 0] = mean[sensor][:, k]
        for i, both in enumerate(turning):
            if both is not None:
                out[i, j] += noise.instability[k] ** 2 * both[0] + noise.walk[k] ** 2 * both[1]
    return out


def _angles(harmonics: SegmentHarmonics, plan: Plan, columns: Sequence[str], remarks: list[str]) -> tuple[Array, Flags]:
    """Angle of the arm at mid time, NaN where nobody knows it, and the segments of which only the means are used."""
    out = np.full(len(harmonics.segments), np.nan)
    mean_only = np.zeros(out.size, dtype=np.bool_)
    for i, s in enumerate(harmonics.segments):
        if harmonics.arm_known[i]:
            out[i] = harmonics.phase[i]
        elif s.arm_phase is not None:
            out[i] = s.arm_phase + s.arm_rate * (harmonics.mid_time[i] - s.start)
        mean_only[i] = s.arm_rate == 0 or (np.isnan(out[i]) and not plan.rig.counter_rotating)
    unknown = [s.name for s, lost in zip(harmonics.segments, np.isnan(out) & mean_only, strict=True) if lost]
    if unknown and not plan.rig.counter_rotating:
        resting = [s.name for s in harmonics.segments if s.arm_rate == 0 and s.name in unknown]
        gyros, tilted = any(c.startswith("gyro") for c in columns), plan.rig.axis_uncertainty > 0
        if resting and (gyros or tilted):
            felt = (
                "the gyros feel the horizontal Earth rate" if gyros else "the accelerometers feel the tilt of its axis"
            )
            raise InputError(
                f"segment {resting[0]!r} does not say where the arm points (arm_phase): on a unit fixed to the arm {felt} by it"
            )
        remarks.append("arm_phase was not given: of segments on the turning arm only the mean over the turn is used")
    return out, mean_only


def _refuse_other_rate(harmonics: SegmentHarmonics, plan: Plan, mean_only: Flags, slow: Array | None) -> None:
    """Refuse samples, or an arm column, that turn at another rate than the plan's."""
    for i, s in enumerate(harmonics.segments):
        if harmonics.arm_known[i] and abs(harmonics.rate[i] - s.arm_rate) > _ASTRAY * abs(s.arm_rate) + 1e-3:
            raise DataError(
                f"segment {s.name!r}: the column arm turns at {np.degrees(harmonics.rate[i]):.6g} deg/s, the plan says "
                f"{np.degrees(s.arm_rate):.6g} deg/s: the sense of rotation, or the plan's times, are wrong"
            )
    if plan.rig.rate_uncertainty > 0 or not harmonics.extended:
        return
    worst: tuple[float, str] | None = None
    for i in np.flatnonzero(~mean_only & ~harmonics.arm_known).tolist():
        s = harmonics.segments[i]
        error, sigma = _rate_error(harmonics, i, None if slow is None else slow[i])
        times = abs(error) / np.hypot(sigma, _ROUNDING * abs(s.arm_rate))
        if s.arm_phase is not None and times > max(_DIFFERENT, worst[0] if worst else 0.0):
            worst = (
                times,
                (
                    f"segment {s.name!r}: the samples turn at about {np.degrees(s.arm_rate + error):.9g} deg/s (+- "
                    f"{np.degrees(sigma):.2g}), the plan says {np.degrees(s.arm_rate):.9g} deg/s, exactly"
                ),
            )
    if worst is not None:
        raise DataError(
            f"{worst[1]}. Correct arm_rate, state rig.rate_uncertainty, or leave arm_phase out, so that phase and rate are "
            "estimated"
        )


def _refuse_moving(harmonics: SegmentHarmonics) -> None:
    """Refuse segments said to be at rest in which the accelerometers feel the arm turn."""
    at = [j for j, a in enumerate(harmonics.axes) if a.startswith("accel")]
    turns = np.array([s.arm_rate != 0 for s in harmonics.segments])
    if not at or not turns.any():
        return
    scatter = np.sqrt(harmonics.residual_variance[:, at])
    usual = np.median(scatter[turns], axis=0)
    for i in np.flatnonzero(~turns):
        times = scatter[i] / np.maximum(usual, 1e-3)
        if times.max() > _RESTLESS:
            raise DataError(
                f"segment {harmonics.segments[int(i)].name!r} is said to be at rest (arm_rate 0), but "
                f"{harmonics.axes[at[int(np.argmax(times))]]} varies by {scatter[i].max() / 9.80665:.2g} g rms: the arm "
                "turned, or the segment lies beside its rest"
            )


def _rate_error(harmonics: SegmentHarmonics, i: int, slow: Array | None) -> tuple[float, float]:
    """How much faster than assumed the samples of a segment turn, from the terms with tau, and its standard deviation (rad/s)."""
    c = 1 + 2 * harmonics.order
    plain, _ = without_tau(harmonics.coefficient[i : i + 1], harmonics.unit_covariance[i : i + 1], harmonics.order)
    h = np.arange(1, harmonics.order + 1)
    slope = np.zeros((len(harmonics.axes), c - 1))  # of the terms with tau to the error: that of c_h e^{ihw tau}
    slope[:, ::2], slope[:, 1::2] = h * plain[0, :, 2::2], -h * plain[0, :, 1::2]
    variance = harmonics.residual_variance[i]
    variance = np.maximum(variance, 1e-24 * np.abs(plain[0]).max() ** 2)
    weighed = np.linalg.solve(harmonics.unit_covariance[i, c:, c:], slope.T).T / variance[:, None]
    information = float(np.sum(weighed * slope))
    spread = information
    if slow is not None:
        spread += float(np.einsum("mi,mij,mj->", weighed, slow[:, c:, c:], weighed))
    return float(np.sum(weighed * harmonics.coefficient[i, :, c:])) / information, math.sqrt(spread) / information
