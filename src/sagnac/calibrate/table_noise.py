"""What a table's stated uncertainty does to the mean inputs, as columns that all sensors share.

Accelerometers and gyros sit on the same table: an error of a setting or of an axis moves both, and their covariance must
say so, or the rotation between the two triads would look far less certain than it is.
"""

from __future__ import annotations

import numpy as np

from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..rigs.turntable import Site, TableErrors, attitude, averaging, mean_inputs

_STEP = 1e-6  # rad, central differences of the rig's model: error 1e-12
_WIDE = 1e-4  # rad, for second differences: error 1e-8


def effects(
    sensor: str, means: SegmentMeans, plan: Plan, site: Site, angles: Array, rates: Array
) -> tuple[Array, Array]:
    """One-sigma effects on the mean inputs of a sensor.

    Parameters
    ----------
    sensor : str
        ``accel`` or ``gyro``.
    means : SegmentMeans
    plan : Plan
    site : sagnac.rigs.turntable.Site
    angles : ndarray, shape (n, 3), rad
        Settings at mid time.
    rates : ndarray, shape (n,), rad/s

    Returns
    -------
    displacement : ndarray, shape (n, 3), m/s^2 or rad/s
        Mean effect of the settings' errors, which shorten the input along itself by the square of the angle.
    columns : ndarray, shape (n, 3, 9 n + 9), m/s^2 or rad/s
        Each setting of each segment, then the squares and products of these, the seven axis errors, the rate, gravity.
        The direction along the input feels only the second order; without it, it would look free of error.
    """
    n, which = len(rates), 0 if sensor == "accel" else 1
    sigma, index = plan.rig.angle_uncertainty, np.arange(n)

    def inputs(shift: Array) -> Array:
        return mean_inputs(angles + shift, rates, rates * means.interval, means.count, site)[which]

    out = np.zeros((n, 3, 9 * n + 9))
    displacement = np.zeros((n, 3))
    unit = np.eye(3)
    for i in range(3):
        out[index, :, 3 * index + i] = (inputs(_STEP * unit[i]) - inputs(-_STEP * unit[i])) / (2 * _STEP) * sigma
        for j in range(i + 1):
            plus, minus = _WIDE * (unit[i] + unit[j]), _WIDE * (unit[i] - unit[j])
            second = (inputs(plus) + inputs(-plus) - inputs(minus) - inputs(-minus)) / (4 * _WIDE**2) * sigma**2
            if i == j:
                displacement += second / 2
            out[index, :, 3 * n + 6 * index + i * (i + 1) // 2 + j] = second / (np.sqrt(2) if i == j else 1.0)
    axes = _axis_effects(which, angles, rates, rates * means.interval, means.count, site)
    out[:, :, 9 * n : 9 * n + 7] = axes * plan.rig.axis_uncertainty
    up = attitude(angles)[:, 2, :]
    if sensor == "gyro":
        out[:, :, -2] = plan.rig.rate_uncertainty * rates[:, None] * up
    else:
        out[:, :, -1] = plan.gravity_uncertainty * up
    return displacement, out


def _axis_effects(which: int, angles: Array, rates: Array, turned: Array, count: Array, site: Site) -> Array:
    """Derivative of the mean inputs to the table's tilts, non-perpendicularities and zero errors, (n, 3, 7)."""
    up_rate = (rates + site.enu[2])[:, None]
    left = averaging(turned, count)[:, None]

    def inputs(errors: TableErrors) -> Array:
        to_enu = attitude(angles, errors)
        axis = attitude(angles, TableErrors((0.0, 0.0), errors.nonperpendicularity, errors.zero))[:, 2, :]
        if which == 0:
            return np.asarray(site.gravity * (axis + left * (to_enu[:, 2, :] - axis)))
        level = np.einsum("nji,j->ni", to_enu, site.enu) - site.enu[2] * axis
        return np.asarray(up_rate * axis + left * level)

    out = np.zeros((len(rates), 3, 7))
    for k in range(7):
        v = np.where(np.arange(7) == k, _STEP, 0.0)
        plus, minus = (TableErrors((w[0], w[1]), (w[2], w[3]), (w[4], w[5], w[6])) for w in (v, -v))
        out[:, :, k] = (inputs(plus) - inputs(minus)) / (2 * _STEP)
    return out
