"""PX4 ULog: files written from the format's description and by pyulog, read to the bit; damage of every kind."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
import ulog_writer as w
from hypothesis import given
from hypothesis import strategies as st
from pyulog import ULog
from tables import AXES, rows, survives

from sagnac.errors import InputError
from sagnac.formats import Fault, blocks, open_table
from sagnac.formats.px4 import survey as ulog_survey

N = 400
TIME = 2_000_000 + 1000 * np.arange(N)
_RNG = np.random.default_rng(5)
ACCEL, GYRO = _RNG.normal(size=(N, 3)).astype("f4"), _RNG.normal(size=(N, 3)).astype("f4")
SOUND = w.log(TIME, ACCEL, TIME, GYRO)


def put(folder, content):
    path = folder / "log.ulg"
    path.write_bytes(content)
    return path


TRUTH = np.column_stack([TIME / 1e6, ACCEL.astype(float), GYRO.astype(float)])


@pytest.mark.parametrize("size", [1 << 10, 1 << 22])
def test_samples_are_those_that_were_logged(tmp_path, monkeypatch, size):
    monkeypatch.setattr(blocks, "SIZE", size)
    table = open_table(put(tmp_path, SOUND))
    found, fault = rows(table)
    assert fault is None
    np.testing.assert_array_equal(found, TRUTH)
    assert table.position() == table.size == len(SOUND)
    again, _ = rows(table)
    np.testing.assert_array_equal(again, TRUTH)


def test_what_goes_along(tmp_path):
    content = w.log(TIME, ACCEL, TIME, GYRO, temperature=41.5, errors=7, clips=(0, 2, 0))
    table = open_table(put(tmp_path, content))
    names = ["gyro_error_count", "accel_error_count", "gyro_clip_y", "accel_clip_x"]
    batches = list(table.read(["temperature [degC]"], names))
    assert {v for b in batches for v in b.column("temperature [degC]").to_pylist()} == {41.5}
    assert [{v for b in batches for v in b.column(n).to_pylist()} for n in names] == [{7}, {7}, {2}, {0}]
    assert any("sensor_gyro: the sensor reached the end of its range (messages: 400)" in text for text in table.remarks)
    list(table.read(["time [s]"], []))
    assert len(set(table.remarks)) == len(table.remarks)  # a second reading says nothing twice


def test_pyulog_reads_the_same(tmp_path):
    """Our writer is judged by the reader that PX4 keeps, and our reader against it."""
    path = put(tmp_path, SOUND)
    log = ULog(str(path))
    assert not log.file_corruption
    for name, kind in (("sensor_accel", "accel"), ("sensor_gyro", "gyro")):
        theirs = log.get_dataset(name).data
        ours, _ = rows(open_table(path), [f"{kind}_{a} [{'m/s^2' if kind == 'accel' else 'rad/s'}]" for a in "xyz"])
        for i, axis in enumerate("xyz"):
            np.testing.assert_array_equal(ours[:, i], theirs[axis].astype(float))
        np.testing.assert_array_equal(theirs["timestamp_sample"], TIME)


def test_what_pyulog_writes_is_read(tmp_path):
    log = ULog(str(put(tmp_path, SOUND)))
    written = tmp_path / "again.ulg"
    with written.open("wb") as stream:
        log.write_ulog(stream)
    found, fault = rows(open_table(written))
    assert fault is None
    np.testing.assert_array_equal(found, TRUTH)


def test_sensors_with_times_of_their_own_are_joined(tmp_path):
    """Accelerometers at 800 Hz that change linearly: at the gyros' times they are what the line says."""
    slow = 2_000_000 + 1250 * np.arange(320) + 70
    line = np.outer((slow - 2_000_000) / 1e6, [64.0, -32.0, 16.0])
    table = open_table(put(tmp_path, w.log(slow, line, TIME, GYRO)))
    assert any("gyros at 1000 Hz and accelerometers at 800 Hz" in text for text in table.remarks)
    found, _ = rows(table)
    inside = (slow[0] <= TIME) & (slow[-1] >= TIME)
    np.testing.assert_array_equal(found[:, 0], TIME[inside] / 1e6)
    np.testing.assert_array_equal(found[:, 4:], GYRO[inside])
    np.testing.assert_allclose(found[:, 1:4], np.outer(found[:, 0] - 2.0, [64.0, -32.0, 16.0]), atol=2e-6)  # float32
    assert table.remarks[-1].endswith(f"near enough before and after: {N - inside.sum()}")


