"""Samples a second of the simulator, with and without writing them. ``make bench`` prints the table after the others.

Six axes on a turntable, moves and turning segments included, best of three. Both figures are of all threads: the time on the
wall, and the CPU time, which other work on the machine does not change much.
"""

from __future__ import annotations

import copy
import os
import tempfile
import time
import tomllib
from pathlib import Path

import numpy as np

from sagnac.simulate import writer
from sagnac.simulate.build import build
from sagnac.simulate.engine import stream
from sagnac.simulate.plans import table_plan
from sagnac.simulate.scenario import from_table, text
from sagnac.simulate.table import imperfect_table, simulate_recording
from sagnac.simulate.unit import laser_gyro_unit

SLOW = {
    "accel_instability": "3 ug",
    "gyro_instability": "0.001 deg/h",
    "accel_walk": "1 ug/sqrt(h)",
    "gyro_walk": "0.0001 deg/h/sqrt(h)",
}


def job(*, pulses: bool, slow: bool):
    """The published norm plan at 500 Hz: 4.1 million samples."""
    table = copy.deepcopy(tomllib.loads(text("norm")))
    table["recording"]["frequency"] = "500 Hz"
    if not pulses:
        table["unit"].pop("scale")
    if slow:
        table["unit"]["noise"] |= SLOW
    return build(from_table(table), 1).job


def timed(run, repeats=3):
    """Samples, and the least wall and CPU time of some runs."""
    best = [np.inf, np.inf]
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        count = run()
        best = [min(best[0], time.perf_counter() - wall), min(best[1], time.process_time() - cpu)]
    return count, best


def unwritten(given):
    return sum(piece.time.size for piece in stream(given))


def written(given, path, kind):
    columns = {c.name: c.worth != 0.0 for c in given.channels}
    count = 0
    with writer.writing(path, columns, (), kind) as write:
        for piece in stream(given):
            write(piece)
            count += piece.time.size
    return count


def plain():
    """The same recording at 50 Hz with plain NumPy, in memory."""
    unit = laser_gyro_unit()
    unit = type(unit)(**{**vars(unit), "pulses": {}})
    plan = table_plan(unit)
    rng = np.random.default_rng(0)
    return simulate_recording(unit, plan, imperfect_table(plan, rng), rng)[0].size


def rows():
    white, counted = job(pulses=False, slow=False), job(pulses=True, slow=False)
    yield "plain NumPy, white noise, in memory", timed(plain)
    yield "white noise", timed(lambda: unwritten(white))
    yield "white noise, pulses", timed(lambda: unwritten(counted))
    yield "white noise, bias instability, random walk", timed(lambda: unwritten(job(pulses=False, slow=True)))
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("parquet", "csv"):
            path = Path(folder, f"recording.{kind}")
            for name, given in (("white noise", white), ("white noise, pulses", counted)):
                count, best = timed(lambda given=given, path=path, kind=kind: written(given, path, kind), 2)
                yield f"{name}, written as {kind} ({path.stat().st_size / count:.0f} bytes a sample)", (count, best)


def main() -> None:
    print(
        f"| {f'simulated samples of six axes, {os.cpu_count()} processors':<66} | {'million/s':>9} | {'CPU [ns/sample]':>15} |"
    )
    print(f"|{'-' * 68}|{'-' * 10}:|{'-' * 16}:|")
    for name, (count, (wall, cpu)) in rows():
        print(f"| {name:<66} | {count / wall / 1e6:>9.2f} | {cpu / count * 1e9:>15.0f} |")


if __name__ == "__main__":
    main()
