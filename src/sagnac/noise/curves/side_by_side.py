"""The same for every axis, side by side on the processors."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_SERIAL = 1 << 16  # numbers that are not worth a second thread


def each_axis(job: Callable[[int], None], axes: int, numbers: int) -> None:
    """Do a job for each axis.

    Parameters
    ----------
    job : callable
        Takes the number of the axis.
    axes : int
    numbers : int
        That the jobs go through in all: few are gone through one axis after the other.
    """
    if numbers < _SERIAL or axes == 1:
        for k in range(axes):
            job(k)
        return
    with ThreadPoolExecutor(min(os.cpu_count() or 1, axes)) as pool:
        list(pool.map(job, range(axes)))
