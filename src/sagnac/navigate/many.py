"""Strapdown navigation of many trajectories at once, in vector instructions on all cores.

For campaigns: the same course with a thousand units, or from a thousand starts. This is what one
:class:`sagnac.navigate.strapdown.Navigator` does in the wander frame with groups of two samples, to rounding.
"""

from __future__ import annotations

import itertools
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from ..earth import EARTH_RATE, ELLIPSOID
from ..errors import DataError, InputError
from ..frames import Array
from .state import State
from .strapdown import Vertical, unpack

_FULL = 24  # numbers of a state with the sample before: see sagnac.kernels.strapdown


def pack_many(states: State) -> Array:
    """States as the kernels have them, see :func:`sagnac.navigate.strapdown.pack`.

    Parameters
    ----------
    states : State
        Of arrays with N entries.

    Returns
    -------
    ndarray, shape (N, 24)
        With no sample before.
    """
    from scipy.spatial.transform import Rotation

    out = np.zeros((states.velocity.shape[0], _FULL))
    out[:, :4] = Rotation.from_matrix(states.C_b_w).as_quat()
    out[:, 4:7] = states.velocity
    out[:, 7:16] = states.C_e_w.reshape(-1, 9)
    out[:, 16] = states.height
    return out


class Fleet:
    """Strapdown systems that are advanced together, each by samples of its own.

    Parameters
    ----------
    states : State
        Where they start: arrays with N entries.
    vertical : {"free", "held"}
        "held": the heights stay and the vertical velocities are zero.
    earth_rate : float, rad/s
    gravity_excess : float, m/s^2
        Real gravity less the normal one.
    threads : int, optional
        One for each core unless given. The result does not depend on it.

    Raises
    ------
    InputError
        When `states` is not one of N entries, or `vertical` is none of the two.
    """

    def __init__(
        self,
        states: State,
        *,
        vertical: Vertical = "free",
        earth_rate: float = EARTH_RATE,
        gravity_excess: float = 0.0,
        threads: int | None = None,
    ) -> None:
        from ..kernels.lanes import LANES

        if states.velocity.ndim != 2 or states.velocity.shape[0] < 1:
            raise InputError(
                f"a fleet starts with states of N entries, N > 0: velocities (N, 3), not {states.velocity.shape}"
            )
        if vertical not in {"free", "held"}:
            raise InputError(f"vertical is 'free' or 'held', not {vertical!r}")
        self._count = int(states.velocity.shape[0])
        groups = -(-self._count // LANES)
        rows = np.minimum(np.arange(groups * LANES), self._count - 1)
        numbers = pack_many(states)[rows].reshape(groups, LANES, _FULL)
        self._states = np.ascontiguousarray(np.swapaxes(numbers, 1, 2)).reshape(groups, -1)
        self._pushed = np.zeros((groups, 3 * LANES))
        self._held = vertical == "held"
        if self._held:
            self._states.reshape(groups, _FULL, LANES)[:, 6] = 0.0
        self._constants = np.array([*ELLIPSOID, earth_rate, gravity_excess])
        self._threads = max(1, min(threads or os.cpu_count() or 1, groups))

    def __len__(self) -> int:
        """Number of trajectories."""
        return self._count

    @property
    def states(self) -> State:
        """Attitudes, velocities and positions as they are now, arrays with N entries."""
        return unpack(self._rows(self._states))

    @property
    def pushed(self) -> Array:
        """Velocity gained from the specific force since the start, in w, shape (N, 3), m/s."""
        return self._rows(self._pushed)

    def _rows(self, lanes: Array) -> Array:
        """What stands in lanes as one row for each trajectory."""
        from ..kernels.lanes import LANES

        width = lanes.shape[1] // LANES
        return np.swapaxes(lanes.reshape(-1, width, LANES), 1, 2).reshape(-1, width)[: self._count].copy()

    def advance(self, turns: Array, pushes: Array, steps: ArrayLike, heights: Array | None = None) -> None:
        """Advance all by many samples.

        Parameters
        ----------
        turns : ndarray, shape (n, 3, N), rad
            Integrals of the angular rate over the sample intervals, in body axes: those of one instant together.
        pushes : ndarray, shape (n, 3, N), m/s
            Integrals of the specific force.
        steps : array_like, shape (n,) or (), s
            Lengths of the sample intervals, the same for all. Samples are taken two by two: pieces of an even number of
            samples give what one call gives.
        heights : ndarray, shape (n, N) or (n,), m, optional
            Heights at the end of each sample interval, from another instrument; the vertical velocities are their
            difference quotients.

        Raises
        ------
        InputError
            If the shapes do not fit or a step is not above zero.
        DataError
            If a result is not a number; the trajectory is named.
        """
        from ..kernels.lanes import advance_groups

        n = turns.shape[0]
        if turns.shape != (n, 3, self._count) or pushes.shape != turns.shape:
            raise InputError(
                f"turns and pushes of {self._count} trajectories are (n, 3, {self._count}); "
                f"these are {turns.shape} and {pushes.shape}"
            )
        lengths = np.asarray(steps, dtype=float)
        if lengths.shape not in {(), (n,)}:
            raise InputError(f"steps are (n,) or one for all, here n = {n}; not {lengths.shape}")
        lengths = np.ascontiguousarray(np.broadcast_to(lengths, (n,)))
        if not (lengths > 0.0).all():
            raise InputError(f"steps are above zero; the least of these is {lengths.min():g} s")
        given = np.empty((0, 0))
        if heights is not None:
            given = np.ascontiguousarray(heights[:, None] if heights.ndim == 1 else heights, dtype=float)
            if given.shape[0] != n or given.shape[1] not in {1, self._count}:
                raise InputError(f"heights are (n,) or (n, N), here n = {n}, N = {self._count}; not {heights.shape}")
        groups = self._states.shape[0]
        edges = [groups * k // self._threads for k in range(self._threads + 1)]
        samples = np.ascontiguousarray(turns, dtype=float), np.ascontiguousarray(pushes, dtype=float), lengths
        settings = self._held or heights is not None, given, self._constants, self._pushed
        with ThreadPoolExecutor(self._threads) as pool:
            parts = itertools.pairwise(edges)
            for done in [pool.submit(advance_groups, self._states, *part, *samples, *settings) for part in parts]:
                done.result()
        bad = ~np.isfinite(self._rows(self._states)).all(axis=1)
        if bad.any():
            raise DataError(
                f"trajectory {int(np.argmax(bad))} came to no number: its samples are none, or far too large"
            )
