"""What a ULog file holds, told by its beginning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import InputError
from ..join import Ticks, rate
from ..table import Fault
from .definitions import Topic
from .records import Log, Record, walk
from .samples import TOPICS, Samples

HOW = (
    "to have all samples, put a file etc/logging/logger_topics.txt with the lines 'sensor_accel 0' and 'sensor_gyro 0' on the "
    "autopilot's card, or set the bits 8 and 9 (raw FIFO) of SDLOG_PROFILE"
)
"""How a user gets a log that can be read."""
_CORRECTED = ("sensor_combined", "vehicle_imu", "vehicle_acceleration", "vehicle_angular_velocity")
_BYTES = 1 << 24  # that are looked at
_SAMPLES = 1 << 17  # of each sensor whose times are kept


@dataclass
class Sensor:
    """What the beginning of the log tells of one sensor.

    Attributes
    ----------
    topic : Topic
    device : int
        PX4's number of the device, 0 when not told.
    samples : Samples
        Those read so far.
    pieces : list of ndarray of int64, us
        Their times.
    """

    topic: Topic
    device: int
    samples: Samples
    pieces: list[Ticks] = field(default_factory=list)

    @property
    def time(self) -> Ticks:
        """Times of its first samples, us."""
        return np.concatenate(self.pieces)

    def add(self, records: Record) -> None:
        """Take in messages, until there are enough."""
        if sum(piece.size for piece in self.pieces) < _SAMPLES:
            self.pieces.append(self.samples(records).time)


def survey(path: Path, select: str | None) -> dict[str, Sensor]:
    """The chosen sensors, ``accel`` and ``gyro`` as far as there are.

    The first 16 MB are read, and more only until both are found of one instance, or of the one that is asked for.

    Raises
    ------
    InputError
        When there are no raw topics, or several instances and none was chosen, or not the one that was.
    """
    found: dict[tuple[str, int], Sensor] = {}
    log = Log()
    try:
        for topic, records in walk(path, log, lambda name, _: name in TOPICS):
            key = topic.name, topic.instance
            if key not in found:
                device = int(records["device_id"][0]) if "device_id" in (topic.dtype.names or ()) else 0
                found[key] = Sensor(topic, device, Samples(path, topic.name, topic.dtype))
            found[key].add(records)
            if log.position > _BYTES and _enough(found, select, log.position):
                break
    except Fault:  # reading comes to it again, and hands out what lies before
        if not found:
            raise
    choices = _choices(found)
    if not choices:
        raise InputError(f"{path}: {_missing(log)}; {HOW}")
    return _chosen(path, choices, select)


def _choices(found: Mapping[tuple[str, int], Sensor]) -> dict[str, dict[str, Sensor]]:
    """What can be chosen: an instance, and apart from it the one with all that the chips had collected."""
    out: dict[str, dict[str, Sensor]] = {}
    for (name, instance), sensor in sorted(found.items(), key=lambda item: (item[0][1], item[0][0])):
        if sensor.pieces and sensor.time.size:
            choice = f"FIFO/{instance}" if name.endswith("_fifo") else str(instance)
            out.setdefault(choice, {})[TOPICS[name]] = sensor
    return out


def _enough(found: Mapping[tuple[str, int], Sensor], select: str | None, position: int) -> bool:
    mine = [sensors for name, sensors in _choices(found).items() if select in {None, name}]
    return any(len(sensors) == 2 for sensors in mine) or (
        bool(mine) and position > 4 * _BYTES
    )  # one may be all there is


def _chosen(path: Path, choices: Mapping[str, dict[str, Sensor]], select: str | None) -> dict[str, Sensor]:
    if select is None and len(choices) == 1:
        return next(iter(choices.values()))
    if select is not None and select in choices:
        return choices[select]
    listed = "; ".join(f"{name} ({_described(sensors)})" for name, sensors in choices.items())
    wrong = f"no {select!r} among the sensors in this log, which" if select is not None else "this log"
    raise InputError(f"{path}: {wrong} holds {listed}; choose one with --select {next(iter(choices))}")


def _described(sensors: Mapping[str, Sensor]) -> str:
    return ", ".join(f"{s.topic.name} {rate(s.time):.4g} Hz, device {s.device}" for _, s in sorted(sensors.items()))


def _missing(log: Log) -> str:
    """Why nothing can be read."""
    names = {topic.name for topic in log.topics.values()}
    corrected = [n for n in _CORRECTED if n in names]
    if corrected:
        return (
            f"no raw samples (sensor_accel, sensor_gyro); those in {', '.join(corrected)} are corrected with the calibration "
            "that was in use and averaged or filtered, so that no calibration can be made from them"
        )
    return f"no samples of sensor_accel or sensor_gyro in its {len(names)} topics"
