"""A figure as a piece of SVG to stand in a page: the same figure gives the same text, and pieces do not disturb each other."""

from __future__ import annotations

import hashlib
import io
import re
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

from ..style import family, settle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_METADATA = re.compile(r"<metadata>.*?</metadata>\s*", re.DOTALL)
_COMMENT = re.compile(r"<!--.*?-->\s*", re.DOTALL)
_GLYPH = re.compile(r'<use xlink:href="#([^"]+)" transform="translate\(([-\d.]+)(?: ([-\d.]+))?\)"\s*/>')
_REFERENCE = re.compile(r'(?:href="#|url\(#)([^")]+)')
_ID = re.compile(r'\sid="([^"]+)"')
_DECIMALS = re.compile(r"(?:scale|matrix|rotate)\([^)]*\)|-?\d+\.\d{3,}")
_CURVED = re.compile(r"[CQcq]")
_PART = re.compile(r"M([^Mz]*)(z?)")
_LONG = 2000
"""Letters of an outline that is drawn to a tenth of a point."""
_OUTLINE = re.compile(r'(<path[^>]*\bd=")([^"]*)(")', re.DOTALL)
_UNSAID = ("Date", "Creator", "Format", "Type")
_GAP = re.compile(r">\s+<")
_STYLE = re.compile(r"<defs><style[^>]*>\*\{([^}]*)\}</style></defs>")
_LONE = re.compile(r"<g>(<(?:path|use)[^>]*/>)</g>")
_ALIKE = re.compile(r'(<use [^>]*?) style="([^"]*)"/>(?:<use [^>]*? style="\2"/>)+')
_WORD = re.compile(r'(?:<use href="#[^"]+"(?: x="[^"]*")?(?: y="[^"]*")?/>){3,}')


def svg(figure: Figure) -> str:
    """Inline SVG of a figure: no prolog, no date, letters as outlines, numbers of two decimals.

    All ids begin with a prefix made from the content, so that several pieces can stand in one page.

    Parameters
    ----------
    figure : matplotlib Figure

    Returns
    -------
    str
        One ``<svg>`` element with its size in points and a view box.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    with family():
        settle(figure)
        mpl.rcParams["svg.hashsalt"] = "sagnac"
        # savefig would draw the figure twice
        FigureCanvasSVG(figure).print_svg(buffer, metadata=dict.fromkeys(_UNSAID))  # type: ignore[no-untyped-call]
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = _COMMENT.sub("", _METADATA.sub("", text))
    text = _GLYPH.sub(_shorter, text)
    text = _OUTLINE.sub(lambda m: m[1] + _compact(m[2]) + m[3], text)
    text = _DECIMALS.sub(lambda m: m[0] if "(" in m[0] else _rounded(m[0]), text)
    text = _GAP.sub("><", text.replace("xlink:href", "href")).strip()
    style = _STYLE.search(text)
    if style is not None:  # for this picture alone, not for the page that it stands in
        text = _STYLE.sub("", text).replace("<svg ", f'<svg style="{style[1]}" ', 1)
    text = _ALIKE.sub(_style_once, _LONE.sub(r"\1", text))
    return _own_ids(_words_once(text))


def _style_once(match: re.Match[str]) -> str:
    """Marks that look alike in one group that says how."""
    style = f' style="{match[2]}"'
    return f"<g{style}>{match[0].replace(style, '')}</g>"


def _words_once(text: str) -> str:
    """A word that is written several times is outlined once."""
    seen: dict[str, str] = {}
    counts = Counter(_WORD.findall(text))

    def word(match: re.Match[str]) -> str:
        letters = match[0]
        if counts[letters] < 2:
            return letters
        if letters in seen:
            return f'<use href="#{seen[letters]}"/>'
        seen[letters] = f"word{len(seen)}"
        return f'<g id="{seen[letters]}">{letters}</g>'

    return _WORD.sub(word, text)


def _shorter(match: re.Match[str]) -> str:
    """Letters are placed by x and y in place of a transform."""
    x, y = _rounded(match[2]), _rounded(match[3] or "0")
    return f'<use href="#{match[1]}" x="{x}"' + (f' y="{y}"' if y != "0" else "") + "/>"


def _rounded(text: str) -> str:
    short = f"{float(text):.2f}".rstrip("0").rstrip(".")
    return "0" if short == "-0" else short


def _compact(path: str) -> str:
    """An outline on one line; a long one of straight lines, which is a curve over a log, to a tenth of a point."""
    path = " ".join(path.split())
    if len(path) > _LONG and not _CURVED.search(path):
        return "".join(_stepwise(part) for part in _PART.findall(path))
    return path.replace(" L ", "L").replace("M ", "M")


def _stepwise(part: tuple[str, str]) -> str:
    """Corners of an outline from one to the next, in tenths of a point; those on a level line are left out."""
    numbers = [round(10 * float(v)) for v in part[0].replace("L", " ").split()]
    corners = list(zip(numbers[::2], numbers[1::2], strict=True))
    kept = corners[:1]
    for i in range(1, len(corners)):
        last = i == len(corners) - 1
        if last or not kept[-1][1] == corners[i][1] == corners[i + 1][1]:
            kept.append(corners[i])
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(kept)]
    moves = "".join(_move(x, y) for x, y in steps[: -1 if part[1] and kept[-1] == kept[0] else None])
    return f"M{_tenths(kept[0][0])} {_tenths(kept[0][1])}{moves}" + ("z" if part[1] else "")


def _move(x: int, y: int) -> str:
    return f"h{_tenths(x)}" if y == 0 else f"v{_tenths(y)}" if x == 0 else f"l{_tenths(x)} {_tenths(y)}"


def _tenths(value: int) -> str:
    return f"{value / 10:g}"


def _own_ids(text: str) -> str:
    """Ids that something refers to, in a space of their own; the others go."""
    used = {name: f"{i:x}" for i, name in enumerate(dict.fromkeys(_REFERENCE.findall(text)))}
    prefix = "s" + hashlib.sha256(text.encode()).hexdigest()[:7]

    def identity(match: re.Match[str]) -> str:
        return f' id="{prefix}{used[match[1]]}"' if match[1] in used else ""

    text = _ID.sub(identity, text)
    return _REFERENCE.sub(lambda m: m[0].replace(m[1], prefix + used[m[1]]), text)
