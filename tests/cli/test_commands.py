"""The command line: results, exit statuses, and files left as they were."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

import sagnac
from sagnac.calibration import load, loads
from sagnac.cli import app, options
from sagnac.cli.opening import Opening
from sagnac.errors import InputError
from sagnac.recording import open_recording

COMMANDS = {
    f"{name} {inner}" if inner else name: command
    for name, group in typer.main.get_command(app).commands.items()
    for inner, command in (getattr(group, "commands", None) or {"": group}).items()
}


def listed(folder: Path = Path()) -> list[str]:
    """Names in a folder."""
    return sorted(p.name for p in folder.iterdir())


@pytest.fixture(scope="module")
def cal(rig, tmp_path_factory):
    """Calibration of the rig's recording by multi-position."""
    from sagnac.calibrate import calibrate

    out = tmp_path_factory.mktemp("cal") / "cal.json"
    recording = open_recording(rig.recording, scale=rig.plan.unit.scale)
    calibrate("multi-position", recording, rig.plan).save(out)
    return out


def digest(*paths: Path) -> list[str]:
    return [hashlib.sha256(p.read_bytes()).hexdigest() for p in paths]


# ------------------------------------------------------------------------------------------------------ help


def test_help_without_arguments(run):
    outcome = run()
    assert "Usage: " in outcome.out + outcome.err
    for name in COMMANDS:
        assert name.split()[0] in outcome.out + outcome.err


def test_version(run):
    assert run("--version").out.strip() == f"sagnac {sagnac.__version__}"


def examples() -> list[tuple[str, str]]:
    return [
        (name, line)
        for name, command in COMMANDS.items()
        for line in re.findall(r"`(sagnac .*?)`", command.epilog or "")
    ]


