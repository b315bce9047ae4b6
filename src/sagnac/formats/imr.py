"""Inertial Explorer's binary IMR: a header of 512 bytes, then records of a time and six scaled whole numbers.

Layout and scaling: NovAtel, Waypoint documentation, "IMR File",
https://docs.novatel.com/Waypoint/Content/Data_Formats/IMR_File.htm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .table import Fault, Table

_HEADER = 512
_ROWS = 1 << 17  # records read at a time
_FIELDS: tuple[tuple[str, str, int], ...] = (
    ("delta_theta", "i4", 17),
    ("delta_velocity", "i4", 21),
    ("rate", "f8", 25),
    ("gyro_scale", "f8", 33),
    ("accel_scale", "f8", 41),
    ("time_system", "i4", 49),
    ("time_bias", "f8", 57),
)
_AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
_COLUMNS = ("time [s]", *(f"{axis} [{'rad/s' if axis.startswith('gyro') else 'm/s^2'}]" for axis in _AXES))
_SYSTEMS = {0: "GPS", 1: "UTC", 2: "GPS"}


@dataclass(frozen=True)
class _Header:
    """What the header says of the records: their layout, factors to rad/s and m/s^2, and what the user should know."""

    record: np.dtype[Any]
    factors: tuple[float, ...]
    remarks: tuple[str, ...]


def open_table(path: Path) -> Table:
    """Open an IMR file: time in seconds of the week, angular rate and specific force in the axes of the unit.

    Raises
    ------
    InputError
        When the header holds no scale factor or rate that can be used. Fault where the file ends within the header or
        (while reading) within a record.
    """
    size = path.stat().st_size
    header = _header(path, size)
    seen = [0]

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        return _read(path, header, [*numeric, *other], seen)

    return Table(path, _COLUMNS, read, header.remarks, position=lambda: seen[0], size=size)


def _header(path: Path, size: int) -> _Header:
    with path.open("rb") as stream:
        head = stream.read(_HEADER)
    if len(head) < _HEADER:
        raise Fault(path, size, f"the file ends within the header, which has {_HEADER} bytes")
    if head[8] not in (0, 1):
        raise Fault(path, 8, f"the byte order is {head[8]}, neither 0 (little endian) nor 1 (big endian)")
    order = "<>"[head[8]]
    values = {name: np.frombuffer(head, order + kind, 1, at)[0].item() for name, kind, at in _FIELDS}
    _check(path, values)
    per_second = [values["rate"] if values[name] else 1.0 for name in ("delta_theta", "delta_velocity")]
    factors = (math.radians(values["gyro_scale"]) * per_second[0],) * 3 + (values["accel_scale"] * per_second[1],) * 3
    record = np.dtype([("time", order + "f8"), ("raw", order + "i4", 6)])
    return _Header(record, factors, _remarks(path, values, record))


def _check(path: Path, values: dict[str, float]) -> None:
    places = {name: at for name, _, at in _FIELDS}
    for name in ("delta_theta", "delta_velocity"):
        if values[name] not in (0, 1):
            raise Fault(path, places[name], f"the flag of increments is {values[name]}, neither 0 (rates) nor 1")
    needed = ["gyro_scale", "accel_scale", *(["rate"] if values["delta_theta"] or values["delta_velocity"] else [])]
    for name in needed:
        if not 1e-30 < abs(values[name]) < 1e30 or (name == "rate" and values[name] < 0):
            raise Fault(path, places[name], f"the header's {name.replace('_', ' ')} is {values[name]}")


def _remarks(path: Path, values: dict[str, float], record: np.dtype[Any]) -> tuple[str, ...]:
    system = _SYSTEMS.get(int(values["time_system"]), "GPS")
    said = [f"time in {system} seconds of the week"]
    summed = [n for n, f in (("angles", "delta_theta"), ("velocities", "delta_velocity")) if values[f]]
    if summed:
        said.append(
            f"the log holds increments of {' and '.join(summed)}: multiplied by the header's {values['rate']:g} Hz"
        )
        with path.open("rb") as stream:
            stream.seek(_HEADER)
            time = np.frombuffer(_whole(stream.read(1000 * record.itemsize), record), record)["time"]
        steps = np.diff(np.where(np.abs(time) < 1e9, time, np.nan))
        step = float(np.median(steps)) if steps.size else math.nan
        if step > 0 and abs(step * values["rate"] - 1) > 0.01:
            said.append(
                f"but its time tags are {1 / step:g} Hz: one of the two is wrong, and with the first every rate"
            )
    if math.isfinite(values["time_bias"]) and values["time_bias"]:
        said.append(f"the header's time tag bias of {values['time_bias']:g} s is not applied")
    return tuple(said)


def _whole(data: bytes, record: np.dtype[Any]) -> bytes:
    return data[: len(data) // record.itemsize * record.itemsize]


def _read(path: Path, header: _Header, wanted: Sequence[str], seen: list[int]) -> Iterator[Any]:
    import pyarrow as pa

    seen[0] = _HEADER
    with path.open("rb") as stream:
        stream.seek(_HEADER)
        while data := stream.read(_ROWS * header.record.itemsize):
            sound = _whole(data, header.record)
            records = np.frombuffer(sound, header.record)
            columns = [records["time"].astype(float)]
            columns += [records["raw"][:, i] * factor for i, factor in enumerate(header.factors)]
            by_name = dict(zip(_COLUMNS, columns, strict=True))
            seen[0] += len(sound)
            if records.size:
                yield pa.RecordBatch.from_arrays([pa.array(by_name[c]) for c in wanted], list(wanted))
            if len(sound) < len(data):
                raise Fault(
                    path, seen[0], f"the file ends within a record, of which {len(data) - len(sound)} bytes are there"
                )
