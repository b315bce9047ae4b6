"""Messages of the type ``sensor_msgs/Imu``, as ROS 1 and CDR serialise them.

The message is a header (stamp, name of the frame), then 37 doubles: orientation (4) and its covariance (9), angular velocity
[rad/s] (3) and its covariance (9), linear acceleration [m/s^2] (3) and its covariance (9). REP 145: the acceleration is the
specific force, +g up at rest. A sensor without estimate has -1 (the message's definition) or NaN (REP 145) as the first
element of its covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from .bag import Channel, Messages

TYPES = ("sensor_msgs/Imu", "sensor_msgs/msg/Imu")
MESSAGE = 1 << 12  # bytes that a message may have: all but the name of the frame are at most 328
_DOUBLES = 37
_GYRO, _GYRO_COVARIANCE, _ACCEL, _ACCEL_COVARIANCE = 13, 16, 25, 28  # places among the doubles
_ZSTD = b"\x28\xb5\x2f\xfd"  # how a zstd frame begins; CDR begins with 0
SENSORS = {"accel": ("m/s^2", _ACCEL, _ACCEL_COVARIANCE), "gyro": ("rad/s", _GYRO, _GYRO_COVARIANCE)}
"""Unit, place of the three values and place of their covariance among the doubles."""


@dataclass(frozen=True)
class Samples:
    """Decoded messages.

    Attributes
    ----------
    stamp, received : ndarray of int64, shape (n,), ns
    values : dict
        Sensor -> samples, shape (n, 3), NaN where it has no estimate.
    end : int
        Bytes of the file that have been read with them.
    frame : str
        Name of the frame of the first.
    """

    stamp: NDArray[np.int64]
    received: NDArray[np.int64]
    values: dict[str, Array]
    end: int
    frame: str


def of_imu(topic: str) -> Callable[[Channel], bool]:
    """Whether a channel carries the topic's Imu messages."""
    return lambda channel: channel.topic == topic and channel.type in TYPES


def samples_of(messages: Messages) -> Iterator[Samples]:
    """Decoded messages before the first that is none."""
    decode = {"ros1": _ros1, "cdr": _cdr}.get(messages.encoding)
    if decode is None:
        raise messages.fault(
            0, f"messages in the encoding {messages.encoding!r}, which is not read here (ros1 and cdr are)"
        )
    messages = _unpacked(messages)
    sound, stamp, doubles = decode(messages)
    count = sound.size if sound.all() else int(np.argmin(sound))
    if count:
        values = {}
        for sensor, (_, place, covariance) in SENSORS.items():
            values[sensor] = doubles[:count, place - _GYRO : place - _GYRO + 3].astype(float)
            told = doubles[:count, covariance - _GYRO]
            values[sensor][(told == -1) | np.isnan(told)] = np.nan
        yield Samples(stamp[:count], messages.received[:count], values, messages.end, _frame(messages))
    if count < sound.size:
        size = messages.last[count] - messages.first[count]
        raise messages.fault(count, f"a message of {size} bytes that is no {TYPES[0]}")


def _frame(messages: Messages) -> str:
    """Name of the frame of the first message: with its zero and what fills it up to 8 bytes it stands before the doubles."""
    name = messages.data[messages.first[0] + 16 : messages.last[0] - 8 * _DOUBLES].tobytes()
    return name.split(b"\0")[0].decode("utf-8", "replace")


def _unpacked(messages: Messages) -> Messages:
    """The same messages when ROS 2 compressed each of them by itself; what cannot be decompressed is left empty."""
    begin = int(messages.first[0])
    if messages.data[begin : begin + len(_ZSTD)].tobytes() != _ZSTD:
        return messages
    import pyarrow as pa

    pieces = []
    for first, last in zip(messages.first.tolist(), messages.last.tolist(), strict=True):
        try:
            stream = pa.CompressedInputStream(pa.BufferReader(messages.data[first:last].tobytes()), "zstd")
            pieces.append(stream.read(MESSAGE))
        except OSError:
            pieces.append(b"")
    ends = np.cumsum([len(piece) for piece in pieces])
    begins = np.concatenate([[0], ends[:-1]])
    return replace(messages, data=np.frombuffer(b"".join(pieces), dtype=np.uint8), first=begins, last=ends)


def _ros1(messages: Messages) -> tuple[NDArray[np.bool_], NDArray[np.int64], Array]:
    """ROS 1 serialisation: sequence number, s, ns, length of the name, name, doubles; all little endian, no padding."""
    sound, head = _head(messages, 16)
    _, seconds, nanoseconds, name = head.view("<u4").astype(np.int64).T
    sound = sound & (nanoseconds < 10**9) & (messages.last - messages.first == 16 + name + 8 * _DOUBLES)
    return sound, seconds * 10**9 + nanoseconds, _doubles(messages, sound).view("<f8")


def _cdr(messages: Messages) -> tuple[NDArray[np.bool_], NDArray[np.int64], Array]:
    """CDR (OMG DDS-XTypes 7.4.3.4): byte order, then s, ns, length of the name with its zero, name, doubles on 8 bytes."""
    sound, head = _head(messages, 16)
    big = (head[:, 1] == 0)[:, None]
    fields = np.where(big, head.view(">u4"), head.view("<u4")).astype(np.int64)
    seconds, nanoseconds, name = fields[:, 1].astype(np.int32).astype(np.int64), fields[:, 2], fields[:, 3]
    size = 4 + (12 + name + 7) // 8 * 8 + 8 * _DOUBLES
    sound = sound & (head[:, 0] == 0) & (head[:, 1] < 2) & (nanoseconds < 10**9)
    sound = sound & (messages.last - messages.first == size)
    raw = _doubles(messages, sound)
    return sound, seconds * 10**9 + nanoseconds, np.where(big, raw.view(">f8"), raw.view("<f8"))


def _head(messages: Messages, size: int) -> tuple[NDArray[np.bool_], NDArray[np.uint8]]:
    """Whether each message is long enough for an Imu, and its first bytes."""
    sound = messages.last - messages.first >= size + 8 * _DOUBLES
    return sound, _cut(messages.data, np.where(sound, messages.first, -1), size)


def _doubles(messages: Messages, sound: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Bytes of the doubles from the angular velocity to the covariance of the acceleration, counted from the end."""
    at = messages.last - 8 * (_DOUBLES - _GYRO)
    return _cut(messages.data, np.where(sound, at, -1), 8 * (_ACCEL_COVARIANCE + 1 - _GYRO))


def _cut(data: NDArray[np.uint8], at: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Rows of `size` bytes from each place, zeros for a negative one."""
    out = np.zeros((at.size, size), dtype=np.uint8)
    if data.size >= size:
        windows = np.lib.stride_tricks.sliding_window_view(data, size)
        out[at >= 0] = windows[at[at >= 0]]
    return out
