"""Strapdown navigation: our kernel against the same mechanisation with ``np.dot`` of 3 x 3 matrices, both compiled.

``make bench`` prints the table after the others. Wall time of one core, best of several, alternating. Ratios above one
are in our favour. Samples are those of a swaying ship at 100 Hz; both must come to where it does.
"""

from __future__ import annotations

import numba as nb
import numpy as np

import plain_strapdown as plain
from harmonics import race
from sagnac.earth import EARTH_RATE, ELLIPSOID
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import Navigator, integrate, pack, unpack
from sagnac.navigate.trajectory import Trajectory
from sagnac.navigate.trajectory.course import Course, Leg, Sway

SAMPLES, FREQUENCY = 400_000, 100.0
CONSTANTS = np.array([*ELLIPSOID, EARTH_RATE, 0.0])


def ride():
    """Where a ship in a seaway starts and ends, and its increments in between."""
    leg = Leg(duration=0.5 * SAMPLES / FREQUENCY, turn_rate=1e-3), Leg(duration=0.5 * SAMPLES / FREQUENCY)
    sway = Sway(roll=0.17, pitch=0.05, yaw=0.02)
    course = Trajectory.of(Course(latitude=0.96, height=20.0, speed=5.0, heading=1.0, leg=leg, sway=sway))
    samples = course.increments(FREQUENCY)
    return course.state(0.0), course.state(course.duration), (samples.turns, samples.pushes, samples.steps)


def kernels(start, end, samples):
    """Rows of the table: what was done, samples, seconds, seconds of the baseline and what that is."""
    turns, pushes, steps = samples
    dots = plain.with_dots(nb)

    def ours(size):
        navigator = Navigator(start, samples=size)
        navigator.advance(turns, pushes, steps)
        return navigator.state

    def baseline():
        return State(
            *dots(start.C_b_w, start.velocity, start.C_e_w, float(start.height), turns, pushes, steps, CONSTANTS)
        )

    (two, other, one, three, four), (a, b, *_) = race(
        [lambda: ours(2), baseline, lambda: ours(1), lambda: ours(3), lambda: ours(4)], 7
    )
    for name, digits in (("C_b_w", 1e-8), ("velocity", 1e-3), ("C_e_w", 1e-8), ("height", 0.1)):
        assert np.allclose(getattr(a, name), getattr(end, name), rtol=0, atol=digits)
        assert np.allclose(getattr(b, name), getattr(end, name), rtol=0, atol=digits)
    return [
        ("two samples in a group", SAMPLES, two, other, "np.dot of 3 x 3 matrices in Numba"),
        ("one, with the one before", SAMPLES, one, other, "the same (two samples)"),
        ("three samples in a group", SAMPLES, three, other, "the same (two samples)"),
        ("four samples in a group", SAMPLES, four, other, "the same (two samples)"),
    ]


def calls(start, samples):
    """One sample a call, and a path of which every hundredth state is kept."""
    count = 2000
    turns, pushes, steps = (values[:count] for values in samples)

    def one_by_one():
        navigator = Navigator(start)
        for turn, push, step in zip(turns, pushes, steps, strict=True):
            navigator.step(turn, push, step)
        return navigator.state.C_b_w

    def in_numpy():
        state, pushed, none = pack(start), np.zeros(3), np.empty(0)
        for k in range(count):
            part = turns[k : k + 1], pushes[k : k + 1], steps[k : k + 1]
            plain.advance(state, *part, 1, False, False, none, CONSTANTS, pushed)
        return unpack(state).C_b_w

    (ours, other), (a, b) = race([one_by_one, in_numpy], 3)
    assert np.allclose(a, b, rtol=0, atol=1e-12)
    (path,), _ = race([lambda: integrate(start, *samples, every=100)], 5)
    return [
        ("Navigator.step, one sample a call", count, ours, other, "plain NumPy"),
        ("integrate, every 100th state kept", SAMPLES, path, None, ""),
    ]


def main() -> None:
    start, end, samples = ride()
    print("Strapdown navigation in the wander frame, time of one sample on one core")
    print(
        f"| {'job':<34} | {'samples':>7} | {'ours [ns]':>9} | {'ours [1e6/s]':>12} | {'baseline [ns]':>13} | ", end=""
    )
    print(f"{'ratio':>6} | {'baseline':<34} |")
    print(f"|{'-' * 36}|{'-' * 8}:|{'-' * 10}:|{'-' * 13}:|{'-' * 14}:|{'-' * 7}:|{'-' * 36}|")
    for name, count, ours, other, against in [*kernels(start, end, samples), *calls(start, samples)]:
        print(f"| {name:<34} | {count:>7} | {ours / count * 1e9:>9.1f} | {count / ours * 1e-6:>12.2f} | ", end="")
        theirs, ratio = ("", "") if other is None else (f"{other / count * 1e9:.1f}", f"{other / ours:.1f}")
        print(f"{theirs:>13} | {ratio:>6} | {against:<34} |")


if __name__ == "__main__":
    main()
