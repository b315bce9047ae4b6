"""Instrument models with named parameters: forward, derivative, inverse. They know no rig.

``triad`` is three sensors as one linear instrument, ``axis`` one sensor with all the terms of the standards, ``inverse``
the whole model read backwards.
"""

from __future__ import annotations

from .axis import TERMS, Axis, Reading
from .inverse import Correction, correction, forward, invert
from .triad import AXES, INPUT, Triad, signed_permutation, triad_of
from .whole import check_whole

__all__ = [
    "AXES",
    "INPUT",
    "TERMS",
    "Axis",
    "Correction",
    "Reading",
    "Triad",
    "check_whole",
    "correction",
    "forward",
    "invert",
    "signed_permutation",
    "triad_of",
]
