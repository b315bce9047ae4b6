"""HDF5 and MATLAB 7.3; h5py writes both, the second as MATLAB does: axes in reverse, classes in attributes."""

from __future__ import annotations

import builtins

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.formats import Fault, format_of, open_table
from sagnac.formats.arrays import variables

ROWS = 400
RNG = np.random.default_rng(12)
TIME = np.arange(ROWS) * 0.01
ACC = RNG.normal(size=(ROWS, 3))
GYR = RNG.normal(size=(3, ROWS))
COUNTS = RNG.integers(-30000, 30000, ROWS).astype("i2")


def plain(path, **options):
    """A file with groups, attributes, a compound dataset and things that are no samples."""
    with h5py.File(path, "w") as file:
        file.create_dataset("time", data=TIME, **options).attrs["units"] = "s"
        imu = file.create_group("imu")
        imu.create_dataset("acc", data=ACC, **options).attrs["unit"] = b"m/s^2"
        texts = np.array(["deg/s", "deg/s", "deg/h"], dtype=h5py.string_dtype())
        imu.create_dataset("gyr", data=GYR, **options).attrs["units"] = texts
        kind = [("n", "i2"), ("v", ">f4", (3,)), ("name", "S4")]
        both = np.zeros(ROWS, dtype=kind)
        both["n"], both["v"] = COUNTS, ACC
        file["raw"] = both
        file["short"] = np.zeros(9)
        file["names"] = ["a", "b"]
        file["cube"] = np.zeros((3, 3, 3))
        file["empty"] = np.zeros((0, 4))
        file["one"] = 9.81
        file["elsewhere"] = h5py.ExternalLink("/nowhere.h5", "/x")
        file["again"] = h5py.SoftLink("/time")
        file["imu/up"] = file["/"]  # a circle
    return path


COLUMNS = (
    "imu.acc.1 [m/s^2]", "imu.acc.2 [m/s^2]", "imu.acc.3 [m/s^2]", "imu.gyr.1 [deg/s]", "imu.gyr.2 [deg/s]",
    "imu.gyr.3 [deg/h]", "raw.n", "raw.v.1", "raw.v.2", "raw.v.3", "time [s]",
)  # fmt: skip
TRUE = np.column_stack([ACC, GYR.T, COUNTS, ACC.astype("f4"), TIME])


def pieces(path):
    table = open_table(path)
    parts = [np.zeros((0, len(table.columns)))]
    try:
        for batch in table.read(table.columns, []):
            parts += [np.column_stack([c.to_numpy() for c in batch.columns])]
    except Fault as fault:
        return np.concatenate(parts), fault
    return np.concatenate(parts), None


@pytest.mark.parametrize("rows", [7, 1 << 17])
@pytest.mark.parametrize("options", [{}, {"chunks": True, "compression": "gzip", "shuffle": True, "fletcher32": True}])
def test_numbers_are_those_that_were_written(tmp_path, monkeypatch, rows, options):
    monkeypatch.setattr(variables, "BATCH", rows)
    path = plain(tmp_path / "log.h5", **options)
    assert format_of(path).module == "arrays.hdf5"
    table = open_table(path)
    assert table.columns == COLUMNS
    assert table.remarks == ("read are the arrays of 400 samples; left out, of another length: short (9)",)
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read, TRUE)


def test_some_columns_in_any_order_with_their_own_types(tmp_path):
    table = open_table(plain(tmp_path / "log.h5"))
    (batch,) = table.read(["time [s]", "raw.n"], ["imu.gyr.2 [deg/s]", "raw.v.3", "raw.n"])
    assert [str(t) for t in batch.schema.types] == ["double", "double", "double", "float", "int16"]
    for column, true in zip(batch.columns, (TIME, COUNTS, GYR[1], ACC[:, 2].astype("f4"), COUNTS), strict=True):
        np.testing.assert_array_equal(column.to_numpy(), true)
    assert table.position() == table.size == table.path.stat().st_size


