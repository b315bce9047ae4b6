"""The terms: every variance and covariance against brute force, and against the closed forms of IEEE Std 952."""

import math

import numpy as np
import pytest

from sagnac import units
from sagnac.errors import InputError
from sagnac.noise.identification import terms
from sagnac.noise.identification.terms import FLOOR, LINEAR, TERMS, lag_covariance, sample_spectrum, variance

DIFFERENCES = {"allan": np.array([1.0, -2.0, 1.0]), "hadamard": np.array([1.0, -3.0, 3.0, -1.0])}
PAIRS = [(1, 1), (1, 4), (3, 7), (8, 8), (8, 64)]


def weights(kind, m):
    """Of the samples in one difference of their means over m."""
    points = np.zeros(m * (len(DIFFERENCES[kind]) - 1) + 1)
    points[::m] = DIFFERENCES[kind]
    return np.cumsum(points)[:-1] / m


def samples_apart(kind, m1, m2, middles):
    """Distances of all samples of two differences whose middles lie so far apart, and the products of their weights."""
    one, two = weights(kind, m1), weights(kind, m2)
    begin = (len(one) - 1) / 2 - (len(two) - 1) / 2 + middles
    apart = np.arange(len(two))[None] + begin - np.arange(len(one))[:, None]
    return apart, one[:, None] * two[None]


def middles(kind, m1, m2):
    offset = 0.0 if kind == "allan" else (1.5 * (m2 - m1)) % 1.0
    return offset + np.array([0.0, 1.0, 5.0, 20.0, 100.0])


def at(key, kind, m1, m2, u, decay=0.0):
    return lag_covariance(key, kind, np.array([float(m1)]), np.array([float(m2)]), np.array([float(u)]), decay)[0]


@pytest.mark.parametrize("kind", ["allan", "hadamard"])
@pytest.mark.parametrize(("m1", "m2"), PAIRS)
@pytest.mark.parametrize("decay", [1e-3, 0.1, 2.0])
def test_markov_covariance_is_that_of_its_samples(kind, m1, m2, decay):
    size = math.sqrt(at("markov", kind, m1, m1, 0.0, decay) * at("markov", kind, m2, m2, 0.0, decay))
    for u in middles(kind, m1, m2):
        apart, products = samples_apart(kind, m1, m2, u)
        brute = np.sum(products * np.exp(-decay * np.abs(apart)))
        assert at("markov", kind, m1, m2, u, decay) == pytest.approx(brute, abs=1e-11 * size)


# autocovariances of the samples of level one; a random walk up to a constant and a slope, which differences take away: mean of
# -|t - s| / 2 over both intervals
SAMPLES = {
    "white": lambda k: (k == 0).astype(float),
    "quantisation": lambda k: 2.0 * (k == 0) - (np.abs(k) == 1),
    "walk": lambda k: -0.5 * np.abs(k) - (k == 0) / 6.0,
}


@pytest.mark.parametrize("kind", ["allan", "hadamard"])
@pytest.mark.parametrize(("m1", "m2"), PAIRS)
@pytest.mark.parametrize("key", SAMPLES)
def test_covariance_is_that_of_the_samples(key, kind, m1, m2):
    for u in middles(kind, m1, m2):
        apart, products = samples_apart(kind, m1, m2, u)
        brute = np.sum(products * SAMPLES[key](np.round(apart)))
        assert at(key, kind, m1, m2, u) == pytest.approx(brute, abs=1e-11 * max(1.0, m2))


@pytest.mark.parametrize("key", ["quantisation", "white", "instability", "walk", "markov"])
@pytest.mark.parametrize("m", [1, 4])
def test_variance_is_the_spectrum_through_the_filter_of_the_difference(key, m):
    omega = np.pi * (np.arange(200_000) + 0.5) / 200_000
    filtered = 2.0 * np.sin(0.5 * omega * m) ** 4 / (m * np.sin(0.5 * omega)) ** 2
    spectrum = sample_spectrum(key, omega, 0.05)
    assert np.mean(spectrum * filtered) == pytest.approx(variance(key, np.array([m]), decay=0.05)[0], rel=1e-8)


def test_variances_are_those_of_ieee_952_in_the_long_run():
    # annex C: 3 Q^2/tau^2, N^2/tau, (2 ln 2/pi) B^2, K^2 tau/3, R^2 tau^2/2
    interval, tau = 0.01, np.array([1.0, 10.0, 1000.0])
    expected = {
        "quantisation": 3.0 / tau**2,
        "white": 1.0 / tau,
        "instability": FLOOR**2 * np.ones(3),
        "walk": tau / 3.0,
        "ramp": tau**2 / 2.0,
    }
    for key in LINEAR:
        found = terms.level(key, 1.0, interval) * variance(key, tau / interval)
        np.testing.assert_allclose(found, expected[key], rtol=1e-4, err_msg=key)


def test_walk_is_that_of_ieee_952_at_every_averaging_time():
    # samples are means over their intervals: K^2 tau/3 holds from the first on
    np.testing.assert_allclose(variance("walk", np.array([1, 2, 3, 1000])), np.array([1, 2, 3, 1000]) / 3.0, rtol=1e-14)


