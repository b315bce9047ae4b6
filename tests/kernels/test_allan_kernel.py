"""Sums of squared differences against whole numbers, which have no rounding, and against their plain twin."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import plain_allan
from sagnac.kernels.allan import add_second, add_third, chain_blocks, stream, sum_blocks, survey

BLOCK = 64


def in_blocks(values, order, quanta, block=BLOCK):
    n, axes = values.shape
    blocks = -(-(n + order) // block)
    local, ends = np.empty((axes, n + order)), np.empty((blocks, 3, axes))
    sum_blocks(values, np.zeros(axes), quanta[0], order, block, 0, blocks, local, ends)
    starts = np.empty((axes, 5, blocks))
    chain_blocks(ends, block, quanta[1:], starts)
    return local, starts


def whole(values, order):
    """Cumulative sums as integers."""
    sums = [0]
    for y in values.tolist():
        sums.append(sums[-1] + int(y))
    if order == 2:
        twice = [0]
        for x in sums:
            twice.append(twice[-1] + x)
        return twice
    return sums


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("slope", [0, 7])
def test_blocks_and_their_starts_are_the_cumulative_sum(order, slope):
    values = np.random.default_rng(0).integers(-1000, 1000, (1000, 2)) + slope * np.arange(-500.0, 500.0)[:, None]
    local, starts = in_blocks(values, order, np.array([[32.0, 32.0], [64.0, 64.0], [4096.0, 4096.0]]))
    t = np.arange(local.shape[1]) % BLOCK
    for a in range(2):
        X, rest, W, small, L = starts[a, :, np.arange(local.shape[1]) // BLOCK].T
        assert np.any(L != 0) or not slope
        found = local[a] + X + rest + L * t
        if order == 2:
            found = local[a] + W + small + (X + rest) * t + L * t * (t - 1) / 2
        assert found.tolist() == whole(values[:, a], order)


def test_starts_are_multiples_of_their_quanta_with_small_rests():
    values = np.random.default_rng(1).normal(size=(5000, 1)) + 1e-2 * np.arange(5000.0)[:, None]
    quanta = np.array([[2.0**-20], [2.0**-6], [2.0**3]])
    _, starts = in_blocks(values, 2, quanta)
    for row, q in zip((4, 0, 2), quanta[:, 0], strict=True):
        assert np.array_equal(starts[0, row] % q, np.zeros(starts.shape[2]))
    for row, q in zip((1, 3), quanta[1:, 0], strict=True):
        assert np.abs(starts[0, row]).max() <= 0.5 * q


@pytest.mark.parametrize(("span", "order"), [(2, 1), (3, 1), (3, 2)])
@pytest.mark.parametrize("m", [1, 2, 31, 64, 100, 256, 300])
def test_sums_of_squares_are_exact_in_whole_numbers(span, order, m):
    values = np.random.default_rng(2).integers(-9, 9, (1000, 1)).astype(float)
    local, starts = in_blocks(values, order, np.array([[2.0], [8.0], [512.0]]))
    out = np.zeros((starts.shape[2], 1))
    if span == 2:
        add_second(local[0], starts[0], BLOCK, np.array([m]), 0, len(out), out)
    else:
        add_third(local[0], starts[0], BLOCK, order, np.array([m]), 0, len(out), out)
    s = whole(values[:, 0], order)
    weights = [1, -2, 1] if span == 2 else [-1, 3, -3, 1]
    terms = len(s) - span * m
    assert int(out.sum()) == sum(sum(w * s[i + k * m] for k, w in enumerate(weights)) ** 2 for i in range(terms))


@pytest.mark.parametrize(("span", "order"), [(2, 1), (3, 1), (3, 2)])
def test_a_long_ramp_costs_no_digits(span, order):
    # whole numbers again, but the second sum goes to 3e14 and the ramp to a hundred thousand times the noise
    n = 50_000
    values = (np.arange(n) * 20 - 10 * n + np.random.default_rng(3).integers(-4, 5, n)).astype(float)[:, None]
    reach = float(np.abs(values).max())
    most = np.log2(np.array([[reach], [n * reach], [0.5 * n * n * reach]]))
    local, starts = in_blocks(values, order, np.exp2(np.ceil(most) - np.array([[25.0], [36.0], [49.0]])), 4096)
    factors = np.array([1, 3, 5000])
    out = np.zeros((starts.shape[2], 3))
    if span == 2:
        add_second(local[0], starts[0], 4096, factors, 0, len(out), out)
    else:
        add_third(local[0], starts[0], 4096, order, factors, 0, len(out), out)
    s = np.array(whole(values[:, 0], order), dtype=object)
    for i, m in enumerate(factors.tolist()):
        d = s
        for _ in range(span):
            d = d[m:] - d[:-m]
        assert float(Fraction(out[:, i].sum()) / Fraction(int((d * d).sum()))) == pytest.approx(1.0, rel=1e-11)


def test_survey_tells_sum_and_reach_and_lets_no_number_through_that_is_none():
    values = np.array([[1.0, 5.0], [-2.0, 7.0], [6.0, 3.0], [1.0, 1.0]])
    out, reference = np.empty((2, 2)), np.array([1.0, 5.0])
    survey(values, reference, 2, 0, 2, out)
    assert out.tolist() == [[2.0, -4.0], [5.0, 4.0]]
    survey(values, reference, 2, 1, 2, out)
    assert out.tolist() == [[5.0, -6.0], [5.0, 4.0]]
    for bad in (np.nan, np.inf, -np.inf):
        values[1, 0] = bad
        survey(values, reference, 2, 0, 2, out)
        assert not np.isfinite(out[0, 0])
        assert out[:, 1].tolist() == [-4.0, 4.0]


@pytest.mark.parametrize(("kind", "span", "order"), [("allan", 2, 1), ("modified", 3, 2), ("hadamard", 3, 1)])
def test_every_level_samples_the_differences_of_the_record(kind, span, order):
    values = np.random.default_rng(4).normal(size=(3001, 1)).cumsum(axis=0)
    factors = np.array([1, 3, 8, 11])
    tails, sums = np.zeros((8, span * 11)), np.zeros((8, 4))
    kept, unread = np.zeros(8, dtype=np.int64), np.zeros(8, dtype=np.int64)
    stream(values, 0, values[0, 0], span, order, 128, factors, 2, tails, kept, unread, sums)
    length = len(values)
    for level in range(5):
        for i in range(2 if level else 0, 4):
            k = int(factors[i])
            terms = length + order - span * k
            scale = {"allan": 2.0 * k**2, "hadamard": 6.0 * k**2, "modified": 2.0 * k**4}[kind]
            expected = plain_allan.variance(values[:, 0], k << level, kind, 1 << level)
            assert sums[level, i] / terms / scale == pytest.approx(expected, rel=1e-10)
        length = length // 2 if order == 1 else (length - 1) // 2
