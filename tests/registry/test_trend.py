"""Trends of one unit: what is told, what is not, and what stands in the way."""

from __future__ import annotations

import json
import time
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from histories import START, YEAR, history_of, one, unit_of, walk
from hypothesis import given, settings
from hypothesis import strategies as st

from sagnac import results
from sagnac.errors import DataError
from sagnac.limits import Limit
from sagnac.registry import Parameter
from sagnac.registry.series import jumps, taken_apart
from sagnac.registry.trend import Made, trend
from sagnac.registry.trend_records import SCHEMA, Trend

UG = 9.80665e-6
BEGIN = datetime.fromisoformat(f"{START}+00:00")
NAME = "accel.bias.x"


def line(n=12, *, rate=3.0, sigma=1.0, seed=1, start=0.0):
    """Calibrations a year apart of a bias [ug] that drifts steadily, with the noise that is stated."""
    rng = np.random.default_rng(seed)
    years = np.arange(n, dtype=float)
    return years, UG * (start + rate * years + sigma * rng.standard_normal(n)), np.full(n, UG * sigma)


def years_after(text: str | None) -> float:
    assert text is not None
    return (datetime.fromisoformat(text) - BEGIN).total_seconds() / YEAR


def test_a_steady_drift_is_found_with_its_level_and_prediction():
    found = trend(one(*line()))[NAME]
    assert found.drift is not None
    assert found.level is not None
    assert found.expected is not None
    assert found.scatter is not None
    # 12 values a year apart known to 1 ug: the slope of the weighted line is known to 1/sqrt(143) ug a year
    assert found.drift.value * YEAR == pytest.approx(3 * UG, abs=3 * UG / np.sqrt(143))
    assert found.drift.standard_uncertainty * YEAR >= UG / np.sqrt(143)
    assert found.drift.lower < found.drift.value < found.drift.upper
    assert found.level.value == pytest.approx(33 * UG, abs=2 * UG)
    assert found.expected.lower < 36 * UG < found.expected.upper
    assert years_after(found.expected.at) == pytest.approx(12.0, abs=1e-6)
    assert found.scatter.model == "stated"
    assert found.scatter.degrees_of_freedom == 10


def test_chi_square_is_that_of_the_weighted_straight_line():
    rng = np.random.default_rng(4)
    years, sigma = np.sort(rng.uniform(0, 9, 8)), rng.uniform(0.5, 2, 8)
    values = 5.0 + 0.3 * years + sigma * rng.standard_normal(8)
    fit, cost = np.polynomial.polynomial.polyfit(years, values, 1, w=1 / sigma, full=True)
    scatter = trend(one(years, values, sigma))[NAME].scatter
    assert scatter is not None
    assert fit.size == 2
    assert scatter.chi2 == pytest.approx(float(cost[0][0]), rel=1e-6)


def test_more_scatter_than_stated_widens_the_drift():
    rng = np.random.default_rng(7)
    years = np.arange(15.0)
    wandering = walk(rng, years, 400.0) + rng.standard_normal(15)
    found = trend(one(years, UG * wandering, UG))[NAME]
    assert found.scatter is not None
    assert found.drift is not None
    assert found.scatter.model in ("walk", "white and walk")
    assert found.scatter.p_value is not None
    assert found.scatter.p_value < 1e-6
    # the mean of 14 steps of 20 ug has a standard deviation of 20/sqrt(14) = 5.3 ug, whatever is stated; these steps are smaller
    assert 2 * UG < found.drift.standard_uncertainty * YEAR < 12 * UG


def test_white_scatter_is_told_from_a_walk():
    rng = np.random.default_rng(8)
    white, wandering = [], []
    for _ in range(20):
        noise = rng.standard_normal((2, 40))
        white.append(trend(one(np.arange(40.0), UG * 30 * noise[0], UG))[NAME].scatter)
        wandering.append(trend(one(np.arange(40.0), UG * 30 * np.cumsum(noise[1]), UG))[NAME].scatter)
    # a second term is taken where twice the logarithm of the likelihood gains more than 2: by chance in 8 % (half of 16 %)
    assert sum(s.model == "white" for s in white) >= 15
    assert sum(s.model == "walk" for s in wandering) >= 15
    assert np.mean([s.white for s in white]) == pytest.approx(30 * UG, rel=0.1)
    assert np.mean([s.walk for s in wandering]) * np.sqrt(YEAR) == pytest.approx(30 * UG, rel=0.1)


def test_less_scatter_than_stated_is_remarked():
    rng = np.random.default_rng(9)
    found = trend(one(np.arange(20.0), UG * 0.05 * rng.standard_normal(20), UG))[NAME]
    assert any("far less than its stated uncertainties" in r for r in found.remarks)


