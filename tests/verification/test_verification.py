"""Verification passes what is right, fails what is not, at the rate it says."""

import numpy as np
import pytest

from sagnac import from_arrays, verify
from sagnac.calibrate import calibrate, hand_turned, norm
from sagnac.compensation import corrections
from sagnac.errors import DataError, InputError
from sagnac.plan import Plan
from sagnac.sensors import Correction
from sagnac.simulate.hand import simulate_hand_turned
from sagnac.simulate.plans import CHECK, table_plan
from sagnac.simulate.table import imperfect_table, simulate_readings, simulate_recording
from sagnac.simulate.unit import laser_gyro_unit
from sagnac.verification.judge import judge

UNIT = laser_gyro_unit()
PULSELESS = type(UNIT)(**{**vars(UNIT), "pulses": {}})


def recorded(plan, seed):
    rng = np.random.default_rng(seed)
    time, samples = simulate_recording(PULSELESS, plan, imperfect_table(plan, rng), rng, frequency=10.0)
    return from_arrays(time, samples["accel"], samples["gyro"])


@pytest.fixture(scope="module")
def calibration():
    plan = table_plan(PULSELESS, dwell=60.0, turning=72.0)
    return calibrate("norm", recorded(plan, 1), plan)


@pytest.fixture(scope="module")
def check():
    return table_plan(PULSELESS, CHECK, dwell=60.0, turning=72.0)


def test_good_calibration_passes(calibration, check):
    outcome = verify(calibration, recorded(check, 2), check)
    assert outcome.passed
    assert outcome.degrees_of_freedom == 16 + 16
    assert {c.what for c in outcome.checks} == {"static norm", "rate norm", "rate axis"}
    assert "PASS" in outcome.summary()
    assert max(abs(c.residual) for c in outcome.checks if c.what == "static norm") < 5e-5


@pytest.mark.parametrize(
    ("name", "change"),
    [("accel.scale_error.x", 2e-5), ("accel.bias.z", 2e-4), ("gyro.scale_error.y", 5e-6), ("gyro.bias.z", 5e-7)],
)
def test_wrong_parameter_fails(calibration, check, name, change):
    """Each wrong by some ten to thirty of its standard uncertainties."""
    parameters = tuple(
        p.model_copy(update={"value": p.value + change}) if p.name == name else p for p in calibration.parameters
    )
    outcome = verify(calibration.model_copy(update={"parameters": parameters}), recorded(check, 2), check)
    assert not outcome.passed
    assert "FAIL" in outcome.summary()


@pytest.mark.parametrize("turn", ["small", "quarter", "reversed"])
def test_turned_gyro_axes_fail(calibration, check, turn):
    """Norms do not see which way the gyros look; the accelerometers in the turning segments do."""
    columns = np.array([[calibration[n].value for n in row] for row in _gyro_names()]) + np.eye(3)
    moved = {
        "small": columns @ np.array([[1, 1e-4, 0], [-1e-4, 1, 0], [0, 0, 1]]),
        "quarter": columns @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]),
        "reversed": -columns,
    }[turn] - np.eye(3)
    changed = {n: moved[i, j] for i, row in enumerate(_gyro_names()) for j, n in enumerate(row)}
    parameters = tuple(
        p.model_copy(update={"value": float(changed.get(p.name, p.value))}) for p in calibration.parameters
    )
    outcome = verify(calibration.model_copy(update={"parameters": parameters}), recorded(check, 2), check)
    assert not outcome.passed


def _gyro_names():
    axes = "xyz"
    return [[f"gyro.scale_error.{a}" if a == b else f"gyro.misalignment.{a}{b}" for b in axes] for a in axes]


@pytest.mark.statistical
def test_fails_as_often_as_it_says(check):
    """300 calibrations, each verified on one fresh recording: probabilities uniform (mean 1/2 within 3.3 sampling errors)."""
    plan = table_plan(PULSELESS, dwell=60.0, turning=72.0)
    rng, p_values = np.random.default_rng(3), []
    empty = from_arrays([0.0], [[0.0] * 3], [[0.0] * 3])
    for _ in range(300):
        fitted = norm.calibrate_means(simulate_readings(PULSELESS, plan, imperfect_table(plan, rng), rng), plan)
        fresh = simulate_readings(PULSELESS, check, imperfect_table(check, rng), rng)
        p_values.append(judge(fitted, fresh, check, corrections(fitted, empty), None).p_value)
    assert abs(np.mean(p_values) - 0.5) < 3.3 / np.sqrt(12 * 300)
    assert np.mean(np.array(p_values) < 0.1) < 0.1 + 3.3 * np.sqrt(0.09 / 300)


