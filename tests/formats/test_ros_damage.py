"""Damaged ROS bags: cut off anywhere, bytes turned, lengths that lie; only ever a refusal, and never a wrong sample."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import ros_writer as w
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.formats import Fault, open_table
from sagnac.formats.ros import scan as bag_scan

ENTRY = w.log(300)
TRUE = np.column_stack([(ENTRY.stamp - ENTRY.stamp[0]) / 1e9, ENTRY.accel, ENTRY.gyro])
RAW = [w.mcap_message(1, int(ENTRY.received[i]), w.serialized(ENTRY, i)) for i in range(300)]
MADE = ("mcap-made-lz4", "mcap-made-loose", "bag-made")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Content of a sound bag of every kind."""
    folder = tmp_path_factory.mktemp("bags")
    out = {kind: w.write(folder / kind, [ENTRY], kind).read_bytes() for kind in w.KINDS}
    out["mcap-made-lz4"] = w.mcap_file([b"".join(RAW[:100]), b"".join(RAW[100:])], "lz4")
    out["mcap-made-loose"] = w.mcap_file([b"".join(RAW)], None, data_crc=True)
    records = (w.ros1_message(1, int(ENTRY.received[i]), w.serialized(ENTRY, i, sequence=True)) for i in range(300))
    out["bag-made"] = w.ros1_file(w.ros1_connection(1) + b"".join(records))
    return out


def taken(path):
    """Rows before the fault, and the fault."""
    rows, fault = [], None
    try:
        table = open_table(path)
        pieces = table.read(table.columns, [])
        rows.extend(np.column_stack([c.to_numpy() for c in piece.columns]) for piece in pieces)
    except InputError as cause:
        fault = cause
    return (np.concatenate(rows) if rows else np.empty((0, 7))), fault


def put(path, content):
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("kind", [*w.KINDS, *MADE])
@given(data=st.data())
def test_a_file_cut_off_gives_its_beginning(whole, tmp_path, kind, data):
    content = whole[kind]
    cut = data.draw(st.integers(16, len(content) - 1))
    rows, fault = taken(put(tmp_path / "x", content[:cut]))
    assert isinstance(fault, Fault) or kind == "bag-made"  # a bag without index may end after any record
    if isinstance(fault, Fault):
        assert f"damaged at byte {fault.offset}: " in str(fault)
        assert fault.offset <= cut
    np.testing.assert_array_equal(rows, TRUE[: len(rows)])


@pytest.mark.parametrize("kind", ["bag", "mcap", "mcap-made-loose", "bag-made", "db3"])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.97])
def test_what_lies_before_the_cut_is_read(whole, tmp_path, kind, share):
    content = whole[kind]
    cut = content.index(ENTRY.accel[int(share * 300)].tobytes())
    rows, fault = taken(put(tmp_path / "x", content[:cut]))
    behind = 4096 // 340 if kind == "db3" else 0  # of a page that is cut nothing is taken
    assert int(share * 300) - behind <= len(rows) <= int(share * 300)
    assert cut - 5000 < fault.offset <= cut


