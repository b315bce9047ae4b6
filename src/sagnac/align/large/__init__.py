"""The start of a transfer alignment whose mounting may be tens of degrees: where the linear filter can begin.

The filter of :mod:`sagnac.align.run` is linear in the error of the slave's attitude and good for a few degrees of it.
:func:`start` takes the first seconds of both systems as one problem (:mod:`sagnac.align.large.model`), which is exact for any
angle, and solves it down to the maximum of the posterior (:mod:`sagnac.align.large.fit`) from several start values: a
left-invariant filter that starts with no mounting, the closed form of Wahba's problem, and that one turned about the vertical by
half a turn. The filter then runs over the whole recording from its beginning, linearised about the mounting found.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...frames import Array, rot_z, rotation_vector
from ..samples import Slave, chosen
from .fit import Fit, by_filter, by_vectors, descend
from .model import Problem, prepare

if TYPE_CHECKING:
    from ..config import Config
    from ..master import Master

TARGET = np.radians(0.5)
"""One sigma of the mounting that is good enough for the linear filter: three of it are 1.5 degrees."""
LONGEST = 600.0
"""s: after which a start is made with what there is."""
SHORTEST = 4.0
"""s: what is looked at first; then twice as much, and so on."""
_ODDS = 1e-3
"""A second minimum that holds more than this share of the posterior is named."""
_DOUBT = 0.05
"""One that holds more than this means that the mounting is not known."""
_HOPELESS = 50.0
"""Cost above the least at which a descent is given up: what it may lead to has no share worth naming."""
_MISFIT = (1.5, 10.0)
"""Rms residual, in units of the stated noise, that is noted, and that no result survives."""


@dataclass(frozen=True)
class Start:
    """Where to linearise.

    Attributes
    ----------
    C_s_m : ndarray, shape (3, 3)
        Slave to master coordinates. The master's attitude at the start times this is the slave's.
    covariance : ndarray, shape (3, 3), rad^2
        Of the rotation that is left, in the slave's axes: ``C_s_m true = C_s_m exp([xi x])``. For information: the filter
        uses the same readings again, see :func:`start`.
    used : float, s
        Of both systems, from the start.
    converged : bool
        Whether the one maximum of the posterior was found and describes the readings.
    close : bool
        Whether all of `covariance` is within the target, so that a linear filter may go on from here.
    misfit : float
        Rms of the whitened residuals; one for a good model.
    gyro_bias, accel_bias : ndarray, shape (3,), rad/s and m/s^2
        Estimates that belong to it.
    notes : tuple of str
        What was not seen, did not settle, or has a rival.
    """

    C_s_m: Array
    covariance: Array
    used: float
    converged: bool
    close: bool
    misfit: float
    gyro_bias: Array
    accel_bias: Array
    notes: tuple[str, ...] = ()

    @property
    def mounting(self) -> Array:
        """Rotation vector of `C_s_m`, shape (3,), rad: what :func:`sagnac.align.run.transfer` takes."""
        return rotation_vector(self.C_s_m)

    @property
    def sigma(self) -> Array:
        """Standard uncertainties of the rotation that is left, shape (3,), rad, about the slave's axes."""
        return np.sqrt(np.diag(self.covariance))


def start(config: Config, slave: Slave, master: Master, *, target: float = TARGET, longest: float = LONGEST) -> Start:
    """Find the mounting well enough for a linear filter, whatever its size.

    Takes 4 s of both systems, then 8, 16, ... until the mounting is known to `target` about every axis, or there is no more.

    The caller runs its filter over the whole recording from the same sample of the master on, linearised about this mounting,
    and gives it *not* this covariance but the configuration's prior, which is centred at no mounting, as
    :func:`sagnac.align.model.prior` writes it around the new point: every reading then counts once, and the filter ends where
    it would have ended had it been started close to the truth. Where `close` is false a linear filter is not to be trusted from
    here.

    Parameters
    ----------
    config : Config
    slave : Slave
        Increments; its short gaps are bridged.
    master : Master
        With attitude, of which the first sample is enough unless it is matched.
    target : float, rad
        One sigma about every axis that is close enough.
    longest : float, s
        To go on for at most.

    Returns
    -------
    Start

    Raises
    ------
    InputError
        When the two have too little in common, or the master has no attitude at the start.
    DataError
        When a gap in the slave's samples within the time needed is too long to bridge.
    """
    matched = chosen(config, slave, master, longest)
    stamps = master.time[matched] - config.latency
    slave = _within(slave, float(stamps[0]), float(stamps[-1]))
    span = float(stamps[-1] - stamps[0])
    for time in _horizons(span):
        count = int(np.searchsorted(stamps, stamps[0] + time + 1e-6)) - 1
        last = time >= span
        if count < 3 and not last:
            continue
        reach = _within(slave, float(stamps[0]), float(stamps[count]))
        problem = prepare(config, reach, master, matched[: count + 1])
        if not last and _largest(descend(problem, by_vectors(problem)).covariance) > target:
            continue
        fits = minima(problem)
        if _largest(fits[0].covariance) <= target and _sound(problem, fits):
            break
    best = fits[0]
    return Start(
        best.point.mounting,
        best.covariance,
        float(problem.time[-1] - problem.time[0]),
        _sound(problem, fits),
        bool(_largest(best.covariance) <= target),
        misfit(problem, best),
        best.point.gyro,
        best.point.accel,
        tuple(_notes(problem, fits, target, master.velocity[matched[: problem.time.size]])),
    )


