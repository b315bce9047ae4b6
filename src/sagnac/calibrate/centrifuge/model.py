"""Model of the centrifuge: Fourier coefficients of each sensor in each segment, predicted without truncation.

For a sensor with parameters p in a segment with the arm at the rate w::

    c = response(p; f, rate),   f, rate = M' C_r^p(alpha, beta, gamma) [series of the arm]

with M the mounting C_p^gimbals of the unit. The coefficients that were measured refer to an angle of the arm of their own, off
from the true one by d at mid time and by dw in rate; harmonic h then shows as ::

    c_h e^{ihd} (1 + i h dw tau),   tau = time from mid time

Each segment has three unknowns of its own, the errors of its gimbal settings, which are projected out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate import Parameter, Rows, eliminate
from ...frames import Array
from ...rigs.centrifuge import Arm, Series, series
from ...rigs.turntable import Site
from ...sensors import Axis
from ...sensors.series import basis, response
from .. import mount

RIG = {"rig.radius": 0, "rig.tilt.x": 1, "rig.tilt.y": 2, "rig.gravity": 3}
"""Unknowns of the rig and their places in :data:`sagnac.rigs.centrifuge.EFFECTS`."""
MOUNT = ("rig.mount.x", "rig.mount.y", "rig.mount.z")
_ARM_RATE, _GIMBALS = 4, slice(5, 8)
_EXACT = 3  # highest harmonic that sensors of third order make of an input of the first


@dataclass(frozen=True)
class Turning:
    """Angle of the arm at mid time and its rate in n segments, linear in a few unknowns q.

    Attributes
    ----------
    parameters : tuple of Parameter
        The unknowns, k of them.
    angle, rate : ndarray, shape (n,), rad and rad/s
        With all unknowns at zero.
    to_angle, to_rate : ndarray, shape (n, k)
    """

    parameters: tuple[Parameter, ...]
    angle: Array
    rate: Array
    to_angle: Array
    to_rate: Array


@dataclass(frozen=True)
class Group:
    """Segments of which the same coefficients are used, n of them, m sensors, c coefficients.

    Attributes
    ----------
    index : ndarray of int, shape (n,)
    order : int
        Highest harmonic.
    extended : bool
        Whether tau cos h th, tau sin h th, h = 1 to order, follow.
    coefficient : ndarray, shape (n, m, c)
    weight : ndarray, shape (n, m, c, c)
        Whitening.
    phase, rate : ndarray, shape (n,), rad and rad/s
        Of the angle that the coefficients refer to, at mid time.
    at_rest : bool
        Whether the arm stands at its angle: the one coefficient is then the reading there, not the mean over a turn.
    """

    index: NDArray[np.intp]
    order: int
    extended: bool
    coefficient: Array
    weight: Array
    phase: Array
    rate: Array
    at_rest: bool = False


@dataclass(frozen=True)
class PriorBlock:
    """What is known beforehand of some parameters together.

    Attributes
    ----------
    at : ndarray of int, shape (p,)
        Their places in the parameter vector.
    mean : ndarray, shape (p,)
    weight : ndarray, shape (p', p)
        Whitening.
    """

    at: NDArray[np.intp]
    mean: Array
    weight: Array


class _Predicted(NamedTuple):
    """Coefficients (n, m, c), derivative to the parameters (n, m, c, k) and to the gimbals' errors (n, m, c, 3)."""

    value: Array
    to_x: Array
    to_local: Array


@dataclass(frozen=True)
class CentrifugeModel:
    """Everything that the residuals need.

    The parameter vector is that of the sensors one after the other, then the rig's (`unknown`), then the turning's.

    Attributes
    ----------
    sensors : tuple of Axis
    fixed : mapping of str to float
        Parameters held where they are.
    arm : Arm
        As planned.
    site : Site
    settings : ndarray, shape (segments, 3), rad
        alpha, beta, gamma.
    setting_sigma : float, rad
        Of each setting; zero: exact.
    turning : Turning
    groups : tuple of Group
    unknown : tuple of str
        Some of :data:`RIG` and :data:`MOUNT`, in that order.
    prior : PriorBlock, optional
    """

    sensors: tuple[Axis, ...]
    fixed: Mapping[str, float]
    arm: Arm
    site: Site
    settings: Array
    setting_sigma: float
    turning: Turning
    groups: tuple[Group, ...]
    unknown: tuple[str, ...] = ()
    prior: PriorBlock | None = None
    _fixed: dict[str, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Keep the fixed parameters as the sensors take them."""
        object.__setattr__(self, "_fixed", dict(self.fixed))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameter names in their order."""
        own = tuple(name for s in self.sensors for name in s.names)
        return own + self.unknown + tuple(p.name for p in self.turning.parameters)

    @cached_property
    def places(self) -> dict[str, int]:
        """Place of each parameter."""
        return {name: i for i, name in enumerate(self.names)}

    def inputs(self, x: Array, index: NDArray[np.intp], local: Array) -> tuple[Series, Array | None, Array]:
        """Series in p with the derivatives of the rig, the mounting's derivative (n, 3, 3, 6) and the arm's rate (n,)."""
        rig = {name: float(x[self.places[name]]) for name in self.unknown}
        arm = Arm(
            rig.get("rig.radius", self.arm.radius),
            self.arm.counter_rotating,
            (rig.get("rig.tilt.x", self.arm.tilt[0]), rig.get("rig.tilt.y", self.arm.tilt[1])),
        )
        site = self.site
        if "rig.gravity" in rig:
            site = Site(site.latitude, rig["rig.gravity"], site.earth_rate)
        turning, q = self.turning, x[len(x) - len(self.turning.parameters) :]
        rate = turning.rate[index] + turning.to_rate[index] @ q
        felt = series(arm, site, rate, self.settings[index] + local)
        if MOUNT[0] not in rig:
            return felt, None, rate
        angles = np.array([rig[name] for name in MOUNT])
        to_p, slopes = mount.matrix(angles).T, np.swapaxes(mount.derivatives(angles), -1, -2)
        d_mount = [np.moveaxis(slopes @ v[:, None], 1, -1) for v in (felt.force, felt.rate)]
        turned = Series(
            to_p @ felt.force,
            to_p @ felt.rate,
            (to_p @ felt.to_force.reshape(-1, 3, 24)).reshape(felt.to_force.shape),
            (to_p @ felt.to_rate.reshape(-1, 3, 24)).reshape(felt.to_rate.shape),
        )
        return turned, np.concatenate(d_mount, axis=-1), rate

    def predicted(self, group: Group, x: Array, local: Array) -> _Predicted:
        """Coefficients of a group as they would be measured."""
        felt, d_mount, rate = self.inputs(x, group.index, local)
        order = _EXACT if group.at_rest else group.order
        n, m, c, k = len(group.index), len(self.sensors), 1 + 2 * order, len(x)
        value, to_x = np.empty((n, m, c)), np.zeros((n, m, c, k))
        to_effects, at = np.empty((n, m, c, 8)), 0
        rig_at = [self.places[u] for u in self.unknown if u in RIG]
        rig_from = [RIG[u] for u in self.unknown if u in RIG]
        for j, sensor in enumerate(self.sensors):
            own = slice(at, at + len(sensor.names))
            at = own.stop
            said = response(sensor, x[own], felt.force, felt.rate, order, self._fixed)
            by_force, by_rate = said.to_force.reshape(n, c, 9), said.to_rate.reshape(n, c, 9)
            value[:, j], to_x[:, j, :, own] = said.value, said.to_parameters
            to_effects[:, j] = by_force @ felt.to_force.reshape(n, 9, 8) + by_rate @ felt.to_rate.reshape(n, 9, 8)
            if d_mount is not None:
                first = self.places[MOUNT[0]]
                to_x[:, j, :, first : first + 3] = by_force @ d_mount[..., :3].reshape(n, 9, 3) + (
                    by_rate @ d_mount[..., 3:].reshape(n, 9, 3)
                )
        to_x[..., rig_at] = to_effects[..., rig_from]
        q = slice(k - len(self.turning.parameters), k)
        to_x[..., q] += to_effects[..., _ARM_RATE, None] * self.turning.to_rate[group.index][:, None, None]
        told = _Predicted(value, to_x, to_effects[..., _GIMBALS])
        return self._standing(group, x[q], q, told) if group.at_rest else self._as_measured(group, x[q], rate, q, told)

    def _standing(self, group: Group, q: Array, at: slice, told: _Predicted) -> _Predicted:
        """What the series are at the angle where the arm stands."""
        turning, index = self.turning, group.index
        angle = turning.angle[index] + turning.to_angle[index] @ q
        there, slope = basis(angle, _EXACT)[:, None], np.zeros((len(index), 1, 1 + 2 * _EXACT))
        h = np.arange(1, _EXACT + 1)
        slope[..., 1::2], slope[..., 2::2] = -h * there[..., 2::2], h * there[..., 1::2]
        value, by_angle = (np.sum(told.value * v, axis=-1, keepdims=True) for v in (there, slope))
        to_x, to_local = there[:, :, None] @ told.to_x, there[:, :, None] @ told.to_local
        to_x[..., at] += by_angle[..., None] * turning.to_angle[index][:, None, None]
        return _Predicted(value, to_x, to_local)

    def _as_measured(self, group: Group, q: Array, rate: Array, at: slice, told: _Predicted) -> _Predicted:
        """The same in the angle that the measured coefficients refer to."""
        turning, index = self.turning, group.index
        apart = turning.angle[index] + turning.to_angle[index] @ q - group.phase
        faster = rate - group.rate
        if not group.extended and not turning.parameters and not apart.any():
            return told
        turn, by_angle, by_rate = _turned(apart, faster, group.order, group.extended)
        value = told.value @ np.swapaxes(turn, -1, -2)
        to_x = turn[:, None] @ told.to_x
        to_x[..., at] += (told.value @ np.swapaxes(by_angle, -1, -2))[..., None] * turning.to_angle[index][
            :, None, None
        ]
        to_x[..., at] += (told.value @ np.swapaxes(by_rate, -1, -2))[..., None] * turning.to_rate[index][:, None, None]
        return _Predicted(value, to_x, turn[:, None] @ told.to_local)

    def whitened(self, group: Group, x: Array, local: Array) -> tuple[Array, Array, Array]:
        """Whitened residuals (n, m c), their derivative to the parameters (n, m c, k) and to the gimbals' errors (n, m c, 3)."""
        told = self.predicted(group, x, local)
        n = len(group.index)
        r = (group.weight @ (group.coefficient - told.value)[..., None])[..., 0]
        to_x, to_local = -group.weight @ told.to_x, -group.weight @ told.to_local
        return r.reshape(n, -1), to_x.reshape(n, -1, len(x)), to_local.reshape(n, -1, 3)

    def locals(self, group: Group, x: Array) -> Array:
        """Most likely errors of the gimbals' settings, given the parameters (Gauss-Newton), (n, 3)."""
        local, before = np.zeros((len(group.index), 3)), np.inf
        for _ in range(20):
            r, _, d = self.whitened(group, x, local)
            r, d = with_setting_prior(r, d, local, self.setting_sigma)
            back = np.swapaxes(d, -1, -2)
            step = -np.linalg.solve(back @ d, back @ r[..., None])
            moved = float(np.abs(d @ step).max())
            local = local + step[..., 0]
            if moved < 1e-8 or 0.3 * before < moved < 1e-3:  # no residual moves any more, or only rounding does
                break
            before = moved
        return local

    def rows(self, x: Array) -> Rows:
        """Whitened residuals with the gimbals' errors projected out; the prior is the last segment."""
        residuals, jacobians, index = [], [], []
        for group in self.groups:
            if self.setting_sigma > 0:
                local = self.locals(group, x)
                r, jac, d = self.whitened(group, x, local)
                r, d = with_setting_prior(r, d, local, self.setting_sigma)
                r, jac = eliminate(r, np.concatenate([jac, np.zeros((len(r), 3, len(x)))], axis=1), d)
            else:
                r, jac, _ = self.whitened(group, x, np.zeros((len(group.index), 3)))
            residuals.append(r.ravel())
            jacobians.append(jac.reshape(-1, len(x)))
            index.append(np.repeat(group.index, r.shape[1]))
        if self.prior is not None:
            weight, jac = self.prior.weight, np.zeros((len(self.prior.weight), len(x)))
            jac[:, self.prior.at] = weight
            residuals.append(weight @ (x[self.prior.at] - self.prior.mean))
            jacobians.append(jac)
            index.append(np.full(len(jac), len(self.settings)))
        return Rows(np.concatenate(residuals), np.vstack(jacobians), np.concatenate(index).astype(np.intp))


def with_setting_prior(r: Array, to_local: Array, local: Array, sigma: float) -> tuple[Array, Array]:
    """Residuals and derivatives with the stated uncertainty of the settings appended.

    Parameters
    ----------
    r : ndarray, shape (n, m)
    to_local : ndarray, shape (n, m, 3)
    local : ndarray, shape (n, 3), rad
    sigma : float, rad

    Returns
    -------
    residual : ndarray, shape (n, m + 3)
    to_local : ndarray, shape (n, m + 3, 3)
    """
    prior = np.broadcast_to(np.eye(3) / sigma, (len(local), 3, 3))
    return np.concatenate([r, local / sigma], axis=1), np.concatenate([to_local, prior], axis=1)


def _turned(apart: Array, faster: Array, order: int, extended: bool) -> tuple[Array, Array, Array]:
    """Matrices (n, c, c0) from coefficients in the true angle to those that are measured, and their derivatives.

    Parameters
    ----------
    apart, faster : ndarray, shape (n,), rad and rad/s
        True angle and rate, less those that the measured coefficients refer to.
    order : int
    extended : bool

    Returns
    -------
    turn, by_angle, by_rate : ndarray, shape (n, c, 1 + 2 order)
        The latter two are the derivatives to `apart` and `faster`.
    """
    n, c = len(apart), 1 + 2 * order
    out = np.zeros((3, n, c + 2 * order * extended, c))
    out[0, :, 0, 0] = 1.0
    for h in range(1, order + 1):
        cos, sin = np.cos(h * apart), np.sin(h * apart)
        along = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
        across = h * np.array([[-sin, cos], [-cos, -sin]]).transpose(2, 0, 1)  # its derivative to the angle
        here, there = slice(2 * h - 1, 2 * h + 1), slice(c + 2 * h - 2, c + 2 * h)
        out[0, :, here, here], out[1, :, here, here] = along, across
        if extended:
            out[0, :, there, here] = faster[:, None, None] * across
            out[1, :, there, here] = -(h**2) * faster[:, None, None] * along
            out[2, :, there, here] = across
    return out[0], out[1], out[2]
