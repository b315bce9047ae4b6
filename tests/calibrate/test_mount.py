"""Mounting angles and what makes them uncertain."""

import numpy as np
import pytest

from sagnac.calibrate import norm
from sagnac.simulate.plans import table_plan
from sagnac.simulate.table import imperfect_table, simulate_readings
from sagnac.simulate.unit import laser_gyro_unit

ARCSEC = np.pi / 648000
UNIT = laser_gyro_unit(gyro_density=0.01 * np.pi / 648000)


@pytest.mark.statistical
@pytest.mark.parametrize(("setting", "axis"), [(60, 5), (1, 1), (20, 0.01)])
def test_mounting_angles_scatter_as_stated(setting, axis):
    """150 tables: settings random (uniform), axes wrong alike in all positions, readings of 2 arcsec noise."""
    plan = table_plan(UNIT, dwell=1.0, turning=1.0, angle_uncertainty=setting * ARCSEC, axis_uncertainty=axis * ARCSEC)
    rng, truth, z = np.random.default_rng(1), UNIT.truth(), []
    for _ in range(150):
        table = imperfect_table(plan, rng, setting=setting * np.sqrt(3) * ARCSEC, axis=axis * ARCSEC)
        found = norm.calibrate_means(simulate_readings(UNIT, plan, table, rng), plan)
        names = [f"rig.mount.{a}" for a in "xyz"]
        z.append([(found[n].value - truth[n]) / found[n].standard_uncertainty for n in names])
    assert np.all(np.abs(np.std(z, axis=0) - 1) < 3.3 / np.sqrt(300))


def test_quarter_turn_leaves_the_calibration_alone():
    """At 90 deg about y two mounting angles are one: they are left out, and nothing else is touched."""
    turned = type(UNIT)(**{**vars(UNIT), "mount": (0.0, np.pi / 2, 0.0)})
    plan = table_plan(turned, dwell=1.0, turning=1.0)
    rng = np.random.default_rng(0)
    found = norm.calibrate_means(simulate_readings(turned, plan, imperfect_table(plan, rng), rng), plan)
    assert "rig.mount.x" not in found.values()
    assert any("mounting angles are not determined" in r for r in found.remarks)
    error = found["accel.scale_error.x"].value - UNIT.truth()["accel.scale_error.x"]
    assert abs(error) < 4 * found["accel.scale_error.x"].standard_uncertainty
