"""Centrifuge calibration: the published case, what is known beforehand, and its bound over many runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from centrifuge_case import (
    ACCEL_Z,
    ACCELS,
    ALL,
    DEG_H,
    DENSITY,
    GYRO_X,
    RADIUS,
    RATE,
    THREE,
    G,
    Z,
    changed,
    on_rig,
    plan,
    record,
)
from centrifuge_runs import BOUND, drawn, within

from sagnac.calibrate import calibrate
from sagnac.calibrate.centrifuge import calibrate_harmonics
from sagnac.calibration import loads
from sagnac.errors import DataError, InputError
from sagnac.plan import Limits, Noise, Unit
from sagnac.simulate.centrifuge import SimulatedCentrifuge, simulate_harmonics

# ------------------------------------------------------------------------------------------------ the published case


def test_noise_free_samples_give_the_truth():
    found = calibrate("centrifuge", record(plan(), seed=None), plan())
    assert found.misalignment == "input-axis"
    assert list(found.values()) == list(ACCEL_Z)
    for name, value in ACCEL_Z.items():
        assert found[name].value == pytest.approx(value, rel=1e-9), name


def test_noisy_samples_give_the_truth_within_the_bound():
    found = calibrate("centrifuge", record(plan()), plan())
    within(found, ACCEL_Z)
    for name, sigma in BOUND.items():
        # the data's own noise is known to 2 %, the bound to two digits
        assert found[name].standard_uncertainty == pytest.approx(sigma, rel=0.05), name
    assert loads(found.to_json()).values() == found.values()


def test_the_bound_is_that_of_three_gammas():
    """Five gammas from 0 to pi give smaller figures: the methods' bound belongs to 0, pi/2 and pi."""
    exact = plan().model_copy(update={"unit": Unit(noise=Noise(accel=DENSITY["accel"]))})
    found = calibrate_harmonics(drawn(exact), exact)
    for name, sigma in BOUND.items():
        assert found[name].standard_uncertainty == pytest.approx(sigma, rel=0.02), name
    five = plan(tuple(np.linspace(0.0, math.pi, 5)))
    more = calibrate_harmonics(drawn(five), five)
    assert all(more[name].standard_uncertainty < 0.95 * sigma for name, sigma in BOUND.items())


def test_closed_form_through_the_library():
    """Its errors are the published ones beside the noise, and it says how much it leaves out."""
    found = calibrate("centrifuge", record(plan()), plan(), closed_form=True)
    assert found.method == "centrifuge closed form"
    truncation = {"accel.misalignment.zx": -1.5e-6, "accel.misalignment.zy": -1.0e-6, "accel.kip.z": 3.0e-8 / G}
    for name, value in truncation.items():
        error = found[name].value - ACCEL_Z[name]
        assert error == pytest.approx(value, abs=4 * found[name].standard_uncertainty + 0.04 * abs(value)), name
    line = dict(zip(found.values(), found.budget[-1].standard_uncertainty, strict=True))
    assert line["accel.misalignment.zx"] == pytest.approx(1.54e-6, rel=0.01)
    assert "first order" in found.remarks[-1]


def test_closed_form_of_three_accelerometers_from_a_plan_without_phases_is_refused():
    given = plan()
    assert len(calibrate_harmonics(drawn(given, ALL, ACCELS), given, closed_form=True).parameters) == 18
    open_ = changed(given, arm_phase=None)
    with pytest.raises(InputError, match="arm_phase of every segment"):
        calibrate_harmonics(drawn(open_, extended=True), open_, closed_form=True)


