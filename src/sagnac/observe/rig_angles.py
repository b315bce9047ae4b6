"""What the rig itself recorded of its angles, held against the plan: a check, and used for nothing else.

The settings that a method knows the input from are those of the plan. A recording may carry the angles that the table shows
(columns ``outer``, ``middle``, ``inner``). Where they disagree with the plan, one of the two is wrong: positions in another
order, a sense, a unit, times. A disagreement far above the stated uncertainty of the settings is refused before anything is
calibrated, a smaller one is told.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frames import Array
from ..plan import Plan, Segment
from ..recording import Recording

COLUMNS = ("outer", "middle", "inner")
"""Columns of a table's angles, from the base to the unit."""
_NOTED, _REFUSED = 4.0, 10.0  # times the stated uncertainty of a setting, from which a disagreement is told or refused,
_LEAST_NOTED, _LEAST_REFUSED = math.radians(0.01), math.radians(0.2)  # and at least;
_PLAIN_NOTED, _PLAIN_REFUSED = math.radians(0.1), math.radians(1.0)  # where none is stated
_RATE_REFUSED = 0.02  # of the planned rate
_RATE_NOTED = 1e-4  # of it: clocks differ by as much
_LATE = 0.1  # s that the angle of a turning axis may be read late
_WHOLE = 0.01  # turns from a whole number of them, within which it does not matter where a turn begins
_FEWEST = 3  # segments that show that the zero of an axis is another
_TURN = 2.0 * math.pi
_DEGREE = math.pi / 180.0


@dataclass
class _Line:
    """Difference of one recorded angle from the plan's over one segment, unwrapped: its line, and how far it moves."""

    start: float
    angle: float
    rate: float
    count: int = 0
    sums: Array = field(default_factory=lambda: np.zeros(4))
    first: float = 0.0
    low: float = math.inf
    high: float = -math.inf
    _last: float = 0.0

    def add(self, time: Array, angle: Array) -> None:
        """Take in the next samples (s, rad); the angle may jump by whole turns."""
        if self.count == 0:
            self.first = self._last = float(angle[0] - self.angle - self.rate * (time[0] - self.start))
        x = time - self.start
        e = angle - self.angle - self.rate * x
        e = np.unwrap(np.concatenate([[self._last], e]))[1:]
        self.count, self._last = self.count + x.size, float(e[-1])
        self.low, self.high = min(self.low, float(e.min())), max(self.high, float(e.max()))
        e = e - self.first
        self.sums += [x.sum(), e.sum(), (x * x).sum(), (x * e).sum()]

    @property
    def off(self) -> float:
        """Mean difference, rad, as it was read: whole turns are left in."""
        return float(self.first + self.sums[1] / self.count)

    @property
    def rate_off(self) -> float:
        """Slope of the difference, rad/s; zero where the samples do not tell."""
        x, e, xx, xe = self.sums / self.count
        spread = xx - x * x
        return float((xe - x * e) / spread) if spread > 0 else 0.0


class RigAngles:
    """Recorded angles of a table beside those of a plan; samples are taken in by :meth:`add`, :meth:`remarks` is the verdict.

    Parameters
    ----------
    recording : Recording
        With or without columns of angles.
    plan : Plan
        Segments that give no angle of an axis are left out for that axis.
    """

    def __init__(self, recording: Recording, plan: Plan) -> None:
        self._name, self._plan = recording.name, plan
        here = COLUMNS[: len(plan.rig.axes)] if plan.rig.kind == "turntable" else ()
        self._lines: dict[tuple[int, int], _Line] = {
            (i, k): _Line(s.start, angle, s.rates[k])
            for k, column in enumerate(here)
            for i, s in enumerate(plan.segment)
            if column in recording.rig and (angle := getattr(s, column)) is not None
        }

    def add(self, time: Array, rig: Mapping[str, Array]) -> None:
        """Take in the next samples.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        rig : mapping of str to ndarray, shape (n,), rad
            See :class:`sagnac.recording.Batch`.
        """
        for (i, k), line in self._lines.items():
            s = self._plan.segment[i]
            a, b = np.searchsorted(time, [s.start, s.stop])
            if b > a:
                line.add(time[a:b], rig[COLUMNS[k]][a:b])

    def remarks(self) -> list[str]:
        """Words on what disagrees by little.

        Raises
        ------
        DataError
            When a disagreement is far above what the settings are trusted to, naming the segment, both angles and what would
            explain it.
        """
        seen = {at: line for at, line in self._lines.items() if line.count}
        if not seen:
            return []
        found = _Compared(self._plan, seen)
        found.refuse_rates()
        said = found.zeros()
        found.refuse_angles(self._name)
        return [*said, *found.small()]


