"""Time series: against the plain twin, and the same whatever the threads and pieces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sagnac.earth import STANDARD_GRAVITY
from sagnac.rigs.turntable import Site, TableErrors
from sagnac.sensors import Correction
from sagnac.simulate.engine import Channel, Clock, Drift, Job, stream
from sagnac.simulate.noise import NO_NOISE, NoiseModel
from sagnac.simulate.plans import CHECK, table_plan
from sagnac.simulate.table import SimulatedTable, imperfect_table, simulate_recording, site_of
from sagnac.simulate.track import TableMotion
from sagnac.simulate.unit import SimulatedUnit, laser_gyro_unit

NOISE = NoiseModel(1e-4, 1e-5, (0.1, 10.0), 1e-6, ((1e-5, 1.0),))
UNIT = laser_gyro_unit(accel_density=0.0, gyro_density=0.0)
PLAN = table_plan(UNIT, CHECK[:3], dwell=4.0, turning=6.0, move=2.0)
TABLE = imperfect_table(PLAN, np.random.default_rng(1))


def channels(noise=NO_NOISE, worth=None, increment=False) -> tuple[Channel, ...]:
    worth = worth or {"accel": 0.0, "gyro": 0.0}
    return tuple(Channel(s, i, noise, worth[s], increment) for s in ("accel", "gyro") for i in range(3))


def job(**changes) -> Job:
    motion = TableMotion(PLAN, site_of(PLAN), TABLE.errors, TABLE.settings, 0.0, np.zeros(3))
    models = {
        "accel": Correction("accel", UNIT.accel_matrix, UNIT.accel_bias),
        "gyro": Correction("gyro", UNIT.gyro_matrix, UNIT.gyro_bias),
    }
    clock = Clock(50.0, math.floor((PLAN.segment[-1].stop + 1.0) * 50.0))
    return replace(Job(motion, UNIT.to_b, models, channels(), clock, 1), **changes)


def whole(given: Job, **options) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    parts = list(stream(given, **options))
    return (
        np.concatenate([p.time for p in parts]),
        {n: np.concatenate([p.sensors[n] for p in parts]) for n in parts[0].sensors},
        {n: np.concatenate([p.rig[n] for p in parts]) for n in parts[0].rig},
    )


def silent() -> SimulatedUnit:
    return replace(UNIT, pulses={})


def test_samples_are_those_of_the_plain_twin():
    time, sensors, _ = whole(job())
    expected_time, expected = simulate_recording(silent(), PLAN, TABLE, np.random.default_rng(1))
    np.testing.assert_array_equal(time, expected_time)
    for sensor, values in expected.items():
        for i, axis in enumerate("xyz"):
            # 1e-13 rad of rounding in the angles, times g
            np.testing.assert_allclose(sensors[f"{sensor}_{axis}"], values[:, i], rtol=0, atol=1e-12)


@pytest.mark.parametrize("increment", [False, True])
def test_threads_and_pieces_make_no_difference(increment):
    # with everything that is handed on from piece to piece: slow noise, jitter, residues
    worth = {"accel": 1e-3, "gyro": 1e-6}
    clock = replace(job().clock, jitter=2e-3, stamp_jitter=1e-3)
    given = job(channels=channels(NOISE, worth, increment), clock=clock, rig=True)
    reference = whole(given, threads=1, piece=10_000)
    for options in ({"threads": 2, "piece": 512}, {"threads": 5, "piece": 77}, {"threads": 1, "piece": 1}):
        if options["piece"] == 1:
            short = replace(given, clock=replace(clock, count=60))
            found, expected = whole(short, **options), whole(short, threads=1)
        else:
            found, expected = whole(given, **options), reference
        np.testing.assert_array_equal(found[0], expected[0])
        for a, b in ((found[1], expected[1]), (found[2], expected[2])):
            assert a.keys() == b.keys()
            for name in a:
                np.testing.assert_array_equal(a[name], b[name])


def test_seeds_make_a_difference():
    one, two = (whole(job(channels=channels(NOISE), seed=s))[1]["gyro_x"] for s in (1, 2))
    assert np.mean(one == two) < 0.01


def test_leaving_the_rest_of_a_file_out_leaves_the_noise_of_an_axis_as_it_is():
    alone = job(channels=(Channel("accel", 2, NOISE),))
    np.testing.assert_array_equal(whole(alone)[1]["accel_z"], whole(job(channels=channels(NOISE)))[1]["accel_z"])
    assert list(whole(alone)[1]) == ["accel_z"]


def integral_of(given: Job, parts: int) -> dict[str, np.ndarray]:
    """Integral of the readings up to each sample, by Gauss' rule with two points in `parts` parts of each interval."""
    h = 1 / given.clock.frequency / parts
    start = np.arange(given.clock.count * parts) * h
    total = {}
    for node in (0.5 - 0.5 / math.sqrt(3), 0.5 + 0.5 / math.sqrt(3)):
        for sensor, u in zip(("accel", "gyro"), given.motion.inputs(start + node * h), strict=True):
            model = given.models[sensor]
            values = u @ (model.matrix @ given.to_unit).T + model.bias
            total[sensor] = total.get(sensor, 0.0) + values.reshape(-1, parts, 3).sum(axis=1) * h / 2
    return {s: np.cumsum(v, axis=0) for s, v in total.items()}


