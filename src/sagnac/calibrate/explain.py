"""What in the plan, read otherwise, would explain the data: angles of another axis, another order, a missing turn."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import AXES, Plan
from ..rigs.turntable import Letters, Site, mean_inputs
from ..sensors import signed_permutation
from . import common

Flags = NDArray[np.bool_]

_POOR = 0.02  # misfit relative to the input from which the plan is doubted,
_BEYOND = 4.0  # if it is also this many times what the table's uncertainty does
_BETTER = 0.25  # share of the misfit that another reading may leave
_GOOD = 0.05  # misfit above which no reading of a plan explains anything
_TURNS = 0.5  # share of the planned rate that a turning unit shows
_STANDS = 5.0  # times the usual reading at rest


@dataclass(frozen=True)
class _Reading:
    """One way to read the plan: order of the angle columns, their signs, what the axes turn about, rates reversed."""

    words: str
    columns: tuple[int, int, int] = (0, 1, 2)
    signs: tuple[int, int, int] = (1, 1, 1)
    letters: Letters | None = None
    reversed_segments: tuple[int, ...] = field(default=())


class _Fit(NamedTuple):
    """Rms misfit of a linear triad relative to its input, and the order and signs in which its axes come out."""

    misfit: float
    axes: tuple[int, int, int]
    signs: tuple[int, int, int]

    @property
    def in_order(self) -> bool:
        return self.axes == (0, 1, 2)

    @property
    def upright(self) -> bool:
        return self.signs == (1, 1, 1)

    @property
    def right_handed(self) -> bool:
        even = self.axes in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        return even == (self.signs.count(-1) % 2 == 0)


def _readings(plan: Plan, turning: Flags) -> list[_Reading]:
    """Other readings, the simplest first."""
    names = [*plan.rig.axes, *list(AXES)[len(plan.rig.axes) :]]
    out = []
    for i in range(3):
        signs = tuple(-1 if k == i else 1 for k in range(3))
        out.append(_Reading(f"{names[i]} has the other sign", signs=(signs[0], signs[1], signs[2])))
    for order in list(permutations(range(3)))[1:]:
        swapped = ", ".join(f"{names[i]} is {names[order[i]]}" for i in range(3) if order[i] != i)
        out.append(_Reading(f"angles are in another order ({swapped})", columns=(order[0], order[1], order[2])))
    for first, second, third in permutations(("x", "y", "z")):
        letters = (first, second, third)
        if letters != plan.rig.letters:
            axes = ", ".join(f"{n} about {a}" for n, a in zip(names, letters, strict=True))
            out.append(_Reading(f"the table's axes are in another order ({axes}; see rig.axes)", letters=letters))
    for segment in np.flatnonzero(turning).tolist():
        name = plan.segment[segment].name
        out.append(_Reading(f"segment {name!r} turned the other way", reversed_segments=(segment,)))
    return out


def refuse_other_reading(sensor: str, means: SegmentMeans, plan: Plan, site: Site) -> None:
    """Refuse a plan that does not explain the readings of a triad while another reading of it does.

    Parameters
    ----------
    sensor : str
        ``accel`` (static segments) or ``gyro`` (all segments).
    means : SegmentMeans
    plan : Plan
    site : Site

    Raises
    ------
    DataError
        Naming what is likely wrong in the plan.
    """
    if any(s.angles is None for s in means.segments):
        return
    rates = common.rates_of(means)
    turning: Flags = np.abs(rates).sum(axis=1) > 0
    used: Flags = ~turning if sensor == "accel" else np.ones_like(turning)
    if used.sum() < 5:  # fewer fit every plan
        return
    planned = _misfit(sensor, means, plan, site, _Reading(""), used)
    limit = max(_POOR, _BEYOND * plan.rig.angle_uncertainty)
    if not np.isfinite(planned.misfit):  # too few positions to tell; that is said elsewhere
        return
    mirrored = sensor == "accel" and planned.misfit < limit and _both_mirrored(planned, means, plan, site)
    if planned.misfit < limit and not mirrored:
        return
    others = [
        (reading, _misfit(sensor, means, plan, site, reading, used))
        for reading in _readings(plan, turning if sensor == "gyro" else np.zeros_like(turning))
    ]
    enough = limit if mirrored else min(max(_BETTER * planned.misfit, 0.25 * _POOR), max(limit, _GOOD))
    good = [
        (r, m.misfit) for r, m in others if m.misfit < enough and m.in_order and (m.upright or sensor in means.counts)
    ]
    if not good:
        return
    best = min(misfit for _, misfit in good)
    likely, left = next((r, misfit) for r, misfit in good if misfit <= 1.5 * best + 1e-6)
    wrong = (
        "both triads come out as in a mirror"
        if mirrored
        else f"the {sensor} readings do not fit the plan's angles and rates (misfit {100 * planned.misfit:.2g} % of the input)"
    )
    raise DataError(f"{wrong}; all fits ({100 * left:.2g} %) if {likely.words}. Correct the plan")


def _both_mirrored(planned: _Fit, means: SegmentMeans, plan: Plan, site: Site) -> bool:
    """Whether accelerometers and gyros come out as in one and the same mirror, as no mounting and no swapped plug does."""
    if planned.right_handed or not {"accel", "gyro"} <= set(means.mean) or not common.rates_of(means).any():
        return False
    every: Flags = np.ones(len(means.segments), dtype=np.bool_)
    gyro = _misfit("gyro", means, plan, site, _Reading(""), every)
    return gyro.axes == planned.axes and gyro.signs == planned.signs and gyro.misfit < _POOR


def _misfit(sensor: str, means: SegmentMeans, plan: Plan, site: Site, reading: _Reading, used: Flags) -> _Fit:
    """Linear fit of a triad to one reading of the plan."""
    settings = np.array([s.angles for s in means.segments], dtype=float)[:, reading.columns] * reading.signs
    rates = common.rates_of(means)
    signs = np.ones(len(rates))
    signs[list(reading.reversed_segments)] = -1.0
    rates = rates * signs[:, None]
    since = means.mid_time - np.array([s.start for s in means.segments])
    felt = mean_inputs(
        settings + rates * since[:, None],
        rates,
        common.left_of(means, rates),
        site,
        letters=reading.letters or plan.rig.letters,
        derivatives=False,
    )
    u = (felt.force if sensor == "accel" else felt.rate)[used]
    size = float(np.sqrt(np.mean(np.sum(u**2, axis=1))))
    design = np.column_stack([u / size, np.ones(len(u))])
    solution, _, rank, _ = np.linalg.lstsq(design, means.mean[sensor][used], rcond=1e-6)
    if rank < 4:
        return _Fit(np.inf, (0, 1, 2), (1, 1, 1))
    residual = means.mean[sensor][used] - design @ solution
    matrix = np.asarray(solution[:3].T / size, dtype=np.float64)
    gain = float(np.mean(np.linalg.norm(matrix, axis=1))) * size
    freedom = max(1.0 - 4.0 / len(u), 0.1)
    misfit = float(np.sqrt(np.mean(residual**2) / freedom)) / max(gain, 1e-300)
    return _Fit(misfit, *signed_permutation(matrix))


def refuse_missing_turns(means: SegmentMeans, rates: Array) -> None:
    """Refuse segments whose gyros contradict the plan about whether the table turns.

    Parameters
    ----------
    means : SegmentMeans
    rates : ndarray, shape (n, 3), rad/s

    Raises
    ------
    DataError
        Naming the segment: said to turn and at rest, or said to rest and turning.
    """
    if "gyro" not in means.mean:
        return
    planned = np.abs(rates.sum(axis=1))
    turning = planned > 0
    readings = means.mean["gyro"]
    rest = np.median(readings[~turning], axis=0) if (~turning).any() else np.zeros(3)
    seen = np.linalg.norm(readings - rest, axis=1)
    gain = float(np.median(seen[turning] / planned[turning])) if turning.any() else 1.0
    if gain <= 0.0:
        return
    unit = np.degrees(1.0 / gain)
    for i in np.flatnonzero(turning):
        if seen[i] < _TURNS * gain * planned[i]:
            raise DataError(
                f"segment {means.segments[i].name!r} is said to turn at {np.degrees(planned[i]):.4g} deg/s, but its gyros "
                f"see {seen[i] * unit:.2g} deg/s: the turn is missing, or the segment lies beside it. Check the plan's times "
                "and rates"
            )
    if not turning.any():
        return
    limit = _TURNS * gain * float(planned[turning].min())
    for i in np.flatnonzero(~turning):
        if seen[i] > max(limit, _STANDS * float(np.median(seen[~turning]))):
            raise DataError(
                f"segment {means.segments[i].name!r} is said to stand still, but its gyros see {seen[i] * unit:.2g} deg/s: a "
                "rate is missing in the plan, or the segment lies beside its rest"
            )
