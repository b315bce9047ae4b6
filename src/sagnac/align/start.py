"""Where navigation can start from: the state and the biases that an alignment ends with."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..files import sha256
from ..frames import Array
from ..navigate.state import State
from .result import Alignment

if TYPE_CHECKING:
    from ..recording import Recording

_WANTED = ("latitude", "longitude", "height", "v_east", "v_north", "v_up", "heading", "pitch", "roll")


def state_of(found: Alignment, name: str = "alignment") -> State:
    """The state that an alignment ends with, at its time.

    Parameters
    ----------
    found : Alignment
    name : str
        For the message.

    Raises
    ------
    InputError
        When it does not say where the unit was.
    """
    known = {v.name: v.value for v in (*found.place, *found.attitude)}
    missing = [n for n in _WANTED if known.get(n) is None]
    if missing:
        raise InputError(f"{name}: navigation cannot start from it, it does not give {', '.join(missing)}")
    latitude, longitude, height, *velocity, heading, pitch, roll = (float(known[n] or 0.0) for n in _WANTED)
    return State.from_angles(latitude, longitude, height, np.array(velocity), (heading, pitch, roll))


def biases_of(found: Alignment) -> tuple[Array, Array]:
    """Biases of gyros and accelerometers, shape (3,) each, rad/s and m/s^2; zero for an axis without one."""
    known = {v.name: v.value for v in found.parameters}
    gyro, accel = (np.array([known.get(f"{s}.bias.{a}") or 0.0 for a in "xyz"]) for s in ("gyro", "accel"))
    return gyro, accel


def refuse_other_reading(found: Alignment, recording: Recording, name: str = "alignment") -> None:
    """Refuse a recording that is read otherwise than the one that the alignment was made of.

    Parameters
    ----------
    found : Alignment
    recording : Recording
        Of the same unit.
    name : str
        Of the alignment, for the message.

    Raises
    ------
    InputError
        When a column of the same name has another scale or unit, or an axis of the same file is another column.
    """
    known = {c.axis: c for c in found.columns}
    for axis, (column, factor) in recording.axes.items():
        then = known.get(axis)
        if then is None:
            continue
        if then.column == column and not math.isclose(then.factor, factor, rel_tol=1e-9):
            raise InputError(
                f"{recording.name}: the numbers of column {column!r} are multiplied by {factor:.9g}, those that {name} was made "
                f"of were by {then.factor:.9g}: give the same --scale and --units as to the alignment"
            )
        if then.column != column and sha256(str(recording.path)) in {s.sha256 for s in found.source}:
            raise InputError(
                f"{recording.name}: {axis} is column {column!r}; {name} was made of the same file with {then.column!r}: "
                "give the same --map as to the alignment"
            )