def test_accelerometers_in_large_bunches_lose_no_rows(tmp_path):
    """Bunches of 20, stamped 10 us apart every 20 ms; only gyros behind the last of the accelerometers are left out."""
    bunched = 2_000_000 + np.arange(N) // 20 * 20_000 + np.arange(N) % 20 * 10
    table = open_table(put(tmp_path, w.log(bunched, ACCEL, TIME, GYRO)))
    found, _ = rows(table)
    np.testing.assert_array_equal(found[:, 0], TIME[bunched[-1] >= TIME] / 1e6)


@pytest.mark.parametrize("size", [1 << 10, 1 << 22])
def test_gyros_whose_time_goes_back_are_refused_in_logs_of_any_size(tmp_path, monkeypatch, size):
    """In small pieces rows have been handed out before; what comes again must not vanish."""
    monkeypatch.setattr(blocks, "SIZE", size)
    again = w.log([], np.zeros((0, 3)), TIME[100:120], GYRO[100:120])
    again = again[again.index(w.data(20, w.gyro(int(TIME[100]), GYRO[100]))) :]
    with pytest.raises(InputError, match="the time of the gyros goes from 2.399000 s to 2.100000 s"):
        rows(open_table(put(tmp_path, SOUND + again)))


def test_one_sensor_alone(tmp_path):
    table = open_table(put(tmp_path, w.log([], np.zeros((0, 3)), TIME, GYRO)))
    assert table.columns[:4] == ("time [s]", *AXES[3:])
    found, _ = rows(table, ["time [s]", *AXES[3:]])
    np.testing.assert_array_equal(found, TRUTH[:, [0, 4, 5, 6]])


def test_instances_are_chosen_by_name(tmp_path):
    path = put(tmp_path, w.log(TIME, ACCEL, TIME, GYRO, instances=(0, 2)))
    with pytest.raises(InputError, match=r"holds 0 \(sensor_accel 1000 Hz, device 1310988.*; 2 \(.*--select 0"):
        open_table(path)
    with pytest.raises(InputError, match="no '1' among the sensors in this log, which holds 0"):
        open_table(path, "1")
    found, _ = rows(open_table(path, "2"))
    np.testing.assert_array_equal(found[:, 1:], np.hstack([ACCEL, GYRO]) + np.float32(2))


def test_an_instance_that_begins_late_can_be_chosen(tmp_path, monkeypatch):
    monkeypatch.setattr(ulog_survey, "_BYTES", 1000)
    late = w.subscribe(31, "sensor_gyro", 1) + b"".join(w.data(31, w.gyro(t + 10**6, GYRO[0])) for t in TIME[:5])
    path = put(tmp_path, SOUND + late)
    monkeypatch.setattr(blocks, "SIZE", 1000)
    np.testing.assert_array_equal(rows(open_table(path))[0], TRUTH)
    assert rows(open_table(path, "1"), AXES[3:])[0].shape == (5, 3)


def test_fields_are_found_by_their_definition(tmp_path):
    """An older and a newer message: other order, an array and a nested type before the fields, no sample time."""
    head = w.header() + w.definition(w.VECTOR)
    head += w.definition(
        "sensor_gyro:double z;vector3[2] q;int16_t[3] y_;uint8_t _padding0;float y;float x;uint64_t timestamp;"
    )
    body = struct.pack("<d32x6xBffQ", 3.0, 0, 2.0, 1.0, 5_000_000)
    content = (
        head + w.subscribe(3, "sensor_gyro") + w.data(3, body) + w.data(3, body[:-8] + struct.pack("<Q", 6_000_000))
    )
    found, fault = rows(open_table(put(tmp_path, content)), ["time [s]", *AXES[3:]])
    assert fault is None
    assert found.tolist() == [[5.0, 1.0, 2.0, 3.0], [6.0, 1.0, 2.0, 3.0]]


