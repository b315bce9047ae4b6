"""Parquet tables, sound and damaged."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet

from sagnac.errors import InputError, SagnacError
from sagnac.formats import open_table
from sagnac.formats import parquet as parquet_format

DATA = np.random.default_rng(2).normal(size=(1000, 2))


def put(path, columns, **options):
    parquet.write_table(columns if isinstance(columns, pa.Table) else pa.table(columns), path, **options)
    return path


@pytest.fixture
def sound(tmp_path):
    return put(tmp_path / "a.parquet", {"time [s]": DATA[:, 0], " b ": DATA[:, 1], "note": ["x"] * 1000})


@pytest.mark.parametrize("rows", [7, 1000, 1 << 17])
def test_numbers_are_those_that_were_written(sound, monkeypatch, rows):
    monkeypatch.setattr(parquet_format, "_ROWS", rows)
    table = open_table(sound)
    assert table.columns == ("time [s]", "b", "note")
    pieces = list(table.read(["b", "time [s]"], ["note"]))
    assert max(p.num_rows for p in pieces) <= rows
    assert pieces[0].schema.names == ["b", "time [s]", "note"]
    np.testing.assert_array_equal(np.concatenate([p.column(0).to_numpy() for p in pieces]), DATA[:, 1])
    np.testing.assert_array_equal(np.concatenate([p.column(1).to_numpy() for p in pieces]), DATA[:, 0])


def test_the_format_is_told_by_content_not_by_name(sound, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(sound.read_bytes())
    assert open_table(path).columns == ("time [s]", "b", "note")


@pytest.mark.parametrize("type_", ["int8", "int32", "uint16", "float32", "int64"])
def test_other_number_types(tmp_path, type_):
    path = put(tmp_path / "a.parquet", {"a": pa.array([1, 2, 3], getattr(pa, type_)())})
    (piece,) = open_table(path).read(["a"], [])
    assert piece.column(0).type == pa.float64()
    assert piece.column(0).to_pylist() == [1.0, 2.0, 3.0]


def test_whole_nanoseconds_since_1970_are_rounded_not_refused(tmp_path):
    path = put(tmp_path / "a.parquet", {"time [ns]": [1_700_000_000_000_000_001]})
    (piece,) = open_table(path).read(["time [ns]"], [])
    assert piece.column(0)[0].as_py() == pytest.approx(1.7e18, rel=2**-53)


def test_integers_are_known_and_come_exactly_when_asked_for_as_they_are(tmp_path):
    whole = [1_700_000_000_000_000_001, 1_700_000_000_001_000_003]
    table = open_table(put(tmp_path / "a.parquet", {"time [ns]": whole, "a": [1.0, 2.0], "n": ["x", "y"]}))
    assert table.whole == {"time [ns]"}
    (piece,) = table.read(["a"], ["time [ns]"])
    assert piece.column("time [ns]").to_pylist() == whole


def test_missing_values_become_nan_for_the_checks_to_find(tmp_path):
    path = put(tmp_path / "a.parquet", {"a": [1.0, None]})
    (piece,) = open_table(path).read(["a"], [])
    assert np.isnan(piece.column(0).to_numpy(zero_copy_only=False)[1])


@pytest.mark.parametrize("values", [pa.array(["x", "y"]), pa.array([1, 2], pa.timestamp("us")), pa.array([[1], [2]])])
def test_a_column_that_is_no_number_is_named(tmp_path, values):
    path = put(tmp_path / "a.parquet", {"b": [1.0, 2.0], "a": values})
    with pytest.raises(InputError, match=r"a\.parquet: cannot read the numbers in column 'a'"):
        list(open_table(path).read(["b", "a"], []))


@pytest.mark.parametrize("names", [["a", "a"], ["a", " a"]])
def test_columns_that_stand_twice(tmp_path, names):
    table = pa.Table.from_arrays([pa.array([1.0]), pa.array([2.0])], names=names)
    with pytest.raises(InputError, match="these columns stand more than once: a"):
        open_table(put(tmp_path / "a.parquet", table))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.99])
def test_a_truncated_file(sound, share):
    data = sound.read_bytes()
    sound.write_bytes(data[: max(4, int(len(data) * share))])
    with pytest.raises(InputError, match=r"a\.parquet: damaged Parquet file"):
        open_table(sound)


@given(st.data())
def test_any_damage_is_a_table_or_a_told_error(tmp_path, data):
    path = put(tmp_path / "b.parquet", {"time [s]": DATA[:40, 0], "b": DATA[:40, 1]})
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(4, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(content[: data.draw(st.integers(4, len(content)))]) if data.draw(st.booleans()) else content)
    try:
        table = open_table(path)
        list(table.read(list(table.columns), []))
    except SagnacError as error:
        if not str(error).startswith(f"{path}: "):
            raise


def test_a_name_that_is_no_utf_8(tmp_path):
    path = put(tmp_path / "a.parquet", {"tiny": [1.0]})
    path.write_bytes(path.read_bytes().replace(b"tiny", b"t\xffny"))
    with pytest.raises(InputError, match="damaged Parquet file"):
        open_table(path)
