"""What a plan is predicted to see is what it sees."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.calibrate import norm, table
from sagnac.design import check, ideal
from sagnac.design.check import worst_ratio
from sagnac.errors import InputError
from sagnac.plan import Noise, Plan, Rig, Segment, Unit
from sagnac.simulate.plans import ICOSAHEDRON, table_plan
from sagnac.simulate.table import readings
from sagnac.simulate.unit import laser_gyro_unit

ARCMIN = np.pi / 10800
G = 9.80665


def test_the_published_bound_of_the_norm_method():
    # methods.md, section 2: one 1e-5 g reading a position: dK 7.1e-6, th 1.13e-5 rad, bias 5.0e-6 g
    found = check(table_plan(laser_gyro_unit(), dwell=1.0, turning=0.0), "norm", sensors=("accel",))
    for axis in "xyz":
        assert found[f"accel.scale_error.{axis}"] == pytest.approx(7.1e-6, rel=0.01)
        assert found[f"accel.bias.{axis}"] == pytest.approx(5.0e-6 * G, rel=0.01)
    for pair in ("yx", "zx", "zy"):
        assert found[f"accel.misalignment.{pair}"] == pytest.approx(1.13e-5, rel=0.02)


@pytest.mark.parametrize("method", ["norm", "table"])
def test_prediction_and_result_agree(method):
    # a unit with errors of up to a percent: uncertainties differ by such percents only
    unit = laser_gyro_unit()
    plan = table_plan(unit, ICOSAHEDRON, dwell=100.0, turning=36.0, angle_uncertainty=ARCMIN)
    rng = np.random.default_rng(1)
    means = ideal.table_means(plan, ("accel", "gyro"))
    noise = {"accel": unit.accel_density, "gyro": unit.gyro_density}
    for sensor, clean in readings(unit, means.mean["accel"], means.mean["gyro"]).items():
        means.mean[sensor] = clean + noise[sensor] / np.sqrt(means.duration)[:, None] * rng.standard_normal((24, 3))
    made = {"norm": norm, "table": table}[method].calibrate_means(means, plan)
    found = check(plan, method)
    for p in found.parameters:
        if p.name.startswith(("accel.", "gyro.")):
            assert p.standard_uncertainty == pytest.approx(made[p.name].standard_uncertainty, rel=0.05), p.name


def test_time_on_the_rig_and_text():
    plan = table_plan(laser_gyro_unit(), dwell=60.0, turning=36.0, move=10.0)
    found = check(plan)
    assert (found.segments, found.time_measuring) == (24, pytest.approx(12 * 96.0))
    assert found.time_on_rig == pytest.approx(24 * 10.0 + 12 * 96.0)
    text = found.summary()
    assert "Plan for table: 24 segments, 23.2 min on the rig (19.2 min of it measuring)" in text
    assert "accel.scale_error.x" in text
    assert "gyro.bias.z" in text
    assert found.to_dict()["parameters"][0]["name"] == "accel.scale_error.x"


def test_a_plan_that_is_not_enough_says_why():
    plan = table_plan(laser_gyro_unit(), ICOSAHEDRON[:3], turning=0.0)
    found = check(plan, sensors=("accel",))
    assert found.parameters == ()
    assert "do not excite all three accel axes" in found.unseen
    assert "not enough" in found.summary()


def test_what_cannot_be_predicted_is_refused():
    plan = table_plan(laser_gyro_unit())
    quiet = plan.model_copy(update={"unit": Unit()})
    with pytest.raises(InputError, match='does not state the noise of the accel triad.*accel = "10 ug/sqrt'):
        check(quiet)
    with pytest.raises(
        InputError, match="a turntable is predicted for table, norm, multi-position, not for 'centrifuge'"
    ):
        check(plan, "centrifuge")
    with pytest.raises(InputError, match="nothing to predict"):
        check(plan.model_copy(update={"segment": ()}))
    with pytest.raises(InputError, match="sensors of a turntable: accel, gyro; not accel_z"):
        check(plan, sensors=("accel_z",))


def test_only_sensors_with_stated_noise_are_taken():
    noise = Noise(accel=1e-4)
    plan = table_plan(laser_gyro_unit()).model_copy(update={"unit": Unit(noise=noise)})
    assert {p.name.split(".")[0] for p in check(plan).parameters} == {"accel", "rig"}


def test_requirements_match_by_the_beginning_of_names():
    found = check(table_plan(laser_gyro_unit()))
    ratio, name = worst_ratio(found, {"accel.bias": found["accel.bias.y"] / 2, "gyro.bias.x": found["gyro.bias.x"]})
    assert ratio == pytest.approx(2.0, rel=0.01)
    assert name.startswith("accel.bias")
    with pytest.raises(InputError, match="'accel.k9' is no parameter of this plan"):
        worst_ratio(found, {"accel.k9": 1.0})


def test_a_single_segment_plan():
    plan = Plan(
        latitude=0.7,
        unit=Unit(noise=Noise(accel=1e-4)),
        rig=Rig(),
        segment=(Segment(name="1", start=0, stop=1, outer=0, middle=0, inner=0),),
    )
    assert check(plan).unseen
