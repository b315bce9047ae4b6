"""``sagnac campaign`` as a user runs it."""

from __future__ import annotations

import json
import shutil

import pytest

CAMPAIGN = """
title = "Norm calibration"
scenario = "norm"
runs = 6

[set]
"plan.dwell" = "1 s"
"plan.turning" = "0 s"
"plan.move" = "0.5 s"
"recording.frequency" = "16 Hz"
"recording.sensors" = "accel"

[grid]
"rig.errors.setting" = ["normal 1 arcmin", "normal 2 arcmin"]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "C.toml"
    path.write_text(CAMPAIGN)
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A finished campaign: processes are started once for all tests that only read it."""
    from sagnac.campaign import run, spec

    folder = tmp_path_factory.mktemp("made")
    (folder / "C.toml").write_text(CAMPAIGN)
    run.run(spec.load(folder / "C.toml"), folder / "runs", workers=1)
    return folder / "runs"


def test_it_runs_and_tells_and_goes_on(run, file, tmp_path):
    done = run("campaign", "run", "C.toml", "--workers", 2)
    assert done.status == 0, done.err
    assert "Norm calibration: norm, 6 runs at each of 2 points, seed 1" in done.out
    assert "RMSE/bound (95 %)" in done.out
    assert "12 of 12 runs" in done.err
    files = sorted(p.name for p in (tmp_path / "C").iterdir() if not p.name.startswith("."))
    assert files == ["campaign.json", "chunks", "results.parquet", "summary.json"]
    whole = (tmp_path / "C" / "results.parquet").read_bytes()
    # a second start has nothing left to do; of a lost chunk, and other workers, the same bytes come
    next((tmp_path / "C" / "chunks").glob("*.parquet")).unlink()
    (tmp_path / "C" / "results.parquet").unlink()
    again = run("campaign", "run", "C.toml", "--workers", 1, "--json")
    assert again.status == 0, again.err
    assert json.loads(again.out)["complete"] is True
    assert (tmp_path / "C" / "results.parquet").read_bytes() == whole


def test_another_campaign_in_the_folder_is_refused(run, file, made, tmp_path):
    shutil.copytree(made, tmp_path / "runs")
    file.write_text(CAMPAIGN.replace("runs = 6", "runs = 7"))
    done = run("campaign", "run", "C.toml", "--out", "runs")
    assert done.status == 2
    assert "another campaign" in done.err
    assert "runs" in done.err


def test_one_run_has_all_its_files_and_is_that_of_the_campaign(run, file, made, tmp_path):
    from pyarrow import parquet

    row = parquet.read_table(made / "results.parquet").to_pylist()[7]
    done = run("campaign", "run", "C.toml", "--only", 7, "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out) == row == json.loads((tmp_path / "C-7" / "row.json").read_text())
    assert {p.name for p in (tmp_path / "C-7").iterdir()} == {
        "calibration.json", "plan.toml", "recording.parquet", "row.json", "scenario.toml", "truth.json"
    }  # fmt: skip
    same = run("simulate", "C-7/scenario.toml", "--out", "S", "--seed", row["seed"])
    assert same.status == 0
    assert (tmp_path / "S" / "recording.parquet").read_bytes() == (tmp_path / "C-7" / "recording.parquet").read_bytes()
    truth = json.loads((tmp_path / "C-7" / "truth.json").read_text())["parameters"]
    found = {
        p["name"]: p["value"] for p in json.loads((tmp_path / "C-7" / "calibration.json").read_text())["parameters"]
    }
    name = "accel.bias.x"
    assert found[name] - truth[name] == pytest.approx(row[f"error.{name}"], rel=1e-9)
    plain = run("campaign", "run", "C.toml", "--only", 7, "--out", "D")
    assert "error.accel.bias.x" in plain.out
    assert "files of the run: D" in plain.out


def test_results_are_shown_with_pictures(run, made, tmp_path):
    done = run("campaign", "show", made, "--plot", "pictures")
    assert done.status == 0, done.err
    assert [line for line in done.out.splitlines() if line.startswith("written: ")] == [
        "written: pictures/point-0.png",
        "written: pictures/point-1.png",
        "written: pictures/along-rig-errors-setting.png",
    ]
    one = run("campaign", "show", made, "--point", 1, "--plot", "one.svg")
    assert one.status == 0
    assert "point 1: rig.errors.setting" in one.out
    assert "point 0: rig" not in one.out
    assert (tmp_path / "one.svg").is_file()
    table = json.loads(run("campaign", "show", made, "--json").out)
    assert (table["schema"], table["done"], table["complete"]) == ("sagnac/campaign-summary/1", 12, True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "none.toml"), "cannot read the campaign"),
        (("run", "C.toml", "--only", "12"), "the runs of C.toml are 0 to 11"),
        (("run", "C.toml", "--out", "C.toml"), "is a file; the results need a folder"),
        (("run", "C.toml", "--only", "1", "--out", "C.toml"), "is a file"),
        (("show", "nowhere"), "cannot read the campaign"),
        (("show", "runs", "--point", "2"), "has no such point"),
        (("show", "runs", "--plot", "x.gif"), ".png, .svg or .pdf"),
    ],
)
def test_what_cannot_be_is_told(run, file, made, tmp_path, arguments, said):
    shutil.copytree(made, tmp_path / "runs")
    done = run("campaign", *arguments)
    assert done.status == 2
    assert said in done.err


