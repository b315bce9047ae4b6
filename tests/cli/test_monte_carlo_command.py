"""``sagnac align monte-carlo`` as a user runs it."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from sagnac.cli.commands import app

CONFIG = """
[initial]
misalignment = ["0.2 deg", "0.2 deg", "0.5 deg"]
velocity = "0.2 m/s"
gyro_bias = "0.01 deg/h"
accel_bias = "50 ug"
[noise]
gyro = "0.001 deg/sqrt(h)"
accel = "0.833 ug/sqrt(Hz)"
velocity = "0.01 m/s"
[trajectory]
latitude = "60 deg"
speed = "10 m/s"
heading = "90 deg"
[[trajectory.leg]]
duration = "20 s"
turn_rate = "3 deg/s"
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "config.toml"
    path.write_text(CONFIG)
    return path


def test_it_prints_errors_against_sigmas(config):
    done = CliRunner().invoke(
        app, ["align", "monte-carlo", "--config", str(config), "--runs", "32", "--frequency", "20"]
    )
    assert done.exit_code == 0, done.output
    assert "32 runs, wander form" in done.output
    assert "NEES" in done.output


def test_machines_get_the_arrays_and_the_seed_settles_them(config):
    words = [
        "align",
        "monte-carlo",
        "--config",
        str(config),
        "--runs",
        "16",
        "--frequency",
        "20",
        "--seed",
        "4",
        "--json",
    ]
    once, again = (CliRunner().invoke(app, [*words, "--threads", str(k)]) for k in (1, 2))
    table = json.loads(once.stdout)
    assert table == json.loads(again.stdout)
    assert len(table["rms"][0]) == len(table["names"]) == 11
    assert table["time"][-1] == 20.0


def test_what_it_cannot_do_is_named(config):
    config.write_text(CONFIG.replace("[initial]", 'states = "full"\n[initial]', 1))
    done = CliRunner().invoke(app, ["align", "monte-carlo", "--config", str(config)])
    assert done.exit_code != 0
    assert "full" in str(done.exception)
