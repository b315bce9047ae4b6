"""Tables of samples in the files that people have, one module a format.

Every format module has ``open_table(path)``, which returns a :class:`Table`; nothing here knows what a column means.
"""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from .table import Table

__all__ = ["Table", "open_table"]


def open_table(path: str | Path) -> Table:
    """Open a file of samples, its format told by its first bytes.

    Raises
    ------
    InputError
        When the file is missing, empty or of no known format.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            head = stream.read(4)
    except OSError as cause:
        raise InputError(f"{path}: cannot read: {cause.strerror}") from cause
    if not head:
        raise InputError(f"{path}: the file is empty")
    if head == b"PAR1":
        from . import parquet

        return parquet.open_table(path)
    from . import csv

    return csv.open_table(path)
