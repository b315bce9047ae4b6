"""What a recording may be opened with besides units and names: a part, a choice, a rate; and who is told how far it is."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from scipy import io

import sagnac
from sagnac import formats
from sagnac.errors import InputError
from sagnac.formats import Fault, Table
from sagnac.recording import open_recording

HEADER = "time [s],accel_x [g],accel_y [g],accel_z [g]\n"
COLUMNS = ("time [s]", "accel_x [g]", "accel_y [g]", "accel_z [g]")


def log(path: Path, rows: int = 50, header: str = HEADER) -> Path:
    path.write_text(header + "".join(f"{k / 10},0,0,1\n" for k in range(1, rows + 1)))
    return path


def damaged(monkeypatch, rows: Sequence[int], remarks: Sequence[str] = ()) -> None:
    """Every file is a table of pieces with so many rows, and then damage at byte 1234."""

    def read(numeric, other):
        first = 0
        for n in rows:
            time = (first + np.arange(1.0, n + 1)) / 10
            values = {"time [s]": time, **{c: np.full(n, float(c == "accel_z [g]")) for c in COLUMNS[1:]}}
            yield pa.RecordBatch.from_pydict({c: values[c] for c in (*numeric, *other)})
            first += n
        raise Fault("log.bin", 1234, "a record ends outside the file")

    table = Table(Path("log.bin"), COLUMNS, read, remarks)
    monkeypatch.setattr(formats, "open_table", lambda path, select=None: table)


def test_a_damaged_file_is_refused_with_the_byte_and_the_way_out(monkeypatch):
    damaged(monkeypatch, [20, 30])
    with pytest.raises(
        InputError, match=r"log\.bin: damaged at byte 1234: a record .*; --partial takes the 50 samples"
    ):
        open_recording("log.bin").read()


def test_what_lies_before_the_damage_is_a_recording_when_asked_for(monkeypatch):
    damaged(monkeypatch, [20, 30], ["time counted from noon"])
    recording = open_recording("log.bin", partial=True)
    assert recording.remarks == ("time counted from noon",)
    assert recording.read().time.tolist() == (np.arange(1.0, 51) / 10).tolist()
    said = "log.bin: only the 50 samples before byte 1234 were read: a record ends outside the file"
    assert recording.remarks == ("time counted from noon", said)
    recording.read()
    assert recording.remarks[1:] == (said,)  # once, however often it is read


def test_damage_before_the_first_sample_leaves_nothing(monkeypatch):
    damaged(monkeypatch, [])
    with pytest.raises(InputError, match=r"damaged at byte 1234: a record ends outside the file$"):
        open_recording("log.bin", partial=True).read()


def test_a_file_without_time_gets_it_from_the_rate(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("accel_x [g],accel_y [g],accel_z [g]\n" + "0,0,1\n" * 9)
    with pytest.raises(InputError, match=r"no column 'time \[s\]'.*--rate '100 Hz'"):
        open_recording(path)
    time = open_recording(path, rate="200 Hz").read().time
    assert time.tolist() == (np.arange(9) / 200).tolist()


@pytest.mark.parametrize("rate", ["100", "100 s", "fast", "0 Hz", "-5 Hz", "inf Hz", "1e300 GHz"])
def test_rates_that_are_none(tmp_path, rate):
    path = tmp_path / "log.csv"
    path.write_text("accel_x [g],accel_y [g],accel_z [g]\n0,0,1\n")
    with pytest.raises(InputError, match="--rate"):
        open_recording(path, rate=rate)


def test_a_file_with_time_needs_no_rate(tmp_path):
    with pytest.raises(InputError, match="has a time of its own"):
        open_recording(log(tmp_path / "log.csv"), rate="10 Hz")


def test_a_choice_among_one_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"\(CSV\) holds one recording; --select /imu has no use"):
        open_recording(log(tmp_path / "log.csv"), select="/imu")


def test_a_matrix_is_named_as_a_whole(tmp_path):
    path = log(tmp_path / "log.csv", header="t,acc.1,acc.2,acc.3\n")
    given = {"rename": {"time": "t", "accel": "acc"}, "units_of": {"time": "s", "accel": "g"}}
    assert open_recording(path, **given).read().accel[:, 2].tolist() == [9.80665] * 50
    with pytest.raises(InputError, match=r"--map accel=ac: there are no columns ac\.1, ac\.2, ac\.3"):
        open_recording(path, rename={"time": "t", "accel": "ac"})


def test_a_matrix_with_units_is_named_as_a_whole(tmp_path):
    path = log(tmp_path / "log.csv", header="t [s],acc.1 [g],acc.2 [g],acc.3 [g]\n")
    assert open_recording(path, rename={"time": "t", "accel": "acc"}).read().accel[:, 2].tolist() == [9.80665] * 50


def several(path: Path) -> Path:
    """Arrays of 6 samples, of 4, among them the time, and of 9."""
    imu = {"t": np.arange(6) * 0.01, "acc": np.arange(18.0).reshape(6, 3), "n": np.arange(6)}
    io.savemat(path, {"imu": imu, "gps": {"time": np.arange(4.0), "x": np.zeros(4)}, "more": np.zeros((9, 3))})
    return path


def test_the_columns_asked_for_say_which_arrays_belong_together(tmp_path):
    path = several(tmp_path / "log.mat")
    units_of = {"time": "s", "accel": "m/s^2"}
    recording = open_recording(path, rename={"time": "imu.t", "accel": "imu.acc"}, units_of=units_of)
    read = recording.read()
    np.testing.assert_array_equal(read.time, np.arange(6) * 0.01)
    np.testing.assert_array_equal(read.accel, np.arange(18.0).reshape(6, 3))
    assert recording.other == ("imu.n",)
    (batch,) = recording.batches(with_other=True)
    assert batch.other.column("imu.n").to_pylist() == list(range(6))
    (said,) = recording.remarks
    assert said == "read are the arrays of 6 samples; left out, of another length: gps.time (4), gps.x (4), more (9)"


@pytest.mark.parametrize(
    ("rename", "says"),
    [
        (
            {"time": "imu.t", "accel": "more"},
            r"named by --map have different lengths: time=imu.t \(6 samples\), accel_x=more.1 \(9 samples\), ",
        ),
        ({"time": "gps.time", "accel": "imu.acc"}, r"time=gps.time \(4 samples\), accel_x=imu.acc.1 \(6 samples\)"),
        ({"time": "imu.u", "accel": "imu.acc"}, r"has no column 'imu.u'; it has: gps.time, gps.x, imu.t, imu.acc.1, "),
    ],
)
def test_columns_of_different_lengths_are_no_recording(tmp_path, rename, says):
    with pytest.raises(InputError, match=says):
        open_recording(several(tmp_path / "log.mat"), rename=rename, units_of={"time": "s", "accel": "m/s^2"})


@pytest.mark.parametrize(("make", "kind"), [(os.mkfifo, "a pipe"), (None, "no file")])
def test_what_is_no_file_is_refused_before_it_is_opened(tmp_path, make, kind):
    path = Path(os.devnull)
    if make:
        path = tmp_path / "pipe"  # opening it would wait for a writer
        make(path)
    with pytest.raises(InputError, match=f"{path}: is {kind}; save the recording as a file first"):
        open_recording(path)


def test_who_watches_is_told_how_far_each_pass_is(tmp_path, monkeypatch):
    said: list[object] = []

    @contextmanager
    def watch(name, size):
        said.append((name, size))
        yield said.append
        said.append("done")

    done = [0]

    def read(numeric, other):
        for k in range(3):
            done[0] = 100 * (k + 1)
            time = np.array([2.0 * k, 2.0 * k + 1])
            yield pa.RecordBatch.from_pydict({c: time if c == "time [s]" else np.ones(2) for c in numeric})

    table = Table(Path("folder/log.bin"), COLUMNS, read, position=lambda: done[0], size=300)
    monkeypatch.setattr(formats, "open_table", lambda path, select=None: table)
    recording = open_recording("log.bin", watch=watch)
    assert said == []
    recording.read()
    assert said == [("log.bin", 300), 100, 200, 300, "done"]
    recording.read()
    assert len(said) == 10


def test_the_temperature_is_that_of_all_samples(tmp_path):
    path = tmp_path / "log.csv"
    rows = "".join(f"{k},0,0,1,{'' if k == 3 else 20 + k}\n" for k in range(5))
    path.write_text(HEADER.strip() + ",temperature [degC]\n" + rows)
    recording = open_recording(path)
    assert recording.temperature is None  # nothing has been read
    list(recording.batches())
    mean, least, greatest = recording.temperature
    assert (mean, least, greatest) == pytest.approx((273.15 + (20 + 21 + 22 + 24) / 4, 293.15, 297.15))


def test_read_is_the_short_name(tmp_path):
    assert sagnac.read is sagnac.open_recording


@pytest.mark.parametrize(
    ("head", "name"),
    [
        (b"PAR1....", "Parquet"),
        (b"ULog\x01\x12\x35\x01", "PX4 ULog"),
        (b"\xa3\x95\x80\x80", "ArduPilot DataFlash"),
        (b"#ROSBAG V2.0\n", "ROS 1 bag"),
        (b"\x89MCAP0\r\n", "MCAP"),
        (b"SQLite format 3\0", "ROS 2 bag (SQLite)"),
        (b"$IMURAW\0", "Inertial Explorer IMR"),
        (b"MATLAB 5.0 MAT-file, Platform", "MATLAB 5"),
        (b"\x89HDF\r\n\x1a\n", "HDF5 or MATLAB 7.3"),
        (b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n", "HDF5 or MATLAB 7.3"),
        (b"// Start Time: now\nPacketCounter\tAcc_X\n", "Xsens text export"),
        (b"// Start Time: now\ntime\tAcc_X\n", "CSV"),
        (b"\xef\xbb\xbf1,2,-3e5\n", "text of numbers"),
        (b"# a comment\n1.0 2.0 3.0\n", "text of numbers"),
        (b"1,2,-3e5\n", "text of numbers"),
        (b"time [s],accel_x [g]\n", "CSV"),
        (b"# 1 2 3\ntime [s],accel_x [g]\n", "CSV"),
        (b"\xef\xbb\xbftime [s]\n", "CSV"),
    ],
)
def test_a_format_is_known_by_its_content(tmp_path, head, name):
    (tmp_path / "file").write_bytes(head)
    assert formats.format_of(tmp_path / "file").name == name
