"""States: the same in w and in east, north, up."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.frames import attitude_matrix
from sagnac.navigate.state import State

ANGLE = st.floats(-3.1, 3.1)


@given(st.floats(-1.5, 1.5), ANGLE, ANGLE, ANGLE)
def test_what_goes_in_comes_out_whatever_the_wander_angle(latitude, longitude, wander, roll):
    velocity, angles = np.array([3.0, -4.0, 0.5]), (2.0, -0.3, roll)
    state = State.from_angles(latitude, longitude, 120.0, velocity, angles, wander)
    for found, expected in zip(state.place, (latitude, longitude, wander), strict=True):
        assert found == pytest.approx(expected, abs=1e-13)
    np.testing.assert_allclose(state.velocity_enu, velocity, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.angles, angles, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.C_b_n, attitude_matrix(*angles), rtol=0, atol=1e-12)
    assert state.height == 120.0


def test_vectors_in_w_are_seen_from_its_axes():
    """x_w at 90 deg from east points north: going north is going along x_w, and a nose to the north lies along it."""
    state = State.from_angles(0.5, 0.1, 0.0, np.array([0.0, 5.0, 1.0]), (0.0, 0.0, 0.0), 0.5 * np.pi)
    np.testing.assert_allclose(state.velocity, [5.0, 0.0, 1.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(state.C_b_w @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], rtol=0, atol=1e-15)


def test_angles_and_matrix_make_the_same_state():
    angles = (1.0, 0.2, -0.3)
    one = State.from_angles(0.5, 0.1, 7.0, np.array([1.0, 2.0, 3.0]), angles, 0.4)
    other = State.at(0.5, 0.1, 7.0, np.array([1.0, 2.0, 3.0]), attitude_matrix(*angles), 0.4)
    for name in ("C_b_w", "velocity", "C_e_w", "height"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_many_states_at_once():
    headings = np.linspace(0.1, 6.0, 5)
    some = [
        State.from_angles(0.2 * k, -0.5, 10.0 * k, np.array([1.0, k, 0.0]), (heading, 0.1, 0.2), 0.3 * k)
        for k, heading in enumerate(headings)
    ]
    many = State(*(np.stack([getattr(s, n) for s in some]) for n in ("C_b_w", "velocity", "C_e_w", "height")))
    np.testing.assert_allclose(many.angles[0], headings, rtol=0, atol=1e-13)
    np.testing.assert_allclose(many.place[0], 0.2 * np.arange(5), rtol=0, atol=1e-14)
    np.testing.assert_allclose(many.velocity_enu[:, 1], np.arange(5.0), rtol=0, atol=1e-14)
    assert many.C_b_n.shape == (5, 3, 3)
