"""Speed, heading and height of a course as functions of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from ...frames import Array
from .legs import MARGIN, parts

if TYPE_CHECKING:
    from .course import Course


class Moment(NamedTuple):
    """What a profile is at some times, (n,) each: m, s, rad."""

    speed: Array
    """Over the ground."""
    acceleration: Array
    heading: Array
    """Of the track."""
    turn: Array
    """Its rate."""
    turn_slope: Array
    """Rate of change of `turn`."""
    climb: Array
    """Vertical speed."""
    climb_slope: Array
    height: Array


@dataclass(frozen=True)
class Profile:
    """Polynomials in the time since the start of each piece, constant terms first.

    Attributes
    ----------
    breaks : ndarray, shape (p + 1,), s
        Where the pieces begin, and the end of the last. The first and the last are those of
        :data:`sagnac.navigate.trajectory.legs.MARGIN`.
    speed, heading, turn, climb, height : ndarray, shape (degree + 1, p)
    easing : ndarray of bool, shape (p,)
        Whether something comes in.
    names : tuple of str
        Key of the leg that each piece belongs to.
    """

    breaks: Array
    speed: Array
    heading: Array
    turn: Array
    climb: Array
    height: Array
    easing: NDArray[np.bool_]
    names: tuple[str, ...]

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, course: Course) -> Profile:
        """Profile of a course.

        Raises
        ------
        InputError
            With the leg at fault, when the legs do not go together.
        """
        pieces = parts(course)
        columns = {k: _padded([getattr(p, k) for p in pieces]) for k in ("speed", "heading", "turn", "climb", "height")}
        return cls(
            breaks=np.array([-MARGIN, *(p.end for p in pieces)]),
            easing=np.array([p.easing for p in pieces]),
            names=tuple(p.name for p in pieces),
            **columns,
        )

    def at(self, time: Array) -> Moment:
        """The profile at times (n,), real or complex, in any order."""
        piece = np.searchsorted(self.breaks, time.real, side="right") - 1
        piece = np.clip(piece, 0, self.breaks.size - 2)
        t = time - self.breaks[piece]
        speed, acceleration = _horner(self.speed, piece, t)
        turn, turn_slope = _horner(self.turn, piece, t)
        climb, climb_slope = _horner(self.climb, piece, t)
        heading, _ = _horner(self.heading, piece, t)
        height, _ = _horner(self.height, piece, t)
        return Moment(speed, acceleration, heading, turn, turn_slope, climb, climb_slope, height)


def _horner(coefficients: Array, piece: NDArray[Any], t: Array) -> tuple[Array, Array]:
    """Values and derivatives, (n,), of polynomials."""
    value, slope = coefficients[-1].take(piece).astype(t.dtype), np.zeros_like(t)
    for row in coefficients[-2::-1]:
        slope = slope * t + value
        value = value * t + row.take(piece)
    return value, slope


def _padded(polynomials: list[Polynomial]) -> Array:
    """Coefficients of polynomials as columns."""
    degree = max(p.coef.size for p in polynomials)
    out = np.zeros((degree, len(polynomials)))
    for i, p in enumerate(polynomials):
        out[: p.coef.size, i] = p.coef
    return out
