"""The pieces of the filter against the textbook's matrix formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from sagnac.earth import ELLIPSOID
from sagnac.kernels import kalman
from sagnac.kernels.covariance import follow


def spread(rng, n):
    root = rng.standard_normal((n, n))
    return root @ root.T + np.eye(n)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 5))
def test_update_and_distance_are_those_of_the_matrix_formulas(seed, n, k):
    rng = np.random.default_rng(seed)
    P, H, R = spread(rng, n), rng.standard_normal((k, n)), rng.uniform(0.1, 2.0, k)
    x, y = rng.standard_normal(n), rng.standard_normal(k)
    H[rng.random((k, n)) < 0.4] = 0.0
    S = H @ P @ H.T + np.diag(R)
    innovation = y - H @ x
    K = P @ H.T @ np.linalg.inv(S)
    A = np.eye(n) - K @ H
    joseph = A @ P @ A.T + K @ np.diag(R) @ K.T
    assert kalman.distance(P, H, R, innovation) == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-9)
    got_x, got = x.copy(), P.copy()
    kalman.update(got_x, got, H, R, y)
    assert np.allclose(got_x, x + K @ innovation, rtol=0, atol=1e-9 * (1 + np.abs(x).max()))
    assert np.allclose(got, joseph, rtol=0, atol=1e-9 * np.abs(P).max())
    assert np.array_equal(got, got.T)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_propagation_is_that_of_the_matrix_formulas(seed, n):
    rng = np.random.default_rng(seed)
    P, F, noise = spread(rng, n), rng.standard_normal((n, n)), rng.uniform(0.0, 2.0, n)
    F[rng.random((n, n)) < 0.5] = 0.0
    phi, got = np.empty((n, n)), P.copy()
    kalman.transition(F, 1e-4, phi)
    assert np.allclose(phi, expm(F * 1e-4), rtol=0, atol=1e-9)  # the third order is (1e-4)^3 of the matrix's own size
    kalman.propagate(got, phi, noise, np.empty((n, n)))
    expected = phi @ (P + 0.5 * np.diag(noise)) @ phi.T + 0.5 * np.diag(noise)
    assert np.allclose(got, expected, rtol=1e-12, atol=1e-12)
    assert np.array_equal(got, got.T)


def test_a_covariance_stays_one_over_many_updates():
    # 20 000 updates of a double integrator that is seen much better than it is driven; a filter that loses the symmetry ends
    # negative
    P, phi = np.diag([1e4, 1e-2, 1e-10]), np.eye(3)
    phi[0, 1], phi[1, 2], phi[0, 2] = 0.1, 0.1, 0.005
    x, room = np.zeros(3), np.empty((3, 3))
    H, R = np.array([[1.0, 0.0, 0.0]]), np.array([1e-8])
    for _ in range(20_000):
        kalman.propagate(P, phi, np.array([0.0, 0.0, 1e-20]), room)
        kalman.update(x, P, H, R, np.zeros(1))
    assert np.all(np.linalg.eigvalsh(P / np.sqrt(np.outer(P.diagonal(), P.diagonal()))) > 0)


def test_following_a_course_is_the_filter_without_data():
    # at rest at the equator with one attitude: the same pieces, put together in plain NumPy
    rng = np.random.default_rng(5)
    n, m = 10, 50
    at = np.array([0, 2, 2, 0, 0, -1, 5, 8, 2, 1])
    C, v, u = np.eye(3), np.zeros(3), np.array([0.0, 1.0, 0.0])
    f = np.array([0.1, -0.2, 9.78])
    H, R, noise, P = rng.standard_normal((m, 2, n)), np.array([0.1, 0.2]), rng.uniform(0, 1e-3, n), spread(rng, n)
    from sagnac.kernels.error_model import system

    F = np.empty((n, n))
    system(C, v, u, 0.0, f, 7.292115e-5, ELLIPSOID, at, F)
    T = np.eye(n) + F * 0.5 + F @ F * 0.125
    expected, transition, gramian, sigmas = P.copy(), np.eye(n), np.zeros((n, n)), []
    for i in range(m):
        expected = T @ (expected + 0.25 * np.diag(noise)) @ T.T + 0.25 * np.diag(noise)
        K = expected @ H[i].T @ np.linalg.inv(H[i] @ expected @ H[i].T + np.diag(R))
        expected = (np.eye(n) - K @ H[i]) @ expected
        transition = T @ transition
        gramian += (H[i] @ transition).T @ np.diag(1 / R) @ H[i] @ transition
        sigmas.append(np.sqrt(expected.diagonal()))
    product, seen, got, picked = np.eye(n), np.zeros((n, n)), np.empty((m, n)), np.empty((m, 3, 3))
    pick = np.broadcast_to(np.eye(n)[2:5], (m, 3, n)).copy()
    still = np.zeros((n, n))
    repeat = [np.repeat(a[None], m, axis=0) for a in (C, v, u)]
    follow(
        *repeat, np.zeros(m), np.repeat(f[None], m, axis=0), np.full(m, 0.5), 7.292115e-5, ELLIPSOID, at, still, H, R, noise,
        pick, P, product, seen, got, picked,
    )  # fmt: skip
    assert np.allclose(got, sigmas, rtol=1e-8)
    assert np.allclose(P, expected, rtol=1e-6, atol=1e-9)
    assert np.allclose(product, transition, rtol=1e-12, atol=1e-15)
    assert np.allclose(seen, gramian, rtol=1e-9, atol=1e-9)
    assert np.allclose(picked[-1], P[2:5, 2:5])
