"""Recordings: what comes out of a file, sample by sample, and samples that are refused in words."""

from __future__ import annotations

import math
import re

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logs import AXES, DEG, HEADER, RAW, G, N, csv, refusal, rows
from pyarrow import parquet

from sagnac.calibrate import calibrate
from sagnac.calibration import Calibration
from sagnac.compensation import corrections
from sagnac.errors import InputError, SagnacError
from sagnac.formats import parquet as parquet_format
from sagnac.formats.text import csv as csv_format
from sagnac.observe.means import segment_means
from sagnac.plan import Plan, Segment
from sagnac.recording import from_arrays, header_parts, open_recording
from sagnac.verification import verify

# ------------------------------------------------------------------------------------------------ what comes out


def test_csv_parquet_and_arrays_agree_to_the_last_bit(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_format, "_BLOCK", 2000)
    monkeypatch.setattr(parquet_format, "_ROWS", 33)
    table = {name: RAW[:, i] for i, name in enumerate(HEADER)}
    parquet.write_table(pa.table(table), tmp_path / "log.parquet")
    by_text = open_recording(csv(tmp_path / "log.csv")).read()
    by_parquet = open_recording(tmp_path / "log.parquet").read()
    in_memory = from_arrays(RAW[:, 0], RAW[:, 1:4] * G, RAW[:, 4:] * DEG).read()
    for batch in (by_text, by_parquet):
        np.testing.assert_array_equal(batch.time, in_memory.time)
        np.testing.assert_array_equal(batch.accel, in_memory.accel)
        np.testing.assert_array_equal(batch.gyro, in_memory.gyro)


def test_the_order_of_columns_and_further_columns_do_not_matter(log):
    order = [5, 0, 3, 1, 6, 2, 4]
    raw = [[*(row[i] for i in order), "word"] for row in rows()]
    csv(log, raw, [*(HEADER[i] for i in order), "remark [furlong]"])
    recording = open_recording(log)
    assert recording.other == ("remark [furlong]",)
    np.testing.assert_array_equal(recording.read().accel, RAW[:, 1:4] * G)
    np.testing.assert_array_equal(recording.read().gyro, RAW[:, 4:] * DEG)


@pytest.mark.parametrize(("sensor", "columns"), [("accel", [0, 1, 2, 3]), ("gyro", [0, 4, 5, 6])])
def test_one_triad_is_enough(log, sensor, columns):
    recording = open_recording(csv(log, RAW[:, columns].tolist(), [HEADER[i] for i in columns]))
    assert recording.has == {sensor}
    other = "gyro" if sensor == "accel" else "accel"
    assert getattr(recording.read(), other) is None
    with pytest.raises(InputError, match=f"this method needs the columns {other}_x, {other}_y, {other}_z"):
        recording.need(other)


SINGLE = [(["accel_z"], []), (["accel_x", "accel_z"], []), (["accel_y"], ["gyro"]), (["accel_y", "gyro_x"], [])]


@pytest.mark.parametrize(("single", "whole"), SINGLE)
def test_axes_of_an_incomplete_triad_stand_alone(log, monkeypatch, single, whole):
    monkeypatch.setattr(csv_format, "_BLOCK", 2000)
    columns = [
        0,
        *(1 + AXES.index(a) for s in whole for a in AXES if a.startswith(s)),
        *(1 + AXES.index(a) for a in single),
    ]
    recording = open_recording(csv(log, RAW[:, columns].tolist(), [HEADER[i] for i in columns]))
    assert recording.single == frozenset(single)
    assert recording.has == frozenset(whole)
    assert recording.other == ()
    batches = list(recording.batches())
    assert len(batches) > 2
    for axis in single:
        unit = G if axis.startswith("accel") else DEG
        np.testing.assert_array_equal(
            np.concatenate([b.single[axis] for b in batches]), RAW[:, 1 + AXES.index(axis)] * unit
        )
    assert all(set(b.single) == set(single) for b in batches)
    assert all((b.accel is None) == ("accel" not in whole) for b in batches)
    memory = from_arrays(
        RAW[:, 0],
        gyro=RAW[:, 4:] * DEG if whole else None,
        single={a: RAW[:, 1 + AXES.index(a)] * (G if a.startswith("accel") else DEG) for a in single},
    )
    assert (memory.single, memory.has) == (recording.single, recording.has)
    (batch,) = memory.batches()
    for axis in single:
        np.testing.assert_array_equal(batch.single[axis], np.concatenate([b.single[axis] for b in batches]))


