"""Centrifuge calibration: the published case, its bound, everything unknown that a rig has, and plans that are wrong."""

from __future__ import annotations

import math
from dataclasses import replace

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

from sagnac.calibrate import calibrate
from sagnac.calibrate.centrifuge import calibrate_harmonics
from sagnac.calibrate.centrifuge.prepare import harmonics_of
from sagnac.calibration import loads
from sagnac.design.ideal import centrifuge_harmonics
from sagnac.errors import DataError, InputError
from sagnac.observe.harmonics import segment_harmonics
from sagnac.plan import Limits, Noise, Plan, Rig, Unit
from sagnac.recording import from_arrays
from sagnac.simulate.centrifuge import SimulatedCentrifuge, simulate_harmonics

# methods, section 3: Cramer-Rao bound with 2.5e-5 g a sample, 1000 Hz, one turn at each of gamma = 0, pi/2, pi, in g
BOUND = {
    "accel.k2.z": 1.05e-8 / G,
    "accel.k3.z": 2.7e-9 / G**2,
    "accel.kip.z": 1.5e-8 / G,
    "accel.misalignment.zx": 5.6e-8,
    "accel.misalignment.zy": 4.6e-8,
    "accel.bias.z": 3.7e-7 * G,
    "accel.scale_error.z": 2.1e-7,
}
MOUNT = {"rig.mount.x": 1e-3, "rig.mount.y": -2e-3, "rig.mount.z": 5e-4}
TURNED = SimulatedCentrifuge(mount=(1e-3, -2e-3, 5e-4))


def drawn(given, truth=ACCEL_Z, axes=Z, *, seed=1, **keys):
    """Harmonics of a noisy run."""
    rng = np.random.default_rng(seed)
    return simulate_harmonics(given, truth, axes=axes, density=DENSITY, rng=rng, **keys)


def errors(found, truth):
    """Errors in standard uncertainties, by name."""
    return {p.name: (p.value - truth[p.name]) / p.standard_uncertainty for p in found.parameters}


def within(found, truth, limit=4.5):
    """No error beyond chance: 4.5 standard uncertainties are exceeded once in 150 000."""
    off = {n: z for n, z in errors(found, truth).items() if abs(z) > limit}
    assert not off, off
    assert found.fit.p_value > 1e-3


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


# ------------------------------------------------------------------------------------------------ what a rig has unknown


@pytest.mark.parametrize("given", [0.0, 1.234, -2.0])
def test_phase_and_rate_found_in_the_samples(given):
    """Arm turning on through all segments, 100 ppm fast, phase not in the plan: the same accuracy, phase and rate besides."""
    unknown = changed(plan(arm_continuous=True), arm_phase=None)
    rig = SimulatedCentrifuge(rate_error=1e-4, phase=given, continuous=True)
    found = calibrate("centrifuge", record(unknown, rig=rig), unknown)
    within(found, {**ACCEL_Z, "rig.arm_phase": given, "rig.arm_rate": RATE * 1.0001})
    for name, sigma in BOUND.items():
        assert found[name].standard_uncertainty < 1.3 * sigma, name
    assert "as the plan says: the arm turned on steadily" in found.remarks[0]
    assert len(found.remarks) == 1


@pytest.mark.parametrize("continuous", [True, False])
@pytest.mark.parametrize("error", [0.0, 1e-5, 1e-4])
def test_the_data_alone_tell_how_the_arm_turned(continuous, error):
    """Three accelerometers, or one and times from start to start of other than whole turns: right, within the stated accuracy."""
    rig = SimulatedCentrifuge(rate_error=error, phase=1.0, continuous=continuous)
    accels = {n: v for n, v in ALL.items() if n.startswith("accel")}
    for given, truth, axes in ((plan(), accels, ACCELS), (plan(move=10.37), ACCEL_Z, Z)):
        unknown = changed(given, arm_phase=None)
        found = calibrate("centrifuge", record(unknown, truth, axes, rig=rig), unknown)
        rates = {n: p.value for n, p in ((q.name, q) for q in found.parameters) if n.startswith("rig.arm")}
        within(found, {**rates, **truth})
        assert abs(rates["rig.arm_rate"] / RATE - 1.0 - error) < 5e-7
        for name, sigma in BOUND.items():
            assert found[name].standard_uncertainty < 1.3 * sigma, name


