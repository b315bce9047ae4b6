"""Uncertainty budgets: their lines make up the whole, and each line is what its source alone does to the result."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.calibrate import budget, calibrate, multi_position, norm, table
from sagnac.earth import STANDARD_GRAVITY
from sagnac.estimate import SCATTER
from sagnac.recording import from_arrays
from sagnac.rigs.turntable import TableErrors
from sagnac.sensors import Correction
from sagnac.simulate.hand import simulate_hand_turned
from sagnac.simulate.plans import ICOSAHEDRON, table_plan
from sagnac.simulate.table import SimulatedTable, simulate_readings
from sagnac.simulate.unit import laser_gyro_unit

ARCMIN, ARCSEC, DEG_H = np.pi / 10800, np.pi / 648000, np.pi / 648000
NOISY = laser_gyro_unit(gyro_density=0.01 * DEG_H)
CLEAN = laser_gyro_unit(accel_density=0.0, gyro_density=0.0)
METHODS = {"norm": norm, "table": table, "multi-position": multi_position}
RIGHT = SimulatedTable(TableErrors(), np.zeros((24, 3)))


def planned(angle=0.2 * ARCMIN, axis=20 * ARCSEC, **site):
    plan = table_plan(
        NOISY, ICOSAHEDRON, dwell=1.0, turning=1.0, move=1.0, angle_uncertainty=angle, axis_uncertainty=axis
    )
    return plan.model_copy(update=site)


def parts(calibration) -> dict[str, np.ndarray]:
    return {line.source: np.array(line.standard_uncertainty) for line in calibration.budget}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("site", [{}, {"gravity_uncertainty": 1e-4}])
def test_the_lines_make_up_the_uncertainty(method, site):
    plan = planned(**site)
    found = METHODS[method].calibrate_means(simulate_readings(NOISY, plan, RIGHT, np.random.default_rng(1)), plan)
    lines = parts(found)
    assert set(lines) >= {budget.NOISE, budget.SETTINGS}
    assert (budget.GRAVITY in lines) == bool(site)
    total = np.sqrt(sum(v**2 for v in lines.values()))
    np.testing.assert_allclose(total, [p.standard_uncertainty for p in found.parameters], rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_gravity_is_in_the_scale_of_the_accelerometers(method):
    # a gravity wrong by e is a scale wrong by e, times the gain of the axis, whatever else there is
    plan = planned(gravity_uncertainty=1e-4)
    found = METHODS[method].calibrate_means(simulate_readings(NOISY, plan, RIGHT, np.random.default_rng(2)), plan)
    at = [p.name for p in found.parameters].index("accel.scale_error.y")
    expected = 1e-4 / plan.site_gravity * (1 + found.parameters[at].value)
    assert parts(found)[budget.GRAVITY][at] == pytest.approx(expected, rel=2e-3)


def only(source: str, rng: np.random.Generator, plan):
    """Readings of a unit and table on which nothing but one source errs."""
    settings, errors, unit = np.zeros((24, 3)), TableErrors(), CLEAN
    if source == budget.NOISE:
        unit = NOISY
    elif source == budget.SETTINGS:
        settings = plan.rig.angle_uncertainty * rng.standard_normal((24, 3))
    else:
        q = plan.rig.axis_uncertainty * rng.standard_normal(7)
        errors = TableErrors((q[0], q[1]), (q[2], q[3]), (q[4], q[5], q[6]))
    return simulate_readings(unit, plan, SimulatedTable(errors, settings), rng)


@pytest.mark.statistical
@pytest.mark.parametrize("source", [budget.NOISE, budget.SETTINGS, budget.AXES])
@pytest.mark.parametrize("method", ["table", "multi-position"])
def test_each_line_is_what_its_source_alone_does(method, source):
    # rms of 200 runs is within 1 / sqrt(400) = 5 % (one sigma) of the truth: single parameters within four of these
    plan, rng = planned(), np.random.default_rng(3)
    run = METHODS[method].calibrate_means
    stated = run(simulate_readings(NOISY, plan, RIGHT, rng), plan)
    line = parts(stated)[source]
    unit = [p for p in stated.parameters if not p.name.startswith("rig.")]
    runs = [run(only(source, rng, plan), plan).values() for _ in range(200)]
    values = np.array([[found[p.name] for p in unit] for found in runs])
    ratio = values.std(axis=0) / line[: len(unit)]
    # the square of an axis error, (20 arcsec)^2, is 1e-8 of a scale and in no line: it is a twentieth of the uncertainty
    seen = line[: len(unit)] > 0.1 * np.array([p.standard_uncertainty for p in unit])
    assert seen.any()
    assert np.all(np.abs(ratio[seen] - 1) < 0.2), dict(zip([p.name for p in unit], ratio, strict=True))
    assert abs(ratio[seen].mean() - 1) < 0.15  # three sigma if all of them err together, as with seven axis errors


def test_scatter_beyond_the_noise_has_a_line():
    # readings ten times as noisy as stated
    plan = planned()
    loud = laser_gyro_unit(accel_density=10 * NOISY.accel_density, gyro_density=0.1 * DEG_H)
    found = norm.calibrate_means(simulate_readings(loud, plan, RIGHT, np.random.default_rng(5)), plan)
    lines = parts(found)
    assert np.median(lines[SCATTER][:9] / lines[budget.NOISE][:9]) > 3
    total = np.sqrt(sum(v**2 for v in lines.values()))
    np.testing.assert_allclose(total, [p.standard_uncertainty for p in found.parameters], rtol=1e-6)


def test_a_unit_turned_by_hand_has_a_budget():
    plain = [Correction(s, np.eye(3), np.zeros(3)) for s in ("accel", "gyro")]
    log = simulate_hand_turned(*plain, np.random.default_rng(2), accel_noise=0.01, gyro_noise=0.001)
    found = calibrate("norm", from_arrays(*log), None)
    lines = parts(found)
    at = [p.name for p in found.parameters].index("accel.scale_error.x")
    # no site given: the spread of gravity over the Earth is in the scale
    assert lines[budget.GRAVITY][at] == pytest.approx(0.02 / STANDARD_GRAVITY, rel=0.5)
    total = np.sqrt(sum(v**2 for v in lines.values()))
    np.testing.assert_allclose(total, [p.standard_uncertainty for p in found.parameters], rtol=1e-6)
