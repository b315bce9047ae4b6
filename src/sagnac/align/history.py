"""What is kept of an alignment, update by update, and the result made of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..frames import Array, heading_pitch_roll, left_jacobian
from ..navigate.state import State
from ..navigate.strapdown import Navigator
from . import model
from .observability import Observability, Observer
from .smoother import Passed, added, smooth

if TYPE_CHECKING:
    from .config import Config
    from .filter import Filter, Match

STEADY = np.radians(3.0)
"""Estimates of the attitude are fed back when they and their standard deviations are smaller than this. Before that, a start
from a large mounting stays where it was linearised: the prior is centred elsewhere, and has to be shouted down first."""
_LOOK = 20
"""Updates from one look at the Gramian to the next."""
OF_NAVIGATION = ("velocity", "attitude", "position", "height")
"""Blocks of states that are errors of the navigation; the others are parameters."""


@dataclass(frozen=True)
class Run:
    """What an alignment found, update by update.

    Attributes
    ----------
    names, units : tuple of str, length n
        Of the states.
    time : ndarray, shape (m,), s
    values : ndarray, shape (m, n)
        Parameters as estimated; errors of the navigation as they were taken out at this update (feedback), or those of the
        slave that has navigated on its own since the start (output). NaN in a covariance analysis.
    sigmas : ndarray, shape (m, n)
    covariance : ndarray, shape (n, n)
        At the end.
    innovation_names : tuple of str, length k
    innovations, innovation_sigmas : ndarray, shape (m, k)
        NaN at times without a sample of the master.
    used : ndarray of bool, shape (m,)
        Whether a sample of the master was taken in.
    nis : ndarray, shape (m,)
        Normalised innovation squared, chi-square with k degrees of freedom.
    angles, angle_sigmas : ndarray, shape (m, 3), rad
        Corrected heading, pitch and roll of the slave.
    places : ndarray, shape (m, 3), rad, rad, m
        Corrected latitude, longitude and height.
    observability : Observability
    final : State
        Of the slave, corrected, ready to navigate on in the wander frame.
    start : float, s
        When it began.
    skipped : tuple of (float, float, str)
        From, to [s] and why.
    smoothed, smoothed_sigmas : ndarray, shape (m, n), or None
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: Array
    values: Array
    sigmas: Array
    covariance: Array
    innovation_names: tuple[str, ...]
    innovations: Array
    innovation_sigmas: Array
    used: np.ndarray[tuple[int], np.dtype[np.bool_]]
    nis: Array
    angles: Array
    angle_sigmas: Array
    places: Array
    observability: Observability
    final: State
    start: float = 0.0
    skipped: tuple[tuple[float, float, str], ...] = ()
    smoothed: Array | None = None
    smoothed_sigmas: Array | None = None


def innovation_names(config: Config, states: model.Layout) -> tuple[str, ...]:
    """Names of what is matched."""
    axes = ("east", "north", "up") if states.geographic else ("x", "y", "z")
    names = [f"velocity.{a}" for a in axes[: states.at[1]]]
    return tuple(names + [f"attitude.{a}" for a in axes] * config.matches_attitude)


def angle_sigmas(C_b_n: Array, covariance: Array) -> Array:
    """Standard deviations of heading, pitch and roll.

    Parameters
    ----------
    C_b_n : ndarray, shape (m, 3, 3)
    covariance : ndarray, shape (m, 3, 3), rad^2
        Of the attitude error Phi, ``C~ = (I - [Phi x]) C``, in east, north, up.

    Returns
    -------
    ndarray, shape (m, 3), rad
    """
    r = -np.eye(3)
    # change of each body axis, (m, 3 components of Phi, 3)
    x, y, z = (np.cross(r, C_b_n[:, None, :, i]) for i in range(3))
    c = C_b_n
    level = c[:, 0, 1] ** 2 + c[:, 1, 1] ** 2
    heading = (y[..., 0] * c[:, 1, 1, None] - y[..., 1] * c[:, 0, 1, None]) / level[:, None]
    pitch = y[..., 2] / np.sqrt(level)[:, None]
    roll = (c[:, 2, 0, None] * z[..., 2] - x[..., 2] * c[:, 2, 2, None]) / (c[:, 2, 0] ** 2 + c[:, 2, 2] ** 2)[:, None]
    J = np.stack([heading, pitch, roll], axis=1)
    return np.asarray(np.sqrt(np.einsum("mai,mij,maj->ma", J, covariance, J)))


