"""The same alignment with all its data at every time: Rauch-Tung-Striebel smoothing of a filter that feeds back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..frames import Array, left_jacobian, rotation_matrix, rotation_vector
from .model import turn_errors


@dataclass(frozen=True)
class Passed:
    """What the smoother needs of one interval and the update at its end.

    Attributes
    ----------
    transition : ndarray, shape (n, n)
    predicted, updated : ndarray, shape (n, n)
        Covariances before and after the update (and the feedback).
    mean, estimate : ndarray, shape (n,)
        Of the errors of the values in use, before and after the update.
    fed_back : bool
        Whether the estimate was then taken out of them.
    """

    transition: Array
    predicted: Array
    updated: Array
    mean: Array
    estimate: Array
    fed_back: bool


def smooth(passed: list[Passed], attitude: slice, mounting: slice) -> tuple[Array, Array]:
    """Corrections to the filter's results by what came later.

    With e the errors that all data find, against the values in use before the feedback, ``d_k = G_k (e_(k+1) - m_(k+1))``,
    ``G_k = P_k T' P_(k+1|k)^-1`` (Rauch, Tung & Striebel 1965, AIAA Journal 3, equation 3.28), m the predicted mean. After a
    feedback x the rest d is told against new values: ``e = x + d`` for what adds, ``exp(e) = exp(d) exp(x)`` for the attitude and
    ``exp(e) = exp(x) exp(d)`` for the mounting.

    Parameters
    ----------
    passed : list of Passed
        In order of time.
    attitude, mounting : slice
        Where they are in the states.

    Returns
    -------
    corrections, sigmas : ndarray, shape (m, n)
        What is to be added to the estimate after each update (see :func:`added`), and the standard deviations of the sum.
    """
    count, n = len(passed), passed[0].mean.size
    corrections, sigmas = np.zeros((count, n)), np.empty((count, n))
    covariance = passed[-1].updated
    sigmas[-1] = np.sqrt(np.diag(covariance))
    for k in range(count - 2, -1, -1):
        later, now = passed[k + 1], passed[k]
        gain = _gain(now.updated, later.transition, later.predicted)
        if later.fed_back:
            found = added(later.estimate, corrections[k + 1], attitude, mounting)
            covariance = _turned_back(covariance, later.estimate, attitude, mounting)
        else:
            found = later.estimate + corrections[k + 1]
        corrections[k] = gain @ (found - later.mean)
        covariance = now.updated + gain @ (covariance - later.predicted) @ gain.T
        covariance = 0.5 * (covariance + covariance.T)
        sigmas[k] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return corrections, sigmas


def added(first: Array, then: Array, attitude: slice, mounting: slice) -> Array:
    """Two corrections one after the other, (n,) each: sums, but for the rotations."""
    out = first + then
    for where, one, other in ((attitude, then, first), (mounting, first, then)):
        if out[where].size:
            out[where] = rotation_vector(rotation_matrix(one[where]) @ rotation_matrix(other[where]))
    return np.asarray(out)


def _turned_back(covariance: Array, x: Array, attitude: slice, mounting: slice) -> Array:
    """Covariance of errors against the values before a feedback, given that against the values after it."""
    out = covariance.copy()
    for where, turned in ((attitude, x[attitude]), (mounting, -x[mounting])):
        if turned.size:
            turn_errors(out, where, np.asarray(np.linalg.inv(left_jacobian(turned))))
    return out


def _gain(updated: Array, transition: Array, predicted: Array) -> Array:
    """``P T' P_next^-1``; the mounting copies the attitude at first, so that the matrix may be singular."""
    scale = np.sqrt(np.diag(predicted))
    scale = np.where(scale > 0, scale, 1.0)
    inverse = np.linalg.pinv(predicted / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    return np.asarray((updated @ transition.T / scale) @ inverse / scale)
