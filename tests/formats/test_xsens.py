"""Text export of Xsens MT Manager, written here as its manual and published files show it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.formats import Fault, format_of, open_table

ROWS = 60
SENSORS = ("Acc_X", "Acc_Y", "Acc_Z", "Gyr_X", "Gyr_Y", "Gyr_Z")
VALUES = np.round(np.random.default_rng(8).normal(size=(ROWS, 6)), 6)
OLD = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n// Filter Profile: human (46.1)\n// Firmware Version: 4.0.2\n"
NEW = (
    "// General information:\n//  MT Manager version: 2022.2.0\n// Device information:\n//  DeviceId: 00B42D4F\n"
    "// Device settings:\n//  Filter Profile: human(46.1)\n// Coordinate system: ENU\n"
)
STANDARD = (
    "accel_x [m/s^2]", "accel_y [m/s^2]", "accel_z [m/s^2]", "gyro_x [rad/s]", "gyro_y [rad/s]", "gyro_z [rad/s]",
)  # fmt: skip


def export(columns, *, comments=OLD, between="\t", end="\n") -> str:
    """A file with the columns given as name: texts, then the sensors'."""
    lines = [between.join([*columns, *SENSORS])]
    for i, row in enumerate(VALUES.tolist()):
        lines.append(between.join([*(str(c[i]) for c in columns.values()), *(f"{v:.6f}" for v in row)]))
    return (comments + "\n".join(lines) + "\n").replace("\n", end)


def counted(start=0, steps=None):
    return (start + np.cumsum(np.ones(ROWS, int) if steps is None else steps)) % 65536


def put(folder, content):
    path = folder / "MT_00B42D4F.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def pieces(path, names=("time [s]", *STANDARD)):
    parts = [np.zeros((0, len(names)))]
    try:
        for batch in open_table(path).read(names, []):
            parts += [np.column_stack([batch.column(i).to_numpy(zero_copy_only=False) for i in range(len(names))])]
    except Fault as fault:
        return np.concatenate(parts), fault
    return np.concatenate(parts), None


PLAIN = export({"PacketCounter": [f"{c:05d}" for c in counted(3582)]})


@pytest.mark.parametrize("between", ["\t", ";", ",", "  "])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_sensors_and_the_packet_counter(tmp_path, between, end):
    path = put(tmp_path, export({"PacketCounter": [f"{c:05d}" for c in counted(3582)]}, between=between, end=end))
    assert format_of(path).module == "text.xsens"
    table = open_table(path)
    assert table.columns == ("time [s]", "PacketCounter", *STANDARD)
    assert table.remarks == (
        "time from the packet counter and the rate in the comments, 100 Hz; missing packets are gaps",
    )
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read[:, 1:], VALUES)
    np.testing.assert_array_equal(read[:, 0], (3583 + np.arange(ROWS)) / 100)
    assert open_table(path).size == path.stat().st_size


@pytest.mark.parametrize("rate", ["//  Update Rate: 400.0Hz", "// Sample rate: 400", "// Sampling rate = 400.0 Hz"])
def test_the_rate_in_the_comments(tmp_path, rate):
    path = put(tmp_path, export({"Counter": counted()}, comments=f"{NEW}{rate}\n"))
    np.testing.assert_array_equal(pieces(path)[0][:, 0], (1 + np.arange(ROWS)) / 400)


@pytest.mark.parametrize("block", [300, 1 << 23])
def test_the_packet_counter_wraps_and_missing_packets_are_gaps(tmp_path, monkeypatch, block):
    monkeypatch.setattr("sagnac.formats.text.lines.BLOCK", block)
    steps = np.ones(ROWS, int)
    steps[20], steps[40] = 7, 1000
    counter = counted(65510, steps)
    assert counter.min() < 1000 < counter.max()
    read, _ = pieces(put(tmp_path, export({"PacketCounter": counter})))
    np.testing.assert_array_equal(read[:, 0], (65510 + np.cumsum(steps)) / 100)


@pytest.mark.parametrize("block", [300, 1 << 23])
def test_sample_time_fine_wraps(tmp_path, monkeypatch, block):
    # 0.1 ms ticks of 32 bits: MTi user manual, timestamp output
    monkeypatch.setattr("sagnac.formats.text.lines.BLOCK", block)
    ticks = 2**32 - 1003 + 25 * np.arange(ROWS)
    path = put(tmp_path, export({"PacketCounter": counted(), "SampleTimeFine": ticks % 2**32}, comments=NEW))
    assert open_table(path).remarks == ()
    np.testing.assert_array_equal(pieces(path)[0][:, 0], ticks * 1e-4)


def test_a_clock_that_is_set_back_is_not_mended(tmp_path):
    ticks = 1_000_000 + 25 * np.arange(ROWS)
    ticks[30:] -= 900_000
    path = put(tmp_path, export({"SampleTimeFine": ticks}, comments=NEW))
    assert pieces(path)[0][30, 0] < pieces(path)[0][29, 0]  # for the recording to refuse


