"""What PX4 and ArduPilot share: an offset and a gain for each accelerometer, an offset alone for each gyro."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..frames import Array
from .canonical import Linear, best_diagonal
from .loss import Held


def offset_and_scale(triad: Linear) -> tuple[Array, Array]:
    """Offsets and gains of u' = s (y - o), each shape (3,).

    The offset is the bias, so that nothing is left at zero input; the gain leaves the least rms error over inputs of all
    directions. Gyros keep a gain of one.
    """
    gain = best_diagonal(triad.forward) if triad.kind == "accel" else np.ones(3)
    return triad.bias, gain


def held(triad: Linear) -> Held:
    """What the autopilot makes of a reading, also with the single precision of its parameters."""
    offset, gain = offset_and_scale(triad)
    stored = np.float32(offset).astype(float), np.float32(gain).astype(float)
    return Held(np.diag(gain), gain * offset, np.zeros((3, 3)), (np.diag(stored[1]), stored[1] * stored[0]))


def check_gain(triad: Linear, lowest: float, highest: float, why: str) -> None:
    """Refuse gains that the autopilot does not accept.

    Raises
    ------
    InputError
        With the axis.
    """
    for axis, gain in zip("xyz", offset_and_scale(triad)[1], strict=True):
        if not lowest <= np.float32(gain) <= highest:
            raise InputError(f"the gain of {triad.kind} {axis} would be {gain:.6g}; {why}")
