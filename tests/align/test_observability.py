"""Directions that measurements see, for systems worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.align.observability import Observer


def test_a_sum_is_seen_and_the_difference_is_not():
    # level error and accelerometer bias at rest: only g * tilt + bias is in the velocity; 9.81 * 1e-3 rad against 1e-3 m/s^2
    g, tilt, bias = 9.81, 1e-3, 1e-3
    first = np.diag([tilt**2, bias**2])
    observer = Observer(first, ("tilt", "bias"))
    for _ in range(100):
        observer.advance(np.eye(2))
        observer.see(np.array([[g, 1.0]]), np.array([1e-6]))
    last = np.linalg.inv(np.linalg.inv(first) + 100 * np.outer([g, 1.0], [g, 1.0]) / 1e-6)
    seen = observer.result(last)
    # the gain of the one direction seen: prior variance of the sum over the variance of its mean
    assert seen.gains[0] == pytest.approx(((g * tilt) ** 2 + bias**2) / 1e-8, rel=1e-9)
    assert seen.gains[1] < 1e-6
    assert seen.ratio == pytest.approx(np.sqrt(np.diag(last)) / [tilt, bias])
    # what is not seen: the bias goes up by one sigma when g * tilt comes down by as much
    assert seen.unseen() == ["0.99 bias"]  # with 0.10 of the tilt, too little to be named


def test_a_copy_and_a_state_known_exactly_count_for_nothing():
    first = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    observer = Observer(first, ("a", "copy of a", "known"))
    observer.advance(np.eye(3))
    observer.see(np.array([[1.0, 0.0, 1.0]]), np.array([0.25]))
    seen = observer.result(first * 0.2)
    assert seen.gains == pytest.approx([4.0])
    assert np.isnan(seen.ratio[2])


def test_time_brings_in_what_a_moment_does_not():
    # position is measured, velocity is seen only because it moves the position
    observer = Observer(np.eye(2), ("position", "velocity"))
    observer.see(np.array([[1.0, 0.0]]), np.array([1.0]))
    assert observer.result(np.eye(2)).gains == pytest.approx([1.0, 0.0], abs=1e-12)
    observer.advance(np.array([[1.0, 2.0], [0.0, 1.0]]))
    observer.see(np.array([[1.0, 0.0]]), np.array([1.0]))
    # the Gramian is [[2, 2], [2, 4]]: 3 +- sqrt(5)
    assert observer.result(np.eye(2)).gains == pytest.approx([3 + np.sqrt(5), 3 - np.sqrt(5)])
