"""How every picture looks: size, colours that survive grey print and colour blindness, units, names, files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from .. import units
from ..errors import InputError
from ..files import write_atomically
from ..frames import Array
from ..printed import printed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_P = ParamSpec("_P")
_T = TypeVar("_T")

# readable in print and to the colour-blind (Okabe & Ito)
BLUE, ORANGE, GREEN, GREY, SKY = "#0072B2", "#D55E00", "#009E73", "#666666", "#56B4E9"
STILL, TURNING = "#dbe7df", "#b9c9dc"
"""Shades of segments at rest and turning; they differ in grey as well."""
BAND = "#e8f1f8"
"""Where values should lie."""
WIDTH = 7.0
"""Of a picture on an A4 page, inches."""
TALLEST = 9.6
"""Of a picture on an A4 page with its caption, inches."""
SMALL, TEXT, TITLE = 6.5, 8.0, 9.0
"""Sizes of letters, points."""
DRAWN = 4000
"""Points that a curve is thinned to, keeping the extremes of each stretch."""
_LETTER = 0.62
"""Width of a letter over its size."""
_ENDINGS = (".png", ".svg", ".pdf")
_PRETTY = (("^2", "²"), ("^3", "³"), ("^4", "⁴"), ("sqrt(Hz)", "√Hz"), ("*", "·"))
_SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    "font.size": TEXT,
    "axes.titlesize": TITLE,
    "axes.labelsize": TEXT,
    "xtick.labelsize": TEXT - 1,
    "ytick.labelsize": TEXT - 1,
    "legend.fontsize": TEXT - 1,
    "hatch.linewidth": 0.6,
    "axes.titlelocation": "left",
    "axes.formatter.useoffset": False,
    "svg.fonttype": "path",
    "text.parse_math": False,  # a name may hold a dollar sign
    "path.simplify_threshold": 0.3,
}


@contextmanager
def family() -> Iterator[None]:
    """The settings of all pictures: drawn and saved in them, whatever the caller's own matplotlib settings are."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def blank(width: float, height: float) -> Figure:
    """An empty figure of this size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=120)


def in_family(draw: Callable[_P, _T]) -> Callable[_P, _T]:
    """Decorator of functions that draw: they do so in :func:`family`."""

    @wraps(draw)
    def within(*args: _P.args, **more: _P.kwargs) -> _T:
        with family():
            return draw(*args, **more)

    return within


def clean(axes: Any) -> None:
    """A light grid behind, no frame above and on the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def title(axes: Any, text: str, size: float = TITLE) -> None:
    """A title in words, on the left."""
    axes.set_title(text, fontsize=size, loc="left")


def check_ending(path: str | Path, option: str = "--out") -> None:
    """Refuse a picture of a kind that cannot be drawn, before any work is done.

    Raises
    ------
    InputError
    """
    if Path(path).suffix.lower() not in _ENDINGS:
        raise InputError(f"{option} {path}: write to a .png, .svg or .pdf file")


def settle(drawn: Figure) -> None:
    """Lay a figure out for good.

    The solver of the layout differs from run to run in the last places of a number; rounded, the same figure gives the same file.
    """
    engine = drawn.get_layout_engine()
    if engine is None:
        return
    for _ in range(2):  # ticks follow the size of a panel, and may be wider than those that it was laid out for
        engine.execute(drawn)
    drawn.set_layout_engine("none")
    for axes in drawn.axes:
        x, y, width, height = (round(float(v), 4) for v in axes.get_position(original=True).bounds)
        axes.set_position((x, y, width, height))


def save(drawn: Figure, path: str | Path) -> None:
    """Write a figure as PNG, SVG or PDF by its ending, whole or not at all; the same figure gives the same bytes."""
    ending = Path(path).suffix.lower().removeprefix(".") or "png"
    with write_atomically(path) as temporary, family():
        import matplotlib as mpl

        settle(drawn)
        mpl.rcParams["svg.hashsalt"] = "sagnac"
        undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(ending)
        drawn.savefig(temporary, format=ending, dpi=150 if ending == "png" else "figure", metadata=undated)


