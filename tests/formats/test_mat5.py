"""MATLAB 5 files: scipy.io writes them, and a small writer made from the format's description where scipy cannot."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import io

from sagnac.errors import InputError
from sagnac.formats import Fault, format_of, open_table
from sagnac.formats.arrays import variables

ROWS = 400
RNG = np.random.default_rng(11)
TIME = np.arange(ROWS) * 0.01
ACC = RNG.normal(size=(ROWS, 3))
GYR = RNG.normal(size=(3, ROWS))
COUNTS = RNG.integers(-30000, 30000, ROWS).astype("i2")
LOG = {
    "time": TIME,
    "imu": {"acc": ACC, "gyr": GYR, "n": COUNTS[None, :], "more": {"f": ACC[:, 0].astype("f4")}},
    "R": np.eye(3),
    "g": 9.81,
    "who": "a unit",
    "cells": np.array([1, "a"], dtype=object),
    "z": np.ones(ROWS) * 1j,
    "flag": np.ones((2, 2, 2)),
}
COLUMNS = (
    "time", "imu.acc.1", "imu.acc.2", "imu.acc.3", "imu.gyr.1", "imu.gyr.2", "imu.gyr.3", "imu.n", "imu.more.f",
)  # fmt: skip
TRUE = np.column_stack([TIME, ACC, GYR.T, COUNTS, ACC[:, 0].astype("f4")])


def saved(folder, content, *, packed=False):
    path = folder / "log.mat"
    io.savemat(path, content, do_compression=packed, oned_as="column")
    return path


def put(folder, content):
    path = folder / "log.mat"
    path.write_bytes(content)
    return path


def pieces(path, names=None):
    table = open_table(path)
    names = table.columns if names is None else names
    parts = [np.zeros((0, len(names)))]
    try:
        for batch in table.read(names, []):
            parts += [np.column_stack([batch.column(i).to_numpy() for i in range(len(names))])]
    except Fault as fault:
        return np.concatenate(parts), fault
    return np.concatenate(parts), None


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("rows", [7, 1 << 17])
def test_numbers_are_those_that_were_saved(tmp_path, monkeypatch, packed, rows):
    monkeypatch.setattr(variables, "BATCH", rows)
    path = saved(tmp_path, LOG, packed=packed)
    assert format_of(path).module == "arrays.mat5"
    table = open_table(path)
    assert table.columns == COLUMNS
    assert table.remarks == ("read are the arrays of 400 samples; left out, of another length: R (3)",)
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read, TRUE)


@pytest.mark.parametrize("packed", [False, True])
def test_some_columns_in_any_order_with_their_own_types(tmp_path, packed):
    table = open_table(saved(tmp_path, LOG, packed=packed))
    (batch,) = table.read(["imu.gyr.3", "imu.n"], ["imu.acc.2", "imu.more.f", "imu.n", "imu.gyr.1"])
    assert [str(t) for t in batch.schema.types] == ["double", "double", "double", "float", "int16", "double"]
    for column, true in zip(batch.columns, (GYR[2], COUNTS, ACC[:, 1], TRUE[:, 8], COUNTS, GYR[0]), strict=True):
        np.testing.assert_array_equal(column.to_numpy(), true)
    assert table.position() == table.size == table.path.stat().st_size


@pytest.mark.parametrize("kind", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">f8", ">i2", "bool"])
def test_types_of_numbers(tmp_path, kind):
    values = np.arange(100).astype(kind)
    path = saved(tmp_path, {"x": values})
    np.testing.assert_array_equal(pieces(path)[0][:, 0], values.astype(float))
    np.testing.assert_array_equal(io.loadmat(path)["x"][:, 0], values)


def test_the_array_named_time_says_which_belong_together(tmp_path):
    table = open_table(saved(tmp_path, {"time": TIME, "acc": ACC, "map": np.zeros(9000), "gps": {"lat": np.zeros(40)}}))
    assert table.columns == ("time", "acc.1", "acc.2", "acc.3")
    assert table.remarks == (
        "read are the arrays of 400 samples; left out, of another length: map (9000), gps.lat (40)",
    )


def test_without_time_the_longest_belong_together(tmp_path):
    table = open_table(saved(tmp_path, {"t": TIME, "acc": ACC, "lat": np.zeros(40)}))
    assert table.columns == ("t", "acc.1", "acc.2", "acc.3")


def test_units_come_from_a_structure_beside(tmp_path):
    units = {"acc": "m/s^2", "t": "s", "odd": "[s]"}
    imu = {"t": TIME, "acc": ACC, "odd": TIME, "bare": TIME, "units": units}
    expected = ("t [s]", "acc.1 [m/s^2]", "acc.2 [m/s^2]", "acc.3 [m/s^2]", "odd", "bare")
    assert open_table(saved(tmp_path, {"imu": imu})).columns == tuple(f"imu.{n}" for n in expected)
    assert open_table(saved(tmp_path, imu)).columns == expected


def test_nothing_to_read(tmp_path):
    with pytest.raises(InputError, match="no array of numbers with more than one sample"):
        open_table(saved(tmp_path, {"who": "nobody", "g": 9.81, "cells": np.array([1, "a"], dtype=object)}))


# ----------------------------------------------------- a writer from the description of the format, in both byte orders


def element(order, kind, data):
    return struct.pack(order + "II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(order, name, shape, kind, data, *, array_class=6, bits=0):
    flags = struct.pack(order + "II", array_class | bits, 0)
    dimensions = struct.pack(f"{order}{len(shape)}i", *shape)
    parts = (element(order, 6, flags), element(order, 5, dimensions), element(order, 1, name.encode()))
    return element(order, 14, b"".join(parts) + element(order, kind, data))


def header(order):
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(order + "H", 0x0100) + {"<": b"IM", ">": b"MI"}[order]


def packed(order, data):
    squeezed = zlib.compress(data)
    return struct.pack(order + "II", 15, len(squeezed)) + squeezed


def made(order="<", *, squeeze=False):
    variables = [
        matrix(order, "time", (ROWS, 1), 9, TIME.astype(order + "f8").tobytes()),
        matrix(order, "acc", (ROWS, 3), 9, ACC.astype(order + "f8").tobytes("F")),
        matrix(order, "n", (1, ROWS), 3, COUNTS.astype(order + "i2").tobytes()),
    ]
    return header(order) + b"".join(packed(order, v) if squeeze else v for v in variables)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("squeeze", [False, True])
def test_both_byte_orders(tmp_path, order, squeeze):
    path = put(tmp_path, made(order, squeeze=squeeze))
    np.testing.assert_array_equal(io.loadmat(path)["acc"], ACC)  # the writer is sound
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read, np.column_stack([TIME, ACC, COUNTS]))


TIME_END = len(header("<") + matrix("<", "time", (ROWS, 1), 9, TIME.tobytes()))


def test_variables_before_damage_are_read(tmp_path):
    whole = made()
    path = put(tmp_path, whole[: TIME_END + 500])
    assert open_table(path).columns == ("time",)
    read, fault = pieces(path)
    np.testing.assert_array_equal(read[:, 0], TIME)
    assert fault.offset == TIME_END + 500
    assert fault.reason.endswith(f"bytes before the end of the variable that begins at byte {TIME_END}")


def test_damage_within_compressed_data(tmp_path):
    whole = bytearray(made(squeeze=True))
    whole[-200] ^= 0xFF
    read, fault = pieces(put(tmp_path, bytes(whole)))
    assert fault is not None
    assert "compressed data" in fault.reason
    np.testing.assert_array_equal(read[:, 0], TIME[: len(read)])


def test_a_wrong_checksum_is_found_at_the_end(tmp_path):
    whole = made(squeeze=True)
    read, fault = pieces(put(tmp_path, whole[:-1] + bytes([whole[-1] ^ 1])))
    assert len(read) >= ROWS - 1
    assert "incorrect data check" in fault.reason


LONG = struct.pack("<II", 14, 4_000_000_000)  # the tag of a matrix that would fill the memory


@pytest.mark.parametrize(
    ("content", "offset", "says"),
    [
        (made()[:100], 100, "the file ends within the header"),
        (made()[:126] + b"XX" + made()[128:], 126, "the byte order is b'XX'"),
        (made()[:133], 133, "the file ends within the tag of the variable at byte 128"),
        (made()[:300], 300, "before the end of the variable that begins at byte 128"),
        (header("<") + struct.pack("<II", 77, 8) + bytes(8), 128, "an element of type 77"),
        (header("<") + packed("<", LONG + bytes(100)), 128 + 8, "4000000000 bytes where a compressed variable should begin"),
        (header("<") + struct.pack("<II", 15, 500) + bytes(500), 636, "compressed data cannot be read"),
        (header("<") + matrix("<", "x", (ROWS, 2), 9, TIME.tobytes()), None, "3200 bytes of numbers in an array of the shape"),
        (header("<") + matrix("<", "x", (-5, 2), 9, TIME.tobytes()), None, "an array of the shape (-5, 2)"),
        (header("<") + matrix("<", "x", (2**31 - 1,) * 2, 9, TIME.tobytes()), None, "in an array of the shape"),
        (header("<") + matrix("<", "x", (ROWS, 1), 99, TIME.tobytes()), None, "numbers of the type 99"),
    ],
)  # fmt: skip
def test_damage_that_leaves_nothing(tmp_path, content, offset, says):
    with pytest.raises(Fault) as caught:
        open_table(put(tmp_path, content))
    assert says in caught.value.reason
    if offset is not None:
        assert abs(caught.value.offset - offset) <= 4100  # what is compressed is placed by the piece given to zlib
        assert "compressed" in says or caught.value.offset == offset


def test_more_data_than_the_description_says(tmp_path):
    long = matrix("<", "x", (ROWS, 1), 9, TIME.tobytes()) + bytes(3_000_000)
    _, fault = pieces(put(tmp_path, header("<") + packed("<", long)))
    assert "more compressed data than their description says" in fault.reason


def nested(depth):
    inner = matrix("<", "", (ROWS, 1), 9, TIME.tobytes())
    for _ in range(depth):
        head = element("<", 6, struct.pack("<II", 2, 0)) + element("<", 5, struct.pack("<2i", 1, 1))
        names = element("<", 1, b"") + struct.pack("<HHi", 5, 4, 2) + element("<", 1, b"a\0")
        inner = element("<", 14, head + names + inner)
    return header("<") + inner


def test_structures_in_structures(tmp_path):
    np.testing.assert_array_equal(pieces(put(tmp_path, nested(4)))[0][:, 0], TIME)
    assert open_table(put(tmp_path, nested(3))).columns == ("a.a.a",)
    with pytest.raises(InputError, match="no array of numbers"):  # no recursion without end
        open_table(put(tmp_path, nested(3000)))


FILES = {False: made(), True: made(squeeze=True)}


@pytest.mark.parametrize("squeeze", [False, True])
@given(data=st.data())
@settings(max_examples=60)
def test_any_truncation_gives_what_lies_before_it(tmp_path, squeeze, data):
    whole = FILES[squeeze]
    path = put(tmp_path, whole[: data.draw(st.integers(19, len(whole) - 1))])
    try:
        read, _ = pieces(path)
    except Fault as fault:
        assert fault.offset <= len(whole)  # noqa: PT017 - only then is there nothing to compare
        return
    except InputError as error:
        assert (path.stat().st_size, "no array" in str(error)) == (128, True)  # noqa: PT017 - a header is a whole file
        return
    np.testing.assert_array_equal(read, np.column_stack([TIME, ACC, COUNTS])[: len(read), : read.shape[1]])


@pytest.mark.parametrize("squeeze", [False, True])
@given(data=st.data())
def test_any_damage_is_a_table_or_a_told_error(tmp_path, squeeze, data):
    whole = bytearray(FILES[squeeze])
    places = st.integers(19, 400) | st.integers(19, len(whole) - 1)
    for at, value in data.draw(st.lists(st.tuples(places, st.integers(0, 255)), min_size=1, max_size=8)):
        whole[at] = value
    path = put(tmp_path, bytes(whole))
    try:
        pieces(path)
    except InputError as error:
        if not str(error).startswith(f"{path}: "):
            raise


@pytest.mark.parametrize("packed", [False, True])
def test_arrays_of_other_lengths_stand_beside(tmp_path, packed):
    path = tmp_path / "log.mat"
    imu = {"t": np.arange(6) * 0.01, "acc": np.arange(18.0).reshape(6, 3)}
    io.savemat(path, {"imu": imu, "gps": {"time": np.arange(4.0)}, "x": np.arange(9)}, do_compression=packed)
    table = open_table(path)
    assert table.columns == ("gps.time",)
    assert [(t.samples, t.columns) for t in table.besides] == [
        (6, ("imu.t", "imu.acc.1", "imu.acc.2", "imu.acc.3")),
        (9, ("x",)),
    ]
    assert [t.whole for t in table.besides][1] == {"x"}
    (batch,) = table.besides[0].read(["imu.t", "imu.acc.2"], [])
    np.testing.assert_array_equal(
        np.column_stack([c.to_numpy() for c in batch.columns]), np.c_[imu["t"], imu["acc"][:, 1]]
    )
