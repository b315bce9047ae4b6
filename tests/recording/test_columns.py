"""Columns of a recording: counts, pulses and scales, headers and options that are refused in words."""

from __future__ import annotations

import numpy as np
import pytest
from logs import AXES, DEG, HEADER, RAW, G, N, csv, refusal, rows

from sagnac.errors import InputError
from sagnac.formats.text import csv as csv_format
from sagnac.recording import nominal_scale, open_recording, sample_interval

# ---------------------------------------------------------------------------------------------- counts and pulses


def test_counts_without_a_scale_stay_counts(log):
    header = ["time [s]", *(f"{a} [LSB]" for a in AXES)]
    recording = open_recording(csv(log, header=header))
    assert recording.counts == {"accel", "gyro"}
    assert not recording.scale
    np.testing.assert_array_equal(recording.read().accel, RAW[:, 1:4])


@pytest.mark.parametrize(
    ("text", "sensor", "factor", "increment"),
    [
        ("16384 LSB/g", "accel", G / 16384, False),
        ("131 LSB/(deg/s)", "gyro", DEG / 131, False),
        ("131 count*s/deg", "gyro", DEG / 131, False),
        ("1.1866 pulse/arcsec", "gyro", DEG / 3600 / 1.1866, True),
        ("1.1866pulse/arcsec", "gyro", DEG / 3600 / 1.1866, True),
        ("10800 pulse/g/s", "accel", G / 10800, True),
        ("500 pulse/(m/s)", "accel", 1 / 500, True),
        ("-131 LSB/(deg/s)", "gyro", -DEG / 131, False),  # an axis that points the other way
    ],
)
def test_nominal_scale(text, sensor, factor, increment):
    value, counted = nominal_scale(text, sensor, "here")
    assert value == pytest.approx(factor, rel=1e-14)
    assert counted is increment


@pytest.mark.parametrize(
    ("text", "sensor", "says"),
    [
        ("16384", "accel", "is no count per input; write for example 16384 LSB/g or 10800 pulse/g/s"),
        ("16384 g/LSB", "accel", "is no count per input"),
        ("131 LSB/(deg/s)", "accel", "is no count per input"),
        ("16384 LSB/g", "gyro", "write for example 131 LSB/(deg/s) or 1.1866 pulse/arcsec"),
        ("0 LSB/g", "accel", "is no scale that a sensor has"),
        ("5e-324 LSB/g", "accel", "is no scale that a sensor has"),
        ("1e200 LSB/g", "accel", "is no scale that a sensor has"),
        ("many LSB/g", "accel", "cannot read 'many LSB/g' as a number with a unit"),
    ],
)
def test_scales_that_are_none(text, sensor, says):
    with pytest.raises(InputError) as caught:
        nominal_scale(text, sensor, "here")
    assert "here: scale" in str(caught.value)
    assert says in str(caught.value)


def test_pulses_are_rates_over_the_sample_interval(log):
    # 10 pulses in 0.01 s at 2 pulse/arcsec are 500 arcsec/s; 5 pulses at 1000 pulse/g/s are 0.5 g
    header = ["time [s]", *(f"{a} [pulse]" for a in AXES)]
    csv(log, [[r[0], 5, 5, 5, 10, 10, 20] for r in rows()], header)
    scale = {"accel": "1000 pulse/g/s", "gyro": "2 pulse/arcsec", "gyro_z": "4 pulse/arcsec"}
    recording = open_recording(log, scale=scale)
    assert recording.increments == {"accel", "gyro"}
    assert recording.counts == frozenset()
    assert recording.scale == scale
    batch = recording.read()
    assert batch.accel == pytest.approx(np.full((N, 3), 0.5 * G), rel=1e-12)
    assert batch.gyro == pytest.approx(np.full((N, 3), 500 * DEG / 3600), rel=1e-12)


def test_levels_and_pulses_in_one_file(log):
    header = ["time [s]", *(f"{a} [LSB]" for a in AXES)]
    csv(log, [[r[0], 16384, 0, 0, 10, 0, 0] for r in rows()], header)
    recording = open_recording(log, scale={"accel": "16384 LSB/g", "gyro": "2 pulse/arcsec"})
    assert recording.increments == {"gyro"}
    assert recording.read().accel[0].tolist() == pytest.approx([G, 0, 0], rel=1e-14)


