"""Norm calibration without a rig: a unit turned by hand from rest to rest.

The static intervals are found, the accelerometers are calibrated in them by the norm of gravity as on a table
(:mod:`.norm`), the gyros by gravity's turn from interval to interval (:mod:`.hand_gyros`).

What a hand-turned log can know of signs: the sign common to all accelerometers, never (gravity and its reaction look
alike: an upward axis at rest is taken to read more than its bias). The rest shows in the rotations: one gyro against the
other two is reversed, all three are when the sense of rotation is wrong. Two reversed gyros cannot be told from one
reversed accelerometer, and are refused.
"""

from __future__ import annotations

import numpy as np

from ..calibration import Calibration, Scatter, named
from ..errors import DataError
from ..frames import Array
from ..observe.means import SegmentMeans, segment_means
from ..observe.saturation import refuse_saturated_motion
from ..observe.static import THRESHOLD, StaticIntervals, static_intervals
from ..plan import Plan, Segment
from ..recording import GAP, SENSORS, Batch, Recording, from_arrays, sample_interval
from ..sensors import Triad
from . import budget, common, norm
from .hand_gyros import GyroFit, calibrate_gyros
from .norm.report import block_diagonal

GRAVITY_SPREAD = 0.015
"""m/s^2, standard deviation of gravity over the Earth's surface (9.780 to 9.832, uniform): used when no site is given."""


def calibrate(
    recording: Recording, site: Plan | None = None, *, threshold: float = THRESHOLD, robust: bool = False
) -> Calibration:
    """Calibrate a unit from a log of it standing still in many attitudes and being turned by hand between.

    Parameters
    ----------
    recording : Recording
        Accelerometers, and gyros if they are to be calibrated; raw counts or SI.
    site : Plan, optional
        Its latitude and gravity are used. Without either, standard gravity with the spread of gravity over the Earth
        as its uncertainty.
    threshold : float
        Static intervals have a moving variance of at most this many times that of the quietest windows.
    robust : bool
        Turn down attitudes that disagree with the rest.

    Returns
    -------
    Calibration
        Accelerometers with a lower-triangular matrix (x_b along accelerometer x), gyros with a full matrix in that frame,
        bias and 3x3 g-sensitivity.

    Raises
    ------
    DataError
        When there are too few attitudes or rotations, columns are permuted or an axis dead or saturated.
    """
    recording.need("accel")
    batch = recording.read()
    _refuse_dead(recording.name, batch)
    found = static_intervals(batch, threshold)
    if len(found.start) == 0:
        raise DataError(
            f"{recording.name}: no static interval found (threshold {threshold:g} times the quietest variance); the unit "
            "must stand still for a few seconds in each attitude"
        )
    given = site is not None and (site.gravity is not None or site.latitude is not None)
    site = _with_gravity(site)
    means, plan = means_of(batch, found, site, recording.counts, recording.name)
    refuse_saturated_motion(recording.name, batch)
    solution = norm.solve(means, plan, robust=robust)
    triad = solution.model.accel
    assert triad is not None  # the recording has accelerometers
    remarks = [r for r in solution.case.remarks if "no turning segments" not in r]
    remarks.insert(0, f"{len(found.start)} static intervals found in {means.span[1] - means.span[0]:.0f} s")
    remarks.append("all accelerometer gains are taken as positive: an upward axis at rest must read more than its bias")
    if site.gravity_uncertainty >= GRAVITY_SPREAD:
        remarks.append("no site given: standard gravity assumed, its spread over the Earth is in the scale factors")
    gyro = None
    if batch.gyro is not None:
        up_rate = plan.earth_rate * np.sin(plan.latitude) if plan.latitude is not None else 0.0
        gyro = calibrate_gyros(batch, found, means, solution.fit, triad, "gyro" in recording.counts, up_rate)
        remarks += gyro.remarks
        if plan.latitude is None:
            remarks.append("no latitude given: the gyros' g-sensitivity contains the vertical Earth rate per g")
    remarks += _gaps(batch)
    reported = plan if given else plan.model_copy(update={"gravity": None})
    return _report(recording, means, reported, plan.site_gravity, solution, triad, gyro, remarks)


