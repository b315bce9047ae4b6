"""What is registered comes back: on SQLite and on PostgreSQL."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from registered import DAY, add, calibration, candidate, content
from sqlalchemy import exc, text

from sagnac.calibration import Value, loads
from sagnac.errors import DataError, InputError
from sagnac.registry import Parameter, open_registry
from sagnac.registry.candidates import Lacking, of_content
from sagnac.registry.dates import parse
from sagnac.registry.queries import values_of
from sagnac.registry.tables import metadata
from sagnac.results import Source


@pytest.fixture
def registry(where):
    with open_registry(where, write=True) as opened:
        yield opened


def at(day: int, hour: int = 12) -> datetime:
    return datetime(2025, 3, day, hour, tzinfo=UTC)


# ------------------------------------------------------------------------------------------------------- documents


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c,
        lambda c: b"\xef\xbb\xbf" + c,
        lambda c: c.replace(b"\n", b"\r\n"),
        lambda c: json.dumps(json.loads(c)).encode(),
        lambda c: c.replace(b'"remarks": []', b'"remarks": ["a\\u0000b \\ud83d\\ude00 \xe2\x88\x9a"]'),
    ],
)
def test_a_file_comes_back_byte_for_byte(registry, change):
    file = change(content())
    (entry,) = add(registry, of_content(file, "cal.json"))
    assert registry.content(entry) == file
    assert registry.calibration(entry) == loads(file.decode("utf-8-sig"))
    assert (entry.unit.model, entry.unit.serial, entry.method) == ("LG-1", "0001", "norm")
    assert (entry.created, entry.software) == (at(1), "sagnac 1.2.3")


def test_numbers_come_back_exactly(registry):
    odd = (0.1, 0.0, -5e-324, 1.7976931348623157e308, -1 / 3, 2**53 + 1.0)
    given = tuple(Value(name=f"p{i}", value=v, unit="1", standard_uncertainty=1e-3) for i, v in enumerate(odd))
    (entry,) = add(registry, candidate(parameters=given))
    found = registry.history(entry.unit)
    assert found.value.tolist() == list(odd)


def test_the_same_file_is_not_registered_twice(registry):
    one, two = candidate(), candidate(created=DAY.format(2))
    first = list(registry.add([one, two, one]))
    again = list(registry.add([two, one]))
    assert [a.new for a in first] == [True, True, False]
    assert [a.new for a in again] == [False, False]
    assert [a.entry.id for a in again] == [first[1].entry.id, first[0].entry.id]
    assert registry.listing()[0].count == 2


def test_the_same_file_is_not_that_of_another_unit(registry):
    nameless = calibration(serial="").to_json().encode()
    mine, other = (of_content(nameless, "cal.json", Lacking(serial=s)) for s in ("7", "8"))
    told = list(registry.add([mine, other]))
    assert [bool(a.refused) for a in told] == [False, True]
    assert "is registered as a calibration of LG-1 7 already, not of LG-1 8" in told[1].refused
    assert "LG-1 7 already" in next(registry.add([other])).refused
    assert [f.unit.serial for f in registry.listing()] == ["7"]


def test_the_same_calibration_in_other_bytes_is_not_registered_twice(registry):
    file = content()
    windows, spaced = file.replace(b"\n", b"\r\n"), json.dumps(json.loads(file)).encode()
    other = candidate(bias=0.006)  # of the same moment, but another result
    first = list(registry.add([of_content(file, "a.json"), of_content(windows, "b.json"), other]))
    again = list(registry.add([of_content(windows, "b.json"), of_content(spaced, "c.json")]))
    assert [(a.new, a.same, a.entry.id) for a in first] == [(True, True, 1), (False, False, 1), (True, True, 2)]
    assert [(a.new, a.same, a.entry.id, a.refused) for a in again] == [(False, False, 1, "")] * 2
    assert registry.listing()[0].count == 2


def test_the_date_of_the_test_goes_before_that_of_the_computation_and_both_are_kept(registry):
    given = Lacking(created="2019-01-01")
    (entry,) = add(registry, candidate(lacking=given))
    assert (entry.created, entry.stated) == (datetime(2019, 1, 1, tzinfo=UTC), at(1))
    assert registry.find(datetime(2019, 6, 1, tzinfo=UTC)) == [entry]
    assert set(registry.history().time.astype("datetime64[D]").astype(str)) == {"2019-01-01"}
    plain, same, another = registry.add(
        [candidate(), candidate(lacking=given), candidate(lacking=Lacking(created="2020-01-01"))]
    )
    assert (plain.refused, same.refused) == ("", "")
    assert "registered with the date 2019-01-01 00:00:00+00:00 already, not 2020-01-01" in another.refused


def test_the_recordings_of_a_calibration_are_known(registry):
    files = (
        Source(file="b.log", sha256="b" * 64),
        Source(file="a.log", sha256="a" * 64),
        Source(file="p.toml", role="plan", sha256="c" * 64),
    )
    first, last = add(registry, candidate(source=files), candidate(created=DAY.format(2)))
    assert (first.recordings, last.recordings) == (("a" * 64, "b" * 64), ())
    runs = [Source(file="a.h5", sha256="a" * 64, select=name) for name in ("run 1", "run 2")]
    one, two = add(registry, *(candidate(created=DAY.format(d), source=(s,)) for d, s in enumerate(runs, 3)))
    assert one.recordings != two.recordings


def test_a_document_that_was_tampered_with_is_not_handed_out(tmp_path):
    with open_registry(tmp_path / "fleet.db", write=True) as registry:
        (entry,) = add(registry, candidate())
        with registry._database.writing() as connection:
            connection.execute(text("DROP TRIGGER documents_no_update"))
            connection.execute(text("UPDATE documents SET content = CAST('{}' AS BLOB)"))
        with pytest.raises(
            InputError, match="registry is damaged: the file of calibration id:1 does not have its SHA-256"
        ):
            registry.calibration(entry)


# ---------------------------------------------------------------------------------------------------- only growing


@pytest.mark.parametrize("table", list(metadata.tables))
def test_nothing_is_changed_or_removed(registry, table):
    add(registry, candidate())
    from sagnac.limits import Limits

    registry.set_limits(Limits({"accel.bias.*": "1 mg"}), model="LG-1")
    own = metadata.tables[table]
    column = next(iter(own.primary_key.columns)).name
    wrong = [f'UPDATE "{table}" SET "{column}" = 77', f'DELETE FROM "{table}"']
    if registry._database.dialect == "postgresql":
        wrong += [f'TRUNCATE "{table}" CASCADE']
    else:
        wrong += [f'INSERT OR REPLACE INTO "{table}" SELECT * FROM "{table}"']
    before = _rows(registry, table)
    assert before
    for statement in wrong:
        with registry._database._engine.connect() as connection, pytest.raises(exc.DBAPIError, match="append-only"):
            connection.execute(text(statement))
    assert _rows(registry, table) == before


def _rows(registry, table):
    with registry._database.reading() as connection:
        return [tuple(row) for row in connection.execute(text(f'SELECT * FROM "{table}"'))]


def test_a_value_belongs_to_a_calibration_that_there_is(registry):
    add(registry, candidate())
    with pytest.raises(InputError, match="(?i)foreign key"), registry._database.writing() as connection:
        connection.execute(text('INSERT INTO "values" VALUES (99, 1, 0.0, 0.0, NULL)'))


# ----------------------------------------------------------------------------------------------------------- lists


@pytest.fixture
def fleet(registry):
    """Three units of two models."""
    for day in (3, 1, 9):
        add(registry, candidate("A", DAY.format(day)))
    add(registry, candidate("B", DAY.format(5), method="table"), candidate("B", DAY.format(2)))
    add(registry, candidate("A", DAY.format(4), "LG-2"))
    return registry


def test_the_list_counts_and_tells_the_latest(fleet):
    assert [(f.unit.model, f.unit.serial, f.count, f.latest.created.day, f.state.word) for f in fleet.listing()] == [
        ("LG-1", "A", 3, 9, ""),
        ("LG-1", "B", 2, 5, ""),
        ("LG-2", "A", 1, 4, ""),
    ]


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ({"model": "LG-2"}, [("A", 1)]),
        ({"serial": "A"}, [("A", 3), ("A", 1)]),
        ({"serial": "A", "model": "LG-1"}, [("A", 3)]),
        ({"since": at(4)}, [("A", 1), ("B", 1), ("A", 1)]),
        ({"since": at(4, 13)}, [("A", 1), ("B", 1)]),
        ({"method": "table"}, [("B", 1)]),
        ({"at_most": 2}, [("A", 3), ("B", 2)]),
        ({"model": "none"}, []),
    ],
)
def test_the_list_can_be_narrowed(fleet, asked, found):
    assert [(f.unit.serial, f.count) for f in fleet.listing(**asked)] == found


def test_calibrations_of_a_unit_by_date(fleet):
    assert [e.created.day for e in fleet.entries(fleet.unit("A", "LG-1"))] == [1, 3, 9]


def test_find_tells_what_was_in_force(fleet):
    def days(moment):
        return [(e.unit.model, e.unit.serial, e.created.day) for e in fleet.find(moment)]

    assert days(at(1) - timedelta(microseconds=1)) == []
    assert days(at(1)) == [("LG-1", "A", 1)]
    assert days(at(4, 11)) == [("LG-1", "A", 3), ("LG-1", "B", 2)]
    assert days(parse("2025-03-04", end=True)) == [("LG-1", "A", 3), ("LG-1", "B", 2), ("LG-2", "A", 4)]
    assert [e.created.day for e in fleet.find(at(30), serial="B")] == [5]


def test_of_two_made_at_one_moment_the_one_registered_last_is_in_force(registry):
    first, last = add(registry, candidate(bias=1.0), candidate(bias=2.0))
    assert first.created == last.created
    assert registry.find(at(30)) == [last]
    assert registry.resolve("0001") == last
    assert registry.listing()[0].latest == last


# ------------------------------------------------------------------------------------------------------ references


def test_a_calibration_is_meant_by_serial_date_number_or_hash(fleet):
    latest = fleet.resolve("B")
    assert latest.created == at(5)
    assert fleet.resolve("B@2025-03-04").created == at(2)
    assert fleet.resolve("B@2025-03-05") == latest
    assert fleet.resolve(f"id:{latest.id}") == latest
    assert fleet.resolve(latest.sha256[:8]) == fleet.resolve(f"sha256:{latest.sha256}") == latest
    assert fleet.resolve("A", "LG-2").created == at(4)


@pytest.mark.parametrize(
    ("reference", "kind", "said"),
    [
        ("A", InputError, "serial number of units of several models, LG-1, LG-2"),
        ("AB", InputError, "no unit has the serial number 'AB'.*did you mean (A or B|B or A)"),
        ("id:99", InputError, "no calibration has the number '99'"),
        ("id:x", InputError, "no calibration has the number 'x'"),
        ("id:99999999999999999999", InputError, "no calibration has the number"),
        ("00000000", InputError, "no calibration's hash begins so"),
        ("B@yesterday", InputError, "'yesterday' is no date; write 2026-11-22"),
        ("B@2025-03-01", DataError, "LG-1 B had no calibration yet at 2025-03-01T23:59:59"),
        ("", InputError, "no unit has the serial number ''"),
    ],
)
def test_what_means_no_calibration(fleet, reference, kind, said):
    with pytest.raises(kind, match=said):
        fleet.resolve(reference)


def test_a_serial_number_with_an_at_sign_is_itself(registry):
    (entry,) = add(registry, candidate("C@2025-03-01"))
    assert registry.resolve("C@2025-03-01") == entry
    assert registry.resolve("C@2025-03-01@2025-03-01") == entry


# --------------------------------------------------------------------------------------------------------- history


def test_the_history_is_what_the_files_say(fleet):
    found = fleet.history()
    told = [
        (found.units[i].serial, found.parameters[p], t, c, v, s)
        for i, p, t, c, v, s in zip(
            found.item,
            found.parameter,
            found.time,
            found.calibration,
            found.value,
            found.standard_uncertainty,
            strict=True,
        )
    ]
    expected = []
    for unit in (f.unit for f in fleet.listing()):
        for entry in fleet.entries(unit):
            own = fleet.calibration(entry)
            expected += [
                (
                    unit.id,
                    Parameter(p.name, p.unit, "element" if "misalignment" in p.name else ""),
                    np.datetime64(entry.created.replace(tzinfo=None), "us"),
                    entry.id,
                    p.value,
                    p.standard_uncertainty,
                )
                for p in own.parameters
            ]
    expected.sort(key=lambda row: (row[0], row[1].name, row[2], row[3]))
    serial = {f.unit.id: f.unit.serial for f in fleet.listing()}
    assert told == [(serial[row[0]], *row[1:]) for row in expected]


def test_a_history_can_be_narrowed(fleet):
    unit = fleet.unit("A", "LG-1")
    found = fleet.history(unit, ["accel.bias.*"], since=at(2), until=at(8))
    assert [found.parameters[p].name for p in found.parameter] == ["accel.bias.x", "accel.bias.y"]
    assert set(found.time.astype("datetime64[D]").astype(str)) == {"2025-03-03"}
    assert set(fleet.history(model="LG-1").units) == {fleet.unit("A", "LG-1").id, fleet.unit("B").id}
    with pytest.raises(InputError, match="no calibration has a parameter 'gyro.bias.x'; there are accel.bias.x, "):
        fleet.history(unit, ["gyro.bias.x"])


def test_an_empty_registry_has_an_empty_history(registry):
    found = registry.history()
    assert (found.value.size, found.parameters, found.units) == (0, (), {})
    assert registry.listing() == registry.find(at(1)) == []


def test_the_same_name_in_another_unit_or_convention_is_another_parameter(registry):
    counts = (Value(name="accel.bias.x", value=32000.0, unit="count", standard_uncertainty=1.0),)
    axes = (Value(name="accel.misalignment.xy", value=1e-4, unit="rad", standard_uncertainty=1e-6),)
    add(registry, candidate(), candidate(created=DAY.format(2), parameters=counts))
    add(registry, candidate(created=DAY.format(3), parameters=axes, misalignment="input-axis"))
    found = registry.history(names=["accel.bias.x", "accel.misalignment.xy"])
    assert found.parameters == (
        Parameter("accel.bias.x", "count"),
        Parameter("accel.bias.x", "m/s^2"),
        Parameter("accel.misalignment.xy", "rad", "element"),
        Parameter("accel.misalignment.xy", "rad", "input-axis"),
    )


def test_degrees_of_freedom_of_few_data_are_kept(registry):
    fit = calibration().fit.model_copy(update={"uncertainty": "scaled", "degrees_of_freedom": 3})
    (entry,) = add(registry, candidate(fit=fit))
    with registry._database.reading() as connection:
        rows = list(values_of(connection, [entry.id], [1, 2, 3, 4]))
    assert [row[-1] for row in rows] == [3.0] * 4


def test_names_go_in_one_order_on_any_server(where):
    names = ["a", "B", "Z-1", "Z1", "_", "ä"]
    with open_registry(where, write=True) as registry:
        add(registry, *(candidate(name, model=name) for name in names))
        assert [f.unit.serial for f in registry.listing()] == sorted(names)
        if (
            registry._database.dialect == "postgresql"
        ):  # whose order is that of the server, where a column does not say it
            asked = """SELECT table_name, column_name FROM information_schema.columns WHERE collation_name IS DISTINCT FROM 'C'
                AND table_schema = current_schema() AND data_type = 'character varying' AND table_name <> 'sagnac_registry'"""
            with registry._database.reading() as connection:
                assert connection.execute(text(asked)).all() == []


def test_a_moment_without_a_zone_is_named_as_such(registry):
    add(registry, candidate())
    with pytest.raises(InputError, match="2025-03-01 00:00:00: has no time zone"):
        registry.find(datetime(2025, 3, 1))  # noqa: DTZ001
    with pytest.raises(TypeError):  # a mistake of the caller's is no damage of the registry
        registry.history(names=5)
