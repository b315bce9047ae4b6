"""What the terminal sees besides results: progress, and why a first call takes longer."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_SILENT = 10.0
"""Seconds of reading after which somebody without a terminal would like to hear how far it is."""


def note(text: str) -> None:
    """A line for the person, not for the pipe."""
    print(text, file=sys.stderr)  # noqa: T201 - this is the terminal


_COMPILED = {
    "hand-turned": (("rotation", "integrate"),),
    "roll-isolated": (("local_level", "innovations"),),
    "centrifuge": (("harmonics", "harmonic_sums"), ("harmonics", "look")),
    "apply roll-isolated": (("attitude", "compose"),),
    "align static": (("attitude", "compose"),),
    "align transfer": (("strapdown", "advance"), ("kalman", "update"), ("error_model", "system")),
    "align covariance": (("covariance", "follow"),),
    "align monte-carlo": (("lanes_chain", "align"),),
    "navigate": (("strapdown", "trace"),),
}
"""Kernels that a method calls."""


def announce_compilation(method: str) -> None:
    """Say that the kernels of a method are being compiled, when they are."""
    if method not in _COMPILED:
        return
    from importlib import import_module

    from ..kernels import is_cold

    if any(is_cold(getattr(import_module(f"sagnac.kernels.{m}"), kernel)) for m, kernel in _COMPILED[method]):
        note("compiling kernels (a few seconds, once on this machine) ...")


@contextmanager
def counting(what: str, unit: str = "samples") -> Iterator[Callable[[float], None]]:
    """Progress of a stream, in samples or s: a bar on a terminal, one line at the end otherwise."""
    last = 0.0
    if not sys.stderr.isatty():

        def remember(done: float) -> None:
            nonlocal last
            last = done

        yield remember
        note(f"{what}: {last:.9g} {unit}")
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    with Progress(
        TextColumn(what),
        BarColumn(),
        TextColumn(f"{{task.completed:.9g}} {unit}"),
        TimeElapsedColumn(),
        console=console,
    ) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done: bar.update(task, completed=done)
        bar.update(task, total=bar.tasks[0].completed)


@contextmanager
def reading(name: str, size: int) -> Iterator[Callable[[int], None]]:
    """Progress through a file of so many bytes: a bar on a terminal, a line now and then in a long reading otherwise."""
    if not sys.stderr.isatty():
        due = time.monotonic() + _SILENT

        def say(done: int) -> None:
            nonlocal due
            if time.monotonic() > due:
                due = time.monotonic() + _SILENT
                note(f"reading {name}: {done / size:.0%}")

        yield say
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

    columns = (TextColumn("reading {task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=size)
        yield lambda done: bar.update(task, completed=done)
