"""Is a master's log sound in itself? Its velocity must be what its position does; a jump, a wrong unit, sign or name is told.

The difference quotient of the position is compared with the velocity, over stretches long enough for the rounding of the
position not to matter. Where they disagree, the log is read otherwise (other units, signs, columns exchanged) until one
reading explains it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...earth import ELLIPSOID, radii
from ...errors import DataError
from ...frames import Array, transform, unit
from ...navigate import wander
from ..master import Master

_STRETCH = 10.0  # s over which the position is differenced
_SLOW = 0.3  # m/s: a slower vehicle shows nothing of its velocity's unit or direction
_AGREE = 0.1  # share of the velocity that the difference quotient may be off
_BETTER = 0.25  # share of the misfit that another reading may leave
_ROBUST = 1.4826  # median absolute deviation to standard deviation
_FAR = 15.0  # robust deviations that a jump stands out by
_JUMP = 0.5  # m: smaller jumps of the position are not spoken of
_REFUSED = 10.0  # m: larger ones are refused


@dataclass(frozen=True)
class _Reading:
    """Another way to read a log."""

    words: str
    of: Callable[[Master], Master]


Flags = NDArray[np.bool_]


def _placed(change: Callable[[Array, Array], tuple[Array, Array]]) -> Callable[[Master], Master]:
    """The log with other latitudes and longitudes."""

    def of(m: Master) -> Master:
        latitude, longitude = change(m.latitude, m.longitude)
        return replace(m, latitude=latitude, longitude=longitude)

    return of


def _turned(*columns: tuple[int, float]) -> Callable[[Master], Master]:
    """The velocity with its components taken from other columns and signs."""
    index, signs = [c for c, _ in columns], np.array([s for _, s in columns])
    return lambda m: replace(m, velocity=m.velocity[:, index] * signs)


def _scaled(factor: float) -> Callable[[Master], Master]:
    return lambda m: replace(m, velocity=m.velocity * factor)


_DEG = math.pi / 180.0
_KNOT = 1852.0 / 3600.0
_E, _N, _U = (0, 1.0), (1, 1.0), (2, 1.0)
_READINGS = (
    _Reading("v_north has the other sign", _turned(_E, (1, -1.0), _U)),
    _Reading("v_east has the other sign", _turned((0, -1.0), _N, _U)),
    _Reading("v_east and v_north have the other sign", _turned((0, -1.0), (1, -1.0), _U)),
    _Reading("v_east and v_north are exchanged", _turned(_N, _E, _U)),
    _Reading("longitude is counted to the west", _placed(lambda lat, lon: (lat, -lon))),
    _Reading("latitude is counted to the south", _placed(lambda lat, lon: (-lat, lon))),
    _Reading("latitude and longitude are exchanged", _placed(lambda lat, lon: (lon, lat))),
    _Reading(
        "latitude and longitude look like radians but are labelled as degrees",
        _placed(lambda lat, lon: (lat / _DEG, lon / _DEG)),
    ),
    _Reading(
        "latitude and longitude look like degrees but are labelled as radians",
        _placed(lambda lat, lon: (lat * _DEG, lon * _DEG)),
    ),
    _Reading("the velocity looks like knots but is labelled m/s", _scaled(_KNOT)),
    _Reading("the velocity looks like km/h but is labelled m/s", _scaled(1 / 3.6)),
    _Reading("the velocity looks like ft/s but is labelled m/s", _scaled(0.3048)),
    _Reading("the velocity looks like m/s but is labelled as knots", _scaled(1 / _KNOT)),
    _Reading("the velocity looks like m/s but is labelled km/h", _scaled(3.6)),
)


def _moves(master: Master) -> tuple[Array, Array, Array]:
    """What the position did from sample to sample, and what the velocity says it did.

    In Earth-fixed axes, in which there is no singular place.

    Returns
    -------
    by_position, by_velocity : ndarray, shape (m - 1, 3), m
    up : ndarray, shape (m - 1, 3)
        Unit vectors.
    """
    C_n_e = np.swapaxes(wander.direction_cosines(master.latitude, master.longitude), -1, -2)
    meridian, normal = radii(master.latitude)
    level = (normal + master.height) * np.cos(master.latitude)
    place = np.column_stack(
        [
            level * np.cos(master.longitude),
            level * np.sin(master.longitude),
            (meridian * (1.0 - ELLIPSOID[1] * np.sin(master.latitude) ** 2) + master.height) * np.sin(master.latitude),
        ]
    )
    velocity = transform(C_n_e, master.velocity)
    by_velocity = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(master.time)[:, None]
    return np.diff(place, axis=0), by_velocity, unit(C_n_e[1:, :, 2] + C_n_e[:-1, :, 2])


def check(master: Master) -> list[str]:
    """Refuse a log whose velocity is not what its position does.

    Parameters
    ----------
    master : Master

    Returns
    -------
    list of str
        What is worth a word: gaps, small jumps.

    Raises
    ------
    DataError
        With the time of a jump, or with the reading of the columns that would explain them.
    """
    whole = ~master.wide
    misfit, speed, vertical, climb = _misfits(master, whole)
    if max(speed, misfit) > _SLOW and misfit > _AGREE * max(speed, _SLOW):
        _refuse_position(master, whole, misfit, speed)
    if max(climb, vertical) > _SLOW and vertical > 0.5 * max(climb, _SLOW) and np.isfinite(vertical):
        upside = _misfits(_turned(_E, _N, (2, -1.0))(master), whole)[2]
        said = (
            "v_up has the other sign (it is positive upwards)" if upside < _BETTER * vertical else "check both columns"
        )
        raise DataError(
            f"{master.name}: v_up and the change of height disagree by {vertical:.2g} m/s rms where v_up is {climb:.2g} m/s: "
            f"{said}"
        )
    return [*_gap_remarks(master), *_jumps(master, whole)]


def _gap_remarks(master: Master) -> list[str]:
    found = master.gaps()
    if not found:
        return []
    shown = ", ".join(f"{a:.6g} to {b:.6g} s" for a, b in found[:5]) + (", ..." if len(found) > 5 else "")
    return [
        f"{master.name} has {len(found)} gap{'s' * (len(found) > 1)}: {shown}; the slave navigates on its own there"
    ]


def _misfits(master: Master, whole: Flags) -> tuple[float, float, float, float]:
    """Rms of difference quotient less velocity, and of the velocity, level and vertical, m/s."""
    size = min(max(1, round(_STRETCH / master.interval)), len(master.time) - 1)
    first = np.arange(0, len(master.time) - 1, size)
    way, mean, up = _moves(master)
    good = whole.astype(float)[:, None]
    duration = np.add.reduceat(good * np.diff(master.time)[:, None], first, axis=0)
    long = duration[:, 0] > 0.5 * size * master.interval
    if not long.any():
        return 0.0, 0.0, 0.0, 0.0
    out = []
    for values in (way - mean, mean):
        stretch = (np.add.reduceat(good * values, first, axis=0) / np.maximum(duration, 1e-9))[long]
        vertical = np.einsum("ij,ij->i", stretch, up[first][long])
        out += [_rms((stretch**2).sum(axis=1) - vertical**2), _rms(vertical**2)]
    return out[0], out[2], out[1], out[3]


def _rms(squares: Array) -> float:
    """Root of the mean of all but the largest tenth: a jump spoils single stretches, and has a check of its own."""
    kept = np.sort(squares)[: max(1, len(squares) - 1 - len(squares) // 10)]
    return float(np.sqrt(np.maximum(kept, 0.0).mean()))


def _refuse_position(master: Master, whole: Flags, misfit: float, speed: float) -> None:
    """Raise, with the reading that explains velocity and position best."""
    tried = [(r, *_misfits(r.of(master), whole)[:2]) for r in _READINGS]
    good = [(m, r) for r, m, v in tried if m < max(_BETTER * misfit * v / max(speed, 1e-9), 0.3 * _AGREE * v)]
    if good:
        least = min(m for m, _ in good)
        words = "; or else ".join([r.words for m, r in good if m <= 1.5 * least + 1e-3][:2])
        raise DataError(
            f"{master.name}: velocity and change of position disagree ({misfit:.3g} m/s rms): {words}; correct the log"
        )
    raise DataError(
        f"{master.name}: velocity and change of position disagree by {misfit:.3g} m/s rms where the velocity is {speed:.3g} m/s: "
        "check the columns' units and names, and that both are of the same system"
    )


def _jumps(master: Master, whole: Flags) -> list[str]:
    """Remarks on small jumps of the position; large ones are refused."""
    way, mean, _ = _moves(master)
    size = np.linalg.norm(way - mean, axis=1)
    usual = _ROBUST * float(np.median(size[whole]))
    # where the velocity bends, the mean of two samples is not that of the time between them
    speed = mean / np.diff(master.time)[:, None]
    change = np.linalg.norm(np.diff(speed, axis=0, prepend=speed[:1], append=speed[-1:]), axis=1)
    bent = 0.5 * np.diff(master.time) * np.maximum(change[1:], change[:-1])
    out = np.flatnonzero((size > np.maximum(max(_FAR * usual, _JUMP), bent)) & whole)
    if not out.size:
        return []
    worst = int(out[np.argmax(size[out])])
    at = f"at {master.time[worst + 1]:.6g} s (row {worst + 2})"
    more = f", and at {out.size - 1} more times" if out.size > 1 else ""
    text = f"{master.name}: the position jumps by {size[worst]:.3g} m {at}{more}, which its velocity does not explain"
    if size[worst] > _REFUSED:
        raise DataError(f"{text}: the master was reset or its log was joined from two; align on one side of it")
    return [text]