class History:
    """Notes what a filter does.

    Parameters
    ----------
    config : Config
    filter_ : Filter
        At its start.
    raw : Navigator, optional
        The slave that navigates on its own.
    """

    def __init__(self, config: Config, filter_: Filter, raw: Navigator | None) -> None:
        self._config, self._filter, self._raw = config, filter_, raw
        self._states = filter_.states
        self._held = filter_.x.copy()
        self._observer = Observer(filter_.P, filter_.states.names)
        self._times: list[float] = []
        self._values: list[Array] = []
        self._sigmas: list[Array] = []
        self._attitudes: list[Array] = []
        self._tilts: list[Array] = []
        self._places: list[Array] = []
        self._matches: list[Match | None] = []
        self._passed: list[Passed] = []

    def note(self, time: float, match: Match | None) -> None:
        """After an update, or an interval without one: feed back, and keep what is asked for."""
        filter_, s = self._filter, self._states.block
        self._observer.advance(filter_.phi)
        if match is not None and match.used:
            self._observer.see(match.H, match.R)
        if len(self._times) % _LOOK == 0:
            self._observer.look(time)
        doubt = np.sqrt(filter_.P.diagonal()[s("attitude")])
        steady = float(np.maximum(np.abs(filter_.x[s("attitude")]), doubt).max()) < STEADY
        x = filter_.feed_back() if steady else filter_.x.copy()
        if self._config.smooth:
            mean = filter_.phi @ self._held
            self._passed.append(Passed(filter_.phi.copy(), filter_.predicted.copy(), filter_.P.copy(), mean, x, steady))
        self._held = np.zeros_like(x) if steady else x
        values = added(filter_.values, self._held, s("attitude"), s("mounting"))
        errors = x if self._raw is None else filter_.less(self._raw.state)
        for block in OF_NAVIGATION:
            values[s(block)] = errors[s(block)]
        state = filter_.state
        self._times.append(time)
        self._values.append(values)
        variance, where, J = filter_.P.diagonal().copy(), s("mounting"), self._told()
        variance[where] = (J @ filter_.P[where, where] @ J.T).diagonal()
        self._sigmas.append(model.reported(self._config, self._states, variance, float(state.height)))
        self._attitudes.append(state.C_b_n)
        self._tilts.append(self._tilt(state))
        self._places.append(np.array([*state.place[:2], state.height]))
        self._matches.append(match)

    def _told(self) -> Array:
        """Takes errors of the mounting to those of the numbers told, (3, 3): ``log(exp(m) exp(d)) = m + Jr(m)^-1 d``."""
        return np.asarray(np.linalg.inv(left_jacobian(-self._filter.values[self._states.block("mounting")])))

    def _tilt(self, state: State) -> Array:
        """Covariance of the attitude error in east, north, up."""
        pick = model.north_errors(self._states, state.C_w_n, state.place[0])
        return np.asarray(pick @ self._filter.P @ pick.T)

    def run(self, start: float, skipped: tuple[tuple[float, float, str], ...]) -> Run:
        """All of it, and the time at the start."""
        states, last = self._states, self._filter
        rows = innovation_names(self._config, states)
        covariance = last.P.copy()
        model.turn_errors(covariance, states.block("mounting"), self._told())
        nothing = np.full(len(rows), np.nan)
        C = np.stack(self._attitudes)
        values = np.stack(self._values)
        smoothed, smoothed_sigmas = None, None
        if self._config.smooth:
            where = states.block("attitude"), states.block("mounting")
            corrections, smoothed_sigmas = smooth(self._passed, *where)
            smoothed = np.stack([added(v, c, *where) for v, c in zip(values, corrections, strict=True)])
        return Run(
            states.names,
            states.units,
            np.array(self._times),
            values,
            np.stack(self._sigmas),
            covariance,
            rows,
            np.stack([nothing if m is None else m.innovation for m in self._matches]),
            np.stack([nothing if m is None else m.sigma for m in self._matches]),
            np.array([m is not None and m.used for m in self._matches]),
            np.array([np.nan if m is None else m.distance for m in self._matches]),
            np.stack(heading_pitch_roll(C), axis=1),
            angle_sigmas(C, np.stack(self._tilts)),
            np.stack(self._places),
            self._observer.result(last.P),
            last.state,
            start,
            skipped,
            smoothed,
            smoothed_sigmas,
        )
