"""Variances against published values, against allantools and against the plain twin; the pyramid against the exact ones."""

from __future__ import annotations

import tracemalloc

import allantools
import numpy as np
import pytest

import plain_allan
from sagnac.errors import DataError, InputError
from sagnac.noise.curves.allan import KINDS, Pyramid, Variances, largest_step, octaves, pooled, variances
from sagnac.noise.curves.confidence import edf

PEERS = {"allan": allantools.oadev, "modified": allantools.mdev, "hadamard": allantools.ohdev}


def riley():
    """The 1000 frequencies of NIST SP 1065, section 12.4: n[i+1] = 16807 n[i] mod 2147483647."""
    n = [1234567890]
    for _ in range(999):
        n.append(16807 * n[-1] % 2147483647)
    return np.array(n) / 2147483647


NINE = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])
"""NBS Monograph 140, annex 8.E, in NIST SP 1065, table 29."""


# ------------------------------------------------------------------------------------------------- published values


@pytest.mark.parametrize(
    ("kind", "published"),
    [
        ("allan", (2.922319e-01, 9.159953e-02, 3.241343e-02)),
        ("modified", (2.922319e-01, 6.172376e-02, 2.170921e-02)),
        ("hadamard", (2.943883e-01, 9.581083e-02, 3.237638e-02)),
    ],
)
def test_thousand_points_of_the_handbook(kind, published):
    # NIST SP 1065, table 31, averaging factors 1, 10 and 100: overlapping Allan, modified Allan, overlapping Hadamard
    found = variances(riley(), 1.0, [1, 10, 100], kind)
    assert found.deviation[:, 0] == pytest.approx(published, rel=3e-7)
    assert found.tau.tolist() == [1.0, 10.0, 100.0]


@pytest.mark.parametrize(
    ("kind", "published"),
    [("allan", (2.922319e-01, 9.965736e-02, 3.897804e-02)), ("hadamard", (2.943883e-01, 1.052754e-01, 3.910860e-02))],
)
def test_thousand_points_without_overlap(kind, published):
    # NIST SP 1065, table 31: the normal deviations are the overlapping ones at factor 1 of the averages
    for m, value in zip((1, 10, 100), published, strict=True):
        means = riley().reshape(-1, m).mean(axis=1)
        assert variances(means, float(m), [1], kind).deviation[0, 0] == pytest.approx(value, rel=3e-7)


@pytest.mark.parametrize(
    ("kind", "published"),
    [("allan", (91.22945, 85.95287)), ("modified", (91.22945, 74.78849)), ("hadamard", (70.80607, 85.61487))],
)
def test_nine_points_of_the_handbook(kind, published):
    # NIST SP 1065, table 30, averaging factors 1 and 2, overlapping
    assert variances(NINE, 1.0, [1, 2], kind).deviation[:, 0] == pytest.approx(published, rel=1e-7)


# ------------------------------------------------------------------------------------------------- the exact variances


