"""A document as PDF, set by typst: deterministic, archivable (PDF/A-3b), with its attachments inside."""

from __future__ import annotations

import datetime
import json
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from ..errors import InputError
from ..files import write_atomically
from .document import UNKNOWN, Document, plain

STANDARD: Final = "a-3b"
"""PDF for the archive, third part: the one that may carry attachments of any kind."""
_NEEDED = "writing PDF needs typst: pip install 'sagnac[pdf]'"
_RUN = 28  # characters that a narrow column can hold unbroken
_NAME = 34  # and the first, of names
_RUNNING = 100  # letters of the line at the head of a page
_EPOCH = datetime.datetime(1980, 1, 1, tzinfo=datetime.UTC)
_BREAK = "\u200b"
_FONTS = ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf", "DejaVuSans-Oblique.ttf", "DejaVuSans-BoldOblique.ttf")
_LAST = "LastResortHE-Regular.ttf"
"""Shows a box with the script's mark for any character at all."""


def check() -> None:
    """Refuse early where typst is not installed.

    Raises
    ------
    InputError
        That says what to install.
    """
    try:
        import typst  # noqa: F401 - whether it is there
    except ImportError as cause:
        raise InputError(_NEEDED) from cause


def render(document: Document) -> bytes:
    """The PDF file.

    The fonts are those that typst and matplotlib carry, so the same document gives the same bytes on any machine with the
    same versions of them. Only a text with characters that they lack (Chinese, say) makes it look among the fonts of the machine.

    Parameters
    ----------
    document : Document

    Returns
    -------
    bytes

    Raises
    ------
    InputError
        When typst is not installed.
    """
    check()
    content = plain(document)
    _soften(content)
    for i, table in enumerate(content["attachments"]):
        del table["base64"]
        table["path"] = re.sub(r"[\\/]+", "_", table["name"]).strip(". ") or f"attachment-{i + 1}"
    moment = _day(document.created)
    inputs = {"document": json.dumps(content, ensure_ascii=False), "day": f"{moment:%Y-%m-%d}"}
    inputs |= {f"attachment-{i}": a.data.decode("utf-8") for i, a in enumerate(document.attachments)}
    return _compiled(inputs, moment, _foreign(content))


def lacking(document: Document) -> str:
    """Characters of a document that no font at hand has.

    Parameters
    ----------
    document : Document

    Returns
    -------
    str
        Each once, in the order of their numbers. Where the PDF has a box or a � in their place.
    """
    foreign = sorted(_foreign(plain(document)))
    if not foreign:
        return ""
    with _font_folder(_FONTS) as folder:
        return "".join(c for c in foreign if not _shows(c, folder))


def _shows(character: str, folder: str) -> bool:
    """Whether a font has the character: an archivable PDF with it can be made, which asks for that."""
    import typst

    try:
        typst.compile(
            b'#sys.inputs.at("character")',
            format="pdf",
            font_paths=typst.Fonts(include_system_fonts=True, font_paths=[folder]),
            ignore_system_fonts=False,
            sys_inputs={"character": character},
            pdf_standards=STANDARD,
            timestamp=_EPOCH,
        )
    except typst.TypstError:
        return False
    return True


def _day(created: str) -> datetime.datetime:
    """Midnight of the document's date; a text that is no date, or lies before 1980, is the first of that year."""
    try:
        day = datetime.datetime.fromisoformat(created[:10])
    except ValueError:
        return _EPOCH
    return max(day.replace(tzinfo=datetime.UTC), _EPOCH)


def save(document: Document, path: str | Path) -> str:
    """Write the PDF, whole or not at all; returns the characters that it lacks, see :func:`lacking`."""
    data = render(document)
    with write_atomically(path) as temporary:
        temporary.write_bytes(data)
    return lacking(document)


def _compiled(inputs: dict[str, str], moment: datetime.datetime, foreign: set[str]) -> bytes:
    """Set the document with the fonts at hand; what none of them can show must not cost it.

    First with what comes along (and the fonts of the machine where that lacks a character), then with a font of boxes for
    the rest, at last without the characters that even that has no box for.
    """
    import typst

    template = (files("sagnac.report") / "templates" / "report.typ").read_bytes()
    shown = {**inputs, "document": "".join(UNKNOWN if c in foreign else c for c in inputs["document"])}
    ways = ((_FONTS, inputs), ((*_FONTS, _LAST), inputs), (_FONTS, shown))
    for i, (names, given) in enumerate(ways):
        with _font_folder(names) as folder:
            try:
                made = typst.compile(
                    template,
                    format="pdf",
                    font_paths=typst.Fonts(include_system_fonts=bool(foreign), font_paths=[folder]),
                    ignore_system_fonts=not foreign,
                    sys_inputs=given,
                    pdf_standards=STANDARD,
                    timestamp=moment,
                )
            except typst.TypstError as cause:
                if i + 1 == len(ways) or "font" not in str(cause):
                    raise
                continue
            return bytes(made)
    raise AssertionError("the last way returns or raises")


@contextmanager
def _font_folder(names: tuple[str, ...]) -> Iterator[str]:
    """A folder with some of the fonts that come with matplotlib, and no others."""
    import matplotlib

    source = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    with tempfile.TemporaryDirectory(prefix="sagnac-fonts-") as folder:
        for name in names:
            if (source / name).exists():
                shutil.copy(source / name, folder)
        yield folder


@lru_cache(maxsize=1)
def _covered() -> frozenset[int]:
    import matplotlib
    from matplotlib.ft2font import FT2Font

    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / _FONTS[0]
    return frozenset(FT2Font(str(path)).get_charmap())


def _foreign(content: dict[str, Any]) -> set[str]:
    """Characters of the texts that DejaVu Sans has not."""
    letters = {c for text in _strings(content) if not text.isascii() for c in text}
    return {c for c in letters if ord(c) not in _covered() and c not in (_BREAK, "\n", "\t")}


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, inner in value.items():
            if key != "svg":
                yield from _strings(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _strings(inner)


def _soften(content: dict[str, Any]) -> None:
    """Let very long words break anywhere; shorter ones stay as they are, and copy from the PDF unchanged."""
    for section in content["sections"]:
        section["title"] = _broken(section["title"])
        for block in section["blocks"]:
            for key in ("text", "caption"):
                if key in block:
                    block[key] = _broken(block[key], 60)
            if "items" in block:
                block["items"] = [_broken(i, 60) for i in block["items"]]
            if "rows" in block:
                first, others = (70, 70) if block["kind"] == "facts" else (_NAME, _RUN)
                block["rows"] = [
                    [_broken(c, others if i else first) for i, c in enumerate(row)] for row in block["rows"]
                ]
    running = f"{content['title']}: {content['subtitle']}"
    content["running"] = running if len(running) <= _RUNNING else f"{running[: _RUNNING - 1]}…"
    content["name"] = f"{content['title']} {content['number']}".strip()  # of the file: as it is
    for key in ("title", "subtitle", "number", "foot"):
        content[key] = _broken(content[key])


def _broken(text: str, limit: int = _RUN) -> str:
    if len(text) <= limit:
        return text
    return re.sub(rf"\S{{{limit + 1},}}", lambda m: _BREAK.join(m[0][i : i + 8] for i in range(0, len(m[0]), 8)), text)
