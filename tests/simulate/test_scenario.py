"""Scenario files: what is read, and what is refused with the key named."""

from __future__ import annotations

import copy
import math
import tomllib
from importlib import resources

import numpy as np
import pytest

from sagnac.earth import STANDARD_GRAVITY
from sagnac.errors import InputError
from sagnac.simulate import grades
from sagnac.simulate.build import build
from sagnac.simulate.drawn import Drawn, si
from sagnac.simulate.scenario import from_table, load, shipped, text

DEG_H = math.pi / 648000


def table_of(name: str = "norm") -> dict:
    entry = resources.files("sagnac.simulate").joinpath("scenarios", f"{name}.toml")
    return tomllib.loads(entry.read_text(encoding="utf-8"))


def changed(name: str, path: str, value: object) -> dict:
    """Table of a shipped scenario with one key set, or taken out for None."""
    table = copy.deepcopy(table_of(name))
    *way, last = path.split("/")
    inner = table
    for key in way:
        inner = inner.setdefault(key, {})
    if value is None:
        inner.pop(last)
    else:
        inner[last] = value
    return table


# ------------------------------------------------------------------------------------------------- what is read


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenarios_can_be_built(name):
    scenario = load(name)
    assert scenario.title == shipped()[name]
    assert len(scenario.sha256) == 64
    built = build(scenario, 1)
    assert built.job.clock.count > 10_000
    assert text(name).startswith("# ")


def test_the_published_truth():
    # [DONG18], table 1
    truth = build(load("norm"), 1).parameters
    assert truth["accel.scale_error.y"] == 0.008
    assert truth["accel.bias.z"] == pytest.approx(-0.0032 * STANDARD_GRAVITY, rel=1e-12)
    assert truth["gyro.bias.x"] == pytest.approx(-0.34 * DEG_H, rel=1e-12)
    assert truth["accel.misalignment.zy"] == 1e-4
    assert truth["rig.mount.y"] == pytest.approx(2 / 60 * math.pi / 180, rel=1e-12)
    assert {abs(v) for n, v in truth.items() if n.startswith(("rig.tilt", "rig.zero"))} == {5 * math.pi / 648000}


def test_every_unit_of_the_standards_is_read():
    table = changed(
        "centrifuge-gyro",
        "unit/parameters",
        {
            "accel.k2.z": "12 ug/g^2", "accel.k3.x": "3 ug/g^3", "accel.kip.y": "5 ug/g^2", "gyro.d_ii.x": "0.06 deg/h/g^2",
            "gyro.d_i.y": "1 deg/h/g", "gyro.misalignment.xy": "1e-4 rad", "gyro.g_sensitivity.xz": "1 deg/h/g",
            "accel.scale_error.x": "20 ppm", "gyro.scale_error.z": 1e-3, "rig.mount.x": "1 arcmin",
        },
    )  # fmt: skip
    truth = build(from_table(table), 1).parameters
    g = STANDARD_GRAVITY
    expected = {
        "accel.k2.z": 12e-6 / g, "accel.k3.x": 3e-6 / g**2, "accel.kip.y": 5e-6 / g, "gyro.d_ii.x": 0.06 * DEG_H / g**2,
        "gyro.d_i.y": DEG_H / g, "gyro.misalignment.xy": 1e-4, "gyro.g_sensitivity.xz": DEG_H / g,
        "accel.scale_error.x": 2e-5, "gyro.scale_error.z": 1e-3, "rig.mount.x": math.pi / 10800,
    }  # fmt: skip
    for name, value in expected.items():
        assert truth[name] == pytest.approx(value, rel=1e-12), name


def test_a_name_without_axis_stands_for_the_axes_not_named():
    truth = build(from_table(changed("norm", "unit/parameters", {"gyro.bias.y": "1 deg/h", "gyro.bias": "3 deg/h"})), 1)
    found = [truth.parameters[f"gyro.bias.{a}"] / DEG_H for a in "xyz"]
    np.testing.assert_allclose(found, [3, 1, 3], rtol=1e-12)


def test_drawn_values_follow_their_law():
    rng = np.random.default_rng(1)
    n = 4000
    normal, uniform, sign, exact = (
        np.array([Drawn(law, 2.0).draw(rng) for _ in range(n)]) for law in ("normal", "uniform", "sign", "exact")
    )
    # relative standard deviations of n values' standard deviation: 1 / sqrt(2 n), and 0.45 / sqrt(n) of a uniform one
    assert normal.std() == pytest.approx(2.0, rel=4 / math.sqrt(2 * n))
    assert uniform.std() == pytest.approx(2.0 / math.sqrt(3), rel=4 * 0.45 / math.sqrt(n))
    assert np.abs(uniform).max() <= 2.0
    assert set(sign) == {2.0, -2.0}
    assert abs(sign.mean()) < 4 * 2.0 / math.sqrt(n)
    assert set(exact) == {2.0}