@pytest.mark.parametrize("kind", KINDS)
def test_equal_to_allantools(kind):
    rng = np.random.default_rng(0)
    y = rng.normal(size=(30_000, 3)) + 9.8
    y[:, 1] = 1e-3 * np.cumsum(y[:, 1] - 9.8)
    y[:, 2] = 9.8 + 1e-6 * (y[:, 2] - 9.8)
    longest = 30_000 // 4 if kind == "allan" else 30_000 // 6
    factors = np.unique(np.round(np.geomspace(1, longest, 40)).astype(int))
    found = variances(y, 0.01, factors, kind)
    for axis in range(3):
        tau, deviation, _, count = PEERS[kind](y[:, axis], rate=100.0, data_type="freq", taus=found.tau)
        assert np.array_equal(count, found.count)
        assert np.allclose(tau, found.tau)
        assert found.deviation[:, axis] == pytest.approx(deviation, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
def test_equal_to_the_plain_twin_for_any_type_and_layout(kind, dtype):
    y = np.round(1000.0 * np.random.default_rng(1).normal(size=(13_000, 4))).astype(dtype)
    plain = [plain_allan.variance(y[:, 1], m, kind) for m in (1, 2, 77, 4095, 4096)]
    for each in (y[:, 1], y[:, 1:2], np.asfortranarray(y)[:, 1], y[:, 1].tolist()):
        found = variances(each, 1.0, [1, 2, 4095, 4096, 77, 2], kind)
        assert found.factors.tolist() == [1, 2, 77, 4095, 4096]
        assert found.variance[:, 0] == pytest.approx(plain, rel=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_an_accelerometer_at_one_g_loses_no_digits(kind):
    # numbers of a few bits only, so that adding 9.8125 rounds nothing: both must come out the same to the last digits
    noise = np.round(np.random.default_rng(2).normal(size=200_000) * 64.0) * 2.0**-26
    quiet, loud = variances(noise, 0.01, kind=kind), variances(noise + 9.8125, 0.01, kind=kind)
    assert loud.variance == pytest.approx(quiet.variance, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_drift_of_ten_thousand_times_the_noise_loses_no_digits(kind):
    n = 300_000
    drifting = np.round(np.random.default_rng(3).normal(size=n) * 256.0) + 8.0 * np.arange(n)
    sums = np.concatenate(
        [[0], np.cumsum(drifting.astype(np.int64))]
    )  # whole numbers: wrapped around, differences stand
    sums = np.concatenate([[0], np.cumsum(sums)]) if kind == "modified" else sums
    found = variances(drifting, 1.0, [1, 7, 100, 5000], kind)
    for i, m in enumerate(found.factors.tolist()):
        d, scale = sums, {"allan": 2.0 * m**2, "modified": 2.0 * float(m) ** 4, "hadamard": 6.0 * m**2}[kind]
        for _ in range(2 if kind == "allan" else 3):
            d = d[m:] - d[:-m]
        assert found.variance[i, 0] == pytest.approx(float((d.astype(np.longdouble) ** 2).mean()) / scale, rel=1e-10)


def test_threads_do_not_change_a_bit(monkeypatch):
    y = np.random.default_rng(4).normal(size=(300_000, 2))
    several = variances(y, 1.0, kind="modified").variance
    monkeypatch.setattr("sagnac.noise.curves.allan.os.cpu_count", lambda: 1)
    assert np.array_equal(variances(y, 1.0, kind="modified").variance, several)


@pytest.mark.parametrize("kind", KINDS)
def test_the_exact_variance_takes_one_copy_of_the_samples(kind):
    y = np.random.default_rng(10).normal(size=(200_000, 6))
    variances(y[:5000], 1.0, kind=kind)  # what is loaded once
    tracemalloc.start()
    variances(y, 1.0, kind=kind)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.1 * y.nbytes


def test_the_pyramid_takes_no_more_for_a_longer_record():
    y = np.random.default_rng(11).normal(size=(1 << 18, 6))  # 12.6 MB
    running = Pyramid(1.0, 6)
    running.add(y)  # what is loaded once
    running = Pyramid(1.0, 6)
    tracemalloc.start()
    for _ in range(4):
        running.add(y)
    running.result()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400_000


def test_octaves_reach_as_far_as_the_span_goes_twice_into_the_record():
    assert octaves(64).tolist() == [1, 2, 4, 8, 16]
    assert octaves(63).tolist() == [1, 2, 4, 8]
    assert octaves(96, "hadamard").tolist() == [1, 2, 4, 8, 16]
    assert octaves(4).tolist() == [1]
    assert octaves(200, per_octave=2).tolist() == [1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45]


def test_pooled_is_the_mean_over_all_differences():
    y = np.random.default_rng(5).normal(size=(1000, 2))
    a, b = variances(y[:300], 0.5), variances(y[300:], 0.5)
    both = pooled([a, b])
    assert both.factors.tolist() == b.factors.tolist()
    assert both.samples == 1000
    again = pooled([both, variances(y[:100], 0.5)])
    assert [samples for samples, _ in again.stretches] == [300, 700, 100]
    assert np.array_equal(sum(counts for _, counts in again.stretches), again.count)
    for i, m in enumerate(both.factors.tolist()):
        parts = [p for p in (a, b) if m in p.factors.tolist()]
        total = sum(p.count[i] * p.variance[i] for p in parts)
        assert both.count[i] == sum(p.count[i] for p in parts)
        assert both.variance[i] == pytest.approx(total / both.count[i])


# --------------------------------------------------------------------------------------------------------- the pyramid


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("per_octave", [1, 3])
def test_the_pyramid_samples_the_differences_of_the_exact_variance(kind, per_octave):
    y = np.random.default_rng(6).normal(size=(50_001, 2)).cumsum(axis=0)
    running = Pyramid(0.1, 2, kind, per_octave=per_octave)
    running.add(y)
    found = running.result()
    assert found.method == "pyramid"
    for i, m in enumerate(found.factors.tolist()):
        step = largest_step(m)
        assert step == 1 or 8 * step <= m < 16 * step
        for axis in range(2):
            expected = plain_allan.variance(y[:, axis], m, kind, step)
            assert found.variance[i, axis] == pytest.approx(expected, rel=1e-9)
    few = found.factors < 16
    exact = variances(y, 0.1, found.factors, kind)
    assert np.array_equal(found.count[few], exact.count[few])
    assert np.array_equal(found.count, -(-exact.count // [largest_step(m) for m in found.factors.tolist()]))


@pytest.mark.parametrize("kind", KINDS)
def test_the_pyramid_does_not_depend_on_the_batches(kind):
    rng = np.random.default_rng(7)
    y = rng.normal(size=(70_000, 2))
    whole = Pyramid(1.0, 2, kind)
    whole.add(y)
    expected = whole.result()
    for sizes in ([1] * 30 + [4096, 4066, 20_000], rng.integers(0, 3000, 10)):
        running, at = Pyramid(1.0, 2, kind), 0
        for size in sizes:
            running.add(y[at : at + size])
            at += size
            if at > 10_000:
                running.result()  # asking changes nothing
        running.add(y[at:])
        assert running.samples == len(y)
        assert np.array_equal(running.result().variance, expected.variance)


def noise_of(exponent, runs, samples, rng):
    """Rates whose spectrum goes with (2 sin(pi f))^exponent (Kasdin 1995)."""
    steps = np.arange(1, samples)
    response = np.concatenate([[1.0], np.cumprod((steps - 1 - exponent / 2) / steps)])
    white = np.fft.rfft(rng.normal(size=(runs, samples)), 2 * samples)
    return np.fft.irfft(white * np.fft.rfft(response, 2 * samples), 2 * samples)[:, :samples]


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("exponent", "kind"),
    [(0, "allan"), (-1, "allan"), (-2, "allan"), (0, "modified"), (0, "hadamard"), (-2, "hadamard")],
)
def test_the_pyramid_is_as_efficient_as_the_exact_variance(exponent, kind):
    # efficiency: variance of the exact estimates over that of the pyramid's, of the same 1000 logs of white noise, bias
    # instability and random walk; the degrees of freedom promise 0.97 or more
    y = noise_of(exponent, 1000, 4096, np.random.default_rng(8)).T
    running = Pyramid(1.0, y.shape[1], kind)
    running.add(y)
    found = running.result()
    exact = variances(y, 1.0, found.factors, kind)
    assert found.variance.mean(axis=1) == pytest.approx(exact.variance.mean(axis=1), rel=0.02)
    efficiency = exact.variance.var(axis=1) / found.variance.var(axis=1)
    for m, value in zip(found.factors.tolist(), efficiency, strict=True):
        promised = edf(kind, exponent, m, 4096, largest_step(m)) / edf(kind, exponent, m, 4096)
        assert promised > 0.97
        assert value == pytest.approx(promised, abs=0.035 if m > 15 else 1e-9)


# ------------------------------------------------------------------------------------------------------- hostile input


GOOD = np.random.default_rng(9).normal(size=100)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"values": GOOD[:3]}, DataError, "3 samples are too few for the Allan variance: it takes 4"),
        ({"factors": [51]}, InputError, "averaging time of 51 samples .* record of 100.* 50 is the longest"),
        ({"factors": [0, 1]}, InputError, "whole numbers of samples, 1 or more"),
        ({"factors": [1.5]}, InputError, "whole numbers"),
        ({"factors": []}, InputError, "one at least"),
        ({"interval": 0.0}, InputError, "interval of the samples is 0.0 s"),
        ({"interval": float("nan")}, InputError, "interval of the samples is nan s"),
        ({"kind": "allen"}, InputError, "no variance of kind 'allen'. Kinds: allan, modified, hadamard"),
        ({"values": np.zeros((2, 2, 2))}, InputError, r"shape \(n,\) or \(n, axes\), and these have \(2, 2, 2\)"),
        ({"values": np.zeros((0, 3))}, InputError, r"these have \(0, 3\)"),
        ({"values": np.full(100, 9.8)}, DataError, "All samples of axis 1 of 1 are the same"),
        ({"values": np.stack([GOOD, 0 * GOOD], axis=1)}, DataError, "axis 2 of 2"),
        ({"values": np.where(np.arange(100) == 40, np.nan, GOOD)}, DataError, "Sample 41 of axis 1 is nan"),
        ({"values": np.where(np.arange(100) == 0, np.inf, GOOD)}, DataError, "Sample 1 of axis 1 is inf"),
    ],
)
def test_what_cannot_be_is_named(change, error, words):
    with pytest.raises(error, match=words):
        variances(**{"values": GOOD, "interval": 1.0, **change})


