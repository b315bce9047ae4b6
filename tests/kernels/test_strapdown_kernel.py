"""The strapdown kernel against its plain twin, against pure coning and sculling, and against itself in other pieces."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import plain_strapdown as plain
from sagnac.earth import EARTH_RATE, ELLIPSOID
from sagnac.kernels.strapdown import FULL, advance, trace
from sagnac.navigate.wander import direction_cosines

EARTH = np.array([*ELLIPSOID, EARTH_RATE, 2e-4])
SPACE = np.array([*ELLIPSOID[:2], 0.0, *ELLIPSOID[3:], 0.0, 0.0])  # neither gravity nor a turning Earth
NONE = np.empty(0)


def start(latitude=0.96, wander=0.3, velocity=(100.0, -50.0, 2.0), height=1000.0, width=FULL):
    state = np.zeros(width)
    state[:4] = np.array([0.1, -0.2, 0.7, 0.5]) / np.sqrt(0.79)
    state[4:7] = velocity
    state[7:16] = direction_cosines(latitude, 0.5, wander).ravel()
    state[16] = height
    return state


def rough(n, steps=None, seed=0):
    """Increments of a rough ride: as much turning and pushing as a unit of 100 Hz may see."""
    rng = np.random.default_rng(seed)
    turns = 0.05 * rng.standard_normal((n, 3))
    return turns, 0.01 * (rng.standard_normal((n, 3)) + [0.0, 0.0, 9.8]), np.full(n, 0.01) if steps is None else steps


def run(state, ride, samples=2, slaved=False, held=False, heights=NONE, constants=EARTH, function=advance):
    after, pushed = state.copy(), np.zeros(3)
    function(after, *ride, samples, slaved, held, heights, constants, pushed)
    return after, pushed


def gap(a, b):
    """Largest difference of two states, each part relative to its size; a quaternion and its negative are the same."""
    turned = plain.to_matrix(a[:4]) - plain.to_matrix(b[:4])
    scaled = (turned, (a - b)[4:7] / 100.0, (a - b)[7:16], (a - b)[16] / 1000.0, (a - b)[17:])
    return max(np.abs(part).max() for part in scaled if np.size(part))


# ------------------------------------------------------------------------------------------------- plain twin

GIVEN = 1000.0 + np.cumsum(np.random.default_rng(3).normal(0.0, 0.02, 203))
JITTERED = np.random.default_rng(5).uniform(0.006, 0.02, 203)


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
@pytest.mark.parametrize("slaved", [False, True])
@pytest.mark.parametrize("vertical", ["free", "held", "given"])
@pytest.mark.parametrize("steps", [None, JITTERED])
def test_kernel_equals_its_plain_twin(samples, slaved, vertical, steps):
    # 203 samples: every size of group leaves some over; 1e-12: rounding of a hundred groups
    ride = rough(203, steps)
    options = samples, slaved, vertical == "held", GIVEN if vertical == "given" else NONE
    ours, pushed = run(start(wander=0.0 if slaved else 0.3), ride, *options)
    twin, plain_pushed = run(start(wander=0.0 if slaved else 0.3), ride, *options, function=plain.advance)
    assert gap(ours, twin) < 1e-12
    np.testing.assert_allclose(pushed, plain_pushed, rtol=0, atol=1e-12)
    if vertical != "free":
        assert ours[16] == (GIVEN[-1] if vertical == "given" else 1000.0)


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.05, 0.24, 0.26, 0.8, 1.5])
def test_large_rotations_within_a_group_go_by_the_closed_form(size):
    """Up to half a turn in a group of two; at 0.25 in each sample the series hands over."""
    turns = np.tile([0.6, -0.48, 0.64], (2, 1)) * size
    ride = turns, np.tile([0.3, 0.1, -0.2], (2, 1)), np.full(2, 0.01)
    # the twin's 1 - sin(a) / a loses three digits at 0.1
    assert gap(run(start(), ride)[0], run(start(), ride, function=plain.advance)[0]) < 1e-13


def test_a_call_may_end_anywhere_within_a_group_of_one():
    ride = rough(50)
    whole, pushed = run(start(), ride, samples=1)
    for cut in range(2, 50):  # from 2 on: the very first sample needs the one after it
        state, total = start(), np.zeros(3)
        for part in (slice(0, cut), slice(cut, None)):
            advance(state, *(v[part] for v in ride), 1, False, False, NONE, EARTH, total)
        assert gap(state, whole) < 1e-14
        np.testing.assert_allclose(total, pushed, rtol=0, atol=1e-14)


@pytest.mark.parametrize("samples", [2, 3, 4])
def test_a_call_may_end_between_groups(samples):
    ride = rough(48)
    whole, _ = run(start(), ride, samples)
    state = start()
    for i in range(0, 48, samples):
        advance(state, *(v[i : i + samples] for v in ride), samples, False, False, NONE, EARTH, np.zeros(3))
    assert gap(state, whole) < 1e-14


def smooth(n, h):
    """A smooth ride at the rate 1/h: increments of rates and specific forces with sines of a few rad/s."""
    edges = np.arange(n + 1)[:, None] * h
    turns = 0.3 * np.diff(-np.cos(edges * [4.0, 3.0, 2.0] + [0.0, 1.0, 2.0]) / [4.0, 3.0, 2.0], axis=0)
    pushes = np.diff(-2.0 * np.cos(edges * [3.0, 5.0, 4.0]) / [3.0, 5.0, 4.0] + edges * [0.0, 0.0, 9.8], axis=0)
    return turns, pushes, np.full(n, h)


def parts(a, b):
    """Differences of attitude, velocity, and position."""
    turned = plain.to_matrix(a[:4]) - plain.to_matrix(b[:4])
    return np.array([np.abs(v).max() for v in (turned, (a - b)[4:7], (a - b)[7:17])])


@pytest.mark.parametrize("samples", [2, 3, 4])
def test_cutting_a_group_costs_no_order(samples):
    """What a cut within a group changes falls as the error does: with the fourth power of the step, position second."""

    def change(h):
        ride = smooth(24, h)
        state = start()
        for part in (slice(0, 13), slice(13, None)):
            advance(state, *(v[part] for v in ride), samples, False, False, NONE, EARTH, np.zeros(3))
        return parts(state, run(start(), ride, samples)[0])

    fine, coarse = change(0.01), change(0.02)
    assert (fine > 0).all()
    assert (coarse / fine > [11.0, 11.0, 3.5]).all()  # 16, 16 and 4 in the limit


def uneven(n, h):
    """The same ride in steps that differ by up to 1.9 times, which fill the same time whatever h is."""
    pattern = np.array([1.0, 1.8, 1.1, 0.95, 1.3, 1.7, 0.9, 1.25])
    steps = np.tile(pattern, n // 8) * h
    edges = np.concatenate([[0.0], np.cumsum(steps)])[:, None]
    turns = 0.3 * np.diff(-np.cos(edges * [4.0, 3.0, 2.0] + [0.0, 1.0, 2.0]) / [4.0, 3.0, 2.0], axis=0)
    pushes = np.diff(-2.0 * np.cos(edges * [3.0, 5.0, 4.0]) / [3.0, 5.0, 4.0] + edges * [0.0, 0.0, 9.8], axis=0)
    return turns, pushes, steps


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_uneven_steps_cost_no_order(samples):
    """Against the same ride in steps 16 times shorter: third order. The coefficients of even steps leave second."""
    truth = run(start(), uneven(3200, 0.01 / 16), 2)[0]
    coarse, fine = (parts(run(start(), uneven(n, h), samples)[0], truth) for n, h in ((200, 0.01), (400, 0.005)))
    assert coarse[0] < 1e-7  # with 2/3 or 1/12 it is 3 to 5e-7
    assert (coarse / fine > [7.0, 7.0, 3.3]).all()


def test_across_a_gap_each_sample_counts_as_a_constant_rate():
    """Rates that have nothing to do with each other: the exact rotation is the product of those of the samples."""
    turns = np.array([[0.02, 0.0, 0.0], [0.0, 0.03, 0.01], [0.0, 0.0, -0.02], [0.01, 0.01, 0.0]])
    state = start(velocity=(0.0, 0.0, 0.0))
    expected = plain.to_matrix(state[:4])
    for turn in turns:
        expected = expected @ plain.exponential(turn)
    ride = turns, np.zeros((4, 3)), np.array([0.01, 0.5, 0.01, 0.5])
    for samples in (2, 4):
        found = plain.to_matrix(run(state, ride, samples, constants=SPACE)[0][:4])
        assert np.abs(found - expected).max() < 3e-6  # a (a x b) / 12; linear rates across the gap would be off by 5e-3
    found = plain.to_matrix(run(state, ride, 1, constants=SPACE)[0][:4])
    assert np.abs(found - expected).max() < 1e-15


# ------------------------------------------------------------------------------------------- coning, sculling

HALF_ANGLE, FREQUENCY, RATE = np.radians(1.0), 2.0 * np.pi * 10.0, 200.0


def coning(n, h, half_angle=HALF_ANGLE, frequency=FREQUENCY):
    """Exact increments of coning about z: the rotation vector turns in the plane with a constant length."""
    edges = np.arange(n + 1) * h
    a, b = np.sin(half_angle), 1.0 - np.cos(half_angle)
    turns = np.stack([a * np.cos(frequency * edges), a * np.sin(frequency * edges), -b * frequency * edges], axis=1)
    return np.diff(turns, axis=0), np.zeros((n, 3)), np.full(n, h)


def coned(t, half_angle=HALF_ANGLE, frequency=FREQUENCY):
    s = np.sin(0.5 * half_angle)
    return np.array([s * np.cos(frequency * t), s * np.sin(frequency * t), 0.0, np.cos(0.5 * half_angle)])


def drift(samples, seconds=10.0, rate=RATE, **motion):
    """Residual drift about the cone's axis, rad/s."""
    n = round(seconds * rate)
    state = start(velocity=(0.0, 0.0, 0.0))
    state[:4] = coned(0.0, **motion)
    after, _ = run(state, coning(n, 1.0 / rate, **motion), samples, constants=SPACE)
    error = plain.to_matrix(after[:4]) @ plain.to_matrix(coned(n / rate, **motion)).T
    return 0.5 * (error[1, 0] - error[0, 1]) / seconds


