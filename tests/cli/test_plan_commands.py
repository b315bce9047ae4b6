"""``sagnac plan check`` and ``sagnac plan optimise`` as a user runs them."""

from __future__ import annotations

import json

import pytest
from inputs import WANTED

from sagnac.plan import load
from sagnac.simulate.plans import ICOSAHEDRON, table_plan
from sagnac.simulate.unit import laser_gyro_unit


@pytest.fixture
def plan_file(tmp_path):
    path = tmp_path / "plan.toml"
    table_plan(laser_gyro_unit(), ICOSAHEDRON).save(path)
    return path


def test_check_prints_every_parameter(run, plan_file):
    outcome = run("plan", "check", plan_file)
    assert outcome.status == 0
    assert "Plan for table: 24 segments, 2.27 h on the rig" in outcome.out
    assert outcome.out.count("gyro.misalignment.") == 6
    table = json.loads(run("plan", "check", plan_file, "--method", "norm", "--json").out)
    assert table["method"] == "norm"
    assert {p["name"] for p in table["parameters"]} > {"accel.bias.x", "gyro.bias.z"}


def test_a_plan_that_is_not_enough_ends_with_status_1(run, tmp_path):
    table_plan(laser_gyro_unit(), ICOSAHEDRON[:2]).save(tmp_path / "short.toml")
    outcome = run("plan", "check", "short.toml")
    assert outcome.status == 1
    assert "not enough: " in outcome.out


def test_optimise_writes_a_plan(run, tmp_path):
    (tmp_path / "wanted.toml").write_text(WANTED)
    outcome = run("plan", "optimise", "wanted.toml", "--out", "best.toml")
    assert outcome.status == 0
    assert "Chosen 12 of 150 candidates" in outcome.out
    assert len(load(tmp_path / "best.toml").segment) == 12
    checked = run("plan", "check", "best.toml", "--method", "norm")
    assert checked.status == 0
    assert checked.out in outcome.out
    same = run("plan", "optimise", "wanted.toml", "--json")
    assert json.loads(same.out)["candidates"] == 150


def test_optimise_leaves_its_input_alone(run, tmp_path):
    (tmp_path / "wanted.toml").write_text(WANTED)
    outcome = run("plan", "optimise", "wanted.toml", "--out", "wanted.toml")
    assert outcome.status == 2
    assert (tmp_path / "wanted.toml").read_text() == WANTED


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (WANTED.replace('"60 s"', '"60"'), "optimise.dwell"),
        (WANTED.replace("positions = 12", "positions = 0"), "optimise.positions"),
        (WANTED.replace("[optimise]", "[[segment]]\n[optimise]"), "has segments"),
        ("latitude = ", "cannot read it"),
    ],
)
def test_bad_requests_end_with_status_2(run, tmp_path, text, said):
    (tmp_path / "wanted.toml").write_text(text)
    outcome = run("plan", "optimise", "wanted.toml", "--out", "best.toml")
    assert outcome.status == 2
    assert said in outcome.err
    assert not (tmp_path / "best.toml").exists()
