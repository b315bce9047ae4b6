"""The certificate: what it is made from, what stands in it, and with which numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from certificates import facts, made, sections, table, words

from sagnac.calibrate import calibrate
from sagnac.calibration import UnitName, Value
from sagnac.errors import InputError
from sagnac.recording import open_recording
from sagnac.report import html
from sagnac.report.certificate import Details, Limits, certificate, gather, hints
from sagnac.report.certificate.evidence import of
from sagnac.report.certificate.methods import method_of
from sagnac.report.document import Grid, Picture, Text
from sagnac.report.shown import MINUS, Scale, moment, percent, scale_of
from sagnac.verification import Check

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
    name = "accel.bias.x"  # the same in both frames; misalignments and scales are turned into one frame before
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