def test_the_date_of_leaving_is_where_the_line_meets_the_limit():
    # from 33 ug at year 11, 3 ug a year: the limit of 60 ug is met at year 20
    found = trend(one(*line(40, sigma=0.1)), limit_of=lambda p: {NAME: Limit(-np.inf, 150 * UG)}.get(p.name))[
        NAME
    ].leaving
    assert found is not None
    assert found.state == "leaves"
    assert found.bound == "upper"
    assert years_after(found.date) == pytest.approx(50.0, abs=0.5)
    assert years_after(found.earliest) < years_after(found.date) < years_after(found.latest)


def test_a_falling_parameter_leaves_through_the_lower_limit():
    found = trend(
        one(*line(30, rate=-3.0, sigma=0.1)), limit_of=lambda p: {NAME: Limit(-100 * UG, 100 * UG)}.get(p.name)
    )[NAME].leaving
    assert found is not None
    assert (found.state, found.bound) == ("leaves", "lower")
    assert years_after(found.date) == pytest.approx(100 / 3, abs=0.5)


def test_already_outside():
    found = trend(one(*line(start=50.0)), limit_of=lambda p: {NAME: Limit(-40 * UG, 40 * UG)}.get(p.name))
    leaving = found[NAME].leaving
    assert leaving is not None
    assert (leaving.state, leaving.bound) == ("already outside", "upper")
    assert leaving.probability_outside > 0.999
    assert leaving.date == found.calibrations[-1].created
    assert "already outside (upper limit, probability > 0.999)" in found.summary()


def test_not_within_twenty_years():
    found = trend(one(*line(30, rate=0.0, sigma=0.01)), limit_of=lambda p: {NAME: Limit(-1.0, 1.0)}.get(p.name))
    leaving = found[NAME].leaving
    assert leaving is not None
    assert leaving.state == "stays"
    assert leaving.date is leaving.earliest is leaving.latest is None
    assert "not within 20 years" in found.summary()


@pytest.mark.parametrize(
    ("n", "words"),
    [
        (1, "one calibration: neither drift nor scatter nor a prediction can be told"),
        (2, "two calibrations: a difference, and nothing left to judge the scatter by"),
    ],
)
def test_too_few_calibrations_say_what_cannot_be_told(n, words):
    found = trend(one(*line(n)), limit_of=lambda p: {NAME: Limit(-1.0, 1.0)}.get(p.name))
    p = found[NAME]
    assert p.drift is p.level is p.scatter is p.expected is p.leaving is None
    assert any(words in r for r in p.remarks)
    assert any("the last value lies inside its limits" in r for r in p.remarks)
    assert words in found.summary()


def test_calibrations_of_one_moment_tell_no_drift():
    found = trend(one(np.zeros(5), UG * np.arange(5.0), UG))[NAME]
    assert found.drift is None
    assert any("all 5 calibrations are of the same moment" in r for r in found.remarks)


def test_some_calibrations_of_one_moment_are_no_harm():
    years, values, sigma = line(6)
    both = one(np.repeat(years, 2), np.repeat(values, 2), np.repeat(sigma, 2) * np.sqrt(2))
    twice, once = trend(both)[NAME], trend(one(years, values, sigma))[NAME]
    assert twice.drift is not None
    assert once.drift is not None
    assert twice.drift.value == pytest.approx(once.drift.value, abs=0.2 * once.drift.standard_uncertainty)


@pytest.mark.parametrize("values", [np.zeros(6), np.arange(6.0), np.array([1.0, 2.0, 2.0, 5.0, 4.0, 9.0])])
@pytest.mark.parametrize("years", [np.arange(6.0), np.array([0.0, 0.0, 1.0, 1.0, 2.0, 3.0])])
def test_zero_uncertainties_are_left_to_the_scatter(values, years):
    found = trend(one(years, 7.0 + UG * values, 0.0), limit_of=lambda _: Limit(-10.0, 10.0))[NAME]
    assert found.drift is not None
    assert found.scatter is not None
    assert found.scatter.chi2 is found.scatter.p_value is None
    assert np.isfinite([found.drift.value, found.drift.lower, found.drift.upper]).all()
    assert any("stated as exact" in r for r in found.remarks)


def test_a_parameter_in_another_unit_is_another_parameter():
    # counts first, then SI: five values that go on as if nothing had been
    years, values, sigma = line(8)
    history = history_of(
        [
            (1, Parameter(NAME, "count"), years[:3], 1e4 * values[:3], 1e4 * sigma[:3]),
            (1, Parameter(NAME, "m/s^2"), years[3:], values[3:], sigma[3:]),
        ]
    )
    found = trend(history)
    assert len(found.parameters) == 1
    assert found[NAME].unit == "m/s^2"
    assert len(found[NAME].values) == 5
    assert "left out: 3 in count, which is not comparable" in found[NAME].remarks
    assert len(found.calibrations) == 5


