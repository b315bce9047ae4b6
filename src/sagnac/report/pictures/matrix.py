"""The correlation matrix, with its strongest pairs named."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...frames import Array
from ..style import BLUE, GREY, ORANGE, SMALL, TEXT, TITLE, WIDTH, blank, in_family, outlines
from .groups import Member, ordered, runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...calibration import Calibration

_CELL = 0.34  # in, at most
_TOP, _BOTTOM, _RIGHT = 0.5, 0.1, 0.08  # in
_BRACKET = 0.3  # in, for the name of a sensor
_SEEN = 0.04
"""A correlation smaller than this is not drawn."""
STRONG = 0.3
"""A pair is named from this correlation on."""
_NAMED = 14
_LETTER = 0.6  # width over size


def correlations(calibration: Calibration) -> Array:
    """Correlation matrix, shape (k, k); zero with a parameter that was given exactly.

    Parameters
    ----------
    calibration : Calibration
    """
    sigma = np.sqrt(np.maximum(np.diag(calibration.matrix), 0.0))
    inverse = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=sigma > 0)
    return np.asarray(np.clip(calibration.matrix * inverse[:, None] * inverse, -1.0, 1.0))


def strongest(calibration: Calibration, least: float = STRONG) -> list[tuple[str, str, float]]:
    """Pairs of parameters with a correlation of at least so much, the strongest first.

    Parameters
    ----------
    calibration : Calibration
    least : float
    """
    r, names = correlations(calibration), list(calibration.values())
    a, b = np.tril_indices(len(names), -1)
    order = np.argsort(-np.abs(r[a, b]), kind="stable")
    return [(names[b[i]], names[a[i]], float(r[a[i], b[i]])) for i in order if abs(r[a[i], b[i]]) >= least]


@in_family
def correlation(calibration: Calibration) -> Figure:
    """Correlation matrix: area is the size of a correlation; positive ones are filled, negative ones open.

    Parameters
    ----------
    calibration : Calibration
    """
    members = ordered(list(calibration.values()))
    order = [m.index for m in members]
    r = correlations(calibration)[np.ix_(order, order)]
    n = len(members)
    size = _letters(n)
    wide = max(len(m.label) for m in members) * _LETTER * size / 72.0 + 0.08
    left = _BRACKET + wide
    cell = min(_CELL, (WIDTH - left - _RIGHT) / n)
    side = cell * n
    height = _TOP + side + wide + _BOTTOM
    figure = blank(WIDTH, height)
    figure.set_layout_engine("none")
    axes = figure.add_axes((left / WIDTH, 1 - (_TOP + side) / height, side / WIDTH, side / height))
    _squares(axes, r, 72.0 * cell)
    _frame(axes, members, size)
    _brackets(axes, members, cell, left)
    _pairs(axes, calibration, cell, side, left)
    figure.text(0.01, 1 - 0.09 / height, "correlation of the parameters", fontsize=TITLE, va="top")
    _legend(figure, height)
    return figure


def _letters(n: int) -> float:
    """Size of the labels, points: as much as a row of a full-width matrix has room for."""
    return float(np.clip(72.0 * (WIDTH - 1.5) / n * 0.85, 4.6, TEXT - 1))


def _squares(axes: Any, r: Array, points: float) -> None:
    from matplotlib.patches import PathPatch

    n = len(r)
    row, column = np.tril_indices(n, -1)
    value = r[row, column]
    half = 0.47 * np.sqrt(np.abs(value))
    line = float(np.clip(0.12 * points, 0.5, 1.4))
    for chosen, style in (
        (value >= _SEEN, {"facecolor": BLUE, "edgecolor": "none"}),
        (value <= -_SEEN, {"facecolor": "white", "edgecolor": ORANGE, "linewidth": line}),
    ):
        if chosen.any():
            inset = line / points / 2 if "linewidth" in style else 0.0
            size = np.maximum(half[chosen] - inset, 0.02)
            path = outlines(column[chosen], row[chosen], size, size)
            axes.add_patch(PathPatch(path, **style))
    diagonal = np.arange(n)
    axes.add_patch(
        PathPatch(outlines(diagonal, diagonal, np.full(n, 0.5), np.full(n, 0.5)), facecolor="#dddddd", edgecolor="none")
    )


def _frame(axes: Any, members: list[Member], size: float) -> None:
    n = len(members)
    axes.set_xlim(-0.5, n - 0.5)
    axes.set_ylim(n - 0.5, -0.5)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0, pad=2)
    labels = [m.label for m in members]
    axes.set_xticks(range(n), labels, rotation=90, fontsize=size)
    axes.set_yticks(range(n), labels, fontsize=size)
    edges = [a for a, _ in runs([(m.sensor, m.term) for m in members])]
    sensors = {a for a, _ in runs([m.sensor for m in members])}
    for edge in [*edges, n]:
        style = {"color": GREY, "lw": 0.9} if edge in sensors or edge == n else {"color": "#bbbbbb", "lw": 0.4}
        axes.plot([-0.5, edge - 0.5], [edge - 0.5] * 2, clip_on=False, zorder=0.5, **style)
        axes.plot([edge - 0.5] * 2, [edge - 0.5, n - 0.5], clip_on=False, zorder=0.5, **style)


def _brackets(axes: Any, members: list[Member], cell: float, left: float) -> None:
    """Sensors at the far left, each along its rows."""
    at = -0.5 - (left - 0.1) / cell
    for a, b in runs([m.sensor for m in members]):
        axes.plot([at + 0.11 / cell] * 2, [a - 0.4, b - 0.6], color=GREY, lw=1.2, clip_on=False)
        axes.text(
            at,
            (a + b - 1) / 2,
            members[a].sensor,
            rotation=90,
            va="center",
            ha="center",
            fontsize=TEXT,
            fontweight="bold",
        )


def _pairs(axes: Any, calibration: Calibration, cell: float, side: float, left: float) -> None:
    """The strongest pairs, as many as the free corner above the diagonal holds."""
    pairs = strongest(calibration)
    line, letter = 1.35 * SMALL / 72.0, _LETTER * SMALL / 72.0
    edge = WIDTH - left - _RIGHT  # of the page, from the matrix's left side, in
    head = f"{len(pairs) or 'no'} pair{'s' * (len(pairs) != 1)} beyond ±{STRONG:g}"
    head += ", the strongest" * (len(pairs) > _NAMED)
    texts = [(f"{a} – {b}", f"{r:+.2f}".replace("-", "−")) for a, b, r in pairs]
    deep = 0.06
    axes.text(*_at(edge, deep, cell), head, ha="right", va="top", fontsize=SMALL, fontweight="bold")
    for pair, value in texts[:_NAMED]:
        deep += line
        if deep + line > side or (len(pair) + 7) * letter > edge - deep - 0.1:
            break
        axes.text(*_at(edge, deep, cell), value, ha="right", va="top", fontsize=SMALL)
        axes.text(*_at(edge - 6.5 * letter, deep, cell), pair, ha="right", va="top", fontsize=SMALL)


def _at(right: float, deep: float, cell: float) -> tuple[float, float]:
    """Place in the matrix of a point so many inches to the right of and below its upper left corner."""
    return right / cell - 0.5, deep / cell - 0.5


def _legend(figure: Figure, height: float) -> None:
    """What filled and open squares mean, on the line of the title."""
    axes = figure.add_axes((1 - 3.5 / WIDTH, 1 - 0.3 / height, 3.42 / WIDTH, 0.24 / height))
    axes.set_xlim(0, 3.42)
    axes.set_ylim(-0.12, 0.12)
    axes.axis("off")
    from matplotlib.patches import Rectangle

    for k, r in enumerate((1.0, 0.5, 0.1, -0.1, -0.5, -1.0)):
        half = 0.075 * np.sqrt(abs(r))
        at = 0.12 + 0.57 * k
        fill: dict[str, Any] = (
            {"facecolor": BLUE, "edgecolor": "none"} if r > 0 else {"facecolor": "white", "edgecolor": ORANGE}
        )
        axes.add_patch(Rectangle((at - half, -half), 2 * half, 2 * half, linewidth=1.2, **fill))
        axes.text(at + 0.1, 0.0, f"{r:+g}".replace("-", "−"), va="center", ha="left", fontsize=SMALL)
