"""Readings rounded more coarsely than their noise: the step is found and its error stays in the uncertainty."""

import numpy as np
import pytest

from sagnac import from_arrays
from sagnac.calibrate import calibrate
from sagnac.observe.means import _lattice, segment_means
from sagnac.plan import Plan, Segment
from sagnac.simulate.plans import table_plan
from sagnac.simulate.table import imperfect_table, simulate_recording
from sagnac.simulate.unit import laser_gyro_unit


def test_common_step_is_found_only_where_there_is_one():
    step = np.radians(0.1)
    rounded = np.round(np.array([-8.5, -5.3, 0.0, 5.3, 8.5]) / 0.1) * step
    assert _lattice(rounded[:, None, None])[0] == pytest.approx(step, rel=1e-9)
    assert _lattice(np.array([1.0, 3.0, 7.0, 8.0, 100.0])[:, None, None])[0] == 1.0
    assert np.all(np.isinf(_lattice(np.random.default_rng(0).normal(size=(12, 2, 3)))))
    assert np.isinf(_lattice(np.array([0.0, 1.0, 2.0])[:, None, None])[0])  # three values say nothing


def test_dithered_readings_average_their_rounding_away():
    """Noise of one step: no variance is added; noise of a hundredth of a step: the step's own, step^2 / 12."""
    rng = np.random.default_rng(1)
    plan = Plan(segment=tuple(Segment(name=str(k), start=10.0 * k, stop=10.0 * k + 10.0) for k in range(5)))
    time = np.arange(5000) / 100 + 0.005
    level = np.array([0.3, 7.7, -4.1, 12.2, 2.9]).repeat(1000)[:, None] + np.zeros(3)
    for noise, expected in ((1.0, 0.0), (0.01, 1 / 12)):
        readings = np.round(level + noise * rng.standard_normal((5000, 3)))
        found = segment_means(from_arrays(time, readings), plan)
        assert np.allclose(found.rounding["accel"], expected)


def test_coarse_gyros_are_calibrated_honestly():
    """0.1 deg/s steps on a laser gyro's rates: errors of 1e-3 in the scale, and the uncertainty says so."""
    unit = laser_gyro_unit()
    unit = type(unit)(**{**vars(unit), "pulses": {}})
    plan = table_plan(unit, dwell=20.0, turning=36.0)
    rng = np.random.default_rng(1)
    time, samples = simulate_recording(unit, plan, imperfect_table(plan, rng), rng, frequency=20.0)
    step = np.radians(0.1)
    found = calibrate("norm", from_arrays(time, samples["accel"], np.round(samples["gyro"] / step) * step), plan)
    truth = unit.truth()
    z = [(found[n].value - v) / found[n].standard_uncertainty for n, v in truth.items() if n.startswith("gyro")]
    assert np.abs(z).max() < 3.5
    assert 3e-4 < found["gyro.scale_error.x"].standard_uncertainty < 3e-3
    assert any("gyro_x is rounded to steps of 0.00175" in r for r in found.remarks)
