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
        known beforehand (``S' W S`` with ``P(0) = S S'``): a direction with gain g is known to ``1 / sqrt(1 + g)`` of its first
        standard deviation, as far as the noise that drives the states allows. From the best seen to the least.
    directions : ndarray, shape (r, n)
        What each of them is: changes of the states in units of their first standard deviations.
    times : ndarray, shape (j,), s
    over_time : ndarray, shape (j, r)
        The gains at these times, each time from the largest to the least.
    """

    names: tuple[str, ...]
    ratio: Array
    gains: Array
    directions: Array
    times: Array
    over_time: Array

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


class Observer:
    """Gathers the Gramian along a run.

    Parameters
    ----------
    first : ndarray, shape (n, n)
        Covariance at the start.
    names : sequence of str, length n
    """

    def __init__(self, first: Array, names: Sequence[str]) -> None:
        self._first, self._names = first.copy(), tuple(names)
        sigma = np.sqrt(np.diag(first))
        self._scale = np.where(sigma > 0, sigma, 1.0)
        values, vectors = np.linalg.eigh(first / np.outer(self._scale, self._scale))
        kept = values > 1e-9 * values[-1]  # copies of others, and what is known exactly, are no directions of their own
        self._root = vectors[:, kept] * np.sqrt(values[kept])
        self.transition, self.gramian = np.eye(sigma.size), np.zeros_like(first)
        self._times: list[float] = []
        self._looks: list[Array] = []

    def advance(self, transition: Array) -> None:
        """Go on by a transition matrix, (n, n)."""
        self.transition = transition @ self.transition

    def see(self, H: Array, R: Array) -> None:
        """Take in measurements with matrix H, (k, n), and variances R, (k,)."""
        seen = (H @ self.transition) / np.sqrt(R)[:, None]
        self.gramian += seen.T @ seen

    def _weighed(self) -> Array:
        whole = self._root * self._scale[:, None]
        return np.asarray(whole.T @ self.gramian @ whole)

    def look(self, time: float) -> None:
        """Note what is seen by now."""
        self._times.append(time)
        self._looks.append(np.maximum(np.linalg.eigvalsh(self._weighed())[::-1], 0.0))

    def result(self, last: Array) -> Observability:
        """What was seen, given the covariance at the end, (n, n)."""
        gains, turned = np.linalg.eigh(self._weighed())
        sigma = np.sqrt(np.diag(self._first))
        ratio = np.sqrt(np.maximum(np.diag(last), 0.0)) / np.where(sigma > 0, sigma, np.nan)
        looks = np.stack(self._looks) if self._looks else np.zeros((0, gains.size))
        return Observability(
            self._names,
            ratio,
            np.maximum(gains[::-1], 0.0),
            (self._root @ turned).T[::-1],
            np.array(self._times),
            looks,
        )
