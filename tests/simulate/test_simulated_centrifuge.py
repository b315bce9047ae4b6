"""The simulated centrifuge against the rig and the sensors instant by instant."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.frames import rot_x, rot_y, rot_z
from sagnac.plan import Plan, Rig, Segment
from sagnac.rigs.centrifuge import inputs
from sagnac.simulate.centrifuge import ALL_AXES, Motion, SimulatedCentrifuge, sensors_of, simulate

G = 9.80665
TRUTH = {
    "accel.bias.x": 0.05,
    "accel.k2.y": 1e-6,
    "accel.misalignment.yx": 1e-3,
    "accel.scale_error.z": -1e-3,
    "accel.k3.z": 3e-8,
    "accel.kip.z": 5e-7,
    "accel.misalignment.zy": 2e-3,
    "gyro.bias.x": 1e-4,
    "gyro.d_ii.y": 1e-7,
    "gyro.scale_error.z": 1e-3,
    "gyro.misalignment.zx": 1e-3,
}
RIG = SimulatedCentrifuge(
    radius_error=1e-3,
    tilt=(1e-3, -2e-3),
    settings=np.random.default_rng(1).normal(0, 1e-3, (3, 3)),
    rate_error=1e-4,
    phase=0.4,
    mount=(1e-3, 2e-3, -3e-3),
)


def plan(counter_rotating=True):
    steps = [(2.0, 1.5, 0.0, 0.0), (2.0, 0.3, 0.2, 1.5), (-3.0, 0.0, 0.0, 3.0)]
    segments = tuple(
        Segment(name=str(i), start=1.0 + 5 * i, stop=4.0 + 5 * i, arm_rate=w, arm_phase=a, alpha=al, gamma=ga)
        for i, (w, a, al, ga) in enumerate(steps)
    )
    rig = Rig(kind="centrifuge", radius=2.0, counter_rotating=counter_rotating)
    return Plan(latitude=0.6, gravity=G, rig=rig, segment=segments)


def together(pieces):
    pieces = list(pieces)
    return [np.concatenate([getattr(p, name) for p in pieces]) for name in ("time", "accel", "gyro", "arm")]


@pytest.mark.parametrize("counter_rotating", [True, False])
def test_samples_are_the_sensors_at_the_rigs_inputs(counter_rotating):
    """In and between segments, with every error of the rig, against the rig evaluated at each instant."""
    p = plan(counter_rotating)
    time, accel, gyro, arm = together(simulate(p, TRUTH, rig=RIG, frequency=50.0))
    state, motion = Motion(p, RIG).state(time), Motion(p, RIG)
    force, rate = inputs(
        motion.arm,
        motion.site,
        state.angle,
        state.rate,
        state.gimbals,
        arm_acceleration=state.acceleration,
        gimbal_rates=state.gimbal_rates,
    )
    to_p = (rot_x(1e-3) @ rot_y(2e-3) @ rot_z(-3e-3)).T
    force, rate = force @ to_p.T, rate @ to_p.T
    for j, s in enumerate(sensors_of(TRUTH)):
        said = (accel if j < 3 else gyro)[:, j % 3]
        np.testing.assert_allclose(said, s.axis.evaluate(s.x, force, rate).value, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * arm), np.exp(1j * state.angle), atol=1e-12)
    assert arm.min() >= 0
    assert arm.max() < 2 * math.pi


@pytest.mark.parametrize("continuous", [False, True])
def test_the_motion_holds_together(continuous):
    """Rate and acceleration are derivatives of the angle, gimbal rates those of the gimbals, over all pieces and their seams."""
    motion, h = Motion(plan(), SimulatedCentrifuge(continuous=continuous, phase=0.7)), 1e-4
    time = np.arange(0.0, 16.0, h)
    s = motion.state(time)
    # a seam jumps in acceleration (10 rad/s^2 at most here): half a step of it in a central difference
    np.testing.assert_allclose((s.angle[2:] - s.angle[:-2]) / (2 * h), s.rate[1:-1], atol=10 * h)
    jumps = np.abs(np.diff(s.acceleration)) > 0.1
    inside = ~(jumps[1:] | jumps[:-1])
    np.testing.assert_allclose(((s.rate[2:] - s.rate[:-2]) / (2 * h))[inside], s.acceleration[1:-1][inside], atol=0.1)
    np.testing.assert_allclose((s.gimbals[2:] - s.gimbals[:-2]) / (2 * h), s.gimbal_rates[1:-1], atol=10 * h)


def test_segments_start_at_their_phase_or_the_arm_turns_on():
    p = plan()
    starts = np.array([s.start for s in p.segment])
    apart = Motion(p, SimulatedCentrifuge(phase=0.1)).state(starts).angle - [1.6, 0.4, 0.1]
    np.testing.assert_allclose(np.exp(1j * apart), 1.0, atol=1e-12)
    on = Motion(p, SimulatedCentrifuge(phase=0.1, continuous=True, rate_error=1e-3)).state(starts).angle
    assert on[1] - on[0] == pytest.approx(5.0 * 2.0 * 1.001, rel=1e-12)
    steady = Motion(p, SimulatedCentrifuge(continuous=True)).state(np.linspace(1.0, 9.0, 50))
    np.testing.assert_allclose(steady.rate, 2.0, rtol=1e-12)


def test_noise_is_that_of_its_density():
    """Noise of 0.02 and 1e-4 per sqrt(Hz) at 100 Hz: 0.2 and 1e-3 a sample; 1500 samples know it to 2 %."""
    quiet = together(simulate(plan(), TRUTH, frequency=100.0))
    rng = np.random.default_rng(2)
    loud = together(simulate(plan(), TRUTH, frequency=100.0, density={"accel": 0.02, "gyro_y": 1e-4}, rng=rng))
    np.testing.assert_allclose((loud[1] - quiet[1]).std(axis=0), 0.2, rtol=0.08)
    np.testing.assert_allclose((loud[2] - quiet[2]).std(axis=0), [0.0, 1e-3, 0.0], rtol=0.08, atol=1e-15)
    with pytest.raises(ValueError, match="rng"):
        next(simulate(plan(), TRUTH, density={"accel": 0.02}))


def test_single_axes():
    pieces = list(simulate(plan(), TRUTH, axes=("accel_z", "gyro_x", "gyro_y", "gyro_z"), frequency=20.0))
    whole = together(simulate(plan(), TRUTH, axes=ALL_AXES, frequency=20.0))
    assert pieces[0].accel is None
    np.testing.assert_array_equal(np.concatenate([p.single["accel_z"] for p in pieces]), whole[1][:, 2])
    np.testing.assert_array_equal(np.concatenate([p.gyro for p in pieces]), whole[2])


def test_times_of_the_samples():
    time = together(simulate(plan(), {}, frequency=1000.0, start=0.5, stop=3.0))[0]
    assert (time[0], time[-1], time.size) == (0.5, 3.0, 2501)
    assert together(simulate(plan(), {}, frequency=10.0))[0][-1] == 14.0


def test_parameters_of_no_sensor_are_refused():
    with pytest.raises(ValueError, match=r"accel\.x"):
        sensors_of({"accel.misalignment.xy": 1e-3}, ("accel_x",))
    with pytest.raises(ValueError, match=r"accel\.k4\.x"):
        sensors_of({"accel.k4.x": 1e-3})
