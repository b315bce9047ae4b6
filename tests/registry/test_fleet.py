"""Drifts over the units of a model."""

from __future__ import annotations

import json

import numpy as np
import pytest
from histories import YEAR, history_of, walk
from scipy.stats import chi2

from sagnac import results
from sagnac.errors import DataError
from sagnac.limits import Limit
from sagnac.registry import Parameter, Unit
from sagnac.registry.fleet import SCHEMA, FleetTrend, consensus, fleet

BIAS = Parameter("accel.bias.x", "m/s^2")
UG = 9.80665e-6


def units(count=30, *, mean=3.0, spread=2.0, n=12, seed=1):
    """Units that drift by `mean` with a `spread` [ug a year], known to 1 ug at each calibration; and their drifts."""
    rng = np.random.default_rng(seed)
    rates = mean + spread * rng.standard_normal(count)
    series = []
    for item, rate in enumerate(rates):
        years = np.arange(n) + rng.uniform(0, 0.2, n)
        series.append((item, BIAS, years, UG * (rate * years + rng.standard_normal(n)), UG))
    return history_of(series), rates


def test_mean_and_spread_of_the_drifts_are_found():
    history, rates = units(60)
    found = fleet(history, model="demo RLG").parameters[0]
    assert found.mean is not None
    assert found.spread is not None
    assert found.mean_standard_uncertainty is not None
    assert found.mean * YEAR / UG == pytest.approx(rates.mean(), abs=0.1)
    assert found.mean_standard_uncertainty * YEAR / UG == pytest.approx(2 / np.sqrt(60), rel=0.25)
    assert found.spread * YEAR / UG == pytest.approx(rates.std(ddof=1), rel=0.1)
    assert found.median * YEAR / UG == pytest.approx(np.median(rates), abs=0.2)


def test_the_units_nearest_to_their_limits_come_first():
    history, rates = units(20, mean=0.0, spread=3.0)
    found = fleet(history, limit_of=lambda _, __: Limit(-60 * UG, 60 * UG)).parameters[0]
    dates = [u.leaving.date for u in found.units if u.leaving is not None and u.leaving.date is not None]
    assert dates == sorted(dates)
    assert len(dates) < 20
    assert int(found.units[0].serial) == np.argmax(np.abs(rates))
    assert {u.leaving.state for u in found.units[len(dates) :] if u.leaving} <= {"stays"}


def test_a_unit_may_have_a_limit_of_its_own():
    history, _ = units(5, mean=0.0, spread=0.1)

    def limit_of(unit: Unit, parameter: Parameter) -> Limit | None:
        assert parameter == BIAS
        return Limit(-UG / 100, UG / 100) if unit.serial == "0003" else None

    found = fleet(history, limit_of=limit_of).parameters[0]
    assert found.units[0].serial == "0003"
    assert [u.limits is not None for u in found.units] == [True, False, False, False, False]


def test_short_histories_are_counted_and_left_out():
    rng = np.random.default_rng(1)
    series = [(i, BIAS, np.arange(n, dtype=float), UG * rng.standard_normal(n), UG) for i, n in enumerate((1, 2, 3, 8))]
    series.append((7, Parameter("gyro.bias.x", "rad/s"), np.arange(2.0), np.zeros(2), 1e-9))
    found = fleet(history_of(series))
    assert [p.name for p in found.parameters] == ["accel.bias.x"]
    assert len(found.parameters[0].units) == 2
    assert found.parameters[0].untold == 2
    assert found.untold == ("gyro.bias.x",)
    assert found.units == 5
    assert "fewer than three calibrations tell no drift" in found.summary()


def test_one_unit_has_no_spread():
    history, _ = units(1)
    found = fleet(history)
    assert found.parameters[0].mean is found.parameters[0].spread is None
    assert "accel.bias.x" in found.summary()


def test_no_calibration_is_no_fleet():
    history, _ = units(1)
    from datetime import UTC, datetime

    with pytest.raises(DataError, match="no calibration of LG-1"):
        fleet(history, model="LG-1", since=datetime(2100, 1, 1, tzinfo=UTC))


