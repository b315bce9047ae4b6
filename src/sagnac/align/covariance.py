"""The alignment's question without data: how well will each state be known along a course.

The covariance of a Kalman filter does not depend on what is measured: following it along the true course, with the same model as
the filter's, gives the standard deviations that many runs would show.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..earth import ELLIPSOID, gravity_excess
from ..errors import InputError
from ..frames import Array, transform
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

    excess = gravity_excess(config.gravity, config.trajectory.latitude, config.trajectory.height)
    course = Trajectory.of(config.trajectory, earth_rate=config.earth_rate, gravity_excess=excess)
    states = model.layout_of(config)
    count = int(course.duration / config.update_interval + 1e-9)
    times = np.asarray(config.update_interval * np.arange(count + 1.0), dtype=np.float64)
    start = course.state(times[:1])
    _, P = model.prior(config, states, _instants(config, states, course, times[:1], start)[0], float(start.height[0]))
    observer = Observer(P, states.names)
    found = []
    for i in range(0, times.size - 1, _PIECE):
        found.append(_follow(config, states, course, times[i : i + _PIECE + 1], P, observer))
        observer.look(float(times[min(i + _PIECE, times.size - 1)]))
    sigmas, angles, spread, places = (np.concatenate(part) for part in zip(*found, strict=True))
    rows = innovation_names(config, states)
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


def _instants(config: Config, states: model.Layout, course: Trajectory, times: Array, at: State) -> model.Instant:
    """What measurements at times are linearised at; the acceleration is the mean over the interval around, or before the end."""
    model.refuse_poles(config, at.place[0], "[trajectory]")
    frame = _frames(states, at)
    C = frame @ at.C_b_w
    rate = course.inputs(times)[1] - config.earth_rate * transform(np.swapaxes(at.C_b_w, 1, 2), at.C_e_w[:, :, 2])
    half = 0.5 * config.update_interval
    ends = [np.clip(times + side, 0.0, course.duration) for side in (-half, half)]
    velocities = [transform(_frames(states, s), s.velocity) for s in map(course.state, ends)]
    count = times.size
    return model.Instant(
        C,
        transform(frame, at.velocity),
        (velocities[1] - velocities[0]) / (ends[1] - ends[0])[:, None],
        rate,
        np.zeros((count, 3)),
        np.broadcast_to(np.array(config.lever_arm), (count, 3)),
    )


def _follow(
    config: Config, states: model.Layout, course: Trajectory, times: Array, P: Array, observer: Observer
) -> tuple[Array, Array, Array, Array]:
    """Over some updates: standard deviations, attitude angles and theirs, places."""
    from ..kernels.covariance import follow

    steps, middle = np.diff(times), 0.5 * (times[1:] + times[:-1])
    inside, after = course.state(middle), course.state(times[1:])
    frame = _frames(states, inside)
    C = frame @ inside.C_b_w
    force = transform(C, course.inputs(middle)[0])
    now = _instants(config, states, course, times[1:], after)
    count, n = steps.size, len(states)
    still, sigmas, tilts = np.zeros((n, n)), np.empty((count, n)), np.empty((count, 3, 3))
    model.complete(config, states, still)
    follow(
        np.ascontiguousarray(C),
        transform(frame, inside.velocity),
        transform(frame, inside.C_e_w[:, :, 2]),
        np.ascontiguousarray(inside.height),
        force,
        steps,
        config.earth_rate,
        ELLIPSOID,
        states.at,
        still,
        model.measurement(states, now, config.matches_attitude),
        model.reading_noise(config, states),
        model.driving_noise(config, states),
        model.north_errors(states, after.C_w_n, after.place[0]),
        P,
        observer.transition,
        observer.gramian,
        sigmas,
        tilts,
    )
    angles = np.stack(after.angles, axis=1)
    places = np.stack([*after.place[:2], after.height], axis=1)
    sigmas = model.reported(config, states, sigmas**2, float(places[0, 2]))
    return sigmas, angles, angle_sigmas(after.C_b_n, tilts), places
