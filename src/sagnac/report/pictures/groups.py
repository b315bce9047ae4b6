"""Parameters in the order of a picture: accelerometers, gyros, rig, and within them by term."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

_FIRST = ("accel", "gyro", "rig")


@dataclass(frozen=True)
class Member:
    """A parameter and its place.

    Attributes
    ----------
    index : int
        In the calibration.
    sensor : str
        ``accel``, ``gyro``, ``rig``, ...
    term : str
        ``bias``, ``scale_error``, ...; empty where there is none.
    label : str
        The name without the sensor.
    """

    index: int
    sensor: str
    term: str
    label: str


def ordered(names: Sequence[str]) -> list[Member]:
    """Parameters by sensor and term, otherwise in their own order.

    Parameters
    ----------
    names : sequence of str
    """
    out = []
    for i, name in enumerate(names):
        sensor, _, rest = name.partition(".")
        term, _, axes = rest.rpartition(".")
        out.append(Member(i, sensor, term if len(axes) <= 2 and axes else rest.partition(".")[0], rest or sensor))
    first = {s: k for k, s in enumerate(dict.fromkeys([*_FIRST, *(m.sensor for m in out)]))}
    terms = {key: k for k, key in enumerate(dict.fromkeys((m.sensor, m.term) for m in out))}
    return sorted(out, key=lambda m: (first[m.sensor], terms[m.sensor, m.term]))


def runs(keys: Sequence[object]) -> list[tuple[int, int]]:
    """Stretches of equal keys: first, and one past the last."""
    edges = [0, *(i for i in range(1, len(keys)) if keys[i] != keys[i - 1]), len(keys)]
    return [(a, b) for a, b in pairwise(edges) if b > a]