@pytest.mark.parametrize("continuous", [True, False])
def test_two_ways_that_fit_alike_and_differ_are_refused(continuous):
    """One accelerometer, whole turns from start to start, 10 ppm: chi-squares 0.1 to 0.4 apart, results 10 sigma."""
    unknown = changed(plan(), arm_phase=None)
    rig = SimulatedCentrifuge(rate_error=1e-5, phase=1.0, continuous=continuous)
    run = record(unknown, rig=rig)
    with pytest.raises(DataError) as caught:
        calibrate("centrifuge", run, unknown)
    for said in (
        "turned on steadily", "same angle at the start", "accel.", "standard uncertainties apart", "Give arm_phase",
        "column arm", "whole turns", "second accelerometer", "rig.arm_continuous",
    ):  # fmt: skip
        assert said in str(caught.value), said
    stated = on_rig(unknown, arm_continuous=continuous)
    found = calibrate("centrifuge", run, stated)
    within(found, {**{p.name: p.value for p in found.parameters}, **ACCEL_Z})


def test_two_ways_that_fit_alike_and_agree_are_no_matter():
    """An exact rate, whole turns from start to start: steady and triggered are the same motion."""
    unknown = changed(plan(), arm_phase=None)
    found = calibrate("centrifuge", record(unknown, rig=SimulatedCentrifuge(phase=1.0)), unknown)
    within(found, {**ACCEL_Z, "rig.arm_phase": 1.0, "rig.arm_rate": RATE})


def test_how_the_arm_turned_says_nothing_on_another_rig():
    with pytest.raises(ValueError, match="arm_continuous"):
        Plan(rig=Rig(kind="turntable", arm_continuous=True))


def test_a_wrong_statement_of_how_the_arm_turned_is_named():
    given = plan(move=10.37)
    run = record(given, rig=SimulatedCentrifuge(phase=1.0, rate_error=1e-4))
    with pytest.raises(DataError, match=r"same angle at every start \(rig\.arm_continuous\)"):
        calibrate("centrifuge", run, changed(on_rig(given, arm_continuous=True), arm_phase=None))


@pytest.mark.parametrize(
    ("rig", "phases", "said"),
    [
        (SimulatedCentrifuge(rate_error=1e-3, phase=1.0, continuous=True), 0.0, "turned on steadily"),
        (SimulatedCentrifuge(rate_error=1e-3, phase=1.0), 0.0, "same angle at the start"),
        (SimulatedCentrifuge(rate_error=1e-3, phase=1.0), "own", "a phase and a rate of its own"),
    ],
)
def test_the_way_the_arm_turned_is_found(rig, phases, said):
    """Two speeds and one accelerometer tell the three ways apart by their chi-square."""
    true = plan(rates=(RATE, 2 * RATE))
    if phases == "own":
        true = changed(true, arm_phase=lambda s: float(np.random.default_rng(int(s.name)).uniform(0, 6)))
    unknown = changed(true, arm_phase=None)
    found = calibrate("centrifuge", record(true, rig=rig), unknown)
    assert said in found.remarks[0]
    names = [n for n in found.values() if n.startswith("rig.arm_rate")]
    for name in names:
        rate = RATE if name.rsplit(".", maxsplit=1)[-1] in ("1", "2", "3", "arm_rate") else 2 * RATE
        assert abs(found[name].value - 1.001 * rate) < 5 * found[name].standard_uncertainty
    within(found, {**{n: p.value for n, p in ((q.name, q) for q in found.parameters)}, **ACCEL_Z})


