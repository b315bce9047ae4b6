"""The filter against dense linear algebra, its grid, mixtures, first passages: every number against another way to it."""

from __future__ import annotations

import numpy as np
import pytest
from histories import YEAR
from scipy.optimize import brentq
from scipy.special import chdtrc, ndtr
from scipy.stats import norm

from sagnac.registry import scatter
from sagnac.registry.drift import Histories, Posterior, course, infer, quantiles
from sagnac.registry.leaving import _between, _first, passage
from sagnac.registry.probability import chi_square_above, normal_below

RNG = np.random.default_rng(5)
TIME = np.array([0.0, 0.1, 0.1, 0.35, 0.6, 1.0])  # two calibrations of one moment among them
SIGMA = np.array([1.0, 0.5, 2.0, 1.0, 0.1, 0.7])
VALUE = np.array([0.3, -1.0, 2.0, 0.8, 2.5, 4.0])
PAIRS = np.array([[0.0, 0.0], [1.5, 0.0], [0.0, 4.0], [0.7, 2.0]])  # variances of white scatter and walk


def own(time=TIME, value=VALUE, sigma=SIGMA) -> scatter.Scaled:
    one = np.ones(1)
    return scatter.Scaled(time[None], value[None], sigma[None] ** 2, one, one, one, one, np.array([time.size]))


def dense(white, walk, at=1.0):
    """Restricted likelihood, drift, its variance, and the level at a time, by generalised least squares with full matrices.

    The level is a + b t + W(t) with the covariance q min(t, t') of W; a and b have no prior.
    """
    design = np.column_stack([np.ones_like(TIME), TIME])
    covariance = walk * np.minimum.outer(TIME, TIME) + np.diag(SIGMA**2 + white)
    inverse = np.linalg.inv(covariance)
    normal = design.T @ inverse @ design
    found = np.linalg.solve(normal, design.T @ inverse @ VALUE)
    left = VALUE - design @ found
    logs = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
    likelihood = -0.5 * (logs + left @ inverse @ left)
    spread = np.linalg.inv(normal)
    cross = walk * np.minimum(TIME, at)
    level = found[0] + found[1] * at + cross @ inverse @ left
    gain = np.array([1.0, at]) - cross @ inverse @ design
    variance = walk * at - cross @ inverse @ cross + gain @ spread @ gain
    return likelihood, found[1], spread[1, 1], level, variance


def test_the_filter_is_generalised_least_squares():
    white, walk = PAIRS.T[:, None]
    found = scatter.run(own(), white, walk)
    oracle = [dense(*pair) for pair in PAIRS]
    assert np.diff(found.likelihood[0]) == pytest.approx(np.diff([o[0] for o in oracle]), rel=1e-10)
    assert found.drift[0] == pytest.approx([o[1] for o in oracle], rel=1e-12)
    assert 1 / found.information[0] == pytest.approx([o[2] for o in oracle], rel=1e-12)
    lever = 1.0 - found.lever[0]
    assert found.value[0] + found.drift[0] * lever == pytest.approx([o[3] for o in oracle], rel=1e-12)
    variance = found.variance[0] + lever**2 / found.information[0]
    assert variance == pytest.approx([o[4] for o in oracle], rel=1e-12)


def test_the_smoother_is_the_best_linear_predictor_also_between_calibrations():
    white, walk = PAIRS.T[:, None]
    between = np.array([0.0, 0.05, 0.5, 0.6, 0.99])
    every = np.concatenate([TIME, between])
    order = np.argsort(every, kind="stable")
    wide = own(
        every[order],
        np.concatenate([VALUE, np.zeros(5)])[order],
        np.concatenate([SIGMA, np.full(5, np.inf)])[order],
    )
    mean, sigma = scatter.smooth(wide, white, walk, scatter.run(wide, white, walk))
    place = np.argsort(order)[TIME.size :]
    for k, at in enumerate(between):
        oracle = [dense(*pair, at=at) for pair in PAIRS]
        assert mean[place[k]] == pytest.approx([o[3] for o in oracle], rel=1e-10)
        assert sigma[place[k]] ** 2 == pytest.approx([o[4] for o in oracle], rel=1e-9)


def histories(n=9, rows=4, *, fill=0) -> Histories:
    rng = np.random.default_rng(11)
    time = np.sort(rng.uniform(0, 8 * YEAR, (rows, n)), axis=1) + 1.6e9
    value = 3.0 + 1e-5 * rng.standard_normal((rows, n)) + 1e-5 * (time - 1.6e9) / YEAR
    sigma = np.full((rows, n), 1e-5)
    if fill:
        time = np.concatenate([time, np.repeat(time[:, -1:], fill, axis=1)], axis=1)
        value = np.concatenate([value, np.zeros((rows, fill))], axis=1)
        sigma = np.concatenate([sigma, np.full((rows, fill), np.inf)], axis=1)
    return Histories(time, value, sigma)