def test_corrected_topics_are_refused_with_what_to_do(tmp_path):
    head = w.header() + w.definition("vehicle_imu:uint64_t timestamp;float[3] delta_angle;")
    content = head + w.subscribe(0, "vehicle_imu") + w.data(0, struct.pack("<Qfff", 5, 0, 0, 0))
    with pytest.raises(InputError, match=r"vehicle_imu are corrected .*logger_topics\.txt"):
        open_table(put(tmp_path, content))
    other = w.header() + w.definition("cpuload:uint64_t timestamp;") + w.subscribe(0, "cpuload")
    with pytest.raises(InputError, match="in its 1 topics"):
        open_table(put(tmp_path, other))


def test_topics_that_the_driver_had_corrected_are_refused(tmp_path):
    head = w.header() + w.definition("sensor_accel:uint64_t timestamp;float x;float y;float z;int16_t x_raw;")
    content = head + w.subscribe(0, "sensor_accel") + w.data(0, struct.pack("<Qfffh", 5, 0, 0, 0, 1))
    with pytest.raises(InputError, match=r"PX4 1\.10 or older"):
        open_table(put(tmp_path, content))


def test_thinned_topics_get_a_remark(tmp_path):
    slow = 10**6 * np.arange(1, 20)
    table = open_table(put(tmp_path, w.log(slow, ACCEL[:19], slow, GYRO[:19])))
    assert any("few of the samples" in text and "sensor_gyro 1 Hz" in text for text in table.remarks)


def test_dropouts_and_different_chips_are_remarks(tmp_path):
    content = w.log(TIME, ACCEL, TIME, GYRO, between=w.record("O", struct.pack("<H", 20)))
    table = open_table(put(tmp_path, content))
    rows(table)
    dropouts = content.count(w.record("O", struct.pack("<H", 20)))
    assert any(f"lost data {dropouts} times, {dropouts * 0.02:.3g} s in all" in text for text in table.remarks)
    other = w.header() + w.definitions() + w.subscribe(1, "sensor_accel") + w.subscribe(2, "sensor_gyro")
    other += w.data(1, w.accel(5, ACCEL[0], device=0x2300A0)) + w.data(2, w.gyro(5, GYRO[0], device=0x2400B1))
    assert any("different chips" in text for text in open_table(put(tmp_path, other)).remarks)


def test_times_since_1970_are_counted_from_the_first(tmp_path):
    epoch = 1_700_000_000_000_000
    table = open_table(put(tmp_path, w.log(TIME + epoch, ACCEL, TIME + epoch, GYRO)))
    assert any("time counted from 2023-11-14 22:13:22 UTC" in text for text in table.remarks)
    np.testing.assert_array_equal(rows(table)[0][:, 0], (TIME - TIME[0]) / 1e6)


def test_appended_data_are_read_behind_a_log_that_stopped_anywhere(tmp_path):
    cut = len(SOUND) - 7  # within the last record
    with_flags = w.header(bytes([1]) + bytes(7), (cut, 0, 0)) + SOUND[len(w.header()) : cut]
    more = b"".join(
        w.data(10, w.accel(t, ACCEL[0])) + w.data(20, w.gyro(t, GYRO[0]))
        for t in (TIME[-1] + 1000 * np.arange(1, 4)).tolist()
    )
    found, fault = rows(open_table(put(tmp_path, with_flags + more)))
    assert fault is None
    assert found.shape == (N - 1 + 3, 7)
    with pytest.raises(InputError, match="appended at"):
        open_table(put(tmp_path, w.header(bytes([1]) + bytes(7), (500, 400, 0)) + SOUND))


