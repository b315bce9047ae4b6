"""Samples in the messages of PX4's raw topics: one in each, or all that the chip had collected (FIFO).

Source: PX4-Autopilot, ``msg/SensorAccel.msg``, ``msg/SensorGyro.msg``, ``msg/SensorAccelFifo.msg``, ``msg/SensorGyroFifo.msg``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...frames import Array
from ..join import GAP, Stream, Ticks
from .records import Record

TOPICS = {"sensor_accel": "accel", "sensor_gyro": "gyro", "sensor_accel_fifo": "accel", "sensor_gyro_fifo": "gyro"}
"""The raw topics and what they hold."""
_PLAIN = dict.fromkeys("xyz", ("f", 0))
_UNROLLED = dict.fromkeys("xyz", ("i", 1)) | {"dt": ("f", 0), "scale": ("f", 0), "samples": ("u", 0)}
_OPTIONAL = {
    "device_id": ("u", 0),
    "temperature": ("f", 0),
    "error_count": ("u", 0),
    "clip_counter": ("u", 1),
    "rotation": ("u", 0),
}
_ALONG = ("temperature", "error_count", "clip_x", "clip_y", "clip_z")
_END = 32766  # counts: PX4Gyroscope.cpp takes these, and those beyond, for the end of the range
_REMEMBERED = 64  # messages by which it is told how many samples they usually have
_EARLIEST = int(np.iinfo(np.int64).min)


class Samples:
    """The samples of one sensor, taken out of its messages in their order.

    Parameters
    ----------
    path : path
    topic : str
    dtype : dtype
        Fields of its messages.

    Attributes
    ----------
    topic : str
    along : tuple of str
        Names of the numbers that go along with each sample.
    clipped : int
        Messages so far in which the sensor had reached the end of its range.

    Raises
    ------
    InputError
        When the fields are not PX4's own, or those of a version that had corrected the samples.
    """

    def __init__(self, path: Path, topic: str, dtype: Any) -> None:
        names = dtype.names or ()
        if "x_raw" in names or "x_integral" in names:
            raise InputError(
                f"{path}: a log of PX4 1.10 or older, whose {topic} was corrected by the driver (parameters CAL_...) before it "
                "was logged; log with a later version"
            )
        self._path, self.topic, self._fifo, self.clipped = path, topic, topic.endswith("_fifo"), 0
        self._last: int | None = None  # time of the message before
        self._counts = np.empty(0, dtype=np.int64)  # samples in the messages before
        self._clock = "timestamp_sample" if "timestamp_sample" in names else "timestamp"
        known = {self._clock: ("u", 0)} | (_UNROLLED if self._fifo else _PLAIN)
        known |= {n: kind for n, kind in _OPTIONAL.items() if n in names}
        fits = all(n in names and (dtype[n].base.kind, dtype[n].ndim) == kind for n, kind in known.items())
        if not fits or dtype[self._clock].itemsize != 8 or len({dtype[a].shape for a in "xyz"}) > 1:
            raise InputError(f"{path}: {topic} has fields other than PX4's own: {dtype}")
        self._clips = "clip_counter" in names and dtype["clip_counter"].shape == (3,) and not self._fifo
        there = {"temperature", "error_count"} & {*names} if not self._fifo else set()
        self.along = tuple(n for n in _ALONG if n in there or (self._clips and n.startswith("clip")))

    @np.errstate(invalid="ignore", over="ignore")  # values that are no numbers are refused where rows are checked
    def __call__(self, records: Record) -> Stream:
        """Samples in the next messages, times in us since the autopilot was started."""
        time = records[self._clock].astype(np.int64)
        if self._fifo:
            return self._unrolled(time, records)
        values = np.stack([records[axis] for axis in "xyz"], axis=1, dtype=float)
        along = np.empty((records.size, len(self.along)))
        for i, name in enumerate(self.along):
            along[:, i] = (
                records["clip_counter"][:, "xyz".index(name[-1])] if name.startswith("clip") else records[name]
            )
        if self._clips:
            self.clipped += int(np.any(records["clip_counter"], axis=1).sum())
        return Stream(time, values, along)

    def _unrolled(self, time: Ticks, records: Record) -> Stream:
        """All that the chip had collected: evenly between the time of the message before, and its own of the last sample.

        A message tells the chip's own step too, but by that the samples of neighbours would overlap when one is read late. It
        is used where the message before is missing: where the time since then is longer than that of the samples by half a
        usual message or more.
        """
        count, step = records["samples"].astype(np.int64), records["dt"].astype(float)
        room = records["x"].shape[1]
        self._check(count, step, room, records)
        before = np.concatenate(
            ([max(int(time[0]) - 10**9, _EARLIEST) if self._last is None else self._last], time[:-1])
        )
        self._last = int(time[-1])
        self._counts = np.append(self._counts, count)
        usual = np.quantile(self._counts, 0.25, method="lower")  # a small message that is lost before a large one
        self._counts = self._counts[-_REMEMBERED:]
        late = (GAP - 1.0) * np.minimum(count, usual)
        whole = (time > before) & (time - before < (count + late) * step)
        step = np.where(whole, (time - before) / np.maximum(count, 1), step)
        behind = count[:, None] - 1 - np.arange(room)
        there = behind >= 0
        times = (time[:, None] - np.rint(behind * step[:, None]).astype(np.int64))[there]
        counts = np.stack([records[axis][there] for axis in "xyz"], axis=1, dtype=float)
        at_end = np.stack([np.any((np.abs(records[a].astype(int)) >= _END) & there, axis=1) for a in "xyz"])
        self.clipped += int(np.any(at_end, axis=0).sum())
        scale = np.repeat(records["scale"].astype(float), count)[:, None]
        return Stream(times, counts * scale, np.empty((times.size, 0)))

    def _check(self, count: Ticks, step: Array, room: int, records: Record) -> None:
        bad = (count > room) | ~((step > 0.0) & (step < 1e6))
        if np.any(bad):
            what = f"{count[bad][0]} samples in room for {room}, {step[bad][0]:g} us apart"
            raise InputError(f"{self._path}: {self.topic} has a message with {what}")
        if "rotation" in (records.dtype.names or ()) and np.any(records["rotation"]):
            raise InputError(
                f"{self._path}: samples in {self.topic} are not turned to the board's axes (rotation); log sensor_gyro"
            )