class _Compared:
    """All readings of a recording beside the plan's."""

    def __init__(self, plan: Plan, lines: Mapping[tuple[int, int], _Line]) -> None:
        sigma = plan.rig.angle_uncertainty
        self.noted = max(_NOTED * sigma, _LEAST_NOTED) if sigma > 0 else _PLAIN_NOTED
        self.refused = max(_REFUSED * sigma, _LEAST_REFUSED) if sigma > 0 else _PLAIN_REFUSED
        self.plan, self.lines = plan, lines
        own = list(plan.rig.axes)
        self.names = [n if n == c else f"{n} (column {c})" for n, c in zip(own, COLUMNS, strict=False)]
        n = len(plan.segment), len(COLUMNS)
        self.planned, self.read, self.off = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
        for (i, k), line in lines.items():
            if not plan.segment[i].rates[k]:  # of an axis that stands
                self.planned[i, k], self.read[i, k] = line.angle, line.angle + line.off
                self.off[i, k] = _less_turns(line.off)
        self.zero = np.zeros(len(COLUMNS))

    def segment(self, i: int) -> Segment:
        return self.plan.segment[i]

    def refuse_rates(self) -> None:
        """Refuse axes that turn at another rate than the plan's."""
        for (i, k), line in self.lines.items():
            rate = line.rate
            if rate and abs(line.rate_off) > _RATE_REFUSED * abs(rate):
                seen = rate + line.rate_off
                cause = (
                    "the sense of the rate, or of the column, is reversed"
                    if abs(seen + rate) < _RATE_REFUSED * abs(rate)
                    else "the rate or the segment's times are wrong"
                )
                raise DataError(
                    f"segment {self.segment(i).name!r}: the plan turns {self.names[k]} at {rate / _DEGREE:.6g} deg/s, the rig "
                    f"recorded {seen / _DEGREE:.6g} deg/s: {cause}. Correct the plan or the column"
                )

    def zeros(self) -> list[str]:
        """Words on axes that read more than the plan by one and the same angle throughout, which is taken off them."""
        out = []
        for k in range(len(COLUMNS)):
            known = np.flatnonzero(np.isfinite(self.off[:, k]))
            if known.size < _FEWEST:
                continue
            off = self.off[known, k]
            alike = np.abs(_wrapped(off[:, None] - off)) < 2.0 * self.noted
            usual = int(np.argmax(alike.sum(axis=1)))
            zero = float(off[usual] + np.mean(_wrapped(off[alike[usual]] - off[usual])))
            if alike[usual].sum() <= known.size / 2 or abs(zero) < self.noted:
                continue
            self.zero[k] = zero
            self.off[known, k] = _wrapped(off - zero)
            out.append(
                f"{self.names[k]} as the rig recorded it is {_deg(zero)} more than the plan says, in "
                f"{'all' if alike[usual].all() else alike[usual].sum()} segments: the column counts from another zero, or the "
                "plan's angles do; the plan's are used"
            )
        return out

    def refuse_angles(self, name: str) -> None:
        """Refuse standing axes that stand elsewhere."""
        bad = np.abs(self.off) > self.refused
        if not bad.any():
            return
        cause = next(
            filter(None, (find(bad) for find in (self._unit, self._sense, self._axes, self._moves, self._order)))
        )
        i, k = (int(v) for v in np.unravel_index(np.nanargmax(np.where(bad, np.abs(self.off), np.nan)), bad.shape))
        others = int(bad.any(axis=1).sum()) - 1
        more = (
            f" ({others} more segment{'s' if others > 1 else ''} disagree{'s' if others == 1 else ''})"
            if others
            else ""
        )
        raise DataError(
            f"segment {self.segment(i).name!r}: the plan says {self.names[k]} {_deg(self.planned[i, k])}, the rig recorded "
            f"{_deg(self.read[i, k])}{more}: {cause}. Correct the plan or the columns of {name}, "
            "which serve this comparison alone"
        )

    def _unit(self, _: NDArray[np.bool_]) -> str:
        """Whether all readings are degrees for radians, or the other way round."""
        for ratio, words in ((1.0 / _DEGREE, "deg but are taken as rad"), (_DEGREE, "rad but are taken as deg")):
            left = self.read - ratio * self.planned
            if np.nanmax(np.abs(_wrapped(left / ratio))) < self.refused:
                return f"the numbers of the columns look like {words}: check their unit"
        return ""

    def _sense(self, bad: NDArray[np.bool_]) -> str:
        """Whether axes count the other way."""
        wrong = np.flatnonzero(bad.any(axis=0))
        other = np.abs(_wrapped(self.read + self.planned))[:, wrong]
        if np.nanmax(other) > self.refused:
            return ""
        return ", ".join(f"{self.names[k]} counts the other way in the plan than in its column" for k in wrong)

    def _axes(self, bad: NDArray[np.bool_]) -> str:
        """Whether two axes are exchanged."""
        wrong = np.flatnonzero(bad.any(axis=0))
        if wrong.size != 2:
            return ""
        a, b = wrong
        crossed = np.abs(_wrapped(self.read[:, [a, b]] - self.planned[:, [b, a]]))
        if not np.nanmax(crossed) < self.refused:
            return ""
        return f"{self.names[a]} and {self.names[b]} are exchanged"

    def _moves(self, bad: NDArray[np.bool_]) -> str:
        """Whether the axes move within the segments that disagree."""
        for i, k in np.argwhere(bad).tolist():
            line = self.lines[i, k]
            if line.high - line.low > self.refused:
                return (
                    f"{self.names[k]} goes from {_deg(line.angle + line.low)} to {_deg(line.angle + line.high)} within segment "
                    f"{self.segment(i).name!r}: its start and stop lie beside its rest"
                )
        return ""

    def _order(self, bad: NDArray[np.bool_]) -> str:
        """Which other segment each of those that disagree stood as."""
        at = np.flatnonzero(bad.any(axis=1)).tolist()
        stood = {i: self._stood_as(i) for i in at}
        like = {i: j for i, j in stood.items() if j is not None}
        named = {i: repr(self.segment(i).name) for i in {*like, *like.values()}}
        pair = next(((i, j) for i, j in like.items() if like.get(j) == i), None)
        for step, words in ((1, "ahead of"), (-1, "behind")):
            inside = [i for i in at if 0 <= i + step < len(self.off)]
            if len(inside) > 2 and len(inside) >= len(at) - 1 and all(self._places(i, i + step) for i in inside):
                name = repr(self.segment(at[0]).name)
                return f"from segment {name} on the rig stood one position {words} the plan: one is missing or listed twice"
        if pair is not None:
            return f"segments {named[pair[0]]} and {named[pair[1]]} are exchanged"
        if like:
            i, j = next(iter(like.items()))
            return f"in segment {named[i]} the rig stood as segment {named[j]} says: the positions are in another order"
        return "the position was not the planned one, or its angles are mistyped"

    def _places(self, i: int, j: int) -> bool:
        """Whether what was recorded in one segment is what the plan says of another."""
        apart = np.abs(_wrapped(self.read[i] - self.zero - self.planned[j]))
        known = np.isfinite(apart)
        return bool(known.any() and known.sum() == np.isfinite(self.off[i]).sum() and apart[known].max() < self.refused)

    def _stood_as(self, i: int) -> int | None:
        """The nearest other segment whose plan fits what was recorded in this one."""
        fitting = [j for j in range(len(self.off)) if j != i and self._places(i, j)]
        back = [j for j in fitting if self._places(j, i)]
        return min(back or fitting, key=lambda j: abs(j - i), default=None)

    def small(self) -> list[str]:
        """Words on what disagrees by less."""
        out = []
        size = np.abs(self.off)
        if np.nanmax(size, initial=0.0) > self.noted:
            i, k = (int(v) for v in np.unravel_index(np.nanargmax(size), size.shape))
            out.append(
                f"the angles that the rig recorded differ from the plan's by up to {_deg(float(size[i, k]))} ({self.names[k]} in "
                f"segment {self.segment(i).name!r}): state rig.angle_uncertainty so, or correct the plan; the plan's are used"
            )
        out += self._moving()
        turning = [self._turned(i, k, line) for (i, k), line in self.lines.items() if line.rate]
        return out + [text for text in turning if text][:_FEWEST]

    def _moving(self) -> list[str]:
        for (i, k), line in self.lines.items():
            if not line.rate and line.high - line.low > self.refused:
                text = (
                    f"{self.names[k]} moves by {_deg(line.high - line.low)} within segment {self.segment(i).name!r}, which is "
                    "said to stand: check its start and stop"
                )
                return [text]
        return []

    def _turned(self, i: int, k: int, line: _Line) -> str:
        """Words on an axis that turns: its rate, or where it was at the start of a turn that is not whole."""
        s = self.segment(i)
        length = s.stop - s.start
        slow = max(_NOTED * self.plan.rig.rate_uncertainty, _RATE_NOTED) * abs(line.rate) + self.noted / length
        if abs(line.rate_off) > slow:
            return (
                f"segment {s.name!r}: the rig recorded {self.names[k]} turning at {(line.rate + line.rate_off) / _DEGREE:.7g} "
                f"deg/s, the plan says {line.rate / _DEGREE:.7g} deg/s; the plan's is used"
            )
        turns = line.rate * length / _TURN
        off = _less_turns(line.off - float(self.zero[k]))
        if abs(turns - round(turns)) < _WHOLE or abs(off) < self.refused + _LATE * abs(line.rate):
            return ""
        return (
            f"segment {s.name!r}: the rig recorded {self.names[k]} {_deg(off)} from where the plan has it, which matters as the "
            "segment is no whole number of turns; the plan's angle is used"
        )


