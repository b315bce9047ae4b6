"""The Cramer-Rao bound against dense Fisher information of short records."""

import math

import numpy as np
import pytest
from scipy.linalg import toeplitz

from sagnac.noise.identification.bound import information
from sagnac.noise.identification.terms import lag_covariance

CASES = [
    ({"white": 1.0, "walk": 1e-3}, 0.0, 1e-9),
    ({"white": 1.0, "ramp": 1e-7}, 0.0, 1e-4),
    ({"white": 1.0, "instability": 0.05, "ramp": 1e-7}, 0.0, 0.01),
    ({"quantisation": 0.5, "white": 1.0, "instability": 0.05, "walk": 1e-3}, 0.0, 0.04),
    ({"white": 1.0, "markov": 0.3}, 0.02, 0.04),
]


def dense(levels, samples, decay):
    """Of the differences of neighbouring samples, whose covariance is exact."""
    size = samples - 1
    one, lag = np.ones(size), np.arange(float(size))

    def covariance(key, a=decay):
        return toeplitz(lag_covariance(key, "allan", one, one, lag, a))

    names = [key for key in levels if key != "ramp"]
    parts = [levels[key] * covariance(key) for key in names]
    whole = np.sum(parts, axis=0)
    if "markov" in levels:
        up, down = (covariance("markov", decay * math.exp(h)) for h in (1e-5, -1e-5))
        parts.append(levels["markov"] * (up - down) / 2e-5)
        names.append("markov_time")
    told = [np.linalg.solve(whole, p) for p in parts]
    out = np.array([[0.5 * np.sum(a * b.T) for b in told] for a in told])
    if "ramp" in levels:
        wide = np.zeros((len(names) + 1,) * 2)
        wide[:-1, :-1], wide[-1, -1] = out, 0.25 * levels["ramp"] * one @ np.linalg.solve(whole, one)
        names, out = [*names, "ramp"], wide
    return names, out


@pytest.mark.parametrize(("levels", "decay", "tolerance"), CASES)
def test_bound_is_that_of_the_dense_covariance(levels, decay, tolerance):
    names, exact = dense(levels, 1500, decay)
    found_names, found = information(levels, 1500, decay)
    assert list(found_names) == names
    spread, expected = (np.sqrt(np.diag(np.linalg.inv(i))) for i in (found, exact))
    np.testing.assert_allclose(spread, expected, rtol=tolerance)


def test_long_records_are_summed_in_panels():
    # white noise of n samples: the variance of the logarithm of its level is 2 / (n - 1)
    names, found = information({"white": 3.0}, 10**8)
    assert names == ("white",)
    assert found[0, 0] == pytest.approx(0.5 * (10**8 - 1), rel=1e-12)
    levels = {"quantisation": 0.5, "white": 1.0, "instability": 1e-3, "walk": 1e-9}
    _, short = information(levels, 200_001)
    j = np.arange(1.0, 200_001.0)
    from sagnac.noise.identification.terms import sample_spectrum

    parts = np.stack([levels[k] * sample_spectrum(k, np.pi * j / 200_001) for k in levels])
    np.testing.assert_allclose(short, 0.5 * (parts / parts.sum(axis=0)) @ (parts / parts.sum(axis=0)).T, rtol=1e-9)
