"""The error states of an alignment: which there are, what is known of them beforehand, what drives them, what shows them.

Errors of the navigation are computed less true: dv, phi with ``C~ = (I - [phi x]) C``, theta with ``C~_e = (I - [theta x])
C_e``, dh. All the others are what is still to be added to the value in use: gyro bias eps, accelerometer bias nab, mounting mu
(``C_s^m = exp([mu x])``), lever arm, flexure, delay of the master. How the first ones grow is in
:mod:`sagnac.kernels.error_model`.

Because the slave starts with its master's attitude, ``phi(0) = C mu``: the mounting is a copy of the attitude error at the
start. It costs three states and gives what is asked for, the mounting, also after the attitude error has gone its own way with
the drift of the gyros.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..earth import ELLIPSOID
from ..errors import InputError
from ..frames import Array, left_jacobian, rotation_matrix, skew, transform
from ..navigate.trajectory.carried import MARKOV_2

if TYPE_CHECKING:
    from .config import Config

_AXES = ("x", "y", "z")
_POLAR = np.radians(89.0)
_LOGGED = 0.1
"""m: how well the slave's position is at first the one of the master's log, lever arm added. The states of the position are those
against the log, whatever the log's own error: it is the same for both."""


@dataclass(frozen=True)
class Layout:
    """Names of the states and where their blocks are.

    Attributes
    ----------
    geographic : bool
        Whether errors are in east, north, up; else in the wander frame.
    names, units : tuple of str
    blocks : dict of str to slice
        ``velocity, attitude, gyro, accel, position, height, mounting, lever, flexure, flexure_rate, delay``, as far as there.
    at : ndarray of int, shape (10,)
        The first ones as :func:`sagnac.kernels.error_model.system` wants them.
    """

    geographic: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    blocks: dict[str, slice]
    at: np.ndarray[tuple[int], np.dtype[np.int64]]

    def __len__(self) -> int:
        """Number of states."""
        return len(self.names)

    def block(self, name: str) -> slice:
        """Where a block is; an empty slice where it is not."""
        return self.blocks.get(name, slice(0, 0))


def layout(
    method: Literal["wander", "geographic", "north-then-wander"],
    *,
    full: bool = False,
    lever: bool = False,
    flexure: bool = False,
    delay: bool = False,
) -> Layout:
    """The states of an alignment.

    Parameters
    ----------
    method : str
        ``wander`` has its errors in the wander frame (11 states in short form); the other two in east, north, up (10).
    full : bool
        Vertical velocity, position and height too (16 and 15 states).
    lever, flexure, delay : bool
        What else is estimated, besides the mounting.
    """
    geographic = method != "wander"
    axes = _AXES if full else _AXES[:2]
    position = ["position_error.x", "position_error.y"] if full else []
    wander = [] if geographic else ["wander_error"]
    table: list[tuple[str, str, Sequence[str]]] = [
        ("velocity", "m/s", [f"velocity_error.{a}" for a in axes]),
        ("attitude", "rad", [f"attitude_error.{a}" for a in _AXES]),
        ("gyro", "rad/s", [f"gyro.bias.{a}" for a in _AXES]),
        ("accel", "m/s^2", [f"accel.bias.{a}" for a in axes]),
        ("position", "rad", position + wander),
        ("height", "m", ["height_error"] if full else []),
        ("mounting", "rad", [f"misalignment.{a}" for a in _AXES]),
        ("lever", "m", [f"lever_arm.{a}" for a in _AXES] if lever else []),
        ("flexure", "rad", [f"flexure.{a}" for a in _AXES] if flexure else []),
        ("flexure_rate", "rad/s", [f"flexure_rate.{a}" for a in _AXES] if flexure else []),
        ("delay", "s", ["delay"] if delay else []),
    ]
    names: list[str] = []
    units: list[str] = []
    blocks: dict[str, slice] = {}
    for block, unit, own in table:
        if own:
            blocks[block] = slice(len(names), len(names) + len(own))
            names += own
            units += [unit] * len(own)
    turned = len(position + wander)
    start = {k: s.start for k, s in blocks.items()}
    at = [
        start["velocity"],
        len(axes),
        start["attitude"],
        start.get("position", 0),
        turned,
        start.get("height", -1),
        start["gyro"],
        start["accel"],
        len(axes),
        int(geographic),
    ]
    return Layout(geographic, tuple(names), tuple(units), blocks, np.array(at, dtype=np.int64))


