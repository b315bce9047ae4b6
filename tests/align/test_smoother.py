"""Smoothing against the batch solution of the same problem."""

from __future__ import annotations

import numpy as np

from sagnac.align.smoother import Passed, smooth
from sagnac.kernels import kalman

NONE = slice(0, 0)


def problem(seed, first):
    """A linear system, its filter with feedback, and the batch solution of all states at once."""
    rng = np.random.default_rng(seed)
    n, m = first.shape[0], 12
    noise = rng.uniform(0.0, 0.2, n)
    truth = np.linalg.cholesky(first + 1e-15 * np.eye(n)) @ rng.standard_normal(n)
    P, room = first.copy(), np.empty((n, n))
    estimate, passed, estimates = np.zeros(n), [], []
    blocks = []
    for _ in range(m):
        T = np.eye(n) + 0.3 * rng.standard_normal((n, n))
        Q = 0.5 * (T @ np.diag(noise) @ T.T + np.diag(noise))
        truth = T @ truth + np.linalg.cholesky(Q + 1e-15 * np.eye(n)) @ rng.standard_normal(n)
        H, R = rng.standard_normal((2, n)), np.array([0.3, 0.5])
        y = H @ truth + np.sqrt(R) * rng.standard_normal(2)
        estimate = T @ estimate
        kalman.propagate(P, T, noise, room)
        predicted, x = P.copy(), np.zeros(n)
        kalman.update(x, P, H, R, y - H @ estimate)
        estimate = estimate + x
        estimates.append(estimate)
        passed.append(Passed(T, predicted, P.copy(), np.zeros(n), x, True))
        blocks.append((T, Q, H, R, y))
    return passed, np.array(estimates), batch(first, blocks)


def batch(first, blocks):
    """All states at once: prior, transitions and measurements as one weighted least squares problem."""
    n, m = first.shape[0], len(blocks)
    A, b = [], []

    def rows(parts, value, covariance):
        root = np.linalg.cholesky(np.linalg.inv(covariance)).T
        row = np.zeros((root.shape[0], n * (m + 1)))
        for k, block in parts.items():
            row[:, k * n : (k + 1) * n] = root @ block
        A.append(row)
        b.append(root @ value)

    rows({0: np.eye(n)}, np.zeros(n), first)
    for k, (T, Q, H, R, y) in enumerate(blocks):
        rows({k: -T, k + 1: np.eye(n)}, np.zeros(n), Q)
        rows({k + 1: H}, y, np.diag(R))
    A, b = np.vstack(A), np.concatenate(b)
    covariance = np.linalg.inv(A.T @ A)
    x = covariance @ A.T @ b
    return x.reshape(m + 1, n)[1:], np.sqrt(covariance.diagonal()).reshape(m + 1, n)[1:]


def test_smoothing_is_the_batch_solution():
    for seed in range(5):
        rng = np.random.default_rng(100 + seed)
        root = rng.standard_normal((4, 4))
        first = root @ root.T + 0.1 * np.eye(4)
        passed, filtered, (expected, sigma) = problem(seed, first)
        corrections, sigmas = smooth(passed, NONE, NONE)
        assert np.allclose(filtered + corrections, expected, rtol=1e-7, atol=1e-8)
        assert np.allclose(sigmas, sigma, rtol=1e-6)
        assert np.array_equal(corrections[-1], np.zeros(4))


def test_a_state_that_copies_another_is_no_obstacle():
    # two equal states: a singular covariance, as the mounting and the attitude error at the start
    first = np.ones((2, 2))
    T = np.eye(2)
    updated = np.full((2, 2), 0.25)
    passed = [
        Passed(T, first, updated, np.zeros(2), np.full(2, 0.3), True),
        Passed(T, updated, 0.5 * updated, np.zeros(2), np.full(2, 0.1), True),
    ]
    corrections, sigmas = smooth(passed, NONE, NONE)
    assert np.allclose(corrections[0], 0.1, atol=1e-9)  # nothing drives them: what is found later was true before
    assert np.allclose(sigmas, np.sqrt(0.125), atol=1e-9)
