"""Where navigation can start from: the state and the biases that an alignment ends with."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..frames import Array
from ..navigate.state import State
from .result import Alignment

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
