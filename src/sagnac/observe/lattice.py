"""The step that readings are rounded to, from readings that are whole multiples of it apart."""

from __future__ import annotations

import numpy as np

from ..frames import Array

_TELLING = 4  # different values from which a common step is no accident
_ROOM = 1e-8  # of the span, for rounding in the last place


def common_step(readings: Array) -> float:
    """Greatest common divisor of the differences of readings (Euclid).

    Parameters
    ----------
    readings : ndarray, any shape

    Returns
    -------
    float
        In the unit of the readings; zero where there are too few different ones to tell. Readings without a step give one of
        the size of the room for rounding.
    """
    values = np.unique(readings)
    if values.size < _TELLING:
        return 0.0
    least = _ROOM * float(values[-1] - values[0])
    step = 0.0
    for difference in np.diff(values):
        while difference > least:
            step, difference = float(difference), step % difference if step else 0.0  # noqa: PLW2901 - Euclid's swap
    return step
