"""Sums of squares against the distributions that are known, and against all differences of a short record."""

import math

import numpy as np
import pytest
from scipy import stats

from sagnac.noise.identification.model_covariance import covariance_table, whole
from sagnac.noise.identification.quadratic import MOST, Squares, normal_score, squares
from sagnac.noise.identification.terms import lag_covariance

TAILS = (-1.96, -1.645, -1.0, -0.2, 0.0, 0.5, 1.645, 1.96, 2.5)


def of(size, shift=0.0, often=1.0, rest=0.0):
    size = np.atleast_1d(np.asarray(size, dtype=float))
    return Squares(size, np.full(size.size, shift), np.full(size.size, often), rest)


@pytest.mark.parametrize("freedom", [1, 3, 12])
def test_one_size_is_chi_square(freedom):
    spread = math.sqrt(2.0 * freedom)
    for z in TAILS:
        value = (stats.chi2.ppf(stats.norm.cdf(z), freedom) - freedom) / spread
        # the formula is that of the normal density at the saddle point: worst for one square, whose density has a pole
        assert normal_score(value, of(1.0 / spread, often=freedom)) == pytest.approx(
            z, abs=0.1 if freedom == 1 else 0.02
        )


def test_shifted_squares_are_noncentral_chi_square():
    freedom, shift = 3, 1.5
    square = freedom * shift**2
    spread = math.sqrt(2.0 * freedom + 4.0 * square)
    for z in TAILS:
        value = (stats.ncx2.ppf(stats.norm.cdf(z), freedom, square) - freedom - square) / spread
        assert normal_score(value, of(1.0 / spread, shift, freedom)) == pytest.approx(z, abs=0.02)


def test_sizes_of_both_signs_are_a_ratio_of_chi_squares():
    # a X < b Y with a + b = 1, where X / Y has an F distribution
    for a in (0.3, 0.5, 0.7):
        spread = math.sqrt(8.0 * (a**2 + (1.0 - a) ** 2))
        found = normal_score(-4.0 * (2.0 * a - 1.0) / spread, of(np.array([a, a - 1.0]) / spread, often=4.0))
        assert found == pytest.approx(stats.norm.ppf(stats.f.cdf((1.0 - a) / a, 4, 4)), abs=0.02)


def test_what_is_normal_stays_so():
    for z in TAILS:
        assert normal_score(z, of(np.zeros(0), rest=1.0)) == pytest.approx(z, abs=1e-3)


def test_a_sum_of_squares_is_never_below_none():
    one = of(1.0 / math.sqrt(2.0))
    assert normal_score(-0.72, one) == -MOST
    assert normal_score(-0.5, of(1.0 / math.sqrt(2.0), rest=1e-3)) > -MOST
    assert normal_score(500.0, one) == MOST


@pytest.mark.parametrize("kind", ["allan", "hadamard"])
def test_few_places_have_the_skewness_of_all_differences(kind):
    keys, levels = ("white", "walk", "ramp"), np.array([1.0, 0.02, 1e-3 if kind == "allan" else 0.0])
    plan = whole(kind, 160)
    table = covariance_table(plan, keys, 0.0)
    exact = np.einsum("i,j,ijkl->kl", levels, levels, table)
    rng = np.random.default_rng(0)
    span, divisor = (2, 2.0) if kind == "allan" else (3, 6.0)
    for _ in range(3):
        weights = np.zeros(len(plan.factors))
        weights[-3:] = rng.normal(size=3)
        variance = float(weights @ exact @ weights)
        found = squares(plan, keys, 0.0, levels, weights, variance)
        assert found.rest < 0.15
        # every difference of the record, of the three averaging times
        own = [
            (m, plan.stretches[0].samples + 1 - span * m, w)
            for m, w in zip(plan.factors[-3:], weights[-3:], strict=True)
        ]
        factor = np.concatenate([np.full(n, float(m)) for m, n, _ in own])
        middle = np.concatenate([np.arange(n) + 0.5 * span * m for m, n, _ in own])
        weight = np.concatenate([np.full(n, w / (n * divisor)) for _, n, w in own])
        low, high = np.minimum.outer(factor, factor), np.maximum.outer(factor, factor)
        lag = np.abs(np.subtract.outer(middle, middle))
        noise = sum(
            level * lag_covariance(key, kind, low.ravel(), high.ravel(), lag.ravel()).reshape(lag.shape)
            for key, level in zip(keys[:2], levels[:2], strict=True)
        )
        mean = math.sqrt(levels[2]) * factor
        once, full = weight[:, None] * noise, np.trace
        spread = 2.0 * full(once @ once) + 4.0 * mean @ (once @ (weight * mean))
        assert spread == pytest.approx(variance, rel=1e-6)
        third = 8.0 * full(once @ once @ once) + 24.0 * mean @ (once @ once @ (weight * mean))
        ours = float(found.often @ (8.0 * found.size**3 + 24.0 * found.size**3 * found.shift**2))
        assert ours == pytest.approx(third / variance**1.5, abs=0.1)