def test_filling_up_changes_nothing():
    plain, filled = infer(histories()), infer(histories(fill=3))
    for name in ("weight", "drift", "drift_sigma", "level", "variance", "model"):
        assert getattr(filled, name) == pytest.approx(getattr(plain, name), rel=1e-9, abs=1e-300)


def test_a_history_is_the_same_alone_and_in_a_crowd():
    one = histories()
    crowd = Histories(*(np.repeat(np.roll(a, 1, axis=0), 70, axis=0) for a in (one.time, one.value, one.sigma)))
    assert infer(crowd).drift[70] == pytest.approx(infer(one).drift[0], rel=1e-12)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e6])
def test_units_of_measurement_do_not_matter(size):
    one = histories()
    scaled = Histories(one.time, size * (one.value - 3.0), size * one.sigma)
    plain = infer(Histories(one.time, one.value - 3.0, one.sigma))
    assert infer(scaled).drift / size == pytest.approx(plain.drift, rel=1e-9)


def test_the_grid_has_closed_in_on_the_likelihood():
    # mean drift over a grid ten times as fine, made from the dense likelihood of the same prior
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0, 1, 12))
    time[0], time[-1] = 0.0, 1.0
    walk = np.concatenate([[0], np.cumsum(np.sqrt(9.0 * np.diff(time)) * rng.standard_normal(11))])
    value, sigma = walk + rng.standard_normal(12), np.ones(12)
    found = infer(Histories(time[None], value[None], sigma[None]))
    units = scatter.scaled(time[None], value[None], sigma[None])
    fine = scatter.Grid.of(*scatter.axes_of(units, 60))
    run = scatter.run(units, fine.white**2, fine.walk**2)
    weight = np.exp(run.likelihood + fine.prior - np.max(run.likelihood + fine.prior))
    weight /= weight.sum()
    low, middle, high = quantiles(found.weight, found.drift, found.drift_sigma, (0.025, 0.5, 0.975))[:, 0]
    expected = quantiles(weight, run.drift, 1 / np.sqrt(run.information), (0.025, 0.5, 0.975))[:, 0] * units.size[0]
    assert [low, middle, high] == pytest.approx(expected, abs=0.03 * (high - low))


def test_quantiles_of_one_component_are_those_of_the_normal_distribution():
    levels = (0.025, 0.5, 0.84)
    found = quantiles(np.ones((2, 1)), np.array([[1.0], [-3.0]]), np.array([[2.0], [1e-6]]), levels)
    expected = np.array([[1.0], [-3.0]]) + np.array([[2.0], [1e-6]]) * norm.ppf(levels)
    assert pytest.approx(expected, abs=2e-5) == found.T


def test_quantiles_of_a_mixture():
    weight, mean, sigma = np.array([[0.3, 0.7]]), np.array([[0.0, 5.0]]), np.array([[1.0, 0.5]])
    for level, at in zip((0.1, 0.6), quantiles(weight, mean, sigma, (0.1, 0.6))[:, 0], strict=True):
        assert float((weight * ndtr((at - mean) / sigma)).sum()) == pytest.approx(level, abs=1e-6)


def test_the_band_ends_at_the_level_of_the_last_calibration_and_widens_ahead():
    one = Histories(*(a[:1] for a in (histories().time, histories().value, histories().sigma)))
    posterior = infer(one)
    last = one.time[0, -1]
    low, middle, high = course(one, posterior, np.array([last, last + YEAR]), (0.025, 0.5, 0.975))
    for k, at in enumerate((last, last + YEAR)):
        expected = quantiles(posterior.weight, *posterior.at(np.array([at])), (0.025, 0.5, 0.975))[:, 0]
        assert [low[k], middle[k], high[k]] == pytest.approx(expected, abs=0.01 * (high[k] - low[k]))
    assert high[1] - low[1] > high[0] - low[0]


@pytest.mark.parametrize(("distance", "speed", "walk"), [(1.0, 0.5, 0.3), (1.0, -0.2, 0.3), (2.0, 1e-9, 0.5)])
def test_first_passages_have_the_distribution_of_cox_and_miller(distance, speed, walk):
    rng = np.random.default_rng(1)
    m = 100_000
    drawn = _first(
        np.full(m, distance), np.full(m, speed), np.full(m, walk), rng.standard_normal(m), rng.random((2, m))
    )
    for t in (1.0, 3.0, 10.0):
        # Cox and Miller 1965, (5.7.73): of a Wiener process with drift
        root = np.sqrt(walk * t)
        expected = ndtr((speed * t - distance) / root) + np.exp(2 * speed * distance / walk) * ndtr(
            (-distance - speed * t) / root
        )
        assert np.mean(drawn <= t) == pytest.approx(expected, abs=4 * np.sqrt(0.25 / m))