def test_a_misalignment_in_another_convention_is_named():
    years, values, sigma = line(6)
    name = "accel.misalignment.yx"
    parts = [(Parameter(name, "rad", "input-axis"), slice(4)), (Parameter(name, "rad", "element"), slice(4, 6))]
    found = trend(history_of([(1, p, years[own], values[own], sigma[own]) for p, own in parts]))[name]
    assert found.misalignment == "element"
    assert "left out: 4 as input-axis, which is not comparable" in found.remarks


def test_since_leaves_out_what_was_before_a_repair():
    years, values, sigma = line(10, rate=0.0)
    values = values + np.where(years >= 5, 100 * UG, 0.0)
    whole = trend(one(years, values, sigma))
    assert [s.after.created for s in whole[NAME].steps] == [whole.calibrations[5].created]
    assert whole[NAME].steps[0].change == pytest.approx(100 * UG, abs=5 * UG)
    assert "--since 2020-02-29" in whole.summary()
    after = trend(one(years, values, sigma), since=datetime(2020, 2, 28, tzinfo=UTC))
    assert len(after.calibrations) == 5
    assert not after[NAME].steps
    assert after[NAME].drift is not None
    assert abs(after[NAME].drift.value) < 3 * after[NAME].drift.standard_uncertainty


def steps(values, sigma=1.0, k=5.0, years=None):
    years = np.arange(float(len(values))) if years is None else years
    return [j.index for j in jumps(taken_apart(one(years, np.asarray(values, float), sigma))[0], k)]


def test_steps():
    assert steps([0, 0.5, 10, 10.5]) == [2]
    assert steps([0, 10]) == [1]  # of two calibrations every change beyond k is one
    assert steps([0, 10], k=8) == []
    assert steps([0, 6, 12, 18, 24, 30]) == []  # a drift is no row of steps
    assert steps([0, 6, 12, 18, 68, 74, 80]) == [4]
    assert steps([5.0]) == []
    assert steps([0, 0, 0, 1e-3, 1e-3, 1e-3], sigma=0.0) == [3]
    assert steps([0, 0, 0, 0], sigma=0.0) == []
    assert steps([0, 0, 30, 0, 0], years=np.array([0.0, 1.0, 1.0, 2.0, 3.0])) == [2, 3]


def test_a_wandering_parameter_has_no_steps_on_that_account():
    rng = np.random.default_rng(3)
    counted = [len(steps(30 * np.cumsum(rng.standard_normal(30)))) for _ in range(50)]
    # a change of 5 times the median size is one of 3.4 sigma: 29 changes in 50 histories have 1.0 of them by chance
    assert sum(counted) <= 5


def test_a_date_before_the_last_calibration_is_refused():
    with pytest.raises(DataError, match="2016-01-01 lies before the last calibration of 2026-"):
        trend(one(*line()), at=datetime(2016, 1, 1, tzinfo=UTC))


def test_no_calibration_is_no_trend():
    with pytest.raises(DataError, match="no calibration since 2050-01-01"):
        trend(one(*line()), since=datetime(2050, 1, 1, tzinfo=UTC))


def test_a_trend_is_that_of_one_unit():
    history = history_of([(i, Parameter(NAME, "m/s^2"), *line(3)) for i in (1, 2)])
    with pytest.raises(ValueError, match="one unit"):
        trend(history)


def test_a_change_of_method_is_named():
    history = one(*line(4))
    made = [Made(method) for method in ("norm", "norm", "table", "table")]
    found = trend(history, made=dict(zip(history.calibration.tolist(), made, strict=True)))
    assert found.calibrations[0].method == "norm"
    assert "different methods (norm, table)" in found.remarks[0]


def test_evaluations_of_the_same_recording_are_named():
    history = one(*line(4))
    made = [Made("norm", recordings) for recordings in (("a",), ("b", "c"), ("b",), ())]
    found = trend(history, made=dict(zip(history.calibration.tolist(), made, strict=True)))
    first, second = history.calibration[1:3]
    assert len(found.remarks) == 1
    assert found.remarks[0].startswith(f"id:{first}, id:{second} are evaluations of the same recording and count as 2 ")
    assert "evaluations of the same recording" in found.summary()


