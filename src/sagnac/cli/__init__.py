"""The command line: each command is a thin shell over a function of the library."""

from __future__ import annotations

import atexit
import gc
import os
import sys

from ..errors import SagnacError
from .commands import app

__all__ = ["app", "main"]


_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Matrices are small here: threads that share one out wait for each other, on a busy machine ten times as long as it takes."""


def main() -> None:
    """Run the command line; errors become one line and an exit status (2 bad input, 1 the data do not support it)."""
    for name in _ONE_THREAD:  # NumPy reads them when it is loaded, which is later
        os.environ.setdefault(name, "1")
    gc.set_threshold(200_000, 50, 100)  # a command lives for seconds: looking for garbage costs more than keeping it
    atexit.register(gc.freeze)  # nor at the end, where a last look at all that was loaded takes up to 0.08 s
    try:
        app()
    except SagnacError as error:
        print(f"sagnac: {error}", file=sys.stderr)  # noqa: T201 - this is the terminal
        sys.exit(error.exit_status)
    except BrokenPipeError:  # the reader went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except KeyboardInterrupt:
        print("sagnac: interrupted; nothing half-written is left behind", file=sys.stderr)  # noqa: T201
        sys.exit(130)