def test_closed_form_counts_what_the_plan_says_of_the_rig():
    """Each line of the budget against the change of the result when the rig is off by so much, and the lines make the whole."""
    sizes = {"radius_uncertainty": 1e-3, "axis_uncertainty": 1e-4, "angle_uncertainty": 1e-4, "phase_uncertainty": 1e-4}
    given = plan(**sizes, gravity_uncertainty=1e-4)
    found = calibrate("centrifuge", record(given), given, closed_form=True)
    lines = {line.source: np.array(line.standard_uncertainty) for line in found.budget}
    *counted, last = lines
    assert last == "truncation, not counted"
    sigma = [p.standard_uncertainty for p in found.parameters]
    np.testing.assert_allclose(np.sqrt(sum(lines[s] ** 2 for s in counted)), sigma, rtol=1e-12)

    def moved(gravity=0.0, **off):
        ends = []
        for sign in (1.0, -1.0):
            rig = SimulatedCentrifuge(**{name: sign * np.asarray(value) for name, value in off.items()})
            real = plan().model_copy(update={"gravity": G + sign * gravity})
            run = simulate_harmonics(real, ACCEL_Z, axes=Z, rig=rig)
            ends.append(np.array(list(calibrate_harmonics(run, plan(), closed_form=True).values().values())))
        return (ends[0] - ends[1]) / 2.0

    def size(changes):
        return np.sqrt(np.sum(np.square(changes), axis=0))

    settings = [1e-4 * np.eye(9)[k].reshape(3, 3) for k in range(9)]
    expected = {
        "arm radius": size([moved(radius_error=1e-3)]),
        "tilt of the arm's axis": size([moved(tilt=(1e-4, 0.0)), moved(tilt=(0.0, 1e-4))]),
        "arm phase": size([moved(phase=1e-4)]),
        "gravity": size([moved(gravity=1e-4)]),
        "gimbal settings": size([moved(settings=s) for s in settings]),
    }
    for source, value in expected.items():
        # the derivatives are taken with the parameters found, of which truncation and noise put kip off by 0.6 %
        np.testing.assert_allclose(lines[source], value, rtol=1e-2, atol=1e-3 * lines["noise"].min(), err_msg=source)
    assert any("no degrees of freedom" in r for r in found.remarks)
    with pytest.raises(InputError, match="takes arm_rate as exact"):
        calibrate("centrifuge", record(given), on_rig(given, rate_uncertainty=1e-4), closed_form=True)


def test_gyro_needs_two_speeds():
    """One speed: DF against the sum DII + DOO + DSS, in words. Two: all ten coefficients, at a condition of a few."""
    one, two = plan(), plan(rates=(RATE, 2 * RATE))
    with pytest.raises(
        DataError,
        match=r"gyro\.bias\.x \(DF\) and the sum gyro\.d_ii\.x \+ gyro\.d_oo\.x \+ gyro\.d_ss\.x cannot be told",
    ):
        calibrate_harmonics(drawn(one, GYRO_X, ("gyro_x",)), one)
    found = calibrate_harmonics(drawn(two, GYRO_X, ("gyro_x",)), two)
    assert set(found.values()) == set(GYRO_X)
    within(found, GYRO_X)
    # methods: 2.7, column-scaled, with the harmonics weighed by their noise
    assert found.fit.condition == pytest.approx(2.7, abs=0.05)


def test_one_speed_is_refused_in_other_settings_too():
    """Turned about alpha and beta the Earth's rotation alone tells DF from the sum, which is worth nothing."""
    given = plan(gimbals=[(0, 0, g) for g in THREE] + [(0.3, 0.2, 0.5), (0.7, 0.0, 0.3)])
    with pytest.raises(DataError, match=r"d_ii\.x \+ gyro\.d_oo"):
        calibrate_harmonics(drawn(given, GYRO_X, ("gyro_x",)), given)


def test_gyro_terms_that_are_not_seen_are_named():
    """At gamma = 0 alone gyro x feels 1 g, always the same, along its output axis: bias, DO and DOO are one."""
    given = plan((0.0,), rates=(RATE, 2 * RATE))
    with pytest.raises(DataError, match=r"gyro_x: the segments cannot tell these apart .*d_oo\.x"):
        calibrate_harmonics(drawn(given, GYRO_X, ("gyro_x",)), given)


