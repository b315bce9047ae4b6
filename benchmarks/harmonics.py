"""Harmonics of long records: our sums against ``np.sum`` of the same samples. ``make bench`` prints the table after the others.

Wall time, best of several, alternating: the sums run in two threads, and figures of a machine that is busy otherwise say
little. Ratios above one are in our favour. The yardstick is one sum over the samples, for which the memory sets the pace, and for
the search of a rate six passes for the harmonics. With little memory free, fewer samples are taken, and the heading says so.
"""

from __future__ import annotations

import os
import time

import numpy as np

import plain
from sagnac.observe.harmonics import harmonics_of, rate_of, segment_harmonics
from sagnac.plan import Plan, Rig, Segment
from sagnac.recording import from_arrays

SAMPLES = 100_000_000
INTERVAL = 1e-3
RATE = 3.0
ORDER = 3


def samples():
    """A wave of two harmonics with noise, in as much memory as is free."""
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    count = min(SAMPLES, free // (8 * 4))
    values = np.random.default_rng(0).standard_normal(count)
    for i in range(0, count, 1 << 20):
        angle = RATE * INTERVAL * np.arange(i, min(i + (1 << 20), count))
        values[i : i + (1 << 20)] += 9.8 + 50.0 * np.cos(angle) + 0.1 * np.sin(2 * angle)
    return values


def race(jobs, repeats):
    """Least wall time of each job, one after the other in turns, and their answers."""
    best, answers = [np.inf] * len(jobs), [None] * len(jobs)
    for _ in range(repeats):
        for i, job in enumerate(jobs):
            start = time.perf_counter()
            answers[i] = job()
            best[i] = min(best[i], time.perf_counter() - start)
    return best, answers


def in_memory(values):
    """Rows of the table: what was done, seconds, seconds of the baseline in the same race, and what that is."""
    triple = values[: len(values) // 3 * 3].reshape(-1, 3)
    rows = []
    for name, given, extended in (
        (f"DC and {ORDER} harmonics, with noise, (n,)", values, False),
        (f"DC and {ORDER} harmonics, (n/3, 3)", triple, False),
        (f"DC and {ORDER} harmonics, terms in tau too, (n,)", values, True),
    ):
        (ours, total), _ = race(
            [
                lambda given=given, extended=extended: harmonics_of(
                    given, INTERVAL, RATE, order=ORDER, extended=extended
                ),
                lambda: np.sum(values),
            ],
            15,
        )
        rows.append((name, ours, total, "np.sum"))
    (passing, found), (_, rate) = race(
        [
            lambda: harmonics_of(values, INTERVAL, RATE, order=ORDER),
            lambda: rate_of(values, INTERVAL, RATE * 1.005, order=ORDER),
        ],
        4,
    )
    assert abs(rate.rate - RATE) < 6 * rate.sigma
    rows.append((f"rate, off by 0.5 % at first, {ORDER} harmonics", found, 6 * passing, "six passes for harmonics"))
    part = values[: len(values) // 10]
    (ours, theirs), (a, b) = race(
        [
            lambda: harmonics_of(part, INTERVAL, RATE, order=ORDER).coefficient[0],
            lambda: plain.block_harmonics(part, INTERVAL, RATE, ORDER),
        ],
        4,
    )
    assert np.allclose(a, b, rtol=0, atol=1e-12 * np.abs(b).max())
    rows.append((f"DC and {ORDER} harmonics, n/10", ours, theirs, "matrix product over blocks"))
    return rows


def from_recording(values):
    """A recording with its time column, checked sample by sample, against the product of the whole design matrix."""
    count = min(len(values) // 3, 1_500_000)
    triple, clock = values[: 3 * count].reshape(-1, 3), np.arange(count) * INTERVAL
    segment = Segment(name="1", start=0.0, stop=count * INTERVAL, arm_rate=RATE, arm_phase=0.0)
    plan = Plan(rig=Rig(kind="centrifuge", radius=1.0), segment=(segment,))
    recording = from_arrays(clock, triple)
    (ours, theirs), (a, b) = race(
        [
            lambda: segment_harmonics(recording, plan, order=ORDER).coefficient[0],
            lambda: plain.harmonics(triple, RATE * clock, ORDER)[0],
        ],
        4,
    )
    assert np.allclose(a, b, rtol=0, atol=1e-11 * np.abs(b).max())
    return [(f"recording of {count:.2g} x 3, with all checks", ours, theirs, "lstsq of the design matrix")]


def main() -> None:
    values = samples()
    few = "" if len(values) == SAMPLES else " (not 1e8: no more memory is free)"
    print(f"Harmonics, n = {len(values):.3g} samples{few}, wall time on {os.cpu_count()} cores")
    print(f"| {'job':<48} | {'ours [ms]':>9} | {'baseline [ms]':>13} | {'ratio':>6} | {'baseline':<26} |")
    print(f"|{'-' * 50}|{'-' * 10}:|{'-' * 14}:|{'-' * 7}:|{'-' * 28}|")
    for name, ours, other, against in [*in_memory(values), *from_recording(values)]:
        print(f"| {name:<48} | {ours * 1e3:>9.1f} | {other * 1e3:>13.1f} | {other / ours:>6.2f} | {against:<26} |")


if __name__ == "__main__":
    main()
