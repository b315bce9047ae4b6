"""The simulated roll-isolated rig: motion, readings, noise, rounding, pieces."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.recording import open_recording
from sagnac.rigs.roll_isolated import (
    DELAY,
    ECCENTRICITY,
    HALF_ANGLE,
    MOUNT_PITCH,
    MOUNT_YAW,
    PHASE,
    RollRig,
    encoder_reading,
    mount,
)
from sagnac.simulate.roll_isolated import (
    PARAMETERS,
    PUBLISHED,
    Motion,
    Profile,
    published_check,
    published_plan,
    recording_of,
    simulate,
    write_recording,
)

DEG = math.pi / 180
PLAN = published_plan(hold=2.0, move=1.0, spins=(3600.0, -1800.0))


def silent(plan=PLAN, truth=PUBLISHED, **options):
    options = {"frequency": 200.0, "density": 0.0, "encoder_bits": None, "earth": (0.0, 0.0, 0.0)} | options
    return recording_of(simulate(plan, truth, np.random.default_rng(1), **options)).read()


def in_segment(batch, number, plan=PLAN):
    s = plan.segment[number]
    return (batch.time >= s.start) & (batch.time < s.stop)


def test_profiles_integrate_exactly():
    p = Profile.through([(1.0, 0.0), (3.0, 4.0), (4.0, 4.0)])
    value, integral = p.at(np.array([0.0, 1.0, 2.0, 3.0, 3.5, 6.0]))
    np.testing.assert_allclose(value, [0, 0, 2, 4, 4, 4])
    np.testing.assert_allclose(integral, [0, 0, 1, 4, 6, 16])


def test_rates_are_the_derivatives_of_the_angles():
    motion = Motion.of(PLAN, 2 * DEG, 1.7)
    t, h = np.linspace(0.1, 14.0, 400) + 1e-3, 1e-6
    angle, rate = motion.swing(t)
    np.testing.assert_allclose((motion.swing(t + h)[0] - motion.swing(t - h)[0]) / (2 * h), rate, atol=1e-6)
    assert np.abs(angle).max() == pytest.approx(2 * DEG, rel=0.01)
    rig = RollRig(half_angle=0.2)
    slope = (motion.angle(t + h, rig) - motion.angle(t - h, rig)) / (2 * h)
    np.testing.assert_allclose(slope, motion.spin.at(t)[0] * math.cos(0.2) - rate, atol=1e-5)


def test_the_plan_is_run():
    motion = Motion.of(PLAN, 0.0, 1.0)
    for s in PLAN.segment:
        t = np.linspace(s.start + 1e-6, s.stop - 1e-6, 9)
        np.testing.assert_allclose(motion.spin.at(t)[0], s.spin_rate, rtol=1e-12)
        np.testing.assert_allclose(motion.inner.at(t)[0], s.inner_rate, rtol=1e-12)


def test_inner_stage_shows_the_mounting_alone():
    batch = silent()
    here = in_segment(batch, 0)
    column = mount(PUBLISHED[MOUNT_YAW], PUBLISHED[MOUNT_PITCH])[:, 0]
    np.testing.assert_allclose(batch.gyro[here], np.tile(280 * DEG * column, (here.sum(), 1)), rtol=1e-12, atol=1e-15)
    assert np.ptp(batch.rig["encoder"][here]) == 0.0


def test_spin_stage_shows_the_published_cone():
    """w0 sin a at 3600 deg/s is 10.3 deg/s [ZHANG15]; its phase is the encoder's angle and the cone's."""
    batch = silent(swing_amplitude=0.0)
    here = in_segment(batch, 2)
    w1 = batch.gyro[here] @ mount(PUBLISHED[MOUNT_YAW], PUBLISHED[MOUNT_PITCH])
    size = np.hypot(w1[:, 1], w1[:, 2])
    np.testing.assert_allclose(np.degrees(size), 3600 * math.sin(0.1642 * DEG), rtol=1e-12)
    assert np.degrees(size[0]) == pytest.approx(10.3, abs=0.05)
    phase = np.arctan2(w1[:, 2], w1[:, 1])
    np.testing.assert_allclose(np.exp(1j * phase), np.exp(1j * (batch.rig["encoder"][here] + 27.3 * DEG)), atol=1e-10)


def test_bias_scale_delay_eccentricity_and_steps():
    truth = PUBLISHED | {"gyro.bias.y": 0.01, "gyro.scale_error.z": 0.02, DELAY: 2e-3, ECCENTRICITY[1]: 0.03}
    plain, off = silent(), silent(truth=truth, encoder_bits=12)
    np.testing.assert_allclose(off.gyro[:, 0], plain.gyro[:, 0], atol=1e-14)
    np.testing.assert_allclose(off.gyro[:, 1] - 0.01, plain.gyro[:, 1], atol=1e-14)
    np.testing.assert_allclose(off.gyro[:, 2] / 1.02, plain.gyro[:, 2], atol=1e-14)
    motion, rig = Motion.of(PLAN, 2 * DEG, 1.7), RollRig.of(truth)
    step = 2 * np.pi / 2**12
    expected = encoder_reading(motion.angle(off.time + 2e-3, rig), rig)
    error = off.rig["encoder"] - expected
    assert np.abs(error - 2 * np.pi * np.round(error / (2 * np.pi))).max() <= step / 2 * (1 + 1e-9)
    assert off.rig["encoder"].min() >= 0
    assert off.rig["encoder"].max() < 2 * np.pi
    np.testing.assert_allclose(off.rig["encoder"] / step, np.round(off.rig["encoder"] / step), atol=1e-8)


def test_noise_has_its_density_and_drift_its_size():
    noisy, quiet = silent(density=1e-3), silent()
    assert (noisy.gyro - quiet.gyro).std() == pytest.approx(1e-3 * math.sqrt(200), rel=0.03)
    offsets = np.concatenate(
        [
            (recording_of(simulate(PLAN, PUBLISHED, np.random.default_rng(k), frequency=20.0, density=0.0, drift=0.1,
                                   earth=(0.0, 0.0, 0.0))).read().gyro - silent(frequency=20.0).gyro)[60:61]
            for k in range(60)
        ]
    )  # fmt: skip
    assert offsets.std() == pytest.approx(0.1, rel=0.25)  # 180 numbers: 5 %


def test_earth_rate_turns_with_the_cylinder():
    """Along the axis it is a bias of gyro x; across it comes round with the cylinder's roll."""
    earth = (1e-3, 2e-3, 0.0)
    felt = silent(earth=earth, swing_amplitude=0.0).gyro - silent(swing_amplitude=0.0).gyro
    batch = silent()
    here = in_segment(batch, 0)
    w1 = felt[here] @ mount(PUBLISHED[MOUNT_YAW], PUBLISHED[MOUNT_PITCH])
    np.testing.assert_allclose(w1[:, 0], 1e-3, rtol=1e-9)
    np.testing.assert_allclose(np.hypot(w1[:, 1], w1[:, 2]), 2e-3, rtol=1e-9)
    assert np.ptp(np.arctan2(w1[:, 2], w1[:, 1])) > 6.0  # once round in 1.3 s
    # a level axis pointing north, at the plan's latitude of 40 deg
    own = silent(earth=None).gyro - silent().gyro
    assert np.linalg.norm(own, axis=1) == pytest.approx(np.full(len(own), PLAN.earth_rate), rel=1e-6)