def test_markov_peaks_where_ieee_952_says():
    # annex C.1.7: the peak is 0.437 q sqrt(T) at tau = 1.89 T; with sigma^2 = q^2 T / 2 it is 0.618 sigma
    m = np.linspace(1000.0, 3000.0, 2001)
    deviation = np.sqrt(variance("markov", m, decay=1e-3))
    assert m[np.argmax(deviation)] == pytest.approx(1893.0, abs=3.0)
    assert deviation.max() == pytest.approx(0.437 * math.sqrt(2.0), rel=0.0005 / 0.437)  # three digits are given


@pytest.mark.parametrize("decay", [1e-6, 1e-4, 0.01, 0.9, 1.1, 3.0])
def test_slope_of_markov_is_its_derivative(decay):
    m, h = 2.0 ** np.arange(0, 20, 3), 1e-3
    up, down = (variance("markov", m, decay=decay * math.exp(s)) for s in (h, -h))
    size = variance("markov", m, decay=decay)
    np.testing.assert_allclose(terms.markov_slope(m, decay) / size, (up - down) / (2.0 * h) / size, atol=1e-6)


def test_no_digits_are_lost_over_a_hundred_million_samples():
    m = np.array([1.0, 1.0, 1e3])
    far = lag_covariance("instability", "allan", m, np.array([1e6, 1e6, 1e6]), np.array([3e7, 9e7, 9e7]))
    # fourth derivative of h^2 ln|h| / (2 pi), times m1 m2
    np.testing.assert_allclose(far, m * 1e6 / (np.pi * -(np.array([3e7, 9e7, 9e7]) ** 2)), rtol=3e-3)
    slow = lag_covariance("markov", "allan", m[:1], np.array([1e6]), np.array([3e7]), 1e-9)
    assert abs(slow[0]) < 1e-6 * variance("markov", np.array([1e6]), decay=1e-9)[0]
    assert abs(lag_covariance("walk", "allan", m[:1], np.array([1e6]), np.array([9e7]))[0]) < 1e-6


def test_hadamard_does_not_see_a_ramp():
    assert variance("ramp", np.array([1.0, 100.0]), "hadamard").tolist() == [0.0, 0.0]


@pytest.mark.parametrize("key", LINEAR)
def test_level_and_value_are_inverse(key):
    assert terms.value(key, terms.level(key, 3e-7, 0.005), 0.005) == pytest.approx(3e-7, rel=1e-14)


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
@pytest.mark.parametrize("key", [*TERMS, "markov_time"])
def test_units_convert(key, sensor):
    inside, sheet = terms.units(key, sensor)
    assert units.convert(1.0, inside, sheet) > 0.0


def test_units_are_those_of_data_sheets():
    # 1 deg/sqrt(h) = 1/60 deg/s/sqrt(Hz)
    assert units.convert(math.radians(1.0) / 60.0, *terms.units("white", "gyro")) == pytest.approx(1.0)
    assert units.convert(9.80665e-6, *terms.units("instability", "accel")) == pytest.approx(1.0)


def test_density_is_one_sided():
    # white noise of N per sqrt(Hz), two-sided: 2 N^2
    found = terms.density("white", 3.0, np.array([0.1, 10.0]), 0.01)
    np.testing.assert_allclose(found, 18.0)
    flicker = terms.density("instability", 2.0, np.array([1e-4]), 0.01)
    assert flicker[0] == pytest.approx(4.0 / (np.pi * 1e-4), rel=1e-4)


def test_unknown_terms_are_named():
    with pytest.raises(InputError, match="'pink': there are quantisation, white"):
        terms.second_difference("pink", np.ones(1), np.ones(1))
    with pytest.raises(InputError, match="'ramp' has no spectrum"):
        sample_spectrum("ramp", np.ones(1))


@pytest.mark.parametrize("key", ["quantisation", "white", "instability", "walk", "markov"])
def test_modified_variance_is_the_spectrum_through_its_filter(key):
    # IEEE Std 1139 annex: transfer 2 sin^6(pi f tau) / (m^4 sin^2(pi f tau0)) of the phase, over sin^2 once more for the rate
    decay = 0.05 if key == "markov" else 0.0
    factors = np.array([1.0, 2.0, 3.0, 9.0, 40.0])
    omega = (np.arange(200_000) + 0.5) * np.pi / 200_000
    spectrum = sample_spectrum(key, omega, decay)
    half = np.sin(0.5 * omega)
    expected = [np.mean(spectrum * 2.0 * np.sin(0.5 * m * omega) ** 6 / (m**4 * half**4)) for m in factors]
    assert variance(key, factors, "modified", decay) == pytest.approx(expected, rel=1e-5)


def test_modified_variance_at_long_averaging_times():
    # NIST SP 1065, section 5.5 and table 5: ratios to the Allan variance of white, flicker and random walk frequency noise
    m = np.array([1.0, 5000.0])
    for key, ratio in (("white", 0.5), ("instability", 0.6746), ("walk", 0.825), ("ramp", 1.0)):
        own = variance(key, m, "modified") / variance(key, m)
        assert own == pytest.approx([1.0, ratio], rel=1e-4)
    between = variance("white", np.array([2.0, 2.5, 3.0]), "modified")
    assert between[0] > between[1] > between[2]
