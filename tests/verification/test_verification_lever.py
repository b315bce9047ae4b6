"""A calibration without a lever arm is verified on segments that turn: gyro misalignments show at their noise."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sagnac import from_arrays
from sagnac.calibrate import multi_position
from sagnac.compensation import corrections
from sagnac.rigs.turntable import attitude, averaging, mean_inputs
from sagnac.simulate.plans import CHECK, table_plan
from sagnac.simulate.table import imperfect_table, readings, simulate_readings, site_of
from sagnac.simulate.unit import laser_gyro_unit
from sagnac.verification.axis import axes
from sagnac.verification.judge import judge

UNIT = laser_gyro_unit()
PULSELESS = type(UNIT)(**{**vars(UNIT), "pulses": {}})
SETTING = np.radians(5.0 / 3600.0)
EMPTY = from_arrays([0.0], [[0.0] * 3], [[0.0] * 3])
LEVER = np.array([0.12, -0.2, 0.31])


def stated(plan):
    """The plan with what the simulated table does."""
    rig = plan.rig.model_copy(update={"angle_uncertainty": float(SETTING / np.sqrt(3.0)), "axis_uncertainty": 0.0})
    return plan.model_copy(update={"rig": rig})


def averaged(plan, rng, lever):
    """Means over whole segments of a thousand samples, the unit at a distance from the table's outer axis."""
    table = imperfect_table(plan, rng, setting=SETTING, axis=0.0)
    means = simulate_readings(PULSELESS, plan, table, rng)
    means = replace(means, interval=means.duration / 1000.0, count=np.full(len(plan.segment), 1000))
    rates = np.array([s.rates for s in plan.segment])
    middle = np.array([s.angles for s in plan.segment]) + rates * means.duration[:, None] / 2 + table.settings
    left = averaging(rates.sum(axis=1) * means.interval, means.count)
    felt = mean_inputs(middle, rates, left, site_of(plan), derivatives=False)
    up = attitude(middle)[:, 2, :]
    away = rates[:, :1] ** 2 * (up * (up @ lever)[:, None] - lever)
    noise = {"accel": PULSELESS.accel_density, "gyro": PULSELESS.gyro_density}
    clean = readings(PULSELESS, felt.force + away, felt.rate)
    spread = 1.0 / np.sqrt(means.duration)[:, None]
    mean = {k: v + noise[k] * spread * rng.standard_normal(v.shape) for k, v in clean.items()}
    return replace(means, mean=mean)


def on_table(positions, rng, *, lever=LEVER, both=None):
    """A check of these positions, with turns at a second rate where `both` gives one."""
    plan = stated(table_plan(PULSELESS, positions, dwell=60.0, turning=72.0, rate=20.0))
    if both is not None:
        more = [s.model_copy(update={"name": f"{s.name}b", "outer_rate": both}) for s in plan.segment if s.outer_rate]
        plan = plan.model_copy(update={"segment": (*plan.segment, *more)})
    return plan, averaged(plan, rng, lever)


def calibrated(rng):
    plan = stated(table_plan(PULSELESS, dwell=60.0, turning=72.0))
    return multi_position.calibrate_means(averaged(plan, rng, LEVER), plan, matrix="triangular")


def judged(calibration, plan, means):
    return judge(calibration, means, plan, corrections(calibration, EMPTY), None)


def turned(calibration, angle):
    """All gyro axes turned about z against the accelerometers, by so much."""
    axes = "xyz"
    names = [[f"gyro.scale_error.{a}" if a == b else f"gyro.misalignment.{a}{b}" for b in axes] for a in axes]
    matrix = np.array([[calibration[n].value for n in row] for row in names]) + np.eye(3)
    c, s = np.cos(angle), np.sin(angle)
    moved = matrix @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) - np.eye(3)
    changed = {n: float(moved[i, j]) for i, row in enumerate(names) for j, n in enumerate(row)}
    parameters = tuple(p.model_copy(update={"value": changed.get(p.name, p.value)}) for p in calibration.parameters)
    return calibration.model_copy(update={"parameters": parameters})


def spread_of_turn(calibration):
    """Standard uncertainty of the turn about z that the gyro misalignments xy and yx hold."""
    names = list(calibration.values())
    at = [names.index("gyro.misalignment.xy"), names.index("gyro.misalignment.yx")]
    half = np.array([0.5, -0.5])
    return float(np.sqrt(half @ calibration.matrix[np.ix_(at, at)] @ half))


@pytest.fixture(scope="module")
def calibration():
    return calibrated(np.random.default_rng(4))


