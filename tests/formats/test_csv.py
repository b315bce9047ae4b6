"""Text tables as people and loggers write them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import InputError, SagnacError
from sagnac.formats import open_table
from sagnac.formats.text import csv as csv_format

ROWS = 60
DATA = np.column_stack([np.arange(ROWS) * 0.01, np.random.default_rng(1).normal(size=(ROWS, 3))])
HEADER = "time [s],accel_x [g],accel_y [g],note"
TEXT = "\n".join([HEADER, *(f"{r[0]!r},{r[1]!r},{r[2]!r},n{i}" for i, r in enumerate(DATA.tolist()))]) + "\n"
NUMERIC = ["time [s]", "accel_x [g]", "accel_y [g]"]


def put(folder: Path, text: str | bytes) -> Path:
    path = folder / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def numbers(path: Path, numeric=NUMERIC, other=()) -> np.ndarray:
    pieces = list(open_table(path).read(numeric, other))
    if not pieces:
        return np.zeros((0, len(numeric)))
    return np.column_stack(
        [np.concatenate([p.column(i).to_numpy(zero_copy_only=False) for p in pieces]) for i in range(len(numeric))]
    )


def refusal(path: Path, numeric=NUMERIC, other=()) -> str:
    with pytest.raises(InputError) as caught:
        numbers(path, numeric, other)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value).removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    "text",
    [
        TEXT,
        TEXT.removesuffix("\n"),
        TEXT.replace("\n", "\r\n"),
        TEXT.replace("\n", "\r"),
        "\ufeff" + TEXT,
        TEXT.replace(",", ";"),
        TEXT.replace(",", "\t"),
        TEXT.replace(",", ", "),
        TEXT.replace(",", " ,  "),
        "# made by a logger\n#\n\n" + TEXT,
        "// made by a logger\n% 1 2 3\n" + TEXT,
        "\ufeff# mark, then comment\r\n" + TEXT.replace("\n", "\r\n"),
        "# a\u2028b\x0cc\x85d\x1ce\n" + TEXT,  # ends of lines elsewhere, but not in a CSV file
        TEXT.replace("\n", "\n\n"),  # blank lines are no rows
        ",".join(f'"{name}"' for name in HEADER.split(",")) + TEXT.removeprefix(HEADER),
        HEADER.replace(",", "  ,  ") + TEXT.removeprefix(HEADER),
    ],
    ids=[
        "plain", "no-end", "crlf", "cr", "bom", "semicolon", "tab", "space-after", "spaces", "comments",
        "other-comments", "bom-comment",
        "unicode-ends", "blank-lines", "quoted-header", "spaced-header",
    ],
)  # fmt: skip
def test_numbers_are_those_that_were_written(tmp_path, text):
    table = open_table(put(tmp_path, text))
    assert table.columns == ("time [s]", "accel_x [g]", "accel_y [g]", "note")
    np.testing.assert_array_equal(numbers(table.path), DATA[:, :3])


@pytest.mark.parametrize("block", [120, 333, 1000, 1 << 24])
def test_numbers_do_not_depend_on_the_block_size(tmp_path, monkeypatch, block):
    monkeypatch.setattr(csv_format, "_BLOCK", block)
    np.testing.assert_array_equal(numbers(put(tmp_path, TEXT)), DATA[:, :3])


@pytest.mark.parametrize(
    ("written", "number"),
    [("+2", 2.0), (".5", 0.5), ("5.", 5.0), ("-1E+3", -1000.0), ('"7"', 7.0), ("  8 ", 8.0), ("0009", 9.0)],
)
def test_number_forms(tmp_path, written, number):
    assert numbers(put(tmp_path, f"a,b\n1,{written}\n"), ["b"])[0, 0] == number


@pytest.mark.parametrize("written", ["", "NaN", "nan", "NA", "null"])
def test_missing_values_become_nan_for_the_checks_to_find(tmp_path, written):
    assert np.isnan(numbers(put(tmp_path, f"a,b\n1,{written}\n"), ["b"])[0, 0])


@pytest.mark.parametrize("block", [150, 1 << 24])
@pytest.mark.parametrize("before", ["", "# comment\n\n"])
@pytest.mark.parametrize("row", [1, 2, 37, ROWS])
@pytest.mark.parametrize(
    ("damaged", "says"),
    [
        ("1,2,x,n", "row {row} (line {line}): 'accel_y [g]' is 'x', not a number"),
        ("1,2,3", "row {row} (line {line}) has 3 fields where the header has 4"),
        ("1,2,3,4,5", "row {row} (line {line}) has 5 fields where the header has 4"),
        ("1,2,0x10,n", "row {row} (line {line}): 'accel_y [g]' is '0x10', not a number"),
    ],
)
def test_a_bad_row_is_named(tmp_path, monkeypatch, block, before, row, damaged, says):
    monkeypatch.setattr(csv_format, "_BLOCK", block)
    lines = TEXT.splitlines()
    lines[row] = damaged
    expected = says.format(row=row, line=before.count("\n") + 1 + row)
    byte = len((before + "\n".join(lines[:row]) + "\n").encode())
    assert refusal(put(tmp_path, before + "\n".join(lines))) == f"{expected} (byte {byte})"


def test_decimal_commas_are_recognised(tmp_path):
    said = refusal(put(tmp_path, TEXT.replace(",", ";").replace(".", ",")))
    assert said == "row 1 (line 2): 'time [s]' is '0,0', not a number; decimals are written with a point (byte 38)"


def test_a_quote_that_never_ends(tmp_path):
    assert "row 3 " in refusal(put(tmp_path, 'a,b\n1,2\n3,4\n5,"6\n7,8\n'), ["a", "b"])


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (b"\n\n\n", "no header line"),
        (b"# only\n# comments\n", "no header line"),
        (b"\x00\x01\x02", "neither Parquet nor text (a zero byte at 0)"),
        (b"time [s]\0,a\n", "neither Parquet nor text (a zero byte at 8)"),
        ("time [s],temperature [°C]\n".encode("latin-1"), "neither Parquet nor UTF-8 text (byte 22)"),
        (("time [s],t [°C]\n" + "1,2\n" * 20000).encode("latin-1"), "neither Parquet nor UTF-8 text (byte 12)"),
        (TEXT.encode("utf-16"), "neither Parquet nor UTF-8 text (byte 0)"),
        (b"time [s]," * 8000, "no header line (time [s],accel_x [g],...) found in its first 64 kB"),
        (b"# long\n" * 10000 + TEXT.encode(), "no header line"),
        (b"a,b,a,c,b\n1,2,3,4,5\n", "these columns stand more than once in the header: a, b"),
        (b"a , a\n1,2\n", "these columns stand more than once in the header: a"),
        (b'# c\n"3","1",,"2.5"\n9,8,7,6\n', "line 2 is numbers alone where the header (time [s],accel_x [g],...) should stand"),
    ],
    ids=[
        "empty", "blank", "comments", "binary", "zero", "latin-1", "latin-1 long", "utf-16", "endless", "far", "twice",
        "twice but for spaces", "numbers in quotes",
    ],
)  # fmt: skip
def test_what_is_no_table_is_refused(tmp_path, content, says):
    assert says in refusal(put(tmp_path, content), ["a"])


@pytest.mark.parametrize("text", [HEADER, HEADER + "\n", "# c\n" + HEADER, HEADER + "\n\n\n"])
def test_a_header_alone_gives_no_rows(tmp_path, text):
    assert numbers(put(tmp_path, text)).shape == (0, 3)


def test_a_missing_file_and_a_folder(tmp_path):
    for path in (tmp_path / "nowhere.csv", tmp_path):
        with pytest.raises(InputError, match="cannot read"):
            open_table(path)


def test_a_nameless_column_gets_its_number(tmp_path):
    # spreadsheets end lines with separators
    table = open_table(put(tmp_path, "a,b,,\n1,2,,\n"))
    assert table.columns == ("a", "b", "column 3", "column 4")
    assert numbers(table.path, ["a", "b"]).tolist() == [[1, 2]]


def test_columns_that_nobody_reads_never_stop_the_reading(tmp_path, monkeypatch):
    # whole numbers in the first block, words in a later one
    monkeypatch.setattr(csv_format, "_BLOCK", 100)
    path = put(tmp_path, "a,note\n" + "".join(f"{i},{i if i < 50 else 'moved'}\n" for i in range(100)))
    notes = [v for piece in open_table(path).read(["a"], ["note"]) for v in piece.column(1).to_pylist()]
    assert notes == [str(i) if i < 50 else "moved" for i in range(100)]


def test_columns_that_nobody_reads_keep_their_type(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_format, "_BLOCK", 100)
    path = put(tmp_path, "a,count\n" + "".join(f"{i},{i}\n" for i in range(100)))
    assert {str(piece.schema.field("count").type) for piece in open_table(path).read(["a"], ["count"])} == {"int64"}


@given(st.binary(max_size=400))
def test_any_bytes_are_a_table_or_a_told_error(tmp_path, data):
    path = put(tmp_path, data)
    try:
        table = open_table(path)
        numbers(path, list(table.columns[:2]), list(table.columns[2:]))
    except SagnacError as error:
        if not str(error).startswith(f"{path}: "):
            raise


@given(st.integers(0, len(TEXT)), st.integers(0, 30), st.binary(max_size=6))
def test_any_damage_is_a_table_or_a_told_error(tmp_path, at, cut, put_in):
    path = put(tmp_path, TEXT[:at].encode() + put_in + TEXT[at + cut :].encode())
    try:
        table = open_table(path)
        numbers(path, list(table.columns[:3]), list(table.columns[3:]))
    except SagnacError as error:
        if not str(error).startswith(f"{path}: "):
            raise


def test_memory_does_not_grow_with_the_file(tmp_path):
    # A child reads a short and a long file through and tells its greatest memory after each. The long one is
    # 120 MB more; what pyarrow keeps in flight is a few blocks, here of 1 MB.
    line = "0.123456,0.0123456789,-0.0123456789,1.0123456789\n"
    short, long = tmp_path / "short.csv", tmp_path / "long.csv"
    for path, size in ((short, 20_000_000), (long, 140_000_000)):
        chunk = line * 20_000
        with path.open("w") as stream:
            stream.write("a,b,c,d\n")
            for _ in range(size // len(chunk)):
                stream.write(chunk)
    code = (
        "import resource, sys\nfrom sagnac.formats import open_table\nfrom sagnac.formats.text import csv\ncsv._BLOCK = 1 << 20\n"
        "for path in sys.argv[1:]:\n"
        "    rows = sum(b.num_rows for b in open_table(path).read(['a', 'b', 'c', 'd'], []))\n"
        "    print(rows, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(short), str(long)], capture_output=True, text=True, check=True, timeout=60
    )
    (rows, before), (more, after) = (map(int, out.split()) for out in done.stdout.splitlines())
    long.unlink()
    unit = 1024 if sys.platform != "darwin" else 1  # ru_maxrss is in kB, on macOS in bytes
    assert more > 6 * rows
    assert (after - before) * unit < 30e6  # a quarter of what the long file has more
