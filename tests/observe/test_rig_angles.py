"""Recorded angles of a table against the plan: what is refused with which words, what is told, what is left alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.errors import DataError
from sagnac.observe.means import segment_means
from sagnac.observe.rig_angles import arm_remarks
from sagnac.plan import Plan, Rig, Segment
from sagnac.recording import from_arrays

DEG = math.pi / 180
DT = 0.05
DWELL, MOVE = 10.0, 4.0
SETTINGS = [(0, 0, 0), (30, 90, 0), (-60, 0, 45), (120, -90, -120), (200, 35, 180), (-90, 10, 90), (10, 180, -31.7)]
RATES = [0, 0, 0, 0, 0, 20.0, 0]  # deg/s of the outer axis


def plan(settings=SETTINGS, rates=RATES, sigma=10 / 3600, shift=0.0, **rig) -> Plan:
    segments = [
        Segment(
            name=str(i + 1),
            start=i * (DWELL + MOVE) + shift,
            stop=i * (DWELL + MOVE) + DWELL + shift,
            outer=o * DEG,
            middle=m * DEG,
            inner=n * DEG,
            outer_rate=r * DEG,
        )
        for i, ((o, m, n), r) in enumerate(zip(settings, rates, strict=True))
    ]
    return Plan(segment=tuple(segments), rig=Rig(angle_uncertainty=sigma * DEG, **rig))


def angles(settings=SETTINGS, rates=RATES) -> tuple[np.ndarray, np.ndarray]:
    """What the table's own encoders show: rest, the turn, and the way to the next position, rad."""
    time = np.arange(round((len(settings) * (DWELL + MOVE) - MOVE + 3.0) / DT)) * DT
    knots, values = [], []
    for i, ((o, m, n), r) in enumerate(zip(settings, rates, strict=True)):
        start = i * (DWELL + MOVE)
        knots += [start, start + DWELL + 0.5]
        values += [(o, m, n), (o + r * (DWELL + 0.5), m, n)]
    return time, np.column_stack([np.interp(time, knots, column) for column in np.array(values, dtype=float).T]) * DEG


def recording(shown=None, time=None, columns=("outer", "middle", "inner")):
    if shown is None:
        time, shown = angles()
    rng = np.random.default_rng(1)
    accel = np.array([0.1, -0.2, 9.8]) + 0.01 * rng.normal(size=(time.size, 3))
    rig = {c: shown[:, ("outer", "middle", "inner").index(c)] for c in columns}
    return from_arrays(time, accel, 0.01 * rng.normal(size=(time.size, 3)), rig=rig, name="run")


def said(found) -> list[str]:
    return [r for r in found.remarks if "rig recorded" in r or "within segment" in r]


def changed(at, settings=SETTINGS):
    out = [list(s) for s in settings]
    for (i, k), value in at.items():
        out[i][k] = value
    return out


def test_a_plan_that_agrees_is_left_alone():
    assert said(segment_means(recording(), plan())) == []


def test_whole_turns_and_a_wrapping_column_are_nothing():
    time, shown = angles()
    assert said(segment_means(recording(np.mod(shown, 2 * np.pi), time), plan())) == []
    assert said(segment_means(recording(shown + 4 * np.pi, time), plan())) == []
    assert said(segment_means(recording(), plan(changed({(3, 0): 120 - 720})))) == []


def test_without_columns_or_angles_there_is_nothing_to_compare():
    assert said(segment_means(recording(columns=()), plan(changed({(3, 0): 77})))) == []
    bare = plan(changed({(3, 0): 77}))
    bare = bare.model_copy(update={"segment": tuple(s.model_copy(update={"outer": None}) for s in bare.segment)})
    assert said(segment_means(recording(), bare)) == []
    # an axis that the table lacks stays at zero, whatever a column of that name holds
    two = plan([(o, m, 0) for o, m, _ in SETTINGS], axes={"azimuth": "z", "elevation": "x"})
    assert said(segment_means(recording(), two)) == []


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (changed({(2, 1): 20}), r"segment '3': the plan says middle 20 deg, the rig recorded 0 deg: .*mistyped"),
        ([(o, -m, n) for o, m, n in SETTINGS], r"\(3 more segments disagree\): middle counts the other way"),
        (
            [(o, -m, -n) for o, m, n in SETTINGS],
            "middle counts the other way in the plan than in its column, inner counts",
        ),
        ([(m, o, n) for o, m, n in SETTINGS], "outer and middle are exchanged"),
        ([SETTINGS[j] for j in (0, 3, 2, 1, 4, 5, 6)], "segments '2' and '4' are exchanged"),
        ([SETTINGS[j] for j in (0, 2, 3, 4, 1, 5, 6)], r"stood as segment '.' says|one position behind"),
        ([(o / 57.29578, m / 57.29578, n / 57.29578) for o, m, n in SETTINGS], "look like deg but are taken as rad"),
        ([(o * 57.29578, m * 57.29578, n * 57.29578) for o, m, n in SETTINGS], "look like rad but are taken as deg"),
    ],
)
def test_a_plan_that_says_otherwise_is_refused_with_the_likely_cause(settings, words):
    still = [0.0] * len(SETTINGS)
    time, shown = angles(rates=still)
    with pytest.raises(DataError, match=words):
        segment_means(recording(shown, time), plan(settings, still))


