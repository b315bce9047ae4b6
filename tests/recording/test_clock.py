"""Times that count from an epoch: exact where the file has integers, remarked where it has doubles."""

from __future__ import annotations

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy import io

from sagnac.errors import InputError
from sagnac.formats import parquet as parquet_format
from sagnac.recording import open_recording

N = 60
BEGIN = 1_700_000_000_123_456_789  # ns since 1970: as a double it is a multiple of 256
TICKS = BEGIN + 1_000_000 * np.arange(N)
TIME = 1e-3 * np.arange(N)
GYRO = np.ones((N, 3))
NAMES = {"rename": {"time": "t", "gyro": "gyr"}, "units_of": {"time": "ns", "gyro": "rad/s"}}
COUNTED = f"time counted from the first sample, which has {BEGIN} in the column {{!r}}"


def table(path, ticks, header="time [ns]", **options):
    columns = {header: ticks, **{f"gyro_{a} [rad/s]": np.ones(N) for a in "xyz"}}
    parquet.write_table(pa.table(columns), path, **options)
    return path


@pytest.mark.parametrize("kind", ["int64", "uint64"])
@pytest.mark.parametrize("rows", [1, 7, 1 << 17])
def test_whole_nanoseconds_in_parquet_are_exact(tmp_path, monkeypatch, kind, rows):
    monkeypatch.setattr(parquet_format, "_ROWS", rows)
    recording = open_recording(table(tmp_path / "a.parquet", TICKS.astype(kind)))
    for _ in range(2):  # the origin is that of the file in each pass
        np.testing.assert_allclose(recording.read().time, TIME, rtol=0, atol=1e-16)
    assert recording.remarks == (COUNTED.format("time [ns]"),)


def test_whole_nanoseconds_in_hdf5_and_matlab_are_exact(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["gyr"] = TICKS, GYRO
    io.savemat(tmp_path / "a.mat", {"t": TICKS, "gyr": GYRO})
    for name in ("a.h5", "a.mat"):
        recording = open_recording(tmp_path / name, **NAMES)
        np.testing.assert_allclose(recording.read().time, TIME, rtol=0, atol=1e-16)
        assert recording.remarks == (COUNTED.format("t"),)


@pytest.mark.parametrize("kind", ["int64", "uint64", "int32"])
def test_a_clock_that_goes_back_is_found(tmp_path, kind):
    scale, header = (10**9, "time [s]") if kind == "int32" else (1, "time [ns]")
    ticks = (TICKS // scale + (np.arange(N) if scale > 1 else 0)).astype(kind)
    ticks[30] = ticks[0] - 5
    with pytest.raises(InputError, match="row 31: time goes from .* to -5"):
        open_recording(table(tmp_path / "a.parquet", ticks, header)).read()


def test_a_difference_that_no_integer_holds(tmp_path):
    ticks = TICKS.copy()
    ticks[30] = -(2**63)
    with pytest.raises(InputError, match=r"row 31: time goes from 0\.029 s to -1\.09\d*e\+10 s"):
        open_recording(table(tmp_path / "a.parquet", ticks)).read()


def test_a_missing_time_is_found(tmp_path):
    ticks = pa.array([None if i == 30 else int(t) for i, t in enumerate(TICKS)], pa.int64())
    with pytest.raises(InputError, match="row 31: time is missing"):
        open_recording(table(tmp_path / "a.parquet", ticks)).read()


def test_integers_that_count_from_the_start_stay_as_they_are(tmp_path):
    # plans refer to the log's own time: a log that begins at 12.3 s begins there
    ticks = 12_345_678 + 1000 * np.arange(N)
    recording = open_recording(table(tmp_path / "a.parquet", ticks, "time [us]"))
    np.testing.assert_allclose(recording.read().time, ticks * 1e-6, rtol=1e-15)
    assert recording.remarks == ()


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_doubles_since_an_epoch_stay_and_are_remarked(tmp_path, form):
    # 2^30 < 1.7e9 < 2^31: doubles there are 2^-22 s = 0.238 us apart
    time = 1.7e9 + TIME
    path = table(tmp_path / f"a.{form}", time, "time [s]")
    if form == "csv":
        rows = "".join(f"{t!r},1,1,1\n" for t in time.tolist())
        path.write_text("time [s],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s]\n" + rows)
    recording = open_recording(path)
    np.testing.assert_array_equal(recording.read().time, time)
    (said,) = recording.remarks
    assert said.startswith("the times in the column 'time [s]' count from an epoch and are known to 0.24 us only")
