"""Axis of the rate about the vertical, which both triads must see alike."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from ..calibrate import common
from ..calibration import Calibration
from ..frames import Array, skew, tangents, unit
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..rigs.turntable import averaging
from ..sensors import Correction, correction, invert, triad_of
from .norms import Misfits, variance_of

LEVER = "rig.lever_arm.x"
"""Without it a calibration does not know how far the accelerometers are from the axis."""


def joined(calibration: Calibration, sensors: Collection[str]) -> bool:
    """Whether the calibration says how the gyros' axes lie to the accelerometers', and the recording has both.

    Parameters
    ----------
    calibration : Calibration
    sensors : collection of str
        Of the recording.
    """
    ratio = calibration.misalignment == "input-axis"
    accel, gyro = (triad_of(calibration.values(), s, ratio=ratio) for s in ("accel", "gyro"))
    return set(sensors) == {"accel", "gyro"} and accel is not None and gyro is not None and gyro.full


def axes(calibration: Calibration, means: SegmentMeans, plan: Plan, models: dict[str, Correction]) -> Misfits:
    """About the vertical both triads must see one axis turn: angle between them, two components a segment.

    Both come out of a function of the parameters, whose derivative is taken by central differences. A lever arm l moves the
    force by w^2 (a a' l - l), a the axis and w the rate, and with it the axis that the accelerometers see.

    Parameters
    ----------
    calibration : Calibration
    means : SegmentMeans
    plan : Plan
    models : dict of str to Correction
    """
    rates = common.rates_of(means)[:, 0] * (plan.rig.letters[0] == "z")
    at = np.flatnonzero(rates)
    k = len(calibration.parameters)
    names = list(calibration.values())
    if not joined(calibration, models) or at.size == 0 or any(m.terms for m in models.values()):
        return Misfits.none("axis", k)
    values = np.array([p.value for p in calibration.parameters])
    up, w = _seen(calibration, means, at, rates[at], values)
    basis = np.swapaxes(tangents(up), -1, -2)

    def apart(x: Array) -> Array:
        a, w = _seen(calibration, means, at, rates[at], x)
        out = (basis @ (w - a)[..., None])[..., 0]
        out[:, 0] += np.where(np.einsum("ni,ni->n", a, w) < 0, np.pi, 0.0)  # turned right round
        return np.asarray(out.ravel())

    jacobian = np.zeros((2 * at.size, k))
    for i in np.flatnonzero([n.startswith(("accel.", "gyro.", "rig.lever")) for n in names]):
        step = np.where(np.arange(k) == i, 1e-6 * max(abs(values[i]), 1.0), 0.0)
        jacobian[:, i] = (apart(values + step) - apart(values - step)) / (2 * step[i])
    variance = np.zeros(at.size)
    for sensor, size in (("accel", np.full(at.size, plan.site_gravity)), ("gyro", np.abs(rates[at]))):
        model = models[sensor]
        gain = float(np.mean(np.linalg.norm(model.matrix, axis=1)))
        variance += variance_of(sensor, means, plan, model)[at].mean(axis=1) / (gain * size) ** 2
    left = np.abs(averaging(rates[at] * means.interval[at], means.count[at]))
    latitude = plan.need_latitude("the rate's axis")
    variance += (left * plan.earth_rate * math.cos(latitude) / rates[at]) ** 2 / 2 + (
        left * plan.rig.axis_uncertainty
    ) ** 2
    named = [means.names[i] for i in np.repeat(at, 2)]
    lever = None
    if LEVER not in names:
        # of a force g w - c P l, P across w, the part of w that is across the force is c P l over its size: exact in l
        across = np.eye(3) - np.einsum("ni,nj->nij", w, w)
        lever = (basis @ across * (rates[at] ** 2 / plan.site_gravity)[:, None, None]).reshape(-1, 3)
    turn = (basis @ -skew(up)).reshape(-1, 3)
    return Misfits(
        "axis", named, apart(values), jacobian, np.repeat(variance, 2), np.zeros(2 * at.size), lever=lever, turn=turn
    )


def _seen(
    calibration: Calibration, means: SegmentMeans, at: NDArray[np.intp], rates: Array, x: Array
) -> tuple[Array, Array]:
    """Direction of the outer axis from the accelerometers and from the gyros, (n, 3) each, for parameter values x."""
    values = dict(zip(calibration.values(), x, strict=True))
    ratio = calibration.misalignment == "input-axis"
    accel, gyro = (correction(values, sensor, ratio=ratio) for sensor in ("accel", "gyro"))
    assert accel is not None and gyro is not None  # noqa: PT018 - the caller has looked
    force = invert(accel, means.mean["accel"][at])
    lever = np.array([values.get(f"rig.lever_arm.{axis}", 0.0) for axis in "xyz"])
    up = unit(force)
    force = force - (rates**2)[:, None] * (up * (up @ lever)[:, None] - lever)
    return unit(force), unit(invert(gyro, means.mean["gyro"][at], force)) * np.sign(rates)[:, None]
