"""Text of bare numbers, as loggers of laser gyros write it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.formats import Fault, format_of
from sagnac.formats.text import numbers

ROWS, WIDTH = 80, 5
PULSES = np.random.default_rng(3).integers(-4000, 4000, (ROWS, WIDTH)).astype(float)
DATA = np.column_stack([PULSES, np.arange(ROWS) * 0.01])
NAMES = ("1", "2", "3", "4", "5", "6")


def written(between: str = " ", data: np.ndarray = DATA, end: str = "\n") -> str:
    return "".join(between.join(f"{v!r}" for v in row) + end for row in data.tolist())


TEXT = written()


def put(folder, content):
    path = folder / "log.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def pieces(path, names=NAMES):
    """Rows up to a fault, and the fault."""
    parts = [np.zeros((0, len(names)))]
    try:
        for batch in numbers.open_table(path).read(names, []):
            parts += [np.column_stack([batch.column(i).to_numpy(zero_copy_only=False) for i in range(len(names))])]
    except Fault as fault:
        return np.concatenate(parts), fault
    return np.concatenate(parts), None


@pytest.mark.parametrize(
    "content",
    [
        TEXT,
        TEXT.removesuffix("\n"),
        TEXT.replace("\n", "\r\n"),
        TEXT.replace("\n", "\r"),
        written("   "),
        written("\t"),
        written(" \t  "),
        written(","),
        written(", "),
        written(";"),
        written(" ; "),
        "".join("  " + line + "  \n" for line in TEXT.splitlines()),
        "% pulses\n# of a gyro\n// and time\n\n" + TEXT,
        "\ufeff" + TEXT,
        TEXT.replace("\n", "\n\n"),
        "\n".join(line + ("  # jump" if i == 7 else "") for i, line in enumerate(TEXT.splitlines())),
        "\n".join(line + ("\n% paused" if i % 9 == 0 else "") for i, line in enumerate(TEXT.splitlines())),
    ],
    ids=[
        "plain", "no-end", "crlf", "cr", "blanks", "tabs", "mixed blanks", "commas", "commas, blanks", "semicolons",
        "semicolons, blanks", "indented", "comments first", "bom", "blank lines", "comment behind", "comments between",
    ],
)  # fmt: skip
@pytest.mark.parametrize("block", [150, 1 << 23])
def test_numbers_are_those_that_were_written(tmp_path, monkeypatch, content, block):
    monkeypatch.setattr("sagnac.formats.text.lines.BLOCK", block)
    path = put(tmp_path, content)
    table = numbers.open_table(path)
    assert table.columns == NAMES
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read, DATA)


COMMENTS = "# a line of a logger that has much to say before it begins\n" * 200  # 11 kB


@pytest.mark.parametrize(
    "content",
    [
        TEXT, written(";"), "# c\n" + written("\t"), "\ufeff" + written(","), "\ufeff# c\n" + TEXT, COMMENTS + written(","),
        "\ufeff" + COMMENTS + "\n" + written(","),
    ],
)  # fmt: skip
def test_it_is_recognised(tmp_path, content):
    path = put(tmp_path, content)
    assert format_of(path).module == "text.numbers"
    np.testing.assert_array_equal(pieces(path)[0], DATA)


def test_columns_in_any_order_and_progress(tmp_path):
    table = numbers.open_table(put(tmp_path, TEXT))
    (batch,) = table.read(["6", "1"], ["2"])
    assert batch.schema.names == ["6", "1", "2"]
    np.testing.assert_array_equal(batch.column(0).to_numpy(), DATA[:, 5])
    np.testing.assert_array_equal(batch.column(2).to_numpy(), DATA[:, 1])
    assert table.position() == table.size == len(TEXT)


@pytest.mark.parametrize("block", [150, 1 << 23])
@pytest.mark.parametrize("row", [2, 37, ROWS])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ("1 2 3 4 5", "row {row} (line {line}) has 5 fields where there are 6 columns"),
        ("1 2 3 4 5 6 7", "row {row} (line {line}) has 7 fields where there are 6 columns"),
        ("1 2 x3 4 5 6", "row {row} (line {line}): column '3' is 'x3', not a number"),
        ("1 2 0x10 4 5 6", "row {row} (line {line}): column '3' is '0x10', not a number"),
        (
            "1 2 3,5 4 5 6",
            "row {row} (line {line}): column '3' is '3,5', not a number; decimals are written with a point",
        ),
        ("1 2 1_000 4 5 6", "row {row} (line {line}): column '3' is '1_000', not a number"),
    ],
)
def test_a_bad_row_is_named_and_those_before_it_are_read(tmp_path, monkeypatch, block, row, end, bad, says):
    monkeypatch.setattr("sagnac.formats.text.lines.BLOCK", block)
    lines = ["% a log", *TEXT.splitlines()]
    lines[row] = bad
    path = put(tmp_path, end.join(lines) + end)
    read, fault = pieces(path)
    np.testing.assert_array_equal(read, DATA[: row - 1])
    offset = sum(len(line + end) for line in lines[:row])
    assert fault.offset == offset
    assert str(fault) == f"{path}: damaged at byte {offset}: {says.format(row=row, line=row + 1)}"


def test_the_first_of_several_bad_rows_is_named(tmp_path):
    lines = TEXT.splitlines()
    lines[50], lines[20], lines[60] = "1 2 3", "1 2 y 4 5 6", "z 2 3 4 5 6"
    read, fault = pieces(put(tmp_path, "\n".join(lines)))
    assert len(read) == 20
    assert "row 21 (line 21): column '3' is 'y'" in fault.reason


def test_bytes_that_are_no_text(tmp_path):
    content = TEXT.encode()
    at = content.index(b"\n", 500) + 1
    read, fault = pieces(put(tmp_path, content[:at] + b"\xff\xfe\x00 2 3 4 5 6\n" + content[at:]))
    assert fault.offset == at
    np.testing.assert_array_equal(read, DATA[: content[:at].count(b"\n")])


def test_a_last_line_that_is_cut_off(tmp_path):
    read, fault = pieces(put(tmp_path, TEXT + "1 2 3"))
    assert len(read) == ROWS
    assert (
        fault.reason
        == f"row {ROWS + 1} (line {ROWS + 1}), the last line, is cut off: it has 3 fields where there are 6 columns"
    )


def test_a_last_line_without_end_is_remarked(tmp_path):
    assert numbers.open_table(put(tmp_path, TEXT)).remarks == ()
    assert "does not end with a line break" in numbers.open_table(put(tmp_path, TEXT[:-1])).remarks[0]


def test_a_line_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr("sagnac.formats.text.lines.BLOCK", 1000)
    read, fault = pieces(put(tmp_path, TEXT[:800] + "\n" + "1" * 5000))
    assert "a line without end" in fault.reason or "fields" in fault.reason
    assert len(read) <= TEXT[:800].count("\n") + 1


def test_comments_alone_are_refused(tmp_path):
    with pytest.raises(InputError, match="no line of numbers found"):
        numbers.open_table(put(tmp_path, "# a\n% b\n\n"))


def test_missing_values_become_nan(tmp_path):
    read, fault = pieces(put(tmp_path, "1,2,3\n4,,6\n7,nan,9\n"), ("1", "2", "3"))
    assert fault is None
    np.testing.assert_array_equal(read, [[1, 2, 3], [4, np.nan, 6], [7, np.nan, 9]])


@given(st.binary(max_size=300))
def test_any_bytes_are_a_table_or_a_told_error(tmp_path, data):
    path = put(tmp_path, b"1 2 3\n" + data)
    pieces(path, numbers.open_table(path).columns)


@given(st.integers(0, len(TEXT)))
def test_any_truncation_gives_the_rows_before_it(tmp_path, at):
    whole = TEXT[:at].rpartition("\n")[0]
    if not whole:
        return
    read, fault = pieces(put(tmp_path, TEXT[:at]))
    sound = whole.count("\n") + 1
    np.testing.assert_array_equal(read[:sound], DATA[:sound])
    assert len(read) == sound or (fault is None and len(read) == sound + 1)  # cut within the last number: remarked


@given(st.integers(0, len(TEXT)), st.integers(0, 30), st.binary(max_size=6))
def test_any_damage_is_a_table_or_a_told_error(tmp_path, at, cut, put_in):
    path = put(tmp_path, TEXT[:at].encode() + put_in + TEXT[at + cut :].encode())
    try:
        pieces(path, numbers.open_table(path).columns)
    except InputError as error:
        if not str(error).startswith(f"{path}: "):
            raise
