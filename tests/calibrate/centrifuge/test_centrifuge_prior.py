"""A 1 g calibration in the frame and the conventions of the centrifuge."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.calibrate import multi_position, norm
from sagnac.calibrate.centrifuge.prior import prior_of, whitening
from sagnac.calibration import named
from sagnac.errors import InputError
from sagnac.plan import Limits, Plan, Unit
from sagnac.rigs.turntable import PERFECT
from sagnac.sensors import Triad
from sagnac.simulate.plans import table_plan
from sagnac.simulate.table import SimulatedTable, imperfect_table, simulate_readings
from sagnac.simulate.unit import laser_gyro_unit

UNIT = laser_gyro_unit()
CLEAN = laser_gyro_unit(accel_density=0.0, gyro_density=0.0)


def expected(unit):
    """Truth of a unit as the centrifuge names it: directions of the input axes in the accelerometers' frame."""
    out = {}
    for kind, matrix, bias in (
        ("accel", unit.accel_matrix, unit.accel_bias),
        ("gyro", unit.gyro_matrix, unit.gyro_bias),
    ):
        triad = Triad(kind, full=kind == "gyro", ratio=True)
        out |= dict(zip(triad.names, triad.pack(matrix, bias), strict=True))
    return out


def table(unit, *, perfect):
    stated = {"angle_uncertainty": 0.0, "axis_uncertainty": 0.0} if perfect else {}
    plan = table_plan(unit, dwell=60.0, turning=36.0, **stated)
    rig = SimulatedTable(PERFECT, np.zeros((24, 3))) if perfect else imperfect_table(plan, np.random.default_rng(1))
    return simulate_readings(unit, plan, rig, np.random.default_rng(2)), plan


@pytest.mark.parametrize("matrix", ["full", "triangular"])
def test_both_matrices_of_a_table_lead_to_the_same_frame(matrix):
    means, plan = table(CLEAN, perfect=True)
    prior = prior_of(multi_position.calibrate_means(means, plan, matrix=matrix), Plan())
    truth = expected(CLEAN)
    assert set(prior.names) == set(truth)
    assert not prior.remarks
    np.testing.assert_allclose(prior.mean, [truth[n] for n in prior.names], rtol=0, atol=1e-9)


def test_covariance_goes_along():
    """The errors of a noisy table in units of the converted covariance: chi-square of 21, within its 0.1 % limits."""
    means, plan = table(UNIT, perfect=False)
    for found in (norm.calibrate_means(means, plan), multi_position.calibrate_means(means, plan)):
        prior, truth = prior_of(found, Plan()), expected(UNIT)
        error = prior.mean - [truth[n] for n in prior.names]
        assert 5.9 < np.sum((whitening(prior.covariance, np.ones(21)) @ error) ** 2) < 46.8


def test_drift_since_widens_the_biases():
    means, plan = table(UNIT, perfect=False)
    found = norm.calibrate_means(means, plan)
    wide = prior_of(found, Plan(unit=Unit(limits=Limits(accel_drift=1e-3))))
    tight = prior_of(found, Plan())
    ratio = np.diag(wide.covariance) - np.diag(tight.covariance)
    np.testing.assert_allclose(ratio, [1e-6 if n.startswith("accel.bias") else 0.0 for n in wide.names], atol=1e-18)


def test_part_of_a_prior():
    means, plan = table(UNIT, perfect=False)
    prior = prior_of(norm.calibrate_means(means, plan), Plan())
    part = prior.only(["gyro.bias.x", "accel.bias.z", "accel.k2.z"])
    assert part.names == ("accel.bias.z", "gyro.bias.x")
    at = [prior.names.index(n) for n in part.names]
    np.testing.assert_array_equal(part.covariance, prior.covariance[np.ix_(at, at)])


def changed(found, names, **update):
    """A calibration with other parameter names."""
    values = named(
        names, [p.unit for p in found.parameters], np.array([p.value for p in found.parameters]), found.matrix
    )
    return found.model_copy(update={"parameters": values, **update})


def test_misalignments_without_their_triad_are_left_out_and_said():
    means, plan = table(UNIT, perfect=False)
    found = norm.calibrate_means(means, plan)
    names = [n.replace("gyro.misalignment.xy", "rig.other") for n in found.values()]
    prior = prior_of(changed(found, names), Plan())
    assert not any(n.startswith("gyro.misalignment") for n in prior.names)
    assert "gyro.scale_error.x" in prior.names
    assert "not used" in prior.remarks[0]


def test_directions_of_input_axes_are_taken_as_they_are():
    means, plan = table(UNIT, perfect=False)
    found = norm.calibrate_means(means, plan).model_copy(update={"misalignment": "input-axis"})
    prior = prior_of(found, Plan())
    np.testing.assert_array_equal(prior.mean, [found[n].value for n in prior.names])


def test_raw_counts_and_rigs_alone_are_refused():
    means, plan = table(UNIT, perfect=False)
    found = norm.calibrate_means(means, plan)
    counts = changed(found, [n.replace("scale_error", "scale_factor") for n in found.values()])
    with pytest.raises(InputError, match="raw counts"):
        prior_of(counts, Plan())
    nothing = changed(found, [f"rig.{i}" for i in range(len(found.parameters))])
    with pytest.raises(InputError, match="says nothing"):
        prior_of(nothing, Plan())


def test_whitening_of_a_covariance_without_full_rank():
    """What is exact is held at its least size; what is fully correlated is not blown up."""
    covariance = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    w = whitening(covariance, np.array([1.0, 1.0, 1e-6]))
    np.testing.assert_allclose(w @ [2.0, 1.0, 0.0] @ w @ [2.0, 1.0, 0.0], 1.0, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(w @ [0.0, 0.0, 1e-6]), 1.0, rtol=1e-9)
