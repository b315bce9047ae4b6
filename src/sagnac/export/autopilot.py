"""What PX4 and ArduPilot share: an offset and a gain for each accelerometer, an offset alone for each gyro; their instances."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from ..calibration import Calibration
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


def instance(
    calibration: Calibration, log: str, given: int | None, first: int, named: Callable[[int], str]
) -> tuple[int, list[str]]:
    """Which of the autopilot's sensors to write for: that which is asked for, else that of the calibration's recording.

    Parameters
    ----------
    calibration : Calibration
    log : str
        Name of the format of the autopilot's logs, whose instances count from zero.
    given : int, optional
        As the user counts.
    first : int
        The first one as the user counts.
    named : callable
        The parameters of one, for remarks.

    Returns
    -------
    int
        As the user counts.
    list of str
        Remarks where the user may not expect it.
    """
    own = _origin(calibration, log)
    known = first if own is None else first + own
    number = known if given is None else given
    if own is None:
        text = f"the calibration does not tell which of the autopilot's sensors it is of; written are {named(number)}"
        return number, [] if given is not None else [f"{text}, of the first; --instance names another"]
    whose = f"the calibration is of instance {own} of the log"
    if given is None:
        return number, [f"{whose}: written are {named(number)} (--instance {number})"]
    if number != known:
        return number, [f"{whose}, --instance {known}, and --instance {number} asks for another: {named(number)}"]
    return number, []


def _origin(calibration: Calibration, log: str) -> int | None:
    """The instance whose samples went in, counted from zero; None when that is not known or not one."""
    recordings = [s for s in calibration.source if s.role == "recording"]
    chosen = {(s.select or "").rpartition("/")[2] if s.format == log else "" for s in recordings}
    number = chosen.pop() if len(chosen) == 1 else ""
    return int(number) if re.fullmatch("[0-9]{1,3}", number) else None
