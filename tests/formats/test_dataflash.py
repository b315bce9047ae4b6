"""ArduPilot DataFlash: what was logged is what ArduPilot's own arithmetic makes of raw samples; reading gives these back."""

from __future__ import annotations

import struct

import dataflash_writer as w
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tables import rows, survives

from sagnac.errors import InputError
from sagnac.formats import blocks, open_table
from sagnac.formats.ardupilot import correction as ardupilot
from sagnac.formats.ardupilot import survey as dataflash_survey

N = 300
TIME = 3_000_000 + 2500 * np.arange(N)
_RNG = np.random.default_rng(6)
ACCEL, GYRO = 10.0 * _RNG.normal(size=(N, 3)), _RNG.normal(size=(N, 3))
ROUNDING = 2.0**-24  # of a number in single precision, relative; samples are rounded a dozen times on their way
TOLERANCE = np.repeat(
    [12 * 60.0 * ROUNDING, 12 * 8.0 * ROUNDING], 3
)  # 60 m/s^2 and 8 rad/s: the largest there is on the way


def made(parameters, temperature=30.0, instances=(0,)):
    """Log of the raw samples ACCEL and GYRO under these parameters."""
    return w.log(TIME, *logged(parameters, temperature), temperature, parameters=parameters, instances=instances)


def logged(parameters, temperature=30.0):
    warm = np.broadcast_to(temperature, N)
    accel, gyro = (
        np.array([w.corrected(kind, v, t, parameters) for v, t in zip(values, warm, strict=True)])
        for kind, values in (("accel", ACCEL), ("gyro", GYRO))
    )
    return gyro, accel


def put(folder, content):
    path = folder / "log.bin"
    path.write_bytes(content)
    return path


def raw(found, accel=ACCEL, gyro=GYRO):
    """Whether the samples are the raw ones."""
    assert found.shape == (len(accel), 7)
    assert np.all(np.abs(found[:, 1:] - np.hstack([accel, gyro])) < TOLERANCE)


SOUND = made(w.PARAMETERS)


@pytest.mark.parametrize("size", [1 << 10, 1 << 22])
def test_the_correction_is_taken_back(tmp_path, monkeypatch, size):
    monkeypatch.setattr(blocks, "SIZE", size)
    table = open_table(put(tmp_path, SOUND))
    found, fault = rows(table)
    assert fault is None
    raw(found)
    np.testing.assert_array_equal(found[:, 0], TIME / 1e6)
    assert table.position() == table.size == len(SOUND)
    assert "accelerometers offset (0.125, -0.25, 0.5) m/s^2, scale (1.01, 0.995, 1.002)" in table.remarks[0]
    assert "gyros offset (0.01, -0.02, 0.03) rad/s; orientation of the board 0 (none)" in table.remarks[0]
    assert "INS_ACCEL_FILTER 20 Hz, INS_GYRO_FILTER 40 Hz" in table.remarks[1]


def test_nothing_to_take_back_gives_what_was_logged_to_the_bit(tmp_path):
    neutral = {
        n: float("SCAL" in n) for n in w.PARAMETERS if n.startswith(("INS_ACCO", "INS_ACCS", "INS_GYRO", "AHRS"))
    }
    accel, gyro = ACCEL.astype("f4"), GYRO.astype("f4")
    table = open_table(put(tmp_path, w.log(TIME, gyro, accel, parameters=neutral)))
    np.testing.assert_array_equal(rows(table)[0][:, 1:], np.hstack([accel, gyro]))
    names = ["gyro_error_count", "accel_error_count", "gyro_health"]
    (batch,) = table.read(["temperature [degC]"], names)
    assert batch.column("temperature [degC]").to_pylist() == [30.0] * N
    assert [batch.column(n).to_pylist()[0] for n in names] == [1, 2, 1]


