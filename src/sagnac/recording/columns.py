"""Which column is what: standard names, units, nominal scale factors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .. import units
from ..errors import InputError
from .record import SENSORS

_KIND = {
    "time": "time",
    "accel": "acceleration",
    "gyro": "angular rate",
    "outer": "angle",
    "middle": "angle",
    "inner": "angle",
    "arm": "angle",
    "encoder": "angle",
    "temperature": "temperature",
}
RIG = ("outer", "middle", "inner", "arm", "encoder", "temperature")
NAMES = ("time", *SENSORS["accel"], *SENSORS["gyro"], *RIG)
_HEADER = re.compile(r"([^\[\]]*)\[([^\[\]]*)\]\s*")


@dataclass(frozen=True)
class Channel:
    """How a column becomes SI: value * factor, and per sample interval when it counts increments."""

    column: str
    factor: float
    increment: bool = False
    offset: float = 0.0
    counted: bool = False


def headers(columns: tuple[str, ...], rename: Mapping[str, str], path: Path) -> dict[str, tuple[str, str | None]]:
    """Standard name -> (column, unit text), by the headers themselves and by what the user renames."""
    parsed = {column: header_parts(column) for column in columns}
    renamed = mapped(columns, rename, path)
    out = {name: (column, parsed[column][1]) for name, column in renamed.items()}
    for column, (bare, unit_text) in parsed.items():
        if bare not in NAMES or bare in renamed or column in renamed.values():
            continue
        if bare in out:
            raise InputError(
                f"{path}: the columns {out[bare][0]!r} and {column!r} are both {bare}; "
                f"say which one counts with --map '{bare}={column}'"
            )
        out[bare] = (column, unit_text)
    return out


def mapped(columns: tuple[str, ...], rename: Mapping[str, str], path: Path) -> dict[str, str]:
    """Standard name -> column, of what the user renames alone."""
    parsed = {column: header_parts(column) for column in columns}
    out: dict[str, str] = {}
    for name, own in _by_axis(rename, parsed).items():
        column = _renamed(name, own, parsed, path)
        owner = next((n for n, c in out.items() if c == column), None)
        if owner is not None:
            raise InputError(f"--map {name}={own}: the column {column!r} of {path} is {owner} already")
        out[name] = column
    return out


def header_parts(column: str) -> tuple[str, str | None]:
    """Name and unit text of a header, ``accel_x [g]``; the unit is None when there are no brackets at its end."""
    match = _HEADER.fullmatch(column)
    return (match[1].strip(), match[2].strip()) if match else (column.strip(), None)


def _by_axis(rename: Mapping[str, str], parsed: Mapping[str, tuple[str, str | None]]) -> dict[str, str]:
    """``accel=acc`` as the three columns of a matrix, acc.1, acc.2 and acc.3, whatever unit stands behind."""
    known = {*parsed, *(bare for bare, _ in parsed.values())}
    out: dict[str, str] = {}
    for name, own in rename.items():
        if name not in SENSORS:
            out[name] = own
            continue
        columns = [f"{own}.{k}" for k in (1, 2, 3)]
        if any(c not in known for c in columns):
            raise InputError(
                f"--map {name}={own}: there are no columns {', '.join(columns)}; name the axes one by one, "
                f"{name}_x=..., {name}_y=..., {name}_z=...; the columns are: {', '.join(parsed)}"
            )
        out |= dict(zip(SENSORS[name], columns, strict=True))
    return out


def _renamed(name: str, own: str, parsed: Mapping[str, tuple[str, str | None]], path: Path) -> str:
    """The column that a ``--map`` pair means."""
    if name not in NAMES:
        raise InputError(f"--map {name}={own}: {name!r} is no standard name ({', '.join(NAMES)})")
    found = [own] if own in parsed else [c for c, (bare, _) in parsed.items() if bare == own]
    if not found:
        raise InputError(f"--map {name}={own}: {path} has no column {own!r}; it has: {', '.join(parsed)}")
    if len(found) > 1:
        raise InputError(f"--map {name}={own}: {path} has several such columns: {', '.join(found)}; write one in full")
    return found[0]


def refuse_unknown(option: str, given: Mapping[str, str]) -> None:
    """Refuse units or scales of what is no column."""
    known = {*SENSORS, *NAMES} if option == "units" else {*SENSORS, *SENSORS["accel"], *SENSORS["gyro"]}
    for name in given:
        if name not in known:
            raise InputError(f"{option}: {name}={given[name]}: {name!r} is none of {', '.join(sorted(known))}")


def _lookup(table: Mapping[str, str], name: str) -> str | None:
    return table.get(name, table.get(name.split("_", maxsplit=1)[0]))


def channel(
    name: str,
    column: str,
    unit_text: str | None,
    units_of: Mapping[str, str],
    scale: Mapping[str, str],
    path: Path,
    counts: set[str],
) -> Channel:
    """How a column becomes SI; a count column without nominal scale adds its name to `counts`."""
    group = name.split("_", maxsplit=1)[0]
    kind = _KIND[group]
    unit_text = _lookup(units_of, name) or unit_text
    example = {"accel": "accel=g", "gyro": "gyro=deg/s"}.get(group, f"{name}={units.KINDS[kind][0]}")
    if unit_text is None or not unit_text.strip():
        raise InputError(
            f"{path}: column {column!r} has no unit. Write it in the header ({name} [{example.split('=')[1]}]) "
            f"or give it with --units {example}"
        )
    what = f"{path}: column {column!r}"
    if group in SENSORS and units.is_count(unit_text):
        text = _lookup(scale, name)
        if text is None:
            counts.add(name)
            return Channel(column, 1.0)
        worth, increment = nominal_scale(text, group, what)
        return Channel(column, worth, increment, counted=True)
    if kind == "temperature":
        zero = units.parse(f"0 {unit_text}", kind, what)
        return Channel(column, units.parse(f"1 {unit_text}", kind, what) - zero, offset=zero)
    return Channel(column, units.factor(unit_text, kind, what))


def nominal_scale(text: str, sensor: str, what: str) -> tuple[float, bool]:
    """Factor from counts to SI and whether the counts are increments over a sample interval.

    Parameters
    ----------
    text : str
        ``16384 LSB/g`` (the count is the input) or ``1.1866 pulse/arcsec``, ``10800 pulse/g/s`` (the count is the
        input summed over the sample interval).
    sensor : str
        ``accel`` or ``gyro``.
    what : str
        For the message.
    """
    value = units.quantity(text, f"{what}: scale")
    rate = {"accel": "m/s^2", "gyro": "rad/s"}[sensor]
    ureg = units.registry()
    for unit_text, increment in ((f"count/({rate})", False), (f"count/({rate})/s", True)):
        if value.is_compatible_with(ureg.Unit(unit_text)):
            counts = float(value.to(ureg.Unit(unit_text)).magnitude)
            if 1e-100 < abs(counts) < 1e100:
                return 1.0 / counts, increment
            raise InputError(f"{what}: scale {text!r} is no scale that a sensor has")
    good = {"accel": "16384 LSB/g or 10800 pulse/g/s", "gyro": "131 LSB/(deg/s) or 1.1866 pulse/arcsec"}[sensor]
    raise InputError(f"{what}: scale {text!r} is no count per input; write for example {good}")
