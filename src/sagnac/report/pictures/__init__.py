"""Pictures of a calibration, each a function that returns a matplotlib figure; :data:`PICTURES` lists them by name.

All are seven inches wide for an A4 page, and can be read in grey print: what colour tells is also told by marks, hatches or
place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from ...errors import InputError
from ...observe.static import THRESHOLD
from .bars import as_found, budget, influence, parameters
from .comparison import Comparison, Pair, comparison, nominal, refuse_nothing
from .log import log
from .matrix import correlation
from .segments import before_after, residuals
from .svg import svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...calibration import Calibration
    from ...plan import Plan
    from ...recording import Recording

_T = TypeVar("_T")

__all__ = [
    "PICTURES",
    "Comparison",
    "Kind",
    "Material",
    "Pair",
    "as_found",
    "before_after",
    "budget",
    "comparison",
    "correlation",
    "draw",
    "influence",
    "log",
    "nominal",
    "parameters",
    "refuse_nothing",
    "residuals",
    "svg",
]


@dataclass(frozen=True)
class Material:
    """What pictures are made from.

    Attributes
    ----------
    calibration : Calibration, optional
    recording : Recording, optional
        Its own, or another one of the same unit.
    plan : Plan, optional
        Of the recording.
    earlier : Calibration, optional
        Of the same unit, before.
    threshold : float
        Of static intervals, see :func:`sagnac.observe.static.static_intervals`.
    """

    calibration: Calibration | None = None
    recording: Recording | None = None
    plan: Plan | None = None
    earlier: Calibration | None = None
    threshold: float = THRESHOLD


@dataclass(frozen=True)
class Kind:
    """A picture that can be drawn.

    Attributes
    ----------
    shows : str
        In words.
    needs, takes : tuple of str
        Attributes of :class:`Material` without which it cannot be drawn, and those that it uses besides.
    make : callable
        Takes a :class:`Material`.
    """

    shows: str
    needs: tuple[str, ...]
    takes: tuple[str, ...]
    make: Callable[[Material], Figure]


def _given(value: _T | None) -> _T:
    assert value is not None  # draw() has looked
    return value


def _residuals(m: Material) -> Figure:
    own = _given(m.calibration)
    if m.recording is None:
        return residuals(own)
    from ...verification import verify

    checks = verify(own, m.recording, m.plan, threshold=m.threshold).checks
    refuse_nothing(own, checks)
    return residuals(own, checks)


def _before_after(m: Material) -> Figure:
    own, recording = _given(m.calibration), _given(m.recording)
    return before_after(comparison(own, recording, m.plan, m.earlier, threshold=m.threshold))


PICTURES: dict[str, Kind] = {
    "parameters": Kind(
        "values with their expanded uncertainties", ("calibration",), (), lambda m: parameters(_given(m.calibration))
    ),
    "correlation": Kind(
        "correlation matrix, strongest pairs named", ("calibration",), (), lambda m: correlation(_given(m.calibration))
    ),
    "budget": Kind(
        "what each uncertainty is made of, or in how many ways it was found",
        ("calibration",),
        (),
        lambda m: budget(_given(m.calibration)),
    ),
    "residuals": Kind(
        "what is left in each segment; without the recording, the chi-square of each",
        ("calibration",),
        ("recording", "plan"),
        _residuals,
    ),
    "influence": Kind(
        "what leaving out one segment moves", ("calibration",), (), lambda m: influence(_given(m.calibration))
    ),
    "log": Kind(
        "the whole log with its segments or static intervals",
        ("recording",),
        ("plan", "calibration"),
        lambda m: log(_given(m.recording), m.plan, m.calibration, threshold=m.threshold),
    ),
    "before-after": Kind(
        "residuals of a recording without and with the calibration, or with an earlier one and this",
        ("calibration", "recording"),
        ("plan", "earlier"),
        _before_after,
    ),
    "as-found": Kind(
        "change since an earlier calibration",
        ("calibration", "earlier"),
        (),
        lambda m: as_found(_given(m.earlier), _given(m.calibration)),
    ),
}
"""Pictures by the names that ``sagnac plot`` knows them by."""


def draw(name: str, material: Material) -> Figure:
    """The picture of this name.

    Parameters
    ----------
    name : str
        One of :data:`PICTURES`.
    material : Material

    Raises
    ------
    InputError
        When there is no such picture, or something that it needs is missing.
    DataError
        When the data do not support it.
    """
    kind = PICTURES.get(name)
    if kind is None:
        raise InputError(f"there is no picture {name!r}; choose from {', '.join(PICTURES)}")
    lacking = [n for n in kind.needs if getattr(material, n) is None]
    if lacking:
        raise InputError(f"the picture {name!r} ({kind.shows}) needs {' and '.join(lacking)}")
    return kind.make(material)
