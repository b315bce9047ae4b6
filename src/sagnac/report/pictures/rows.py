"""One row a parameter or comparison: names on the left, a mark or bar, numbers on the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..style import GREY, SMALL, TEXT, TITLE, WIDTH, blank
from .groups import runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LETTER = 0.6  # width over size
_TALLEST_ROW, _LEAST_ROW = 0.2, 0.125  # in
_MOST = 8.4  # in, for all rows
_HEAD, _FOOT = 0.72, 0.48  # in


@dataclass(frozen=True)
class Row:
    """What stands around the mark.

    Attributes
    ----------
    group : str
        Rows of one group stand together under its name.
    label : str
    numbers : str
        On the right.
    """

    group: str
    label: str
    numbers: str


def table(rows: Sequence[Row], heading: str, x_label: str, numbers: str) -> tuple[Figure, Any, list[float]]:
    """Axes with a row for each entry, groups parted and named, room for a legend below the heading.

    Parameters
    ----------
    rows : sequence of Row
    heading, x_label : str
    numbers : str
        What the numbers on the right are.

    Returns
    -------
    figure : Figure
    axes : matplotlib Axes
        The caller draws in it; rows are at these ordinates, from the top down.
    y : list of float
    """
    stretches = runs([r.group for r in rows])
    y: list[float] = []
    names: list[tuple[float, str]] = []
    at = 0.0
    for a, b in stretches:
        if rows[a].group:
            names.append((at + 0.05, rows[a].group))
            at += 1.0
        y += [at + i for i in range(b - a)]
        at += b - a + 0.25
    pitch = min(_TALLEST_ROW, max(_LEAST_ROW, _MOST / at))
    size = min(TEXT - 1, 72.0 * pitch * 0.72)
    letter = _LETTER * size / 72.0
    left = max([len(r.label) for r in rows] + [len(n) * 1.1 for _, n in names]) * letter + 0.12
    right = max(len(numbers), *(len(r.numbers) for r in rows)) * letter + 0.12
    height = _HEAD + _FOOT + at * pitch
    figure = blank(WIDTH, height)
    figure.set_layout_engine("none")
    axes = figure.add_axes((left / WIDTH, _FOOT / height, (WIDTH - left - right) / WIDTH, at * pitch / height))
    axes.set_ylim(at - 0.55, -0.7)
    axes.set_yticks(y, [r.label for r in rows], fontsize=size)
    axes.tick_params(axis="y", length=0, pad=3)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.grid(True, axis="x", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel(x_label)
    beside = axes.get_yaxis_transform()
    for where, name in names:
        axes.text(
            -left * 0.985 / (WIDTH - left - right),
            where,
            name,
            transform=beside,
            fontsize=size,
            fontweight="bold",
            va="center",
        )
        axes.axhline(where - 0.62, color=GREY, lw=0.5, xmin=-left / (WIDTH - left - right), clip_on=False)
    for where, row in zip(y, rows, strict=True):
        axes.text(
            1 + 0.985 * right / (WIDTH - left - right),
            where,
            row.numbers,
            transform=beside,
            fontsize=size,
            ha="right",
            va="center",
        )
    axes.text(
        1 + 0.985 * right / (WIDTH - left - right),
        -0.75,
        numbers,
        transform=beside,
        fontsize=SMALL,
        ha="right",
        va="bottom",
    )
    figure.text(0.01, 1 - 0.08 / height, heading, fontsize=title_size(heading), va="top")
    return figure, axes, y


def title_size(heading: str) -> float:
    """Letters of a heading, smaller where it would not fit the page."""
    return min(TITLE, 72.0 * (WIDTH - 0.2) / (0.56 * max(len(heading), 1)))


def legend(figure: Figure, axes: Any, columns: int) -> None:
    """What the marks mean, in one line below the heading."""
    handles, labels = axes.get_legend_handles_labels()
    below_heading(figure, handles, columns, labels)


def below_heading(figure: Figure, handles: Sequence[Any], columns: int, labels: Sequence[str] | None = None) -> None:
    """Marks with what they mean, in one line below the heading."""
    if handles:
        figure.legend(
            handles,
            [h.get_label() for h in handles] if labels is None else labels,
            loc="upper left",
            bbox_to_anchor=(0.0, 1 - 0.24 / figure.get_size_inches()[1]),
            ncols=columns,
            frameon=False,
            fontsize=TEXT - 1,
            handlelength=1.6,
            columnspacing=1.4,
            borderpad=0.2,
        )
