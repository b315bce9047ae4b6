"""Sums over many integers from few nodes.

A function that is smooth but for kinks at known places is summed in panels that double away from the kinks, each by the Gauss
rule of its own integers: the rule that is exact for *sums* of polynomials over that many equidistant points (orthogonal
polynomials of Chebyshev, also Gram). No panel takes a sum for an integral.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...frames import Array

_NODES = 8
"""Of a panel: exact for polynomials up to degree 15."""


def graded(start: int, length: int, smallest: int = _NODES, *, both: bool = False) -> tuple[Array, Array]:
    """Nodes and weights of a sum over `length` integers from `start` on, in panels that double.

    Parameters
    ----------
    start, length : int
    smallest : int
        Integers in the first panel.
    both : bool
        Whether there is a kink at the end as well.
    """
    return gauss(panels_between(start, length, 1, both=both, smallest=smallest), 1)


def panels_between(start: int, length: int, step: int, *, both: bool, smallest: int = _NODES) -> list[tuple[int, int]]:
    """Panels (first point, number of points), doubling away from the beginning, and from the end where that is a kink.

    Parameters
    ----------
    start, length : int
        First point, and number of points.
    step : int
        From one point to the next.
    both : bool
        Whether there is a kink at the end.
    smallest : int
        Points in the first panel.
    """
    left: list[int] = []
    right: list[int] = []
    size, rest = smallest, length
    while rest > 0:
        for side in (left, right) if both else (left,):
            take = min(size, rest)
            side.append(take)
            rest -= take
        size *= 2
    out = []
    for take in (*left, *reversed(right)):
        if take:
            out.append((start, take))
            start += step * take
    return out


def gauss(panels: list[tuple[int, int]], step: int) -> tuple[Array, Array]:
    """Points and weights of panels.

    Parameters
    ----------
    panels : list of (int, int)
        First point and number of points of each.
    step : int
        From one point to the next.
    """
    lags, weights = [], []
    for start, length in panels:
        x, w = rule(length)
        lags.append(start + step * x)
        weights.append(w)
    return np.concatenate(lags), np.concatenate(weights)


@lru_cache(maxsize=8192)
def rule(length: int) -> tuple[Array, Array]:
    """Gauss rule of the sum over 0, 1, ..., length - 1: nodes and weights, the points themselves if they are few.

    The recurrence of the orthogonal polynomials is beta_k = k^2 (L^2 - k^2) / (4 (4 k^2 - 1)) (discrete Chebyshev, Gautschi
    2004, section 1.5); nodes are the eigenvalues of the Jacobi matrix (Golub & Welsch 1969).
    """
    if length <= _NODES:
        return np.arange(float(length)), np.ones(length)
    k = np.arange(1.0, _NODES)
    off = 0.5 * np.sqrt(k**2 * (1.0 - (k / length) ** 2) / (4.0 * k**2 - 1.0))  # in units of the length
    values, vectors = np.linalg.eigh(np.diag(off, 1) + np.diag(off, -1))
    return np.asarray(0.5 * (length - 1) + length * values), np.asarray(length * vectors[0] ** 2)