def test_rate_far_off_the_plan():
    """One percent off over ten turns: found all the same."""
    unknown = changed(plan(hold=20.0), arm_phase=None)
    rig = SimulatedCentrifuge(rate_error=-1e-2, phase=0.5, continuous=True)
    found = calibrate("centrifuge", record(unknown, rig=rig), unknown)
    within(found, {**ACCEL_Z, "rig.arm_phase": 0.5, "rig.arm_rate": RATE * 0.99})


def test_a_column_of_the_arms_angle_is_used():
    unknown = changed(plan(), arm_phase=None)
    rig = SimulatedCentrifuge(rate_error=1e-3, phase=2.0)
    found = calibrate("centrifuge", record(unknown, rig=rig, arm=True), unknown)
    within(found, ACCEL_Z)
    with pytest.raises(DataError, match="column arm turns at 180.* the plan says -180"):
        calibrate("centrifuge", record(plan(), arm=True), changed(unknown, arm_rate=-RATE))


def test_uncertain_rate_and_phase_of_the_plan():
    """A rate known to 1000 ppm and a phase known to 1 mrad, both off by one sigma: found from the samples."""
    given = plan(rate_uncertainty=1e-3, phase_uncertainty=1e-3)
    found = calibrate("centrifuge", record(given, rig=SimulatedCentrifuge(rate_error=1e-3, phase=1e-3)), given)
    within(found, ACCEL_Z)
    assert "arm phase" in [line.source for line in found.budget]


@pytest.mark.parametrize("error", [1e-4, -1e-4])
def test_an_uncertain_rate_over_many_turns(error):
    """100 ppm stated and 100 ppm off, 20 minutes at 30 rpm: the arm is 11 degrees from where the plan's rate has it."""
    given = plan(hold=1200.0, rate_uncertainty=1e-4)
    found = calibrate("centrifuge", record(given, rig=SimulatedCentrifuge(rate_error=error), frequency=20.0), given)
    within(found, ACCEL_Z)


@pytest.mark.parametrize("phase", [0.5, -0.3])
def test_a_phase_that_is_hardly_known(phase):
    """Known to 0.2 rad and off by 0.5: found from the samples, as without a word about it but for the loose statement."""
    given = plan(phase_uncertainty=0.2)
    within(calibrate("centrifuge", record(given, rig=SimulatedCentrifuge(phase=phase)), given), ACCEL_Z)


def test_parts_of_turns():
    given = plan(tuple(np.linspace(0.0, math.pi, 5)), hold=1.37)
    found = calibrate("centrifuge", record(given), given)
    within(found, ACCEL_Z)
    assert "too short a part of a turn" in found.remarks[0]


def test_every_error_of_the_rig_goes_into_fit_and_budget():
    rng = np.random.default_rng(7)
    given = plan(
        tuple(np.linspace(0.0, 3.0, 5)),
        rates=(RATE, 2 * RATE),
        angle_uncertainty=1e-5,
        axis_uncertainty=1e-5,
        radius_uncertainty=1e-4,
        phase_uncertainty=1e-4,
        gravity_uncertainty=1e-5,
    )
    rig = SimulatedCentrifuge(1e-4, (1e-5, -1e-5), 1e-5 * rng.standard_normal((10, 3)), 0.0, -1e-4, mount=TURNED.mount)
    found = calibrate_harmonics(drawn(given, ALL, ACCELS, rig=rig), given)
    truth = {**ALL, **MOUNT, "rig.radius": RADIUS + 1e-4, "rig.tilt.x": 1e-5, "rig.tilt.y": -1e-5}
    within(found, truth)
    lines = {line.source: np.array(line.standard_uncertainty) for line in found.budget}
    assert set(lines) == {
        "noise", "gimbal settings", "arm radius", "tilt of the arm's axis", "gravity", "arm phase",
    }  # fmt: skip
    total = np.sqrt(sum(v**2 for v in lines.values()))
    np.testing.assert_allclose(total, [p.standard_uncertainty for p in found.parameters], rtol=1e-6)


