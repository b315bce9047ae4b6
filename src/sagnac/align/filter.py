"""The filter of a transfer alignment: a slave that navigates, its errors' covariance, and the master that it is matched with.

An extended Kalman filter with feedback: after each update the estimated errors are taken out of the navigation and of the
values in use, and the filter goes on with a mean of zero, linearised at the best that is known. Written for a stream:
:meth:`Filter.advance` takes samples of the slave, :meth:`Filter.match` a sample of the master for the time reached. Neither
keeps any history.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..earth import ELLIPSOID, gravity_excess, normal_gravity, radii
from ..errors import DataError
from ..frames import Array, cross, left_jacobian, rotation_matrix, rotation_vector
from ..kernels import error_model, kalman
from ..navigate import wander
from ..navigate.state import State
from ..navigate.strapdown import Navigator
from . import model

if TYPE_CHECKING:
    from .config import Config


_NO_TURN = 1e-7
"""rad: feedback of less leaves the covariance as it is."""


@dataclass(frozen=True)
class Reference:
    """One sample of the master.

    Attributes
    ----------
    latitude, longitude : float, rad
    velocity : ndarray, shape (3,), m/s
        East, north, up.
    attitude : ndarray, shape (3, 3), or None
        C_b_n.
    """

    latitude: float
    longitude: float
    velocity: Array
    attitude: Array | None = None


@dataclass(frozen=True)
class Match:
    """What a sample of the master did.

    Attributes
    ----------
    innovation, sigma : ndarray, shape (k,)
        Difference to the prediction, and its predicted standard deviation.
    distance : float
        Squared and weighted by its covariance: chi-square with k degrees of freedom.
    used : bool
        False where the gate shut it out.
    H : ndarray, shape (k, n)
        It was linear in the errors with this matrix,
    R : ndarray, shape (k,)
        and has these variances.
    """

    innovation: Array
    sigma: Array
    distance: float
    used: bool
    H: Array
    R: Array


class Filter:
    """State of an alignment in progress.

    Parameters
    ----------
    config : sagnac.align.config.Config
    states : sagnac.align.model.Layout
    start : State
        Of the slave, with the master's attitude turned by `mounting`.
    rate, force : ndarray, shape (3,), rad/s and m/s^2
        What the slave's sensors read then.
    mounting : ndarray, shape (3,), rad, optional
        Where to linearise first; the prior stays centred at zero.

    Attributes
    ----------
    x : ndarray, shape (n,)
        Estimate of the errors of the values in use, zero after each update.
    P : ndarray, shape (n, n)
        Its covariance.
    values : ndarray, shape (n,)
        Parameters in use, at the places of their states (biases, mounting, lever arm, ...).
    phi, predicted : ndarray, shape (n, n)
        Transition over the last interval, and the covariance at its end before the update.
    """

    def __init__(
        self,
        config: Config,
        states: model.Layout,
        start: State,
        rate: Array,
        force: Array,
        mounting: Array | None = None,
    ) -> None:
        self._config, self.states = config, states
        self._rate = config.earth_rate
        latitude = float(start.place[0])
        height = float(start.height)
        self._excess = gravity_excess(config.gravity, latitude, height)
        self.navigator = self._navigator(start)
        self._now: State | None = None
        n = len(states)
        self.values = np.zeros(n)
        self.values[states.block("lever")] = config.lever_arm if "lever" in states.blocks else []
        self._lever = np.array(config.lever_arm)
        if mounting is not None:
            self.values[states.block("mounting")] = mounting
        earth = self._rate * start.C_e_w[:, 2]
        over = wander.transport_rate(start.C_e_w, start.velocity, start.height)
        gained = start.C_b_w @ force - np.cross(2.0 * earth + over, start.velocity)
        gained[2] -= normal_gravity(latitude, height) + self._excess
        self._turning = rate - start.C_b_w.T @ earth
        self._accelerating = self._frame(start) @ gained
        self.x, self.P = model.prior(config, states, self._instant(start), height)
        self._noise = model.driving_noise(config, states)
        self._still = np.zeros((n, n))
        model.complete(config, states, self._still)
        self._F, self.phi, self._room = np.zeros((n, n)), np.eye(n), np.empty((n, n))
        self.predicted = self.P.copy()

    def _navigator(self, start: State) -> Navigator:
        return Navigator(
            start,
            samples=self._config.coning,
            frame="north" if self._config.method == "north-then-wander" else "wander",
            vertical="free",
            earth_rate=self._rate,
            gravity_excess=self._excess,
        )

    def twin(self) -> Navigator:
        """The same navigation as it stands, to be left to itself."""
        return self._navigator(self.state)

    def _frame(self, state: State) -> Array:
        """Takes coordinates in w to the frame of the errors."""
        return state.C_w_n if self.states.geographic else np.eye(3)

    def _instant(self, state: State) -> model.Instant:
        """What a measurement at a state is linearised at."""
        frame = self._frame(state)
        return model.Instant(
            frame @ state.C_b_w,
            frame @ state.velocity,
            self._accelerating,
            self._turning,
            self._mounted(),
            self.lever,
        )

    @property
    def state(self) -> State:
        """Attitude, velocity and position as they are now."""
        if self._now is None:
            self._now = self.navigator.state
        return self._now

    @property
    def lever(self) -> Array:
        """Lever arm in use, shape (3,), m, in the master's axes."""
        where = self.states.block("lever")
        return self.values[where] if where.stop else self._lever

    @property
    def delay(self) -> float:
        """Delay of the master in use, s."""
        where = self.states.block("delay")
        return float(self.values[where][0]) if where.stop else 0.0

    @property
    def gyro_bias(self) -> Array:
        """In use, shape (3,), rad/s."""
        return self.values[self.states.block("gyro")]

    @property
    def accel_bias(self) -> Array:
        """In use, shape (3,), m/s^2; zero where it is not estimated."""
        given = self.values[self.states.block("accel")]
        return np.concatenate([given, np.zeros(3 - given.size)])

    def advance(self, turns: Array, pushes: Array, steps: Array, heights: Array | None = None) -> None:
        """Navigate over samples and propagate the covariance over their time, in one step.

        Parameters
        ----------
        turns, pushes : ndarray, shape (n, 3), rad and m/s
            Increments of the slave.
        steps : ndarray, shape (n,), s
        heights : ndarray, shape (n,), m, optional
            At the ends of the samples: short form, in which the vertical channel follows the master.
        """
        if not steps.size:
            return
        before = self.state
        turns = turns - steps[:, None] * self.gyro_bias
        pushed = self.navigator.pushed.copy()
        self.navigator.advance(turns, pushes - steps[:, None] * self.accel_bias, steps, heights)
        self._now = None
        after = self.state
        time = float(steps.sum())
        frame = self._frame(after)
        force = frame @ (self.navigator.pushed - pushed) / time
        C = frame @ (0.5 * (before.C_b_w + after.C_b_w))
        velocity = frame @ (0.5 * (before.velocity + after.velocity))
        axis = frame @ after.C_e_w[:, 2]
        height = float(after.height)
        error_model.system(C, velocity, axis, height, force, self._rate, ELLIPSOID, self.states.at, self._F)
        self._F += self._still
        kalman.transition(self._F, time, self.phi)
        kalman.propagate(self.P, self.phi, self._noise * time, self._room)
        self.predicted[:] = self.P
        if self.x.any():
            self.x = self.phi @ self.x
        if "flexure" in self.states.blocks:
            both = [*range(*self.states.block("flexure").indices(len(self.x)))]
            both += [*range(*self.states.block("flexure_rate").indices(len(self.x)))]
            self.values[both] = self.phi[np.ix_(both, both)] @ self.values[both]
        self._accelerating = frame @ (after.velocity - before.velocity) / time
        last = turns[-1] / steps[-1]
        if turns.shape[0] > 1:  # the rate at the end, not in the middle of the last sample
            last = 1.5 * last - 0.5 * turns[-2] / steps[-2]
        self._turning = last - after.C_b_w.T @ (self._rate * after.C_e_w[:, 2])

    def bridged(self, turned: Array, pushed: Array) -> None:
        """Widen the covariance by what may have happened in a gap: rotation and velocity, (3,), rad and m/s, one sigma, in b."""
        state = self.state
        C = self._frame(state) @ state.C_b_w
        for block, spread in (("attitude", turned), ("velocity", pushed)):
            where = self.states.block(block)
            size = where.stop - where.start
            self.P[where, where] += ((C * spread**2) @ C.T)[:size, :size]
        self.predicted[:] = self.P

    def match(self, reference: Reference) -> Match:
        """Take in a sample of the master, if the gate lets it.

        Parameters
        ----------
        reference : Reference
            True at the time that :meth:`advance` has reached (its stamp less the latency and :attr:`delay`).
        """
        state = self.state
        now = self._instant(state)
        y = self._difference(state, now, reference)
        H = model.measurement(self.states, now, self._config.matches_attitude)
        R = model.reading_noise(self._config, self.states)
        expected = H @ self.x
        distance = float(kalman.distance(self.P, H, R, y - expected))
        if not np.isfinite(distance):
            raise DataError("the filter's covariance is no longer one of numbers: check the noise and initial values")
        sigma = np.sqrt(np.einsum("ij,jk,ik->i", H, self.P, H) + R)
        used = not self._config.gate or distance <= _threshold(self._config.gate, y.size)
        if used:
            kalman.update(self.x, self.P, H, R, y)
        return Match(y - expected, sigma, distance, used, H, R)

    def feed_back(self) -> Array:
        """Take the estimated errors out of everything in use; returns what was taken out, shape (n,)."""
        x = self.x.copy()
        s = self.states.block
        state = self.state
        back = self._frame(state).T
        velocity, position = np.zeros(3), np.zeros(3)
        velocity[: self.states.at[1]] = x[s("velocity")]
        position[3 - self.states.at[4] if self.states.at[4] == 1 else 0 :][: self.states.at[4]] = x[s("position")]
        if self.states.geographic and "position" in self.states.blocks:
            up = state.C_e_w[2, 2]
            position[2] = position[1] * up / np.sqrt(1.0 - up**2)
        height = float(x[s("height")][0]) if "height" in self.states.blocks else 0.0
        self.navigator.correct(
            attitude=back @ x[s("attitude")], velocity=back @ velocity, position=back @ position, height=height
        )
        self._now = None
        for block in ("gyro", "accel", "lever", "flexure", "flexure_rate", "delay"):
            self.values[s(block)] += x[s(block)]
        mounting = s("mounting")
        self.values[mounting] = rotation_vector(rotation_matrix(self.values[mounting]) @ rotation_matrix(x[mounting]))
        self._turn_covariance(x[s("attitude")], x[mounting])
        self.x[:] = 0.0
        return x

    def _turn_covariance(self, attitude: Array, mounting: Array) -> None:
        """Errors left after the feedback are rotations against the new values.

        With ``C~ -> exp(phi) C~`` and ``exp(mu) -> exp(mu) exp(x)`` they are ``Jl(phi)`` and ``Jr(x)`` of what they were.
        Without it the mounting would be off by the product of the estimates of its azimuth and its level, 0.1 arcmin for 0.5 and
        0.2 deg.
        """
        if max(np.abs(attitude).max(), np.abs(mounting).max()) < _NO_TURN:
            return
        model.turn_errors(self.P, self.states.block("attitude"), left_jacobian(attitude))
        model.turn_errors(self.P, self.states.block("mounting"), left_jacobian(-mounting))
        self.P = 0.5 * (self.P + self.P.T)

    def less(self, other: State) -> Array:
        """Errors of another navigation, this one taken for true, shape (n,); zero for the states that are no such errors."""
        s, out, own = self.states.block, np.zeros(len(self.states)), self.state
        both = [(self._frame(o), o) for o in (other, own)]
        velocity = [frame @ o.velocity for frame, o in both]
        out[s("velocity")] = (velocity[0] - velocity[1])[: self.states.at[1]]
        C, reference = (frame @ o.C_b_w for frame, o in both)
        out[s("attitude")] = -rotation_vector(C @ reference.T)
        here, there = other.place, own.place
        if self.states.at[4] == 1:
            out[s("position")] = np.mod(here[2] - there[2] + np.pi, 2.0 * np.pi) - np.pi
        elif self.states.at[4] > 1:
            C_e, reference = (frame @ o.C_e_w for frame, o in both)
            out[s("position")] = -rotation_vector(C_e @ reference.T)[: self.states.at[4]]
            out[s("height")] = other.height - own.height
        return out

    def _mounted(self) -> Array:
        """Rotation from the slave's axes to the master's, shape (3,), with the flexure in use."""
        mounting, flexure = self.values[self.states.block("mounting")], self.values[self.states.block("flexure")]
        if not flexure.size:
            return mounting
        return rotation_vector(rotation_matrix(mounting) @ rotation_matrix(flexure))

    def _difference(self, state: State, now: model.Instant, reference: Reference) -> Array:
        """Slave less master, in the frame of the errors, with lever arm and mounting as they are in use."""
        if self.states.geographic:
            to_frame = parted(state, now.C @ rotation_matrix(now.mounting).T @ self.lever)
        else:
            to_frame = state.C_e_w @ wander.direction_cosines(reference.latitude, reference.longitude).T
        turned = rotation_matrix(now.mounting)
        flexing = self.values[self.states.block("flexure_rate")]
        rate = now.rate - flexing if flexing.size else now.rate
        carried = now.C @ cross(rate, turned.T @ self.lever)
        out = (now.velocity - to_frame @ reference.velocity - carried)[: self.states.at[1]]
        if not self._config.matches_attitude or reference.attitude is None:
            return np.asarray(out)
        error = now.C @ (to_frame @ reference.attitude @ turned).T
        return np.concatenate([out, -rotation_vector(error)])


def parted(state: State, offset: Array) -> Array:
    """How east, north, up turn over a short way, shape (3, 3): takes their coordinates at its beginning to those at its end.

    Parameters
    ----------
    state : State
        At its end.
    offset : ndarray, shape (3,), m
        The way, in east, north, up.
    """
    latitude, height = state.place[0], state.height
    meridian, normal = radii(latitude)
    east = offset[0] / (normal + height)
    return rotation_matrix([offset[1] / (meridian + height), -east, -east * np.tan(latitude)])


@lru_cache(maxsize=16)
def _threshold(probability: float, rows: int) -> float:
    """Chi-square quantile."""
    from scipy.stats import chi2

    return float(chi2.ppf(probability, rows))
