"""Position along a course: direction cosines integrated to rounding, on panels, without singular places."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...earth import ELLIPSOID
from ...errors import InputError
from ...frames import Array
from .. import wander
from .panels import Rule, locate, rule, values
from .profile import Moment, Profile

if TYPE_CHECKING:
    from .course import Course, Sway

_NODES = 12
_NEAREST = math.cos(math.radians(89.9))
"""Cosine of the highest latitude of a rhumb line: nearer to a pole, headings change by degrees a second."""
_ROUNDS = 60
_PHASE = 1.5
"""rad: how far the track turns in a panel."""
_HEAVING = 6.0
"""rad: how far the heave goes on, whose share in the rate of w is some 1e-7."""
_TRAVEL = 0.3
"""How far a panel goes, in units of the distance from the Earth's centre, or for a rhumb line from its axis."""


class Track(NamedTuple):
    """How the vehicle goes over the Earth, in the wander frame, at times (n,)."""

    moment: Moment
    """With the heave."""
    sine: Array
    """Of the angle of the track from y_w, clockwise, (n,)."""
    cosine: Array
    turn: Array
    """Rate of that angle, (n,), rad/s."""
    velocity: Array
    """(n, 3), m/s."""
    rate: Array
    """Of w over the Earth, (n, 3), rad/s."""


@dataclass(frozen=True)
class Way:
    """Position along a course.

    Attributes
    ----------
    profile : Profile
    sway : Sway
    rhumb : bool
        Whether headings are against north; otherwise they are against the wander frame.
    edges : ndarray, shape (panels + 1,), s
    series : ndarray, shape (panels, k, 9)
        Legendre series of C_e_w, row by row.
    """

    profile: Profile
    sway: Sway
    rhumb: bool
    edges: Array
    series: Array

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, course: Course, nodes: int = _NODES) -> Way:
        """Integrate the position of a course.

        Parameters
        ----------
        course : Course
        nodes : int
            Of Gauss' rule on each panel.

        Raises
        ------
        InputError
            When the legs do not go together, or a rhumb line comes to a pole.
        """
        empty = np.zeros(0)
        way = cls(Profile.of(course), course.sway, course.path == "rhumb", empty, empty)
        edges, series = _integrated(way, wander.direction_cosines(course.latitude, course.longitude), rule(nodes))
        return replace(way, edges=edges, series=series)

    def cosines(self, time: Array) -> Array:
        """C_e_w at times (n,), (n, 3, 3)."""
        return values(self.series, *locate(self.edges, time)).reshape(-1, 3, 3)

    def axis(self, time: Array) -> Array:
        """The Earth's axis in w, the last column of C_e_w, (n, 3)."""
        return values(self.series[:, :, 2::3], *locate(self.edges, time))

    def track(self, time: Array, axis: Array) -> Track:
        """The way over the Earth.

        Parameters
        ----------
        time : ndarray, shape (n,), s
            Real or complex.
        axis : ndarray, shape (n, 3)
            The Earth's axis in w.
        """
        m = self.moment(time)
        sine, cosine, turn = np.sin(m.heading), np.cos(m.heading), m.turn
        C_e_w = np.broadcast_to(axis[:, :, None], (*axis.shape, 3))  # curvature is about its last column alone
        if self.rhumb:
            k1, _ = wander.curvature(C_e_w, m.height)
            level = np.sqrt(axis[:, 0] ** 2 + axis[:, 1] ** 2)  # cos L
            to_east = m.speed * sine
            s, c = axis[:, 0] / level, axis[:, 1] / level  # north is the wander angle clockwise of y_w
            sine, cosine = sine * c + cosine * s, cosine * c - sine * s
            turn = turn - k1 * to_east * axis[:, 2] / level
        velocity = np.stack([m.speed * sine, m.speed * cosine, m.climb], axis=-1)
        return Track(m, sine, cosine, turn, velocity, wander.transport_rate(C_e_w, velocity, m.height))

    def moment(self, time: Array) -> Moment:
        """The profile with the heave."""
        m, heave = self.profile.at(time), self.sway.heave
        if heave == 0.0:
            return m
        w = 2.0 * math.pi / self.sway.heave_period
        up, rise = (
            heave * np.sin(w * time + self.sway.heave_phase),
            heave * w * np.cos(w * time + self.sway.heave_phase),
        )
        return m._replace(height=m.height + up, climb=m.climb + rise, climb_slope=m.climb_slope - w * w * up)


