"""The master's log: columns, units, refusals with row and reason; and whether its velocity is what its position does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet
from voyages import DEG, voyage

from sagnac.align.checks import master as master_checks
from sagnac.align.master import from_arrays, open_master
from sagnac.errors import DataError, InputError
from sagnac.frames import attitude_matrix

HEADER = "time [s],latitude [deg],longitude [deg],height [m],v_east [m/s],v_north [m/s],v_up [m/s]"
ANGLES = ",heading [deg],pitch [deg],roll [deg]"
ROWS = ["0,60,108,10,5,0,0", "0.1,60,108.00001,10,5,0,0", "0.2,60,108.00002,10,5,0,0"]


@pytest.fixture
def csv(tmp_path):
    def write(header: str = HEADER, rows=ROWS):
        path = tmp_path / "master.csv"
        path.write_text("\n".join([header, *rows]) + "\n")
        return path

    return write


def refused(path) -> str:
    with pytest.raises(InputError) as caught:
        open_master(path)
    assert str(caught.value).startswith(str(path))
    return str(caught.value)


# ------------------------------------------------------------------------------------------------- what is read


def test_columns_become_si(csv):
    master = open_master(
        csv(HEADER + ANGLES, [r + a for r, a in zip(ROWS, [",370,1,-2", ",-10,1,-2", ",350,1,-2"], strict=True)])
    )
    assert master.time.tolist() == [0, 0.1, 0.2]
    assert master.latitude == pytest.approx(60 * DEG)
    assert master.longitude[2] == pytest.approx(108.00002 * DEG, rel=1e-15)
    assert master.velocity.tolist() == [[5, 0, 0]] * 3
    assert master.attitude[0] == pytest.approx(attitude_matrix(10 * DEG, DEG, -2 * DEG))
    assert master.attitude[1] == pytest.approx(master.attitude[2])  # headings in any turn


def test_other_units_order_and_columns(csv):
    header = "heave [m],v_up [kn],v_north [km/h],v_east [ft/s],height [ft],longitude [rad],latitude [arcmin],time [ms]"
    master = open_master(csv(header, ["0,1,36,10,100,-1,-600,0", "0,1,36,10,100,-1,-600,100"]))
    assert master.velocity[0] == pytest.approx([3.048, 10, 1852 / 3600])
    assert master.height[0] == pytest.approx(30.48)
    assert master.latitude[0] == pytest.approx(-10 * DEG)
    assert master.time.tolist() == [0, pytest.approx(0.1)]
    assert master.attitude is None


def test_parquet_and_csv_read_alike(tmp_path, csv):
    columns = list(zip(*[[float(v) for v in r.split(",")] for r in ROWS], strict=True))
    parquet.write_table(pa.table(dict(zip(HEADER.split(","), columns, strict=True))), tmp_path / "m.parquet")
    one, other = open_master(tmp_path / "m.parquet"), open_master(csv())
    assert np.array_equal(one.longitude, other.longitude)
    assert np.array_equal(one.velocity, other.velocity)


def test_longitude_goes_on_over_the_date_line(csv):
    master = open_master(csv(rows=["0,60,179.99999,0,5,0,0", "1,60,-179.99999,0,5,0,0", "2,60,-179.99997,0,5,0,0"]))
    assert np.diff(master.longitude) == pytest.approx([0.00002 * DEG] * 2, rel=1e-5)


def test_gaps_are_found():
    y = voyage("straight")
    kept = (y.stamps < 10) | (y.stamps > 12)
    master = from_arrays(y.stamps[kept], *y.place[kept].T, y.velocity[kept])
    assert master.interval == pytest.approx(0.1)
    ((start, stop),) = master.gaps()
    assert (start, stop) == pytest.approx((9.9, 12.1), abs=0.11)
    assert voyage("straight").master.gaps() == []


# --------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize("name", [h.split(" ")[0] for h in HEADER.split(",")])
def test_a_column_that_is_missing_is_asked_for(csv, name):
    said = refused(csv(HEADER.replace(f"{name} [", f"my_{name} [")))
    assert f"a master's log lacks {name} [" in said
    assert f"my_{name}" in said


def test_attitude_is_whole_or_not_there(csv):
    said = refused(csv(HEADER + ",heading [deg],roll [deg]", [r + ",1,2" for r in ROWS]))
    assert "a master's log lacks pitch [deg]" in said


def test_a_column_that_stands_twice(csv):
    said = refused(csv(HEADER + ",height [ft]", [r + ",1" for r in ROWS]))
    assert "the columns 'height [m]' and 'height [ft]' are both height" in said


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("time [s]", "time", "column 'time' has no unit. Write it in the header: time [s]"),
        ("v_up [m/s]", "v_up []", "column 'v_up []' has no unit. Write it in the header: v_up [m/s]"),
        ("latitude [deg]", "latitude [m]", "'m' is no unit of latitude; write for example latitude [deg]"),
        ("v_east [m/s]", "v_east [m]", "'m' is no unit of v_east; write for example v_east [m/s]"),
        ("height [m]", "height [metter]", "column 'height [metter]'"),
    ],
)
def test_units(csv, old, new, says):
    assert says in refused(csv(HEADER.replace(old, new)))


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("0.1,60,nan,10,5,0,0", "row 2: longitude is missing or not a number: not a finite number; remove or mend"),
        ("0.1,60,108,10,inf,0,0", "row 2: v_east is inf m/s: not a finite number"),
        ("0.1,,108,10,5,0,0", "row 2"),
        ("0,60,108,10,5,0,0", "row 2: time goes from 0 s to 0 s; it must increase from sample to sample"),
        ("-1,60,108,10,5,0,0", "row 2: time goes from 0 s to -1 s"),
        ("0.1,90.1,108,10,5,0,0", "row 2: latitude is 1.57254 rad: beyond what is found on Earth"),
        ("0.1,60,361,10,5,0,0", "row 2: longitude is 6.30064 rad: beyond what is found on Earth"),
        (
            "0.1,60,108,10,5,40000,0",
            "row 2: v_north is 40000 m/s: beyond what is found on Earth (3000 m/s at most); check",
        ),
        ("0.1,60,108,1e7,5,0,0", "row 2: height is 1e+07 m: beyond"),
        ("0.1,60,108,10,5,0", "row 2 (line 3) has 6 fields where the header has 7"),
        ("0.1,60,east,10,5,0,0", "row 2 (line 3): 'longitude [deg]' is 'east', not a number"),
    ],
)
def test_rows(csv, row, says):
    assert says in refused(csv(rows=[ROWS[0], row, ROWS[2]]))


def test_pitch_beyond_straight_up(csv):
    assert "row 1: pitch is 1.58825 rad" in refused(csv(HEADER + ANGLES, [r + ",0,91,0" for r in ROWS]))


def test_too_little(csv, tmp_path):
    assert "no samples" in refused(csv(rows=[]))
    assert "1 sample; a master's log needs two at least" in refused(csv(rows=ROWS[:1]))
    assert "cannot read" in refused(tmp_path / "nowhere.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\x00\xfe" * 10)
    assert "neither Parquet nor" in refused(tmp_path / "b.csv")


def test_arrays_are_checked_as_files_are():
    y = voyage("straight")
    latitude = y.place[:, 0].copy()
    latitude[3] = np.nan
    with pytest.raises(InputError, match="row 4: latitude"):
        from_arrays(y.stamps, latitude, *y.place[:, 1:].T, y.velocity)
    with pytest.raises(InputError, match="height has shape"):
        from_arrays(y.stamps, *y.place[:, :2].T, y.place[1:, 2], y.velocity)


@given(st.text(max_size=60), st.lists(st.text(max_size=30), max_size=3))
def test_whatever_the_file_holds_it_is_refused(tmp_path_factory, header, rows):
    path = tmp_path_factory.mktemp("m") / "m.csv"
    path.write_text("\n".join([header, *rows]), encoding="utf-8", errors="replace")
    with pytest.raises(InputError):
        open_master(path)


# ------------------------------------------------------------------------------ velocity and position together


def changed(y, **changes):
    return replace(y, **{name: change(getattr(y, name)) for name, change in changes.items()}).master


def columns(order, signs):
    return lambda v: v[:, order] * np.array(signs)


WRONG = [
    ({"velocity": columns([0, 1, 2], [1, -1, 1])}, "v_north has the other sign"),
    ({"velocity": columns([0, 1, 2], [-1, 1, 1])}, "v_east has the other sign"),
    ({"velocity": columns([0, 1, 2], [-1, -1, 1])}, "v_east and v_north have the other sign"),
    ({"velocity": columns([1, 0, 2], [1, 1, 1])}, "v_east and v_north are exchanged"),
    ({"velocity": lambda v: v / 0.514444}, "the velocity looks like knots but is labelled m/s"),
    ({"velocity": lambda v: v * 0.514444}, "the velocity looks like m/s but is labelled as knots"),
    ({"velocity": lambda v: v * 3.6}, "the velocity looks like km/h but is labelled m/s"),
    ({"velocity": lambda v: v / 0.3048}, "the velocity looks like ft/s but is labelled m/s"),
    ({"place": lambda p: p * [DEG, DEG, 1]}, "latitude and longitude look like radians but are labelled as degrees"),
    ({"place": lambda p: p * [1, -1, 1]}, "longitude is counted to the west"),
    ({"place": lambda p: p * [-1, 1, 1]}, "latitude is counted to the south"),
    ({"place": lambda p: p[:, [1, 0, 2]] - [0.9, 0, 0]}, "latitude and longitude are exchanged"),
    ({"velocity": lambda v: v * 1.3}, "check the columns' units and names, and that both are of the same system"),
    ({"velocity": lambda v: v * 0}, "check the columns' units and names"),
]


@pytest.mark.parametrize(("changes", "says"), WRONG, ids=[s[:30] for _, s in WRONG])
@pytest.mark.parametrize("way", ["straight", "s-turn"])
def test_a_velocity_that_is_not_what_the_position_does_is_explained(way, changes, says):
    with pytest.raises(DataError) as caught:
        master_checks.check(changed(voyage(way), **changes))
    assert "velocity and change of position disagree" in str(caught.value)
    assert says in str(caught.value)


@pytest.mark.parametrize("way", ["straight", "s-turn", "swaying", "parked", "aircraft", "pole"])
@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_sound_logs_pass(way, rate):
    assert master_checks.check(voyage(way, rate=rate).master) == []


def test_vertical_velocity_downwards():
    y = voyage("aircraft")
    with pytest.raises(DataError, match=r"v_up and the change of height disagree .* v_up has the other sign"):
        master_checks.check(changed(y, velocity=columns([0, 1, 2], [1, 1, -1])))
    with pytest.raises(DataError, match=r"v_up and the change of height disagree .* check both columns"):
        master_checks.check(changed(y, place=lambda p: p * [1, 1, 10]))


def stepped(at, by):
    def change(values):
        out = values.copy()
        out[at:] += by
        return out

    return change


def test_jumps_of_the_position():
    y = voyage("s-turn")
    metre = 1 / 6.37e6
    (said,) = master_checks.check(changed(y, place=stepped(600, [3 * metre, 0, 0])))
    assert "the position jumps by 3 m at 60 s (row 601), which its velocity does not explain" in said.replace(
        "3.01", "3"
    )
    with pytest.raises(DataError, match=r"the position jumps by 30 m at 60 s \(row 601\).* align on one side of it"):
        master_checks.check(changed(y, place=stepped(600, [29.96 * metre, 0, 0])))
    assert master_checks.check(changed(y, place=stepped(600, [0.1 * metre, 0, 0]))) == []


def test_gaps_are_spoken_of():
    y = voyage("straight")
    kept = (y.stamps < 10) | (y.stamps > 12)
    (said,) = master_checks.check(from_arrays(y.stamps[kept], *y.place[kept].T, y.velocity[kept]))
    assert said.startswith("master has 1 gap: ")
    assert "the slave navigates on its own there" in said
