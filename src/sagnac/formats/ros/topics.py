"""Samples of one topic of ``sensor_msgs/Imu`` from the files of a ROS bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..table import Fault, Table
from .bag import Messages
from .imu import SENSORS, TYPES, Samples, samples_of
from .scan import ROWS


@dataclass(frozen=True)
class Bag:
    """One file of a bag.

    Attributes
    ----------
    path : Path
    size : int
        Bytes.
    topics : mapping
        Topic -> type of its messages.
    messages : callable
        ``messages(topic)`` yields :class:`Messages` in the order of the file and raises :class:`Fault` at damage.
    counts : callable
        Topic -> number of messages, as far as the file tells.
    remarks : tuple of str
    fault : Fault or None
        Damage behind which more topics may lie.
    """

    path: Path
    size: int
    topics: Mapping[str, str]
    messages: Callable[[str], Iterator[Messages]]
    counts: Callable[[], Mapping[str, int]] = field(default=dict)
    remarks: tuple[str, ...] = ()
    fault: Fault | None = None


def open_bags(path: Path, bags: Sequence[Bag], select: str | None) -> Table:
    """Table of one topic of Imu messages.

    Parameters
    ----------
    path : Path
        As the user gave it.
    bags : sequence of Bag
        Files of the bag in the order of time.
    select : str or None
        The topic; may be left out where there is one only.

    Raises
    ------
    InputError
        When there is no such topic, or several and none is chosen, or its messages hold no sensor.
    Fault
        When damage stands before its first message.
    """
    topic = _chosen(path, bags, select)
    first = next(_decoded(bags, topic, [0]), None)
    if first is None:
        raise InputError(f"{path}: no message on {topic}")
    sensors = [s for s in SENSORS if not np.isnan(first.values[s][0, 0])]
    if not sensors:
        raise InputError(
            f"{path}: the messages on {topic} say that they hold no gyro and no accelerometer (covariance -1 or NaN)"
        )
    stamped = first.stamp[0] != 0
    begin = int(first.stamp[0] if stamped else first.received[0])
    remarks = [f"time counted from the first sample on {topic}, at {_utc(begin)} ({begin} ns)"]
    if first.frame:
        remarks.append(f"axes are those of the frame {first.frame!r}")
    if not stamped:
        remarks.append(f"the messages on {topic} carry no time: that at which they were recorded was taken")
    place = [0]

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        import pyarrow as pa

        wanted = [*numeric, *other]
        for samples in _gathered(_decoded(bags, topic, place)):
            time = (samples.stamp if stamped else samples.received) - begin
            columns = {"time [s]": time / 1e9}
            for sensor in sensors:
                for i, header in enumerate(_headers(sensor)):
                    columns[header] = np.ascontiguousarray(samples.values[sensor][:, i])
            yield pa.RecordBatch.from_arrays([pa.array(columns[c]) for c in wanted], names=wanted)

    names = ("time [s]", *(header for s in sensors for header in _headers(s)))
    remarks += [remark for bag in bags for remark in bag.remarks]
    return Table(
        path, names, read, tuple(remarks), lambda: place[0], sum(bag.size for bag in bags), topic, origin=begin / 1e9
    )


def _headers(sensor: str) -> list[str]:
    return [f"{sensor}_{axis} [{SENSORS[sensor][0]}]" for axis in "xyz"]


def _utc(nanoseconds: int) -> str:
    second = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=nanoseconds // 10**9)
    return f"{second:%Y-%m-%dT%H:%M:%S}.{nanoseconds % 10**9:09d}Z"


def _chosen(path: Path, bags: Sequence[Bag], select: str | None) -> str:
    found = {topic: kind for bag in bags for topic, kind in bag.topics.items()}
    imus = sorted(topic for topic, kind in found.items() if kind in TYPES)
    fault = next((bag.fault for bag in bags if bag.fault), None)
    if fault and (not imus or select not in (*imus, None)):
        raise fault
    if not imus:
        kinds = ", ".join(f"{t} ({k})" for t, k in sorted(found.items())[:20]) or "none"
        raise InputError(f"{path}: no topic of type {TYPES[0]}; its topics: {kinds}")
    if select in imus:
        return str(select)
    if select is None and len(imus) == 1:
        return imus[0]
    described = ", ".join(_described(topic, bags) for topic in imus)
    if select is not None:
        kind = f"is of type {found[select]}" if select in found else "is not in it"
        raise InputError(f"{path}: {select} {kind}; its topics of type {TYPES[0]}: {described}")
    raise InputError(
        f"{path}: several topics of type {TYPES[0]}: {described}; choose one, for example --select {imus[0]}"
    )


def _described(topic: str, bags: Sequence[Bag]) -> str:
    """The topic, how many messages it has and the rate of its first ones."""
    count = sum(bag.counts().get(topic, 0) for bag in bags)
    try:
        first = next(_decoded(bags, topic, [0]), None)
    except Fault:
        first = None
    steps = np.diff(first.stamp if first.stamp[0] else first.received) if first else np.empty(0)
    rate = f", {1e9 / np.median(steps):.4g} Hz" if steps.size and np.median(steps) > 0 else ""
    return f"{topic} ({count} messages{rate})" if count else topic


def _decoded(bags: Sequence[Bag], topic: str, place: list[int]) -> Iterator[Samples]:
    """Samples in the order of the files; `place` is set to the bytes read."""
    before = 0
    for bag in bags:
        try:
            for messages in bag.messages(topic) if topic in bag.topics else ():
                yield from samples_of(messages)
                place[0] = before + messages.end
        except OSError as cause:
            raise InputError(f"{bag.path}: cannot read: {cause.strerror}") from cause
        before += bag.size
        place[0] = before


def _gathered(pieces: Iterator[Samples]) -> Iterator[Samples]:
    """The same samples in fewer pieces of at most about :data:`~.scan.ROWS`; those before a fault come before it."""
    waiting: list[Samples] = []
    fault: Fault | None = None
    while True:
        try:
            piece = next(pieces, None)
        except Fault as cause:
            piece, fault = None, cause
        if piece is not None:
            waiting.append(piece)
        if waiting and (piece is None or sum(p.stamp.size for p in waiting) >= ROWS // 2):
            yield _joined(waiting)
            waiting = []
        if piece is None:
            break
    if fault:
        raise fault


def _joined(pieces: list[Samples]) -> Samples:
    return Samples(
        np.concatenate([p.stamp for p in pieces]),
        np.concatenate([p.received for p in pieces]),
        {s: np.vstack([p.values[s] for p in pieces]) for s in SENSORS},
        pieces[-1].end,
        pieces[0].frame,
    )
