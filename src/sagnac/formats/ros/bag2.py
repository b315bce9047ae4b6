"""ROS 2 bags: SQLite files (.db3), and folders of them or of MCAP files. metadata.yaml is not read."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Container, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..table import Fault, Table
from .bag import Messages
from .imu import MESSAGE, TYPES
from .mcap import mcap_bag
from .sqlite_file import ERRORS, Pages, connection, fault, pages, place
from .topics import Bag, open_bags

_ROWS = 1 << 13  # messages taken at a time
_KINDS = (".db3", ".mcap")


class _DamageError(Exception):
    """A row that cannot be."""


def open_table(path: Path, select: str | None = None) -> Table:
    """Open the Imu messages of one topic of a ROS 2 bag.

    Parameters
    ----------
    path : Path
        A .db3 file, or the folder of a bag: all its .db3 or .mcap files in the order of the numbers in their names.
    select : str, optional
        The topic.

    Raises
    ------
    InputError
        When the folder holds no such file, files of both kinds or compressed ones, a file cannot be opened, or as
        :func:`~.topics.open_bags`.
    """
    try:
        files = _files(path) if path.is_dir() else [path]
        bags = [mcap_bag(file) if file.suffix == ".mcap" else _sqlite_bag(file) for file in files]
        return open_bags(path, bags, select)
    except OSError as cause:
        raise InputError(f"{path}: cannot read: {cause.strerror}") from cause


def _files(folder: Path) -> list[Path]:
    inside = sorted(folder.iterdir(), key=lambda p: [(int(t), "") if t.isdecimal() else (0, t) for t in _parts(p.name)])
    packed = [p.name for p in inside if p.name.endswith((".db3.zstd", ".mcap.zstd"))]
    if packed:
        raise InputError(f"{folder}: {packed[0]} is compressed as a whole; unpack it first: zstd -d {packed[0]}")
    found = [p for p in inside if p.suffix in _KINDS]
    if not found:
        raise InputError(f"{folder}: cannot read a folder without .db3 or .mcap files: it is no ROS 2 bag")
    if len({p.suffix for p in found}) > 1:
        raise InputError(f"{folder}: holds .db3 and .mcap files; name one file, or keep one kind in the folder")
    return found


def _parts(name: str) -> list[str]:
    return re.split(r"(\d+)", name)


def _sqlite_bag(path: Path) -> Bag:
    layout = pages(path)
    try:
        with closing(connection(path)) as base:
            topics = base.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
    except ERRORS as cause:
        hint = f"; {layout.beside} lies beside it and holds what was not written into it" if layout.beside else ""
        raise fault(layout, f"SQLite cannot read its table of topics ({cause}){hint}") from cause
    if not all(isinstance(i, int) and all(isinstance(t, str) for t in texts) for i, *texts in topics):
        raise fault(layout, "its table of topics holds what is no topic")

    def messages(topic: str) -> Iterator[Messages]:
        encodings = {number: encoding for number, name, kind, encoding in topics if name == topic and kind in TYPES}
        return _messages(layout, encodings, {number for number, *_ in topics})

    def counts() -> dict[str, int]:
        return _counts(path, {number: name for number, name, *_ in topics})

    short = fault(layout, "") if layout.short else None
    return Bag(path, layout.size, {name: kind for _, name, kind, _ in topics}, messages, counts, fault=short)


def _counts(path: Path, names: dict[int, str]) -> dict[str, int]:
    """Messages of each topic; none when the file is damaged."""
    try:
        with closing(connection(path)) as base:
            found = base.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id").fetchall()
    except ERRORS:
        return {}
    return {names[number]: count for number, count in found if number in names}


def _messages(layout: Pages, encodings: dict[int, str], known: set[int]) -> Iterator[Messages]:
    """Messages of the topics that have an encoding in the order in which they were recorded; `known` are all topics."""
    wanted = ", ".join(str(number) for number in encodings)
    piece = f"CASE WHEN topic_id IN ({wanted}) THEN substr(data, 1, {MESSAGE}) END"
    query = f"SELECT rowid, topic_id, timestamp, {piece} FROM messages ORDER BY rowid"
    rows: list[Any] = []
    last, damage, number = b"", "", 0
    try:
        with closing(connection(layout.path)) as base:
            most = _most(base)
            for row in _sound(base.execute(query), layout, known, encodings):
                number = row[0]
                if row[1] in encodings:
                    last = row[3]
                    rows.append(row)
                if len(rows) == _ROWS:
                    yield _joined(layout, rows, encodings, most)
                    rows = []
    except (_DamageError, *ERRORS) as cause:
        damage = f"after message {number}: {str(cause) or 'a row larger than any can be'}"
    if rows:
        yield _joined(layout, rows, encodings, 0)
    if damage or layout.short:
        raise fault(layout, damage, last)
    if layout.beside:
        raise Fault(
            layout.path, layout.size, f"{layout.beside} lies beside the file and holds what was not written into it"
        )


def _most(base: sqlite3.Connection) -> int:
    """Greatest number of a message; 0 when damage hides it."""
    try:
        return base.execute("SELECT max(rowid) FROM messages").fetchone()[0] or 0
    except ERRORS:
        return 0


def _sound(rows: Iterable[Any], layout: Pages, known: set[int], wanted: Container[int]) -> Iterator[Any]:
    """Rows up to the first that cannot be."""
    before = None
    for row in rows:
        number, topic, time, data = row
        if not isinstance(number, int) or not isinstance(time, int) or topic not in known:
            raise _DamageError("a message that cannot be")
        if topic in wanted and not isinstance(data, bytes):
            raise _DamageError("a message without content")
        if before is not None and number <= before:
            raise _DamageError("messages out of order")
        if layout.cut_row is not None and number >= layout.cut_row:
            raise _DamageError("a message on a page that is not whole")
        before = number
        yield row


def _joined(layout: Pages, rows: list[Any], encodings: dict[int, str], most: int) -> Messages:
    pieces = [row[3] for row in rows]
    last = np.cumsum([len(piece) for piece in pieces])
    received: NDArray[np.int64] = np.array([row[2] for row in rows], dtype=np.int64)

    def at_message(i: int, reason: str) -> Fault:
        return Fault(layout.path, place(layout.path, pieces[i]), f"message {rows[i][0]}: {reason}")

    end = int(layout.size * min(1.0, rows[-1][0] / most)) if most else layout.size
    data = np.frombuffer(b"".join(pieces), dtype=np.uint8)
    first = np.concatenate([[0], last[:-1]])
    return Messages(data, first, last, received, encodings[rows[0][1]], end, at_message)
