"""Numba loops and nothing else: arrays in, arrays out. Compiled on first use and cached on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def is_cold(kernel: Any) -> bool:
    """Whether a kernel has to be compiled before its first call on this machine.

    Parameters
    ----------
    kernel : numba dispatcher
    """
    name = kernel.py_func.__name__
    return not any(Path(kernel.stats.cache_path).glob(f"*{name}-*.nbi"))
