"""Strapdown navigation: from increments of angle and velocity to attitude, velocity and position.

In the wander frame w (z up, x at the wander angle from east), with C = C_b_w, v the velocity over the Earth in w and p
the first two components of the Earth's axis in w (:func:`sagnac.navigate.wander.curvature`)::

    w_ew = (-(K v)_y, (K v)_x, 0),   K = k1 I + k2 p p',   w_ie = w_e C_e_w[:, 2]
    dv/dt = C f - (2 w_ie + w_ew) x v - g z,   dh/dt = v_z
    dC_e_w/dt = -[w_ew x] C_e_w,   dC/dt = C [w_ib x] - [(w_ie + w_ew) x] C

which has no singular place (Savage, J. Guidance 21(1, 2), 1998; Jekeli, *Inertial Navigation Systems with Geodetic
Applications*, 2001, 4.3). A north-slaved system is the same with w_ew_z = (K v)_x tan L, which keeps x east and is
singular at the poles. The integration itself, and its treatment of coning, is described in
:func:`sagnac.kernels.strapdown.advance`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..earth import EARTH_RATE, ELLIPSOID
from ..errors import DataError, InputError
from ..frames import Array, cross, rotation_matrix
from ..recording import GAP
from .state import State

Frame = Literal["wander", "north"]
Vertical = Literal["free", "held"]
Meaning = Literal["instant", "mean"]

_FULL = 24  # numbers of a state with the sample before: see sagnac.kernels.strapdown
_NO_HEIGHTS = np.empty(0)
_NEAR_POLE = 0.05  # rad: north-slaved axes that turn by more in one group are metres off after it, soon kilometres


class Settings(TypedDict, total=False):
    """What :class:`Navigator` takes by name."""

    samples: int
    frame: Frame
    vertical: Vertical
    earth_rate: float
    gravity_excess: float


def pack(state: State) -> Array:
    """A state as the kernels have it, see :mod:`sagnac.kernels.strapdown`.

    Parameters
    ----------
    state : State
        One.

    Returns
    -------
    ndarray, shape (24,)
        With no sample before.
    """
    from scipy.spatial.transform import Rotation

    out = np.zeros(_FULL)
    out[:4] = Rotation.from_matrix(state.C_b_w).as_quat()
    out[4:7] = state.velocity
    out[7:16] = state.C_e_w.ravel()
    out[16] = state.height
    return out


def unpack(numbers: Array) -> State:
    """States of what the kernels have, the inverse of :func:`pack`.

    Parameters
    ----------
    numbers : ndarray, shape (..., 17) or (..., 24)
    """
    from scipy.spatial.transform import Rotation

    lead = numbers.shape[:-1]
    attitude = Rotation.from_quat(numbers[..., :4].reshape(-1, 4)).as_matrix().reshape(*lead, 3, 3)
    C_e_w = numbers[..., 7:16].reshape(*lead, 3, 3).copy()
    return State(attitude, numbers[..., 4:7].copy(), C_e_w, numbers[..., 16].copy())


class Navigator:
    """A strapdown system that is advanced sample by sample, or by many samples at once, and corrected in between.

    Parameters
    ----------
    state : State
        Where it starts. With ``frame="north"`` it is first turned so that the wander angle is zero.
    samples : int
        Samples in a group for coning and sculling, 1 to 4. Those that come one by one are groups of one in any case.
    frame : {"wander", "north"}
        "north": w is turned with north.
    vertical : {"free", "held"}
        "held": the height stays and the vertical velocity is zero.
    earth_rate : float, rad/s
    gravity_excess : float, m/s^2
        Real gravity less the normal one.

    Attributes
    ----------
    pushed : ndarray, shape (3,), m/s
        Velocity gained from the specific force since the start, or since it was set to zero, in w.
    """

    def __init__(
        self,
        state: State,
        *,
        samples: int = 2,
        frame: Frame = "wander",
        vertical: Vertical = "free",
        earth_rate: float = EARTH_RATE,
        gravity_excess: float = 0.0,
    ) -> None:
        from ..kernels.strapdown import advance

        _check_settings(samples, frame, vertical)
        self._kernel: Any = advance
        self._slaved = frame == "north"
        self._numbers = pack(_to_north(state) if self._slaved else state)
        self._settings = (samples, self._slaved, vertical == "held")
        self._constants = np.array([*ELLIPSOID, earth_rate, gravity_excess])
        self._turn, self._push, self._step = np.empty((1, 3)), np.empty((1, 3)), np.empty(1)
        self.pushed = np.zeros(3)

    @property
    def state(self) -> State:
        """Attitude, velocity and position as they are now."""
        return unpack(self._numbers)

    @property
    def numbers(self) -> Array:
        """The same as the kernels have it, shape (24,); a view."""
        return self._numbers

    def step(self, turn: ArrayLike, push: ArrayLike, dt: float) -> None:
        """Advance by one sample.

        Parameters
        ----------
        turn : array_like, shape (3,), rad
            Integral of the angular rate over the sample interval, in body axes.
        push : array_like, shape (3,), m/s
            Integral of the specific force.
        dt : float, s
            Length of the sample interval.

        Raises
        ------
        InputError
            If the step is not above zero.
        DataError
            If a north-slaved system comes too near a pole. Samples that are no numbers are passed on.
        """
        if not dt > 0.0:
            raise InputError(f"a sample interval is above zero, not {dt:g} s")
        self._turn[0] = turn
        self._push[0] = push
        self._step[0] = dt
        settings = (*self._settings, _NO_HEIGHTS, self._constants, self.pushed)
        self._near_pole(self._kernel(self._numbers, self._turn, self._push, self._step, *settings))

    def advance(self, turns: Array, pushes: Array, steps: ArrayLike, heights: Array | None = None) -> None:
        """Advance by many samples.

        Parameters
        ----------
        turns : ndarray, shape (n, 3), rad
            Integrals of the angular rate over the sample intervals, in body axes.
        pushes : ndarray, shape (n, 3), m/s
            Integrals of the specific force.
        steps : array_like, shape (n,) or (), s
            Lengths of the sample intervals.
        heights : ndarray, shape (n,), m, optional
            Height at the end of each sample interval, from another instrument; the vertical velocity is its
            difference quotient.

        Raises
        ------
        InputError
            If the shapes do not fit or a step is not above zero.
        DataError
            If the result is not a number: samples that are none, or a north-slaved system at a pole.
        """
        samples = _samples(turns, pushes, steps, heights)
        settings = (*self._settings, samples[3], self._constants, self.pushed)
        self._check(self._kernel(self._numbers, *samples[:3], *settings))

    def trace(
        self,
        turns: Array,
        pushes: Array,
        steps: ArrayLike,
        heights: Array | None = None,
        *,
        every: int = 1,
        since: int = 0,
        time: float = 0.0,
    ) -> tuple[Array, float]:
        """Advance by many samples and keep every k-th state.

        Parameters
        ----------
        turns, pushes, steps, heights
            As :meth:`advance` takes them.
        every : int
            Keep the state after so many samples each. Groups for coning end there.
        since : int
            Samples since the last kept state, before these.
        time : float, s
            Time of the state before these samples.

        Returns
        -------
        rows : ndarray, shape (m, 25)
            Time and state, see :func:`unpack`.
        time : float, s
            After the last sample.

        Raises
        ------
        InputError, DataError
            As :meth:`advance` does.
        """
        from ..kernels.strapdown import trace

        t, p, h, given = _samples(turns, pushes, steps, heights)
        rows, clock = np.empty(((since + h.size) // every, 1 + _FULL)), np.array([time])
        settings = (*self._settings, given, self._constants, self.pushed)
        self._check(trace(self._numbers, t, p, h, *settings, every, since, clock, rows))
        return rows, float(clock[0])

    def correct(
        self,
        *,
        attitude: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        position: ArrayLike | None = None,
        height: float | None = None,
    ) -> None:
        """Take estimated errors out. An error is what was computed less what is true.

        Parameters
        ----------
        attitude : array_like, shape (3,), rad
            phi: the computed attitude is ``(I - [phi x]) C_b_w``.
        velocity : array_like, shape (3,) or (2,), m/s
            dv, in w; two numbers leave the vertical one alone.
        position : array_like, shape (3,), rad
            theta: the computed position is ``(I - [theta x]) C_e_w``.
        height : float, m
        """
        numbers = self._numbers
        if attitude is not None:
            _turn_left(numbers[:4], np.asarray(attitude, dtype=float))
        if velocity is not None:
            dv = np.asarray(velocity, dtype=float)
            numbers[4 : 4 + dv.size] -= dv
        if position is not None:
            C_e_w = rotation_matrix(position) @ numbers[7:16].reshape(3, 3)
            numbers[7:16] = C_e_w.ravel()
        if height is not None:
            numbers[16] -= height
        if self._slaved and position is not None:
            numbers[:17] = pack(_to_north(self.state))[:17]

    def _near_pole(self, turned: float) -> None:
        if turned > _NEAR_POLE:
            raise DataError(
                f"too near a pole for a north-slaved system: its axes turned by {np.degrees(turned):.2g} deg in one"
                " group of samples; use the wander frame"
            )

    def _check(self, turned: float) -> None:
        self._near_pole(turned)
        if not np.isfinite(self._numbers).all():
            pole = ", or use the wander frame at a pole" if self._slaved else ""
            raise DataError(
                f"attitude, velocity and position are no longer numbers: look for samples that are none{pole}"
            )


@dataclass(frozen=True)
class Path:
    """Where a strapdown system went.

    Attributes
    ----------
    time : ndarray, shape (m,), s
    states : State
        Of arrays with m entries.
    """

    time: Array
    states: State


def integrate(
    state: State,
    turns: Array,
    pushes: Array,
    steps: ArrayLike,
    *,
    every: int = 1,
    heights: Array | None = None,
    start: float = 0.0,
    **settings: Unpack[Settings],
) -> Path:
    """Advance a state over all samples and keep every k-th one.

    Parameters
    ----------
    state : State
        Before the first sample.
    turns, pushes, steps, heights
        As :meth:`Navigator.advance` takes them.
    every : int
        Keep the state after so many samples each. Groups for coning end there: a multiple of `samples` is best.
    start : float, s
        Time of `state`.
    **settings
        `samples`, `frame`, `vertical`, `earth_rate` and `gravity_excess` as :class:`Navigator` takes them.

    Returns
    -------
    Path
        The state before the first sample, after every k-th and after the last one.

    Raises
    ------
    InputError, DataError
        As :meth:`Navigator.advance` does.
    """
    return integrate_pieces(state, [(turns, pushes, steps, heights)], every=every, start=start, **settings)


def integrate_pieces(
    state: State,
    pieces: Iterable[tuple[Any, ...]],
    *,
    every: int = 1,
    start: float = 0.0,
    **settings: Unpack[Settings],
) -> Path:
    """The same for samples that come in pieces, none of which is kept.

    Parameters
    ----------
    state, every, start, settings
        As :func:`integrate` takes them.
    pieces : iterable of tuple
        ``(turns, pushes, steps)`` or ``(turns, pushes, steps, heights)``, for example
        ``((i.turns, i.pushes, i.steps) for i in trajectory.stream(100.0))``. Groups for coning end with a piece, so
        that its length should be a multiple of `samples`.

    Returns
    -------
    Path
    """
    if every < 1:
        raise InputError(f"every is the number of samples from one kept state to the next, 1 or more; not {every!r}")
    navigator = Navigator(state, **settings)
    time, since = start, 0
    kept = [np.concatenate([[start], navigator.numbers])[None]]
    for piece in pieces:
        rows, time = navigator.trace(*piece, every=every, since=since, time=time)
        since = (since + len(piece[0])) % every
        kept.append(rows)
    if since:
        kept.append(np.concatenate([[time], navigator.numbers])[None])
    table = np.concatenate(kept)
    return Path(table[:, 0].copy(), unpack(table[:, 1:]))


def increments(time: Array, gyro: Array, accel: Array, meaning: Meaning = "instant") -> tuple[Array, Array, Array]:
    """Increments of angle and velocity between samples.

    Instantaneous samples are integrated with the cubic through the two samples before and the two after each interval's
    middle; in equal steps that is ``dt (-f_-1 + 13 f_0 + 13 f_1 - f_2) / 24``. The first and the last interval, gaps
    and their neighbours have the trapezoid. A gap is a step longer than 1.5 usual ones.

    Parameters
    ----------
    time : ndarray, shape (n,), s
        Of the samples, increasing.
    gyro, accel : ndarray, shape (n, 3), rad/s and m/s^2
    meaning : {"instant", "mean"}
        Whether a sample is the value at its time, or the mean since the sample before it. The first mean is of no
        use then, since nobody knows when it began.

    Returns
    -------
    steps : ndarray, shape (n - 1,), s
    turns, pushes : ndarray, shape (n - 1, 3), rad and m/s
        Over the intervals between the samples.

    Raises
    ------
    InputError
        If shapes do not fit, there are fewer than two samples, or time does not increase.
    """
    steps = np.diff(time)
    if not (gyro.shape == accel.shape == (time.size, 3)) or time.size < 2:
        raise InputError(
            "increments need times (n,), rates and specific forces (n, 3), n > 1; "
            f"these are {time.shape}, {gyro.shape} and {accel.shape}"
        )
    if not (steps > 0.0).all():
        at = int(np.argmin(steps > 0.0))
        raise InputError(
            f"time does not increase from sample {at + 1} ({time[at]:g} s) to the next ({time[at + 1]:g} s)"
        )
    if meaning == "mean":
        return steps, steps[:, None] * gyro[1:], steps[:, None] * accel[1:]
    if meaning != "instant":
        raise InputError(
            f"samples are 'instant' (values at their times) or 'mean' (since the one before), not {meaning!r}"
        )
    return steps, _integral(steps, gyro), _integral(steps, accel)


def _integral(steps: Array, values: Array) -> Array:
    """Integral of the cubic through four samples over the interval in their middle, elsewhere of the straight line."""
    out = 0.5 * steps[:, None] * (values[1:] + values[:-1])
    if steps.size < 3:
        return np.asarray(out)
    whole = steps < GAP * np.median(steps)
    good = (whole[:-2] & whole[1:-1] & whole[2:])[:, None]
    h0, h, h2 = (steps[i : i + steps.size - 2, None] for i in range(3))
    slopes = np.diff(values, axis=0) / steps[:, None]
    left, right = (slopes[1:-1] - slopes[:-2]) / (h0 + h), (slopes[2:] - slopes[1:-1]) / (h + h2)
    third = (right - left) / (h0 + h + h2)
    # Newton's form; over [0, h] the integral of s (s - h) is -h^3 / 6, of s (s - h) (s - h - h2) h^4 / 12 + h^3 h2 / 6
    out[1:-1] += np.where(good, h**3 * (third * (h / 12.0 + h2 / 6.0) - right / 6.0), 0.0)
    return np.asarray(out)


def _check_settings(samples: int, frame: str, vertical: str) -> None:
    if samples not in {1, 2, 3, 4}:
        raise InputError(f"samples is the number of samples in a group for coning, 1 to 4; not {samples!r}")
    if frame not in {"wander", "north"}:
        raise InputError(f"frame is 'wander' or 'north', not {frame!r}")
    if vertical not in {"free", "held"}:
        raise InputError(f"vertical is 'free' or 'held' (heights are given to `advance`), not {vertical!r}")


def _samples(turns: Array, pushes: Array, steps: ArrayLike, heights: Array | None) -> tuple[Array, Array, Array, Array]:
    """What the kernels take: contiguous, of matching shapes, with steps above zero."""
    t, p = (np.ascontiguousarray(v, dtype=float) for v in (turns, pushes))
    h = np.asarray(steps, dtype=float)
    h = np.full(len(t), float(h)) if h.ndim == 0 else np.ascontiguousarray(h)
    given = _NO_HEIGHTS if heights is None else np.ascontiguousarray(heights, dtype=float)
    if not (t.shape == p.shape == (h.size, 3)) or h.ndim != 1:
        raise InputError(f"turns and pushes are (n, 3), steps (n,); these are {t.shape}, {p.shape} and {h.shape}")
    if heights is not None and given.shape != h.shape:
        raise InputError(f"{h.size} samples need as many heights; these are {given.shape}")
    if not (h > 0.0).all():
        at = int(np.argmin(h > 0.0))
        raise InputError(f"steps are above zero; that of sample {at + 1} is {h[at]:g} s")
    return t, p, h, given


def _to_north(state: State) -> State:
    """The same with a wander angle of zero."""
    C_w_n = state.C_w_n
    return State(C_w_n @ state.C_b_w, C_w_n @ state.velocity, C_w_n @ state.C_e_w, state.height)


def _turn_left(quaternion: Array, vector: Array) -> None:
    """``exp([v x])`` from the left, in place."""
    half = 0.5 * vector
    angle = float(np.sqrt(half @ half))
    v, c = half * np.sinc(angle / np.pi), np.cos(angle)
    q, w = quaternion[:3].copy(), quaternion[3]
    quaternion[:3] = c * q + w * v + cross(v, q)
    quaternion[3] = c * w - v @ q
