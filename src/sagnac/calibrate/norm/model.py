"""Model of norm-observation calibration: only the size of the input is trusted, not its direction.

[DONG18] with nothing truncated. In each position the direction a of the outer (vertical) axis in the unit's frame is
an unknown of that position, so that the table's angles do not matter. ::

    static    N_a = S_a g a + b_a
    turning   N_a = S_a [g (a + T tilt) + w^2 (a (a.l) - l)] + b_a
              N_g = S_g [(w + w_e sin L) a + h] + b_g

S_a is lower triangular: the accelerometers define b. In a turning segment both triads see the same axis, which gives
S_g as a full matrix in b without the table's angles. l is the lever arm from the outer axis to the accelerometers; h is
what the averaging leaves of the horizontal Earth rate: its size is known, its azimuth is one more unknown of the position
that the table's setting only bounds; T tilt is what the averaging leaves of the outer axis's tilt. Gyros alone get their
own triangular frame from ::

    |u|^2 = (w + w_e sin L)^2 + |h|^2

which is the sampled norm for one sample and the turn-averaged one for whole turns.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate import Effects, Rows, eliminate
from ...frames import Array, cross, tangents, unit
from ...sensors import Triad
from ..budget import NOISE, SETTINGS

NO_AZIMUTH = 1.8  # rad: standard deviation of an angle of which nothing is known


@dataclass(frozen=True)
class Group:
    """Segments of one kind (static or turning), n of them, m readings each."""

    index: NDArray[np.intp]
    accel: Array | None
    gyro: Array | None
    weight: Array
    """Whitening, (n, m, m)."""
    rate: Array
    """Table rate, rad/s; zero when static."""
    level: Array
    """Size of what is left of the horizontal Earth rate, (n,), rad/s."""
    north: Array
    """A direction in b near that of the horizontal Earth rate, (n, 3)."""
    twist_sigma: Array | None
    """How well the azimuth of h is known from the settings, (n,), rad; None when h does not matter."""
    lean: Array
    """T: what is left of the two tilts, in b, (n, 3, 2)."""
    start: Array
    """First directions, (n, 3)."""

    @cached_property
    def turns(self) -> bool:
        """Whether the table turns."""
        return bool(np.any(self.rate))

    @cached_property
    def readings(self) -> Array:
        """Readings of both triads side by side, (n, m)."""
        return np.hstack([v for v in (self.accel, self.gyro) if v is not None])


@dataclass(frozen=True)
class Local:
    """Unknowns of the positions: direction a (n, 3) and azimuth of h (n,)."""

    a: Array
    twist: Array

    @cached_property
    def basis(self) -> Array:
        """Directions in which a can move, (n, 3, 2)."""
        return tangents(self.a)


class Split(NamedTuple):
    """The parameter vector by meaning, with the place of each part."""

    accel: Array
    gyro: Array
    lever: Array
    tilt: Array
    gravity_error: float
    rate_error: float


@dataclass(frozen=True)
class NormModel:
    """Everything the residuals need; `x` is accel, gyro, lever arm, tilt, gravity error, rate error, where present."""

    accel: Triad | None
    gyro: Triad | None
    lever: bool
    tilt: bool
    gravity_unknown: bool
    rate_unknown: bool
    gravity: float
    up_rate: float
    groups: tuple[Group, ...]
    _found: dict[int, tuple[bytes, Local]] = field(init=False, repr=False, compare=False, default_factory=dict)

    def without_azimuths(self, known: bool) -> NormModel:
        """The same with h where the settings put it (`known`), or left out: a simpler model to start from."""
        groups = [replace(g, twist_sigma=None, level=g.level if known else np.zeros_like(g.level)) for g in self.groups]
        return replace(self, groups=tuple(groups))

    @cached_property
    def places(self) -> list[slice]:
        """Where each part of :class:`Split` stands in the parameter vector."""
        sizes = [
            len(self.accel.names) if self.accel else 0,
            len(self.gyro.names) if self.gyro else 0,
            3 * self.lever,
            2 * self.tilt,
            int(self.gravity_unknown),
            int(self.rate_unknown),
        ]
        ends = np.cumsum(sizes)
        return [slice(int(e - s), int(e)) for s, e in zip(sizes, ends, strict=True)]

    def split(self, x: Array) -> Split:
        """Parts of the parameter vector; absent ones are zero."""
        parts = [x[at] for at in self.places]
        return Split(
            parts[0],
            parts[1],
            parts[2] if self.lever else np.zeros(3),
            parts[3] if self.tilt else np.zeros(2),
            float(parts[4][0]) if self.gravity_unknown else 0.0,
            float(parts[5][0]) if self.rate_unknown else 0.0,
        )

    def accel_readings(self, group: Group, x: Array, local: Local, full: bool) -> tuple[Array, Array, Array | None]:
        """Accelerometer readings (n, 3), derivative to a (n, 3, 3) and to the parameters (n, 3, k)."""
        assert self.accel is not None
        p, a = self.split(x), local.a
        matrix, bias, _ = self.accel.unpack(p.accel)
        g = self.gravity * (1.0 + p.gravity_error)
        w2 = group.rate[:, None, None] ** 2
        f = g * (a + group.lean @ p.tilt) if self.tilt else g * a
        if group.turns:
            along = (a @ p.lever)[:, None, None]
            f = f + (w2 * (a[:, :, None] * along - p.lever[:, None]))[..., 0]
            to_a = matrix @ (g * np.eye(3) + w2 * (along * np.eye(3) + a[:, :, None] * p.lever))
        else:
            to_a = np.broadcast_to(g * matrix, (len(a), 3, 3))
        if not full:
            return f @ matrix.T + bias, to_a, None
        to_x = np.zeros((len(a), 3, x.size))
        at = self.places
        d_matrix, d_bias, _ = self.accel.derivatives(p.accel)
        to_x[:, :, at[0]] = np.einsum("kij,nj->nik", d_matrix, f) + d_bias.T
        if self.lever:
            to_x[:, :, at[2]] = matrix @ (w2 * (a[:, :, None] * a[:, None, :] - np.eye(3)))
        if self.tilt:
            to_x[:, :, at[3]] = g * matrix @ group.lean
        if self.gravity_unknown:
            to_x[:, :, at[4]] = (self.gravity * (a + group.lean @ p.tilt) @ matrix.T)[:, :, None]
        return f @ matrix.T + bias, to_a, to_x

    def gyro_readings(
        self, group: Group, x: Array, local: Local, full: bool
    ) -> tuple[Array, Array, Array, Array | None]:
        """Gyro readings (n, 3), derivative to a (n, 3, 3), to the azimuth (n, 3), to the parameters (n, 3, k)."""
        assert self.gyro is not None
        p, a = self.split(x), local.a
        matrix, bias, _ = self.gyro.unpack(p.gyro)
        along = (group.rate * (1.0 + p.rate_error) + self.up_rate)[:, None]
        if self.gyro.full:
            ahead = across(group.north, a)
            aside = cross(a, ahead)
            c, s = np.cos(local.twist)[:, None], np.sin(local.twist)[:, None]
            h, d_h = group.level[:, None] * (c * ahead + s * aside), group.level[:, None] * (c * aside - s * ahead)
            w, d_rate = along * a + h, group.rate[:, None] * a
            to_a = along[..., None] * np.eye(3) - a[:, :, None] * h[:, None, :]
        else:
            size = np.hypot(along, group.level[:, None])
            w, d_rate, d_h = size * a, along / size * group.rate[:, None] * a, np.zeros_like(a)
            to_a = size[..., None] * np.eye(3)
        values = w @ matrix.T + bias
        if not full:
            return values, matrix @ to_a, d_h @ matrix.T, None
        to_x = np.zeros((len(a), 3, x.size))
        at = self.places
        d_matrix, d_bias, _ = self.gyro.derivatives(p.gyro)
        to_x[:, :, at[1]] = np.einsum("kij,nj->nik", d_matrix, w) + d_bias.T
        if self.rate_unknown:
            to_x[:, :, at[5]] = (d_rate @ matrix.T)[:, :, None]
        return values, matrix @ to_a, d_h @ matrix.T, to_x

    def whitened(self, group: Group, x: Array, local: Local, full: bool) -> tuple[Array, Array, Array | None]:
        """Whitened residual (n, m'), its derivative to the local unknowns (n, m', 2 or 3) and to the parameters."""
        n = len(group.start)
        values, to_local, to_x = [], [], []
        basis = local.basis
        if group.accel is not None:
            v, to_a, d = self.accel_readings(group, x, local, full)
            values.append(v)
            to_local.append(np.concatenate([to_a @ basis, np.zeros((n, 3, 1))], axis=2))
            to_x.append(d)
        if group.gyro is not None:
            v, to_a, to_twist, d = self.gyro_readings(group, x, local, full)
            values.append(v)
            to_local.append(np.concatenate([to_a @ basis, to_twist[..., None]], axis=2))
            to_x.append(d)
        r = (group.weight @ (group.readings - np.hstack(values))[..., None])[..., 0]
        d_local = -group.weight @ np.concatenate(to_local, axis=1)
        d_x = -group.weight @ np.concatenate(to_x, axis=1) if full else None  # type: ignore[arg-type]
        if group.twist_sigma is None:
            return r, d_local[:, :, :2], d_x
        prior = np.zeros((n, 1, 3))
        prior[:, 0, 2] = 1.0 / group.twist_sigma
        r = np.column_stack([r, local.twist / group.twist_sigma])
        d_local = np.concatenate([d_local, prior], axis=1)
        return r, d_local, None if d_x is None else np.concatenate([d_x, np.zeros((n, 1, x.size))], axis=1)

    def locals(self, group: Group, x: Array) -> Local:
        """Most likely direction and azimuth of each position, given the parameters; kept for who asks for the same again."""
        key, asked = id(group), x.tobytes()
        if key not in self._found or self._found[key][0] != asked:
            self._found[key] = asked, self._most_likely(group, x)
        return self._found[key][1]

    def _most_likely(self, group: Group, x: Array) -> Local:
        """Gauss-Newton of the directions and azimuths alone."""
        local = Local(group.start, np.zeros(len(group.start)))
        if group.twist_sigma is not None and np.any(group.twist_sigma >= NO_AZIMUTH):
            local = self._first_twist(group, x, local)
        before = np.inf
        for _ in range(30):
            r, d, _ = self.whitened(group, x, local, full=False)
            back = np.swapaxes(d, -1, -2)
            step = -np.linalg.solve(back @ d, back @ r[..., None])[..., 0]
            moved = float(np.abs(d @ step[..., None]).max())
            a = unit(local.a + (local.basis @ step[:, :2, None])[..., 0])
            local = Local(a, local.twist + step[:, 2] if step.shape[1] > 2 else local.twist)
            if moved < 1e-8 or 0.3 * before < moved < 1e-3:  # no residual moves any more, or only rounding does
                break
            before = moved
        return local

    def _first_twist(self, group: Group, x: Array, local: Local) -> Local:
        """Azimuth of h read from the gyros, where the plan says nothing about it."""
        assert self.gyro is not None and group.gyro is not None  # noqa: PT018 - only such groups have an azimuth
        matrix, bias, _ = self.gyro.unpack(self.split(x).gyro)
        w = np.linalg.solve(matrix, (group.gyro - bias).T).T
        ahead = across(group.north, local.a)
        aside = cross(local.a, ahead)
        return Local(local.a, np.arctan2(np.einsum("ni,ni->n", w, aside), np.einsum("ni,ni->n", w, ahead)))

    def rows(self, x: Array) -> Rows:
        """Whitened residuals with the unknowns of the positions projected out."""
        residuals, jacobians, index = [], [], []
        for group in self.groups:
            r, d_local, d_x = self.whitened(group, x, self.locals(group, x), full=True)
            assert d_x is not None
            r, jac = eliminate(r, d_x, d_local)
            residuals.append(r.ravel())
            jacobians.append(jac.reshape(-1, x.size))
            index.append(np.repeat(group.index, r.shape[1]))
        return Rows(np.concatenate(residuals), np.vstack(jacobians), np.concatenate(index).astype(np.intp))

    def effects(self, x: Array) -> list[Effects]:
        """How noise and settings move the rows."""
        out, at = [], 0
        for group in self.groups:
            r, d_local, _ = self.whitened(group, x, self.locals(group, x), full=False)
            n, m = r.shape
            _, matrix = eliminate(r, np.broadcast_to(np.eye(m), (n, m, m)), d_local)
            sources = [NOISE] * m
            if group.twist_sigma is not None and np.all(group.twist_sigma < NO_AZIMUTH):
                sources[-1] = SETTINGS
            out.append(Effects(at + np.arange(n * matrix.shape[1]).reshape(n, -1), matrix, sources))
            at += n * matrix.shape[1]
        return out


def across(v: Array, a: Array) -> Array:
    """Directions of the parts of v perpendicular to a, (n, 3)."""
    return unit(v - a * np.einsum("ni,ni->n", a, v)[:, None])