def test_later_kinds_are_refused_and_later_records_are_not(tmp_path):
    with pytest.raises(InputError, match="later kind"):
        open_table(put(tmp_path, w.header(bytes([2]) + bytes(7)) + SOUND[len(w.header()) :]))
    found, fault = rows(open_table(put(tmp_path, SOUND + w.record("Z", b"what is this"))))
    assert fault is None
    assert len(found) == N


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"\x05\x00\x00hello", "no ULog record"),
        (b"\x00\x00D", "no ULog record"),
        (w.data(99, b"1234"), "no ULog record"),
        (w.data(20, b"short"), "no ULog record"),
        (w.record("S", b"12345678"), "no ULog record"),
        (w.definition("sensor_gyro:float other;"), "defined twice"),
        (w.definition("nothing"), "definition of a format"),
        (w.definition("a:float[99999999] b;"), "definition of a format"),
        (w.record("F", b"a:float \xff;"), "ascii"),
        (w.record("A", b"\0\x09\0"), "without a name"),
        (w.subscribe(20, "sensor_accel"), "message 20 is announced"),
        (w.definition("sensor_gyro_x:sensor_gyro_x a;") + w.data(10, b""), "no ULog record"),
        (b"\x01", "ends within a record"),
        (b"\xff\xffD", "ends within a record"),
        (b"\xff\xffI", "ends within a record"),
    ],
)
def test_damage_is_told_with_its_byte_and_what_lies_before_is_handed_out(tmp_path, bad, reason):
    table = open_table(put(tmp_path, SOUND + bad))
    found, fault = rows(table)
    np.testing.assert_array_equal(found, TRUTH)
    assert reason in str(fault)
    assert len(SOUND) <= fault.offset <= len(SOUND) + 40


@pytest.mark.parametrize(
    "text",
    ["sensor_gyro:b x;", "sensor_gyro:sensor_gyro x;", "sensor_gyro:float x;float x;", "sensor_gyro:b[2] _padding;"],
)
def test_formats_that_cannot_be(tmp_path, text):
    chain = b"".join(w.definition(f"t{k}:t{k + 1}[10] a;") for k in range(40))
    with pytest.raises(InputError, match="damaged at byte"):
        open_table(put(tmp_path, w.header() + chain + w.definition(text) + w.subscribe(1, "sensor_gyro")))
    deep = w.header() + chain + w.subscribe(1, "t0") + w.data(1, b"x")  # a topic that nobody wants and nobody can size
    with pytest.raises(InputError, match="in its 1 topics"):
        open_table(put(tmp_path, deep))


COUNTS = _RNG.integers(-32000, 32000, (N, 3))
STEPS = 125 * np.arange(N) + 2_000_000


