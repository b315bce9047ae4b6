"""ULog files from the words of the PX4 guide, "ULog File Format": every record written by hand."""

from __future__ import annotations

import struct

import numpy as np

MAGIC = b"ULog\x01\x12\x35"
SYNC = bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12])
ACCEL = (
    "sensor_accel:uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;float temperature;"
    "uint32_t error_count;uint8_t[3] clip_counter;uint8_t[5] _padding0;"
)
"""As PX4 1.14 logs it: fields by size, padding to eight bytes, which is not logged at the end."""
GYRO = ACCEL.replace("sensor_accel", "sensor_gyro").replace(
    "uint8_t[5] _padding0", "uint8_t samples;uint8_t[4] _padding0"
)


def fifo(kind, rotation=None):
    """Definition of the message with all that a chip had collected."""
    fields = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float dt;float scale;int16_t[32] x;int16_t[32] y;"
    return f"sensor_{kind}_fifo:{fields}int16_t[32] z;uint8_t samples;" + (
        "" if rotation is None else "uint8_t rotation;"
    )


NESTED = "imu_report:uint64_t timestamp;vector3 inner[2];uint8_t flag;".replace("vector3 inner[2]", "vector3[2] inner")
VECTOR = "vector3:float[3] v;uint8_t[4] _padding0;"
_ACCEL, _GYRO = struct.Struct("<QQIffffI3B"), struct.Struct("<QQIffffI3BB")


def record(letter, content):
    return struct.pack("<Hc", len(content), letter.encode()) + content


def header(flags=bytes(8), appended=(0, 0, 0)):
    """File header and the record of flags."""
    head = MAGIC + b"\x01" + struct.pack("<Q", 1_000_000)
    return head + record("B", bytes(8) + flags + struct.pack("<3Q", *appended))


def definition(text):
    return record("F", text.encode())


def info(key, value):
    return record("I", bytes([len(key)]) + key.encode() + value)


def parameter(name, value):
    return record("P", bytes([len(name) + 6]) + b"float " + name.encode() + struct.pack("<f", value))


def subscribe(number, name, instance=0):
    return record("A", struct.pack("<BH", instance, number) + name.encode())


def data(number, content):
    return record("D", struct.pack("<H", number) + content)


def accel(time, values, *, stamp=None, device=1310988, temperature=25.5, errors=0, clips=(0, 0, 0)):
    stamp = time + 250 if stamp is None else stamp
    return _ACCEL.pack(stamp, time, device, *values, temperature, errors, *clips)


def gyro(time, values, *, stamp=None, device=2490636, temperature=26.5, errors=0, clips=(0, 0, 0), samples=8):
    stamp = time + 300 if stamp is None else stamp
    return _GYRO.pack(stamp, time, device, *values, temperature, errors, *clips, samples)


def collected(time, step, scale, counts, rotation=None, count=None):
    """Message of all that a chip had collected: counts, shape (n, 3), the last one at `time`."""
    room = np.zeros((3, 32), dtype="<i2")
    room[:, : len(counts)] = counts.T
    head = struct.pack("<QQIff", time + 100, time, 1310988, step, scale)
    return (
        head
        + room.tobytes()
        + bytes([len(counts) if count is None else count])
        + bytes([] if rotation is None else [rotation])
    )


def definitions():
    """What stands at the beginning of a log."""
    return (
        definition(NESTED)
        + definition(VECTOR)
        + definition(ACCEL)
        + definition(GYRO)
        + info("char[3] sys_name", b"PX4")
        + parameter("CAL_ACC0_XOFF", 0.25)
    )


def log(accel_time, accel_values, gyro_time, gyro_values, *, instances=(0,), between=b"", **fields):
    """A whole log: the samples of all instances in the order of their times, other records among them.

    Instance i has the values given plus i.
    """
    out = [header(), definitions(), subscribe(5, "imu_report")]
    for i in instances:
        out += [subscribe(10 + i, "sensor_accel", i), subscribe(20 + i, "sensor_gyro", i)]
    rows = [(int(t), 1, v) for t, v in zip(gyro_time, gyro_values, strict=True)]
    rows += [(int(t), 0, v) for t, v in zip(accel_time, accel_values, strict=True)]
    for k, (time, kind, values) in enumerate(sorted(rows, key=lambda row: row[:2])):
        for i in instances:
            pack = gyro if kind else accel
            out.append(data((20 if kind else 10) + i, pack(time, np.float32(values) + np.float32(i), **fields)))
        if k % 7 == 3:
            out += [record("S", SYNC), data(5, struct.pack("<Q", time) + bytes(32) + b"\x01"), between]
        if k % 11 == 5:
            out.append(record("L", b"6" + struct.pack("<Q", time) + b"armed"))
    return b"".join(out)