def layout_of(config: Config) -> Layout:
    """The states that a configuration asks for."""
    return layout(
        config.method,
        full=config.states == "full",
        lever=config.initial.lever_arm is not None,
        flexure=config.flexure is not None,
        delay=config.initial.delay is not None,
    )


def refuse_poles(config: Config, latitude: Array, name: str) -> None:
    """Only the wander form with all states has no singular place: the others measure errors against east and north.

    Parameters
    ----------
    config : Config
    latitude : ndarray, shape (m,), rad
    name : str
        For the message.

    Raises
    ------
    InputError
        When the latitude is beyond 89 deg and the form is another one.
    """
    if float(np.abs(latitude).max()) > _POLAR and (config.method != "wander" or config.states != "full"):
        raise InputError(
            f"{name}: goes beyond 89 deg of latitude, where east, north and the wander angle are no good measure of an error: "
            'write method = "wander" and states = "full"'
        )


def prior(config: Config, states: Layout, now: Instant, height: float) -> tuple[Array, Array]:
    """Mean and covariance of the errors at the start, in SI.

    The slave takes its attitude and velocity from the master's log with the mounting, lever arm and delay in use: what is wrong
    with them is in the first attitude and velocity error from the beginning. The start is a measurement without a difference,
    ``H x = 0``, which gives both errors as combinations of the other states; on top of it comes what else is stated of them.

    What is stated of the mounting is told of its whole rotation vector mu, about zero, wherever the filter is linearised. With m
    in use, and what is still to be added to it d, ``exp(mu) = exp(m) exp(d)``, it is to first order ``mu = m + Jr(m)^-1 d``: d
    has the mean ``-m`` (``Jr(m) m = m``) and the covariance ``Jr S^2 Jr'``. That is the prior at the point that the filter ends
    near. A large mean must stay in its state until the readings have moved it; fed back at once it would undo the start.

    Parameters
    ----------
    config : Config
    states : Layout
    now : Instant
        The slave at the start, with the mounting in use.
    height : float, m

    Returns
    -------
    mean : ndarray, shape (n,)
    covariance : ndarray, shape (n, n)
    """
    first = config.initial
    s = states.block
    sigma = np.zeros(len(states))
    radius = ELLIPSOID[0] + height
    for block, value in (
        ("mounting", first.misalignment),
        ("gyro", first.gyro_bias),
        ("accel", first.accel_bias),
        ("height", first.height),
        ("lever", first.lever_arm),
        ("delay", first.delay),
    ):
        where = s(block)
        if value is not None and where.stop:
            sigma[where] = np.broadcast_to(value, (3,))[: where.stop - where.start] if np.ndim(value) else value
    turned = s("position").stop - s("position").start
    sigma[s("position")] = [*[_LOGGED / radius] * (turned - turned % 2), *[first.wander] * (turned % 2)]
    if config.flexure is not None:
        beta = MARKOV_2 / config.flexure.time
        sigma[s("flexure")] = config.flexure.sigma
        sigma[s("flexure_rate")] = beta * np.asarray(config.flexure.sigma)
    spread, mean = np.diag(sigma), np.zeros(len(states))
    spread[s("mounting")] = left_jacobian(now.mounting).T @ spread[s("mounting")]
    mean[s("mounting")] = -now.mounting
    H, rows = measurement(states, now, True), int(states.at[1])
    attitude, velocity = s("attitude"), s("velocity")
    for errors in (mean, spread):
        errors[attitude] = -H[rows:] @ errors
        errors[velocity] = -H[:rows] @ errors
    out = spread @ spread.T
    out[velocity, velocity] += first.velocity**2 * np.eye(rows)
    if config.matches_attitude:
        # the attitude that the slave starts with is one reading of the master's; with velocities alone the mounting is told
        # against that reading, as nothing can tell it from the master's true attitude
        out[attitude, attitude] += (config.noise.attitude or 0.0) ** 2 * np.eye(3)
    return mean, out


