"""Lines in a spectrum: named at their frequency with their amplitude, and none in noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.noise.curves.allan import octaves, variances
from sagnac.noise.curves.spectrum import spectrum
from sagnac.noise.findings.lines import lines_in
from sagnac.noise.page import density_of
from sagnac.simulate.noise import AxisNoise, NoiseModel

DT, N = 0.005, 60_000


def found(values, terms):
    density = spectrum(values, DT)
    expected = density_of(terms, density.frequency, DT)
    return lines_in(density, expected, variances(values, DT, octaves(values.size, per_octave=2)))


def noise(seed, model):
    values = np.zeros(N)
    AxisNoise(model, DT, seed, (0,)).add(values)
    return values


@pytest.mark.parametrize("frequency", [0.9, 7.3, 50.0, 88.8])
def test_a_sine_is_a_line(frequency):
    values = noise(1, NoiseModel(density=1.0)) + 3.0 * np.sin(2 * math.pi * frequency * DT * np.arange(N) + 0.3)
    lines = found(values, {"white": 1.0})
    assert len(lines) == 1
    line = lines[0]
    assert line.narrow
    assert line.frequency == pytest.approx(frequency, rel=0.01)
    assert line.amplitude == pytest.approx(3.0, rel=0.1)
    told = line.told("gyro_x", "deg/h", 2.0)
    assert f"line at {line.frequency:.4g} Hz" in told.text
    assert told.size == line.amplitude


def test_its_share_is_what_the_variance_says():
    quiet = noise(2, NoiseModel(density=1.0))
    sine = 4.0 * np.sin(2 * math.pi * 1.7 * DT * np.arange(N))
    line = found(quiet + sine, {"white": 1.0})[0]
    factors = octaves(N, per_octave=2)
    both, alone = (variances(v, DT, factors).variance[:, 0] for v in (quiet + sine, quiet))
    assert line.share == pytest.approx(float((1.0 - alone / both).max()), abs=0.05)
    assert line.told("gyro_x", "deg/h", 1.0).spoils == (line.share > 0.3)


def test_sway_is_a_broad_peak():
    rng = np.random.default_rng(3)
    frequency = np.fft.rfftfreq(N, DT)
    band = (frequency > 1.7) & (frequency < 2.7)
    sway = np.fft.irfft(np.where(band, rng.normal(size=band.size) + 1j * rng.normal(size=band.size), 0.0), N)
    sway *= 5.0 / sway.std()
    lines = found(noise(3, NoiseModel(density=1.0)) + sway, {"white": 1.0})
    broad = lines[0]
    assert not broad.narrow
    assert broad.low == pytest.approx(1.7, abs=0.2)
    assert broad.high == pytest.approx(2.7, abs=0.2)
    assert "broad peak" in broad.told("accel_x", "ug", 1.0).text
    assert broad.amplitude / math.sqrt(2) == pytest.approx(5.0, rel=0.1)


@pytest.mark.statistical
def test_noise_has_no_lines():
    """Of 150 clean axes at most one shows a line: six axes a log, one log in a hundred would be 0.25."""
    alarms = 0
    for seed in range(75):
        alarms += bool(found(noise(100 + seed, NoiseModel(density=1.0)), {"white": 1.0}))
        steep = noise(200 + seed, NoiseModel(density=0.1, walk=1.0))
        alarms += bool(found(steep, {"white": 0.1, "walk": 1.0}))
    assert alarms <= 1