RESIDUAL = {1: (4, 1 / 60), 2: (4, 1 / 60), 3: (6, 1 / 280), 4: (8, 1 / 1260)}
"""Order and factor: N! / (2^(N+1) 1 3 5 ... (2N+1)) with N = 2, 3, 4 samples in a group (Park et al. 1999, J. Guidance
22(1)); one with the sample before it has the factor of two: x / 2 - (2/3) sin x + (1/12) sin 2x = x^5 / 60 + ..."""


def bound(samples, half_angle, frequency, h):
    order, factor = RESIDUAL[samples]
    return half_angle**2 * frequency * (frequency * h) ** order * factor


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_residual_of_coning_is_that_of_theory(samples):
    # half angle so small that terms beyond its square do not show, 20 Hz at 200 Hz so that the residual is large
    motion = {"half_angle": 1e-4, "frequency": 2.0 * np.pi * 20.0}
    expected = bound(samples, 1e-4, motion["frequency"], 1.0 / RATE)
    found = [abs(drift(samples, 2.0, rate, **motion)) for rate in (RATE, 2 * RATE)]
    assert found[0] == pytest.approx(
        expected, rel=0.35
    )  # the next term of the series is (W h)^2 = 0.4 times some tenths
    assert np.log2(found[0] / found[1]) == pytest.approx(RESIDUAL[samples][0], abs=0.3)