@pytest.mark.parametrize(
    "orientation", [1, 2, 3, 4, 6, 8, 9, 10, 12, 14, 15, 16, 18, 20, 24, 25, 26, 28, 33, 36, 37, 38, 39]
)
def test_the_orientation_of_the_board(orientation):
    """The turn is the one that ArduPilot's code writes out axis by axis (vector3.cpp)."""
    found = ardupilot.corrections(w.PARAMETERS | {"AHRS_ORIENTATION": float(orientation)}, 0)["gyro"].turn
    expected = np.array(w.rotated(orientation, *np.eye(3)), dtype=float)
    np.testing.assert_allclose(
        found, expected, atol=2e-6 if orientation == 38 else 1e-7
    )  # written with six digits there
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-15)
    if not np.any(np.abs(np.abs(expected) - 0.5) < 0.49):
        np.testing.assert_array_equal(found, expected)


def test_a_turned_board_is_turned_back(tmp_path):
    raw(rows(open_table(put(tmp_path, made(w.PARAMETERS | {"AHRS_ORIENTATION": 36.0}))))[0])


@pytest.mark.parametrize("number", [100, 101, 102])
def test_orientations_of_ones_own(number):
    angles = dict(zip(ardupilot._CUSTOM[number], (10.0, -20.0, 30.0), strict=True))
    found = ardupilot.corrections(w.PARAMETERS | {"AHRS_ORIENTATION": float(number)} | angles, 0)["accel"].turn
    assert np.arctan2(found[2, 1], found[2, 2]) == pytest.approx(np.radians(10))
    assert -np.arcsin(found[2, 0]) == pytest.approx(np.radians(-20))
    assert np.arctan2(found[1, 0], found[0, 0]) == pytest.approx(np.radians(30))


def test_polynomials_of_temperature(tmp_path):
    """Temperatures go beyond both limits of the polynomials, where they count as these."""
    warm = np.linspace(0.0, 70.0, N).astype("f4")
    parameters = w.PARAMETERS | w.THERMAL | {"AHRS_ORIENTATION": 2.0}
    table = open_table(put(tmp_path, made(parameters, warm)))
    assert "polynomials of temperature of the gyros, calibrated at 31 degC" in table.remarks[0]
    raw(rows(table)[0])
    flat = parameters | {"INS_TCAL1_ENABLE": 0.0}
    away = rows(open_table(put(tmp_path, w.log(TIME, *logged(parameters, warm), warm, parameters=flat))))[0]
    assert np.abs(away[:, 1:4] - ACCEL).max() > 0.5  # the polynomials of this test matter


def test_a_polynomial_that_is_being_learned_is_not_applied(tmp_path):
    raw(rows(open_table(put(tmp_path, made(w.PARAMETERS | {"INS_TCAL1_ENABLE": 2.0}))))[0])


def test_parameters_that_change_count_from_then_on(tmp_path):
    """Twice: to another offset and back, also within one piece of the file."""
    other = w.PARAMETERS | {"INS_GYROFFS_X": 0.5, "INS_GYROFFS_Z": -0.5, "INS_ACCSCAL_Y": 1.1}
    head = w.definitions() + b"".join(w.parameter(n, v) for n, v in w.PARAMETERS.items())
    (g1, a1), (g2, a2) = logged(w.PARAMETERS), logged(other)
    parts = [head]
    for k in range(N):
        if k in {100, 200}:
            now = other if k == 100 else w.PARAMETERS
            parts += [w.parameter(n, now[n], int(TIME[k])) for n in other if other[n] != w.PARAMETERS[n]]
        parts.append(w.imu(int(TIME[k]), *((g2[k], a2[k]) if 100 <= k < 200 else (g1[k], a1[k]))))
    table = open_table(put(tmp_path, b"".join(parts)))
    raw(rows(table)[0])
    changes = [text for text in table.remarks if "changed its correction" in text]
    assert [text[:66] for text in changes] == [
        f"the autopilot changed its correction, from {TIME[k - 1] / 1e6:.3f} s on was taken back"[:66]
        for k in (100, 200)
    ]
    assert "gyros offset (0.5, -0.02, -0.5)" in changes[0]
    rows(table)
    assert len(set(table.remarks)) == len(table.remarks)


