"""Whether this is a unit that stays at its place, at the latitude, with the signs and in the units that were said.

What is refused here is named; a wrong attitude with a small uncertainty would be worse than none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import permutations, product

import numpy as np

from ...errors import DataError
from ...frames import Array, cross, rotation_vector
from ...navigate.stream import Piece
from .coarse import inertial
from .fit import Data, Look, Place, look
from .model import Blocks, read_otherwise

_FAR = 5.0  # standard uncertainties
_SIZE = 0.02  # error of the specific force that no usable accelerometer has
_NEAR = 0.2  # share by which a ratio may miss that of two units
_SPEED, _REACH = 0.5, 5.0  # m/s and m: what nobody calls standing or moored
_EXPLAINED = 0.3  # share of the changes that turns must explain to say anything
_PARTS = 6
_TURN, _PUSH, _ALONE = 1e-4, 0.05, 100.0
"""An increment of more than this, rad and m/s, that is so many times all around it, is an error of the log."""
_RING = 13
_AROUND = np.abs(np.arange(-_RING, _RING + 1)) > 3
"""Which samples are around one; those next to it share in it where samples are integrated."""
_QUIET, _LITTLE, _WORSE = 0.02, 0.1, 3.0
"""Displacement that is nothing to wonder at, m; that another reading of the axes may leave, m; and how many times less."""
_HEADING = math.radians(5.0)
_AXES = ("x", "y", "z")
_ENU = ("east", "north", "the vertical")

_FORCE_UNITS = (
    (9.80665, "m/s^2 labelled g"),
    (1 / 9.80665, "g labelled m/s^2"),
    (1e3, "mg labelled g"),
    (1e-3, "g labelled mg"),
    (1e6, "ug labelled g"),
)
_RATE_UNITS = (
    (180 / math.pi, "deg/s labelled rad/s"),
    (math.pi / 180, "rad/s labelled deg/s"),
    (3600.0, "deg/h labelled deg/s"),
    (1 / 3600, "deg/s labelled deg/h"),
    (648000 / math.pi, "deg/h labelled rad/s"),
    (60.0, "pulses of arcseconds labelled arcminutes"),
)
"""Readings that are larger than they should be by this factor, and how that comes about."""


def sound(pieces: Iterable[Piece], name: str) -> Iterator[Piece]:
    """The same increments, without any that stands alone far above all around it.

    A knock on a vehicle rings on for more than a few samples; what does not is an error of the log.

    Raises
    ------
    DataError
        With sensor, time and size.
    """
    table = np.empty((0, 8))
    for piece in pieces:
        first = max(0, len(table) - _RING)  # those before have been looked at
        table = np.vstack([table, np.column_stack([piece.time, piece.steps, piece.turns, piece.pushes])])
        _refuse_lone(table, first, len(table) - _RING, name)
        table = table[-2 * _RING :]
        yield piece
    _refuse_lone(table, max(0, len(table) - _RING), len(table), name)


def _refuse_lone(table: Array, first: int, last: int, name: str) -> None:
    """Refuse a lone sample among those from `first` to before `last` in a table of time, step, turn and push, (n, 8)."""
    from scipy.ndimage import maximum_filter

    if last <= first:
        return
    for sensor, columns, least, unit, scale in (
        ("gyro", slice(2, 5), _TURN, "deg/s", 180.0 / math.pi),
        ("accel", slice(5, 8), _PUSH, "m/s^2", 1.0),
    ):
        sums = table[:, columns]
        off = np.abs(sums - np.median(sums, axis=0))
        size = off.max(axis=1)
        if size[first:last].max() < least:
            continue
        around = maximum_filter(size, footprint=_AROUND, mode="constant")
        around = np.maximum(around, max(np.median(size), least / _ALONE))
        i = first + int(np.argmax((size / around)[first:last]))
        if size[i] > _ALONE * around[i]:
            axis = int(np.argmax(off[i]))
            reads = f"{scale * sums[i, axis] / table[i, 1]:.4g} {unit} about {table[i, 0]:.9g} s"
            raise DataError(
                f"{name}: {sensor}_{_AXES[axis]} reads {reads}, {size[i] / around[i]:.2g} times what is around it, in a sample "
                "that stands alone: an error of the log, not of the unit. Mend it, or take the part before or after it "
                "(--from, --to)"
            )


def refuse_strange_force(blocks: Blocks, place: Place, accel_bias: Array, name: str) -> None:
    """Refuse a mean specific force that is not gravity.

    Raises
    ------
    DataError
        With the unit that was likely meant.
    """
    size = float(np.linalg.norm(blocks.body_force, axis=1).mean())
    ratio = size / place.gravity
    if abs(ratio - 1.0) > max(_SIZE, _FAR * float(np.linalg.norm(accel_bias)) / place.gravity):
        raise DataError(
            f"{name}: the mean specific force is {size:.4g} m/s^2 where gravity is {place.gravity:.4g} m/s^2: "
            + (_unit_of(ratio, _FORCE_UNITS) or "the unit moved off, or the accelerometers' scale is wrong")
        )


def _unit_of(ratio: float, table: tuple[tuple[float, str], ...], near: float = _NEAR) -> str:
    """What makes readings wrong by this factor, in words; empty where nothing known does."""
    for factor, words in table:
        if ratio > 0.0 and abs(math.log(ratio / factor)) < near:
            return f"they look like {words}"
    return ""


def mean_rate(time: Array, angles: Iterable[Array]) -> tuple[Array, Array]:
    """Slope of angles that sway, part by part, and its covariance.

    A straight line through angles that come back again and again is much steadier than the mean of the rates. Parts that are far
    from the others (people move about, the unit is turned on its place) are left out; how the rest scatters is the uncertainty.

    Parameters
    ----------
    time : ndarray, shape (n,), s
    angles : iterable of ndarray, shape (k, 3), rad
        One after the other, n together.

    Returns
    -------
    rate : ndarray, shape (3,), rad/s
    covariance : ndarray, shape (3, 3), rad^2/s^2
    """
    slopes, at = [], 0
    for part in angles:
        t = time[at : at + len(part)]
        at += len(part)
        t = t - t.mean()
        slopes.append(t @ part / (t @ t))
    found = np.array(slopes)
    off = np.linalg.norm(found - np.median(found, axis=0), axis=1)
    found = found[off <= 6.0 * np.median(off)]
    return found.mean(axis=0), np.cov(found.T) / len(found)


def _body_angles(blocks: Blocks) -> list[Array]:
    """The plain integral of the rates in body axes, in parts."""
    return np.array_split(np.cumsum(blocks.body_rate * blocks.length[:, None], axis=0), _PARTS)


def _inertial_angles(blocks: Blocks) -> list[Array]:
    """How the body has turned, in s, in parts, each against its own middle."""
    out = []
    for C in np.array_split(blocks.C_b_s, _PARTS):
        here = C[len(C) // 2]
        out.append(rotation_vector(here.T @ C) @ here.T)
    return out


def refuse_strange_rate(blocks: Blocks, place: Place, gyro_bias: Array, name: str) -> None:
    """Refuse a mean rate that is not the Earth's, in size or along the vertical.

    Raises
    ------
    DataError
        With the unit, the sign or the latitude that is likely wrong.
    """
    bias = float(np.linalg.norm(gyro_bias))
    rate, covariance = mean_rate(blocks.end, _body_angles(blocks))
    size, allowed = float(np.linalg.norm(rate)), _FAR * (math.sqrt(np.trace(covariance)) + bias)
    if not 0.5 < size / place.earth_rate < 2.0 and abs(size - place.earth_rate) > allowed:
        _refuse_size(size, place, allowed, name)
    rate, covariance = mean_rate(blocks.end, _inertial_angles(blocks))
    up = blocks.speed[-1] / np.linalg.norm(blocks.speed[-1])
    allowed = _FAR * (math.sqrt(up @ covariance @ up) + bias)
    vertical, wanted = float(up @ rate), float(place.rate[2])
    if abs(vertical - wanted) > allowed:
        if abs(vertical) > place.earth_rate + allowed:
            _refuse_size(max(size, abs(vertical)), place, allowed, name)
        _refuse_vertical(vertical, wanted, allowed, float(blocks.body_force[:, 2].mean()) / place.gravity, place, name)


def _refuse_size(size: float, place: Place, allowed: float, name: str) -> None:
    ratio = size / place.earth_rate
    words = _unit_of(ratio, _RATE_UNITS, 2.0 * _NEAR) if size > 0 else "the gyros say nothing at all"
    if not words:
        words = (
            "the unit turned or moved off, or its gyros have a larger bias than stated (--gyro-bias)"
            if ratio > 1
            else "the gyros' scale is wrong, or they have a larger bias than stated (--gyro-bias)"
        )
    raise DataError(
        f"{name}: the unit turns at {_per_hour(size)} on the mean, where the Earth turns at {_per_hour(place.earth_rate)} "
        f"(give or take {_per_hour(allowed)}): {words}"
    )


def _refuse_vertical(vertical: float, wanted: float, allowed: float, z: float, place: Place, name: str) -> None:
    told = (
        f"{name}: along the specific force the unit turns at {_per_hour(vertical)}, where the Earth turns at "
        f"{_per_hour(wanted)} about the vertical at a latitude of {math.degrees(place.latitude):.4g} deg (give or take "
        f"{_per_hour(allowed)})"
    )
    if abs(vertical + wanted) > allowed:
        shown = math.degrees(math.asin(max(-1.0, min(1.0, vertical / place.earth_rate))))
        raise DataError(
            f"{told}: the gyros show a latitude of {shown:.4g} deg, or have a larger bias than stated (--gyro-bias)"
        )
    if z < -0.5:
        raise DataError(
            f"{told}, and the z axis reads {z:.2f} g: the accelerometers have the wrong sign (at rest an upward axis reads "
            f"+g here, not -g), or the unit lies upside down and the latitude has the wrong sign"
        )
    raise DataError(
        f"{told}: the latitude has the wrong sign (north is positive), or the gyros have (positive is counter-clockwise seen "
        f"from the tip of an axis), or one sensor's axes are not right-handed"
    )


def refuse_upside_down(blocks: Blocks, place: Place, name: str) -> None:
    """Refuse a unit whose z axis points down, with a specific force and a rate that fit each other.

    Raises
    ------
    DataError
    """
    z = float(blocks.body_force[:, 2].mean()) / place.gravity
    if z < -0.5:
        raise DataError(
            f"{name}: the z axis reads {z:.2f} g: the unit lies upside down, or its axes are x forward, y right, z down. Here "
            f"they are x right, y forward, z up: exchange x and y with --map and turn the sign of z; if the unit really lies so, "
            f"say --upside-down"
        )


def _per_hour(rate: float) -> str:
    return f"{math.degrees(rate) * 3600:.4g} deg/h"


def refuse_other_axes(data: Data, prior: Array, seen: Look, name: str) -> None:
    """Refuse gyros whose axes are not those of the accelerometers, as far as the unit tilts.

    A tilt that the gyros tell otherwise than the accelerometers becomes a displacement that grows with the square of the time.
    When the unit is displaced by more than people in a vehicle do it, all ways to exchange and reverse the gyros' axes are tried.

    Raises
    ------
    DataError
        With the way that leaves far less.
    """
    given = _displaced(seen)
    if given < _QUIET:
        return
    found: tuple[float, str] = (given, "")
    for axes, sign in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        reading = np.diag(sign) @ np.eye(3)[list(axes)]
        other = data.read_otherwise(read_otherwise(data.blocks, reading))
        C = inertial(other.blocks, data.site.latitude, earth_rate=data.site.earth_rate)
        left = _displaced(look(other, C, prior))
        if left < found[0]:
            words = (f"{x} = {'-' * (g < 0)}gyro_{_AXES[a]}" for x, a, g in zip(_AXES, axes, sign, strict=True))
            found = left, ", ".join(words)
    if found[0] < min(_LITTLE, given / _WORSE):
        raise DataError(
            f"{name}: when the unit tilts, gyros and accelerometers do not tell of the same turns: it would have been displaced "
            f"by {given:.2g} m. With {found[1]} it would be {found[0]:.2g} m: the axes of one of them are exchanged or reversed"
        )


def _displaced(seen: Look) -> float:
    """Horizontal displacement that is left over, rms, m."""
    return float(np.sqrt((seen.place[:, :2] ** 2).sum(axis=1).mean()))


def _refuse_strange_turns(blocks: Blocks, name: str) -> None:
    """Refuse gyros in another unit, as the accelerometers tell it of a unit that sways: ``df/dt = -w x f``.

    A unit high above the axis that it rolls about feels its own acceleration too, so that this is asked only of samples
    that nothing explains.
    """
    f = blocks.body_force
    turned = 0.5 * blocks.body_rate * blocks.length[:, None]
    change, expected = np.diff(f, axis=0), cross(0.5 * (f[1:] + f[:-1]), turned[1:] + turned[:-1])
    size, share = float((expected**2).sum()), float((change * expected).sum())
    if size > 0.0 and share > 0.0 and share**2 / size > _EXPLAINED * float((change**2).sum()):
        words = _unit_of(size / share, _RATE_UNITS, 2.0 * _NEAR)
        if words:
            raise DataError(
                f"{name}: the gyros read {size / share:.3g} times the turns that tilt the accelerometers: {words}"
            )


def refuse_travel(blocks: Blocks, time: Array, seen: Look, name: str) -> None:
    """Refuse a unit that did not stay at its place, or whose sensors do not speak of the same place.

    Parameters
    ----------
    blocks : Blocks
    time : ndarray, shape (m,), s
        Middles of the windows of `seen`.
    seen : Look
    name : str

    Raises
    ------
    DataError
        With a unit of the gyros that would explain it, or else with when and how fast it went.
    """
    level = seen.place[:, :2]
    speed = np.linalg.norm(np.diff(level, axis=0), axis=1) / np.diff(time)
    reach = float(np.ptp(level, axis=0).max())
    if speed.max() > _SPEED or reach > _REACH:
        _refuse_strange_turns(blocks, name)
        k = int(np.argmax(speed))
        raise DataError(
            f"{name}: the unit did not stay at its place: it seems to go over {reach:.2g} m, up to {speed[k]:.2g} m/s about "
            f"{0.5 * (time[k] + time[k + 1]):.6g} s. Choose a time at rest with --from and --to"
        )


def refuse_strange_biases(seen: Look, place: Place, gyro_bias: Array, accel_bias: Array, name: str) -> list[str]:
    """Refuse samples that ask for biases that are not what was said of them; remarks on those that are far out.

    Parameters
    ----------
    seen : Look
        A fit that takes next to nothing of the biases for granted.
    place : Place
    gyro_bias, accel_bias : ndarray, shape (3,), rad/s and m/s^2
        What was said, one sigma.
    name : str

    Returns
    -------
    list of str

    Raises
    ------
    DataError
    """
    remarks = []
    axes = seen.C  # of the body at the start, in east, north, up of the middle of the time
    for what, values, part, limits, unit, size in (
        ("gyro", seen.eps, slice(0, 3), gyro_bias, "deg/h", math.pi / 648000),
        ("accel", seen.nab, slice(3, 6), accel_bias, "ug", 9.80665e-6),
    ):
        found, said = axes @ values, np.sqrt((axes**2) @ limits**2)
        sigma = np.sqrt(np.diag(axes @ seen.covariance[part, part] @ axes.T))
        ratio = np.abs(found) / np.hypot(said, sigma)
        k = int(np.argmax(ratio))
        told = (
            f"the samples ask for {what} biases of {found[k] / size:.3g} {unit} along {_ENU[k]}, where "
            f"{said[k] / size:.3g} {unit} was said (one sigma, --{what}-bias)"
        )
        if ratio[k] > _FAR:
            raise DataError(f"{name}: {told}: either that is too small, or {_otherwise(what, axes @ seen.eps, place)}")
        if ratio[k] > 3.0:
            remarks.append(told)
    return remarks


def _otherwise(what: str, eps: Array, place: Place) -> str:
    """What else could look like such biases."""
    if what == "accel":
        return "the height or the gravity is that of another place, or the accelerometers' scale is off"
    share = float(place.rate[1] + eps[1]) / place.earth_rate
    if not abs(share) < 1.0:
        return "the gyros' scale is off"
    shown = math.copysign(math.degrees(math.acos(share)), place.latitude)
    return f"the latitude is that of another place (the rate is that of {shown:.2f} deg), or the gyros' scale is off"


def refuse_poor_gyros(place: Place, gyro_bias: Array, name: str) -> None:
    """Refuse gyros of which can be said beforehand that they do not find north.

    Raises
    ------
    DataError
    """
    level = float(np.sqrt((gyro_bias**2).mean()))
    sigma = level / (place.earth_rate * math.cos(place.latitude))
    refuse_no_heading(sigma, gyro_bias, "Gyros that see the Earth turn are needed", name)


def refuse_no_heading(sigma: float, gyro_bias: Array, advice: str, name: str) -> None:
    """Refuse gyros that cannot find north.

    Raises
    ------
    DataError
    """
    if not sigma < _HEADING:
        raise DataError(
            f"{name}: heading cannot be found: its standard uncertainty is {math.degrees(sigma):.3g} deg with gyros whose "
            f"bias may be {_per_hour(float(np.max(gyro_bias)))}. {advice}"
        )
