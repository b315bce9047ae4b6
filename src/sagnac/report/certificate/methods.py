"""How each method works, for a certificate: what it does in words, its equations, and where they come from (``methods.toml``)."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
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
class Input:
    """What a method takes as exact unless its uncertainty is stated.

    Attributes
    ----------
    what : str
    of : tuple of str
        How the names of the parameters begin that it matters to.
    unless, when : str
        Keys of the rig, or ``gravity_uncertainty``, ``latitude``: with the one it is not exact, without the other it is not used.
    shows : str
        What is told with it: ``gravity``, ``latitude``, ``scale`` or a key of the rig.
    """

    what: str
    of: tuple[str, ...]
    unless: str = ""
    when: str = ""
    shows: str = ""


@dataclass(frozen=True)
class Method:
    """A method in words and equations.

    Attributes
    ----------
    title : str
    parts : tuple of (str, str)
        Sentences, and the equations that belong to them, one a line.
    sources : tuple of str
    rests : mapping of str to str
        What the results of each sensor rest on.
    exact : tuple of Input
    budget, budget_note : str
        Why there is no budget of the uncertainty by source, and what else is to be known of one.
    """

    title: str
    parts: tuple[tuple[str, str], ...] = ()
    sources: tuple[str, ...] = ()
    rests: Mapping[str, str] = field(default_factory=dict)
    exact: tuple[Input, ...] = ()
    budget: str = ""
    budget_note: str = ""


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

    def words(text: str) -> str:
        return " ".join(text.split())

    return Method(
        table["title"],
        parts=tuple((words(p["words"]), p["equations"]) for p in table["part"]),
        sources=tuple(words(s) for s in table["sources"]),
        rests={sensor: words(text) for sensor, text in table["rests"].items()},
        exact=tuple(Input(**{**e, "of": tuple(e["of"])}) for e in table["exact"]),
        budget=words(table.get("budget", "")),
        budget_note=words(table.get("budget_note", "")),
    )


def uncertainty_in_words(calibration: Calibration) -> tuple[str, ...]:
    """Where the standard uncertainties come from, a sentence for each sensor that differs."""
    out = []
    for part in calibration.fit.uncertainty.split(" / "):
        label, _, used = part.rpartition(": ")
        what = _UNCERTAINTY.get(used, f"is of the kind {used!r}")
        out.append(f"The standard uncertainty{f' of the {label}' if label else ''} {what}.")
    return tuple(out)
