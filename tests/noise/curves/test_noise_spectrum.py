"""Spectra of noise against SciPy's, against the energy of the samples and against known densities."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch

from sagnac.errors import DataError, InputError
from sagnac.noise.curves.spectrum import SpectrumPass, spectrum


def one_length(y, length, removed="mean", interval=0.01):
    running = SpectrumPass(interval, y.shape[1], shortest=length, longest=length, removed=removed)
    running.add(y)
    return running.result()


@pytest.mark.parametrize(("removed", "theirs"), [("mean", "constant"), ("trend", "linear")])
@pytest.mark.parametrize("length", [64, 1000])
def test_one_length_is_the_method_of_welch(removed, theirs, length):
    y = np.random.default_rng(0).normal(size=(150_001, 2)).cumsum(axis=0) + 9.8
    found = one_length(y, length, removed)
    frequency, density = welch(y, 100.0, "hann", length, detrend=theirs, axis=0)
    assert found.frequency == pytest.approx(frequency[2:-1])
    assert found.density == pytest.approx(density[2:-1], rel=1e-9)
    assert set(found.averages) == {150_001 // (length // 2) - 1}
    assert found.samples == 150_001


def test_every_frequency_is_that_of_the_length_that_resolves_it():
    y = np.random.default_rng(1).normal(size=(50_000, 1))
    found = spectrum(y, 0.5)
    assert (np.diff(found.frequency) > 0).all()
    assert found.frequency[-1] == pytest.approx(127 / 128)
    assert (found.resolution <= found.frequency / 16 * (1 + 1e-12))[found.frequency > 16 / (16384 * 0.5)].all()
    for length in (256, 1024, 4096, 16384):
        own = np.isclose(found.resolution, 1.0 / (0.5 * length))
        frequency, density = welch(y[:, 0], 2.0, "hann", length, detrend="constant")
        assert own.sum() > 40
        ratio = found.density[own, 0] / np.interp(found.frequency[own], frequency, density)
        # longer stretches are of filtered samples, where filter and window change places: that moves each density by less than a
        # tenth of its own scatter, and their mean not at all
        scatter = np.sqrt(2.0 / found.freedom[own])
        assert ratio == pytest.approx(1.0, abs=1e-9 if length == 256 else 0.1 * scatter.min())
        assert ratio.mean() == pytest.approx(1.0, abs=0.01 * scatter.min())
        assert (found.averages[own] == 50_000 // (length // 2) - 1).all()


def longest_of(y):
    """Density that stretches of 4096 samples give, by way of the lower rates and by SciPy without them."""
    running = SpectrumPass(1.0, 1, longest=4096)
    running.add(y)
    found = running.result()
    own = np.isclose(found.resolution, 1.0 / 4096)
    frequency, density = welch(y, 1.0, "hann", 4096, detrend="constant")
    return found.density[own, 0], np.interp(found.frequency[own], frequency, density)


@pytest.mark.parametrize("power", [0, 2, 4])
def test_what_lies_at_high_frequencies_does_not_fold_onto_low_ones(power):
    # differences of white noise, as rounding makes them, have at the lowest frequency shown, 2/4096, (sin(pi f))^2 = 2.4e-6 of
    # their density at half the rate, and differences of these the square of it
    y = np.diff(np.random.default_rng(8).normal(size=400_000), power // 2)
    found, expected = longest_of(y)
    assert found == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("frequency", [0.1, 0.1903, 0.2503, 0.4997])
def test_a_strong_line_leaves_lower_rates_alone(frequency):
    white = np.random.default_rng(9).normal(size=200_000)
    alone, _ = longest_of(white)
    shaken, _ = longest_of(white + 1000.0 * np.sin(2 * np.pi * frequency * np.arange(white.size)))
    assert shaken == pytest.approx(alone, rel=1e-3)


def test_the_energy_is_that_of_the_samples():
    # Parseval: the one-sided density sums up to the variance, less what mean and trend have
    y = np.random.default_rng(2).normal(size=(400_000, 3)) * [1e-6, 1.0, 300.0] + 9.8
    found = one_length(y, 2048)
    assert found.density.sum(axis=0) * found.resolution[0] == pytest.approx(y.var(axis=0), rel=0.004)
    many = spectrum(y, 0.01)
    ends = np.concatenate([[0.0], 0.5 * (many.frequency[1:] + many.frequency[:-1]), [50.0]])
    assert np.diff(ends) @ many.density == pytest.approx(y.var(axis=0), rel=0.01)


def test_densities_of_white_noise_and_of_random_walk():
    # white: N^2 is sigma^2 interval, one-sided twice that; random walk of K: 2 K^2 / (2 pi f)^2 where f is low
    rng = np.random.default_rng(3)
    white, walk = rng.normal(size=2**20), np.cumsum(rng.normal(size=2**20))
    found = spectrum(np.stack([white, walk], axis=1), 0.01)
    assert np.average(found.density[:, 0], weights=found.freedom) == pytest.approx(0.02, rel=0.005)
    low = found.frequency < 2.0
    expected = 2.0 * (1.0 / 0.01) / (2.0 * np.pi * found.frequency) ** 2
    ratio = (found.density[:, 1] / expected)[low]
    assert np.average(ratio, weights=found.freedom[low]) == pytest.approx(1.0, rel=0.02)


@pytest.mark.statistical
def test_degrees_of_freedom_and_intervals_are_those_of_the_scatter():
    # 300 axes of white noise: the scatter of the densities over the axes is that of chi-square
    y = np.random.default_rng(4).normal(size=(12_000, 300))
    found = spectrum(y, 1.0)
    freedom = 2.0 * found.density.mean(axis=1) ** 2 / found.density.var(axis=1)
    for k in np.unique(found.averages):
        own = found.averages == k
        assert freedom[own].mean() == pytest.approx(found.freedom[own].mean(), rel=0.06)
    low, high = found.intervals(0.9)
    covered = ((low < 2.0) & (high > 2.0)).mean(axis=1)
    assert covered.mean() == pytest.approx(0.9, abs=0.01)


def test_the_result_does_not_depend_on_the_batches():
    rng = np.random.default_rng(5)
    y = rng.normal(size=(200_000, 2))
    expected = spectrum(y, 1.0).density
    running, at = SpectrumPass(1.0, 2), 0
    for size in rng.integers(0, 40_000, 9):
        running.add(y[at : at + size])
        at += size
        if running.samples >= 256:
            running.result()
    running.add(y[at:])
    assert np.array_equal(running.result().density, expected)


def test_no_stretch_spans_a_gap():
    y = np.random.default_rng(6).normal(size=(5000, 1))
    running = SpectrumPass(1.0, 1, shortest=256, longest=256)
    running.add(y[:2300])
    running.gap()
    running.add(y[2300:] + 1e6)
    found = running.result()
    parts = [one_length(y[:2300], 256, interval=1.0), one_length(y[2300:], 256, interval=1.0)]
    k = [p.averages[0] for p in parts]
    assert found.averages[0] == sum(k)
    expected = (k[0] * parts[0].density + k[1] * parts[1].density) / sum(k)
    assert found.density == pytest.approx(expected, rel=1e-6)


def test_what_cannot_be_is_named():
    for arguments, words in (
        ({"interval": 0.0, "axes": 1}, "interval of the samples is 0.0 s"),
        ({"interval": 1.0, "axes": 0}, "Spectrum of 0 axes"),
        ({"interval": 1.0, "axes": 1, "shortest": 7}, "stretches of 7"),
        ({"interval": 1.0, "axes": 1, "shortest": 64, "longest": 32}, "64 to 32"),
        ({"interval": 1.0, "axes": 1, "shortest": 64, "longest": 256}, "256 samples or more, not 64"),
        ({"interval": 1.0, "axes": 1, "removed": "parabola"}, "mean or trend, not 'parabola'"),
    ):
        with pytest.raises(InputError, match=words):
            SpectrumPass(**arguments)
    running = SpectrumPass(1.0, 2)
    running.add(np.ones((100, 2)))
    with pytest.raises(DataError, match="100 samples are too few for a spectrum: it takes 256 in a row"):
        running.result()
    with pytest.raises(InputError, match="Samples of 3 axes, and there were to be 2"):
        running.add(np.ones((5, 3)))
    with pytest.raises(DataError, match="Sample 102 of axis 1 is inf"):
        running.add([[0.0, 0.0], [np.inf, 0.0]])
    assert running.samples == 100
    with pytest.raises(InputError, match="Level"):
        spectrum(np.random.default_rng(7).normal(size=300), 1.0).intervals(2.0)
