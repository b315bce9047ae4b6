"""The kernels that find records against plain twins, on sound, damaged and random bytes."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.kernels.bag_records import CUT, DONE, MALFORMED, STOPPED, scan_mcap, scan_ros1


class _EndError(Exception):
    """What a scan ends with."""


def _take(data, at, form):
    if at + struct.calcsize(form) > len(data):
        raise _EndError(CUT)
    return struct.unpack_from(form, data, at)[0]


def _ros1(data, at):
    size = _take(data, at, "<I")
    head = data[at + 4 : at + 4 + size]
    if len(head) < size:
        raise _EndError(CUT)
    op, number, time = -1, -1, -1
    while head:
        if len(head) < 4 or len(head) - 4 < struct.unpack("<I", head[:4])[0]:
            raise _EndError(MALFORMED)
        length = struct.unpack("<I", head[:4])[0]
        field, head = head[4 : 4 + length], head[4 + length :]
        if length == 4 and field.startswith(b"op="):
            op = field[3]
        elif length == 9 and field[:1] + field[3:5] == b"cn=":
            number = struct.unpack("<I", field[5:])[0]
        elif length == 13 and field[:2] + field[4:5] == b"ti=":
            seconds, nanoseconds = struct.unpack("<II", field[5:])
            time = seconds * 10**9 + nanoseconds
    if op == 5:
        raise _EndError(STOPPED)
    if op < 0 or (op == 2 and min(number, time) < 0) or (op == 7 and number < 0):
        raise _EndError(MALFORMED)
    first = at + 8 + size
    last = first + _take(data, at + 4 + size, "<I")
    if last > len(data):
        raise _EndError(CUT)
    return (op, number, time, first, last, at), last


def _mcap(data, at):
    op = data[at]
    if op in (2, 6):
        raise _EndError(STOPPED)
    size = _take(data, at + 1, "<Q")
    first, last = at + 9, at + 9 + size
    if last > len(data):
        raise _EndError(CUT)
    if op == 0 or (op == 5 and size < 22):
        raise _EndError(MALFORMED)
    if op == 5:
        return (op, _take(data, first, "<H"), _take(data, first + 6, "<q"), first + 22, last, at), last
    return (op, -1, -1, first, last, at), last


def plain(record, data, at, most):
    rows = []
    try:
        while at < len(data) and len(rows) < most:
            row, at = record(data, at)
            rows.append(row)
    except _EndError as end:
        return rows, at, end.args[0]
    return rows, at, DONE


def same(kernel, record, data, at=0, most=50):
    out = np.zeros((most, 6), dtype=np.int64)
    view = np.frombuffer(data, dtype=np.uint8)
    count, stop, status = kernel(view, at, out)
    rows, plain_stop, plain_status = plain(record, data, at, most)
    assert (stop, status) == (plain_stop, plain_status)
    assert out[:count].tolist() == [list(row) for row in rows]
    return count


field = st.one_of(
    st.builds(lambda op: b"op=" + bytes([op]), st.sampled_from([2, 2, 2, 3, 4, 5, 7])),
    st.builds(lambda n: b"conn=" + struct.pack("<I", n), st.integers(0, 2**32 - 1)),
    st.builds(lambda n: b"time=" + struct.pack("<Q", n), st.integers(0, 2**64 - 1)),
    st.binary(max_size=12),
)


@st.composite
def ros1_records(draw):
    out = b""
    for _ in range(draw(st.integers(0, 6))):
        op = draw(st.sampled_from([2, 2, 2, 2, 3, 7]))
        fields = [b"op=" + bytes([op]), b"conn=" + draw(st.binary(min_size=4, max_size=4))]
        fields += [b"time=" + draw(st.binary(min_size=8, max_size=8)), draw(field)]
        head = b"".join(struct.pack("<I", len(f)) + f for f in draw(st.permutations(fields)))
        body = draw(st.binary(max_size=20))
        out += struct.pack("<I", len(head)) + head + struct.pack("<I", len(body)) + body
    return out


@st.composite
def mcap_records(draw):
    out = b""
    for _ in range(draw(st.integers(0, 6))):
        op = draw(st.sampled_from([5, 5, 5, 5, 3, 4, 7, 9, 200]))
        body = draw(st.binary(min_size=22 if op == 5 else 0, max_size=40))
        out += struct.pack("<BQ", op, len(body)) + body
    return out


CASES = [(scan_ros1, _ros1, ros1_records()), (scan_mcap, _mcap, mcap_records())]


@pytest.mark.parametrize(("kernel", "record", "records"), CASES)
@given(data=st.data())
def test_kernels_find_what_their_twins_find(kernel, record, records, data):
    raw = data.draw(records)
    same(kernel, record, raw)
    if raw:
        same(kernel, record, raw[: data.draw(st.integers(0, len(raw)))])
        damaged = bytearray(raw)
        damaged[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
        same(kernel, record, bytes(damaged))
    same(kernel, record, raw + data.draw(st.binary(max_size=60)))
    same(kernel, record, data.draw(st.binary(max_size=60)))


def test_a_full_table_is_filled_again():
    raw = b"".join(struct.pack("<BQ", 5, 30) + bytes(30) for _ in range(7))
    assert same(scan_mcap, _mcap, raw, 0, 3) == 3
    assert same(scan_mcap, _mcap, raw, 3 * 39, 3) == 3
    assert same(scan_mcap, _mcap, raw, 6 * 39, 3) == 1
