"""Trajectories against an independent way: forces, rates and increments of a vehicle and of units on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drives import DEG, E2, FIRST, SECOND, SHIP, TABLES, WEAVE, A, carried, every, trajectory
from hypothesis import given
from hypothesis import strategies as st

from sagnac.earth import EARTH_RATE, normal_gravity
from sagnac.frames import Array, rotation_vector
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import integrate
from sagnac.navigate.trajectory import Trajectory
from sagnac.navigate.trajectory.body import angles
from sagnac.navigate.trajectory.read import from_table

# ------------------------------------------------------------------------------------------- an independent way


def fixed(motion: Trajectory, time: Array) -> tuple[Array, Array]:
    """Earth-fixed position, relative to that at the first time, (n, 3), m, and C_b_e, (n, 3, 3), by latitude and longitude."""
    state = motion.state(time)
    up = state.C_e_w[:, 2]
    normal = A / np.sqrt(1 - E2 * up[:, 2] ** 2)
    place = (normal + state.height)[:, None] * up - (E2 * normal * up[:, 2])[:, None] * [0.0, 0.0, 1.0]
    return place - place[0], np.swapaxes(state.C_e_w, 1, 2) @ state.C_b_w


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
