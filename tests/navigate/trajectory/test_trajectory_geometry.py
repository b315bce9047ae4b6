"""Trajectories: geometry and kinematics, units on the vehicle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from drives import ARM, BEND, DEG, E2, FIRST, SHIP, STEPPED, UNITS, A, trajectory
from scipy.integrate import quad

from sagnac.earth import EARTH_RATE, normal_gravity, radii
from sagnac.errors import InputError
from sagnac.frames import left_jacobian, rotation_matrix, rotation_vector
from sagnac.navigate.trajectory import Trajectory
from sagnac.navigate.trajectory.carried import Flexure, beside
from sagnac.navigate.trajectory.read import from_table
from sagnac.navigate.wander import direction_cosines

# -------------------------------------------------------------------------------------------- geometry and kinematics


def test_a_parallel():
    # constant inputs, by hand: along a parallel f = g + (2 w_ie + w_en) x v, longitude v / ((R_N + h) cos L)
    table = {"latitude": "60 deg", "speed": "10 m/s", "heading": "90 deg", "leg": [{"duration": "900 s"}]}
    motion = Trajectory.of(from_table(table))
    force, rate = motion.inputs(np.linspace(0, 900, 7))
    w, r = EARTH_RATE, float(radii(60 * DEG)[1])
    c, s = 0.5, math.sqrt(0.75)
    north, up = 2 * w * 10 * s + 100 * s / c / r, normal_gravity(60 * DEG) - 2 * w * 10 * c - 100 / r
    np.testing.assert_allclose(force, np.tile([-north, 0, up], (7, 1)), rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        rate, np.tile([-(w * c + 10 / r), 0, w * s + 10 / r * s / c], (7, 1)), rtol=0, atol=1e-17
    )
    latitude, longitude, wander = motion.state(900.0).place
    assert latitude == pytest.approx(60 * DEG, abs=1e-15)
    assert longitude == pytest.approx(900 * 10 / (r * c), rel=1e-12)
    assert wander == pytest.approx(-longitude * s, rel=1e-12)


def test_a_meridian():
    # a rhumb line due north: speed is R_M dL/dt
    table = {
        "latitude": "40 deg",
        "longitude": "20 deg",
        "speed": "300 m/s",
        "heading": "0 deg",
        "leg": [{"duration": "3 h"}],
    }
    for path in ("rhumb", "great-circle"):
        latitude, longitude, _ = Trajectory.of(from_table(table | {"path": path})).state(3 * 3600.0).place
        gone, _ = quad(lambda lat: float(radii(lat)[0]), 40 * DEG, float(latitude), epsabs=1e-6)
        assert gone == pytest.approx(300 * 3 * 3600, abs=1e-5)
        assert longitude == pytest.approx(20 * DEG, abs=1e-14)


def test_a_rhumb_line_keeps_its_heading_and_a_geodesic_its_constant():
    table = {"latitude": "30 deg", "speed": "250 m/s", "heading": "50 deg", "leg": [{"duration": "4 h"}]}
    rhumb = Trajectory.of(from_table(table)).state(np.linspace(0, 14400, 9))
    np.testing.assert_allclose(rhumb.angles[0], 50 * DEG, rtol=0, atol=1e-13)
    great = Trajectory.of(from_table(table | {"path": "great-circle"})).state(np.linspace(0, 14400, 9))
    latitude, heading = great.place[0], great.angles[0]
    constant = radii(latitude)[1] * np.cos(latitude) * np.sin(heading)  # Clairaut's
    np.testing.assert_allclose(constant, constant[0], rtol=1e-13)
    assert np.ptp(heading) > 20 * DEG
    # the loxodrome: longitude is tan(heading) times isometric latitude
    latitude, longitude, _ = rhumb.place
    e = math.sqrt(E2)
    isometric = np.arctanh(np.sin(latitude)) - e * np.arctanh(e * np.sin(latitude))
    np.testing.assert_allclose(longitude, math.tan(50 * DEG) * (isometric - isometric[0]), rtol=0, atol=1e-12)


def test_over_the_pole():
    motion = trajectory("over the pole")
    _, longitude, _ = motion.state(np.array([0.0, 60.0])).place
    at_pole = quad(lambda lat: float(radii(lat)[0]) + 1000.0, 89.95 * DEG, 90 * DEG)[0] / 250.0
    assert 20 < at_pole < 25
    assert float(motion.state(at_pole).place[0]) == pytest.approx(90 * DEG, abs=1e-12)
    assert math.degrees(longitude[1]) == pytest.approx(30 - 180, abs=1e-9)
    heading = motion.state(np.array([20.0, 25.0])).angles[0]
    np.testing.assert_allclose(heading, [0, math.pi], atol=1e-8)
    rate = motion.inputs(np.linspace(0, 60, 601))[1]
    # nothing happens at the pole: what changes is the Earth rate on the level, 7.3e-5 rad/s times 15 km over R
    assert np.ptp(rate, axis=0).max() == pytest.approx(7.3e-5 * 15e3 / 6.4e6, rel=0.01)


def test_turns_climbs_and_speeds_are_those_of_the_legs():
    table = SHIP | {
        "leg": [
            {"duration": "60 s", "turn_rate": "3 deg/s"},
            {"duration": "60 s", "climb": "30 m", "turn_rate": "-1 deg/s"},
            {"duration": "60 s", "acceleration": "0.1 m/s^2", "climb": "2 deg"},
            {"duration": "60 s", "climb": "-12 m", "ease": "5 s"},
            {"duration": "60 s", "climb": "-0.5 m/s"},
        ]
    }
    motion = Trajectory.of(from_table(table))
    state = motion.state(np.arange(0, 301, 60.0))
    np.testing.assert_allclose(np.degrees(state.angles[0]), [30, 210, 150, 150, 150, 150], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*state.velocity_enu[:, :2].T), [5, 5, 5, 11, 11.25, 11.25], rtol=1e-12)
    # the acceleration goes out in 5 s of the leg that says so, with half its size in the mean: 0.25 m/s
    assert state.height[2] - state.height[0] == pytest.approx(30, abs=1e-10)
    assert state.height[4] - state.height[3] == pytest.approx(-12, abs=1e-10)
    slope = math.tan(2 * DEG)
    # 3 s of coming in at a mean of half: the distance gone in the 60 s less that; then the ramp itself, by quadrature
    s = lambda t: 5 + 0.1 * t  # noqa: E731
    ramp = lambda x: x**3 * (10 - 15 * x + 6 * x * x)  # noqa: E731
    gained = quad(lambda t: slope * s(t) * (ramp(t / 3) if t < 3 else 1), 0, 60, points=[3])[0]
    assert state.height[3] - state.height[2] == pytest.approx(gained, rel=1e-9)
    assert state.velocity[3, 2] == pytest.approx(slope * 11, rel=1e-12)
    assert state.velocity[5, 2] == pytest.approx(-0.5, rel=1e-12)


def test_a_coordinated_bank_pulls_nowhere_but_down_the_seat():
    motion = trajectory("plane")
    time = np.linspace(24, 56, 50)
    state, (force, _) = motion.state(time), motion.inputs(time)
    roll = motion.state(40.0).angles[2]
    assert math.tan(roll) == pytest.approx(100 * 3 * DEG / (normal_gravity(48 * DEG, 1000.0) + 1e-3), rel=1e-9)
    # the Coriolis acceleration of 100 m/s is 0.01 m/s^2, of the climb 1e-3; gravity and turn would be 9.8 and 5.2
    assert np.abs(force[:, 0]).max() < 0.02
    # the nose is on the path, but for the 2 deg of pitch
    level = rotation_matrix([2 * DEG, 0, 0])
    along = np.einsum("nji,nj->ni", state.C_b_w, state.velocity)
    roll = rotation_matrix(np.stack([0 * time, state.angles[2], 0 * time], axis=-1))
    seen = np.einsum("ji,nj->ni", level.T, np.einsum("nij,nj->ni", roll, along))
    np.testing.assert_allclose(seen[:, [0, 2]], 0, atol=1e-10)


def test_sway_is_what_it_says():
    motion = trajectory("sway")
    time = np.linspace(0, 60, 60_001)
    heading, pitch, roll = motion.state(time).angles
    w = 2 * math.pi
    np.testing.assert_allclose(roll, 10 * DEG * np.sin(w * time / 9), atol=1e-12)
    np.testing.assert_allclose(pitch, 3 * DEG * np.sin(w * time / 6.3 + 70 * DEG), atol=1e-12)
    np.testing.assert_allclose(heading, 30 * DEG + 2 * DEG * np.sin(w * time / 12), atol=1e-12)
    np.testing.assert_allclose(motion.state(time).height, 20 + np.sin(w * time / 7), atol=1e-11)
    # the track is that of the course: yaw turns the body only
    velocity = motion.state(time).velocity_enu
    np.testing.assert_allclose(np.arctan2(velocity[:, 0], velocity[:, 1]), 30 * DEG, atol=1e-12)


def test_before_the_start_it_goes_straight_and_after_the_end_steadily_on():
    motion = trajectory("plane")
    state = motion.state(np.array([-10.0, -5.0, 0.0]))
    np.testing.assert_allclose(state.angles[0], 250 * DEG, atol=1e-12)
    np.testing.assert_allclose(state.height, 1000, atol=1e-12)
    _, rate = motion.inputs(np.array([140.5, 149.9]))
    np.testing.assert_allclose(rate[0], rate[1], atol=1e-6)


def test_the_rate_of_the_wander_frame_has_no_vertical_part():
    motion = trajectory("beside the pole")
    step, times = 0.5, np.arange(5.0, 95.0, 10.0)
    C = motion.state(times[:, None] + step * np.arange(-4, 5)).C_e_w
    slope = np.einsum("k,nkij->nij", FIRST, C) / step
    turning = slope @ np.swapaxes(C[:, 4], 1, 2)  # -[w x]
    np.testing.assert_allclose(turning[:, 0, 1], 0, atol=1e-14)
    assert np.abs(turning).max() > 5e-6


# ----------------------------------------------------------------------------------------- a unit on the vehicle


@pytest.mark.parametrize("name", ["plane", "over the pole", "sway"])
def test_a_unit_on_an_arm_is_where_the_arm_ends(name):
    time = np.linspace(0, 60, 13)
    vehicle, arm = trajectory(name).state(time), trajectory(name, "arm").state(time)

    def place(state):
        up = state.C_e_w[:, 2]
        normal = A / np.sqrt(1 - E2 * up[:, 2] ** 2)
        return (normal + state.height)[:, None] * up - (E2 * normal * up[:, 2])[:, None] * [0.0, 0.0, 1.0]

    offset = np.einsum("nji,nj->ni", vehicle.C_e_w, vehicle.C_b_w @ np.array(ARM))
    np.testing.assert_allclose(place(arm) - place(vehicle), offset, rtol=0, atol=5e-9)
    # and turned as the vehicle is
    both = (np.swapaxes(s.C_e_w, 1, 2) @ s.C_b_w for s in (vehicle, arm))
    np.testing.assert_allclose(*both, rtol=0, atol=1e-14)


def test_beside_is_exact_for_a_kilometre():
    C, offset = (
        direction_cosines([0.3, -1.5707963, 1.2], [1.0, 2.0, -3.0], [0.5, 0.0, 2.0]),
        np.array([600.0, -700.0, 300.0]),
    )
    turned, height = beside(C, np.array([10.0, 0.0, 5000.0]), np.tile(offset, (3, 1)))
    back, again = beside(turned @ C, height, np.einsum("nij,j->ni", turned, -offset))
    np.testing.assert_allclose(back @ turned, np.tile(np.eye(3), (3, 1, 1)), rtol=0, atol=3e-11)  # the freedom of w
    np.testing.assert_allclose(again, [10, 0, 5000], rtol=0, atol=5e-9)
    np.testing.assert_allclose((back @ turned)[:, 2], np.tile([0, 0, 1.0], (3, 1)), rtol=0, atol=1e-15)


def test_mounting_and_flexure_turn_what_is_felt():
    time = np.array([1.0, 40.0, 77.7])
    plain, turned = trajectory("sway", "arm"), trajectory("sway", "turned")
    C = rotation_matrix(np.outer(np.sin(time), BEND)) @ UNITS["turned"]["mounting"]
    np.testing.assert_allclose(turned.state(time).C_b_w, plain.state(time).C_b_w @ C, atol=1e-15)
    (f1, w1), (f2, w2) = plain.inputs(time), turned.inputs(time)
    np.testing.assert_allclose(f2, np.einsum("nji,nj->ni", C, f1), rtol=0, atol=1e-14)
    # about a fixed axis the rate is that of the angle
    np.testing.assert_allclose(w2, np.einsum("nji,nj->ni", C, w1 + np.outer(np.cos(time), BEND)), rtol=0, atol=1e-15)


@pytest.mark.parametrize("size", [1e-6, 9e-3, 1.1e-2, 0.5, 3.0])
def test_the_rate_of_a_rotation_vector(size):
    v, slope, h = size * np.array([0.36, -0.48, 0.8]), np.array([0.3, 1.0, -2.0]), 1e-6
    turn = rotation_vector(rotation_matrix(v + h * slope) @ rotation_matrix(v - h * slope).T) / (2 * h)
    np.testing.assert_allclose(left_jacobian(v[None])[0] @ slope, turn, rtol=0, atol=1e-9)


def test_a_flexure_of_pieces_is_integrated_piece_by_piece():
    # a triangle: its rate jumps at knots that no sample meets
    knots = np.arange(-10.0, 111.0, 0.737)
    heights = np.where(np.arange(knots.size) % 2, 1e-3, -1e-3)

    def angle(t):
        k = np.clip(np.searchsorted(knots, t) - 1, 0, knots.size - 2)
        rate = np.diff(heights)[k] / 0.737
        return np.outer(heights[k] + rate * (t - knots[k]), [1, 0, 0]), np.outer(rate, [1, 0, 0])

    motion = trajectory("straight").carry(flexure=Flexure(angle, math.inf, knots))
    time, turns, _ = motion.increments(10.0)
    still = trajectory("straight").increments(10.0).turns
    # about x, the axis along which the angle grows, what is gained is the change of the angle
    np.testing.assert_allclose((turns - still)[:, 0], np.diff(angle(time)[0][:, 0]), rtol=0, atol=1e-16)


@pytest.mark.parametrize("name", STEPPED)
def test_a_lever_arm_needs_turns_that_come_in_smoothly(name):
    with pytest.raises(
        InputError, match=r"trajectory\.leg\.1\.legs\.0\.ease: the leg begins with a step .* for example '2 s'"
    ):
        trajectory(name).carry(lever_arm=ARM)
