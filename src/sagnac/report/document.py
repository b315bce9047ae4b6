"""What a report says, apart from how it looks: sections of texts, facts, tables and pictures.

A :class:`Document` is made once and rendered twice, by :mod:`sagnac.report.html` and :mod:`sagnac.report.pdf`. Texts are
plain: nothing in them is markup. :func:`plain` is what both renderers work from.
"""

from __future__ import annotations

import base64
import re
import unicodedata
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

Align: TypeAlias = Literal["left", "right", "center"]
_ALIGN: dict[str, Align] = {"l": "left", "r": "right", "c": "center"}
_KEPT = "\n\t"
# characters that turn the order of what follows: a name must not be able to rearrange a certificate
_TURNING = {chr(c) for c in (*range(0x202A, 0x202F), *range(0x2066, 0x206A))}
UNKNOWN = "\N{REPLACEMENT CHARACTER}"


@dataclass(frozen=True)
class Text:
    """A paragraph.

    A `note` stands back, a `missing` one says what is not there and what would bring it, a `warning` is not to be missed, in one
    of `maths` underscores lower what follows them, as in an :class:`Equation`.
    """

    text: str
    style: Literal["plain", "note", "missing", "warning", "maths"] = "plain"


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Facts:
    """Labels and values, one a line."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Grid:
    """A table.

    Attributes
    ----------
    header : tuple of str, length n
    rows : tuple of tuple of str, each of length n
        The first cell of a row names it.
    align : str, length n
        ``l``, ``r`` or ``c`` for each column.
    caption : str
    dense : bool
        Small print, for wide tables of numbers.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    align: str
    caption: str = ""
    dense: bool = False

    def __post_init__(self) -> None:
        wrong = [r for r in (self.header, *self.rows) if len(r) != len(self.align)]
        if wrong or set(self.align) - set(_ALIGN):
            raise ValueError(f"a table of {len(self.align)} columns ({self.align!r}) cannot hold {wrong[:1]}")


@dataclass(frozen=True)
class Picture:
    """A drawing as an inline SVG of our own making, with a caption and a text for those who cannot see it."""

    svg: str
    caption: str
    alt: str


@dataclass(frozen=True)
class Verdict:
    """A result to be seen at once: passed, failed, or (None) undecided."""

    passed: bool | None
    text: str

    @property
    def word(self) -> str:
        """The result in a word, so that nothing rests on a colour."""
        return "UNDECIDED" if self.passed is None else "PASS" if self.passed else "FAIL"


@dataclass(frozen=True)
class Equation:
    """One equation a line, in Unicode: ``ω_e`` and ``K_{ip}`` have an index, single letters are set in italics."""

    text: str


Block: TypeAlias = Text | Bullets | Facts | Grid | Picture | Verdict | Equation


@dataclass(frozen=True)
class Section:
    """Blocks under a title; a section of level 2 belongs to the one of level 1 before it."""

    title: str
    blocks: tuple[Block, ...]
    level: Literal[1, 2] = 1


@dataclass(frozen=True)
class Attachment:
    """A file that travels inside the document."""

    name: str
    media_type: str
    data: bytes
    description: str


@dataclass(frozen=True)
class Document:
    """A report.

    Attributes
    ----------
    title, subtitle, number : str
        The number may be empty.
    created : str
        Date or time of issue, ISO 8601. Never the time of rendering: the same document gives the same bytes.
    sections : tuple of Section
    attachments : tuple of Attachment
    foot : str
        At the foot of every page.
    """

    title: str
    subtitle: str
    number: str
    created: str
    sections: tuple[Section, ...]
    attachments: tuple[Attachment, ...] = ()
    foot: str = ""


def clean(text: str) -> str:
    """Text that can be shown: control characters, halves of pairs and marks that turn the order of reading made visible."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        c if c in _KEPT or (unicodedata.category(c) not in ("Cc", "Cs", "Cn", "Co") and c not in _TURNING) else UNKNOWN
        for c in text
    )


_BOX = re.compile(r'viewBox="\S+ \S+ ([\d.]+) ([\d.]+)"')
_PART = re.compile(r"_\{([^}]*)\}|_([^\W_]+)|([A-Za-zΑ-Ωα-ω]+)|([^A-Za-zΑ-Ωα-ω_]+|_)")


def runs(text: str, *, italic: bool = True) -> list[tuple[str, str]]:
    """Pieces of an equation and how they are set: ``index``, ``symbol`` (italic) or ``upright``.

    Parameters
    ----------
    text : str
    italic : bool
        Whether single letters are symbols; in running text they may be words.
    """
    out = []
    for part in _PART.finditer(text):
        index = part[1] if part[1] is not None else part[2]
        if index is not None:
            out.append((index, "index"))
        else:
            out.append((part[0], "symbol" if italic and part[3] and len(part[3]) == 1 else "upright"))
    return out


def _cleaned(value: Any) -> Any:
    """Texts cleaned, tuples as lists."""
    if isinstance(value, str):
        return clean(value)
    return [_cleaned(v) for v in value] if isinstance(value, tuple) else value


def _block(block: Block) -> dict[str, Any]:
    out = {"kind": type(block).__name__.lower(), **{key: _cleaned(value) for key, value in vars(block).items()}}
    match block:
        case Text(_, "maths"):
            out["runs"] = runs(out.pop("text"), italic=False)
        case Equation():
            out["lines"] = [runs(line) for line in out.pop("text").split("\n")]
        case Grid():
            out["align"] = [_ALIGN[a] for a in block.align]
        case Picture():
            out["svg"] = block.svg  # ours: nothing in it is to be replaced
            box = _BOX.search(block.svg)
            out["ratio"] = float(box[2]) / float(box[1]) if box else 1.0
        case Verdict():
            state = "open" if block.passed is None else "pass" if block.passed else "fail"
            out |= {"state": state, "word": block.word}
    return out


def plain(document: Document) -> dict[str, Any]:
    """The document as tables and lists of clean texts, sections and pictures numbered; attachments in base 64."""
    sections: list[dict[str, Any]] = []
    first = second = pictures = 0
    for section in document.sections:
        first, second = (first + 1, 0) if section.level == 1 else (first, second + 1)
        number = f"{first}" if section.level == 1 else f"{first}.{second}"
        blocks = [_block(b) for b in section.blocks]
        for block in blocks:
            if block["kind"] == "picture":
                pictures += 1
                block["number"] = pictures
        sections.append({"number": number, "title": clean(section.title), "level": section.level, "blocks": blocks})
    return {
        "title": clean(document.title),
        "subtitle": clean(document.subtitle),
        "number": clean(document.number),
        "created": clean(document.created),
        "foot": clean(document.foot),
        "sections": sections,
        "attachments": [
            {
                "name": clean(a.name),
                "media_type": a.media_type,
                "base64": base64.b64encode(a.data).decode("ascii"),
                "description": clean(a.description),
                "size": len(a.data),
            }
            for a in document.attachments
        ],
    }
