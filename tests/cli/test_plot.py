"""``sagnac plot``: every picture of every kind of file, and what it refuses."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv

from sagnac.calibrate import calibrate
from sagnac.calibration import load
from sagnac.plan import Plan
from sagnac.recording import open_recording
from sagnac.report.pictures import PICTURES
from sagnac.report.plot import Given, plot

MAGIC = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A recording of a unit at rest in 14 attitudes, another one of it, its plan and its calibration, which names both."""
    folder = tmp_path_factory.mktemp("made")
    rng = np.random.default_rng(4)
    directions = np.vstack([np.eye(3), -np.eye(3), rng.standard_normal((8, 3))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    rows = ["gravity = '9.81 m/s^2'", "[unit]", "model = 'unit'", "serial = '7'"]
    for k in range(len(directions)):
        rows += ["[[segment]]", f"name = 'p{k + 1}'", f"start = '{5 * k + 0.5} s'", f"stop = '{5 * k + 4.5} s'"]
    (folder / "plan.toml").write_text("\n".join(rows), encoding="utf-8")
    for name in ("recording.csv", "check.csv"):
        force = 9.81 * np.repeat(directions, 500, axis=0)
        accel = force * [1.01, 0.99, 1.02] + [0.05, -0.03, 0.02] + 1e-3 * rng.standard_normal(force.shape)
        columns = {"time [s]": np.arange(len(accel)) / 100}
        columns |= {f"accel_{a} [m/s^2]": np.ascontiguousarray(accel[:, i]) for i, a in enumerate("xyz")}
        csv.write_csv(pa.table(columns), folder / name)
    return folder


@pytest.fixture
def folder(made, tmp_path, run):
    """A copy in the folder where commands run, with the calibration made by the command line."""
    for name in ("plan.toml", "recording.csv", "check.csv"):
        shutil.copy(made / name, tmp_path / name)
    if not (made / "cal.json").exists():
        done = run("calibrate", "norm", "recording.csv", "--plan", "plan.toml", "--out", "cal.json")
        assert done.status == 0, done.err
        shutil.copy(tmp_path / "cal.json", made / "cal.json")
    shutil.copy(made / "cal.json", tmp_path / "cal.json")
    return tmp_path


def test_what_can_be_drawn_is_listed(run, folder):
    told = run("plot", "cal.json")
    assert told.status == 0
    assert all(name in told.out for name in PICTURES)
    assert "(needs --earlier)" in told.out
    rows = json.loads(run("plot", "cal.json", "--json").out)
    assert [r["name"] for r in rows] == list(PICTURES)
    assert [r["name"] for r in rows if r["missing"]] == ["as-found"]
    assert "log" in run("plot", "recording.csv").out


@pytest.mark.parametrize(
    ("name", "ending"),
    [*((n, "png") for n in PICTURES), *((n, e) for n in ("correlation", "log") for e in ("svg", "pdf"))],
)
def test_every_picture_of_a_calibration(run, folder, name, ending):
    more = ["--earlier", "cal.json"] if name == "as-found" else []
    done = run("plot", "cal.json", name, *more, "--out", f"x.{ending}")
    assert done.status == 0, done.err
    assert done.out == f"x.{ending}\n"
    assert (folder / f"x.{ending}").read_bytes().startswith(MAGIC[ending])


def test_a_picture_goes_beside_where_no_file_is_named(run, folder):
    done = run("plot", "cal.json", "budget", "--json")
    assert json.loads(done.out) == {"out": "budget.png", "remarks": []}
    assert (folder / "budget.png").exists()


def test_before_and_after_on_another_recording(run, folder):
    own = run("plot", "cal.json", "before-after")
    assert "the recording that the fit has seen" in own.err
    other = run("plot", "cal.json", "before-after", "--recording", "check.csv", "--plan", "plan.toml")
    assert (other.status, other.err) == (0, "")


def test_a_plan_of_the_fit_is_not_taken_for_another_recording(run, folder):
    own, other = (plot(Path("cal.json"), "log", Given(recording=f)) for f in (None, Path("check.csv")))
    assert own.figure.get_suptitle() == "14 segments of the plan"
    assert other.figure.get_suptitle().endswith("static intervals")


def test_recordings_are_drawn_with_their_plan(run, folder):
    assert run("plot", "recording.csv", "log", "--plan", "plan.toml").status == 0
    assert run("plot", "recording.csv", "log").status == 0


def test_files_that_have_changed_are_not_taken(run, folder):
    (folder / "recording.csv").write_text("time [s],accel_x [g]\n0,1\n", encoding="utf-8")
    lost = run("plot", "cal.json", "log")
    assert lost.status == 2
    assert "needs the recording; recording.csv is not beside it as it was; give it with --recording" in lost.err
    assert "(needs --recording)" in run("plot", "cal.json").out
    alone = run("plot", "cal.json", "residuals")
    assert alone.status == 0
    assert "drawn from the calibration alone" in alone.err


def test_a_plan_that_has_changed_is_missed(run, folder):
    (folder / "plan.toml").write_text("gravity = '9.8 m/s^2'\n", encoding="utf-8")
    done = run("plot", "cal.json", "residuals")
    assert done.status == 0
    assert "the plan was not found, so that this is drawn from the calibration alone (--plan)" in done.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["cal.json", "nothing"], "there is no picture 'nothing' of it; choose from parameters, correlation"),
        (["cal.json", "as-found"], "needs --earlier"),
        (["cal.json", "budget", "--recording", "check.csv"], "the picture 'budget' takes no --recording"),
        (["cal.json", "budget", "--out", "x.bmp"], "write to a .png, .svg or .pdf file"),
        (["cal.json", "budget", "--out", "cal.json"], "write to a .png"),
        (["recording.csv", "budget"], "there is no picture 'budget' of it; choose from log"),
        (["recording.csv", "log", "--earlier", "cal.json"], "takes no --earlier"),
        (["missing.json"], "no such file"),
        (["plan.toml", "log"], "plan.toml"),
        (["."], "cannot read the alignment"),
        (["cal.json", "log", "--recording", "missing.csv"], "cannot read the recording"),
    ],
)
def test_what_is_refused(run, folder, arguments, said):
    done = run("plot", *arguments)
    assert done.status == 2
    assert said in done.err
    assert not list(folder.glob("*.png"))


