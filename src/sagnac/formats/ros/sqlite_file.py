"""What an SQLite file says about itself without SQLite, which tells no byte (sqlite.org/fileformat2.html)."""

from __future__ import annotations

import mmap
import re
import sqlite3
import struct
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from ..table import Fault

_LEAF = 13  # first byte of a page that holds rows of a table
LIMIT = 1 << 28  # bytes of a row
ERRORS = (sqlite3.Error, OverflowError, MemoryError, UnicodeDecodeError)
"""What sqlite3 raises at damage; MemoryError for a row that says it is larger than any can be."""


@dataclass(frozen=True)
class Pages:
    """Pages of an SQLite file.

    Attributes
    ----------
    path : Path
    size : int
        Bytes that the file has.
    page : int
        Bytes of a page.
    told : int
        Bytes that the file has by its header; 0 where that does not say.
    cut_row : int or None
        First number of a row on a page that the end of the file cuts in two: SQLite would take zeros for what is missing.
    beside : str
        Name of a journal that holds what is not in the file yet, empty where there is none.
    """

    path: Path
    size: int
    page: int
    told: int
    cut_row: int | None
    beside: str

    @property
    def short(self) -> bool:
        """Whether the file ends before its header says."""
        return self.size < self.told


def pages(path: Path) -> Pages:
    """Read the header of an SQLite file, and its last page where that is cut in two.

    Raises
    ------
    Fault
        When it has no sound header.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(100)
        if len(head) < 100 or not head.startswith(b"SQLite format 3\0"):
            raise Fault(path, min(len(head), 16), "the header of an SQLite file is not whole")
        (page,) = struct.unpack_from(">H", head, 16)
        page = 65536 if page == 1 else page
        if page < 512 or page & (page - 1):
            raise Fault(path, 16, f"pages of {page} bytes do not exist in SQLite")
        changes, count = struct.unpack_from(">II", head, 24)
        (valid_for,) = struct.unpack_from(">I", head, 92)
        stream.seek(size - size % page)
        cut_row = _first_row(stream.read(size % page))
    told = count * page if changes == valid_for else 0
    names = [f"{path.name}{ending}" for ending in ("-wal", "-journal")]
    beside = [n for n in names if (path.parent / n).is_file() and (path.parent / n).stat().st_size]
    return Pages(path, size, page, told, cut_row, beside[0] if beside else "")


def _first_row(page: bytes) -> int | None:
    """Least number of the rows that begin in what there is of a page; None where it holds no rows."""
    if len(page) < 8 or page[0] != _LEAF:
        return None
    count = int.from_bytes(page[3:5], "big")
    cells = page[8 : 8 + 2 * count]
    numbers = []
    for (at,) in struct.iter_unpack(">H", cells[: len(cells) // 2 * 2]):
        _, after = _varint(page, at)
        number, after = _varint(page, after)
        if after <= len(page):
            numbers.append(number)
    return min(numbers, default=None)


def _varint(page: bytes, at: int) -> tuple[int, int]:
    """Number of up to 9 bytes and the place after it, beyond the end where it is not whole."""
    value = 0
    for i in range(at, min(at + 8, len(page))):
        value = value << 7 | page[i] & 127
        if page[i] < 128:
            return value, i + 1
    return value, len(page) + 1  # the ninth byte is needed only by numbers that no bag reaches


def connection(path: Path) -> sqlite3.Connection:
    """Connection that changes nothing, beside the file neither; a file that ends early is read as far as it goes."""
    base = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LIMIT)
    base.execute("PRAGMA writable_schema=ON")  # without it SQLite refuses a file shorter than its header says
    return base


def fault(layout: Pages, reason: str, last: bytes = b"") -> Fault:
    """Damage, at the byte where the file ends early, or of the page of which SQLite complains, or after the last good row.

    Parameters
    ----------
    layout : Pages
    reason : str
    last : bytes
        Content of the last row that was read.
    """
    path = layout.path
    if layout.short:
        return Fault(path, layout.size, f"the file ends there; by its header it has {layout.told} bytes")
    try:
        with closing(connection(path)) as base:
            complaint = str(base.execute("PRAGMA quick_check(1)").fetchone()[0])
    except ERRORS:
        complaint = ""
    page = re.search(r"[Pp]age (\d+)", complaint)
    at = (int(page[1]) - 1) * layout.page if page else place(path, last) + len(last)
    return Fault(path, min(at, layout.size), reason)


def place(path: Path, content: bytes) -> int:
    """Byte of the file at which something stands that is found there once, 0 when it is not found."""
    if not content:
        return 0
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as whole:
        return max(0, whole.find(content[:256]))
