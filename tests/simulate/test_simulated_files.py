"""Scenarios to files, and calibrations of them against the truth."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet
from test_scenario import changed, table_of

from sagnac.calibrate import METHODS, calibrate
from sagnac.calibration import Calibration
from sagnac.errors import InputError
from sagnac.plan import load as load_plan
from sagnac.recording import open_recording
from sagnac.simulate import scenario as scenarios
from sagnac.simulate.run import Simulated, run

DEG = math.pi / 180


def shortened(name: str = "norm", frequency: str = "20 Hz", **plan: object) -> scenarios.Scenario:
    table = table_of(name)
    table["recording"]["frequency"] = frequency
    table["plan"] |= plan
    return scenarios.from_table(table, name)


def quick() -> scenarios.Scenario:
    return shortened(dwell="4 s", turning="9 s", move="2 s")


def digests(done: Simulated) -> list[str]:
    return [hashlib.sha256(f.read_bytes()).hexdigest() for f in done.files]


def test_the_same_seed_gives_the_same_files(tmp_path):
    one, two, three = (
        digests(run(quick(), tmp_path / str(k), seed=s, threads=t)) for k, (s, t) in enumerate([(1, 1), (1, 3), (2, 1)])
    )
    assert one == two
    assert one[0] != three[0]
    assert one[1] == three[1]  # the plan does not know the truth
    assert one[2] != three[2]


def test_files_read_back(tmp_path):
    counted = []
    done = run(quick(), tmp_path, seed=5, progress=counted.append)
    assert [f.name for f in done.files] == ["recording.parquet", "plan.toml", "truth.json"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f.name for f in done.files)
    plan = load_plan(tmp_path / "plan.toml")
    assert plan == done.scenario.plan
    batch = open_recording(done.files[0], scale=plan.unit.scale).read()
    assert batch.time.size == done.samples == counted[-1]
    assert batch.time[-1] == pytest.approx(plan.segment[-1].stop + 1.0)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["schema"] == "sagnac/truth/1"
    assert truth["seed"] == 5
    assert truth["parameters"] == done.truth
    assert truth["misalignment"] == "element"
    assert len(truth["setting_errors"]) == 24
    assert truth["noise"]["gyro"]["density"] == pytest.approx(0.001 * DEG / 60)


@pytest.mark.parametrize("scaled", [True, False])
def test_csv_holds_the_same_samples(tmp_path, scaled):
    done = {}
    for kind in ("csv", "parquet"):
        table = changed("norm", "recording", {"frequency": "20 Hz", "format": kind, "rig": True})
        table["plan"] |= {"dwell": "2 s", "turning": "2 s", "move": "2 s"}
        table["unit"]["temperature"] = {"profile": "ramp", "start": "20 degC", "stop": "30 degC"}
        if not scaled:
            table["unit"].pop("scale")
        scenario = scenarios.from_table(table)
        files = run(scenario, tmp_path, seed=1).files
        done[kind] = open_recording(files[0], scale=scenario.plan.unit.scale).read()
    assert files[0].name == "recording.parquet"
    for a, b in ((getattr(done["csv"], n), getattr(done["parquet"], n)) for n in ("time", "accel", "gyro")):
        np.testing.assert_array_equal(a, b)
    assert done["csv"].rig.keys() == {"outer", "middle", "inner", "temperature"}
    temperature = done["csv"].rig["temperature"] - 273.15
    assert temperature[0] == pytest.approx(20.0, abs=0.05)
    assert temperature[-1] == pytest.approx(30.0, abs=1e-9)


def test_one_axis_alone(tmp_path):
    table = changed("centrifuge-accel", "recording/sensors", ["accel_z"])
    table["plan"]["turns"] = 1.0
    done = run(scenarios.from_table(table), tmp_path, seed=1)
    assert parquet.read_schema(done.files[0]).names == ["time [s]", "accel_z [m/s^2]"]


def test_a_recording_too_large_for_the_disk_is_refused_at_once(tmp_path):
    scenario = shortened(frequency="1e9 Hz")
    with pytest.raises(InputError, match=r"norm: recording: some .* GB would be written, .* GB are free in"):
        run(scenario, tmp_path / "new", seed=1)
    assert not (tmp_path / "new").exists()


def test_a_failure_on_the_way_leaves_nothing(tmp_path):
    table = changed("norm", "unit/scale", {"gyro": "1e12 pulse/arcsec"})
    table["plan"]["dwell"] = "2 s"
    with pytest.raises(InputError, match=r"unit.scale: gyro_x counts more than 2147483647 pulses in a sample"):
        run(scenarios.from_table(table), tmp_path, seed=1)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_run_keeps_the_files_of_the_last_one(tmp_path):
    before = digests(run(quick(), tmp_path, seed=1))

    def stop(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(quick(), tmp_path, seed=2, progress=stop)
    assert digests(run(quick(), tmp_path / "again", seed=1)) == before
    assert [hashlib.sha256((tmp_path / f).read_bytes()).hexdigest() for f in _NAMES] == before
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*_NAMES, "again"])


_NAMES = ("recording.parquet", "plan.toml", "truth.json")


# ------------------------------------------------------------------- calibrations of what was simulated, and truth


def calibrated(name: str, folder: Path, seed: int) -> tuple[Simulated, Calibration]:
    """A shipped scenario and the calibration that it is for."""
    done = run(scenarios.load(name), folder, seed=seed)
    plan = load_plan(folder / "plan.toml")
    recording = open_recording(done.files[0], scale=plan.unit.scale)
    return done, calibrate(done.scenario.method, recording, plan)


def deviations(done: Simulated, result: Calibration) -> dict[str, float]:
    """Error over standard uncertainty of each parameter."""
    assert {p.name for p in result.parameters} <= set(done.truth)
    known = (p for p in result.parameters if p.standard_uncertainty > 0)
    return {p.name: (p.value - done.truth[p.name]) / p.standard_uncertainty for p in known}


_TABLES = ("four-position", "multi-position", "table")
_CENTRIFUGES = ("centrifuge-accel", "centrifuge-gyro")
FOLLOWED = [n for n in scenarios.shipped() if scenarios.load(n).method in METHODS]


@pytest.mark.parametrize("name", FOLLOWED)
def test_calibrating_a_shipped_scenario_finds_its_truth(tmp_path, name):
    done, result = calibrated(name, tmp_path, 1)
    z = deviations(done, result)
    # up to 34 parameters: beyond 4.5 standard uncertainties once in 4000 runs
    assert max(abs(v) for v in z.values()) < 4.5, z
    assert result.misalignment == json.loads((tmp_path / "truth.json").read_text())["misalignment"]


@pytest.mark.statistical
@pytest.mark.parametrize("name", [n for n in (*_TABLES, *_CENTRIFUGES) if n in FOLLOWED])
def test_errors_are_what_the_uncertainties_say(tmp_path, name):
    runs = 12
    z = np.array([list(deviations(*calibrated(name, tmp_path, 100 + s)).values()) for s in range(runs)])
    # mean square over k parameters and 12 seeds is one; its standard deviation is sqrt(2 / (12 k)) for independent
    # parameters, and twice that allows for correlated ones
    assert np.mean(z**2) == pytest.approx(1.0, abs=8 * math.sqrt(2 / z.size))
