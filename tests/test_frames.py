"""Rotations and vector algebra, by their laws and against other computations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sagnac.frames import (
    attitude_matrix,
    cross,
    heading_pitch_roll,
    rot_x,
    rot_y,
    rot_z,
    rotation_matrix,
    rotation_vector,
    skew,
    tangents,
    unit,
    wahba,
)

EPS = np.finfo(float).eps
angles = st.floats(-10, 10)
number = st.floats(-1e3, 1e3)
vectors = st.tuples(number, number, number).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))


@pytest.mark.parametrize(("turn", "axis"), [(rot_x, "x"), (rot_y, "y"), (rot_z, "z")])
@given(angle=angles)
def test_rotations_are_those_of_scipy(turn, axis, angle):
    np.testing.assert_allclose(turn(angle), Rotation.from_euler(axis, angle).as_matrix(), atol=4 * EPS)


def test_rotations_are_active():
    # a quarter turn about z takes x to y, about x takes y to z, about y takes z to x
    np.testing.assert_allclose(rot_z(math.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=EPS)
    np.testing.assert_allclose(rot_x(math.pi / 2) @ [0, 1, 0], [0, 0, 1], atol=EPS)
    np.testing.assert_allclose(rot_y(math.pi / 2) @ [0, 0, 1], [1, 0, 0], atol=EPS)


@pytest.mark.parametrize("turn", [rot_x, rot_y, rot_z])
@given(a=angles, b=angles)
def test_rotations_compose_and_invert(turn, a, b):
    np.testing.assert_allclose(turn(a) @ turn(b), turn(a + b), atol=20 * EPS)
    np.testing.assert_allclose(turn(a) @ turn(a).T, np.eye(3), atol=4 * EPS)
    assert np.linalg.det(turn(a)) == pytest.approx(1, abs=8 * EPS)


@pytest.mark.parametrize("turn", [rot_x, rot_y, rot_z])
def test_rotations_are_batched(turn):
    a = np.linspace(-3, 3, 24).reshape(2, 3, 4)
    assert turn(a).shape == (2, 3, 4, 3, 3)
    np.testing.assert_array_equal(turn(a)[1, 2, 3], turn(a[1, 2, 3]))


@given(vectors, vectors)
def test_skew_is_the_cross_product(v, w):
    bound = 4 * EPS * np.linalg.norm(v) * np.linalg.norm(w)
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w), rtol=0, atol=bound)
    np.testing.assert_allclose(cross(v, w), np.cross(v, w), rtol=0, atol=bound)
    np.testing.assert_array_equal(skew(v), -skew(v).T)


def test_skew_generates_rotations():
    np.testing.assert_allclose(expm(skew(np.array([0, 0, 0.7]))), rot_z(0.7), atol=10 * EPS)


def test_cross_broadcasts():
    v, w = np.random.default_rng(1).normal(size=(2, 5, 1, 3)), np.random.default_rng(2).normal(size=(4, 3))
    np.testing.assert_allclose(cross(v, w), np.cross(v, w), atol=1e-14)


@given(directions, st.floats(1e-3, 1e3))
def test_unit_keeps_the_direction(v, size):
    assert np.linalg.norm(unit(v * size)) == pytest.approx(1, abs=4 * EPS)
    np.testing.assert_allclose(unit(v * size), v, atol=4 * EPS)


@given(directions)
def test_tangents_complete_a_frame(v):
    t = tangents(v)
    frame = np.column_stack([t, v])
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-15 + 8 * EPS)


@pytest.mark.parametrize("v", [[0, 0, 1], [0, 0, -1], [0, 0, -0.0], [1e-8, 0, -1], [1, 0, 0]])
def test_tangents_at_the_poles_of_their_formula(v):
    v = unit(np.array(v) + np.array([0, 0, 0.0])) if np.any(v) else np.array([1.0, 0, -0.0])
    t = tangents(v[None])[0]
    np.testing.assert_allclose(np.column_stack([t, v]).T @ np.column_stack([t, v]), np.eye(3), atol=8 * EPS)


@given(st.integers(0, 10_000), st.integers(2, 8))
def test_wahba_finds_the_rotation(seed, count):
    rng = np.random.default_rng(seed)
    here = rng.normal(size=(count, 3))
    true = Rotation.random(rng=rng).as_matrix()
    found = wahba(here, here @ true.T)
    # two directions must not be nearly parallel: the error grows with 1/sin of the angle between them
    spread = np.linalg.svd(here, compute_uv=False)
    np.testing.assert_allclose(found, true, atol=50 * EPS * (spread[0] / spread[1]) ** 2)
    assert np.linalg.det(found) == pytest.approx(1, abs=10 * EPS)


def test_wahba_agrees_with_scipy_on_noisy_directions():
    rng = np.random.default_rng(5)
    here = rng.normal(size=(20, 3))
    there = here @ Rotation.random(rng=rng).as_matrix().T + 0.1 * rng.normal(size=(20, 3))
    best, _ = Rotation.align_vectors(there, here)
    np.testing.assert_allclose(wahba(here, there), best.as_matrix(), atol=1e-12)


def test_wahba_never_returns_a_reflection():
    here = np.eye(3)
    assert np.linalg.det(wahba(here, here * [1, 1, -1])) == pytest.approx(1)


@given(st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3), st.floats(1e-12, 1.0))
def test_rotation_vectors_and_matrices_are_inverse(vector, size):
    v = np.array(vector) * size
    C = rotation_matrix(v)
    assert np.allclose(C @ C.T, np.eye(3), atol=1e-15 * 8)
    assert np.allclose(C, rotation_matrix(np.stack([v, v]))[1], atol=1e-15)
    assert np.allclose(C, Rotation.from_rotvec(v).as_matrix(), atol=1e-15 * 4)
    if np.linalg.norm(v) < np.pi - 1e-6:
        assert np.allclose(rotation_vector(C), v, rtol=1e-9, atol=1e-15)
        assert np.allclose(rotation_vector(np.stack([C, np.eye(3)])), [v, np.zeros(3)], rtol=1e-9, atol=1e-15)


@given(st.floats(0, 6.28), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_heading_pitch_roll_are_those_of_the_convention(heading, pitch, roll):
    C = attitude_matrix(heading, pitch, roll)
    got = heading_pitch_roll(C)
    assert np.allclose(attitude_matrix(*got), C, atol=1e-12)
    assert np.allclose(got[1:], [pitch, roll], atol=1e-9)
    nose, right = C[:, 1], C[:, 0]
    assert np.sin(pitch) == pytest.approx(nose[2], abs=1e-12)  # nose up
    assert np.arctan2(nose[0], nose[1]) % (2 * np.pi) == pytest.approx(
        got[0] % (2 * np.pi), abs=1e-9
    )  # clockwise from north
    assert -right[2] == pytest.approx(np.sin(roll) * np.cos(pitch), abs=1e-12)  # right side down