def test_six_axes_at_once():
    given = plan(rates=(RATE, 2 * RATE))
    found = calibrate(
        "centrifuge", record(given, ALL, ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")), given
    )
    assert set(found.values()) == set(ALL)
    within(found, ALL)


# ------------------------------------------------------------------------------------------------ prior knowledge


def prior_of_truth(truth, sigma, seed=3):
    """A calibration with given uncertainties and errors drawn from them."""
    given = plan()
    made = calibrate_harmonics(drawn(given), given)
    rng = np.random.default_rng(seed)
    names, values = list(truth), np.array(list(truth.values()))
    values = values + np.array([sigma[n] for n in names]) * rng.standard_normal(len(names))
    variance = np.diag([sigma[n] ** 2 for n in names])
    parameters = tuple(
        made.parameters[0].model_copy(
            update={"name": n, "value": float(v), "unit": "", "standard_uncertainty": sigma[n]}
        )
        for n, v in zip(names, values, strict=True)
    )
    return made.model_copy(
        update={
            "parameters": parameters,
            "covariance": tuple(tuple(float(v) for v in row) for row in variance),
            "misalignment": "input-axis",
        }
    )


def test_a_prior_bias_makes_one_speed_enough():
    given = plan()
    known = {"gyro.bias.x": GYRO_X["gyro.bias.x"], "gyro.scale_error.x": 1e-3, "gyro.misalignment.xy": 2e-4}
    truth = {**GYRO_X, **known}
    sigma = {"gyro.bias.x": 0.01 * DEG_H, "gyro.scale_error.x": 1e-5, "gyro.misalignment.xy": 1e-5}
    prior = prior_of_truth(known, sigma)
    found = calibrate_harmonics(drawn(given, truth, ("gyro_x",)), given, prior=prior)
    within(found, {**truth, "gyro.misalignment.xz": 0.0})
    # the data add nothing to scale and direction, which the platform does not turn, and next to nothing to the bias
    assert found["gyro.scale_error.x"].standard_uncertainty == pytest.approx(1e-5, rel=1e-3)
    assert found["gyro.bias.x"].standard_uncertainty == pytest.approx(0.01 * DEG_H, rel=1e-2)
    assert "prior calibration" in [line.source for line in found.budget]


def test_a_prior_adds_its_information():
    """Two independent measurements: the information of each adds up."""
    given = plan()
    sigma = {"accel.bias.z": 2e-6, "accel.scale_error.z": 1e-7}
    prior = prior_of_truth({n: ACCEL_Z[n] for n in sigma}, sigma)
    run = drawn(given)
    alone, both = calibrate_harmonics(run, given), calibrate_harmonics(run, given, prior=prior)
    within(both, ACCEL_Z)
    at = [list(alone.values()).index(n) for n in ACCEL_Z]
    information = np.linalg.inv(alone.matrix)
    for name, s in sigma.items():
        k = list(alone.values()).index(name)
        information[k, k] += s**-2
    np.testing.assert_allclose(both.matrix, np.linalg.inv(information)[np.ix_(at, at)], rtol=1e-3, atol=0)
    assert both.fit.degrees_of_freedom == alone.fit.degrees_of_freedom + 2


def test_a_prior_that_contradicts_the_data_is_named():
    given = plan()
    prior = prior_of_truth({"accel.bias.z": ACCEL_Z["accel.bias.z"] + 1e-3}, {"accel.bias.z": 1e-5})
    found = calibrate_harmonics(drawn(given), given, prior=prior)
    assert any(r.startswith("accel.bias.z: the prior calibration says") for r in found.remarks)
    assert found.fit.uncertainty != "white"


def test_bounds_of_the_gyro_scale_widen_the_bias():
    """A scale error that the platform cannot show changes the bias by what it makes of the Earth rate."""
    given = plan(rates=(RATE, 2 * RATE))
    run = drawn(given, GYRO_X, ("gyro_x",))
    limit = given.model_copy(update={"unit": Unit(limits=Limits(gyro_scale=0.5))})
    plain, wide = calibrate_harmonics(run, given), calibrate_harmonics(run, limit)
    assert set(wide.values()) == set(plain.values())
    assert wide["gyro.d_ii.x"].standard_uncertainty < 1.2 * plain["gyro.d_ii.x"].standard_uncertainty
    # x feels half of up to 15 deg/h; what its share changes from segment to segment takes part of that from the bias
    assert 1.1 * plain["gyro.bias.x"].standard_uncertainty < wide["gyro.bias.x"].standard_uncertainty < 4 * DEG_H


# ------------------------------------------------------------------------------------------------ statistics


def campaign(given, truth, axes, runs, *, seed=11, rig=None, **keys):
    """Errors, standard uncertainties and the white ones of many runs, and the parameters' names."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(runs):
        drawn_rig, more = (SimulatedCentrifuge(), {}) if rig is None else rig(rng)
        run = simulate_harmonics(given, truth, axes=axes, density=DENSITY, rng=rng, rig=drawn_rig, **keys)
        found = calibrate_harmonics(run, given)
        names, expected = list(found.values()), {**truth, **more}
        error = np.array([p.value - expected[p.name] for p in found.parameters])
        out.append((error, [p.standard_uncertainty for p in found.parameters], found.fit.white, found.matrix))
    error, sigma, white, matrix = (np.array(v) for v in zip(*out, strict=True))
    return names, error, sigma, white, matrix


def judge(names, error, sigma, white, matrix, *, limit, band):
    from scipy.stats import chi2

    ratio = np.sqrt(np.mean(error**2, axis=0) / np.mean(white**2, axis=0))
    assert np.all(ratio <= limit), dict(zip(names, ratio, strict=True))
    coverage = np.mean(np.abs(error) < 1.96 * sigma, axis=0)
    assert np.all((coverage >= band[0]) & (coverage <= band[1])), dict(zip(names, coverage, strict=True))
    nees = np.einsum("ni,ni->", error, np.linalg.solve(matrix, error[..., None])[..., 0])
    assert chi2.ppf(5e-4, error.size) < nees < chi2.ppf(1 - 5e-4, error.size)


@pytest.mark.statistical
def test_the_accelerometer_reaches_the_bound():
    """1000 runs: rms over the bound at most 1.08, coverage 93 to 97 %, squared errors within the 0.1 % limits of chi-square."""
    given = plan().model_copy(update={"unit": Unit(noise=Noise(accel=DENSITY["accel"]))})
    names, error, *rest = campaign(given, ACCEL_Z, Z, 1000)
    judge(names, error, *rest, limit=1.08, band=(0.93, 0.97))
    rms = dict(zip(names, np.sqrt(np.mean(error**2, axis=0)), strict=True))
    for name, sigma in BOUND.items():
        assert rms[name] < 1.08 * sigma, name


@pytest.mark.statistical
def test_the_gyro_reaches_the_bound():
    given = plan(rates=(RATE, 2 * RATE))
    judge(*campaign(given, GYRO_X, ("gyro_x",), 1000), limit=1.08, band=(0.93, 0.97))


@pytest.mark.statistical
def test_unknown_phase_and_rate_reach_the_bound():
    """500 runs, 100 ppm off: rms within 3.3 of its own sampling errors, coverage 92 to 98 %."""
    given = changed(plan(arm_continuous=True), arm_phase=None)

    def rig(rng):
        phase = float(rng.uniform(-3, 3))
        drawn_rig = SimulatedCentrifuge(rate_error=1e-4, phase=phase, continuous=True)
        return drawn_rig, {"rig.arm_phase": phase, "rig.arm_rate": 1.0001 * RATE}

    judge(*campaign(given, ACCEL_Z, Z, 500, rig=rig, extended=True), limit=1 + 3.3 / math.sqrt(1000), band=(0.92, 0.98))


@pytest.mark.statistical
def test_uncertain_rigs_reach_the_bound():
    """200 runs with settings, radius, tilt and phase off by what the plan states."""
    given = plan(
        tuple(np.linspace(0.0, 3.0, 5)),
        angle_uncertainty=1e-5,
        axis_uncertainty=1e-5,
        radius_uncertainty=1e-4,
        phase_uncertainty=1e-4,
    )

    def rig(rng):
        radius, tilt = 1e-4 * rng.standard_normal(), 1e-5 * rng.standard_normal(2)
        drawn_rig = SimulatedCentrifuge(
            radius, (tilt[0], tilt[1]), 1e-5 * rng.standard_normal((5, 3)), 0.0, 1e-4 * rng.standard_normal()
        )
        return drawn_rig, {"rig.radius": RADIUS + radius, "rig.tilt.x": tilt[0], "rig.tilt.y": tilt[1]}

    judge(*campaign(given, ACCEL_Z, Z, 200, rig=rig), limit=1 + 3.3 / math.sqrt(400), band=(0.9, 0.99))
