"""The true motion along a course: attitude, velocity and position, and what ideal sensors feel.

Speed, heading and climb of the track are analytic in time, and so are pitch and roll; position follows from them by integration
of C_e_w to rounding. The specific force and the angular rate are those of the navigation equations themselves, turned round::

    f = dv/dt + (2 w_ie + w_ew) x v + g,   w_ib = w_ie + w_ew + w_wb

in the wander frame, with v of known direction and size, so that ideal sensors integrate back to the truth. Their integrals over
sample intervals are those of interpolating polynomials on panels that end where a leg does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...earth import EARTH_RATE, gravity_by_sine, normal_gravity
from ...errors import InputError
from ...frames import Array, attitude_matrix, cross, transform
from ..state import State
from .body import Body, angles
from .carried import RIGID, Carried, Flexure, beside, swung
from .course import Course
from .panels import divided, locate, rule, values
from .way import Track, Way

PIECE = 1 << 14
"""Samples computed at a time: what bounds the memory."""
_NODES = 16
_BLOCK = 512
"""Panels computed at a time, so that what is computed for them stays in the cache."""
_MOST_PANELS = 1 << 13
_STEP = 1e-9
"""rad/s: of the body's rate, beyond rounding."""
_LONGEST = 1.0
"""s: of a panel; what it feels over longer ones would cost digits of the single increments."""


class Increments(NamedTuple):
    """What ideal sensors count over the intervals between instants."""

    time: Array
    """(n + 1,), s: the first instant, then the end of each interval."""
    turns: Array
    """(n, 3), rad: integral of the angular rate of the body."""
    pushes: Array
    """(n, 3), m/s: integral of the specific force."""

    @property
    def steps(self) -> Array:
        """Length of each interval, (n,), s."""
        return np.diff(self.time)


