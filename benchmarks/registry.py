"""The registry with 100 000 calibrations: what each command takes on SQLite. ``make bench`` prints the table after the others.

500 units, 200 calibrations of 20 parameters each, through the code that registers files, from the check of the JSON on. Whole
commands are wall-clock seconds of a fresh process, the best of several; calls are those of the library on an open registry.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from sagnac.limits import Limits
from sagnac.registry import open_registry
from sagnac.registry.candidates import Candidate, Reading
from sagnac.registry.entries import Parameter

UNITS, EACH = 500, 200
START = datetime(2015, 1, 1, tzinfo=UTC)
AXES = {"m/s^2": "accel.bias.{}", "rad/s": "gyro.bias.{}", "1": "accel.scale_error.{}", "1 ": "gyro.scale_error.{}"}
PAIRS = ("xy", "xz", "yx", "yz", "zx", "zy")
PARAMETERS = (
    *(Parameter(name.format(a), unit.strip()) for unit, name in AXES.items() for a in "xyz"),
    *(Parameter(f"accel.misalignment.{p}", "rad", "element") for p in PAIRS),
    *(Parameter(f"gyro.misalignment.{p}", "rad", "element") for p in PAIRS[:2]),
)
DOCUMENT = b"x" * 8000  # of a calibration of 20 parameters, with its covariance


def fleet():
    """Candidates in the order of their dates; each unit drifts."""
    rng = np.random.default_rng(1)
    drift, level = rng.normal(scale=1e-5, size=(2, UNITS, len(PARAMETERS)))
    for k in range(EACH):
        noise = rng.normal(scale=1e-6, size=drift.shape)
        for u, row in enumerate(level + drift * k / EACH + noise):
            content = f"{u} {k} ".encode() + DOCUMENT
            yield Candidate(
                file=f"{u}-{k}.json",
                content=content,
                sha256=hashlib.sha256(content).hexdigest(),
                model=f"LG-{u % 5}",
                serial=f"{u:04d}",
                created=START + timedelta(days=18 * k, seconds=u),
                method="table",
                misalignment="element",
                software="sagnac",
                readings=tuple(Reading(p, v, 1e-6) for p, v in zip(PARAMETERS, row.tolist(), strict=True)),
            )


def best(job, repeats):
    """Least wall-clock time."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        job()
        times.append(time.perf_counter() - start)
    return min(times)


def command(compiled, *arguments):
    """A whole command, in a process of its own; modules compiled beforehand, into a folder, as they are where it is installed."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    environment["PYTHONPYCACHEPREFIX"] = str(compiled)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    line = [sys.executable, "-c", "from sagnac.cli import main; main()", "registry", *arguments]
    return best(lambda: subprocess.run(line, check=True, stdout=subprocess.DEVNULL, env=environment), 5)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fleet.db"
        start = time.perf_counter()
        with open_registry(path, write=True) as registry:
            count = sum(one.new for one in registry.add(fleet()))
            spent = time.perf_counter() - start
            for model in range(5):
                registry.set_limits(Limits({"accel.bias.*": "10 ug", "*.scale_error.*": "50 ppm"}), model=f"LG-{model}")
        print(f"registry: {count} calibrations of {len(PARAMETERS)} parameters in {spent:.1f} s,", end=" ")
        print(f"{path.stat().st_size / 1e6:.0f} MB")
        with open_registry(path) as registry:
            unit, at = registry.unit("0042"), START + timedelta(days=2000)
            calls = {
                "list": registry.listing,
                "list --serial 0042": lambda: registry.states(registry.entries(unit)),
                "find --at 2020-06-30": lambda: registry.find(at),
                "trend 0042 (its history alone)": lambda: registry.history(unit),
                "trend --model LG-1 (its history alone)": lambda: registry.history(model="LG-1"),
            }
            rows = [(name, best(job, 5)) for name, job in calls.items()]
        print(f"\n| {'command':<40} | {'call [ms]':>9} | {'whole [ms]':>10} |\n|{'-' * 42}|{'-' * 10}:|{'-' * 11}:|")
        for name, call in rows:
            whole = command(path.with_name("compiled"), *name.partition(" (")[0].split(), "--registry", str(path))
            print(f"| {name:<40} | {call * 1e3:>9.1f} | {whole * 1e3:>10.0f} |")


if __name__ == "__main__":
    main()
