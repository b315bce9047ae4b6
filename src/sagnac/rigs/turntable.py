"""Three-axis turntable: Earth rate, gravity and table rate in the case frame k.

The attitude of the case on the usual table, outer axis about z, middle about x, inner about y::

    C_k^n = Rx(tilt_x) Ry(tilt_y) Rz(outer) Ry(n_1) Rx(middle) Rz(n_2) Ry(inner)

with n east, north, up, the tilt of the outer axis, and n_1, n_2 the non-perpendicularity of middle to outer and of inner
to middle axis ([DONG18], section 2, with the rig's errors written out). Each angle is the setting plus the axis's zero error
plus the error of that setting. A table of another build names the axis of the case that each of its axes turns about at
zero, from the base to the unit (``letters``): the tilts are then about the other two axes, a non-perpendicularity about the
axis across both of its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..earth import earth_rate_enu
from ..frames import Array, rot_x, rot_y, rot_z, skew

Letters = tuple[str, str, str]
STANDARD: Letters = ("z", "x", "y")
"""Outer axis vertical, middle along x, inner along y."""
_TURN = {"x": rot_x, "y": rot_y, "z": rot_z}
_UNIT = dict(zip("xyz", np.eye(3), strict=True))
_EFFECTS = 7
"""Derivatives of the inputs: three settings, two tilts, two non-perpendicularities (zero errors act as the settings do)."""


@dataclass(frozen=True)
class TableErrors:
    """Errors of the rig, rad.

    Attributes
    ----------
    tilt : tuple of float
        Of the outer axis, about east and about north.
    nonperpendicularity : tuple of float
        Middle to outer, inner to middle.
    zero : tuple of float
        Of outer, middle and inner scale.
    """

    tilt: tuple[float, float] = (0.0, 0.0)
    nonperpendicularity: tuple[float, float] = (0.0, 0.0)
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0)


PERFECT = TableErrors()


@dataclass(frozen=True)
class Site:
    """Where the rig stands.

    Attributes
    ----------
    latitude : float, rad
    gravity : float, m/s^2
    earth_rate : float, rad/s
    """

    latitude: float
    gravity: float
    earth_rate: float
    enu: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Keep the Earth rate in east, north, up beside its size."""
        object.__setattr__(self, "enu", earth_rate_enu(self.latitude, self.earth_rate))


class _Chain(NamedTuple):
    """Rotations from the rig's base to the case, what each turns about, and its angle (...,)."""

    letters: tuple[str, ...]
    angles: tuple[Array, ...]


_TILTS, _SETTINGS, _CROSSED = (0, 1), (2, 4, 6), (3, 5)
"""Places in the chain of the two tilts, of the three settings, of the two non-perpendicularities."""


def _chain(angles: Array, errors: TableErrors, letters: Letters) -> _Chain:
    first = "xyz".index(letters[0])
    tilts = "xyz"[(first + 1) % 3], "xyz"[(first + 2) % 3]
    across = [next(a for a in "xyz" if a not in pair) for pair in (letters[:2], letters[1:])]
    outer, middle, inner = np.moveaxis(angles + np.array(errors.zero), -1, 0)
    order = (*tilts, letters[0], across[0], letters[1], across[1], letters[2])
    small = [np.asarray(v) for v in (*errors.tilt, *errors.nonperpendicularity)]
    return _Chain(order, (small[0], small[1], outer, small[2], middle, small[3], inner))


def _product(factors: Sequence[Array]) -> Array:
    out = factors[0]
    for factor in factors[1:]:
        out = out @ factor
    return out


