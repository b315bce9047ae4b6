"""A unit that sways on its place, simulated with increments that are exact to rounding."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sagnac.align.static import place_of
from sagnac.align.static.fit import Place
from sagnac.frames import Array, attitude_matrix
from sagnac.navigate.stream import Piece

DEGREE = np.pi / 180
HOUR = DEGREE / 3600
UG = 9.80665e-6
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class Wave:
    """Sums of cosines: frequencies (k,) rad/s, amplitudes (k, 3), phases (k, 3)."""

    w: Array
    a: Array
    p: Array

    def __call__(self, t: Array, order: int = 0) -> Array:
        """Value or derivative at times (...,), shape (..., 3)."""
        phase = self.w[:, None] * t[..., None, None] + self.p + order * np.pi / 2
        return np.einsum("...ki,ki->...i", np.cos(phase), self.a * self.w[:, None] ** order)


def waves(rng: np.random.Generator, low: float, high: float, rms: float, count: int = 6) -> Wave:
    """Random sway between two frequencies, Hz, of about an rms on each axis."""
    w = 2 * np.pi * np.sort(rng.uniform(low, high, count))
    return Wave(w, rng.normal(0, rms * np.sqrt(2 / count), (count, 3)), rng.uniform(0, 2 * np.pi, (count, 3)))


def together(*parts: Wave) -> Wave:
    """Several waves at once."""
    return Wave(*(np.concatenate([getattr(p, n) for p in parts]) for n in ("w", "a", "p")))


STILL = Wave(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)))


@dataclass(frozen=True)
class Unit:
    """A unit on its place.

    `angles` are heading, pitch, roll about which `sway` goes (rad), `heave` is the displacement (m, east, north, up), `turn` a
    turn in heading: (start, stop, angle) with a smooth rate.
    """

    place: Place = field(default_factory=lambda: place_of(34.246 * DEGREE, 108.9 * DEGREE, 380.0))
    angles: tuple[float, float, float] = (0.5, 0.02, -0.01)
    sway: Wave = STILL
    heave: Wave = STILL
    turn: tuple[float, float, float] | None = None

    def attitude(self, t: Array) -> tuple[Array, Array]:
        """Heading, pitch, roll and their rates, shape (..., 3)."""
        a, da = np.array(self.angles) + self.sway(t), self.sway(t, 1)
        if self.turn is not None:
            start, stop, angle = self.turn
            x = np.clip((t - start) / (stop - start), 0, 1)
            a[..., 0] += angle * (x - np.sin(2 * np.pi * x) / (2 * np.pi))
            da[..., 0] += angle / (stop - start) * (1 - np.cos(2 * np.pi * x))
        return a, da

    def C_b_n(self, t: float) -> Array:
        a, _ = self.attitude(np.array(t))
        return attitude_matrix(*a)

    def inputs(self, t: Array) -> tuple[Array, Array]:
        """Specific force and rate in body axes, shape (..., 3)."""
        a, da = self.attitude(t)
        C = attitude_matrix(a[..., 0], a[..., 1], a[..., 2])
        zero = np.zeros_like(t)
        # C = Rz(-heading) Rx(pitch) Ry(roll): the rate in body axes
        c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
        body = np.stack([da[..., 1] * c, da[..., 2], da[..., 1] * s], axis=-1)
        up = C[..., 2, :]
        body = body - da[..., 0, None] * up
        w = self.place.rate
        body = body + np.einsum("...ij,i->...j", C, w)
        f = (
            self.heave(t, 2)
            + 2 * np.cross(w, self.heave(t, 1))
            + np.stack([zero, zero, zero + self.place.gravity], axis=-1)
        )
        return np.einsum("...ij,...i->...j", C, f), body

    def increments(self, duration: float, frequency: float, start: float = 0.0) -> Piece:
        """Increments without errors."""
        n, h = round(duration * frequency), 1 / frequency
        turns, pushes = np.empty((n, 3)), np.empty((n, 3))
        for a in range(0, n, 5000):
            b = min(n, a + 5000)
            t = h * (np.arange(a, b)[:, None] + 0.5 + 0.5 * NODES)
            f, w = self.inputs(t)
            turns[a:b], pushes[a:b] = (0.5 * h * np.einsum("nki,k->ni", v, WEIGHTS) for v in (w, f))
        return Piece(start, start + h * np.arange(1, n + 1), np.full(n, h), turns, pushes)


def spoilt(
    piece: Piece, rng: np.random.Generator, eps: Array, nab: Array, gyro_noise: float = 0.0, accel_noise: float = 0.0
) -> Piece:
    """The same with biases and white noise."""
    h = piece.steps[:, None]
    turns = piece.turns + eps * h + gyro_noise * np.sqrt(h) * rng.normal(size=piece.turns.shape)
    pushes = piece.pushes + nab * h + accel_noise * np.sqrt(h) * rng.normal(size=piece.turns.shape)
    return Piece(piece.begin, piece.time, piece.steps, turns, pushes)


def phi_of(C_found: Array, C_true: Array) -> Array:
    """Error of an attitude: computed ``(I - [phi x])`` true."""
    from sagnac.frames import rotation_vector

    return -rotation_vector(C_found @ C_true.T)