@pytest.mark.parametrize("empty", ["", "NaN"])
@pytest.mark.parametrize("block", [300, 1 << 23])
def test_utc(tmp_path, monkeypatch, empty, block):
    monkeypatch.setattr("sagnac.formats.text.lines.BLOCK", block)
    nano = 995_000_000 + 2_500_000 * np.arange(ROWS)
    columns = {
        "SampleTimeFine": [empty] * ROWS,
        "UTC_Nano": nano % 10**9,
        "UTC_Year": np.where(nano < 10**9, 2023, 2024),
        "UTC_Month": np.where(nano < 10**9, 12, 1),
        "UTC_Day": np.where(nano < 10**9, 31, 1),
        "UTC_Hour": np.where(nano < 10**9, 23, 0),
        "UTC_Minute": np.where(nano < 10**9, 59, 0),
        "UTC_Second": np.where(nano < 10**9, 59, 0),
        "UTC_Valid": [7] * ROWS,
    }
    path = put(tmp_path, export(columns))
    assert open_table(path).remarks == ("time counted from the first sample, 2023-12-31 23:59:59 UTC",)
    np.testing.assert_allclose(pieces(path)[0][:, 0], 0.0025 * np.arange(ROWS), rtol=0, atol=1e-12)


def test_without_any_time_there_is_no_time(tmp_path):
    path = put(tmp_path, export({}, comments=NEW))
    assert open_table(path).columns == STANDARD
    np.testing.assert_array_equal(pieces(path, STANDARD)[0], VALUES)


def test_without_a_rate_packets_may_not_be_missing(tmp_path):
    good = put(tmp_path, export({"PacketCounter": counted(65510)}, comments=NEW))
    assert open_table(good).columns == ("PacketCounter", *STANDARD)
    np.testing.assert_array_equal(pieces(good, STANDARD)[0], VALUES)
    steps = np.ones(ROWS, int)
    steps[33] = 3
    bad = put(tmp_path, export({"PacketCounter": counted(65510, steps)}, comments=NEW))
    with pytest.raises(InputError, match="row 34: the packet counter goes on by 3 .*// Update Rate: 100.0Hz"):
        pieces(bad, STANDARD)


@pytest.mark.parametrize("comments", ["", "# my log\n"])
def test_without_the_comments_units_are_not_guessed(tmp_path, comments):
    # a DOT writes the same names, with ticks of 1 us and deg/s
    path = put(
        tmp_path, export({"PacketCounter": counted(), "SampleTimeFine": counted()}, comments=comments, between=",")
    )
    with pytest.raises(InputError, match="nothing says the unit of Gyr_X, Gyr_Y, Gyr_Z, SampleTimeFine"):
        open_table(path)


def test_units_in_the_header_are_kept(tmp_path):
    content = export({"PacketCounter": counted(), "time [us]": np.arange(ROWS) * 10**4}, comments="")
    for axis in "XYZ":
        content = content.replace(f"Gyr_{axis}", f"Gyr_{axis} [deg/s]")
    table = open_table(put(tmp_path, content))
    gyros = ("gyro_x [deg/s]", "gyro_y [deg/s]", "gyro_z [deg/s]")
    assert table.columns == ("PacketCounter", "time [us]", *STANDARD[:3], *gyros)
    np.testing.assert_array_equal(pieces(table.path, ("time [us]",))[0][:, 0], np.arange(ROWS) * 10**4)


def test_other_columns(tmp_path):
    extra = {
        "PacketCounter": counted(),
        "Temperature": [21.5] * ROWS,
        "VelInc_X": [0.25] * ROWS,
        "Mat[1][1]": [1.0] * ROWS,
        "Roll": [-3.0] * ROWS,
        "StatusWord": ["0001"] * ROWS,
        "Mag_X": [""] * ROWS,
    }
    table = open_table(put(tmp_path, export(extra)))
    new = ("temperature [degC]", "VelInc_X [m/s]", "Mat[1][1]", "Roll [deg]", "StatusWord", "Mag_X")
    assert table.columns[2:8] == new
    (batch,) = table.read(["temperature [degC]"], new[1:])
    assert batch.column(0).to_pylist()[:2] == [21.5, 21.5]
    assert batch.column(1).to_pylist()[:2] == [0.25, 0.25]
    assert batch.column(4).to_pylist()[:2] == ["0001", "0001"]
    assert batch.column(5).null_count == ROWS


def test_empty_fields_become_nan_for_the_checks_to_find(tmp_path):
    lines = PLAIN.splitlines()
    fields = lines[10].split("\t")
    fields[2] = ""
    lines[10] = "\t".join(fields)
    read, _ = pieces(put(tmp_path, "\n".join(lines) + "\n"))
    assert np.flatnonzero(np.isnan(read).any(axis=1)).tolist() == [5]


