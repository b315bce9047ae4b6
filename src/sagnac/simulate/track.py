"""How a table moves through a plan: steady in the segments, a smooth move (cubic) between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..frames import Array, rot_x, rot_y, rot_z
from ..plan import AXES, Plan, Segment
from ..rigs.turntable import STANDARD, Letters, Site, TableErrors, attitude
from .positions import bring_up

_TURN = {"x": rot_x, "y": rot_y, "z": rot_z}


@dataclass(frozen=True)
class Track:
    """Angles of the three axes as cubics in time.

    Attributes
    ----------
    starts : ndarray, shape (p,), s
        Where each piece begins.
    cubics : ndarray, shape (p, 4, 3)
        Coefficients in the time since then, constant term first, in rad and s.
    """

    starts: Array
    cubics: Array

    def angles(self, time: Array) -> tuple[Array, Array]:
        """Angles and rates, shape (n, 3), rad and rad/s, at times (n,)."""
        piece = np.maximum(np.searchsorted(self.starts, time, side="right") - 1, 0)
        t = (time - self.starts[piece])[:, None]
        c0, c1, c2, c3 = np.moveaxis(self.cubics[piece], 1, 0)
        return c0 + t * (c1 + t * (c2 + t * c3)), c1 + t * (2.0 * c2 + 3.0 * t * c3)


def track(segments: Sequence[Segment], angles: Array, rates: Array) -> Track:
    """The way of a table that starts at rest with all angles zero and rests after the last segment.

    Parameters
    ----------
    segments : sequence of Segment
        In order of time.
    angles, rates : ndarray, shape (segments, 3), rad and rad/s
        True angles at the start of each, and true rates during it.

    Raises
    ------
    InputError
        When a segment begins somewhere else at the instant at which the one before ends.
    """
    starts, cubics = [], []
    time, angle, rate = 0.0, np.zeros(3), np.zeros(3)
    for s, first, speed in zip(segments, angles, rates, strict=True):
        begin = first + 2 * np.pi * np.round((angle - first) / (2 * np.pi))  # the near way round
        if s.start > time:
            starts.append(time)
            cubics.append(_move(s.start - time, (angle, rate), (begin, speed)))
        elif starts and np.abs(begin - angle).max() > math.radians(1.0):
            raise InputError(
                f"segment {s.name!r} begins at {s.start:g} s, when the table is still elsewhere: leave it time to move"
            )
        starts.append(s.start)
        cubics.append(np.stack([begin, speed, np.zeros(3), np.zeros(3)]))
        time, angle, rate = s.stop, begin + (s.stop - s.start) * speed, speed
    starts.append(time)
    cubics.append(np.stack([angle, *np.zeros((3, 3))]))
    return Track(np.array(starts), np.array(cubics))


def _move(time: float, begin: tuple[Array, Array], end: tuple[Array, Array]) -> Array:
    """Cubic from one angle and rate to another, (4, 3)."""
    (a0, r0), (a1, r1) = begin, end
    way = a1 - a0
    return np.stack([a0, r0, (3.0 * way / time - 2.0 * r0 - r1) / time, ((r0 + r1) - 2.0 * way / time) / time**2])


def settings(segment: Segment, letters: Letters = STANDARD, axes: int = 3) -> tuple[float, float, float]:
    """Angles of outer, middle and inner axis, rad, of a segment that gives them or the azimuths of x and y.

    Parameters
    ----------
    segment : Segment
    letters : tuple of str
    axes : int
        How many axes the table has.

    Raises
    ------
    InputError
        When it gives neither, or the table has no vertical axis to turn to an azimuth.
    """
    if segment.angles is not None:
        return segment.angles
    if segment.x_azimuth is None or segment.y_azimuth is None or segment.z is None:
        raise InputError(
            f"segment {segment.name!r} gives no attitude: write the angles of the axes, or x_azimuth, y_azimuth and z"
        )
    if letters[0] != "z":
        raise InputError(f"segment {segment.name!r}: azimuths need a vertical outer axis (rig.axes)")
    up = np.array([0.0, 0.0, 1.0 if segment.z == "up" else -1.0])
    x, y = (np.array([math.sin(a), math.cos(a), 0.0]) for a in (segment.x_azimuth, segment.y_azimuth))
    if float(y @ np.cross(up, x)) < 1.0 - 1e-6:
        raise InputError(f"segment {segment.name!r}: x_azimuth, y_azimuth and z are not those of a right-handed frame")
    first = bring_up(up, letters, axes)
    there = attitude(np.array(first), letters=letters)[:, 0]
    turn = math.atan2(there[0] * x[1] - there[1] * x[0], there[0] * x[0] + there[1] * x[1])
    return first[0] + turn, first[1], first[2]


def kernel_arguments(
    path: Track, site: Site, errors: TableErrors, letters: Letters, lever: Array
) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """What :func:`sagnac.kernels.simulation.table_inputs` takes after the time.

    The chain of rotations is that of :mod:`sagnac.rigs.turntable`: two tilts about the axes that the first one is not, and a
    non-perpendicularity about the axis across both neighbours; zero errors are added to the angles.
    """
    first = "xyz".index(letters[0])
    tilt = _TURN["xyz"[(first + 1) % 3]](errors.tilt[0]) @ _TURN["xyz"[(first + 2) % 3]](errors.tilt[1])
    across = [next(a for a in "xyz" if a not in pair) for pair in (letters[:2], letters[1:])]
    links = np.stack([_TURN[a](v).T for a, v in zip(across, errors.nonperpendicularity, strict=True)])
    cubics = path.cubics.copy()
    cubics[:, 0] += errors.zero
    axes = np.array(["xyz".index(a) for a in letters])
    up = site.gravity * tilt[2, :]
    return path.starts, cubics, axes, up, tilt.T @ site.enu, np.ascontiguousarray(links), lever


class TableMotion:
    """A unit carried through a plan by an imperfect table (a :class:`sagnac.simulate.engine.Motion`).

    Parameters
    ----------
    plan : Plan
    site : sagnac.rigs.turntable.Site
    errors : TableErrors
    setting_errors : ndarray, shape (segments, 3), rad
        Error of each setting.
    rate_error : float
        Relative error of all rates.
    lever : ndarray, shape (3,), m
        From where the axes meet to the unit, in the case.
    """

    def __init__(
        self, plan: Plan, site: Site, errors: TableErrors, setting_errors: Array, rate_error: float, lever: Array
    ) -> None:
        ordered = np.argsort([s.start for s in plan.segment], kind="stable")
        segments = [plan.segment[i] for i in ordered]
        stated = np.array([settings(s, plan.rig.letters, len(plan.rig.axes)) for s in segments])
        rates = np.array([s.rates for s in segments])
        self._names = tuple(AXES)[: len(plan.rig.axes)]
        self._stated = segments, stated, rates
        true = track(segments, stated + setting_errors[ordered], rates * (1.0 + rate_error))
        self._arguments = kernel_arguments(true, site, errors, plan.rig.letters, lever)

    @cached_property
    def _shown(self) -> Track:
        """The way that the settings say; asked for where the rig's channels are recorded only."""
        return track(*self._stated)

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """Specific force and angular rate of the case, (n, 3) each, m/s^2 and rad/s."""
        from ..kernels.simulation import table_inputs

        force, rate = np.empty((time.size, 3)), np.empty((time.size, 3))
        table_inputs(time, *self._arguments, force, rate)
        return force, rate

    def columns(self, time: Array) -> dict[str, Array]:
        """What the table shows of its angles, rad: the settings, without their errors."""
        angles, _ = self._shown.angles(time)
        return {name: np.ascontiguousarray(angles[:, i]) for i, name in enumerate(self._names)}
