"""Kernels of the simulator against plain twins."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.signal import lfilter

from sagnac.kernels.simulation import count, table_inputs, wander
from sagnac.plan import Segment
from sagnac.rigs.turntable import Site, TableErrors, attitude, inputs
from sagnac.simulate.track import kernel_arguments, track

SITE = Site(0.8, 9.81, 7.292115e-5)
ERRORS = TableErrors((1e-3, -2e-3), (3e-3, -1e-3), (2e-3, 1e-3, -3e-3))
BUILDS = [c for c in itertools.product("xyz", repeat=3) if c[0] != c[1] and c[1] != c[2]]


def moving():
    """Two segments, one of which turns, with moves of all three axes before, between and after."""
    segments = [Segment(name=n, start=t, stop=t + 3) for n, t in (("a", 2.0), ("b", 7.0))]
    angles = np.array([[0.3, -1.0, 2.0], [2.0, 1.0, -0.5]])
    rates = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    return track(segments, angles, rates)


def felt(letters, lever=(0.0, 0.0, 0.0), time=None):
    time = np.linspace(0.0, 12.0, 2401) if time is None else time
    force, rate = np.empty((time.size, 3)), np.empty((time.size, 3))
    table_inputs(time, *kernel_arguments(moving(), SITE, ERRORS, letters, np.array(lever)), force, rate)
    return time, force, rate


@pytest.mark.parametrize("letters", BUILDS)
def test_inputs_are_those_of_the_rig_model(letters):
    time, force, rate = felt(letters)
    expected = inputs(*moving().angles(time), SITE, ERRORS, letters)
    np.testing.assert_allclose(force, expected[0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(rate, expected[1], rtol=0, atol=1e-14)


@pytest.mark.parametrize("letters", BUILDS[:4])
def test_a_lever_arm_adds_the_acceleration_of_its_end(letters):
    # second difference of the end's position in the room; 1e-4 s leaves 1e-8 h^-2 eps of rounding and h^2 / 12 of curvature
    lever, h = np.array([0.1, -0.2, 0.3]), 1e-4
    time = np.array([1.0, 1.7, 5.5, 6.2, 8.5])  # in moves and in the turning segment, away from their ends
    there = [attitude(moving().angles(time + k * h)[0], ERRORS, letters) @ lever for k in (-1, 0, 1)]
    acceleration = (there[0] - 2 * there[1] + there[2]) / h**2
    in_case = np.einsum("nji,nj->ni", attitude(moving().angles(time)[0], ERRORS, letters), acceleration)
    _, with_lever, rate = felt(letters, lever, time)
    _, without, same = felt(letters, time=time)
    assert np.abs(in_case).max() > 0.02
    np.testing.assert_allclose(with_lever - without, in_case, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(rate, same)


def test_pieces_of_time_make_no_difference():
    time, force, _ = felt(("z", "x", "y"))
    parts = [felt(("z", "x", "y"), time=t)[1] for t in np.array_split(time, 7)]
    np.testing.assert_array_equal(np.concatenate(parts), force)


@pytest.mark.parametrize("decay", [1.0, 0.97])
def test_wander_is_a_first_order_recursion(decay):
    normals = np.random.default_rng(1).standard_normal(1000)
    values = np.ones(1000)
    last = wander(0.5, decay, 2.0, normals, values)
    expected, _ = lfilter([2.0], [1.0, -decay], normals, zi=[decay * 0.5])
    np.testing.assert_allclose(values, 1.0 + expected, rtol=0, atol=1e-11)
    assert last == pytest.approx(expected[-1], abs=1e-11)


def test_count_hands_on_what_is_left():
    rng = np.random.default_rng(2)
    values, interval = rng.normal(3.0, 40.0, 5000), rng.uniform(0.009, 0.011, 5000)
    pulses = values.copy()
    left = count(0.25, interval, 7.0, pulses)
    integral = 0.25 + np.cumsum(values * interval * 7.0)
    assert (pulses == np.round(pulses)).all()
    behind = integral - np.cumsum(pulses)
    # 1e-9 of a pulse for the rounding of the sums
    assert behind.min() > -1e-9
    assert behind.max() < 1 + 1e-9
    assert left == pytest.approx(behind[-1], abs=1e-9)
    assert 0.0 <= left < 1.0
    assert math.isclose(pulses.sum() + left, integral[-1], abs_tol=1e-9)
