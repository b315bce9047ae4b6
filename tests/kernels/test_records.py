"""Walks over records against plain Python twins, on sound and on random bytes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.kernels import records

SYNC = bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12])
U8 = np.uint8


def ulog_twin(data, at, known, wanted, room):
    """The walk over ULog records from the description of the format. `known`: number -> (fewest, most bytes)."""
    found = []
    while len(data) - at >= 3:
        size, letter, content = int.from_bytes(data[at : at + 2], "little"), chr(data[at + 2]), data[at + 3 :]
        whole = len(content) >= size
        sound = letter.isascii() and letter.isalpha() and size >= {"D": 2, "S": 8}.get(letter, 1)
        if not sound or (letter == "S" and not SYNC.startswith(content[:8])):
            return at, found, records.DAMAGED
        if letter == "D" and len(content) >= 2:
            number = int.from_bytes(content[:2], "little")
            least, most = known.get(number, (1, 0))
            if not least <= size - 2 <= most:
                return at, found, records.DAMAGED
            if whole and number in wanted:
                if len(found) == room:
                    return at, found, records.FULL
                found.append((at + 5, number))
        if not whole:
            break
        if letter in "ABFO":
            return at, found, records.CONTROL
        at += 3 + size
    return at, found, records.UNFINISHED


def dataflash_twin(data, at, lengths, wanted, room):
    found = []
    while data[at : at + 2] == b"\xa3\x95"[: len(data) - at] and len(data) - at >= 3:
        kind = data[at + 2]
        if lengths.get(kind, 0) < 3:
            return at, found, records.DAMAGED
        if at + lengths[kind] > len(data):
            return at, found, records.UNFINISHED
        if kind == 0x80:
            return at, found, records.CONTROL
        if kind in wanted:
            if len(found) == room:
                return at, found, records.FULL
            found.append((at + 3, kind))
        at += lengths[kind]
    return at, found, records.UNFINISHED if b"\xa3\x95".startswith(data[at : at + 2]) else records.DAMAGED


def walk_ulog(data, at, known, wanted, room):
    shortest, longest = np.full(65536, -1, np.int32), np.zeros(65536, np.int32)
    ours = np.zeros(65536, U8)
    for number, (least, most) in known.items():
        shortest[number], longest[number], ours[number] = least, most, number in wanted
    places, kinds = np.empty(room, np.int64), np.empty(room, np.uint16)
    data = np.array(list(data), dtype=U8)
    at, count, why = records.walk_ulog(data, at, shortest, longest, ours, places, kinds)
    return at, list(zip(places[:count].tolist(), kinds[:count].tolist(), strict=True)), why


def walk_dataflash(data, at, lengths, wanted, room):
    table, ours = np.zeros(256, np.int32), np.zeros(256, U8)
    for kind, length in lengths.items():
        table[kind], ours[kind] = length, kind in wanted
    places, kinds = np.empty(room, np.int64), np.empty(room, U8)
    data = np.array(list(data), dtype=U8)
    at, count, why = records.walk_dataflash(data, at, table, ours, places, kinds)
    return at, list(zip(places[:count].tolist(), kinds[:count].tolist(), strict=True)), why


KNOWN = {1: (4, 4), 2: (1, 3), 300: (0, 65536)}
ulog_record = st.one_of(
    st.tuples(st.sampled_from([1, 2, 300, 77]), st.binary(max_size=6)).map(
        lambda d: bytes([len(d[1]) + 2, 0]) + b"D" + d[0].to_bytes(2, "little") + d[1]
    ),
    st.just(bytes([8, 0]) + b"S" + SYNC),
    st.tuples(st.sampled_from(b"ABFOIPQLMRCSxZ?\x00"), st.binary(max_size=9)).map(
        lambda r: bytes([len(r[1]), 0, r[0]]) + r[1]
    ),
    st.binary(max_size=4),
)
LENGTHS = {0x80: 9, 5: 4, 6: 3, 7: 2, 200: 30}
dataflash_message = st.one_of(
    st.tuples(st.sampled_from([0x80, 5, 6, 7, 200, 8]), st.binary(min_size=27, max_size=27)).map(
        lambda m: b"\xa3\x95" + bytes([m[0]]) + m[1][: max(LENGTHS.get(m[0], 3) - 3, 0)]
    ),
    st.binary(max_size=3),
)


@given(st.lists(ulog_record, max_size=12).map(b"".join), st.integers(0, 3), st.integers(1, 4))
def test_ulog_records_are_those_of_the_twin(data, cut, room):
    data = data[: max(len(data) - cut, 0)]
    assert walk_ulog(data, 0, KNOWN, {1, 300}, room) == ulog_twin(data, 0, KNOWN, {1, 300}, room)


@given(st.lists(dataflash_message, max_size=12).map(b"".join), st.integers(0, 3), st.integers(1, 4))
def test_dataflash_messages_are_those_of_the_twin(data, cut, room):
    data = data[: max(len(data) - cut, 0)]
    assert walk_dataflash(data, 0, LENGTHS, {5, 200}, room) == dataflash_twin(data, 0, LENGTHS, {5, 200}, room)


@pytest.mark.parametrize("walk", [walk_ulog, walk_dataflash])
def test_nothing_is_nothing(walk):
    assert walk(b"", 0, {}, (), 1) == (0, [], records.UNFINISHED)


def test_pieces_are_gathered():
    data = np.arange(100, dtype=U8)
    np.testing.assert_array_equal(records.gather(data, np.array([3, 90, 7]), 4), data[[[3], [90], [7]] + np.arange(4)])