def test_many_changes_are_counted(tmp_path):
    parts = [SOUND]
    for k in range(9):
        parts += [w.parameter("INS_GYROFFS_X", 0.1 * k + 0.2), w.imu(int(TIME[-1] + 1 + k), GYRO[0], ACCEL[0])]
    table = open_table(put(tmp_path, b"".join(parts)))
    rows(table)
    assert any("correction 4 times more" in text for text in table.remarks)


def test_parameters_that_come_behind_the_first_samples_are_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(dataflash_survey, "_BYTES", 100)
    monkeypatch.setattr(blocks, "SIZE", 1000)
    gyro, accel = logged(w.PARAMETERS)
    samples = b"".join(w.imu(int(t), g, a) for t, g, a in zip(TIME, gyro, accel, strict=True))
    late = b"".join(w.parameter(n, v) for n, v in w.PARAMETERS.items())
    raw(rows(open_table(put(tmp_path, w.definitions() + samples + late)))[0])


@pytest.mark.parametrize("missing", ["INS_ACCOFFS_Y", "INS_ACCSCAL_Z", "INS_GYROFFS_X", "AHRS_ORIENTATION"])
def test_missing_parameters_are_named(tmp_path, missing):
    gyro, accel = logged(w.PARAMETERS)
    few = {n: v for n, v in w.PARAMETERS.items() if n != missing}
    with pytest.raises(InputError, match=rf"log\.bin: the parameter {missing} is not there"):
        open_table(put(tmp_path, w.log(TIME, gyro, accel, parameters=few)))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"INS_ACCSCAL_X": 0.0}, r"INS_ACCSCAL_X, _Y, _Z are \(0, 0.995, 1.002\)"),
        ({"INS_ACCSCAL_X": float("nan")}, "INS_ACCSCAL_X is not a number"),
        ({"AHRS_ORIENTATION": 77.0}, "AHRS_ORIENTATION is 77"),
        ({"AHRS_ORIENTATION": 101.0}, "CUST_ROT1_ROLL is not there"),
        ({"INS_TCAL1_ENABLE": 1.0}, "INS_TCAL1_ACC1_X is not there"),
    ],
)
def test_parameters_that_make_no_sense(tmp_path, change, reason):
    with pytest.raises(InputError, match=reason):
        open_table(put(tmp_path, w.log(TIME[:2], GYRO, ACCEL, parameters=w.PARAMETERS | change)))


def test_names_of_the_parameters_of_each_instance():
    assert ardupilot.names(1)["accel"] == "INS_ACC2OFFS"
    assert ardupilot.names(2)["gyro_calibrated"] == "INS_GYR3_CALTEMP"
    assert ardupilot.names(3) == {
        "accel": "INS4_ACCOFFS", "scale": "INS4_ACCSCAL", "gyro": "INS4_GYROFFS", "thermal": "INS4_TCAL_",
        "accel_calibrated": "INS4_ACC_CALTEMP", "gyro_calibrated": "INS4_GYR_CALTEMP",
    }  # fmt: skip
    assert ardupilot.concerns("INS4_GYROFFS_X", 3)
    assert not ardupilot.concerns("INS4_GYROFFS_X", 0)


def second(parameters):
    """The parameters of the first instance for the second."""
    change = {"INS_ACCOFFS": "INS_ACC2OFFS", "INS_ACCSCAL": "INS_ACC2SCAL", "INS_GYROFFS": "INS_GYR2OFFS"}
    return {change.get(n[:-2], n[:-2]) + n[-2:]: v for n, v in parameters.items()}


def test_instances_are_chosen(tmp_path):
    gyro, accel = logged(w.PARAMETERS)
    path = put(tmp_path, w.log(TIME, gyro, accel, parameters=w.PARAMETERS | second(w.PARAMETERS), instances=(0, 1)))
    with pytest.raises(InputError, match=r"IMU/0 \(IMU 400 Hz\); IMU/1 .*--select 0"):
        open_table(path)
    with pytest.raises(InputError, match="no '7' in this log"):
        open_table(path, "7")
    for select in ("1", "IMU/1"):
        table = open_table(path, select)
        raw(rows(table)[0])
        assert table.choice == "IMU/1"
        assert table.remarks[0].startswith("messages IMU, instance 1 (INS_ACC2OFFS_X, ...): ")


