"""Identification: exact on exact variances, honest on short ones, and at its bound on simulated logs."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from sagnac.errors import DataError, InputError
from sagnac.noise.curves.allan import Variances, octaves, pooled, variances
from sagnac.noise.identification import bound
from sagnac.noise.identification.identify import deviations, identify
from sagnac.noise.identification.terms import FLOOR, TERMS, level, variance
from sagnac.simulate.noise import AxisNoise, NoiseModel

MEMS = {"quantisation": 6e-6, "white": 9e-5, "instability": 4e-5, "walk": 5e-6}
"""Of a MEMS gyro, SI: 1.2 arcsec, 0.3 deg/sqrt(h), 8 deg/h, 60 deg/h/sqrt(h)."""


def exact(coefficients, interval=0.01, samples=1 << 20, kind="allan"):
    """Variances that equal their expectation."""
    m = octaves(samples, kind)
    total = sum(d**2 for d in deviations(coefficients, m * interval, interval, kind).values())
    order = 2 if kind == "allan" else 3
    return Variances(kind, interval, samples, m, total[:, None], samples + 1 - order * m, "exact")


def log(coefficients, interval, samples, seed):
    """Samples by the package's simulator, flicker noise over a band wider than the log."""
    get = coefficients.get
    markov = ((get("markov"), get("markov_time")),) if "markov" in coefficients else ()
    band = (0.5 * interval, 10.0 * samples * interval)
    model = NoiseModel(get("white", 0.0), get("instability", 0.0), band, get("walk", 0.0), markov)
    out = get("ramp", 0.0) * interval * np.arange(samples)
    AxisNoise(model, interval, seed, (0,)).add(out)
    residues = np.random.default_rng([seed, 1]).standard_normal(samples + 1)
    return out + np.diff(residues) * get("quantisation", 0.0) / interval


@pytest.mark.parametrize(
    "truth",
    [
        {"white": 9e-5},
        {"white": 9e-5, "walk": 5e-6},
        MEMS,
        {"quantisation": 2.4e-6, "white": 9e-7, "instability": 1e-7},
        {"white": 9e-7, "instability": 2e-7, "ramp": 4e-10},
        {"white": 1e-3, "markov": 4e-4, "markov_time": 10.0},
    ],
)
def test_exact_variances_give_the_coefficients(truth):
    found = identify(exact(truth))
    assert {c.key for c in found.coefficients} == set(truth)
    # the expectation of a variance lies a little above its most likely value: the choice of terms sees it, the estimate does not
    for c in found.coefficients:
        assert c.value == pytest.approx(truth[c.key], rel=1e-4 if c.key.startswith("markov") else 1e-6)
        assert c.lower < c.value < c.upper
        assert c.upper - c.lower == pytest.approx(3.92 * c.standard_uncertainty, rel=0.3)
    assert found.p_value > 0.99
    assert found.degrees_of_freedom == len(found.tau) - len(truth)
    np.testing.assert_allclose(found.model(found.tau), exact(truth).deviation[:, 0], rtol=1e-4)


def test_hadamard_gives_the_same_but_no_ramp():
    found = identify(exact(MEMS, kind="hadamard"))
    for c in found.coefficients:
        assert c.value == pytest.approx(MEMS[c.key], rel=1e-6)
    assert "ramp" not in found.limits


def test_result_does_not_depend_on_the_unit():
    v = variances(log(MEMS, 0.01, 1 << 14, 1), 0.01)
    one, other = identify(v), identify(replace(v, variance=v.variance * 1e-24))
    for a, b in zip(one.coefficients, other.coefficients, strict=True):
        assert b.value == pytest.approx(1e-12 * a.value, rel=1e-9)
        assert b.upper == pytest.approx(1e-12 * a.upper, rel=1e-6)
    assert other.chi2 == pytest.approx(one.chi2)