def test_one_law_does_not_shift_the_other_draws():
    base = build(load("norm"), 3).parameters
    exact = build(from_table(changed("norm", "rig/errors/tilt", "5 arcsec")), 3).parameters
    assert [base[f"rig.zero.{a}"] for a in ("outer", "middle", "inner")] == [
        exact[f"rig.zero.{a}"] for a in ("outer", "middle", "inner")
    ]


def test_grades_scatter_as_they_say():
    for name in grades.GRADES:
        spread = grades.grade(name).spread
        units = [grades.draw(name, np.random.default_rng(k))[0] for k in range(400)]
        for full in spread:
            values = np.array([u[full] for u in units])
            # relative standard deviation of the standard deviation of 400 values: 3.5 %; five of them over 90 names
            assert values.std() == pytest.approx(spread[full], rel=5 / math.sqrt(800)), full
            assert abs(values.mean()) < 5 * spread[full] / 20


def test_grades_are_ordered():
    mems, tactical, navigation = (grades.grade(n) for n in ("mems", "tactical", "navigation"))
    for full, size in navigation.spread.items():
        if full in mems.spread:
            assert size < tactical.spread[full] < mems.spread[full], full
    for sensor in ("accel", "gyro"):
        densities = [g.noise[sensor].density for g in (navigation, tactical, mems)]
        assert densities[0] < densities[2]
        assert densities[0] < densities[1]


def test_what_is_given_overrides_the_grade():
    table = changed("norm", "unit/grade", "tactical")
    table["unit"]["parameters"] = {"accel.bias.x": "1 mg"}
    table["unit"]["noise"] = {"gyro": "1 deg/sqrt(h)"}
    built = build(from_table(table), 1)
    assert built.parameters["accel.bias.x"] == pytest.approx(1e-3 * STANDARD_GRAVITY)
    assert built.parameters["accel.bias.y"] != 0
    assert built.noise["gyro"].density == pytest.approx(math.radians(1) / 60)
    assert built.noise["gyro"].instability == grades.grade("tactical").noise["gyro"].instability
    assert built.noise["accel"] == grades.grade("tactical").noise["accel"]
    # and the plan states the white noise of both
    noise = from_table(table).plan.unit.noise
    assert noise.gyro == pytest.approx(built.noise["gyro"].density, rel=1e-12)
    assert noise.accel == pytest.approx(built.noise["accel"].density, rel=1e-12)


def test_a_plan_may_state_no_noise():
    assert from_table(changed("norm", "unit/state_noise", value=False)).plan.unit.noise.accel is None


def test_segments_in_place_of_a_plan_by_name():
    table = changed("norm", "plan", None)
    table["segment"] = [
        {"name": "a", "start": "1 s", "stop": "5 s", "outer": "0 deg", "middle": "30 deg", "inner": "0 deg"}
    ]
    scenario = from_table(table)
    assert scenario.plan.segment[0].middle == pytest.approx(math.pi / 6)
    assert build(scenario, 1).job.clock.count == 300


