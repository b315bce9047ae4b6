"""Sizes in a scenario that are given, or drawn with the seed."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import BeforeValidator

from ..quantities import si

_LAW = re.compile(r"\s*(normal|uniform|sign)\s+(.*)", re.DOTALL)


@dataclass(frozen=True)
class Drawn:
    """A truth that is given, or drawn with the seed.

    Attributes
    ----------
    law : str
        ``exact`` is the value itself, ``normal`` has it as standard deviation, ``uniform`` as bound on both sides, and
        ``sign`` is the value with either sign.
    size : float, SI
    """

    law: Literal["exact", "normal", "uniform", "sign"]
    size: float

    def draw(self, rng: np.random.Generator) -> float:
        """A value, SI; random numbers are used whatever the law is, so that one law does not shift the other draws."""
        normal, uniform = float(rng.standard_normal()), float(rng.uniform(-1.0, 1.0))
        shape = {"exact": 1.0, "normal": normal, "uniform": uniform, "sign": math.copysign(1.0, uniform)}
        return self.size * shape[self.law]


def drawn(unit: str, example: str) -> BeforeValidator:
    """Reader of a :class:`Drawn`: ``"5 arcsec"``, ``"normal 5 arcsec"``, ``"uniform 1 arcmin"``, ``"sign 5 arcsec"``."""
    return BeforeValidator(lambda given: draws(given, unit, example))


def drawn_each(count: int, unit: str, example: str) -> BeforeValidator:
    """Reader of several :class:`Drawn`: a list, or one text for all of them."""

    def read(given: object) -> tuple[Drawn, ...]:
        parts = given if isinstance(given, list | tuple) else [given] * count
        if len(parts) != count:
            raise ValueError(f"{len(parts)} values where {count} are needed")
        return tuple(draws(part, unit, example) for part in parts)

    return BeforeValidator(read)


def draws(given: object, unit: str, example: str) -> Drawn:
    """A :class:`Drawn` from its text; raises ValueError as :func:`si` does."""
    if isinstance(given, Drawn):
        return given
    match = _LAW.fullmatch(given) if isinstance(given, str) else None
    if match is None:
        return Drawn("exact", si(given, unit, example))
    size = si(match[2], unit, example)
    if size < 0:
        raise ValueError(f"{given!r}: a drawn value has a size, which is not negative")
    law: Any = match[1]
    return Drawn(law, size)