def _refuse_dead(name: str, batch: Batch) -> None:
    for sensor, values in (("accel", batch.accel), ("gyro", batch.gyro)):
        if values is None:
            continue
        for axis, low, high in zip(SENSORS[sensor], values.min(axis=0), values.max(axis=0), strict=True):
            if low == high:
                raise DataError(f"{name}: {axis} never changes (always {low:g}): the axis is dead or not connected")


def _gaps(batch: Batch) -> list[str]:
    """Notes on the gaps of a log; a static interval ends at one, a rotation with one is left out."""
    steps = np.diff(batch.time)
    where = np.flatnonzero(steps > GAP * sample_interval(batch.time))
    notes = [f"gap of {steps[i]:.3g} s at {batch.time[i]:.6g} s: excluded" for i in where[:10]]
    return notes + ([f"and {where.size - 10} more gaps"] if where.size > 10 else [])


def means_of(
    batch: Batch, found: StaticIntervals, site: Plan, counts: frozenset[str], name: str
) -> tuple[SegmentMeans, Plan]:
    """Means of the static intervals, as if a plan had named them ``1``, ``2``, ...

    Parameters
    ----------
    batch : Batch
        The whole recording.
    found : StaticIntervals
    site : Plan
        Site and unit; its segments are replaced.
    counts : frozenset of str
        Sensors in raw counts.
    name : str
        Of the recording, for messages.
    """
    half = 0.5 * sample_interval(batch.time)
    segments = tuple(
        Segment(name=str(i + 1), start=float(batch.time[a]) - half, stop=float(batch.time[b - 1]) + half)
        for i, (a, b) in enumerate(zip(found.start, found.stop, strict=True))
    )
    plan = site.model_copy(update={"segment": segments})
    recording = from_arrays(batch.time, batch.accel, batch.gyro, counts=tuple(counts), name=name)
    return segment_means(recording, plan), plan


def _with_gravity(site: Plan | None) -> Plan:
    site = site or Plan()
    if site.gravity is None and site.latitude is None:
        return site.model_copy(update={"gravity": 9.80665, "gravity_uncertainty": GRAVITY_SPREAD})
    return site


def _report(
    recording: Recording,
    means: SegmentMeans,
    plan: Plan,
    gravity: float,
    solution: norm.Solution,
    triad: Triad,
    gyro: GyroFit | None,
    remarks: list[str],
) -> Calibration:
    accel, k = solution.fit, len(triad.names)
    names, units = list(triad.names), list(triad.units)
    sources = budget.lines(solution.budget(), accel, range(k), behind=0 if gyro is None else len(gyro.triad.names))
    value, covariance = accel.value[:k], accel.covariance[:k, :k]
    parts = [(accel, list(range(k)))]
    norm_rms = _norm_residual(means, triad, value, gravity)
    residuals = {"static norm": Scatter(rms=norm_rms, unit="m/s^2", count=len(means.count))}
    if gyro is not None:
        names += gyro.triad.names
        units += gyro.triad.units
        value = np.concatenate([value, gyro.fit.value])
        covariance = block_diagonal(covariance, gyro.fit.covariance)
        covariance[k:, :k], covariance[:k, k:] = gyro.cross[:, :k], gyro.cross[:, :k].T
        parts.append((gyro.fit, list(range(len(gyro.triad.names)))))
        rotations = budget.lines({budget.NOISE: gyro.fit.white}, gyro.fit, range(len(gyro.fit.names)), before=k)
        sources = budget.joined(sources, rotations)
        residuals["rotation"] = Scatter(rms=float(np.degrees(gyro.angle_rms)), unit="deg", count=gyro.rotations)
        unit = "count" if gyro.triad.counts else "rad/s"
        residuals["gyro at rest"] = Scatter(rms=gyro.static_rms, unit=unit, count=3 * len(means.count))
    return common.result(
        "norm",
        named(names, units, value, covariance),
        covariance,
        common.fit_record(parts, residuals, ("accelerometers", "gyros")[: len(parts)]),
        plan=plan,
        gravity=gravity,
        recording=recording,
        means=means,
        budget=sources,
        remarks=remarks,
    )


def _norm_residual(means: SegmentMeans, triad: Triad, value: Array, gravity: float) -> float:
    """Rms of the norm's misfit over the static intervals, m/s^2."""
    matrix, bias, _ = triad.unpack(value)
    norms = np.linalg.norm(np.linalg.solve(matrix, (means.mean["accel"] - bias).T), axis=0)
    return float(np.sqrt(np.mean((norms - gravity) ** 2)))