def test_the_pieces_do_not_matter():
    parts = [
        recording_of(simulate(PLAN, PUBLISHED, np.random.default_rng(3), frequency=200.0, drift=1e-3, chunk=c)).read()
        for c in (1 << 16, 77)
    ]
    np.testing.assert_array_equal(parts[0].gyro, parts[1].gyro)
    np.testing.assert_array_equal(parts[0].rig["encoder"], parts[1].rig["encoder"])
    rows = [b.row for b in simulate(PLAN, PUBLISHED, np.random.default_rng(3), frequency=200.0, chunk=100)]
    assert rows == list(range(1, parts[0].time.size + 1, 100))


def test_full_scale_clips():
    batch = silent(full_scale=250 * DEG)
    assert batch.gyro.max() == 250 * DEG
    assert batch.gyro.min() == -250 * DEG


def test_files_read_back(tmp_path):
    batch = silent()
    rows = write_recording(
        tmp_path / "r.parquet", simulate(PLAN, PUBLISHED, np.random.default_rng(1), frequency=200.0, density=0.0,
                                         encoder_bits=None, earth=(0.0, 0.0, 0.0), chunk=500)
    )  # fmt: skip
    back = open_recording(tmp_path / "r.parquet").read()
    assert rows == back.time.size == batch.time.size
    np.testing.assert_allclose(back.gyro, batch.gyro, rtol=1e-14, atol=1e-16)
    np.testing.assert_allclose(back.rig["encoder"], batch.rig["encoder"], rtol=1e-14)


def test_published_case():
    plan, check = published_plan(), published_check()
    assert [round(math.degrees(s.turn_rate)) for s in plan.segment] == [280, -280, 6480]
    assert [round(math.degrees(s.turn_rate)) for s in check.segment] == [3600]
    assert check.segment[0].stop - check.segment[0].start == 60.0
    assert set(PUBLISHED) == {MOUNT_YAW, MOUNT_PITCH, HALF_ANGLE, PHASE} <= set(PARAMETERS)
