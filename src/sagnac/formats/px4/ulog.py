"""PX4 ULog: the raw topics of one instance, ``sensor_accel`` and ``sensor_gyro``, or with all that the chips had collected.

Units, axes and times: PX4-Autopilot, ``msg/SensorAccel.msg`` and ``msg/SensorGyro.msg``; that they are not corrected:
``src/lib/drivers/accelerometer/PX4Accelerometer.cpp`` (rotation of the driver and nominal scale, nothing else).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ...frames import Array
from ..join import Joiner, Stream, rate, remark, usual_step
from ..table import Fault, Table
from .records import Log, walk
from .samples import Samples
from .survey import HOW, Sensor, survey

_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}
_EPOCH = 10**14  # us: counted from 1970 and not from the autopilot's start
_SLOW = 50.0  # Hz


def open_table(path: Path, select: str | None = None) -> Table:
    """Open a ULog file.

    Parameters
    ----------
    path : path
    select : str, optional
        Instance (``multi_id``) of the sensors, ``0``, or ``FIFO/0`` for all that the chips had collected; needed where there
        are several.

    Raises
    ------
    InputError
        When the raw topics are not there, several instances are and none was chosen, or the file is none that can be read.
    """
    sensors = survey(path, select)
    remarks = _remarks(sensors)
    reader = _Reader(path, sensors)

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        import pyarrow as pa

        types = dict.fromkeys(numeric, pa.float64())
        for columns in reader.rows(remarks):
            names = [*numeric, *other]
            yield pa.RecordBatch.from_arrays([pa.array(columns[n], types.get(n)) for n in names], names=names)

    topic = next(iter(sensors.values())).topic
    choice = f"FIFO/{topic.instance}" if topic.name.endswith("_fifo") else str(topic.instance)
    size, origin = path.stat().st_size, reader.origin / 1e6
    return Table(path, reader.columns, read, remarks, lambda: reader.log.position, size, choice, origin=origin)


def _remarks(sensors: Mapping[str, Sensor]) -> list[str]:
    """What the beginning of the log tells; reading adds what only the whole of it does."""
    devices = {sensor.topic.name: sensor.device for sensor in sensors.values()}
    named = " and ".join(f"{name} (device {device})" for name, device in sorted(devices.items()))
    instance = next(iter(sensors.values())).topic.instance
    remarks = [f"instance {instance} of {named}; axes are those of the autopilot's board, x forward, y right, z down"]
    if len({device & 0xFFFF for device in devices.values()}) > 1:  # bus and address; the rest is the kind of sensor
        remarks.append(
            "accelerometers and gyros of this instance are different chips, or parts of one with addresses of their own"
        )
    slow = {f"{s.topic.name} {rate(s.time):.3g} Hz" for s in sensors.values() if rate(s.time) < _SLOW}
    if slow:
        remarks.append(f"the log holds few of the samples that the sensors gave: {', '.join(sorted(slow))}; {HOW}")
    if len(sensors) == 2:
        joined = remark(sensors["accel"].time, sensors["gyro"].time)
        remarks += [joined] if joined else []
    first = min(int(sensor.time[0]) for sensor in sensors.values())
    if first > _EPOCH:
        remarks.append(f"time counted from {datetime.fromtimestamp(first // 10**6, UTC):%Y-%m-%d %H:%M:%S} UTC")
    return remarks


class _Reader:
    """Rows of the chosen sensors, any number of times."""

    def __init__(self, path: Path, sensors: Mapping[str, Sensor]) -> None:
        self.path, self.sensors, self.log = path, dict(sorted(sensors.items())), Log()
        self.step = usual_step(sensors["accel"].time) if "accel" in sensors else 0.0
        first = min(int(sensor.time[0]) for sensor in sensors.values())
        self.origin = first if first > _EPOCH else 0
        self.along = {kind: sensor.samples.along for kind, sensor in self.sensors.items()}
        self.warm = "gyro" if "temperature" in self.along.get("gyro", ()) else "accel"
        axes = [f"{kind}_{axis} [{_UNITS[kind]}]" for kind in self.sensors for axis in "xyz"]
        self.columns = ("time [s]", *axes, *(self._label(k, name) for k in self.sensors for name in self.along[k]))

    def _label(self, kind: str, name: str) -> str:
        if name != "temperature":
            return f"{kind}_{name}"
        return "temperature [degC]" if kind == self.warm else f"{kind}_temperature [degC]"

    def rows(self, remarks: list[str]) -> Iterator[dict[str, Array]]:
        """Columns under their header texts, many rows at a time; at the end `remarks` grows."""
        self.log = Log()
        joiner = Joiner(str(self.path), self.step, len(self.along.get("accel", ())))
        mine = {s.topic: (kind, Samples(self.path, s.topic.name, s.topic.dtype)) for kind, s in self.sensors.items()}
        wanted = {(topic.name, topic.instance) for topic in mine}
        try:
            for topic, records in walk(self.path, self.log, lambda *key: key in wanted):
                kind, samples = mine[topic]
                stream = samples(records)
                both = joiner.add(*((stream, None) if kind == "accel" else (None, stream))) if len(mine) == 2 else ()
                found = dict(zip(("accel", "gyro"), both, strict=True)) if both else {kind: stream}
                if found[kind].time.size:
                    yield self._columns(found)
        except Fault:
            self._report(joiner, [samples for _, samples in mine.values()], remarks)
            raise
        self._report(joiner, [samples for _, samples in mine.values()], remarks)

    def _columns(self, found: Mapping[str, Stream]) -> dict[str, Array]:
        out = {"time [s]": (next(iter(found.values())).time - self.origin) / 1e6}
        for kind, stream in found.items():
            out |= {f"{kind}_{axis} [{_UNITS[kind]}]": stream.values[:, i] for i, axis in enumerate("xyz")}
            for i, name in enumerate(self.along[kind]):
                values = stream.other[:, i]
                out[self._label(kind, name)] = values if name == "temperature" else values.astype(np.int64)
        return out

    def _report(self, joiner: Joiner, samples: Sequence[Samples], remarks: list[str]) -> None:
        joiner.finish()
        told = []
        if self.log.dropouts:
            total = sum(self.log.dropouts) / 1e3
            told.append(f"the logger lost data {len(self.log.dropouts)} times, {total:.3g} s in all (dropouts)")
        told += [
            f"{s.topic}: the sensor reached the end of its range (messages: {s.clipped})" for s in samples if s.clipped
        ]
        if joiner.lost:
            told.append(f"gyro samples left out for lack of accelerometers near enough before and after: {joiner.lost}")
        remarks += [text for text in told if text not in remarks]
