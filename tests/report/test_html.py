"""The HTML page: complete, alone, and with every text as text."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser

import pytest

from sagnac.report import html
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

HOSTILE = "<script>alert(1)</script> \"q\" 'a' & --> ]]> #x $y$ @z {{ 7*7 }} </title></style>"
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><path d="M0 0L9 9"/></svg>'
DATA = json.dumps({"name": "</script><!-- <script>", "µ": [1.5, None]}, ensure_ascii=False).encode()


class Reader(HTMLParser):
    """What a browser would see: elements with attributes, text, and the content of scripts."""

    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.elements, self.texts, self.scripts = [], [], []
        self._inside = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._inside.append(tag)

    def handle_endtag(self, tag):
        while self._inside and self._inside.pop() != tag:
            pass

    def handle_data(self, data):
        where = self._inside[-1] if self._inside else ""
        (self.scripts if where == "script" else self.texts).append(data)


def made(text=HOSTILE):
    return Document(
        text,
        text,
        text,
        "2026-11-22",
        (
            Section(
                text,
                (
                    Text(text),
                    Text(text, "note"),
                    Text(text, "missing"),
                    Text(text, "maths"),
                    Bullets((text,)),
                    Facts(((text, text),)),
                    Grid((text, "b"), ((text, text),), "lr", text),
                    Picture(SVG, text, text),
                    Verdict(True, text),
                    Verdict(False, text),
                    Verdict(None, text),
                    Equation(text),
                ),
            ),
            Section("part", (), 2),
        ),
        (Attachment("cal</a>.json", "application/json", DATA, text),),
        text,
    )


@pytest.fixture(scope="module")
def page():
    return html.render(made())


def test_hostile_texts_stay_texts(page):
    seen = Reader(page)
    scripts = [a for tag, a in seen.elements if tag == "script"]
    assert scripts == [{"type": "application/json", "data-name": "cal</a>.json"}]
    assert sum("<script>alert(1)</script>" in t for t in seen.texts) >= 10
    assert not any("49" in t for t in seen.texts)
    assert {"onclick", "onload", "onerror"}.isdisjoint(k for _, a in seen.elements for k in a)


def test_the_page_needs_nothing_else(page):
    seen = Reader(page)
    links = [a[k] for _, a in seen.elements for k in ("src", "href", "xlink:href", "action", "srcset") if k in a]
    assert links
    assert all(link.startswith(("#", "data:application/json;base64,")) for link in links)
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)
    assert {t for t, _ in seen.elements}.isdisjoint({"link", "iframe", "object", "embed", "img", "base"})


def test_the_attachment_is_in_it_to_save_and_to_read(page):
    seen = Reader(page)
    link = next(a for tag, a in seen.elements if tag == "a" and "download" in a)
    assert base64.b64decode(link["href"].partition("base64,")[2]) == DATA
    assert json.loads("".join(seen.scripts)) == json.loads(DATA)


def test_tables_name_their_rows_and_columns_and_pictures_have_words(page):
    seen = Reader(page)
    scopes = [a.get("scope") for tag, a in seen.elements if tag == "th"]
    assert set(scopes) == {"row", "col"}
    picture = next(a for _, a in seen.elements if a.get("role") == "img")
    assert picture["aria-label"] == HOSTILE
    assert [t for t, _ in seen.elements if t in ("h1", "h2", "h3")] == ["h1", "h2", "h3"]
    assert ("html", {"lang": "en"}) in seen.elements


def test_the_same_document_gives_the_same_page(page):
    assert html.render(made()) == page


def test_indices_are_lowered_without_blanks():
    page = html.render(Document("t", "", "", "2026-11-22", (Section("s", (Equation("N_a = K_{ip} a"),)),)))
    assert "<i>N</i><sub>a</sub> = <i>K</i><sub>ip</sub> <i>a</i>" in page


def test_a_page_is_written_whole(tmp_path):
    html.save(made("x"), tmp_path / "a.html")
    assert (tmp_path / "a.html").read_bytes() == html.render(made("x")).encode()
    assert [p.name for p in tmp_path.iterdir()] == ["a.html"]