def test_how_the_unit_sits_on_its_gimbals_is_found_where_it_shows():
    given = plan(rates=(RATE, 2 * RATE))
    found = calibrate_harmonics(drawn(given, ALL, ACCELS, rig=TURNED), given)
    assert "rig.mount was estimated" in found.remarks[-1]
    within(found, {**ALL, **MOUNT})
    square = calibrate_harmonics(drawn(given, ALL, ACCELS), given)
    assert not any("mount" in n for n in square.values())


def test_a_unit_fixed_to_the_arm():
    """IEEE 836: steps of g, the unit upright, on each side and on its head; scale and misalignments of the gyros as well."""
    turned = [
        (0, 0, 0),
        (0, 0, math.pi / 2),
        (0, 0, math.pi),
        (0, math.pi / 2, 0),
        (math.pi / 2, 0, 0),
        (0.5, 0.6, 0.7),
    ]
    given = plan(gimbals=turned, rates=(RATE / 3, RATE, -RATE / 2, 1.3 * RATE), counter_rotating=False, hold=6.0)
    truth = {**ALL, "gyro.scale_error.x": 1e-3, "gyro.misalignment.yz": 2e-3, "gyro.misalignment.zx": -1e-3}
    found = calibrate(
        "centrifuge", record(given, truth, (*ACCELS, "gyro_x", "gyro_y", "gyro_z"), frequency=200.0), given
    )
    assert {"gyro.scale_error.z", "gyro.misalignment.xy"} <= set(found.values())
    within(found, {**dict.fromkeys(found.values(), 0.0), **truth})


SIX = [(0, 0, 0), (0, 0, math.pi / 2), (math.pi / 2, 0, 0), (0, math.pi / 2, 0), (0, 0, math.pi), (1.0, 0.5, 0.3)]


@pytest.mark.parametrize("phase", [0.7, -2.0])
def test_gyros_on_an_arm_at_rest(phase):
    """A unit fixed to the arm feels the horizontal Earth rate, 13 deg/h, by where the arm points, which counts at rest."""
    rates = (0.0, RATE, 2 * RATE, -RATE)
    given = plan(gimbals=SIX, rates=rates, counter_rotating=False, hold=600.0, move=2.0, phase=phase)
    truth = {n: v for n, v in ALL.items() if n.startswith("gyro")}
    found = calibrate("centrifuge", record(given, truth, ("gyro_x", "gyro_y", "gyro_z"), frequency=20.0), given)
    within(found, {**dict.fromkeys(found.values(), 0.0), **truth})


def test_the_harmonics_of_a_plan_have_the_arm_at_rest_where_it_points():
    """Harmonics of perfect sensors, as plans are judged by, fit with all parameters zero and nothing left over."""
    noise = Unit(noise=Noise(gyro=DENSITY["gyro"]))
    given = plan(gimbals=SIX, rates=(0.0, RATE, 2 * RATE, -RATE), counter_rotating=False, hold=600.0, phase=0.7)
    given = given.model_copy(update={"unit": noise})
    found = calibrate_harmonics(centrifuge_harmonics(given, ("gyro",)), given)
    assert found.fit.chi2 < 1e-6
    assert all(abs(p.value) < 1e-3 * p.standard_uncertainty for p in found.parameters)


def test_a_tilted_axis_on_an_arm_at_rest():
    """The tilt of the arm's axis shows on the accelerometers by where the arm points: 1 mrad of g, and at rest too."""
    truth = {n: v for n, v in ALL.items() if n.startswith("accel")}
    given = plan(gimbals=SIX, rates=(0.0, RATE), counter_rotating=False, hold=10.0, phase=0.7, axis_uncertainty=1e-3)
    rig = SimulatedCentrifuge(tilt=(1e-3, -0.5e-3))
    found = calibrate("centrifuge", record(given, truth, ACCELS, rig=rig, frequency=100.0), given)
    within(found, {**truth, "rig.tilt.x": 1e-3, "rig.tilt.y": -0.5e-3})
    unknown = changed(given, arm_phase=None)
    with pytest.raises(InputError, match=r"segment '1' does not say where the arm points .* the tilt of its axis"):
        calibrate("centrifuge", record(given, truth, ACCELS, rig=rig, frequency=100.0), unknown)


