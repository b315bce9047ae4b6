"""True motion along a course: against Earth-fixed coordinates, against a navigator, against geometry in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from sagnac.earth import EARTH_RATE, ELLIPSOID, normal_gravity, radii
from sagnac.errors import InputError
from sagnac.frames import Array, left_jacobian, rotation_matrix, rotation_vector
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import integrate
from sagnac.navigate.trajectory import Trajectory
from sagnac.navigate.trajectory.body import angles
from sagnac.navigate.trajectory.carried import Flexure, beside
from sagnac.navigate.trajectory.course import from_table
from sagnac.navigate.wander import direction_cosines

DEG = math.pi / 180.0
A, E2 = ELLIPSOID[:2]
WEAVE = [
    {"duration": "15 s", "turn_rate": "3 deg/s"},
    {"duration": "30 s", "turn_rate": "-3 deg/s"},
    {"duration": "15 s", "turn_rate": "3 deg/s"},
]
SHIP = {"latitude": "55 deg", "longitude": "10 deg", "height": "20 m", "speed": "5 m/s", "heading": "30 deg"}
SWAY = {
    "roll": "10 deg", "roll_period": "9 s", "pitch": "3 deg", "pitch_period": "6.3 s", "pitch_phase": "70 deg",
    "yaw": "2 deg", "heave": "1 m",
}  # fmt: skip
PLANE = {
    "latitude": "48 deg",
    "height": "1 km",
    "speed": "100 m/s",
    "heading": "250 deg",
    "bank": "coordinated",
    "pitch": "2 deg",
}
TABLES = {
    "straight": SHIP | {"leg": [{"duration": "100 s"}]},
    "weave": SHIP | {"leg": [{"duration": "20 s"}, {"repeat": 2, "legs": WEAVE}, {"duration": "20 s"}]},
    "eased": SHIP | {"ease": "2 s", "leg": [{"duration": "20 s"}, {"repeat": 2, "legs": WEAVE}, {"duration": "20 s"}]},
    "great circle": SHIP | {"path": "great-circle", "leg": [{"duration": "20 s"}, {"repeat": 2, "legs": WEAVE}]},
    "speed": SHIP
    | {
        "leg": [
            {"duration": "40 s", "acceleration": "0.3 m/s^2"},
            {"duration": "9 s"},
            {"duration": "40 s", "acceleration": "-0.4 m/s^2"},
        ]
    },
    "sway": SHIP | {"sway": SWAY, "ease": "2 s", "leg": [{"duration": "60 s"}, {"duration": "40 s", "turn_rate": "1 deg/s"}]},
    "plane": PLANE
    | {
        "leg": [
            {"duration": "20 s"},
            {"duration": "40 s", "climb": "200 m", "turn_rate": "3 deg/s"},
            {"duration": "30 s", "climb": "5 deg", "acceleration": "0.5 m/s^2"},
            {"duration": "30 s", "climb": "-3 m/s", "turn_rate": "-6 deg/s"},
            {"duration": "20 s"},
        ]
    },
    "over the pole": PLANE
    | {
        "latitude": "89.95 deg", "longitude": "30 deg", "heading": "0 deg", "path": "great-circle", "speed": "250 m/s",
        "leg": [{"duration": "60 s"}],
    },
    "beside the pole": SHIP | {"latitude": "-89.8 deg", "heading": "80 deg", "speed": "50 m/s", "leg": [{"duration": "100 s"}]},
}  # fmt: skip
ARM = (1.0, -20.0, 4.0)
BEND = np.array([1e-2, -2e-2, 3e-2])
FLEXURE = Flexure(lambda t: (np.outer(np.sin(t), BEND), np.outer(np.cos(t), BEND)), 2.0 * math.pi)
UNITS = {
    "vehicle": {},
    "arm": {"lever_arm": ARM},
    "turned": {"mounting": rotation_matrix([0.1, 0.2, -0.5]), "flexure": FLEXURE, "lever_arm": ARM},
}
STEPPED = ("weave", "great circle")  # what begins a turn at once carries no lever arm


@cache
def trajectory(name: str, unit: str = "vehicle") -> Trajectory:
    vehicle = Trajectory.of(from_table(TABLES[name]), earth_rate=7.3e-5, gravity_excess=1e-3)
    return vehicle.carry(**UNITS[unit]) if unit != "vehicle" else vehicle


every = pytest.mark.parametrize("name", TABLES)
carried = pytest.mark.parametrize(
    ("name", "unit"), [(n, u) for n in TABLES for u in UNITS if u == "vehicle" or n not in STEPPED]
)


# ------------------------------------------------------------------------------------------- an independent way


def fixed(motion: Trajectory, time: Array) -> tuple[Array, Array]:
    """Earth-fixed position, relative to that at the first time, (n, 3), m, and C_b_e, (n, 3, 3), by latitude and longitude."""
    state = motion.state(time)
    up = state.C_e_w[:, 2]
    normal = A / np.sqrt(1 - E2 * up[:, 2] ** 2)
    place = (normal + state.height)[:, None] * up - (E2 * normal * up[:, 2])[:, None] * [0.0, 0.0, 1.0]
    return place - place[0], np.swapaxes(state.C_e_w, 1, 2) @ state.C_b_w


# central differences of eighth order
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


@carried
def test_force_and_rate_are_those_of_earth_fixed_coordinates(name, unit):
    # f = C' (d2r/dt2 + 2 w x dr/dt - g(r)) with g along the ellipsoid's normal, w = C' dC/dt; away from where legs meet
    motion, step, w = trajectory(name, unit), 0.1, np.array([0.0, 0.0, 7.3e-5])
    breaks = motion.way.profile.breaks
    times = [t for t in np.arange(0.55, motion.duration, 2.11) if np.abs(breaks - t).min() > 4.5 * step]
    assert len(times) > 15
    force, rate = motion.inputs(np.array(times))
    for i, t in enumerate(times):
        place, _ = fixed(motion, t + step * np.arange(-4, 5))
        _, attitude = fixed(motion, t + 0.2 * step * np.arange(-4, 5))
        velocity, acceleration = FIRST @ place / step, SECOND @ place / step**2
        state = motion.state(t)
        gravity = normal_gravity(float(state.place[0]), float(state.height)) + 1e-3
        felt = attitude[4].T @ (acceleration + 2 * np.cross(w, velocity) + gravity * state.C_e_w[2])
        # 1e-9 m of rounding in places over 0.1 s squared; eighth order leaves less, but for the plane's quick roll
        np.testing.assert_allclose(force[i], felt, rtol=0, atol=2e-6 if name != "plane" else 1e-4)
        turning = attitude[4].T @ np.einsum("k,kij->ij", FIRST, attitude) / (0.2 * step)
        across = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
        np.testing.assert_allclose(
            rate[i], across + attitude[4].T @ w, rtol=0, atol=5e-13 if name != "plane" else 1e-10
        )
        # velocity, the derivative of the place
        np.testing.assert_allclose(
            state.C_e_w @ velocity, state.velocity, rtol=0, atol=1e-6 if name != "plane" else 1e-5
        )


@carried
def test_ideal_sensors_integrate_to_the_truth(name, unit):
    motion = trajectory(name, unit)
    time, turns, pushes = motion.increments(200.0)
    settings = {"samples": 4, "earth_rate": 7.3e-5, "gravity_excess": 1e-3}
    path = integrate(motion.state(0.0), turns, pushes, np.diff(time), every=time.size - 1, **settings)
    horizontal, height, attitude, velocity = errors(path.states, motion.state(path.time))
    # what is left is the navigator's: 1e-5 m, and 2e-9 deg where the plane rolls quickly
    assert horizontal < 1e-4
    assert height < 1e-4
    assert attitude < 1e-8 * DEG
    assert velocity < 1e-5


def errors(found: State, true: State) -> tuple[float, float, float, float]:
    """Horizontal error, height, attitude against the Earth, and velocity, largest: m, m, rad, m/s.

    Against the Earth, because the wander angle of a unit with a lever arm has a freedom of 1e-9 rad.
    """
    up = np.linalg.norm(found.C_e_w[:, 2] - true.C_e_w[:, 2], axis=-1)
    turned = np.linalg.norm(
        rotation_vector(to_earth(found, found.C_b_w) @ np.swapaxes(to_earth(true, true.C_b_w), 1, 2)), axis=-1
    )
    velocity = to_earth(found, found.velocity[:, :, None]) - to_earth(true, true.velocity[:, :, None])
    return (
        float(np.max(up) * A),
        float(np.max(np.abs(found.height - true.height))),
        float(np.max(turned)),
        float(np.max(np.abs(velocity))),
    )


def to_earth(state: State, matrix: Array) -> Array:
    return np.asarray(np.swapaxes(state.C_e_w, 1, 2) @ matrix)


def test_an_hour_at_55_north_with_turns():
    legs = [{"duration": "100 s"}, {"repeat": 10, "legs": [*WEAVE, {"duration": "290 s"}]}]
    motion = Trajectory.of(from_table(SHIP | {"leg": legs}))
    assert motion.duration == 3600.0
    time, turns, pushes = motion.increments(200.0)
    path = integrate(motion.state(0.0), turns, pushes, np.diff(time), every=200 * 60)
    horizontal, height, attitude, velocity = errors(path.states, motion.state(path.time))
    assert horizontal < 0.05
    assert attitude < 1e-6 * DEG
    # measured: 0.02 mm, 6e-10 deg
    assert horizontal < 1e-3
    assert height < 1e-3
    assert velocity < 1e-6


# ---------------------------------------------------------------------------------------------------- increments


@carried
def test_more_nodes_change_nothing(name, unit):
    motion = trajectory(name, unit)
    few, many = motion.increments(20.0), replace(motion, nodes=28).increments(20.0)
    # 20 m/s in the longest panel: rounding 4e-15; 0.1 rad of turn
    np.testing.assert_allclose(few.pushes, many.pushes, rtol=0, atol=2e-13)
    np.testing.assert_allclose(few.turns, many.turns, rtol=0, atol=2e-15)


@carried
def test_increments_are_integrals_of_what_is_felt(name, unit):
    # Gauss' rule with eight points on every interval of 50 ms; legs begin where an interval does
    motion = trajectory(name, unit)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    time, turns, pushes = motion.increments(20.0)
    half = 0.5 * np.diff(time)[:, None]  # of the instants as they are: at 100 s they are rounded to 1e-14 s
    at = time[:-1, None] + half * (nodes + 1)
    force, rate = (v.reshape(*at.shape, 3) for v in motion.inputs(at.ravel()))
    np.testing.assert_allclose(pushes, np.einsum("nk,nki->ni", half * weights, force), rtol=0, atol=2e-13)
    np.testing.assert_allclose(turns, np.einsum("nk,nki->ni", half * weights, rate), rtol=0, atol=2e-15)


def test_a_leg_may_begin_within_an_interval():
    motion = trajectory("weave")
    odd = motion.increments(np.array([19.93, 20.04, 34.99, 35.0, 35.07]))
    parts = motion.increments(np.array([19.93, 20.0, 20.04, 34.99, 35.0, 35.07]))
    np.testing.assert_allclose(odd.turns[0], parts.turns[0] + parts.turns[1], rtol=0, atol=1e-16)
    np.testing.assert_allclose(odd.pushes[0], parts.pushes[0] + parts.pushes[1], rtol=0, atol=1e-14)
    # heading turns from 20 s on, clockwise, at 3 deg/s, with the Earth's and the transport rate: 1e-4 rad/s
    assert odd.turns[0, 2] == pytest.approx(-0.04 * 3 * DEG, abs=0.11 * 1e-4)


@given(
    cuts=st.lists(st.floats(0.0, 139.9), min_size=1, max_size=12, unique=True), name=st.sampled_from(["eased", "plane"])
)
def test_increments_of_parts_are_those_of_the_whole(cuts, name):
    motion = trajectory(name)
    edges = np.array([0.0, *sorted({c for c in cuts if c > 0.0}), 139.95])
    parts, whole = motion.increments(edges), motion.increments(edges[[0, -1]])
    np.testing.assert_allclose(parts.pushes.sum(axis=0), whole.pushes[0], rtol=0, atol=3e-12)
    np.testing.assert_allclose(parts.turns.sum(axis=0), whole.turns[0], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(parts.steps, np.diff(edges))


@pytest.mark.parametrize("piece", [1, 7, 64, 100_000])
def test_a_stream_is_the_whole_however_it_is_cut(piece):
    motion = trajectory("sway", "turned")
    whole, parts = motion.increments(10.0), list(motion.stream(10.0, piece))
    assert all(p.turns.shape[0] <= piece for p in parts)
    for name in ("turns", "pushes"):
        np.testing.assert_array_equal(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name))
    np.testing.assert_array_equal(np.concatenate([whole.time[:1], *(p.time[1:] for p in parts)]), whole.time)
    assert whole.time.size == 1001


def test_samples_far_apart_and_long_courses():
    # a day in one interval of each hour, in blocks: what the inputs of a straight great circle at the equator come to
    table = SHIP | {
        "latitude": "0 deg",
        "heading": "90 deg",
        "path": "great-circle",
        "height": "0 m",
        "leg": [{"duration": "24 h"}],
    }
    motion = Trajectory.of(from_table(table))
    time, turns, pushes = motion.increments(1 / 3600)
    assert time.size == 25
    rate = EARTH_RATE + 5.0 / A
    np.testing.assert_allclose(turns, np.tile([-3600 * rate, 0, 0], (24, 1)), rtol=0, atol=1e-11)  # body y points east
    down = normal_gravity(0.0) - 2 * EARTH_RATE * 5.0 - 25.0 / A
    np.testing.assert_allclose(pushes[:, 2], 3600 * down, rtol=1e-13)
    assert motion.state(86400.0).place[1] == pytest.approx(10 * DEG + 86400 * 5 / A, abs=1e-12)


def test_an_hour_of_fast_sway_in_little_memory():
    import tracemalloc

    table = SHIP | {"sway": {"roll": "1 deg", "roll_period": "0.4 s"}, "leg": [{"duration": "1 h"}]}
    motion = Trajectory.of(from_table(table))
    tracemalloc.start()
    total = sum(p.turns.sum(axis=0) for p in motion.stream(10.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.isfinite(total).all()
    assert peak < 150e6  # 57 000 panels of 0.06 s, 16 nodes each: all at once they would take 1 GB


def test_what_cannot_be_sampled():
    motion = trajectory("straight")
    with pytest.raises(ValueError, match="0.001 Hz in 100 s: no interval"):
        motion.increments(0.001)
    with pytest.raises(ValueError, match="instants must increase"):
        motion.increments(np.array([0.0, 2.0, 1.0]))
    with pytest.raises(ValueError, match=r"times from 0 s to 111 s; this course is known from -10 s to 110 s"):
        motion.inputs(np.array([0.0, 111.0]))
    with pytest.raises(ValueError, match="known from"):
        motion.state(math.nan)


# ------------------------------------------------------------------------------------------------------ instants


@carried
def test_instants_in_any_order(name, unit):
    motion, rng = trajectory(name, unit), np.random.default_rng(3)
    time = rng.uniform(-10, motion.duration + 10, 50)
    order = np.argsort(time)
    for found, expected in zip(motion.inputs(time), motion.inputs(time[order]), strict=True):
        np.testing.assert_array_equal(found[order], expected)
    state, single = motion.state(time.reshape(5, 10)), motion.state(float(time[13]))
    np.testing.assert_array_equal(state.C_b_w[1, 3], single.C_b_w)
    np.testing.assert_array_equal(state.velocity[1, 3], single.velocity)
    assert single.height.shape == ()


def test_between_two_legs_it_is_the_mean_of_both():
    motion, h = trajectory("weave"), 1e-9
    (before, at, after), _ = motion.inputs(np.array([35 - h, 35.0, 35 + h]))[::-1]
    np.testing.assert_allclose(at, 0.5 * (before + after), rtol=0, atol=1e-11)
    assert after[2] - before[2] == pytest.approx(6 * DEG, rel=1e-6)


@every
def test_velocity_and_attitude_do_not_step(name):
    motion = trajectory(name)
    breaks = motion.way.profile.breaks[1:-1]
    before, after = motion.state(breaks - 1e-9), motion.state(breaks + 1e-9)
    np.testing.assert_allclose(after.velocity, before.velocity, rtol=0, atol=1e-7)
    np.testing.assert_allclose(after.C_b_w, before.C_b_w, rtol=0, atol=1e-8)
    np.testing.assert_allclose(after.C_e_w, before.C_e_w, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["eased", "plane"])
def test_what_comes_in_smoothly_is_felt_without_a_step(name):
    motion = trajectory(name, "arm")
    breaks = motion.way.profile.breaks[1:-1]
    for before, after in zip(motion.inputs(breaks - 1e-8), motion.inputs(breaks + 1e-8), strict=True):
        np.testing.assert_allclose(after, before, rtol=0, atol=3e-6)


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


# ---------------------------------------------------------------------------------------------------- the kinds of number


def test_a_complex_step_gives_the_rates_of_all_angles():
    motion, time = trajectory("plane"), np.array([1.0, 21.0, 33.0, 61.5, 92.0, 111.0])
    shifted = angles(motion.course, motion.way, 9.8, time + 1e-30j)
    for exact, complex_ in zip(angles(motion.course, motion.way, 9.8, time), shifted, strict=True):
        np.testing.assert_allclose(complex_.angle.imag / 1e-30, exact.rate, rtol=1e-13, atol=1e-17)
    m = motion.way.profile.at(time + 1e-30j)
    real = motion.way.profile.at(time)
    for value, slope in (("speed", "acceleration"), ("heading", "turn"), ("turn", "turn_slope"), ("height", "climb")):
        np.testing.assert_allclose(getattr(m, value).imag / 1e-30, getattr(real, slope), rtol=1e-13, atol=1e-17)


def test_gravity_and_earth_rate_are_those_given():
    course = from_table(TABLES["straight"])
    plain, other = Trajectory.of(course), Trajectory.of(course, earth_rate=0.0, gravity_excess=0.5)
    (f1, w1), (f2, w2) = (m.inputs(np.array([50.0])) for m in (plain, other))
    # without the Earth's rotation there is no Coriolis acceleration: 2 w v is 7e-4 m/s^2
    np.testing.assert_allclose(f2 - f1, [[0, 0, 0.5]], atol=8e-4)
    assert np.linalg.norm(w1 - w2) == pytest.approx(EARTH_RATE, rel=1e-12)