@pytest.mark.parametrize(("single", "whole"), SINGLE)
def test_what_needs_whole_triads_says_which_axes_lack(log, single, whole):
    columns = [
        0,
        *(1 + AXES.index(a) for s in whole for a in AXES if a.startswith(s)),
        *(1 + AXES.index(a) for a in single),
    ]
    recording = open_recording(csv(log, RAW[:, columns].tolist(), [HEADER[i] for i in columns]))
    sensor = single[0].partition("_")[0]
    lacking = ", ".join(a for a in AXES if a.startswith(sensor) and a not in single)
    says = re.escape(f"{log}: {sensor} lacks {lacking}; rename columns with --map")
    plan = Plan(segment=(Segment(name="1", start=0.1, stop=1.0),), gravity=9.8)
    calibration = Calibration.model_validate(
        {
            "method": "norm",
            "parameters": [{"name": "accel.bias.x", "value": 0.0, "unit": "m/s^2", "standard_uncertainty": 1.0}],
            "covariance": [[1.0]],
            "fit": {"chi2": 1, "degrees_of_freedom": 1, "residual_rms": 1, "converged": True, "iterations": 1},
            "site": {"gravity": 9.8},
            "software": {"version": "0"},
            "created": "2020-01-01T00:00:00+00:00",
        }
    )
    for method in (
        recording.read,
        recording.need_whole,
        lambda: recording.need("accel"),
        lambda: recording.need("gyro"),
        lambda: segment_means(recording, plan),
        lambda: calibrate("norm", recording),
        lambda: calibrate("multi-position", recording, plan),
        lambda: corrections(calibration, recording),
        lambda: verify(calibration, recording, plan),
    ):
        with pytest.raises(InputError, match=says):
            method()


@pytest.mark.parametrize("row", [1, 150, N])
def test_single_axes_are_checked_like_others(log, row):
    raw = RAW[:, [0, 3]].tolist()
    raw[row - 1][1] = "nan"
    recording = open_recording(csv(log, raw, [HEADER[0], HEADER[3]]))
    with pytest.raises(InputError, match=rf"row {row}: accel_z is missing or not a number"):
        list(recording.batches())


def test_single_axes_in_counts_and_with_a_scale(log):
    header = ["time [s]", "accel_x [LSB]", "accel_z [LSB]", "gyro_z [pulse]"]
    csv(log, RAW[:, [0, 1, 3, 6]].tolist(), header)
    recording = open_recording(log)
    assert recording.counts == {"accel", "gyro"}
    np.testing.assert_array_equal(next(recording.batches()).single["accel_z"], RAW[:, 3])
    recording = open_recording(log, scale={"accel": "16384 LSB/g", "gyro": "2 pulse/arcsec"})
    assert recording.counts == frozenset()
    assert recording.increments == {"gyro"}
    assert recording.scale == {"accel": "16384 LSB/g", "gyro": "2 pulse/arcsec"}
    batch = next(recording.batches())
    np.testing.assert_allclose(batch.single["accel_z"], RAW[:, 3] * G / 16384, rtol=1e-14)
    np.testing.assert_allclose(batch.single["gyro_z"], RAW[:, 6] / 2 * DEG / 3600 / 0.01, rtol=1e-9)
    csv(log, RAW[:, [0, 1, 3]].tolist(), ["time [s]", "accel_x [g]", "accel_z [LSB]"])
    assert "some accel columns are counts and others are not; give --scale for all of them" in refusal(log)


def test_names_of_the_rig_columns(log):
    header = [*HEADER, "arm [deg]", "temperature [degC]"]
    assert open_recording(csv(log, [[*r, 90.0, 20.0] for r in rows()], header)).rig == {"arm", "temperature"}
    assert from_arrays(RAW[:, 0], RAW[:, 1:4], rig={"arm": RAW[:, 1]}).rig == {"arm"}
    assert from_arrays(RAW[:, 0], RAW[:, 1:4]).rig == frozenset()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"single": {"accel_w": [1.0, 2.0]}}, "'accel_w' is no axis (accel_x, ... gyro_z)"),
        ({"single": {"accel_z": [1.0]}}, "accel_z has shape (1,), time has 2 samples"),
        (
            {"accel": np.zeros((2, 3)), "single": {"accel_z": [1.0, 2.0]}},
            "accel is given as a whole and by single axes",
        ),
        (
            {"single": {f"gyro_{a}": [1.0, 2.0] for a in "xyz"}},
            "the single axes make gyro whole; give gyro, shape (n, 3)",
        ),
    ],
)
def test_single_axes_that_do_not_fit(options, says):
    with pytest.raises(InputError) as caught:
        from_arrays([0.0, 1.0], name="mine", **options)
    assert str(caught.value).startswith("mine: ")
    assert says in str(caught.value)


