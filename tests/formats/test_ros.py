"""ROS bags: values to the bit, selection, what the messages mean; against bags and readings of rosbags."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from dataclasses import replace

import numpy as np
import pytest
import ros_writer as w

from sagnac.errors import InputError
from sagnac.formats import Fault, open_table

AXES = [f"{sensor}_{axis} [{unit}]" for sensor, unit in (("accel", "m/s^2"), ("gyro", "rad/s")) for axis in "xyz"]


def values(table):
    """Columns of a table, one below the other."""
    pieces = [np.column_stack([c.to_numpy() for c in piece.columns]) for piece in table.read(table.columns, [])]
    return np.concatenate(pieces) if pieces else np.empty((0, len(table.columns)))


def expected(entry):
    return np.column_stack([(entry.stamp - entry.stamp[0]) / 1e9, entry.accel, entry.gyro])


def put(path, content):
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("kind", w.KINDS)
def test_samples_are_those_written_and_those_that_rosbags_reads(tmp_path, kind):
    entry = w.log()
    path = w.write(tmp_path / "x", [entry], kind)
    table = open_table(path)
    assert table.columns == ("time [s]", *AXES)
    np.testing.assert_array_equal(values(table), expected(entry))
    assert table.position() == table.size == path.stat().st_size
    np.testing.assert_array_equal(values(table), expected(entry))  # a table may be read again
    stamp, gyro, accel = w.peer(path if kind.startswith("bag") else path.parent, "/imu")
    np.testing.assert_array_equal(values(table), expected(replace(entry, stamp=stamp, gyro=gyro, accel=accel)))
    if not kind.startswith("bag"):
        np.testing.assert_array_equal(values(open_table(path.parent)), expected(entry))


def test_time_is_counted_from_the_first_stamp_and_that_is_said(tmp_path):
    table = open_table(w.write(tmp_path / "x", [w.log(3)]))
    assert table.remarks == (
        "time counted from the first sample on /imu, at 2026-11-22T09:30:00.123456789Z (1795339800123456789 ns)",
        "axes are those of the frame 'imu_link'",
    )
    piece = next(iter(table.read(["gyro_z [rad/s]", "time [s]"], ["accel_x [m/s^2]"])))
    assert piece.schema.names == ["gyro_z [rad/s]", "time [s]", "accel_x [m/s^2]"]


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_one_of_several_topics_is_selected(tmp_path, kind):
    logs = [w.log(400, "/imu/a", 1, frame="a"), w.log(200, "/imu/b", 2, rate=100, frame="a longer name")]
    path = w.write(tmp_path / "x", logs, kind)
    np.testing.assert_array_equal(values(open_table(path, "/imu/a")), expected(logs[0]))
    np.testing.assert_array_equal(values(open_table(path, "/imu/b")), expected(logs[1]))
    with pytest.raises(InputError, match=r"/imu/a \(400 messages, \d+.*Hz\), /imu/b \(200 .*--select /imu/a"):
        open_table(path)
    with pytest.raises(InputError, match="/imu is not in it; .*/imu/a.*/imu/b"):
        open_table(path, "/imu")
    with pytest.raises(InputError, match="/chatter is of type std_msgs"):
        open_table(path, "/chatter")


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_counts_and_rates_of_the_topics_are_told(tmp_path, kind):
    logs = [w.log(401, "/a", 1), w.log(51, "/b", 2, rate=100)]  # 200 and 100 Hz, the second for a quarter of the time
    with pytest.raises(
        InputError, match=r"/a \(401 messages, (199\.\d|200|200\.\d) Hz\), /b \(51 messages, (99\.|100)"
    ) as told:
        open_table(w.write(tmp_path / "x", logs, kind))
    assert "choose one, for example --select /a" in str(told.value)


@pytest.mark.parametrize("none", [-1.0, np.nan])  # the definition of the message; REP 145
@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_a_sensor_without_estimate_is_absent(tmp_path, kind, none):
    logs = [w.log(5, "/a", gyro_covariance=none), w.log(5, "/g", accel_covariance=none)]
    path = w.write(tmp_path / "x", logs, kind)
    assert open_table(path, "/a").columns == ("time [s]", *AXES[:3])
    assert open_table(path, "/g").columns == ("time [s]", *AXES[3:])
    neither = w.write(tmp_path / "y", [w.log(5, gyro_covariance=none, accel_covariance=none)], kind)
    with pytest.raises(InputError, match="no gyro and no accelerometer"):
        open_table(neither)


def test_an_estimate_that_ends_is_no_number(tmp_path):
    first, then = w.log(3), replace(w.log(3), gyro_covariance=-1.0)
    body = b"".join(
        w.mcap_message(1, int(e.received[i]), w.serialized(e, i)) for i, e in enumerate((first, then, first))
    )
    found = values(open_table(put(tmp_path / "x.mcap", w.mcap_file([body]))))
    assert np.isnan(found[1, 4:]).all()
    assert np.isfinite(found[:, :4]).all()
    assert np.isfinite(found[[0, 2]]).all()


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_messages_without_stamp_get_their_receive_times(tmp_path, kind):
    entry = w.log(50)
    path = w.write(tmp_path / "x", [replace(entry, stamp=np.zeros(50, dtype=np.int64))], kind)
    table = open_table(path)
    assert any("carry no time" in remark for remark in table.remarks)
    np.testing.assert_array_equal(values(table), expected(replace(entry, stamp=entry.received)))


def test_no_imu_or_no_message_is_said(tmp_path):
    with pytest.raises(InputError, match=r"no topic of type sensor_msgs/Imu; its topics: none"):
        open_table(w.write(tmp_path / "a", [], "db3", text=False))
    odd = w.ros1_connection(0, "/speed", "geometry_msgs/Twist")
    with pytest.raises(InputError, match=r"its topics: /speed \(geometry_msgs/Twist\)"):
        open_table(put(tmp_path / "b.bag", w.ros1_file(odd)))
    for kind in ("bag", "db3", "mcap"):
        with pytest.raises(InputError, match="no message on /imu"):
            open_table(w.write(tmp_path / f"c-{kind}", [w.log(0)], kind))


@pytest.mark.parametrize("frame", ["", "a", "imu", "base_link_of_7", "x" * 300])
@pytest.mark.parametrize("little_endian", [True, False])
def test_names_of_any_length_in_either_byte_order(tmp_path, frame, little_endian):
    entry = w.log(20, frame=frame)
    path = w.write(tmp_path / "x", [entry], "mcap", little_endian=little_endian)
    np.testing.assert_array_equal(values(open_table(path)), expected(entry))
    np.testing.assert_array_equal(values(open_table(w.write(tmp_path / "y", [entry]))), expected(entry))


def test_both_byte_orders_in_one_file(tmp_path):
    entry = w.log(6)
    raw = [w.serialized(entry, i, little_endian=i % 2 == 0) for i in range(6)]
    body = b"".join(w.mcap_message(1, int(t), m) for t, m in zip(entry.received, raw, strict=True))
    np.testing.assert_array_equal(values(open_table(put(tmp_path / "x", w.mcap_file([body])))), expected(entry))


@pytest.mark.parametrize("summary", [True, False])
@pytest.mark.parametrize("codec", ["", "lz4", "zstd", None])
def test_mcap_of_every_make(tmp_path, codec, summary):
    entry = w.log(900)
    raw = [w.mcap_message(1, int(entry.received[i]), w.serialized(entry, i)) for i in range(900)]
    content = w.mcap_file([b"".join(raw[:500]), b"".join(raw[500:])], codec, codec != "lz4", summary, data_crc=True)
    np.testing.assert_array_equal(values(open_table(put(tmp_path / "x.mcap", content))), expected(entry))


def test_ros1_messages_in_mcap(tmp_path):
    entry = w.log(20)
    body = b"".join(w.mcap_message(1, int(entry.received[i]), w.serialized(entry, i, sequence=True)) for i in range(20))
    content = w.mcap_file([body], definitions=w.mcap_channel(kind="sensor_msgs/Imu", encoding="ros1"))
    np.testing.assert_array_equal(values(open_table(put(tmp_path / "x.mcap", content))), expected(entry))
    content = w.mcap_file([body], definitions=w.mcap_channel(kind="sensor_msgs/Imu", encoding="json"))
    with pytest.raises(Fault, match="encoding 'json', which is not read"):
        open_table(put(tmp_path / "x.mcap", content))


@pytest.mark.parametrize("padding", [0, 300_000])
def test_bag_without_index_and_chunks(tmp_path, padding):
    entry = w.log(500)
    records = w.ros1_connection(7) + w.ros1_connection(3, "/text", "std_msgs/String")
    for i in range(500):
        records += w.ros1_message(7, int(entry.received[i]), w.serialized(entry, i, sequence=True))
        records += w.ros1_message(3, int(entry.received[i]), b"?" * (padding if i == 250 else 9))
    table = open_table(put(tmp_path / "x.bag", w.ros1_file(records)))
    np.testing.assert_array_equal(values(table), expected(entry))
    assert "no index" in table.remarks[2]


def test_connections_of_one_topic_are_joined(tmp_path):
    """Two publishers of a topic, one after the other, as when a driver is started again."""
    entry = w.log(40)
    records = w.ros1_connection(1) + w.ros1_connection(2)
    for i in range(40):
        records += w.ros1_message(1 + i // 20, int(entry.received[i]), w.serialized(entry, i, sequence=True))
    np.testing.assert_array_equal(values(open_table(put(tmp_path / "x.bag", w.ros1_file(records)))), expected(entry))


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_files_of_a_folder_follow_the_numbers_in_their_names(tmp_path, kind):
    entry = w.log(130)
    folder = tmp_path / "bag"
    folder.mkdir()
    for i in range(13):
        rows = slice(10 * i, 10 * i + 10)
        part = replace(entry, **{k: getattr(entry, k)[rows] for k in ("stamp", "received", "gyro", "accel")})
        shutil.copy(w.write(tmp_path / f"part{i}", [part], kind), folder / f"bag_{i}.{kind}")
    table = open_table(folder)
    np.testing.assert_array_equal(values(table), expected(entry))
    assert table.position() == table.size == sum(p.stat().st_size for p in folder.iterdir())


def test_folders_that_are_no_bag_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"without .db3 or .mcap files"):
        open_table(tmp_path)
    put(tmp_path / "a.db3", b"")
    put(tmp_path / "a.mcap", b"")
    with pytest.raises(InputError, match=r"holds .db3 and .mcap"):
        open_table(tmp_path)
    put(tmp_path / "a.db3.zstd", b"")
    with pytest.raises(InputError, match=r"zstd -d a.db3.zstd"):
        open_table(tmp_path)


def test_other_bags_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"V1.2 is no bag of version 2.0"):
        open_table(put(tmp_path / "x.bag", b"#ROSBAG V1.2\n" + bytes(100)))
    secret = w.ros1_record(
        b"", op=3, index_pos=bytes(8), conn_count=0, chunk_count=0, encryptor=b"rosbag/AesCbcEncryptor"
    )
    with pytest.raises(InputError, match="encrypted"):
        open_table(put(tmp_path / "x.bag", b"#ROSBAG V2.0\n" + secret))


def test_reading_changes_nothing_beside_the_file(tmp_path):
    path = w.write(tmp_path / "x", [w.log()], "db3")
    with sqlite3.connect(path) as base:
        base.execute("PRAGMA journal_mode=WAL")  # the mode of the header remains, as in bags that ROS records
    base.close()
    before, names = path.read_bytes(), sorted(p.name for p in path.parent.iterdir())
    assert values(open_table(path)).shape == (500, 7)
    assert path.read_bytes() == before
    assert sorted(p.name for p in path.parent.iterdir()) == names


def test_samples_in_a_log_beside_the_file_are_not_passed_over(tmp_path):
    entry = w.log(100)
    path = w.write(tmp_path / "x", [entry], "db3")
    base = sqlite3.connect(path)
    base.execute("PRAGMA journal_mode=WAL")
    base.execute("INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM messages")
    base.commit()
    found = []
    with pytest.raises(Fault, match="x.db3-wal lies beside the file"):
        found += open_table(path).read(["time [s]"], [])
    base.close()
    assert values(open_table(path)).shape == (200, 7)


def test_samples_stream_in_small_pieces(tmp_path, monkeypatch):
    monkeypatch.setattr("sagnac.formats.ros.topics.ROWS", 100)
    table = open_table(w.write(tmp_path / "x", [w.log(5000)]))
    pieces = list(table.read(["time [s]"], []))
    assert max(p.num_rows for p in pieces) < 150
    assert sum(p.num_rows for p in pieces) == 5000


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_file_that_vanishes_is_said(tmp_path, kind):
    path = w.write(tmp_path / "x", [w.log(5)], kind)
    table = open_table(path)
    path.unlink()
    with pytest.raises(InputError, match="cannot read: No such file"):
        values(table)


def test_a_message_of_another_shape_is_a_fault_at_its_place(tmp_path):
    entry = w.log(4)
    raw = [w.serialized(entry, i) for i in range(4)]
    raw[2] = raw[2] + bytes(8)
    records = [w.mcap_message(1, int(t), m) for t, m in zip(entry.received, raw, strict=True)]
    content = w.mcap_file([b"".join(records)])
    table = open_table(put(tmp_path / "x.mcap", content))
    found = []
    with pytest.raises(Fault, match="a message of 332 bytes that is no sensor_msgs/Imu") as caught:
        found += table.read(["time [s]"], [])
    assert caught.value.offset == content.index(records[2])
    assert sum(p.num_rows for p in found) == 2
    assert len(raw[2]) == 332  # 4; 12 + 9 (a name and its zero) on 8 bytes: 24; 37 doubles; 8 too many
    (kind,) = struct.unpack_from("<H", raw[0])
    assert kind == 0x0100  # CDR, little endian
