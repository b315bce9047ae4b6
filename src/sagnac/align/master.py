"""The master's log: position, velocity and attitude of the base's navigation system, read and checked.

The columns are ``time [s], latitude [deg], longitude [deg], height [m], v_east [m/s], v_north [m/s], v_up [m/s]`` and, where the
master gives its attitude, ``heading [deg], pitch [deg], roll [deg]``; other units of the same kind are as good.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import formats, units
from ..errors import InputError
from ..frames import Array, attitude_matrix
from ..recording import GAP, header_parts

ANGLES = ("heading", "pitch", "roll")
# column -> SI unit, example of a header
_COLUMNS = {
    "time": ("s", "s"),
    "latitude": ("rad", "deg"),
    "longitude": ("rad", "deg"),
    "height": ("m", "m"),
    "v_east": ("m/s", "m/s"),
    "v_north": ("m/s", "m/s"),
    "v_up": ("m/s", "m/s"),
    **dict.fromkeys(ANGLES, ("rad", "deg")),
}
_NEEDED = tuple(name for name in _COLUMNS if name not in ANGLES)
# size beyond which a value is not one of a vehicle on Earth
_LARGEST = {"height": 1e5, "v_east": 3000.0, "v_north": 3000.0, "v_up": 3000.0, "pitch": math.pi / 2 + 1e-9}
_LARGEST |= {"latitude": math.pi / 2 + 1e-12, "longitude": 2 * math.pi + 1e-9}


@dataclass(frozen=True)
class Master:
    """Samples of the master.

    Attributes
    ----------
    time : ndarray, shape (m,), s
        As stamped; a known lateness is not taken out.
    latitude, longitude : ndarray, shape (m,), rad
        The longitude goes on beyond pi where the log crosses the date line.
    height : ndarray, shape (m,), m
    velocity : ndarray, shape (m, 3), m/s
        East, north, up.
    attitude : ndarray, shape (m, 3, 3), or None
        C_b_n: takes body coordinates (x right, y forward, z up) to east, north, up.
    name : str
        For messages.
    """

    time: Array
    latitude: Array
    longitude: Array
    height: Array
    velocity: Array
    attitude: Array | None
    name: str = "master"

    @property
    def interval(self) -> float:
        """Usual time between samples, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def wide(self) -> NDArray[np.bool_]:
        """Which intervals between samples are gaps, shape (m - 1,)."""
        return np.asarray(np.diff(self.time) > GAP * self.interval)

    def gaps(self) -> list[tuple[float, float]]:
        """Start and end, in s, of the stretches without samples."""
        return [(float(self.time[i]), float(self.time[i + 1])) for i in np.flatnonzero(self.wide)]


def from_arrays(
    time: Array,
    latitude: Array,
    longitude: Array,
    height: Array,
    velocity: Array,
    angles: Array | None = None,
    *,
    name: str = "master",
) -> Master:
    """A master from arrays in memory, checked as a file is.

    Parameters
    ----------
    time : array_like, shape (m,), s
    latitude, longitude : array_like, shape (m,), rad
    height : array_like, shape (m,), m
    velocity : array_like, shape (m, 3), m/s
        East, north, up.
    angles : array_like, shape (m, 3), rad, optional
        Heading, pitch, roll.
    name : str
        Used in messages.

    Raises
    ------
    InputError
        As :func:`open_master`.
    """
    v = np.asarray(velocity, dtype=float)
    given: dict[str, Any] = {"time": time, "latitude": latitude, "longitude": longitude, "height": height}
    given |= {f"v_{n}": v[:, i] for i, n in enumerate(("east", "north", "up"))}
    if angles is not None:
        given |= {n: np.asarray(angles, dtype=float)[:, i] for i, n in enumerate(ANGLES)}
    return _checked(name, {k: np.asarray(values, dtype=float) for k, values in given.items()})


