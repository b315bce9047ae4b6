"""Workers of a dask cluster, on this machine or on others.

Chunks are tasks of :mod:`distributed`, with no more of them out than keep its workers busy. The task itself travels with
each chunk: data scattered beforehand would be lost with the last worker that holds them.
"""

from __future__ import annotations

import logging
import queue
import socket
import time
import uuid
from collections.abc import Collection
from contextlib import suppress
from typing import Any, NamedTuple

from .._version import __version__
from ..errors import InputError
from .work import ENVIRONMENT, Job, Reply, perform

_AHEAD = (
    1  # jobs more than threads: the next one to go on with; when a worker dies, jobs beside the guilty one are suspects
)
_CONNECT = 10.0  # s until a scheduler is taken for absent
_JOIN = 60.0  # s until a cluster without workers is given up, at the start and later
_FETCH = 10.0  # s that the result of a chunk may take to come before others are looked after
_REFRESH = 2.0  # s between looks at who is there

_PACKAGES = ("sagnac", "numpy", "scipy", "numba")
# What a worker is asked before it gets work, as text: it may have no Sagnac to understand anything else with.
_QUESTION = (
    "dict([(n, __import__(n).__version__ if __import__('importlib.util').util.find_spec(n) else None)"
    f" for n in {_PACKAGES!r}] + [(n, __import__('os').environ.get(n)) for n in {tuple(ENVIRONMENT)[:1]!r}])"
)


class _Given(NamedTuple):
    future: Any
    job: Job
    chosen: frozenset[str] | None
    """Workers that it may go to, where not to any."""
    strangers: frozenset[str]
    """Workers that were known to be of no use then."""


