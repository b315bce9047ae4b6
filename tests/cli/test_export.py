"""``sagnac export`` as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sagnac.calibration import loads
from sagnac.cli.commands_export import To
from sagnac.export import TARGETS

NOISE = (
    "--noise", "accel_density=80 ug/sqrt(Hz),gyro_density=0.3 deg/sqrt(h)",
    "--noise", "accel_random_walk=2e-5 m/s^3/sqrt(Hz)",
    "--noise", "gyro_random_walk=1e-6 rad/s^2/sqrt(Hz)",
)  # fmt: skip


@pytest.fixture
def cal(tmp_path):
    """A unit with biases, scale errors and cross terms, uncertainties of a thousandth of each."""
    values = {
        f"{kind}.{term}.{axes}": value
        for kind, bias in (("accel", 0.2), ("gyro", 0.03))
        for term, value in (("scale_error", 0.01), ("bias", bias), ("misalignment", 0.005))
        for axes in (("yx", "zx", "zy") if term == "misalignment" else "xyz")
    }
    units = {"scale_error": "1", "misalignment": "rad"}
    reading = {"accel": "m/s^2", "gyro": "rad/s"}
    rows = [(n, v, units.get(n.split(".")[1], reading[n.split(".")[0]])) for n, v in values.items()]
    covariance = [[(1e-3 * v) ** 2 * (i == j) for j in range(len(rows))] for i, (_, v, _) in enumerate(rows)]
    text = json.dumps(
        {
            "schema": "sagnac/calibration/1",
            "method": "by hand",
            "parameters": [
                {"name": n, "value": v, "unit": u, "standard_uncertainty": 1e-3 * abs(v)} for n, v, u in rows
            ],
            "covariance": covariance,
            "fit": {"chi2": 0.0, "degrees_of_freedom": 0, "residual_rms": 0.0, "converged": True, "iterations": 0},
            "site": {"gravity": 9.81},
            "software": {"version": "0"},
            "created": "2000-01-01T00:00:00+00:00",
        }
    )
    loads(text).save(tmp_path / "cal.json")
    return Path("cal.json")


def listed() -> list[str]:
    return sorted(p.name for p in Path().iterdir())


def test_the_command_knows_every_target():
    assert {to.value for to in To} == set(TARGETS)


@pytest.mark.parametrize("target", TARGETS)
def test_writes_every_target(run, cal, target):
    ending = TARGETS[target].ending
    outcome = run("export", cal, "--to", target, "--rate", "200 Hz", *NOISE, "--out", f"unit{ending}")
    assert (outcome.status, outcome.err) == (0, "")
    first = outcome.out.splitlines()[0]
    assert first == ("unit_acc.calib, unit_gyro.calib" if target == "imu_tk" else f"unit{ending}")
    assert listed() == sorted(["cal.json", *first.split(", ")])


def test_says_what_was_dropped(run, cal):
    outcome = run("export", cal, "--to", "px4", "--out", "unit.params")
    assert "not held by the target" in outcome.out
    assert "gyro scale: 0.0175 rad/s" in outcome.out  # one percent of 100 deg/s
    machine = json.loads(run("export", cal, "--to", "px4", "--out", "unit.params", "--json").out)
    assert machine["out"] == ["unit.params"]
    assert machine["to"] == "px4"
    dropped = {(d["sensor"], d["what"]): d for d in machine["dropped"]}
    assert dropped["gyro", "scale"]["size"] == pytest.approx(0.01 * machine["at"]["angular_rate"], rel=1e-6)
    assert dropped["gyro", "scale"]["in_noise"] is None


def test_prints_text_without_out(run, cal):
    run("export", cal, "--to", "ardupilot", "--out", "unit.param")
    printed = run("export", cal, "--to", "ardupilot")
    assert printed.status == 0
    assert printed.out == Path("unit.param").read_text(encoding="ascii")
    assert "not held by the target" in printed.err
    machine = json.loads(run("export", cal, "--to", "ardupilot", "--json").out)
    assert machine["text"] == printed.out
    assert listed() == ["cal.json", "unit.param"]


@pytest.mark.parametrize(("target", "what"), [("matlab", "binary"), ("imu_tk", "two files")])
def test_needs_out_for_what_cannot_be_printed(run, cal, target, what):
    outcome = run("export", cal, "--to", target)
    assert outcome.status == 2
    assert what in outcome.err
    assert "--out" in outcome.err


def test_never_overwrites_its_input(run, cal):
    before = cal.read_bytes()
    for out in (cal, Path("folder/../cal.json")):
        outcome = run("export", cal, "--to", "json", "--out", out)
        assert outcome.status == 2
        assert "inputs are never modified" in outcome.err
    Path("u_acc.json").write_bytes(before)
    outcome = run("export", "u_acc.json", "--to", "imu_tk", "--out", "u.json")
    assert outcome.status == 2
    assert Path("u_acc.json").read_bytes() == before
    assert listed() == ["cal.json", "u_acc.json"]


def test_what_is_missing_is_named_with_its_option(run, cal):
    outcome = run("export", cal, "--to", "kalibr", "--rate", "200 Hz", *NOISE[:4], "--out", "imu.yaml")
    assert outcome.status == 2
    assert "--noise gyro_random_walk='... rad/s^2/sqrt(Hz)'" in outcome.err
    assert "accel_density" not in outcome.err
    assert listed() == ["cal.json"]


def test_identifiers_and_instances(run, cal):
    both = run("export", cal, "--to", "px4", "--device-id", "1310988", "--instance", "1").out
    assert "CAL_ACC1_ID\t1310988\t6" in both
    assert "CAL_GYRO1_ID\t1310988\t6" in both
    one = run("export", cal, "--to", "px4", "--device-id", "gyro=1311244").out
    assert "CAL_GYRO0_ID\t1311244\t6" in one
    assert "\tCAL_ACC0_ID" not in one
    warm = run("export", cal, "--to", "ardupilot", "--temperature", "77 degF").out
    assert "INS_ACC1_CALTEMP,25.0\n" in warm


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("px4", "--device-id", "x"), "accel=N"),
        (("px4", "--device-id", "mag=3"), "accel=N"),
        (("px4", "--device-id", "accel=99999999999"), "accel=N"),
        (("px4", "--instance", "7"), "slots 0 to 3"),
        (("kalibr", "--rate", "0 Hz"), "more than zero"),
        (("kalibr", "--rate", "200"), "no unit"),
        (("kalibr", "--noise", "accel_density"), "name=value"),
        (("ardupilot", "--temperature", "25 m"), "temperature"),
        (("kalibr", "--topic", "a b"), "topic"),
        (("px5",), "px5"),
    ],
)
def test_bad_options(run, cal, arguments, words):
    outcome = run("export", cal, "--to", *arguments)
    assert outcome.status == 2
    assert words in " ".join(outcome.err.split())
    assert listed() == ["cal.json"]


def test_a_calibration_without_sensors_is_no_export(run, cal):
    text = json.loads(cal.read_text(encoding="utf-8"))
    text["method"] = "roll-isolated"
    cal.write_text(json.dumps(text), encoding="utf-8")
    outcome = run("export", cal, "--to", "json")
    assert outcome.status == 1
    assert "encoder" in outcome.err
