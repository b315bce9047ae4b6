"""The master's log in time: whether it is late, and whether it jumps where the slave feels nothing.

Over the master's sample intervals the slave's own rotation and change of velocity are known far better than a mounting of some
degrees or a bias could spoil, so that a sudden difference is the master's. A log that is late by T shows what was true T before:
the angles of both, summed up, differ by ``-T w``, which is seen wherever the rate w changes.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...frames import Array
from .windows import Apart, Intervals, apart, intervals

if TYPE_CHECKING:
    from ..config import Config
    from ..master import Master
    from ..samples import Slave

_STRETCH = 20.0  # s: drifts and tilts are a straight line over this time
_SURE = 5.0  # standard deviations
_SMALL = 0.01  # s: half a sample of many slaves; less is not spoken of
_FAR = 8.0  # times the median of all differences that a jump is; noise comes to 4 times
_JUMPS = {"velocity": (0.1, "m/s", 1.0), "attitude": (math.radians(0.3), "deg", 180.0 / math.pi)}
"""Least size spoken of, SI; unit it is told in, and its size."""


class Lateness(NamedTuple):
    """How much later than true the master's samples are stamped, s, and one sigma."""

    value: float
    sigma: float


def check(slave: Slave, master: Master, config: Config) -> tuple[float, list[str]]:
    """Refuse a master that is late by more than its noise hides, or that jumps.

    Parameters
    ----------
    slave : Slave
    master : Master
        With attitude.
    config : Config

    Returns
    -------
    late : float, s
        Lateness that the filter is to find as its delay; zero where it is not asked to.
    remarks : list of str
        What is worth a word.

    Raises
    ------
    DataError
        With the lateness, or with time and size of the jump.
    """
    given = intervals(slave, master, config.latency)
    if given.steps.size < 10:
        return 0.0, []
    found = apart(slave, given, master, config)
    late = lateness(given, found)
    said = _lateness_told(late, given, found, master, config) + _jumps(given, found, master, config, late)
    return (late.value if late is not None and config.initial.delay is not None else 0.0), said


def lateness(given: Intervals, found: Apart) -> Lateness | None:
    """Lateness of the master against the slave, by their angles.

    Parameters
    ----------
    given : Intervals
    found : Apart

    Returns
    -------
    Lateness or None
        None where the rate hardly changes.

    Notes
    -----
    Over stretches of some seconds, ``sum(slave - master) = c0 + c1 t + T w`` with the slave's rate w: least squares for T
    common to all, c0 and c1 of each stretch on its own. The uncertainty is from the scatter of the stretches.
    """
    parts = []
    for part in stretches(given):
        seen = _detrended(found.rate[part])
        summed = _detrended(np.cumsum(found.angle[part], axis=0))
        parts.append(
            (float((seen * seen).sum()), float((seen * summed).sum()), float((summed * summed).sum()), seen.size)
        )
    if not parts:
        return None
    own, both, rest, count = np.array(parts).T
    if own.sum() <= 1e-12:
        return None
    value = float(both.sum() / own.sum())
    scatter = float(np.sum((both - value * own) ** 2)) / own.sum() ** 2
    white = max(0.0, float(rest.sum() - value * both.sum())) / max(1.0, count.sum() - 3.0) / own.sum()
    return Lateness(value, math.sqrt(scatter + white))


