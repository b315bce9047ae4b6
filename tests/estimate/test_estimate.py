"""The estimator against linear theory, brute force and its own claims."""

import numpy as np
import pytest

from sagnac.errors import DataError
from sagnac.estimate import Parameter, Rows, combination, eliminate, estimate, null_space

SEGMENTS = [str(i) for i in range(12)]


def linear(design, observed, sigma=1.0, segment=None):
    """Model of a linear problem as rows."""
    index = np.arange(len(design)) % len(SEGMENTS) if segment is None else segment
    return lambda x: Rows((observed - design @ x) / sigma, -design / sigma, index)


def parameters(k, **kwargs):
    return [Parameter(f"p{i}", "1", 0.0, 1.0, **kwargs) for i in range(k)]


@pytest.fixture
def problem():
    rng = np.random.default_rng(5)
    design = rng.standard_normal((60, 4))
    truth = np.array([1.0, -2.0, 0.5, 3.0])
    return design, truth, design @ truth + 0.01 * rng.standard_normal(60)


def test_linear_problem_equals_the_textbook(problem):
    design, _, observed = problem
    fit = estimate(parameters(4), linear(design, observed, 0.01), SEGMENTS)
    covariance = np.linalg.inv(design.T @ design) * 0.01**2
    assert np.allclose(fit.value, covariance @ design.T @ observed / 0.01**2, rtol=1e-12)
    assert np.allclose(fit.white, np.sqrt(np.diag(covariance)), rtol=1e-10)
    residual = (observed - design @ fit.value) / 0.01
    assert fit.chi2 == pytest.approx(residual @ residual, rel=1e-10)
    assert fit.degrees_of_freedom == 56
    assert fit.used == "white"


def test_delete_one_segment_equals_refits(problem):
    design, _, observed = problem
    segment = np.arange(60) % 12
    fit = estimate(parameters(4), linear(design, observed, 0.01), SEGMENTS)
    refits = np.array([np.linalg.lstsq(design[segment != s], observed[segment != s], rcond=None)[0] for s in range(12)])
    jackknife = np.sqrt(11 / 12 * ((refits - refits.mean(axis=0)) ** 2).sum(axis=0))
    assert np.allclose(fit.jackknife, jackknife, rtol=1e-9)
    shifts = np.abs(refits - fit.value).max(axis=1)
    worst = max(fit.influence, key=lambda i: i.shift)
    sigma = fit.sigma
    expected = np.max(np.abs(refits - fit.value) / sigma, axis=1)
    assert worst.shift == pytest.approx(expected.max(), rel=1e-6)
    assert shifts.shape == (12,)


def test_leverages_sum_to_the_number_of_parameters(problem):
    design, _, observed = problem
    fit = estimate(parameters(4), linear(design, observed, 0.01), SEGMENTS)
    assert sum(i.leverage for i in fit.influence) == pytest.approx(4.0, rel=1e-9)
    assert sum(i.chi2 for i in fit.influence) == pytest.approx(fit.chi2, rel=1e-9)


def test_cluster_figure_sees_what_the_white_one_does_not():
    """Samples of a segment share an error ten times their noise: white is 2 to 4 times too small (style of the rig)."""
    rng = np.random.default_rng(0)
    segment = np.repeat(np.arange(12), 50)
    design = np.repeat(rng.standard_normal((12, 2)), 50, axis=0)
    observed = design @ [1.0, 2.0] + 0.1 * rng.standard_normal(600) + np.repeat(rng.standard_normal(12), 50)
    fit = estimate(parameters(2), linear(design, observed, 0.1, segment), SEGMENTS)
    assert fit.used == "delete-one-segment"
    assert np.all(fit.cluster > 5 * fit.white)
    assert np.allclose(fit.sigma, fit.jackknife)


def test_cluster_figure_is_unbiased():
    """CR2 has no bias when segments scatter alike (Bell & McCaffrey 2002): mean over 400 runs within 4 sigma of the truth."""
    rng = np.random.default_rng(2)
    design = rng.standard_normal((12, 2))
    rows = np.repeat(design, 5, axis=0)
    segment = np.repeat(np.arange(12), 5)
    variances = []
    for _ in range(400):
        observed = rows @ [1.0, 2.0] + np.repeat(rng.standard_normal(12), 5)
        variances.append(estimate(parameters(2), linear(rows, observed, 0.1, segment), SEGMENTS).cluster ** 2)
    truth = np.diag(np.linalg.inv(design.T @ design))
    spread = np.std(variances, axis=0) / np.sqrt(400)
    assert np.all(np.abs(np.mean(variances, axis=0) - truth) < 4 * spread)


