"""Every kind of run of a campaign: calibrations on all rigs, alignment, a unit turned by hand, noise."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sagnac.calibration import load
from sagnac.campaign import run as campaigns
from sagnac.campaign import spec
from sagnac.campaign.tasks import noise, prepare
from sagnac.errors import InputError

SHORT = {"plan.dwell": "20 s", "plan.turning": "36 s", "recording.frequency": "10 Hz"}
KINDS = {
    "norm": ({"set": SHORT}, "gyro.misalignment.zy"),
    "table": ({"set": SHORT}, "rig.zero.outer"),
    "multi-position": ({"set": SHORT}, "gyro.scale_error.x"),
    "four-position": ({}, "accel.bias.z"),
    "centrifuge-accel": ({}, "accel.k3.z"),
    "centrifuge-gyro": ({}, "gyro.d_ii.y"),
    "roll-isolated": ({"set": {"plan.inner_time": "5 s", "plan.spin_time": "5 s"}}, "rig.cone_half_angle"),
    "transfer-s-turn": ({"set": {"trajectory.leg": [{"duration": "40 s", "turn_rate": "3 deg/s"}]}}, "misalignment.z"),
}


@pytest.mark.parametrize("name", KINDS)
def test_every_shipped_scenario_runs_within_five_sigma(name):
    more, parameter = KINDS[name]
    task = prepare(spec.from_table({"scenario": name, "runs": 2, **more}))
    row = task.row(1)
    assert row["status"] == "ok"
    assert set(row) == set(task.columns)
    error, sigma = row[f"error.{parameter}"], row[f"sigma.{parameter}"]
    assert 0 < abs(error) < 5 * sigma
    bound = dict(zip(task.names, task.about.points[0].bound, strict=True))[parameter]
    assert bound <= 1.3 * sigma
    assert row["nees_degrees_of_freedom"] > 2
    assert row["chi2"] > 0


HAND = """
gravity = "9.81744 m/s^2"
[unit.parameters]
"accel.scale_error" = "normal 0.01"
"accel.bias" = "normal 20 mg"
"gyro.bias" = "normal 1 deg/s"
[unit.noise]
accel = "200 ug/sqrt(Hz)"
gyro = "0.01 deg/s/sqrt(Hz)"
[hand]
attitudes = 20
rest = "2 s"
[recording]
frequency = "50 Hz"
"""


def test_a_unit_turned_by_hand(tmp_path):
    (tmp_path / "hand.toml").write_text(HAND)
    table = {"scenario": "hand.toml", "method": "hand", "runs": 3}
    found = spec.from_table(table, folder=tmp_path)
    task = prepare(found)
    row = task.row(2)
    assert row["status"] == "ok"
    for name in ("accel.bias.x", "accel.scale_error.z", "gyro.scale_error.y", "gyro.bias.z"):
        assert abs(row[f"error.{name}"]) < 6 * row[f"sigma.{name}"]
    bound = dict(zip(task.names, task.about.points[0].bound, strict=True))
    assert 0 < bound["accel.bias.x"] < 2 * row["sigma.accel.bias.x"]
    assert bound["gyro.bias.x"] is None  # their noise is judged by the residuals
    campaigns.again(found, 2, tmp_path / "again")
    again = load(tmp_path / "again" / "calibration.json")
    truth = json.loads((tmp_path / "again" / "truth.json").read_text())["parameters"]
    assert again["accel.bias.x"].value - truth["accel.bias.x"] == pytest.approx(row["error.accel.bias.x"], rel=1e-6)
    for wrong, said in (("[rig]\n", "rig: say nothing"), ("[hand]\nrests = 3\n", "hand.rests: no such key")):
        text = HAND.replace("[hand]\n", "") + wrong if "hand" in wrong else HAND + wrong
        (tmp_path / "hand.toml").write_text(text.replace('attitudes = 20\nrest = "2 s"\n', ""))
        with pytest.raises(InputError, match=said):
            spec.from_table(table, folder=tmp_path)


REST = """
latitude = "45 deg"
[unit.noise]
accel = "50 ug/sqrt(Hz)"
gyro = "0.1 deg/sqrt(h)"
gyro_walk = "2 deg/h/sqrt(h)"
[plan]
positions = [["0 deg", "0 deg", "0 deg"]]
dwell = "2 h"
[recording]
frequency = "2 Hz"
"""


def test_noise_of_a_rest(tmp_path):
    (tmp_path / "rest.toml").write_text(REST)
    task = prepare(spec.from_table({"scenario": "rest.toml", "method": "noise", "runs": 2}, folder=tmp_path))
    assert set(task.names) == {f"{n}.{a}" for n in ("accel.white", "gyro.white", "gyro.walk") for a in "xyz"}
    row = task.row(0)
    # of white noise alone each of the 14400 samples tells 1 / sqrt(2 n) of its deviation
    bound = dict(zip(task.names, task.about.points[0].bound, strict=True))
    assert bound["accel.white.x"] == pytest.approx(50e-6 * 9.80665 / np.sqrt(2 * 14400), rel=0.01)
    for name in ("accel.white.x", "gyro.white.y"):
        assert abs(row[f"error.{name}"]) < 5 * row[f"sigma.{name}"]


def test_noise_is_ideal_flicker_where_no_band_is_stated(tmp_path):
    """In the default band B is biased by a fifth and more; from the sample interval to 30 rests it is what is identified."""
    text = REST.replace('gyro_walk = "2 deg/h/sqrt(h)"', 'gyro_instability = "1 deg/h"')
    (tmp_path / "rest.toml").write_text(text)
    table = {"scenario": "rest.toml", "method": "noise", "runs": 2}
    ideal = spec.from_table(table, folder=tmp_path)
    scenario = noise.read(ideal.points[0].table)
    assert scenario.unit.noise.instability_band == pytest.approx((0.5, 30 * 7200.0))
    task = prepare(ideal)
    assert task.about.points[0].notes == ()
    errors = [row[f"error.gyro.instability.{a}"] for row in map(task.row, range(2)) for a in "xyz"]
    rms = np.sqrt(np.mean(np.square(errors)))
    bound = dict(zip(task.names, task.about.points[0].bound, strict=True))["gyro.instability.x"]
    assert rms < 2.2 * bound  # chi-square of six at 1e-4
    stated = spec.from_table({**table, "set": {"unit.noise.instability_band": ["10 s", "3000 s"]}}, folder=tmp_path)
    assert noise.read(stated.points[0].table).unit.noise.instability_band == (10.0, 3000.0)
    assert "outside of it" in prepare(stated).about.points[0].notes[0]
    campaigns.again(ideal, 1, tmp_path / "again")  # what is written is what was run
    assert "instability_band" in (tmp_path / "again" / "scenario.toml").read_text()


def test_slow_noise_that_the_plan_does_not_state_is_told():
    changed = {**SHORT, "unit.noise.accel_instability": "20 ug", "recording.sensors": "accel"}
    hidden = prepare(spec.from_table({"scenario": "norm", "runs": 1, "set": changed}))
    assert "bias instability of the accelerometers, which the plan does not state" in hidden.about.points[0].notes[0]
    assert "gyros" not in hidden.about.points[0].notes[0]
    stated = spec.from_table({"scenario": "norm", "runs": 1, "set": changed | {"unit.state_slow_noise": True}})
    assert prepare(stated).about.points[0].notes == ()


def test_a_row_says_how_its_uncertainties_were_found(tmp_path):
    (tmp_path / "hand.toml").write_text(HAND)
    row = prepare(spec.from_table({"scenario": "hand.toml", "method": "hand", "runs": 1}, folder=tmp_path)).row(0)
    assert row["uncertainty"] != "white"
    assert 1 <= row["dof.gyro.bias.x"] < 200
    known = prepare(spec.from_table({"scenario": "norm", "runs": 1, "set": SHORT})).row(0)
    assert (known["uncertainty"], known["dof.accel.bias.x"]) == ("white", None)
