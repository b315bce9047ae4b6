"""Calibrations of the recordings of a fleet."""

from __future__ import annotations

import pickle

import pytest
from campaign_tables import SMALL, norm

from sagnac._version import __version__
from sagnac.calibrate import calibrate
from sagnac.calibration import load
from sagnac.campaign import spec
from sagnac.campaign.chunks import Part, UnfitError
from sagnac.campaign.tasks import fleet, prepare
from sagnac.campaign.work import Job, perform
from sagnac.errors import DataError
from sagnac.recording import open_recording
from sagnac.simulate import scenario as scenarios
from sagnac.simulate.run import run as simulate


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Recordings of three units with a plan each, one recording of another kind, and one that is damaged."""
    folder = tmp_path_factory.mktemp("fleet")
    found = spec.from_table(norm(set={**SMALL, "unit.parameters.accel.bias": "normal 5 mg"}))
    for i in range(3):
        table = {**found.points[0].table, "unit": {**found.points[0].table["unit"], "serial": f"S{i}"}}
        scenario = scenarios.from_table(table)
        simulate(scenario, folder / "made", seed=i)
        (folder / "made" / "recording.parquet").rename(folder / f"log{i}.parquet")
        (folder / "made" / "plan.toml").rename(folder / f"log{i}.toml")
    (folder / "log9.parquet").write_bytes((folder / "log0.parquet").read_bytes()[:3000])
    (folder / "log9.toml").write_bytes((folder / "log0.toml").read_bytes())
    return folder


FLEET = {"recordings": "*.parquet", "plan": "{stem}.toml", "method": "norm"}


def test_a_fleet_has_a_row_and_a_calibration_each(logs, tmp_path):
    task = prepare(spec.from_table(FLEET, folder=logs))
    rows = [task.row(i) for i in range(4)]
    assert [r["recording"] for r in rows] == ["log0.parquet", "log1.parquet", "log2.parquet", "log9.parquet"]
    assert [r["serial"] for r in rows] == ["S0", "S1", "S2", "log9"]
    assert [r["status"] == "ok" for r in rows] == [True, True, True, False]
    assert "damaged" in rows[3]["status"]
    assert str(logs) not in rows[3]["status"]
    assert all(set(r) == set(task.columns) for r in rows)
    assert fleet.write_calibrations(tmp_path, iter(rows)) == 3
    made = load(tmp_path / "calibrations" / "log1.json")
    plain = calibrate("norm", open_recording(logs / "log1.parquet"), spec.plans.load(logs / "log1.toml"))
    assert made.values() == plain.values() == {n[6:]: v for n, v in rows[1].items() if n.startswith("value.")}
    assert made.unit.serial == "S1"
    assert [s.role for s in made.source] == ["recording", "plan"]
    assert made.created > "2020"
    # written again they are the same files: the time that they were made is kept
    before = (tmp_path / "calibrations" / "log1.json").read_bytes()
    fleet.write_calibrations(tmp_path, iter(rows))
    assert (tmp_path / "calibrations" / "log1.json").read_bytes() == before
    assert task.row(1) == rows[1]


def test_one_plan_for_all_takes_the_serial_from_the_file(logs):
    task = prepare(spec.from_table({**FLEET, "plan": "log0.toml"}, folder=logs))
    assert task.row(1)["serial"] == "log1"
    told = prepare(spec.from_table({**FLEET, "plan": "log0.toml", "serial": "plan"}, folder=logs))
    assert told.row(1)["serial"] == "S0"


def test_a_fleet_of_nothing_is_refused(logs):
    with pytest.raises(DataError, match=r"none of the recordings can be calibrated.*damaged"):
        prepare(spec.from_table({**FLEET, "recordings": "log9.parquet"}, folder=logs))


def copied(logs, folder):
    folder.mkdir(parents=True)
    for file in [*logs.glob("*.parquet"), *logs.glob("*.toml")]:
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


def test_rows_are_the_same_wherever_the_fleet_lies(logs, tmp_path):
    table = {**FLEET, "recordings": "../logs/*.parquet", "plan": "../logs/{stem}.toml"}
    rows = []
    for place in ("one", "two/deep"):
        copied(logs, tmp_path / place / "logs")
        (tmp_path / place / "here").mkdir()
        campaign = spec.from_table(table, folder=tmp_path / place / "here")
        rows.append([prepare(campaign).row(i) for i in (0, 3)])
    assert rows[0] == rows[1]
    assert str(tmp_path) not in str(rows)
    fleet.write_calibrations(tmp_path / "made", iter(rows[0]), tmp_path / "one" / "here")
    sources = [s.file for s in load(tmp_path / "made" / "calibrations" / "log0.json").source]
    assert sources == [str(tmp_path / "one" / "logs" / name) for name in ("log0.parquet", "log0.toml")]


def test_a_log_that_changes_meanwhile_ends_the_campaign(logs, tmp_path):
    folder = copied(logs, tmp_path / "logs")
    task = prepare(spec.from_table(FLEET, folder=folder))
    (folder / "log1.toml").write_bytes((folder / "log0.toml").read_bytes())
    (folder / "log9.parquet").unlink()
    for index, name in ((1, "log1.toml"), (3, "log9.parquet")):
        with pytest.raises(UnfitError, match=f"{name} is not what it was when the campaign began"):
            task.row(index)
        reply = perform(pickle.dumps(task), Job(Part(index, index + 1), "f"), __version__)
        assert (reply.kind, reply.chunks) == ("unfit", ())
        assert name in reply.text
    assert task.row(2)["status"] == "ok"


def test_a_missing_plan_costs_its_recording_alone(logs, tmp_path):
    folder = copied(logs, tmp_path / "logs")
    (folder / "log1.toml").unlink()
    task = prepare(spec.from_table(FLEET, folder=folder))
    rows = [task.row(i) for i in range(4)]
    assert [r["status"] == "ok" for r in rows] == [True, False, True, False]
    assert rows[1]["status"].startswith("log1.toml: cannot read the plan: ")
