"""From the log of an autopilot to its parameters: the calibration knows which sensor it is of, and the export goes there."""

from __future__ import annotations

import dataflash_writer
import numpy as np
import pytest
import ulog_writer

from sagnac.calibrate import hand_turned
from sagnac.calibration import load
from sagnac.export import export
from sagnac.plan import Plan
from sagnac.recording import from_arrays, open_recording
from sagnac.sensors import Correction
from sagnac.simulate.hand import simulate_hand_turned

BIAS = np.array([0.2, -0.1, 0.3])
NONE = {f"INS_{w}_{a}": v for w, v in (("ACCOFFS", 0.0), ("ACCSCAL", 1.0), ("GYROFFS", 0.0)) for a in "XYZ"}


@pytest.fixture(scope="module")
def turned():
    """Time [us], accelerometers and gyros of a unit with known biases that was turned by hand."""
    accel = Correction("accel", np.diag([1.01, 0.99, 1.02]), BIAS)
    gyro = Correction("gyro", np.eye(3), np.array([0.01, 0.02, -0.03]))
    random = np.random.default_rng(2)
    time, force, rate = simulate_hand_turned(accel, gyro, random, accel_noise=1e-3, gyro_noise=1e-4)
    return np.rint(time * 1e6).astype(int) + 1_000_000, force, rate


def ardupilot(time, force, rate):
    """Instance 1 of two, each with an offset and a scale that change nothing."""
    both = NONE | {n.replace("OFFS", "2OFFS").replace("SCAL", "2SCAL"): v for n, v in NONE.items()}
    return dataflash_writer.log(time, rate, force, parameters={"AHRS_ORIENTATION": 0.0} | both, instances=(0, 1))


def px4(time, force, _):
    """Two instances of accelerometers alone; the writer adds the instance to its values."""
    return ulog_writer.log(time, force - np.float32(1), [], np.zeros((0, 3)), instances=(0, 1))


@pytest.mark.parametrize(
    ("write", "select", "choice", "name", "target", "offset"),
    [
        (ardupilot, "1", "IMU/1", "ArduPilot DataFlash", "ardupilot", "INS_ACC2OFFS_X,"),
        (px4, "1", "1", "PX4 ULog", "px4", "1\t1\tCAL_ACC1_XOFF\t"),
    ],
)
def test_parameters_are_those_of_the_sensor_in_the_log(tmp_path, turned, write, select, choice, name, target, offset):
    (tmp_path / "log").write_bytes(write(*turned))
    recording = open_recording(tmp_path / "log", select=select)
    assert (recording.format, recording.select) == (name, choice)
    batch = recording.read()
    alone = from_arrays(batch.time, batch.accel)
    assert (alone.format, alone.select) == (None, None)
    found = hand_turned.calibrate(recording, Plan(gravity=9.80665))
    assert (found.source[0].format, found.source[0].select) == (name, choice)
    found.save(tmp_path / "cal.json")
    (line,) = [
        t for t in export(load(tmp_path / "cal.json"), target).files[""].decode().splitlines() if t.startswith(offset)
    ]
    written = float(line.removeprefix(offset).partition("\t")[0])
    assert written == pytest.approx(found["accel.bias.x"].value, rel=1e-6)
    assert written == pytest.approx(BIAS[0], abs=5e-3)
