"""What a worker does, in a process of its own here or on a dask cluster: the same function, the same bytes.

A worker never raises: what went wrong comes back as a :class:`Reply` that says whose fault it is.
"""

from __future__ import annotations

import ctypes
import math
import pickle
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cache, lru_cache
from typing import Any, NamedTuple

from .._version import __version__
from ..errors import SagnacError
from .chunks import OK, Part, Task, UnfitError, encode

TARGET = 1.0
"""Seconds of work in a chunk, as the pilot sees it: well above the half second below which handing out costs more."""
LONG = 0.5
"""Seconds from which on a run is a chunk by itself."""
MOST_CHUNKS = 10_000
"""More would make a folder slow and a second start slower; chunks of very long campaigns hold more runs instead."""
_MOST_VALUES = 1 << 20  # in a chunk: its rows are some hundred MB while they are made
_PILOT = 0.2  # seconds of timed runs
_LEAST, _MOST = 3, 1000  # of them
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)

ENVIRONMENT = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Of a worker's process: one thread for one core, and sums in one order wherever they are made."""


# Numbers of malloc.h, and bytes: the largest mapping threshold that every glibc takes, and free memory at the top of the heap.
_MALLOC = {"M_MMAP_THRESHOLD": (-3, 32 << 20), "M_TRIM_THRESHOLD": (-1, 64 << 20)}


class Job(NamedTuple):
    """What a worker is asked for: the rows of a part, or how long a run takes."""

    part: Part
    campaign: str
    """Fingerprint."""
    pilot: bool = False
    """Time runs from all over the part instead."""


class Reply(NamedTuple):
    """What comes of a job; `kind` says which of the other fields count."""

    job: Job
    kind: str
    """``done``, ``timed``, ``raised`` (by a run), ``unfit`` (this worker or task), ``lost`` (the worker has died)
    or ``foreign`` (it went to a worker that is given no more work)."""
    chunks: tuple[tuple[Part, bytes], ...] = ()
    """Of a pilot, runs so long that each is a chunk."""
    seconds: float = 0.0
    """That a run takes, of a pilot."""
    text: str = ""
    """What was wrong."""
    trace: str = ""
    run: int = -1
    """Which one raised it."""
    deaths: int = 1
    """Workers that were lost with this job."""


_turn = threading.Lock()  # tasks need not bear threads: where a dask worker has several, they take turns


def perform(task: bytes, job: Job, version: str, told: Callable[[], object] | None = None) -> Reply:
    """Do a job.

    Parameters
    ----------
    task : bytes
        Pickled :class:`.chunks.Task`.
    job : Job
    version : str
        Of Sagnac where the driver runs: another one might give other results.
    told : callable, optional
        Is called after the first run.
    """
    if version != __version__:
        return Reply(job, "unfit", text=f"the worker has Sagnac {__version__}, the driver {version}")
    try:
        loaded = _load(task)
    except Exception as cause:  # noqa: BLE001 - unpickling runs whatever the task brings
        return Reply(job, "unfit", text=f"a worker cannot load the task: {_said(cause)}", trace=traceback.format_exc())
    keep_memory()
    with _turn:
        return _pilot(loaded, job, told) if job.pilot else _chunk(loaded, job, told)


def runs_per_chunk(seconds: float, runs: int, columns: int) -> int:
    """How many runs make a chunk.

    Parameters
    ----------
    seconds : float
        That a run takes.
    runs : int
        In the whole campaign.
    columns : int
        Of its results.
    """
    wanted = 1.0 if seconds >= LONG else min(TARGET / max(seconds, 1e-9), _MOST_VALUES / max(columns, 1))
    return min(max(math.ceil(wanted), math.ceil(runs / MOST_CHUNKS)), runs)


@cache
def keep_memory() -> None:
    """Have the C library keep the memory of one run's arrays for the next run, where it can be told to.

    It gives large arrays back to the system at once otherwise, which then clears every page of the next ones: 2 of 34 ms of a
    short run, and 10 of 44 ms below dask, which lowers the threshold for its workers (``MALLOC_TRIM_THRESHOLD_``).
    """
    with suppress(OSError, AttributeError, TypeError):  # macOS, Windows and musl have no mallopt
        tell = ctypes.CDLL(None).mallopt
        for number, size in _MALLOC.values():
            tell(number, size)


@lru_cache(maxsize=2)
def _load(task: bytes) -> Task:
    loaded: Task = pickle.loads(task)
    return loaded


class _RunError(Exception):
    """A run raised what no run may raise."""


def _row(task: Task, run: int) -> Mapping[str, Any]:
    """Row of a run; data that support no result are one."""
    try:
        return {"status": OK, **task.row(run), "run": run}
    except SagnacError as refusal:
        return {"run": run, "status": str(refusal)}
    except UnfitError:
        raise
    except Exception as cause:
        raise _RunError(run) from cause


def _chunk(task: Task, job: Job, told: Callable[[], object] | None) -> Reply:
    def rows() -> Iterator[Mapping[str, Any]]:
        for run in range(*job.part):
            yield _row(task, run)
            if told is not None and run == job.part.first:
                told()

    try:
        return Reply(job, "done", chunks=((job.part, encode(rows(), task.columns, job.part, job.campaign)),))
    except _RunError as error:
        return _raised(job, error)
    except (UnfitError, ValueError) as cause:
        return Reply(job, "unfit", text=str(cause))


def _pilot(task: Task, job: Job, told: Callable[[], object] | None) -> Reply:
    """Time some runs from all over the campaign; the first one, which may compile kernels, and the slowest do not count."""
    first, last = job.part
    rows: dict[int, Mapping[str, Any]] = {}
    times: list[float] = []
    try:
        rows[first] = _row(task, first)
        if told is not None:
            told()
        for run in _spread(first, last):
            if len(times) >= _LEAST and (sum(times) - max(times) >= _PILOT or len(times) >= _MOST):
                break
            start = time.perf_counter()
            rows[run] = _row(task, run)
            times.append(time.perf_counter() - start)
        seconds = (sum(times) - max(times)) / (len(times) - 1) if len(times) > 1 else LONG
        kept = (
            [Part(run, run + 1) for run in rows]
            if runs_per_chunk(seconds, last - first, len(task.columns)) == 1
            else []
        )
        made = tuple((part, encode([rows[part.first]], task.columns, part, job.campaign)) for part in kept)
    except _RunError as error:
        return _raised(job, error)
    except (UnfitError, ValueError) as cause:
        return Reply(job, "unfit", text=str(cause))
    return Reply(job, "timed", chunks=made, seconds=seconds)


def _spread(first: int, last: int) -> Iterator[int]:
    """Runs after the first one, each once, evenly over all of them wherever one stops."""
    seen = {first}
    for i in range(1, 4 * (last - first)):
        run = first + int((i * _GOLDEN % 1.0) * (last - first))
        if run not in seen:
            seen.add(run)
            yield run


def _raised(job: Job, error: _RunError) -> Reply:
    cause = error.__cause__
    assert cause is not None  # raised from it
    trace = "".join(traceback.format_exception(cause))
    place = traceback.extract_tb(cause.__traceback__)[-1]
    text = f"{_said(cause)} ({place.filename}, line {place.lineno})"
    return Reply(job, "raised", run=error.args[0], text=text, trace=trace)


def _said(cause: BaseException) -> str:
    return f"{type(cause).__name__}: {cause}" if str(cause) else type(cause).__name__
