"""The roll-isolated rig against brute-force geometry and complex-step derivatives."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sagnac.frames import rot_x
from sagnac.rigs.roll_isolated import (
    DELAY,
    ECCENTRICITY,
    HALF_ANGLE,
    MOUNT_PITCH,
    MOUNT_YAW,
    PHASE,
    RATE_ARGUMENTS,
    RollRig,
    eccentric_slope,
    encoder_reading,
    inner_rates,
    mount,
    mount_derivatives,
    true_angle,
    unit_rate_derivatives,
    unit_rates,
    without_cone,
)

STEP = 1e-30  # complex step: no cancellation, so as small as one likes
RIG = RollRig(0.05, -0.03, 0.08, 0.7, 2e-3, (0.01, -0.02, 0.005, 0.003))
small = st.floats(-0.3, 0.3)
angles = st.floats(-7, 7)


def tilt(rig: RollRig) -> np.ndarray:
    """T: carrier's x axis to [cos a, sin a cos e0, sin a sin e0], the short way round."""
    return Rotation.from_rotvec(rig.half_angle * np.array([0.0, -np.sin(rig.phase), np.cos(rig.phase)])).as_matrix()


def body_rate(attitude, t, h=1e-4):
    """Rate of a frame from its attitude by a five-point derivative: C' = C [w x]."""
    c = [attitude(t + k * h) for k in (-2, -1, 1, 2)]
    w = attitude(t).T @ ((c[0] - 8 * c[1] + 8 * c[2] - c[3]) / (12 * h))
    return np.array([w[2, 1], w[0, 2], w[1, 0]])


def carrier(t):
    """A carrier that spins at 20 rad/s and yaws and pitches besides."""
    return Rotation.from_euler("YZX", [0.3 * np.sin(1.1 * t), 0.2 * np.cos(0.7 * t), 20.0 * t]).as_matrix()


def relative(t):
    """Roll of the carrier against the cylinder and its rate, with a swing."""
    return 20.0 * t - 0.1 * np.sin(9.0 * t), 20.0 - 0.9 * np.cos(9.0 * t)


def test_the_mount_is_the_documented_product():
    p, y = 0.3, -0.2
    rz = np.array([[np.cos(p), np.sin(p), 0], [-np.sin(p), np.cos(p), 0], [0, 0, 1]])
    ry = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    np.testing.assert_allclose(mount(y, p), rz @ ry, atol=1e-16)
    # methods of the publication: first column, from which yaw and pitch are read
    np.testing.assert_allclose(
        mount(y, p)[:, 0], [np.cos(p) * np.cos(y), -np.sin(p) * np.cos(y), np.sin(y)], atol=1e-16
    )


@pytest.mark.parametrize("t", [0.0, 0.37, 1.9])
def test_rates_of_a_spinning_carrier_are_those_of_its_geometry(t):
    """The inner cylinder hangs in the carrier by T and the encoder's angle; its rate is the derivative of its attitude."""
    spin = 20.0

    def cylinder(t):
        return rot_x(spin * t) @ tilt(RIG).T @ rot_x(-relative(t)[0])

    e, de = relative(t)
    ours = inner_rates(np.array([spin * np.cos(RIG.half_angle) - de]), spin, np.array([e]), RIG)[0]
    np.testing.assert_allclose(ours, body_rate(cylinder, t), atol=1e-8)


@pytest.mark.parametrize("t", [0.1, 0.8, 2.3])
def test_without_cone_is_exact_for_any_motion(t):
    """Rates of the cylinder laid onto the spin axis, and the spin, while the carrier yaws and pitches as well."""

    def cylinder(t):
        return carrier(t) @ tilt(RIG).T @ rot_x(-relative(t)[0])

    def laid(t):
        return carrier(t) @ rot_x(-relative(t)[0])

    e, de = relative(t)
    rates, spin = without_cone(body_rate(cylinder, t)[None], np.array([e]), np.array([de]), RIG)
    np.testing.assert_allclose(rates[0], body_rate(laid, t), atol=1e-8)
    np.testing.assert_allclose(spin[0], body_rate(carrier, t)[0], atol=1e-8)