@pytest.mark.parametrize("other", ["accel.misalignment.xy", None])
def test_a_misalignment_in_another_frame_is_another_quantity(other):
    # three full matrices, in the frame of the mounting faces, then three triangular ones: the change of 100 is one of frame
    years, name = np.arange(6.0), "accel.misalignment.yx"
    parts = [(1, Parameter(name, "rad", "element"), years, 1e-6 * (years % 2) + 1e-4 * (years > 2), 1e-6)]
    parts += [(1, Parameter("accel.misalignment.xy", "rad", "element"), years[:3], 1e-6 * np.ones(3), 1e-6)]
    parts += [(1, Parameter("gyro.misalignment.xy", "rad", "element"), years, 1e-6 * np.ones(6), 1e-6)]
    whole = history_of(parts)
    if other is None:  # only some parameters were asked for: the frame is told by the others all the same
        found = trend(history_of(parts[:1]), frames=whole)[name]
    else:
        found = trend(whole)[name]
        assert (
            "left out: 3 in the frame of the mounting faces, which is not comparable"
            in trend(whole)["gyro.misalignment.xy"].remarks
        )
    assert found.frame == "the accelerometers' own frame"
    assert len(found.values) == 3
    assert not found.steps
    assert "left out: 3 in the frame of the mounting faces, which is not comparable" in found.remarks


def test_it_reads_back_from_json():
    found = trend(
        unit_of(np.random.default_rng(1), np.arange(5.0)), limit_of=lambda p: {NAME: Limit(-1.0, np.inf)}.get(p.name)
    )
    again = results.loads(Trend, SCHEMA, "a trend", found.to_json(), "trend")
    assert again == found
    table = json.loads(found.to_json())
    assert table["parameters"][0]["limits"] == {"lower": -1.0, "upper": None}
    series = again[NAME].series()
    assert series.value.tolist() == list(found[NAME].values)


def test_the_page_has_a_row_a_parameter_in_datasheet_units():
    text = trend(unit_of(np.random.default_rng(1), np.arange(6.0))).summary()
    rows = {line.split()[0]: line for line in text.splitlines() if line.startswith(("  accel.", "  gyro."))}
    assert len(rows) == 6
    assert " ug" in rows["accel.bias.y"] or " mg" in rows["accel.bias.y"]
    assert "deg/h" in rows["gyro.bias.x"]
    assert all("±" in row for row in rows.values())


def test_thousands_of_points():
    rng = np.random.default_rng(6)
    years = np.sort(rng.uniform(0, 10, 4000))
    found = trend(one(years, UG * (2 * years + rng.standard_normal(4000)), UG))[NAME]
    assert found.drift is not None
    assert found.drift.value * YEAR == pytest.approx(2 * UG, abs=5 * found.drift.standard_uncertainty * YEAR)


def test_two_hundred_calibrations_of_twenty_parameters_do_not_take_long():
    history = unit_of(np.random.default_rng(2), np.linspace(0, 20, 200), tuple(f"accel.k{i}" for i in range(7)))
    trend(history, limit_of=lambda _: Limit(-1e-2, 1e-2))  # imports
    begin = time.process_time()
    trend(history, limit_of=lambda _: Limit(-1e-2, 1e-2))
    assert time.process_time() - begin < 3.0  # 0.07 s on a quiet machine; this only finds a change of order


def test_calibrations_far_in_the_past_and_future():
    found = trend(one(np.array([0.0, 150.0, 300.0]), np.array([0.0, 1.0, 2.0]), 0.1), at=BEGIN + timedelta(days=130000))
    assert found[NAME].drift is not None
    assert found[NAME].drift.value * YEAR == pytest.approx(1 / 150, rel=1e-3)


numbers = st.floats(-1e12, 1e12, allow_subnormal=False)
points = st.tuples(st.floats(0, 100), numbers, st.one_of(st.just(0.0), st.floats(1e-12, 1e12)))


@settings(max_examples=150, deadline=None)
@given(st.lists(points, min_size=1, max_size=12), st.tuples(numbers, numbers).filter(lambda two: two[0] < two[1]))
def test_whatever_was_registered_gives_a_trend(given_points, bounds):
    years, values, sigmas = (np.array(column) for column in zip(*given_points, strict=True))
    found = trend(
        one(years, values, sigmas[np.argsort(years, kind="stable")]),
        limit_of=lambda p: {NAME: Limit(*bounds)}.get(p.name),
    )
    p = found[NAME]
    for known in (p.level, p.drift, p.expected):
        assert known is None or known.lower <= known.value <= known.upper
    if p.leaving is not None:
        dates = [d for d in (p.leaving.earliest, p.leaving.date, p.leaving.latest) if d is not None]
        assert dates == sorted(dates)
    assert found.summary()
    assert results.loads(Trend, SCHEMA, "a trend", found.to_json(), "trend") == found
