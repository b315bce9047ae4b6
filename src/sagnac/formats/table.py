"""A file of samples as named columns that stream."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import InputError


class Fault(InputError):  # noqa: N818 - the fault is the file's
    """Damage inside a file whose beginning was sound: what was read before it stands.

    Parameters
    ----------
    path : path
    offset : int
        First byte that could not be used.
    reason : str
    """

    def __init__(self, path: str | Path, offset: int, reason: str) -> None:
        super().__init__(f"{path}: damaged at byte {offset}: {reason}")
        self.path, self.offset, self.reason = Path(path), offset, reason


@dataclass(frozen=True)
class Table:
    """Columns of one file.

    Attributes
    ----------
    path : Path
    columns : tuple of str
        Header texts, stripped. Formats that fix the meaning of their columns give the standard ones, ``accel_x [m/s^2]``.
    read : callable
        ``read(numeric, other)`` yields pyarrow record batches with the named columns under their header texts, those of
        `numeric` as float64, those of `other` as they are. Raises :class:`Fault` at damage, after all that lies before it.
    remarks : sequence of str
        What the reader did to the samples and the user would not expect. It may grow while the rows are read.
    position : callable or None
        Bytes read so far by the latest `read`, of the size of the file; None where the format cannot tell.
    size : int
        Bytes in all, where `position` can tell.
    choice : str or None
        Which of several recordings this is, as `select` takes it, where the format has such.
    format : str or None
        Name of the format, see :data:`sagnac.formats.FORMATS`; :func:`sagnac.formats.open_table` fills it in.
    whole : frozenset of str
        Columns that the file holds as integers: among the `other` of `read` they come exactly as they are.
    samples : int
        Rows in all, where the file says so without being read.
    origin : float
        Where the time is counted from, s since the epoch of the file's own clock; zero for a time that is told as it stands.
    besides : tuple of Table
        Columns of other lengths in the same file, those of each length together: for who asks for them by name.
    """

    path: Path
    columns: tuple[str, ...]
    read: Callable[[Sequence[str], Sequence[str]], Iterator[Any]]
    remarks: Sequence[str] = ()
    position: Callable[[], int] | None = field(default=None, repr=False)
    size: int = 0
    choice: str | None = None
    format: str | None = None
    whole: frozenset[str] = frozenset()
    samples: int = 0
    origin: float = 0.0
    besides: tuple[Table, ...] = ()