def test_lines_with_semicolons_are_read(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(text("norm").replace('model = "simulated laser-gyro unit"\n', 'model = "a"; '))
    assert load(path).unit.serial == "DONG18"


@pytest.mark.parametrize(
    ("given", "unit", "value"),
    [
        ("1 ug/K", "m/s^2/K", 9.80665e-6),
        ("1 ug/degC", "m/s^2/K", 9.80665e-6),
        ("20 degC", "K", 293.15),
        ("1 ppm", "1", 1e-6),
        (0.25, "1", 0.25),
        ("0.06 m/s/sqrt(h)", "m/s^2/Hz^0.5", 1e-3),
        ("6 deg/h/sqrt(h)", "rad/s/s^0.5", 6 * DEG_H / 60),
    ],
)
def test_texts_with_units(given, unit, value):
    assert si(given, unit, "") == pytest.approx(value, rel=1e-12)


# ---------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("name", "path", "value", "says"),
    [
        ("norm", "nonsense", 1, "nonsense: no such key"),
        ("norm", "method", "nomr", "method: Input should be '', 'four-position'"),
        ("norm", "method", "centrifuge", "method: 'centrifuge' is not for a turntable (rig.kind)"),
        ("roll-isolated", "method", "norm", "method: 'norm' is not for a roll-isolated (rig.kind)"),
        ("norm", "unit/gradee", "mems", "unit.gradee: no such key"),
        ("norm", "unit/grade", "best", "unit.grade: Input should be 'mems', 'tactical' or 'navigation'"),
        ("norm", "recording", None, "recording: is missing"),
        ("norm", "recording/frequency", "0 Hz", "recording.frequency: 0 is not above zero"),
        ("norm", "recording/frequency", 50, "recording.frequency: write it as a text with its unit, for example '100 Hz'"),
        ("norm", "recording/frequency", "50 s", "recording.frequency: '50 s' has s where Hz is needed"),
        ("norm", "recording/frequency", "nan Hz", "recording.frequency: cannot read 'nan Hz'"),
        ("norm", "recording/frequency", "1e300 Hz", "recording.frequency: 8.161e+303 samples are more than any file holds"),
        ("norm", "recording/frequency", "1e-9 Hz", "are less than two samples"),
        ("norm", "recording/jitter", "10 ms", "recording: jitter, timestamp_jitter: together 0.01 s"),
        ("norm", "recording/sensors", "mag", "recording.sensors.0: Input should be 'accel', 'gyro', 'accel_x'"),
        ("norm", "recording/sensors", [], "recording: sensors: none is recorded"),
        ("norm", "plan/dwell", "-1 s", "plan.dwell: -1 is negative"),
        ("norm", "plan/rate", "0 deg/s", "plan: rate: a turning segment has a rate other than zero"),
        ("norm", "plan/rate", ["10 deg/s", "x"], "plan.rate.1: cannot read 'x'"),
        ("norm", "plan/rate", "9000 deg/s", "segment 'r1' turns 180 deg from sample to sample at 50 Hz"),
        ("norm", "plan/positions", "cube", "plan.positions: Input should be 'icosahedron', 'dodecahedron'"),
        ("norm", "plan/positions", [["1 deg", "2 deg"]], "plan.positions.0.2: is missing"),
        ("norm", "plan/positions", [["1 deg", "2 deg", "3 xx"]], "plan.positions.0.2: cannot read 'xx'"),
        ("norm", "plan/move", "0 s", "segment 's2' begins at 300 s, when the table is still elsewhere"),
        ("norm", "plan", None, "plan: give [plan] or [[segment]]"),
        ("norm", "unit/parameters", {"accel.bias.q": "1 mg"}, "unit.parameters: 'accel.bias.q' is no coefficient"),
        ("norm", "unit/parameters", {"accel.bias.x": "1 deg"}, "accel.bias.x: '1 deg' has deg where m/s^2 is needed"),
        ("norm", "unit/parameters", {"accel.bias.x": 1.0}, "accel.bias.x: write it as a text with its unit"),
        ("norm", "unit/parameters", {"accel.misalignment.xy": "1 rad"}, "accelerometers define the frame: yx, zx, zy"),
        ("norm", "unit/parameters", {"gyro.bias.x": "normal -1 deg/h"}, "a drawn value has a size"),
        ("norm", "unit/noise/accel", "-1 ug/sqrt(Hz)", "unit.noise.accel: -9.80665e-06 is negative"),
        ("norm", "unit/noise/accel", "1 ug", "unit.noise.accel: '1 ug' has ug where m/s^2/Hz^0.5 is needed"),
        ("norm", "unit/noise/instability_band", ["9 s", "1 s"], "unit.noise: instability_band: the second"),
        ("norm", "unit/noise/markov", [{"sensor": "gyro", "size": "1 ug", "time": "3 s"}], "'1 ug' has ug where rad/s"),
        ("norm", "unit/scale", {"accel_x": "10 pulse/g/s"}, "unit.scale: the axes of the accel triad are read in different"),
        ("norm", "unit/scale", {"gyros": "10 pulse/arcsec"}, "unit.scale: gyros: none of accel, gyro"),
        ("norm", "unit/limits", {"k9": "1 g"}, "unit.limits.k9: no such key"),
        ("norm", "unit/temperature", {"profile": "ramp", "start": "20 degC"}, "unit.temperature: stop: a ramp has one"),
        ("norm", "unit/temperature", {"profile": "constant", "start": "20"}, "unit.temperature.start: '20' has no unit"),
        (
            "norm", "unit/temperature", {"profile": "sine", "start": "20 degC", "amplitude": "5 degC"},
            "amplitude: 278.15 K is too wide; write a difference of temperatures in K",
        ),
        (
            "norm", "unit/temperature", {"profile": "constant", "start": "1 K", "coefficients": {"accel.k2.x": "1 ug/g^2/K"}},
            "only biases and scale errors change with temperature",
        ),
        ("norm", "rig/kind", "swing", "rig.kind: 'swing' is none of turntable, centrifuge, roll-isolated, vehicle"),
        ("norm", "rig/radius", "1 m", "radius says nothing on a turntable rig"),
        ("norm", "rig/errors/radius", "1 m", "rig.errors.radius: no such key"),
        ("norm", "rig/errors/tilt", ["1 deg"], "rig.errors.tilt: 1 values where 2 are needed"),
        ("norm", "rig/axes", {"a": "z"}, "plan.turning_axis: this table has no axis 'outer', but a"),
        ("norm", "latitude", "99 deg", "latitude 99 deg is beyond a pole"),
        ("norm", "latitude", None, "gives no latitude"),
        ("norm", "config", {"a": 1}, "trajectory, master, config: they belong to a vehicle"),
        ("centrifuge-accel", "plan/turns", None, "plan: give turns or dwell"),
        ("centrifuge-accel", "plan/gamma", [], "plan.gamma: Tuple should have at least 1 item"),
        ("centrifuge-accel", "plan/gamma", ["1 deg"] * 20000, "plan: 20000 segments or more are asked for"),
        ("centrifuge-accel", "plan/arm_rate", "60000 deg/s", "segment '1' turns 60 deg from sample to sample at 1000 Hz"),
        ("centrifuge-accel", "rig/radius", None, "radius is missing"),
        ("roll-isolated", "unit/parameters", {"rig.mount.x": "1 deg"}, "on this rig the mounting stands in rig.errors"),
        ("roll-isolated", "plan/inner_time", "0 s", "segment 'inner 1' stops at 10 s, not after its start"),
        ("transfer", "trajectory", None, "trajectory: is missing"),
        ("transfer", "trajectory/heading", "10 m", "trajectory.heading: '10 m' has m where rad is needed"),
        ("transfer", "trajectory/latitude", "90 deg", "trajectory.leg.0: after 0 s the course comes within 0.1 deg of a pole"),
        ("transfer", "trajectory/leg", [{"duration": "9 s", "acceleration": "-2 m/s^2"}], "leg.0.acceleration: the speed falls"),
        ("transfer", "trajectory/sway", {"roll": "5 m"}, "trajectory.sway.roll: '5 m' has m where rad is needed"),
        ("transfer-s-turn", "rig/errors/lever_arm", "1 m", "trajectory.leg.0.legs.0.ease: the leg begins with a step in"),
        ("transfer", "rig/errors/flexure", "-1 arcmin", "rig.errors.flexure.0: -0.000290888 is negative"),
        ("transfer", "rig/errors/flexure", "10 deg", "rig.errors.flexure.0: Input should be less than or equal to 0.1"),
        ("transfer", "rig/errors/lever_arm", ["1 m"], "rig.errors.lever_arm: 1 values where 3 are needed"),
        ("transfer", "master/latency", "11 s", "master.latency: Input should be less than or equal to 10"),
        ("transfer-s-turn", "recording/frequency", "0.01 Hz", "trajectory.leg.0.legs.0 turns 300 deg from sample to sample"),
        ("transfer", "recording", {"frequency": "0.02 Hz", "jitter": "11 s"}, "recording.jitter: 11 s; a vehicle is known only"),
        ("transfer", "master/gap", [["9 s", "3 s"]], "master: gap: from 9 s to 3 s is no time; write the earlier one first"),
        ("transfer", "master/gap", [["0 s", "1000 s"]], "master: 0 samples of 9001 are left; make frequency higher"),
        ("transfer", "trajectory/leg", [{"duration": "0 s"}], "trajectory.leg.0.duration: 0 is not above zero"),
        ("transfer", "trajectory/speed", "1e9 m/s", "trajectory.speed: Input should be less than or equal to 1000"),
        ("transfer", "plan", {"dwell": "1 s"}, "plan, segment: a vehicle has a [trajectory]"),
        ("transfer", "rig/radius", "1 m", "rig: radius says nothing on a vehicle"),
        ("transfer", "master/frequency", "1e12 Hz", "master.frequency: Input should be less than or equal to 1000"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(name, path, value, says):
    with pytest.raises(InputError) as error:
        build(from_table(changed(name, path, value), "s.toml"), 1)
    assert str(error.value).startswith("s.toml: ")
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_scenario_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"there is no scenario nothing; shipped are .*norm"):
        load("nothing")
    with pytest.raises(InputError, match="nothing.toml: cannot read the scenario: "):
        load(tmp_path / "nothing.toml")
    (tmp_path / "bad.toml").write_text("a =\nb = 1\n")
    with pytest.raises(InputError, match="bad.toml: cannot read the scenario: .*line 1"):
        load(tmp_path / "bad.toml")


def test_the_plan_states_slow_noise_when_asked_to():
    noise = {"accel_instability": "20 ug", "gyro_walk": "2 deg/h/sqrt(h)"}
    table = changed("norm", "unit/noise", value=noise)
    assert from_table(table).plan.unit.noise.accel_instability is None
    table["unit"]["state_slow_noise"] = True
    stated = from_table(table)
    assert stated.plan.unit.noise.of("accel", "instability") == pytest.approx((20 * 9.80665e-6,) * 3)
    assert stated.plan.unit.noise.of("gyro", "walk") == pytest.approx((stated.unit.noise_of("gyro").walk,) * 3)
