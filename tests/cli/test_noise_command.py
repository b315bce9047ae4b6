"""``sagnac noise`` as a user runs it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from sagnac import calibration as calibrations
from sagnac import plan as plans
from sagnac.noise import record

N = 20_000


def columns(seed=1, unit="deg/s"):
    rng = np.random.default_rng(seed)
    out = {"time [s]": np.arange(N) / 100}
    out |= {f"accel_{a} [g]": (a == "z") + 6e-4 * rng.normal(size=N) for a in "xyz"}
    return out | {f"gyro_{a} [{unit}]": 0.02 * rng.normal(size=N) for a in "xyz"}


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    path = tmp_path_factory.mktemp("still") / "still.parquet"
    parquet.write_table(pa.table(columns()), path)
    return path


@pytest.fixture(scope="module")
def single(tmp_path_factory):
    """The same of one axis: quicker."""
    path = tmp_path_factory.mktemp("single") / "single.parquet"
    parquet.write_table(pa.table({k: v for k, v in columns().items() if k.startswith(("time", "gyro_x"))}), path)
    return path


@pytest.fixture(scope="module")
def stepped(tmp_path_factory):
    given = {k: v for k, v in columns(2).items() if k.startswith(("time", "gyro_x", "gyro_y"))}
    given["gyro_y [deg/s]"][12_000:] += 0.05
    path = tmp_path_factory.mktemp("stepped") / "stepped.csv"
    csv.write_csv(pa.table(given), path)
    return path


def test_the_table_the_file_and_the_picture(run, still):
    done = run("noise", still, "--out", "noise.json", "--plot", "noise.png")
    assert done.status == 0, done.err
    row = next(line for line in done.out.splitlines() if "angle random walk N" in line)
    assert row.split()[4].startswith("0.1")  # 0.02 deg/s at 100 Hz is 0.12 deg/sqrt(h)
    assert "deg/sqrt(h)" in row
    assert "written: noise.json" in done.err
    assert Path("noise.png").stat().st_size > 20_000
    found = record.load("noise.json")
    assert found["gyro_x"]["white"].value == pytest.approx(math.radians(0.002), rel=0.03)


def test_json_is_the_file(run, single):
    done = run("noise", single, "--out", "noise.json", "--json")
    assert done.status == 0
    assert json.loads(done.out) == json.loads(Path("noise.json").read_text())


def test_a_refused_axis_is_status_one_and_the_others_are_given(run, stepped):
    done = run("noise", stepped, "--out", "noise.json")
    assert done.status == 1
    assert "refused: gyro_y: gyro_y changes its mean by" in done.out
    assert [a.name for a in record.load("noise.json").axes] == ["gyro_x"]
    told = next(line for line in done.out.splitlines() if "undisturbed for longest" in line)
    stop = told.partition("--to '")[2].partition("'")[0]
    assert run("noise", stepped, "--to", stop).status == 0
    assert run("noise", stepped, "--despite", "step").status == 0


def test_when_nothing_can_be_judged_nothing_is_written(run, still):
    done = run("noise", still, "--to", "0.2 s", "--out", "noise.json", "--plot", "noise.png")
    assert done.status == 1
    assert "too few" in done.err
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--from", "10"], "--from: '10' has no unit where a time is needed"),
        (["--from", "10 s", "--to", "5 s"], "--to 5 s is not after --from 10 s"),
        (["--segment", "1"], "--segment 1: give the plan"),
        (["--despite", "wind"], "--despite wind: there are saturated"),
        (["--into", "plan.toml"], "give the file to write with --out"),
        (["--plot", "noise.gif"], "write to a .png, .svg or .pdf file"),
        (["--expect", "gyro=N=1 deg/sqrt(h)"], "--expect tells of a record that there is not yet"),
    ],
)
def test_wrong_usage_is_status_two(run, still, arguments, words):
    done = run("noise", still, *arguments)
    assert done.status == 2
    assert words in done.err


def test_a_segment_of_the_plan(run, single):
    text = 'latitude = "45 deg"\n[[segment]]\nname = "rest"; start = "50 s"; stop = "150 s"\n'
    text += 'outer = "0 deg"; middle = "0 deg"; inner = "0 deg"\n'
    Path("plan.toml").write_text(text)
    done = run("noise", single, "--plan", "plan.toml", "--segment", "rest", "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out)["samples"] == 10_000
    wrong = run("noise", single, "--plan", "plan.toml", "--segment", "2")
    assert wrong.status == 2
    assert "the plan has rest" in wrong.err


def test_into_a_plan_and_a_calibration(run, still, rig):
    Path("plan.toml").write_text(Path(rig.plan_file).read_text())
    done = run("noise", still, "--into", "plan.toml", "--out", "new.toml")
    assert done.status == 0, done.err
    assert plans.load("new.toml").unit.noise.of("gyro") == pytest.approx((math.radians(0.002),) * 3, rel=0.03)
    assert run("calibrate", "norm", rig.recording, "--plan", "plan.toml", "--out", "cal.json").status == 0
    assert run("noise", still, "--into", "cal.json", "--out", "new.json").status == 0
    assert calibrations.load("new.json").noise["gyro"].origin == "noise test"
    kept = run("noise", still, "--into", "cal.json", "--out", "cal.json")
    assert kept.status == 2
    assert "inputs are never modified" in kept.err


# ------------------------------------------------------------------------------------------- before the test


def test_how_long_to_record_from_words(run):
    done = run("noise", "--expect", "gyro=N=0.2 deg/sqrt(h), B=5 deg/h", "--rate", "100 Hz", "--plot", "need.png")
    assert done.status == 0, done.err
    assert "bias instability B" in done.out
    assert "each coefficient to 10 %" in done.out
    assert Path("need.png").exists()
    longer = run(
        "noise", "--expect", "gyro=N=0.2 deg/sqrt(h), B=5 deg/h", "--rate", "100 Hz", "--within", "1 %", "--json"
    )
    shorter = run("noise", "--expect", "gyro=N=0.2 deg/sqrt(h), B=5 deg/h", "--rate", "100 Hz", "--json")
    one, ten = (json.loads(d.out)[0]["lengths"]["instability"] for d in (longer, shorter))
    assert 30 < one / ten < 200  # a hundred times as long for a tenth of the uncertainty, about


def test_how_long_to_record_from_a_plan_and_from_an_earlier_test(run, single):
    Path("plan.toml").write_text('[unit]\nnoise = { accel = "60 ug/sqrt(Hz)", accel_instability = "20 ug" }\n')
    done = run("noise", "--plan", "plan.toml", "--rate", "100 Hz", "--out", "need.json")
    assert done.status == 0, done.err
    assert json.loads(Path("need.json").read_text())[0]["sensor"] == "accel"
    assert run("noise", single, "--out", "noise.json").status == 0
    again = run("noise", "--plan", "noise.json")
    assert again.status == 0
    assert "gyro triad at 100 Hz" in again.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "give a RECORDING, or what noise is expected"),
        (["--expect", "gyro=N=1 deg/sqrt(h)"], "give --rate '100 Hz'"),
        (["--expect", "N=1 deg/sqrt(h)", "--rate", "1 Hz"], "begin with accel= or gyro="),
        (["--expect", "gyro=Z=1 deg/h", "--rate", "1 Hz"], "'Z=1 deg/h' is no term: there are Q, N, B, K, R"),
        (["--expect", "gyro=N=1 deg/h", "--rate", "1 Hz"], "'1 deg/h' is not in deg/sqrt(h)"),
        (["--expect", "gyro=N=-1 deg/sqrt(h)", "--rate", "1 Hz"], "must be more than zero"),
        (["--plan", "plan.toml", "--rate", "1 Hz"], "states no noise"),
    ],
)
def test_what_is_expected_has_to_be_said(run, arguments, words):
    Path("plan.toml").write_text('latitude = "45 deg"\n')
    done = run("noise", *arguments)
    assert done.status == 2
    assert words in done.err


# ------------------------------------------------------------------------------------------------- real logs


def test_a_vehicle_that_people_move_about_in_is_no_place_for_a_noise_test(run, public_data):
    log = public_data("laser_gyro_parked.parquet")
    scale = ("--scale", "gyro=10 pulse/arcsec", "--scale", "accel=817.996 pulse/(m/s)")
    done = run("noise", log, *scale)
    assert done.status == 1
    assert "no axis can be judged" in done.err
    told = run("noise", log, *scale, "--despite", "motion,step,shock,line,misfit", "--json")
    # its description tells of a sway of 1.7 to 2.7 Hz
    lines = [d for d in json.loads(told.out)["disturbances"] if d["kind"] == "line" and 1.5 < d["frequency"] < 3.5]
    assert {d["axis"] for d in lines} >= {"gyro_x", "gyro_y", "gyro_z", "accel_x"}


def test_a_log_that_ends_in_motion_is_judged_from_its_rest(run, public_data):
    log = public_data("xsens_mti_hand.csv")
    done = run("noise", log)
    assert done.status == 1
    # at rest for the first 50 s, then turned by hand
    assert "undisturbed for longest (52." in done.err
    rest = run("noise", log, "--to", "48 s", "--json")
    found = record.loads(rest.out)
    for axis in "xyz":
        # 2.7 count/sqrt(Hz) of 4770 count/(rad/s): 0.03 deg/s/sqrt(Hz), as MEMS gyros of that time have
        assert found[f"gyro_{axis}"]["white"].value == pytest.approx(2.7, rel=0.1)
