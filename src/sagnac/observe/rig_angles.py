"""What the rig itself recorded of its angles, held against the plan: a check, and used for nothing else.

The settings that a method knows the input from are those of the plan. A recording may carry the angles that the table shows
(columns ``outer``, ``middle``, ``inner``). Where they disagree with the plan, one of the two is wrong: positions in another
order, a sense, a unit, times. A disagreement far above the stated uncertainty of the settings is refused before anything is
calibrated, a smaller one is told; where the result hardly rests on the angles, the former is told too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frames import Array
from ..plan import Plan, Segment
from ..recording import Recording
from .lattice import common_step
from .rig_readings import TURN, RigReading

COLUMNS = ("outer", "middle", "inner")
"""Columns of a table's angles, from the base to the unit."""
_NOTED, _REFUSED = 4.0, 10.0  # times the stated uncertainty of a setting, from which a disagreement is told or refused,
_LEAST_NOTED, _LEAST_REFUSED = math.radians(0.01), math.radians(0.2)  # and at least;
_PLAIN_NOTED, _PLAIN_REFUSED = math.radians(0.1), math.radians(1.0)  # where none is stated
_RATE_REFUSED = 0.02  # of the planned rate
_RATE_NOTED = 1e-4  # of it: clocks differ by as much
_LATE = 0.1  # s that the angle of a turning axis may be read late
_WHOLE = 0.01  # turns from a whole number of them, within which it does not matter where a turn begins
_AGREE = 2  # segments that show that the zero of an axis is another
_SEVERAL = 3  # different settings that show a sense
_SHARE = 0.03  # of the samples of a segment, from which it counts that they are elsewhere
_COARSEST = math.radians(1.0)  # step of a column that explains a difference
_PLACES = 100.0  # in which settings can stand between two steps
_OUTSTANDING = 10.0  # times the refusing limit that settings must reach to show a unit
_SHOWN = 3  # turning segments told of, at most
_DEGREE = math.pi / 180.0


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
        calm = _limits(plan)[0]
        self._readings: dict[tuple[int, int], RigReading] = {
            (i, k): RigReading(s.start, angle, s.rates[k], calm)
            for k, column in enumerate(here)
            for i, s in enumerate(plan.segment)
            if column in recording.rig and (angle := getattr(s, column)) is not None
        }
        self._of_segment: dict[int, list[tuple[str, RigReading]]] = {}
        for (i, k), reading in self._readings.items():
            self._of_segment.setdefault(i, []).append((COLUMNS[k], reading))
        self._starts, self._stops = (np.array([getattr(s, end) for s in plan.segment]) for end in ("start", "stop"))

    def add(self, time: Array, rig: Mapping[str, Array]) -> None:
        """Take in the next samples.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        rig : mapping of str to ndarray, shape (n,), rad
            See :class:`sagnac.recording.Batch`.
        """
        if not self._of_segment:
            return
        begin, end = np.searchsorted(time, self._starts), np.searchsorted(time, self._stops)
        for i in np.flatnonzero(end > begin).tolist():
            part = slice(begin[i], end[i])
            for column, reading in self._of_segment.get(i, ()):
                reading.add(time[part], rig[column][part])

    def remarks(self, *, tell: bool = False) -> list[str]:
        """Words on what disagrees by little.

        Parameters
        ----------
        tell : bool
            Angles far from the plan's are told as well, as by a method whose result hardly rests on them.

        Raises
        ------
        DataError
            When a disagreement is far above what the settings are trusted to, naming the segment, both angles and what would
            explain it. Of rates, and of axes that do not rest where they should, in any case.
        """
        seen = {at: reading for at, reading in self._readings.items() if reading.count}
        if not seen:
            return []
        found = _Compared(self._plan, seen)
        found.refuse_rates()
        said = found.zeros()
        wrong = found.wrong_angles()
        if wrong is None:
            return [*said, *found.small()]
        text, moves = wrong
        if moves or not tell:
            raise DataError(
                f"{text}. Correct the plan or the columns of {self._name}, which serve this comparison alone"
            )
        told = (
            f"{text}. Told only, as what follows hardly rests on the angles; what does (rig.mount, rig.tilt) is no better than "
            "they are. Correct the plan, or state rig.angle_uncertainty"
        )
        return [*said, told, *found.restless(), *found.turning()]