def test_it_reads_back_from_json():
    history, _ = units(4)
    found = fleet(history, limit_of=lambda _, __: Limit(-np.inf, 60 * UG))
    assert results.loads(FleetTrend, SCHEMA, "a trend", found.to_json(), "fleet") == found
    assert json.loads(found.to_json())["schema"] == SCHEMA


def test_the_page_names_as_many_as_asked_for():
    history, _ = units(30)
    found = fleet(history, model="LG-1", limit_of=lambda _, __: Limit(-np.inf, 60 * UG))
    assert found.summary(3).count("upper limit") == 3
    assert "30 units" in found.summary()


@pytest.mark.parametrize("sigma", [0.0, 1e-3])
def test_equal_drifts_have_no_spread(sigma):
    found = consensus(np.full(5, 2.0), np.full(5, sigma))
    assert found[:4] == pytest.approx((2.0, sigma / np.sqrt(5), 0.0, 0.0), abs=1e-12)


def test_the_spread_makes_the_squares_what_they_should_be():
    # Paule and Mandel: sum of squares over variances is n - 1; at the bounds it is a quantile of chi-square
    values, sigmas = np.array([1.0, 3.0, 2.0, 7.0]), np.array([0.1, 0.2, 1.0, 0.5])
    mean, sigma, spread, lower, upper = consensus(values, sigmas)
    for size, expected in ((spread, 3.0), (lower, chi2.isf(0.025, 3)), (upper, chi2.isf(0.975, 3))):
        weight = 1 / (sigmas**2 + size**2)
        middle = np.average(values, weights=weight)
        assert np.sum(weight * (values - middle) ** 2) == pytest.approx(expected, rel=1e-6)
    weight = 1 / (sigmas**2 + spread**2)
    assert mean == pytest.approx(np.average(values, weights=weight))
    assert sigma == pytest.approx(weight.sum() ** -0.5)


def test_a_spread_no_larger_than_the_uncertainties_is_found_in_many_units():
    # seven calibrations in six years, known to 1 ug: a drift is known to 1 / sqrt(28) = 0.19 ug a year; drifts differ by 0.28
    found = fleet(units(200, mean=0.0, spread=0.28, n=7)[0]).parameters[0]
    assert found.spread is not None
    assert found.spread_lower is not None
    assert found.spread_upper is not None
    assert 0.2 < found.spread * YEAR / UG < 0.36
    assert 0 < found.spread_lower < found.spread < found.spread_upper
    none = fleet(units(200, mean=0.0, spread=0.0, n=7)[0])
    assert none.parameters[0].spread_upper is not None
    assert none.parameters[0].spread_upper * YEAR / UG < 0.2
    assert "0 (" not in none.summary()


def test_models_are_not_pooled():
    rng = np.random.default_rng(1)
    series = [
        (i, BIAS, np.arange(8.0), UG * ((i % 2) * 50 * np.arange(8.0) + rng.standard_normal(8)), UG) for i in range(8)
    ]
    named = {i: Unit(i, f"LG-{i % 2}", f"{i:04d}") for i in range(8)}
    found = fleet(history_of(series, units=named), limit_of=lambda _, __: Limit(-1e-2, 1e-2))
    assert [(p.model, len(p.units)) for p in found.parameters] == [("LG-0", 4), ("LG-1", 4)]
    means = [p.mean for p in found.parameters]
    assert all(m is not None for m in means)
    assert np.array(means) * YEAR / UG == pytest.approx([0, 50], abs=1)
    text = found.summary()
    assert text.splitlines()[2].split()[:2] == ["model", "parameter"]
    assert any(line.split()[:2] == ["LG-1", "0001"] for line in text.splitlines())


@pytest.mark.statistical
def test_the_mean_of_wandering_units_is_as_uncertain_as_it_says():
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(60):
        series = []
        for item in range(8):
            years = np.arange(10.0)
            level = (3.0 + 2.0 * rng.standard_normal()) * years + walk(rng, years, 4.0)
            series.append((item, BIAS, years, UG * (level + rng.standard_normal(10)), UG))
        found = fleet(history_of(series)).parameters[0]
        assert found.mean is not None
        assert found.mean_standard_uncertainty is not None
        held += abs(found.mean * YEAR / UG - 3.0) < 2.36 * found.mean_standard_uncertainty * YEAR / UG  # Student, 7
    assert held >= 50  # 57 expected; 50 or fewer come in 0.1 %