def test_lever_arm_is_found_and_taken_out(calibration):
    """8 segments with two components each, 8 rates, 8 gravities, and three unknowns of the lever arm."""
    outcome = judged(calibration, *on_table(CHECK, np.random.default_rng(5)))
    assert outcome.passed
    assert outcome.degrees_of_freedom == 32 - 3
    axis = [c for c in outcome.checks if c.what == "rate axis"]
    assert max(c.standard_uncertainty for c in axis) < 2 * SETTING
    (remark,) = [r for r in outcome.remarks if "lever arm" in r]
    found = [float(v) for v in re.findall(r"[xyz] (-?[\d.]+) ±", remark)]
    assert remark.count(" mm") == 3
    np.testing.assert_allclose(found, 1e3 * LEVER, atol=2.0)  # some 4 standard uncertainties of 0.5 mm


def test_derivatives_are_those_of_the_misfits(calibration):
    """To a lever arm of a tenth of a millimetre each way, and to a turn of the gyros by a microradian about z."""

    def misfits(found, lever):
        plan, means = on_table(CHECK, np.random.default_rng(5), lever=lever)
        return axes(found, means, plan, corrections(found, EMPTY))

    still = misfits(calibration, np.zeros(3))
    for arm in 1e-4 * np.eye(3):
        change = misfits(calibration, arm).residual - misfits(calibration, -arm).residual
        # the table's case frame is mounted 1.5 mrad from that of the accelerometers; values up to 0.0124, (20 deg/s)^2 / g
        np.testing.assert_allclose(change / 2e-4, still.lever @ PULSELESS.to_b @ arm / 1e-4, atol=1e-6)
    change = misfits(turned(calibration, 1e-6), np.zeros(3)).residual - still.residual
    np.testing.assert_allclose(change / 1e-6, still.turn[:, 2], atol=1e-3)


def test_wrong_misalignment_fails(calibration):
    """By 10 standard uncertainties, which is less than a thousandth of what a lever arm of half a metre would do."""
    wrong = 10.0 * spread_of_turn(calibration)
    assert wrong < np.radians(0.01)
    plan, means = on_table(CHECK, np.random.default_rng(5))
    assert not judged(turned(calibration, wrong), plan, means).passed


def test_misalignment_that_a_lever_arm_hides_is_not_called_verified(calibration):
    upright = ((0.0, 0.0, 0.0), (0.0, 90.0, 0.0))
    two, plan_two = on_table(upright, np.random.default_rng(6)), on_table(upright, np.random.default_rng(6), both=0.1)
    outcome = judged(calibration, *two)
    assert any("the gyros' misalignment is not verified" in r and "lever arm" in r for r in outcome.remarks)
    assert not any("is not verified" in r and "lever" in r for r in judged(calibration, *plan_two).remarks)
    single = judged(calibration, *on_table(upright[:1], np.random.default_rng(6)))
    assert any("the gyros' misalignment is not verified" in r for r in single.remarks)
    assert all(np.isfinite(c.z) for c in single.checks)
    one_axis = judged(calibration, *on_table(upright[:1], np.random.default_rng(6), both=0.1))
    assert any("the gyros' misalignment is verified only in part" in r for r in one_axis.remarks)


def test_what_is_not_excited_is_named(calibration):
    plan, means = on_table(((0.0, 0.0, 0.0), (90.0, 0.0, 0.0)), np.random.default_rng(7))
    remarks = judged(calibration, plan, means).remarks
    assert any(r.startswith("gyro x, y: no segment turns about it") for r in remarks)
    assert any(r.startswith("accel x, y: no segment stands with it along the vertical") for r in remarks)


@pytest.mark.statistical
def test_right_calibrations_pass_as_often_as_stated():
    """200 calibrations, each verified on one fresh recording: chi-square of the stated degrees of freedom.

    Mean within 3.3 sampling errors of the degrees of freedom, probabilities uniform (Kolmogorov-Smirnov at 0.1 %).
    """
    from scipy.stats import kstest

    rng, chi2, p_values = np.random.default_rng(8), [], []
    for _ in range(200):
        outcome = judged(calibrated(rng), *on_table(CHECK, rng, lever=rng.uniform(-0.5, 0.5, 3)))
        chi2.append(outcome.chi2)
        p_values.append(outcome.p_value)
    assert abs(np.mean(chi2) - outcome.degrees_of_freedom) < 3.3 * np.sqrt(2 * outcome.degrees_of_freedom / 200)
    assert kstest(p_values, "uniform").pvalue > 1e-3
