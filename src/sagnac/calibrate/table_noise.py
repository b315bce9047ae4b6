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


def effects(sensor: str, means: SegmentMeans, plan: Plan, site: Site, angles: Array, rates: Array) -> Array:
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
    ndarray, shape (n, 3, 3 n + 9), m/s^2 or rad/s
        Columns: each setting of each segment, then the seven axis errors, the rate, gravity.
    """
    n, which = len(rates), 0 if sensor == "accel" else 1
    turned = rates * means.interval
    out = np.zeros((n, 3, 3 * n + 9))
    for i in range(3):
        shift = np.where(np.arange(3) == i, _STEP, 0.0)
        plus, minus = (mean_inputs(angles + s, rates, turned, means.count, site)[which] for s in (shift, -shift))
        out[np.arange(n), :, 3 * np.arange(n) + i] = (plus - minus) / (2 * _STEP) * plan.rig.angle_uncertainty
    axes = _axis_effects(which, angles, rates, turned, means.count, site)
    out[:, :, 3 * n : 3 * n + 7] = axes * plan.rig.axis_uncertainty
    up = attitude(angles)[:, 2, :]
    if sensor == "gyro":
        out[:, :, -2] = plan.rig.rate_uncertainty * rates[:, None] * up
    else:
        out[:, :, -1] = plan.gravity_uncertainty * up
    return out


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
