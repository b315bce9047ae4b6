"""``sagnac simulate`` as a user runs it."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from sagnac.cli import commands_simulate
from sagnac.recording import open_recording
from sagnac.simulate.scenario import shipped, text

SHORT = {'dwell = "300 s"': 'dwell = "16 s"', 'turning = "360 s"': 'turning = "36 s"', 'move = "10 s"': 'move = "3 s"'}


@pytest.fixture
def scenario(tmp_path) -> Path:
    """The norm scenario in little."""
    path = tmp_path / "short.toml"
    given = text("norm")
    for old, new in SHORT.items():
        given = given.replace(old, new)
    path.write_text(given)
    return path


def listed(folder: Path = Path()) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_the_shipped_ones_are_listed(run):
    outcome = run("simulate", "--list")
    assert (outcome.status, outcome.err) == (0, "")
    for name, title in shipped().items():
        assert f"{name} " in outcome.out
        assert title in outcome.out
    assert json.loads(run("simulate", "--list", "--json").out) == shipped()
    assert listed() == []


def test_a_shipped_one_is_shown_as_a_file_that_runs(run, tmp_path):
    outcome = run("simulate", "four-position", "--show")
    assert outcome.status == 0
    (tmp_path / "mine.toml").write_text(outcome.out.replace('"600 s"', '"20 s"'))
    assert run("simulate", "mine.toml", "--out", "mine").status == 0


def test_recording_plan_and_truth_are_written(run, scenario, monkeypatch):
    monkeypatch.setattr(commands_simulate, "_announce_compilation", lambda: None)
    outcome = run("simulate", scenario, "--out", "out", "--seed", "3")
    assert outcome.status == 0
    assert listed(Path("out")) == ["plan.toml", "recording.parquet", "truth.json"]
    assert listed() == ["out", "short.toml"]
    # 12 segments of 16 s and 12 of 36 s with 3 s before each, and a second of rest, at 50 Hz
    samples = (12 * (16 + 36) + 24 * 3 + 1) * 50
    assert outcome.err == f"simulating {scenario}: {samples} samples\n"
    assert f"out/recording.parquet  {samples} samples, {samples / 50:g} s" in outcome.out
    # the command that it says comes next runs
    follow = next(line for line in outcome.out.splitlines() if line.startswith("next: sagnac "))
    after = run(*follow.removeprefix("next: sagnac ").split())
    assert after.status == 0
    assert after.out.startswith("Calibration by norm\n")
    assert "cal.json" in listed(Path("out"))


def test_json_for_machines(run, scenario):
    outcome = run("simulate", scenario, "--out", "out", "--seed", "7", "--json")
    table = json.loads(outcome.out)
    truth = json.loads(Path("out/truth.json").read_text())
    assert table["truth"] == truth["parameters"]
    assert table["seed"] == truth["seed"] == 7
    assert [Path(f).name for f in table["files"]] == ["recording.parquet", "plan.toml", "truth.json"]
    assert truth["scenario"]["sha256"] == hashlib.sha256(scenario.read_bytes()).hexdigest()
    assert open_recording("out/recording.parquet", scale={"gyro": "1.1866 pulse/arcsec"}).has == {"accel", "gyro"}


def test_seed_and_threads(run, scenario):
    for out, seed, threads in (("a", 1, 1), ("b", 1, 3), ("c", 2, 1)):
        assert run("simulate", scenario, "--out", out, "--seed", seed, "--threads", threads).status == 0
    a, b, c = (hashlib.sha256(Path(n, "recording.parquet").read_bytes()).hexdigest() for n in "abc")
    assert a == b != c


def test_a_shipped_name_is_no_folder_of_that_name(run):
    Path("four-position").mkdir()
    assert run("simulate", "four-position", "--show").status == 0


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (["simulate"], "simulate: name a SCENARIO (--list shows the shipped ones)"),
        (["simulate", "norm"], "simulate: give the folder with --out DIR"),
        (["simulate", "nothing", "--out", "out"], "there is no scenario nothing; shipped are "),
        (["simulate", "nothing.toml", "--out", "out"], "nothing.toml: cannot read the scenario: "),
        (["simulate", "bad.toml", "--out", "out"], "bad.toml: recording.frequency: '50 s' has s where Hz is needed"),
        (["simulate", "huge.toml", "--out", "out"], "huge.toml: recording: some "),
        (["simulate", "fast.toml", "--out", "out"], "segment 'r1' turns 360 deg from sample to sample"),
        (["simulate", "short.toml", "--out", "short.toml"], "cannot write short.toml/recording.parquet: "),
    ],
)
def test_what_cannot_be_has_status_two_and_leaves_nothing(run, scenario, line, says):
    given = scenario.read_text()
    Path("bad.toml").write_text(given.replace('"50 Hz"', '"50 s"'))
    Path("huge.toml").write_text(given.replace('"50 Hz"', '"1e12 Hz"'))
    Path("fast.toml").write_text(given.replace('"10 deg/s"', '"18000 deg/s"'))
    before = listed()
    outcome = run(*line)
    assert outcome.status == 2
    assert outcome.out == ""
    assert outcome.err.startswith("sagnac: ")
    assert outcome.err.count("\n") == 1
    assert says in outcome.err
    assert listed() == before


def test_the_scenario_is_not_overwritten(run, scenario):
    shutil.copy(scenario, "plan.toml")
    before = Path("plan.toml").read_bytes()
    outcome = run("simulate", "plan.toml", "--out", ".")
    assert outcome.status == 2
    assert "inputs are never modified" in outcome.err
    assert Path("plan.toml").read_bytes() == before
    assert listed() == ["plan.toml", "short.toml"]


def test_a_full_disk_is_seen_before_the_start(run, scenario, monkeypatch):
    class Usage(NamedTuple):
        free: int

    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1_000_000))
    outcome = run("simulate", scenario, "--out", "out")
    assert outcome.status == 2
    # 34850 samples of time (8 bytes) and six counts (4): 1.1 MB
    assert "some 0.00112 GB would be written, 0.001 GB are free" in outcome.err
    assert listed() == ["short.toml"]


def test_usage(run):
    assert run("simulate", "norm", "--out", "out", "--seed", "-1").status == 2
    assert run("simulate", "norm", "--out", "out", "--threads", "0").status == 2
    assert listed() == []
