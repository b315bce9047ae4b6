"""Model of the joint calibration on a turntable: every setting may be wrong by what the table's uncertainty allows.

In segment s the settings are theta_s + delta_s with delta_s of prior standard deviation ``angle_uncertainty``; the table's own
errors q (two tilts, two non-perpendicularities, three zero errors) have the prior ``axis_uncertainty``. With the mean inputs
of :func:`sagnac.rigs.turntable.mean_inputs`::

    N_a = S_a [C_k^b f(theta + delta, q) + w^2 (a (a.l) - l)] + b_a
    N_g = S_g C_k^b u(theta + delta, q) + b_g

S_a is lower triangular (the accelerometers define b), S_g full in b; a is the axis that turns, l the lever arm from it. Without
accelerometers the gyros define b. The prior of delta to zero is multi-position calibration, to infinity the norm method: the
three delta of a segment are its own unknowns and are projected out segment by segment.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimate import Effects, Rows, eliminate
from ..frames import Array
from ..rigs.turntable import Letters, MeanInputs, Site, TableErrors, mean_inputs
from ..sensors import Triad
from . import mount
from .budget import NOISE, SETTINGS

RIG = (
    "rig.tilt.x",
    "rig.tilt.y",
    "rig.nonperpendicularity.middle",
    "rig.nonperpendicularity.inner",
    "rig.zero.outer",
    "rig.zero.middle",
    "rig.zero.inner",
)
_EFFECT = (3, 4, 5, 6, 0, 1, 2)
"""Column of ``MeanInputs`` derivatives that belongs to each of :data:`RIG`: a zero error acts as its setting does."""


class _Felt(NamedTuple):
    """Inputs in b with their derivatives to the settings and to the parameters."""

    value: Array
    """(n, 3)."""
    to_setting: Array
    """(n, 3, 3)."""
    to_x: Array
    """(n, 3, k)."""


@dataclass
class TableModel:
    """Everything the residuals need; `x` is triads, mount, lever arm, table errors, gravity error, rate error, where present.

    Attributes
    ----------
    triads : dict of str to Triad
        ``accel``, ``gyro`` or both, the first one lower triangular.
    readings, sigma : dict of str to ndarray, shape (n, 3)
        Means and their standard deviations.
    angles, rates : ndarray, shape (n, 3), rad and rad/s
        Settings at mid time.
    left : ndarray, shape (n,)
        What averaging leaves of a turning vector.
    setting_sigma : float, rad
        Standard deviation of each setting; zero where they are exact.
    lever, rig, gravity_unknown, rate_unknown : bool
        Which further parameters there are.
    """

    triads: dict[str, Triad]
    readings: dict[str, Array]
    sigma: dict[str, Array]
    angles: Array
    rates: Array
    left: Array
    site: Site
    letters: Letters
    setting_sigma: float
    lever: bool
    rig: bool
    gravity_unknown: bool
    rate_unknown: bool
    _settings: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Start with the settings as they are."""
        self._settings = np.zeros_like(self.angles)

    def without(self, segment: int) -> TableModel:
        """The same with one segment left out."""
        keep = np.arange(len(self.angles)) != segment
        return replace(
            self,
            readings={k: v[keep] for k, v in self.readings.items()},
            sigma={k: v[keep] for k, v in self.sigma.items()},
            angles=self.angles[keep],
            rates=self.rates[keep],
            left=self.left[keep],
        )

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each part stands in the parameter vector."""
        sizes = {
            **{kind: len(t.names) for kind, t in self.triads.items()},
            "mount": 3,
            "lever": 3 * self.lever,
            "rig": len(RIG) * self.rig,
            "gravity": int(self.gravity_unknown),
            "rate": int(self.rate_unknown),
        }
        ends = np.cumsum(list(sizes.values()))
        return {name: slice(int(end - size), int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)}

    def _inputs(self, x: Array, settings: Array) -> MeanInputs:
        q = x[self.places["rig"]] if self.rig else np.zeros(len(RIG))
        errors = TableErrors((q[0], q[1]), (q[2], q[3]), (q[4], q[5], q[6]))
        return mean_inputs(self.angles + settings, self.rates, self.left, self.site, errors, self.letters)

    def felt(self, kind: str, x: Array, settings: Array, inputs: MeanInputs | None = None) -> _Felt:
        """What the triad of a kind feels, in b, for settings that are off by `settings` (n, 3)."""
        given = self._inputs(x, settings) if inputs is None else inputs
        at = self.places
        angles = x[at["mount"]]
        to_b, d_to_b = mount.matrix(angles).T, np.swapaxes(mount.derivatives(angles), 1, 2)
        u, d_u = (given.force, given.d_force) if kind == "accel" else (given.rate, given.d_rate)
        to_x = np.zeros((len(u), 3, x.size))
        if kind == "accel" and self.gravity_unknown:
            u, d_u, g = u * (1.0 + x[at["gravity"]]), d_u * (1.0 + x[at["gravity"]]), u
            to_x[:, :, at["gravity"]] = (g @ to_b.T)[:, :, None]
        if kind == "gyro" and self.rate_unknown:
            speed = self.rates.sum(axis=1)[:, None]
            u, d_u = u + x[at["rate"]] * speed * given.axis, d_u + x[at["rate"]] * speed[..., None] * given.d_axis
            to_x[:, :, at["rate"]] = (speed * given.axis @ to_b.T)[:, :, None]
        value = u @ to_b.T
        to_x[:, :, at["mount"]] = np.einsum("kij,nj->nik", d_to_b, u)
        effect = to_b @ d_u
        if kind == "accel" and self.lever:
            value, effect = self._lever(x, value, effect, to_x, given, to_b, d_to_b)
        if self.rig:
            to_x[:, :, at["rig"]] = effect[:, :, _EFFECT]
        return _Felt(value, effect[:, :, :3], to_x)

    def _lever(
        self, x: Array, value: Array, effect: Array, to_x: Array, given: MeanInputs, to_b: Array, d_to_b: Array
    ) -> tuple[Array, Array]:
        """Add the centripetal part w^2 (a (a.l) - l) and its derivatives (`to_x` in place)."""
        at = self.places
        arm = x[at["lever"]]
        speed = (self.rates.sum(axis=1) ** 2)[:, None]
        axis = given.axis @ to_b.T
        along = (axis @ arm)[:, None]
        value = value + speed * (axis * along - arm)
        to_axis = speed[..., None] * (along[..., None] * np.eye(3) + axis[:, :, None] * arm)
        to_x[:, :, at["lever"]] = speed[..., None] * (axis[:, :, None] * axis[:, None, :] - np.eye(3))
        to_x[:, :, at["mount"]] += to_axis @ np.einsum("kij,nj->nik", d_to_b, given.axis)
        return value, effect + to_axis @ (to_b @ given.d_axis)

    def whitened(self, x: Array, settings: Array, *, full: bool) -> tuple[Array, Array, Array]:
        """Whitened residual (n, m), its derivative to the settings (n, m, 3) and, if `full`, to the parameters (n, m, k)."""
        given = self._inputs(x, settings)
        residual, to_setting, to_x = [], [], []
        for kind, triad in self.triads.items():
            own = x[self.places[kind]]
            matrix, bias, _ = triad.unpack(own)
            felt = self.felt(kind, x, settings, given)
            weight = 1.0 / self.sigma[kind]
            residual.append(weight * (self.readings[kind] - felt.value @ matrix.T - bias))
            to_setting.append(-weight[..., None] * (matrix @ felt.to_setting))
            if full:
                change = matrix @ felt.to_x
                d_matrix, d_bias, _ = triad.derivatives(own)
                change[:, :, self.places[kind]] = np.einsum("kij,nj->nik", d_matrix, felt.value) + d_bias.T
                to_x.append(-weight[..., None] * change)
        if self.setting_sigma > 0:
            residual.append(settings / self.setting_sigma)
            to_setting.append(np.broadcast_to(np.eye(3) / self.setting_sigma, (len(settings), 3, 3)))
            if full:
                to_x.append(np.zeros((len(settings), 3, x.size)))
        joined = np.concatenate(to_x, axis=1) if full else np.zeros((len(settings), 0, 0))
        return np.hstack(residual), np.concatenate(to_setting, axis=1), joined

    def settings(self, x: Array) -> Array:
        """Most likely error of each setting (n, 3), rad, given the parameters (Gauss-Newton from the last answer)."""
        if self.setting_sigma == 0:
            return self._settings
        settings, before = self._settings, np.inf
        for _ in range(40):
            r, d, _ = self.whitened(x, settings, full=False)
            back = np.swapaxes(d, -1, -2)
            step = -np.linalg.solve(back @ d, back @ r[..., None])[..., 0]
            moved = float(np.abs(d @ step[..., None]).max())
            # half a radian at most: further out the angles of a table mean something else
            settings = settings + step * np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 0.5))
            if moved < 1e-8 or 0.3 * before < moved < 1e-3:  # no residual moves any more, or only rounding does
                break
            before = moved
        if np.all(np.isfinite(settings)) and np.abs(settings).max() < np.pi:
            self._settings = settings
        return settings

    def rows(self, x: Array) -> Rows:
        """Whitened residuals with the errors of the settings projected out."""
        r, to_setting, to_x = self.whitened(x, self.settings(x), full=True)
        if self.setting_sigma > 0:
            r, to_x = eliminate(r, to_x, to_setting)
        index: NDArray[np.intp] = np.repeat(np.arange(len(r)), r.shape[1])
        return Rows(r.ravel(), to_x.reshape(-1, x.size), index)

    def effects(self, x: Array) -> list[Effects]:
        """How noise and settings move the rows."""
        r, to_setting, _ = self.whitened(x, self.settings(x), full=False)
        n, m = r.shape
        sources = [NOISE] * (3 * len(self.triads)) + [SETTINGS] * (m - 3 * len(self.triads))
        matrix = np.broadcast_to(np.eye(m), (n, m, m))
        if self.setting_sigma > 0:
            matrix = eliminate(r, matrix, to_setting)[1]
        return [Effects(np.arange(matrix.shape[0] * matrix.shape[1]).reshape(matrix.shape[:2]), matrix, sources)]
