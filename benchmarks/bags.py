"""Reading of ROS bags: ours against rosbags, which decodes every message by itself. Run by hand with ``python bags.py 1000``
for bags of 1000 MB, otherwise small ones.

Both sides give stamps, angular rates and specific forces of all messages as arrays; that these are equal is asserted.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

from sagnac.formats import open_table

KINDS = ("bag", "bag-lz4", "bag-bz2", "db3", "mcap", "mcap-zstd")
MESSAGE = 370  # bytes of a message with what the file adds


def write(folder, kind, count):
    """A bag of Imu messages at 1 kHz, all but their stamps and samples equal."""
    ros1 = kind.startswith("bag")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    path = Path(folder, f"{kind}.bag" if ros1 else kind)
    if ros1:
        writer = rosbag1.Writer(path)
        if kind != "bag":
            writer.set_compression(writer.CompressionFormat[kind.removeprefix("bag-").upper()])
    else:
        plugin = StoragePlugin.SQLITE3 if kind == "db3" else StoragePlugin.MCAP
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if kind == "mcap-zstd":
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    rng = np.random.default_rng(1)
    begin = bytes(4) if ros1 else b"\0\1\0\0"  # a sequence number; CDR, little endian
    name = b"\x08\0\0\0imu_link" if ros1 else b"\x09\0\0\0imu_link\0\0\0\0"  # with its zero, on 8 bytes
    tail = np.zeros(37)
    with writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for i in range(count):
            if i % 1000 == 0:
                samples = rng.normal(size=(1000, 6))
            tail[13:16], tail[25:28] = samples[i % 1000, :3], samples[i % 1000, 3:]
            stamp = np.array([1_795_339_800 + i // 1000, i % 1000 * 1_000_000], dtype="<u4").tobytes()
            message = begin + stamp + name + tail.tobytes()
            writer.write(connection, 1_795_339_800_000_000_000 + i * 1_000_000, message)
    return path


def ours(path):
    table = open_table(path)
    pieces = [np.column_stack([c.to_numpy() for c in p.columns]) for p in table.read(table.columns, [])]
    return np.concatenate(pieces)


def baseline(path):
    rows = []
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            stamp, w, a = message.header.stamp, message.angular_velocity, message.linear_acceleration
            rows.append((stamp.sec, stamp.nanosec, a.x, a.y, a.z, w.x, w.y, w.z))
    values = np.array(rows)
    seconds = (values[:, 0] - values[0, 0]) + (values[:, 1] - values[0, 1]) / 1e9
    return np.column_stack([seconds, values[:, 2:]])


def rows(megabytes):
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            path = write(folder, kind, megabytes * 1_000_000 // MESSAGE)
            best, answers = [np.inf, np.inf], [None, None]
            for _ in range(3):
                for i, read in enumerate((ours, baseline)):
                    start = time.process_time()
                    answers[i] = read(path)
                    best[i] = min(best[i], time.process_time() - start)
            assert np.allclose(answers[0][:, 0], answers[1][:, 0], rtol=0, atol=1e-9)
            assert np.array_equal(answers[0][:, 1:], answers[1][:, 1:])
            yield kind, len(answers[0]), best


def alone(path):
    """What reading a large bag takes: messages, seconds on the wall, and MB of memory before and at most."""
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    table = open_table(path)
    count = sum(piece.num_rows for piece in table.read(table.columns, []))
    spent = time.perf_counter() - start
    return count, spent, before / 1024, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def large(megabytes):
    """Ours alone on large bags, each written and read in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as fresh:
                path = fresh.submit(write, folder, kind, megabytes * 1_000_000 // MESSAGE).result()
                count, spent, before, after = fresh.submit(alone, path).result()
            files = [path] if path.is_file() else list(path.iterdir())
            size = sum(file.stat().st_size for file in files) / 1e6
            print(
                f"{kind:<10} {size:>6.0f} MB, {count} messages: {spent:.2f} s, {after:.0f} MB of memory ({before:.0f} before)"
            )
            for file in files:
                file.unlink()


def main() -> None:
    print(f"| {'bags of Imu messages':<24} | {'ours [ms]':>9} | {'rosbags [ms]':>12} | {'ratio':>6} |")
    print(f"|{'-' * 26}|{'-' * 10}:|{'-' * 13}:|{'-' * 7}:|")
    for kind, count, best in rows(20):
        name = f"{kind}, {count} messages"
        print(f"| {name:<24} | {best[0] * 1e3:>9.1f} | {best[1] * 1e3:>12.1f} | {best[1] / best[0]:>6.1f} |")


if __name__ == "__main__":
    large(int(sys.argv[1])) if len(sys.argv) > 1 else main()
