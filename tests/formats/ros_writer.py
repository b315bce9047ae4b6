"""Bags for the tests, written by rosbags, and what it reads from them: an implementation that shares nothing with ours."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from zlib import crc32

import lz4.frame
import numpy as np
import pyarrow as pa
from rosbags import rosbag1, rosbag2
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

START = 1_795_339_800_123_456_789
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
KINDS = ("bag", "bag-bz2", "bag-lz4", "db3", "db3-message", "mcap", "mcap-zstd", "mcap-message")


@dataclass(frozen=True)
class Log:
    """What a bag holds on one topic."""

    topic: str
    stamp: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    received: np.ndarray
    frame: str = "imu_link"
    gyro_covariance: float = 0.5
    accel_covariance: float = 0.5


def log(count=500, topic="/imu", seed=1, rate=200, **more):
    """Random samples, each received a little after its stamp."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(-20_000, 20_000, count) + np.arange(count) * (10**9 // rate)
    stamp = START + steps - steps[:1] if count else np.empty(0, dtype=np.int64)
    received = stamp + 1_000_000
    return Log(topic, stamp, rng.normal(size=(count, 3)), rng.normal(size=(count, 3)), received, **more)


def _imu(store, entry, i, sequence):
    types = store.types
    stamp = int(entry.stamp[i])
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    head = (i, time, entry.frame) if sequence else (time, entry.frame)
    vector = types["geometry_msgs/msg/Vector3"]
    covariance = [np.arange(9.0) for _ in range(3)]
    covariance[1][0], covariance[2][0] = entry.gyro_covariance, entry.accel_covariance
    return types["sensor_msgs/msg/Imu"](
        types["std_msgs/msg/Header"](*head),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8),
        covariance[0],
        vector(*entry.gyro[i].tolist()),
        covariance[1],
        vector(*entry.accel[i].tolist()),
        covariance[2],
    )


def messages(logs, sequence, little_endian=True):
    """(log, receive time, message) of several logs and of a topic of texts, in the order of their receive times."""
    rows = [(int(entry.received[i]), k, i) for k, entry in enumerate(logs) for i in range(entry.stamp.size)]
    for received, k, i in sorted(rows):
        yield k, received, serialized(logs[k], i, sequence, little_endian)


def serialized(entry, i, sequence=False, little_endian=True):
    """A sample as ROS 1 (with a sequence number) or ROS 2 serialises it."""
    store, kind = ROS1 if sequence else ROS2, "sensor_msgs/msg/Imu"
    message = _imu(store, entry, i, sequence)
    if sequence:
        return bytes(store.serialize_ros1(message, kind))
    return bytes(store.serialize_cdr(message, kind, little_endian=little_endian))


def _text(store, sequence, number):
    message = store.types["std_msgs/msg/String"](f"chatter {number} " * (1 + number % 7))
    return bytes((store.serialize_ros1 if sequence else store.serialize_cdr)(message, "std_msgs/msg/String"))


