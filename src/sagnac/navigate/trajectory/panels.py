"""Smooth functions of time as Legendre series on panels, through the nodes of Gauss' rule, and their integrals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ...frames import Array

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Rule:
    """Gauss' rule on [-1, 1].

    Attributes
    ----------
    nodes : ndarray, shape (k,)
    integral : ndarray, shape (k + 1, k)
        Takes values at the nodes to the Legendre series of the integral of their interpolating polynomial from -1 on.
    """

    nodes: Array
    integral: Array


@lru_cache
def rule(count: int) -> Rule:
    """Gauss' rule with `count` nodes."""
    nodes, weights = legendre.leggauss(count)
    degree = np.arange(count)
    # orthogonality of the Legendre polynomials, which the rule integrates exactly up to degree 2 count - 1
    series = (degree + 0.5)[:, None] * legendre.legvander(nodes, count - 1).T * weights
    return Rule(nodes, np.asarray(legendre.legint(series, lbnd=-1, axis=0)))


def divided(breaks: Array, longest: Array) -> Array:
    """Edges of panels of equal length between breaks.

    Parameters
    ----------
    breaks : ndarray, shape (p + 1,), increasing
    longest : ndarray, shape (p,)
        How long a panel between two breaks may be.

    Returns
    -------
    ndarray, shape (panels + 1,)
    """
    length = np.diff(breaks)
    counts = np.maximum(np.ceil(length / longest * (1.0 - 1e-12)), 1.0).astype(np.int64)
    piece = np.repeat(np.arange(length.size), counts)
    within = np.arange(piece.size) - (np.cumsum(counts) - counts)[piece]
    return np.append(breaks[piece] + within * (length / counts)[piece], breaks[-1])


def locate(edges: Array, time: Array) -> tuple[Indices, Array]:
    """Panel of each time, int (n,), and where in it the time lies, from -1 to 1; an edge belongs to the panel that begins there.

    The first and the last panel hold before and after them, too. Of complex times the real part says which panel it is.
    """
    panel = np.searchsorted(edges, time.real, side="right") - 1
    panel = np.clip(panel, 0, edges.size - 2).astype(np.int64, copy=False)
    half = 0.5 * (edges[panel + 1] - edges[panel])
    return panel, (time - edges[panel]) / half - 1.0


def values(series: Array, panel: Indices, x: Array) -> Array:
    """Sum of Legendre series.

    Parameters
    ----------
    series : ndarray, shape (panels, k, m)
        Coefficients, that of degree 0 first.
    panel : ndarray of int, shape (n,)
    x : ndarray, shape (n,)
        From -1 to 1, real or complex.

    Returns
    -------
    ndarray, shape (n, m)
        The same for an instant whatever others are asked for at the same time.
    """
    order = None
    if panel.size and np.any(panel[1:] < panel[:-1]):
        order = np.argsort(panel, kind="stable")
        panel, x = panel[order], x[order]
    count = series.shape[1]
    basis = np.empty((count, x.size), dtype=x.dtype)
    basis[0] = 1.0
    basis[1] = x
    for j in range(1, count - 1):
        basis[j + 1] = ((2 * j + 1) * x * basis[j] - j * basis[j - 1]) / (j + 1)
    out = np.empty((x.size, series.shape[2]), dtype=x.dtype)
    ends = np.flatnonzero(np.diff(panel, append=-1)) + 1
    first = 0
    for last in ends.tolist():
        # not a product of matrices: how BLAS adds up depends on how many rows there are
        np.einsum("kn,km->nm", basis[:, first:last], series[panel[first]], out=out[first:last])
        first = last
    if order is None:
        return out
    back = np.empty_like(out)
    back[order] = out
    return back