def test_more_averaging_times_than_octaves_are_thinned_out():
    y = log(MEMS, 0.01, 1 << 14, 1)
    dense = identify(variances(y, 0.01, octaves(1 << 14, per_octave=8)))
    sparse = identify(variances(y, 0.01))
    assert np.all(np.diff(np.log2(dense.tau)) > 0.9)
    for a, b in zip(dense.coefficients, sparse.coefficients, strict=True):
        assert a.key == b.key
        assert abs(a.value - b.value) < a.standard_uncertainty


def test_each_axis_has_its_own_noise():
    y = np.column_stack([log({"white": n}, 0.01, 1 << 12, 5) for n in (1e-4, 3e-4)])
    v = variances(y, 0.01)
    assert identify(v, 1).value("white") == pytest.approx(3.0 * identify(v, 0).value("white"), rel=1e-6)


def test_pooled_stretches_are_known_as_well_as_all_their_samples():
    parts = [variances(log({"white": 1.0}, 1.0, n, s), 1.0) for s, n in enumerate((6000, 3000, 1000))]
    found = identify(pooled(parts))
    (white,) = found.coefficients
    # 10 000 samples: 1 / sqrt(2 n) of the density
    assert white.standard_uncertainty / white.value == pytest.approx(1.0 / math.sqrt(20_000), rel=0.02)
    assert white.value == pytest.approx(1.0, abs=4.0 * white.standard_uncertainty)


def test_absent_terms_have_limits_that_shrink_with_the_record():
    short, long = (identify(exact({"white": 1.0}, 1.0, n)) for n in (1 << 12, 1 << 18))
    for found in (short, long):
        assert set(found.limits) == {"quantisation", "instability", "walk", "ramp"}
    for key in ("instability", "walk", "ramp"):
        assert 0.0 < long.limits[key] < 0.3 * short.limits[key]
    # B below what would stand out of white noise at the longest times: 0.664 B < 2 N / sqrt(tau)
    assert FLOOR * long.limits["instability"] < 2.0 / math.sqrt(2**16)


def test_terms_that_look_alike_are_named():
    # a walk that the longest times barely show could as well be a ramp
    found = identify(exact({"white": 1.0, "walk": 1.5e-3}, 1.0, 1 << 14))
    assert [c.key for c in found.coefficients] == ["white", "walk"]
    assert any("rate (acceleration) ramp instead of rate (acceleration) random walk" in n for n in found.notes)
    assert found.evidence[0].keys == ("white", "walk")
    assert found.evidence[0].criterion == 0.0


def test_a_poor_fit_names_where_the_model_misses():
    v = exact(MEMS)
    bumped = v.variance.copy()
    bumped[9] *= 1.3
    found = identify(replace(v, variance=bumped), terms=("quantisation", "white", "instability", "walk"))
    assert found.p_value < 1e-3
    (note,) = [n for n in found.notes if "do not explain" in n]
    assert f"{v.tau[9]:.3g} s (+" in note
    # the rest of the coefficients is not bent to explain it
    assert "error of the model of" in note
    for c in found.coefficients:
        assert abs(c.value - MEMS[c.key]) < 2.0 * c.standard_uncertainty


def test_an_instrument_that_is_no_sum_of_terms_gets_uncertainties_that_say_so():
    v = exact(MEMS)
    wavy = v.variance * np.exp(0.1 * np.random.default_rng(3).normal(size=v.variance.shape))
    found = identify(replace(v, variance=wavy), terms=("quantisation", "white", "instability", "walk"))
    assert found.p_value < 1e-3
    for c in found.coefficients:
        assert abs(c.value - MEMS[c.key]) < 3.0 * c.standard_uncertainty
        assert c.standard_uncertainty > 0.02 * c.value


def test_a_term_may_be_ruled_out():
    found = identify(exact(MEMS), terms=("white", "instability", "walk"))
    assert found.value("quantisation") == 0.0
    assert "quantisation" not in found.limits
    assert found.p_value < 1e-6


