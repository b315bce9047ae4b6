"""What an ArduPilot DataFlash log holds, told by its beginning."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import InputError
from ..join import Ticks, rate
from ..table import Fault
from .correction import corrections
from .records import SAMPLES, Found, Log, Record, clock, heat, walk

_BYTES = 1 << 22  # that are looked at
_KEPT = 1 << 17  # samples of each sensor whose times are kept

Key = tuple[str, int]
"""Message (IMU, ACC, GYR) and instance."""


@dataclass
class Survey:
    """What the beginning of a log tells.

    Attributes
    ----------
    pieces : dict of Key to list of ndarray of int64, us
        Times of samples.
    labels : dict of Key to tuple of str
    parameters : dict of str to float
        First value of each.
    temperature : dict of int to float, degC
        First one of each instance.
    """

    pieces: dict[Key, list[Ticks]] = field(default_factory=dict)
    labels: dict[Key, tuple[str, ...]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    temperature: dict[int, float] = field(default_factory=dict)

    def time(self, key: Key) -> Ticks:
        """Times of the first samples, us."""
        return np.concatenate(self.pieces[key])

    def choices(self) -> dict[str, tuple[Key, ...]]:
        """What can be chosen, and the messages that it is made of."""
        out: dict[str, tuple[Key, ...]] = {}
        for instance in sorted({i for _, i in self.pieces}):
            raw, whole = (("ACC", instance), ("GYR", instance)), ("IMU", instance)
            if all(key in self.pieces for key in raw):
                out[f"RAW/{instance}"] = raw
            if whole in self.pieces:
                out[f"IMU/{instance}"] = (whole,)
        return out


def survey(path: Path, select: str | None) -> tuple[tuple[Key, ...], Survey]:
    """The messages that were chosen, and what the beginning of the log tells.

    The first 4 MB are read, and more only until there are samples, those asked for, and the parameters that were applied to
    them.

    Raises
    ------
    InputError
        When there are no samples, or those of several instances and none was chosen, or not the one that was.
    """
    found = Survey()
    log = Log()
    try:
        for piece in walk(path, log, lambda name: name in SAMPLES or name == "PARM"):
            for part in piece:
                _note(found, part)
            if log.position > _BYTES and _enough(found, select):
                break
    except Fault:  # reading comes to it again, and hands out what lies before
        if not found.pieces:
            raise
    if not found.choices():
        raise InputError(
            f"{path}: no messages IMU, and not both ACC and GYR; the bits 'IMU' and 'IMU_RAW' of LOG_BITMASK make them logged"
        )
    return _chosen(path, found, select), found


def samples(found: Found) -> Iterator[tuple[Key, Found]]:
    """Messages with samples, by instance."""
    name, instance = SAMPLES[found.name]
    if "I" not in (found.records.dtype.names or ()):
        yield (name, instance), found
        return
    for i in np.unique(found.records["I"]):
        mine = found.records["I"] == i
        yield (name, int(i)), Found(found.name, found.places[mine], found.records[mine])


def ticks(records: Record) -> Ticks:
    """Times of samples, us since the autopilot was started."""
    name = clock(records.dtype)
    return records[name].astype(np.int64) * (1000 if name == "TimeMS" else 1)


def parameters(found: Found, wanted: Callable[[str], bool]) -> Iterator[tuple[int, str, float]]:
    """Place, name and value of the wanted parameters among messages PARM."""
    known = {raw: raw.decode("ascii", "replace") for raw in np.unique(found.records["Name"]).tolist()}
    ours = {raw for raw, name in known.items() if wanted(name)}
    for k in np.flatnonzero(np.isin(found.records["Name"], list(ours))) if ours else ():
        yield int(found.places[k]), known[found.records["Name"][k].item()], float(found.records["Value"][k])


def _note(found: Survey, part: Found) -> None:
    labels = part.records.dtype.names or ()
    if part.name == "PARM":
        for _, name, value in parameters(part, lambda name: name.startswith(("INS", "AHRS_", "CUST_ROT"))):
            found.parameters.setdefault(name, value)
        return
    for key, mine in samples(part):
        kept = found.pieces.setdefault(key, [])
        found.labels[key] = labels
        if sum(piece.size for piece in kept) < _KEPT:
            kept.append(ticks(mine.records))
        warmth = heat(mine.records) if key[0] == "IMU" else None
        if warmth is not None:
            found.temperature.setdefault(key[1], float(warmth[0]))


def _enough(found: Survey, select: str | None) -> bool:
    choices = found.choices()
    mine = [keys for name, keys in choices.items() if select is None or select in {name, name[4:]}]
    if not mine:
        return False
    try:
        corrections(found.parameters, mine[0][0][1])
    except InputError:  # a parameter may still come
        return False
    return True


def _chosen(path: Path, found: Survey, select: str | None) -> tuple[Key, ...]:
    choices = found.choices()
    instances = sorted({name[4:] for name in choices}, key=int)
    if select is None and len(instances) == 1:
        select = instances[0]
    for name in (select, f"RAW/{select}", f"IMU/{select}"):
        if name in choices:
            return choices[name]
    listed = "; ".join(f"{name} ({_rates(found, keys)})" for name, keys in choices.items())
    wrong = f"there is no {select!r} in this log, which" if select is not None else "this log"
    raise InputError(
        f"{path}: {wrong} holds {listed}; choose an instance with --select {instances[0]}, or the messages too with "
        f"--select {next(iter(choices))}"
    )


def _rates(found: Survey, keys: tuple[Key, ...]) -> str:
    return ", ".join(f"{name} {rate(found.time((name, i))):.4g} Hz" for name, i in keys)
