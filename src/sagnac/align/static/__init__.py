r"""Static alignment: the attitude of a unit that stays at its place, from its own samples.

Its place may sway: people get in and out, wind and sea move it. What is told apart at rest and what is not:

- the level error is the accelerometers' bias over gravity, the heading error is the east gyros' bias over the horizontal Earth
  rate, ``eps_E / (w_e cos L)``, whatever the time; the stated biases set these floors;
- the bias of the gyros along north and of the accelerometers along the vertical are seen;
- a unit that is turned on its place during the alignment tells the others apart as well.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...earth import EARTH_RATE, normal_gravity
from ...errors import InputError
from ...frames import Array
from ...navigate.strapdown import Meaning
from ...navigate.stream import Stream
from ...recording import Recording
from ..result import Alignment
from . import checks, report
from .coarse import inertial
from .fit import Data, Place, look, loose, rows, settled, stated
from .model import Blocks, collect, joined
from .noise import found_noise

GYRO_BIAS, ACCEL_BIAS = math.radians(0.01) / 3600.0, 50e-6 * 9.80665
"""What the biases are taken to be (one sigma) unless stated: 0.01 deg/h and 50 ug, a navigation-grade unit's."""
_COARSE = 120
"""Blocks that means are looked at in."""
_POLE = math.radians(89.9)


def place_of(
    latitude: float,
    longitude: float,
    height: float,
    gravity: float | None = None,
    earth_rate: float = EARTH_RATE,
) -> Place:
    """Where the unit stands; gravity is that of the ellipsoid unless given. In rad, m, m/s^2 and rad/s.

    Raises
    ------
    InputError
        Off the Earth, or where there is no north.
    """
    if not abs(latitude) <= math.pi / 2:
        raise InputError(f"a latitude of {math.degrees(latitude):.6g} deg is none; it goes from -90 deg to 90 deg")
    if abs(latitude) > _POLE:
        raise InputError(
            "within some kilometres of a pole no unit finds north by itself; take its attitude from a master"
        )
    if not abs(longitude) <= 2.0 * math.pi or not -1e4 < height < 1e5:
        raise InputError(
            f"longitude {math.degrees(longitude):.6g} deg, height {height:.6g} m: no place where a unit could stand"
        )
    g = normal_gravity(latitude, height) if gravity is None else gravity
    return Place(latitude, longitude, height, g, earth_rate)


def align(
    recording: Recording,
    place: Place,
    *,
    start: float | None = None,
    stop: float | None = None,
    method: Literal["fine", "gyrocompass"] = "fine",
    meaning: Meaning = "instant",
    gyro_bias: ArrayLike | None = None,
    accel_bias: ArrayLike | None = None,
    gyro_noise: float | None = None,
    accel_noise: float | None = None,
    upside_down: bool = False,
) -> Alignment:
    """Align a unit that stays at its place.

    Parameters
    ----------
    recording : Recording
        With both triads, x right, y forward, z up.
    place : Place
        See :func:`place_of`.
    start, stop : float, s, optional
        Times to align between; all samples unless given.
    method : {"fine", "gyrocompass"}
        "fine": the maximum-likelihood estimate over all samples, for a unit that may sway. "gyrocompass": from the means of
        specific force and rate, for a unit that stands still.
    meaning : {"instant", "mean"}
        What samples that are not pulses are.
    gyro_bias, accel_bias : array_like, shape () or (3,), rad/s and m/s^2, optional
        What the biases may be, one sigma; :data:`GYRO_BIAS` and :data:`ACCEL_BIAS` unless given.
    gyro_noise, accel_noise : float, rad/s/Hz^0.5 and m/s^2/Hz^0.5, optional
        White noise; found in the samples unless given.
    upside_down : bool
        Whether the z axis may point down.

    Returns
    -------
    Alignment
        Attitude and velocity at the end of the time, biases, and their covariance.

    Raises
    ------
    InputError
        When columns are missing or something given is out of sense.
    DataError
        When these are not samples of a unit that stays at this place: it moves, signs, units or latitude are wrong; or at a
        gap, for how the unit sways in it is not known.
    """
    eps, nab = (
        _sizes(v, what) for v, what in ((_or(gyro_bias, GYRO_BIAS), "gyro"), (_or(accel_bias, ACCEL_BIAS), "accel"))
    )
    for density, what in ((gyro_noise, "gyro"), (accel_noise, "accel")):
        if density is not None and not 0.0 < density < math.inf:
            raise InputError(
                f"a noise of {density!r} of the {what} is none; leave it out and it is found in the samples"
            )
    checks.refuse_poor_gyros(place, eps, recording.name)
    stream = Stream(recording, meaning=meaning, start=start, stop=stop)
    blocks = collect(checks.sound(stream, recording.name))
    _refuse_early(blocks, place, eps, nab, upside_down, recording.name)
    remarks = report.opening(gyro_bias is None, accel_bias is None)
    if method == "gyrocompass":
        return report.of_means(recording, joined(blocks, _COARSE), place, eps, nab, remarks)
    C = inertial(blocks, place.latitude, earth_rate=place.earth_rate)
    prior = loose(place, C, eps, nab)
    data = Data.of(blocks, place)
    seen = look(data, C, prior)
    checks.refuse_other_axes(data, prior, seen, recording.name)
    checks.refuse_travel(joined(blocks, _COARSE), blocks.start + data.middle, seen, recording.name)
    table = rows(data, seen.C)
    noise = found_noise(data.middle, data.kernel, table, prior, place.gravity, gyro=gyro_noise, accel=accel_noise)
    seen = look(data, seen.C, prior, noise)
    remarks += checks.refuse_strange_biases(seen, place, eps, nab, recording.name)
    remarks += report.noise_remarks(noise, gyro_noise is None, accel_noise is None)
    found = settled(data, C, noise, stated(eps, nab))
    return report.of_fit(recording, blocks, place, found, np.concatenate([eps, nab]), remarks)


def _refuse_early(blocks: Blocks, place: Place, eps: Array, nab: Array, upside_down: bool, name: str) -> None:
    """What can be said before anything is fitted."""
    checks.refuse_strange_force(blocks, place, nab, name)
    checks.refuse_strange_rate(blocks, place, eps, name)
    if not upside_down:
        checks.refuse_upside_down(blocks, place, name)


def _or(given: ArrayLike | None, default: float) -> ArrayLike:
    return default if given is None else given


def _sizes(given: ArrayLike, what: str) -> Array:
    """Three sizes above zero."""
    sizes = np.asarray(given, dtype=float)
    if sizes.shape not in ((), (3,)) or not np.all((sizes > 0.0) & np.isfinite(sizes)):
        raise InputError(f"the {what} bias (one sigma) is one number or three, above zero; not {given!r}")
    return np.broadcast_to(sizes, 3).copy()
