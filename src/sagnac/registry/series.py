"""A history taken apart: one series a parameter of a unit, and what it shows before any model is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..frames import Array
from .drift import Histories
from .entries import History, Parameter
from .scatter import medians

STEP = 5.0
"""Joint standard uncertainties from which a change between two calibrations is called a step."""
_USUAL = 4
"""Changes from which the usual one of a parameter can be told."""
_NORMAL = 0.6745
"""Median of the size of a standard normal number."""
_TRIADS = "accel", "gyro"
_UPPER, _LOWER = ("xy", "xz", "yz"), ("yx", "zx", "zy")
"""Elements of a matrix that only a full one has, and that both have."""
_OF_THE_UNIT = ("rig.mount_", "rig.cone_")
"""What the roll-isolated method finds about the unit, for all that its names begin with rig."""


_FRAMES = ("", "the accelerometers' own frame", "the frame of the mounting faces", "the gyros' own frame")
"""That a misalignment is in; of all else none."""


@dataclass(frozen=True)
class Series:
    """One parameter of one unit, in the unit, the convention and the frame of its latest calibration.

    Attributes
    ----------
    item : int
        Number of the unit in the registry.
    parameter : Parameter
    time : ndarray, shape (n,)
        POSIX time, s, ascending.
    calibration : ndarray of int, shape (n,)
        Numbers in the registry.
    value, sigma : ndarray, shape (n,)
    frame : str
        Of a misalignment, in words; empty for all else.
    elsewhere : tuple of str
        What earlier calibrations gave in another unit, convention or frame, and how many times: these are not in the series.
    """

    item: int
    parameter: Parameter
    time: Array
    calibration: NDArray[np.int64]
    value: Array
    sigma: Array
    frame: str = ""
    elsewhere: tuple[str, ...] = ()


def taken_apart(history: History, since: float | None = None, frames: History | None = None) -> list[Series]:
    """All series of a history, in the order of units and parameters.

    Parameters
    ----------
    history : History
    since : float, optional
        POSIX time, s; earlier calibrations are left out.
    frames : History, optional
        With all misalignments of the same calibrations, where `history` has only some: which there are tells their frame.
    """
    time = history.time.astype("datetime64[us]").astype(np.int64) / 1e6
    code = _frames(history, frames or history)
    by = np.lexsort((code, history.parameter, history.item))  # stable: each by time and number as before
    by = by if since is None else by[time[by] >= since]
    item, index, time, code = history.item[by], history.parameter[by], time[by], code[by]
    if not time.size:
        return []
    number, value, sigma = history.calibration[by], history.value[by], history.standard_uncertainty[by]
    edges = np.flatnonzero((np.diff(item) != 0) | (np.diff(index) != 0) | (np.diff(code) != 0)) + 1
    found: dict[tuple[int, str], list[Series]] = {}
    for a, b in zip([0, *edges], [*edges, time.size], strict=True):
        name = history.parameters[index[a]]
        own = Series(int(item[a]), name, time[a:b], number[a:b], value[a:b], sigma[a:b], _FRAMES[code[a]])
        found.setdefault((own.item, own.parameter.name), []).append(own)
    return [_latest(forms) for forms in found.values()]


def _frames(history: History, every: History) -> NDArray[np.int64]:
    """Which of the :data:`_FRAMES` each value of a history is in.

    A full matrix of the accelerometers is in the frame of the mounting faces, a lower triangular one in their own, and a full one
    of the gyros in that of the accelerometers (:mod:`sagnac.registry.conventions` tells them apart by the same rule).
    """
    code = np.zeros(history.time.size, dtype=np.int64)
    if not every.time.size:
        return code
    first = int(every.calibration.min())
    upper = np.zeros((2, int(max(every.calibration.max(), history.calibration.max(initial=0))) - first + 1), dtype=bool)
    lower = upper.copy()
    for row, kind in enumerate(_TRIADS):
        for state, pairs in ((upper, _UPPER), (lower, _LOWER)):
            state[row, every.calibration[_of(every, {f"{kind}.misalignment.{p}" for p in pairs})] - first] = True
    own = lower[0] & ~upper[0]
    accel, gyro = (_of(history, {f"{kind}.misalignment.{p}" for p in (*_UPPER, *_LOWER)}) for kind in _TRIADS)
    at = history.calibration - first
    code[accel] = np.where(upper[0, at[accel]], 2, 1)
    code[gyro] = np.where(upper[1, at[gyro]], np.where(own[at[gyro]], 1, 2), 3)
    return code


def _of(history: History, names: set[str]) -> NDArray[np.bool_]:
    """Which values are those of some parameters, shape (n,)."""
    return np.array([p.name in names for p in history.parameters], dtype=bool)[history.parameter]


def _latest(forms: list[Series]) -> Series:
    """The form that the latest calibration has, with a word about the others."""
    if len(forms) == 1:
        return forms[0]
    last = max(forms, key=lambda s: (s.time[-1], s.calibration[-1]))
    return replace(last, elsewhere=tuple(_form(s, last) for s in forms if s is not last))


def _form(s: Series, last: Series) -> str:
    """What a form has that the latest one has not, in words."""
    one, other = s.parameter, last.parameter
    words = [f"in {one.unit}"] if one.unit != other.unit else []
    words += [f"as {one.misalignment}"] if one.misalignment != other.misalignment else []
    words += [f"in {s.frame}"] if s.frame != last.frame else []
    return f"{s.time.size} " + ", ".join(words)


def of_the_unit(name: str) -> bool:
    """Whether a parameter is that of a unit, and not of the rig or of how the unit was mounted on it."""
    return not name.startswith("rig.") or name.startswith(_OF_THE_UNIT)


def tells_drift(series: Series) -> bool:
    """Whether drift and scatter can be estimated: three calibrations, not all of one moment."""
    return bool(series.time.size > 2 and series.time[-1] > series.time[0])


def side_by_side(many: Sequence[Series]) -> Histories:
    """Series of any lengths as rows of arrays."""
    count = np.array([s.time.size for s in many])
    shape = len(many), int(count.max())
    real = np.arange(shape[1]) < count[:, None]
    time = np.repeat(np.array([s.time[-1] for s in many])[:, None], shape[1], axis=1)
    value, sigma = np.zeros(shape), np.full(shape, np.inf)
    time[real] = np.concatenate([s.time for s in many])
    value[real] = np.concatenate([s.value for s in many])
    sigma[real] = np.concatenate([s.sigma for s in many])
    return Histories(time, value, sigma)


@dataclass(frozen=True)
class Jump:
    """A change between two calibrations in a row that is larger than their uncertainties and the usual changes allow.

    Attributes
    ----------
    index : int
        Of the calibration after it.
    change, sigma : float
        Change and joint standard uncertainty.
    """

    index: int
    change: float
    sigma: float


def jumps(series: Series, k: float = STEP) -> list[Jump]:
    """Steps of a series.

    A step is a change, less what the usual drift makes of the time between, of more than `k` joint standard uncertainties and,
    where there are four changes or more, of more than `k` times the usual change of the parameter (the median): a parameter that
    always wanders by more than its uncertainties has no steps on that account.

    Parameters
    ----------
    series : Series
    k : float
    """
    if series.time.size < 2:
        return []
    change, between = np.diff(series.value), np.diff(series.time)
    sigma = np.hypot(series.sigma[1:], series.sigma[:-1])
    usual = np.zeros_like(change)
    several = change.size >= _USUAL
    if several and np.any(between > 0):
        rates = change[between > 0] / between[between > 0]
        slope = float(medians(rates[None], np.array([rates.size]))[0])
        usual = slope * between
    left = np.abs(change - usual)
    rounding = 1e-12 * np.maximum(np.abs(series.value[1:]), np.abs(series.value[:-1]))
    bound = np.maximum(sigma, rounding)
    with np.errstate(divide="ignore", invalid="ignore"):
        over = np.where(bound > 0, left / bound, np.where(left > 0, np.inf, 0.0))
    if several:
        over = over / max(1.0, float(np.sort(over)[(over.size - 1) // 2]) / _NORMAL)
    return [Jump(int(i) + 1, float(change[i]), float(sigma[i])) for i in np.flatnonzero(over > k)]