def collected(extra=b"", late=None, missing=(), rotation=None):
    """Messages of eight samples 125 us apart; the time of message `late` is 400 us late."""
    out = [w.header(), w.definitions(), w.definition(w.fifo("accel", rotation)), w.definition(w.fifo("gyro", rotation))]
    out += [w.subscribe(1, "sensor_accel_fifo"), w.subscribe(2, "sensor_gyro_fifo"), extra]
    for k in range(0, N, 8):
        if k // 8 not in missing:
            time = int(STEPS[k + 7]) + (400 if k // 8 == late else 0)
            for number, scale in ((1, 0.001), (2, 0.0005)):
                out.append(w.data(number, w.collected(time, 125.0, scale, COUNTS[k : k + 8], rotation)))
    return b"".join(out)


def test_all_that_the_chips_had_collected(tmp_path):
    found, fault = rows(open_table(put(tmp_path, collected())))
    assert fault is None
    np.testing.assert_array_equal(found[:, 0], STEPS / 1e6)
    np.testing.assert_array_equal(found[:, 1:4], COUNTS * float(np.float32(0.001)))
    np.testing.assert_array_equal(found[:, 4:], COUNTS * float(np.float32(0.0005)))


def test_samples_of_a_message_that_is_late_stay_in_order(tmp_path):
    found, _ = rows(open_table(put(tmp_path, collected(late=20))))
    steps = np.diff(np.rint(found[:, 0] * 1e6))
    assert steps.sum() == STEPS[-1] - STEPS[0]
    assert set(steps[159:175]) == {175.0, 75.0}  # 1400 us and 600 us for eight samples each
    assert set(np.delete(steps, slice(159, 175))) == {125.0}


def test_a_message_that_is_missing_is_a_gap(tmp_path):
    found, _ = rows(open_table(put(tmp_path, collected(missing=(10, 11)))))
    kept = np.delete(np.arange(N), slice(80, 96))
    np.testing.assert_array_equal(found[:, 0], STEPS[kept] / 1e6)
    np.testing.assert_array_equal(found[:, 1:4], COUNTS[kept] * float(np.float32(0.001)))


@pytest.mark.parametrize(
    ("sizes", "missing"),
    [([8, 8, 8, 8, 32, 8, 8], 3), ([8, 8, 32, 8, 8, 8, 32, 8], 5), ([8, 32], None), ([4] * 6 + [8, 16] + [4] * 6, 5)],
)
def test_a_small_message_that_is_missing_before_a_large_one_is_a_gap(tmp_path, sizes, missing):
    """What the samples of the large one lack is less than half of it."""
    ends = np.cumsum(sizes)
    if missing is None:  # the second message of all comes eight samples late: no message between was ever seen
        ends = ends + np.array([0, 8])
    out = [w.header(), w.definition(w.fifo("gyro")), w.subscribe(2, "sensor_gyro_fifo")]
    kept = []
    for k, (end, size) in enumerate(zip(ends.tolist(), sizes, strict=True)):
        if k != missing:
            kept += range(end - size, end)
            counts = np.arange(end - size, end)[:, None] * [1, 2, 3]
            out.append(w.data(2, w.collected(2_000_000 + 125 * (end - 1), 125.0, 1.0, counts)))
    found, _ = rows(open_table(put(tmp_path, b"".join(out))), ["time [s]", "gyro_x [rad/s]"])
    np.testing.assert_array_equal(found[:, 1], kept)
    np.testing.assert_array_equal(found[:, 0], (2_000_000 + 125 * np.array(kept)) / 1e6)


def test_collected_samples_beside_others_are_chosen_by_name(tmp_path):
    extra = w.subscribe(10, "sensor_accel") + w.subscribe(20, "sensor_gyro")
    extra += b"".join(w.data(10, w.accel(t, ACCEL[0])) + w.data(20, w.gyro(t, GYRO[0])) for t in (10**6, 2 * 10**6))
    path = put(tmp_path, collected(extra))
    with pytest.raises(InputError, match=r"holds 0 \(sensor_accel 1 Hz.*; FIFO/0 \(sensor_accel_fifo 8000 Hz"):
        open_table(path)
    assert rows(open_table(path, "FIFO/0"))[0].shape == (N, 7)
    assert rows(open_table(path, "0"))[0].shape == (2, 7)
    assert [open_table(path, which).choice for which in ("FIFO/0", "0")] == ["FIFO/0", "0"]


def test_collected_samples_that_were_not_turned_are_refused(tmp_path):
    assert rows(open_table(put(tmp_path, collected(rotation=0))))[0].shape == (N, 7)
    with pytest.raises(InputError, match="not turned"):
        open_table(put(tmp_path, collected(rotation=2)))


def test_the_end_of_the_range_of_collected_samples(tmp_path):
    counts = np.array([[0, 0, 0], [32767, 0, -32768]])
    extra = w.data(2, w.collected(1_000_000, 125.0, 1.0, counts)) + w.data(
        2, w.collected(1_001_000, 125.0, 1.0, counts[:1])
    )
    table = open_table(put(tmp_path, collected(extra)))
    rows(table)
    assert "sensor_gyro_fifo: the sensor reached the end of its range (messages: 1)" in table.remarks


@pytest.mark.parametrize(("step", "count"), [(0.0, 8), (float("nan"), 8), (1e30, 8), (125.0, 33)])
def test_collected_samples_that_make_no_sense(tmp_path, step, count):
    bad = w.data(2, w.collected(1_000_000, step, 1.0, np.zeros((8, 3), int), count=count))
    with pytest.raises(InputError, match=f"{count} samples in room for 32"):
        open_table(put(tmp_path, collected(bad)))


def test_wrong_fields_are_named(tmp_path):
    head = w.header() + w.definition("sensor_gyro:uint64_t timestamp;float x;int32_t y;float z;")
    with pytest.raises(InputError, match="fields other than PX4's own"):
        open_table(put(tmp_path, head + w.subscribe(0, "sensor_gyro") + w.data(0, bytes(20))))


def test_values_that_are_no_numbers_are_handed_on_without_a_word(tmp_path):
    """Signalling NaN, infinity: the check of rows names them; time at the end of its range is no trouble either."""
    odd = np.array([0x7FA00000, 0x7F800000, 0xFF800000], dtype="u4").view("f4")
    content = w.header() + w.definitions() + w.subscribe(10, "sensor_accel") + w.subscribe(20, "sensor_gyro")
    for time in (2**63, 2**63 + 1000, 2**63 + 2000):
        content += w.data(10, w.accel(time, odd, stamp=0)) + w.data(20, w.gyro(time, odd, stamp=0))
    found, _ = rows(open_table(put(tmp_path, content)))
    assert not np.any(np.isfinite(found[:, 1:]))


def test_a_file_that_ends_in_its_header(tmp_path):
    with pytest.raises(Fault, match="within its header"):
        open_table(put(tmp_path, w.MAGIC + b"\x01\0\0"))


SHORT = w.log(TIME[:20], ACCEL[:20], TIME[:20], GYRO[:20])


@given(st.integers(7, len(SHORT) - 1))
def test_truncated_anywhere_a_prefix_is_handed_out(tmp_path, cut):
    path = put(tmp_path, SHORT[:cut])
    try:
        table = open_table(path)
    except InputError:
        assert cut < SHORT.index(struct.pack("<Q", int(TIME[0]))) + 60  # no sample was whole yet
        return
    if AXES[-1] not in table.columns:  # the first gyro sample was not whole yet
        return
    found, fault = rows(table)
    np.testing.assert_array_equal(found, TRUTH[: len(found)])
    assert len(found) >= 18 * cut // len(SHORT) - 10
    if fault is not None:
        assert fault.offset <= cut


flips = st.lists(st.tuples(st.integers(7, len(SHORT) - 1), st.integers(0, 255)), min_size=1, max_size=8)


@given(flips)
def test_flipped_bytes_never_crash(tmp_path, changes):
    content = bytearray(SHORT)
    for at, value in changes:
        content[at] = value
    survives(put(tmp_path, bytes(content)))


@given(st.binary(max_size=300))
def test_any_bytes_behind_the_magic_never_crash(tmp_path, content):
    survives(put(tmp_path, w.MAGIC + content))


words = st.sampled_from(
    [
        w.fifo("gyro"),
        w.ACCEL,
        w.GYRO,
        w.VECTOR,
        "sensor_gyro:uint64_t timestamp;float x;float y;float z;float[60000] q;",
        "a:b c;b:a d;",
        ":;",
        "sensor_gyro:;",
    ]
)
records = st.one_of(
    words.map(w.definition),
    st.tuples(st.sampled_from("ABDFIOPQSZ"), st.binary(min_size=1, max_size=60)).map(lambda r: w.record(*r)),
    st.tuples(
        st.integers(0, 2),
        st.sampled_from(["sensor_gyro", "sensor_accel", "sensor_gyro_fifo", "vector3", ""]),
        st.integers(0, 3),
    ).map(lambda a: w.subscribe(*a)),
    st.tuples(
        st.integers(0, 2), st.one_of(st.binary(min_size=20, max_size=60), st.binary(min_size=221, max_size=221))
    ).map(lambda d: w.data(*d)),
)


@given(st.lists(records, max_size=12))
def test_records_in_any_order_never_crash(tmp_path, parts):
    survives(put(tmp_path, w.header() + b"".join(parts)))


def test_pyulog_agrees_on_a_log_of_nothing(tmp_path):
    content = w.header() + w.definitions()
    assert not ULog(io.BytesIO(content)).data_list
    with pytest.raises(InputError, match="in its 0 topics"):
        open_table(put(tmp_path, content))
