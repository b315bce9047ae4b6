"""The folder of a campaign: which runs are done is what can be read there, so that any start goes on from it.

``campaign.json``
    What the campaign is, so that no other one is mixed with it, and how its runs are parted.
``chunks/<sha256>.parquet``
    Rows of some runs each, see :mod:`.chunks`. A file is written beside its name and moved there when it is whole; one
    whose contents do not agree with its name is thrown away, and its runs are done again.
``results.parquet``
    All rows, by run, in row groups of a fixed size: the same bytes however the runs were parted and whoever did them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field

from .. import results
from .._version import __version__
from ..errors import DataError, InputError
from ..files import sha256, write_atomically
from ..results import Record, Software
from . import chunks
from .chunks import Chunk, Part
from .lock import locked

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA = "sagnac/campaign/1"
MANIFEST, RESULTS = "campaign.json", "results.parquet"
PACKAGES = ("numpy", "scipy", "numba")
"""What the last bits of results may depend on."""
GROUP = 1 << 15
"""Rows of a group of the results: what the memory of whoever reads or writes them is bounded by."""
_CHUNKS, _LOCK = "chunks", ".lock"
_SHORT = 200  # longer texts of an identity are kept as their hash: they are only compared
_TOLD = 4  # differences that are told one by one


class Manifest(Record):
    """What stands in ``campaign.json``."""

    schema_: Literal["sagnac/campaign/1"] = Field(default="sagnac/campaign/1", alias="schema")
    fingerprint: str
    """SHA-256 of all that the results depend on."""
    identity: dict[str, str]
    """The same in words; a long text is told by its own SHA-256."""
    runs: int
    runs_per_chunk: int
    columns: dict[str, str]
    """Of the results, with their types in the words of pyarrow."""
    about: dict[str, Any]
    """What the campaign itself says about its runs."""
    results: str | None = None
    """SHA-256 of ``results.parquet``, when that is written."""
    software: Software
    packages: dict[str, str] = Field(default_factory=dict)
    """Versions of what the last bits of results may depend on, where the campaign was begun."""


def packages() -> dict[str, str]:
    """Versions of the packages that calculate, here."""
    return {name: version(name) for name in PACKAGES}


def fingerprint(identity: Mapping[str, str]) -> str:
    """SHA-256 of all that the results of a campaign depend on, told as texts by name."""
    return hashlib.sha256(json.dumps(dict(identity), sort_keys=True).encode()).hexdigest()


class Store:
    """The folder of a campaign, held by one driver; a context, which opens and locks it.

    Parameters
    ----------
    folder : path
        Made when it is not there; one with another campaign is refused.
    identity : mapping of str to str
        All that the results depend on, by name; the version of Sagnac is added.
    runs : int
        Number of runs.
    columns : mapping of str to str, optional
        Of the task, see :class:`.chunks.Task`. Where they follow from the identity they may be left out: a folder that
        holds the campaign knows them, for one that does not :meth:`describe` tells them.
    about : mapping, optional
        What whoever shows the results wants to know, as JSON.

    Raises
    ------
    InputError
        On entering it: when the folder cannot be used, holds another campaign (with what differs) or is in use.
    """

    def __init__(
        self,
        folder: str | Path,
        identity: Mapping[str, str],
        runs: int,
        columns: Mapping[str, str] | None = None,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        if runs < 1:
            raise InputError(f"{folder}: a campaign of {runs} runs; it needs one at least")
        self.folder = Path(folder)
        self.runs = runs
        self.columns = dict(columns or {})
        self.notes: list[str] = []
        """What was found that somebody should know, for who drives the campaign."""
        whole = {**identity, "runs": str(runs), "sagnac": __version__}
        if columns is not None:
            whole["columns"] = json.dumps(self.columns)
        self.fingerprint = fingerprint(whole)
        self._identity = {name: _short(text) for name, text in whole.items()}
        self._about = dict(about or {})
        self._manifest: Manifest | None = None
        self._held: dict[int, Path] = {}  # chunks by their first run
        self._done = 0
        self._open = ExitStack()

    def __enter__(self) -> Self:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as cause:
            raise InputError(f"cannot make the folder {self.folder}: {cause.strerror}") from cause
        with ExitStack() as opened:
            opened.enter_context(locked(self.folder / _LOCK, str(self.folder)))
            self._look()
            self._open = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    @property
    def about(self) -> dict[str, Any] | None:
        """What the campaign in the folder says about its runs; none where there is none yet."""
        return self._manifest.about if self._manifest else None

    def describe(self, columns: Mapping[str, str], about: Mapping[str, Any]) -> None:
        """Tell columns and description of a campaign that the folder does not know yet."""
        self.columns, self._about = dict(columns), dict(about)

    @property
    def runs_per_chunk(self) -> int | None:
        """How the runs are parted; none before :meth:`start`."""
        return self._manifest.runs_per_chunk if self._manifest else None

    @property
    def done(self) -> int:
        """Number of runs that are safe."""
        return self._done

    def start(self, runs_per_chunk: int) -> None:
        """Settle how the runs are parted, for good."""
        self._manifest = Manifest(
            fingerprint=self.fingerprint,
            identity=self._identity,
            runs=self.runs,
            runs_per_chunk=runs_per_chunk,
            columns=self.columns,
            about=self._about,
            software=Software(version=__version__),
            packages=packages(),
        )
        results.save(self._manifest, self.folder / MANIFEST)

    def missing(self) -> Iterator[Part]:
        """Parts that are not there yet, in order."""
        assert self._manifest is not None  # the parts are settled
        for first in range(0, self.runs, self._manifest.runs_per_chunk):
            if first not in self._held:
                yield self._part(first)

    def put(self, part: Part, data: bytes) -> None:
        """Keep a chunk.

        Raises
        ------
        InputError
            When it cannot be written; nothing is left of it then.
        DataError
            When it is not the chunk of that part.
        """
        if chunks.decode(data)[:2] != (self.fingerprint, part) or part != self._part(part.first):
            raise DataError(f"{part}: what came back belongs to another part or campaign")
        target = self.folder / _CHUNKS / chunks.name_of(data)
        with write_atomically(target) as temporary:
            temporary.write_bytes(data)
        self._keep(part, target)

    def tables(self) -> Iterator[pa.Table]:
        """Rows that are there, chunk by chunk, by run; chunks that are damaged are thrown away.

        Whoever needs all of them looks whether there are :meth:`missing` ones afterwards.
        """
        for first in sorted(self._held):
            chunk = _read(self._held[first])
            if chunk is None or chunk[:2] != (self.fingerprint, self._part(first)):
                self._drop(self._held.pop(first))
                part = self._part(first)
                self._done -= part.last - part.first
                continue
            yield chunk.table

    def finish(self, take: Callable[[pa.Table], object] | None = None) -> bool:
        """Write ``results.parquet``, when all chunks are there and whole.

        Parameters
        ----------
        take : callable, optional
            Is given all rows by run in tables of :data:`GROUP` rows, the last one shorter: what it makes of them cannot
            depend on how the runs were parted.

        Returns
        -------
        bool
            False when runs are missing, be it that a chunk was found damaged; nothing is written or given then.

        Raises
        ------
        InputError
            When it cannot be written.
        """
        assert self._manifest is not None  # the parts are settled
        target = self.folder / RESULTS
        if not self._finished(target):
            if next(self.missing(), None) is not None:
                return False
            for _ in self.tables():  # looked at before anything is given away
                pass
            if next(self.missing(), None) is not None:
                return False
            kinds = chunks.schema(self.columns).with_metadata({"sagnac.campaign": self.fingerprint})
            with write_atomically(target) as temporary:
                written = 0
                with chunks.writing(kinds, temporary) as group:
                    for table in _regrouped(self.tables()):
                        group(table.replace_schema_metadata(kinds.metadata))
                        written += len(table)
                if written != self.runs:
                    raise DataError(f"{self.folder}: somebody else changes the chunks; {target} is not written")
            self._manifest = self._manifest.model_copy(update={"results": sha256(target)})
            results.save(self._manifest, self.folder / MANIFEST)
        if take is not None:
            for table in read_results(self.folder):
                take(table)
        return True

    def _part(self, first: int) -> Part:
        assert self._manifest is not None  # the parts are settled
        return Part(first, min(first + self._manifest.runs_per_chunk, self.runs))

    def _finished(self, target: Path) -> bool:
        """Whether the results are there as they were written."""
        assert self._manifest is not None  # the parts are settled
        return self._manifest.results is not None and target.is_file() and sha256(target) == self._manifest.results

    def _look(self) -> None:
        """Find out what is there."""
        if not (self.folder / MANIFEST).exists():
            strange = [name for name in (_CHUNKS, RESULTS) if (self.folder / name).exists()]
            if strange:
                raise InputError(
                    f"{self.folder}: has {' and '.join(strange)}, but no {MANIFEST} that says of what; take another folder"
                )
            return
        found = read_manifest(self.folder)
        if found.fingerprint != self.fingerprint:
            raise InputError(
                f"{self.folder}: holds another campaign: {_differences(found.identity, self._identity)}; "
                "take another folder, or remove this one"
            )
        self._manifest = found
        self.columns = dict(found.columns)
        odd = [
            f"{n} {v} here, {found.packages[n]} then" for n, v in packages().items() if found.packages.get(n, v) != v
        ]
        if odd:
            self.notes.append(f"not as when it was begun: {', '.join(odd)}: the last bits of results may depend on it")
        folder = self.folder / _CHUNKS
        for place, name in ((folder, ""), (self.folder, MANIFEST), (self.folder, RESULTS)):
            for path in place.glob(f".{name}*.*"):  # a driver that was killed was writing it
                self._drop(path, told=False)
        for path in sorted(folder.glob("*.parquet")):
            chunk = _read(path)
            if chunk is not None and chunk.campaign == self.fingerprint and chunk.part == self._part(chunk.part.first):
                self._keep(chunk.part, path)
            else:
                self._drop(path)

    def _keep(self, part: Part, path: Path) -> None:
        if part.first not in self._held:
            self._held[part.first] = path
            self._done += part.last - part.first

    def _drop(self, path: Path, *, told: bool = True) -> None:
        if told:
            self.notes.append(f"{path}: damaged; its runs are done again")
        with suppress(FileNotFoundError):
            path.unlink()


def is_begun(folder: str | Path) -> bool:
    """Whether a campaign was begun in a folder, be it that nothing of it is safe yet."""
    return (Path(folder) / _LOCK).exists()


def read_manifest(folder: str | Path) -> Manifest:
    """What a folder holds.

    Raises
    ------
    InputError
        When it is not that of a campaign that was started.
    """
    path = Path(folder) / MANIFEST
    return results.loads(Manifest, SCHEMA, "a campaign", results.read_text(path, "campaign"), str(path))


def read_results(folder: str | Path) -> Iterator[pa.Table]:
    """Rows of ``results.parquet`` by run, in tables of :data:`GROUP`."""
    from pyarrow import parquet

    with parquet.ParquetFile(Path(folder) / RESULTS) as stream:
        for i in range(stream.num_row_groups):
            yield stream.read_row_group(i, use_threads=False).replace_schema_metadata(None)


def read_chunks(folder: str | Path, manifest: Manifest) -> Iterator[Chunk]:
    """Whole chunks of a campaign that may be under way, in the order of their names; nothing is locked or changed."""
    seen = set()
    for path in sorted((Path(folder) / _CHUNKS).glob("[!.]*.parquet")):
        chunk = _read(path)
        if chunk is not None and chunk.campaign == manifest.fingerprint and chunk.part not in seen:
            seen.add(chunk.part)
            yield chunk


def _read(path: Path) -> Chunk | None:
    """A chunk; none when the file is not what its name says."""
    try:
        data = path.read_bytes()
        return chunks.decode(data) if chunks.name_of(data) == path.name else None
    except (FileNotFoundError, ValueError):
        return None
    except OSError as cause:  # of the disk or the rights, and no reason to throw the file away
        raise InputError(f"{path}: cannot read it: {cause.strerror}") from cause


def _regrouped(tables: Iterator[pa.Table]) -> Iterator[pa.Table]:
    """The same rows in tables of :data:`GROUP`, the last one shorter."""
    import pyarrow as pa

    held: list[pa.Table] = []
    rows = 0
    for table in tables:
        held.append(table)
        rows += len(table)
        if rows >= GROUP:
            joined = pa.concat_tables(held)
            whole = rows - rows % GROUP
            for start in range(0, whole, GROUP):
                yield joined.slice(start, GROUP)
            held, rows = [joined.slice(whole)], rows - whole
    if rows:
        yield pa.concat_tables(held)


def _short(text: str) -> str:
    return text if len(text) <= _SHORT else f"sha256 {hashlib.sha256(text.encode()).hexdigest()}"


def _differences(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """What differs between two campaigns, in words."""
    told = []
    for name in sorted(there.keys() | here.keys()):
        old, new = there.get(name, "missing"), here.get(name, "missing")
        if old != new:
            told.append(f"{name} differs" if old.startswith("sha256 ") else f"{name} is {old} there, {new} here")
    if not told:
        return "its fingerprint differs"
    return ", ".join(told[:_TOLD]) + (f" and {len(told) - _TOLD} more" if len(told) > _TOLD else "")