def test_rig_columns(log):
    # water freezes at 273.15 K; a right angle is pi/2
    header = [*HEADER, "outer [deg]", "middle [rad]", "temperature [degC]", "arm [arcsec]"]
    batch = open_recording(csv(log, [[*r, 90.0, 1.5, 0.0, 648000.0] for r in rows()], header)).read()
    assert batch.rig["outer"] == pytest.approx(np.full(N, math.pi / 2), rel=1e-15)
    assert batch.rig["middle"] == pytest.approx(np.full(N, 1.5), rel=1e-15)
    assert batch.rig["temperature"] == pytest.approx(np.full(N, 273.15), rel=1e-15)
    assert batch.rig["arm"] == pytest.approx(np.full(N, math.pi), rel=1e-15)


@pytest.mark.parametrize(("unit", "kelvin"), [("degC", 293.15), ("°C", 293.15), ("K", 20.0), ("degF", 266.4833333333)])
def test_temperature_units(log, unit, kelvin):
    # 20 degF is (20 - 32) * 5 / 9 = -6.667 degC
    batch = open_recording(csv(log, [[*r, 20.0] for r in rows()], [*HEADER, f"temperature [{unit}]"])).read()
    assert batch.rig["temperature"][0] == pytest.approx(kelvin, rel=1e-12)


def test_units_from_outside(log):
    csv(log, rows(), ["time", *AXES])
    batch = open_recording(log, units_of={"time": "s", "accel": "g", "gyro": "deg/s", "gyro_y": "rad/s"}).read()
    np.testing.assert_array_equal(batch.accel, RAW[:, 1:4] * G)
    np.testing.assert_array_equal(batch.gyro, RAW[:, 4:] * [DEG, 1, DEG])


@pytest.mark.parametrize("own", ["AX", "AX [g]"])
def test_other_names(log, own):
    csv(log, rows(), ["t [s]", "AX [g]", *HEADER[2:]])
    batch = open_recording(log, rename={"accel_x": own, "time": "t"}).read()
    np.testing.assert_array_equal(batch.accel, RAW[:, 1:4] * G)


def test_axes_may_be_exchanged(log):
    swapped = {"accel_x": "accel_y", "accel_y": "accel_x"}
    batch = open_recording(csv(log), rename=swapped).read()
    np.testing.assert_array_equal(batch.accel, RAW[:, [2, 1, 3]] * G)


def test_a_second_unit_in_the_file_is_chosen_by_name(log):
    csv(log, [[*r, 7.0] for r in rows()], [*HEADER, "accel_x [m/s^2]"])
    assert open_recording(log, rename={"accel_x": "accel_x [m/s^2]"}).read().accel[0, 0] == 7.0
    assert open_recording(log, rename={"accel_x": "accel_x [g]"}).read().accel[0, 0] == RAW[0, 1] * G


@pytest.mark.parametrize(
    ("column", "parts"),
    [
        ("accel_x [g]", ("accel_x", "g")),
        ("accel_x[m/s^2] ", ("accel_x", "m/s^2")),
        ("accel_x", ("accel_x", None)),
        ("accel_x []", ("accel_x", "")),
        ("[g]", ("", "g")),
        ("a [b] c", ("a [b] c", None)),
        ("a [b] [c]", ("a [b] [c]", None)),
        ("accel_x" + " " * 50_000 + "b", ("accel_x" + " " * 50_000 + "b", None)),  # at once, not after hours
    ],
)
def test_header_parts(column, parts):
    assert header_parts(column) == parts


# ------------------------------------------------------------------------------------------------ samples refused

BLOCKS = [500, 1 << 24]  # many pieces, and one


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("row", [1, 2, 100, N])
@pytest.mark.parametrize(
    ("value", "says"),
    [("nan", "missing or not a number"), ("", "missing or not a number"), ("inf", "infinite"), ("-inf", "infinite")],
)
@pytest.mark.parametrize("column", [0, 2, 6])
def test_samples_that_are_not_finite(log, monkeypatch, block, row, value, says, column):
    monkeypatch.setattr(csv_format, "_BLOCK", block)
    raw = rows()
    raw[row - 1][column] = value
    name = HEADER[column].split(" ", maxsplit=1)[0]
    assert f"log.csv: row {row}: {name} is {says} (1 such in this part of the file)" in refusal(csv(log, raw))


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("row", [2, 100, N])
@pytest.mark.parametrize("step", [0.0, -0.005, -5.0])
def test_time_that_does_not_increase(log, monkeypatch, block, row, step):
    monkeypatch.setattr(csv_format, "_BLOCK", block)
    raw = rows()
    before = RAW[row - 2, 0]
    raw[row - 1][0] = before + step
    said = refusal(csv(log, raw))
    assert f"row {row}: time goes from {before:.9g} s to {before + step:.9g} s; it must increase" in said