def _limits(plan: Plan) -> tuple[float, float]:
    """Differences of a setting from which it is told and refused, rad."""
    sigma = plan.rig.angle_uncertainty
    if not sigma > 0:
        return _PLAIN_NOTED, _PLAIN_REFUSED
    return max(_NOTED * sigma, _LEAST_NOTED), max(_REFUSED * sigma, _LEAST_REFUSED)


class _Compared:
    """All readings of a recording beside the plan's."""

    def __init__(self, plan: Plan, lines: Mapping[tuple[int, int], RigReading]) -> None:
        self.plan, self.lines = plan, lines
        own = list(plan.rig.axes)
        self.names = [n if n == c else f"{n} (column {c})" for n, c in zip(own, COLUMNS, strict=False)]
        self.step = np.array([self._step(k) for k in range(len(COLUMNS))])
        noted, refused = _limits(plan)
        self.noted, self.refused = noted + self.step / 2.0, refused + self.step / 2.0
        n = len(plan.segment), len(COLUMNS)
        self.planned, self.read, self.off = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
        for (i, k), line in lines.items():
            if not line.rate:  # of an axis that stands
                rests = line.away(self.refused[k]) <= _SHARE
                off = line.off if rests else line.mean
                self.planned[i, k], self.read[i, k] = line.angle, line.angle + off
                self.off[i, k] = _less_turns(off)
        self.zero = np.zeros(len(COLUMNS))

    def _step(self, k: int) -> float:
        """Step of a column, zero where settings on another raster do not show that it rounds."""
        here = [line for (_, j), line in self.lines.items() if j == k]
        step = common_step(np.array([line.first for line in here]))
        if not 0 < step <= _COARSEST:
            return 0.0
        raster = np.array([line.angle for line in here]) / step
        alike = np.unique(np.round((raster % 1.0) * _PLACES) % _PLACES, return_counts=True)[1]
        return step if alike.max() <= len(here) / 2 else 0.0

    def segment(self, i: int) -> Segment:
        return self.plan.segment[i]

    def refuse_rates(self) -> None:
        """Refuse axes that turn at another rate than the plan's."""
        for (i, k), line in self.lines.items():
            rate, s = line.rate, self.segment(i)
            # a column tells no rate better than its angles over the length of the segment
            limit = _RATE_REFUSED * abs(rate) + self.refused[k] / (s.stop - s.start)
            if rate and abs(line.rate_off) > limit:
                seen = rate + line.rate_off
                cause = (
                    "the sense of the rate, or of the column, is reversed"
                    if abs(seen + rate) < limit
                    else "the rate or the segment's times are wrong"
                )
                raise DataError(
                    f"segment {s.name!r}: the plan turns {self.names[k]} at {rate / _DEGREE:.6g} deg/s, the rig "
                    f"recorded {seen / _DEGREE:.6g} deg/s: {cause}. Correct the plan or the column"
                )

    def zeros(self) -> list[str]:
        """Words on axes that read more than the plan by one and the same angle throughout, which is taken off them."""
        out = []
        for k in range(len(COLUMNS)):
            known = np.flatnonzero(np.isfinite(self.off[:, k]))
            off = self.off[known, k]
            found = _common(off, 2.0 * self.noted[k], self.noted[k]) or _common(off, self.refused[k], self.refused[k])
            if found is None:
                continue
            zero, alike = found
            self.zero[k] = zero
            self.off[known, k] = _wrapped(off - zero)
            planned = self.planned[known, k]
            still = np.abs(_wrapped(planned - planned[0])).max() < self.noted[k]
            out.append(
                f"{self.names[k]} as the rig recorded it is {_deg(zero)} more than the plan says, in "
                f"{'all' if alike == known.size else alike} segments: the column counts from another zero, or the "
                f"plan's angles do; the plan's are used{self._untold(k) if still else ''}"
            )
        return out

    def _untold(self, k: int) -> str:
        return (
            f". Make sure of it: the plan never sets {self.names[k]} to another angle, so nothing tells another zero from a "
            f"unit that stood {_deg(float(self.zero[k]))} from where the plan has it, and then all that rests on the angles is "
            "wrong by as much"
        )

    def wrong_angles(self) -> tuple[str, bool] | None:
        """Words on standing axes that stand elsewhere, and whether they move; None where there is none."""
        bad = np.abs(self.off) > self.refused
        if not bad.any():
            return None
        moves = self._moves(bad)
        finds = (self._unit, self._sense, self._axes)
        cause = next(filter(None, (find(bad) for find in finds)), "") or moves or self._order(bad)
        i, k = (int(v) for v in np.unravel_index(np.nanargmax(np.where(bad, np.abs(self.off), np.nan)), bad.shape))
        others = int(bad.any(axis=1).sum()) - 1
        more = (
            f" ({others} more segment{'s' if others > 1 else ''} disagree{'s' if others == 1 else ''})"
            if others
            else ""
        )
        text = (
            f"segment {self.segment(i).name!r}: the plan says {self.names[k]} {_deg(self.planned[i, k])}, the rig recorded "
            f"{_deg(self.read[i, k])}{more}: {cause}"
        )
        return text, bool(moves)

    def _unit(self, _: NDArray[np.bool_]) -> str:
        """Whether all readings are degrees for radians, or the other way round."""
        if np.nanmax(np.abs(self.planned) / self.refused) < _OUTSTANDING:
            return ""  # of angles near zero nothing is seen
        for ratio, words in ((1.0 / _DEGREE, "deg but are taken as rad"), (_DEGREE, "rad but are taken as deg")):
            left = self.read - ratio * self.planned
            if np.nanmax(np.abs(_wrapped(left / ratio)) / self.refused) < 1.0:
                return f"the numbers of the columns look like {words}: check their unit"
        return ""

    def _sense(self, bad: NDArray[np.bool_]) -> str:
        """Whether axes count the other way, be it from another zero."""
        words = [self._reversed(int(k)) for k in np.flatnonzero(bad.any(axis=0))]
        return ", ".join(words) if all(words) else ""

    def _reversed(self, k: int) -> str:
        known = np.isfinite(self.off[:, k])
        other = _wrapped(self.read[known, k] + self.planned[known, k])
        text = f"{self.names[k]} counts the other way in the plan than in its column"
        if np.abs(other).max() < self.refused[k]:
            return text
        found = _common(other, self.refused[k], self.refused[k])
        settings = np.unique(np.round(_wrapped(self.planned[known, k]) / self.refused[k]))
        if found is None or found[1] < other.size or settings.size < _SEVERAL:
            return ""
        return f"{text}, and from another zero ({_deg(found[0])})"

    def _axes(self, bad: NDArray[np.bool_]) -> str:
        """Whether two axes are exchanged."""
        wrong = np.flatnonzero(bad.any(axis=0))
        if wrong.size != 2:
            return ""
        a, b = wrong
        crossed = np.abs(_wrapped(self.read[:, [a, b]] - self.planned[:, [b, a]]))
        if not np.nanmax(crossed / self.refused[[a, b]]) < 1.0:
            return ""
        return f"{self.names[a]} and {self.names[b]} are exchanged"

    def _moves(self, bad: NDArray[np.bool_]) -> str:
        """Whether the axes move within the segments that disagree."""
        for i, k in np.argwhere(bad).tolist():
            line = self.lines[i, k]
            share = line.away(self.refused[k])
            if share <= _SHARE:
                continue
            low, high = line.extent
            name = repr(self.segment(i).name)
            why = (
                "its start and stop lie beside its rest"
                if line.moves_at_ends(self.refused[k])
                else f"it moved, or {100.0 * share:.2g} % of the column is wrong"
            )
            return f"{self.names[k]} goes from {_deg(line.angle + low)} to {_deg(line.angle + high)} within segment {name}: {why}"
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
        near = bool(np.all(apart[known] < self.refused[known]))
        return near and bool(known.any()) and known.sum() == np.isfinite(self.off[i]).sum()

    def _stood_as(self, i: int) -> int | None:
        """The nearest other segment whose plan fits what was recorded in this one."""
        fitting = [j for j in range(len(self.off)) if j != i and self._places(i, j)]
        back = [j for j in fitting if self._places(j, i)]
        return min(back or fitting, key=lambda j: abs(j - i), default=None)

    def small(self) -> list[str]:
        """Words on what disagrees by less."""
        out = []
        times = np.abs(self.off) / self.noted
        if np.nanmax(times, initial=0.0) > 1.0:
            i, k = (int(v) for v in np.unravel_index(np.nanargmax(times), times.shape))
            out.append(
                f"the angles that the rig recorded differ from the plan's by up to {_deg(abs(float(self.off[i, k])))} "
                f"({self.names[k]} in segment {self.segment(i).name!r}): state rig.angle_uncertainty so, or correct the plan; "
                "the plan's are used"
            )
        return [*out, *self.restless(), *self.turning()]

    def restless(self) -> list[str]:
        """Words on axes that move a little, and on samples that stand out."""
        moving = [self._moving(i, k, line) for (i, k), line in self.lines.items() if not line.rate]
        strays = [self._stray(i, k, line) for (i, k), line in self.lines.items() if not line.rate]
        out = [text for text in moving if text][:1]
        bad = [text for text in strays if text]
        if bad:
            more = f" ({len(bad) - 1} more segments with such)" if len(bad) > 1 else ""
            out.append(f"{bad[0]}{more}")
        return out

    def _moving(self, i: int, k: int, line: RigReading) -> str:
        low, high = line.extent
        if not line.moves_at_ends(self.refused[k]):
            return ""
        return (
            f"{self.names[k]} moves by {_deg(high - low)} within segment {self.segment(i).name!r}, which is said to stand: "
            "check its start and stop"
        )

    def _stray(self, i: int, k: int, line: RigReading) -> str:
        stray = line.stray
        if abs(stray.off) < self.refused[k] or line.moves_at_ends(self.refused[k]):
            return ""
        return (
            f"{self.names[k]} as the rig recorded it jumps in segment {self.segment(i).name!r}: {_deg(stray.shown)} at "
            f"{stray.time:.10g} s, {_deg(abs(stray.off))} from where it stands; such samples are left out of the comparison"
        )

    def turning(self) -> list[str]:
        """Words on axes that turn."""
        out = [self._turned(i, k, line) for (i, k), line in self.lines.items() if line.rate]
        return [text for text in out if text][:_SHOWN]

    def _turned(self, i: int, k: int, line: RigReading) -> str:
        """Words on an axis that turns: its rate, or where it was at the start of a turn that is not whole."""
        s = self.segment(i)
        length = s.stop - s.start
        slow = max(_NOTED * self.plan.rig.rate_uncertainty, _RATE_NOTED) * abs(line.rate) + self.noted[k] / length
        if line.changes and abs(line.rate_off) > slow:
            return (
                f"segment {s.name!r}: the rig recorded {self.names[k]} turning at {(line.rate + line.rate_off) / _DEGREE:.7g} "
                f"deg/s, the plan says {line.rate / _DEGREE:.7g} deg/s; the plan's is used"
            )
        turns = line.rate * length / TURN
        off = _less_turns(line.off - float(self.zero[k]))
        if abs(turns - round(turns)) < _WHOLE or abs(off) < self.refused[k] + _LATE * abs(line.rate):
            return ""
        return (
            f"segment {s.name!r}: the rig recorded {self.names[k]} {_deg(off)} from where the plan has it, which matters as the "
            "segment is no whole number of turns; the plan's angle is used"
        )


def _common(off: Array, alike: float, least: float) -> tuple[float, int] | None:
    """Angle that most differences share to within some, where it is more than the least, and how many they are."""
    if off.size < _AGREE:
        return None
    order = np.sort(np.concatenate([off - TURN, off, off + TURN]))
    usual = off[np.argmax(np.searchsorted(order, off + alike) - np.searchsorted(order, off - alike, side="right"))]
    apart = _wrapped(off - usual)
    near = np.abs(apart) < alike
    zero = _less_turns(float(usual + np.median(apart[near])))
    return (zero, int(near.sum())) if near.sum() > off.size / 2 and abs(zero) >= least else None


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
    return np.asarray(angle - TURN * np.round(angle / TURN))


def _less_turns(angle: float) -> float:
    return math.remainder(angle, TURN)


def _deg(angle: float) -> str:
    return f"{angle / _DEGREE:.6g} deg"