def test_every_command_has_an_example():
    assert {name for name, _ in examples()} == set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_the_example(run, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", "300")
    outcome = run(*name.split(), "--help")
    assert outcome.status == 0
    text = " ".join(outcome.out.split())
    for _, line in (e for e in examples() if e[0] == name):
        assert line in text


@pytest.mark.parametrize(("name", "line"), examples())
def test_examples_are_command_lines_that_parse(name, line):
    depth = 1 + len(name.split())
    called, arguments = shlex.split(line)[:depth], shlex.split(line)[depth:]
    assert called == ["sagnac", *name.split()]
    context = COMMANDS[name].make_context(name, arguments)
    assert context.params  # parsed, not run


# ------------------------------------------------------------------------------------------- the way it should go


def test_calibrate_writes_and_prints_the_same_result(run, rig, tmp_path):
    before = digest(rig.recording, rig.plan_file)
    outcome = run("calibrate", "multi-position", rig.recording, "--plan", rig.plan_file, "--out", "cal.json", "--json")
    assert (outcome.status, outcome.err) == (0, "written: cal.json\n")
    assert loads(outcome.out) == load(tmp_path / "cal.json")
    # gyro biases of [DONG18] within six standard uncertainties as the result states them
    result = load(tmp_path / "cal.json")
    for axis, truth in zip("xyz", (-0.34, 0.17, -0.02), strict=True):
        p = result[f"gyro.bias.{axis}"]
        assert abs(p.value - truth * np.pi / 648000) < 6 * p.standard_uncertainty
    assert result.source[0].sha256 == before[0]
    assert result.unit.scale == rig.plan.unit.scale
    assert digest(rig.recording, rig.plan_file) == before
    assert listed(tmp_path) == ["cal.json"]


def test_calibrate_prints_a_page_without_json(run, rig):
    outcome = run("calibrate", "multi-position", rig.recording, "--plan", rig.plan_file)
    assert outcome.status == 0
    assert outcome.out.startswith("Calibration by multi-position\n")
    assert "accel.scale_error.x" in outcome.out
    assert listed() == []


def test_site_options_lie_over_the_plan(run, rig):
    lines = ["calibrate", "multi-position", rig.recording, "--plan", rig.plan_file, "--json"]
    plain = loads(run(*lines).out)
    moved = loads(run(*lines, "--gravity", "9.81 m/s^2").out)
    assert moved.site.gravity == 9.81
    # the accelerometer scale goes with gravity: 9.81 / 9.80665 to first order
    ratio = (1 + plain["accel.scale_error.y"].value) / (1 + moved["accel.scale_error.y"].value)
    assert ratio == pytest.approx(9.81 / 9.80665, rel=1e-6)


def test_apply(run, rig, cal, tmp_path):
    before = digest(rig.recording, cal)
    outcome = run("apply", cal, rig.recording, "--out", "out.parquet", "--json")
    assert outcome.status == 0
    samples = open_recording(rig.recording, scale=rig.plan.unit.scale).read().time.size
    assert json.loads(outcome.out) == {"out": "out.parquet", "samples": samples}
    assert outcome.err == f"compensating recording.parquet: {samples} samples\n"
    batch = open_recording(tmp_path / "out.parquet").read()
    still = (batch.time > 4) & (batch.time < 18)  # the first static segment, 3 s to 19 s
    # ten millionths of g per root hertz over 14 s are 3e-5 m/s^2; the calibration adds some 1e-4 for table errors
    assert np.linalg.norm(batch.accel[still].mean(axis=0)) == pytest.approx(9.80665, abs=2e-3)
    assert digest(rig.recording, cal) == before
    assert listed(tmp_path) == ["out.parquet"]


def test_verify_passes_and_says_so(run, rig, cal):
    outcome = run("verify", cal, rig.recording, "--plan", rig.plan_file, "--json")
    assert outcome.status == 0
    result = json.loads(outcome.out)
    assert result["passed"] is True
    assert len(result["checks"]) == 48  # twelve norms of gravity, twelve of the rate, twelve axes of two components


def test_verify_fails_with_status_one(run, rig, cal, tmp_path):
    table = json.loads(cal.read_text())
    for p in table["parameters"]:
        if p["name"] == "accel.bias.z":
            p["value"] += 0.05  # 5 mg
    (tmp_path / "wrong.json").write_text(json.dumps(table))
    outcome = run("verify", "wrong.json", rig.recording, "--plan", rig.plan_file)
    assert outcome.status == 1
    assert "FAIL: chi-square" in outcome.out


# ---------------------------------------------------------------------------------------- statuses 1 and 2


def csv_of(path: Path, rows: int, header="time [s],accel_x [g],accel_y [g],accel_z [g]") -> Path:
    body = "".join(f"{i / 10!r},0.{i % 7},0.1,1\n" for i in range(1, rows + 1))
    path.write_text(header + "\n" + body)
    return path


def test_usage_errors_have_status_two(run):
    for line in (
        ["calibrate"],
        ["calibrate", "guess", "log.csv"],
        ["calibrate", "norm", "log.csv", "--no-such-option"],
        ["apply", "cal.json", "log.csv"],
        ["invent"],
        ["demo", "--seed", "-1"],
    ):
        assert run(*line).status == 2, line


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (["calibrate", "norm", "nowhere.csv"], "sagnac: nowhere.csv: cannot read: No such file"),
        (["calibrate", "norm", "bare.csv"], "column 'accel_x' has no unit. Write it in the header"),
        (["calibrate", "norm", "log.csv", "--units", "accel"], "--units 'accel': write name=value pairs"),
        (["calibrate", "norm", "log.csv", "--units", "acel=g"], "'acel' is none of accel"),
        (["calibrate", "norm", "log.csv", "--map", "accel_x=Q"], "has no column 'Q'"),
        (["calibrate", "norm", "log.csv", "--scale", "accel"], "--scale 'accel': write name=value pairs"),
        (["calibrate", "norm", "log.csv", "--gravity", "9.81"], "gravity: '9.81' has no unit"),
        (["calibrate", "norm", "log.csv", "--latitude", "99 deg"], "latitude 99 deg is beyond a pole"),
        (["calibrate", "norm", "log.csv", "--plan", "nowhere.toml"], "nowhere.toml: cannot read the plan"),
        (["calibrate", "four-position", "log.csv"], "four-position needs a plan (--plan)"),
        (["calibrate", "norm", "log.csv", "--plot", "plot.xyz"], "--plot plot.xyz: write to a .png, .svg or .pdf file"),
        (["apply", "nowhere.json", "log.csv", "--out", "out.csv"], "nowhere.json: cannot read the calibration"),
        (["apply", "log.csv", "log.csv", "--out", "out.csv"], "log.csv: not a JSON file"),
        (["verify", "nowhere.json", "log.csv"], "nowhere.json: cannot read the calibration"),
    ],
)
def test_unusable_input_has_status_two_and_one_line(run, tmp_path, line, says):
    csv_of(tmp_path / "log.csv", 50)
    csv_of(tmp_path / "bare.csv", 50, "time [s],accel_x,accel_y,accel_z")
    before = listed()
    if line[0] == "calibrate":
        line = [*line, "--out", "cal.json"]
    outcome = run(*line)
    assert outcome.status == 2
    assert says in outcome.err
    assert outcome.err.startswith("sagnac: ")
    assert outcome.err.count("\n") == 1
    assert outcome.out == ""
    assert listed() == before


