"""Degrees of freedom against brute force, against the published approximation and by simulation; kinds of noise told apart."""

from __future__ import annotations

import allantools.ci
import numpy as np
import pytest

from sagnac.errors import DataError, InputError
from sagnac.noise.curves.allan import KINDS, Pyramid, largest_step, octaves, pooled, variances
from sagnac.noise.curves.confidence import degrees_of_freedom, edf, exponents, intervals

LOWEST = {"allan": -2, "modified": -2, "hadamard": -4}
EVERY = [(kind, alpha) for kind in KINDS for alpha in range(2, LOWEST[kind] - 1, -1)]


def noise_of(exponent, runs, samples, rng):
    """Rates whose spectrum goes with (2 sin(pi f))^exponent (Kasdin 1995), one run a column."""
    steps = np.arange(1, samples)
    response = np.concatenate([[1.0], np.cumprod((steps - 1 - exponent / 2) / steps)])
    white = np.fft.rfft(rng.normal(size=(runs, samples)), 2 * samples)
    return np.fft.irfft(white * np.fft.rfft(response, 2 * samples), 2 * samples)[:, :samples].T


def by_integral(kind, alpha, m, n, step=1):
    """2 E^2 / var with the correlations from the spectrum, at so many frequencies that the step does not matter."""
    span = 2 if kind == "allan" else 3
    size = 1 << int(np.ceil(np.log2(64 * max(n, 64))))
    f = (np.arange(size // 2) + 0.5) / size
    power = (2 * np.sin(np.pi * f)) ** (alpha - 2.0) * (2 * np.sin(np.pi * m * f)) ** (4 if kind != "hadamard" else 6)
    if kind == "modified":
        power *= (np.sin(np.pi * m * f) / (m * np.sin(np.pi * f))) ** 2
    terms = (n + (2 if kind == "modified" else 1) - span * m - 1) // step + 1
    all_of_it = np.concatenate([power, np.zeros(size // 2)])
    lags = np.real(np.fft.ifft(all_of_it) * np.exp(1j * np.pi * np.arange(size) / size))[: terms * step : step]
    return (terms * lags[0]) ** 2 / (terms * lags[0] ** 2 + 2 * ((terms - np.arange(1, terms)) * lags[1:] ** 2).sum())


@pytest.mark.parametrize(("kind", "alpha"), EVERY)
def test_degrees_are_those_of_the_correlations_that_the_spectrum_has(kind, alpha):
    for m in (1, 2, 3, 8, 60, 700):
        for share in (3.2, 4, 7, 40):
            n = round(share * m) + 2
            if n < 20_000:
                # spectra of odd exponents have a corner at zero, and correlations that die out slowly: both sides cut them
                assert edf(kind, alpha, m, n) == pytest.approx(
                    by_integral(kind, alpha, m, n), rel=6e-4 if alpha % 2 else 1e-9
                )
    for m, n in ((16, 300), (64, 2000)):
        assert edf(kind, alpha, m, n, m // 8) == pytest.approx(by_integral(kind, alpha, m, n, m // 8), rel=6e-4)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("alpha", [2, 0, -2, -4])
def test_degrees_are_those_of_the_covariance_matrix(kind, alpha):
    # all differences as a matrix on independent numbers: E is the trace of its square, var twice the sum of the squares of
    # the covariance of the differences
    if alpha < LOWEST[kind]:
        return
    for m, n in ((1, 12), (2, 13), (3, 20), (5, 33), (5, 16)):
        rates = np.eye(n + 40)
        if alpha == 2:
            rates = np.diff(rates, axis=0)
        for _ in range(-alpha // 2):
            rates = np.cumsum(rates, axis=0)
        rates = rates[-n:] - rates[-n] * (alpha < 0)  # levels, slopes: no difference sees what the start was
        if alpha == -4:
            rates = rates - np.arange(n)[:, None] * (rates[1] - rates[0])
        d = np.concatenate([np.zeros((1, rates.shape[1])), np.cumsum(rates, axis=0)])
        if kind == "modified":
            d = np.concatenate([0 * d[:1], np.cumsum(d, axis=0)])
        for _ in range(2 if kind == "allan" else 3):
            d = d[m:] - d[:-m]
        covariance = d @ d.T
        assert edf(kind, alpha, m, n) == pytest.approx(np.trace(covariance) ** 2 / (covariance**2).sum(), rel=1e-9)


# allantools raises there: exponent 2 of short records, exponent -4 of long ones
UNPUBLISHED = {("hadamard", 2, 100, 400), ("hadamard", -4, 100, 4000), ("hadamard", -4, 2000, 30_000)}


@pytest.mark.parametrize(("kind", "alpha"), EVERY)
def test_degrees_meet_those_of_greenhall_and_riley_at_long_averaging_times(kind, alpha):
    # they take noise in continuous time, so that short averaging times differ; at exponent 1 for ever (logarithm)
    for m, n in ((100, 400), (100, 4000), (2000, 30_000)):
        if (kind, alpha, m, n) in UNPUBLISHED:
            continue
        published = allantools.ci.edf_greenhall(
            alpha, 3 if kind == "hadamard" else 2, m, n + 1, overlapping=True, modified=kind == "modified"
        )
        far = 0.18 if alpha == 1 and kind != "modified" else 0.01
        assert edf(kind, alpha, m, n) == pytest.approx(published, rel=far)


def test_degrees_of_long_records_follow_the_law_of_scale():
    # at one share of the record, more samples in between tell nothing new, and lags chosen sparsely sum up as all do
    for kind, alpha in EVERY:
        if alpha <= 0 or (kind == "modified" and alpha < 2):
            for share in (4.5, 50):
                small, large = edf(kind, alpha, 400, round(400 * share)), edf(kind, alpha, 10**6, round(10**6 * share))
                assert large == pytest.approx(small, rel=6e-3)


def test_between_whole_exponents_the_degrees_lie_between():
    ends = edf("allan", 0, 10, 1000), edf("allan", -1, 10, 1000)
    assert edf("allan", -0.5, 10, 1000) == pytest.approx(np.sqrt(ends[0] * ends[1]))


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("kind", "alpha"), [("allan", 0), ("allan", -1), ("allan", -2), ("modified", 0), ("modified", 2), ("hadamard", -2)]
)
def test_intervals_contain_the_truth_as_often_as_they_say(kind, alpha):
    # 2000 logs of 1000 samples; the truth is their mean. Of 2000, 95 % are within 94 and 96 % with two sigma: chi-square is
    # an approximation, which at the longest averaging times adds to that
    y = noise_of(alpha, 2000, 1000 + 200, np.random.default_rng(0))[200:]
    found = variances(y, 1.0, kind=kind)
    truth = np.sqrt(found.variance.mean(axis=1))[:, None]
    low, high = intervals(found, 0.95, alpha)
    covered = ((low < truth) & (truth < high)).mean(axis=1)
    assert covered.min() > 0.935
    assert covered.max() < 0.97
    spread = 2.0 * found.variance.mean(axis=1) ** 2 / found.variance.var(axis=1)
    assert spread == pytest.approx(degrees_of_freedom(found, alpha)[:, 0], rel=0.12)


@pytest.mark.statistical
@pytest.mark.parametrize("alpha", [0, -1, -2])
def test_intervals_with_exponents_by_slope_hold_too(alpha):
    # somewhat less often than with the exponent known: a slope goes with the errors of the variances
    y = noise_of(alpha, 4000, 2200, np.random.default_rng(1))[200:]
    found = variances(y, 1.0)
    truth = np.sqrt(found.variance.mean(axis=1))[:, None]
    few = variances(y[:, :800], 1.0)
    low, high = intervals(few)
    covered = ((low < truth) & (truth < high)).mean(axis=1)
    assert covered.min() > 0.90
    assert covered.max() < 0.98


def test_intervals_are_those_of_chi_square():
    found = variances(np.random.default_rng(2).normal(size=(1000, 2)), 1.0, [1, 30])
    low, high = intervals(found, 0.9, 0)
    for i, m in enumerate((1, 30)):
        for a in range(2):
            expected = allantools.ci.confidence_interval(found.deviation[i, a], edf("allan", 0, m, 1000), 0.9)
            assert (low[i, a], high[i, a]) == pytest.approx(expected, rel=1e-6)


def test_degrees_of_stretches_add_up_and_the_pyramid_has_its_own():
    y = np.random.default_rng(3).normal(size=(3000, 1))
    a, b = variances(y[:1000], 1.0), variances(y[1000:], 1.0)
    both = degrees_of_freedom(pooled([a, b]), 0)[:, 0]
    for i, m in enumerate(octaves(2000).tolist()):
        alone = edf("allan", 0, m, 2000)
        if m > 250:  # the first stretch was not asked for these
            assert both[i] == pytest.approx(alone)
        else:
            assert alone < both[i] < edf("allan", 0, m, 3000) * 1.01
    running = Pyramid(1.0, 1)
    running.add(y)
    found = degrees_of_freedom(running.result(), 0)[:, 0]
    assert found == pytest.approx([edf("allan", 0, m, 3000, largest_step(m)) for m in octaves(3000).tolist()])


def test_exponents_by_slope():
    y = np.hstack([noise_of(alpha, 1, 200_000, np.random.default_rng(4)) for alpha in (2, 0, -1, -2)])
    few = [1, 2, 4, 8, 16, 32, 64, 128]
    for kind in KINDS:
        found = exponents(variances(y, 1.0, few, kind))[3:]
        expected = np.array([2.0 if kind == "modified" else 1.0, 0.0, -1.0, -2.0])
        assert np.abs(found - expected).max() < 0.2
    assert exponents(variances(y, 1.0, [8])).tolist() == [[0.0] * 4]


def test_what_cannot_be_is_named():
    for arguments, words in (
        (("allen", 0, 1, 10), "no variance of kind 'allen'"),
        (("allan", -3, 1, 10), "Exponent -3: the allan variance is told for -2 to 2"),
        (("allan", 2.5, 1, 10), "Exponent 2.5"),
        (("allan", float("nan"), 1, 10), "Exponent nan"),
        (("allan", 0, 6, 10), "averaging time of 6 samples .* record of 10"),
        (("allan", 0, 6, 100, 4), "in steps of 4"),
        (("allan", 0, 0, 10), "averaging time of 0"),
    ):
        with pytest.raises(InputError, match=words):
            edf(*arguments)
    found = variances(np.random.default_rng(6).normal(size=100), 1.0)
    for level in (0.0, 1.0, 95.0):
        with pytest.raises(InputError, match="Level"):
            intervals(found, level)
    with pytest.raises(DataError, match="axis 1 at 4 s is zero: its samples repeat a pattern"):
        exponents(variances(np.tile([1.0, -1.0], 50), 2.0))
