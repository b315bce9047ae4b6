"""Many at once: a thousand trajectories, filters and whole transfer alignments against one after the other.

``make bench`` prints the table after the others. Wall time of all cores, best of several, alternating; figures are per
sample or per update of one trajectory or run, so that they compare. Ratios above one are in our favour.
"""

from __future__ import annotations

import itertools
import os
from concurrent.futures import ThreadPoolExecutor

import numba as nb
import numpy as np

import plain_lanes as plain
from harmonics import race
from sagnac.align import config as settings
from sagnac.align.filter import Filter, Reference
from sagnac.align.model import layout_of
from sagnac.align.monte_carlo import monte_carlo
from sagnac.align.monte_carlo.chain import Chain
from sagnac.earth import EARTH_RATE, ELLIPSOID
from sagnac.frames import attitude_matrix
from sagnac.kernels import lanes_filter, strapdown
from sagnac.kernels.lanes import LANES
from sagnac.navigate.many import Fleet, pack_many
from sagnac.navigate.state import State

RUNS, CORES = 1000, os.cpu_count() or 1
SAMPLES, UPDATES, MOTIONS, SECONDS = 2000, 9000, 300, 600.0
DT, DEG = 0.1, np.pi / 180.0
CONSTANTS = np.array([*ELLIPSOID, EARTH_RATE, 0.0])
NOISE = DT * np.array([6.7e-11, 6.7e-11, *[8.5e-14] * 3, *[0.0] * 6])
PRIOR = np.diag(np.array([0.2, 0.2, *[0.2 * DEG] * 2, 0.5 * DEG, 1e-9, *[4.8e-8] * 3, *[4.9e-4] * 2]) ** 2)


def fleet():
    """A thousand trajectories, each with samples of its own, and the kernel for one on all cores."""
    rng = np.random.default_rng(0)
    C = attitude_matrix(rng.uniform(0, 6, RUNS), rng.normal(0, 0.1, RUNS), rng.normal(0, 0.1, RUNS))
    states = [State.at(rng.uniform(-1, 1), 0.0, 10.0, rng.normal(0, 5, 3), c) for c in C]
    start = State(*(np.array([getattr(s, k) for s in states]) for k in ("C_b_w", "velocity", "C_e_w", "height")))
    turns, pushes = rng.normal(0, 1e-3, (SAMPLES, 3, RUNS)), rng.normal(0, 1e-2, (SAMPLES, 3, RUNS))
    pushes[:, 2] += 0.098
    steps, none = np.full(SAMPLES, 0.01), np.empty(0)
    turn, push = (np.ascontiguousarray(np.moveaxis(v, 2, 0)) for v in (turns, pushes))

    def ours():
        together = Fleet(start)
        together.advance(turns, pushes, steps)
        return together.states.velocity

    def baseline():
        numbers, pushed = pack_many(start), np.zeros((RUNS, 3))

        def some(first):
            for i in range(first, RUNS, CORES):
                strapdown.advance(numbers[i], turn[i], push[i], steps, 2, False, False, none, CONSTANTS, pushed[i])

        with ThreadPoolExecutor(CORES) as pool:
            list(pool.map(some, range(CORES)))
        return numbers[:, 4:7]

    (a, b), (x, y) = race([ours, baseline], 7)
    assert np.allclose(x, y, rtol=0, atol=1e-9)
    return "strapdown, samples", RUNS * SAMPLES, a, RUNS * SAMPLES, b, "the kernel for one, one by one"


def motions():
    """Motion of each run, 30 s of it: its own heading, latitude and speed, and a swing; (updates, 19, runs)."""
    rng = np.random.default_rng(1)
    time = DT * np.arange(MOTIONS)[:, None]
    swing = 0.3 * np.sin(2 * np.pi * time / 30.0 + rng.uniform(0, 6, RUNS))
    heading = rng.uniform(0, 6, RUNS) + swing
    latitude, speed = rng.uniform(0.0, 1.2, RUNS) + 0 * time, rng.uniform(5, 20, RUNS) + 0 * time
    C = attitude_matrix(heading, 0 * heading, 0 * heading)
    rate = np.gradient(heading, DT, axis=0)
    out = np.zeros((MOTIONS, lanes_filter.MOTION, RUNS))
    out[:, :9] = np.moveaxis(C.reshape(MOTIONS, RUNS, 9), 1, 2)
    out[:, 9], out[:, 10] = speed * np.sin(heading), speed * np.cos(heading)
    out[:, 12], out[:, 13], out[:, 14] = rate * out[:, 10], -rate * out[:, 9], 9.81
    out[:, 16], out[:, 17] = np.cos(latitude), np.sin(latitude)
    return out


@nb.njit(nogil=True)
def _follow(P, x, rows, seen, nis, room, updates):
    """Updates of one group, over and over the same motion."""
    own = np.empty(4 * LANES)
    for k in range(updates):
        motion = rows[k % rows.shape[0]]
        for i in range(LANES):
            own[i], own[LANES + i] = seen[k, 0], seen[k, 1]
            own[2 * LANES + i], own[3 * LANES + i] = -motion[10 * LANES + i], motion[9 * LANES + i]
        lanes_filter.step(P, x, motion, own, DT, EARTH_RATE, ELLIPSOID, False, NOISE, 1e-4, nis, room)