def reported(config: Config, states: Layout, variance: Array, height: float) -> Array:
    """Standard deviations of the states, with that of the master's own position in those of the position.

    Parameters
    ----------
    config : Config
    states : Layout
    variance : ndarray, shape (..., n)
        Of the states, in which the position is the slave's against the master's log.
    height : float, m
    """
    total = np.maximum(variance, 0.0)
    if config.states == "full":
        total = total.copy()
        where = states.block("position")
        total[..., where.start : where.start + 2] += (config.initial.position / (ELLIPSOID[0] + height)) ** 2
    return np.asarray(np.sqrt(total))


def driving_noise(config: Config, states: Layout) -> Array:
    """Spectral density of the white noise that drives each state, (n,), SI squared per second."""
    noise = config.noise
    q = np.zeros(len(states))
    for block, density in (
        ("velocity", noise.accel),
        ("attitude", noise.gyro),
        ("gyro", noise.gyro_walk),
        ("accel", noise.accel_walk),
    ):
        q[states.block(block)] = density**2
    if config.flexure is not None:
        beta = MARKOV_2 / config.flexure.time
        q[states.block("flexure_rate")] = 4.0 * beta**3 * np.asarray(config.flexure.sigma) ** 2
    return q


def reading_noise(config: Config, states: Layout) -> Array:
    """Variances of a sample of the master, in the order of the rows of :func:`measurement`, (k,), SI."""
    noise = config.noise
    attitude = [(noise.attitude or 0.0) ** 2] * (3 * config.matches_attitude)
    return np.array([noise.velocity**2] * int(states.at[1]) + attitude)


def complete(config: Config, states: Layout, F: Array) -> None:
    """Rows of F that the navigation does not fill: the flexure, ``l'' = -2 b l' - b^2 l + noise``."""
    if config.flexure is not None:
        beta = MARKOV_2 / config.flexure.time
        angle, rate = states.block("flexure"), states.block("flexure_rate")
        F[angle, rate] = np.eye(3)
        F[rate, angle] = -(beta**2) * np.eye(3)
        F[rate, rate] = -2.0 * beta * np.eye(3)


@dataclass(frozen=True)
class Instant:
    """What a measurement is linearised at, one or many: leading axes (...).

    Attributes
    ----------
    C : ndarray, shape (..., 3, 3)
        Takes the slave's axes to the frame of the errors.
    velocity, acceleration : ndarray, shape (..., 3), m/s and m/s^2
        Over the Earth, in the frame; of the velocity's components.
    rate : ndarray, shape (..., 3), rad/s
        Of the slave over the Earth, in its own axes.
    mounting : ndarray, shape (..., 3), rad
    lever : ndarray, shape (..., 3), m
        From master to slave, in the master's axes.
    """

    C: Array
    velocity: Array
    acceleration: Array
    rate: Array
    mounting: Array
    lever: Array

    def __getitem__(self, k: int) -> Instant:
        """One of many."""
        return Instant(*(getattr(self, f.name)[k] for f in fields(self)))