def attitude(angles: Array, errors: TableErrors = PERFECT, letters: Letters = STANDARD) -> Array:
    """C_k^n for settings of the table.

    Parameters
    ----------
    angles : ndarray, shape (..., 3), rad
        Outer, middle, inner.
    errors : TableErrors
    letters : tuple of str
        What the three axes turn about at zero.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    chain = _chain(angles, errors, letters)
    return _product([_TURN[a](v) for a, v in zip(chain.letters, chain.angles, strict=True)])


def rate(angles: Array, rates: Array, errors: TableErrors = PERFECT, letters: Letters = STANDARD) -> Array:
    """Rotation of the case against the Earth, in k.

    Parameters
    ----------
    angles, rates : ndarray, shape (..., 3), rad and rad/s
        Outer, middle, inner.
    errors : TableErrors
    letters : tuple of str

    Returns
    -------
    ndarray, shape (..., 3), rad/s
    """
    chain = _chain(angles, errors, letters)
    factors = [_TURN[a](v) for a, v in zip(chain.letters, chain.angles, strict=True)]
    inner_turn = factors[5] @ factors[6]
    middle_turn = factors[3] @ factors[4] @ inner_turn
    outer, middle, inner = (_UNIT[a] for a in letters)
    return np.asarray(
        rates[..., 0, None] * (outer @ middle_turn)
        + rates[..., 1, None] * (middle @ inner_turn)
        + rates[..., 2, None] * inner
    )


def inputs(
    angles: Array, rates: Array, site: Site, errors: TableErrors = PERFECT, letters: Letters = STANDARD
) -> tuple[Array, Array]:
    """Specific force and angular rate of the case, in k, for angles and rates at the same instants.

    Parameters
    ----------
    angles, rates : ndarray, shape (n, 3), rad and rad/s
    site : Site
    errors : TableErrors
    letters : tuple of str

    Returns
    -------
    specific_force, angular_rate : ndarray, shape (n, 3), m/s^2 and rad/s
    """
    to_enu = attitude(angles, errors, letters)
    force = site.gravity * to_enu[..., 2, :]
    return force, np.einsum("...ji,j->...i", to_enu, site.enu) + rate(angles, rates, errors, letters)


def averaging(turned: Array, count: Array) -> Array:
    """What is left of a turning vector after averaging over evenly spaced samples (Dirichlet kernel).

    Parameters
    ----------
    turned : ndarray
        Angle from one sample to the next, rad.
    count : ndarray of int
        Number of samples; one sample is left as it is, a whole turn leaves nothing.

    Returns
    -------
    ndarray
        Factor on the vector at mid time.
    """
    half = np.asarray(turned, dtype=float) / 2.0
    n = np.asarray(count, dtype=float)
    small = np.abs(np.sin(half)) < 1e-9
    safe = np.where(small, 1.0, np.sin(half))
    # whole turns from sample to sample look like standing still, or like alternating
    return np.where(small, np.cos(n * half) / np.cos(half), np.sin(n * half) / (n * safe))


class MeanInputs(NamedTuple):
    """Inputs of segments, averaged over their samples, in k, and their derivatives.

    The derivatives are to the three settings, two tilts and two non-perpendicularities; zero errors act as the settings do.
    """

    force: Array
    """(n, 3), m/s^2, without what a lever arm adds."""
    rate: Array
    """(n, 3), rad/s."""
    axis: Array
    """Direction of the axis that turns (outer axis in static segments), (n, 3)."""
    d_force: Array
    """(n, 3, 7)."""
    d_rate: Array
    """(n, 3, 7)."""
    d_axis: Array
    """(n, 3, 7)."""


def mean_inputs(
    angles: Array,
    rates: Array,
    left: Array,
    site: Site,
    errors: TableErrors = PERFECT,
    letters: Letters = STANDARD,
    *,
    derivatives: bool = True,
) -> MeanInputs:
    """Mean inputs of segments in which at most one axis turns, steadily.

    Averaging over the turn keeps of every vector its part along the axis, and :func:`averaging` of the rest.

    Parameters
    ----------
    angles : ndarray, shape (n, 3), rad
        Settings at the middle of each segment, with the errors of the settings.
    rates : ndarray, shape (n, 3), rad/s
        Of outer, middle and inner axis; one of them may be other than zero in a segment.
    left : ndarray, shape (n,)
        What :func:`averaging` leaves of a turning vector, one in static segments.
    site : Site
    errors : TableErrors
    letters : tuple of str
    derivatives : bool
        Whether they are needed; they are empty otherwise.

    Returns
    -------
    MeanInputs
    """
    chain = _chain(angles, errors, letters)
    n = len(angles)
    factors, slopes = [], []
    for place, (letter, angle) in enumerate(zip(chain.letters, chain.angles, strict=True)):
        turn = np.broadcast_to(_TURN[letter](angle), (n, 3, 3))
        slope = skew(_UNIT[letter]) @ turn
        if place in _SETTINGS:
            moving = rates[:, _SETTINGS.index(place)] != 0
            share = np.where(moving, left, 1.0)[:, None, None]
            along = np.outer(_UNIT[letter], _UNIT[letter])
            turn, slope = along + share * (turn - along), share * slope
        factors.append(turn)
        slopes.append(slope)
    which = np.where(rates[:, 1] != 0, 1, np.where(rates[:, 2] != 0, 2, 0))
    tails, d_tails = _tails(factors, slopes, derivatives)
    to_enu, d_to_enu = tails[0], d_tails[0]
    units = np.array([_UNIT[a] for a in letters])[which]
    after = np.array(_SETTINGS)[which] + 1  # an axis stands in k as what follows it in the chain puts it
    index = np.arange(n)
    axis = np.einsum("ni,nij->nj", units, tails[after, index])
    d_axis = np.einsum("ni,npij->njp", units, d_tails[after, index])
    force = site.gravity * to_enu[:, 2, :]
    speed = rates[index, which][:, None]
    turned = np.einsum("nji,j->ni", to_enu, site.enu) + speed * axis
    d_force = site.gravity * np.moveaxis(d_to_enu[:, :, 2, :], 1, 2)
    d_rate = np.einsum("npji,j->nip", d_to_enu, site.enu) + speed[..., None] * d_axis
    return MeanInputs(force, turned, axis, d_force, d_rate, d_axis)


def _tails(factors: Sequence[Array], slopes: Sequence[Array], derivatives: bool) -> tuple[Array, Array]:
    """Products from each place of the chain to its end (8, n, 3, 3), and their derivatives (8, n, 7 or 0, 3, 3)."""
    n, count = len(factors[0]), _EFFECTS if derivatives else 0
    columns = {place: k for k, place in enumerate((*_SETTINGS, *_TILTS, *_CROSSED))}
    tails, d_tails = np.empty((8, n, 3, 3)), np.zeros((8, n, count, 3, 3))
    tails[7] = np.eye(3)
    for place in range(6, -1, -1):
        tails[place] = factors[place] @ tails[place + 1]
        if derivatives:
            d_tails[place] = factors[place][:, None] @ d_tails[place + 1]
            d_tails[place, :, columns[place]] = slopes[place] @ tails[place + 1]
    return tails, d_tails
