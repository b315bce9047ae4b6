"""The covariance of variances against sums over every lag, and against simulated logs."""

import numpy as np
import pytest

from sagnac.errors import InputError
from sagnac.noise.curves.allan import Variances, pooled, variances
from sagnac.noise.identification.model_covariance import covariance_table, design, layout, whole
from sagnac.noise.identification.panels import graded, rule
from sagnac.noise.identification.terms import DIVISOR, LINEAR, ORDER, lag_covariance

KEYS = (*LINEAR, "markov")
DECAY = 0.03
FACTORS = (1, 2, 5, 16, 37, 100, 220)


def every_lag(kind, first, second):
    """Sum over all pairs of differences of two (stretch length, factor): counted one by one."""
    (n1, m1), (n2, m2) = first, second
    count1, count2 = n1 + 1 - ORDER[kind] * m1, n2 + 1 - ORDER[kind] * m2
    lag = np.arange(1 - count1, count2, dtype=float)
    pairs = np.minimum(count1, count2 - lag) - np.maximum(0.0, -lag)
    middles = lag + 0.5 * ORDER[kind] * (m2 - m1)
    one = np.ones(lag.size)
    rows = np.stack([lag_covariance(k, kind, m1 * one, m2 * one, middles, DECAY) for k in KEYS])
    out = 2.0 / (count1 * count2 * DIVISOR[kind] ** 2) * (rows * pairs) @ rows.T
    ramp = KEYS.index("ramp")
    out[ramp, ramp] = 0.0
    return out


@pytest.mark.parametrize("kind", ["allan", "hadamard"])
@pytest.mark.parametrize("samples", [701, 5000])
def test_table_is_the_sum_over_every_lag(kind, samples):
    m = np.array(FACTORS)
    v = Variances(kind, 1.0, samples, m, np.ones((m.size, 1)), samples + 1 - ORDER[kind] * m, "exact")
    table = covariance_table(layout(v), KEYS, DECAY)
    ramp = KEYS.index("ramp")
    for i, m1 in enumerate(FACTORS):
        for j, m2 in enumerate(FACTORS):
            brute = every_lag(kind, (samples, m1), (samples, m2))
            size = np.sqrt(np.outer(np.diag(table[:, :, i, i]), np.diag(table[:, :, j, j])))
            # a ramp has no size of its own, and its sum with flicker noise, whose spectrum begins at zero, nearly cancels
            size[ramp] = size[:, ramp] = 100.0 * np.abs(brute[ramp]) + 1e-6 * brute.max()
            assert np.all(np.abs(table[:, :, i, j] - brute) <= 1e-9 * size)


@pytest.mark.parametrize("length", [1, 8, 9, 20, 1000, 10**8])
def test_rule_sums_polynomials_exactly(length):
    x, w = rule(length)
    middle = 0.5 * (length - 1)
    for degree in (0, 2, 4):  # odd ones vanish about the middle
        # sum of ((2 x - L + 1) / L)^degree, by the moments of equidistant points
        ratio = 1.0 / length**2
        exact = {0: 1.0, 2: (1.0 - ratio) / 3.0, 4: (1.0 - ratio) * (3.0 - 7.0 * ratio) / 15.0}[degree]
        found = float(np.sum(w * (2.0 * (x - middle) / length) ** degree)) / length
        assert found == pytest.approx(exact, rel=1e-12, abs=1e-14)


def test_graded_panels_hold_every_integer_once():
    x, w = graded(3, 100_000)
    assert w.sum() == pytest.approx(100_000)
    assert np.sum(w * x) == pytest.approx(np.arange(3.0, 100_003.0).sum(), rel=1e-13)
    assert np.sum(w / x**2) == pytest.approx(np.sum(1.0 / np.arange(3.0, 100_003.0) ** 2), rel=1e-7)


