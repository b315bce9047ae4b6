"""The noise engine: densities, slopes and correlations are those asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.simulate.noise import AxisNoise, NoiseModel, flicker, gauss_markov, generator

DT = 0.01


def noise(model: NoiseModel, count: int, stream: int = 0, dt: float = DT) -> np.ndarray:
    values = np.zeros(count)
    AxisNoise(model, dt, 1, (stream,)).add(values)
    return values


def allan_deviation(rates: np.ndarray, dt: float, time: float) -> float:
    """Fully overlapping, of averages over `time` (IEEE Std 952, annex C)."""
    m = round(time / dt)
    angle = np.concatenate([[0.0], np.cumsum(rates)]) * dt
    second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
    return math.sqrt(np.mean(second**2) / 2) / (m * dt)


def allan_of_markov(size: float, tau: float, time: float) -> float:
    """Allan variance of a first-order Gauss-Markov process of standard deviation `size` (IEEE Std 952, annex C)."""
    x = time / tau
    return 2 * size**2 / x * (1 - (3 - 4 * math.exp(-x) + math.exp(-2 * x)) / (2 * x))


def test_no_noise_adds_nothing():
    assert not noise(NoiseModel(), 10).any()


def test_calls_continue_each_other():
    model = NoiseModel(1.0, 0.5, (1.0, 50.0), 0.1, ((0.3, 2.0),))
    whole = noise(model, 1000)
    parted = np.zeros(1000)
    axis = AxisNoise(model, DT, 1, (0,))
    for part in np.split(parted, [1, 17, 600]):
        axis.add(part)
    np.testing.assert_array_equal(whole, parted)


def test_streams_differ_and_seeds_repeat():
    a, b = noise(NoiseModel(1.0), 1000, 0), noise(NoiseModel(1.0), 1000, 1)
    assert abs(np.mean(a * b)) / (a.std() * b.std()) < 4 / math.sqrt(1000)
    np.testing.assert_array_equal(a, noise(NoiseModel(1.0), 1000, 0))
    assert generator(1, 2).random() != generator(2, 1).random()


def test_flicker_is_flat_in_its_band():
    # sqrt(2 ln 2 / pi) B: the lowest Allan deviation of 1/f noise, IEEE Std 952
    floor = math.sqrt(2 * math.log(2) / math.pi)
    band = (1.0, 3000.0)
    processes = [(p.spread, -DT / math.log(p.decay)) for p in flicker(1.0, band, DT)]
    assert processes[0][1] == pytest.approx(1.0)
    assert processes[-1][1] == pytest.approx(3000.0)
    # away from the ends of the band by a factor of 20 the flanks of the outer processes no longer matter
    for time in np.geomspace(20 * band[0], band[1] / 20, 20):
        total = math.sqrt(sum(allan_of_markov(s, t, time) for s, t in processes))
        assert total == pytest.approx(floor, rel=0.03)


def test_the_slow_processes_hardly_change_from_sample_to_sample():
    p = gauss_markov(2.0, 1e6, 1e-4)
    # step^2 = size^2 (1 - decay^2) = size^2 * 2 dt / tau: 2e-10 * 4, without loss of digits
    assert p.step == pytest.approx(2.0 * math.sqrt(2e-10), rel=1e-9)


@pytest.mark.statistical
@pytest.mark.parametrize("dt", [0.1, 0.002])
def test_white_noise_has_its_density(dt):
    # a mean over T has density^2 / T; n means: relative standard deviation of their variance sqrt(2 / n), four of them
    density, time, n = 0.3, 1.0, 2000
    values = noise(NoiseModel(density), round(n * time / dt), dt=dt)
    means = values.reshape(n, -1).mean(axis=1)
    assert np.mean(means**2) == pytest.approx(density**2 / time, rel=4 * math.sqrt(2 / n))
    assert values.var() == pytest.approx(density**2 / dt, rel=4 * math.sqrt(2 / values.size))


@pytest.mark.statistical
def test_random_walk_grows_as_its_square_root():
    # increments over T are normal with walk^2 T and independent
    walk, n = 0.7, 4000
    values = noise(NoiseModel(walk=walk), 100 * n)
    for m in (1, 10, 100):
        steps = np.diff(values[::m])
        k = steps.size
        assert np.mean(steps**2) == pytest.approx(walk**2 * m * DT, rel=4 * math.sqrt(2 / k))
        assert abs(np.mean(steps[1:] * steps[:-1])) < 4 * walk**2 * m * DT / math.sqrt(k)
    # it starts at zero
    assert abs(values[0]) < 5 * walk * math.sqrt(DT)
    # Allan deviation K sqrt(T / 3) (IEEE Std 952, annex C): slope +1/2
    assert allan_deviation(values, DT, 1.0) == pytest.approx(walk * math.sqrt(1 / 3), rel=0.1)


@pytest.mark.statistical
def test_gauss_markov_has_its_size_and_correlation():
    # n correlation times of record: variance and autocovariance have relative standard deviations of about sqrt(2 / n) or less
    size, tau, n = 1.5, 0.5, 6000
    values = noise(NoiseModel(markov=((size, tau),)), round(n * tau / DT))
    band = 4 * math.sqrt(2 / n)
    assert values.var() == pytest.approx(size**2, rel=band)
    for lag in (0.1, 0.5, 1.0, 1.5):
        k = round(lag / DT)
        measured = np.mean(values[k:] * values[:-k]) / size**2
        assert measured == pytest.approx(math.exp(-lag / tau), abs=band)


@pytest.mark.statistical
def test_gauss_markov_starts_in_its_steady_state():
    # first samples of 2000 axes; relative standard deviation of a variance sqrt(2 / 2000)
    first = [noise(NoiseModel(markov=((2.0, 1e4),)), 1, k)[0] for k in range(2000)]
    assert np.var(first) == pytest.approx(4.0, rel=4 * math.sqrt(2 / 2000))


@pytest.mark.statistical
def test_bias_instability_has_its_floor():
    # Allan deviation of the sum of processes, exactly known; the mean over eight axes of 4000 s each. At T = 20 s there are
    # some 200 independent values an axis: relative standard deviation of the mean variance 1 / sqrt(800) = 3.5 %
    model = NoiseModel(instability=1.0, band=(0.5, 400.0))
    processes = [(p.spread, -0.05 / math.log(p.decay)) for p in flicker(1.0, model.band, 0.05)]
    runs = [noise(model, 80_000, k, 0.05) for k in range(8)]
    for time in (2.0, 5.0, 20.0):
        found = math.sqrt(np.mean([allan_deviation(r, 0.05, time) ** 2 for r in runs]))
        expected = math.sqrt(sum(allan_of_markov(s, t, time) for s, t in processes))
        assert found == pytest.approx(expected, rel=0.08)
        assert found == pytest.approx(0.664, rel=0.12)