def test_inputs_are_kept(run, file, tmp_path):
    (tmp_path / "in").mkdir()
    assert run("simulate", "norm", "--show").status == 0
    (tmp_path / "in" / "scenario.toml").write_text(run("simulate", "norm", "--show").out)
    (tmp_path / "in" / "C.toml").write_text(CAMPAIGN.replace('"norm"\nruns', '"scenario.toml"\nruns'))
    done = run("campaign", "run", "in/C.toml", "--only", 0, "--out", "in")
    assert done.status == 2
    assert "inputs are never modified" in done.err


def test_a_run_that_is_refused_has_exit_status_one(run, file, tmp_path):
    few = '"plan.positions" = ["icosahedron", [["0 deg", "0 deg", "0 deg"], ["0 deg", "90 deg", "0 deg"]]]'
    file.write_text(CAMPAIGN.replace('"rig.errors.setting" = ["normal 1 arcmin", "normal 2 arcmin"]', few))
    done = run("campaign", "run", "C.toml", "--only", 11)
    assert done.status == 1
    assert f"run 11: {json.loads((tmp_path / 'C-11' / 'row.json').read_text())['status']}" in done.err


def test_a_fleet_leaves_calibrations_that_can_be_read(run, tmp_path):
    scenario = run("simulate", "norm", "--show").out
    short = scenario.replace('dwell = "300 s"', 'dwell = "5 s"').replace('turning = "360 s"', 'turning = "0 s"')
    (tmp_path / "logs").mkdir()
    for i in (1, 2):
        (tmp_path / "s.toml").write_text(short.replace('"DONG18"', f'"U{i}"'))
        assert run("simulate", "s.toml", "--out", "made", "--seed", i).status == 0
        shutil.move(tmp_path / "made" / "recording.parquet", tmp_path / "logs" / f"u{i}.parquet")
        shutil.move(tmp_path / "made" / "plan.toml", tmp_path / "logs" / f"u{i}.toml")
    (tmp_path / "fleet.toml").write_text('recordings = "logs/*.parquet"\nplan = "logs/{stem}.toml"\nmethod = "norm"\n')
    done = run("campaign", "run", "fleet.toml", "--workers", 1)
    assert done.status == 0, done.err
    assert "fleet: norm, 2 recordings" in done.out
    assert sorted(p.name for p in (tmp_path / "fleet" / "calibrations").iterdir()) == ["u1.json", "u2.json"]
    assert json.loads((tmp_path / "fleet" / "calibrations" / "u2.json").read_text())["unit"]["serial"] == "U2"
    assert run("plot", "fleet/calibrations/u1.json").status == 0
    assert run("campaign", "show", "fleet", "--plot", "fleet.png").status == 0
    assert run("campaign", "run", "fleet.toml", "--only", 1).status == 0


