"""Runs of a campaign, handed out in chunks to processes here or to a dask cluster; the results do not tell which.

Each run depends on its number alone, a chunk holds some runs one after the other, and the store knows which chunks are
there. So it does not matter who does a chunk, or when, or how often: a worker that dies has its chunk done by another,
a driver that dies has the missing ones done at the next start. Workers send chunks back as bytes and the driver alone
writes: nobody shares a file system. The driver's memory holds a chunk or two and the names of those that are done.
"""

from __future__ import annotations

import pickle
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from ..errors import DataError, InputError
from .chunks import Part, Task
from .local import LocalCrew, cores
from .progress import Watch
from .store import Store
from .work import Job, Reply, runs_per_chunk

if TYPE_CHECKING:
    import pyarrow as pa

DEATHS = 3
"""Workers that a chunk may cost before its runs are taken for the cause."""
_WAIT = 0.5  # s after which the progress is told anew when nothing has come
_LATE = 10.0  # times the usual time after which a job is told to be late, and
_PATIENCE = 30.0  # s that it takes at least; what a busy machine delays is no news
_UNKNOWN = 300.0  # s where the usual time is not known yet


class Crew(Protocol):
    """Those who do the jobs."""

    notes: list[str]

    @property
    def room(self) -> int:
        """Number of jobs that can be given now."""

    @property
    def busy(self) -> int:
        """Number of jobs that were given and have not come back."""

    def give(self, job: Job) -> None:
        """Have a job done."""

    def collect(self, seconds: float) -> list[Reply]:
        """What has come back; waits for so long when there is nothing."""

    def where(self, job: Job) -> str:
        """Who does a job, in words."""

    def close(self) -> None:
        """Drop all work."""


def run(
    task: Task,
    store: Store,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Watch | None = None,
    take: Callable[[pa.Table], object] | None = None,
    chunk: int | None = None,
    again: Callable[[int], str] | None = None,
    seed: int | None = None,
) -> None:
    """Do the runs of a campaign that are missing, and write ``results.parquet``.

    Parameters
    ----------
    task : Task
    store : Store
        Entered.
    workers : int, optional
        Processes on this machine; one for each core unless given.
    scheduler : str, optional
        Address of a dask scheduler (``tcp://host:8786``), whose workers do the runs instead.
    watch : Watch, optional
        Is told how far it is.
    take : callable, optional
        Is given all rows in the end, see :meth:`.store.Store.finish`.
    chunk : int, optional
        Runs in a chunk, where the campaign has not been started yet; found by timing some runs unless given.
    again : callable, optional
        Takes a run to the command that repeats it alone, for messages.
    seed : int, optional
        Of the campaign, for messages; a run's own is ``SeedSequence(seed, spawn_key=(run,))``.

    Raises
    ------
    InputError
        When the scheduler or its workers cannot be used, the task cannot be sent to workers, or results cannot be written.
    DataError
        When a run raises anything but an InputError or a DataError, or its workers die again and again.
    """
    if workers is not None and scheduler is not None:
        raise InputError(_EITHER)
    drive = _Drive(store, watch or Watch(), again or (lambda index: f"task.row({index})"), seed)
    if store.runs_per_chunk is None and chunk is not None:
        store.start(min(chunk, store.runs))
    try:
        blob = pickle.dumps(task)
    except Exception as cause:  # whatever the task's own parts raise
        raise InputError(f"the task cannot be sent to workers: {type(cause).__name__}: {cause}") from cause
    try:
        while store.runs_per_chunk is None or not store.finish(take):
            drive.tell(store.notes)
            with closing(_crew(blob, store, workers, scheduler)) as crew:
                drive.tell(crew.notes)
                drive.work(crew)
    except KeyboardInterrupt:
        drive.watch.note(drive.kept("stopped"))
        raise
    except OSError as cause:
        raise InputError(drive.kept(str(cause))) from cause
    drive.tell(store.notes)


_EITHER = "--workers are processes of this machine, those of a --scheduler are its own: give one of them"


def check_crew(workers: int | None, scheduler: str | None) -> None:
    """Refuse at once what :func:`run` would refuse when the task is ready.

    Raises
    ------
    InputError
        When both are given, or no scheduler answers.
    """
    if scheduler is None:
        return
    if workers is not None:
        raise InputError(_EITHER)
    from .cluster import need_scheduler

    need_scheduler(scheduler)