def test_biases_alone_are_compared_with_fresh_ones():
    """A four-position result has no scale, so that no norm can be judged; the same positions give the biases again."""
    plan = Plan(
        latitude=0.7,
        gravity=9.8,
        unit={"noise": {"accel": 1e-4, "gyro": 1e-6}},
        segment=tuple(
            {"name": str(i), "start": 60.0 * i, "stop": 60.0 * i + 60.0, "x_azimuth": x, "y_azimuth": y, "z": z}
            for i, (x, y, z) in enumerate(
                (
                    (0.0, -np.pi / 2, "up"),
                    (0.0, np.pi / 2, "down"),
                    (np.pi, -np.pi / 2, "down"),
                    (np.pi, np.pi / 2, "up"),
                )
            )
        ),
    )
    up = np.array([1.0, -1.0, -1.0, 1.0]).repeat(60)
    accel = np.outer(up, [0, 0, 9.8 * 1.01]) + [0.01, 0.02, 0.03]  # a scale error that the method does not see
    time = np.arange(240.0) + 0.5
    rng = np.random.default_rng(0)
    first, second = (from_arrays(time, accel + 1e-4 * rng.standard_normal((240, 3))) for _ in range(2))
    found = calibrate("four-position", first, plan)
    outcome = verify(found, second, plan)
    assert outcome.passed
    assert [c.what for c in outcome.checks] == [f"accel.bias.{a}" for a in "xyz"]
    shifted = from_arrays(time, accel + 1e-3)
    assert not verify(found, shifted, plan).passed


def test_hand_turned_log_is_verified_without_plan():
    rng = np.random.default_rng(5)
    accel = Correction("accel", np.diag([400.0, 410, 420]), np.array([3e4, 3e4, 3e4]), counts=True)
    gyro = Correction("gyro", np.diag([4700.0, 4800, 4900]), np.array([3e4, 3e4, 3e4]), 0.5 * np.eye(3), counts=True)
    first, second = (simulate_hand_turned(accel, gyro, rng, accel_noise=3.0, gyro_noise=23.0) for _ in range(2))
    counts = ("accel", "gyro")
    found = hand_turned.calibrate(from_arrays(*first, counts=counts), Plan(gravity=9.80665))
    outcome = verify(found, from_arrays(*second, counts=counts))
    assert outcome.passed
    assert outcome.rotation_rms == pytest.approx(np.radians(found.fit.residuals["rotation"].rms), rel=0.4)
    time, a, g = second
    bad = verify(found, from_arrays(time, a, (g - 3e4) * 1.02 + 3e4, counts=counts))
    assert not bad.passed
    assert any("rotations close to" in r for r in bad.remarks)


def test_units_must_match(calibration):
    raw = from_arrays(np.arange(100.0), np.ones((100, 3)), counts=("accel",))
    with pytest.raises(InputError, match="SI units, but .* raw counts"):
        verify(calibration, raw, Plan(gravity=9.8))


def test_nothing_to_compare_is_said(calibration):
    plan = Plan(latitude=0.7, gravity=9.8, segment=({"name": "1", "start": 0.0, "stop": 9.0},))
    gyro_only = from_arrays(np.arange(10.0), gyro=np.zeros((10, 3)))
    with pytest.raises(DataError, match="nothing to compare"):
        verify(calibration, gyro_only, plan)


def test_calibration_from_a_rig_is_not_taken_for_a_hand_turned_one(calibration, check):
    """Turning segments would pass for static intervals, and most of the calibration for verified."""
    with pytest.raises(InputError, match=r"made on a turntable; give the plan of this recording \(--plan\)"):
        verify(calibration, recorded(check, 2))


def test_static_segments_do_not_verify_gyros(calibration):
    plan = table_plan(PULSELESS, CHECK, dwell=60.0, turning=0.0)
    outcome = verify(calibration, recorded(plan, 2), plan)
    assert (
        "no segment turns: scale factors, misalignments and biases of the gyro triad are not verified"
        in outcome.remarks
    )


def test_uncertainties_larger_than_the_scatter_are_remarked(calibration, check):
    """All uncertainties stated ten times too large: chi-square a hundredth of its degrees of freedom, nearly."""
    wide = calibration.model_copy(
        update={"covariance": tuple(tuple(400 * v for v in row) for row in calibration.covariance)}
    )
    noisy = check.unit.noise.model_copy(
        update={"accel": 20 * PULSELESS.accel_density, "gyro": 20 * PULSELESS.gyro_density}
    )
    plan = check.model_copy(update={"unit": check.unit.model_copy(update={"noise": noisy})})
    outcome = verify(wide, recorded(check, 2), plan)
    assert outcome.passed
    assert any("the stated uncertainties are larger than what is seen" in r for r in outcome.remarks)
    assert "probability > 0.999" in outcome.summary()
    assert "-0.00 " not in outcome.summary()
