"""Tables of samples in the files that people have, one module a format.

Every format module has ``open_table(path)``, or ``open_table(path, select)`` where one file may hold several recordings; it
returns a :class:`Table`. Which sensor is meant, in which unit, is only known here where the format itself fixes it.
"""

from __future__ import annotations

import stat
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from ..errors import InputError
from .table import Fault, Table

__all__ = ["FORMATS", "Fault", "Format", "Table", "format_of", "open_table"]

_HEAD = 1 << 16  # as far as the readers of text look for their first line behind comments
_MARK = b"\xef\xbb\xbf"  # byte order mark of UTF-8
_COMMENTS = (b"#", b"%", b"//")


@dataclass(frozen=True)
class Format:
    """A format and how it is known.

    Attributes
    ----------
    name : str
        For messages.
    module : str
    recognised : callable
        Tells from the first 64 kB, without a byte order mark, whether a file is of this format.
    several : bool
        Whether a file may hold several recordings, of which `select` names one.
    """

    name: str
    module: str
    recognised: Callable[[bytes], bool]
    several: bool = False


def _begins(*magic: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(magic)


def _hdf5(head: bytes) -> bool:
    """Whether the signature stands where HDF5 allows it: at 0, 512, 1024, 2048 bytes."""
    return any(head[at : at + 8] == b"\x89HDF\r\n\x1a\n" for at in (0, 512, 1024, 2048))


def _split(head: bytes) -> tuple[list[bytes], bytes]:
    """Comment lines, and the first line that is neither blank nor comment; that one is empty where there is none."""
    comments: list[bytes] = []
    for raw in head.splitlines():
        line = raw.strip()
        if line and not line.startswith(_COMMENTS):
            return comments, line
        comments.append(line)
    return comments, b""


def _xsens(head: bytes) -> bool:
    """Whether it is a text export of MT Manager."""
    from .text.xsens_marks import is_export

    comments, line = _split(head)
    return b"\0" not in head and is_export(
        [c.decode(errors="replace") for c in comments], line.decode(errors="replace")
    )


def _bare_numbers(head: bytes) -> bool:
    """Whether the first line that says anything is numbers alone."""
    fields = _split(head)[1].replace(b",", b" ").replace(b";", b" ").split()
    try:
        return bool([float(field) for field in fields])
    except ValueError:
        return False


FORMATS = (
    Format("Parquet", "parquet", _begins(b"PAR1")),
    Format("PX4 ULog", "px4.ulog", _begins(b"ULog\x01\x12\x35"), several=True),
    Format("ArduPilot DataFlash", "ardupilot.dataflash", _begins(b"\xa3\x95\x80"), several=True),
    Format("ROS 1 bag", "ros.bag1", _begins(b"#ROSBAG V"), several=True),
    Format("MCAP", "ros.mcap", _begins(b"\x89MCAP0\r\n"), several=True),
    Format("ROS 2 bag (SQLite)", "ros.bag2", _begins(b"SQLite format 3\0"), several=True),
    Format("Inertial Explorer IMR", "imr", _begins(b"$IMURAW")),
    Format("MATLAB 5", "arrays.mat5", _begins(b"MATLAB 5.0 MAT-file")),
    Format("HDF5 or MATLAB 7.3", "arrays.hdf5", _hdf5),
    Format("Xsens text export", "text.xsens", _xsens),
    Format("text of numbers", "text.numbers", _bare_numbers),
    Format("CSV", "text.csv", _begins(b"")),  # whatever is left
)
"""In the order in which they are tried."""


def format_of(path: str | Path) -> Format:
    """The format of a file, told by its first bytes; of a folder, by its being a ROS 2 bag.

    Raises
    ------
    InputError
        When the file is missing or empty, or is none: a pipe cannot be read twice.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            return next(f for f in FORMATS if f.module == "ros.bag2")
        if not stat.S_ISREG(mode):  # opening a pipe would wait, reading it would use it up
            kind = "a pipe" if stat.S_ISFIFO(mode) else "no file"
            raise InputError(f"{path}: is {kind}; save the recording as a file first")
        with path.open("rb") as stream:
            head = stream.read(_HEAD)
    except OSError as cause:
        raise InputError(f"{path}: cannot read: {cause.strerror}") from cause
    if not head:
        raise InputError(f"{path}: the file is empty")
    return next(f for f in FORMATS if f.recognised(head.removeprefix(_MARK)))


def open_table(path: str | Path, select: str | None = None) -> Table:
    """Open a file of samples, its format told by its first bytes.

    Parameters
    ----------
    path : path
    select : str, optional
        Which of several recordings in the file: the topic of a bag, the instance of a sensor.

    Raises
    ------
    InputError
        When the file is missing, empty or of no known format, or `select` names nothing in it.
    """
    path = Path(path)
    found = format_of(path)
    module = import_module(f".{found.module}", __name__)
    if found.several:
        opened = module.open_table(path, select)
    elif select is not None:
        raise InputError(
            f"{path}: a file of this format ({found.name}) holds one recording; --select {select} has no use"
        )
    else:
        opened = module.open_table(path)
    assert isinstance(opened, Table)
    return replace(opened, format=found.name)