def test_an_earlier_calibration_of_another_unit_is_refused(run, folder):
    other = load(folder / "cal.json")
    other.model_copy(update={"unit": other.unit.model_copy(update={"serial": "8"})}).save(folder / "other.json")
    done = run("plot", "cal.json", "as-found", "--earlier", "other.json")
    assert done.status == 2
    assert "is of unit '8', the calibration is of '7'" in done.err


def test_a_unit_turned_by_hand_needs_no_plan(run, tmp_path):
    rng = np.random.default_rng(5)
    directions = np.vstack([np.eye(3), -np.eye(3), rng.standard_normal((8, 3))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    parts = []
    for k, direction in enumerate(directions):
        parts.append(np.tile(direction, (400, 1)))
        parts.append(
            np.linspace(direction, directions[(k + 1) % len(directions)], 60) + 0.05 * rng.standard_normal((60, 3))
        )
    force = 9.81 * np.vstack(parts) + 1e-3 * rng.standard_normal((460 * len(directions), 3))
    columns = {"time [s]": np.arange(len(force)) / 100}
    columns |= {f"accel_{a} [m/s^2]": np.ascontiguousarray(force[:, i]) for i, a in enumerate("xyz")}
    csv.write_csv(pa.table(columns), tmp_path / "log.csv")
    calibrate("norm", open_recording(tmp_path / "log.csv"), Plan(gravity=9.81)).save(tmp_path / "hand.json")
    for name in ("residuals", "log"):
        done = run("plot", "hand.json", name)
        assert (done.status, done.err) == (0, "")


def test_a_plan_has_no_picture(run, folder):
    told = run("plot", "plan.toml")
    assert told.status == 2
    assert "plan.toml: is a plan" in told.err
    assert run("plot", "plan.toml", "log").status == 2
