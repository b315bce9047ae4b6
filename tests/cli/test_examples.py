"""Every example that a command's help shows is run, in a folder with the files that it names."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import typer
from inputs import CAMPAIGN, WANTED
from pyarrow import csv, parquet

from sagnac.align.transfer import covariance
from sagnac.calibrate import calibrate
from sagnac.calibration import UnitName
from sagnac.calibration import load as load_calibration
from sagnac.campaign import run as campaigns
from sagnac.campaign import spec
from sagnac.cli import app
from sagnac.earth import EARTH_RATE, normal_gravity
from sagnac.recording import SENSORS, open_recording
from sagnac.registry import open_registry
from sagnac.registry.candidates import of_content
from sagnac.sensors import Correction
from sagnac.simulate.hand import simulate_hand_turned
from sagnac.simulate.run import run as simulate
from sagnac.simulate.scenario import load, text

COMMANDS = {
    f"{name} {inner}" if inner else name: command
    for name, group in typer.main.get_command(app).commands.items()
    for inner, command in (getattr(group, "commands", None) or {"": group}).items()
}
EXAMPLES = [line for command in COMMANDS.values() for line in re.findall(r"`(sagnac .*?)`", command.epilog or "")]


def as_csv(source: Path, target: Path) -> None:
    csv.write_csv(parquet.read_table(source), target)


def simulated(folder: Path, name: str, **shorter: str) -> Path:
    """Files of a shipped scenario, with other durations."""
    given = text(name)
    for key, value in shorter.items():
        given = re.sub(rf'^{key} = ".*"', f'{key} = "{value}"', given, flags=re.MULTILINE)
    (folder / f"{name}.toml").write_text(given)
    simulate(load(folder / f"{name}.toml"), folder / name, seed=1)
    return folder / name


def hand_turned(path: Path) -> None:
    plain = [Correction(s, np.eye(3), np.zeros(3)) for s in ("accel", "gyro")]
    time, accel, gyro = simulate_hand_turned(
        *plain, np.random.default_rng(1), gravity=9.81744, accel_noise=0.01, gyro_noise=2e-3
    )
    columns = {"time [s]": time}
    for axes, values, unit in ((SENSORS["accel"], accel, "m/s^2"), (SENSORS["gyro"], gyro, "rad/s")):
        columns |= {f"{a} [{unit}]": values[:, i] for i, a in enumerate(axes)}
    csv.write_csv(pa.table(columns), path)


def parked(path: Path, latitude: float = np.radians(34.246), height: float = 380.0) -> None:
    """Pulses of a level laser-gyro unit that points north, for five and a half minutes at 50 Hz."""
    rng = np.random.default_rng(2)
    time = np.arange(1, 16501) / 50
    rate = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    force = np.array([0.0, 0.0, normal_gravity(latitude, height)])
    columns = {"time [s]": time}
    for axes, true, density, pulse in (
        (SENSORS["gyro"], rate, 3e-7, np.radians(0.1 / 3600)),
        (SENSORS["accel"], force, 1e-4, 1 / 817.996),
    ):
        total = np.cumsum(true / 50 + density * np.sqrt(1 / 50) * rng.normal(size=(time.size, 3)), axis=0)
        counted = np.diff(np.floor(total / pulse), axis=0, prepend=0.0)
        columns |= {f"{a} [pulse]": counted[:, i] for i, a in enumerate(axes)}
    parquet.write_table(pa.table(columns), path)


def still(path: Path) -> None:
    """A unit at rest for five minutes at 100 Hz: white noise of 50 ug/sqrt(Hz) and 0.1 deg/sqrt(h)."""
    rng = np.random.default_rng(3)
    n = 30_000
    columns = {"time [s]": np.arange(n) / 100}
    for axes, mean, size, unit in (
        (SENSORS["accel"], 1.0, 50e-6 * 10, "g"),
        (SENSORS["gyro"], 0.0, 0.1 / 60 * 10, "deg/s"),
    ):
        columns |= {f"{a} [{unit}]": mean * (a == "accel_z") + size * rng.normal(size=n) for a in axes}
    parquet.write_table(pa.table(columns), path)


def fleet(folder: Path) -> None:
    """A registry with three years of a unit, and a calibration that does not say which unit it is of."""
    unit = UnitName(model="LG-1", serial="0001")
    with open_registry(folder / "fleet.db", write=True) as registry:
        for year, file in ((2023, "as-found"), (2024, "last-year"), (2025, "cal")):
            made = load_calibration(folder / f"{file}.json")
            made = made.model_copy(update={"unit": unit, "created": f"{year}-06-01T10:00:00+00:00"})
            list(registry.add([of_content(made.to_json().encode(), f"{file}.json")]))
    load_calibration(folder / "cal.json").model_copy(update={"unit": UnitName()}).save(folder / "hand.json")


@pytest.fixture(scope="module")
def files(rig, rig_again, tmp_path_factory) -> Path:
    """A folder with every file that an example names."""
    made, folder = tmp_path_factory.mktemp("made"), tmp_path_factory.mktemp("files")
    shutil.copy(rig.plan_file, folder / "plan.toml")
    as_csv(rig.recording, folder / "recording.csv")
    as_csv(rig_again.recording, folder / "check.csv")
    shutil.copy(rig_again.recording, folder / "check.parquet")
    shutil.copy(rig_again.plan_file, folder / "check.toml")
    for file, method, result in (
        ("recording.csv", "norm", "cal.json"),
        ("check.csv", "norm", "last-year.json"),
        ("recording.csv", "multi-position", "as-found.json"),
    ):
        calibrate(method, open_recording(folder / file, scale=rig.plan.unit.scale), rig.plan).save(folder / result)
    fleet(folder)
    hand_turned(folder / "log.csv")
    arm = simulated(made, "centrifuge-accel")
    as_csv(arm / "recording.parquet", folder / "spun.csv")
    shutil.copy(arm / "plan.toml", folder / "arm.toml")
    ship = simulated(made, "transfer-s-turn", duration="20 s")
    for name in ("master.parquet", "recording.parquet", "config.toml"):
        shutil.copy(ship / name, folder / name)
    covariance(folder / "config.toml", folder / "aligned")
    shutil.copy(folder / "aligned" / "alignment.json", folder)
    (folder / "details.toml").write_text('number = "C-1"\n[laboratory]\nname = "The laboratory"\n')
    (folder / "limits.toml").write_text('[limits]\n"accel.bias.*" = "10 mg"\n')
    parked(folder / "parked.parquet")
    still(folder / "still.parquet")
    (folder / "wanted.toml").write_text(WANTED)
    shutil.copy(made / "transfer-s-turn.toml", folder / "scenario.toml")
    (folder / "campaign.toml").write_text(CAMPAIGN)
    campaigns.run(spec.load(folder / "campaign.toml"), folder / "runs", workers=1)
    return folder


def _out(line: str) -> str:
    words = shlex.split(line)
    return words[words.index("--out") + 1] if "--out" in words else ""


@pytest.mark.parametrize("line", EXAMPLES)
def test_the_example_runs(run, files, tmp_path, line):
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    words = shlex.split(line)[1:]
    if "monte-carlo" in words:  # as many as tell anything in a test
        words[words.index("--runs") + 1] = "20"
    if "navigate" in words:  # what it starts from is made by another example
        assert run(*shlex.split(next(e for e in EXAMPLES if "align static" in e))[1:]).status == 0
    outcome = run(*words)
    assert outcome.status == 0, outcome.err
    asked = _out(line)
    assert not asked or (tmp_path / asked).exists()
