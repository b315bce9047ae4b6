"""Time of the rows of an Xsens text export, from the columns that it happens to have."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ... import units
from ...errors import InputError
from ...frames import Array
from .xsens_marks import PACKET, TICKS

PACKETS = (PACKET, "Counter")  # the second in exports of old versions
_UTC = tuple(f"UTC_{part}" for part in ("Year", "Month", "Day", "Hour", "Minute", "Second", "Nano"))
_RATE = re.compile(r"//.*(?:update|sampl\w+)\s*rate\W*([0-9].*)", re.IGNORECASE)
_TICK = 1e-4  # s
_PERIOD = {TICKS: 2.0**32} | dict.fromkeys(PACKETS, 2.0**16)  # where the counters begin again


@dataclass(frozen=True)
class Clock:
    """Where the time comes from.

    Attributes
    ----------
    columns : tuple of str
        Those that are needed; none where the file has neither time nor packet counter.
    rate : float, Hz
        Packets per second by the comments, where the packet counter is all there is; 0 when they do not say.
    remarks : tuple of str
    """

    columns: tuple[str, ...]
    rate: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def timed(self) -> bool:
        """Whether it gives a time, not only the order of the packets."""
        return bool(self.columns) and (self.columns[0] not in PACKETS or self.rate > 0)


def chosen(path: Path, names: Sequence[str], first: Mapping[str, str], comments: Sequence[str]) -> Clock:
    """The best time that a file has.

    Parameters
    ----------
    path : Path
        For messages.
    names : sequence of str
        Its columns.
    first : mapping of str to str
        Its first row: columns stand there empty when the unit did not send them.
    comments : sequence of str
        Its comment lines.

    Raises
    ------
    InputError
        When the rate in the comments is needed and cannot be read.
    """

    def given(*columns: str) -> bool:
        return all(first.get(c, "").strip().lower() not in ("", "nan") for c in columns)

    if given(TICKS):
        return Clock((TICKS,))
    if given(*_UTC):
        year, month, day, hour, minute, second, _ = (first[c].strip() for c in _UTC)
        start = f"{year}-{month:0>2}-{day:0>2} {hour:0>2}:{minute:0>2}:{second:0>2} UTC"
        return Clock(_UTC, remarks=(f"time counted from the first sample, {start}",))
    packets = tuple(n for n in PACKETS if n in names)[:1]
    rate = _rate(path, comments) if packets else 0.0
    if rate:
        said = f"time from the packet counter and the rate in the comments, {rate:g} Hz; missing packets are gaps"
        return Clock(packets, rate, (said,))
    return Clock(packets)


def _rate(path: Path, comments: Sequence[str]) -> float:
    """Packets per second by the first comment line that says it; a number without unit is in Hz; 0 where none does."""
    for line in comments:
        if match := _RATE.match(line):
            text, what = match[1].strip(), f"{path}: comment line {line!r}"
            rate = units.parse(text if re.search(r"[A-Za-z]", text) else f"{text} Hz", "sample rate", what)
            if not 1e-6 < rate < 1e9:
                raise InputError(f"{what}: is no rate of packets")
            return rate
    return 0.0


class Counter:
    """Time of successive batches of rows: keeps what goes on from one to the next.

    Parameters
    ----------
    path : Path
    clock : Clock
    """

    def __init__(self, path: Path, clock: Clock) -> None:
        self._path, self._clock = path, clock
        self._last = self._turns = 0.0
        self._before: float | None = None
        self._row = 1
        self._origin: tuple[float, float] | None = None

    def seconds(self, columns: Mapping[str, Array]) -> Array:
        """Time in s of the next rows, given the columns that the clock needs.

        Raises
        ------
        InputError
            When packets are missing and nothing says when they came.
        """
        if self._clock.columns == _UTC:
            return self._utc(columns)
        (name, values), *_ = columns.items()
        count = self._unwrapped(values, _PERIOD[name])
        if name == TICKS:
            return count * _TICK
        if self._clock.rate:
            return count / self._clock.rate
        self._refuse_gaps(count)
        return count

    def _unwrapped(self, values: Array, period: float) -> Array:
        steps = np.diff(values, prepend=self._last)
        turns = self._turns + np.cumsum(steps < -period / 2)
        self._last, self._turns = float(values[-1]), float(turns[-1])
        return np.asarray(values + period * turns)

    def _refuse_gaps(self, count: Array) -> None:
        steps = np.diff(count, prepend=count[0] - 1 if self._before is None else self._before)
        jumps = np.flatnonzero(steps != 1)
        if jumps.size:
            raise InputError(
                f"{self._path}: row {self._row + jumps[0]}: the packet counter goes on by {steps[jumps[0]]:g} and nothing "
                "says when the packets came; put the line '// Update Rate: 100.0Hz' with their rate before the header"
            )
        self._before = float(count[-1])
        self._row += count.size

    def _utc(self, columns: Mapping[str, Array]) -> Array:
        fields = np.array([columns[c] for c in _UTC])
        whole = np.all(np.abs(fields) < 1e10, axis=0) & (np.abs(fields[0]) < 1e4)  # casting what is not would fail
        year, month, day, hour, minute, second, nano = np.where(whole, fields, 0.0)
        months = ((year - 1970) * 12 + month - 1).astype("int64").astype("datetime64[M]")
        days = months.astype("datetime64[D]").astype("int64") + day - 1
        coarse = days * 86400 + hour * 3600 + minute * 60 + second
        if self._origin is None:
            self._origin = (float(coarse[0]), float(nano[0]))
        return np.where(whole, (coarse - self._origin[0]) + (nano - self._origin[1]) * 1e-9, np.nan)
