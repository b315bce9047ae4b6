"""Verification of centrifuge runs: a good calibration passes, a changed unit and a wrong plan do not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.calibrate.centrifuge import calibrate_harmonics
from sagnac.errors import DataError, InputError
from sagnac.plan import Plan, Rig, Segment
from sagnac.recording import from_arrays
from sagnac.simulate.centrifuge import SimulatedCentrifuge, simulate, simulate_harmonics
from sagnac.verification import verify
from sagnac.verification.centrifuge import verify_harmonics

G = 9.80665
TRUTH = {f"accel.{t}.{a}": v for a in "xyz" for t, v in (("bias", 0.05), ("scale_error", 1e-3), ("k2", 1e-6))}
TRUTH |= {f"gyro.{t}.{a}": v for a in "xyz" for t, v in (("bias", 3e-5), ("d_i", 5e-7), ("d_oo", 4e-9))}
TRUTH |= {"accel.misalignment.yx": 1e-3, "accel.misalignment.zx": 1.5e-3}
AXES = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
DENSITY = {"accel": 8e-6, "gyro": 3e-6}


def plan(gammas, rates, phase=0.0):
    segments = [
        Segment(name=f"{r}.{g}", start=5.0 + 12.0 * i, stop=7.0 + 12.0 * i, arm_rate=r, arm_phase=phase, gamma=g)
        for i, (r, g) in enumerate((r, g) for r in rates for g in gammas)
    ]
    rig = Rig(kind="centrifuge", radius=10 * G / math.pi**2)
    return Plan(latitude=0.52, gravity=G, rig=rig, segment=tuple(segments))


FIRST = plan((0.0, math.pi / 2, math.pi), (math.pi, 2 * math.pi))
SECOND = plan((0.4, 1.3, 2.6), (2.2, 5.0))


def run(given, truth=TRUTH, seed=1, **keys):
    return simulate_harmonics(given, truth, axes=AXES, density=DENSITY, rng=np.random.default_rng(seed), **keys)


@pytest.fixture(scope="module")
def calibration():
    return calibrate_harmonics(run(FIRST), FIRST)


def test_a_good_calibration_passes(calibration):
    outcome = verify_harmonics(calibration, run(SECOND, seed=2), SECOND)
    assert outcome.passed
    # six segments, six sensors, DC and four harmonics
    assert outcome.degrees_of_freedom == 6 * 6 * 9
    kinds = {c.what for c in outcome.checks}
    assert kinds == {f"{a} {w}" for a in AXES for w in ("mean", "1x", "2x", "3x") if not (w == "3x" and a[0] == "g")}
    means = [c.z for c in outcome.checks if "mean" in c.what]
    # means are normal, though what calibration and noise leave is partly common to the segments
    assert 0.6 < np.sqrt(np.mean(np.square(means))) < 1.5
    assert "accel_z 1x" in outcome.summary()


def test_the_unit_may_sit_otherwise_and_the_arms_phase_be_unknown(calibration):
    given = plan((0.4, 1.3, 2.6), (2.2, 5.0), phase=None)
    rig = SimulatedCentrifuge(mount=(1e-3, -2e-3, 3e-4), phase=0.7, rate_error=1e-4, continuous=True)
    outcome = verify_harmonics(calibration, run(given, seed=3, rig=rig, extended=True), given)
    assert outcome.passed
    assert any("rig.mount" in r for r in outcome.remarks)
    assert any("turned on steadily" in r for r in outcome.remarks)


def test_a_changed_unit_fails(calibration):
    for name, change in (("accel.k2.x", 2e-8), ("gyro.d_oo.y", 2e-9), ("accel.bias.z", 1e-4)):
        outcome = verify_harmonics(calibration, run(SECOND, {**TRUTH, name: TRUTH[name] + change}, seed=4), SECOND)
        assert not outcome.passed, name


@pytest.mark.statistical
def test_good_calibrations_pass_as_often_as_they_should():
    """200 pairs of runs: two fail at 1 %, eight hardly ever; the chi-squares average their number."""
    outcomes = []
    for seed in range(200):
        found = calibrate_harmonics(run(FIRST, seed=2 * seed), FIRST, sensors=("accel_x", "accel_z"))
        outcomes.append(verify_harmonics(found, run(SECOND, seed=2 * seed + 1), SECOND))
    assert sum(not o.passed for o in outcomes) < 8
    ratio = np.mean([o.chi2 / o.degrees_of_freedom for o in outcomes])
    assert abs(ratio - 1.0) < 3.3 * math.sqrt(2 / (108 * 200))


def test_through_the_library(calibration):
    rng = np.random.default_rng(5)
    parts = list(simulate(SECOND, TRUTH, frequency=1000.0, density=DENSITY, rng=rng))
    time, accel, gyro = (np.concatenate([getattr(p, k) for p in parts]) for k in ("time", "accel", "gyro"))
    recording = from_arrays(time, accel, gyro)
    assert verify(calibration, recording, SECOND).passed
    wrong = SECOND.model_copy(
        update={"segment": tuple(s.model_copy(update={"gamma": -s.gamma}) for s in SECOND.segment)}
    )
    with pytest.raises(DataError, match="gamma has the other sign"):
        verify(calibration, recording, wrong)
    with pytest.raises(InputError, match="unit fixed|latitude"):
        verify(calibration, recording, SECOND.model_copy(update={"latitude": None}))


def test_sensors_without_calibration_are_left_out(calibration):
    found = calibrate_harmonics(run(FIRST), FIRST, sensors=("accel_z",))
    outcome = verify_harmonics(found, run(SECOND, seed=2), SECOND)
    assert {c.what.split()[0] for c in outcome.checks} == {"accel_z"}
    only_x = simulate_harmonics(SECOND, TRUTH, axes=("gyro_x",), density=DENSITY, rng=np.random.default_rng(1))
    with pytest.raises(DataError, match="says nothing about the sensors in the recording"):
        verify_harmonics(found, only_x, SECOND)