def test_nothing_is_looked_for_before_the_folder_and_the_scheduler(run, file, made, tmp_path, monkeypatch):
    from sagnac.campaign import run as campaigns

    def prepared(*_):
        raise AssertionError("bounds are looked for")

    shutil.copytree(made, tmp_path / "runs")
    monkeypatch.setattr(campaigns, "prepare", prepared)
    whole = (tmp_path / "runs" / "summary.json").read_bytes()
    (tmp_path / "runs" / "summary.json").unlink()
    assert run("campaign", "run", "C.toml", "--out", "runs").status == 0  # bounds stand in the folder
    assert (tmp_path / "runs" / "summary.json").read_bytes() == whole
    file.write_text(CAMPAIGN.replace("runs = 6", "runs = 6\nseed = 2"))
    done = run("campaign", "run", "C.toml", "--out", "runs")
    assert (done.status, "campaign.seed is 1 there, 2 here" in done.err) == (2, True)
    done = run("campaign", "run", "C.toml", "--out", "new", "--scheduler", "tcp://127.0.0.1:9")
    assert (done.status, "no dask scheduler answers" in done.err) == (2, True)
    done = run("campaign", "run", "C.toml", "--out", "new", "--scheduler", "tcp://127.0.0.1:9", "--workers", 1)
    assert (done.status, "give one of them" in done.err) == (2, True)


def test_one_run_bounds_its_own_point_alone(run, file, made, monkeypatch):
    from sagnac.campaign.tasks import calibration

    bounds, bound = [], calibration.bound
    monkeypatch.setattr(calibration, "bound", lambda *a: (bounds.append(a), bound(*a))[1])
    done = run("campaign", "run", "C.toml", "--only", 7)
    assert done.status == 0, done.err
    assert len(bounds) == 1
    line = next(x for x in done.out.splitlines() if "sigma.accel.bias.x" in x)
    assert line.split()[2] == "ug"


def test_slips_are_told(run, file, made, tmp_path):
    shutil.copytree(made, tmp_path / "runs")
    done = run("campaign", "run", "C.toml", "--only", 3, "--out", "runs")
    assert (done.status, "runs: holds a campaign" in done.err) == (2, True)
    file.write_text(CAMPAIGN.replace("runs = 6", 'runs = 6\nparameters = ["acel", "accel.bias"]'))
    done = run("campaign", "run", "C.toml", "--out", "new")
    assert (done.status, "no parameter acel; there are accel.scale_error.x, " in done.err) == (2, True)
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / ".lock").touch()
    done = run("campaign", "show", "begun")
    assert (done.status, "begun: the campaign has only just begun" in done.err) == (2, True)


def test_the_number_of_runs_that_was_not_given_is_told(tmp_path, monkeypatch):
    from sagnac.campaign import run as campaigns
    from sagnac.campaign import spec
    from sagnac.campaign.progress import Watch

    notes = []
    (tmp_path / "C.toml").write_text(CAMPAIGN.replace("runs = 6\n", ""))
    campaigns._tell_first(spec.load(tmp_path / "C.toml"), Watch(note=notes.append))
    assert notes == ["runs is not given: 1000 at each of 2 points"]


def test_commands_that_are_named_can_be_pasted(run, tmp_path):
    (tmp_path / "my own").mkdir()
    (tmp_path / "my own" / "C.toml").write_text(CAMPAIGN.replace("runs = 6", "runs = 2"))
    done = run("campaign", "run", "my own/C.toml", "--workers", 1)
    assert done.status == 0, done.err
    assert "sagnac campaign run 'my own/C.toml' --only RUN" in done.out
    assert "sagnac campaign show 'my own/C' --plot 'my own/C/pictures'" in done.out


def test_a_fleet_with_a_refused_recording_has_exit_status_one(run, tmp_path):
    scenario = run("simulate", "norm", "--show").out
    short = scenario.replace('dwell = "300 s"', 'dwell = "5 s"').replace('turning = "360 s"', 'turning = "0 s"')
    (tmp_path / "s.toml").write_text(short)
    assert run("simulate", "s.toml", "--out", "logs", "--seed", 1).status == 0
    (tmp_path / "logs" / "u1.parquet").write_bytes((tmp_path / "logs" / "recording.parquet").read_bytes())
    (tmp_path / "logs" / "u2.parquet").write_bytes((tmp_path / "logs" / "recording.parquet").read_bytes()[:3000])
    (tmp_path / "logs" / "recording.parquet").rename(tmp_path / "logs" / "u0.parquet")
    (tmp_path / "fleet.toml").write_text('recordings = "logs/*.parquet"\nplan = "logs/plan.toml"\nmethod = "norm"\n')
    done = run("campaign", "run", "fleet.toml", "--workers", 1)
    assert done.status == 1
    assert "InputError" not in done.out
    assert "logs/u0.parquet and logs/u1.parquet are the same recording" in done.err
    assert sorted(p.name for p in (tmp_path / "fleet" / "calibrations").iterdir()) == ["u0.json", "u1.json"]
    assert (tmp_path / "fleet" / "summary.json").is_file()