def test_time_that_jumps_back_exactly_at_the_end_of_a_piece(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet_format, "_ROWS", 50)
    raw = RAW.copy()
    raw[100:, 0] -= 0.01  # row 101 repeats the time of row 100, the last of the second piece
    path = tmp_path / "log.parquet"
    parquet.write_table(pa.table({name: raw[:, i] for i, name in enumerate(HEADER)}), path, row_group_size=50)
    assert "row 101: time goes from 1 s to 1 s" in refusal(path)


@pytest.mark.parametrize("time", [[1.0, 1.0, 1.0], [3.0, 2.0, 1.0], [math.nan] * 3, [math.inf] * 3, [0.0, math.inf, 1]])
def test_pulses_with_unsound_time_are_refused_for_the_time(log, time):
    header = ["time [s]", *(f"{a} [pulse]" for a in AXES)]
    csv(log, [[t, *[1] * 6] for t in time], header)
    scale = {"accel": "1000 pulse/g/s", "gyro": "2 pulse/arcsec"}
    assert "time " in refusal(log, scale=scale).split(": ", maxsplit=2)[2]


def test_numbers_beyond_all_measure_are_refused_without_a_warning(log):
    raw = rows()
    raw[4][2] = 1e308  # g: more than a float holds in m/s^2
    assert "row 5: accel_y is infinite" in refusal(csv(log, raw))


def test_a_word_among_the_numbers(log):
    raw = rows()
    raw[41][5] = "word"
    assert f"{log}: row 42 (line 43): 'gyro_y [deg/s]' is 'word', not a number" in refusal(csv(log, raw))


def test_no_samples(log):
    assert refusal(csv(log, [])) == f"{log}: no samples"


@given(st.binary(max_size=200))
def test_any_bytes_after_a_sound_header_are_read_or_refused(tmp_path, data):
    path = tmp_path / "fuzz.csv"
    path.write_bytes((",".join(HEADER) + "\n0.1,1,2,3,4,5,6\n").encode() + data)
    try:
        batch = open_recording(path).read()
        assert np.isfinite(batch.accel).all()
        assert (np.diff(batch.time) > 0).all()
    except SagnacError as error:
        if str(path) not in str(error):
            raise


@given(st.integers(1, 20_000))
def test_a_log_cut_anywhere_is_read_or_refused(tmp_path, size):
    path = csv(tmp_path / "whole.csv")
    data = path.read_bytes()
    path.write_bytes(data[: min(size, len(data))])
    try:
        batch = open_recording(path).read()
        # what is read well is the beginning of what was written, but for the last number, which may have lost its end
        np.testing.assert_array_equal(batch.time[:-1], RAW[: batch.time.size - 1, 0])
    except SagnacError as error:
        if str(path) not in str(error):
            raise


@given(
    st.lists(st.text(max_size=12), min_size=1, max_size=5), st.dictionaries(st.text(max_size=8), st.text(max_size=8))
)
def test_any_header_and_options_are_read_or_refused(tmp_path, names, options):
    path = tmp_path / "fuzz.csv"
    path.write_text(",".join(names) + "\n" + ",".join("1" for _ in names) + "\n", encoding="utf-8", errors="replace")
    for use in ({"rename": options}, {"units_of": options}, {"scale": options}, {}):
        with pytest.raises(SagnacError):
            open_recording(path, **use).read()


# ---------------------------------------------------------------------------------------------------- from memory


@pytest.mark.parametrize(
    ("time", "accel", "rig", "says"),
    [
        ([0.0, 1.0], np.zeros((3, 3)), None, "accel has shape (3, 3), time has 2 samples"),
        ([0.0, 1.0], np.zeros(2), None, "accel has shape (2,)"),
        ([[0.0], [1.0]], np.zeros((2, 3)), None, "time has shape (2, 1), not (n,)"),
        (["a", "b"], np.zeros((2, 3)), None, "time: cannot read as numbers"),
        ([0.0, 1.0], [["a"] * 3] * 2, None, "accel: cannot read as numbers"),
        ([0.0, 1.0], np.zeros((2, 3)), {"outer": [1.0]}, "outer has shape (1,), time has 2 samples"),
    ],
)
def test_arrays_that_do_not_fit(time, accel, rig, says):
    with pytest.raises(InputError) as caught:
        from_arrays(time, accel, name="mine", rig=rig)
    assert str(caught.value).startswith("mine: ")
    assert says in str(caught.value)


def test_arrays_are_checked_like_files():
    with pytest.raises(InputError, match="mine: row 2: time goes from 1 s to 1 s"):
        from_arrays([1.0, 1.0], np.zeros((2, 3)), name="mine").read()
    with pytest.raises(InputError, match="mine: row 2: accel_z is infinite"):
        from_arrays([1.0, 2.0], [[0, 0, 0], [0, 0, math.inf]], name="mine").read()
    with pytest.raises(InputError, match="mine: no samples"):
        from_arrays([], np.zeros((0, 3)), name="mine").read()
