"""How each method works, for a certificate: what it does in words, its equations, and where they come from (``methods.toml``)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any

from ...calibration import Calibration

_UNCERTAINTY = {
    "white": "follows from the noise and the uncertainties stated, which explain the scatter between segments",
    "scaled": "follows from the noise, scaled by the scatter of the residuals",
    "delete-one-segment": (
        "follows from leaving out one segment at a time: noise does not explain the scatter between segments, or is "
        "not known"
    ),
}


@dataclass(frozen=True)
class Method:
    """A method in words and equations.

    Attributes
    ----------
    title : str
    parts : tuple of (str, str)
        Sentences, and the equations that belong to them, one a line.
    sources : tuple of str
    """

    title: str
    parts: tuple[tuple[str, str], ...] = ()
    sources: tuple[str, ...] = ()


@lru_cache(maxsize=1)
def _known() -> dict[str, Any]:
    return tomllib.loads((files("sagnac.report.certificate") / "methods.toml").read_text(encoding="utf-8"))


def by_hand(calibration: Calibration) -> bool:
    """Whether the unit was turned by hand: static intervals were found, where a rig would have a plan of segments."""
    return calibration.method == "norm" and any("static intervals found" in r for r in calibration.remarks)


def method_of(calibration: Calibration) -> Method:
    """The method of a calibration; one that this version does not know by its name alone."""
    table = _known().get("norm by hand" if by_hand(calibration) else calibration.method)
    if table is None:
        return Method(calibration.method)
    parts = tuple((" ".join(p["words"].split()), p["equations"]) for p in table["part"])
    return Method(table["title"], parts, tuple(" ".join(s.split()) for s in table["sources"]))


def uncertainty_in_words(calibration: Calibration) -> tuple[str, ...]:
    """Where the standard uncertainties come from, a sentence for each sensor that differs."""
    out = []
    for part in calibration.fit.uncertainty.split(" / "):
        label, _, used = part.rpartition(": ")
        what = _UNCERTAINTY.get(used, f"is of the kind {used!r}")
        out.append(f"The standard uncertainty{f' of the {label}' if label else ''} {what}.")
    return tuple(out)
