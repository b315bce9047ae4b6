"""One driver at a time in a folder: a lock that the system takes away with the process, however that ends."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from ..errors import InputError

_FREE = 64  # bytes after which the locked one stands: Windows lets nobody read a locked byte


@contextmanager
def locked(path: Path, what: str) -> Iterator[None]:
    """Hold the lock of a file while the block runs.

    The file stays where it is afterwards, and means nothing by itself.

    Parameters
    ----------
    path : Path
        Made when it is not there.
    what : str
        What is locked, for the message.

    Raises
    ------
    InputError
        When another process holds it, with its number, or the file cannot be written.
    """
    try:
        stream = path.open("a+b")
    except OSError as cause:
        raise InputError(f"cannot write {path}: {cause.strerror}") from cause
    with stream:
        try:
            _take(stream)
        except OSError as cause:
            stream.seek(0)
            holder = stream.read(_FREE).decode(errors="replace").strip("\0 ") or "another process"
            raise InputError(f"{what}: {holder} is at work on it; wait for it, or stop it first") from cause
        with contextlib.suppress(OSError):  # a full disk: nobody learns our number, that is all
            stream.truncate(0)
            stream.write(f"process {os.getpid()} on {socket.gethostname()}"[:_FREE].encode())
            stream.flush()
        yield


if sys.platform == "win32":
    import msvcrt

    def _take(stream: IO[bytes]) -> None:
        stream.seek(_FREE)
        msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(stream: IO[bytes]) -> None:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
