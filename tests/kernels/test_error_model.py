"""The system matrix against the nonlinear mechanisation, entry by entry."""

from __future__ import annotations

import mechanisation
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sagnac.align import model
from sagnac.earth import EARTH_RATE, ELLIPSOID
from sagnac.frames import rotation_vector
from sagnac.kernels.error_model import system
from sagnac.kernels.kalman import transition
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import Navigator

FORMS = [(m, full) for m in ("wander", "geographic") for full in (False, True)]


def matrix(state, force, layout):
    n = len(layout)
    F = np.zeros((n, n))
    system(
        state.C_b_w,
        state.velocity,
        state.C_e_w[:, 2].copy(),
        float(state.height),
        state.C_b_w @ force,
        EARTH_RATE,
        ELLIPSOID,
        layout.at,
        F,
    )
    return F


def agree(F, expected, latitude, relative=1e-9):
    # entries that cancel exactly leave rounding behind: of the largest term of their row, or of the rate of a frame on north
    row = np.abs(expected).max(axis=1, keepdims=True) + 1e-5 / np.cos(latitude) ** 2
    assert np.abs(F - expected).max() <= relative * np.abs(expected).max()
    assert np.all(np.abs(F - expected) <= relative * np.abs(expected) + 1e-14 * row)


@pytest.mark.parametrize(("method", "full"), FORMS)
@settings(max_examples=40, deadline=None)
@given(
    latitude=st.floats(-1.5, 1.5),
    wander_angle=st.floats(-3.1, 3.1),
    angles=st.tuples(*[st.floats(-1.4, 1.4)] * 3),
    velocity=st.tuples(*[st.floats(-300, 300)] * 3),
    height=st.floats(-100, 2e4),
)
def test_every_entry_is_the_derivative_of_the_nonlinear_mechanisation(
    method, full, latitude, wander_angle, angles, velocity, height
):
    layout = model.layout(method, full=full)
    if layout.geographic:
        wander_angle = 0.0
    state = State.from_angles(latitude, 0.4, height, np.array(velocity), angles, wander_angle)
    force, rate = np.array([1.0, -2.0, 9.7]), np.array([0.1, -0.2, 0.3])
    expected = mechanisation.system(
        (state.C_b_w, state.velocity, state.C_e_w, height), force, rate, layout.at, len(layout)
    )
    agree(matrix(state, force, layout), expected, latitude)


def test_the_pole_itself_is_no_special_place_for_the_wander_form():
    layout = model.layout("wander", full=True)
    at_pole = State.from_angles(np.pi / 2, 0.4, 100.0, np.array([200.0, 30.0, 1.0]), (1.0, 0.1, 0.2), 0.3)
    near = State.from_angles(np.pi / 2 - 1e-9, 0.4, 100.0, np.array([200.0, 30.0, 1.0]), (1.0, 0.1, 0.2), 0.3)
    force = np.array([1.0, -2.0, 9.7])
    F = matrix(at_pole, force, layout)
    assert np.all(np.isfinite(F))
    # 1e-9 rad from it the largest change is that of 2 w_e v: 200 m/s * 1.5e-4 rad/s * 1e-9
    assert np.allclose(F, matrix(near, force, layout), rtol=1e-6, atol=1e-10)


def errors_of(state, reference, layout):
    """Errors of one state against another as they are defined, with the position's as a rotation."""
    out = np.zeros(len(layout))
    s = layout.block
    out[s("velocity")] = state.velocity - reference.velocity
    out[s("attitude")] = -rotation_vector(state.C_b_w @ reference.C_b_w.T)
    out[s("position")] = -rotation_vector(state.C_e_w @ reference.C_e_w.T)
    out[s("height")] = state.height - reference.height
    return out


def test_two_navigations_side_by_side_part_as_the_transition_matrix_says():
    # the mechanisation that is used, run from two starts; differences over +-d are exact to d^2 relative
    layout = model.layout("wander", full=True)
    start = State.from_angles(1.0, 0.4, 3000.0, np.array([120.0, -80.0, 3.0]), (1.1, 0.2, -0.3), 0.8)
    force, rate = np.array([1.0, -2.0, 9.7]), np.array([1e-3, -2e-3, 3e-3])
    steps = np.full(2000, 5e-4)  # short, so that what the integration itself leaves out is less than 1e-6
    s = layout.block
    sizes = np.zeros(len(layout))
    for block, size in (("velocity", 1.0), ("attitude", 3e-4), ("position", 3e-4), ("height", 100.0)):
        sizes[s(block)] = size
    sizes[s("gyro")], sizes[s("accel")] = 3e-4, 1e-2

    def after(x):
        navigator = Navigator(start, samples=2)
        navigator.correct(
            attitude=-x[s("attitude")],
            velocity=-x[s("velocity")],
            position=-x[s("position")],
            height=-x[s("height")][0],
        )
        turns, pushes = np.outer(steps, rate + x[s("gyro")]), np.outer(steps, force + x[s("accel")])
        navigator.advance(turns, pushes, steps)
        return navigator.state

    true = after(np.zeros(len(layout)))
    # the matrix changes along the way: a product over short steps, each with the matrix of its middle
    along, T, step = Navigator(start, samples=1), np.eye(len(layout)), np.empty((len(layout), len(layout)))
    for _ in range(1000):
        along.step(5e-4 * rate, 5e-4 * force, 5e-4)
        transition(matrix(along.state, force, layout), 1e-3, step)
        T = step @ T
        along.step(5e-4 * rate, 5e-4 * force, 5e-4)
    for j in np.flatnonzero(sizes):  # all but the mounting, which is no state of the navigation
        x = np.zeros(len(layout))
        x[j] = sizes[j]
        ends = [errors_of(after(sign * x), true, layout) for sign in (1.0, -1.0)]
        found = (ends[0] - ends[1]) / (2 * sizes[j])
        expected = T[:, j].copy()
        for block in ("gyro", "accel"):
            expected[s(block)] = 0.0  # they are no states of the navigation
        assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max(), layout.names[j]