def test_a_position_that_was_left_out_shifts_those_after_it():
    still = [0.0] * 6
    time, shown = angles(SETTINGS[:2] + SETTINGS[3:], still)
    with pytest.raises(DataError, match=r"from segment '3' on the rig stood one position ahead of the plan"):
        segment_means(recording(shown, time), plan(SETTINGS[:-1], still))


def test_times_that_lie_in_the_moves_are_named():
    with pytest.raises(DataError, match=r"goes from .* within segment '.': its start and stop lie beside its rest"):
        segment_means(recording(), plan(rates=[0.0] * 7, shift=2.0, settings=changed({(5, 0): 110})))


def test_a_rate_of_the_other_sense_and_another_rate():
    with pytest.raises(DataError, match=r"'6': the plan turns outer at -20 deg/s, the rig recorded 20 .* is reversed"):
        segment_means(recording(), plan(rates=[-r for r in RATES]))
    with pytest.raises(DataError, match=r"at 25 deg/s, the rig recorded 20 deg/s: the rate or .* times are wrong"):
        segment_means(recording(), plan(rates=[1.25 * r for r in RATES]))
    (told,) = said(segment_means(recording(), plan(rates=[1.001 * r for r in RATES])))
    assert "turning at 20 deg/s, the plan says 20.02 deg/s; the plan's is used" in told


def test_where_a_turn_begins_matters_only_when_it_is_not_whole():
    settings = changed({(5, 0): 0})
    (told,) = said(segment_means(recording(), plan(settings)))  # 200 deg
    assert "outer -90 deg from where the plan has it" in told
    time, shown = angles(rates=[1.8 * r for r in RATES])  # 360 deg
    assert said(segment_means(recording(shown, time), plan(settings, [1.8 * r for r in RATES]))) == []


def test_another_zero_of_a_column_is_told_and_what_is_wrong_besides_still_refused():
    time, shown = angles()
    shown[:, 2] += 5.0 * DEG
    (told,) = said(segment_means(recording(shown, time), plan()))
    assert "inner as the rig recorded it is 5 deg more than the plan says, in all segments" in told
    with pytest.raises(DataError, match=r"segment '3': the plan says inner 60 deg"):
        segment_means(recording(shown, time), plan(changed({(2, 2): 60})))


def test_how_far_is_judged_by_the_stated_uncertainty():
    off = changed({(2, 1): 0.15})
    (told,) = said(segment_means(recording(), plan(off)))
    assert "differ from the plan's by up to 0.15 deg (middle in segment '3')" in told
    assert said(segment_means(recording(), plan(off, sigma=0.05))) == []
    assert len(said(segment_means(recording(), plan(off, sigma=0.0)))) == 1
    with pytest.raises(DataError, match="middle 0.5 deg, the rig recorded 0 deg"):
        segment_means(recording(), plan(changed({(2, 1): 0.5})))
    assert len(said(segment_means(recording(), plan(changed({(2, 1): 0.5}), sigma=0.1)))) == 1
    with pytest.raises(DataError, match="middle 2 deg"):
        segment_means(recording(), plan(changed({(2, 1): 2.0}), sigma=0.1))


def test_names_of_the_axes_are_the_plan_s_own():
    own = plan(changed({(2, 1): 20}), axes={"azimuth": "z", "elevation": "x", "roll": "y"})
    with pytest.raises(DataError, match=r"elevation \(column middle\) 20 deg"):
        segment_means(recording(), own)


def test_the_arm_of_a_centrifuge():
    segments = [
        Segment(name=n, start=s, stop=s + 60.0, arm_rate=180 * DEG, arm_phase=p * DEG)
        for n, s, p in (("1", 0.0, 10.0), ("2", 100.0, -30.0))
    ]
    mid = np.array([30.0, 130.0])
    rate = np.full(2, 180 * DEG)
    angle = np.array([10.0, -30.0]) * DEG + 2 * np.pi + rate * 30.0
    known = np.ones(2, dtype=bool)
    assert arm_remarks(segments, angle, mid, rate, known, 0.0) == []
    assert arm_remarks(segments, angle + 0.5, mid, rate, ~known, 0.0) == []
    (told,) = arm_remarks(segments, angle + np.array([0.0, 2.0]) * DEG, mid, rate, known, 0.0)
    assert (
        "segment '2': the column arm stands at -28 deg at the start, the plan says -30 deg; the column is used" in told
    )
    with pytest.raises(DataError, match="segment '1': the column arm stands at 100 deg .* different zeros"):
        arm_remarks(segments, angle + 90 * DEG, mid, rate, known, 0.0)
