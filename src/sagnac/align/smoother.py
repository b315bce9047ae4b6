"""The same alignment with all its data at every time: Rauch-Tung-Striebel smoothing of a filter that feeds back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..frames import Array


@dataclass(frozen=True)
class Passed:
    """What the smoother needs of one interval and the update at its end.

    Attributes
    ----------
    transition : ndarray, shape (n, n)
    predicted, updated : ndarray, shape (n, n)
        Covariances before and after the update.
    correction : ndarray, shape (n,)
        Mean after the update less the prediction: what was fed back, or would have been.
    """

    transition: Array
    predicted: Array
    updated: Array
    correction: Array


def smooth(first: Array, passed: list[Passed]) -> tuple[Array, Array]:
    """Corrections to the filter's results by what came later.

    With feedback the mean at each update is zero and the prediction of the next one too, so that what the next update and all
    later ones
    found is its correction and theirs: ``d_k = G_k (c_(k+1) + d_(k+1))``, ``G_k = P_k T' P_(k+1|k)^-1``
    (Rauch, Tung & Striebel 1965, AIAA Journal 3, equation 3.28).

    Parameters
    ----------
    first : ndarray, shape (n, n)
        Covariance at the start.
    passed : list of Passed
        In order of time.

    Returns
    -------
    corrections, sigmas : ndarray, shape (m, n)
        To be added to the estimate after each update, and the standard deviations of the sum.
    """
    count, n = len(passed), first.shape[0]
    corrections, sigmas = np.zeros((count, n)), np.empty((count, n))
    covariance = passed[-1].updated
    sigmas[-1] = np.sqrt(np.diag(covariance))
    for k in range(count - 2, -1, -1):
        later, now = passed[k + 1], passed[k]
        gain = _gain(now.updated, later.transition, later.predicted)
        corrections[k] = gain @ (later.correction + corrections[k + 1])
        covariance = now.updated + gain @ (covariance - later.predicted) @ gain.T
        covariance = 0.5 * (covariance + covariance.T)
        sigmas[k] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return corrections, sigmas


def _gain(updated: Array, transition: Array, predicted: Array) -> Array:
    """``P T' P_next^-1``; the mounting copies the attitude at first, so that the matrix may be singular."""
    scale = np.sqrt(np.diag(predicted))
    scale = np.where(scale > 0, scale, 1.0)
    inverse = np.linalg.pinv(predicted / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    return np.asarray((updated @ transition.T / scale) @ inverse / scale)
