"""What a table's stated uncertainty does to the mean inputs, as columns that all sensors share.

Accelerometers and gyros sit on the same table: an error of a setting or of an axis moves both, and their covariance must
say so, or the rotation between the two triads would look far less certain than it is.
"""

from __future__ import annotations

import numpy as np

from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..rigs.turntable import Site, mean_inputs
from .budget import AXES, GRAVITY, RATE
from .common import left_of, rates_of

AXES_AND_SITE = (*[AXES] * 7, RATE, GRAVITY)
"""Lines of the budget that the last columns of :func:`effects` belong to."""
_WIDE = 1e-4  # rad, for second differences of the rig's model: error 1e-8


def effects(sensor: str, means: SegmentMeans, plan: Plan, site: Site, angles: Array) -> tuple[Array, Array]:
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

    Returns
    -------
    displacement : ndarray, shape (n, 3), m/s^2 or rad/s
        Mean effect of the settings' errors, which shorten the input along itself by the square of the angle.
    columns : ndarray, shape (n, 3, 9 n + 9), m/s^2 or rad/s
        Each setting of each segment, then the squares and products of these, the seven axis errors, the rate, gravity.
        The direction along the input feels only the second order; without it, it would look free of error.
    """
    rates = rates_of(means)
    left = left_of(means, rates)
    n, sigma, index = len(rates), plan.rig.angle_uncertainty, np.arange(len(rates))
    felt = mean_inputs(angles, rates, left, site, letters=plan.rig.letters)
    first = felt.d_force if sensor == "accel" else felt.d_rate

    def inputs(shift: Array) -> Array:
        moved = mean_inputs(angles + shift, rates, left, site, letters=plan.rig.letters, derivatives=False)
        return moved.force if sensor == "accel" else moved.rate

    out = np.zeros((n, 3, 9 * n + 9))
    displacement = np.zeros((n, 3))
    unit = np.eye(3)
    for i in range(3):
        out[index, :, 3 * index + i] = first[:, :, i] * sigma
        for j in range(i + 1):
            plus, minus = _WIDE * (unit[i] + unit[j]), _WIDE * (unit[i] - unit[j])
            second = (inputs(plus) + inputs(-plus) - inputs(minus) - inputs(-minus)) / (4 * _WIDE**2) * sigma**2
            if i == j:
                displacement += second / 2
            out[index, :, 3 * n + 6 * index + i * (i + 1) // 2 + j] = second / (np.sqrt(2) if i == j else 1.0)
    # two tilts, two non-perpendicularities, three zero errors, which act as the settings do
    out[:, :, 9 * n : 9 * n + 7] = first[:, :, [3, 4, 5, 6, 0, 1, 2]] * plan.rig.axis_uncertainty
    if sensor == "gyro":
        out[:, :, -2] = plan.rig.rate_uncertainty * rates.sum(axis=1)[:, None] * felt.axis
    else:
        out[:, :, -1] = plan.gravity_uncertainty / site.gravity * felt.force
    return displacement, out