def test_prior_is_an_observation():
    design = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
    observed = np.array([1.0, 2.0, 3.0])
    given = [Parameter("a", "1", 0.0, 100.0), Parameter("b", "1", 0.0, 100.0, prior=0.5, prior_sigma=0.1)]
    fit = estimate(given, linear(design, observed), SEGMENTS)
    stacked = np.vstack([design, [0.0, 10.0]])
    right = np.append(observed, 5.0)
    assert np.allclose(fit.value, np.linalg.lstsq(stacked, right, rcond=None)[0])
    assert fit.white[1] == pytest.approx(0.1, rel=1e-9)


def test_vague_prior_does_not_count_as_a_degree_of_freedom(problem):
    design, _, observed = problem
    vague = parameters(4, prior=0.0, prior_sigma=1e6)
    assert estimate(vague, linear(design, observed, 0.01), SEGMENTS).degrees_of_freedom == 56


def test_unseen_combination_is_named(problem):
    design, _, observed = problem
    design = design.copy()
    design[:, 3] = design[:, 0] - 2 * design[:, 1]
    with pytest.raises(DataError, match=r"cannot tell these apart") as error:
        estimate(parameters(4), linear(design, observed), SEGMENTS)
    for name in ("p0", "p1", "p3"):
        assert name in str(error.value)
    assert "p2" not in str(error.value)


def test_parameter_without_any_effect_is_named(problem):
    design, _, observed = problem
    design = design.copy()
    design[:, 2] = 0.0
    with pytest.raises(DataError, match="p2"):
        estimate(parameters(4), linear(design, observed), SEGMENTS)


def test_combination_left_vague_is_refused(problem):
    design, _, observed = problem
    design = design.copy()
    design[:, 3] = design[:, 0] + 1e-6 * design[:, 3]
    with pytest.raises(DataError, match=r"next to nothing about: .*p0.*p3|next to nothing about: .*p3.*p0"):
        estimate(parameters(4), linear(design, observed, 0.01), SEGMENTS)


def test_no_redundancy_and_no_noise_is_refused():
    with pytest.raises(DataError, match="nothing is left to judge"):
        estimate(parameters(2), linear(np.eye(2), np.ones(2)), SEGMENTS, noise_known=False)


def test_diverging_model_is_refused():
    """Residual atan-like: Gauss-Newton from far away overshoots for ever, and the slope does not end."""

    def model(x):
        return Rows(np.array([np.exp(-x[0]) + 1.0, 1.0]), np.array([[-np.exp(-x[0])], [0.0]]), np.array([0, 1]))

    with pytest.raises(DataError):
        estimate([Parameter("p", "1", 0.0, 1.0)], model, SEGMENTS)


def test_nonlinear_problem_reaches_the_truth():
    t = np.linspace(0, 4, 40)
    observed = 2.0 * np.exp(-0.7 * t)

    def model(x):
        e = np.exp(-x[1] * t)
        return Rows((observed - x[0] * e) / 1e-3, np.column_stack([-e, x[0] * t * e]) / 1e-3, np.arange(40) % 12)

    fit = estimate([Parameter("a", "1", 1.0, 1.0), Parameter("k", "1", 0.2, 1.0)], model, SEGMENTS)
    assert np.allclose(fit.value, [2.0, 0.7], atol=1e-12)


def test_robust_option_turns_a_bad_segment_down(problem):
    design, truth, observed = problem
    segment = np.arange(60) % 12
    spoiled = observed + np.where(segment == 7, 5.0, 0.0)
    plain = estimate(parameters(4), linear(design, spoiled, 0.01), SEGMENTS)
    robust = estimate(parameters(4), linear(design, spoiled, 0.01), SEGMENTS, robust=True)
    assert np.abs(robust.value - truth).max() < 0.05 * np.abs(plain.value - truth).max()
    assert robust.weights[7] < 0.02
    assert np.all(np.delete(robust.weights, 7) > 0.3)


