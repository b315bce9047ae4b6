"""Parts that certificates and other pages share: pictures that may be missing, the correlation matrix as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ..errors import SagnacError
from ..results import Uncertain
from .document import Grid, Picture, Text
from .shown import MINUS, plain_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS = 22
"""Of the correlation matrix, side by side on a page."""


def picture(draw: Callable[[], Figure], caption: str, alt: str) -> Picture | Text:
    """A picture, or a word on why there is none.

    Parameters
    ----------
    draw : callable
        Returns the figure.
    caption, alt : str
    """
    from . import pictures

    try:
        return Picture(pictures.svg(draw()), caption, alt)
    except SagnacError as cause:  # one picture that cannot be drawn does not cost the certificate
        return not_drawn(caption, str(cause))


def not_drawn(caption: str, reason: str) -> Text:
    """What stands in the place of a picture: which one, and what would give it."""
    what, reason = f"{caption[:1].lower()}{caption[1:].rstrip('.')}", plain_words(reason)
    return Text(f"Not drawn: {what}. {reason[:1].upper()}{reason[1:].rstrip('.')}.", "missing")


def correlation_grids(parameters: Sequence[Uncertain], covariance: Sequence[Sequence[float]]) -> tuple[Grid, ...]:
    """The lower triangle of the correlation matrix in percent, in tables that are not too wide for a page."""
    sigma = [p.standard_uncertainty for p in parameters]
    count, grids = len(parameters), []
    for begin in range(0, count, _COLUMNS):
        columns = range(begin, min(begin + _COLUMNS, count))
        rows = tuple(
            (
                str(i + 1),
                parameters[i].name,
                *(_coefficient(covariance[i][j], sigma[i] * sigma[j]) if j <= i else "" for j in columns),
            )
            for i in range(begin, count)
        )
        header = ("", "parameter", *(str(j + 1) for j in columns))
        caption = f"Columns {begin + 1} to {columns[-1] + 1}"
        grids.append(Grid(header, rows, "rl" + "r" * len(columns), caption, dense=True))
    return tuple(grids)


def _coefficient(covariance: float, size: float) -> str:
    if not size > 0:
        return "–"
    text = f"{100 * covariance / size:.0f}"
    return "0" if text == "-0" else text.replace("-", MINUS)
