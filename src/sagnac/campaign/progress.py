"""How far a campaign is: rate and remaining time, as a bar on a terminal and as plain lines elsewhere."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TextIO

_WINDOW = 30.0  # s that the rate is taken over: long against a chunk, short against a campaign
_EVERY = 10.0  # s between lines where there is no terminal


@dataclass(frozen=True)
class Watch:
    """Who wants to hear of a campaign.

    Attributes
    ----------
    progress : callable
        Is given how many runs are safe, and of how many.
    note : callable
        Is given a line about something that happened: a lost worker, a damaged chunk.
    """

    progress: Callable[[int, int], object] = lambda done, runs: None  # noqa: ARG005 - nobody listens
    note: Callable[[str], object] = lambda text: None  # noqa: ARG005


class Pace:
    """Runs a second over the last half minute; what was there at the start is nobody's speed."""

    def __init__(self, clock: Callable[[], float] | None = None) -> None:
        self._clock = clock or time.monotonic
        self._seen: deque[tuple[float, int]] = deque(maxlen=4096)

    def update(self, done: int) -> None:
        """So many runs are safe now."""
        now = self._clock()
        self._seen.append((now, done))
        while len(self._seen) > 2 and now - self._seen[1][0] >= _WINDOW:
            self._seen.popleft()

    @property
    def rate(self) -> float:
        """Runs a second, nan before there are any."""
        if len(self._seen) < 2:
            return math.nan
        (start, before), (end, after) = self._seen[0], self._seen[-1]
        return (after - before) / (end - start) if end > start and after > before else math.nan

    def told(self, done: int, runs: int) -> str:
        """Rate and remaining time, in words."""
        if math.isnan(self.rate):
            return ""
        rate = f"{self.rate:.3g} runs/s" if self.rate < 1000 else f"{self.rate:.0f} runs/s"
        return rate if done >= runs else f"{rate}, {_duration((runs - done) / self.rate)} to go"


@contextmanager
def telling(what: str, stream: TextIO | None = None) -> Iterator[Watch]:
    """A :class:`Watch` that writes to a stream (standard error unless given)."""
    out = sys.stderr if stream is None else stream
    if out.isatty():
        with _bar(what, out) as watch:
            yield watch
    else:
        with _lines(what, out) as watch:
            yield watch


@contextmanager
def _lines(what: str, out: TextIO) -> Iterator[Watch]:
    """A line now and then, and one at the end if anything was done."""
    pace, due = Pace(), time.monotonic() + _EVERY
    last, said = "", ""

    def write(text: str) -> None:
        out.write(f"{text}\n")
        out.flush()

    def progress(done: int, runs: int) -> None:
        nonlocal due, last, said
        pace.update(done)
        told = pace.told(done, runs)
        last = f"{what}: {done} of {runs} runs" + (f", {told}" if told else "")
        if time.monotonic() >= due:
            due = time.monotonic() + _EVERY
            said = last
            write(last)

    try:
        yield Watch(progress, write)
    finally:
        if last != said:
            write(last)


@contextmanager
def _bar(what: str, out: TextIO) -> Iterator[Watch]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[told]}"))
    pace = Pace()
    with Progress(*columns, console=Console(file=out)) as bar:
        task = bar.add_task(escape(what), total=None, told="")

        def progress(done: int, runs: int) -> None:
            pace.update(done)
            bar.update(task, completed=done, total=runs, told=pace.told(done, runs))

        yield Watch(progress, lambda text: bar.console.print(text, markup=False, highlight=False, soft_wrap=True))


def _duration(seconds: float) -> str:
    """A time to wait, as short as it can be said."""
    if seconds < 60:
        return f"{max(math.ceil(seconds), 1)} s"
    minutes = math.ceil(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours < 48 else f"{seconds / 86400:.3g} days"