def test_terms_give_the_deviation():
    found = identify(exact(MEMS))
    tau = np.array([0.01, 1.0, 300.0])
    parts = found.terms(tau)
    assert parts["instability"] == pytest.approx(FLOOR * MEMS["instability"], rel=1e-5)
    expected = level("walk", MEMS["walk"], 0.01) * variance("walk", tau / 0.01)
    np.testing.assert_allclose(parts["walk"] ** 2, expected, rtol=1e-5)


def test_covariance_is_that_of_the_coefficients():
    found = identify(exact({"white": 1e-3, "markov": 4e-4, "markov_time": 10.0}))
    spread = [c.standard_uncertainty for c in found.coefficients]
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), spread, rtol=1e-9)
    # white noise hides the short times, and the long ones tell sigma^2 T: more of one is less of the other, as in the bound
    keys = [c.key for c in found.coefficients]
    a, b = keys.index("markov"), keys.index("markov_time")
    names, told = bound.information({"white": level("white", 1e-3, 0.01), "markov": 4e-4**2}, 1 << 20, 1e-3)
    best = np.linalg.inv(told)
    i, j = names.index("markov"), names.index("markov_time")
    expected = best[i, j] / math.sqrt(best[i, i] * best[j, j])
    # of the decay, in the bound: the sign of the time's logarithm is the other one
    assert found.covariance[a, b] / (spread[a] * spread[b]) == pytest.approx(-expected, abs=0.05)


def test_hostile_variances_are_refused():
    v = variances(np.random.default_rng(0).normal(size=(1000, 2)), 0.01)
    dead = replace(v, variance=v.variance * [1.0, 0.0])
    with pytest.raises(DataError, match="at tau = 0.01 s is 0: the axis is constant"):
        identify(dead, 1)
    assert identify(dead, 0).value("white") > 0.0
    with pytest.raises(DataError, match="2 averaging times are too few"):
        identify(variances(np.random.default_rng(0).normal(size=9), 0.01))
    with pytest.raises(InputError, match="'pink': there are quantisation"):
        identify(v, terms=("white", "pink"))
    with pytest.raises(InputError, match="let there be one of quantisation, white"):
        identify(v, terms=("ramp", "markov"))
    with pytest.raises(InputError, match="not from the modified one"):
        identify(variances(np.random.default_rng(0).normal(size=1000), 0.01, kind="modified"))


def test_short_records_give_what_they_can():
    for n in (16, 40, 100):
        found = identify(variances(np.random.default_rng(n).normal(size=n), 1.0))
        assert found.coefficients
        assert all(np.isfinite([c.value, c.standard_uncertainty, c.lower, c.upper]).all() for c in found.coefficients)
        assert all(np.isfinite(x) for x in found.limits.values())


def test_a_pure_ramp_and_a_pure_walk_are_found():
    # without white noise the first averaging times hold next to nothing
    walk = np.cumsum(np.random.default_rng(2).normal(size=4096))
    assert identify(variances(walk, 1.0)).value("walk") == pytest.approx(1.0, rel=0.1)
    ramp = 1e-3 * np.arange(4096.0) + 1e-4 * np.random.default_rng(2).normal(size=4096)
    assert identify(variances(ramp, 1.0)).value("ramp") == pytest.approx(1e-3, rel=1e-3)


def test_a_straight_line_shows_no_noise():
    with pytest.raises(DataError, match="on a straight line: there is no noise to see"):
        identify(variances(1e-9 * np.arange(4096.0), 0.01))


