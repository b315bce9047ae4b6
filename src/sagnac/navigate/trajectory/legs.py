"""From the legs of a course to pieces on which speed, heading and height are polynomials in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from ...earth import STANDARD_GRAVITY
from ...errors import InputError

if TYPE_CHECKING:
    from .course import Course, Leg

MARGIN = 10.0
"""s: how long a course goes straight on before its start, and steadily on after its end."""
EASE = 3.0
"""s: default of what may not come in at once."""
_FASTEST = 1000.0
_HEIGHTS = (-12e3, 100e3)
_STEEPEST = math.radians(60.0)
_LEANS = math.radians(75.0)
_SLOWEST = 1.0  # m/s, of what leans into its turns
_RAMP = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
"""From 0 to 1 with first and second derivative zero at both ends, and mean 1/2."""
_STILL = Polynomial([0.0])


@dataclass(frozen=True)
class Part:
    """A piece of a course: polynomials in the time since its start.

    Attributes
    ----------
    name : str
        Key of its leg.
    end : float, s
    easing : bool
        Whether something comes in.
    speed, heading, turn, climb, height : Polynomial
        Over the ground, of the track, its rate, vertical speed; m, s, rad.
    """

    name: str
    end: float
    easing: bool
    speed: Polynomial
    heading: Polynomial
    turn: Polynomial
    climb: Polynomial
    height: Polynomial


def parts(course: Course) -> list[Part]:
    """The pieces of a course; the first and the last are those of :data:`MARGIN`.

    Raises
    ------
    InputError
        With the leg at fault, when the legs do not go together.
    """
    drawn = _Drawn(course)
    for name, leg in course.legs:
        drawn.add(name, leg)
    # after the end all goes on as it was there, at a steady speed
    drawn.append(
        drawn.parts[-1].name, MARGIN, Polynomial([drawn.turn]), _STILL, drawn.law.at(Polynomial([drawn.speed]))
    )
    return drawn.parts


class _Law(NamedTuple):
    """Vertical speed: a constant, and a slope times the speed."""

    constant: float
    slope: float

    def at(self, speed: Polynomial) -> Polynomial:
        return self.constant + self.slope * speed if self.slope else Polynomial([self.constant])


@dataclass(frozen=True)
class _Eased:
    """How one quantity comes in over the beginning of a leg, and of a height's climb how it goes out again."""

    into: float
    out: float = 0.0

    def cuts(self, duration: float) -> set[float]:
        return {self.into, duration - self.out}

    def within(self, start: float, duration: float) -> bool:
        """Whether it changes in what begins at `start`."""
        return start < self.into or start >= duration - self.out

    def blend(self, start: float, duration: float, before: Polynomial | float, target: Polynomial) -> Polynomial:
        """What holds from `start` on, in the time since then, between what was before and the target."""
        if start < self.into:
            return before + _RAMP(Polynomial([start, 1.0]) / self.into) * (target - before)
        if start >= duration - self.out:
            return target * (1.0 - _RAMP(Polynomial([start - (duration - self.out), 1.0]) / self.out))
        return target


