"""Blocks of a log: the same however it is parted, and what plain NumPy says of it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sagnac.noise.findings.blocks import Ledger

DT = 0.01


def blocks_of(values, parts=(), most=64, warmth=None):
    ledger = Ledger(values.shape[1], DT, most)
    edges = [0, *parts, len(values)]
    time = DT * np.arange(len(values))
    for i, j in pairwise(edges):
        ledger.add(time[i:j], values[i:j], None if warmth is None else warmth[i:j])
    return ledger.blocks()


@pytest.fixture(scope="module")
def values():
    rng = np.random.default_rng(1)
    return 9.8 + np.round(rng.normal(size=(10_007, 2)), 1) * [1.0, 1e-3]


def test_blocks_are_what_numpy_says(values):
    found = blocks_of(values)
    size = found.size
    assert found.count * size <= len(values) < (found.count + 1) * size
    assert 32 <= found.count < 64
    cut = values[: found.count * size].reshape(found.count, size, 2)
    assert np.allclose(found.mean, cut.mean(axis=1), rtol=1e-14)
    assert np.allclose(found.variance, cut.var(axis=1), rtol=1e-9)
    steps = np.diff(values, axis=0, prepend=values[:1])[: found.count * size] ** 2
    assert np.allclose(found.steps, steps.reshape(found.count, size, 2).mean(axis=1), rtol=1e-9)
    assert np.allclose(found.start, DT * size * np.arange(found.count))


def test_extremes_and_equal_samples_are_counted(values):
    found = blocks_of(values)
    assert np.array_equal(found.low, values.min(axis=0))
    assert np.array_equal(found.at_high, (values == values.max(axis=0)).sum(axis=0))
    assert np.allclose(found.equal, (np.abs(np.diff(values, axis=0)) < 1e-9).sum(axis=0) / len(values))
    assert found.finest[0] == pytest.approx(0.1, rel=1e-9)  # and not the 2e-15 by which 9.8 + 0.1 k is rounded


@pytest.mark.parametrize("parts", [(1,), (5, 6, 7, 2000), tuple(range(0, 10_000, 97)), (9999,)])
def test_parting_changes_nothing(values, parts):
    whole, parted = blocks_of(values), blocks_of(values, parts)
    for name in ("start", "stop", "low", "high", "at_low", "at_high", "equal", "run", "run_start", "runs", "finest"):
        assert np.array_equal(getattr(whole, name), getattr(parted, name)), name
    for name in ("mean", "variance", "steps"):
        assert np.allclose(getattr(whole, name), getattr(parted, name), rtol=1e-9), name
    assert whole.size == parted.size


@pytest.mark.parametrize("parts", [(), (300,), (299, 310), (250, 299, 300, 301, 320)])
def test_the_longest_run_is_found_across_pieces(values, parts):
    held = values.copy()
    held[300:337, 1] = held[300, 1]
    found = blocks_of(held, parts)
    assert found.run[1] == pytest.approx(37, abs=1)  # the sample before may be equal by chance
    assert found.run_start[1] == pytest.approx(3.0, abs=0.011)


def test_runs_are_counted_by_their_lengths():
    y = np.round(0.4 * np.random.default_rng(7).standard_normal((20_000, 1)))
    found = blocks_of(y)
    change = np.flatnonzero(np.diff(y[:, 0]) != 0)
    lengths = np.diff(change) - 1  # repeats between one change and the next; and those before the first
    lengths = np.append(lengths[lengths > 0], [change[0]] if change[0] else [])
    assert found.runs[0, :10].tolist() == [int(((lengths >> j) == 1).sum()) for j in range(10)]


def test_temperature_is_averaged_where_it_is_known(values):
    warmth = np.full(len(values), np.nan)
    warmth[::100] = 300.0 + np.arange(0, len(values), 100) * 1e-3
    found = blocks_of(values, warmth=warmth)
    assert found.temperature is not None
    middle = 300.0 + (found.mid / DT) * 1e-3
    assert np.allclose(found.temperature, middle, atol=0.11)
    assert blocks_of(values).temperature is None
