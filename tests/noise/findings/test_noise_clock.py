"""Lost samples are found in stamps that jitter, come late or in bursts, and none where nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.noise.findings.clock import Clock, usual_interval
from sagnac.noise.gather import gather
from sagnac.recording import from_arrays

N, DT = 20_000, 0.01
RNG = np.random.default_rng(1)
EVEN = DT * np.arange(N)


def in_bursts(of):
    """All samples of a burst are stamped when its last one is there, a little after one another."""
    k = np.arange(N)
    return DT * (k - k % of + of - 1) + 1e-4 * DT * (k % of)


def stalled():
    """Once, nine samples come together, late."""
    time = EVEN.copy()
    time[700:709] = time[709] - 1e-5 * np.arange(9, 0, -1)
    return time


STAMPS = {
    "even": EVEN,
    "uniform": EVEN + DT * RNG.uniform(-0.3, 0.3, N),
    "normal": np.sort(EVEN + DT * 0.15 * RNG.normal(size=N)) + 1e-12 * np.arange(N),
    "pairs": in_bursts(2),
    "tens": in_bursts(10),
    "one in four late": EVEN + DT * 0.6 * (np.arange(N) % 4 == 3),
    "stalled": stalled(),
    "another clock": EVEN * 1.003 + 1e-4 * np.sin(EVEN),
}


def broken(time, pieces=(), interval=None):
    clock = Clock(usual_interval(time) if interval is None else interval)
    done, out = 0, []
    for part in np.split(time, pieces):
        decided, breaks = clock.take(part)
        out += [done + b for b in breaks]
        done += decided
    decided, breaks = clock.rest()
    out += [done + b for b in breaks]
    assert done + decided == time.size
    return out, clock.gaps


@pytest.mark.parametrize("name", STAMPS)
def test_nothing_is_lost(name):
    assert broken(STAMPS[name])[0] == []
    assert usual_interval(STAMPS[name]) == pytest.approx(np.ptp(STAMPS[name]) / (N - 1), rel=1e-12)


@pytest.mark.parametrize("name", STAMPS)
@pytest.mark.parametrize("lost", [1, 3, 500])
def test_what_is_lost_is_found(name, lost):
    time = np.delete(STAMPS[name], slice(9_000, 9_000 + lost))
    found, gaps = broken(time)
    # in bursts the places near it are not told apart
    assert 1 <= len(found) <= {"pairs": 2, "tens": 10}.get(name, 1)
    assert max(abs(f - 9_000) for f in found) <= (60 if name == "tens" else 3)
    assert gaps[0][1] > lost * DT * 0.5 or name == "tens"
    # where the loss lies in a burst of ten of 20 000 cannot be told
    within = 5e-4 if name == "tens" else 2e-4
    assert usual_interval(time) == pytest.approx(usual_interval(STAMPS[name]), rel=within)


def test_many_that_are_lost_at_random():
    rng = np.random.default_rng(2)
    kept = rng.random(N) > 0.01
    kept[[0, -1]] = True
    runs = np.flatnonzero(np.diff(np.flatnonzero(kept)) > 1) + 1
    single = runs[np.diff(runs, prepend=-9) > 4]  # of those that are closer, one stands for both
    found = broken(EVEN[kept])[0]
    assert set(single.tolist()) <= set(found) <= set(runs.tolist())
    assert usual_interval(EVEN[kept]) == pytest.approx(DT, rel=1e-3)
    found = broken(STAMPS["uniform"][kept])[0]
    apart = np.abs(np.subtract.outer(runs, found)).min(axis=1)
    assert np.mean(apart <= 2) > 0.95
    assert abs(len(found) - runs.size) <= 0.05 * runs.size


@pytest.mark.parametrize("name", ["even", "uniform", "tens"])
def test_it_does_not_matter_how_the_log_is_cut(name):
    time = np.delete(STAMPS[name], [*range(5_000, 5_020), 7_000, 7_001, 12_345])
    whole = broken(time, interval=DT)
    for pieces in ((1, 2, 3, 70, 5_010), tuple(range(100, 19_900, 37))):
        parted = broken(time, pieces, interval=DT)
        assert parted[0] == whole[0]
        assert np.allclose(parted[1], whole[1], atol=1e-9)


@pytest.mark.parametrize("name", ["uniform", "normal", "pairs", "one in four late"])
@pytest.mark.parametrize("memory", [2**31, 0])
def test_a_log_with_such_stamps_is_taken_whole(name, memory):
    gyro = np.random.default_rng(3).normal(size=(N, 3))
    found = gather(from_arrays(STAMPS[name], gyro=gyro), memory=memory)
    assert found.stretches == (N,)
    assert found.interval == pytest.approx(np.ptp(STAMPS[name]) / (N - 1), rel=1e-12)
    kept = np.delete(np.arange(N), slice(6_000, 9_000))
    found = gather(from_arrays(STAMPS[name][kept], gyro=gyro[kept]), memory=memory)
    assert sum(found.stretches) + found.short == N - 3_000
    assert found.stretches == pytest.approx((6_000, 11_000), abs=3)
    assert found.interval == pytest.approx(DT, rel=2e-4)
    if found.kept is not None:
        assert np.array_equal(found.kept[0].column(1, DT, None), gyro[: found.stretches[0], 1])
