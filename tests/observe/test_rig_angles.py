"""Recorded angles of a table against the plan: what is refused with which words, what is told, what is left alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.calibrate import calibrate
from sagnac.errors import DataError
from sagnac.observe.means import segment_means
from sagnac.observe.rig_angles import RigAngles, arm_remarks
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


STILL = [0.0] * len(SETTINGS)


def at_rest(settings=SETTINGS):
    return angles(settings, [0.0] * len(settings))


def rounded(shown, step):
    """As an encoder with that step, deg, shows it."""
    return np.round(shown / (step * DEG)) * step * DEG


@pytest.mark.parametrize(
    ("rate", "step"), [(15 / 3600, 0.001), (15 / 3600, 0.01), (15 / 3600, 0.1), (0.05, 0.1), (0.1, 0.1), (0.5, 0.1)]
)
def test_a_slow_turn_is_not_judged_finer_than_the_column_shows_it(rate, step):
    rates = [0, 0, 0, 0, 0, rate, 0]
    time, shown = angles(rates=rates)
    assert said(segment_means(recording(rounded(shown, step), time), plan(rates=rates))) == []


def test_a_slow_turn_of_the_other_sense_is_refused_once_the_column_shows_it():
    rates = [0, 0, 0, 0, 0, 0.1, 0]  # 1 deg in 10 s
    time, shown = angles(rates=rates)
    with pytest.raises(DataError, match=r"turns outer at -0\.1 deg/s, the rig recorded 0\.[01].* is reversed"):
        segment_means(recording(rounded(shown, 0.01), time), plan(rates=[-r for r in rates]))


@pytest.mark.parametrize(("rate", "hold"), [(100, 1.0), (200, 1.0), (300, 0.5), (400, 0.5), (20, 0.25)])
def test_a_column_that_is_held_between_its_readings(rate, hold):
    """More than half a turn within a hold: two rates a turn a hold apart look the same, and neither is refused."""
    rates = [0, 0, 0, 0, 0, rate, 0]
    time, shown = angles(rates=rates)
    read_at = np.searchsorted(time, np.floor(time / hold + 1e-9) * hold - 1e-6)
    assert said(segment_means(recording(shown[read_at], time), plan(rates=rates))) == []


def test_a_turn_that_the_column_does_not_show_is_refused():
    time, shown = angles(rates=STILL)
    with pytest.raises(DataError, match=r"turns outer at 20 deg/s, the rig recorded 0 deg/s"):
        segment_means(recording(shown, time), plan())


@pytest.mark.parametrize(("samples", "value", "shows"), [(1, 0.0, "0 deg"), (3, 0.0, "0 deg"), (1, 1e6, "5.72958e.07")])
def test_bad_samples_of_an_encoder_are_told_with_time_and_value(samples, value, shows):
    time, shown = at_rest()
    at = int(np.searchsorted(time, 47.0 - 1e-9))
    shown[at : at + samples, 0] = value
    (told,) = said(segment_means(recording(shown, time), plan(rates=STILL)))
    assert f"outer as the rig recorded it jumps in segment '4': {shows.replace('e.', 'e+')} " in told
    assert "at 47 s" in told


def test_bad_samples_of_a_turning_axis_do_not_change_its_rate():
    time, shown = angles()
    shown[np.searchsorted(time, 79.0), 0] = 0.0  # a second before the end of the turn
    assert said(segment_means(recording(shown, time), plan())) == []


def test_an_encoder_that_is_elsewhere_for_a_tenth_of_a_segment_is_refused():
    time, shown = at_rest()
    at = int(np.searchsorted(time, 47.0))
    shown[at : at + 20, 0] = 0.0
    with pytest.raises(
        DataError, match=r"goes from 0 deg to 120 deg within segment '4': it moved, or 10 % of the column"
    ):
        segment_means(recording(shown, time), plan(rates=STILL))


@pytest.mark.parametrize("step", [0.05, 0.1, 0.2])
def test_another_zero_shows_in_a_coarse_column_too(step):
    settings = [(o + 0.0313 * i, m + 0.0171 * i, n) for i, (o, m, n) in enumerate(SETTINGS)]
    time, shown = at_rest(settings)
    shown[:, 0] += 30.03 * DEG
    found = said(segment_means(recording(rounded(shown, step), time), plan(settings, STILL)))
    # the mean of what rounding leaves is within half a step
    text = next(t for t in found if "counts from another zero" in t)
    assert float(text.split("it is ")[1].split(" deg")[0]) == pytest.approx(30.03, abs=step / 2)


def test_rounding_to_whole_degrees_is_no_disagreement_but_a_typing_error_is():
    settings = [(o + 0.13 * i, m + 0.17 * i, n) for i, (o, m, n) in enumerate(SETTINGS)]
    time, shown = at_rest(settings)
    coarse = recording(rounded(shown, 1.0), time, columns=("outer", "middle"))
    assert said(segment_means(coarse, plan(settings, STILL))) == []
    # settings that lie on the raster themselves are not rounded: a degree is a degree
    time, shown = at_rest()
    with pytest.raises(DataError, match=r"'3': the plan says middle 0\.4 deg"):
        segment_means(recording(shown, time), plan(changed({(2, 1): 0.4}), STILL))


def test_two_segments_that_agree_show_another_zero_and_one_does_not():
    time, shown = at_rest(SETTINGS[:2])
    shown[:, 0] += 30.0 * DEG
    (told,) = said(segment_means(recording(shown, time), plan(SETTINGS[:2], STILL[:2])))
    assert "outer as the rig recorded it is 30 deg more than the plan says, in all segments" in told
    time, shown = at_rest(SETTINGS[:1])
    with pytest.raises(DataError, match="the plan says outer 0 deg, the rig recorded 30 deg"):
        segment_means(recording(shown + 30.0 * DEG * np.array([1, 0, 0]), time), plan(SETTINGS[:1], STILL[:1]))


def test_angles_near_zero_do_not_look_like_another_unit():
    zeros = [(0, 0, 0)] * 6
    time, shown = at_rest(changed({(2, 0): 5.0}, zeros))
    with pytest.raises(DataError, match=r"outer 0 deg, the rig recorded 5 deg: the position was not the planned one"):
        segment_means(recording(shown, time), plan(zeros, STILL[:6], sigma=0))


def test_a_reversed_axis_with_another_zero_is_named_so():
    time, shown = at_rest()
    shown[:, 0] = 40 * DEG - shown[:, 0]
    with pytest.raises(DataError, match=r"outer counts the other way .*, and from another zero \(40 deg\)"):
        segment_means(recording(shown, time), plan(rates=STILL))


def test_a_constant_angle_of_an_axis_that_never_moves_may_be_a_unit_that_is_turned():
    never = [(o, m, 0) for o, m, _ in SETTINGS]
    time, shown = at_rest(never)
    shown[:, 2] += math.pi
    (told,) = said(segment_means(recording(shown, time), plan(never, STILL)))
    assert "Make sure of it: the plan never sets inner to another angle" in told
    time, shown = at_rest()
    shown[:, 2] += math.pi
    (told,) = said(segment_means(recording(shown, time), plan(rates=STILL)))
    assert "Make sure" not in told


def test_what_hardly_rests_on_the_angles_is_told_of_them():
    rng = np.random.default_rng(3)
    settings = [tuple(v + rng.uniform(-2, 2) for v in s) for s in SETTINGS]
    off = plan(settings, STILL)
    time, shown = at_rest()
    with pytest.raises(DataError, match="the position was not the planned one"):
        segment_means(recording(shown, time), off)
    (told,) = said(segment_means(recording(shown, time), off, rig="tell"))
    assert "more segments disagree): the position was not the planned one" in told
    assert "state rig.angle_uncertainty" in told
    # its rates, and that an axis rests, it does rest on
    with pytest.raises(DataError, match="is reversed"):
        segment_means(recording(), plan(rates=[-r for r in RATES]), rig="tell")
    with pytest.raises(DataError, match="beside its rest"):
        segment_means(recording(), plan(rates=STILL, shift=2.0, settings=changed({(5, 0): 110})), rig="tell")


@pytest.mark.parametrize(
    ("method", "rig"),
    [("norm", "tell"), ("table", "refuse"), ("multi-position", "refuse"), ("four-position", "refuse")],
)
def test_which_methods_rest_on_the_angles(method, rig, monkeypatch):
    def seen(recording, plan, rig="refuse"):
        raise DataError(f"asked to {rig}")

    monkeypatch.setattr("sagnac.observe.means.segment_means", seen)
    with pytest.raises(DataError, match=f"asked to {rig}"):
        calibrate(method, recording(), plan())


def test_one_pass_or_many_say_the_same():
    time, shown = angles(rates=[0, 0, 0, 0, 0, 200, 0])
    shown[300, 1] = 1.0
    shown += 1e-5 * np.random.default_rng(2).normal(size=shown.shape)
    given = plan(rates=[0, 0, 0, 0, 0, 200.1, 0])
    run = recording(np.mod(shown, 2 * np.pi), time)
    texts = []
    for size in (7, 150, time.size):
        one = RigAngles(run, given)
        for k in range(0, time.size, size):
            part = slice(k, k + size)
            one.add(
                time[part], {c: np.mod(shown[part, j], 2 * np.pi) for j, c in enumerate(("outer", "middle", "inner"))}
            )
        texts.append(one.remarks())
    assert len(texts[0]) == 2
    assert "middle as the rig recorded it jumps in segment '2': 57.29" in texts[0][0]
    assert "deg/s, the plan says 200.1 deg/s; the plan's is used" in texts[0][1]
    assert [t[:60] for t in texts[0]] == [t[:60] for t in texts[1]] == [t[:60] for t in texts[2]]