def test_four_samples_leave_less_than_a_twentieth_of_a_degree_an_hour():
    """1 deg half angle, 10 Hz, sampled at 200 Hz. Without any coning term it would be b^2 W (W h)^2 / 12: 32 deg/h."""
    per_hour = [abs(np.degrees(drift(m))) * 3600.0 for m in (1, 2, 3, 4)]
    # the theory says 0.64, 0.64, 0.0136, 0.0003; the fourth power of the angle adds 0.001
    np.testing.assert_allclose(per_hour, [0.64, 0.64, 0.0136, 0.0003], atol=0.01)
    assert per_hour[3] < 0.05


def spread(i, j, motion=coning):
    """Rectified product of samples i and j of a group of coning: depends on j - i alone."""
    turns, *_ = motion(8, 1.0 / RATE)
    return np.cross(turns[i], turns[j])[2]


def test_four_samples_equal_the_optimal_concentrated_form_in_coning():
    """54/105, 92/105, 214/105 against the last sample (Ignagni 1996); ours are spread over both ends."""
    w = plain.weights(np.ones(4))
    ours = sum(w[i, j] * spread(i, j) for i, j in itertools.combinations(range(4), 2))
    theirs = (54 * spread(0, 3) + 92 * spread(1, 3) + 214 * spread(2, 3)) / 105
    assert ours == pytest.approx(theirs, rel=1e-9)


@pytest.mark.parametrize(("m", "n"), [(0, 1), (0, 2), (0, 3), (1, 2)])
def test_four_samples_are_exact_to_fifth_order(m, n):
    """Rates t^m about x and t^n about y: 1/2 of the integral of angle x rate over four steps of one."""
    edges = np.arange(5.0)
    x, y = np.diff(edges ** (m + 1)) / (m + 1), np.diff(edges ** (n + 1)) / (n + 1)
    w = plain.weights(np.ones(4))
    ours = sum(w[i, j] * (x[i] * y[j] - y[i] * x[j]) for i, j in itertools.combinations(range(4), 2))
    assert ours == pytest.approx(0.5 * (1 / (m + 1) - 1 / (n + 1)) * 4.0 ** (m + n + 2) / (m + n + 2), rel=1e-13)


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_residual_of_sculling_is_that_of_coning(samples):
    """Rocking about x and shaking along y in step: force along z, the same integral with one angle a velocity."""
    angle, shake, frequency, n = 1e-5, 0.5, 2.0 * np.pi * 20.0, 400
    h = 1.0 / RATE
    edges, zero = np.arange(n + 1) * h, np.zeros(n)
    turns = np.stack([np.diff(angle * np.cos(frequency * edges)), zero, zero], axis=1)
    pushes = np.stack([zero, np.diff(shake * np.sin(frequency * edges)), zero], axis=1)
    state = start(velocity=(0.0, 0.0, 0.0))
    state[:4] = np.sin(0.5 * angle), 0.0, 0.0, np.cos(0.5 * angle)
    flat = np.array([1e30, *SPACE[1:]])  # no curvature either
    after, _ = run(state, (turns, pushes, np.full(n, h)), samples, constants=flat)
    truth = 0.5 * angle * shake * frequency * n * h  # of sin(angle cos) shake frequency cos, to the square of the angle
    order, factor = RESIDUAL[samples]
    expected = angle * shake * frequency * n * h * (frequency * h) ** order * factor
    assert abs(after[6] - truth) == pytest.approx(expected, rel=0.35)