@pytest.mark.parametrize("block", [300, 1 << 23])
def test_a_bad_row_is_named_and_those_before_it_are_read(tmp_path, monkeypatch, block):
    monkeypatch.setattr("sagnac.formats.text.lines.BLOCK", block)
    lines = PLAIN.splitlines(keepends=True)
    for damaged, says in (
        ("00001\t1\t2\n", "row 33 (line 38) has 3 fields where there are 7 columns"),
        ("00001\t1\tx\t3\t4\t5\t6\n", "row 33 (line 38): column 'Acc_Y' is 'x', not a number"),
    ):
        path = put(tmp_path, "".join([*lines[:37], damaged, *lines[38:]]))
        read, fault = pieces(path)
        np.testing.assert_array_equal(read[:, 1:], VALUES[:32])
        assert fault.offset == sum(map(len, lines[:37]))
        assert fault.reason == says


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (OLD, "no header line"),
        (OLD + "Acc_X\tAcc_X\n1\t2\n", "columns stand more than once"),
        (OLD + "Acc_X\tAcc_X [g]\tAcc_X [g]\n1\t2\n", "columns stand more than once"),
    ],
)
def test_headers_that_cannot_be_used(tmp_path, content, says):
    from sagnac.formats.text import xsens

    with pytest.raises(InputError, match=says):
        xsens.open_table(put(tmp_path, content))


def test_a_header_alone_gives_no_rows(tmp_path):
    assert pieces(put(tmp_path, OLD + PLAIN.splitlines()[4] + "\n"))[0].shape == (0, 7)


@given(st.integers(len(OLD) + 80, len(PLAIN)))
def test_any_truncation_gives_the_rows_before_it(tmp_path, at):
    sound = PLAIN[:at].count("\n") - 5
    read, fault = pieces(put(tmp_path, PLAIN[:at]))
    np.testing.assert_array_equal(read[:sound, 1:], VALUES[:sound])
    assert len(read) == sound or (fault is None and len(read) == sound + 1)  # cut within the last number: remarked


UTC = "UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second,UTC_Nano,Acc_X\n2020,1,1,0,0,0,0,1\n"


@given(st.integers(0, len(PLAIN)), st.integers(0, 30), st.binary(max_size=6))
def test_any_damage_is_a_table_or_a_told_error(tmp_path, at, cut, put_in):
    path = put(tmp_path, PLAIN[:at].encode() + put_in + PLAIN[at + cut :].encode())
    told(path)


@given(st.lists(st.floats() | st.integers(), min_size=8, max_size=24), st.binary(max_size=20))
def test_any_utc_is_a_table_or_a_told_error(tmp_path, values, rest):
    rows = [",".join(map(repr, values[i : i + 8])) for i in range(0, len(values), 8)]
    told(put(tmp_path, (OLD + UTC + "\n".join(rows)).encode() + rest))


def told(path):
    try:
        pieces(path, open_table(path).columns)
    except InputError as error:
        if not str(error).startswith(f"{path}: "):
            raise


@pytest.mark.parametrize("comments", ["", "// logger of mine\n", "// Start Time: noon\n// Update Rate: 100.0Hz\n"])
@pytest.mark.parametrize("names", [SENSORS, tuple(f"My{n}" for n in SENSORS), ("Acc_X_raw", "PacketCounterLow")])
def test_the_same_names_in_a_table_of_somebody_else(tmp_path, comments, names):
    # such a file may be in g: its units are for the user to say
    path = put(tmp_path, f"{comments}{','.join(names)}\n{','.join('1' * len(names))}\n")
    assert format_of(path).module == "text.csv"
    assert open_table(path).columns == names


@pytest.mark.parametrize("comments", [OLD, NEW, "\ufeff" + NEW, "// MT Manager\n", "\n// Scenario: 4.1\n"])
def test_the_comments_of_mt_manager_are_enough(tmp_path, comments):
    assert format_of(put(tmp_path, export({}, comments=comments))).module == "text.xsens"


@pytest.mark.parametrize("comments", ["// logger of mine\n", "// Filter: none\n"])
def test_other_comments_give_no_units(tmp_path, comments):
    path = put(tmp_path, export({"SampleTimeFine": counted()}, comments=comments))
    with pytest.raises(InputError, match="nothing says the unit of Gyr_X, Gyr_Y, Gyr_Z, SampleTimeFine"):
        open_table(path)


@pytest.mark.parametrize(("text", "hertz"), [("1 kHz", 1000), ("0.4kHz", 400), ("2e2 Hz", 200), ("60", 60)])
def test_the_rate_in_the_comments_has_a_unit(tmp_path, text, hertz):
    path = put(tmp_path, export({"PacketCounter": counted()}, comments=f"{NEW}// Update Rate: {text}\n"))
    np.testing.assert_allclose(pieces(path)[0][:, 0], (1 + np.arange(ROWS)) / hertz, rtol=1e-14)


@pytest.mark.parametrize("text", ["100 per second", "10 ms", "100,0Hz", "1 2", "0 Hz"])
def test_a_rate_that_cannot_be_read_is_refused(tmp_path, text):
    path = put(tmp_path, export({"PacketCounter": counted()}, comments=f"{NEW}// Update Rate: {text}\n"))
    with pytest.raises(InputError, match=f"comment line '// Update Rate: {text}'"):
        open_table(path)
