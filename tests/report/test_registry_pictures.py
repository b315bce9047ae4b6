"""Pictures of a registry: what is drawn, not how it looks."""

from __future__ import annotations

import numpy as np
import pytest
from figures import assert_clear, made, texts_of

from sagnac.errors import DataError
from sagnac.limits import Limit
from sagnac.registry import History, Parameter, Unit
from sagnac.registry.compare import compare
from sagnac.registry.fleet import fleet
from sagnac.registry.trend import trend
from sagnac.report import registry as pictures
from sagnac.report.style import save

UG = 9.80665e-6
NAMES = [f"{s}.bias.{a}" for s in ("accel", "gyro") for a in "xyz"]


def history(units=1, n=9, names=("accel.bias.x",), *, rate=5.0, step=0.0, sigma=1.0) -> History:
    """Drifting parameters, calibrated once a year; with a step after the fifth calibration."""
    rng = np.random.default_rng(1)
    values = [
        UG * (rate * (1 + 0.1 * u) * np.arange(n) + step * (np.arange(n) > 4) + rng.standard_normal(n))
        for u in range(units)
        for _ in names
    ]
    years = (np.arange(n) * 365.25 * 86400e6).astype("timedelta64[us]")
    count = units * len(names)
    return History(
        item=np.repeat(np.arange(units), n * len(names)),
        time=np.tile(np.datetime64("2015-03-01T10:00:00", "us") + years, count),
        calibration=np.tile(np.arange(n), count),
        parameter=np.tile(np.repeat(np.arange(len(names)), n), units),
        value=np.concatenate(values),
        standard_uncertainty=np.full(n * count, sigma * UG),
        parameters=tuple(Parameter(name, "m/s^2" if name.startswith("accel") else "rad/s") for name in names),
        units={u: Unit(u, "LG-1", f"{u:04d}") for u in range(units)},
    )


def lines(axes, style=None):
    return [x for x in axes.get_lines() if style is None or x.get_linestyle() == style]


def test_a_trend_shows_calibrations_level_limits_and_departure():
    found = trend(history(), limit_of=lambda p: {"accel.bias.x": Limit(-60 * UG, 60 * UG)}.get(p.name))
    figure = pictures.trend(found)
    axes = figure.axes[0]
    dashed = [x.get_ydata()[0] for x in lines(axes, "--") if len(set(x.get_ydata())) == 1]
    assert dashed[:2] == pytest.approx([-60.0, 60.0])  # ug
    bars = axes.containers[0]
    assert bars.lines[0].get_ydata() == pytest.approx(np.array(found.parameters[0].values) / UG)
    left = [x for x in lines(axes) if x.get_marker() == "D"]
    assert left[0].get_ydata() == pytest.approx([60.0])
    leaving = found.parameters[0].leaving
    assert leaving is not None
    assert str(left[0].get_xdata()[0])[:10] == str(leaving.date)[:10]
    said = texts_of(figure)
    assert any("limits left: 2027" in t for t in said)
    assert {"calibrations", "level", "predicted", "limit", "95 % band of the level"} <= set(said)
    assert "[µg]" in said
    assert_clear(figure)


def test_a_limit_far_away_does_not_squeeze_the_picture():
    figure = pictures.trend(trend(history(), limit_of=lambda p: {"accel.bias.x": Limit(-1.0, 1.0)}.get(p.name)))
    low, high = figure.axes[0].get_ylim()
    assert high - low < 300
    assert any("not within 20 years" in t for t in texts_of(figure))


def test_a_step_is_marked():
    found = trend(history(step=200.0))
    assert len(found.parameters[0].steps) == 1
    figure = pictures.trend(found)
    assert " step" in texts_of(figure) or "step" in [t.strip() for t in texts_of(figure)]


@pytest.mark.parametrize("n", [1, 2])
def test_too_short_a_history_is_drawn_without_a_level(n):
    figure = pictures.trend(trend(history(n=n)))
    assert not [x for x in lines(figure.axes[0]) if x.get_label() == "level"]
    assert_clear(figure)


def test_exact_values_can_be_drawn():
    assert_clear(pictures.trend(trend(history(sigma=0.0))))


def test_of_many_parameters_those_with_most_to_tell_are_drawn():
    names = [*NAMES, "accel.k2.x", "accel.k2.y"]
    found = trend(
        history(names=tuple(sorted(names))), limit_of=lambda p: {"gyro.bias.z": Limit(-50 * UG, 50 * UG)}.get(p.name)
    )
    figure = pictures.trend(found)
    assert len(figure.axes) == pictures.MOST
    said = texts_of(figure)
    assert any(t.startswith("gyro.bias.z") for t in said)
    assert any("6 of 8 parameters" in t for t in said)
    assert_clear(figure)
    assert len(pictures.trend(found, ["accel.k2.x"]).axes) == 1
    with pytest.raises(DataError, match="there are accel.bias.x"):
        pictures.trend(found, ["none"])


def test_a_fleet_has_a_row_a_unit():
    found = fleet(history(units=12), model="LG-1", limit_of=lambda _, __: Limit(-60 * UG, 60 * UG))
    figure = pictures.fleet(found)
    axes = figure.axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == [u.serial for u in found.parameters[0].units]
    assert axes.get_yticklabels()[0].get_text() == "0011"  # the one that drifts most
    assert {"leaves them within 20 years", "mean", "spread over the units"} <= set(texts_of(figure))
    assert_clear(figure)


def test_a_large_fleet_shows_the_nearest_to_their_limits():
    found = fleet(history(units=150, n=4), model="LG-1", limit_of=lambda _, __: Limit(-60 * UG, 60 * UG))
    figure = pictures.fleet(found)
    assert any("60 of 150 units" in t for t in texts_of(figure))
    assert_clear(figure)


def test_a_fleet_without_a_drift_has_no_picture():
    with pytest.raises(DataError, match="three calibrations or more"):
        pictures.fleet(fleet(history(n=2)))


def test_a_comparison_has_a_row_a_parameter():
    before = made(12, 3)
    sigma = np.array([p.standard_uncertainty for p in before.parameters]) * np.sqrt(2)
    over = np.array([0.5, -1.0, 3.0, 50.0, *np.zeros(8)])
    after = before.model_copy(
        update={
            "parameters": tuple(
                p.model_copy(update={"value": p.value + k * s})
                for p, k, s in zip(before.parameters, over, sigma, strict=True)
            )
        }
    )
    figure = pictures.comparison(compare(before, after, names=("old.json", "new.json")))
    drawn = {x.get_marker(): x.get_xdata() for x in lines(figure.axes[0]) if len(x.get_xdata())}
    assert sorted(drawn["o"])[:2] == pytest.approx([-1.0, 0.0], abs=1e-6)
    assert drawn["D"] == pytest.approx([3.0])
    assert drawn[">"] == pytest.approx([6.42])  # 1.07 times the farthest that is drawn to scale
    assert "50" in texts_of(figure)
    assert any("old.json" in t and "χ²" in t for t in texts_of(figure))
    assert_clear(figure)


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_the_same_trend_gives_the_same_file(tmp_path, ending):
    found = trend(history(), limit_of=lambda p: {"accel.bias.x": Limit(-60 * UG, 60 * UG)}.get(p.name))
    for name in ("one", "two"):
        save(pictures.trend(found), tmp_path / f"{name}.{ending}")
    assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"two.{ending}").read_bytes()
