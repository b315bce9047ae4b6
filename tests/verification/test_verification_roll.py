"""Verification of a roll-isolated calibration: passes when it should, fails with the line named when it should not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.calibrate import calibrate
from sagnac.errors import DataError, InputError
from sagnac.recording import from_arrays
from sagnac.rigs.roll_isolated import DELAY, ECCENTRICITY, HALF_ANGLE, MOUNT_PITCH, PHASE
from sagnac.simulate.roll_isolated import (
    BIAS_STABILITY,
    PUBLISHED,
    published_check,
    published_plan,
    recording_of,
    simulate,
)
from sagnac.verification import verify

DEG = math.pi / 180
TRUTH = PUBLISHED | {DELAY: 1e-3, ECCENTRICITY[0]: 0.1 * DEG, "gyro.bias.x": 1e-4, "gyro.scale_error.x": 2e-3}


def log(plan, truth=TRUTH, seed=1, **options):
    options = {"frequency": 500.0, "drift": BIAS_STABILITY} | options
    return recording_of(simulate(plan, truth, np.random.default_rng(seed), **options))


@pytest.fixture(scope="module")
def calibration():
    plan = published_plan(hold=20.0, move=1.0)
    return calibrate("roll-isolated", log(plan), plan)


CHECK = published_check(hold=20.0)


def by_name(outcome):
    return {c.what: c for c in outcome.checks}


def outcome_of(calibration, change=None, plan=CHECK, **options):
    return verify(calibration, log(plan, TRUTH | (change or {}), **({"seed": 2} | options)), plan)


def test_the_same_unit_passes(calibration):
    outcome = outcome_of(calibration)
    assert outcome.passed
    assert {c.what for c in outcome.checks} == {
        "y mean", "z mean", "y swing", "z swing", "spin in phase", "spin across", "spin backward", "twice spin", "encoder 1x",
        "encoder 2x", "encoder delay", "x scale",
    }  # fmt: skip
    assert outcome.degrees_of_freedom == 18
    assert "PASS" in outcome.summary()
    assert outcome.to_dict()["checks"][0]["segment"] == "test"


@pytest.mark.parametrize(
    ("change", "line", "size", "cause"),
    [
        # 10.3 deg/s across the axis times the change
        ({HALF_ANGLE: 0.18 * DEG}, "spin in phase", 3600 * DEG * math.sin(0.0158 * DEG), "half-angle of the cone"),
        ({PHASE: 29.3 * DEG}, "spin across", 3600 * DEG * math.sin(0.1642 * DEG) * 2 * DEG, "phase of the cone"),
        # rate of the swing, 2 deg at 1.7 Hz, times the change
        ({MOUNT_PITCH: 0.2 * DEG}, "y swing", -0.24 * DEG * 2 * DEG * 2 * math.pi * 1.7, "mounting angles"),
        ({ECCENTRICITY[1]: 0.1 * DEG}, "encoder 1x", 0.1 * DEG, "eccentricity of the encoder"),
        ({ECCENTRICITY[2]: 0.1 * DEG}, "encoder 2x", 0.1 * DEG, "eccentricity of the encoder"),
        ({DELAY: 1.5e-3}, "encoder delay", 0.5e-3, "delay of the encoder"),
        ({"gyro.bias.z": 0.5 * DEG}, "z mean", 0.5 * DEG, "bias"),
        ({"gyro.scale_error.x": 0.01}, "x scale", 0.008, "scale of gyro x"),
        ({"gyro.scale_error.y": 0.1}, "spin backward", 0.05 * 3600 * DEG * math.sin(0.1642 * DEG), "scales of gyros y and z"),
    ],
)  # fmt: skip
def test_what_has_changed_is_named_with_its_size(calibration, change, line, size, cause):
    outcome = outcome_of(calibration, change)
    assert not outcome.passed
    check = by_name(outcome)[line]
    assert abs(check.z) > 5
    assert check.residual == pytest.approx(size, rel=0.1)
    assert any(f"'test', {line}: " in r and cause in r for r in outcome.remarks)


def test_published_case_with_a_delay_that_is_not_modelled():
    """1 ms, stated as zero: calibrated at 6480 deg/s it hides in the phase of the cone, and shows at 3600 deg/s.

    Of the 6.48 deg that it put into the phase 3.6 belong there at this speed: 2.88 deg of 10.3 deg/s.
    """
    plan, check = published_plan(encoder_delay=0.0), published_check()
    calibration = calibrate("roll-isolated", log(plan, frequency=1000.0), plan)
    outcome = verify(calibration, log(check, frequency=1000.0, seed=2), check)
    assert not outcome.passed
    assert "FAIL" in outcome.summary()
    across = by_name(outcome)["spin across"]
    assert math.degrees(across.residual) == pytest.approx(10.317 * math.radians(2.88), rel=0.02)
    assert any("spin across" in r and "at 10 Hz" in r and "delay of the encoder" in r for r in outcome.remarks)
    assert any("residual spectrum of gyro_y" in r and "10 Hz" in r and "spin" in r for r in outcome.remarks)
    assert by_name(outcome)["encoder delay"].residual == pytest.approx(1e-3, abs=2e-5)
    # left to be estimated, all is well
    free = published_plan()
    good = calibrate("roll-isolated", log(free, frequency=1000.0), free)
    assert verify(good, log(check, frequency=1000.0, seed=2), check).passed


def test_a_line_of_nobody_is_reported(calibration):
    batch = log(CHECK, seed=3).read()
    shaken = batch.gyro + 0.03 * DEG * np.cos(2 * np.pi * 47.0 * batch.time)[:, None]
    outcome = verify(calibration, from_arrays(batch.time, gyro=shaken, rig={"encoder": batch.rig["encoder"]}), CHECK)
    notes = [r for r in outcome.remarks if "vibration" in r]
    assert any("gyro_y: 0.03" in n or "gyro_y: 0.02" in n for n in notes)
    assert notes
    assert all("at 46.9" in n or "at 47" in n for n in notes)


def test_a_cylinder_that_does_not_swing(calibration):
    outcome = outcome_of(calibration, swing_amplitude=0.0)
    assert outcome.passed
    assert not {"y swing", "encoder delay", "x scale"} & set(by_name(outcome))


def test_both_stages_are_checked(calibration):
    plan = published_plan(hold=10.0, move=1.0, spins=(3600.0, 1800.0))
    outcome = outcome_of(calibration, plan=plan)
    assert outcome.passed
    assert [c.what for c in outcome.checks if c.segment == "inner +"] == ["x mean", "y mean", "z mean"]
    moved = outcome_of(calibration, {MOUNT_PITCH: 0.06 * DEG}, plan=plan)
    assert not moved.passed
    check = next(c for c in moved.checks if c.segment == "inner -" and c.what == "y mean")
    assert check.residual == pytest.approx(280 * DEG * math.sin(0.1 * DEG), rel=0.1)


def test_noise_that_the_plan_does_not_state_is_found(calibration):
    plan = CHECK.model_copy(
        update={
            "unit": CHECK.unit.model_copy(update={"noise": type(CHECK.unit.noise)()}),
            "rig": CHECK.rig.model_copy(update={"encoder_resolution": 0.0}),
        }
    )
    recording = log(CHECK, seed=2)
    stated, found = verify(calibration, recording, CHECK), verify(calibration, recording, plan)
    assert found.passed
    for a, b in zip(stated.checks, found.checks, strict=True):
        assert b.standard_uncertainty == pytest.approx(a.standard_uncertainty, rel=0.15)


def test_what_cannot_be_verified_is_refused(calibration):
    with pytest.raises(InputError, match=r"needs a plan"):
        verify(calibration, log(CHECK), None)
    wrong = published_check(hold=20.0, spin=-3600.0)
    with pytest.raises(DataError, match="wrong sign of spin_rate"):
        verify(calibration, log(CHECK), wrong)


@pytest.mark.statistical
def test_verification_fails_as_often_as_it_says():
    """300 fresh calibrations and checks of 3 s at 100 Hz: probabilities uniform (3.3 sampling errors), ratios of size one."""
    plan, check = published_plan(hold=3.0, move=0.5), published_check(hold=3.0)
    p_values, ratios = [], []
    for k in range(300):
        rng = np.random.default_rng(900 + k)
        truth = (
            PUBLISHED | {DELAY: rng.normal(1e-3, 3e-4)} | {n: 0.05 * DEG * rng.standard_normal() for n in ECCENTRICITY}
        )
        truth |= {f"gyro.scale_error.{a}": 0.01 * rng.standard_normal() for a in "yz"}
        options = {
            "frequency": 100.0, "drift": BIAS_STABILITY, "earth": (0.0, 0.0, 0.0), "swing_frequency": rng.uniform(1.5, 1.9),
            "swing_amplitude": rng.uniform(1.8, 2.2) * DEG,
        }  # fmt: skip
        calibration = calibrate("roll-isolated", recording_of(simulate(plan, truth, rng, **options)), plan)
        outcome = verify(calibration, recording_of(simulate(check, truth, rng, **options)), check)
        p_values.append(outcome.p_value)
        ratios.append([c.z for c in outcome.checks])
    for level in (0.1, 0.5, 0.9):
        assert abs(np.mean(np.array(p_values) < level) - level) < 3.3 * math.sqrt(level * (1 - level) / 300)
    sizes = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.abs(sizes - 1).max() < 3.3 / math.sqrt(2 * 300)
