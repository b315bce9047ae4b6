"""Sets of positions on tables of every build, and the segments that plans by name become."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from sagnac.errors import InputError
from sagnac.plan import Plan, Rig, Segment
from sagnac.rigs.turntable import attitude
from sagnac.simulate import positions
from sagnac.simulate.recipes import CentrifugeRecipe, RollRecipe, TableRecipe
from sagnac.simulate.track import settings, track

BUILDS = [c for c in itertools.product("xyz", repeat=3) if c[0] != c[1] and c[1] != c[2]]
DEG = math.pi / 180


@pytest.mark.parametrize("letters", BUILDS)
@pytest.mark.parametrize(("name", "count"), [("icosahedron", 12), ("dodecahedron", 20), ("cube-6", 6), ("check", 8)])
def test_each_direction_is_brought_up(letters, name, count):
    angles = np.array(positions.named(name, letters))
    up = attitude(angles, letters=letters)[:, 2, :]
    assert len(angles) == count
    if letters == ("z", "x", "y") and name == "icosahedron":
        # printed to 1e-4 deg; every vertex has the same neighbours: five at arccos(1 / sqrt 5), one opposite
        for row in np.degrees(np.arccos(np.clip(up @ up.T, -1, 1))):
            np.testing.assert_allclose(np.sort(row), [0, *[63.43495] * 5, *[116.56505] * 5, 180], atol=2e-3)
    else:
        np.testing.assert_allclose(up, positions.directions(name), atol=1e-12)


def test_directions_are_spread_evenly():
    # a set of a regular solid has the second moment I / 3 and no first one
    for name in ("icosahedron", "dodecahedron", "cube-6"):
        d = positions.directions(name)
        np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, rtol=1e-15)
        np.testing.assert_allclose(d.sum(axis=0), 0, atol=1e-12)
        np.testing.assert_allclose(d.T @ d / len(d), np.eye(3) / 3, atol=1e-12)
        assert len(np.unique(np.round(d, 9), axis=0)) == len(d)


@pytest.mark.parametrize(("name", "headings"), [("cube-12", 2), ("cube-24", 4)])
def test_cubes_turn_each_face(name, headings):
    matrices = attitude(np.array(positions.named(name)))
    assert len(np.unique(np.round(matrices, 6), axis=0)) == 6 * headings
    # whole turns by a right angle: signed permutations
    np.testing.assert_allclose(np.sort(np.abs(matrices).reshape(-1, 9), axis=1)[:, :6], 0, atol=1e-12)


def test_a_table_that_cannot():
    # two axes: outer z, middle x; x can never be up
    with pytest.raises(InputError, match=r"cannot bring the direction \[1.0, 0.0, 0.0\]"):
        positions.named("cube-6", ("z", "x", "y"), 2)
    with pytest.raises(InputError, match="needs a vertical outer axis"):
        positions.named("cube-24", ("x", "z", "x"))


@pytest.mark.parametrize("letters", [c for c in BUILDS if c[0] == "z"])
@pytest.mark.parametrize("position", positions.four_positions())
def test_azimuths_become_settings(letters, position):
    x_azimuth, y_azimuth, z = position
    segment = Segment(name="a", start=0, stop=1, x_azimuth=x_azimuth, y_azimuth=y_azimuth, z=z)
    c = attitude(np.array(settings(segment, letters)), letters=letters)
    np.testing.assert_allclose(c[:, 0], [math.sin(x_azimuth), math.cos(x_azimuth), 0], atol=1e-12)
    np.testing.assert_allclose(c[:, 1], [math.sin(y_azimuth), math.cos(y_azimuth), 0], atol=1e-12)
    np.testing.assert_allclose(c[:, 2], [0, 0, 1 if z == "up" else -1], atol=1e-12)


def test_the_four_positions_cancel():
    # [ZHOU13]: the sum of each axis over the four attitudes is zero
    total = sum(
        attitude(np.array(settings(Segment(name="a", start=0, stop=1, x_azimuth=x, y_azimuth=y, z=z))))
        for x, y, z in positions.four_positions()
    )
    np.testing.assert_allclose(total, 0, atol=1e-12)


@pytest.mark.parametrize(
    ("segment", "says"),
    [
        ({}, "gives no attitude"),
        ({"x_azimuth": 0.0, "y_azimuth": 0.0, "z": "up"}, "not those of a right-handed frame"),
        ({"x_azimuth": 0.0, "y_azimuth": 90 * DEG, "z": "up"}, "not those of a right-handed frame"),
    ],
)
def test_attitudes_that_are_none(segment, says):
    with pytest.raises(InputError, match=says):
        settings(Segment(name="a", start=0, stop=1, **segment))


def test_azimuths_need_a_vertical_axis():
    segment = Segment(name="a", start=0, stop=1, x_azimuth=0.0, y_azimuth=-90 * DEG, z="up")
    assert settings(segment)[0] == pytest.approx(90 * DEG)
    with pytest.raises(InputError, match="azimuths need a vertical outer axis"):
        settings(segment, ("x", "y", "z"))


def test_a_table_needs_time_to_move():
    a, b = (Segment(name=n, start=t, stop=t + 1) for n, t in (("a", 1.0), ("b", 2.0)))
    with pytest.raises(InputError, match="segment 'b' begins at 2 s, when the table is still elsewhere"):
        track([a, b], np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.zeros((2, 3)))
    same = track([a, b], np.zeros((2, 3)), np.zeros((2, 3)))
    assert same.angles(np.array([1.5, 2.5]))[0].tolist() == [[0, 0, 0], [0, 0, 0]]


# ------------------------------------------------------------------------------------------------------ recipes


def test_table_segments_follow_each_other():
    recipe = TableRecipe(positions="cube-6", dwell=10.0, turning=5.0, rate=(0.1, -0.1), move=2.0)
    segments = recipe.segments(Plan())
    assert [s.name for s in segments] == [
        *(f"s{i}" for i in range(1, 7)), *(f"r{i}.1" for i in range(1, 7)), *(f"r{i}.2" for i in range(1, 7)),
    ]  # fmt: skip
    assert segments[0].start == 2.0
    for first, second in itertools.pairwise(segments):
        assert second.start - first.stop == pytest.approx(2.0)
    assert {s.stop - s.start for s in segments[:6]} == {10.0}
    assert [s.outer_rate for s in segments] == [0.0] * 6 + [0.1] * 6 + [-0.1] * 6


def test_axes_of_other_names():
    plan = Plan(rig=Rig(axes={"yaw": "z", "roll": "x"}))
    recipe = TableRecipe(positions=((0.0, 0.5, 0.0),), turning=5.0, rate=(0.1,), turning_axis="roll")
    assert recipe.segments(plan)[0].middle_rate == 0.1
    with pytest.raises(InputError, match=r"plan.turning_axis: this table has no axis 'pitch', but yaw, roll"):
        recipe.model_copy(update={"turning_axis": "pitch"}).segments(plan)


def test_centrifuge_segments_are_every_combination():
    recipe = CentrifugeRecipe(
        gamma=(0.0, 1.0), alpha=(0.0, 0.5), arm_rate=(math.pi, -2 * math.pi, 0.0), turns=4, dwell=7.0
    )
    segments = recipe.segments(Plan())
    assert len(segments) == 12
    assert {(s.alpha, s.beta, s.gamma) for s in segments} == {(a, 0.0, g) for a in (0.0, 0.5) for g in (0.0, 1.0)}
    # four turns at half a turn, and at one turn a second; at rest the dwell
    assert [round(s.stop - s.start, 9) for s in segments[:3]] == [8.0, 4.0, 7.0]
    assert all(s.arm_phase == 0.0 for s in segments)
    unknown = recipe.model_copy(update={"state_phase": False}).segments(Plan())
    assert all(s.arm_phase is None for s in unknown)
    listed = CentrifugeRecipe(settings=((0.1, 0.2, 0.3),), arm_rate=(1.0,), turns=1).segments(Plan())
    assert [(s.alpha, s.beta, s.gamma) for s in listed] == [(0.1, 0.2, 0.3)]


def test_roll_segments_are_both_stages():
    recipe = RollRecipe(inner_rate=(4.0, -4.0), spin_rate=(100.0,), inner_time=20.0, spin_time=30.0, move=1.0)
    segments = recipe.segments(Plan())
    assert [(s.stage, s.inner_rate, s.spin_rate) for s in segments] == [
        ("inner", 4.0, 0.0), ("inner", -4.0, 0.0), ("spin", 0.0, 100.0),
    ]  # fmt: skip
    assert segments[-1].stop == 1 + 20 + 1 + 20 + 1 + 30


def test_too_many_segments():
    many = CentrifugeRecipe(gamma=(0.0,) * 101, alpha=(0.0,) * 100, arm_rate=(1.0,), turns=1)
    with pytest.raises(InputError, match="10100 segments or more are asked for; 10000 are the most"):
        many.segments(Plan())
