"""The page of an alignment: what it says of what was found, and of what was not."""

from __future__ import annotations

import json

import pytest

from sagnac.align.result import Alignment
from sagnac.errors import InputError
from sagnac.report import html
from sagnac.report.alignment_page import page
from sagnac.report.document import Grid, Picture, Text, Verdict

FOUND = {
    "schema": "sagnac/alignment/1",
    "kind": "transfer",
    "method": "wander",
    "matching": "velocity",
    "time": 120.0,
    "parameters": [
        {"name": "gyro.bias.x", "value": 4.84813681e-8, "unit": "rad/s", "standard_uncertainty": 4.84813681e-9},
        {"name": "misalignment.z", "value": None, "unit": "rad", "standard_uncertainty": 2.9088821e-4},
    ],
    "covariance": [[2.350443e-17, 7.0511e-13], [7.0511e-13, 8.46159507e-8]],
    "attitude": [{"name": "heading", "value": 1.0, "unit": "rad", "standard_uncertainty": 2.9088821e-4}],
    "innovations": {
        "updates": 100,
        "rejected": 1,
        "mean": 5.1,
        "expected": 5.0,
        "band": [4.8, 5.2],
        "ratio": {"velocity.x": 1.01},
    },
    "observed": [{"name": "gyro.bias.x", "unit": "rad/s", "initial": 4.8e-8, "final": 4.8e-9}],
    "singular_values": [10.0, 0.5],
    "not_observed": [{"name": "misalignment.z", "remains": 0.9, "reason": "no turn", "shown_by": "a turn"}],
    "skipped": [{"start": 1.0, "stop": 2.0, "reason": "a gap"}],
    "course": [{"after": 1.0, "standard_uncertainty": [1e-8, 1e-3]}],
    "remarks": ["a <note>"],
    "source": [{"file": "/a/b/master.parquet", "role": "master", "sha256": "0" * 64}],
    "software": {"version": "1.0"},
    "created": "2026-11-22T09:27:53+00:00",
}


@pytest.fixture
def made(tmp_path):
    def write(**changed):
        file = tmp_path / "alignment.json"
        table = {**FOUND, **changed}
        table["covariance"] = [
            [p["standard_uncertainty"] ** 2 if i == j else 0.0 for j in range(len(table["parameters"]))]
            for i, p in enumerate(table["parameters"])
        ]
        file.write_text(json.dumps(table))
        return page(file)

    return write


def blocks(document, kind):
    return [b for s in document.sections for b in s.blocks if isinstance(b, kind)]


def test_values_stand_in_the_units_of_the_field(made):
    document = made()
    (grid,) = [g for g in blocks(document, Grid) if g.caption == "Result"]
    rows = {row[0]: row[1:] for row in grid.rows}
    # 4.84813681e-8 rad/s is 0.01 deg/h; two standard uncertainties are 0.002 deg/h
    assert rows["gyro.bias.x"] == ("0.0100", "0.0020", "deg/h", "0.00100")
    assert rows["misalignment.z"] == ("–", "2.0", "arcmin", "1.00")
    assert rows["heading"][2] == "deg"


def test_a_place_that_was_given_is_shown_as_given_and_to_a_centimetre(made):
    place = [
        {"name": "latitude", "value": 0.5977062933960191, "unit": "rad", "standard_uncertainty": 0.0},
        {"name": "height", "value": 380.0, "unit": "m", "standard_uncertainty": 0.0},
    ]
    (grid,) = [g for g in blocks(made(place=place), Grid) if g.caption == "Result"]
    rows = {row[0]: row[1:] for row in grid.rows}
    assert rows["latitude"] == ("34.2460480", "given", "deg", "given")  # 0.5977062933960191 rad
    assert rows["height"] == ("380.00", "given", "m", "given")


def test_the_axes_of_one_quantity_have_the_same_digits(made):
    parameters = [
        {"name": f"gyro.bias.{a}", "value": 1e-7, "unit": "rad/s", "standard_uncertainty": u}
        for a, u in zip("xyz", (1.3e-8, 4.8e-8, 4.8e-9), strict=True)
    ]
    (grid,) = [g for g in blocks(made(parameters=parameters, observed=[], course=[]), Grid) if g.caption == "Result"]
    shown = [row[1:4] for row in grid.rows if row[0].startswith("gyro.bias")]
    assert {len(cell.partition(".")[2]) for row in shown for cell in row[:2]} == {4}
    assert {row[2] for row in shown} == {"deg/h"}


def test_what_was_not_observed_says_what_would_show_it(made):
    (grid,) = [g for g in blocks(made(), Grid) if g.caption == "Not observed"]
    assert grid.rows == (("misalignment.z", "90 %", "no turn", "a turn"),)
    assert "Not observed: misalignment.z." in [t.text for t in blocks(made(), Text)]
    assert "All parameters were observed." in [t.text for t in blocks(made(not_observed=[]), Text)]


@pytest.mark.parametrize(("mean", "passed"), [(5.1, True), (4.8, True), (5.3, False), (1.0, False)])
def test_innovations_are_judged_by_their_band(made, mean, passed):
    (verdict,) = blocks(made(innovations={**FOUND["innovations"], "mean": mean}), Verdict)
    assert verdict.passed is passed


def test_without_its_history_nothing_is_drawn_and_that_is_said(made):
    document = made()
    assert blocks(document, Picture) == []
    assert any("history.parquet" in t.text for t in blocks(document, Text) if t.style == "missing")


def test_a_static_alignment_has_no_history(made):
    document = made(kind="static", innovations=None, observed=[], singular_values=[], not_observed=[], course=[])
    titles = [s.title for s in document.sections]
    assert "Innovations" not in titles
    assert document.title == "Static alignment"
    assert not [t for t in blocks(document, Text) if t.style == "missing"]


def test_the_file_is_attached_and_names_are_texts(made, tmp_path):
    document = made()
    assert document.attachments[0].data == (tmp_path / "alignment.json").read_bytes()
    assert "a &lt;note&gt;" in html.render(document)
    assert document.subtitle == "master.parquet"


def test_what_is_no_alignment_is_refused(tmp_path):
    (tmp_path / "x.json").write_text("{}")
    with pytest.raises(InputError, match="schema"):
        page(tmp_path / "x.json")
    with pytest.raises(InputError, match="cannot read the alignment"):
        page(tmp_path / "none.json")
    assert Alignment.model_validate(FOUND).kind == "transfer"
