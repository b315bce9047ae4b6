"""Multi-position: exact where the table is, weighed where it is not, refused where it cannot tell."""

from dataclasses import replace

import numpy as np
import pytest

from sagnac.calibrate import mount, multi_position
from sagnac.errors import DataError, InputError
from sagnac.plan import Rig
from sagnac.rigs.turntable import TableErrors
from sagnac.sensors import correction
from sagnac.simulate.plans import ICOSAHEDRON, table_plan
from sagnac.simulate.table import SimulatedTable, imperfect_table, simulate_readings
from sagnac.simulate.unit import laser_gyro_unit

ARCMIN = np.pi / 10800
DEG_H = np.pi / 648000
CLEAN = laser_gyro_unit(accel_density=0.0, gyro_density=0.0)
NOISY = laser_gyro_unit(gyro_density=0.01 * DEG_H)


def made(unit, *, rng=None, setting=0.0, rig=None, positions=ICOSAHEDRON):
    plan = table_plan(unit, positions, dwell=1.0, turning=1.0)
    plan = plan.model_copy(update={"rig": rig or Rig()})
    table = SimulatedTable(TableErrors(), np.zeros((len(plan.segment), 3)))
    if setting:
        table = imperfect_table(plan, rng, setting=setting, axis=0.0)
    return plan, simulate_readings(unit, plan, table, rng or np.random.default_rng(0))


def test_perfect_table_gives_the_full_matrix_in_the_case_frame():
    plan, means = made(CLEAN)
    found = multi_position.calibrate_means(means, plan)
    for sensor, truth in (("accel", CLEAN.accel_matrix), ("gyro", CLEAN.gyro_matrix)):
        assert np.allclose(correction(found.values(), sensor).matrix, truth @ CLEAN.to_b, atol=1e-12)


def test_triangular_tells_instrument_from_mounting():
    plan, means = made(CLEAN)
    found = multi_position.calibrate_means(means, plan, matrix="triangular")
    truth = CLEAN.truth()
    assert set(truth) == set(found.values())
    assert max(abs(found[n].value - v) for n, v in truth.items()) < 1e-12


def test_closed_form_is_exact_on_a_perfect_table():
    plan, means = made(CLEAN)
    found, truth = multi_position.closed_form(means, plan), CLEAN.truth()
    assert max(abs(found[n] - v) for n, v in truth.items()) < 1e-12


def test_raw_counts_and_negative_gains():
    plan, means = made(CLEAN)
    gain = {"accel": np.array([4e3, -4e3, 4e3]), "gyro": np.array([5e4, 5e4, -5e4])}
    raw = replace(means, mean={k: v * gain[k] - 77 for k, v in means.mean.items()}, counts=frozenset(gain))
    found = multi_position.calibrate_means(raw, plan)
    for sensor, truth in (("accel", CLEAN.accel_matrix), ("gyro", CLEAN.gyro_matrix)):
        expected = gain[sensor][:, None] * truth @ CLEAN.to_b
        assert np.allclose(correction(found.values(), sensor).matrix, expected, rtol=1e-9, atol=1e-6)
    assert any("accel_y" in r for r in found.remarks)
    assert any("gyro_z" in r for r in found.remarks)


def test_jacobian_equals_central_differences():
    plan, means = made(NOISY, rng=np.random.default_rng(1), rig=Rig(angle_uncertainty=ARCMIN))
    site = multi_position.common.site_of(plan, "")
    angles = multi_position.common.need_angles(means, "")
    first = multi_position.first_solutions(("accel", "gyro"), means, plan, site, angles, [])
    first = [multi_position._displaced(f, means, plan, site, angles) for f in first]
    weight = multi_position._whitening(*multi_position._errors(first, means))
    for kind in (multi_position._Full, multi_position._Triangular):
        problem = kind(first, weight, 9.8, 0.17)
        x = np.array([p.start for p in problem.parameters()])
        jac = problem.rows(x).jacobian
        for k in range(x.size):
            step = np.where(np.arange(x.size) == k, 1e-6, 0.0)
            seen = (problem.rows(x + step).residual - problem.rows(x - step).residual) / 2e-6
            assert np.allclose(jac[:, k], seen, rtol=1e-6, atol=1e-6 * np.abs(seen).max())


def test_mounting_angles_round_trip_and_derivative():
    angles = np.array([0.3, -0.2, 1.1])
    assert np.allclose(mount.angles_of(mount.matrix(angles)), angles, atol=1e-15)
    for k in range(3):
        step = np.where(np.arange(3) == k, 1e-6, 0.0)
        seen = (mount.matrix(angles + step) - mount.matrix(angles - step)) / 2e-6
        assert np.allclose(mount.derivatives(angles)[k], seen, atol=1e-9)