def _crew(blob: bytes, store: Store, workers: int | None, scheduler: str | None) -> Crew:
    if scheduler is not None:
        from .cluster import DaskCrew

        return DaskCrew(blob, scheduler)
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers: take one at least")
    parts = -(-(store.runs - store.done) // (store.runs_per_chunk or 1))
    return LocalCrew(blob, min(workers or cores(), parts))


@dataclass
class _Drive:
    """A driver at work."""

    store: Store
    watch: Watch
    again: Callable[[int], str]
    seed: int | None = None
    deaths: Counter[Part] = field(default_factory=Counter)
    out: dict[Job, float] = field(default_factory=dict)
    late: set[Job] = field(default_factory=set)
    spent: tuple[float, int] = (0.0, 0)
    """Seconds that jobs were out, and their runs: the usual time."""

    def work(self, crew: Crew) -> None:
        """Hand out all that is missing and keep what comes back."""
        self.watch.progress(self.store.done, self.store.runs)
        if self.store.runs_per_chunk is None:
            self._go(crew, iter([Job(Part(0, self.store.runs), self.store.fingerprint, pilot=True)]))
        self._go(crew, (Job(part, self.store.fingerprint) for part in self.store.missing()))

    def kept(self, what: str) -> str:
        """What is safe when the campaign ends early."""
        if not self.store.done:
            return what
        return (
            f"{what}; {self.store.done} of {self.store.runs} runs are safe in {self.store.folder}: "
            "the same command goes on from there"
        )

    def tell(self, notes: list[str]) -> None:
        """Pass notes on, once."""
        for text in notes:
            self.watch.note(text)
        notes.clear()

    def _go(self, crew: Crew, jobs: Iterator[Job]) -> None:
        returned: list[Job] = []
        replies: list[Reply] = []
        while True:
            while crew.room > 0 and (job := returned.pop() if returned else next(jobs, None)) is not None:
                crew.give(job)
                self.out[job] = time.time()
            # whoever has replied is busy again before anything is written
            returned.extend([reply.job for reply in replies if not self._settled(reply)])
            self.watch.progress(self.store.done, self.store.runs)
            self.tell(crew.notes)
            self._tell_late(crew)
            if not crew.busy and not returned:
                return
            replies = crew.collect(_WAIT) if crew.busy else []

    def _tell_late(self, crew: Crew) -> None:
        """Name jobs that take far longer than others: a worker that is stopped or hangs says nothing itself."""
        seconds, runs = self.spent
        for job, since in self.out.items():
            usual = (job.part.last - job.part.first) * seconds / runs if runs and not job.pilot else None
            if job in self.late or time.time() - since < (_UNKNOWN if usual is None else max(_LATE * usual, _PATIENCE)):
                continue
            self.late.add(job)
            told = "" if usual is None else f", where {max(usual, 0.1):.2g} s are usual"
            clock = time.strftime("%H:%M:%S", time.localtime(since))
            self.watch.note(
                f"{_named(job).rstrip(',')}: with {crew.where(job)} since {clock}{told}; "
                "if that hangs, end it: another one does the runs"
            )

    def _settled(self, reply: Reply) -> bool:
        """Whether a job is done with; those of a worker that was lost are not."""
        since = self.out.pop(reply.job, time.time())
        self.late.discard(reply.job)
        if reply.kind == "foreign":
            return False
        if reply.kind == "lost":
            return self._lost(reply)
        if reply.kind == "done":
            part = reply.job.part
            self.spent = self.spent[0] + time.time() - since, self.spent[1] + part.last - part.first
        if reply.kind == "timed":
            self.spent = reply.seconds, 1
        if reply.kind == "raised":
            which = f"run {reply.run}" + ("" if self.seed is None else f" (seed {self.seed}, spawn key {reply.run})")
            told = f"{which} stopped the campaign: {reply.text}; to see it again: {self.again(reply.run)}"
            error = DataError(self.kept(told))
            error.add_note(reply.trace)
            raise error
        if reply.kind == "unfit":
            raise InputError(self.kept(reply.text))
        if reply.kind == "timed":
            self.store.start(runs_per_chunk(reply.seconds, self.store.runs, len(self.store.columns)))
        for part, data in reply.chunks:
            self._put(part, data)
        return True

    def _put(self, part: Part, data: bytes) -> None:
        try:
            self.store.put(part, data)
        except InputError as cause:
            raise InputError(self.kept(str(cause))) from cause

    def _lost(self, reply: Reply) -> bool:
        part = reply.job.part
        self.deaths[part] += reply.deaths
        what = _named(reply.job)
        if self.deaths[part] >= DEATHS:
            raise DataError(
                self.kept(
                    f"{what} were on {self.deaths[part]} workers that died ({reply.text}); "
                    f"to see what happens: {self.again(part.first)}"
                )
            )
        self.watch.note(f"a worker was lost ({reply.text}); once more: {what.rstrip(',')}")
        return False


def _named(job: Job) -> str:
    return "the first runs, which tell how long one takes," if job.pilot else str(job.part)