def test_pooled_stretches_weigh_by_their_differences():
    rng = np.random.default_rng(0)
    parts = [variances(rng.normal(size=n), 1.0, [m for m in (1, 4, 16, 64) if 4 * m <= n]) for n in (900, 300, 100)]
    plan = layout(pooled(parts))
    table = covariance_table(plan, ("white",))[0, 0]
    expected = np.zeros((4, 4))
    counts = np.array([p.count.tolist() + [0] * (4 - len(p.count)) for p in parts], dtype=float)
    share = counts / counts.sum(axis=0)
    for p, s in zip(parts, share, strict=True):
        own = covariance_table(layout(p), ("white",))[0, 0]
        expected[: len(own), : len(own)] += own * np.outer(s, s)[: len(own), : len(own)]
    np.testing.assert_allclose(table, expected, rtol=1e-12)


def test_many_lengths_are_taken_together_at_their_mean():
    rng = np.random.default_rng(0)
    parts = [variances(rng.normal(size=n), 1.0, (1, 4, 16)) for n in range(400, 440)]
    together = layout(pooled(parts))
    assert len(together.stretches) == 1
    assert together.samples == pytest.approx(sum(range(400, 440)), abs=20)  # half a sample each
    one = covariance_table(layout(variances(rng.normal(size=420), 1.0, (1, 4, 16))), ("white",))[0, 0]
    np.testing.assert_allclose(covariance_table(together, ("white",))[0, 0], one / 40, rtol=0.01)


@pytest.mark.parametrize("kind", ["allan", "hadamard"])
def test_one_long_stretch_after_many_short_ones_keeps_its_longest_times(kind):
    # their mean would be shorter than what the long one alone tells, and no uncertainty at all be left there
    rng = np.random.default_rng(0)
    short = [variances(rng.normal(size=n), 1.0, kind=kind) for n in range(600, 770, 10)]
    long = variances(rng.normal(size=20_000), 1.0, kind=kind)
    spread = np.diag(covariance_table(layout(pooled([*short, long])), ("white",))[0, 0])
    alone = np.diag(covariance_table(layout(long), ("white",))[0, 0])
    longest = long.factors > short[-1].factors[-1]
    np.testing.assert_allclose(spread[longest], alone[longest], rtol=1e-12)
    assert np.all(spread > 0.3 * alone)


def test_modified_variance_has_no_model():
    v = variances(np.random.default_rng(0).normal(size=100), 1.0, kind="modified")
    with pytest.raises(InputError, match="from the allan or hadamard variance, not from the modified one"):
        layout(v)
    with pytest.raises(InputError, match="modified"):
        whole("modified", 100)


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["allan", "hadamard"])
def test_covariance_is_that_of_simulated_logs(kind):
    rng = np.random.default_rng(3)
    runs, samples = 20_000, 256
    levels = np.array([0.5, 1.0, 0.02])
    residues = rng.normal(size=(samples + 1, runs)) * np.sqrt(levels[0])
    y = np.diff(residues, axis=0) + rng.normal(size=(samples, runs)) * np.sqrt(levels[1])
    steps = rng.normal(size=(samples, runs)) * np.sqrt(levels[2])
    # means of a walk over the intervals: half way between its ends, and what it does between them
    y += np.cumsum(steps, axis=0) - 0.5 * steps + rng.normal(size=(samples, runs)) * np.sqrt(levels[2] / 12.0)
    v = variances(y, 1.0, kind=kind)
    plan, keys = layout(v), ("quantisation", "white", "walk")
    expected = design(plan, keys) @ levels
    model = np.einsum("t,u,tuij->ij", levels, levels, covariance_table(plan, keys))
    spread = np.sqrt(np.diag(model))
    np.testing.assert_allclose(v.variance.mean(axis=1), expected, atol=4.0 * (spread / np.sqrt(runs)).max())
    # a covariance of 20 000 runs scatters by about 1 % of its size, more for the skew longest times
    np.testing.assert_allclose(
        np.cov(v.variance) / np.outer(spread, spread), model / np.outer(spread, spread), atol=0.06
    )