def measurement(states: Layout, now: Instant, attitude: bool) -> Array:
    """Matrix H of velocity, and attitude, matching.

    Parameters
    ----------
    states : Layout
    now : Instant
    attitude : bool
        Whether the attitude is matched too.

    Returns
    -------
    ndarray, shape (..., k, n)
        Two rows (three in full form) of ``v~ - v_master - C~ (w x l)``, then three of ``-log(C~ (C~_master exp(mu))')``.

    Notes
    -----
    In the wander form the master's velocity and attitude are brought to the slave's own computed frame; an error theta of that
    frame is in the difference, ``dv - v x theta`` and ``phi - C mu - theta``. In the geographic form both are taken in east,
    north, up as each one computes it, the master's turned by what north turns over the lever arm.
    """
    rows = states.at[1]
    H = np.zeros((*now.C.shape[:-2], rows + 3 * attitude, len(states)))
    s = states.block
    H[..., :rows, s("velocity")] = np.eye(rows)
    to_slave = np.swapaxes(rotation_matrix(now.mounting), -1, -2)
    lever = transform(to_slave, now.lever)
    swung = now.C @ skew(now.rate)  # C (w x .)
    carried = transform(swung, lever)
    H[..., :rows, s("attitude")] = -skew(carried)[..., :rows, :]
    turning = (swung @ skew(lever))[..., :rows, :]
    H[..., :rows, s("mounting")] = turning
    if "lever" in states.blocks:
        H[..., :rows, s("lever")] = (swung @ to_slave)[..., :rows, :]
    if "flexure" in states.blocks:
        H[..., :rows, s("flexure")] = turning
        H[..., :rows, s("flexure_rate")] = (now.C @ skew(lever))[..., :rows, :]
    if "delay" in states.blocks:
        H[..., :rows, s("delay")] = now.acceleration[..., :rows, None]
    axes = _turned_axes(states)
    H[..., :rows, s("position")] = -(skew(now.velocity) @ axes)[..., :rows, :]
    if attitude:
        _attitude_rows(states, now, axes, H[..., rows:, :])
    return H


def turn_errors(covariance: Array, where: slice, J: Array) -> None:
    """Write J times the errors of one block in the place of them, in a covariance, in place."""
    covariance[where] = J @ covariance[where]
    covariance[:, where] = covariance[:, where] @ J.T


def _turned_axes(states: Layout) -> Array:
    """How the frame that both are compared in turns with the states of position, (3, k)."""
    count = states.at[4]
    if states.geographic:
        return np.zeros((3, count))
    return np.eye(3)[:, 3 - count :] if count == 1 else np.eye(3)


def _attitude_rows(states: Layout, now: Instant, axes: Array, H: Array) -> None:
    """The three rows of the attitude, filled in."""
    s = states.block
    H[..., s("attitude")] = np.eye(3)
    H[..., s("mounting")] = -now.C
    H[..., s("position")] = -axes
    if "flexure" in states.blocks:
        H[..., s("flexure")] = -now.C
    if "delay" in states.blocks:
        H[..., s("delay")] = -transform(now.C, now.rate)[..., None]


def north_errors(states: Layout, C_w_n: Array, latitude: ArrayLike) -> Array:
    """Matrix that takes the states to the attitude error Phi in east, north, up.

    Parameters
    ----------
    states : Layout
    C_w_n : ndarray, shape (..., 3, 3)
    latitude : array_like, shape (...), rad

    Returns
    -------
    ndarray, shape (..., 3, n)
        In the wander form ``Phi = C_w_n (phi - theta) + psi``: theta is what turned the computed wander frame, and
        ``psi = (theta_E, theta_N, theta_N tan L)`` what turned the computed east, north, up with the position; in the short form,
        with the position known, theta is the wander error alone (Huang et al. 2011: the heading error is not phi_z). In the
        geographic form the states themselves.
    """
    pick = np.zeros((*C_w_n.shape[:-2], 3, len(states)))
    pick[..., states.block("attitude")] = np.eye(3)
    if states.geographic:
        return pick
    where = states.block("position")
    pick[..., where] = -_turned_axes(states)
    pick = np.asarray(C_w_n @ pick)
    if states.at[4] > 1:
        psi = C_w_n.copy()
        psi[..., 2, :] = psi[..., 1, :] * np.tan(np.asarray(latitude))[..., None]
        pick[..., where] += psi
    return pick
