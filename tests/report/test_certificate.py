"""The certificate: what it states, what it refuses to invent, and how it judges."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sagnac.calibrate import calibrate
from sagnac.calibration import Calibration, Fit, Influence, Site, Software, UnitName, Value
from sagnac.errors import InputError
from sagnac.recording import open_recording
from sagnac.report import html, pictures
from sagnac.report.certificate import Details, Limits, certificate, concerns, gather, hints, load_details, load_limits
from sagnac.report.certificate.coverage import cover
from sagnac.report.certificate.evidence import of
from sagnac.report.certificate.limits import Limit, assign, decide, outcome
from sagnac.report.certificate.methods import method_of
from sagnac.report.document import Facts, Grid, Picture, Text, Verdict
from sagnac.report.shown import MINUS, Scale, moment, percent, scale_of
from sagnac.results import covariance_rows
from sagnac.verification import Check

MG = 9.80665e-3
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"></svg>'


def made(values=((1.0 * MG, 0.1 * MG),), *, names=None, used="white", dof=10, segments=0, **more):
    """A calibration of accelerometer biases, uncorrelated."""
    names = names or [f"accel.bias.{'xyz'[i]}" for i in range(len(values))]
    sigma = np.array([s for _, s in values])
    influence = tuple(
        Influence(segment=f"s{i}", leverage=0.1, chi2=1.0, shift=0.5, parameter=names[0]) for i in range(segments)
    )
    fit = Fit(
        chi2=9.0,
        degrees_of_freedom=dof,
        residual_rms=1.0,
        converged=True,
        iterations=2,
        uncertainty=used,
        p_value=0.5,
        white=tuple(float(s) for s in sigma),
        influence=influence,
    )
    given = {
        "method": "norm",
        "unit": UnitName(model="unit", serial="7"),
        "fit": fit,
        "site": Site(gravity=9.81, gravity_source="given"),
        "software": Software(version="1.2.3"),
        "created": "2026-11-22T09:27:53+00:00",
        **more,
    }
    parameters = tuple(
        Value(name=n, value=v, unit="m/s^2", standard_uncertainty=s) for n, (v, s) in zip(names, values, strict=True)
    )
    return Calibration(parameters=parameters, covariance=covariance_rows(np.diag(sigma**2)), **given)


@pytest.fixture
def undrawn(monkeypatch):
    """No pictures, where a test is about words: drawing takes a second."""
    monkeypatch.setattr(pictures, "svg", lambda _: SVG)
    for name in ("parameters", "correlation", "budget", "residuals", "influence", "log", "before_after", "as_found"):
        monkeypatch.setattr(pictures, name, lambda *_, **__: None)
    monkeypatch.setattr(pictures, "comparison", lambda *_, **__: None)


def sections(document):
    return {s.title: s for s in document.sections}


def facts(section):
    return {a: b for block in section.blocks if isinstance(block, Facts) for a, b in block.rows}


def table(section, caption):
    grid = next(b for b in section.blocks if isinstance(b, Grid) and caption in b.caption)
    return [dict(zip(grid.header, row, strict=True)) for row in grid.rows]


def words(section):
    return " ".join(b.text for b in section.blocks if isinstance(b, Text | Verdict))


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


# -------------------------------------------------------------------------------------------------------- evidence


@pytest.fixture(scope="module")
def lab(rig, rig_again, tmp_path_factory):
    """A calibration by norm with its recording and plan beside it, and one by multi-position; one of another recording."""
    folder = tmp_path_factory.mktemp("lab")
    for file in (rig.recording, rig.plan_file, rig_again.recording, rig_again.plan_file):
        (folder / file.name).write_bytes(file.read_bytes())
    other = open_recording(folder / "again.parquet", scale=rig.plan.unit.scale)
    calibrate("norm", other, rig.plan).with_source(folder / "again.toml", "plan").save(folder / "again.json")
    recording = open_recording(folder / "recording.parquet", scale=rig.plan.unit.scale)
    for method in ("norm", "multi-position"):
        calibrate(method, recording, rig.plan).with_source(folder / "plan.toml", "plan").save(folder / f"{method}.json")
    return folder


@pytest.fixture(scope="module")
def full(lab):
    """All that a certificate can hold."""
    evidence = gather(
        lab / "norm.json",
        check=lab / "again.parquet",
        check_plan=lab / "again.toml",
        earlier=lab / "again.json",
        as_found=lab / "multi-position.json",
    )
    return certificate(evidence, Details(number="C-9"), Limits({"accel.bias.*": "10 mg"}))


def test_files_beside_the_calibration_are_found_by_their_hash(lab):
    evidence = gather(lab / "norm.json")
    assert evidence.recording is not None
    assert evidence.plan is not None
    assert evidence.absent == {}
    assert len(evidence.fit_checks) == 12 + 12 + 24  # norms at rest, norms of rate, two components of each axis


def test_a_changed_file_is_not_found_and_not_taken(lab, tmp_path):
    for name in ("norm.json", "plan.toml"):
        (tmp_path / name).write_bytes((lab / name).read_bytes())
    (tmp_path / "recording.parquet").write_bytes(b"other")
    text = (tmp_path / "norm.json").read_text().replace(str(lab), "/no/such/folder")
    (tmp_path / "norm.json").write_text(text)
    evidence = gather(tmp_path / "norm.json")
    assert evidence.recording is None
    assert evidence.plan is not None
    assert "was not found with the SHA-256" in evidence.absent["recording"]
    (hint,) = hints(evidence)
    assert "give it with --recording" in hint
    with pytest.raises(InputError, match="not the recording that the calibration was made from"):
        gather(tmp_path / "norm.json", recording=tmp_path / "recording.parquet")
    (tmp_path / "plan.toml").write_text("latitude = '45 deg'")
    with pytest.raises(InputError, match="not the plan"):
        gather(tmp_path / "norm.json", plan=tmp_path / "plan.toml")


@pytest.mark.usefixtures("undrawn")
def test_a_plan_without_a_hash_is_taken_and_said(lab, tmp_path, rig):
    recording = open_recording(lab / "recording.parquet", scale=rig.plan.unit.scale)
    calibrate("norm", recording, rig.plan).save(tmp_path / "cal.json")
    evidence = gather(tmp_path / "cal.json", plan=lab / "plan.toml")
    assert any(role == "plan, as given" for role, _, _ in evidence.files)
    assert "could not be compared" in words(sections(certificate(evidence))["Software and data"])


def test_files_that_cannot_be_are_refused(lab, tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        gather(lab / "norm.json", recording=tmp_path / "none.csv")
    with pytest.raises(InputError, match="cannot read the earlier calibration"):
        gather(lab / "norm.json", earlier=tmp_path / "none.json")
    with pytest.raises(InputError, match="--check"):
        gather(lab / "norm.json", check_plan=lab / "plan.toml")
    with pytest.raises(InputError, match="cannot read the calibration"):
        gather(tmp_path / "none.json")
    (tmp_path / "x.json").write_text("{}")
    with pytest.raises(InputError, match="schema"):
        gather(tmp_path / "x.json")


def test_the_recording_that_the_fit_has_seen_verifies_nothing(lab):
    with pytest.raises(InputError, match="is the recording that the calibration was made from"):
        gather(lab / "norm.json", check=lab / "recording.parquet", check_plan=lab / "plan.toml")


def test_a_calibration_that_had_a_plan_is_verified_with_one(lab):
    with pytest.raises(InputError, match=r"give the plan of that recording too \(--check-plan\)"):
        gather(lab / "norm.json", check=lab / "again.parquet")


@pytest.mark.usefixtures("undrawn")
def test_where_the_fits_own_recording_is_not_known_unseen_is_not_claimed(lab, tmp_path):
    from sagnac import load_calibration

    known = load_calibration(lab / "norm.json")
    known.model_copy(update={"source": ()}).save(tmp_path / "cal.json")
    for file, claimed in ((lab / "norm.json", True), (tmp_path / "cal.json", False)):
        said = words(
            sections(certificate(gather(file, check=lab / "again.parquet", check_plan=lab / "again.toml")))[
                "Verification"
            ]
        )
        assert ("which the fit has not seen" in said) is claimed
        assert ("could not be checked" in said) is not claimed


def test_a_calibration_is_not_compared_with_itself(lab, tmp_path):
    from sagnac import load_calibration

    with pytest.raises(InputError, match="given twice"):
        gather(lab / "norm.json", earlier=lab / "norm.json")
    with pytest.raises(InputError, match="given twice"):
        gather(lab / "norm.json", earlier=lab / "again.json", as_found=lab / "again.json")
    again = load_calibration(lab / "norm.json").model_copy(update={"created": "2020-01-01T00:00:00+00:00"})
    again.save(tmp_path / "again.json")
    with pytest.raises(InputError, match="the same result"):
        gather(lab / "norm.json", earlier=tmp_path / "again.json")


@pytest.mark.usefixtures("undrawn")
def test_as_found_is_said_only_of_what_was_found(tmp_path):
    names = {"unit": UnitName(model="unit", serial="7")}
    made(((1.0, 0.1),), created="2025-03-04T05:06:07+00:00", **names).save(tmp_path / "old.json")
    made(((2.0, 0.1),), **names).save(tmp_path / "new.json")
    later = certificate(gather(tmp_path / "new.json", earlier=tmp_path / "old.json"))
    section = sections(later)["Change since the calibration of 2025-03-04"]
    assert set(table(section, "Change since")[0]) >= {"before", "now"}
    assert "as found" not in words(section).lower()
    adjusted = sections(certificate(gather(tmp_path / "new.json", as_found=tmp_path / "old.json")))
    assert set(table(adjusted["As found, as left"], "As found")[0]) >= {"as found", "as left"}
    assert "not known" not in words(section)
    made(((2.5, 0.1),), unit=UnitName()).save(tmp_path / "unnamed.json")
    doubtful = certificate(gather(tmp_path / "new.json", earlier=tmp_path / "unnamed.json"))
    assert "That both are of the same unit is not known" in words(
        sections(doubtful)["Change since the calibration of 2026-11-22"]
    )


def test_as_found_must_be_of_the_same_unit(lab, tmp_path):
    other = made(unit=UnitName(serial="another"))
    other.save(tmp_path / "other.json")
    with pytest.raises(InputError, match="another"):
        gather(lab / "norm.json", earlier=tmp_path / "other.json")
    made(names=["gyro.k"], unit=UnitName()).save(tmp_path / "none.json")
    with pytest.raises(InputError, match="no parameter in common"):
        gather(lab / "norm.json", earlier=tmp_path / "none.json")


# -------------------------------------------------------------------------------------------------------- contents


def test_the_sections_stand_in_the_order_in_which_they_are_looked_for(full):
    day = full.created[:10]
    assert [s.title for s in full.sections] == [
        "Identification",
        "Summary",
        "Rig and plan",
        "Site, gravity and environment",
        "Method",
        "Results",
        "Correlation",
        "Conformity with limits",
        "Uncertainty budget",
        "Residuals",
        "Verification",
        "As found, as left",
        f"Change since the calibration of {day}",
        "Remarks of the calibration",
        "Traceability",
        "Statements",
        "Software and data",
        "Appendix: correlation matrix",
    ]


def test_every_picture_is_there(full):
    count = {s.title: sum(isinstance(b, Picture) for b in s.blocks) for s in full.sections}
    assert {title for title, n in count.items() if n} == {
        "Rig and plan",
        "Results",
        "Correlation",
        "Uncertainty budget",
        "Residuals",
        "Verification",
        "As found, as left",
        f"Change since the calibration of {full.created[:10]}",
    }
    assert not [b for s in full.sections for b in s.blocks if isinstance(b, Text) and b.style == "missing"]


def test_values_and_expanded_uncertainties_are_those_of_the_calibration(full, lab):
    from sagnac import load_calibration, units

    calibration = load_calibration(lab / "norm.json")
    rows = {r["parameter"]: r for r in table(sections(full)["Results"], "Values")}
    assert list(rows) == list(calibration.values())
    for p in calibration.parameters:
        row = rows[p.name]
        unit = {"µg": "ug", "1": ""}.get(row["unit"], row["unit"])
        size = units.convert(1.0, p.unit, unit)
        value, expanded, u = (float(row[k].replace(MINUS, "-")) for k in ("value", "U", "u"))
        step = 10.0 ** -len(row["U"].partition(".")[2])
        assert value == pytest.approx(p.value * size, abs=0.51 * step)
        assert expanded == pytest.approx(2 * p.standard_uncertainty * size, abs=0.51 * step)
        assert u == pytest.approx(p.standard_uncertainty * size, abs=0.051 * step)


def test_the_difference_as_found_is_told_in_joint_expanded_uncertainties(full, lab):
    from sagnac import load_calibration

    new, old = load_calibration(lab / "norm.json"), load_calibration(lab / "multi-position.json")
    rows = {r["parameter"]: r for r in table(sections(full)["As found, as left"], "As found")}
    name = "accel.scale_error.x"
    joint = 2 * math.hypot(new[name].standard_uncertainty, old[name].standard_uncertainty)
    expected = (new[name].value - old[name].value) / joint
    assert float(rows[name]["Eₙ"].replace(MINUS, "-")) == pytest.approx(expected, abs=0.0051)


def test_what_a_standard_asks_for_is_stated(full):
    said = html.render(full)
    for sentence in (
        "The results relate only to the item calibrated",
        "shall not be reproduced except in full",
        "coverage factor k = 2",
        "coverage probability of approximately 95.45 %",
        "JCGM 100:2008",
        "Decision rule.",
        "Metrological traceability: not stated",
        "No recommendation on the interval of calibration",
    ):
        assert sentence in said


def test_hashes_and_the_data_are_in_it(full, lab):
    import hashlib

    data = (lab / "norm.json").read_bytes()
    assert full.attachments[0].data == data
    section = sections(full)["Software and data"]
    assert facts(section)["SHA-256 of it"] == hashlib.sha256(data).hexdigest()
    assert {r["made from"] for r in table(section, "made from")} == {"recording", "plan"}
    assert hashlib.sha256(data).hexdigest()[:16] in full.foot


def test_the_appendix_gives_the_covariance_back(full, lab):
    from sagnac import load_calibration

    calibration = load_calibration(lab / "norm.json")
    grids = [b for b in sections(full)["Appendix: correlation matrix"].blocks if isinstance(b, Grid)]
    told = {}
    for grid in grids[:-1]:
        for row in grid.rows:
            for column, cell in zip(grid.header[2:], row[2:], strict=True):
                if cell:
                    told[int(row[0]), int(column)] = float(cell.replace(MINUS, "-")) / 100
    sigma = np.sqrt(np.diag(calibration.matrix))
    n = len(sigma)
    assert len(told) == n * (n + 1) // 2
    for (i, j), r in told.items():
        assert r == pytest.approx(calibration.matrix[i - 1, j - 1] / (sigma[i - 1] * sigma[j - 1]), abs=0.0051)


def test_the_whole_page_is_small(full):
    assert len(html.render(full).encode()) < 1_000_000


def test_the_same_calibration_gives_the_same_page():
    evidence = of(made(((1.0, 0.1), (2.0, 0.1)), segments=3))
    assert html.render(certificate(evidence)) == html.render(certificate(evidence))


@pytest.mark.usefixtures("undrawn")
def test_a_calibration_alone_says_which_file_would_give_what_is_missing():
    document = certificate(of(made(segments=4)))
    missing = [b.text for s in document.sections for b in s.blocks if isinstance(b, Text) and b.style == "missing"]
    assert any("the recording of the calibration was not given" in text for text in missing)
    assert any("no recording that the fit has not seen was given" in text for text in missing)
    assert any("the plan of the calibration was not given" in text for text in missing)


@pytest.mark.usefixtures("undrawn")
def test_a_fit_that_noise_does_not_explain_is_said_in_the_summary():
    calibration = made(used="delete-one-segment", segments=30, dof=200)
    poor = calibration.model_copy(update={"fit": calibration.fit.model_copy(update={"p_value": 1e-12})})
    assert "does not explain the scatter" in words(sections(certificate(of(poor)))["Summary"])
    assert "does not explain" not in words(sections(certificate(of(calibration)))["Summary"])


@pytest.mark.parametrize(
    "method",
    ["four-position", "multi-position", "norm", "table", "centrifuge", "centrifuge closed form", "roll-isolated"],
)
def test_every_method_is_told_with_its_equations_and_sources(method):
    told = method_of(made(method=method))
    assert len(told.parts) >= 2
    assert told.sources
    assert all(equations.strip() for _, equations in told.parts)


@pytest.mark.usefixtures("undrawn")
def test_a_method_from_the_future_is_named_only():
    told = method_of(made(method="by magic"))
    assert (told.title, told.parts) == ("by magic", ())
    assert "no description" in words(sections(certificate(of(made(method="by magic"))))["Method"])


@pytest.mark.usefixtures("undrawn")
def test_a_unit_turned_by_hand_has_its_own_words():
    by_hand = made(remarks=("38 static intervals found in 512 s",))
    assert method_of(by_hand).title == "Norm, turned by hand"
    assert "turned by hand" in words(sections(certificate(of(by_hand)))["Rig and plan"])


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("count", "listed"), [(60, 60), (61, 10), (300, 10)])
def test_of_many_residuals_the_worst_are_listed(count, listed):
    checks = tuple(
        Check(f"s{i}", "static norm", 1e-6 * (i % 97) * (-1) ** i, 1e-5 * (1 + i % 3), "m/s^2") for i in range(count)
    )
    evidence = replace(of(made()), fit_checks=checks)
    section = sections(certificate(evidence))["Residuals"]
    rows = table(section, "recording of the calibration")
    assert len(rows) == listed
    assert table(section, "By quantity")[0]["number"] == str(count)
    assert (f"The other {count - listed} are left out" in words(section)) is (listed < count)
    if listed < count:
        worst = sorted(checks, key=lambda c: -abs(c.z))[:10]
        assert [r["segment"] for r in rows] == [c.segment for c in worst]
    assert len({r["unit"] for r in rows}) == 1
    assert len({len(r["residual"].partition(".")[2]) for r in rows}) == 1
    assert not [r for r in rows if r["residual / u"] == f"{MINUS}0.0"]


# --------------------------------------------------------------------------------------------------------- numbers


@pytest.mark.parametrize(
    ("value", "expanded", "text"),
    [(12.3456, 0.12, "12.35"), (-12.3456, 1.2, f"{MINUS}12.3"), (-0.001, 0.12, "0.00"), (1234567.0, 1200.0, "1234567")],
)
def test_a_value_has_the_digits_of_its_uncertainty(value, expanded, text):
    parameter = Value(name="p", value=value, unit="V", standard_uncertainty=expanded / 2)
    assert scale_of(parameter, expanded).text(value) == text


def test_extremes_can_be_shown():
    assert Scale("", 1.0, 2).text(math.inf) == "–"
    assert scale_of(Value(name="p", value=1.0, unit="V", standard_uncertainty=0.0), 0.0).text(1.0) == "1.000000"
    assert (
        scale_of(Value(name="p", value=1e-30, unit="V", standard_uncertainty=1e-31), 2e-31).text(1e-30)
        == f"1e{MINUS}30"
    )
    assert moment("2026-11-22T09:27:53+00:00") == "2026-11-22 09:27:53 UTC"
    assert moment("some day") == "some day"
    assert percent(1.0).replace("\xa0", " ") == "> 99.9 %"
    assert percent(0.0).replace("\xa0", " ") == "< 0.1 %"