def test_old_logs_have_a_message_for_each_instance(tmp_path):
    gyro, accel = logged(w.PARAMETERS)
    parts = [w.definitions(w.OLD)]
    parts += [w.parameter(n, v, messages=w.OLD) for n, v in (w.PARAMETERS | second(w.PARAMETERS)).items()]
    for t, g, a in zip(TIME.tolist(), gyro, accel, strict=True):
        parts += [w.message("IMU", t, *g, *a, 0, 0, 35.0, messages=w.OLD)]
        parts += [w.message("IMU2", t, *(2 * g), *a, 0, 0, 36.0, messages=w.OLD)]
    path = put(tmp_path, b"".join(parts))
    raw(rows(open_table(path, "0"))[0])
    other = open_table(path, "1")
    (batch,) = other.read(["temperature [degC]", "gyro_x [rad/s]"], ["gyro_error_count"])
    assert batch.column(0).to_pylist() == [36.0] * N
    np.testing.assert_allclose(batch.column(1).to_numpy(), 2.0 * gyro[:, 0] + 0.01, atol=1e-7)


def unfiltered(offset=0, temperature=30.0, parameters=w.PARAMETERS):
    """ACC and GYR at the rate of the sensors, IMU beside them at a tenth, warming up."""
    gyro, accel = logged(parameters, temperature)
    warm = np.broadcast_to(temperature, N)
    parts = [w.definitions(), *(w.parameter(n, v) for n, v in parameters.items())]
    for k, t in enumerate(TIME.tolist()):
        parts += [w.imu(t, gyro[k], accel[k], warm[k])] if k % 10 == 0 else []
        parts += [w.message("ACC", t + 400, 0, t + offset, *accel[k]), w.message("GYR", t + 500, 0, t, *gyro[k])]
    return b"".join(parts)


