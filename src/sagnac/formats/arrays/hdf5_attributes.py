"""Attributes of HDF5 datasets, and whether the HDF5 library can be let loose on them.

It walks the heaps with texts of variable length by the sizes that stand in them, and goes round for ever where damage has
made one of them zero. Layout: The HDF Group, "HDF5 File Format Specification", III.E (global heap).
"""

from __future__ import annotations

import math
import mmap
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .variables import WIDEST

LONGEST_TEXT = 64
_SIGNATURE = b"GCOL\x01"
_HEAD = 16  # signature, version, three bytes without meaning, size of the heap
_OBJECT = 16  # index, references, four bytes without meaning, size of the data


def attribute(item: Any, key: str, sound: Callable[[], bool]) -> Any:
    """Value of a small attribute that is text, else None: damage can make it claim any size and type.

    Parameters
    ----------
    item : h5py object
    key : str
    sound : callable
        Whether texts of variable length can be read, see :func:`heaps_are_sound`; asked where there are some.
    """
    import h5py

    known = item.attrs.get_id(key)
    if math.prod(known.shape or (1,)) > WIDEST or known.dtype.itemsize > 4 * LONGEST_TEXT:
        return None
    text = h5py.check_string_dtype(known.dtype)
    if text is None or (text.length is None and not sound()):
        return None
    return item.attrs[key]


def units(item: Any, width: int, sound: Callable[[], bool]) -> tuple[str, ...]:
    """Attribute ``units`` or ``unit`` of a dataset: one text for all columns or one for each."""
    for key in ("units", "unit"):
        if key in item.attrs:
            given = np.ravel(attribute(item, key, sound)).tolist()
            texts = [t.decode(errors="replace") if isinstance(t, bytes) else t for t in given]
            if all(isinstance(t, str) for t in texts):
                return tuple(texts * width) if len(texts) == 1 else tuple(texts) if len(texts) == width else ()
    return ()


def heaps_are_sound(path: Path) -> bool:
    """Whether every heap in the file can be walked from its beginning to its end."""
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at = data.find(_SIGNATURE)
        while at >= 0:
            if not _walkable(data, at):
                return False
            at = data.find(_SIGNATURE, at + 1)
    return True


def _walkable(data: mmap.mmap, begin: int) -> bool:
    head = data[begin : begin + _HEAD]
    if len(head) < _HEAD:
        return False
    end = begin + int(struct.unpack("<Q", head[8:])[0])
    if end > len(data):
        return False
    at = begin + _HEAD
    while at + _OBJECT <= end:
        index, size = struct.unpack("<H6xQ", data[at : at + _OBJECT])
        step = _OBJECT + -(-size // 8) * 8 if index else size  # index 0: free space, its head counted in
        if not step or at + step > end:
            return False
        at += step
    return True
