"""Compensated recordings: the inverse of the instrument, whole files, nothing lost."""

from __future__ import annotations

import hashlib
import json
import math
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv as pacsv
from pyarrow import parquet

from sagnac.calibration import loads
from sagnac.compensation import apply, compensate, corrections
from sagnac.errors import DataError, InputError
from sagnac.formats import parquet as parquet_format
from sagnac.formats.text import csv as csv_format
from sagnac.recording import from_arrays, open_recording
from sagnac.sensors import forward

G = 9.80665
DEG = math.pi / 180
N = 500
RNG = np.random.default_rng(11)
FORCE = RNG.normal(size=(N, 3)) * 10
RATE = RNG.normal(size=(N, 3))
TIME = np.arange(1, N + 1) * 0.01


def listed(folder: Path = Path()) -> list[str]:
    """Names in a folder."""
    return sorted(p.name for p in folder.iterdir())


def unit_of(name: str) -> str:
    kind, term, _ = name.split(".")
    reading = {"accel": "m/s^2", "gyro": "rad/s"}[kind]
    units = {"bias": reading, "misalignment": "rad", "g_sensitivity": "rad*s/m", "scale_factor": f"count/({reading})"}
    units["k2"] = "s^2/m"
    return units.get(term, "1")


def calibration(values: dict[str, float]):
    return loads(
        json.dumps(
            {
                "schema": "sagnac/calibration/1",
                "method": "by hand",
                "parameters": [
                    {"name": n, "value": v, "unit": unit_of(n), "standard_uncertainty": 0.0}
                    for n, v in values.items()
                ],
                "covariance": np.zeros((len(values), len(values))).tolist(),
                "fit": {
                    "chi2": 0.0, "degrees_of_freedom": 0, "residual_rms": 0.0, "converged": True, "iterations": 0
                },
                "site": {"gravity": 9.81},
                "software": {"version": "0"},
                "created": "2000-01-01T00:00:00+00:00",
            }
        )
    )  # fmt: skip


ACCEL = {
    "accel.scale_error.x": 0.01, "accel.scale_error.y": -0.02, "accel.scale_error.z": 0.0,
    "accel.misalignment.yx": 1e-3, "accel.misalignment.zx": -2e-3, "accel.misalignment.zy": 3e-3,
    "accel.bias.x": 0.1, "accel.bias.y": -0.2, "accel.bias.z": 0.3, "accel.k2.x": 1e-4,
}  # fmt: skip
GYRO = {
    "gyro.bias.x": 0.01,
    "gyro.bias.y": 0.0,
    "gyro.bias.z": 0.0,
    "gyro.misalignment.xy": 1e-3,
    "gyro.g_sensitivity.xz": 1e-4,
}
BOTH = calibration(ACCEL | GYRO)


def readings(cal=BOTH):
    models = corrections(cal, from_arrays(TIME, FORCE, RATE))
    return forward(models["accel"], FORCE), forward(models["gyro"], RATE, FORCE)


@pytest.fixture
def log(tmp_path):
    accel, gyro = readings()
    names = ["time [s]", *(f"accel_{a} [m/s^2]" for a in "xyz"), *(f"gyro_{a} [rad/s]" for a in "xyz")]
    columns = dict(zip(names, np.column_stack([TIME, accel, gyro]).T, strict=True))
    columns |= {"outer [deg]": np.full(N, 90.0), "temperature [degC]": np.full(N, 20.0)}
    columns |= {"remark": [f"r{i}" for i in range(N)], "volt [V]": np.arange(N)}
    path = tmp_path / "log.parquet"
    parquet.write_table(pa.table(columns), path)
    return path


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
@pytest.mark.parametrize("rows", [64, 1 << 17])
def test_inputs_come_back_and_nothing_is_lost(tmp_path, log, monkeypatch, ending, rows):
    monkeypatch.setattr(parquet_format, "_ROWS", rows)
    before = hashlib.sha256(log.read_bytes()).digest()
    out, told = tmp_path / f"out{ending}", []
    assert apply(BOTH, open_recording(log), out, progress=told.append) == N
    assert told[-1] == N
    assert hashlib.sha256(log.read_bytes()).digest() == before
    batch = open_recording(out).read()
    np.testing.assert_array_equal(batch.time, TIME)
    # readings up to 40 m/s^2, matrices near one: a few roundings, 7e-15 each
    np.testing.assert_allclose(batch.accel, FORCE, rtol=0, atol=4e-14)
    np.testing.assert_allclose(batch.gyro, RATE, rtol=0, atol=4e-15)
    np.testing.assert_allclose(batch.rig["outer"], math.pi / 2, rtol=1e-15)
    np.testing.assert_allclose(batch.rig["temperature"], 293.15, rtol=1e-15)
    table = parquet.read_table(out) if ending == ".parquet" else pacsv.read_csv(out)
    assert table.column("remark").to_pylist() == [f"r{i}" for i in range(N)]
    assert table.column("volt [V]").to_pylist() == list(range(N))
    assert listed(tmp_path) == ["log.parquet", f"out{ending}"]