@pytest.mark.parametrize("kind", ["bag-bz2", "bag-lz4", "mcap-zstd", "mcap-made-lz4"])
def test_chunks_before_the_cut_one_are_read(whole, tmp_path, kind):
    rows, fault = taken(put(tmp_path / "x", whole[kind][: len(whole[kind]) * 3 // 4]))
    assert len(rows) >= 100
    assert "the file ends inside the chunk that begins there" in str(fault)


@pytest.mark.parametrize("kind", [*w.KINDS, *MADE])
@given(data=st.data())
def test_turned_bytes_never_crash(whole, tmp_path, kind, data):
    content = bytearray(whole[kind])
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.one_of(st.integers(16, len(content) - 1), st.integers(16, min(6000, len(content) - 1))))
        content[place] = data.draw(st.integers(0, 255))
    rows, fault = taken(put(tmp_path / "x", content))
    assert isinstance(fault, InputError | None)
    assert rows.shape[1] in (4, 7)


@pytest.mark.parametrize("begin", [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
@given(rest=st.binary(max_size=400))
def test_files_of_which_only_the_beginning_is_right(tmp_path, begin, rest):
    rows, fault = taken(put(tmp_path / "x", begin + rest))
    assert isinstance(fault, InputError)
    assert not len(rows)


@given(fields=st.lists(st.binary(max_size=40), max_size=6), extra=st.integers(-3, 3))
def test_headers_of_ros1_records(tmp_path, fields, extra):
    head = b"".join(struct.pack("<I", max(0, len(f) + extra)) + f for f in fields)
    records = w.ros1_connection(1) + struct.pack("<I", len(head)) + head + struct.pack("<I", 5) + b"hello"
    _, fault = taken(put(tmp_path / "x.bag", w.ros1_file(records)))
    assert isinstance(fault, InputError)


@pytest.mark.parametrize("kind", ["mcap-zstd", "mcap-made-lz4"])
@pytest.mark.parametrize("size", [0, 1, 10_000, 1 << 27, 1 << 40, (1 << 64) - 1])
def test_sizes_of_chunks_that_lie(whole, tmp_path, kind, size):
    content = bytearray(whole[kind])
    at = content.index(b"\x06", 30)
    while content[at + 1 + 8 + 16 + 8 + 4 : at + 9 + 32].hex() not in ("03000000", "04000000"):
        at = content.index(b"\x06", at + 1)
    struct.pack_into("<Q", content, at + 9 + 16, size)
    rows, fault = taken(put(tmp_path / "x", content))
    assert isinstance(fault, Fault)
    assert fault.offset == at
    assert not len(rows)


@pytest.mark.parametrize("codec", ["lz4", "bz2", "zstd"])
def test_a_chunk_that_unpacks_to_more_than_it_says_takes_no_memory(codec):
    import bz2

    import pyarrow as pa

    bomb = bz2.compress(bytes(1 << 26)) if codec == "bz2" else pa.compress(bytes(1 << 26), codec, asbytes=True)
    data, complaint = bag_scan.unpacked(bomb, codec, 1000)
    assert len(data) == 1000
    assert "more bytes where 1000 are stated" in complaint


def test_a_chunk_larger_than_what_is_read_is_refused(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(bag_scan, "LIMIT", 10_000)
    for kind in ("bag", "bag-bz2", "mcap"):
        rows, fault = taken(put(tmp_path / "x", whole[kind]))
        assert "a chunk larger than" in str(fault)
        assert len(rows) < 20  # rosbags' first chunk of an MCAP file is a small one


@pytest.mark.parametrize("kind", ["mcap-made-lz4", "mcap-made-none"])
def test_checksums_find_a_turned_bit(tmp_path, kind):
    codec = kind.removeprefix("mcap-made-").replace("none", "")
    content = bytearray(w.mcap_file([b"".join(RAW[:100]), b"".join(RAW[100:])], codec))
    content[len(content) // 2] ^= 1
    rows, fault = taken(put(tmp_path / "x", content))
    assert len(rows) == 100
    assert "checksum" in str(fault) or "cannot be unpacked" in str(fault)


def test_checksum_of_a_file_without_chunks(whole, tmp_path):
    content = bytearray(whole["mcap-made-loose"])
    content[content.index(ENTRY.accel[200].tobytes()) + 1] ^= 1
    rows, fault = taken(put(tmp_path / "x", content))
    assert len(rows) == 300
    assert "do not match the checksum" in str(fault)


def test_messages_of_an_undeclared_connection(tmp_path):
    message = w.ros1_message(5, int(ENTRY.received[0]), w.serialized(ENTRY, 0, sequence=True))
    _, fault = taken(put(tmp_path / "x.bag", w.ros1_file(w.ros1_connection(1) + message)))
    assert "damaged" in str(fault) or "no message" in str(fault)