def test_steps_of_g_with_chosen_terms():
    """One accelerometer along the arm, arm at rest and at five speeds, phase unknown: the polynomial of its input."""
    rates = (0.0, 0.5 * RATE, 0.7 * RATE, 0.85 * RATE, RATE, 1.1 * RATE)
    given = plan((-math.pi / 2,), rates=rates, counter_rotating=False, hold=5.0)
    unknown = changed(given, arm_phase=None)
    terms = ("accel.bias", "accel.scale_error", "accel.k2", "accel.k3")
    only = {n: v for n, v in ACCEL_Z.items() if n.rsplit(".", maxsplit=1)[0] in terms}
    # what 1 g across the input axis adds through misalignments is constant: left out of the truth
    found = calibrate("centrifuge", record(given, only), unknown, terms=terms)
    within(found, only)
    assert "only the mean over the turn" in found.remarks[-1]
    with pytest.raises(DataError, match=r"accel\.kip\.z|accel\.misalignment"):
        calibrate("centrifuge", record(given, only), unknown)


def test_cross_terms_on_request():
    truth = {**ACCEL_Z, "accel.kio.z": 4e-7, "accel.kpo.z": -6e-7}
    given = plan(gimbals=[(0, 0, g) for g in THREE] + [(0.4, 0.3, 0.5), (1.0, 0.5, 2.0), (2.0, 1.0, 0.0)])
    terms = tuple(f"accel.{t}" for t in ("bias", "scale_error", "k2", "k3", "kip", "kio", "kpo", "misalignment"))
    found = calibrate_harmonics(drawn(given, truth), given, terms=terms)
    within(found, truth)
    with pytest.raises(InputError, match="'k2' is none"):
        calibrate_harmonics(drawn(given), given, terms=("k2",))
    with pytest.raises(InputError, match="no such terms"):
        calibrate_harmonics(drawn(given), given, terms=("accel.d_i",))


def test_sensors_can_be_chosen():
    given = plan()
    run = drawn(given, ALL, (*ACCELS, "gyro_x"))
    found = calibrate_harmonics(run, given, sensors=("accel",))
    assert {n.split(".")[0] for n in found.values()} == {"accel"}
    assert set(calibrate_harmonics(run, given, sensors=("accel_z",)).values()) == set(ACCEL_Z)
    with pytest.raises(InputError, match="'gyro_y' was not recorded"):
        calibrate_harmonics(run, given, sensors=("gyro_y",))


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


# ------------------------------------------------------------------------------------------------ what is wrong is named


@pytest.fixture(scope="module")
def two():
    return plan(rates=(RATE, 2 * RATE))


@pytest.fixture(scope="module")
def right(two):
    return record(two)


@pytest.fixture(scope="module")
def triad(two):
    return record(two, ALL, ACCELS)


WRONG = [
    (lambda p: changed(p, arm_rate=lambda s: -s.arm_rate), "the arm turned the other way"),
    (lambda p: changed(p, gamma=lambda s: -s.gamma), "gamma has the other sign"),
    (lambda p: changed(p, gamma=0.0, alpha=lambda s: s.gamma), "alpha is gamma, gamma is alpha"),
    (lambda p: on_rig(p, radius=1.01 * RADIUS), r"the arm's radius is 9\.93621\d? m, not 10\.0355"),
    (lambda p: on_rig(p, radius=1.0001 * RADIUS), r"the arm's radius is 9\.93621\d? m"),
    (lambda p: changed(p, arm_phase=math.pi / 2), "arm_phase is -90 deg off"),
    (lambda p: changed(p, arm_phase=math.radians(1.0)), "the arm is -1 deg ahead of arm_phase"),
    (lambda p: on_rig(p, counter_rotating=False), "on a counter-rotating platform"),
    (lambda p: p.model_copy(update={"latitude": -p.latitude}), "latitude has the other sign"),
    (
        lambda p: changed(p, arm_rate=lambda s: s.arm_rate if s.name != "2" else 0.0),
        "segment '2' is said to be at rest",
    ),
]