def write(path, logs, kind="bag", *, chunk=20_000, little_endian=True, text=True):
    """Write a bag at a path without suffix; returns the file that holds the samples."""
    ros1 = kind.startswith("bag")
    path = path.with_suffix(".bag") if ros1 else path
    store = ROS1 if ros1 else ROS2
    writer = _ros1(path, kind, chunk) if ros1 else _ros2(path, kind)
    with writer:
        connections = [writer.add_connection(e.topic, "sensor_msgs/msg/Imu", typestore=store) for e in logs]
        texts = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store) if text else None
        for number, (k, received, raw) in enumerate(messages(logs, ros1, little_endian)):
            writer.write(connections[k], received, raw)
            if kind.startswith("mcap") and number % (chunk // 350) == 9:
                writer.storage.close_chunk()
            if texts and number % 3 == 0:
                writer.write(texts, received, _text(store, ros1, number))
    return path if ros1 else next(p for p in path.iterdir() if p.suffix in (".db3", ".mcap"))


def _ros1(path, kind, chunk):
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = chunk
    compression = {"bag-bz2": writer.CompressionFormat.BZ2, "bag-lz4": writer.CompressionFormat.LZ4}.get(kind)
    if compression:
        writer.set_compression(compression)
    return writer


def _ros2(path, kind):
    plugin = StoragePlugin.MCAP if kind.startswith("mcap") else StoragePlugin.SQLITE3
    writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    if kind.endswith("message"):
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    elif kind == "mcap-zstd":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    return writer


def peer(path, topic):
    """Stamps [ns], gyro and accelerometer samples as rosbags reads them."""
    stamp, gyro, accel = [], [], []
    with AnyReader([path]) as reader:
        wanted = [c for c in reader.connections if c.topic == topic]
        for connection, _, raw in reader.messages(wanted):
            message = reader.deserialize(raw, connection.msgtype)
            stamp.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            w, a = message.angular_velocity, message.linear_acceleration
            gyro.append((w.x, w.y, w.z))
            accel.append((a.x, a.y, a.z))
    return np.array(stamp), np.array(gyro), np.array(accel)


# ------------------------------------------------------------------------------------ MCAP, from mcap.dev/spec


def _record(op, content):
    return struct.pack("<BQ", op, len(content)) + content


def _mcap_text(text):
    return struct.pack("<I", len(text)) + text.encode()


def mcap_message(channel, received, raw):
    return _record(5, struct.pack("<HIQQ", channel, 0, received, received) + raw)


def mcap_file(bodies, codec="", crc=True, summary=True, definitions=None, data_crc=False):
    """MCAP file of chunks, each the records given; ``codec=None`` leaves them outside chunks."""
    definitions = mcap_channel() if definitions is None else definitions
    out = b"\x89MCAP0\r\n" + _record(1, _mcap_text("ros2") + _mcap_text("test"))
    for i, body in enumerate(bodies):
        records = (definitions if i == 0 else b"") + body
        if codec is None:
            out += records
            continue
        packed = {"": bytes, "lz4": lz4.frame.compress, "zstd": lambda raw: pa.compress(raw, "zstd", asbytes=True)}[
            codec
        ](records)
        head = struct.pack("<QQQI", 0, 0, len(records), crc32(records) if crc else 0) + _mcap_text(codec)
        out += _record(6, head + struct.pack("<Q", len(packed)) + packed)
        out += _record(7, bytes(6))
    out += _record(9, bytes(200_000)) if codec is None else b""  # an attachment, larger than what is read at once
    out += _record(15, struct.pack("<I", crc32(out) if data_crc else 0))
    begin = len(out)
    if summary:
        out += definitions + _record(11, struct.pack("<QHIIIIQQI", 0, 1, 1, 0, 0, 0, 0, 0, 0))
    footer = struct.pack("<BQQQ", 2, 20, begin if summary else 0, 0)
    return out + footer + struct.pack("<I", crc32(out[begin:] + footer) if summary else 0) + b"\x89MCAP0\r\n"


def mcap_channel(number=1, topic="/imu", kind="sensor_msgs/msg/Imu", encoding="cdr"):
    schema = struct.pack("<H", 7) + _mcap_text(kind) + _mcap_text("ros2msg") + _mcap_text("")
    return _record(3, schema) + _record(
        4, struct.pack("<HH", number, 7) + _mcap_text(topic) + _mcap_text(encoding) + bytes(4)
    )


# ------------------------------------------------------------------- ROS 1, from wiki.ros.org/Bags/Format/2.0


def ros1_record(data, **fields):
    """Record with the fields in the order given; integers become one byte (op) or four."""
    head = b""
    for name, value in fields.items():
        raw = bytes([value]) if name == "op" else struct.pack("<I", value) if isinstance(value, int) else value
        field = name.encode() + b"=" + raw
        head += struct.pack("<I", len(field)) + field
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def ros1_connection(number, topic="/imu", kind="sensor_msgs/Imu"):
    inside = b"".join(
        struct.pack("<I", len(f)) + f for f in (b"topic=" + topic.encode(), b"type=" + kind.encode(), b"md5sum=x")
    )
    return ros1_record(inside, op=7, conn=number, topic=topic.encode())


def ros1_message(number, received, raw):
    return ros1_record(raw, time=struct.pack("<II", *divmod(received, 10**9)), conn=number, op=2)


def ros1_file(records):
    """Bag without index, its records outside chunks, the fields of its headers in another order than is usual."""
    begin = ros1_record(b" " * 4000, conn_count=0, chunk_count=0, index_pos=bytes(8), op=3)
    return b"#ROSBAG V2.0\n" + begin + records