@dataclass(frozen=True)
class Trajectory:
    """The true motion along a course; see :meth:`of` and :meth:`carry`.

    Attributes
    ----------
    course : Course
    way : Way
        The position along it.
    earth_rate : float, rad/s
    gravity_excess : float, m/s^2
        Real gravity less the normal one.
    unit : Carried
        Where on the vehicle the unit sits whose motion this is.
    nodes : int
        Of each panel on which force and rate are integrated.
    """

    course: Course
    way: Way
    earth_rate: float = EARTH_RATE
    gravity_excess: float = 0.0
    unit: Carried = RIGID
    nodes: int = _NODES

    @classmethod
    def of(cls, course: Course, *, earth_rate: float = EARTH_RATE, gravity_excess: float = 0.0) -> Trajectory:
        """The motion of the vehicle itself.

        Parameters
        ----------
        course : Course
        earth_rate : float, rad/s
        gravity_excess : float, m/s^2
            Real gravity less the normal one.

        Raises
        ------
        InputError
            When the legs do not go together, or a rhumb line comes to a pole; the leg is named.
        """
        return cls(course, Way.of(course), earth_rate, gravity_excess)

    @property
    def duration(self) -> float:
        """Time of all legs, s."""
        return float(self.way.profile.breaks[-2])

    def carry(
        self, *, lever_arm: ArrayLike = (0.0, 0.0, 0.0), mounting: Array | None = None, flexure: Flexure | None = None
    ) -> Trajectory:
        """The motion of a unit on the vehicle.

        Parameters
        ----------
        lever_arm : array_like, shape (3,), m
            From the vehicle's own point to the unit, in the vehicle's axes.
        mounting : ndarray, shape (3, 3), optional
            C_s_m: takes the unit's coordinates to those of the vehicle.
        flexure : Flexure, optional

        Raises
        ------
        InputError
            When there is a lever arm and a leg begins with a step in the body's rate: the unit's velocity would step.
        """
        turned = np.eye(3) if mounting is None else np.asarray(mounting, dtype=float)
        carried = replace(self, unit=Carried(np.asarray(lever_arm, dtype=float), turned, flexure))
        if carried.unit.aside:
            _refuse_steps(carried)
        return carried

    # ------------------------------------------------------------------------------------------------ at instants

    def state(self, time: ArrayLike) -> State:
        """True attitude, velocity and position.

        Parameters
        ----------
        time : array_like, shape (...), s
            In any order, from 10 s before the start to 10 s after the end.

        Returns
        -------
        State
            Of arrays with the leading shape of `time`. The wander angle is zero where the course starts, and w turns over the
            Earth without any rate about the vertical, whatever the path. That of a unit with a lever arm is the vehicle's,
            carried over by the shortest way.
        """
        given = np.asarray(time, dtype=float)
        t = self._checked(given.reshape(-1))
        C_e_w = self.way.cosines(t)
        track = self.way.track(t, C_e_w[:, :, 2])
        yaw, pitch, roll = angles(self.course, self.way, self._gravity, t)
        C_b_w = attitude_matrix(np.arctan2(track.sine, track.cosine) + yaw.angle, pitch.angle, roll.angle)
        velocity, height = track.velocity, track.moment.height
        if self.unit.aside:
            arm = self.unit.lever_arm
            turned, height = beside(C_e_w, height, C_b_w @ arm)
            swing = transform(C_b_w, cross(self._over_earth(t, track)[1], arm))
            velocity = transform(turned, velocity + swing)
            C_e_w, C_b_w = turned @ C_e_w, turned @ C_b_w
        if self.unit.turned:
            C_b_w = C_b_w @ self.unit.attitude(t)
        lead = given.shape
        return State(
            C_b_w.reshape(*lead, 3, 3), velocity.reshape(*lead, 3), C_e_w.reshape(*lead, 3, 3), height.reshape(lead)
        )

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """What ideal sensors feel at instants.

        Parameters
        ----------
        time : ndarray, shape (n,), s
            In any order. Where a leg begins at once, an instant between two legs has the mean of both.

        Returns
        -------
        force, rate : ndarray, shape (n, 3), m/s^2 and rad/s
            Specific force and angular rate in the axes of the unit.
        """
        t = self._checked(np.asarray(time, dtype=float))
        force, rate = np.empty((t.size, 3)), np.empty((t.size, 3))
        for first in range(0, t.size, PIECE):
            at = slice(first, first + PIECE)
            force[at], rate[at] = self._instants(t[at])
        return force, rate

    def _instants(self, t: Array) -> tuple[Array, Array]:
        breaks, aside = self.way.profile.breaks, 4.0 * np.spacing(np.abs(t))
        near = np.clip(np.searchsorted(breaks, t), 1, breaks.size - 1)
        between = np.minimum(np.abs(t - breaks[near]), np.abs(t - breaks[near - 1])) <= aside
        force, rate = self._felt(np.where(between, t + 2.0 * aside, t))
        if between.any():
            before = self._felt((t - 2.0 * aside)[between])
            force[between] = 0.5 * (force[between] + before[0])
            rate[between] = 0.5 * (rate[between] + before[1])
        return force, rate

    # ---------------------------------------------------------------------------------------------- over intervals

    def increments(self, sampling: float | Array) -> Increments:
        """What ideal sensors count over sample intervals: integrals to rounding.

        Parameters
        ----------
        sampling : float or ndarray, shape (n + 1,)
            A frequency, Hz, for the intervals between ``k / frequency`` from the start to the end of the course; or the
            instants, s, in increasing order.
        """
        if np.ndim(sampling) == 0:
            frequency = float(sampling)
            parts = list(self.stream(frequency))
            time = np.arange(self._count(frequency) + 1) / frequency
            return Increments(time, *(np.concatenate([getattr(p, k) for p in parts]) for k in ("turns", "pushes")))
        time = self._checked(np.asarray(sampling, dtype=float))
        if time.size < 2 or np.any(np.diff(time) <= 0.0):
            raise ValueError("instants must increase, and there must be two of them")
        turns, pushes = np.empty((time.size - 1, 3)), np.empty((time.size - 1, 3))
        for first, last in self._blocks(time):
            rates = self._integrals(time[first : last + 1])
            pushes[first:last], turns[first:last] = rates[:, :3], rates[:, 3:]
        return Increments(time, turns, pushes)

    def stream(self, frequency: float, piece: int = PIECE) -> Iterator[Increments]:
        """The same piece by piece, for courses of any length; each piece begins with the last instant of the one before.

        Parameters
        ----------
        frequency : float, Hz
        piece : int
            Intervals at a time; the increments do not depend on it.
        """
        count = self._count(frequency)
        for first in range(0, count, piece):
            yield self.increments(np.arange(first, min(first + piece, count) + 1) / frequency)

    def _count(self, frequency: float) -> int:
        count = math.floor(self.duration * frequency * (1.0 + 1e-15))
        if count < 1:
            raise ValueError(f"{frequency:g} Hz in {self.duration:g} s: no interval")
        return count

    @cached_property
    def _edges(self) -> Array:
        """Edges of the panels of force and rate, which break where a leg does."""
        breaks, longest = _panels(self)
        return divided(breaks, longest)

    def _blocks(self, time: Array) -> Iterator[tuple[int, int]]:
        """First and last instant of parts with not too many intervals, nor too many panels."""
        panel, _ = locate(self._edges, time)
        first = 0
        while first < time.size - 1:
            far = int(np.searchsorted(panel, panel[first] + _MOST_PANELS, side="right")) - 1
            last = min(max(far, first + 1), first + PIECE, time.size - 1)
            yield first, last
            first = last

    def _integrals(self, time: Array) -> Array:
        """Integrals of force and rate between instants (n + 1,), (n, 6)."""
        panel, x = locate(self._edges, time)
        begin, end = int(panel[0]), int(panel[-1]) + 1
        series = np.concatenate([self._series(i, min(i + _BLOCK, end)) for i in range(begin, end, _BLOCK)])
        panel = panel - begin
        since = values(series, panel, x)  # the beginning of the panel
        out = np.diff(since, axis=0)
        whole = series.sum(axis=1)  # all Legendre polynomials are 1 at the end
        over = np.flatnonzero(np.diff(panel))
        if over.size:
            pairs = np.stack([panel[over], panel[over + 1]], axis=1).ravel()
            out[over] += np.add.reduceat(np.concatenate([whole, np.zeros((1, 6))]), pairs, axis=0)[::2]
        return out

    def _series(self, begin: int, end: int) -> Array:
        """Legendre series of the integrals of force and rate from the beginning of each panel, (panels, k, 6)."""
        gauss, edges = rule(self.nodes), self._edges[begin : end + 1]
        half = 0.5 * np.diff(edges)
        time = edges[:-1, None] + half[:, None] * (gauss.nodes + 1.0)
        both = np.concatenate(self._felt(time.ravel()), axis=1).reshape(*time.shape, 6)
        return np.asarray(gauss.integral @ both * half[:, None, None])

    # ------------------------------------------------------------------------------------------------ the equations

    def _checked(self, time: Array) -> Array:
        first, last = self.way.profile.breaks[[0, -1]]
        if time.size and not (time.min() >= first and time.max() <= last):
            raise ValueError(
                f"times from {time.min():g} s to {time.max():g} s; this course is known from {first:g} s to {last:g} s"
            )
        return time

    @cached_property
    def _gravity(self) -> float:
        """Gravity at the start, m/s^2, against which a coordinated bank leans."""
        return normal_gravity(self.course.latitude, self.course.height) + self.gravity_excess

    def _over_earth(self, time: Array, track: Track) -> tuple[Body, Array]:
        """The body's axes, and its rate over the Earth in them, (n, 3)."""
        body = Body.of(track, *angles(self.course, self.way, self._gravity, time))
        return body, body.seen(track.rate) + body.rate()

    def _felt(self, time: Array) -> tuple[Array, Array]:
        """Specific force and angular rate, (n, 3) each."""
        unit = self.unit
        cosines = self.way.cosines(time) if unit.aside else None
        axis = self.way.axis(time) if cosines is None else cosines[:, :, 2]
        track = self.way.track(time, axis)
        body, rate = self._over_earth(time, track)
        m, earth = track.moment, self.earth_rate * axis
        force = cross(2.0 * earth + track.rate, track.velocity)
        pull = m.speed * track.turn
        force[:, 0] += m.acceleration * track.sine + pull * track.cosine
        force[:, 1] += m.acceleration * track.cosine - pull * track.sine
        force[:, 2] += m.climb_slope + self._weight(axis[:, 2], m.height)
        if cosines is not None:
            turned, height = beside(cosines, m.height, body.shown(unit.lever_arm))
            # gravity there less gravity here
            force += self._weight((turned[:, 2:] @ axis[:, :, None])[:, 0, 0], height)[:, None] * turned[:, 2]
            force[:, 2] -= self._weight(axis[:, 2], m.height)
        force, earth = body.seen(force), body.seen(earth)
        if cosines is not None:
            force += swung(unit.lever_arm, earth, rate, self._slope(time))
        rate = rate + earth
        if unit.turned:
            to_unit = np.swapaxes(unit.attitude(time), -1, -2)
            force, rate = transform(to_unit, force), transform(to_unit, rate + unit.rate(time))
        return force, rate

    def rate_over_earth(self, time: Array) -> Array:
        """Angular rate of the vehicle over the Earth in its own axes, (n, 3), rad/s, at times (n,)."""
        return self._over_earth(time, self.way.track(time, self.way.axis(time)))[1]

    def _weight(self, sine: Array, height: Array) -> Array:
        """Gravity, (n,), m/s^2, of the sine of the latitude and the height."""
        return gravity_by_sine(sine, height) + self.gravity_excess

    def _slope(self, time: Array) -> Array:
        """Derivative of the body's rate over the Earth, in b, (n, 3), by a complex step, which costs no digits."""
        shifted: Any = time + 1e-30j
        return np.asarray(self.rate_over_earth(shifted).imag / 1e-30)


