"""Attitudes from small rotations: scipy's rotations, coning with its closed form, pieces."""

import numpy as np
from scipy.spatial.transform import Rotation

from sagnac.kernels.attitude import compose

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def test_rotations_about_one_axis_add_up():
    turns = np.tile([0.01, -0.02, 0.03], (500, 1))
    out = Rotation.from_quat(compose(turns, turns[0], IDENTITY)[-1])
    assert (out.inv() * Rotation.from_rotvec(500 * turns[0])).magnitude() < 1e-13


def test_it_is_the_product_of_the_rotation_vectors():
    rng = np.random.default_rng(0)
    turns = 0.3 * rng.standard_normal((30, 3))
    before = 0.3 * rng.standard_normal(3)
    start = np.array([0.1, -0.7, 0.5, 0.5])
    attitude = Rotation.from_quat(start)
    previous = before
    for turn in turns:
        attitude = attitude * Rotation.from_rotvec(turn + np.cross(previous, turn) / 12)
        previous = turn
    out = Rotation.from_quat(compose(turns, before, start)[-1])
    assert (out.inv() * attitude).magnitude() < 1e-14


def test_coning_does_not_drift():
    """An axis on a cone of 1 deg at 2 Hz, sampled at 100 Hz, for 20 s.

    ``R = X(wt) R0 X(wt)'`` has the body rate ``R' w x - w x``; its integral over a step by Gauss's rule of five points. Without
    the cross product of neighbours the attitude drifts by a^2 w t / 2 of what the steps' own cones leave out.
    """
    w, dt, n = 4 * np.pi, 0.01, 2000
    tip = Rotation.from_rotvec([0, np.radians(1.0), 0])
    axis = np.array([1.0, 0, 0])

    def attitude(t):
        turn = Rotation.from_rotvec(np.outer(w * t, axis))
        return turn * tip * turn.inv()

    nodes, weights = np.polynomial.legendre.leggauss(5)
    at = (np.arange(n)[:, None] + (nodes + 1) / 2) * dt
    rates = attitude(at.ravel()).inv().apply(w * axis).reshape(n, 5, 3) - w * axis
    turns = np.einsum("k,nkj->nj", weights / 2 * dt, rates)
    begin, end = attitude(np.array([0.0]))[0], attitude(np.array([n * dt]))[0]
    ours = Rotation.from_quat(compose(turns, turns[-1], begin.as_quat())[-1])
    plain = begin
    for turn in turns:
        plain = plain * Rotation.from_rotvec(turn)
    assert (end.inv() * plain).magnitude() > 1e-5
    assert (end.inv() * ours).magnitude() < 0.01 * (end.inv() * plain).magnitude()


def test_pieces_go_on_where_the_last_one_stopped():
    turns = 0.01 * np.random.default_rng(2).standard_normal((50, 3))
    whole = compose(turns, np.zeros(3), IDENTITY)
    first = compose(turns[:20].copy(), np.zeros(3), IDENTITY)
    second = compose(turns[20:].copy(), turns[19], first[-1])
    np.testing.assert_allclose(whole, np.vstack([first, second]), atol=1e-15)


def test_attitudes_stay_rotations():
    out = compose(np.tile([0.4, 0.3, -0.2], (100_000, 1)), np.zeros(3), IDENTITY)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0, atol=4e-15)


def test_the_compiled_loop_is_the_plain_one():
    turns = np.random.default_rng(5).standard_normal((40, 3)) * np.logspace(-6, 0, 40)[:, None]
    np.testing.assert_allclose(
        compose(turns, turns[0], IDENTITY), compose.py_func(turns, turns[0], IDENTITY), atol=1e-15
    )
