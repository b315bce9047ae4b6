"""The published closed form: its amplitudes, its own errors, its scatter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.calibrate.centrifuge.closed_form import COUNT, pick, published
from sagnac.errors import DataError, InputError
from sagnac.rigs.centrifuge import Arm, series
from sagnac.rigs.turntable import Site
from sagnac.sensors.series import response

G = 9.80665
SITE = Site(math.radians(29.89), G, 7.292e-5)
RATE = math.pi
ARM = Arm(10 * G / RATE**2)
GAMMAS = np.array([0.0, math.pi / 2, math.pi])
# [XU18], the accelerometer of the worked example, in g
TRUTH = {"bias": 6.310e-3, "scale_error": -1.1e-3, "k2": 1.2e-5, "k3": 3e-6, "kip": 5e-6, "zx": 0.001478, "zy": 0.00126}
POWERS = {"bias": 1, "k2": -1, "k3": -2, "kip": -1}
# methods, section 3: error of the closed form without noise, and its rms error with 2.5e-5 g a sample over one turn
TRUNCATION = {
    "bias": 3.4e-7,
    "scale_error": -8.6e-9,
    "k2": -2.5e-8,
    "k3": 1.9e-10,
    "kip": 3.0e-8,
    "zx": -1.5e-6,
    "zy": -1.0e-6,
}
RMSE = {
    "bias": 5.4e-7,
    "scale_error": 4.0e-7,
    "k2": 3.1e-8,
    "k3": 3.3e-9,
    "kip": 3.4e-8,
    "zx": 1.55e-6,
    "zy": 1.03e-6,
}


def case(letter, truth=TRUTH, rate=RATE):
    """Closed form, parameters in SI and their names, exact amplitudes."""
    a, a1 = rate**2 * ARM.radius, 2 * rate * ARM.radius * float(SITE.enu[2])
    linear = published(letter, a, a1, G)
    keys = (*linear.axis.terms, *linear.axis.misalignments)
    x = np.array([truth[k] * G ** POWERS.get(k, 0) for k in keys])
    settings = np.stack([np.zeros(3), np.zeros(3), GAMMAS], axis=1)
    felt = series(ARM, SITE, np.full(3, rate), settings)
    return linear, x, keys, response(linear.axis, x, felt.force, felt.rate).value


def in_g(keys):
    return np.array([G ** -POWERS.get(k, 0) for k in keys])


def test_amplitudes_are_the_published_ones():
    """Methods, section 3, noise-free harmonics in g to the digits given."""
    _, _, _, k = case("z")
    k = k / G
    named = {"k0": 0, "k1c": 1, "k1s": 2, "k2c": 3, "k2s": 4, "k3c": 5}
    expected = [
        {"k0": 1.0052253, "k1s": -0.0122348, "k1c": -0.0147646},
        {"k0": 0.0054330, "k1s": -0.0125898, "k1c": -9.9914809, "k2s": 2.515e-4, "k2c": 5.987e-4, "k3c": -7.500e-4},
        {"k0": -0.9925807, "k1s": -0.0129383, "k1c": 0.0147639},
    ]
    for i, row in enumerate(expected):
        for name, value in row.items():
            # half a unit of the last digit printed, which is better than 1e-6 where seven of them are
            digit = 5e-8 if name in ("k0", "k1s", "k1c") else 5.1e-8
            assert k[i, named[name]] == pytest.approx(value, rel=0, abs=digit), (i, name)


def test_its_errors_without_noise_are_the_published_ones():
    linear, x, keys, k = case("z")
    error = dict(zip(keys, (linear(k) - x) * in_g(keys), strict=True))
    for name, value in TRUNCATION.items():
        assert error[name] == pytest.approx(value, rel=0.035), name  # two digits are given


@pytest.mark.parametrize("letter", ["x", "y"])
def test_counterparts_for_x_and_y_are_of_the_same_order(letter):
    """With the parameters of z, what the first order leaves out of x and y is no more than 2e-6 rad, 1e-7 g and 1e-8."""
    truth = {**TRUTH, "yx": 0.001478}
    linear, x, keys, k = case(letter, truth)
    error = dict(zip(keys, np.abs(linear(k) - x) * in_g(keys), strict=True))
    limits = {"bias": 1e-7, "scale_error": 1.1e-8, "k2": 1e-8, "k3": 1e-9, "kip": 1e-8, "yx": 2e-6}
    assert all(error[key] < limits[key] for key in keys), error


@pytest.mark.parametrize("letter", ["x", "y", "z"])
@pytest.mark.parametrize("rate", [RATE, -RATE, 2 * RATE])
def test_exact_in_the_limit_of_small_errors(letter, rate):
    """With all parameters a thousandth of those above the errors of second order shrink by a million."""
    small = {key: 1e-3 * value for key, value in {**TRUTH, "yx": 0.001478}.items()}
    linear, x, _, k = case(letter, small, rate)
    np.testing.assert_allclose((linear(k) - x) / np.abs(x), 0.0, atol=2e-2 if letter == "y" else 5e-3)


def test_its_rms_error_is_the_published_one():
    """Bias and scatter together, exactly; the methods' figures are of a campaign, which knows its rms to some 4 %."""
    linear, x, keys, k = case("z")
    size = 2.5e-5 * G * np.sqrt(np.tile([1.0] + [2.0] * (COUNT - 1), 3) / 2000)
    scatter = np.linalg.norm(linear.matrix * size, axis=1)
    rms = dict(zip(keys, np.hypot(linear(k) - x, scatter) * in_g(keys), strict=True))
    for name, value in RMSE.items():
        assert rms[name] == pytest.approx(value, rel=0.045), name


def test_segments_of_the_fastest_speed_are_taken():
    settings = np.zeros((7, 3))
    settings[:, 2] = [*GAMMAS, *GAMMAS, math.pi / 4]
    rates = np.array([1.0, 1.0, 1.0, -2.0, -2.0, -2.0, -2.0])
    assert pick(rates, settings, counter_rotating=True) == [[3], [4], [5]]
    assert pick(rates[:3], settings[:3], counter_rotating=True) == [[0], [1], [2]]


def test_other_sets_are_refused():
    settings = np.zeros((3, 3))
    settings[:, 2] = [0.0, math.pi / 4, math.pi]
    with pytest.raises(DataError, match="gamma = 0, 90 and 180 deg at one arm rate"):
        pick(np.ones(3), settings, counter_rotating=True)
    settings[:, 2] = GAMMAS
    with pytest.raises(DataError, match="alpha = beta = 0"):
        pick(np.ones(3), settings + [0.1, 0.0, 0.0], counter_rotating=True)
    with pytest.raises(InputError, match="counter-rotating"):
        pick(np.ones(3), settings, counter_rotating=False)