@given(st.floats(-200, 200), st.floats(-2, 2), angles, small, angles)
def test_without_cone_takes_away_what_the_cone_adds(spin, roll_rate, e, half, phase):
    rig = RollRig(half_angle=half, phase=phase)
    angle = np.array([e])
    w1 = inner_rates(np.array([roll_rate]), spin, angle, rig)
    rates, found = without_cone(w1, angle, np.array([spin * np.cos(half) - roll_rate]), rig)
    np.testing.assert_allclose(found, spin, atol=1e-12 * (1 + abs(spin)))
    # about its axis: w - de/dt, where the coned cylinder rolls at w cos a - de/dt
    np.testing.assert_allclose(rates[0], [roll_rate + spin * (1 - np.cos(half)), 0, 0], atol=1e-12 * (1 + abs(spin)))


@given(small, small)
def test_mount_derivatives(yaw, pitch):
    numeric = [mount(yaw + 1j * STEP, pitch).imag / STEP, mount(yaw, pitch + 1j * STEP).imag / STEP]
    np.testing.assert_allclose(mount_derivatives(yaw, pitch), numeric, atol=1e-15)


def test_rate_derivatives_to_every_argument():
    """Complex step: exact to rounding."""
    roll, spin, angle = np.array([0.3, -1.0]), 113.0, np.array([0.4, 5.0])
    ours = dict(zip(RATE_ARGUMENTS, unit_rate_derivatives(roll, spin, angle, RIG), strict=True))
    for name in ("mount_yaw", "mount_pitch", "half_angle", "phase"):
        moved = replace(RIG, **{name: getattr(RIG, name) + 1j * STEP})
        numeric = unit_rates(roll, spin, angle, moved).imag.T / STEP
        np.testing.assert_allclose(ours["angle" if name == "phase" else name], numeric, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(
        ours["spin"], unit_rates(roll, spin + 1j * STEP, angle, RIG).imag.T / STEP, rtol=1e-13, atol=1e-15
    )
    np.testing.assert_allclose(
        ours["roll_rate"], unit_rates(roll + 1j * STEP, spin, angle, RIG).imag.T / STEP, rtol=1e-13, atol=1e-15
    )
    np.testing.assert_allclose(
        ours["angle"], unit_rates(roll, spin, angle + 1j * STEP, RIG).imag.T / STEP, rtol=1e-13, atol=1e-13
    )


@given(angles, st.tuples(*[st.floats(-0.05, 0.05)] * 4))
def test_true_angle_undoes_the_eccentricity(e, eccentricity):
    rig = RollRig(eccentricity=eccentricity)
    np.testing.assert_allclose(true_angle(encoder_reading(np.array([e]), rig), eccentricity), [e], atol=1e-14 * 8)
    slope = eccentric_slope(np.array([e + 1j * STEP]), eccentricity).real
    shown = encoder_reading(np.array([e + 1j * STEP]), rig).imag / STEP
    np.testing.assert_allclose(1 + slope, shown, rtol=1e-13)


def test_readings_are_rounded_to_the_step():
    step = 2 * np.pi / 2**14
    e = np.linspace(0, 7, 1001)
    shown = encoder_reading(e, RollRig(), step)
    np.testing.assert_allclose(shown / step, np.round(shown / step), atol=1e-9)
    assert np.abs(shown - e).max() <= step / 2 * (1 + 1e-9)


def test_a_rig_of_named_parameters():
    values = {MOUNT_YAW: 1.0, MOUNT_PITCH: 2.0, HALF_ANGLE: 3.0, PHASE: 4.0, DELAY: 5.0, ECCENTRICITY[3]: 6.0}
    assert RollRig.of(values) == RollRig(1.0, 2.0, 3.0, 4.0, 5.0, (0.0, 0.0, 0.0, 6.0))
    assert RollRig.of({}) == RollRig()
    assert len(fields(RollRig)) == 6
