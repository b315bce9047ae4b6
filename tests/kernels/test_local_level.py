"""Whitening by the local-level filter against the dense covariance of readings."""

import numpy as np
import pytest

from sagnac.kernels.local_level import innovations

WHITE, WALK = 0.04, 0.3


def start(rows):
    return -1.0, np.zeros(rows)


@pytest.fixture
def readings():
    rng = np.random.default_rng(1)
    steps = rng.uniform(0.5, 1.5, 40)
    return rng.standard_normal((3, 40)), steps


def dense(steps, white=WHITE, walk=WALK):
    """Covariance of readings relative to an unknown level at the first sample."""
    t = np.concatenate([[0.0], np.cumsum(steps[1:])])
    return white * np.eye(t.size) + walk * np.minimum.outer(t, t)


def test_it_is_the_likelihood_of_the_dense_covariance(readings):
    """Inner products of whitened columns are those with the inverse covariance, the unknown level projected out."""
    columns, steps = readings
    white, _, _ = innovations(columns, steps, WHITE, WALK, *start(3))
    inverse = np.linalg.inv(dense(steps))
    one = np.ones((steps.size, 1))
    projected = inverse - inverse @ one @ np.linalg.solve(one.T @ inverse @ one, one.T @ inverse)
    np.testing.assert_allclose(white @ white.T, columns @ projected @ columns.T, rtol=1e-10)
    assert (white[:, 0] == 0).all()  # nothing is known before the first reading


def test_pieces_go_on_where_the_last_one_stopped(readings):
    columns, steps = readings
    whole, back, variance = innovations(columns, steps, WHITE, WALK, *start(3))
    p, levels = start(3)
    first, back_1, p = innovations(columns[:, :17].copy(), steps[:17], WHITE, WALK, p, levels)
    second, back_2, p = innovations(columns[:, 17:].copy(), steps[17:], WHITE, WALK, p, levels)
    np.testing.assert_array_equal(whole, np.hstack([first, second]))
    np.testing.assert_array_equal(back, np.concatenate([back_1, back_2]))
    assert p == variance


def test_back_gives_the_filtered_reading(readings):
    """Best estimate of the level from the readings so far, by the dense covariance."""
    columns, steps = readings
    white, back, variance = innovations(columns, steps, WHITE, WALK, *start(3))
    filtered = columns[0] - back * white[0]
    n = steps.size
    covariance, walked = dense(steps), dense(steps, 0.0)
    one, inverse = np.ones(n), np.linalg.inv(covariance)
    mean = one @ inverse @ columns[0] / (one @ inverse @ one)
    last = mean + walked[-1] @ inverse @ (columns[0] - mean)
    assert filtered[-1] == pytest.approx(last, rel=1e-10)
    gain = (1 - walked[-1] @ inverse @ one) ** 2 / (one @ inverse @ one)
    assert variance == pytest.approx(walked[-1, -1] - walked[-1] @ inverse @ walked[-1] + gain, rel=1e-9)


def test_the_compiled_loop_is_the_plain_one(readings):
    columns, steps = readings
    ours = innovations(columns, steps, WHITE, WALK, *start(3))
    plain = innovations.py_func(columns, steps, WHITE, WALK, *start(3))
    for a, b in zip(ours, plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-15)
