"""Random numbers of the lanes: the generator's published numbers, the normal distribution, independence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from sagnac.kernels.lanes import LANES
from sagnac.kernels.lanes_random import normals

WORD = 2**64 - 1


def plain(state):
    """xoshiro256++ in whole numbers."""
    a, b, c, d = state
    r = (a + d) & WORD
    r = (((r << 23) & WORD | r >> 41) + a) & WORD
    t = (b << 17) & WORD
    c ^= a
    d ^= b
    b ^= c
    a ^= d
    c ^= t
    return r, (a, b, c, (d << 45) & WORD | d >> 19)


def plain_pair(x, y):
    """Box and Muller's transform of two words, with the logarithm, sine and cosine of the standard library."""
    u = 2.0 - (1.0 + (x >> 12) / 2.0**52)
    radius, angle = math.sqrt(-2.0 * math.log(u)), 0.5 * math.pi * ((y >> 12) / 2.0**52 - 0.5)
    pair = [math.sin(angle), math.cos(angle)] if not y & 1 else [math.cos(angle), math.sin(angle)]
    return [radius * (1 - (y & 2)) * pair[0], radius * (1 - (y >> 1 & 2)) * pair[1]]


def draws(state, pairs):
    out, own = np.empty((pairs, 2 * LANES)), state.copy()
    for row in out:
        normals(own, row, 0)
    return out.reshape(pairs, 2, LANES)


def state_of(seed):
    return np.random.default_rng(seed).integers(0, 2**64, 4 * LANES, dtype=np.uint64)


def test_the_plain_generator_is_the_published_one():
    # first numbers from the state 1, 2, 3, 4, as the reference implementation in C gives them
    state, out = (1, 2, 3, 4), []
    for _ in range(5):
        r, state = plain(state)
        out.append(r)
    assert out == [41943041, 58720359, 3588806011781223, 3591011842654386, 9228616714210784205]


def test_each_lane_is_the_plain_generator():
    first = state_of(1)
    ours = draws(first, 200)
    for i in range(LANES):
        state = tuple(int(s) for s in first.reshape(4, LANES)[:, i])
        for k in range(200):
            x, state = plain(state)
            y, state = plain(state)
            # the polynomials are good to some 1e-16 of numbers up to 8
            np.testing.assert_allclose(ours[k, :, i], plain_pair(x, y), rtol=0, atol=4e-15)


@pytest.mark.parametrize("word", [0, WORD, 1 << 63, (1 << 12) - 1, 0x6A09E667F3BCD << 12])
def test_the_ends_of_the_range_are_finite(word):
    """The next word is what is asked for when a + d is zero and a is that word."""
    state = np.zeros((4, LANES), dtype=np.uint64)
    state[0], state[3] = word, (1 << 64) - word & WORD
    assert plain((word, 0, 0, (1 << 64) - word & WORD))[0] == word
    out = draws(state.ravel(), 1)
    assert np.isfinite(out).all()
    assert np.abs(out).max() < 8.6  # sqrt(2 ln 2^52)


@pytest.mark.statistical
def test_they_are_normal_and_independent():
    out = draws(state_of(2), 40_000)  # 80 000 of each lane, 1.28 million in all
    values = out.ravel()
    n = values.size
    # four standard deviations of each moment: 1, sqrt(1/2), sqrt(6), sqrt(24) over sqrt(n)
    assert abs(values.mean()) < 4 / math.sqrt(n)
    assert abs(values.std() - 1) < 4 * math.sqrt(0.5 / n)
    assert abs(stats.skew(values)) < 4 * math.sqrt(6 / n)
    assert abs(stats.kurtosis(values)) < 4 * math.sqrt(24 / n)
    assert stats.kstest(values, "norm").pvalue > 1e-3
    # tails beyond 4: expected 6.33e-5 each way together
    assert stats.poisson(6.334e-5 * n).cdf(np.sum(np.abs(values) > 4)) == pytest.approx(0.5, abs=0.499)
    lanes = out.transpose(2, 0, 1).reshape(LANES, -1)
    correlation = np.corrcoef(lanes) - np.eye(LANES)
    assert np.abs(correlation).max() < 5 / math.sqrt(lanes.shape[1])
    for lag in (1, 2, 3):
        assert abs(np.mean(lanes[:, lag:] * lanes[:, :-lag])) < 4 / math.sqrt(n)
    assert abs(np.mean(out[:, 0] ** 2 * out[:, 1] ** 2) - 1) < 4 * math.sqrt(8 / (n / 2))  # the two of a pair
