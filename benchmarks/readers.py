"""Reading a log of PX4: ours against pyulog, the reader that PX4 keeps. ``make bench`` prints the table after the others.

Both get the accelerometers and gyros out of the same file of 100 MB; ours checks every record and joins the two. CPU
seconds of this process, best of several, alternating.
"""

from __future__ import annotations

import struct
import tempfile
import time
from pathlib import Path

import numpy as np
from pyulog import ULog

from sagnac.formats import open_table

SIZE = 100_000_000
MESSAGE = [
    ("head", "S5"),
    ("timestamp", "<u8"),
    ("time", "<u8"),
    ("device", "<u4"),
    ("value", "<f4", 3),
    ("rest", "u1", 11),
]
OTHER = [("head", "S5"), ("timestamp", "<u8"), ("states", "<f4", 48)]
FIELDS = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;float temperature;uint32_t "
FIELDS += "error_count;uint8_t[3] clip_counter;"
AXES = tuple(f"{k}_{a} [{u}]" for k, u in (("accel", "m/s^2"), ("gyro", "rad/s")) for a in "xyz")


def record(letter, content):
    return struct.pack("<Hc", len(content), letter) + content


def write(path):
    """Accelerometers and gyros at 1 kHz, and an estimator's states at 250 Hz as logs have them."""
    head = b"ULog\x01\x12\x35\x01" + bytes(8)
    head += b"".join(record(b"F", f"{name}:{FIELDS}".encode()) for name in ("sensor_accel", "sensor_gyro"))
    head += record(b"F", b"estimator_states:uint64_t timestamp;float[48] states;")
    names = ("sensor_accel", "sensor_gyro", "estimator_states")
    head += b"".join(record(b"A", struct.pack("<BH", 0, i) + name.encode()) for i, name in enumerate(names))
    block = np.dtype([("accel", MESSAGE, 4), ("gyro", MESSAGE, 4), ("other", OTHER)])
    rows = np.zeros(SIZE // block.itemsize, block)
    clock = 1_000_000 + 1000 * np.arange(4 * rows.size).reshape(-1, 4)
    rng = np.random.default_rng(0)
    for i, name in enumerate(block.names):
        field = rows[name]
        field["head"] = struct.pack("<HcH", field.dtype.itemsize - 3, b"D", i)
        field["timestamp"] = clock if field.ndim == 2 else clock[:, 0]
        if field.ndim == 2:
            field["time"], field["device"] = clock, 1310988
            field["value"] = rng.normal(size=(*field.shape, 3))
    path.write_bytes(head + rows.tobytes())


def ours(path):
    batches = [
        np.column_stack([batch.column(name).to_numpy() for name in AXES]) for batch in open_table(path).read(AXES, [])
    ]
    return np.concatenate(batches)


def theirs(path):
    log = ULog(str(path), ["sensor_accel", "sensor_gyro"])
    data = [log.get_dataset(name).data[axis] for name in ("sensor_accel", "sensor_gyro") for axis in "xyz"]
    return np.column_stack([column.astype(float) for column in data])


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.ulg"
        write(path)
        best = [np.inf, np.inf]
        for _ in range(3):
            answers = []
            for i, job in enumerate((ours, theirs)):
                start = time.process_time()
                answers.append(job(path))
                best[i] = min(best[i], time.process_time() - start)
            assert np.array_equal(*answers)
        rows = len(answers[0])
    print(f"| {'reading':<52} | {'ours [ms]':>9} | {'baseline [ms]':>13} | {'ratio':>6} | {'baseline':<34} |")
    print(f"|{'-' * 54}|{'-' * 10}:|{'-' * 14}:|{'-' * 7}:|{'-' * 36}|")
    job = f"PX4 ULog of {SIZE / 1e6:.0f} MB, {rows} x 6 samples"
    print(
        f"| {job:<52} | {best[0] * 1e3:>9.1f} | {best[1] * 1e3:>13.1f} | {best[1] / best[0]:>6.1f} | {'pyulog':<34} |"
    )


if __name__ == "__main__":
    main()