def stretches(given: Intervals) -> list[slice]:
    """Runs of intervals without a gap, of about 20 s each.

    Parameters
    ----------
    given : Intervals
    """
    breaks = np.flatnonzero(np.diff(given.start) > given.steps[:-1] + 1e-6) + 1
    out = []
    for first, last in zip([0, *breaks.tolist()], [*breaks.tolist(), given.start.size], strict=True):
        size = max(8, round(_STRETCH / float(np.median(given.steps))))
        pieces = max(1, (last - first) // size)
        edges = np.linspace(first, last, pieces + 1).astype(int)
        out += [slice(a, b) for a, b in pairwise(edges.tolist()) if b - a >= 8]
    return out


def _detrended(values: Array) -> Array:
    """Values (n, 3) less their straight line."""
    t = np.linspace(-1.0, 1.0, len(values))[:, None]
    return np.asarray(values - values.mean(axis=0) - t * (t * values).sum(axis=0) / (t**2).sum())


def _lateness_told(late: Lateness | None, given: Intervals, found: Apart, master: Master, config: Config) -> list[str]:
    """Refuse a lateness that shows in the velocity; speak of a smaller one."""
    known = config.initial.delay
    if late is None or abs(late.value) < _SURE * late.sigma + _SMALL:
        return []
    which = "late" if late.value > 0 else "early"
    text = f"{master.name} is {which} by {abs(late.value):.3f} s against the slave (+- {late.sigma:.3f} s)"
    total = config.latency + late.value
    if known is not None:
        if abs(late.value) > _SURE * known:
            raise DataError(f'{text}, far beyond initial.delay; write latency = "{total:.3f} s"')
        return []
    moved = np.concatenate([_detrended(found.gained[s] / given.steps[s, None]) for s in stretches(given)])
    shown = abs(late.value) * float(np.sqrt((moved**2).sum(axis=1).mean()))
    rate = np.concatenate([_detrended(found.rate[s]) for s in stretches(given)])
    turned = abs(late.value) * float(np.sqrt((rate**2).sum(axis=1).mean()))
    attitude = config.noise.attitude if config.matches_attitude else None
    delay = max(0.01, 2.0 * abs(late.value))
    remedy = f'write latency = "{total:.3f} s", or have it estimated with initial.delay = "{delay:.2g} s"'
    if shown > config.noise.velocity or (attitude is not None and turned > attitude):
        raise DataError(f"{text}: {remedy}")
    return [f"{text}, which is not taken out; {remedy}"]


def _jumps(given: Intervals, found: Apart, master: Master, config: Config, late: Lateness | None) -> list[str]:
    """Steps of velocity and attitude that the slave does not feel; single samples that are off are left to the gate."""
    out = []
    # a master that is late by T shows a change of the rate of turn, or of the acceleration, as a step of T times as much
    behind = max(abs(late.value) if late is not None else 0.0, 3.0 * (config.initial.delay or 0.0))
    mounted = 4.0 * float(np.linalg.norm(config.initial.misalignment))
    for what, between, noise, moved in (
        ("velocity", found.velocity, config.noise.velocity, found.gained),
        ("attitude", found.angle, config.noise.attitude or 0.0, found.turned),
    ):
        least, unit, size_of = _JUMPS[what]
        size = np.linalg.norm(between - np.median(between, axis=0), axis=1)
        usual = float(np.median(size))
        allowed = np.maximum(
            max(_FAR * usual, 8.0 * math.sqrt(2.0) * noise, least), mounted * np.linalg.norm(moved, axis=1)
        )
        pace = moved / given.steps[:, None]
        change = np.linalg.norm(np.diff(pace, axis=0, prepend=0.0), axis=1)  # what was before the first is not known
        allowed = allowed + 2.0 * behind * _around(change, 1 + math.ceil(behind / float(np.median(given.steps))))
        far = np.flatnonzero(size > allowed)
        steps, spikes = _sorted(far, between, given)
        if spikes.size:
            shown = ", ".join(f"{given.start[i] + given.steps[i] + config.latency:.6g} s" for i in spikes[:5])
            out.append(
                f"{master.name}: {what} is off in single samples ({spikes.size}: {shown}{', ...' * (spikes.size > 5)})"
            )
        if steps.size:
            i = int(steps[np.argmax(size[steps])])
            at = f"at {given.start[i] + given.steps[i] + config.latency:.6g} s (row {given.number[i] + 2})"
            text = (
                f"{master.name}: its {what} jumps by {size[i] * size_of:.3g} {unit} {at}, where the slave feels nothing"
            )
            if what == "velocity" or config.matches_attitude:
                raise DataError(f"{text}: it was reset, or its log was joined from two; align on one side of it")
            out.append(text)
    return out


def _around(values: Array, reach: int) -> Array:
    """Largest of the values (n,) up to so many places away."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(values, 2 * reach + 1))


def _sorted(far: NDArray[np.int64], between: Array, given: Intervals) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the steps, and of the jumps that the next sample takes back."""
    steps, spikes = [], []
    skip = -1
    for i in far.tolist():
        if i == skip:
            continue
        back = i + 1 < given.number.size and given.number[i + 1] == given.number[i] + 1
        if back and np.linalg.norm(between[i] + between[i + 1]) < 0.3 * np.linalg.norm(between[i]):
            spikes.append(i)
            skip = i + 1
        else:
            steps.append(i)
    return np.array(steps, dtype=np.int64), np.array(spikes, dtype=np.int64)
