"""Rigs as the engine wants them, against the rig models and against kinematics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_scenario import changed

from sagnac.plan import Plan, Rig, Segment
from sagnac.rigs.roll_isolated import RollRig
from sagnac.simulate import roll_isolated
from sagnac.simulate.build import build
from sagnac.simulate.centrifuge import Motion, SimulatedCentrifuge
from sagnac.simulate.motions import CentrifugeMotion, RollMotion
from sagnac.simulate.scenario import from_table, load

DEG = math.pi / 180
TIME = np.linspace(0.0, 100.0, 20_001)


@pytest.fixture(scope="module")
def centrifuge() -> tuple[Plan, SimulatedCentrifuge]:
    segments = tuple(
        Segment(name=str(i), start=10.0 + 30 * i, stop=20.0 + 30 * i, arm_rate=w, arm_phase=0.5, gamma=g, alpha=0.1)
        for i, (w, g) in enumerate([(math.pi, 0.0), (2 * math.pi, 1.0), (0.0, 2.0)])
    )
    plan = Plan(latitude=0.5, gravity=9.8, rig=Rig(kind="centrifuge", radius=9.9), segment=segments)
    settings = np.random.default_rng(1).normal(0, 1e-3, (3, 3))
    return plan, SimulatedCentrifuge(1e-3, (1e-3, -2e-3), settings, 1e-4, 0.02)


@pytest.mark.parametrize("counter_rotating", [True, False])
def test_a_centrifuge_is_that_of_the_rig_model(centrifuge, counter_rotating):
    plan, rig = centrifuge
    plan = plan.model_copy(update={"rig": plan.rig.model_copy(update={"counter_rotating": counter_rotating})})
    force, rate = CentrifugeMotion(plan, rig).inputs(TIME)
    expected = Motion(plan, rig).inputs(TIME)
    # 40 g of centripetal acceleration, to rounding of angles of some hundred radians
    np.testing.assert_allclose(force, expected[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(rate, expected[1], rtol=0, atol=1e-13)
    assert np.abs(force).max() > 300


def test_the_arm_channel_is_its_angle(centrifuge):
    plan, rig = centrifuge
    arm = CentrifugeMotion(plan, rig).columns(np.array([10.0, 10.25]))["arm"]
    np.testing.assert_allclose(arm, [0.52, 0.52 + 0.25 * math.pi * 1.0001], rtol=1e-12)


def test_errors_of_a_centrifuge_are_drawn_and_told():
    table = changed(
        "centrifuge-accel",
        "rig/errors",
        {
            "radius": "1 mm",
            "tilt": ["1 arcmin", "0 deg"],
            "setting": "uniform 5 arcsec",
            "rate": "100 ppm",
            "phase": "1 deg",
        },
    )
    built = build(from_table(table), 1)
    truth = built.parameters
    assert truth["rig.radius"] == pytest.approx(98.0665 / math.pi**2 + 1e-3, rel=1e-12)
    assert truth["rig.rate_error"] == pytest.approx(1e-4)
    assert truth["rig.phase_error"] == pytest.approx(DEG)
    assert truth["rig.tilt.x"] == pytest.approx(DEG / 60)
    assert built.misalignment == "input-axis"
    settings = np.array(list(built.details["setting_errors"].values()))
    assert settings.shape == (3, 3)
    assert 0 < np.abs(settings).max() <= 5 * DEG / 3600


def roll_plan() -> Plan:
    return Plan(
        latitude=40 * DEG,
        rig=Rig(kind="roll-isolated", encoder_resolution=2 * math.pi / 2**14),
        segment=(
            Segment(name="a", start=5, stop=25, stage="inner", inner_rate=2.0),
            Segment(name="b", start=35, stop=65, stage="spin", spin_rate=60.0),
        ),
    )


def test_a_roll_isolated_rig_is_that_of_its_own_simulator():
    rig = RollRig(-0.11 * DEG, -0.04 * DEG, 0.1642 * DEG, 27.3 * DEG, 2e-4, (1e-4, 0, 0, 0))
    plan = roll_plan()
    _, rate = RollMotion(plan, rig, 0.0, 2 * DEG, 1.7).inputs(TIME[1:])
    motion = roll_isolated.Motion.of(plan, 2 * DEG, 1.7)
    earth = plan.earth_rate * math.cos(40 * DEG), plan.earth_rate * math.sin(40 * DEG), 0.0
    expected = roll_isolated._true_rates(TIME[1:], motion, rig, earth)
    np.testing.assert_allclose(rate, expected, rtol=0, atol=1e-13)


def test_gravity_turns_as_the_gyros_say():
    # without a cone the cylinder's axis stands still: df/dt = -(rate - Earth rate) x f
    rig, h = RollRig(0.3 * DEG, 0.2 * DEG), 1e-4
    motion = RollMotion(roll_plan(), rig, 0.0, 2 * DEG, 1.7)
    for time in (np.array([6.0, 10.0, 40.0, 50.3]),):
        before, now, after = (motion.inputs(time + k * h) for k in (-1, 0, 1))
        slope = (after[0] - before[0]) / (2 * h)
        # Earth rate 7e-5 rad/s times g
        np.testing.assert_allclose(slope, -np.cross(now[1], now[0]), rtol=0, atol=1e-3)
        np.testing.assert_allclose(np.linalg.norm(now[0], axis=1), roll_plan().site_gravity, rtol=1e-12)
        assert np.abs(slope).max() > 1.0


def test_a_rate_error_of_a_roll_isolated_rig():
    rig = RollRig(half_angle=0.1 * DEG)
    exact, off = (RollMotion(roll_plan(), rig, e, 0.0, 1.7).inputs(np.array([15.0]))[1] for e in (0.0, 1e-3))
    assert off[0, 0] - exact[0, 0] == pytest.approx(2e-3, rel=1e-9)


def test_an_encoder_shows_whole_steps():
    shown = RollMotion(roll_plan(), RollRig(), 0.0, 0.0, 1.7).columns(TIME)["encoder"] / (2 * math.pi / 2**14)
    np.testing.assert_allclose(shown, np.round(shown), atol=1e-6)
    assert load("roll-isolated").plan.rig.encoder_resolution == pytest.approx(2 * math.pi / 2**14, rel=1e-12)
