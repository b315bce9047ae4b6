"""Trends and comparisons of what a registry holds, in both databases."""

from __future__ import annotations

import subprocess
import sys

import pytest
from registered import MG, add, candidate

from sagnac.calibration import Value
from sagnac.errors import DataError, InputError
from sagnac.limits import Limits
from sagnac.registry import open_registry
from sagnac.registry.analysis import fleet_trend, unit_trend
from sagnac.registry.entries import numbered

MONTH = "2025-{:02d}-01T12:00:00+00:00"
YEAR = 31557600.0


def counts(serial, created, count):
    """A calibration of raw counts: one bias."""
    value = Value(name="accel.bias.x", value=count, unit="count", standard_uncertainty=1.0)
    return candidate(serial, created, parameters=(value,))


@pytest.fixture
def registry(where):
    """Two units that drift by 0.1 and 0.2 mg a month, and one of another model."""
    with open_registry(where, write=True) as opened:
        for serial, rate in (("0001", 0.1), ("0002", 0.2)):
            add(opened, *(candidate(serial, MONTH.format(m), bias=rate * m * MG) for m in range(1, 9)))
        add(opened, *(candidate("0001", MONTH.format(m), "OTHER") for m in range(1, 4)))
        yield opened


def test_the_trend_of_a_unit_is_judged_by_the_limits_in_force_for_it(registry):
    registry.set_limits(Limits({"accel.bias.*": "2 mg"}), model="LG-1")
    registry.set_limits(Limits({"accel.bias.x": "1 mg"}), model="LG-1", serial="0001")
    found = unit_trend(registry, registry.unit("0001", "LG-1"))
    assert [p.limits.upper / MG if p.limits else None for p in found.parameters] == pytest.approx(
        [1.0, 2.0, None, None]
    )
    x = found["accel.bias.x"]
    assert x.drift is not None
    assert x.drift.value * YEAR / 12 / MG == pytest.approx(0.1, rel=0.02)
    assert x.leaving is not None
    assert str(x.leaving.date).startswith(
        ("2025-09", "2025-10")
    )  # 0.8 mg on 1 August, 0.1 mg a month: 1 mg on 1 October
    assert {m.method for m in found.calibrations} == {"norm"}


def test_the_trend_of_a_model_judges_each_unit_by_its_own_limits(registry):
    registry.set_limits(Limits({"accel.bias.x": "2 mg"}), model="LG-1")
    registry.set_limits(Limits({"accel.bias.x": "3 mg"}), model="LG-1", serial="0002")
    found = fleet_trend(registry, "LG-1", ["accel.bias.x"])
    assert [(u.serial, round(u.limits.upper / MG, 9)) for u in found.parameters[0].units if u.limits] == [
        ("0002", 3.0),
        ("0001", 2.0),
    ]
    assert found.units == 2
    every = fleet_trend(registry, None, ["accel.bias.x"])
    assert every.units == 3
    assert [(p.model, len(p.units)) for p in every.parameters] == [("LG-1", 2), ("OTHER", 1)]  # models are not alike


def test_a_limit_in_si_is_none_for_a_history_in_counts(registry):
    for month in range(1, 5):  # in SI at first, so that the limit is taken; now for counts
        add(registry, candidate("0003", MONTH.format(month)))
    registry.set_limits(Limits({"accel.bias.x": "2 mg"}), model="LG-1")
    add(registry, *(counts("0003", MONTH.format(month), 1000.0 + month) for month in range(6, 10)))
    found = unit_trend(registry, registry.unit("0003"), ["accel.bias.x"])["accel.bias.x"]
    assert found.unit == "count"
    assert found.limits is found.leaving is None


def test_a_calibration_can_be_left_out(registry):
    unit = registry.unit("0002")
    numbers = [e.id for e in registry.entries(unit)]
    found = unit_trend(registry, unit, without=numbers[2:4])
    assert [m.id for m in found.calibrations] == [*numbers[:2], *numbers[4:]]
    assert fleet_trend(registry, "LG-1", without=numbers[:1]).calibrations == 15
    other = registry.entries(registry.unit("0001", "LG-1"))[0].id
    with pytest.raises(InputError, match=f"id:{other} is no calibration of LG-1 0002"):
        unit_trend(registry, unit, without=[other])


def test_a_parameter_that_only_other_units_have_is_named(registry):
    add(registry, *(counts("0003", MONTH.format(month), 1000.0 + month) for month in range(6, 10)))
    with pytest.raises(
        DataError, match=r"no calibration of LG-1 0003 has a parameter 'accel.scale\*'; they have accel.bias.x"
    ):
        unit_trend(registry, registry.unit("0003"), ["accel.scale*"])


def test_the_frame_of_a_misalignment_is_known_where_only_it_was_asked_for(registry):
    def made(month, *pairs):
        values = (
            Value(name=f"accel.misalignment.{p}", value=1e-5, unit="rad", standard_uncertainty=1e-6) for p in pairs
        )
        return candidate("0003", MONTH.format(month), parameters=tuple(values))

    add(registry, *(made(m, "xy", "yx") for m in (1, 2, 3)), *(made(m, "yx") for m in (4, 5)))
    found = unit_trend(registry, registry.unit("0003"), ["accel.misalignment.yx"])["accel.misalignment.yx"]
    assert len(found.values) == 2
    assert "left out: 3 in the frame of the mounting faces, which is not comparable" in found.remarks


@pytest.mark.parametrize("command", [["list"], ["find", "--at", "2026-01-01"], ["trend", "0001"]])
def test_reading_loads_no_library_that_only_writing_or_large_fleets_need(command, tmp_path):
    """Each of them takes a quarter of a second to load, half of what a whole command may take."""
    with open_registry(tmp_path / "fleet.db", write=True) as opened:
        add(opened, *(candidate("0001", MONTH.format(m), bias=m * MG) for m in range(1, 5)))
        opened.set_limits(Limits({"accel.bias.x": "5 mg"}), model="LG-1")
    code = (
        "import sys; from sagnac.cli import app\n"
        f"app({['registry', *command, '--registry', str(tmp_path / 'fleet.db')]!r}, standalone_mode=False)\n"
        "print(sorted({'alembic', 'matplotlib', 'numba', 'psycopg', 'scipy'} & set(sys.modules)), file=sys.stderr)"
    )
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert "0001" in told.stdout
    assert told.stderr.strip() == "[]"


@pytest.mark.parametrize(
    ("text", "number"),
    [("id:12", 12), (" 12 ", 12), ("id:", None), ("id:-1", None), ("id:١٢", None), ("1e3", None), ("9" * 19, None)],
)
def test_the_number_of_a_calibration_is_digits_that_a_database_can_hold(text, number):
    assert numbered(text) == number
