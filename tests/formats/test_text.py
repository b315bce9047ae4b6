"""Damage inside CSV files: the rows before it are read, and byte and row are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.formats import Fault
from sagnac.formats.text import csv

ROWS = 60
DATA = np.column_stack([np.arange(ROWS) * 0.01, np.random.default_rng(1).normal(size=(ROWS, 2))])
LINES = ["time [s],a,b,note", *(f"{r[0]!r},{r[1]!r},{r[2]!r},n{i}" for i, r in enumerate(DATA.tolist()))]


def put(folder, content):
    path = folder / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def pieces(path, other=("note",)):
    parts, notes = [np.zeros((0, 3))], []
    try:
        for batch in csv.open_table(path).read(["time [s]", "a", "b"], other):
            parts += [np.column_stack([c.to_numpy(zero_copy_only=False) for c in batch.columns[:3]])]
            notes += batch.column(3).to_pylist() if other else []
    except Fault as fault:
        return np.concatenate(parts), notes, fault
    return np.concatenate(parts), notes, None


@pytest.mark.parametrize("block", [150, 1 << 24])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("row", [1, 2, 37, ROWS])
@pytest.mark.parametrize("bad", ["1,2,x,n", "1,2,3", "1,2,3,4,5"])
def test_rows_before_a_bad_one_are_read(tmp_path, monkeypatch, block, end, row, bad):
    monkeypatch.setattr(csv, "_BLOCK", block)
    lines = ["\ufeff# a log", *LINES]
    lines[row + 1] = bad
    path = put(tmp_path, end.join(lines) + end)
    read, notes, fault = pieces(path)
    np.testing.assert_array_equal(read, DATA[: row - 1])
    assert notes == [f"n{i}" for i in range(row - 1)]
    assert fault.offset == sum(len((line + end).encode()) for line in lines[: row + 1])
    assert fault.path == path
    assert str(fault) == f"{path}: {fault.reason} (byte {fault.offset})"
    assert fault.reason.startswith(f"row {row} (line {row + 2})")


def test_the_first_of_several_bad_rows_is_named(tmp_path):
    lines = list(LINES)
    lines[50], lines[20], lines[40] = "1,2,3", "1,y,3,n", "z,2,3,n"
    read, _, fault = pieces(put(tmp_path, "\n".join(lines)))
    np.testing.assert_array_equal(read, DATA[:19])
    assert fault.reason == "row 20 (line 21): 'a' is 'y', not a number"


def test_quoted_fields_over_several_lines(tmp_path):
    lines = list(LINES)
    lines[5] = lines[5].replace("n4", '"n\n4"')
    lines[9] = "1,x,2,n"
    read, notes, fault = pieces(put(tmp_path, "\n".join(lines)))
    assert len(read) == len(notes) == 8
    assert fault.reason == "row 9 (line 11): 'a' is 'x', not a number"
    assert fault.offset == len("\n".join(lines[:9])) + 1


def test_progress_and_a_last_line_without_end(tmp_path):
    assert csv.open_table(put(tmp_path, "\n".join(LINES) + "\n")).remarks == ()
    table = csv.open_table(put(tmp_path, "\n".join(LINES)))
    assert "does not end with a line break" in table.remarks[0]
    list(table.read(["a"], []))
    assert table.position() == table.size


@given(st.integers(20, len("\n".join(LINES))))
def test_any_truncation_gives_the_rows_before_it(tmp_path, at):
    content = "\n".join(LINES)[:at]
    sound = content.count("\n") - 1
    read, _, fault = pieces(put(tmp_path, content))
    np.testing.assert_array_equal(read[: max(sound, 0)], DATA[: max(sound, 0)])
    assert len(read) == max(sound, 0) or (fault is None and len(read) == sound + 1)