def filters():
    """A thousand filters of eleven states with 9000 updates each, and one run of a plain one."""
    motion, seen = motions(), np.random.default_rng(2).normal(0, 0.01, (UPDATES, 2))
    rows = motion[:, :, np.minimum(np.arange(-(-RUNS // LANES) * LANES), RUNS - 1)]
    groups = [np.ascontiguousarray(rows[:, :, i : i + LANES]).reshape(MOTIONS, -1) for i in range(0, RUNS, LANES)]

    def ours():
        def one(own):
            P, x, nis = np.repeat(PRIOR.ravel(), LANES), np.zeros(11 * LANES), np.zeros(LANES)
            _follow(P, x, own, seen, nis, np.empty(2 * lanes_filter.ROOM * LANES), UPDATES)
            return P.reshape(11, 11, LANES)[:, :, 0]

        with ThreadPoolExecutor(CORES) as pool:
            first, *_ = pool.map(one, groups)
        return first

    def baseline():
        P, x = PRIOR.copy(), np.zeros(11)
        for k in range(UPDATES):
            m = motion[k % MOTIONS, :, 0]
            F = plain.system(m[:9].reshape(3, 3), m[9:12], m[12:15], m[15:18], m[18], EARTH_RATE)
            P, x, _ = plain.step(P, x, F, DT, NOISE, np.array([*seen[k], -m[10], m[9]]), 1e-4)
        return P

    ours()
    (a, b), (x, y) = race([ours, baseline], 3)
    sigma = np.sqrt(np.diag(y))
    assert np.allclose(x / np.outer(sigma, sigma), y / np.outer(sigma, sigma), rtol=0, atol=1e-9)
    return "filter of eleven states, updates", RUNS * UPDATES, a, UPDATES, b, "one run in plain NumPy"


def configuration():
    """The published transfer alignment."""
    initial = {
        "misalignment": ["0.2 deg", "0.2 deg", "0.5 deg"],
        "velocity": "0.2 m/s",
        "gyro_bias": "0.01 deg/h",
        "accel_bias": "50 ug",
    }
    trajectory = {"latitude": "60 deg", "height": "0 m", "speed": "10 m/s", "heading": "90 deg"}
    return settings.from_table(
        {
            "gate": "off",
            "initial": initial,
            "noise": {"gyro": "0.001 deg/sqrt(h)", "accel": "0.833 ug/sqrt(Hz)", "velocity": "0.01 m/s"},
            "trajectory": trajectory | {"leg": [{"duration": f"{SECONDS} s"}]},
        }
    )


def alignments():
    """A thousand transfer alignments of 600 s at 100 Hz, and a minute of one with the filter for one."""
    config, minute = configuration(), 60.0
    states, chain = layout_of(config), Chain.of(config, config, 100.0)
    (piece,) = itertools.islice(chain.pieces(chain.marks([minute / 2])), 1)
    start = chain.trajectory.state(0.0)

    def ours():
        return monte_carlo(config, runs=RUNS, times=[SECONDS])

    def baseline():
        one = Filter(config, states, start, np.zeros(3), np.array([0.0, 0.0, 9.8]))
        for k, (east, north) in enumerate(piece.velocities):
            own = slice(k * chain.count, (k + 1) * chain.count)
            one.advance(piece.turns[own], piece.pushes[own], piece.steps[own], piece.heights[own])
            one.match(Reference(config.trajectory.latitude, 0.0, np.array([east, north, 0.0])))
            one.feed_back()
        return one.P

    ours()
    (a, b), (found, _) = race([ours, baseline], 2)
    low, high = found.nees_band[0]
    print(
        f"Monte Carlo: {RUNS} runs of {SECONDS:g} s at 100 Hz in {a:.1f} s; NEES {found.nees[0]:.2f}, "
        f"95 % band {low:.2f} to {high:.2f}"
    )
    count = len(piece.velocities)
    return "transfer alignment, updates", RUNS * round(SECONDS / DT), a, count, b, "one run with sagnac.align.filter"


def main() -> None:
    print(f"{RUNS} at once on {CORES} cores")
    rows = [fleet(), filters(), alignments()]
    print(
        f"| {'job':<33} | {'ours [s]':>8} | {'each [ns]':>9} | {'[1e6/s]':>7} | {'baseline, each [ns]':>19} | ", end=""
    )
    print(f"{'ratio':>6} | {'baseline':<32} |")
    print(f"|{'-' * 35}|{'-' * 9}:|{'-' * 10}:|{'-' * 8}:|{'-' * 20}:|{'-' * 7}:|{'-' * 34}|")
    for name, count, ours, few, other, against in rows:
        each, theirs = ours / count * 1e9, other / few * 1e9
        print(f"| {name:<33} | {ours:>8.3f} | {each:>9.1f} | {1e3 / each:>7.2f} | {theirs:>19.1f} | ", end="")
        print(f"{theirs / each:>6.1f} | {against:<32} |")


if __name__ == "__main__":
    main()