class DaskCrew:
    """The workers of a scheduler.

    Parameters
    ----------
    task : bytes
        Pickled.
    scheduler : str
        Its address, ``tcp://host:8786``.

    Raises
    ------
    InputError
        When dask is not installed, the scheduler does not answer, there are no workers, or they have another Sagnac.
    """

    def __init__(self, task: bytes, scheduler: str) -> None:
        self.notes: list[str] = []
        self._task = task
        self._scheduler = scheduler
        self._client = _connected(scheduler)
        self._token = uuid.uuid4().hex
        self._given = 0
        self._out: dict[str, _Given] = {}
        self._ready: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._threads, self._looked = 0, 0.0
        self._alone: float | None = None  # since when there is no worker
        self._good: frozenset[str] = frozenset()
        self._strangers: frozenset[str] = frozenset()
        self._stranded: list[Reply] = []
        self._quiet = _silenced()
        try:
            self._wait()
        except BaseException:
            self.close()
            raise

    @property
    def room(self) -> int:
        """Number of jobs that can be given now."""
        if time.monotonic() - self._looked > _REFRESH:
            self._look()
        return max(max(self._threads, 1) + _AHEAD - len(self._out), 0)

    @property
    def busy(self) -> int:
        """Number of jobs that were given and have not come back."""
        return len(self._out)

    def give(self, job: Job) -> None:
        """Have a job done."""
        self._given += 1
        key = f"sagnac-{self._token}-{self._given}"
        # without strangers dask may choose: it then knows itself which jobs kill workers
        chosen = {"workers": sorted(self._good), "allow_other_workers": False} if self._strangers else {}
        future = self._client.submit(perform, self._task, job, __version__, key=key, pure=False, retries=0, **chosen)
        self._out[key] = _Given(future, job, self._good if chosen else None, self._strangers)
        future.add_done_callback(lambda done: self._ready.put(done.key))

    def collect(self, seconds: float) -> list[Reply]:
        """What has come back; waits for so long when there is nothing.

        Raises
        ------
        ConnectionError
            When the scheduler is gone.
        """
        if time.monotonic() - self._looked > _REFRESH:
            self._look()
        stranded, self._stranded = self._stranded, []
        keys: list[str] = []
        with suppress(queue.Empty):
            keys.append(self._ready.get(timeout=seconds))
            while True:
                keys.append(self._ready.get_nowait())
        replies = [self._fetched(key) for key in keys if key in self._out]
        return stranded + [reply for reply in replies if reply is not None]

    def where(self, job: Job) -> str:
        """Who does a job, in words."""
        keys = {key for key, given in self._out.items() if given.job == job}
        with suppress(OSError):
            for address, held in self._client.processing().items():
                if keys & set(held):
                    return f"the dask worker {address}"
        return "the dask cluster"

    def close(self) -> None:
        """Drop all work."""
        with suppress(OSError):  # the scheduler may be gone
            self._client.cancel([given.future for given in self._out.values()])
        self._out.clear()
        self._client.close(timeout=_CONNECT)
        for logger in self._quiet:
            logger.disabled = False

    def _fetched(self, key: str) -> Reply | None:
        """Reply to a finished job, none when its worker is lost before it is here; the scheduler has it done again."""
        from distributed import KilledWorker

        given = self._out[key]
        future, job = given.future, given.job
        try:
            reply: Reply = future.result(timeout=_FETCH)
        except TimeoutError:
            self._ready.put(key)
            return None
        except KilledWorker as cause:
            reply = Reply(job, "lost", text="the dask worker died", deaths=cause.allowed_failures + 1)
        except BaseException as cause:  # whatever dask or the task's own modules raise
            if isinstance(cause, (KeyboardInterrupt, SystemExit)):
                raise
            self._need_scheduler()
            reply = self._failed(future, job, cause)
        if reply.kind == "unfit":
            self._look()
            if self._strangers - given.strangers:  # it went to one of those before they were known
                reply = Reply(job, "foreign")
        del self._out[key]
        return reply

    def _failed(self, future: Any, job: Job, cause: BaseException) -> Reply:
        if future.status in ("cancelled", "lost"):
            return Reply(job, "lost", text="the dask scheduler dropped it")
        return Reply(job, "unfit", text=f"a dask worker cannot do the runs: {type(cause).__name__}: {cause}")

    def _need_scheduler(self) -> None:
        if self._client.status != "running":
            raise ConnectionError(f"the dask scheduler at {self._scheduler} is gone; start it and its workers again")

    def _look(self) -> None:
        """See who is there, and examine newcomers; raises InputError where nobody has been for long."""
        self._need_scheduler()
        threads: dict[str, int] = dict(self._client.nthreads())
        self._looked = time.monotonic()
        self._good &= threads.keys()
        self._strangers &= threads.keys()
        for address, why in self._examined(threads.keys() - self._good - self._strangers).items():
            if why:
                self._strangers |= {address}
                self.notes.append(f"the dask worker {address} {why}; it gets no work")
            else:
                self._good |= {address}
        self._threads = sum(n for address, n in threads.items() if address in self._good)
        self._strand()
        self._wait_for_one()

    def _wait_for_one(self) -> None:
        if self._good:
            self._alone = None
        elif self._alone is None:
            self._alone = time.monotonic()
            self.notes.append(f"no worker is left at {self._scheduler}; waiting {_JOIN:g} s for one")
        elif time.monotonic() - self._alone > _JOIN:
            raise ConnectionError(
                f"no worker that can be used has been at the dask scheduler {self._scheduler} for {_JOIN:g} s; "
                f"start some: dask worker {self._scheduler}"
            )

    def _strand(self) -> None:
        """Take back jobs all of whose chosen workers are gone: dask would wait for these for ever."""
        for key, given in list(self._out.items()):
            if given.chosen is not None and not given.chosen & self._good:
                self._client.cancel([given.future])
                del self._out[key]
                self._stranded.append(Reply(given.job, "lost", text="the dask workers it was for are gone"))

    def _wait(self) -> None:
        """Wait for workers and refuse those whose results might differ."""
        try:
            self._client.wait_for_workers(1, timeout=_JOIN)
        except TimeoutError as cause:
            raise InputError(
                f"no worker is at the dask scheduler {self._scheduler}; waited {_JOIN:g} s; "
                f"start some: dask worker {self._scheduler}"
            ) from cause
        self._look()
        if not self._good and self._strangers:
            told = next(note for note in self.notes if note.endswith("; it gets no work"))
            raise InputError(f"{told.removesuffix('; it gets no work')}; install the same on both")
        if self._threads > len(self._good):
            self.notes.append("dask workers do one run at a time, whatever their threads: start them with --nthreads 1")

    def _examined(self, addresses: Collection[str]) -> dict[str, str]:
        """What is wrong with each of these workers; those that do not answer are left out, and asked again."""
        asked = {
            a: self._client.submit(eval, _QUESTION, workers=[a], allow_other_workers=False, pure=False)
            for a in addresses
        }
        out = {}
        for address, future in asked.items():
            try:
                found = future.result(timeout=_FETCH)
            except TimeoutError:
                continue
            except Exception as cause:  # noqa: BLE001 - whatever the worker raises
                found = cause
            if future.status in ("cancelled", "lost"):  # it has gone meanwhile
                continue
            out[address] = _unlike(found)
            if isinstance(found, dict) and not out[address]:
                self._tell_odd(address, found)
        return out

    def _tell_odd(self, address: str, found: dict[str, Any]) -> None:
        ours = _answer()
        odd = [f"{n} {found[n]}, here {ours[n]}" for n in _PACKAGES if found[n] != ours[n]]
        odd += [f"{n} is not 1 in its environment" for n in ours if n not in _PACKAGES and found[n] != "1"]
        if odd:
            self.notes.append(f"dask worker {address}: {'; '.join(odd)}: the last bits of results may depend on it")