@pytest.mark.parametrize(("mistake", "said"), WRONG)
@pytest.mark.parametrize("axes", ["one", "three"])
def test_a_wrong_plan_is_named(mistake, said, axes, two, right, triad):
    with pytest.raises(DataError, match=said):
        calibrate("centrifuge", right if axes == "one" else triad, mistake(two))


@pytest.mark.parametrize(
    ("rig", "said"),
    [
        (SimulatedCentrifuge(rate_error=2e-6), r"samples turn at about .* exactly.*leave arm_phase out"),
        (SimulatedCentrifuge(rate_error=1e-2), "samples turn at about"),
        (
            SimulatedCentrifuge(settings=3e-4 * np.random.default_rng(1).normal(size=(6, 3))),
            "gimbals' settings are off",
        ),
        (SimulatedCentrifuge(tilt=(1e-4, 2e-4)), "axis is tilted by 0.0"),
    ],
)
def test_a_rig_that_is_not_as_stated_is_named(rig, said, two):
    with pytest.raises(DataError, match=said):
        calibrate("centrifuge", record(two, rig=rig), two)


def test_a_turn_that_is_missing_is_named(two):
    still = changed(two, arm_rate=lambda s: s.arm_rate if s.name != "2" else 0.0)
    run = record(still)
    within(calibrate("centrifuge", run, still), ACCEL_Z)
    with pytest.raises(DataError, match="segment '2' is said to turn at 180 deg/s, but accel_z hardly changes"):
        calibrate("centrifuge", run, two)


def test_a_unit_fixed_to_the_arm_against_a_plan_that_says_otherwise(two):
    run = record(on_rig(two, counter_rotating=False), ALL, ACCELS)
    with pytest.raises(DataError, match="fixed to the arm"):
        calibrate("centrifuge", run, two)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: c * G, "look like m/s.2 but are labelled g"),
        (lambda c: c / G, "look like g but are labelled m/s.2"),
        (lambda c: -c, "accel_x answers to -x"),
        (lambda c: c[:, [2, 1, 0]], "accel_x answers to z and accel_z answers to x"),
        (lambda c: c[:, [1, 0, 2]], "accel_x answers to y and accel_y answers to x"),
    ],
)
def test_units_columns_and_signs_are_named(change, said, two):
    run = drawn(two, ALL, ACCELS)
    with pytest.raises(DataError, match=said):
        calibrate_harmonics(replace(run, coefficient=change(run.coefficient)), two)


def test_a_reversed_column_that_shows_in_its_gain_alone():
    """Up and down alone, at 250 g across: the coarse look cannot tell, the gain can."""
    given = plan((0.0, math.pi), rates=(5 * RATE,))
    run = drawn(given)
    terms = ("accel.bias", "accel.scale_error", "accel.misalignment")
    with pytest.raises(DataError, match="gain of -"):
        calibrate_harmonics(replace(run, coefficient=-run.coefficient), given, terms=terms)


