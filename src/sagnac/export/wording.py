"""Numbers and comments of text files."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from .._version import __version__
from ..frames import Array
from .canonical import Canonical
from .record import SIZES, Dropped

FRAME = "Axes x, y, z are the sensor axes as the recording labels them; nothing is turned into another frame."


def real(value: float) -> str:
    """The shortest decimal that reads back as the same double, with a point: YAML 1.1 takes ``1e-05`` for a text."""
    text = repr(float(value) + 0.0)  # no negative zero
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0{e}{exponent}" if e and "." not in mantissa else text


def single(value: float) -> str:
    """The same of a number that is kept in single precision, without an exponent."""
    return np.format_float_positional(np.float32(value), unique=True, trim="0")


def row(values: Iterable[float]) -> str:
    """``[ 1.0, 0.0, 0.0 ]``."""
    return "[ " + ", ".join(real(v) for v in values) + " ]"


def spread(values: Array) -> str:
    """Standard uncertainties, two digits each: rows with semicolons between."""
    lines = np.atleast_2d(values)
    return "; ".join(", ".join(f"{v:.1e}" for v in line) for line in lines)


def plain(text: str) -> str:
    """A text that can stand in a one-line comment of any file: ASCII, no control characters, no end of a C comment."""
    ascii_only = text.encode("ascii", "replace").decode("ascii")
    return re.sub(r"[\x00-\x1f\x7f]+", " ", ascii_only).replace("*/", "* /")


def header(canonical: Canonical, dropped: tuple[Dropped, ...], remarks: Iterable[str] = ()) -> list[str]:
    """What a file says of itself: the unit, the calibration, what is not in it."""
    cal = canonical.calibration
    unit = " ".join(part for part in (cal.unit.model, cal.unit.serial) if part) or "unit not named"
    lines = [
        f"Calibration of {unit}",
        f"by method {cal.method} of {cal.created}, written by sagnac {__version__}",
        FRAME,
        *canonical.remarks,
        *remarks,
    ]
    if dropped:
        lines += [f"Not held by this file, {SIZES}:"]
        lines += [f"  {d.line()}" for d in dropped]
    return [plain(line) for line in lines]


def comments(lines: Iterable[str], mark: str = "# ") -> list[str]:
    """Lines as comments."""
    return [f"{mark}{line}".rstrip() for line in lines]


def encoded(lines: Iterable[str]) -> bytes:
    """Lines as the content of a file."""
    return ("\n".join(lines) + "\n").encode("ascii")