def arm_remarks(
    segments: Sequence[Segment], angle: Array, time: Array, rate: Array, known: NDArray[np.bool_], uncertainty: float
) -> list[str]:
    """Angle of a centrifuge's arm by its column against the plan's ``arm_phase``.

    Parameters
    ----------
    segments : sequence of Segment
    angle, time, rate : ndarray, shape (n,)
        Angle of the column at some time of each segment and its rate, rad, s and rad/s.
    known : ndarray of bool, shape (n,)
        Where there is a column.
    uncertainty : float, rad
        Of ``arm_phase`` as the plan states it; zero where it does not.

    Returns
    -------
    list of str
        Words on a disagreement that is no more than the column being read late.

    Raises
    ------
    DataError
        When the two differ by more.
    """
    worst = (0.0, "")
    least = max(_NOTED * uncertainty, _PLAIN_NOTED)
    for i, s in enumerate(segments):
        if s.arm_phase is None or not known[i]:
            continue
        at_start = _less_turns(float(angle[i] - rate[i] * (time[i] - s.start)))
        off = _less_turns(at_start - s.arm_phase)
        words = f"segment {s.name!r}: the column arm stands at {_deg(at_start)} at the start, the plan says {_deg(s.arm_phase)}"
        if abs(off) > max(_REFUSED * uncertainty, _PLAIN_REFUSED) + _LATE * abs(s.arm_rate):
            raise DataError(
                f"{words}: the angles count from different zeros (arm and arm_phase count from east, counter-clockwise), or the "
                "segment's start is not that of its turn. Correct arm_phase, or leave it out: the column tells"
            )
        if abs(off) > max(least, abs(worst[0])):
            worst = (off, words)
    return [f"{worst[1]}; the column is used"] if worst[1] else []


def _wrapped(angle: Array) -> Array:
    """Less whole turns, between minus and plus half a turn."""
    return np.asarray(angle - _TURN * np.round(angle / _TURN))


def _less_turns(angle: float) -> float:
    return math.remainder(angle, _TURN)


def _deg(angle: float) -> str:
    return f"{angle / _DEGREE:.6g} deg"
