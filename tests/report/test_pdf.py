"""The PDF: the same bytes for the same document, archivable, with its data inside and every text as text."""

from __future__ import annotations

import builtins
import io
import json
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.report import pdf
from sagnac.report.document import (
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
)

pytest.importorskip("typst")
pypdf = pytest.importorskip("pypdf")

HOSTILE = '#panic("x") $x$ @ref *b* _i_ `r` \\ [x] // c /* d */ <lbl> ~ "q" = - +'
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 3"><path d="M0 0L9 3" stroke="#000"/></svg>'
DATA = json.dumps({"name": "µ", "values": [1.5, None]}).encode()


def made(text=HOSTILE, name="cal.json"):
    rows = tuple((f"parameter {i}", text) for i in range(90))
    return Document(
        "Calibration certificate",
        text,
        "C-7",
        "2026-11-22T09:27:53+00:00",
        (
            Section(
                text,
                (
                    Text(text),
                    Text(text, "missing"),
                    Text("ω_e", "maths"),
                    Bullets((text,)),
                    Facts(((text, text),)),
                    Grid((text, "b"), rows, "lr", text),
                    Picture(SVG, text, text),
                    Verdict(True, text),
                    Verdict(False, text),
                    Verdict(None, text),
                    Equation("N_a = S_a u\n" + text),
                ),
            ),
            Section("Part", (Text("end"),), 2),
        ),
        (Attachment(name, "application/json", DATA, text),),
        text,
    )


def read(data):
    return pypdf.PdfReader(io.BytesIO(data))


def letters(text):
    """Text without blanks: lines break anywhere."""
    return re.sub(r"[\s\u200b\xa0]+", "", text)


@pytest.fixture(scope="module")
def made_pdf():
    return pdf.render(made())


def test_the_same_document_gives_the_same_bytes(made_pdf):
    assert pdf.render(made()) == made_pdf


def test_the_attachment_reads_back_equal(made_pdf):
    assert dict(read(made_pdf).attachments) == {"cal.json": [DATA]}


@pytest.mark.parametrize("name", ["../../a b.json", 'x#$@".json', "..", "", "ü" * 200])
def test_any_name_can_be_attached(name):
    kept = list(read(pdf.render(made("x", name))).attachments.values())
    assert kept
    assert all(one == [DATA] for one in kept)


def test_it_says_that_it_is_for_the_archive(made_pdf):
    metadata = read(made_pdf).xmp_metadata
    assert metadata is not None
    raw = metadata.stream.get_data().decode()
    assert re.search(r"pdfaid:part>3<", raw)
    assert re.search(r"pdfaid:conformance>B<", raw)


def test_its_date_is_that_of_the_document(made_pdf):
    info = read(made_pdf).metadata
    assert info.creation_date.isoformat().startswith("2026-11-22")
    assert info.title == "Calibration certificate C-7"


def test_bookmarks_follow_the_sections(made_pdf):
    outline = read(made_pdf).outline
    assert [o["/Title"] for o in outline if not isinstance(o, list)] == [f"1 {HOSTILE}"]
    assert [o["/Title"] for o in outline[1]] == ["1.1 Part"]


def test_pages_are_counted_and_hostile_texts_are_text(made_pdf):
    pages = [letters(p.extract_text()) for p in read(made_pdf).pages]
    assert len(pages) > 1
    assert all(f"page{i + 1}of{len(pages)}" in text for i, text in enumerate(pages))
    assert "".join(pages).count(letters(HOSTILE)) > 90


@pytest.mark.parametrize(
    "text",
    [
        "x" * 2000,
        "שלום עולם (42) مرحبا",
        "中文名字 日本語 한국어 \U0001f600",
        "a\x00\x07\u202e\ud800\U0010ffff\ue000",
        "",
        "a\nb\tc",
        "e\u0301\u0302\u0303" * 50,
    ],
)
def test_any_text_can_be_set(text):
    assert read(pdf.render(made(text))).pages


@settings(max_examples=25)
@given(st.text(max_size=200), st.text(max_size=30))
def test_any_text_whatever_can_be_set(text, name):
    pdf.render(made(text, name))


@pytest.mark.parametrize("created", ["", "some day", "0001-01-01", "2026-02-30", "9999-12-31T00:00:00+00:00"])
def test_a_date_that_is_none_does_not_cost_the_document(created):
    document = made("x")
    changed = Document(document.title, "", "", created, document.sections)
    assert read(pdf.render(changed)).pages


def test_long_words_break_and_short_ones_stay_whole():
    assert pdf._broken("x" * 28) == "x" * 28
    assert pdf._broken("x" * 29).replace("\u200b", "") == "x" * 29
    assert "\u200b" in pdf._broken("x" * 29)
    assert pdf._broken("word " * 40) == "word " * 40


def test_without_typst_it_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name == "typst":
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=re.escape("pip install 'sagnac[pdf]'")):
        pdf.render(made())


def test_a_pdf_is_written_whole(tmp_path, made_pdf):
    pdf.save(made(), tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes() == made_pdf
    assert [p.name for p in tmp_path.iterdir()] == ["a.pdf"]


def test_characters_that_no_font_has_are_known():
    assert pdf.lacking(made("plain, ±, Ω, ש")) == pdf.lacking(made("plain"))
    # Egyptian hieroglyphs, of which neither typst nor matplotlib nor a usual machine has a font
    assert "\U00013080" in pdf.lacking(made("\U00013080 and \U00013080"))
    assert pdf.lacking(made("\U00013080")).count("\U00013080") == 1


def test_pictures_stand_where_they_are_told_and_tables_are_not_torn():
    svg = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 12"><rect width="10" height="12"/></svg>'
    rows = tuple((f"row{i}", "1") for i in range(30))
    document = Document(
        title="T",
        subtitle="",
        number="",
        created="2026-11-22",
        sections=(
            Section("One", (Text("before"), Picture(svg, "drawn.", "a box"), Text("after"))),
            Section("Two", (Grid(("name", "value"), rows, "lr", "whole"), Picture(svg, "next.", "a box"))),
        ),
    )
    pages = [p.extract_text() for p in read(pdf.render(document)).pages]
    text = letters("".join(pages))
    places = [text.index(letters(word)) for word in ("before", "drawn.", "after", "whole", "row29", "next.")]
    assert places == sorted(places)
    assert [("row0" in p, "row29" in p) for p in pages if "row" in p] == [(True, True)]


def test_a_warning_is_set_like_nothing_else():
    document = Document("T", "", "", "2026-11-22", (Section("S", (Text("mind this", "warning"),)),))
    assert "mind this" in read(pdf.render(document)).pages[0].extract_text()