def envelope(time: Array, values: Array, points: int = DRAWN) -> tuple[Array, Array]:
    """Thin a curve to its least and greatest value in each of `points` / 2 stretches.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
    points : int

    Returns
    -------
    time, values : ndarray, shape (m,)
        m is about `points`, or n when the curve is short already.
    """
    size = len(values) // (points // 2)
    if size < 2:
        return time, values
    count = len(values) // size
    blocks = values[: count * size].reshape(count, size)
    low, high = blocks.argmin(axis=1), blocks.argmax(axis=1)
    index = np.sort(np.column_stack([low, high]), axis=1) + np.arange(count)[:, None] * size
    rest = np.arange(count * size, len(values))
    chosen = np.concatenate([index.ravel(), rest])
    return time[chosen], values[chosen]


def pretty(unit: str) -> str:
    """A unit as it is set in print: ``m/s^2`` with a raised two, ``ug`` with the micro sign."""
    for plain, printed_ in _PRETTY:
        unit = unit.replace(plain, printed_)
    return "µ" + unit[1:] if unit.startswith(("ug", "us")) else unit


def in_brackets(unit: str) -> str:
    """A unit for the label of an axis, with a blank before it; nothing for a bare number."""
    return f" [{pretty(unit)}]" if unit not in ("", "1") else ""


def shown_unit(size: float, si_unit: str) -> tuple[str, float]:
    """Unit in which a quantity of this size has a convenient number, and the factor from SI to it.

    Parameters
    ----------
    size : float
        A typical value or uncertainty in SI.
    si_unit : str
    """
    unit = printed(0.0, abs(size) / 30.0, si_unit)[2]
    try:
        return unit, units.convert(1.0, si_unit, unit) if unit != si_unit else 1.0
    except InputError:
        return si_unit, 1.0


def common_unit(values: Array, sigmas: Array, si_unit: str) -> str:
    """One unit for numbers that stand together, see :func:`number`.

    Parameters
    ----------
    values, sigmas : ndarray, shape (n,)
        SI; uncertainties of nothing do not count.
    si_unit : str
    """
    known = sigmas[(sigmas > 0) & np.isfinite(sigmas)]
    return printed(float(np.max(np.abs(values))), float(np.median(known)) if known.size else 0.0, si_unit)[2]


def number(value: float, sigma: float, si_unit: str, unit: str | None = None) -> tuple[str, str, str]:
    """:func:`sagnac.printed.printed` with a true minus sign and the unit as in print."""
    v, s, unit = printed(value, sigma, si_unit, unit)
    return v.replace("-", "−" if float(v) else ""), s, pretty(unit)