def test_a_second_pass_with_the_identity_changes_nothing(tmp_path, log):
    identity = calibration({f"accel.scale_error.{a}": 0.0 for a in "xyz"} | {f"gyro.bias.{a}": 0.0 for a in "xyz"})
    apply(BOTH, open_recording(log), tmp_path / "one.parquet")
    apply(identity, open_recording(tmp_path / "one.parquet"), tmp_path / "two.csv")
    one, two = open_recording(tmp_path / "one.parquet").read(), open_recording(tmp_path / "two.csv").read()
    np.testing.assert_array_equal(one.accel, two.accel)
    np.testing.assert_array_equal(one.gyro, two.gyro)


def test_a_sensor_without_calibration_is_passed_on(tmp_path, log):
    apply(calibration(ACCEL), open_recording(log), tmp_path / "out.parquet")
    batch = open_recording(tmp_path / "out.parquet").read()
    np.testing.assert_allclose(batch.accel, FORCE, rtol=0, atol=4e-14)
    np.testing.assert_array_equal(batch.gyro, open_recording(log).read().gyro)


def test_raw_counts_without_calibration_stay_counts(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(
        "time [s],accel_x [LSB],accel_y [LSB],accel_z [LSB],gyro_x [LSB],gyro_y [LSB],gyro_z [LSB]\n0.1,1,2,3,4,5,6\n"
    )
    scale = {f"accel.scale_factor.{a}": 100.0 for a in "xyz"}
    apply(calibration(scale), open_recording(path), tmp_path / "out.parquet")
    out = open_recording(tmp_path / "out.parquet")
    assert out.counts == {"gyro"}
    assert out.read().gyro.tolist() == [[4, 5, 6]]
    assert out.read().accel == pytest.approx(np.array([[0.01, 0.02, 0.03]]), rel=1e-15)


def test_columns_that_were_not_meant_keep_their_numbers_under_another_name(tmp_path):
    # two units in one file: the second is calibrated, the first must neither be overwritten nor stand for it
    path = tmp_path / "log.csv"
    names = [*(f"accel_{a} [m/s^2]" for a in "xyz"), *(f"second_{a} [m/s^2]" for a in "xyz")]
    path.write_text(",".join(["time [s]", *names]) + "\n0.1,1,2,3,4,5,6\n")
    recording = open_recording(path, rename={f"accel_{a}": f"second_{a}" for a in "xyz"})
    apply(
        calibration({"accel.bias.x": 1.0, "accel.bias.y": 0.0, "accel.bias.z": 0.0}),
        recording,
        tmp_path / "out.parquet",
    )
    out = parquet.read_table(tmp_path / "out.parquet").to_pydict()
    assert out["accel_x [m/s^2]"] == [3.0]
    assert out["input accel_x [m/s^2]"] == [1]
    assert open_recording(tmp_path / "out.parquet").read().accel.tolist() == [[3, 5, 6]]


@pytest.mark.parametrize("name", ["out.txt", "out", "out.parquet.gz"])
def test_other_endings_are_refused(tmp_path, log, name):
    with pytest.raises(InputError, match=r"write to a \.parquet or \.csv file"):
        apply(BOTH, open_recording(log), tmp_path / name)


def test_the_recording_itself_is_never_the_output(tmp_path, log):
    before = log.read_bytes()
    (tmp_path / "link.parquet").symlink_to(log)
    for out in (log, tmp_path / "link.parquet", tmp_path / "." / "log.parquet"):
        with pytest.raises(InputError, match="is the recording itself; input is never modified"):
            apply(BOTH, open_recording(log), out)
    assert log.read_bytes() == before


def test_an_error_on_the_way_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_format, "_BLOCK", 200)
    path = tmp_path / "log.csv"
    path.write_text(
        "time [s],accel_x [g],accel_y [g],accel_z [g]\n"
        + "".join(f"{t!r},0,0,{'nan' if i == 400 else 1}\n" for i, t in enumerate(TIME.tolist()))
    )
    written = []
    with pytest.raises(InputError, match="row 401: accel_z is missing or not a number"):
        apply(calibration(ACCEL), open_recording(path), tmp_path / "out.csv", progress=written.append)
    assert written[-1] > 300  # it had begun to write
    assert listed(tmp_path) == ["log.csv"]


