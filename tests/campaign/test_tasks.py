"""What single runs of a campaign do: what they draw, their bound, their rows."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from campaign_tables import SMALL, norm

from sagnac.campaign import spec
from sagnac.campaign.tasks import calibration, memory, prepare
from sagnac.campaign.tasks.outcome import Outcome, cells, nees
from sagnac.errors import DataError
from sagnac.recording import open_recording
from sagnac.sensors import Triad
from sagnac.simulate.build import build
from sagnac.simulate.run import run as simulate

SHORT = {"plan.dwell": "20 s", "plan.turning": "36 s", "recording.frequency": "10 Hz"}


def task_of(table):
    return prepare(spec.from_table(table))


@pytest.fixture(scope="module")
def small():
    return task_of(norm())


def test_a_row_depends_on_its_number_alone(small):
    again = pickle.loads(pickle.dumps(small))
    rows = [small.row(i) for i in range(4)]
    assert [again.row(i) for i in (3, 1, 2, 0)] == [rows[i] for i in (3, 1, 2, 0)]
    assert len({r["seed"] for r in rows}) == 4
    longer = task_of(norm(runs=9))
    assert longer.row(3) == rows[3]
    drawn = np.random.SeedSequence(1, spawn_key=(2,)).generate_state(1, np.uint64)
    assert rows[2]["seed"] == memory.seed_of(1, 2) == int(drawn[0]) >> 1


def test_the_bound_is_the_published_one(small):
    """Section 2 of the methods, one reading of 1e-5 g in each of twelve positions: dK 7.1e-6, th 1.13e-5 rad, bias 5.0e-6 g."""
    bound = dict(zip(small.names, small.about.points[0].bound, strict=True))
    of = {n: v for n, v in bound.items() if n.startswith("accel")}
    assert len(of) == 9
    published = {"scale_error": 7.1e-6, "misalignment": 1.13e-5, "bias": 5.0e-6 * 9.80665}
    for name, value in of.items():
        assert value == pytest.approx(published[name.split(".")[1]], rel=0.025), name  # the unit's own scales: 0.8 %


def test_the_recording_in_memory_is_that_of_the_file(tmp_path):
    """Pulses, counts and SI, as ``sagnac simulate`` writes and ``sagnac calibrate`` reads them."""
    for scale in ({}, {"gyro": "1.1866 pulse/arcsec", "accel": "10600 pulse/g/s"}, {"accel": "16384 LSB/g"}):
        found = spec.from_table({"scenario": "norm", "set": {**SHORT, "unit.scale": scale}, "runs": 1})
        scenario = spec.scenario(found.points[0])
        held = memory.recording_of(build(scenario, 5), scenario.plan).read()
        written = open_recording(simulate(scenario, tmp_path, seed=5).files[0], scale=scenario.plan.unit.scale)
        batch = written.read()
        for mine, theirs in ((held.time, batch.time), (held.accel, batch.accel), (held.gyro, batch.gyro)):
            np.testing.assert_allclose(mine, theirs, rtol=1e-15)
        assert written.increments == memory.recording_of(build(scenario, 5), scenario.plan).increments


def test_single_axes_and_the_rigs_own_channels_are_recorded():
    changed = {**SHORT, "recording.sensors": ["accel_z", "gyro"], "recording.rig": True, "unit.scale": {}}
    scenario = spec.scenario(spec.from_table({"scenario": "norm", "set": changed}).points[0])
    found = memory.recording_of(build(scenario, 1), scenario.plan)
    assert (found.has, found.single, found.rig) == ({"gyro"}, {"accel_z"}, {"outer", "middle", "inner"})


def test_a_refusal_is_a_row_that_says_why():
    """Five positions are too few for nine parameters; the bound says so too where no point can do better."""
    few = [["0 deg", f"{a} deg", "10 deg"] for a in range(0, 250, 50)]
    with pytest.raises(DataError, match="not even a run without noise gives a result"):
        task_of(norm(set={**SMALL, "plan.positions": few}))
    task = task_of(norm(set=SMALL, grid={"plan.positions": ["icosahedron", few]}, runs=2))
    assert task.about.points[0].remark == ""
    row = task.row(3)
    told = "norm calibration of the accel triad needs at least 9 well-spread positions"
    assert task.about.points[1].remark.startswith(told)
    assert row["status"].startswith(told)
    assert (row["point"], row["nees"], row["grid.plan.positions"]) == (1, None, json.dumps(few))
    assert task.row(0)["status"] == "ok"


def test_only_wanted_parameters_are_judged():
    task = task_of(norm(parameters=["accel.bias", "rig"]))
    assert {n.rpartition(".")[0] for n in task.names} == {"accel.bias", "rig.mount", "rig.tilt"}
    row = task.row(0)
    assert row["nees_degrees_of_freedom"] == len(task.names) == 8
    with pytest.raises(DataError, match="no parameter has a truth"):
        task_of(norm(parameters=["accel.bia"]))


def test_gyros_alone_are_judged_in_their_own_frame():
    table = {"scenario": "norm", "set": {**SHORT, "recording.sensors": "gyro", "unit.scale": {}}, "runs": 2}
    row = task_of(table).row(0)
    for name in ("gyro.misalignment.yx", "gyro.misalignment.zx", "gyro.scale_error.y"):
        assert abs(row[f"error.{name}"]) < 5 * row[f"sigma.{name}"]
    scenario = spec.scenario(spec.from_table(table).points[0])
    built = build(scenario, 1)
    truth = calibration.truth_of(built, spec.Options(method="norm"))
    own, whole = Triad("gyro"), Triad("gyro", full=True)
    lower = own.unpack(np.array([truth[n] for n in own.names]))[0]
    full = whole.unpack(np.array([built.parameters[n] for n in whole.names]))[0]
    np.testing.assert_allclose(lower @ lower.T, full @ full.T, atol=1e-15)


def test_nees_is_the_square_in_the_metric_of_the_covariance():
    rng = np.random.default_rng(3)
    mix = rng.standard_normal((4, 4))
    covariance, error = mix @ mix.T, rng.standard_normal(4)
    square = error @ np.linalg.solve(covariance, error)
    assert nees(error, covariance) == (pytest.approx(square, rel=1e-10), 4)
    # what is known exactly does not count, nor does a combination that is
    wide = np.zeros((6, 6))
    wide[:4, :4] = covariance
    wide[5] = wide[0]
    wide[:, 5] = wide[:, 0]
    assert nees(np.array([*error, 7.0, error[0]]), wide) == (pytest.approx(square, rel=1e-8), 4)
    assert nees(np.ones(2), np.zeros((2, 2))) == (0.0, 0)


def test_parameters_without_a_truth_have_no_error():
    found = Outcome(("a.x", "b.x"), ("1", "1"), np.array([1.0, 2.0]), np.eye(2), {"a.x": 0.5, "c.x": 1.0})
    row = cells(found, ("a.x", "b.x"), ())
    assert (row["error.a.x"], row["sigma.a.x"], row["nees"]) == (0.5, 1.0, pytest.approx(0.25))
    assert "error.b.x" not in row