def minima(problem: Problem) -> list[Fit]:
    """Different minima of the problem, the one with the most of the posterior first.

    Parameters
    ----------
    problem : Problem
    """
    vectors = by_vectors(problem)
    turned = rot_z(np.pi) @ vectors.attitude
    mounting = problem.master.T @ turned
    starts = [
        by_filter(problem),
        vectors,
        vectors._replace(attitude=turned, mounting=mounting),
    ]
    fits = [descend(problem, point) for point in starts]
    least = min(fit.cost for fit in fits)
    return _different(fit for fit in fits if fit.cost < least + _HOPELESS)


def _different(fits: Iterable[Fit]) -> list[Fit]:
    """Those that are more than three sigma from all better ones, best first."""
    out: list[Fit] = []
    for fit in sorted(fits, key=lambda fit: (not fit.settled, -fit.evidence)):
        if all(_apart(one, fit) for one in out):
            out.append(fit)
    return out


def misfit(problem: Problem, fit: Fit) -> float:
    """Rms of the whitened residuals: one for a good model."""
    return float(np.sqrt(fit.cost / problem.count))


def _apart(one: Fit, other: Fit) -> bool:
    """Whether two minima are different ones: further from each other than three sigma."""
    turn = rotation_vector(one.point.mounting.T @ other.point.mounting)
    return float(turn @ np.linalg.solve(one.covariance, turn)) > 9.0


def _shares(fits: list[Fit]) -> Array:
    """Share of the posterior about each minimum (Laplace)."""
    weight = np.exp(np.minimum([fit.evidence - fits[0].evidence for fit in fits], 50.0))
    return np.asarray(weight / weight.sum())


def _sound(problem: Problem, fits: list[Fit]) -> bool:
    return fits[0].settled and float(_shares(fits)[1:].sum()) < _DOUBT and misfit(problem, fits[0]) < _MISFIT[1]


def _largest(covariance: Array) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


def _horizons(span: float) -> list[float]:
    count = max(0, int(np.ceil(np.log2(span / SHORTEST)))) if span > SHORTEST else 0
    return [SHORTEST * 2.0**i for i in range(count)] + [span]


def _within(slave: Slave, first: float, last: float) -> Slave:
    """The samples that reach into a stretch of time, and one before."""
    a = max(int(np.searchsorted(slave.time, first, side="right")) - 2, 0)
    b = min(int(np.searchsorted(slave.time, last + 0.1)) + 1, slave.steps.size)
    return Slave(slave.time[a : b + 1], slave.steps[a:b], slave.turns[a:b], slave.pushes[a:b], slave.name)


def _notes(problem: Problem, fits: list[Fit], target: float, velocity: Array) -> list[str]:
    """What there is to say about a start, in words."""
    best, span = fits[0], problem.time[-1] - problem.time[0]
    out = []
    if not best.settled:
        out.append(f"the iteration had not settled after {best.steps} steps; the mounting is not to be trusted")
    size = misfit(problem, best)
    if size > _MISFIT[0]:
        out.append(
            f"the residuals are {size:.3g} times what the stated noise allows: look at noise.velocity, the lever arm, the "
            "lateness of the master, the signs and units of the slave's axes"
        )
    for fit, share in zip(fits[1:], _shares(fits)[1:], strict=True):
        if share > _ODDS:
            apart = np.degrees(np.linalg.norm(rotation_vector(best.point.mounting.T @ fit.point.mounting)))
            angles = ", ".join(f"{a:.3g}" for a in np.degrees(rotation_vector(fit.point.mounting)))
            out.append(
                f"another mounting, rotation vector ({angles}) deg, {apart:.3g} deg away, explains the readings as well: its "
                f"share is {100 * share:.2g} %. More time, or a manoeuvre, tells them apart"
            )
    return out + _unseen(problem, best, target, velocity, span)


def _unseen(problem: Problem, best: Fit, target: float, velocity: Array, span: float) -> list[str]:
    """Which rotations are not known well enough, and why."""
    up = best.point.attitude[2]
    azimuth = float(np.sqrt(up @ best.covariance @ up))
    level = np.eye(3) - np.outer(up, up)
    tilt = _largest(level @ best.covariance @ level)
    out = []
    if tilt > target:
        out.append(f"after {span:.4g} s the level has a standard uncertainty of {np.degrees(tilt):.2g} deg")
    if azimuth <= target:
        return out
    beforehand = float(np.sqrt(up @ np.diag(problem.sigma[:3] ** 2) @ up))
    text = f"after {span:.4g} s the azimuth has a standard uncertainty of {np.degrees(azimuth):.2g} deg"
    changes = velocity[:, :2] - velocity[:, :2].mean(axis=0)
    noise = np.sqrt(problem.noise[0])
    if float(np.sqrt(np.mean(np.sum(changes**2, axis=1)))) < max(0.3, 5.0 * noise):
        text += ": on a straight and steady course it is seen only through the Earth's rotation"
    else:
        text += ": the manoeuvre is too small for it"
    if azimuth > 0.8 * beforehand:
        text += "; nothing is seen of it, and what is given is what was known beforehand"
    return [*out, text + ". A turn or a change of speed shows it within seconds"]