@pytest.mark.statistical
def test_errors_scatter_as_stated_with_an_imperfect_table():
    """300 runs, settings off by 1 sigma of 20 arcsec: normalised errors of every parameter have size one (3.3 sampling errors).

    20 arcsec, not 1 arcmin: the square of the angle error, which a linear method cannot see, is then a tenth of the gyros'
    scale uncertainty (2e-7).
    """
    sigma = 20 * np.pi / 648000
    rng, truth = np.random.default_rng(12), NOISY.truth()
    z = []
    for _ in range(300):
        plan, means = made(NOISY, rng=rng, setting=sigma * np.sqrt(3), rig=Rig(angle_uncertainty=sigma))
        found = multi_position.calibrate_means(means, plan, matrix="triangular")
        z.append([(found[n].value - v) / found[n].standard_uncertainty for n, v in truth.items()])
    assert np.all(np.abs(np.std(z, axis=0) - 1) < 3.6 / np.sqrt(600)), np.std(z, axis=0)


@pytest.mark.statistical
def test_common_errors_of_the_axes_are_in_the_uncertainty():
    """200 tables with axis errors of 20 arcsec (uniform sign), settings exact: normalised errors have size one at most."""
    sigma = 20 * np.pi / 648000
    rng, truth, z = np.random.default_rng(5), NOISY.truth(), []
    plan = table_plan(NOISY, dwell=1.0, turning=1.0).model_copy(update={"rig": Rig(axis_uncertainty=sigma)})
    for _ in range(200):
        table = imperfect_table(plan, rng, setting=0.0, axis=sigma)
        found = multi_position.calibrate_means(simulate_readings(NOISY, plan, table, rng), plan, matrix="triangular")
        z.append([(found[n].value - v) / found[n].standard_uncertainty for n, v in truth.items()])
    size = np.std(z, axis=0)
    assert np.all(np.abs(size - 1) < 3.6 / np.sqrt(400)), dict(zip(truth, size, strict=True))


def test_rate_uncertainty_goes_into_the_gyro_scale():
    """1e-4 of the rate, common to all: the static segments' Earth rate (to 0.01 of 15 deg/h each) takes off an eighth."""
    plan, means = made(NOISY, rng=np.random.default_rng(1), rig=Rig(rate_uncertainty=1e-4))
    found = multi_position.calibrate_means(means, plan)
    assert 0.8e-4 < found["gyro.scale_error.x"].standard_uncertainty < 1e-4


def test_too_few_positions_are_refused():
    plan, means = made(CLEAN, positions=ICOSAHEDRON[:3])
    with pytest.raises(DataError, match="do not excite all three accel axes"):
        multi_position.calibrate_means(means, plan)


def test_missing_table_angle_is_refused_by_segment():
    plan, means = made(CLEAN)
    bare = (plan.segment[0].model_copy(update={"inner": None}), *plan.segment[1:])
    with pytest.raises(InputError, match="segment 's1' lacks outer, middle or inner"):
        multi_position.calibrate_means(replace(means, segments=bare), plan)


@pytest.mark.parametrize(
    ("sensor", "change", "said"),
    [
        ("accel", lambda v: v * [1, 1, -1], "accel_z: reads minus the specific force"),
        ("accel", lambda v: v[:, [0, 2, 1]], "accel_y answers to z"),
        ("gyro", lambda v: -v, "wrong sense of rotation"),
        ("gyro", lambda v: v[:, [1, 2, 0]], "gyro_x answers to rotation about y"),
        ("accel", lambda v: v / 9.80665, "labelled m/s"),
        ("gyro", np.degrees, "labelled rad/s"),
    ],
)
def test_wrong_signs_columns_and_units_are_named(sensor, change, said):
    plan, means = made(NOISY, rng=np.random.default_rng(1), rig=Rig(angle_uncertainty=ARCMIN))
    with pytest.raises(DataError, match=said):
        multi_position.calibrate_means(replace(means, mean={**means.mean, sensor: change(means.mean[sensor])}), plan)


@pytest.mark.statistical
@pytest.mark.parametrize("arcmin", [1.0, 10.0])
def test_second_order_of_the_settings_is_in_the_uncertainty(arcmin):
    """Random settings of 1' and 10' (one sigma, uniform): the shortened input neither biases nor is mistaken for a misfit.

    To first order the gyros' scale error would be off by the angle squared, 8e-6 at 10', forty standard uncertainties.
    """
    sigma = arcmin * ARCMIN
    rng, truth, z = np.random.default_rng(4), NOISY.truth(), []
    for _ in range(100):
        plan, means = made(NOISY, rng=rng, setting=sigma * np.sqrt(3), rig=Rig(angle_uncertainty=sigma))
        found = multi_position.calibrate_means(means, plan, matrix="triangular")
        z.append([(found[n].value - v) / found[n].standard_uncertainty for n, v in truth.items()])
    assert np.all(np.std(z, axis=0) < 1 + 3.6 / np.sqrt(200) + 0.05), dict(zip(truth, np.std(z, axis=0), strict=True))
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.45)
