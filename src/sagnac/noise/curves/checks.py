"""Samples as they have to be: checked once, in the same words for variances and spectra."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...errors import DataError, InputError
from ...frames import Array

_PART = 1 << 16  # rows that are looked at together for what is no number


def check_interval(interval: float) -> None:
    """Refuse an interval that is none.

    Parameters
    ----------
    interval : float, s

    Raises
    ------
    InputError
        It is not a positive number.
    """
    if not (np.isfinite(interval) and interval > 0):
        raise InputError(f"The interval of the samples is {interval} s: it has to be a positive number of seconds.")


def table(values: ArrayLike, *, least: int = 0, axes: int | None = None) -> Array:
    """Samples as rows of axes, not copied if they are floating-point numbers.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, axes)
    least : int
        Rows that there have to be.
    axes : int, optional
        Columns that there have to be; any number when it is None.

    Returns
    -------
    ndarray, shape (n, axes)
        Of the type float32 or float64.

    Raises
    ------
    InputError
        Another shape.
    """
    y = np.asarray(values)
    if y.dtype not in (np.float32, np.float64):
        y = y.astype(float)
    y = y[:, None] if y.ndim == 1 else y
    if y.ndim != 2 or y.shape[1] < 1 or len(y) < least:
        raise InputError(f"Samples have the shape (n,) or (n, axes), and these have {np.shape(values)}.")
    if axes is not None and y.shape[1] != axes:
        raise InputError(f"Samples of {y.shape[1]} axes, and there were to be {axes}.")
    return y


def check_finite(values: Array, before: int = 0) -> None:
    """Name the first sample that is no number.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
    before : int
        Samples that came before these.

    Raises
    ------
    DataError
        With the number of the sample and of its axis.
    """
    if np.isfinite(values.sum()):
        return
    for start in range(0, len(values), _PART):
        bad = np.argwhere(~np.isfinite(values[start : start + _PART]))
        if bad.size:
            row, axis = bad[0]
            raise DataError(
                f"Sample {before + start + row + 1} of axis {axis + 1} is {values[start + row, axis]}: part the record there."
            )
