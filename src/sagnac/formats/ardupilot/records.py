"""The messages of an ArduPilot DataFlash log in their order.

Source: ArduPilot, ``libraries/AP_Logger/LogStructure.h`` (message FMT, characters of formats, heads of messages).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..blocks import Blocks
from ..table import Fault

_KINDS: dict[str, Any] = dict.fromkeys("BM", "<u1") | dict.fromkeys("hc", "<i2") | dict.fromkeys("HC", "<u2")
_KINDS |= (
    dict.fromkeys("ieL", "<i4") | dict.fromkeys("IE", "<u4") | {"b": "<i1", "q": "<i8", "Q": "<u8", "a": ("<i2", (32,))}
)
_KINDS |= {"g": "<f2", "f": "<f4", "d": "<f8", "n": "S4", "N": "S16", "Z": "S64"}
FIELDS = {"ACC": ("AccX", "AccY", "AccZ"), "GYR": ("GyrX", "GyrY", "GyrZ")}
"""Labels of the samples; a message IMU has both."""
SAMPLES = {name + n: (name, int(n or 1) - 1) for name in ("IMU", "ACC", "GYR") for n in ("", "1", "2", "3")}
"""Messages with samples: what they hold, and the instance of those of old logs (IMU2), which have no field for it."""
_OPTIONAL = {"I": "u", "T": "f", "Temp": "f"}
_FMT, _FMT_LENGTH = 0x80, 89
_HEAD = 3
_MANY = 1 << 16  # messages listed at a time

Record = NDArray[Any]
"""Structured array, one field for each label of a message."""


@dataclass(frozen=True)
class Found:
    """Messages of one kind in a piece of the file.

    Attributes
    ----------
    name : str
    places : ndarray of int64, shape (n,)
        Where in the file they begin.
    records : structured ndarray, shape (n,)
    """

    name: str
    places: NDArray[np.int64]
    records: Record


@dataclass
class Log:
    """What a walk through a file has met so far.

    Attributes
    ----------
    names : dict of int to str
        Messages that are defined.
    dtypes : dict of int to dtype
        Of those that are wanted.
    position : int
        First byte that was not looked at.
    """

    names: dict[int, str] = field(default_factory=dict)
    dtypes: dict[int, Any] = field(default_factory=dict)
    position: int = 0


def walk(path: Path, log: Log, wanted: Callable[[str], bool]) -> Iterator[list[Found]]:
    """Wanted messages, those of one piece of the file at a time.

    Parameters
    ----------
    path : path
    log : Log
        A new one; filled on the way.
    wanted : callable
        Tells by the name of a message whether it is wanted.

    Raises
    ------
    Fault
        At the first message that is none or unfinished, after all before it was yielded.
    """
    from ...kernels import records

    lengths, ours = np.zeros(256, dtype=np.int32), np.zeros(256, dtype=np.uint8)
    lengths[_FMT] = _FMT_LENGTH
    places, kinds = np.empty(_MANY, dtype=np.int64), np.empty(_MANY, dtype=np.uint8)
    at = 0
    with Blocks(path, 0, path.stat().st_size) as blocks:
        while True:
            at, count, why = records.walk_dataflash(blocks.data, at, lengths, ours, places, kinds)
            log.position = blocks.base + at
            if count:
                yield [
                    _found(blocks, log, int(k), places[:count][kinds[:count] == k]) for k in np.unique(kinds[:count])
                ]
            if why == records.DAMAGED:
                raise Fault(path, log.position, "no DataFlash message stands here")
            if why == records.CONTROL:
                kind = _define(path, log, blocks.data[at + _HEAD : at + _FMT_LENGTH], lengths, wanted)
                ours[kind] = kind in log.dtypes
                at += _FMT_LENGTH
            elif why == records.UNFINISHED:
                if not blocks.more(at):
                    break
                at = 0
        if blocks.data.size:
            raise Fault(path, log.position, "the file ends within a message")


def _found(blocks: Blocks, log: Log, kind: int, places: NDArray[np.int64]) -> Found:
    from ...kernels.records import gather

    dtype = log.dtypes[kind]
    return Found(log.names[kind], blocks.base + places, gather(blocks.data, places, dtype.itemsize).view(dtype)[:, 0])


def _define(
    path: Path, log: Log, content: NDArray[np.uint8], lengths: NDArray[np.int32], wanted: Callable[[str], bool]
) -> int:
    """Take a definition; the kind that it defines."""
    raw = content.tobytes()
    kind, length = raw[0], raw[1]
    try:
        name, form, labels = (part.split(b"\0")[0].decode("ascii") for part in (raw[2:6], raw[6:22], raw[22:]))
    except UnicodeDecodeError as cause:
        raise Fault(path, log.position, f"a definition of messages {kind} that is no text") from cause
    if log.names.setdefault(kind, name) != name or (lengths[kind] and lengths[kind] != length):
        raise Fault(path, log.position, f"messages {kind} are defined twice and differently")
    lengths[kind] = length
    if kind not in log.dtypes and wanted(name):
        log.dtypes[kind] = _dtype(path, log, name, form, labels, length)
    return kind


def _dtype(path: Path, log: Log, name: str, form: str, labels: str, length: int) -> Any:
    fields = labels.split(",")
    try:
        dtype = np.dtype([(label, _KINDS[c]) for label, c in zip(fields, form, strict=True)])
    except (KeyError, ValueError) as cause:
        raise Fault(path, log.position, f"the definition of {name}, {form!r} {labels!r}, cannot be") from cause
    if dtype.itemsize + _HEAD != length:
        raise Fault(path, log.position, f"messages {name} are said to have {length} bytes, their fields make other")
    needed = {"PARM": {"Name": "S", "Value": "f"}, "DSF": {"Dp": "u"}}.get(name, {})
    if name in SAMPLES:
        needed = dict.fromkeys((a for key, axes in FIELDS.items() if name[:3] in {key, "IMU"} for a in axes), "f")
        needed |= {clock(dtype): "u"} | {n: kind for n, kind in _OPTIONAL.items() if n in fields}
    wrong = [n for n, kind in needed.items() if n not in fields or dtype[n].kind != kind]
    if wrong:
        raise InputError(
            f"{path}: messages {name} have no {', '.join(wrong)} of the kind that is known; they have {dtype}"
        )
    return dtype


def clock(dtype: Any) -> str:
    """Label of the time of samples."""
    return next((n for n in ("SampleUS", "TimeUS", "TimeMS") if n in dtype.names), "TimeUS")


@np.errstate(invalid="ignore")
def heat(records: Record) -> NDArray[np.float64] | None:
    """Temperatures of messages IMU, degC; None when they have none."""
    label = next((n for n in ("T", "Temp") if n in (records.dtype.names or ())), None)
    return None if label is None else records[label].astype(float)
