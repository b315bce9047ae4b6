"""Ideal sensors must integrate to the truth; what a navigator does with its samples; increments from samples."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from exact_motion import Motion, Wave
from hypothesis import given
from hypothesis import strategies as st

import plain_strapdown as plain
from sagnac.earth import EARTH_RATE, ELLIPSOID, normal_gravity
from sagnac.errors import DataError, InputError
from sagnac.frames import rot_y, rotation_matrix
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import Navigator, increments, integrate, integrate_pieces, pack, unpack
from sagnac.navigate.wander import to_enu

R = 6.37e6
DEG = np.pi / 180.0

# An hour at 55 N: 5 m/s to the north-east with turns (circles of 100 m, heading at up to 4 deg/s) in a seaway.
COURSE = Motion(
    latitude=Wave(55 * DEG, 3.0 / R, ((100.0 / R, 0.02, 0.0),)),
    longitude=Wave(0.2, 4.0 / R / 0.57, ((80.0 / R / 0.57, 0.03, 1.0),)),
    height=Wave(20.0, 0.0, ((2.0, 0.1, 0.0),)),
    heading=Wave(1.0, 0.002, ((1.5, 0.05, 0.0), (0.02, 0.7, 1.0))),
    pitch=Wave(0.02, 0.0, ((0.05, 0.6, 0.0),)),
    roll=Wave(0.0, 0.0, ((0.1, 0.5, 2.0),)),
)


@pytest.fixture(scope="module")
def hour():
    return list(COURSE.pieces(3600.0, 200.0))


@pytest.fixture(scope="module")
def minute():
    return COURSE.samples(60.0, 100.0)


# ------------------------------------------------------------------------------------------------- zero tests


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_an_hour_of_ideal_samples_integrates_to_the_truth(hour, samples):
    navigator = Navigator(COURSE.state(0.0, wander=0.7), samples=samples)
    for piece in hour:
        navigator.advance(*piece)
    horizontal, height, velocity, attitude = COURSE.errors(navigator.state, 3600.0)
    assert horizontal < 0.05
    assert attitude < 1e-6 * DEG
    # measured: 0.2 mm and 6e-10 deg with one sample, less with more; a free height grows by cosh(3600 s / 570 s) = 280
    assert horizontal < 1e-3
    assert height < 5e-3
    assert velocity < 5e-6


SWAY = Motion(
    latitude=Wave(0.5),
    longitude=Wave(0.0),
    pitch=Wave(0.0, 0.0, ((5 * DEG, 6.0, 0.0),)),
    roll=Wave(0.0, 0.0, ((10 * DEG, 6.0, 0.0),)),
)


@pytest.mark.parametrize("samples", [1, 2])
def test_height_holds_under_large_fast_sway(samples):
    """Roll by 10 deg and pitch by 5 deg at 6 rad/s, 100 Hz, 600 s."""
    navigator = Navigator(SWAY.state(0.0), samples=samples)
    navigator.advance(*SWAY.samples(600.0, 100.0))
    assert SWAY.errors(navigator.state, 600.0)[1] < 0.05


def test_without_the_second_order_rotation_term_height_is_tens_of_metres_off():
    """(1/6) a x (a x u) left out of the plain twin, T = 0.02 s: in the mean g <(w T)^2> / 6 of acceleration is lost."""
    state, pushed = pack(SWAY.state(0.0)), np.zeros(3)
    constants = np.array([*ELLIPSOID, EARTH_RATE, 0.0])
    ride = SWAY.samples(600.0, 100.0)
    plain.advance(state, *ride, 2, False, False, np.empty(0), constants, pushed, second=False)
    mean_square = 0.5 * ((10 * DEG) ** 2 + (5 * DEG) ** 2) * 6.0**2
    missing = normal_gravity(0.5) * mean_square * 0.02**2 / 6.0
    stiffness = 3.08e-6  # of gravity with height, 1/s^2: makes a free height grow
    grown = missing / stiffness * (np.cosh(600.0 * np.sqrt(stiffness)) - 1.0)
    assert 80.0 < SWAY.errors(unpack(state), 600.0)[1] < 100.0
    assert SWAY.errors(unpack(state), 600.0)[1] == pytest.approx(grown, rel=0.02)


def polar(distance):
    """250 m/s on a great circle at 10 km height that comes within a distance of the pole after 10 minutes."""
    radius = 6.4e6 + 1e4  # of curvature at the pole
    return Motion(
        latitude=Wave(0.0),
        longitude=Wave(-600.0 * 250.0 / radius, 250.0 / radius),
        height=Wave(1e4),
        heading=Wave(0.5 * np.pi),
        roll=Wave(0.0, 0.0, ((0.02, 0.3, 0.0),)),
        tilt=tuple(map(tuple, rot_y(-0.5 * np.pi + distance / radius))),
    )


def flown(distance, **settings):
    motion = polar(distance)
    path = integrate_pieces(motion.state(0.0, wander=0.3), motion.pieces(1200.0, 100.0), every=60000, **settings)
    closest = np.arccos(min(motion.at(np.array([600.0]))[0][0, 2], 1.0)) * 6.41e6
    assert closest == pytest.approx(distance, abs=0.02 * distance + 1e-6)
    last = State(*(getattr(path.states, name)[-1] for name in ("C_b_w", "velocity", "C_e_w", "height")))
    return motion.errors(last, 1200.0)


@pytest.mark.parametrize("distance", [1e5, 1e4, 1e3, 100.0, 1.0, 0.0])
def test_the_wander_frame_crosses_the_pole(distance):
    horizontal, height, velocity, attitude = flown(distance)
    assert horizontal < 1.0
    # measured: a micrometre at every distance
    assert horizontal < 1e-4
    assert height < 1e-4
    assert velocity < 1e-6
    assert attitude < 1e-9


def test_north_slaved_axes_lose_their_way_near_the_pole():
    """The error grows faster and faster with how far the axes turn in a group; where it is metres they are refused."""
    far, near, nearer = (flown(distance, frame="north")[0] for distance in (1e5, 1e4, 1e3))
    assert far < 1e-3
    assert far < near < nearer
    assert 0.01 < nearer < 1.0  # 0.05 m here, in groups of two at 100 Hz; 40 000 times that of the wander frame
    for distance in (100.0, 10.0, 1.0):
        with pytest.raises(DataError, match="too near a pole .* use the wander frame"):
            flown(distance, frame="north")


CLIMB = Motion(
    latitude=Wave(-0.9, 5.0 / R, ((50.0 / R, 0.02, 0.0),)),
    longitude=Wave(3.1, 6.0 / R),
    height=Wave(100.0, 1.0, ((20.0, 0.2, 0.0),)),
    heading=Wave(1.0, 0.01, ((0.3, 0.1, 0.0),)),
    pitch=Wave(0.0, 0.0, ((0.05, 0.6, 0.0),)),
)


def test_given_heights_replace_the_vertical_channel():
    ride, heights = CLIMB.samples(300.0, 100.0), CLIMB.height(np.arange(1, 30001) / 100.0)[0]
    navigator = Navigator(CLIMB.state(0.0), vertical="free")
    navigator.advance(*ride, heights)
    horizontal, height, velocity, _ = CLIMB.errors(navigator.state, 300.0)
    assert horizontal < 1e-4
    assert height == 0.0
    assert velocity < 0.01  # difference quotient: half a step late, 0.8 m/s^2 over 0.01 s


def test_a_held_height_stays():
    level = Motion(CLIMB.latitude, CLIMB.longitude, Wave(100.0), CLIMB.heading, CLIMB.pitch)
    navigator = Navigator(level.state(0.0), vertical="held", gravity_excess=0.1)
    navigator.advance(*level.samples(300.0, 100.0))
    assert level.errors(navigator.state, 300.0)[0] < 1e-4
    assert navigator.state.height == 100.0
    assert navigator.state.velocity[2] == 0.0


@pytest.mark.parametrize("latitude", [0.0, 1.2, -0.7])
def test_gravity_is_normal_gravity_plus_the_excess(latitude):
    """At rest on an Earth that does not turn the specific force holds the unit up for as long as one likes."""
    state = State.from_angles(latitude, 0.1, 500.0, np.zeros(3), (0.3, 0.0, 0.0))
    navigator = Navigator(state, earth_rate=0.0, gravity_excess=3e-4)
    g = normal_gravity(latitude, 500.0) + 3e-4
    navigator.advance(np.zeros((1000, 3)), np.tile([0.0, 0.0, g * 0.01], (1000, 1)), 0.01)
    assert navigator.state.height == pytest.approx(500.0, abs=1e-11)
    assert np.abs(navigator.state.velocity).max() < 1e-12
    np.testing.assert_allclose(navigator.pushed, [0.0, 0.0, 10.0 * g], rtol=1e-12, atol=1e-12)


# -------------------------------------------------------------------------------------------------- navigator


def test_steps_one_by_one_are_groups_of_one(minute):
    turns, pushes, steps = (v[:500] for v in minute)
    start = COURSE.state(0.0)
    single, whole = Navigator(start), Navigator(start, samples=1)
    for turn, push, step in zip(turns, pushes, steps, strict=True):
        single.step(turn, push, step)
    whole.advance(turns, pushes, steps)
    # but for the very first sample, for which a single step knows no other: its coning term is 1e-9 rad here
    np.testing.assert_allclose(single.state.C_b_w, whole.state.C_b_w, rtol=0, atol=1e-8)
    np.testing.assert_allclose(single.state.velocity, whole.state.velocity, rtol=0, atol=1e-6)


@given(cuts=st.lists(st.integers(2, 198), max_size=6))
def test_cutting_calls_of_single_samples_changes_nothing(cuts):
    ride = CUT
    whole, pieces = Navigator(COURSE.state(0.0), samples=1), Navigator(COURSE.state(0.0), samples=1)
    whole.advance(*ride)
    edges = [0, *sorted(cuts), 200]
    for a, b in itertools.pairwise(edges):
        pieces.advance(*(v[a:b] for v in ride))
    np.testing.assert_allclose(pieces.numbers, whole.numbers, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(pieces.pushed, whole.pushed, rtol=1e-13)


CUT = COURSE.samples(2.0, 100.0)


def test_cutting_a_group_changes_little(minute):
    """A cut in a group of four leaves two smaller groups: one group in 1500 is of a lower order."""
    whole, cut = Navigator(COURSE.state(0.0), samples=4), Navigator(COURSE.state(0.0), samples=4)
    whole.advance(*minute)
    for part in (slice(0, 3001), slice(3001, None)):
        cut.advance(*(v[part] for v in minute))
    np.testing.assert_allclose(cut.state.C_b_w, whole.state.C_b_w, rtol=0, atol=1e-9)
    np.testing.assert_allclose(cut.state.velocity, whole.state.velocity, rtol=0, atol=1e-7)


@given(turned=st.floats(-3.1, 3.1))
def test_the_wander_angle_at_the_start_makes_no_difference(turned):
    ride = CUT
    paths = [Navigator(COURSE.state(0.0, wander=angle)) for angle in (0.0, turned)]
    for navigator in paths:
        navigator.advance(*ride)
    one, other = (navigator.state for navigator in paths)
    for a, b in zip((*one.place[:2], *one.angles), (*other.place[:2], *other.angles), strict=True):
        assert a == pytest.approx(b, abs=1e-12)
    np.testing.assert_allclose(one.velocity_enu, other.velocity_enu, rtol=0, atol=1e-11)


def test_north_keeps_x_east(minute):
    navigator = Navigator(COURSE.state(0.0, wander=1.0), frame="north")
    assert navigator.state.place[2] == pytest.approx(0.0, abs=1e-15)
    navigator.advance(*minute)
    assert navigator.state.place[2] == pytest.approx(0.0, abs=1e-12)
    assert COURSE.errors(navigator.state, 60.0)[0] < 1e-4
    wander = Navigator(COURSE.state(0.0, wander=1.0))
    wander.advance(*minute)
    assert abs(wander.state.place[2] - 1.0) > 1e-5  # 240 m to the east at 55 N


def test_corrections_take_errors_out():
    truth = COURSE.state(0.0, wander=0.4)
    phi, dv, theta, dh = np.array([2e-2, -1e-2, 3e-2]), np.array([0.3, -0.2, 0.1]), np.array([1e-5, 2e-5, -3e-4]), 7.0
    wrong = State(
        rotation_matrix(-phi) @ truth.C_b_w,
        truth.velocity + dv,
        rotation_matrix(-theta) @ truth.C_e_w,
        truth.height + dh,
    )
    navigator = Navigator(wrong)
    navigator.correct(attitude=phi, velocity=dv, position=theta, height=dh)
    for name in ("C_b_w", "velocity", "C_e_w", "height"):
        np.testing.assert_allclose(getattr(navigator.state, name), getattr(truth, name), rtol=0, atol=1e-13)


def test_a_correction_of_two_velocities_leaves_the_third():
    navigator = Navigator(COURSE.state(0.0))
    before = navigator.state.velocity
    navigator.correct(velocity=[1.0, 2.0])
    np.testing.assert_allclose(navigator.state.velocity, before - [1.0, 2.0, 0.0], rtol=0, atol=1e-15)


def test_a_north_slaved_system_stays_so_when_its_position_is_corrected():
    navigator, theta = Navigator(COURSE.state(0.0), frame="north"), np.array([1e-4, 2e-4, 5e-3])
    expected = navigator.state
    navigator.correct(position=theta)
    state = navigator.state
    np.testing.assert_allclose(state.C_e_w[2], (rotation_matrix(theta) @ expected.C_e_w)[2], rtol=0, atol=1e-15)
    assert state.place[2] == pytest.approx(0.0, abs=1e-15)
    # velocity and attitude in w go along with the axes
    turned = to_enu(expected.place[2] + np.arctan2(*(rotation_matrix(theta) @ expected.C_e_w)[:2, 2]))
    np.testing.assert_allclose(state.velocity, turned @ expected.velocity, rtol=0, atol=1e-12)


def test_pushed_is_the_velocity_gained_from_the_specific_force(minute):
    navigator = Navigator(COURSE.state(0.0), earth_rate=EARTH_RATE)
    navigator.advance(*minute)
    assert navigator.pushed[2] == pytest.approx(normal_gravity(55 * DEG, 20.0) * 60.0, rel=1e-3)
    navigator.pushed[:] = 0.0
    navigator.step([0.0, 0.0, 0.0], navigator.state.C_b_w.T @ [0.1, 0.2, 0.3], 0.01)
    np.testing.assert_allclose(navigator.pushed, [0.1, 0.2, 0.3], rtol=0, atol=1e-4)


def test_the_state_that_is_given_out_is_a_copy(minute):
    navigator = Navigator(COURSE.state(0.0))
    first = navigator.state
    velocity = first.velocity.copy()
    navigator.advance(*minute)
    np.testing.assert_array_equal(first.velocity, velocity)
    assert not np.array_equal(navigator.state.velocity, velocity)


# -------------------------------------------------------------------------------------------------- integrate


def test_integrate_keeps_every_kth_state_and_the_last(minute):
    path = integrate(COURSE.state(0.0), *minute, every=400, start=100.0)
    np.testing.assert_allclose(path.time, 100.0 + np.arange(16) * 4.0, rtol=0, atol=1e-9)
    path = integrate(COURSE.state(0.0), *(v[:1000] for v in minute), every=400)
    np.testing.assert_allclose(path.time, [0.0, 4.0, 8.0, 10.0], rtol=0, atol=1e-11)
    assert path.states.C_b_w.shape == (4, 3, 3)
    assert path.states.height.shape == (4,)
    navigator = Navigator(COURSE.state(0.0))
    for k, stop in enumerate((400, 800, 1000)):
        navigator.advance(*(v[400 * k : stop] for v in minute))
        np.testing.assert_allclose(path.states.C_b_w[k + 1], navigator.state.C_b_w, rtol=0, atol=1e-15)
        np.testing.assert_allclose(path.states.C_e_w[k + 1], navigator.state.C_e_w, rtol=0, atol=1e-15)
        np.testing.assert_allclose(path.states.velocity[k + 1], navigator.state.velocity, rtol=0, atol=1e-14)
        assert path.states.height[k + 1] == navigator.state.height


def test_pieces_make_no_difference(minute):
    whole = integrate(COURSE.state(0.0), *minute, every=500, samples=1)
    edges = [0, 7, 500, 501, 1720, 3000, 6000]
    pieces = ([v[a:b] for v in minute] for a, b in itertools.pairwise(edges))
    parts = integrate_pieces(COURSE.state(0.0), pieces, every=500, samples=1)
    np.testing.assert_allclose(parts.time, whole.time, rtol=1e-12)
    for name in ("C_b_w", "velocity", "C_e_w", "height"):
        np.testing.assert_allclose(getattr(parts.states, name), getattr(whole.states, name), rtol=0, atol=1e-12)


def test_a_path_has_the_truth_all_along(minute):
    path = integrate(COURSE.state(0.0), *minute, every=1000)
    for k, time in enumerate(path.time):
        state = State(path.states.C_b_w[k], path.states.velocity[k], path.states.C_e_w[k], path.states.height[k])
        assert COURSE.errors(state, time)[0] < 1e-4


def test_integrate_takes_heights_and_settings():
    ride, heights = CLIMB.samples(20.0, 100.0), CLIMB.height(np.arange(1, 2001) / 100.0)[0]
    path = integrate(CLIMB.state(0.0), *ride, every=1000, heights=heights, frame="north", gravity_excess=1.0)
    np.testing.assert_array_equal(path.states.height[1:], heights[[999, 1999]])


def test_one_step_for_all_samples():
    turns, pushes, steps = CUT
    one, other = Navigator(COURSE.state(0.0)), Navigator(COURSE.state(0.0))
    one.advance(turns, pushes, 0.01)
    other.advance(turns, pushes, np.full(steps.size, 0.01))
    np.testing.assert_array_equal(one.numbers, other.numbers)


def test_pack_and_unpack_are_inverse():
    state = COURSE.state(5.0, wander=-2.0)
    again = unpack(pack(state))
    for name in ("C_b_w", "velocity", "C_e_w", "height"):
        np.testing.assert_allclose(getattr(again, name), getattr(state, name), rtol=0, atol=1e-14)
    assert unpack(np.tile(pack(state), (2, 5, 1))).C_b_w.shape == (2, 5, 3, 3)


# ------------------------------------------------------------------------------------------------- increments

POLYNOMIAL = np.array([[1.0, -2.0, 0.5], [0.3, 0.2, -0.1], [-0.4, 0.1, 0.2], [0.2, 0.3, -0.5]])  # up to cubic


def cubic(t):
    return np.vander(t, 4, increasing=True) @ POLYNOMIAL


def cubic_integral(t):
    return (np.vander(t, 5, increasing=True)[:, 1:] / np.arange(1, 5)) @ POLYNOMIAL


def test_four_point_rule_in_even_steps():
    """dt (-f_-1 + 13 f_0 + 13 f_1 - f_2) / 24 inside, the trapezoid at the ends."""
    time, values = np.arange(6) * 0.1, np.random.default_rng(0).standard_normal((6, 3))
    steps, turns, pushes = increments(time, values, -values)
    inside = 0.1 * (-values[:-3] + 13.0 * values[1:-2] + 13.0 * values[2:-1] - values[3:]) / 24.0
    ends = 0.05 * (values[[0, 4]] + values[[1, 5]])
    np.testing.assert_allclose(turns[1:4], inside, rtol=0, atol=1e-15)
    np.testing.assert_allclose(turns[[0, 4]], ends, rtol=0, atol=1e-15)
    np.testing.assert_allclose(pushes, -turns, rtol=0, atol=1e-15)
    np.testing.assert_allclose(steps, 0.1, rtol=1e-12)


@given(st.lists(st.floats(0.08, 0.12), min_size=3, max_size=12))
def test_cubics_are_integrated_exactly_in_any_steps(steps):
    time = np.concatenate([[0.2], 0.2 + np.cumsum(steps)])
    _, turns, _ = increments(time, cubic(time), cubic(time))
    np.testing.assert_allclose(turns[1:-1], np.diff(cubic_integral(time), axis=0)[1:-1], rtol=0, atol=1e-14)


def test_gaps_and_their_neighbours_have_the_trapezoid():
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.6, 0.7, 0.8, 0.9, 1.0])
    values = cubic(time)
    _, turns, _ = increments(time, values, values)
    trapezoid = 0.5 * np.diff(time)[:, None] * (values[1:] + values[:-1])
    straight = np.abs(turns - trapezoid).max(axis=1) < 1e-16
    assert straight.tolist() == [True, False, True, True, True, False, False, True]


def test_means_belong_to_the_interval_before():
    time, values = np.array([0.0, 0.1, 0.3]), np.arange(9.0).reshape(3, 3)
    steps, turns, pushes = increments(time, values, 2.0 * values, "mean")
    np.testing.assert_allclose(steps, [0.1, 0.2])
    np.testing.assert_allclose(turns, values[1:] * np.array([[0.1], [0.2]]))
    np.testing.assert_allclose(pushes, 2.0 * turns)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_few_samples_will_do(count):
    time = np.arange(count) * 0.1
    line = np.stack([time, 1.0 - time, 0.0 * time], axis=1)
    _, turns, _ = increments(time, line, line)
    exact = np.stack([0.5 * time**2, time - 0.5 * time**2, 0.0 * time], axis=1)
    np.testing.assert_allclose(turns, np.diff(exact, axis=0), rtol=0, atol=1e-16)


def test_instantaneous_samples_navigate_nearly_as_well():
    """An hour of the ship would be 720 000 samples; ten minutes of them leave centimetres, the trapezoid metres."""
    time = np.arange(60001) / 100.0
    *_, force, rate = COURSE.at(time)
    steps, turns, pushes = increments(time, rate, force)
    navigator = Navigator(COURSE.state(0.0), vertical="free")
    navigator.advance(turns, pushes, steps)
    horizontal, _, _, attitude = COURSE.errors(navigator.state, 600.0)
    assert horizontal < 0.05
    assert attitude < 1e-4 * DEG


# ---------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"samples": 5}, "1 to 4; not 5"),
        ({"samples": 0}, "1 to 4; not 0"),
        ({"frame": "geographic"}, "'wander' or 'north', not 'geographic'"),
        ({"vertical": "given"}, "'free' or 'held' .*, not 'given'"),
    ],
)
def test_settings_that_do_not_exist_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Navigator(COURSE.state(0.0), **settings)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"turns": np.zeros((3, 2))}, r"these are \(3, 2\), \(3, 3\) and \(3,\)"),
        ({"pushes": np.zeros((4, 3))}, r"\(4, 3\)"),
        ({"steps": np.array([0.1, 0.1])}, r"\(2,\)"),
        ({"steps": np.array([0.1, 0.0, 0.1])}, "sample 2 is 0 s"),
        ({"steps": np.array([0.1, np.nan, 0.1])}, "sample 2 is nan s"),
        ({"heights": np.zeros(2)}, r"3 samples need as many heights; these are \(2,\)"),
    ],
)
def test_samples_that_do_not_fit_are_refused(change, message):
    ride = {"turns": np.zeros((3, 3)), "pushes": np.zeros((3, 3)), "steps": 0.1, "heights": None} | change
    with pytest.raises(InputError, match=message):
        Navigator(COURSE.state(0.0)).advance(**ride)


@pytest.mark.parametrize("frame", ["wander", "north"])
def test_samples_that_are_no_numbers_are_found_out(frame):
    turns = np.zeros((3, 3))
    turns[1, 2] = np.nan
    with pytest.raises(DataError, match="no longer numbers"):
        Navigator(COURSE.state(0.0), frame=frame).advance(turns, np.zeros((3, 3)), 0.01)


@pytest.mark.parametrize(
    ("time", "gyro", "meaning", "message"),
    [
        ([0.0, 0.1, 0.1, 0.3], (4, 3), "instant", r"sample 2 \(0.1 s\) to the next \(0.1 s\)"),
        ([0.0, 0.1, np.nan, 0.3], (4, 3), "instant", "does not increase from sample 2"),
        ([0.0, 0.1, 0.2], (4, 3), "instant", r"\(3,\), \(4, 3\) and \(4, 3\)"),
        ([0.0], (1, 3), "instant", "n > 1"),
        ([0.0, 0.1], (2, 3), "average", "'instant' .* or 'mean' .*, not 'average'"),
    ],
)
def test_samples_that_make_no_increments_are_refused(time, gyro, meaning, message):
    with pytest.raises(InputError, match=message):
        increments(np.array(time), np.zeros(gyro), np.zeros(gyro), meaning)


@pytest.mark.parametrize("step", [0.0, -0.01, np.nan])
def test_a_step_takes_time(step):
    with pytest.raises(InputError, match="above zero, not"):
        Navigator(COURSE.state(0.0)).step(np.zeros(3), np.zeros(3), step)


def test_a_step_too_near_a_pole_is_refused_in_north():
    state = State.from_angles(0.5 * np.pi - 10.0 / R, 0.0, 0.0, np.array([250.0, 0.0, 0.0]), (0.0, 0.0, 0.0))
    with pytest.raises(DataError, match="its axes turned by 1[34] deg in one group"):
        Navigator(state, frame="north").step(np.zeros(3), np.zeros(3), 0.01)


def test_a_start_at_the_pole_itself_is_refused_in_north():
    state = State(np.eye(3), np.array([1.0, 0.0, 0.0]), np.eye(3), np.array(0.0))
    with pytest.raises(DataError, match="use the wander frame at a pole"):
        Navigator(state, frame="north").advance(np.zeros((2, 3)), np.zeros((2, 3)), 0.01)


def test_a_path_needs_a_stride():
    with pytest.raises(InputError, match="1 or more; not 0"):
        integrate(COURSE.state(0.0), np.zeros((1, 3)), np.zeros((1, 3)), 0.1, every=0)