# ------------------------------------------------------------------------------------------------------ laws


@given(turned=st.floats(-3.1, 3.1), latitude=st.floats(-1.5, 1.5))
def test_turning_the_wander_angle_changes_nothing_else(turned, latitude):
    """A constant rotation about the vertical of all that is in w: Earth-fixed position, velocity and attitude stay."""
    ride = rough(40, seed=1)
    c, s = np.cos(turned), np.sin(turned)
    to_new = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    first = start(latitude, 0.3)
    second = first.copy()
    second[:4] = plain.to_quaternion(to_new @ plain.to_matrix(first[:4]))
    second[4:7] = to_new @ first[4:7]
    second[7:16] = (to_new @ first[7:16].reshape(3, 3)).ravel()
    after = [run(state, ride)[0] for state in (first, second)]
    there = [state[7:16].reshape(3, 3).T for state in after]  # C_w_e
    for column in (there[0] @ after[0][4:7] - there[1] @ after[1][4:7], there[0][:, 2] - there[1][:, 2]):
        assert np.abs(column).max() < 1e-12
    bodies = [C_w_e @ plain.to_matrix(state[:4]) for C_w_e, state in zip(there, after, strict=True)]
    np.testing.assert_allclose(*bodies, rtol=0, atol=1e-13)
    assert after[0][16] == pytest.approx(after[1][16], abs=1e-9)


def test_rotations_stay_rotations():
    """A million groups at 250 m/s and 3 rad/s: 2.8 h at 200 Hz."""
    n = 2_000_000
    ride = np.tile([0.005, -0.01, 0.01], (n, 1)), np.tile([0.0, 0.0, 0.049], (n, 1)), np.full(n, 0.005)
    after, _ = run(start(velocity=(250.0, 0.0, 0.0)), ride, held=True)
    M = after[7:16].reshape(3, 3)
    assert np.abs(M @ M.T - np.eye(3)).max() < 1e-15
    assert np.linalg.det(M) == pytest.approx(1.0, abs=1e-15)
    assert np.linalg.norm(after[:4]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("width", [17, FULL])
def test_trace_keeps_what_advance_leaves(width):
    ride = rough(25)
    rows, clock, state = np.empty((3, 1 + width)), np.array([5.0]), start(width=width)
    options = 2, False, False, NONE, EARTH
    trace(state, *ride, *options, np.zeros(3), 8, 2, clock, rows)  # 2 since the last: kept after 6, 14, 22
    again = start(width=width)
    for row, part in zip(rows, (slice(0, 6), slice(6, 14), slice(14, 22)), strict=True):
        advance(again, *(v[part] for v in ride), *options, np.zeros(3))
        assert row[0] == pytest.approx(5.0 + part.stop * 0.01, abs=1e-13)
        np.testing.assert_array_equal(row[1:], again)
    assert clock[0] == pytest.approx(5.25, abs=1e-13)
    advance(again, *(v[22:] for v in ride), *options, np.zeros(3))
    np.testing.assert_array_equal(state, again)


def test_no_samples_change_nothing():
    state = start()
    after, pushed = run(state, rough(0))
    assert gap(after, state) < 1e-15
    assert not pushed.any()


def test_north_slaved_says_how_far_its_axes_turned():
    """100 m from the pole at 250 m/s eastward: v / d = 2.5 rad/s."""
    state = start(latitude=0.5 * np.pi - 100.0 / 6.4e6, wander=0.0, velocity=(250.0, 0.0, 0.0))
    ride = np.zeros((2, 3)), np.zeros((2, 3)), np.full(2, 0.01)
    numbers = state.copy(), *ride, 2, True, False, NONE, EARTH, np.zeros(3)
    assert advance(*numbers) == pytest.approx(0.05, rel=0.01)
    assert advance(state.copy(), *ride, 2, False, False, NONE, EARTH, np.zeros(3)) == 0.0