class _Drawn:
    """Pieces in the making, and what the last one ends with."""

    def __init__(self, course: Course) -> None:
        self.course = course
        self.parts: list[Part] = []
        self.time = -MARGIN
        self.speed, self.height = course.speed, course.height
        self.heading = course.heading
        self.turn, self.thrust, self.law = 0.0, 0.0, _Law(0.0, 0.0)
        self.append("leg.0", MARGIN, _STILL, _STILL, _STILL)

    def add(self, name: str, leg: Leg) -> None:
        """The pieces of a leg."""
        duration = leg.duration or 0.0
        turn, thrust, climb = self._eased(name, leg, duration)
        law = self._target(leg, thrust, climb, duration)
        begin, edges = self.time, {0.0, duration} | turn.cuts(duration) | thrust.cuts(duration) | climb.cuts(duration)
        turning, accelerating, climbing = self.turn, self.thrust, self.law
        for start, end in pairwise(sorted(edges)):
            acceleration = thrust.blend(start, duration, accelerating, Polynomial([leg.acceleration]))
            speed = acceleration.integ(k=self.speed)
            self.append(
                name,
                end - start,
                turn.blend(start, duration, turning, Polynomial([leg.turn_rate])),
                acceleration,
                climb.blend(start, duration, climbing.at(speed), law.at(speed)),
                easing=any(e.within(start, duration) for e in (turn, thrust, climb)),
            )
            self.time = begin + end
        self.turn, self.thrust = leg.turn_rate, leg.acceleration
        self.law = _Law(0.0, 0.0) if climb.out else law

    def append(
        self, name: str, length: float, turn: Polynomial, thrust: Polynomial, climb: Polynomial, *, easing: bool = False
    ) -> None:
        """A piece from now on."""
        begun = ((self.speed, thrust), (self.heading, turn), (self.height, climb))
        speed, heading, height = (slope.integ(k=first) for first, slope in begun)
        part = Part(name, self.time + length, easing, speed, heading, turn, climb, height)
        _refuse_nonsense(part, length)
        if self.course.bank == "coordinated":
            _refuse_bank(part, length)
        self.parts.append(part)
        self.speed, self.heading, self.height = (float(p(length)) for p in (speed, heading, height))
        self.time = part.end

    def _eased(self, name: str, leg: Leg, duration: float) -> tuple[_Eased, _Eased, _Eased]:
        """How turn rate, acceleration and climb come in."""
        given = leg.ease if leg.ease is not None else self.course.ease
        if given is not None and given > duration:
            raise _fault(name, "ease", f"{given:g} s is longer than the leg, {duration:g} s")
        # what may not come in at once, and what may
        slowly = min(EASE, duration / 3.0) if given is None else given
        freely = slowly if self.course.bank == "coordinated" else given or 0.0
        rises = self.law != (0.0, 0.0) or bool(leg.climb and leg.climb.value)
        turns, pushes = self.turn != leg.turn_rate, self.thrust != leg.acceleration
        if slowly == 0.0 and (rises or (turns and self.course.bank == "coordinated")):
            what = "a climb" if rises else "a coordinated bank"
            raise _fault(
                name, "ease", f"{what} cannot come in at once; give it a time, for example '3 s', or leave ease out"
            )
        out = slowly if leg.climb is not None and leg.climb.kind == "height" and rises else 0.0
        if 2.0 * out > duration:
            raise _fault(
                name,
                "climb",
                f"a leg of {duration:g} s is too short to begin a climb and to end it, {out:g} s each (ease)",
            )
        return _Eased(freely * turns), _Eased(freely * pushes), _Eased(slowly * rises, out)

    def _target(self, leg: Leg, thrust: _Eased, climb: _Eased, duration: float) -> _Law:
        """The vertical speed once it has come in."""
        if leg.climb is None:
            return _Law(0.0, 0.0)
        if leg.climb.kind == "angle":
            return _Law(0.0, math.tan(leg.climb.value))
        if leg.climb.kind == "speed":
            return _Law(leg.climb.value, 0.0)
        gained = 0.0
        if climb.into:
            # by what goes out, while the new climb comes in; the acceleration comes in at once, or in the same time
            speed = thrust.blend(0.0, duration, self.thrust, Polynomial([leg.acceleration])).integ(k=self.speed)
            gained = float(climb.blend(0.0, duration, self.law.at(speed), _STILL).integ()(climb.into))
        return _Law((leg.climb.value - gained) / (duration - 0.5 * (climb.into + climb.out)), 0.0)


def _refuse_nonsense(part: Part, length: float) -> None:
    """Refuse speeds and heights beyond sense."""
    least, most = _extremes(part.speed, length)
    if least < -1e-9 * max(most, 1.0):
        raise _fault(
            part.name, "acceleration", f"the speed falls to {least:.3g} m/s {_when(part, length)}; shorten the leg"
        )
    if most > _FASTEST:
        raise _fault(
            part.name, "acceleration", f"the speed grows to {most:.4g} m/s {_when(part, length)}; shorten the leg"
        )
    low, high = _extremes(part.height, length)
    if low < _HEIGHTS[0] or high > _HEIGHTS[1]:
        beyond = high if high > _HEIGHTS[1] else low
        raise _fault(
            part.name,
            "climb",
            f"the height reaches {beyond:.6g} m {_when(part, length)}; it must stay between -12 km and 100 km",
        )


def _refuse_bank(part: Part, length: float) -> None:
    """Refuse what a vehicle that leans into its turns cannot do."""
    when, least = _when(part, length), _extremes(part.speed, length)[0]
    if least < _SLOWEST:
        raise _fault(
            part.name, "acceleration", f"{least:.3g} m/s {when} is too slow for a coordinated bank, {_SLOWEST:g} m/s"
        )
    bank = math.atan(max(map(abs, _extremes(part.speed * part.turn, length))) / STANDARD_GRAVITY)
    if bank > _LEANS:
        raise _fault(
            part.name,
            "turn_rate",
            f"the bank would be {math.degrees(bank):.3g} deg {when}, more than {math.degrees(_LEANS):g} deg; turn slower, or "
            'write bank = "level"',
        )
    slope = math.tan(_STEEPEST)
    if any(_extremes(side * part.climb - slope * part.speed, length)[1] > 0.0 for side in (1.0, -1.0)):
        raise _fault(
            part.name, "climb", f"the path is steeper than {math.degrees(_STEEPEST):g} deg {when}; climb slower"
        )


def _when(part: Part, length: float) -> str:
    return f"between {part.end - length:g} s and {part.end:g} s"


def _extremes(polynomial: Polynomial, length: float) -> tuple[float, float]:
    """Least and greatest value on [0, length]."""
    at = np.array([0.0, length])
    if np.count_nonzero(polynomial.coef[2:]):
        turning = polynomial.deriv().trim().roots()
        inner = turning.real[(abs(turning.imag) < 1e-9 * length) & (turning.real > 0) & (turning.real < length)]
        at = np.concatenate([at, inner])
    values = polynomial(at)
    return float(values.min()), float(values.max())


def _fault(leg: str, key: str, what: str) -> InputError:
    return InputError(f"trajectory.{leg}.{key}: {what}")
