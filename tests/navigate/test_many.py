"""Many trajectories at once against one navigator each."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.errors import DataError, InputError
from sagnac.kernels.lanes import LANES
from sagnac.navigate.many import Fleet, pack_many
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import Navigator, pack

SAMPLES = 150  # more than one block of the kernel


def start(count, seed=1):
    rng = np.random.default_rng(seed)
    parts = [
        State.from_angles(
            rng.uniform(-1.5, 1.5),
            rng.uniform(-3, 3),
            rng.uniform(0, 1e4),
            rng.normal(0, 100, 3),
            tuple(rng.uniform(-1, 1, 3)),
            rng.uniform(-3, 3),
        )
        for _ in range(count)
    ]
    return State(*(np.array([getattr(p, k) for p in parts]) for k in ("C_b_w", "velocity", "C_e_w", "height")))


def one(states, i):
    return State(states.C_b_w[i], states.velocity[i], states.C_e_w[i], states.height[i])


def samples(count, n=SAMPLES, seed=2):
    rng = np.random.default_rng(seed)
    turns, pushes = rng.normal(0, 2e-2, (n, 3, count)), rng.normal(0, 0.1, (n, 3, count))
    pushes[:, 2] += 0.098
    steps = np.full(n, 0.01)
    steps[7] = 0.04
    return turns, pushes, steps


def close(ours, theirs):
    for name in ("C_b_w", "velocity", "C_e_w", "height"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("count", [1, LANES, LANES + 1, 2 * LANES + 5])
@pytest.mark.parametrize("vertical", ["free", "held", "given", "each"])
def test_each_is_a_navigator(count, vertical):
    states, (turns, pushes, steps) = start(count), samples(count)
    heights = {"given": np.full(SAMPLES, 50.0), "each": np.linspace(10, 20, SAMPLES)[:, None] + np.arange(count)}.get(
        vertical
    )
    settings = {"vertical": "held" if vertical == "held" else "free", "earth_rate": 7.3e-5, "gravity_excess": 2e-4}
    fleet = Fleet(states, **settings)
    fleet.advance(turns, pushes, steps, heights)
    assert len(fleet) == count
    for i in range(count):
        alone = Navigator(one(states, i), **settings)
        own = heights if heights is None or heights.ndim == 1 else heights[:, i].copy()
        alone.advance(turns[:, :, i].copy(), pushes[:, :, i].copy(), steps, own)
        close(one(fleet.states, i), alone.state)
        np.testing.assert_allclose(fleet.pushed[i], alone.pushed, rtol=0, atol=1e-10)


def test_threads_make_no_difference():
    count = 5 * LANES + 3
    states, given = start(count), samples(count)
    ends = []
    for threads in (1, 2, 3, 7):
        fleet = Fleet(states, threads=threads)
        fleet.advance(*given)
        ends.append(fleet.states)
    for end in ends[1:]:
        for name in ("C_b_w", "velocity", "C_e_w", "height"):
            np.testing.assert_array_equal(getattr(end, name), getattr(ends[0], name))


def test_who_sails_along_makes_no_difference():
    count = 2 * LANES
    states, (turns, pushes, steps) = start(count), samples(count)
    whole, part = Fleet(states), Fleet(one(states, slice(3, 9)))
    whole.advance(turns, pushes, steps)
    part.advance(turns[:, :, 3:9], pushes[:, :, 3:9], steps)
    np.testing.assert_array_equal(whole.states.velocity[3:9], part.states.velocity)
    np.testing.assert_array_equal(whole.states.C_e_w[3:9], part.states.C_e_w)


def test_even_pieces_give_what_one_call_gives():
    states, (turns, pushes, steps) = start(20), samples(20)
    whole, parts = Fleet(states), Fleet(states)
    whole.advance(turns, pushes, steps)
    for begin, end in ((0, 2), (2, 40), (40, 40), (40, SAMPLES)):
        parts.advance(turns[begin:end], pushes[begin:end], steps[begin:end])
    close(parts.states, whole.states)
    np.testing.assert_allclose(parts.pushed, whole.pushed, rtol=0, atol=1e-11)


def test_a_single_step_length_serves_all():
    states, (turns, pushes, _) = start(3), samples(3)
    a, b = Fleet(states), Fleet(states)
    a.advance(turns, pushes, 0.01)
    b.advance(turns, pushes, np.full(SAMPLES, 0.01))
    np.testing.assert_array_equal(a.states.velocity, b.states.velocity)


def test_the_start_is_what_was_given():
    states = start(LANES + 2)
    close(Fleet(states).states, states)
    np.testing.assert_allclose(pack_many(states), [pack(one(states, i)) for i in range(LANES + 2)], rtol=0, atol=1e-15)


def test_what_does_not_fit_is_refused():
    states, (turns, pushes, steps) = start(4), samples(4)
    with pytest.raises(
        InputError, match=r"turns and pushes of 4 trajectories are \(n, 3, 4\); these are \(150, 3, 3\)"
    ):
        Fleet(states).advance(turns[:, :, :3], pushes[:, :, :3], steps)
    with pytest.raises(InputError, match="these are"):
        Fleet(states).advance(turns, pushes[:-1], steps)
    with pytest.raises(InputError, match="steps are above zero; the least of these is 0 s"):
        Fleet(states).advance(turns, pushes, np.where(np.arange(SAMPLES) == 3, 0.0, steps))
    with pytest.raises(InputError, match=r"steps are \(n,\) or one for all, here n = 150; not \(149,\)"):
        Fleet(states).advance(turns, pushes, steps[1:])
    with pytest.raises(InputError, match=r"heights are \(n,\) or \(n, N\), here n = 150, N = 4; not \(150, 3\)"):
        Fleet(states).advance(turns, pushes, steps, np.zeros((SAMPLES, 3)))
    with pytest.raises(InputError, match="states of N entries"):
        Fleet(one(states, 0))
    with pytest.raises(InputError, match="vertical is 'free' or 'held', not 'fixed'"):
        Fleet(states, vertical="fixed")


def test_the_trajectory_that_fails_is_named():
    states, (turns, pushes, steps) = start(20), samples(20)
    turns[4, 1, 18] = np.nan
    fleet = Fleet(states)
    with pytest.raises(DataError, match="trajectory 18 came to no number"):
        fleet.advance(turns, pushes, steps)