def test_eliminating_local_unknowns_equals_solving_for_them():
    rng = np.random.default_rng(3)
    n, m, k, own = 8, 5, 3, 2
    jac, local, r = rng.standard_normal((n, m, k)), rng.standard_normal((n, m, own)), rng.standard_normal((n, m))
    reduced_r, reduced_j = eliminate(r, jac, local)
    whole = np.zeros((n, m, k + n * own))
    whole[:, :, :k] = jac
    for s in range(n):
        whole[s, :, k + s * own : k + (s + 1) * own] = local[s]
    everything = np.linalg.lstsq(whole.reshape(n * m, -1), r.ravel(), rcond=None)[0]
    only = np.linalg.lstsq(reduced_j.reshape(-1, k), reduced_r.ravel(), rcond=None)[0]
    assert np.allclose(only, everything[:k], rtol=1e-10)
    full = whole.reshape(n * m, -1)
    schur = np.linalg.inv(np.linalg.inv(full.T @ full)[:k, :k])
    assert np.allclose(reduced_j.reshape(-1, k).T @ reduced_j.reshape(-1, k), schur, rtol=1e-9)


def test_consider_adds_what_fixed_quantities_contribute(problem):
    """Fixing b at its prior and considering it equals solving with the prior, where the data say nothing about b."""
    design, _, observed = problem
    fit = estimate(parameters(3), linear(design[:, :3], observed - 3.0 * design[:, 3], 0.01), SEGMENTS)
    wider, cross = fit.consider(-design[:, 3:] / 0.01, np.array([[0.05**2]]))
    moved = np.linalg.lstsq(design[:, :3], design[:, 3], rcond=None)[0]
    assert np.allclose(wider.covariance - fit.covariance, np.outer(moved, moved) * 0.05**2, rtol=1e-8)
    assert np.allclose(cross[:, 0], -moved * 0.05**2, rtol=1e-8)


def test_null_space_condition_is_free_of_units():
    rng = np.random.default_rng(1)
    jac = rng.standard_normal((30, 3))
    first, _ = null_space(jac, "abc")
    second, _ = null_space(jac * [1e-6, 1.0, 1e6], "abc")
    assert first == pytest.approx(second, rel=1e-9)


def test_combination_reads_like_words():
    assert combination(np.array([3.0, 0.0, -4.0]), ["a", "b", "c"]) == "0.8 c - 0.6 a"


@pytest.mark.statistical
def test_estimates_reach_the_bound_and_intervals_hold():
    """1000 runs of a linear problem: ratio to the bound within its own sampling error (3.3 sigma, 7.4 %), coverage 93 to 97 %."""
    rng = np.random.default_rng(11)
    design = rng.standard_normal((40, 3))
    truth = np.array([0.3, -0.2, 0.1])
    errors, sigmas, p_values = [], [], []
    for _ in range(1000):
        observed = design @ truth + 0.1 * rng.standard_normal(40)
        fit = estimate(parameters(3), linear(design, observed, 0.1), SEGMENTS)
        errors.append(fit.value - truth)
        sigmas.append(fit.sigma)
        p_values.append(fit.p_value)
    bound = 0.1 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bound
    assert np.all(np.abs(ratio - 1) < 3.3 / np.sqrt(2000))
    coverage = np.mean(np.abs(errors) < 1.96 * np.array(sigmas), axis=0)
    assert np.all((coverage > 0.93) & (coverage < 0.97))
    assert abs(np.mean(np.array(p_values) < 0.5) - 0.5) < 3.3 * 0.5 / np.sqrt(1000)


def test_chi_square_of_each_segment_is_expected_to_be_its_rows_less_its_leverage():
    """Of the whitened residuals left by a fit the covariance is ``I - H``: means over 400 noises, within four of their errors."""
    rng = np.random.default_rng(11)
    design = rng.standard_normal((23, 3))
    segment = np.repeat([0, 1, 2, 3], [12, 5, 4, 2])
    chi2 = []
    for _ in range(400):
        noise = rng.standard_normal(23)
        fit = estimate(
            [Parameter(n, "1", 0.0, 1.0) for n in "abc"],
            lambda x, noise=noise: Rows(noise - design @ x, -design, segment),
            tuple("1234"),
            noise_known=True,
        )
        chi2.append([i.chi2 for i in fit.influence])
    expected = np.array([i.rows - i.leverage for i in fit.influence])
    assert [i.rows for i in fit.influence] == [12, 5, 4, 2]
    assert np.all(np.abs(np.mean(chi2, axis=0) - expected) < 4 * np.sqrt(2 * expected / 400))
