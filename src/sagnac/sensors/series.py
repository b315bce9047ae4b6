"""What a sensor says when its inputs are Fourier series in one angle: a Fourier series again.

An input of mean, cosine and sine makes of a polynomial of third order a series up to the third harmonic. It is found exactly by
evaluating the sensor at equally spaced angles (a discrete Fourier transform is exact for a trigonometric polynomial).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..frames import Array
from .axis import Axis

_POINTS = 16  # more than twice the highest harmonic that is asked for


class SeriesReading(NamedTuple):
    """Coefficients of a sensor's output (mean, cos, sin, cos 2, sin 2, ...), c of them, and how they change."""

    value: Array
    """(n, c), m/s^2 or rad/s."""
    to_parameters: Array
    """(n, c, k)."""
    to_force: Array
    """(n, c, 3, 3), by the coefficients of the force: component, then mean, cosine, sine."""
    to_rate: Array
    """(n, c, 3, 3), by those of the rate."""


def basis(angle: Array, order: int) -> Array:
    """1, cos, sin, cos 2, sin 2, ... of angles.

    Parameters
    ----------
    angle : ndarray, shape (n,), rad
    order : int
        Highest harmonic.

    Returns
    -------
    ndarray, shape (n, 1 + 2 order)
    """
    out = np.ones((angle.size, 1 + 2 * order))
    if order:
        turn = np.exp(1j * angle)
        power = turn
        for h in range(1, order + 1):
            out[:, 2 * h - 1], out[:, 2 * h] = power.real, power.imag
            power = power * turn
    return out


@lru_cache(maxsize=4)
def _transforms(order: int) -> tuple[Array, Array, Array]:
    """From series of inputs to values at the points (3, p), from these to coefficients (p, c), and both in one (p, 3 c)."""
    angles = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
    to_values = basis(angles, 1).T
    to_series = basis(angles, order) * (2.0 / _POINTS)
    to_series[:, 0] /= 2.0
    both = (to_series[:, :, None] * to_values.T[:, None, :]).reshape(_POINTS, -1)
    return np.ascontiguousarray(to_values), to_series, both


def response(
    axis: Axis, x: Array, force: Array, rate: Array, order: int = 4, fixed: dict[str, float] | None = None
) -> SeriesReading:
    """Output of one sensor for inputs given as series, without truncation.

    Parameters
    ----------
    axis : Axis
    x : ndarray, shape (k,)
        Parameters in the order of ``axis.names``.
    force, rate : ndarray, shape (n, 3, 3), m/s^2 and rad/s
        Component, then mean, cosine, sine.
    order : int
        Highest harmonic wanted, at most 7.
    fixed : dict of str to float, optional
        See :meth:`Axis.evaluate`.

    Returns
    -------
    SeriesReading
        With c = 1 + 2 order.
    """
    if not 0 <= order < _POINTS // 2:
        raise ValueError(f"order is 0 to {_POINTS // 2 - 1}, not {order}")
    to_values, to_series, both = _transforms(order)
    n, c = len(force), 1 + 2 * order
    forces, rates = (np.moveaxis(v @ to_values, 1, 2).reshape(-1, 3) for v in (force, rate))
    said = axis.evaluate(x, forces, rates, fixed)
    slopes = [
        (np.moveaxis(v.reshape(n, _POINTS, 3), 1, 2) @ both).reshape(n, 3, c, 3).swapaxes(1, 2)
        for v in (said.to_force, said.to_rate)
    ]
    return SeriesReading(
        said.value.reshape(n, _POINTS) @ to_series,
        to_series.T @ said.to_parameters.reshape(n, _POINTS, len(x)),
        slopes[0],
        slopes[1],
    )