def matlab(path, content):
    """A 7.3 file: a head of 512 bytes, every matrix n x k as a dataset k x n, texts as numbers, structures as groups."""

    def put(group, name, value):
        if isinstance(value, dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, part in value.items():
                put(inner, key, part)
            return
        if isinstance(value, str):
            item = group.create_dataset(name, data=np.array([[ord(c)] for c in value], dtype="u2"))
            item.attrs["MATLAB_class"] = np.bytes_("char")
            return
        value = np.asarray(value)
        value = value.reshape(-1, 1) if value.ndim == 1 else value
        item = group.create_dataset(name, data=value.T)
        item.attrs["MATLAB_class"] = np.bytes_({"f8": "double", "i2": "int16"}.get(value.dtype.str[1:], "double"))

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            put(file, name, value)
        references = file.create_group("#refs#")
        references["a"] = np.zeros(ROWS)
        cells = file.create_dataset("cells", data=np.array([[references["a"].ref]], dtype=h5py.ref_dtype))
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        nothing = file.create_dataset("nothing", data=np.zeros(2, dtype="u8"))
        nothing.attrs["MATLAB_class"], nothing.attrs["MATLAB_empty"] = np.bytes_("double"), 1
        sparse = file.create_group("sparse")
        sparse.attrs["MATLAB_sparse"] = 3
        sparse["data"] = np.zeros(ROWS)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def test_matlab(tmp_path):
    imu = {"acc": ACC, "gyr": GYR, "n": COUNTS, "units": {"acc": "m/s^2", "gyr": "deg/s"}}
    path = matlab(tmp_path / "log.mat", {"time": TIME, "imu": imu, "who": "a unit", "R": np.eye(3)})
    assert format_of(path).module == "arrays.hdf5"
    table = open_table(path)
    assert table.columns == (
        "imu.acc.1 [m/s^2]", "imu.acc.2 [m/s^2]", "imu.acc.3 [m/s^2]",
        "imu.gyr.1 [deg/s]", "imu.gyr.2 [deg/s]", "imu.gyr.3 [deg/s]", "imu.n", "time",
    )  # fmt: skip
    assert table.remarks == ("read are the arrays of 400 samples; left out, of another length: R (3)",)
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read, np.column_stack([ACC, GYR.T, COUNTS, TIME]))


def test_a_square_matrix_has_its_rows_in_time(tmp_path):
    square = RNG.normal(size=(5, 5))
    read, _ = pieces(matlab(tmp_path / "a.mat", {"x": square}))
    np.testing.assert_array_equal(read, square)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = square
    np.testing.assert_array_equal(pieces(tmp_path / "a.h5")[0], square)


def test_without_h5py_it_is_said_what_to_install(tmp_path, monkeypatch):
    path = plain(tmp_path / "log.h5")
    real = builtins.__import__

    def without(name, *rest):
        if name == "h5py":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install 'sagnac\[matlab\]'"):
        open_table(path)