def test_the_first_piece_may_hold_one_sample(log, monkeypatch):
    # two samples say how long pulses were counted, wherever the file happens to be cut
    header = ["time [s]", *(f"{a} [pulse]" for a in AXES)]
    csv(log, [[r[0], *[1] * 6] for r in rows()], header)
    scale = {"accel": "1000 pulse/g/s", "gyro": "2 pulse/arcsec"}
    whole = open_recording(log, scale=scale).read()
    monkeypatch.setattr(csv_format, "_BLOCK", len(",".join(header)) + 25)
    pieces = list(open_recording(log, scale=scale).batches())
    assert len(pieces) > 2
    assert [p.row for p in pieces] == list(np.cumsum([1, *(p.time.size for p in pieces[:-1])]))
    np.testing.assert_allclose(np.concatenate([p.gyro for p in pieces]), whole.gyro, rtol=1e-12)


def test_one_sample_alone_cannot_hold_pulses(log):
    header = ["time [s]", *(f"{a} [pulse]" for a in AXES)]
    csv(log, [[0.0, *[1] * 6]], header)
    scale = {"accel": "1000 pulse/g/s", "gyro": "2 pulse/arcsec"}
    assert "one sample alone cannot say over which time its pulses were counted" in refusal(log, scale=scale)


def test_sample_interval_is_the_mean_of_the_steps_without_gaps():
    time = np.concatenate([np.arange(100) * 0.01, 5 + np.arange(100) * 0.01])
    assert sample_interval(time) == pytest.approx(0.01, rel=1e-12)
    # time stamps in whole milliseconds at 3 ms and 1/3: the mean is right where single steps are not
    time = np.round(np.arange(3000) / 300, 3)
    assert sample_interval(time) == pytest.approx(1 / 300, rel=1e-4)


# ------------------------------------------------------------------------------------------------ columns refused


def header_with(**changes: str) -> list[str]:
    return [changes.get(name.split(" ", maxsplit=1)[0], name) for name in HEADER]


@pytest.mark.parametrize(
    ("header", "says"),
    [
        (
            header_with(accel_x="accel_x"),
            "log.csv: column 'accel_x' has no unit. Write it in the header (accel_x [g]) or give it with --units accel=g",
        ),
        (header_with(gyro_y="gyro_y []"), "(gyro_y [deg/s]) or give it with --units gyro=deg/s"),
        (header_with(time="time"), "column 'time' has no unit. Write it in the header (time [s]) or give it with"),
        (header_with(accel_x="accel_x [furlong]"), "column 'accel_x [furlong]': cannot read 'furlong'"),
        (header_with(accel_x="accel_x [deg/s]"), "'1 deg/s' has deg / s where an acceleration is needed"),
        (header_with(gyro_x="gyro_x [Hz]"), "has Hz where an angular rate is needed"),
        (header_with(gyro_x="gyro_x [12]"), "'12' is not a unit"),
        (header_with(time="time [count]"), "has count where a time is needed"),
        (header_with(time="when [s]"), "no column 'time [s]'; the columns are: when [s], accel_x [g]"),
        (header_with(accel_y="acc_y [g]"), "accel lacks accel_y; rename columns with --map"),
        (header_with(accel_y="accel_x [mg]"), "the columns 'accel_x [g]' and 'accel_x [mg]' are both accel_x"),
        (header_with(accel_y="accel_x [g]"), "these columns stand more than once in the header: accel_x [g]"),
        (header_with(accel_x="accel_x [LSB]"), "some accel columns are counts and others are not"),
        (["time [s]", *"abcdef"], "no sensor columns (accel_x [g], gyro_x [deg/s], ...); rename others with --map"),
    ],
)
def test_headers_that_are_refused(log, header, says):
    said = refusal(csv(log, header=header))
    assert says in said
    assert "log.csv" in said


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"rename": {"accel_w": "AX"}}, "--map accel_w=AX: 'accel_w' is no standard name (time, accel_x,"),
        ({"rename": {"accel_x": "AX"}}, "has no column 'AX'; it has: time [s], accel_x [g]"),
        ({"rename": {"accel_x": "gyro_x", "accel_y": "gyro_x"}}, "the column 'gyro_x [deg/s]'"),
        ({"rename": {"accel_x": "gyro_x", "accel_y": "gyro_x"}}, "is accel_x already"),
        ({"rename": {"accel_x": "accel_y"}}, "accel lacks accel_y"),
        ({"units_of": {"acel": "g"}}, "units: acel=g: 'acel' is none of accel, accel_x,"),
        ({"scale": {"giro": "2 pulse/arcsec"}}, "scale: giro=2 pulse/arcsec: 'giro' is none of accel,"),
        ({"units_of": {"accel": "m"}}, "has m where an acceleration is needed"),
    ],
)
def test_options_that_are_refused(log, options, says):
    assert says in refusal(csv(log), **options)


def test_an_ambiguous_name_is_refused(log):
    csv(log, [[*r, 7.0, 8.0] for r in rows()], [*HEADER, "AX [g]", "AX [mg]"])
    assert "has several such columns: AX [g], AX [mg]; write one in full" in refusal(log, rename={"accel_x": "AX"})
