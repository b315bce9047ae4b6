"""What the measurements of an alignment see of its states, and what they leave as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..frames import Array


@dataclass(frozen=True)
class Observability:
    """What was seen of the errors at the start.

    Attributes
    ----------
    names : tuple of str, length n
    ratio : ndarray, shape (n,)
        Standard deviation at the end over that at the start; NaN where there was none at the start.
    gains : ndarray, shape (r,)
        Singular values of the Gramian ``sum (H T)' R^-1 (H T)``, with T the transition from the start, in units of what is
        known
        beforehand (``S' W S`` with ``P(0) = S S'``): a direction with gain g is known to ``1 / sqrt(1 + g)`` of its first
        standard
        deviation, as far as the noise that drives the states allows. From the best seen to the least.
    directions : ndarray, shape (r, n)
        What each of them is: changes of the states in units of their first standard deviations.
    """

    names: tuple[str, ...]
    ratio: Array
    gains: Array
    directions: Array

    def unseen(self, gain: float = 1.0) -> list[str]:
        """Directions of less than this gain in words: the states that move together."""
        out = []
        for g, direction in zip(self.gains, self.directions, strict=True):
            if g < gain:
                strong = np.argsort(-np.abs(direction))
                largest = np.abs(direction[strong[0]])
                parts = [i for i in strong if np.abs(direction[i]) > 0.3 * largest]
                sign = np.sign(direction[strong[0]])
                out.append(
                    " ".join(
                        ("+ " if sign * direction[i] > 0 else "- ") + f"{abs(direction[i]):.2f} {self.names[i]}"
                        for i in parts
                    ).removeprefix("+ ")
                )
        return out


def directions(first: Array, gramian: Array, names: Sequence[str], last: Array) -> Observability:
    """Singular values and directions of a Gramian, weighed with what was known at the start.

    Parameters
    ----------
    first, last : ndarray, shape (n, n)
        Covariance at the start and at the end.
    gramian : ndarray, shape (n, n)
        Of the states at the start.
    names : sequence of str, length n
    """
    sigma = np.sqrt(np.diag(first))
    scale = np.where(sigma > 0, sigma, 1.0)
    values, vectors = np.linalg.eigh(first / np.outer(scale, scale))
    kept = values > 1e-9 * values[-1]
    root = vectors[:, kept] * np.sqrt(values[kept])
    whole = root * scale[:, None]
    gains, turned = np.linalg.eigh(whole.T @ gramian @ whole)
    ratio = np.sqrt(np.maximum(np.diag(last), 0.0)) / np.where(sigma > 0, sigma, np.nan)
    return Observability(tuple(names), ratio, np.maximum(gains[::-1], 0.0), (root @ turned).T[::-1])


class Observer:
    """Gathers the Gramian along a run.

    Parameters
    ----------
    first : ndarray, shape (n, n)
        Covariance at the start.
    names : sequence of str, length n
    """

    def __init__(self, first: Array, names: Sequence[str]) -> None:
        self._first, self._names = first.copy(), names
        self._transition = np.eye(len(names))
        self._gramian = np.zeros_like(first)

    def advance(self, transition: Array) -> None:
        """Go on by a transition matrix, (n, n)."""
        self._transition = transition @ self._transition

    def see(self, H: Array, R: Array) -> None:
        """Take in measurements with matrix H, (k, n), and variances R, (k,)."""
        seen = (H @ self._transition) / np.sqrt(R)[:, None]
        self._gramian += seen.T @ seen

    def result(self, last: Array) -> Observability:
        """What was seen, given the covariance at the end."""
        return directions(self._first, self._gramian, self._names, last)
