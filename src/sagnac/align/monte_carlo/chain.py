"""The runs of a Monte Carlo: slaves that are drawn, navigate and are corrected, in lanes of a kernel."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...earth import ELLIPSOID, gravity_excess
from ...errors import InputError
from ...frames import Array, rot_z, rotation_matrix, rotation_vector, transform
from ...navigate.many import pack_many
from ...navigate.state import State
from ...navigate.strapdown import unpack
from ...navigate.trajectory import Trajectory
from .. import model

if TYPE_CHECKING:
    from ..config import Config

Integers = NDArray[np.uint64]

_PIECE = 4096  # samples of the common motion at a time: what bounds the memory
_SLOT = np.array([0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 5])  # where the states of the short form stand in the kernel's order
_DRAWS = 12  # numbers that a run starts with
_POLE = 1e-4  # rad of latitude: nearer, east and north turn too fast
_WHOLE = 1e-6  # how far the samples in an update interval may be off a whole number, and times off the course


class Piece(NamedTuple):
    """Common motion over some updates."""

    turns: Array
    """(n, 3), rad: increments of the master in its body axes."""
    pushes: Array
    """(n, 3), m/s."""
    steps: Array
    """(n,), s."""
    heights: Array
    """(n,), m: at the end of each sample."""
    velocities: Array
    """(m, 2), m/s: east and north at each update."""
    update: int
    """The last one, counted from one at the first."""


@dataclass(frozen=True)
class Group:
    """Runs side by side, in the rows of the kernels.

    Attributes
    ----------
    state, P, biases, generator, nis : ndarray
        As :func:`sagnac.kernels.lanes_chain.align` wants them; they change.
    to_master : ndarray, shape (lanes, 3, 3)
        Mounting: takes the slaves' axes to the master's.
    mounting : ndarray
        The same for the kernel.
    """

    state: Array
    P: Array
    biases: Array
    generator: Integers
    nis: Array
    to_master: Array
    mounting: Array


@dataclass(frozen=True)
class Chain:
    """What all runs have in common.

    Attributes
    ----------
    trajectory : Trajectory
        Of the master.
    method : str
    names, units : tuple of str
        Of the states.
    frequency : float, Hz
        Of the slaves' samples.
    count : int
        Samples in an update interval.
    prior : ndarray, shape (n, n)
        First covariance.
    driving, variance
        The filter's noise, in the kernel's order.
    sizes : ndarray, shape (12,)
        Standard deviation of what a run starts with: mounting, level velocity, gyro and accelerometer biases, wander
        angle.
    drawn : ndarray, shape (5,)
        Noise that is drawn.
    constants : ndarray, shape (8,)
        Of the Earth.
    """

    trajectory: Trajectory
    method: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    frequency: float
    count: int
    prior: Array
    driving: Array
    variance: float
    sizes: Array
    drawn: Array
    constants: Array

    @classmethod
    def of(cls, config: Config, source: Config, frequency: float) -> Chain:
        """Runs that filter as one configuration says and are drawn as another does.

        Raises
        ------
        InputError
            When they ask for what these runs do not do.
        """
        for given in (config, source):
            _check(given)
        course = config.trajectory
        if course is None:
            raise InputError("[trajectory] is missing: Monte Carlo runs need the course that the master takes")
        count = round(config.update_interval * frequency) if math.isfinite(frequency) else 0
        if count < 1 or abs(count / (config.update_interval * frequency) - 1.0) > _WHOLE:
            raise InputError(
                f"update_interval {config.update_interval:g} s is no whole number of samples at {frequency:g} Hz: "
                "change either"
            )
        excess = gravity_excess(config.gravity, course.latitude, course.height)
        trajectory = Trajectory.of(course, earth_rate=config.earth_rate, gravity_excess=excess)
        states = model.layout_of(config)
        n = states.block("mounting").start
        start = trajectory.state(0.0)
        first, noise = source.initial, source.noise
        driving = np.zeros(_SLOT.size)
        driving[_SLOT[:n]] = model.driving_noise(config, states)[:n]
        still = np.zeros(3)
        at_start = model.Instant(start.C_b_w, start.velocity, still, still, still, still)
        wander = first.wander if config.method == "wander" else 0.0
        return cls(
            trajectory,
            config.method,
            states.names[:n],
            states.units[:n],
            frequency,
            count,
            model.prior(config, states, at_start, float(start.height))[1][:n, :n],
            driving,
            config.noise.velocity**2,
            np.array([*first.misalignment, *[first.velocity] * 2, *first.gyro_bias, *first.accel_bias, wander]),
            np.array([noise.gyro, noise.accel, noise.gyro_walk, noise.accel_walk, noise.velocity]),
            np.array([*ELLIPSOID, config.earth_rate, excess]),
        )

    @property
    def interval(self) -> float:
        """From update to update, s."""
        return self.count / self.frequency

    @property
    def duration(self) -> float:
        """Time of the last update on the course, s."""
        return math.floor(self.trajectory.duration / self.interval + _WHOLE) * self.interval

    def marks(self, times: Sequence[float]) -> tuple[int, ...]:
        """Updates nearest to times, s, in increasing order."""
        out = sorted({round(t / self.interval) for t in times if math.isfinite(t)})
        last = round(self.duration / self.interval)
        if not out or out[0] < 1 or out[-1] > last:
            raise InputError(
                f"times: {', '.join(f'{t:g}' for t in times) or 'none'} s; there are updates from {self.interval:g} to "
                f"{self.duration:g} s on this course"
            )
        return tuple(out)

    def start(self, runs: int, seed: int) -> list[Group]:
        """Draw the runs, the last ones of the last group to fill it up."""
        from ...kernels.lanes import LANES

        truth = self.trajectory.state(0.0)
        return [self._drawn(np.arange(i, i + LANES), seed, truth) for i in range(0, runs, LANES)]

    def _drawn(self, numbers: NDArray[np.int64], seed: int, truth: State) -> Group:
        from ...kernels.lanes_random import normals

        lanes = numbers.size
        generator, drawn = _generators(numbers, seed), np.empty(_DRAWS * lanes)
        for row in range(0, _DRAWS, 2):
            normals(generator, drawn, row)
        drawn = drawn.reshape(_DRAWS, lanes) * self.sizes[:, None]
        to_master = rotation_matrix(drawn[:3].T)
        velocity = np.repeat(truth.velocity[None], lanes, axis=0)
        velocity[:, :2] += drawn[3:5].T
        C_b_w = np.broadcast_to(truth.C_b_w, (lanes, 3, 3))  # the slaves start with their master's attitude
        state = pack_many(State(C_b_w, velocity, rot_z(-drawn[11]) @ truth.C_e_w, truth.height))
        P = np.zeros((_SLOT.size, _SLOT.size))
        slot = _SLOT[: len(self.names)]
        P[np.ix_(slot, slot)] = self.prior
        return Group(
            np.ascontiguousarray(state.T).ravel(),
            np.repeat(P.ravel(), lanes),
            drawn[5:11].ravel(),
            generator,
            np.zeros(lanes),
            to_master,
            np.ascontiguousarray(np.transpose(to_master, (2, 1, 0))).ravel(),
        )

    def pieces(self, marks: Sequence[int]) -> Iterator[Piece]:
        """The common motion, in pieces that end at the marks or before."""
        most = max(1, _PIECE // self.count)
        update = 0
        for mark in marks:
            while update < mark:
                after = min(update + most, mark)
                yield self._piece(update, after)
                update = after

    def _piece(self, begin: int, end: int) -> Piece:
        last = self.trajectory.duration
        time = np.minimum(np.arange(begin * self.count, end * self.count + 1) / self.frequency, last)
        increments = self.trajectory.increments(time)
        states = self.trajectory.state(time[1:])
        at = slice(self.count - 1, None, self.count)
        ends = State(states.C_b_w[at], states.velocity[at], states.C_e_w[at], states.height[at])
        if np.hypot(ends.C_e_w[:, 0, 2], ends.C_e_w[:, 1, 2]).min() < _POLE:
            raise InputError(
                f"the course comes within {_POLE * ELLIPSOID[0]:.0f} m of a pole before {end * self.interval:g} s, "
                "where a master's velocity in east, north, up says nothing"
            )
        return Piece(
            increments.turns,
            increments.pushes,
            increments.steps,
            np.ascontiguousarray(states.height),
            np.ascontiguousarray(ends.velocity_enu[:, :2]),
            end,
        )

    def advance(self, group: Group, piece: Piece) -> None:
        """Take a group over a piece."""
        from ...kernels.lanes_chain import align

        align(
            group.state,
            group.P,
            group.biases,
            group.mounting,
            group.generator,
            *piece[:5],
            self.method == "geographic",
            self.drawn,
            self.driving,
            self.variance,
            self.constants,
            group.nis,
        )

    def truth(self, update: int) -> State:
        """True state after an update."""
        return self.trajectory.state(min(update * self.interval, self.trajectory.duration))

    def compare(self, groups: Sequence[Group], truth: State) -> tuple[Array, Array, Array]:
        """True errors of runs and their covariances, and how far off their position is.

        Parameters
        ----------
        groups : sequence of Group
        truth : State
            Of the master.

        Returns
        -------
        errors : ndarray, shape (k, n), SI
        P : ndarray, shape (k, n, n)
        aside : ndarray, shape (k,), m
        """
        n = len(self.names)
        own = unpack(_columns([g.state for g in groups]))
        geographic = self.method == "geographic"
        here, there = (own.C_w_n, truth.C_w_n) if geographic else (np.eye(3), np.eye(3))
        C = there @ truth.C_b_w @ np.concatenate([g.to_master for g in groups])
        errors = np.zeros((C.shape[0], _SLOT.size))
        velocity = transform(here, own.velocity) - there @ truth.velocity
        errors[:, :2] = velocity[:, :2]
        errors[:, 2:5] = -rotation_vector(here @ own.C_b_w @ np.swapaxes(C, 1, 2))
        errors[:, 5:10] = _columns([g.biases for g in groups])[:, :5]
        errors[:, 10] = np.mod(own.place[2] - truth.place[2] + np.pi, 2.0 * np.pi) - np.pi
        P = _columns([g.P for g in groups]).reshape(-1, _SLOT.size, _SLOT.size)
        slot = _SLOT[:n]
        aside = np.linalg.norm(own.C_e_w[:, 2] - truth.C_e_w[2], axis=1) * (ELLIPSOID[0] + float(truth.height))
        return errors[:, :n], P[:, slot[:, None], slot], aside


def _columns(rows: Sequence[Array]) -> Array:
    """Rows of lanes as one row for each run, (runs, ...)."""
    from ...kernels.lanes import LANES

    return np.concatenate([np.ascontiguousarray(r.reshape(-1, LANES).T) for r in rows])


def _generators(numbers: NDArray[np.int64], seed: int) -> Integers:
    """First states of generators: splitmix64 (Steele, Lea & Flood 2014) of the seed and the numbers of the runs."""
    start = np.random.SeedSequence(seed).generate_state(1, np.uint64)
    step = np.uint64(0x9E3779B97F4A7C15)
    of_run = _mixed(start + step * (numbers.astype(np.uint64) + np.uint64(1)))
    return np.concatenate([_mixed(of_run + k * step) for k in np.arange(1, 5, dtype=np.uint64)[:, None]])


def _mixed(x: Integers) -> Integers:
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def _check(config: Config) -> None:
    """Refuse what these runs do not do."""
    for wrong, words in (
        (config.method not in {"wander", "geographic"}, f'method {config.method!r}: write "wander" or "geographic"'),
        (config.states != "short", f'states {config.states!r}: write states = "short"'),
        (config.matching != "velocity", f'matching {config.matching!r}: write matching = "velocity"'),
        (config.correction != "feedback", f'correction {config.correction!r}: write correction = "feedback"'),
        (any(config.lever_arm) or config.initial.lever_arm is not None, "a lever arm: leave it out"),
        (config.initial.delay is not None, "an unknown delay of the master: leave initial.delay out"),
        (config.flexure is not None, "flexure: leave it out"),
    ):
        if wrong:
            raise InputError(f"Monte Carlo runs do not do {words}")