def _panels(motion: Trajectory) -> tuple[Array, Array]:
    """Where panels must end, and how long they may be in between."""
    profile, sway, flexure = motion.way.profile, motion.course.sway, motion.unit.flexure
    length = np.diff(profile.breaks)
    at = profile.breaks[:-1, None] + length[:, None] * np.linspace(1e-9, 1.0 - 1e-9, 9)
    m = profile.at(at.ravel())
    fastest = np.abs(m.turn).reshape(at.shape).max(axis=1)
    for size, period in ((getattr(sway, n), getattr(sway, f"{n}_period")) for n in ("roll", "pitch", "yaw", "heave")):
        if size > 0.0:
            fastest = np.maximum(fastest, 2.0 * math.pi / period)
    leans = motion.course.bank == "coordinated"
    if leans:
        change = 10.0 * np.abs(m.acceleration) / np.maximum(m.speed, 1e-3)
        fastest = np.maximum(fastest, change.reshape(at.shape).max(axis=1))
    longest = np.minimum(_LONGEST, 1.0 / np.maximum(fastest, 1e-9))
    longest = np.where(profile.easing, np.minimum(longest, length / (16.0 if leans else 4.0)), longest)
    if flexure is None:
        return profile.breaks, longest
    first, last = profile.breaks[[0, -1]]
    inner = flexure.breaks[(flexure.breaks > first) & (flexure.breaks < last)]
    breaks = np.union1d(profile.breaks, inner)
    piece = np.searchsorted(profile.breaks, breaks[:-1], side="right") - 1
    return breaks, np.minimum(longest[piece], flexure.scale / 10.0)


def _refuse_steps(motion: Trajectory) -> None:
    """Refuse steps in the body's rate over the Earth."""
    breaks = motion.way.profile.breaks[1:-1]
    aside = 4.0 * np.spacing(np.abs(breaks) + 1.0)
    before, after = (motion.rate_over_earth(t) for t in (breaks - aside, breaks + aside))
    steps = np.flatnonzero(np.abs(after - before).max(axis=1) > _STEP)
    if steps.size:
        raise InputError(
            f"trajectory.{motion.way.profile.names[steps[0] + 1]}.ease: the leg begins with a step in the rate of turn, at which "
            "a unit with a lever arm would step in velocity; give it a time, for example '2 s'"
        )