def test_what_cannot_be_used_is_said():
    given = plan()
    counts = from_arrays(np.arange(0.0, 50.0, 0.01), np.ones((5000, 3)), counts=("accel",))
    with pytest.raises(InputError, match="--scale"):
        calibrate("centrifuge", counts, given)
    with pytest.raises(InputError, match="arm_rate other than zero"):
        calibrate_harmonics(drawn(given), changed(given, arm_rate=0.0))
    with pytest.raises(InputError, match="latitude"):
        calibrate_harmonics(drawn(given), given.model_copy(update={"latitude": None}))
    with pytest.raises(InputError, match="centrifuge is for a centrifuge"):
        calibrate("centrifuge", record(given), on_rig(given, kind="turntable"))
    with pytest.raises(InputError, match="are for centrifuge"):
        calibrate("norm", record(given), given, closed_form=True)
    with pytest.raises(DataError, match=r"no \[\[segment\]\]"):
        calibrate("centrifuge", record(given), given.model_copy(update={"segment": ()}))
    flat = changed(plan((0.0, math.pi)), arm_phase=None)
    with pytest.raises(DataError, match="shows where the arm was"):
        calibrate_harmonics(drawn(flat, extended=True), flat)


def test_a_fourth_harmonic_is_remarked_on():
    given = plan()
    run = drawn(given)
    run.coefficient[1, 0, 7] += 2e-4
    found = calibrate_harmonics(run, given)
    assert any("fourth harmonic of 0.0002" in r and "segment '2'" in r for r in found.remarks)


def test_a_disturbed_segment_can_be_turned_down():
    """A knock of 0.3 mg on the mean of one of ten segments: the chi-square says so, the robust option mends it."""
    given = plan(tuple(np.linspace(0.0, math.pi, 10)))
    run = drawn(given)
    run.coefficient[4, 0, 0] += 3e-3
    mended = calibrate_harmonics(run, given, robust=True)
    clean = calibrate_harmonics(drawn(given), given)
    assert mended["accel.bias.z"].value == pytest.approx(ACCEL_Z["accel.bias.z"], abs=2e-5)
    assert mended.fit.influence[4].chi2 > 5 * np.median([i.chi2 for i in mended.fit.influence])
    assert set(mended.values()) == set(clean.values())


def test_noise_that_exceeds_what_the_plan_states_is_used():
    given = plan().model_copy(update={"unit": Unit(noise=Noise(accel=DENSITY["accel"] / 3))})
    found = calibrate_harmonics(drawn(given), given)
    assert "3 times the noise stated" in found.remarks[0]
    assert found["accel.k2.z"].standard_uncertainty == pytest.approx(BOUND["accel.k2.z"], rel=0.02)


def test_drawn_harmonics_are_those_of_the_samples():
    """Known and unknown rate, parts of a turn, errors of the rig: noise-free samples give the very same coefficients."""
    rig = SimulatedCentrifuge(phase=0.3, rate_error=1e-3, tilt=(1e-3, 0.0))
    for extended, hold in ((False, 1.75), (True, 2.25)):
        given = plan(hold=hold)
        rate = "estimate" if extended else "known"
        found = segment_harmonics(record(given, seed=None, rig=rig), given, rate=rate, extended=extended)
        made = simulate_harmonics(given, ACCEL_Z, axes=Z, rig=rig, extended=extended)
        apart = (made.coefficient - found.coefficient)[:, 0]
        # as signals: terms with and without tau can hardly be told apart over a single turn
        rms = np.sqrt(np.einsum("ni,nij,nj->n", apart, np.linalg.inv(made.unit_covariance), apart) / made.count)
        assert rms.max() < (1e-7 if extended else 1e-12)
        size = np.sqrt(np.einsum("nii->ni", made.unit_covariance))
        correlation = [run.unit_covariance / (size[:, :, None] * size[:, None, :]) for run in (made, found)]
        np.testing.assert_allclose(correlation[0], correlation[1], atol=1e-6)
        np.testing.assert_allclose(made.mid_time, found.mid_time, atol=1e-12)


def test_harmonics_are_asked_for_as_the_plan_needs_them():
    run = record(plan(), seed=None)
    assert harmonics_of(run, plan()).extended
    assert not np.isfinite(harmonics_of(run, plan()).measured_rate).any()
    assert np.isfinite(harmonics_of(run, changed(plan(), arm_phase=None)).measured_rate).all()
    short = plan(hold=1.0)
    assert not harmonics_of(record(short, seed=None), short).extended


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
