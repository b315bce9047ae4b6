"""Attitude of a body along its track, and how it turns."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...frames import Array
from .way import Track, Way

if TYPE_CHECKING:
    from .course import Course


class Angle(NamedTuple):
    """An angle and its rate, (n,) each."""

    angle: Array
    rate: Array


def angles(course: Course, way: Way, gravity: float, time: Array) -> tuple[Angle, Angle, Angle]:
    """Yaw against the track, pitch and roll.

    Parameters
    ----------
    course : Course
    way : Way
    gravity : float, m/s^2
        Against which a coordinated bank leans.
    time : ndarray, shape (n,), s
        Real or complex.
    """
    sway = course.sway
    yaw = _swing(time, sway.yaw, sway.yaw_period, sway.yaw_phase)
    pitch = _swing(time, sway.pitch, sway.pitch_period, sway.pitch_phase, course.pitch)
    roll = _swing(time, sway.roll, sway.roll_period, sway.roll_phase, course.roll)
    if course.bank == "level":
        return yaw, pitch, roll
    m = way.profile.at(time)  # the nose follows the course, not the heave
    s, pull = m.speed, m.speed * m.turn
    path = (m.climb_slope * s - m.climb * m.acceleration) / (s * s + m.climb * m.climb)
    lean = gravity * (m.acceleration * m.turn + s * m.turn_slope) / (gravity * gravity + pull * pull)
    return (
        yaw,
        Angle(pitch.angle + np.arctan(m.climb / s), pitch.rate + path),
        Angle(roll.angle + np.arctan(pull / gravity), roll.rate + lean),
    )


class Body(NamedTuple):
    """Attitude of the body in w, by sines and cosines, (n,) each, and the rates of the angles."""

    heading_s: Array
    heading_c: Array
    heading_rate: Array
    pitch_s: Array
    pitch_c: Array
    pitch_rate: Array
    roll_s: Array
    roll_c: Array
    roll_rate: Array

    @classmethod
    def of(cls, track: Track, yaw: Angle, pitch: Angle, roll: Angle) -> Body:
        """Attitude of a body on a track, turned against it by three angles."""
        s, c = np.sin(yaw.angle), np.cos(yaw.angle)
        return cls(
            track.sine * c + track.cosine * s,
            track.cosine * c - track.sine * s,
            track.turn + yaw.rate,
            np.sin(pitch.angle),
            np.cos(pitch.angle),
            pitch.rate,
            np.sin(roll.angle),
            np.cos(roll.angle),
            roll.rate,
        )

    def seen(self, v: Array) -> Array:
        """Vectors (n, 3) in w as the body sees them."""
        x = self.heading_c * v[:, 0] - self.heading_s * v[:, 1]
        ahead = self.heading_s * v[:, 0] + self.heading_c * v[:, 1]
        y = self.pitch_c * ahead + self.pitch_s * v[:, 2]
        up = self.pitch_c * v[:, 2] - self.pitch_s * ahead
        return np.stack([self.roll_c * x - self.roll_s * up, y, self.roll_s * x + self.roll_c * up], axis=-1)

    def shown(self, v: Array) -> Array:
        """A vector (3,) in the body's axes in w, (n, 3)."""
        x, up = self.roll_c * v[0] + self.roll_s * v[2], self.roll_c * v[2] - self.roll_s * v[0]
        ahead, z = self.pitch_c * v[1] - self.pitch_s * up, self.pitch_s * v[1] + self.pitch_c * up
        return np.stack(
            [self.heading_c * x + self.heading_s * ahead, self.heading_c * ahead - self.heading_s * x, z], axis=-1
        )

    def rate(self) -> Array:
        """Rate of the body against w, in its own axes, (n, 3)."""
        # heading turns clockwise, about minus z
        y, up = -self.pitch_s * self.heading_rate, -self.pitch_c * self.heading_rate
        return np.stack(
            [
                self.roll_c * self.pitch_rate - self.roll_s * up,
                self.roll_rate + y,
                self.roll_s * self.pitch_rate + self.roll_c * up,
            ],
            axis=-1,
        )


def _swing(time: Array, amplitude: float, period: float, phase: float, mean: float = 0.0) -> Angle:
    """Mean and sway of an angle."""
    if amplitude == 0.0:
        return Angle(np.full_like(time, mean), np.zeros_like(time))
    w = 2.0 * math.pi / period
    return Angle(mean + amplitude * np.sin(w * time + phase), w * amplitude * np.cos(w * time + phase))
