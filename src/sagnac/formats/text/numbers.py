"""Text of bare numbers, as loggers of laser gyros write their pulse counts: no header, a column is known by its number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ...errors import InputError
from ..table import Table
from . import rows
from .lines import unended

_HEAD = 1 << 16
_MARK = b"\xef\xbb\xbf"


def open_table(path: Path) -> Table:
    """Open a text of numbers parted by blanks, tabs, commas or semicolons; its columns are ``1``, ``2``, ... ``k``.

    Lines that are blank or begin with ``#``, ``%`` or ``//`` are no rows. What the columns mean is for the user to
    say (``--map time=7,gyro_x=1``, ``--units gyro=pulse``).

    Raises
    ------
    InputError
        When no line of numbers is found. Fault (while reading) at a row with another number of fields, or a field
        that is no number.
    """
    layout = _layout(path)

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        return rows.rows(layout, dict.fromkeys([*numeric, *other], True))

    size = path.stat().st_size
    return Table(path, layout.names, read, unended(path), position=layout.position, size=size)


def _layout(path: Path) -> rows.Layout:
    """What parts the fields, and how many there are, from the first line that says anything."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    start = len(_MARK) if head.startswith(_MARK) else 0
    for line in head[start:].splitlines():
        bare = line.strip()
        if bare and not bare.startswith(rows.COMMENTS):
            delimiter = next((d for d in ";," if d.encode() in bare), " ")
            fields = rows.tidy(bare, delimiter).split(delimiter.encode())
            names = tuple(str(k) for k in range(1, len(fields) + 1))
            return rows.Layout(path, start, 1, delimiter, names)
    raise InputError(f"{path}: no line of numbers found in its first {_HEAD // 1024} kB")
