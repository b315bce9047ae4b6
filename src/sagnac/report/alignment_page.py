"""The page of an alignment: what was found, what was not seen, how the filter fared."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path, PurePath

from .. import __version__
from ..align.record import HISTORY, RESULT
from ..align.result import Alignment, Value, loads
from ..errors import InputError
from .document import Attachment, Block, Bullets, Document, Facts, Grid, Section, Text, Verdict
from .parts import correlation_grids, not_drawn, picture
from .shown import Scale, convert, moment, or_not_stated, term_of

_KINDS = {"transfer": "Transfer alignment", "covariance": "Covariance analysis", "static": "Static alignment"}
_UNITS = {"rad": "arcmin", "rad/s": "deg/h", "m/s^2": "ug", "s": "ms"}
_DEGREES = ("heading", "pitch", "roll", "latitude", "longitude")
_GIVEN_DIGITS = {"deg": 7, "m": 2}
"""After the point, of a place that was given: about a centimetre."""
_K = 2.0
_CAPTIONS = {
    "estimates": "Estimates over time with bands of three standard deviations.",
    "deviations": "Standard deviations over time.",
    "innovations": "What each update differed by from its prediction, and the normalised squares.",
    "observability": "Standard deviation of each parameter over the initial one.",
}


def page(path: str | Path) -> Document:
    """The page of an alignment.

    Parameters
    ----------
    path : path of ``alignment.json``
        With ``history.parquet`` beside it pictures are drawn.

    Raises
    ------
    InputError
        When the file cannot be read or is no alignment.
    """
    file = Path(path)
    try:
        data = file.read_bytes()
        found = loads(data.decode("utf-8-sig"), str(path))
    except (OSError, UnicodeDecodeError) as cause:
        raise InputError(f"{path}: cannot read the alignment: {cause}") from cause
    sections = [
        _summary(found),
        _result(found),
        _unseen(found),
        _innovations(found),
        _course(found),
        _pictures(found, file.parent),
        _notes(found),
        _data(found, file.name, data),
        _matrix(found),
    ]
    return Document(
        title=_KINDS[found.kind],
        subtitle=", ".join(PurePath(s.file).name for s in found.source) or file.name,
        number="",
        created=found.created,
        sections=tuple(s for s in sections if s is not None),
        attachments=(Attachment(file.name, "application/json", data, "the alignment"),),
        foot=f"alignment data SHA-256 {hashlib.sha256(data).hexdigest()[:16]}…",
    )


def _scale(value: Value, uncertainty: float) -> Scale:
    """How a quantity is shown: the unit that an alignment is told in, two digits of the uncertainty."""
    unit = "deg" if value.name in _DEGREES else _UNITS.get(value.unit, value.unit)
    size = convert(1.0, value.unit, unit)
    shown = uncertainty * size
    digits = min(9, max(0, 1 - math.floor(math.log10(shown)))) if shown > 0 else _GIVEN_DIGITS.get(unit, 4)
    return Scale(unit, size, digits)


def _scales(values: Sequence[Value], uncertainties: Sequence[float]) -> list[Scale]:
    """The same for several, the axes of one quantity with the same digits: those of the smallest uncertainty."""
    least: dict[tuple[str, str], float] = {}
    for v, u in zip(values, uncertainties, strict=True):
        if u > 0:
            key = term_of(v.name), v.unit
            least[key] = min(u, least.get(key, u))
    return [
        _scale(v, least[term_of(v.name), v.unit] if u > 0 else 0.0) for v, u in zip(values, uncertainties, strict=True)
    ]


def _summary(found: Alignment) -> Section:
    rows = [
        ("Kind", _KINDS[found.kind]),
        ("Method", found.method),
        ("Matching", found.matching),
        ("States", found.states),
        ("Correction", found.correction),
        ("Result belongs to", f"{found.time:.3f} s on the clock of the recording"),
        ("Made", moment(found.created)),
    ]
    blocks: list[Block] = [Facts(tuple(r for r in rows if r[1]))]
    i = found.innovations
    if i is not None:
        inside = i.band[0] <= i.mean <= i.band[1]
        text = (
            f"Normalised innovations squared {i.mean:.4g} where {i.expected:.4g} is expected; 99.9 % of alignments "
            "whose noise is as stated "
            f"lie between {i.band[0]:.4g} and {i.band[1]:.4g}."
        )
        blocks.append(Verdict(inside, text))
    if found.not_observed:
        blocks.append(Text(f"Not observed: {', '.join(n.name for n in found.not_observed)}."))
    return Section("Summary", tuple(blocks))


def _result(found: Alignment) -> Section:
    rows = []
    values = (*found.attitude, *found.place, *found.parameters)
    expanded = [_K * v.standard_uncertainty for v in values]
    for value, size, scale in zip(values, expanded, _scales(values, expanded), strict=True):
        shown = "–" if value.value is None else scale.text(value.value)
        spread = (scale.text(size), scale.text(value.standard_uncertainty, 1)) if size > 0 else ("given", "given")
        rows.append((value.name, shown, spread[0], scale.unit_text, spread[1]))
    words = (
        "U is the expanded uncertainty with the coverage factor k = 2, about 95 % of a normal distribution; u is the "
        "standard uncertainty. "
        "Heading, pitch and roll are those of the unit."
    )
    if found.kind == "covariance":
        words = "Predicted without data: there are uncertainties, and no values. " + words
    return Section(
        "Result", (Grid(("quantity", "value", "U", "unit", "u"), tuple(rows), "lrrlr", "Result"), Text(words))
    )


def _unseen(found: Alignment) -> Section | None:
    blocks: list[Block] = []
    if found.not_observed:
        why = tuple((n.name, f"{100 * n.remains:.0f} %", n.reason, n.shown_by) for n in found.not_observed)
        blocks.append(Grid(("quantity", "left", "why", "what would show it"), why, "lrll", "Not observed"))
    if found.not_separated:
        blocks.append(
            Text(
                "Directions that the data say less of than was known before, in states over their initial uncertainties:"
            )
        )
        blocks.append(Bullets(found.not_separated))
    if found.observed:
        rows = []
        values = [Value(name=o.name, value=None, unit=o.unit, standard_uncertainty=o.final) for o in found.observed]
        for o, scale in zip(found.observed, _scales(values, [o.final for o in found.observed]), strict=True):
            left = f"{100 * o.final / o.initial:.3g} %" if o.initial > 0 else "–"
            rows.append((o.name, scale.text(o.initial), scale.text(o.final, 1), scale.unit_text, left))
        header = ("quantity", "u at the start", "u at the end", "unit", "left")
        blocks.append(Grid(header, tuple(rows), "lrrlr", "What the data took away"))
    if found.singular_values:
        singular = ", ".join(f"{v:.3g}" for v in found.singular_values)
        blocks.append(
            Text(
                f"Singular values of the observability Gramian: {singular}. Below 1 the data say less than was known before.",
                "note",
            )
        )
    if not blocks:
        return None
    if not found.not_observed:
        blocks.insert(0, Text("All parameters were observed."))
    return Section("What was observed and what was not", tuple(blocks))


def _innovations(found: Alignment) -> Section | None:
    i = found.innovations
    if i is None:
        return None
    facts = Facts(
        (
            ("Updates", f"{i.updates}"),
            ("Of them beyond the gate", f"{i.rejected}"),
            ("Mean square, normalised", f"{i.mean:.4g}"),
            ("Expected", f"{i.expected:.4g}"),
            ("99.9 % band of the mean", f"{i.band[0]:.4g} to {i.band[1]:.4g}"),
        )
    )
    blocks: list[Block] = [facts]
    if i.ratio:
        rows = tuple((name, f"{ratio:.3f}") for name, ratio in i.ratio.items())
        blocks.append(
            Grid(
                ("component", "rms / standard deviation"),
                rows,
                "lr",
                "Scatter of the innovations over what was expected",
            )
        )
    return Section("Innovations", tuple(blocks))


def _course(found: Alignment) -> Section | None:
    if not found.course:
        return None
    header = ("after", *(f"{m.after:.4g} s" for m in found.course))
    rows = []
    for k, p in enumerate(found.parameters):
        scale = _scale(p, p.standard_uncertainty)
        unit = f" [{scale.unit_text}]"
        rows.append((p.name + unit, *(f"{m.standard_uncertainty[k] * scale.size:.3g}" for m in found.course)))
    grid = Grid(header, tuple(rows), "l" + "r" * len(found.course), "Standard uncertainties over time", len(header) > 8)
    return Section("How the uncertainty fell", (grid,))


def _pictures(found: Alignment, folder: Path) -> Section:
    title = "Estimates over time"
    if found.kind == "static":
        return Section(title, (Text("A static alignment keeps no history.", "note"),))
    from . import alignment_files

    reason = ""
    try:
        result, history = alignment_files.read(folder)
        reason = "" if result == found else f"{folder / HISTORY} is the history of another alignment"
    except InputError as cause:
        reason = str(cause)
    if reason:
        wanted = f"put {HISTORY} and {RESULT}, as the alignment wrote them, into one folder ({reason})"
        return Section(title, (not_drawn("Estimates and innovations over time", wanted),))
    blocks: list[Block] = [Text("What the filter knew at each update, from the history of the alignment.")]
    for name in alignment_files.pictures_of(history):
        draw = alignment_files.PICTURES[name][1]
        caption = _CAPTIONS["deviations" if name == "estimates" and found.kind == "covariance" else name]
        blocks.append(picture(partial(draw, history), caption, caption))
    return Section(title, tuple(blocks))


def _notes(found: Alignment) -> Section | None:
    items = [f"Left out: {s.start:.9g} s to {s.stop:.9g} s: {s.reason}" for s in found.skipped]
    items += found.remarks
    return Section("Notes", (Bullets(tuple(items)),)) if items else None


def _data(found: Alignment, name: str, data: bytes) -> Section:
    blocks: list[Block] = [
        Facts(
            (
                ("Aligned with", f"{found.software.name} {found.software.version}"),
                ("Page made with", f"sagnac {__version__}"),
                ("Alignment file", f"{name} ({found.schema_id})"),
                ("SHA-256 of it", hashlib.sha256(data).hexdigest()),
            )
        )
    ]
    if found.source:
        rows = tuple((PurePath(s.file).name, or_not_stated(s.sha256 or "")) for s in found.source)
        blocks.append(Grid(("file", "SHA-256"), rows, "ll", "Files that the alignment was made from"))
    blocks.append(Text(f"The file {name} is attached, byte for byte. It is the result in full precision.", "note"))
    return Section("Software and data", tuple(blocks))


def _matrix(found: Alignment) -> Section:
    words = "Correlation coefficients times 100; columns have the numbers of the rows."
    grids = correlation_grids(found.parameters, found.covariance)
    return Section("Appendix: correlation matrix", (Text(words), *grids))
