"""Covariance that slow noise gives to means, parts and harmonics of segments, against closed forms and simulated noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.calibrate.slow import SlowNoise, harmonics_covariance, kernels, scatter_density, slow_noise
from sagnac.observe.harmonic_sums import Even, HarmonicSums, Turn
from sagnac.plan import Noise, Plan, Unit
from sagnac.sensors.series import basis
from sagnac.simulate.noise import AxisNoise, NoiseModel

ONE = SlowNoise(np.ones(3), np.ones(3))


def test_kernels_are_means_over_pairs_of_cells():
    """Against a fine grid, whose midpoint rule is off by 1e-4 where the logarithm is infinite."""
    fine = (np.arange(400) + 0.5) / 400
    flicker, walk = kernels(100)
    for lag in (0, 1, 2, 63, 64, 99):
        u = np.abs(lag + fine[:, None] - fine)
        assert walk[lag] == pytest.approx(-u.mean() / 2, abs=1e-5)
        logs = np.log(u[u > 0]).sum() / u.size + (math.log(1 / 400) - 1.5) / 400 * (lag == 0)
        assert flicker[lag] == pytest.approx(-logs / math.pi, abs=2e-3 if lag == 0 else 1e-5)


def test_means_over_longer_times_differ_as_the_mean_variance_says():
    """Parts put together: the difference of the variances of the means over T and 50 T is that of the closed form."""
    flicker, walk = kernels(50)
    lag = np.abs(np.arange(50)[:, None] - np.arange(50))
    stated = SlowNoise(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])).mean_variance(np.array([1.0]), 50.0)[0]
    assert flicker[0] - flicker[lag].mean() == pytest.approx(stated[0], rel=1e-12)
    assert walk[0] - walk[lag].mean() == pytest.approx(stated[1], rel=1e-12)


def test_parts_have_the_segments_mean_and_scatter():
    parts = ONE.parts_covariance(0, 60.0, 300.0, 16)
    whole = ONE.mean_variance(np.array([60.0]), 300.0)[0, 0]
    assert parts.mean() == pytest.approx(whole, rel=1e-12)
    # each part by itself as any segment of that length, in the mean over its places
    assert np.diag(parts).mean() == pytest.approx(ONE.mean_variance(np.array([3.75]), 300.0)[0, 0], rel=1e-12)
    assert np.linalg.eigvalsh(parts).min() > 0


@pytest.mark.parametrize("turns", [1, 7, 400])
def test_a_random_walk_over_whole_turns(turns):
    """By parts: the cosine gets 2 K^2 / (T w^2), the sine, of which the ends differ, three times that."""
    T, w = 30.0, 2.0 * math.pi * turns / 30.0
    _, walk = harmonics_covariance(2.0 * math.pi * turns, math.pi * turns, T, 2)
    h = np.array([1.0, 2.0])
    expected = 2.0 / (T * (h * w) ** 2)
    np.testing.assert_allclose(np.diag(walk)[1::2], expected, rtol=0.02)
    np.testing.assert_allclose(np.diag(walk)[2::2], 3.0 * expected, rtol=0.02)
    assert abs(walk[0, 0]) < 1e-9


def test_flicker_noise_over_many_turns_has_its_spectrum():
    flicker, _ = harmonics_covariance(2.0 * math.pi * 300.3, 0.4, 60.0, 3)
    spectrum = 1.0 / (2.0 * math.pi * np.repeat([1, 2, 3], 2) * 300.3 / 60.0)
    np.testing.assert_allclose(np.diag(flicker)[1:], 2.0 / 60.0 * spectrum, rtol=0.02)


def test_variances_go_on_beyond_the_turns_that_are_summed():
    """300.25 turns are summed as 128.25; summed as they are they give the same within the ends' part."""
    from sagnac.calibrate import slow

    few = harmonics_covariance(2.0 * math.pi * 300.25, 0.4, 60.0, 2, extended=True)
    summed = slow._TURNS
    try:
        slow._TURNS = 1e6
        all_turns = harmonics_covariance(2.0 * math.pi * 300.25, 0.4, 60.0, 2, extended=True)
    finally:
        slow._TURNS = summed
    for one, other in zip(few, all_turns, strict=True):
        np.testing.assert_allclose(np.diag(one), np.diag(other), rtol=0.02)


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["flicker", "walk"])
def test_coefficients_of_simulated_noise_over_a_part_of_turns(kind):
    """2.3 turns with the terms with tau: 1000 drawn coefficients about the mean, chi-square within 5 %."""
    model = NoiseModel(instability=1.0, band=(0.002, 3e4)) if kind == "flicker" else NoiseModel(walk=1.0)
    T, n, arc, phase, order = 20.0, 1000, 2.0 * math.pi * 2.3, 0.7, 2
    tau = ((np.arange(n) + 0.5) / n - 0.5) * T
    terms = basis(phase + arc * tau / T, order)
    terms = np.hstack([terms, tau[:, None] * terms[:, 1:]])
    to_coefficients = np.linalg.pinv(terms)
    covariance = harmonics_covariance(arc, phase, T, order, extended=True)[kind == "walk"]
    found = []
    for seed in range(1000):
        noise = np.zeros(n)
        AxisNoise(model, T / n, seed, (1,)).add(noise)
        found.append((to_coefficients @ (noise - noise.mean()))[1:])
    found = np.array(found)
    own = covariance[1:, 1:]
    squares = np.einsum("ni,ni->n", found, np.linalg.solve(own, found.T).T) / own.shape[0]
    assert squares.mean() == pytest.approx(1.0, abs=0.05)


