"""Allan variances of 1e7 samples at 92 averaging times: ours against allantools, in time and in memory.

``make bench`` prints the tables after the others. Wall-clock seconds, best of two, alternating: ours uses every processor,
allantools one; processor seconds stand in the second table. Memory is the peak of a child process over what it had before
the call, with the samples already there.

The last two rows are a whole noise test of a Parquet file of six axes: ``sagnac.noise.study``, with disturbances looked
for, terms, uncertainties and a digest of the file, and what there is otherwise: PyArrow, ``allantools.oadev`` at octaves
and ``scipy.signal.welch``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import allantools
import numpy as np
import pyarrow as pa
from pyarrow import parquet
from scipy.signal import welch

from sagnac.noise.curves.allan import Pyramid, octaves, variances
from sagnac.noise.curves.spectrum import SpectrumPass
from sagnac.noise.study import study
from sagnac.recording import open_recording

SAMPLES = 10_000_000
LONG = 100_000_000
INTERVAL = 0.01
RATE = 1000.0  # Hz, of the whole test
COLUMNS = tuple(f"accel_{k} [m/s^2]" for k in "xyz") + tuple(f"gyro_{k} [rad/s]" for k in "xyz")
FACTORS = np.unique(np.round(np.geomspace(1, SAMPLES // 5, 99)).astype(int))
PEERS = {"allan": "oadev", "modified": "mdev", "hadamard": "ohdev"}


def samples(count=SAMPLES):
    return np.random.default_rng(0).normal(size=count) + 9.8


def ours(values, kind="allan"):
    return variances(values, INTERVAL, FACTORS, kind).deviation[:, 0]


def theirs(values, kind="allan"):
    peer = getattr(allantools, PEERS[kind])
    return peer(values, rate=1.0 / INTERVAL, data_type="freq", taus=FACTORS * INTERVAL)[1]


def peak():
    """Most memory that this process has had, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))


def settle():
    """Forget the peak so far."""
    Path("/proc/self/clear_refs").write_text("5")


def stream(count, axes, kind="allan"):
    """The pyramid over a long record; the same batch again and again, so that making samples costs nothing."""
    batch = np.random.default_rng(0).normal(size=(1 << 18, axes)) + 9.8
    running = Pyramid(INTERVAL, axes, kind)
    for start in range(0, count, len(batch)):
        running.add(batch[: count - start])
    return running.result()


def densities(count, axes):
    batch = np.random.default_rng(0).normal(size=(1 << 18, axes)) + 9.8
    running = SpectrumPass(INTERVAL, axes)
    for start in range(0, count, len(batch)):
        running.add(batch[: count - start])
    return running.result()


def write_log(path, count):
    """Six axes of white noise and random walk at 1 kHz."""
    rng = np.random.default_rng(0)
    with parquet.ParquetWriter(path, pa.schema([(name, pa.float64()) for name in ("time [s]", *COLUMNS)])) as out:
        walk = np.zeros(len(COLUMNS))
        for start in range(0, count, 1 << 20):
            size = min(1 << 20, count - start)
            slow = walk + 1e-5 * rng.normal(size=(size, len(COLUMNS))).cumsum(axis=0)
            walk = slow[-1]
            values = 1e-3 * (rng.normal(size=slow.shape) + slow)
            times = (start + np.arange(size)) / RATE
            out.write_table(pa.table([times, *values.T], schema=out.schema))


def whole_test(path):
    return study(open_recording(path))


def without_us(path):
    table = parquet.read_table(path)
    for name in COLUMNS:
        column = table[name].to_numpy()
        allantools.oadev(column, rate=RATE, data_type="freq", taus=octaves(column.size) / RATE)
        welch(column, RATE, nperseg=1 << 14)


def child(job, path=None):
    """Time, processor time and memory of one job in this process; samples in an array are made before and not counted."""
    ours(samples(3 * int(FACTORS[-1])))  # what is compiled or loaded once
    stream(200_000, 2)
    densities(200_000, 2)
    jobs = {
        "ours": ours,
        "theirs": theirs,
        "pyramid 1": lambda _: stream(LONG, 1),
        "pyramid 6": lambda _: stream(LONG, 6),
        "spectrum 6": lambda _: densities(LONG // 10, 6),
        "test": lambda _: whole_test(path),
        "no test": lambda _: without_us(path),
    }
    if job == "test":
        with tempfile.TemporaryDirectory() as folder:
            small = Path(folder) / "small.parquet"
            write_log(small, 200_000)
            whole_test(small)
    held = samples() if job in ("ours", "theirs") else None
    settle()
    before = peak()
    wall, cpu = time.perf_counter(), time.process_time()
    jobs[job](held)
    print(time.perf_counter() - wall, time.process_time() - cpu, peak() - before)


def measured(job, *more):
    run = subprocess.run([sys.executable, __file__, job, *more], check=True, capture_output=True, text=True)
    return [float(word) for word in run.stdout.split()]


def main() -> None:
    values = samples()
    print(f"Allan variances: {SAMPLES:.0e} samples, {FACTORS.size} averaging times, {os.cpu_count()} processors")
    print(f"| {'kind':<10} | {'ours [s]':>8} | {'allantools [s]':>14} | {'ratio':>6} | {'farthest apart':>14} |")
    print(f"|{'-' * 12}|{'-' * 9}:|{'-' * 15}:|{'-' * 7}:|{'-' * 15}:|")
    for kind in PEERS:
        best, answers = [np.inf, np.inf], [ours(values, kind), None]
        for _ in range(2):
            for i, job in enumerate((ours, theirs)):
                start = time.perf_counter()
                answers[i] = job(values, kind)
                best[i] = min(best[i], time.perf_counter() - start)
        apart = float(np.abs(answers[0] / answers[1] - 1.0).max())
        assert apart < 1e-9
        print(f"| {kind:<10} | {best[0]:>8.2f} | {best[1]:>14.1f} | {best[1] / best[0]:>6.0f} | {apart:>14.0e} |")
    print()
    print(f"| {'job':<48} | {'wall [s]':>8} | {'processors [s]':>14} | {'memory [MB]':>11} |")
    print(f"|{'-' * 50}|{'-' * 9}:|{'-' * 15}:|{'-' * 12}:|")
    names = {
        "ours": f"exact, {SAMPLES:.0e} samples",
        "theirs": f"allantools, {SAMPLES:.0e} samples",
        "pyramid 1": f"pyramid, {LONG:.0e} samples",
        "pyramid 6": f"pyramid, {LONG:.0e} x 6 samples",
        "spectrum 6": f"power spectral density, {LONG // 10:.0e} x 6 samples",
    }
    memory = {}
    for job, name in names.items():
        wall, cpu, memory[job] = measured(job)
        print(f"| {name:<48} | {wall:>8.2f} | {cpu:>14.2f} | {memory[job] / 1e6:>11.1f} |")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "still.parquet"
        write_log(path, SAMPLES)
        for job, name in {
            "test": f"whole noise test, {SAMPLES:.0e} x 6 samples",
            "no test": "PyArrow, allantools at octaves, SciPy's welch",
        }.items():
            wall, cpu, used = measured(job, str(path))
            print(f"| {name:<48} | {wall:>8.2f} | {cpu:>14.2f} | {used / 1e6:>11.1f} |")
    print(f"memory of ours over that of allantools: {memory['ours'] / memory['theirs']:.2f}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        child(*sys.argv[1:])
    else:
        main()
