"""The simulated unit on its table: motion, readings, noise and pulses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.earth import STANDARD_GRAVITY
from sagnac.plan import Plan, Segment
from sagnac.recording import open_recording
from sagnac.rigs.turntable import PERFECT, inputs
from sagnac.simulate.plans import CHECK, ICOSAHEDRON, table_plan
from sagnac.simulate.table import (
    SimulatedTable,
    imperfect_table,
    motion,
    readings,
    simulate_readings,
    simulate_recording,
    site_of,
    write_recording,
)
from sagnac.simulate.unit import SimulatedUnit, laser_gyro_unit

DEG = math.pi / 180
DEG_H = DEG / 3600


def silent(pulses: dict[str, str] | None = None, **noise: float) -> SimulatedUnit:
    """The laser-gyro unit with other noise and pulses."""
    unit = laser_gyro_unit(accel_density=noise.get("accel", 0.0), gyro_density=noise.get("gyro", 0.0))
    return SimulatedUnit(
        unit.accel_matrix, unit.accel_bias, unit.gyro_matrix, unit.gyro_bias, unit.mount,
        unit.accel_density, unit.gyro_density, pulses or {},
    )  # fmt: skip


def short_plan(unit, positions=CHECK[:3], **options) -> Plan:
    return table_plan(unit, positions, **({"dwell": 4.0, "turning": 6.0, "move": 2.0} | options))


def perfect(plan: Plan) -> SimulatedTable:
    return SimulatedTable(PERFECT, np.zeros((len(plan.segment), 3)))


# --------------------------------------------------------------------------------------------- plan and motion


def test_the_twelve_positions_are_the_vertices_of_an_icosahedron():
    # vertical in the unit: every vertex has five neighbours at arccos(1 / sqrt 5) = 63.435 deg and one opposite
    plan = table_plan(laser_gyro_unit(), ICOSAHEDRON, turning=0)
    angles = np.array([s.angles for s in plan.segment])
    up = inputs(angles, np.zeros_like(angles), site_of(plan))[0] / plan.site_gravity
    between = np.degrees(np.arccos(np.clip(up @ up.T, -1, 1)))
    for row in between:
        # the table's angles are printed to 1e-4 deg: 31.7175 for 31.717474
        np.testing.assert_allclose(np.sort(row), [0, *[63.43495] * 5, *[116.56505] * 5, 180], atol=2e-3)


def test_segments_follow_each_other_with_time_to_move():
    plan = short_plan(laser_gyro_unit())
    assert [s.name for s in plan.segment] == ["s1", "s2", "s3", "r1", "r2", "r3"]
    assert [(s.start, s.stop) for s in plan.segment] == [(2, 6), (8, 12), (14, 18), (20, 26), (28, 34), (36, 42)]
    assert [s.outer_rate for s in plan.segment] == [0, 0, 0, 10 * DEG, 10 * DEG, 10 * DEG]


@pytest.fixture(scope="module")
def moving():
    plan = short_plan(laser_gyro_unit())
    table = imperfect_table(plan, np.random.default_rng(1))
    time = np.arange(0, 44, 1e-3)
    return plan, table, time, *motion(plan, table, time)


def test_motion_is_continuous_and_its_rates_are_its_derivative(moving):
    _, _, time, angles, rates = moving
    h = 1e-3
    # A move of half a turn in 2 s has accelerations of 6 pi / 4 = 5 rad/s^2 and jerks of 12 pi / 8 = 5 rad/s^3:
    # steps of the rate stay below 1e-3 * 10, except at the end, where the table stops
    moved = time[:-1] < 41.9
    assert np.abs(np.diff(rates, axis=0))[moved].max() < 10 * h
    slope = (angles[2:] - angles[:-2]) / (2 * h)
    np.testing.assert_allclose(slope[moved[1:]], rates[1:-1][moved[1:]], atol=10 * h)
    assert np.abs(np.diff(angles, axis=0)).max() < 4 * h


def test_segments_are_where_the_plan_and_the_setting_errors_say(moving):
    plan, table, time, angles, rates = moving
    for s, error in zip(plan.segment, table.settings, strict=True):
        here = (time >= s.start) & (time < s.stop)
        expected = np.array(s.angles) + error + np.outer(time[here] - s.start, [s.outer_rate, 0, 0])
        turns = (angles[here] - expected) / (2 * math.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
        assert (rates[here] == [s.outer_rate, 0, 0]).all()


def test_moves_take_the_near_way_round(moving):
    plan, _, time, angles, _ = moving
    for first, second in zip(plan.segment[:-1], plan.segment[1:], strict=True):
        i, j = np.searchsorted(time, [first.stop, second.start])
        assert np.abs(angles[j] - angles[i]).max() < math.pi + 2 * DEG


def test_table_errors_are_within_what_was_asked():
    plan = table_plan(laser_gyro_unit())
    table = imperfect_table(plan, np.random.default_rng(3), setting=0.01, axis=0.002)
    assert table.settings.shape == (24, 3)
    assert np.abs(table.settings).max() <= 0.01
    # uniform: standard deviation 1 / sqrt 3 of the bound; 72 of them are within 25 % of it (4 sigma: 4 * 0.45 / sqrt 72)
    assert table.settings.std() == pytest.approx(0.01 / math.sqrt(3), rel=0.25)
    e = table.errors
    assert {abs(v) for v in (*e.tilt, *e.nonperpendicularity, *e.zero)} == {0.002}


# -------------------------------------------------------------------------------------------------- readings


def test_truth_is_the_published_unit():
    # [DONG18], table 1
    truth = laser_gyro_unit().truth()
    assert truth["accel.scale_error.y"] == pytest.approx(0.008, rel=1e-12)
    assert truth["accel.bias.z"] == pytest.approx(-0.0032 * STANDARD_GRAVITY, rel=1e-12)
    assert truth["gyro.bias.x"] == pytest.approx(-0.34 * DEG_H, rel=1e-12)
    assert truth["gyro.misalignment.zx"] == -6e-4
    assert truth["rig.mount.y"] == pytest.approx(2 / 60 * DEG, rel=1e-12)


def test_readings_are_matrix_times_input_plus_bias():
    unit = silent()
    force, rate = np.array([[0.0, 0.0, 9.8]]), np.array([[0.1, 0.2, 0.3]])
    found = readings(unit, force, rate)
    np.testing.assert_allclose(
        found["accel"][0], unit.accel_matrix @ unit.to_b @ force[0] + unit.accel_bias, rtol=1e-14
    )
    np.testing.assert_allclose(found["gyro"][0], unit.gyro_matrix @ unit.to_b @ rate[0] + unit.gyro_bias, rtol=1e-14)


def test_readings_of_segments_are_those_of_their_middles():
    unit = silent()
    plan = short_plan(unit)
    means = simulate_readings(unit, plan, perfect(plan), np.random.default_rng(1))
    middle = np.array([(s.start + s.stop) / 2 for s in plan.segment])
    np.testing.assert_array_equal(means.mid_time, middle)
    angles, rates = motion(plan, perfect(plan), middle)
    expected = readings(unit, *inputs(angles, rates, site_of(plan)))
    np.testing.assert_allclose(means.mean["gyro"], expected["gyro"], rtol=0, atol=1e-15)
    np.testing.assert_allclose(means.mean["accel"], expected["accel"], rtol=0, atol=2e-14)


def test_noise_of_a_simulated_reading_is_that_of_an_average():
    unit = laser_gyro_unit(accel_density=1e-3, gyro_density=1e-5)
    plan = short_plan(unit)
    rng = np.random.default_rng(2)
    runs = [simulate_readings(unit, plan, perfect(plan), rng) for _ in range(300)]
    clean = simulate_readings(silent(), plan, perfect(plan), rng)
    hold = np.array([s.stop - s.start for s in plan.segment])
    for sensor, density in (("accel", 1e-3), ("gyro", 1e-5)):
        errors = np.array([r.mean[sensor] for r in runs]) - clean.mean[sensor]
        # 300 runs of 3 axes: relative standard deviation of a standard deviation 1 / sqrt(2 * 900) = 2.4 %; four of them
        np.testing.assert_allclose(errors.std(axis=(0, 2)), density / np.sqrt(hold), rtol=0.095)


# ---------------------------------------------------------------------------------------------- sample by sample


@pytest.mark.parametrize("frequency", [25.0, 100.0])
def test_white_noise_has_its_density_at_any_rate(frequency):
    unit, quiet = silent(accel=1e-3, gyro=1e-5), silent()
    plan = short_plan(unit, dwell=20.0, turning=0.0)
    rng = np.random.default_rng(5)
    time, noisy = simulate_recording(unit, plan, perfect(plan), rng, frequency=frequency)
    _, clean = simulate_recording(quiet, plan, perfect(plan), rng, frequency=frequency)
    for sensor, density in (("accel", 1e-3), ("gyro", 1e-5)):
        noise = noisy[sensor] - clean[sensor]
        # variance of one sample: density^2 times the sample rate; white: neighbours do not correlate. n values each.
        n = noise.size
        assert noise.std() == pytest.approx(density * math.sqrt(frequency), rel=4 / math.sqrt(2 * n))
        correlation = np.mean(noise[1:] * noise[:-1]) / noise.var()
        assert abs(correlation) < 4 / math.sqrt(n)
        assert abs(noise.mean()) < 4 * noise.std() / math.sqrt(n)
    assert time[0] == 1 / frequency
    assert np.diff(time) == pytest.approx(np.full(time.size - 1, 1 / frequency), rel=1e-9)


def test_pulses_carry_their_residue():
    rates = {"accel": 10800 / STANDARD_GRAVITY, "gyro": 1.1866 * 648000 / math.pi}  # pulses per m/s and per rad
    unit = silent({"accel": "10800 pulse/g/s", "gyro": "1.1866 pulse/arcsec"})
    plan = short_plan(unit)
    time, pulses = simulate_recording(unit, plan, perfect(plan), np.random.default_rng(6), frequency=50.0)
    middle = motion(plan, perfect(plan), time - 0.01)  # of the interval over which pulses are counted
    levels = readings(unit, *inputs(*middle, site_of(plan)))
    for sensor, scale in rates.items():
        counted = np.cumsum(pulses[sensor], axis=0)
        integral = np.cumsum(levels[sensor], axis=0) / 50.0 * scale
        assert (pulses[sensor] == np.round(pulses[sensor])).all()
        # never more than one pulse behind, at any time; 1e-6 of a pulse for the rounding of sums of 1e5
        assert (counted <= integral + 1e-6).all()
        assert (counted > integral - 1 - 1e-6).all()
    assert time.size == 43 * 50


def test_levels_are_rounded_where_the_scale_is_a_level():
    unit = silent({"accel": "16384 LSB/g"})
    plan = short_plan(unit)
    _, counts = simulate_recording(unit, plan, perfect(plan), np.random.default_rng(7), frequency=10.0)
    _, levels = simulate_recording(silent(), plan, perfect(plan), np.random.default_rng(7), frequency=10.0)
    np.testing.assert_array_equal(counts["accel"], np.round(levels["accel"] * 16384 / STANDARD_GRAVITY))
    np.testing.assert_array_equal(counts["gyro"], levels["gyro"])


def test_a_written_recording_reads_back_as_what_was_simulated(tmp_path):
    unit = laser_gyro_unit(accel_density=0.0, gyro_density=0.0)
    plan = short_plan(unit)
    time, samples = simulate_recording(unit, plan, perfect(plan), np.random.default_rng(8), frequency=50.0)
    write_recording(str(tmp_path / "r.parquet"), time, samples, unit.pulses)
    recording = open_recording(tmp_path / "r.parquet", scale=plan.unit.scale)
    assert recording.increments == {"accel", "gyro"}
    batch = recording.read()
    np.testing.assert_array_equal(batch.time, time)
    # axis by axis: its own pulses per g s, over 0.02 s
    scale = np.array([10800, 10400, 10600]) / STANDARD_GRAVITY * 0.02
    np.testing.assert_allclose(batch.accel, samples["accel"] / scale, rtol=1e-9)
    np.testing.assert_allclose(batch.gyro, samples["gyro"] / (1.1866 * 648000 / math.pi * 0.02), rtol=1e-9)


def test_the_same_seed_gives_the_same_recording():
    unit = laser_gyro_unit()
    plan = short_plan(unit)
    one, two = (
        simulate_recording(unit, plan, imperfect_table(plan, rng), rng, frequency=20.0)[1]
        for rng in (np.random.default_rng(9), np.random.default_rng(9))
    )
    np.testing.assert_array_equal(one["gyro"], two["gyro"])


def test_before_and_after_the_plan_the_table_rests():
    plan = Plan(segment=(Segment(name="a", start=5, stop=6, outer=1.0, middle=0.0, inner=0.0),), latitude=0.5)
    angles, rates = motion(plan, perfect(plan), np.array([0.0, 5.5, 6.5, 100.0]))
    np.testing.assert_allclose(angles[:, 0], [0, 1, 1, 1], atol=1e-15)
    assert (rates[[0, 1, 2, 3]] == 0).all()
