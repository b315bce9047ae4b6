"""Limits that a registry keeps: which counts when, and what they make of the calibrations."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from registered import DAY, MG, add, calibration, candidate

from sagnac import limits as rules
from sagnac.calibration import Value
from sagnac.coverage import cover
from sagnac.errors import InputError
from sagnac.limits import Limits
from sagnac.registry import open_registry
from sagnac.registry.bounds import bound_of, read_setting
from sagnac.registry.dates import now

PAST = datetime(2020, 1, 1, tzinfo=UTC)


@pytest.fixture
def registry(where):
    with open_registry(where, write=True) as opened:
        add(opened, candidate())
        yield opened


def keep(registry, table, **how):
    return registry.set_limits(Limits(table), **({"model": "LG-1"} | how))


def counts(registry, name="accel.bias.x", unit="m/s^2", **asked):
    found = bound_of(registry.limits(registry.unit("0001"), **asked), name, unit)
    return None if found is None else (found.lower / MG, found.upper / MG)


@pytest.mark.parametrize(
    ("text", "given"),
    [
        ("accel.bias.x=1 mg", "1 mg"),
        ("accel.bias.x = ±1 mg", "1 mg"),
        ("accel.bias.x=+-1 mg", "1 mg"),
        ("accel.bias.x=-1 mg..2 mg", {"lower": "-1 mg", "upper": "2 mg"}),
        ("accel.bias.x=..2 mg", {"upper": "2 mg"}),
        ("accel.bias.x=-1 mg..", {"lower": "-1 mg"}),
        ("accel.bias.x=none", "none"),
    ],
)
def test_a_limit_as_it_is_written(text, given):
    assert read_setting(text) == ("accel.bias.x", given)


@pytest.mark.parametrize("text", ["accel.bias.x", "=1 mg", "accel.bias.x=", ""])
def test_what_is_no_limit(text):
    with pytest.raises(InputError, match="write parameter=limit"):
        read_setting(text)


@pytest.mark.parametrize(
    ("given", "bounds"),
    [
        ("1 mg", (-1, 1)),
        (["-1 mg", "2 mg"], (-1, 2)),
        ({"upper": "2 mg"}, (-float("inf"), 2)),
        ({"lower": "0 mg"}, (0, float("inf"))),
    ],
)  # fmt: skip
def test_a_limit_is_kept_in_si(registry, given, bounds):
    made, remarks = keep(registry, {"accel.bias.x": given})
    assert (made[0].unit, remarks) == ("m/s^2", [])
    assert counts(registry) == pytest.approx(bounds)
    kept = registry.limits()[0]
    assert (kept.lower, kept.upper, kept.rule) == (made[0].lower, made[0].upper, "guarded acceptance")


def test_a_later_limit_follows_an_earlier_one_from_its_date_on(registry):
    keep(registry, {"accel.bias.x": "1 mg"}, valid_from=PAST)
    keep(registry, {"accel.bias.x": "2 mg"}, valid_from=PAST + timedelta(days=10))
    keep(registry, {"accel.bias.x": "9 mg"}, valid_from=now() + timedelta(days=10))
    assert counts(registry, at=PAST - timedelta(seconds=1)) is None
    assert counts(registry, at=PAST) == pytest.approx((-1, 1))
    assert counts(registry, at=PAST + timedelta(days=9)) == pytest.approx((-1, 1))
    assert counts(registry) == pytest.approx((-2, 2))
    assert [b.upper / MG for b in registry.limits()] == pytest.approx([2])  # the last line, and none that is to come
    assert [b.upper / MG for b in registry.limits(at=PAST)] == pytest.approx([1])  # nothing was removed


def test_the_unit_goes_before_the_model_the_name_before_the_pattern(registry):
    keep(registry, {"accel.bias.x": "1 mg"})
    keep(registry, {"accel.bias.*": "2 mg"})
    assert counts(registry) == pytest.approx((-1, 1))
    assert counts(registry, "accel.bias.y") == pytest.approx((-2, 2))
    keep(registry, {"accel.*.x": "3 mg"}, serial="0001")
    assert counts(registry) == pytest.approx((-3, 3))


def test_a_lifted_limit_leaves_the_next_in_rank_in_force(registry):
    """A line for a unit that is lifted does not take the limit of its model with it."""
    keep(registry, {"accel.bias.x": "1 mg"})
    with pytest.raises(InputError, match="accel.bias.x: nothing to lift, LG-1 0001 has no limit .*give it a wider one"):
        keep(registry, {"accel.bias.x": "none"}, serial="0001")
    keep(registry, {"accel.bias.x": "3 mg"}, serial="0001", valid_from=PAST)
    keep(registry, {"accel.bias.x": "4 mg"}, serial="0001")
    assert counts(registry) == pytest.approx((-4, 4))
    keep(registry, {"accel.bias.x": "none"}, serial="0001")
    assert counts(registry) == pytest.approx((-1, 1))
    keep(registry, {"accel.bias.x": "2 mg"})  # a new one for the model counts for the unit too
    assert counts(registry) == pytest.approx((-2, 2))
    keep(registry, {"accel.bias.*": "9 mg"})
    keep(registry, {"accel.bias.x": "none"})
    assert counts(registry) == pytest.approx((-9, 9))
    assert [(b.serial, b.key) for b in registry.limits()] == [("", "accel.bias.*")]
    keep(registry, {"accel.bias.*": "none"})
    assert (counts(registry), registry.limits()) == (None, [])
    assert counts(registry, at=PAST) == pytest.approx((-3, 3))


def test_a_limit_of_another_unit_of_measurement_does_not_count(registry):
    count = (Value(name="accel.bias.x", value=32000.0, unit="count", standard_uncertainty=1.0),)
    add(registry, candidate(created=DAY.format(2), parameters=count))
    _, remarks = keep(registry, {"accel.bias.x": "33000 count"})
    assert counts(registry) is None
    assert bound_of(registry.limits(), "accel.bias.x", "count").upper == 33000.0
    assert remarks == [
        "accel.bias.x: a limit in count, so of accel.bias.x, and not of accel.bias.x (m/s^2)",
    ]
    assert registry.listing()[0].state.word == "pass"


def test_what_could_not_be_judged_is_undecided_and_named(registry):
    """As a certificate refuses it: a limit in SI says nothing of a bias in counts."""
    parts = (
        Value(name="accel.bias.x", value=1e6, unit="count", standard_uncertainty=1.0),
        Value(name="accel.scale_error.x", value=1e-4, unit="1", standard_uncertainty=1e-6),
    )
    add(registry, candidate("0002", parameters=parts), candidate("0003", parameters=parts[1:]))
    keep(registry, {"accel.bias.*": "1 mg", "accel.scale_error.*": "200 ppm"})

    def told():
        return [tuple(f.state) for f in registry.listing()]

    alone = ("pass", (), ())
    assert told()[1:] == [("undecided", (), ("accel.bias.x",)), alone]
    keep(registry, {"accel.scale_error.*": "1 ppm"})
    assert told()[1] == ("fail", ("accel.scale_error.x",), ("accel.bias.x",))
    keep(registry, {"accel.scale_error.*": "none"})
    keep(registry, {"accel.bias.x": "2000000 count"}, serial="0002")
    assert told()[1:] == [alone, ("", (), ())]


def test_limits_set_before_calibrations_in_counts_judge_nothing_silently(registry):
    keep(registry, {"gyro.bias.*": "1 deg/h"}, model="LG-9")
    raw = (Value(name="gyro.bias.x", value=3.0, unit="count", standard_uncertainty=1.0),)
    add(registry, candidate(model="LG-9", parameters=raw))
    (found,) = registry.listing(model="LG-9")
    assert found.state == ("undecided", (), ("gyro.bias.x",))


def test_a_pattern_over_several_units_says_what_it_meets(registry):
    made, (remark,) = keep(registry, {"accel.*": "1 mg"})
    assert made[0].unit == "m/s^2"
    assert remark == (
        "accel.*: a limit in m/s^2, so of accel.bias.x, accel.bias.y, "
        "and not of accel.misalignment.xy (rad), accel.scale_error.x (1)"
    )
    assert registry.listing()[0].state.unjudged == ()
    add(registry, candidate("0004", parameters=calibration().parameters[2:3]))
    assert tuple(registry.listing()[1].state) == ("", (), ())


@pytest.mark.parametrize(
    ("table", "how", "said"),
    [
        ({"gyro.bias.x": "1 deg/h"}, {}, "limits: gyro.bias.x: meets no parameter of the calibrations; they have accel.bias.x"),
        ({"accel.bias.x": "1 deg/h"}, {}, "deg / h where m/s\\^2 is needed"),
        ({"accel.bias.x": "1"}, {}, "no unit where m/s\\^2 is needed"),
        ({"accel.bias.x": "-1 mg"}, {}, "one bound alone is the largest size"),
        ({"accel.bias.x": ["2 mg", "1 mg"]}, {}, "the lower bound is not below the upper one"),
        ({"accel.bias.*": "1 mg", "*.x": "2 mg"}, {}, "accel.bias.x is met by 'accel.bias.\\*' and '\\*.x'"),
        ({"accel.bias.x": "1 mg"}, {"serial": "0002"}, "no unit of model 'LG-1' with serial number '0002'; did you mean 0001"),
        ({"accel.bias.x": "1 mg"}, {"model": "x" * 201}, "has 201 characters; 200 are kept"),
    ],
)  # fmt: skip
def test_a_limit_that_fits_nothing_is_refused(registry, table, how, said):
    with pytest.raises(InputError, match=said):
        keep(registry, table, **how)
    assert registry.limits() == []


def test_limits_may_come_before_the_first_calibration(registry):
    made, remarks = keep(registry, {"gyro.bias.*": "1 deg/h", "accel.k2.x": "10 ug/g^2"}, model="LG-9")
    assert [b.unit for b in made] == ["rad/s", "s^2/m"]
    assert remarks == ["no calibration of LG-9 is registered yet: names were not checked"]
    with pytest.raises(InputError, match="'3 furlong'"):
        keep(registry, {"gyro.bias.*": "3 furlong"}, model="LG-9")


@pytest.mark.parametrize("used", ["white", "scaled"])
@pytest.mark.parametrize("rule", list(rules.RULES))
@pytest.mark.parametrize("bias", [0.5, 0.97, 0.985, 1.0, 1.015, 1.03, 1.2])
def test_the_list_decides_as_a_certificate_does(tmp_path, used, rule, bias):
    fit = calibration().fit.model_copy(update={"uncertainty": used, "degrees_of_freedom": 4})
    given, table = calibration(bias=bias * MG, fit=fit), {"accel.bias.x": "1 mg", "accel.scale_error.x": "1000 ppm"}
    limits, coverage = Limits(table, rule), cover(given)
    decided = {
        name: rules.decide(given[name], limit, coverage.expanded(given[name]), coverage.dof[name], rule)
        for name, limit in rules.assign(limits, given).items()
    }
    with open_registry(tmp_path / "fleet.db", write=True) as registry:
        (entry,) = add(registry, candidate(bias=bias * MG, fit=fit))
        registry.set_limits(limits, model="LG-1")
        (found,) = registry.listing()
    assert found.state.word == {True: "pass", False: "fail", None: "undecided"}[rules.outcome(decided)]
    assert found.state.beyond == tuple(name for name, d in decided.items() if d.passed is False)
    assert found.latest == entry


def test_units_with_limits_of_their_own_among_others(registry):
    add(registry, candidate("0002"), candidate("0003"), candidate("0001", model="LG-2"))
    keep(registry, {"accel.bias.x": "1 mg"})
    keep(registry, {"accel.bias.x": "0.1 mg"}, serial="0002")
    assert [(f.unit.serial, f.state.word, f.state.beyond) for f in registry.listing()] == [
        ("0001", "pass", ()),
        ("0002", "fail", ("accel.bias.x",)),
        ("0003", "pass", ()),
        ("0001", "", ()),
    ]
