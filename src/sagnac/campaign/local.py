"""Workers as processes of this machine.

They are spawned, not forked: the threads and locks of numpy, numba and Arrow do not survive a fork, the number of BLAS
threads has to stand in the environment before numpy is loaded, and no server process (as of ``forkserver``) can be
killed in the place of a worker. It costs the second that imports take, once for each worker. Each has a pipe of its own,
so that it is known which runs a worker that dies has had; a ``ProcessPoolExecutor`` gives up all of them.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING

from .._version import __version__
from ..errors import DataError
from .work import ENVIRONMENT, Job, Reply, perform

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

_READY = "ready"  # what a worker says when it has loaded its modules,
_WARM = "warm"  # and after its first run: its kernels are compiled
_STARTS = 3  # workers in a row that may die before they say anything


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class _Worker:
    process: SpawnProcess
    pipe: Connection
    job: Job | None = None
    spoke: bool = False


class LocalCrew:
    """Some worker processes.

    The first one gets work alone until it has done a run: kernels are then compiled and kept on disk, and the others,
    which have loaded their modules meanwhile, find them there.

    Parameters
    ----------
    task : bytes
        Pickled.
    workers : int
    """

    def __init__(self, task: bytes, workers: int) -> None:
        self.notes: list[str] = []
        self._task = task
        self._warm = False
        self._stillborn = 0
        self._workers: list[_Worker] = []
        try:
            for _ in range(workers):
                self._workers.append(self._start())
        except BaseException:
            self.close()
            raise

    @property
    def room(self) -> int:
        """Number of jobs that can be given now."""
        idle = sum(w.job is None for w in self._workers)
        return idle if self._warm else min(idle, 1 - self.busy)

    @property
    def busy(self) -> int:
        """Number of jobs that are being done."""
        return sum(w.job is not None for w in self._workers)

    def give(self, job: Job) -> None:
        """Have a job done by whoever is idle."""
        worker = next(w for w in self._workers if w.job is None)
        worker.job = job
        with suppress(OSError):  # it has just died: its pipe says so
            worker.pipe.send(job)

    def collect(self, seconds: float) -> list[Reply]:
        """What has come of the jobs meanwhile; waits for so long when there is nothing.

        Raises
        ------
        DataError
            When workers cannot even be started.
        """
        ready = wait([w.pipe for w in self._workers], seconds)
        replies = [self._heard(w) for w in list(self._workers) if w.pipe in ready]
        return [reply for reply in replies if reply is not None]

    def where(self, job: Job) -> str:
        """Who does a job, in words."""
        return next((f"process {w.process.pid}" for w in self._workers if w.job == job), "a process that has ended")

    def close(self) -> None:
        """Stop the workers, whatever they are doing."""
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
            worker.pipe.close()
            worker.process.close()
        self._workers.clear()

    def _start(self) -> _Worker:
        context = get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=serve, args=(there, self._task, __version__), daemon=True)
        with _environment():
            process.start()
        there.close()  # the other end of ours is the worker's alone: it ends with it
        return _Worker(process, here)

    def _heard(self, worker: _Worker) -> Reply | None:
        try:
            said = worker.pipe.recv()
        except (EOFError, OSError):
            return self._buried(worker)
        worker.spoke, self._stillborn = True, 0
        self._warm |= said != _READY
        if said in (_READY, _WARM):
            return None
        worker.job = None
        assert isinstance(said, Reply)  # a worker says nothing else
        return said

    def _buried(self, worker: _Worker) -> Reply | None:
        """Put another worker in the place of a dead one."""
        worker.process.join()
        how = _ending(worker.process.exitcode)
        job = worker.job
        self._stillborn += not worker.spoke
        if self._stillborn >= _STARTS:
            raise DataError(
                f"workers end before they have done anything ({how}); what they printed says why; a script that starts a "
                'campaign needs an `if __name__ == "__main__":` around that'
            )
        self._workers[self._workers.index(worker)] = self._start()
        worker.pipe.close()
        worker.process.close()
        return None if job is None else Reply(job, "lost", text=how)


def serve(pipe: Connection, task: bytes, version: str) -> None:
    """What a worker process does: jobs from a pipe, one after the other, until that is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all processes of a terminal: the driver decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    told = False

    def tell() -> None:
        nonlocal told
        if not told:
            pipe.send(_WARM)
        told = True

    with suppress(EOFError, OSError):  # the driver is gone
        pipe.send(_READY)
        while True:
            pipe.send(perform(task, pipe.recv(), version, tell))


def _end_with_parent() -> None:
    """A driver that was killed leaves no workers behind, however long their runs are."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _environment() -> Iterator[None]:
    """What a worker finds in its environment."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _ending(code: int | None) -> str:
    """How a process ended, in words."""
    if code is None or code >= 0:
        return f"it ended with status {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"it was ended by {name}" + (", perhaps for want of memory" if name == "SIGKILL" else "")
