"""A file of samples as named columns that stream."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Table:
    """Columns of one file.

    Attributes
    ----------
    path : Path
    columns : tuple of str
        Header texts, stripped.
    read : callable
        ``read(numeric, other)`` yields pyarrow record batches with the named columns under their header texts,
        those of `numeric` as float64, those of `other` as they are.
    """

    path: Path
    columns: tuple[str, ...]
    read: Callable[[Sequence[str], Sequence[str]], Iterator[Any]]