def test_without_a_walk_a_limit_is_met_where_the_line_meets_it():
    speeds, distances = np.array([1.0, -1.0, 0.0, 2.0]), np.array([2.0, 2.0, 2.0, -1.0])
    found = _first(distances, speeds, np.zeros(4), np.ones(4), np.full((2, 4), 0.5))
    assert found.tolist() == [2.0, np.inf, np.inf, 0.0]


def test_two_limits_are_left_as_brownian_motion_leaves_them():
    # dx = dW between -1 and 1: quantiles of the exit time from its series of eigenfunctions (Cox and Miller 1965, 5.7)
    k = 2 * np.arange(200) + 1
    stays = lambda t: 4 / np.pi * np.sum((-1.0) ** np.arange(200) / k * np.exp(-(k**2) * np.pi**2 * t / 8))  # noqa: E731
    expected = [brentq(lambda t, p=p: 1 - stays(t) - p, 0.01, 20) for p in (0.025, 0.5, 0.975)]
    assert expected == pytest.approx([0.161, 0.758, 3.17], rel=0.01)
    one, nothing = np.ones((1, 1)), np.zeros((1, 1))
    number = np.zeros(1, dtype=np.int64)
    posterior = Posterior(one, nothing, one, nothing, nothing, nothing, nothing, nothing, np.zeros(1), number, number)
    found = passage(posterior, -np.ones(1), np.ones(1), 20.0)
    assert found.within[:, 0] == pytest.approx(expected, rel=0.05)  # of 4000 draws
    draws = np.ones(200_000)
    time, _ = _between(draws, draws, 0 * draws, draws)
    assert np.quantile(time, (0.025, 0.5, 0.975)) == pytest.approx(expected, rel=0.015)


@pytest.mark.parametrize("drift", [0.3, -0.5, 2.0, -2.0, 8.0])
@pytest.mark.parametrize("above", [0.3, 1.0, 1.9])
def test_which_limit_is_left_and_when_on_average(drift, above):
    # of a Wiener process with drift between two limits, a distance of 2 from one another (Cox and Miller 1965, 5.7)
    m, q, width = 40_000, 0.7, 2.0
    below = width - above
    rises = np.expm1(-2 * drift * below / q) / np.expm1(-2 * drift * width / q)
    mean = (rises * width - below) / drift
    time, upper = _between(np.full(m, above), np.full(m, below), np.full(m, drift), np.full(m, q))
    assert upper.mean() == pytest.approx(rises, abs=4 * np.sqrt(0.25 / m))
    assert time.mean() == pytest.approx(mean, abs=4 * time.std() / np.sqrt(m) + 2e-3 * mean)


def test_compiled_filters_are_those_of_numpy():
    for given in (histories(rows=3, n=40), histories(fill=3)):
        own = scatter.scaled(given.time, given.value, given.sigma)
        grid = scatter.Grid.of(*scatter.axes_of(own, 4))
        plain, compiled = (scatter.run(own, grid.white**2, grid.walk**2, compiled=c) for c in (False, True))
        for name in ("likelihood", "drift", "information", "value", "lever", "variance"):
            assert getattr(compiled, name) == pytest.approx(getattr(plain, name), rel=1e-9)


def test_a_limit_that_is_not_there_is_never_left():
    posterior = infer(histories())
    none = np.full(4, np.inf)
    found = passage(posterior, -none, none, 20 * YEAR)
    assert np.all(np.isinf(found.within))
    assert np.all(found.outside == 0)


@pytest.mark.parametrize("dof", [1, 2, 3, 8, 21, 500])
@pytest.mark.parametrize("over", [0.0, 0.1, 1.0, 2.0, 10.0])
def test_chi_square_is_that_of_scipy(dof, over):
    assert chi_square_above(over * dof, dof) == pytest.approx(chdtrc(dof, over * dof), rel=1e-9, abs=1e-300)


def test_the_normal_distribution_is_that_of_scipy():
    z = np.linspace(-9, 9, 1001)
    below, density = normal_below(z)
    assert below == pytest.approx(ndtr(z), abs=1.5e-7)
    assert density == pytest.approx(norm.pdf(z), rel=1e-12)
