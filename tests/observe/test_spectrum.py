"""Spectra of noise and lines of known size, in one piece and in many; names of lines."""

import numpy as np
import pytest

from sagnac.observe.spectrum import SpectrumSums, find_lines, folded

DT = 0.001
KNOWN = {"mean": 0.0, "swing": 1.7, "spin": 10.0, "twice spin": 20.0}


def values(count=60_000, noise=0.1, lines=((10.0, 0.05), (33.0, 0.02)), mean=0.3, seed=1):
    t = np.arange(count) * DT
    out = mean + noise * np.random.default_rng(seed).standard_normal(count)
    for k, (f, a) in enumerate(lines):
        out += a * np.cos(2 * np.pi * f * t + k)
    return out[:, None]


def spectrum_of(x, sizes=(7000,)):
    sums, at, k = SpectrumSums.fitting(len(x), DT), 0, 0
    while at < len(x):
        sums.add(x[at : at + sizes[k % len(sizes)]])
        at, k = at + sizes[k % len(sizes)], k + 1
    return sums.result()


def test_white_noise_has_its_density():
    """0.1 per sample at 1 kHz: 2 * 0.01 / 1000 per Hz, one-sided; the mean over 7500 bins is known to 0.5 %."""
    s = spectrum_of(values(lines=()))
    assert s.density[5:-5].mean() == pytest.approx(2 * 0.01 * DT, rel=0.02)
    assert np.median(s.floor) == pytest.approx(2 * 0.01 * DT, rel=0.05)
    assert s.mean[0] == pytest.approx(0.3, abs=4 * 0.1 / np.sqrt(60_000))
    assert s.averages == 7  # four stretches, overlapping by half


def test_total_power_is_the_variance():
    x = values(noise=0.0, lines=((12.34, 0.5),), mean=0.0)
    s = spectrum_of(x)
    assert s.density.sum() * s.resolution == pytest.approx(0.125, rel=1e-3)


@pytest.mark.parametrize("frequency", [10.0, 10.021, 10.0333])
def test_lines_have_their_size_wherever_they_fall_between_bins(frequency):
    s = spectrum_of(values(lines=((frequency, 0.05),)))
    line = next(line for line in find_lines(s, 0, KNOWN) if line.name == "spin")
    assert line.frequency == pytest.approx(frequency, abs=s.resolution / 2)
    assert line.amplitude == pytest.approx(0.05, rel=0.06)  # noise of 0.1 sqrt(2/60000) = 6e-4 in each of five bins
    assert line.loudness > 10


def test_lines_are_named_or_said_to_be_nobodys():
    found = find_lines(spectrum_of(values()), 0, KNOWN)
    assert [line.name for line in found] == ["mean", "spin", ""]
    assert found[0].amplitude == pytest.approx(0.3, abs=2e-3)
    assert found[2].frequency == pytest.approx(33.0, abs=0.05)


def test_noise_alone_has_no_lines():
    for seed in range(20):
        assert len(find_lines(spectrum_of(values(lines=(), seed=seed)), 0, KNOWN)) == 1


def test_pieces_make_no_difference():
    x = values()
    whole, pieces = spectrum_of(x, (60_000,)), spectrum_of(x, (1, 999, 20_000))
    np.testing.assert_allclose(whole.density, pieces.density, rtol=1e-10, atol=1e-18)


def test_too_short_for_a_stretch_has_no_spectrum():
    sums = SpectrumSums(DT, 64)
    sums.add(np.zeros((63, 1)))
    assert sums.result() is None


def test_frequencies_fold():
    assert folded(10.0, DT) == pytest.approx(10.0)
    assert folded(990.0, DT) == pytest.approx(10.0)
    assert folded(18.0, 0.05) == pytest.approx(2.0)
