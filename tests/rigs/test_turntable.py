"""The turntable against geometry, numerical derivatives and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sagnac.frames import rot_x, rot_y, rot_z
from sagnac.rigs.turntable import PERFECT, Site, TableErrors, attitude, averaging, inputs, mean_inputs, rate

SITE = Site(math.radians(45), 9.8061992, 7.292115e-5)
angle = st.floats(-7, 7)
small = st.floats(-0.05, 0.05)
settings = st.tuples(angle, angle, angle).map(np.array)
errors = st.builds(
    TableErrors, tilt=st.tuples(small, small), nonperpendicularity=st.tuples(small, small), zero=st.tuples(*[small] * 3)
)


@given(settings)
def test_attitude_of_a_perfect_table_is_three_turns(a):
    # outer about up, middle about the x it carries, inner about the y that carries: intrinsic Z X Y
    np.testing.assert_allclose(attitude(a), Rotation.from_euler("ZXY", a).as_matrix(), atol=2e-15)


@given(settings, errors)
def test_attitude_is_the_documented_product(a, e):
    o, m, i = a + np.array(e.zero)
    n1, n2 = e.nonperpendicularity
    product = rot_x(e.tilt[0]) @ rot_y(e.tilt[1]) @ rot_z(o) @ rot_y(n1) @ rot_x(m) @ rot_z(n2) @ rot_y(i)
    np.testing.assert_allclose(attitude(a, e), product, atol=2e-15)
    np.testing.assert_allclose(attitude(a, e) @ attitude(a, e).T, np.eye(3), atol=4e-15)


@given(settings, st.tuples(*[st.floats(-3, 3)] * 3).map(np.array), errors)
def test_rate_is_the_derivative_of_attitude(a, r, e):
    # C' = C [w x]; five-point central difference with h = 1e-3: truncation h^4 w^5 / 30 and rounding 1e-16 / h
    h = 1e-3
    c = [attitude(a + k * h * r, e) for k in (-2, -1, 1, 2)]
    derivative = (c[0] - 8 * c[1] + 8 * c[2] - c[3]) / (12 * h)
    w = attitude(a, e).T @ derivative
    measured = np.array([w[2, 1] - w[1, 2], w[0, 2] - w[2, 0], w[1, 0] - w[0, 1]]) / 2
    bound = np.abs(r).sum() ** 5 * h**4 / 10 + 1e-12
    np.testing.assert_allclose(rate(a, r, e), measured, rtol=0, atol=bound)


def test_inputs_at_rest():
    # level table: gravity reaction up, Earth rate north and up; on its head both change sign along y and z
    level, head = np.zeros(3), np.array([0, math.pi, 0])
    force, turn = inputs(np.array([level, head]), np.zeros((2, 3)), SITE)
    np.testing.assert_allclose(force, [[0, 0, SITE.gravity], [0, 0, -SITE.gravity]], atol=2e-15)
    north, up = 7.292115e-5 * math.cos(math.pi / 4), 7.292115e-5 * math.sin(math.pi / 4)
    np.testing.assert_allclose(turn, [[0, north, up], [0, -north, -up]], atol=1e-19)


@given(settings, errors)
def test_lengths_do_not_depend_on_attitude(a, e):
    force, turn = inputs(a[None], np.zeros((1, 3)), SITE, e)
    assert np.linalg.norm(force) == pytest.approx(SITE.gravity, rel=1e-14)
    assert np.linalg.norm(turn) == pytest.approx(7.292115e-5, rel=1e-14)


@given(st.floats(-6, 6), st.integers(1, 60))
def test_averaging_is_the_mean_of_evenly_spaced_turns(turned, count):
    # the mean of n unit vectors, turned by `turned` from one to the next, against the one in the middle
    phase = (np.arange(count) - (count - 1) / 2) * turned
    mean = np.exp(1j * phase).mean()
    assert averaging(turned, count) == pytest.approx(mean.real, abs=1e-12)
    assert mean.imag == pytest.approx(0, abs=1e-12)


def test_averaging_at_its_limits():
    assert averaging(0.0, 1000) == 1.0
    assert averaging(1.234, 1) == pytest.approx(1.0, abs=1e-15)
    assert averaging(1e-12, 10) == pytest.approx(1.0, abs=1e-15)
    # a whole turn leaves nothing, half a turn in many steps leaves 2 / pi (mean of a half sine)
    assert averaging(2 * math.pi / 360, 360) == pytest.approx(0, abs=1e-14)
    assert averaging(math.pi / 100_000, 100_000) == pytest.approx(2 / math.pi, abs=1e-9)


LETTERS = [("z", "x", "y"), ("z", "y", "x"), ("x", "z", "x"), ("y", "x", "z"), ("z", "x", "z")]


@given(settings, st.integers(0, 2), st.floats(-2, 2), st.integers(1, 200), st.floats(0.001, 0.1), errors)
@pytest.mark.parametrize("letters", LETTERS)
def test_mean_inputs_are_the_average_of_inputs(letters, a, axis, speed, count, interval, e):
    time = (np.arange(count) - (count - 1) / 2) * interval
    every = np.repeat(a[None], count, axis=0)
    every[:, axis] += speed * time
    rates = np.zeros((count, 3))
    rates[:, axis] = speed
    force, turn = ([math.fsum(column) / count for column in v.T] for v in inputs(every, rates, SITE, e, letters))
    left = averaging(np.array([speed * interval]), np.array([count]))
    mean = mean_inputs(a[None], rates[:1], left, SITE, e, letters)
    np.testing.assert_allclose(mean.force[0], force, rtol=0, atol=6e-14)  # angles up to 27 rad carry 4e-15
    # rounding of a rate of 2 rad/s
    np.testing.assert_allclose(mean.rate[0], turn, rtol=0, atol=8e-15)


@given(settings, st.integers(0, 2), st.floats(-2, 2), st.floats(-1, 1), errors)
@pytest.mark.parametrize("letters", LETTERS)
def test_derivatives_of_the_mean_inputs(letters, a, axis, speed, left, e):
    rates = np.where(np.arange(3) == axis, speed, 0.0)[None]
    x = np.array([0, 0, 0, *e.tilt, *e.nonperpendicularity])

    def at(v):
        moved = TableErrors((v[3], v[4]), (v[5], v[6]), e.zero)
        return mean_inputs(a[None] + v[:3], rates, np.array([left]), SITE, moved, letters)

    exact, h = at(x), 1e-5
    for k in range(7):
        step = np.where(np.arange(7) == k, h, 0.0)
        plus, minus = at(x + step), at(x - step)
        for name, size in (("force", 10.0), ("rate", 2.0), ("axis", 1.0)):
            slope = (getattr(plus, name) - getattr(minus, name)) / (2 * h)
            # truncation h^2 / 6 of functions with derivatives of their own size, rounding 1e-16 / h
            np.testing.assert_allclose(getattr(exact, f"d_{name}")[:, :, k], slope, rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("letters", LETTERS)
def test_letters_say_what_the_axes_turn_about(letters):
    a = np.array([0.3, -0.7, 1.1])
    expected = Rotation.from_euler("".join(letters).upper(), a).as_matrix()
    np.testing.assert_allclose(attitude(a, letters=letters), expected, atol=2e-15)


def test_a_perfect_table_is_the_default():
    assert TableErrors() == PERFECT
    a = np.array([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(attitude(a), attitude(a, PERFECT))


def test_tilt_is_about_east_and_north():
    # the outer axis of a table tilted about east by t leans to the south: its up is (0, -sin t, cos t)
    up = attitude(np.zeros(3), TableErrors(tilt=(0.01, 0.0)))[:, 2]
    np.testing.assert_allclose(up, [0, -math.sin(0.01), math.cos(0.01)], atol=1e-16)
    up = attitude(np.zeros(3), TableErrors(tilt=(0.0, 0.01)))[:, 2]
    np.testing.assert_allclose(up, [math.sin(0.01), 0, math.cos(0.01)], atol=1e-16)
