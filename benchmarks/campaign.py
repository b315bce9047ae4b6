"""What it costs to hand runs out: 10 000 norm calibrations in a bare loop, by processes here and by a dask cluster.

A run is that of the shipped norm scenario, of accelerometers at 8 Hz: it draws unit and rig, simulates the recording of
hours on the table in memory, and calibrates it. Bare loops are plain Python, warm, on as many cores at once, of some
hundred runs before and after each line; the others include the start of their workers, the pilot, Parquet and hashes,
and the closing of the results. CPU time is that of all processes together: it tells the
overhead on a machine that others use as well. The dask cluster is up before; what its workers load is ours. A dask worker
looks at its own stack a hundred times a second, unless told not to (``DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False``):
the last line. Workers keep the memory of a run's arrays for the next run, which a plain loop does not: the first ratio may be
below 1. The second is that to loops that keep it as well.
"""

from __future__ import annotations

import hashlib
import logging
import os
import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import psutil

from sagnac.campaign import spec
from sagnac.campaign.engine import run
from sagnac.campaign.store import Store
from sagnac.campaign.tasks import prepare
from sagnac.campaign.work import keep_memory

RUNS = 10_000
BARE = 400  # runs of a bare loop
CAMPAIGN = {"scenario": "norm", "set": {"recording.sensors": "accel", "recording.frequency": "8 Hz"}}


@cache
def norm(runs):
    """The task of the campaign, made once in a process."""
    return prepare(spec.from_table({**CAMPAIGN, "runs": runs}))


def spent():
    """CPU seconds of this process, of those that it has had and of those that it has."""
    ours = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    alive = [child.cpu_times() for child in psutil.Process().children(recursive=True)]
    return sum(use.ru_utime + use.ru_stime for use in ours) + sum(use.user + use.system for use in alive)


def timed(job):
    wall, cpu = time.perf_counter(), spent()
    answer = job()
    return time.perf_counter() - wall, spent() - cpu, answer


def loop(runs, keep):
    """CPU seconds of a bare loop, warm, in a process of its own."""
    task = norm(RUNS)
    if keep:
        keep_memory()
    for i in range(5):
        task.row(i)
    start = time.process_time()
    for i in range(runs):
        task.row(i)
    return time.process_time() - start


def bare(runs, cores):
    """CPU seconds a run of bare loops on so many cores at once, plain ones and others that keep their memory."""
    answer = []
    for keep in (False, True):
        with ProcessPoolExecutor(cores, mp_context=get_context("spawn")) as pool:
            total = sum(pool.map(loop, [runs // cores] * cores, [keep] * cores))
        answer.append(total / (runs // cores * cores))
    return np.array(answer)


def local(task, runs, workers):
    return engine(task, runs, workers=workers)


def cluster(task, runs, workers, *, profiler=True):
    import dask
    from distributed import LocalCluster

    os.environ["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    told = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    with dask.config.set({"distributed.worker.profile.enabled": profiler}), LocalCluster(**told) as made:
        return engine(task, runs, scheduler=made.scheduler_address)


def engine(task, runs, **how):
    """Time on the wall and of all processors, and the hash of the results: they are the same whoever made them."""
    return timed(lambda: results(task, runs, **how))


def results(task, runs, **how):
    with tempfile.TemporaryDirectory() as folder:
        with Store(folder, {"task": "benchmark"}, runs, task.columns) as store:
            run(task, store, **how)
        return hashlib.sha256(Path(folder, "results.parquet").read_bytes()).hexdigest()


def main(runs: int = RUNS) -> None:
    task = norm(RUNS)
    jobs = [
        ("local, 1 worker", local, 1),
        ("local, 2 workers", local, 2),
        ("dask, 1 worker", cluster, 1),
        ("dask, 2 workers", cluster, 2),
        ("the same, not profiled", partial(cluster, profiler=False), 2),
    ]
    heads = {"runs/s": 7, "CPU [ms/run]": 12, "bare [ms/run]": 14, "ratio": 5, "to one with memory": 18}
    print(f"| {f'{runs} norm calibrations':<24} | {' | '.join(f'{h:>{w}}' for h, w in heads.items())} |")
    print(f"|{'-' * 26}|{'|'.join('-' * (w + 1) + ':' for w in heads.values())}|")
    answers = set()
    for name, who, workers in jobs:
        some = min(runs // 2, BARE)
        before = bare(some, workers)
        wall, cpu, answer = who(task, runs, workers)
        base = 0.5 * (before + bare(some, workers))  # others may use the machine too
        answers.add(answer)
        cpu /= runs
        plain, kept = cpu / base
        print(
            f"| {name:<24} | {runs / wall:>7.0f} | {cpu * 1e3:>12.3f} | {base[0] * 1e3:>14.3f} | {plain:>5.3f} | {kept:>18.3f} |",
            flush=True,
        )
    assert len(answers) == 1  # bit for bit


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
