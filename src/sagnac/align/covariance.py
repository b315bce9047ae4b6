"""The alignment's question without data: how well will each state be known along a course.

The covariance of a Kalman filter does not depend on what is measured: following it along the true course, with the same model as
the filter's, gives the standard deviations that many runs would show.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..earth import ELLIPSOID
from ..errors import InputError
from ..frames import Array
from ..navigate import wander
from ..navigate.state import State
from . import model
from .history import Run, angle_sigmas, innovation_names
from .observability import Observer

if TYPE_CHECKING:
    from ..navigate.trajectory import Trajectory
    from .config import Config

_PIECE = 100
"""Updates at a time: what bounds the memory besides the results, and from one look at the Gramian to the next."""


def covariance(config: Config) -> Run:
    """Standard deviations of an alignment along the course of its configuration.

    Parameters
    ----------
    config : Config
        With ``[trajectory]``.

    Returns
    -------
    Run
        With NaN in the place of estimates and innovations.

    Raises
    ------
    InputError
        When the configuration has no course, or one over a pole in a form that cannot go there.
    """
    if config.trajectory is None:
        raise InputError("[trajectory] is missing: a covariance analysis needs the course that the master would take")
    from ..navigate.trajectory import Trajectory

    course = Trajectory.of(config.trajectory, earth_rate=config.earth_rate)
    states = model.layout_of(config)
    count = int(course.duration / config.update_interval + 1e-9)
    times = np.asarray(config.update_interval * np.arange(count + 1.0), dtype=np.float64)
    model.refuse_poles(config, course.state(times).place[0], "[trajectory]")
    start = course.state(times[:1])
    first = model.prior(config, states, _frames(states, start)[0] @ start.C_b_w[0], float(start.height[0]))
    P, observer = first.copy(), Observer(first, states.names)
    found = []
    for i in range(0, times.size - 1, _PIECE):
        found.append(_follow(config, states, course, times[i : i + _PIECE + 1], P, observer))
        observer.look(float(times[min(i + _PIECE, times.size - 1)]))
    sigmas, angles, spread, places = (np.concatenate(part) for part in zip(*found, strict=True))
    attitude = config.matching == "velocity+attitude"
    rows = innovation_names(states.geographic, int(states.at[1]), attitude)
    nothing = np.full((count, len(rows)), np.nan)
    end = course.state(times[-1:])
    return Run(
        states.names,
        states.units,
        times[1:],
        np.full_like(sigmas, np.nan),
        sigmas,
        P,
        rows,
        nothing,
        nothing,
        np.zeros(count, dtype=bool),
        np.full(count, np.nan),
        angles,
        spread,
        places,
        observer.result(P),
        State(end.C_b_w[0], end.velocity[0], end.C_e_w[0], end.height[0]),
    )


def _frames(states: model.Layout, at: State) -> Array:
    """Take coordinates in w to the frame of the errors, (m, 3, 3)."""
    return at.C_w_n if states.geographic else np.broadcast_to(np.eye(3), at.C_b_w.shape)


def _apply(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("mij,mj->mi", matrices, vectors))


def _follow(
    config: Config, states: model.Layout, course: Trajectory, times: Array, P: Array, observer: Observer
) -> tuple[Array, Array, Array, Array]:
    """Over some updates: standard deviations, attitude angles and theirs, places."""
    from ..kernels.covariance import follow

    steps, middle = np.diff(times), 0.5 * (times[1:] + times[:-1])
    inside, ends = course.state(middle), course.state(times)
    frame = _frames(states, inside)
    C = frame @ inside.C_b_w
    force = _apply(C, course.inputs(middle)[0])
    after = State(ends.C_b_w[1:], ends.velocity[1:], ends.C_e_w[1:], ends.height[1:])
    velocities = _apply(_frames(states, ends), ends.velocity)
    own = wander.transport_rate(after.C_e_w, after.velocity, after.height) + config.earth_rate * after.C_e_w[:, :, 2]
    rate = course.inputs(times[1:])[1] - _apply(np.swapaxes(after.C_b_w, 1, 2), own)
    count, n = steps.size, len(states)
    now = model.Instant(
        _frames(states, after) @ after.C_b_w,
        velocities[1:],
        np.diff(velocities, axis=0) / steps[:, None],
        rate,
        np.zeros((count, 3)),
        np.broadcast_to(np.array(config.lever_arm), (count, 3)),
    )
    attitude = config.matching == "velocity+attitude"
    noise = config.noise
    R = np.array([noise.velocity**2] * int(states.at[1]) + [(noise.attitude or 0.0) ** 2] * (3 * attitude))
    still, sigmas, tilts = np.zeros((n, n)), np.empty((count, n)), np.empty((count, 3, 3))
    model.complete(config, states, still)
    follow(
        np.ascontiguousarray(C),
        _apply(frame, inside.velocity),
        _apply(frame, inside.C_e_w[:, :, 2]),
        np.ascontiguousarray(inside.height),
        force,
        steps,
        config.earth_rate,
        ELLIPSOID,
        states.at,
        still,
        model.measurement(states, now, attitude),
        R,
        model.driving_noise(config, states),
        model.north_errors(states, after.C_w_n),
        P,
        observer.transition,
        observer.gramian,
        sigmas,
        tilts,
    )
    angles = np.stack(after.angles, axis=1)
    places = np.stack([*after.place[:2], after.height], axis=1)
    return sigmas, angles, angle_sigmas(after.C_b_n, tilts), places