def _unlike(found: object) -> str:
    """Why a worker gets no work, from what it answered."""
    if not isinstance(found, dict):
        return f"fails ({found}), the driver has Sagnac {__version__}"
    if found["sagnac"] == __version__:
        return ""
    theirs = "no Sagnac" if found["sagnac"] is None else f"Sagnac {found['sagnac']}"
    return f"has {theirs}, the driver has {__version__}"


def _silenced() -> list[logging.Logger]:
    """Keep distributed from telling at length, with tracebacks, what is told here in a line; returns whom to wake up again."""
    families = ("distributed", "tornado", "asyncio")
    found = [x for n, x in logging.root.manager.loggerDict.items() if n.split(".")[0] in families]
    quiet = [x for x in found if isinstance(x, logging.Logger) and not x.disabled]
    for logger in quiet:
        logger.disabled = True
    return quiet


def need_scheduler(address: str) -> None:
    """Raise InputError where dask is not installed or no scheduler answers."""
    try:
        import distributed  # noqa: F401 - whether it is there
    except ImportError as cause:
        raise InputError("a dask cluster needs dask: pip install 'sagnac[cluster]'") from cause
    try:
        _knock(address)
    except (OSError, ValueError) as cause:
        raise InputError(f"no dask scheduler answers at {address}: {cause}") from cause


def _connected(scheduler: str) -> Any:
    """A client of a scheduler; raises InputError."""
    need_scheduler(scheduler)
    import distributed

    connect: Any = distributed.Client  # ships no types
    try:
        return connect(scheduler, timeout=_CONNECT, set_as_default=False, name="sagnac")
    except (OSError, ValueError) as cause:
        raise InputError(f"no dask scheduler answers at {scheduler}: {cause}") from cause


def _knock(scheduler: str) -> None:
    """Raise OSError or ValueError where no scheduler listens; a client would be left half made, or wait for ever."""
    from distributed.comm.addressing import get_address_host_port, parse_address

    kind = parse_address(scheduler)[0]
    if kind not in ("tcp", "tls"):
        raise ValueError("write tcp://HOST:PORT, or tls://HOST:PORT where dask is set up for it")
    with socket.create_connection(get_address_host_port(scheduler, strict=True), timeout=_CONNECT) as stream:
        if kind == "tcp" and not stream.recv(1):  # a scheduler speaks first, a web server waits
            raise OSError("what listens there is something else")


def _answer() -> dict[str, Any]:
    """What this process would answer."""
    answer: dict[str, Any] = eval(_QUESTION)
    return answer