def _integrated(way: Way, start: Array, gauss: Rule) -> tuple[Array, Array]:
    """Edges of the panels, and the series on them."""
    breaks, names = way.profile.breaks, way.profile.names
    _refuse_pole(way, start, names[0], 0.0)
    C, edges = start, [float(breaks[0])]
    panels = [_panel(way, gauss, edges[0], -edges[0], C, back=True)]  # before the start
    for i, name in enumerate(names[1:], start=1):
        now, end = float(breaks[i]), float(breaks[i + 1])
        while now < end:
            count = math.ceil((end - now) / _longest(way, i, C))
            length = (end - now) / count
            edges.append(now)
            panels.append(_panel(way, gauss, now, length, C))
            C = _orthonormal(panels[-1].sum(axis=0).reshape(3, 3))  # all Legendre polynomials are 1 at the end
            _refuse_pole(way, C, name, now)
            now = end if count == 1 else now + length
    return np.array([*edges, breaks[-1]]), np.stack(panels)


def _longest(way: Way, piece: int, C_e_w: Array) -> float:
    """How long a panel may be that begins in a piece at a place."""
    profile, sway = way.profile, way.sway
    length = float(profile.breaks[piece + 1] - profile.breaks[piece])
    ends = profile.at(profile.breaks[piece] + np.array([1e-9, 0.5, 1.0 - 1e-9]) * length)
    turn, speed = float(np.abs(ends.turn).max()), float(ends.speed.max())
    limits = [length / 2.0 if profile.easing[piece] else length]
    if turn > 0.0:
        limits.append(_PHASE / turn)
    if sway.heave > 0.0:
        limits.append(_HEAVING * sway.heave_period / (2.0 * math.pi))
    if speed > 0.0:
        away = float(np.hypot(C_e_w[0, 2], C_e_w[1, 2])) if way.rhumb else 1.0
        limits.append(_TRAVEL * away * float(ELLIPSOID[0]) / speed)
    return min(limits)


def _panel(way: Way, gauss: Rule, begin: float, length: float, C_e_w: Array, *, back: bool = False) -> Array:
    """Series of C_e_w on a panel, (k, 9), given its value at the beginning, or with `back` at the end; Picard's iteration."""
    time = begin + 0.5 * length * (gauss.nodes + 1.0)
    vander = np.polynomial.legendre.legvander(gauss.nodes, gauss.nodes.size)
    now = np.broadcast_to(C_e_w.ravel(), (time.size, 9))
    for _ in range(_ROUNDS):
        C = now.reshape(-1, 3, 3)
        a, b, _z = way.track(time, C[:, :, 2]).rate.T[:, :, None]
        # -[w x] C with w = (a, b, 0)
        slope = np.stack([-b * C[:, 2], a * C[:, 2], b * C[:, 0] - a * C[:, 1]], axis=1).reshape(-1, 9)
        series = 0.5 * length * (gauss.integral @ slope)
        series[0] += C_e_w.ravel() - (series.sum(axis=0) if back else 0.0)
        before, now = now, vander @ series
        if np.abs(now - before).max() < 4.0 * np.finfo(float).eps:
            break
    return np.asarray(series)


def _orthonormal(C: Array) -> Array:
    """The nearest rotation to one that is off by rounding."""
    return np.asarray(1.5 * C - 0.5 * C @ C.T @ C)


def _refuse_pole(way: Way, C_e_w: Array, leg: str, time: float) -> None:
    if way.rhumb and np.hypot(C_e_w[0, 2], C_e_w[1, 2]) < _NEAREST:
        raise InputError(
            f"trajectory.{leg}: after {time:g} s the course comes within 0.1 deg of a pole, where headings against north lose "
            'their sense; write path = "great-circle"'
        )
