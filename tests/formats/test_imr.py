"""Inertial Explorer's IMR, written here from its published description."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sagnac.formats import Fault, format_of, imr, open_table

ROWS = 50
RAW = np.random.default_rng(5).integers(-(2**31), 2**31, (ROWS, 6))
TIME = 345600.0 + np.arange(ROWS) / 200
COLUMNS = (
    "time [s]", "gyro_x [rad/s]", "gyro_y [rad/s]", "gyro_z [rad/s]",
    "accel_x [m/s^2]", "accel_y [m/s^2]", "accel_z [m/s^2]",
)  # fmt: skip


def made(
    *, order="<", theta=1, velocity=1, rate=200.0, gyro=1e-7, accel=1e-6, system=2, bias=0.0, time=TIME, raw=RAW
) -> bytes:
    """Header and records, field by field as in the description (packed, no filling bytes)."""
    flag = {"<": 0, ">": 1}[order]
    head = struct.pack(
        order + "8sbdiidddiid32s4s32s12s?iii354s",
        b"$IMURAW\0", flag, 8.9, theta, velocity, rate, gyro, accel, system, 2, bias,
        b"a unit", b"", b"a program", b"", False, 0, 0, 0, b"",
    )  # fmt: skip
    assert len(head) == 512
    return head + b"".join(struct.pack(order + "d6i", t, *row) for t, row in zip(time, raw.tolist(), strict=True))


def put(folder, content):
    path = folder / "log.imr"
    path.write_bytes(content)
    return path


def pieces(path):
    parts = [np.zeros((0, 7))]
    try:
        for batch in imr.open_table(path).read(COLUMNS, []):
            parts += [np.column_stack([batch.column(i).to_numpy(zero_copy_only=False) for i in range(7)])]
    except Fault as fault:
        return np.concatenate(parts), fault
    return np.concatenate(parts), None


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("theta", "velocity"), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_scaling(tmp_path, order, theta, velocity):
    # the description: times the scale factor are degrees, times the data rate then degrees per second
    path = put(tmp_path, made(order=order, theta=theta, velocity=velocity))
    assert format_of(path).module == "imr"
    table = open_table(path)
    assert table.columns == COLUMNS
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read[:, 0], TIME)
    np.testing.assert_allclose(read[:, 1:4], np.radians(RAW[:, :3] * 1e-7 * (200 if theta else 1)), rtol=1e-15)
    np.testing.assert_allclose(read[:, 4:], RAW[:, 3:] * 1e-6 * (200 if velocity else 1), rtol=1e-15)
    increments = [r for r in table.remarks if "increments" in r]
    assert bool(increments) == bool(theta or velocity)


def test_progress_and_choice_of_columns(tmp_path):
    table = imr.open_table(put(tmp_path, made()))
    (batch,) = table.read([COLUMNS[4]], [COLUMNS[0]])
    assert batch.schema.names == [COLUMNS[4], COLUMNS[0]]
    np.testing.assert_array_equal(batch.column(1).to_numpy(), TIME)
    assert table.position() == table.size == 512 + 32 * ROWS


@pytest.mark.parametrize(("system", "name"), [(0, "GPS"), (1, "UTC"), (2, "GPS")])
def test_the_time_system_is_remarked(tmp_path, system, name):
    assert imr.open_table(put(tmp_path, made(system=system))).remarks[0] == f"time in {name} seconds of the week"


def test_a_rate_that_the_time_tags_deny_is_remarked(tmp_path):
    assert not any("200 Hz: one" in r for r in imr.open_table(put(tmp_path, made())).remarks)
    remarks = imr.open_table(put(tmp_path, made(rate=100.0))).remarks
    assert any(r.startswith("but its time tags are 200 Hz") for r in remarks)


def test_a_bias_of_the_time_tags_is_remarked(tmp_path):
    assert imr.open_table(put(tmp_path, made(bias=0.02))).remarks[-1].startswith("the header's time tag bias of 0.02 s")


@pytest.mark.parametrize(
    ("content", "offset", "says"),
    [
        (made()[:300], 300, "the file ends within the header"),
        (made()[:8] + b"\x07" + made()[9:], 8, "the byte order is 7"),
        (made(theta=3), 17, "the flag of increments is 3"),
        (made(velocity=-1), 21, "the flag of increments is -1"),
        (made(rate=0.0), 25, "the header's rate is 0.0"),
        (made(rate=-100.0), 25, "the header's rate is -100.0"),
        (made(gyro=float("nan")), 33, "the header's gyro scale is nan"),
        (made(accel=0.0), 41, "the header's accel scale is 0.0"),
        (made(accel=float("inf")), 41, "the header's accel scale is inf"),
    ],
)
def test_a_header_that_cannot_be_used(tmp_path, content, offset, says):
    with pytest.raises(Fault, match=says) as caught:
        imr.open_table(put(tmp_path, content))
    assert caught.value.offset == offset


def test_a_rate_is_not_needed_where_the_records_are_rates(tmp_path):
    read, fault = pieces(put(tmp_path, made(rate=0.0, theta=0, velocity=0)))
    assert fault is None
    assert len(read) == ROWS


def test_no_records(tmp_path):
    read, fault = pieces(put(tmp_path, made()[:512]))
    assert fault is None
    assert read.shape == (0, 7)


@pytest.mark.parametrize("block", [1, 7, 1 << 17])
@given(at=st.integers(512, 512 + 32 * ROWS))
@settings(max_examples=40)
def test_any_truncation_gives_the_rows_before_it(tmp_path, block, at):
    whole = made()
    path = put(tmp_path, whole[:at])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(imr, "_ROWS", block)
        read, fault = pieces(path)
    count, rest = divmod(at - 512, 32)
    np.testing.assert_array_equal(read[:, 0], TIME[:count])
    assert len(read) == count
    assert (fault is not None) == bool(rest)
    if fault is not None:
        assert fault.offset == at - rest


@given(st.lists(st.tuples(st.integers(8, 700), st.integers(0, 255)), max_size=12))
def test_any_damage_is_a_table_or_a_told_error(tmp_path, changes):
    data = bytearray(made())
    for at, value in changes:
        data[at] = value
    path = put(tmp_path, bytes(data))
    try:
        pieces(path)
    except Fault as error:
        if not str(error).startswith(f"{path}: damaged at byte"):
            raise
