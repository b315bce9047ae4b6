"""Centrifuge calibration: plans, rigs and samples that are wrong are named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from centrifuge_case import (
    ACCEL_Z,
    ACCELS,
    ALL,
    DENSITY,
    RADIUS,
    RATE,
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
from sagnac.calibrate.centrifuge.prepare import harmonics_of
from sagnac.errors import DataError, InputError
from sagnac.observe.harmonics import segment_harmonics
from sagnac.plan import Noise, Unit
from sagnac.recording import from_arrays
from sagnac.simulate.centrifuge import SimulatedCentrifuge, simulate_harmonics

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


def test_an_arm_column_that_is_off_is_named_where_the_fit_fails(two):
    (batch,) = record(two, arm=True).batches()
    column = {"arm": batch.rig["arm"] + math.radians(0.5)}
    run = from_arrays(batch.time, single=batch.single, rig=column, name="run")
    said = (
        r"ahead of arm_phase, or of the column arm.*\nNoted before: .*the column arm stands at .*; the column is used"
    )
    with pytest.raises(DataError, match=said):
        calibrate("centrifuge", run, two)