def test_samples_before_the_filters_are_preferred(tmp_path):
    path = put(tmp_path, unfiltered())
    table = open_table(path)
    assert table.remarks[0].startswith("messages ACC and GYR, instance 0")
    assert not any("filter" in text for text in table.remarks)
    assert table.choice == "RAW/0"
    found = rows(table)[0]
    raw(found)
    np.testing.assert_array_equal(found[:, 0], TIME / 1e6)
    assert rows(open_table(path, "IMU/0"))[0].shape == (N // 10, 7)
    with pytest.raises(InputError, match=r"RAW/0 \(ACC 400 Hz, GYR 400 Hz\); IMU/0 \(IMU 40 Hz\)"):
        open_table(path, "1")


def test_samples_of_other_times_are_joined(tmp_path):
    table = open_table(put(tmp_path, unfiltered(offset=700)))
    assert any("-0.700 ms from the nearest" in text for text in table.remarks)
    found = rows(table)[0]
    share = 1800 / 2500  # from the sample before, 700 us behind the gyros' time before
    expected = ACCEL[:-1] * (1 - share) + ACCEL[1:] * share
    raw(found, expected, GYRO[1:])


def test_temperature_of_unfiltered_samples_is_that_of_the_last_imu_message(tmp_path):
    warm = np.repeat(np.linspace(15.0, 55.0, N // 10), 10).astype("f4")
    table = open_table(put(tmp_path, unfiltered(0, warm, w.PARAMETERS | w.THERMAL)))
    raw(rows(table)[0])
    np.testing.assert_array_equal(rows(table, ["temperature [degC]"])[0][:, 0], warm)


def test_temperature_is_needed_where_it_was_corrected_for(tmp_path):
    parameters = w.PARAMETERS | w.THERMAL
    parts = [w.definitions(), *(w.parameter(n, v) for n, v in parameters.items())]
    parts += [w.message("ACC", 5, 0, 5, 0, 0, 0), w.message("GYR", 5, 0, 5, 0, 0, 0)]
    with pytest.raises(InputError, match="no temperature is in messages IMU"):
        open_table(put(tmp_path, b"".join(parts)))


@pytest.mark.parametrize(
    ("options", "accelerometers", "gyros"),
    [
        ({"INS_RAW_LOG_OPT": 4.0}, "", "were"),
        ({"INS_RAW_LOG_OPT": 8.0}, "", ""),
        ({"INS_RAW_LOG_OPT": 12.0}, "", ""),
        ({"INS_LOG_BAT_OPT": 2.0}, "were", "were"),
        ({"INS_LOG_BAT_OPT": 1.0}, "", ""),
        ({"INS_LOG_BAT_OPT": 3.0}, "may in part have been", "may in part have been"),
        ({"INS_LOG_BAT_OPT": 4.0}, "may in part have been", "may in part have been"),
        ({"INS_LOG_BAT_OPT": 2.0, "INS_LOG_BAT_MASK": 0.0}, "", ""),
        ({"INS_LOG_BAT_OPT": 2.0, "INS_LOG_BAT_MASK": 1.0, "INS_RAW_LOG_OPT": 0.0}, "were", ""),
        ({"INS_LOG_BAT_OPT": float("nan"), "INS_RAW_LOG_OPT": float("inf")}, "", ""),
    ],
)
def test_samples_behind_the_filters_are_known_by_the_parameters(tmp_path, options, accelerometers, gyros):
    """AP_InertialSensor_Backend.cpp, log_accel_raw and log_gyro_raw; BatchSampler.cpp."""
    table = open_table(put(tmp_path, unfiltered(parameters=w.PARAMETERS | options)))
    expected = [("ACC", accelerometers, "accelerometers"), ("GYR", gyros, "gyros")]
    told = [text.rpartition(" (")[0] for text in table.remarks if "behind the filters" in text]
    assert told == [f"samples in {m} {how} logged behind the filters of the {s}" for m, how, s in expected if how]


def test_filtered_gyros_and_lost_messages_are_remarks(tmp_path):
    lost = w.message("DSF", 0, 3, 0, 0, 0, 0, 0) + w.message("DSF", 0, 12, 0, 0, 0, 0, 0)
    table = open_table(put(tmp_path, unfiltered(parameters=w.PARAMETERS | {"INS_RAW_LOG_OPT": 4.0}) + lost))
    rows(table)
    assert any("behind the filters of the gyros" in text for text in table.remarks)
    assert "the logger lost 12 messages" in table.remarks


def test_values_that_are_no_numbers_are_handed_on_without_a_word(tmp_path):
    odd = np.array([0x7FA00000, 0x7F800000, 0xFF800000], dtype="u4").view("f4")
    sound = w.imu(5, np.zeros(3), np.zeros(3))
    bad = sound[:12] + odd.tobytes() * 2 + sound[36:]
    content = w.definitions() + b"".join(
        w.parameter(n, v) for n, v in (w.PARAMETERS | {"AHRS_ORIENTATION": 1.0}).items()
    )
    found, _ = rows(open_table(put(tmp_path, content + bad)))
    assert not np.any(np.isfinite(found[:, 1:]))


def test_a_log_without_samples(tmp_path):
    with pytest.raises(InputError, match="no messages IMU"):
        open_table(put(tmp_path, w.definitions() + w.parameter("AHRS_ORIENTATION", 0.0)))


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"\0", "no DataFlash message"),
        (b"\xa3\x95", "ends within a message"),
        (b"\xa3\x95\x63garbage", "no DataFlash message"),
        (w.HEAD + bytes([70]) + b"short", "ends within a message"),
        (b"\xff" * 100, "no DataFlash message"),
        (w.definition("IMU", 70, "Q", "TimeUS"), "defined twice"),
        (w.definition("IMX", 99, "Q", "TimeUS", 0) + w.HEAD + b"\x63", "no DataFlash message"),
        (w.definition("IMU3", 99, "Q", "TimeUS", 50), "said to have 50 bytes"),
        (w.definition("IMU3", 99, "Q", "TimeUS,Q", 50), "cannot be"),
        (w.definition("IMU3", 99, "QQ", "TimeUS,TimeUS", 50), "cannot be"),
        (w.definition("IMU3", 99, "Q", "TimeUS").replace(b"TimeUS", b"Time\xffS"), "is no text"),
    ],
)
def test_damage_is_told_with_its_byte_and_what_lies_before_is_handed_out(tmp_path, bad, reason):
    found, fault = rows(open_table(put(tmp_path, SOUND + bad)))
    raw(found)
    assert reason in str(fault)
    assert len(SOUND) <= fault.offset <= len(SOUND) + 89


