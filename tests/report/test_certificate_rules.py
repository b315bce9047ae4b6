"""The rules of a certificate: coverage factors, decisions, details."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from certificates import MG, facts, made, sections, table, words

from sagnac.calibration import Value
from sagnac.coverage import cover
from sagnac.errors import InputError
from sagnac.limits import Limit, assign, decide, outcome
from sagnac.report.certificate import Details, Limits, certificate, concerns, load_details, load_limits
from sagnac.report.certificate.evidence import of
from sagnac.report.document import Text, Verdict
from sagnac.report.shown import percent

# ------------------------------------------------------------------------------------------------ coverage factors


def test_white_uncertainties_have_the_factor_that_was_asked_for():
    coverage = cover(made(used="white", dof=3))
    assert coverage.one_factor
    assert coverage.expanded(made().parameters[0]) == pytest.approx(0.2 * MG)
    assert "k = 2" in coverage.statement()
    assert "95.45 %" in coverage.statement()


@pytest.mark.parametrize(("dof", "factor"), [(1, 13.97), (2, 4.53), (5, 2.65), (10, 2.28), (20, 2.13), (50, 2.05)])
def test_few_degrees_of_freedom_have_students_factor(dof, factor):
    # JCGM 100:2008, table G.2, column 95.45 %
    coverage = cover(made(used="scaled", dof=dof))
    assert coverage.factors["accel.bias.x"] == pytest.approx(factor, abs=0.005)
    assert "Student" in coverage.statement()


def test_segments_left_out_bound_the_degrees_of_freedom():
    coverage = cover(made(used="delete-one-segment", dof=90, segments=11))
    assert coverage.dof["accel.bias.x"] == 10
    assert cover(made(used="delete-one-segment", dof=900, segments=400)).one_factor


def test_sensors_with_uncertainties_of_their_own_have_factors_of_their_own():
    names = ["accel.bias.x", "gyro.bias.x", "rig.mount.x"]
    coverage = cover(made(((1, 1), (1, 1), (1, 1)), names=names, used="accelerometers: white / gyros: scaled", dof=5))
    assert math.isinf(coverage.dof["accel.bias.x"])
    assert coverage.dof["gyro.bias.x"] == 5
    assert coverage.dof["rig.mount.x"] == 5  # what belongs to neither gets the more cautious one


def test_no_degrees_of_freedom_no_probability():
    coverage = cover(made(used="scaled", dof=0))
    assert coverage.factors["accel.bias.x"] == 2
    assert "no coverage probability can be stated" in coverage.statement()


@pytest.mark.parametrize("k", [0.0, -2.0, 9.0, math.nan])
def test_a_useless_coverage_factor_is_refused(k):
    with pytest.raises(InputError, match="coverage factor"):
        certificate(of(made()), k=k)


# ------------------------------------------------------------------------------------------------------- decisions


@pytest.mark.parametrize(
    ("value", "guarded", "simple"),
    [
        (0.0, True, True),
        (0.79, True, True),
        (0.81, None, True),
        (1.0, None, True),
        (1.19, None, False),
        (1.21, False, False),
    ],
)
def test_the_guard_band_is_the_expanded_uncertainty(value, guarded, simple):
    # limits of 1 mg, U = 0.2 mg: ILAC-G8:09/2019, figures 3 and 5
    parameter = Value(name="p", value=value * MG, unit="m/s^2", standard_uncertainty=0.1 * MG)
    limit = Limit(-MG, MG)
    assert decide(parameter, limit, 0.2 * MG, math.inf, "guarded acceptance").passed is guarded
    assert decide(parameter, limit, 0.2 * MG, math.inf, "simple acceptance").passed is simple


def test_the_probability_of_conformity_is_that_of_the_guide():
    # JCGM 106:2012, 7.4 with a normal distribution: Phi((1 - 0.8) / 0.1) and, on the limit, one half
    def probability(value, limit=None, dof=math.inf):
        parameter = Value(name="p", value=value, unit="m/s^2", standard_uncertainty=0.1)
        return decide(parameter, limit or Limit(-1.0, 1.0), 0.2, dof, "guarded acceptance").probability

    assert probability(0.8) == pytest.approx(0.97725, abs=1e-5)
    assert probability(1.0) == pytest.approx(0.5, abs=1e-12)
    assert probability(1.2, Limit(-math.inf, 1.0)) == pytest.approx(0.02275, abs=1e-5)
    # the numbers of the example in 7.4: 13.6 with u = 1.8 between 12.5 and 16.3, Phi(1.5) - Phi(-0.6111)
    example = Value(name="p", value=13.6, unit="m/s^2", standard_uncertainty=1.8)
    found = decide(example, Limit(12.5, 16.3), 3.6, math.inf, "guarded acceptance").probability
    assert found == pytest.approx(0.933193 - 0.270563, abs=1e-5)
    # Student's distribution with three degrees of freedom: P(t < 2) = 0.93034
    assert probability(0.8, Limit(-math.inf, 1.0), 3) == pytest.approx(0.93034, abs=1e-5)
    exact = Value(name="p", value=1.0, unit="m/s^2", standard_uncertainty=0.0)
    assert decide(exact, Limit(-1.0, 1.0), 0.0, math.inf, "guarded acceptance").passed is True


def test_guarded_acceptance_keeps_its_promise():
    """Of the units at which a pass is possible no more than 2.3 % that pass lie outside."""
    rng = np.random.default_rng(5)
    truth = rng.uniform(-2.0, 2.0, 100_000)
    seen = truth + 0.1 * rng.standard_normal(truth.size)
    passed = np.abs(seen) <= 1.0 - 0.2
    at_the_edge = passed & (np.abs(seen) > 0.799)
    assert np.mean(np.abs(truth[passed]) > 1.0) < 0.0023
    assert np.mean(np.abs(truth[at_the_edge]) > 1.0) == pytest.approx(0.0228, abs=0.03)


def test_limits_are_read_with_their_units(tmp_path):
    (tmp_path / "limits.toml").write_text(
        'rule = "simple acceptance"\nspecification = "sheet 1"\n[limits]\n"accel.bias.*" = "2 mg"\n'
        '"accel.bias.x" = ["-1 mg", "3 mg"]\n"gyro.bias.x" = { upper = "0.1 deg/h" }\n'
    )
    limits = load_limits(tmp_path / "limits.toml")
    assert (limits.rule, limits.specification) == ("simple acceptance", "sheet 1")
    calibration = made(((0, 1), (0, 1), (0, 1)))
    calibration = calibration.model_copy(
        update={
            "parameters": (
                *calibration.parameters,
                Value(name="gyro.bias.x", value=0, unit="rad/s", standard_uncertainty=1),
            )
        }
    )
    found = assign(limits, calibration)
    assert found["accel.bias.y"] == Limit(-2 * MG, 2 * MG)
    assert found["accel.bias.x"].lower == pytest.approx(-MG)  # the exact name goes before the pattern
    assert found["gyro.bias.x"].upper == pytest.approx(math.radians(0.1) / 3600)
    assert math.isinf(found["gyro.bias.x"].lower)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[limits]\n"gyro.*" = "1 deg/h"', "meets no parameter"),
        ('[limits]\n"accel.*" = "1 mg"\n"*.bias.x" = "1 mg"', "a line of its own"),
        ('[limits]\n"accel.bias.x" = "1 deg/h"', "where m/s^2 is needed"),
        ('[limits]\n"accel.bias.x" = "-1 mg"', "negative"),
        ('[limits]\n"accel.bias.x" = 1.0', "text with its unit"),
        ('[limits]\n"accel.bias.x" = ["1 mg"]', "lower and the upper"),
        ('[limits]\n"accel.bias.x" = ["2 mg", "1 mg"]', "not below"),
        ('[limits]\n"accel.bias.x" = { most = "1 mg" }', "lower, upper or both"),
        ('[limits]\n"accel.bias.x" = {}', "lower, upper or both"),
        ('rule = "generous"\n[limits]\n"accel.bias.x" = "1 mg"', "rule"),
        ('tolerance = 1\n[limits]\n"accel.bias.x" = "1 mg"', "tolerance: no such key"),
        ("[limits]\n", "limits"),
        ("", "limits: is missing"),
        ("[limits", "cannot read the limits"),
    ],
)
def test_limits_that_cannot_be_meant_are_refused(tmp_path, text, message):
    (tmp_path / "limits.toml").write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        assign(load_limits(tmp_path / "limits.toml"), made())


@pytest.mark.usefixtures("undrawn")
def test_one_failure_fails_and_one_doubt_leaves_undecided():
    calibration = made(((0, 0.1 * MG), (1.05 * MG, 0.1 * MG), (2 * MG, 0.1 * MG)))
    verdicts = {}
    for names in (
        ("accel.bias.x",),
        ("accel.bias.x", "accel.bias.y"),
        ("accel.bias.x", "accel.bias.y", "accel.bias.z"),
    ):
        limits = Limits(dict.fromkeys(names, "1 mg"))
        section = sections(certificate(of(calibration), None, limits))["Conformity with limits"]
        verdicts[len(names)] = next(b for b in section.blocks if isinstance(b, Verdict)).passed
    assert verdicts == {1: True, 2: None, 3: False}
    assert [row["decision"] for row in table(section, "Decisions")] == ["pass", "undecided", "fail"]
    assert [row["conforms with"] for row in table(section, "Decisions")][1] == percent(0.30854)  # Phi(-0.5)
    assert "Guarded acceptance" in words(section)
    assert outcome({}) is True


# --------------------------------------------------------------------------------------------------------- details

DETAILS = """
number = "C-1"
issued = 2026-11-24
calibrated = ["2026-11-20", "2026-11-22"]
operator = "A. Person"
traceability = "To the national standard."
[laboratory]
name = "The laboratory"
[item]
received = "2026-11-18"
[environment]
temperature = ["22 degC", "23 degC"]
humidity = "45 %"
pressure = "1013 hPa"
[[standard]]
name = "Table"
certificate = "T 1"
"""


@pytest.mark.usefixtures("undrawn")
def test_details_are_shown_and_the_rest_is_not_stated(tmp_path):
    (tmp_path / "d.toml").write_text(DETAILS)
    document = certificate(of(made()), load_details(tmp_path / "d.toml"))
    shown = facts(sections(document)["Identification"])
    assert shown["Certificate number"] == "C-1"
    assert shown["Calibrated"] == "2026-11-20 to 2026-11-22"
    assert shown["Customer"] == shown["Approved by"] == "not stated"
    assert facts(sections(document)["Site, gravity and environment"])["Ambient temperature"] == "22 °C to 23 °C"
    assert (document.number, document.created) == ("C-1", "2026-11-24")
    assert table(sections(document)["Traceability"], "Standards")[0]["valid until"] == "not stated"


@pytest.mark.usefixtures("undrawn")
def test_nothing_is_invented_without_details():
    document = certificate(of(made()))
    shown = facts(sections(document)["Identification"])
    stated = {k for k, v in shown.items() if v != "not stated"}
    assert stated == {"Item", "Serial number", "Data evaluated"}
    assert "not stated" in words(sections(document)["Traceability"])
    assert document.created == "2026-11-22T09:27:53+00:00"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nummer = '1'", "nummer: no such key"),
        ("[laboratory]\nnam = 'x'", "laboratory.nam: no such key"),
        ("issued = '24.11.2026'", "2026-11-22"),
        ("calibrated = ['2026-11-22', '2026-11-20']", "before"),
        ("[environment]\ntemperature = '20 m'", "temperature"),
        ("[environment]\ntemperature = ['23 degC', '20 degC']", "below"),
        ("[environment]\npressure = '1013'", "no pressure"),
        ("[environment]\nhumidity = 45", "text with its unit"),
        ("[[standard]]\nidentifier = 'x'", "name: is missing"),
        ("issued = 2026-11-20\ncalibrated = 2026-11-22", "issued: 2026-11-20 is before 2026-11-22 (calibrated)"),
        (
            "calibrated = ['2026-11-20', '2026-11-22']\n[item]\nreceived = 2026-11-21",
            "calibrated: 2026-11-20 is before",
        ),
        (
            "issued = 2026-11-20\n[item]\nreceived = 2026-11-21",
            "issued: 2026-11-20 is before 2026-11-21 (item.received)",
        ),
        ("[environment]\nhumidity = '140 %'", "between 0 % and 100 %"),
        ("[environment]\nhumidity = ['-1 %', '40 %']", "between 0 % and 100 %"),
        ("[environment]\npressure = '0 hPa'", "a pressure is positive"),
        ("[environment]\npressure = '-3 kPa'", "a pressure is positive"),
        ("[environment]\ntemperature = '-300 degC'", "no such temperature"),
    ],
)
def test_details_that_cannot_be_meant_are_refused(tmp_path, text, message):
    (tmp_path / "d.toml").write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        load_details(tmp_path / "d.toml")


@pytest.mark.usefixtures("undrawn")
def test_a_standard_that_was_no_longer_valid_is_seen(tmp_path):
    text = """calibrated = ["2026-11-20", "2026-11-22"]
    [[standard]]
    name = "Level"
    valid_until = 2026-11-21
    [[standard]]
    name = "Table"
    valid_until = 2026-11-22
    """
    (tmp_path / "d.toml").write_text(text)
    details = load_details(tmp_path / "d.toml")
    (told,) = concerns(details, made())
    assert told == "the standard 'Level' was valid until 2026-11-21, before the calibration of 2026-11-22"
    shown = sections(certificate(of(made()), details))
    for title in ("Summary", "Traceability"):
        assert [b.style for b in shown[title].blocks if isinstance(b, Text) and "'Level'" in b.text] == ["warning"]
    undated = details.model_copy(update={"calibrated": ""})
    assert len(concerns(undated, made(created="2026-11-23T00:00:00+00:00"))) == 2


def test_the_files_of_the_documentation_can_be_read(tmp_path):
    told = (Path(__file__).parents[2] / "docs" / "certificate.md").read_text(encoding="utf-8")
    limits, details = re.findall(r"```toml\n(.*?)```", told, re.DOTALL)
    (tmp_path / "limits.toml").write_text(limits, encoding="utf-8")
    (tmp_path / "details.toml").write_text(details, encoding="utf-8")
    assert load_limits(tmp_path / "limits.toml").rule == "guarded acceptance"
    known = load_details(tmp_path / "details.toml")
    every = {
        f"{name}." if name in ("laboratory", "customer", "item", "environment", "standard") else name
        for name in Details.model_fields
    }
    assert {n for n in every if re.search(rf"^(\[+{n[:-1]}\]|{n} =)", details, re.MULTILINE)} == every
    assert known.standard[0].name == "Three-axis table"
