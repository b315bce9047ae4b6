"""The centrifuge against inertial mechanics, numerical derivatives and its own instants."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sagnac.rigs.centrifuge import EFFECTS, Arm, gimbals, inputs, series
from sagnac.rigs.turntable import Site

SITE = Site(math.radians(29.89), 9.80665, 7.292e-5)
angle = st.floats(-7, 7)
small = st.floats(-0.05, 0.05)
arms = st.builds(Arm, radius=st.floats(0.2, 20), counter_rotating=st.booleans(), tilt=st.tuples(small, small))
settings = st.tuples(angle, angle, angle).map(np.array)
rates = st.floats(-8, 8)


def at(values, angles):
    """A series (3, 3) at angles (n,), shape (n, 3)."""
    return np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1) @ values.T


@given(settings)
def test_gimbals_are_three_passive_turns(a):
    # passive rotations as the conventions write them out
    (ca, sa), (cb, sb), (cg, sg) = ((math.cos(v), math.sin(v)) for v in a)
    x = np.array([[1, 0, 0], [0, ca, sa], [0, -sa, ca]])
    z = np.array([[cb, sb, 0], [-sb, cb, 0], [0, 0, 1]])
    y = np.array([[cg, 0, -sg], [0, 1, 0], [sg, 0, cg]])
    np.testing.assert_allclose(gimbals(a), y @ z @ x, atol=2e-15)


def test_force_is_the_published_one():
    """[XU18]: f = [-(A+A1) cos th, -(A+A1) sin th, 1 + A2 sin th] in g."""
    w, r, g = math.pi, 10 * SITE.gravity / math.pi**2, SITE.gravity
    up, north = 7.292e-5 * math.sin(math.radians(29.89)), 7.292e-5 * math.cos(math.radians(29.89))
    a, a1, a2 = w * w * r / g, 2 * w * r * up / g, 2 * w * r * north / g
    felt = series(Arm(r), SITE, np.array([w]), np.zeros((1, 3)))
    np.testing.assert_allclose(felt.force[0] / g, [[0, -(a + a1), 0], [0, 0, -(a + a1)], [1, 0, a2]], atol=1e-15)
    np.testing.assert_allclose(felt.rate[0], [[0, 0, 0], [north, 0, 0], [up, 0, 0]], atol=1e-19)
    # fixed to the arm: x outward, y ahead
    felt = series(Arm(r, counter_rotating=False), SITE, np.array([w]), np.zeros((1, 3)))
    np.testing.assert_allclose(felt.force[0] / g, [[-(a + a1), 0, 0], [0, 0, 0], [1, 0, a2]], atol=1e-15)
    np.testing.assert_allclose(felt.rate[0], [[0, 0, north], [0, north, 0], [w + up, 0, 0]], atol=1e-19)


@given(arms, rates, angle, settings)
def test_inertial_mechanics_agree(arm, w, start, a):
    """Second derivative of the position in inertial space, and the derivative of the attitude there."""
    h, earth = 1e-3, SITE.enu
    from_tilted = Rotation.from_euler("XY", arm.tilt)  # base to east, north, up

    def place(t):
        turn = Rotation.from_rotvec(earth * t) * from_tilted
        th = start + w * t
        arm_turn = Rotation.identity() if arm.counter_rotating else Rotation.from_euler("z", th)
        return turn.apply([arm.radius * math.cos(th), arm.radius * math.sin(th), 0.0]), turn * arm_turn

    (p0, _), (p1, c1), (p2, c2), (p3, c3), (p4, _) = (place(k * h) for k in (-2, -1, 0, 1, 2))
    acceleration = (-p0 + 16 * p1 - 30 * p2 + 16 * p3 - p4) / (12 * h * h)
    # gravity holds the centrifugal acceleration at the axis; what the arm's own place adds is left out by the model
    acceleration = acceleration - np.cross(earth, np.cross(earth, p2)) + [0, 0, SITE.gravity]
    to_p = gimbals(a)
    force, rate = inputs(arm, SITE, np.array([start]), np.array([w]), a[None])
    # five points leave r w^6 h^4 / 90 and rounding of 2e-15 r / h^2
    bound = arm.radius * (abs(w) ** 6 * h**4 / 90 + 4e-15 / h**2 * 4) + 1e-12
    np.testing.assert_allclose(force[0], to_p @ c2.inv().apply(acceleration), rtol=0, atol=bound)
    turned = c2.inv() * c3 * (c2.inv() * c1).inv()
    # a steady turn is found exactly; on the arm the Earth rate turns by w h to either side
    bound = 7.3e-5 * (w * h) ** 2 + 1e-12
    np.testing.assert_allclose(rate[0], to_p @ turned.as_rotvec() / (2 * h), rtol=0, atol=bound)


@given(arms, rates, settings, st.lists(angle, min_size=1, max_size=5))
def test_series_are_the_inputs_at_every_angle(arm, w, a, angles):
    th = np.array(angles)
    felt = series(arm, SITE, np.array([w]), a[None])
    force, rate = inputs(arm, SITE, th, np.full(th.size, w), np.repeat(a[None], th.size, axis=0))
    np.testing.assert_allclose(at(felt.force[0], th), force, rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(at(felt.rate[0], th), rate, rtol=1e-13, atol=1e-14)


@given(arms, rates, settings)
def test_derivatives_are_those_of_the_series(arm, w, a):
    felt = series(arm, SITE, np.array([w]), a[None])
    for k, effect in enumerate(EFFECTS):
        h = 1e-5
        shifted = []
        for sign in (1, -1):
            step = sign * h
            tilt = (arm.tilt[0] + step * (effect == "tilt_x"), arm.tilt[1] + step * (effect == "tilt_y"))
            moved = Arm(arm.radius + step * (effect == "radius"), arm.counter_rotating, tilt)
            site = Site(SITE.latitude, SITE.gravity + step * (effect == "gravity"), SITE.earth_rate)
            gimbal = a + step * np.array([effect == "alpha", effect == "beta", effect == "gamma"])
            shifted.append(series(moved, site, np.array([w + step * (effect == "arm_rate")]), gimbal[None]))
        for mine, plus, minus in zip(felt[2:], shifted[0][:2], shifted[1][:2], strict=True):
            # central difference: rounding 1e-16 * 2000 / h, truncation 1e3 h^2 / 6
            np.testing.assert_allclose(mine[..., k], (plus - minus) / (2 * h), rtol=0, atol=1e-7, err_msg=effect)


def test_the_series_of_an_arm_at_rest_is_gravity():
    felt = series(Arm(10.0), SITE, np.zeros(1), np.array([[0.0, 0.0, math.pi / 2]]))
    np.testing.assert_allclose(felt.force[0], [[-SITE.gravity, 0, 0], [0, 0, 0], [0, 0, 0]], atol=1e-15)


@given(arms, rates, angle, settings, st.floats(-2, 2), st.tuples(*[st.floats(-2, 2)] * 3).map(np.array))
def test_inputs_while_arm_and_gimbals_move(arm, w, th, a, acceleration, turning):
    """The rate is that of the attitude's derivative; the tangential acceleration is r dw/dt."""
    one = (np.array([th]), np.array([w]), a[None])
    still, rate = inputs(arm, SITE, *one)
    force, moved = inputs(arm, SITE, *one, arm_acceleration=acceleration, gimbal_rates=turning[None])
    assert np.linalg.norm(force - still) == pytest.approx(arm.radius * abs(acceleration), rel=1e-9, abs=1e-12)
    h = 1e-4
    before, after = (gimbals(a + s * h * turning) for s in (-1, 1))
    # coordinates v_p = C v_r with C' = -[w x] C; a central difference leaves |w|^3 h^2 / 6
    rotation = Rotation.from_matrix(before @ after.T).as_rotvec() / (2 * h)
    np.testing.assert_allclose(moved[0] - rate[0], rotation, rtol=0, atol=np.abs(turning).sum() ** 3 * h**2 + 1e-11)