def test_pulses_are_the_integral_within_one_pulse():
    # 1.1866 pulse/arcsec and 10800 pulse/g/s of [DONG18]; 20 parts leave 1e-8 of a pulse, the engine's one part 1e-3
    worth = {"accel": STANDARD_GRAVITY / 10800, "gyro": math.pi / 648000 / 1.1866}
    given = job(channels=channels(worth=worth, increment=True))
    _, pulses, _ = whole(given)
    integral = integral_of(given, 20)
    for name, counted in pulses.items():
        sensor, axis = name.split("_")
        behind = integral[sensor][:, "xyz".index(axis)] / worth[sensor] - np.cumsum(counted)
        assert (counted == np.round(counted)).all()
        assert behind.min() > -1e-3
        assert behind.max() < 1 + 1e-3


def test_a_count_of_the_level_is_rounded():
    worth = {"accel": STANDARD_GRAVITY / 100, "gyro": 1e-3}
    _, counts, _ = whole(job(channels=channels(worth=worth)))
    _, levels, _ = whole(job())
    for name, values in counts.items():
        np.testing.assert_array_equal(values, np.round(levels[name] / worth[name.split("_")[0]]))


def test_jitter_moves_the_sample_and_its_stamp():
    clock = replace(job().clock, jitter=4e-3)
    time, sensors, _ = whole(job(clock=clock))
    off = time - np.arange(1, time.size + 1) / 50.0
    assert np.abs(off).max() <= 4e-3
    # uniform: standard deviation bound / sqrt 3; that of n values is within 4 * 0.45 / sqrt n of it
    assert off.std() == pytest.approx(4e-3 / math.sqrt(3), rel=4 * 0.45 / math.sqrt(time.size))
    assert (np.diff(time) > 0).all()
    # in the last segment the outer axis turns at 10 deg/s: the reading is that of the stamped time
    motion, at = job().motion, (time > PLAN.segment[-1].start) & (time < PLAN.segment[-1].stop)
    _, rate = motion.inputs(time[at])
    expected = rate @ (UNIT.gyro_matrix @ UNIT.to_b).T + UNIT.gyro_bias
    np.testing.assert_allclose(sensors["gyro_x"][at], expected[:, 0], rtol=0, atol=1e-14)


def test_stamp_jitter_moves_the_stamp_only():
    time, sensors, _ = whole(job(clock=replace(job().clock, stamp_jitter=4e-3)))
    exact, same, _ = whole(job())
    assert 3.5e-3 < np.abs(time - exact).max() <= 4e-3
    np.testing.assert_array_equal(sensors["gyro_y"], same["gyro_y"])


def test_temperature_moves_bias_and_scale():
    drift = Drift(
        lambda t: 300.0 + 0.1 * t,
        298.0,
        {"accel": np.array([1e-3, 0, 0]), "gyro": np.zeros(3)},
        {"accel": np.zeros(3), "gyro": np.array([0, 2e-3, 0])},
    )
    time, warm, rig = whole(job(drift=drift))
    _, cold, _ = whole(job())
    warmer = 2.0 + 0.1 * time
    np.testing.assert_allclose(rig["temperature"], 298.0 + warmer, rtol=0, atol=1e-11)
    np.testing.assert_allclose(warm["accel_x"] - cold["accel_x"], 1e-3 * warmer, rtol=0, atol=1e-13)
    _, rate = job().motion.inputs(time)
    expected = 2e-3 * warmer * (rate @ UNIT.to_b.T)[:, 1]
    np.testing.assert_allclose(warm["gyro_y"] - cold["gyro_y"], expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(warm["gyro_x"], cold["gyro_x"])


def test_the_table_shows_its_settings_not_its_errors():
    time, _, rig = whole(job(rig=True))
    assert list(rig) == ["outer", "middle", "inner"]
    s = PLAN.segment[1]
    at = (time > s.start) & (time < s.stop)
    for name in rig:
        turns = (rig[name][at] - getattr(s, name)) / (2 * math.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)


def test_an_unread_stream_ends_its_threads():
    import threading

    before = threading.active_count()
    pieces = stream(job(), threads=2, piece=64)
    next(pieces)
    pieces.close()
    assert threading.active_count() == before


def test_a_lever_arm_is_felt():
    motion = TableMotion(PLAN, Site(0.8, 9.81, 7.3e-5), TableErrors(), np.zeros((6, 3)), 0.0, np.array([0.5, 0.0, 0.0]))
    still = TableMotion(PLAN, Site(0.8, 9.81, 7.3e-5), TableErrors(), np.zeros((6, 3)), 0.0, np.zeros(3))
    middle = np.array(
        [(PLAN.segment[3].start + PLAN.segment[3].stop) / 2]
    )  # position (0, 0): turns about z at 10 deg/s
    extra = motion.inputs(middle)[0] - still.inputs(middle)[0]
    # centripetal, w^2 r
    np.testing.assert_allclose(extra[0], [-0.5 * math.radians(10) ** 2, 0, 0], atol=1e-12)


def test_a_table_without_errors_is_perfect():
    exact = SimulatedTable(TableErrors(), np.zeros((6, 3)))
    motion = TableMotion(PLAN, site_of(PLAN), exact.errors, exact.settings, 0.0, np.zeros(3))
    force, _ = motion.inputs(np.array([4.0]))  # first position: up is z
    np.testing.assert_allclose(force[0], [0, 0, PLAN.gravity], atol=1e-12)