def open_master(path: str | Path) -> Master:
    """Read the log of a master, CSV or Parquet.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        With file, row and reason: a column that is missing or has no unit or a wrong one, a sample that is not finite or out of
        range, time that does not increase.
    """
    table = formats.open_table(path)
    columns = _found(table.columns, str(path))
    factors = {name: _factor(f"{path}: column {c!r}", name, header_parts(c)[1]) for name, c in columns.items()}
    wanted = list(columns.values())
    pieces = [[_floats(p.column(i)) for i in range(len(wanted))] for p in table.read(wanted, ())]
    if not pieces:
        raise InputError(f"{path}: no samples")
    joined = dict(zip(columns, map(np.concatenate, zip(*pieces, strict=True)), strict=True))
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found next
        return _checked(str(path), {name: joined[name] * factors[name] for name in columns})


def _found(headers: tuple[str, ...], source: str) -> dict[str, str]:
    """Name of a quantity -> header of its column."""
    out: dict[str, str] = {}
    for header in headers:
        name = header_parts(header)[0]
        if name not in _COLUMNS:
            continue
        if name in out:
            raise InputError(f"{source}: the columns {out[name]!r} and {header!r} are both {name}; drop one of them")
        out[name] = header
    missing = [n for n in _NEEDED if n not in out]
    if any(n in out for n in ANGLES):
        missing += [n for n in ANGLES if n not in out]
    if missing:
        wanted = ", ".join(f"{n} [{_COLUMNS[n][1]}]" for n in missing)
        raise InputError(f"{source}: a master's log lacks {wanted}; the columns are: {', '.join(headers)}")
    return out


def _factor(what: str, name: str, unit_text: str | None) -> float:
    """What to multiply a column by to get SI."""
    si, example = _COLUMNS[name]
    if not unit_text:
        raise InputError(f"{what} has no unit. Write it in the header: {name} [{example}]")
    try:
        value = units.quantity(f"1 {unit_text}", what).to(units.quantity(f"1 {si}").units)
    except InputError:
        raise
    except Exception as cause:  # pint raises unrelated types
        raise InputError(f"{what}: {unit_text!r} is no unit of {name}; write for example {name} [{example}]") from cause
    return float(value.magnitude)


def _floats(column: Any) -> Array:
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)


def _checked(name: str, columns: Mapping[str, Array]) -> Master:
    """A master of columns in SI, or the row and reason of what is wrong with them."""
    time = columns["time"]
    if time.size < 2:
        raise InputError(f"{name}: {time.size} sample{'s' * (time.size != 1)}; a master's log needs two at least")
    for column, values in columns.items():
        if values.shape != time.shape:
            raise InputError(f"{name}: {column} has shape {values.shape}, time has {time.size} samples")
        _refuse(name, column, values, ~np.isfinite(values), "not a finite number; remove or mend these samples first")
    wrong = np.flatnonzero(np.diff(time) <= 0)
    if wrong.size:
        i = int(wrong[0]) + 1
        raise InputError(
            f"{name}: row {i + 1}: time goes from {time[i - 1]:.9g} s to {time[i]:.9g} s; it must increase from sample to sample"
        )
    for column, largest in _LARGEST.items():
        if column in columns:
            unit = _COLUMNS[column][0]
            beyond = f"beyond what is found on Earth ({largest:.4g} {unit} at most); check the column's unit"
            _refuse(name, column, columns[column], np.abs(columns[column]) > largest, beyond)
    attitude = attitude_matrix(*(columns[a] for a in ANGLES)) if "heading" in columns else None
    velocity = np.column_stack([columns[f"v_{n}"] for n in ("east", "north", "up")])
    longitude = np.unwrap(columns["longitude"])
    return Master(time, columns["latitude"], longitude, columns["height"], velocity, attitude, name)


def _refuse(name: str, column: str, values: Array, wrong: Any, why: str) -> None:
    """Refuse a column with a sample that is wrong, and say which is the first."""
    bad = np.flatnonzero(wrong)
    if bad.size:
        count = f" ({bad.size} such)" if bad.size > 1 else ""
        shown = (
            "missing or not a number" if math.isnan(values[bad[0]]) else f"{values[bad[0]]:.6g} {_COLUMNS[column][0]}"
        )
        raise InputError(f"{name}: row {int(bad[0]) + 1}: {column} is {shown}{count}: {why}")