def test_nothing_to_read(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = 1.0
    with pytest.raises(InputError, match="no array of numbers with more than one sample"):
        open_table(tmp_path / "a.h5")


def test_two_columns_of_one_name(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a/b"], file["a.b"] = TIME, TIME
    with pytest.raises(InputError, match=r"several columns have one name: a.b \(400\), a.b \(400\)"):
        open_table(tmp_path / "a.h5")


@pytest.mark.parametrize("at", [0.3, 0.7, 0.999])
def test_a_file_that_is_cut_off(tmp_path, at):
    whole = plain(tmp_path / "log.h5").read_bytes()
    path = tmp_path / "cut.h5"
    cut = int(at * len(whole))
    path.write_bytes(whole[:cut])
    with pytest.raises(Fault, match="HDF5 cannot be read in part") as caught:
        open_table(path)
    assert caught.value.offset == cut
    assert f"at byte {len(whole)}" in caught.value.reason


@pytest.mark.parametrize("rows", [64, 1 << 17])
def test_rows_before_a_damaged_chunk_are_read(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(variables, "BATCH", rows)
    path = tmp_path / "chunks.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("time", data=TIME, chunks=(50,), fletcher32=True)
        file.create_dataset("acc", data=ACC, chunks=(30, 3), fletcher32=True)
        place = file["acc"].id.get_chunk_info_by_coord((120, 0)).byte_offset
    whole = bytearray(path.read_bytes())
    whole[place + 11] ^= 4
    path.write_bytes(whole)
    read, fault = pieces(path)
    np.testing.assert_array_equal(read, np.column_stack([ACC, TIME])[:120])
    assert fault.offset == place
    assert "/acc cannot be read from row 121 on" in fault.reason


def test_a_dataset_larger_than_any_file_could_hold(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", shape=(10**14,), dtype="f8", chunks=(1000,), compression="gzip")
    with pytest.raises(InputError, match="more than a file of .* bytes can hold"):
        open_table(tmp_path / "a.h5")


def test_a_heap_that_would_send_the_library_in_circles_is_left_alone(tmp_path):
    whole = bytearray(plain(tmp_path / "log.h5").read_bytes())
    first = whole.index(b"GCOL") + 16
    whole[first : first + 16] = bytes(16)  # free space of no size: the next object is this one again
    path = tmp_path / "damaged.h5"
    path.write_bytes(whole)
    assert open_table(path).columns == tuple(c.split(" [")[0] for c in COLUMNS)
    np.testing.assert_array_equal(pieces(path)[0], TRUE)


@given(changes=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=5))
@settings(max_examples=60)
def test_any_damage_is_a_table_or_a_told_error(tmp_path, changes):
    whole = bytearray(plain(tmp_path / "log.h5", chunks=True, fletcher32=True).read_bytes())
    for at, value in changes:
        whole[8 + int(at * (len(whole) - 9))] = value
    path = tmp_path / "damaged.h5"
    path.write_bytes(whole)
    try:
        pieces(path)
    except InputError as error:
        if not str(error).startswith(f"{path}: "):
            raise


def packed(path, **attributes):
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        item = file.create_dataset("acc", data=np.column_stack([COUNTS, COUNTS, COUNTS]))
        item.attrs.update(attributes)
    return path


@pytest.mark.parametrize("rows", [7, 1 << 17])
@pytest.mark.parametrize(
    ("attributes", "scale", "offset"),
    [
        ({"scale_factor": 0.01}, 0.01, 0.0),
        ({"add_offset": np.float32(-2.5)}, 1.0, -2.5),
        ({"scale_factor": np.array([-0.01]), "add_offset": 5}, -0.01, 5.0),
        ({"scale_factor": 0.01, "add_offset": 0.0, "_FillValue": COUNTS[9]}, 0.01, 0.0),
        ({"_FillValue": COUNTS[9:10], "missing_value": float(COUNTS[20])}, 1.0, 0.0),
    ],
)
def test_packed_numbers_are_unpacked(tmp_path, monkeypatch, rows, attributes, scale, offset):
    # CF conventions 1.11, 8.1 and 2.5.1: number in the file * scale_factor + add_offset; fills are numbers in the file
    monkeypatch.setattr(variables, "BATCH", rows)
    true = COUNTS * scale + offset
    fills = [int(np.ravel(v)[0]) for k, v in attributes.items() if k in ("_FillValue", "missing_value")]
    true[np.isin(COUNTS, fills)] = np.nan
    path = packed(tmp_path / "a.h5", units="m/s^2", **attributes)
    assert np.isnan(true).any() == bool(fills)
    read, fault = pieces(path)
    assert fault is None
    np.testing.assert_array_equal(read, np.column_stack([true, true, true, TIME]))
    assert open_table(path).columns == (*(f"acc.{k} [m/s^2]" for k in (1, 2, 3)), "time")
    (batch, *_) = open_table(path).read([], ["acc.1 [m/s^2]"])
    assert str(batch.schema.types[0]) == "double"


def test_a_fill_of_doubles_in_singles(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        item = file.create_dataset("x", data=np.array([1.0, 9.96920996838687e36, 2.0], dtype="f4"))
        item.attrs["_FillValue"] = 9.96920996838687e36
    np.testing.assert_array_equal(pieces(tmp_path / "a.h5")[0], [[1.0], [np.nan], [2.0]])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("scale_factor", [0.1, 0.2, 0.3]),
        ("scale_factor", "0.1"),
        ("scale_factor", 0.0),
        ("scale_factor", np.nan),
        ("add_offset", np.inf),
        ("_FillValue", [1, 2]),
        ("missing_value", "none"),
        ("_Unsigned", "true"),
    ],
)
def test_packing_that_cannot_be_applied_is_refused_where_it_is_read(tmp_path, key, value):
    table = open_table(packed(tmp_path / "a.h5", **{key: value}))
    assert len(list(table.read(["time"], []))) == 1
    with pytest.raises(InputError, match=f"a.h5: /acc: its attribute {key} is in a form that cannot be applied"):
        list(table.read(["acc.1"], []))


def test_packing_of_a_compound_dataset_is_refused(tmp_path):
    item_path = plain(tmp_path / "a.h5")
    with h5py.File(item_path, "a") as file:
        file["raw"].attrs["scale_factor"] = 0.1
    with pytest.raises(InputError, match="/raw: its attribute scale_factor"):
        list(open_table(item_path).read(["raw.n"], []))


def test_arrays_of_other_lengths_stand_beside(tmp_path):
    table = open_table(plain(tmp_path / "log.h5"))
    (short,) = table.besides
    assert (table.samples, short.samples) == (400, 9)
    assert short.columns == ("short",)
    (batch,) = short.read(["short"], [])
    assert batch.column(0).to_pylist() == [0.0] * 9
    assert table.whole == {"raw.n"}