def test_data_that_do_not_support_the_result_have_status_one(run, rig, tmp_path):
    short = tmp_path / "short.csv"
    csv_of(short, 50)
    outcome = run("calibrate", "multi-position", short, "--plan", rig.plan_file, "--out", "cal.json")
    assert outcome.status == 1
    assert "segment 's1' (3 s to 19 s) lies outside the data of" in outcome.err
    assert listed() == ["short.csv"]


def test_a_bad_sample_half_way_leaves_no_output(run, cal, tmp_path):
    log = tmp_path / "log.csv"
    csv_of(log, 3000)
    log.write_text(log.read_text() + "1000,nan,0,1\n")
    outcome = run("apply", cal, log, "--out", "out.csv")
    assert outcome.status == 2
    assert "row 3001: accel_x is missing or not a number" in outcome.err
    assert listed() == ["log.csv"]


# ------------------------------------------------------------------------------------ inputs are not overwritten


def test_no_output_over_an_input(run, rig, cal, tmp_path):
    log, plan, model = (tmp_path / n for n in ("log.parquet", "plan.toml", "model.csv"))
    for source, copy in ((rig.recording, log), (rig.plan_file, plan), (cal, model)):
        copy.write_bytes(source.read_bytes())
    (tmp_path / "link.parquet").symlink_to(log)
    before = digest(log, plan, model)
    calibrate = ["calibrate", "multi-position", log, "--plan", plan]
    for line in (
        [*calibrate, "--out", log],
        [*calibrate, "--out", "./log.parquet"],
        [*calibrate, "--out", "link.parquet"],
        [*calibrate, "--out", plan],
        [*calibrate, "--out", "new.png", "--plot", "new.png"],
        ["apply", model, log, "--out", log],
        ["apply", model, log, "--out", model],
        ["apply", model, log, "--plan", plan, "--out", "link.parquet"],
    ):
        outcome = run(*line)
        assert outcome.status == 2, line
        assert "inputs are never modified" in outcome.err or "is written by --out already" in outcome.err
    assert digest(log, plan, model) == before
    assert listed() == ["link.parquet", "log.parquet", "model.csv", "plan.toml"]


# -------------------------------------------------------------------------------------------- option texts


@pytest.mark.parametrize(
    ("text", "table"),
    [
        (None, {}),
        ("", {}),
        ("accel=g,gyro=deg/s", {"accel": "g", "gyro": "deg/s"}),
        (" accel = g , gyro=deg/s ,", {"accel": "g", "gyro": "deg/s"}),
        ("accel_x=AX [a=b]", {"accel_x": "AX [a=b]"}),
    ],
)
def test_pairs(text, table):
    assert options.pairs(text, "--map") == table


@pytest.mark.parametrize("text", ["accel", "=g", "accel=", "accel=g,gyro", "a b"])
def test_pairs_that_are_none(text):
    with pytest.raises(InputError, match="--units .*: write name=value pairs with commas between"):
        options.pairs(text, "--units")


def test_scale_may_stand_several_times(run, tmp_path):
    (tmp_path / "log.csv").write_text(
        "time [s],gyro_x [pulse],gyro_y [pulse],gyro_z [pulse]\n" + "".join(f"{i / 10},9,9,9\n" for i in range(1, 9))
    )
    opened = Opening(scale=["gyro=1 pulse/arcsec", "gyro_z=2pulse/arcsec"]).open(tmp_path / "log.csv")
    # 9 pulses in 0.1 s at 1 and 2 pulse/arcsec: 90 and 45 arcsec/s
    np.testing.assert_allclose(opened.read().gyro[0] * 648000 / np.pi, [90, 90, 45], rtol=1e-12)


def test_the_module_runs_as_a_program(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", "from sagnac.cli import main; main()", "calibrate", "norm", "nowhere.csv"],
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == "sagnac: nowhere.csv: cannot read: No such file or directory\n"