def every(count: int, room: int) -> int:
    """Step at which `count` labels are written where there is room for `room`."""
    return max(1, -(-count // max(room, 1)))


def shortened(text: str, most: int) -> str:
    """A name of at most so many letters, cut in its middle."""
    if len(text) <= most:
        return text
    head = (most - 1) // 2
    return f"{text[:head]}…{text[len(text) - (most - 1 - head) :]}"


def outlines(x: NDArray[Any], y: NDArray[Any], half_width: Array, half_height: Array) -> Any:
    """Rectangles as one path, which keeps files small.

    Parameters
    ----------
    x, y, half_width, half_height : ndarray, shape (n,)
    """
    from matplotlib.path import Path as Outline

    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    corners = np.stack([x, y], axis=-1)[:, None] + around * np.stack([half_width, half_height], axis=-1)[:, None]
    codes = np.tile([Outline.MOVETO, *[Outline.LINETO] * 3, Outline.CLOSEPOLY], len(x))
    return Outline(corners.reshape(-1, 2), codes)


def powers(axis: Any) -> None:
    """Ticks of a logarithmic axis in words that need no typesetting: 0.01, 1, 100, 10⁵."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(numticks=7))
    axis.set_major_formatter(FuncFormatter(lambda v, _: _power(v)))
    axis.set_minor_formatter(NullFormatter())


def _power(value: float) -> str:
    exponent = round(float(np.log10(value)))
    if -3 <= exponent <= 3:
        return f"{value:g}"
    return "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


End = tuple[float, str, str]
"""Where a curve ends, its name and its colour."""


def end_labels(drawn: Figure, ends: Sequence[tuple[Any, Sequence[End]]]) -> None:
    """Names of curves at their right ends, clear of one another, each with a line to its curve.

    Parameters
    ----------
    drawn : matplotlib Figure
        With all else in it, so that its layout says how high the panels are.
    ends : sequence of (axes, ends of its curves)
    """
    drawn.draw_without_rendering()
    for axes, own in ends:
        _label_ends(axes, own)


def _label_ends(axes: Any, ends: Sequence[End]) -> None:
    height = axes.get_position().height * axes.figure.get_size_inches()[1]
    gap = 1.2 * SMALL / 72.0 / max(height, 0.1)
    to_axes = axes.transData + axes.transAxes.inverted()
    x = axes.get_xlim()[1]
    placed = sorted((float(to_axes.transform((x, y))[1]), name, colour) for y, name, colour in ends)
    at = np.array([p[0] for p in placed])
    for i in range(1, at.size):
        at[i] = max(at[i], at[i - 1] + gap)
    if at.size:  # those pushed out at the top push the others down again
        at[-1] = min(at[-1], max(1.0, gap * at.size))
    for i in range(at.size - 2, -1, -1):
        at[i] = min(at[i], at[i + 1] - gap)
    for where, (y, name, colour) in zip(at, placed, strict=True):
        axes.annotate(
            name,
            (1.0, y),
            xytext=(1.05, where),
            xycoords="axes fraction",
            textcoords="axes fraction",
            va="center",
            fontsize=SMALL,
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "lw": 0.6,
                "color": colour,
                "shrinkA": 2,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
            },
        )


def _beginning(names: Sequence[str]) -> str:
    """What all names begin with."""
    least, greatest = min(names), max(names)  # all others lie between
    same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(least, greatest, strict=False)))
    return least[:same]


def told_apart(names: Sequence[str], most: int) -> tuple[list[str], str]:
    """Names of at most so many letters that still differ, and the pattern that they were taken from.

    What all of them begin or end with is left out where they are too long; numbers stay whole.

    Parameters
    ----------
    names : sequence of str
    most : int

    Returns
    -------
    names : list of str
    pattern : str
        Empty where nothing common was left out.
    """
    if max((len(n) for n in names), default=0) <= most or len(set(names)) < 2:
        return [shortened(n, most) for n in names], ""
    head = re.sub(r"\d+$", "", _beginning(names))
    tail = re.sub(r"^\d+", "", _beginning([n[len(head) :][::-1] for n in names])[::-1])
    own = [n[len(head) : len(n) - len(tail)] for n in names]
    return [shortened(n, most) for n in own], f"{head}…{tail}" if head or tail else ""


@dataclass(frozen=True)
class Names:
    """How the names of segments are written below an axis.

    Attributes
    ----------
    shown : list of str
    pattern : str
        What they have in common and is left out.
    size : float
        Of the letters, points.
    step : int
        Every so many are written.
    upright : bool
    """

    shown: list[str]
    pattern: str
    size: float
    step: int
    upright: bool

    @property
    def height(self) -> float:
        """What they take below the axis, inches."""
        if self.upright:
            return 0.2
        return 0.1 + _LETTER * self.size / 72.0 * max((len(n) for n in self.shown), default=1)

    @property
    def label(self) -> str:
        """Label of the axis."""
        return f"segment ({self.pattern})" if self.pattern else "segment"

    def write(self, axes: Any) -> None:
        """Names at 0, 1, 2, ... of this axis."""
        at = list(range(0, len(self.shown), self.step))
        axes.set_xticks(at, [self.shown[i] for i in at], rotation=0 if self.upright else 90, fontsize=self.size)
        axes.set_xlim(-0.7, max(len(self.shown) - 0.3, 0.7))


def names_below(names: Sequence[str], *, width: float = WIDTH - 1.0, most: int = 18) -> Names:
    """Names of segments below an axis: upright where they fit, turned or thinned where they do not.

    Parameters
    ----------
    names : sequence of str
    width : float
        Of the axis, inches.
    most : int
        Letters of a name that are written.
    """
    shown, pattern = told_apart(names, most)
    size = TEXT - 1 if len(names) <= 50 else SMALL - 0.5
    longest = max((len(n) for n in shown), default=1) * _LETTER * size / 72.0
    upright = longest * len(names) * 1.15 < width
    step = 1 if upright else every(len(names), int(width / (1.15 * size / 72.0)))
    if not upright and longest * (len(names) / every(len(names), 25)) * 1.15 < width and longest < 0.3:
        upright, step = True, every(len(names), 25)  # short names of many: some of them upright
    return Names(shown, pattern, size, step, upright)