def test_the_pyramid_names_what_cannot_be():
    running = Pyramid(1.0, 2)
    with pytest.raises(DataError, match="0 samples are too few"):
        running.result()
    with pytest.raises(InputError, match="3 axes, and there were to be 2"):
        running.add(np.zeros((5, 3)))
    running.add(np.ones((10, 2)))
    with pytest.raises(DataError, match="Sample 12 of axis 2 is nan"):
        running.add([[1.0, 2.0], [1.0, np.nan]])
    assert running.samples == 10
    with pytest.raises(DataError, match="axis 1 of 2 are the same"):
        running.result()
    ramp = Pyramid(1.0, 1, "hadamard")
    ramp.add(np.arange(100.0))  # moves, though its third differences are nothing
    assert ramp.result().variance.max() < 1e-20
    for arguments in ((0.0, 1), (1.0, 0), (1.0, 1, "allen")):
        with pytest.raises(InputError):
            Pyramid(*arguments)
    with pytest.raises(InputError, match="per octave"):
        Pyramid(1.0, 1, per_octave=0)
    with pytest.raises(InputError, match="per octave"):
        octaves(100, per_octave=0)


def test_what_does_not_go_together_is_not_pooled():
    a = variances(GOOD, 1.0)
    for other in (
        variances(GOOD, 2.0),
        variances(GOOD, 1.0, kind="hadamard"),
        variances(np.stack([GOOD, GOOD], 1), 1.0),
    ):
        with pytest.raises(InputError, match="cannot be pooled"):
            pooled([a, other])
    with pytest.raises(InputError, match="no variances to pool"):
        pooled([])
    assert isinstance(pooled([a]), Variances)
