"""Documents before they are rendered: what they refuse, how texts are cleaned, how parts are numbered."""

from __future__ import annotations

import base64
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.report.document import (
    UNKNOWN,
    Attachment,
    Bullets,
    Document,
    Equation,
    Facts,
    Grid,
    Picture,
    Section,
    Text,
    Verdict,
    clean,
    plain,
    runs,
)

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><path d="M0 0L9 9"/></svg>'


def document(*blocks, attachments=(), title="Title"):
    return Document(title, "unit", "C-1", "2026-11-22", (Section("One", blocks),), attachments)


@pytest.mark.parametrize(
    ("header", "rows", "align"),
    [(("a", "b"), (("1",),), "lr"), (("a",), (), "lr"), (("a", "b"), (), "lx"), (("a", "b"), (("1", "2", "3"),), "lr")],
)
def test_a_table_whose_cells_do_not_fit_is_refused(header, rows, align):
    with pytest.raises(ValueError, match="columns"):
        Grid(header, rows, align)


def test_the_word_of_a_verdict_does_not_rest_on_colour():
    assert [Verdict(p, "").word for p in (True, False, None)] == ["PASS", "FAIL", "UNDECIDED"]


@pytest.mark.parametrize(
    ("given_text", "shown"),
    [
        ("plain <b>", "plain <b>"),
        ("a\x00b\x1b", f"a{UNKNOWN}b{UNKNOWN}"),
        ("a\ud800b", f"a{UNKNOWN}b"),
        ("a\u202eb\u2066c", f"a{UNKNOWN}b{UNKNOWN}c"),
        ("two\nlines\tand", "two\nlines\tand"),
        ("שלום µg 中文 é", "שלום µg 中文 é"),
        ("\U0010ffff", UNKNOWN),
    ],
)
def test_characters_that_cannot_be_shown_become_visible(given_text, shown):
    assert clean(given_text) == shown


@given(st.text())
def test_any_text_can_be_shown_and_written(text):
    shown = clean(text)
    assert len(shown) == len(text)
    shown.encode("utf-8")
    assert clean(shown) == shown


def test_equations_part_into_symbols_words_and_indices():
    assert runs("N = ω_e sin L K_{ip}²") == [
        ("N", "symbol"),
        (" = ", "upright"),
        ("ω", "symbol"),
        ("e", "index"),
        (" ", "upright"),
        ("sin", "upright"),
        (" ", "upright"),
        ("L", "symbol"),
        (" ", "upright"),
        ("K", "symbol"),
        ("ip", "index"),
        ("²", "upright"),
    ]
    assert ("a", "symbol") not in runs("a rate of ω_e", italic=False)


@given(st.text(alphabet="abN_{}=ω²₁ ()"))
def test_no_letter_of_an_equation_is_lost(text):
    kept = "".join(piece for piece, _ in runs(text))
    assert kept.replace("_", "").replace("{", "").replace("}", "") == text.replace("_", "").replace("{", "").replace(
        "}", ""
    )


def test_sections_and_pictures_are_numbered():
    picture = Picture(SVG, "caption", "alt")
    made = plain(
        Document(
            "t",
            "s",
            "",
            "2026-11-22",
            (
                Section("a", (picture,)),
                Section("b", ()),
                Section("c", (picture,), 2),
                Section("d", (), 2),
                Section("e", ()),
            ),
        )
    )
    assert [s["number"] for s in made["sections"]] == ["1", "2", "2.1", "2.2", "3"]
    assert [b["number"] for s in made["sections"] for b in s["blocks"]] == [1, 2]


def test_every_block_becomes_plain_data():
    data = json.dumps({"a": 1}).encode()
    made = plain(
        document(
            Text("t"),
            Text("ω_e", "maths"),
            Bullets(("a", "b")),
            Facts((("label", "value"),)),
            Grid(("a", "b"), (("1", "2"),), "lr"),
            Picture(SVG, "c", "a"),
            Verdict(None, "v"),
            Equation("a = b\nc = d"),
            attachments=(Attachment("x.json", "application/json", data, "d"),),
        )
    )
    kinds = [b["kind"] for b in made["sections"][0]["blocks"]]
    assert kinds == ["text", "text", "bullets", "facts", "grid", "picture", "verdict", "equation"]
    assert base64.b64decode(made["attachments"][0]["base64"]) == data
    json.dumps(made)