def test_damage_in_the_middle(tmp_path):
    content = bytearray(SOUND)
    at = SOUND.index(w.HEAD + bytes([70]), len(SOUND) // 2)
    content[at] = 0
    found, fault = rows(open_table(put(tmp_path, bytes(content))))
    assert fault.offset == at
    assert 0.3 * N < len(found) < 0.6 * N
    raw(found, ACCEL[: len(found)], GYRO[: len(found)])


def test_messages_of_an_unknown_kind_are_refused(tmp_path):
    content = w.definitions({"IMU": (70, "Qf", "TimeUS,AccX")}) + w.HEAD + bytes([70]) + struct.pack("<Qf", 1, 0)
    with pytest.raises(InputError, match="IMU have no AccY, AccZ, GyrX, GyrY, GyrZ"):
        open_table(put(tmp_path, content))


SHORT = w.log(TIME[:15], GYRO, ACCEL)
FIRST = SHORT.index(w.HEAD + bytes([70]))


@given(st.one_of(st.integers(3, len(SHORT) - 1), st.integers(FIRST, len(SHORT) - 1)))
def test_truncated_anywhere_a_prefix_is_handed_out(tmp_path, cut):
    path = put(tmp_path, SHORT)
    truth, _ = rows(open_table(path))
    path = put(tmp_path, SHORT[:cut])
    if cut < FIRST + 54:  # the first sample is not whole yet
        with pytest.raises(InputError):
            open_table(path)
        return
    found, fault = rows(open_table(path))
    np.testing.assert_array_equal(found, truth[: len(found)])
    assert len(found) >= SHORT[:cut].count(w.HEAD + bytes([70])) - 1
    assert fault is None or fault.offset <= cut


flips = st.lists(st.tuples(st.integers(3, len(SHORT) - 1), st.integers(0, 255)), min_size=1, max_size=8)


@given(flips)
def test_flipped_bytes_never_crash(tmp_path, changes):
    content = bytearray(SHORT)
    for at, value in changes:
        content[at] = value
    survives(put(tmp_path, bytes(content)))


@given(st.binary(max_size=300))
def test_any_bytes_behind_the_first_never_crash(tmp_path, content):
    survives(put(tmp_path, b"\xa3\x95\x80" + content))


forms = st.sampled_from(["QBffffff", "QNf", "fff", "", "aaaa", "Zf", "gdqb", "QBQfff"])
labels = st.sampled_from(
    ["TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "TimeUS,Name,Value", "A,A,B", "", "TimeUS,I,SampleUS,AccX,AccY,AccZ"]
)
definitions = st.builds(
    lambda name, kind, form, label, length: (
        w.HEAD + b"\x80" + struct.pack("<BB4s16s64s", kind, length, name, form.encode(), label.encode())
    ),
    st.sampled_from([b"IMU", b"PARM", b"ACC", b"GYR", b"DSF", b"\xff"]),
    st.integers(126, 133),
    forms,
    labels,
    st.sampled_from([0, 2, 3, 31, 36, 36, 37, 89]),
)
messages = st.tuples(st.integers(126, 133), st.binary(min_size=28, max_size=34)).map(
    lambda m: w.HEAD + bytes([m[0]]) + m[1]
)


@given(st.lists(st.one_of(definitions, messages), max_size=12))
def test_messages_in_any_order_never_crash(tmp_path, parts):
    survives(
        put(tmp_path, w.definitions() + b"".join(w.parameter(n, v) for n, v in w.PARAMETERS.items()) + b"".join(parts))
    )
    survives(put(tmp_path, w.HEAD + b"\x80" + b"".join(parts)))
