"""Saturated axes in motion: runs of equal samples at an extreme of the range."""

from __future__ import annotations

import numpy as np

from ..errors import DataError
from ..frames import Array
from ..recording import SENSORS, Batch

_RUN = 8  # equal samples in a row that a turning hand never gives an unsaturated axis
_RESOLVED = 1.5


def longest_run(at: Array) -> tuple[int, int]:
    """Length and start of the longest run of true values, (0, 0) when there is none.

    Parameters
    ----------
    at : ndarray of bool, shape (n,)
    """
    edges = np.diff(np.concatenate([[0], at.astype(np.int8), [0]]))
    start, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if start.size == 0:
        return 0, 0
    i = int(np.argmax(stop - start))
    return int(stop[i] - start[i]), int(start[i])


def refuse_saturated_motion(name: str, batch: Batch) -> None:
    """Refuse a recording in which an axis stands at an extreme for a run of samples.

    Axes whose noise is not resolved by the converter are left alone: they may well repeat a value.

    Raises
    ------
    DataError
        With the axis, the value and the time.
    """
    for sensor, values in (("accel", batch.accel), ("gyro", batch.gyro)):
        if values is None:
            continue
        for k, axis in enumerate(SENSORS[sensor]):
            column = values[:, k]
            steps = np.abs(np.diff(column))
            moving = steps[steps > 0]
            if moving.size == 0 or np.median(steps) <= _RESOLVED * moving.min():
                continue
            for side, value in (("top", column.max()), ("bottom", column.min())):
                run, start = longest_run(column == value)
                if run >= _RUN:
                    raise DataError(
                        f"{name}: {axis} is saturated at the {side} of its range ({value:g}) for {run} samples from "
                        f"{batch.time[start]:.6g} s: turn more slowly or choose a wider range"
                    )
