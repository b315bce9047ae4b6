"""Vehicles: what master and slave record along a course, against each other and by hand."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet
from test_scenario import changed, table_of

from sagnac.align.config import load as load_config
from sagnac.earth import normal_gravity, radii
from sagnac.frames import attitude_matrix, heading_pitch_roll, rotation_matrix
from sagnac.navigate.strapdown import increments, integrate
from sagnac.navigate.trajectory import read
from sagnac.recording import Batch, open_recording
from sagnac.simulate import scenario as scenarios
from sagnac.simulate.build import build
from sagnac.simulate.engine import stream
from sagnac.simulate.run import run
from sagnac.simulate.vehicle import config_text, vehicle_of

DEG = math.pi / 180
EAST = 19.44 * 1852 / 3600
MASTER = [
    "time [s]", "latitude [deg]", "longitude [deg]", "height [m]", "v_east [m/s]", "v_north [m/s]", "v_up [m/s]", "heading [deg]",
    "pitch [deg]", "roll [deg]",
]  # fmt: skip


def along_the_parallel() -> tuple[np.ndarray, np.ndarray, float]:
    """Force, rate in east, north, up, and rate of longitude of the published course, by hand: R_N = 6394209.174 m."""
    w, r, c, s = 7.292115e-5, 6394209.174, 0.5, math.sqrt(0.75)
    rate = np.array([0, w * c + EAST / r, w * s + EAST / r * s / c])
    north, up = 2 * w * EAST * s + EAST**2 * s / c / r, normal_gravity(60 * DEG) - 2 * w * EAST * c - EAST**2 / r
    return np.array([0, north, up]), rate, EAST / (r * c)


def silent(name: str) -> dict:
    """Table of a shipped scenario without noise and biases."""
    table = table_of(name)
    table["unit"] = {}
    table["master"] = {"frequency": "10 Hz"}
    return table


def simulated(table: dict, folder: Path, seed: int = 1) -> tuple[Batch, dict[str, np.ndarray]]:
    """The slave's samples and the master's log."""
    done = run(scenarios.from_table(table), folder, seed=seed)
    master = parquet.read_table(folder / "master.parquet")
    return open_recording(done.files[0]).read(), {n: master[n].to_numpy() for n in master.column_names}


def test_transfer_scenario(tmp_path):
    done = run(scenarios.load("transfer"), tmp_path, seed=1)
    assert [f.name for f in done.files] == ["recording.parquet", "master.parquet", "config.toml", "truth.json"]
    master = parquet.read_table(tmp_path / "master.parquet")
    assert master.column_names == MASTER
    assert master.num_rows == 9001
    velocity = np.column_stack([master[f"v_{n} [m/s]"].to_numpy() for n in ("east", "north", "up")])
    # 19.44 kn, and 0.01 m/s of white noise: mean within four standard deviations, standard deviation within 3 %
    np.testing.assert_allclose(velocity.mean(axis=0), [EAST, 0, 0], atol=4 * 0.01 / math.sqrt(9001))
    np.testing.assert_allclose(velocity.std(axis=0), 0.01, rtol=4 / math.sqrt(2 * 9001))
    force, rate, turning = along_the_parallel()
    turned = (master["longitude [deg]"][-1].as_py() - 108.0) * DEG
    assert turned == pytest.approx(900 * turning, rel=1e-9)
    batch = open_recording(done.files[0]).read()
    # the slave's mean readings are its biases and the master's inputs in its own axes: mounting error 0.2, 0.2, 0.5 deg
    to_slave = (attitude_matrix(90 * DEG, 0, 0) @ rotation_matrix(np.array([0.2, 0.2, 0.5]) * DEG)).T
    for values, u, bias, density in (
        (batch.accel, force, 50e-6 * 9.80665, 0.833e-6 * 9.80665),
        (batch.gyro, rate, 0.01 * DEG / 3600, 0.001 * DEG / 60),
    ):
        np.testing.assert_allclose(values.mean(axis=0), to_slave @ u + bias, atol=5 * density / 30)


def test_the_published_course_is_felt_exactly(tmp_path):
    batch, _ = simulated(silent("transfer"), tmp_path)
    force, rate, _ = along_the_parallel()
    to_slave = (attitude_matrix(90 * DEG, 0, 0) @ rotation_matrix(np.array([0.2, 0.2, 0.5]) * DEG)).T
    # R_N above has ten digits; gravity's share in an axis is rounded at 2e-15
    np.testing.assert_allclose(batch.accel, np.tile(to_slave @ force, (90_000, 1)), rtol=0, atol=1e-13)
    np.testing.assert_allclose(batch.gyro, np.tile(to_slave @ rate, (90_000, 1)), rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["transfer-s-turn", "transfer-ship"])
def test_slave_and_master_are_on_the_same_vehicle(tmp_path, name):
    # ideal readings, integrated from the slave's true start, end with the master's attitude and an arm's length away
    batch, master = simulated(silent(name), tmp_path)
    built = build(scenarios.from_table(silent(name)), 1)
    start = built.job.motion.trajectory.state(batch.time[0])
    steps, turns, pushes = increments(batch.time, batch.gyro, batch.accel)
    last = integrate(start, turns, pushes, steps, every=steps.size).states
    arm, mounting = (np.array([built.parameters[f"{n}.{a}"] for a in "xyz"]) for n in ("lever_arm", "misalignment"))
    attitude = last.C_b_n[-1] @ rotation_matrix(mounting).T
    assert master["time [s]"][-1] == batch.time[-1] == 300.0
    shown = np.array([master[f"{n} [deg]"][-1] for n in ("heading", "pitch", "roll")]) * DEG
    # readings are instants: where a turn begins at once their integral is right again two samples later. At the end of the arm
    # vertical and, at 60 deg, north are others by up to 2 l / R
    allowed = 5e-8 + 2 * np.linalg.norm(arm) / 6.38e6
    np.testing.assert_allclose(heading_pitch_roll(attitude), shown, rtol=0, atol=allowed)
    latitude, longitude, _ = last.place
    north = (latitude[-1] - master["latitude [deg]"][-1] * DEG) * radii(latitude[-1])[0]
    east = (longitude[-1] - master["longitude [deg]"][-1] * DEG) * radii(latitude[-1])[1] * np.cos(latitude[-1])
    up = last.height[-1] - master["height [m]"][-1]
    np.testing.assert_allclose([east, north, up], attitude @ arm, rtol=0, atol=0.1)


def test_pulses_of_a_vehicle_are_exact_integrals():
    # legs begin between samples, samples are early and late; what the pulses add up to is at most one behind
    legs = [{"duration": "7.123 s", "turn_rate": "3 deg/s"}, {"duration": "12.877 s", "turn_rate": "-3 deg/s"}]
    table = changed("transfer-s-turn", "trajectory/leg", legs)
    table["unit"] = {"scale": {"gyro": "1e9 pulse/rad", "accel": "1e6 pulse/(m/s)"}}
    table["recording"]["jitter"] = "2 ms"
    job = build(scenarios.from_table(table), 1).job
    pieces = list(stream(job, piece=300))
    exact = job.motion.trajectory.increments(np.concatenate([[0.0], *(p.time for p in pieces)]))
    for sensor, values, worth in (("gyro", exact.turns, 1e-9), ("accel", exact.pushes, 1e-6)):
        for i, axis in enumerate("xyz"):
            counted = np.cumsum(np.concatenate([p.sensors[f"{sensor}_{axis}"] for p in pieces]))
            behind = np.cumsum(values[:, i]) / worth - counted
            assert behind.min() > -1e-3
            assert behind.max() < 1 + 1e-3


def test_a_master_that_is_late_and_has_gaps(tmp_path):
    table = silent("transfer-s-turn")
    _, prompt = simulated(table, tmp_path / "a")
    table["master"] |= {"latency": "0.3 s", "gap": [["100 s", "130 s"], ["200.05 s", "200.2 s"]]}
    _, late = simulated(table, tmp_path / "b")
    time = late["time [s]"]
    assert time.size == 3001 - 300 - 1
    assert not ((time >= 100) & (time < 130)).any()
    assert 200.1 not in np.round(time, 3)
    expected = np.isin(np.round(prompt["time [s]"], 3), np.round(time - 0.3, 3))
    for name in MASTER[1:]:
        np.testing.assert_allclose(late[name][time >= 0.25], prompt[name][expected], rtol=0, atol=1e-9)


def test_the_masters_heading_goes_round_and_its_noise_is_its_own(tmp_path):
    table = silent("transfer-s-turn")
    table["master"] |= {"attitude": "1 arcmin", "velocity": "0.1 m/s"}
    table["trajectory"]["heading"] = "0 deg"
    _, one = simulated(table, tmp_path / "a")
    assert one["heading [deg]"].min() >= 0.0
    assert one["heading [deg]"].max() > 359.0
    table["master"]["gap"] = [["10 s", "20 s"]]
    _, two = simulated(table, tmp_path / "b")
    held = ~((one["time [s]"] >= 10) & (one["time [s]"] < 20))
    for name in MASTER:
        np.testing.assert_array_equal(two[name], one[name][held])  # a gap does not shift the noise
    _, three = simulated(table, tmp_path / "c", seed=2)
    assert (three["v_up [m/s]"] != two["v_up [m/s]"]).all()
    assert two["v_up [m/s]"].std() == pytest.approx(0.1, rel=4 / math.sqrt(2 * 2900))


def test_a_flexure_is_a_second_order_markov_process():
    table = silent("transfer")
    table["rig"]["errors"] = {"flexure": ["1 arcmin", "0 deg", "3 arcmin"], "flexure_time": "2 s"}
    built = build(scenarios.from_table(table), 5)
    assert built.details["flexure"] == {"sigma": pytest.approx([math.pi / 10800, 0, math.pi / 3600]), "time": 2.0}
    trajectory = built.job.motion.trajectory
    angle, rate = trajectory.unit.flexure.angle(np.arange(0.0, 900.0, 0.5))
    beta, sigma = 2.146 / 2.0, np.array([1, 0, 3]) * math.pi / 10800
    # autocorrelation sigma^2 (1 + beta t) exp(-beta t) (Gelb 1974, table 2.2-1). Its integral over both sides is 4 / beta of the
    # square's 5 / (2 beta): 900 s are some 390 independent values, and 0.3 is four standard deviations of a variance
    for lag in (0, 1, 4):
        expected = sigma**2 * (1 + beta * lag / 2) * math.exp(-beta * lag / 2)
        found = np.mean(angle[lag:] * angle[: angle.shape[0] - lag], axis=0)
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.3 * sigma.max() ** 2)
    np.testing.assert_allclose(rate.std(axis=0), beta * sigma, rtol=0.25, atol=1e-30)
    # the unit turns by it, and counts what it turned; in its own axes the Earth's 0.07 rad of turn are others by 1e-3 of it
    time, turns, _ = trajectory.increments(50.0)
    _, still, _ = vehicle_of(scenarios.from_table(table)).increments(50.0)
    bent = trajectory.unit.flexure.angle(time)[0]
    np.testing.assert_allclose(np.cumsum(turns - still, axis=0), bent[1:] - bent[0], rtol=0, atol=2e-5)


def test_site_and_course_are_in_the_settings(tmp_path):
    table = silent("transfer") | {"gravity": "9.82 m/s^2", "earth_rate": "7.3e-5 rad/s"}
    batch, _ = simulated(table, tmp_path)
    north, up = 2 * 7.3e-5 * EAST * math.sqrt(0.75), 9.82 - 2 * 7.3e-5 * EAST * 0.5
    assert np.linalg.norm(batch.accel[0]) == pytest.approx(math.hypot(north, up), abs=1e-4)
    config = tomllib.loads((tmp_path / "config.toml").read_text())
    assert (config["gravity"], config["earth_rate"]) == ("9.82 m/s^2", "7.3e-5 rad/s")
    assert read.from_table(config["trajectory"]) == read.from_table(table["trajectory"])


@pytest.mark.parametrize("name", ["transfer", "transfer-s-turn", "transfer-ship"])
def test_the_settings_are_read_by_the_alignment(tmp_path, name):
    (tmp_path / "config.toml").write_text(config_text(scenarios.load(name)))
    settings = load_config(tmp_path / "config.toml")
    assert settings.trajectory == scenarios.load(name).trajectory


def test_what_comes_next_after_a_vehicle(tmp_path):
    table = silent("transfer-s-turn")
    table["unit"]["scale"] = {"gyro": "10 pulse/arcsec", "accel": "1000 pulse/g/s"}
    done = run(scenarios.from_table(table), tmp_path, seed=1)
    assert done.summary().splitlines()[-1] == (
        f"next: sagnac align transfer --master {tmp_path}/master.parquet --slave {tmp_path}/recording.parquet --config "
        f"{tmp_path}/config.toml --scale 'gyro=10 pulse/arcsec' --scale 'accel=1000 pulse/g/s' --out {tmp_path}/alignment"
    )