@pytest.mark.parametrize("name", ["sine", "steps", "outliers", "square"])
def test_what_is_no_noise_is_fitted_badly_and_says_so(name):
    rng, t = np.random.default_rng(4), np.arange(4096.0)
    y = {
        "sine": np.sin(0.01 * t) + 1e-3 * rng.normal(size=t.size),
        "steps": np.round(0.3 * rng.normal(size=t.size)) + (t > 2000),
        "outliers": rng.normal(size=t.size) + 1e3 * (t % 1000 == 0),
        "square": np.sign(np.sin(0.1 * t)),
    }[name]
    found = identify(variances(y, 1.0))
    assert all(np.isfinite([c.value, c.standard_uncertainty, c.lower, c.upper]).all() for c in found.coefficients)
    if name in {"sine", "square"}:
        assert any("do not explain" in note for note in found.notes)


@lru_cache
def study(name):
    truth, interval, samples, runs = CASES[name]
    results = [identify(variances(log(truth, interval, samples, seed), interval)) for seed in range(runs)]
    decay = interval / truth["markov_time"] if "markov" in truth else 0.0
    names, told = bound.information({k: level(k, v, interval) for k, v in truth.items() if k in TERMS}, samples, decay)
    spread = dict(zip(names, np.sqrt(np.diag(np.linalg.inv(told))), strict=True))
    limits = {k: spread[k] * (1.0 if k == "markov_time" else 0.5) for k in truth}
    return truth, results, limits


CASES = {
    "mems": ({"quantisation": 0.7, "white": 1.0, "instability": 0.2, "walk": 1e-2}, 1.0, 1 << 16, 30),
    "laser": ({"quantisation": 2.0, "white": 1.0, "instability": 0.1}, 1.0, 1 << 16, 30),
    "markov": ({"white": 1.0, "markov": 0.3, "markov_time": 100.0}, 1.0, 1 << 16, 30),
}


@pytest.mark.statistical
@pytest.mark.parametrize("name", CASES)
def test_errors_are_at_the_bound_and_intervals_hold(name):
    truth, results, limits = study(name)
    for key, true in truth.items():
        values = np.array([r.value(key) for r in results])
        rms = math.sqrt(np.mean((values / true - 1.0) ** 2))
        # 30 runs: the root mean square of normal errors scatters by 13 %, and 1.15 is asked for of the true one (the 200 runs of
        # benchmarks/noise_identification.py hold it)
        assert rms < 1.15 * (1.0 + 2.0 * 0.13) * limits[key], key
        found = [c for r in results for c in r.coefficients if c.key == key]
        held = np.mean([c.lower <= true <= c.upper for c in found])
        # 95 % of 30: 25 or fewer once in 60 times
        assert held >= 26 / 30, key
        stated = np.median([c.standard_uncertainty for c in found]) / true
        assert stated == pytest.approx(limits[key], rel=0.15), key


@pytest.mark.statistical
def test_terms_are_added_wrongly_once_in_twenty_times_at_most_and_large_ones_not_missed():
    wrong, missed, poor, runs = 0, 0, 0, 0
    for name in CASES:
        truth, results, _ = study(name)
        for r in results:
            keys = {c.key for c in r.coefficients}
            wrong += bool(keys - set(truth))
            missed += bool(set(truth) - keys)
            poor += r.p_value < 0.05
            runs += 1
    # binomial, 90 runs: 5 % is 4.5, and 9 are passed once in 50 times
    assert runs == 90
    assert wrong <= 9
    assert missed <= 2
    assert poor <= 9


@pytest.mark.statistical
def test_a_term_of_five_sigma_is_found():
    # five times the uncertainty that the bound gives the squared walk beside white noise
    samples, walk = 1 << 13, 2.5e-2
    names, told = bound.information({"white": 1.0, "walk": walk**2}, samples)
    sigma = math.sqrt(np.linalg.inv(told)[names.index("walk"), names.index("walk")])
    assert 1.0 / sigma == pytest.approx(5.0, rel=0.2)
    seen = [
        not {"walk", "ramp", "instability", "markov"}.isdisjoint(
            c.key for c in identify(variances(log({"white": 1.0, "walk": walk}, 1.0, samples, s), 1.0)).coefficients
        )
        for s in range(40)
    ]
    assert np.mean(seen) >= 0.95