def test_blocks_of_a_segment_at_rest_are_parts_without_harmonics():
    """Two ways to the same: a formula of sixteen means, and the scatter of parts on a fine grid."""
    flicker, walk, freedom = scatter_density(0.0, 60.0, 4, 16)
    one = SlowNoise(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])).blocks_density(np.array([60.0]), np.zeros(1), 16)
    assert freedom == 14
    assert (flicker, walk) == (pytest.approx(one[0], rel=1e-9), pytest.approx(one[1], rel=1e-9))
    # segments are pooled by their freedom: two that turn have 12 each
    both = SlowNoise(np.ones(3), np.zeros(3))
    still, turning = (both.blocks_density(np.array([60.0]), np.array([arc]), 16)[0] for arc in (0.0, 20.0))
    pooled = both.blocks_density(np.full(3, 60.0), np.array([0.0, 20.0, -20.0]), 16)[0]
    assert pooled == pytest.approx((14 * still + 24 * turning) / 38, rel=1e-12)


@pytest.mark.statistical
@pytest.mark.parametrize("turns", [0.0, 0.8, 10.3])
@pytest.mark.parametrize("kind", ["flicker", "walk"])
def test_density_of_the_scatter_of_simulated_noise(kind, turns):
    """Mean over 200 runs of what the sums of harmonics find, to four of its standard errors and 3 %."""
    T, step, order, runs = 20.0, 0.01, 3, 200
    model = NoiseModel(instability=1.0, band=(step, 1e5)) if kind == "flicker" else NoiseModel(walk=1.0)
    rate, extended = 2.0 * math.pi * turns / T, turns > 1
    found, freedom = [], set()
    for seed in range(runs):
        noise = np.zeros(round(T / step))
        AxisNoise(model, step, seed, (1,)).add(noise)
        sums = HarmonicSums(Turn(0.0, T, rate, 0.3), 1, order if turns else 0, extended=extended)
        sums.add([noise[:, None]], Even(step / 2, step), step)
        fit = sums.fit()
        found.append(fit.slow_squares[0] * step / fit.slow_degrees_of_freedom)
        freedom.add(fit.slow_degrees_of_freedom)
    *densities, own = scatter_density(rate * T, T, order, 16, extended=extended)
    expected = densities[kind == "walk"]
    assert abs(np.mean(found) - expected) < 4.0 * np.std(found) / math.sqrt(runs) + 0.03 * expected
    assert all(abs(f - own) <= 2 for f in freedom)


def test_what_a_plan_does_not_state_is_none():
    def of(**noise):
        return slow_noise(Plan(unit=Unit(noise=Noise(gyro=1e-5, **noise))), "gyro")

    assert of() is None
    assert of(gyro_instability=0.0, gyro_walk=0.0) is None
    assert of(gyro_walk=(0.0, 1e-7, 0.0)).walk.tolist() == [0.0, 1e-7, 0.0]
    assert of(accel_walk=1.0) is None
