"""Strapdown lanes against the kernel for one trajectory, lane by lane."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.earth import EARTH_RATE, ELLIPSOID
from sagnac.kernels import lanes, strapdown
from sagnac.kernels.lanes import LANES
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import pack

CONSTANTS = np.array([*ELLIPSOID, EARTH_RATE, 1e-4])
NONE = np.empty(0)


def starts(rng):
    """States all over the Earth, one of them 6 m from the pole."""
    out = []
    for i in range(LANES):
        latitude = 0.5 * np.pi - 1e-6 if i == 1 else rng.uniform(-1.5, 1.5)
        velocity, angles = rng.normal(0, 100, 3), tuple(rng.uniform(-1, 1, 3))
        state = State.from_angles(
            latitude, rng.uniform(-3, 3), rng.uniform(0, 1e4), velocity, angles, rng.uniform(-3, 3)
        )
        out.append(pack(state))
    return np.array(out)


def samples(n, rng):
    """Samples of all lanes, two of a lane with more than a radian each, and uneven steps with a gap."""
    turns, pushes = rng.normal(0, 2e-2, (n, 3, LANES)), rng.normal(0, 0.1, (n, 3, LANES))
    pushes[:, 2] += 0.098
    turns[5:7, :, 3] *= 60.0
    steps = np.full(n, 0.01)
    steps[10:13] = [0.05, 0.013, 0.009]
    return turns, pushes, steps


def by_lanes(first, turns, pushes, steps, tied=False, heights=NONE):
    state, pushed = np.ascontiguousarray(first.T).ravel(), np.zeros(3 * LANES)
    rows, room = np.concatenate([turns, pushes], axis=1).ravel(), np.empty(lanes.ROOM * LANES)
    lanes.advance(state, rows, steps, tied, heights, CONSTANTS, pushed, room)
    return state.reshape(lanes.STATE, LANES).T, pushed.reshape(3, LANES).T


def one_by_one(first, turns, pushes, steps, held=False, heights=None):
    out, pushed = first.copy(), np.zeros((LANES, 3))
    for i in range(LANES):
        given = NONE if heights is None else np.ascontiguousarray(heights[:, i])
        own = np.ascontiguousarray(turns[:, :, i]), np.ascontiguousarray(pushes[:, :, i])
        strapdown.advance(out[i], *own, steps, 2, False, held, given, CONSTANTS, pushed[i])
    return out, pushed


def agree(ours, theirs):
    # 400 samples of 1e-16 each, on numbers as large as they are
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("n", [400, 401, 1, 2])
@pytest.mark.parametrize("vertical", ["free", "held", "given"])
def test_each_lane_is_the_kernel_for_one(n, vertical):
    rng = np.random.default_rng(n)
    first, given = starts(rng), samples(max(n, 20), rng)
    given = tuple(g[:n] for g in given)
    heights = rng.normal(100.0, 0.01, (n, LANES)) if vertical == "given" else None
    if vertical == "given":
        first[:, 16] = 100.0
    ours = by_lanes(first, *given, vertical != "free", NONE if heights is None else heights.ravel())
    agree(ours, one_by_one(first, *given, vertical == "held", heights))


def test_the_sample_before_is_handed_on():
    rng = np.random.default_rng(3)
    first, (turns, pushes, steps) = starts(rng), samples(31, rng)
    ours, theirs = first, first.copy()
    for begin, end in ((0, 20), (20, 21), (21, 22), (22, 31)):
        part = turns[begin:end], pushes[begin:end], steps[begin:end]
        ours = by_lanes(ours, *part)[0]
        theirs = one_by_one(theirs, *part)[0]
    agree([ours], [theirs])


def test_a_lane_knows_nothing_of_the_others():
    rng = np.random.default_rng(4)
    first, (turns, pushes, steps) = starts(rng), samples(50, rng)
    order = rng.permutation(LANES)
    whole = by_lanes(first, turns, pushes, steps)
    mixed = by_lanes(first[order], turns[:, :, order], pushes[:, :, order], steps)
    for a, b in zip(whole, mixed, strict=True):
        np.testing.assert_array_equal(a[order], b)


def test_the_compiled_loop_is_the_plain_one():
    rng = np.random.default_rng(5)
    first, (turns, pushes, steps) = starts(rng), samples(16, rng)
    state, pushed = np.ascontiguousarray(first.T).ravel(), np.zeros(3 * LANES)
    rows, room = np.concatenate([turns, pushes], axis=1).ravel(), np.empty(lanes.ROOM * LANES)
    lanes.advance.py_func(state, rows, steps, False, NONE, CONSTANTS, pushed, room)
    np.testing.assert_allclose(
        state.reshape(-1, LANES).T, by_lanes(first, turns, pushes, steps)[0], rtol=1e-13, atol=1e-13
    )
