"""Centrifuge calibration with everything unknown that a rig has: phase, rate, axes, mounting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from centrifuge_case import (
    ACCEL_Z,
    ACCELS,
    ALL,
    DENSITY,
    RADIUS,
    RATE,
    THREE,
    Z,
    changed,
    on_rig,
    plan,
    record,
)
from centrifuge_runs import BOUND, MOUNT, TURNED, drawn, within

from sagnac.calibrate import calibrate
from sagnac.calibrate.centrifuge import calibrate_harmonics
from sagnac.design.ideal import centrifuge_harmonics
from sagnac.errors import DataError, InputError
from sagnac.plan import Noise, Plan, Rig, Unit
from sagnac.simulate.centrifuge import SimulatedCentrifuge

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