def test_no_samples(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time [s],accel_x [g],accel_y [g],accel_z [g]\n")
    with pytest.raises(DataError, match=r"log\.csv: no samples to compensate"):
        apply(calibration(ACCEL), open_recording(path), tmp_path / "out.csv")
    assert listed(tmp_path) == ["log.csv"]


def test_units_of_calibration_and_recording_must_agree():
    counts = calibration({f"accel.scale_factor.{a}": 100.0 for a in "xyz"})
    with pytest.raises(InputError, match="is for readings in raw counts, but mine gives SI units"):
        corrections(counts, from_arrays(TIME, FORCE, name="mine"))
    with pytest.raises(InputError, match="is for readings in SI units, but mine gives raw counts"):
        corrections(calibration(ACCEL), from_arrays(TIME, FORCE, name="mine", counts=("accel",)))


def test_a_calibration_of_the_other_sensor_is_refused():
    with pytest.raises(DataError, match=r"says nothing about the sensors in mine \(gyro\)"):
        corrections(calibration(ACCEL), from_arrays(TIME, gyro=RATE, name="mine"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: p if p["name"] != "accel.scale_error.z" else None, "gives accel.scale_error of x, y only"),
        (
            lambda p: p | ({"unit": "mg"} if p["name"] == "accel.bias.x" else {}),
            "accel.bias.x in 'mg'; it must be in 'm/s",
        ),
        (lambda p: p | ({"value": -1.0} if p["name"] == "accel.scale_error.y" else {}), "an axis has no gain"),
    ],
)
def test_hand_edited_files_are_looked_at(change, said):
    table = json.loads(calibration(ACCEL).to_json())
    table["parameters"] = [q for q in map(change, table["parameters"]) if q is not None]
    table["covariance"] = np.zeros((len(table["parameters"]),) * 2).tolist()
    with pytest.raises(DataError, match=re.escape(said)):
        corrections(loads(json.dumps(table)), from_arrays(TIME, FORCE))


def test_g_sensitive_gyros_need_accelerometers():
    cal, recording = calibration(GYRO), from_arrays(TIME, gyro=RATE)
    with pytest.raises(DataError, match="needs the accelerometers of the same recording"):
        compensate(recording.read(), corrections(cal, recording))


def test_a_part_of_a_triad_is_not_compensated():
    # a centrifuge run of one gyro says nothing about the two others
    cal = calibration(ACCEL | {"gyro.bias.x": 0.01, "gyro.d_i.x": 1e-6})
    with pytest.raises(DataError, match="covers gyro x only"):
        corrections(cal, from_arrays(TIME, FORCE, RATE))


def test_gyros_that_answer_to_forces_nobody_calibrated():
    cal = calibration({f"gyro.bias.{a}": 0.01 for a in "xyz"} | {f"gyro.d_i.{a}": 1e-6 for a in "xyz"})
    with pytest.raises(DataError, match=r"gyro\.d_i\.x in '1'; it must be in 'rad\*s/m'"):
        corrections(cal, from_arrays(TIME, FORCE, RATE))
    right = cal.model_copy(
        update={
            "parameters": tuple(
                p.model_copy(update={"unit": "rad*s/m"}) if ".d_i." in p.name else p for p in cal.parameters
            )
        }
    )
    recording = from_arrays(TIME, FORCE, RATE)
    with pytest.raises(DataError, match="calibrate accelerometers and gyros together"):
        compensate(recording.read(), corrections(right, recording))
