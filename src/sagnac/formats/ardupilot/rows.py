"""Rows of a DataFlash log: the samples with the autopilot's correction taken back, by the parameters in force at each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...frames import Array
from ..join import Joiner, Stream, usual_step
from . import correction
from .records import FIELDS, SAMPLES, Found, heat
from .survey import Key, Survey, parameters, samples, ticks

HEADERS = {"ACC": [f"accel_{a} [m/s^2]" for a in "xyz"], "GYR": [f"gyro_{a} [rad/s]" for a in "xyz"]}
"""Columns made of the samples."""
ALONG = {"EG": "gyro_error_count", "EA": "accel_error_count", "GH": "gyro_health", "AH": "accel_health"}
ALONG |= {"ErrG": "gyro_error_count", "ErrA": "accel_error_count", "GyHlt": "gyro_health", "AcHlt": "accel_health"}
"""Labels of IMU that are passed on, and their columns."""
TEMPERATURE = "temperature [degC]"
_KINDS = {"ACC": "accel", "GYR": "gyro"}
_CHANGES = 5  # that are told one by one


def corrections(path: Path, known: Mapping[str, float], instance: int) -> dict[str, correction.Correction]:
    """See :func:`ardupilot.corrections`; messages name the file."""
    try:
        return correction.corrections(known, instance)
    except InputError as cause:
        raise InputError(f"{path}: {cause}") from cause


class Pass:
    """One pass through a log: the parameters in force, and what waits for its counterpart.

    Parameters
    ----------
    path : path
    keys : tuple of Key
        Messages that are read: IMU, or ACC and GYR.
    found : Survey
    """

    def __init__(self, path: Path, keys: tuple[Key, ...], found: Survey) -> None:
        self._path, self._names, self._instance = path, [name for name, _ in keys], keys[0][1]
        self._known = dict(found.parameters)
        self._now = corrections(path, self._known, self._instance)
        self._warmth = np.array([found.temperature.get(self._instance, np.nan)])  # the last one
        step = usual_step(found.time(keys[0])) if len(keys) == 2 else 0.0
        self._joiner = Joiner(str(path), step)
        self._time, self._changes, self._dropped = 0.0, list[tuple[float, str]](), 0

    def stretches(self, piece: list[Found]) -> Iterator[dict[str, Found]]:
        """Samples of this instance by message, between changes of the parameters, which are taken over."""
        changed: list[tuple[int, str, float]] = []
        mine: dict[str, Found] = {}
        for part in piece:
            if part.name == "PARM":
                changed += list(parameters(part, lambda name: correction.concerns(name, self._instance)))
            elif part.name == "DSF":
                self._dropped = int(part.records["Dp"][-1])
            elif part.name in SAMPLES:
                mine |= {name: found for (name, i), found in samples(part) if i == self._instance}
        low = 0
        for place, name, value in changed:
            if self._known.get(name) != value:
                yield {name: _between(found, low, place) for name, found in mine.items()}
                self._change(name, value)
                low = place
        yield {name: _between(found, low, np.iinfo(np.int64).max) for name, found in mine.items()}

    def _change(self, name: str, value: float) -> None:
        self._known[name] = value
        self._now = corrections(self._path, self._known, self._instance)
        if not self._changes or self._changes[-1][0] != self._time:
            self._changes.append((self._time, ""))
        self._changes[-1] = self._time, correction.text(self._now, self._known)  # x, y and z count as one change

    def rows(self, mine: Mapping[str, Found]) -> Iterator[dict[str, Array]]:
        """Columns of a stretch under their header texts."""
        whole = mine.get("IMU")
        told = heat(whole.records) if whole is not None else None
        places, warmth = np.empty(0, dtype=np.int64), self._warmth
        if whole is not None and told is not None:
            places, warmth = whole.places, np.append(self._warmth, told)
            self._warmth = warmth[-1:]
        streams = {}
        for name in self._names:
            part = mine.get(name)
            if part is not None and part.places.size:
                T = warmth[np.searchsorted(places, part.places, "right")]
                self._time = ticks(part.records)[-1] / 1e6
                if name == "IMU":
                    yield self._columns(self._stream("ACC", part, T), self._stream("GYR", part, T), part)
                else:
                    streams[name] = self._stream(name, part, T)
        if streams:
            accel, gyro = self._joiner.add(streams.get("ACC"), streams.get("GYR"))
            if gyro.time.size:
                yield self._columns(accel, gyro, None)

    @np.errstate(invalid="ignore", over="ignore")  # values that are no numbers are refused where rows are checked
    def _stream(self, name: str, part: Found, temperature: Array) -> Stream:
        values = np.stack([part.records[axis] for axis in FIELDS[name]], axis=1, dtype=float)
        along = temperature[:, None] if name == "GYR" else np.empty((temperature.size, 0))
        return Stream(ticks(part.records), self._now[_KINDS[name]].undo(values, temperature), along)

    def _columns(self, accel: Stream, gyro: Stream, part: Found | None) -> dict[str, Array]:
        out = {"time [s]": gyro.time / 1e6, TEMPERATURE: gyro.other[:, 0]}
        for name, stream in (("ACC", accel), ("GYR", gyro)):
            out |= dict(zip(HEADERS[name], stream.values.T, strict=True))
        if part is not None:
            out |= {n: part.records[label] for label, n in ALONG.items() if label in (part.records.dtype.names or ())}
        return out

    def report(self) -> list[str]:
        """What the whole log tells."""
        self._joiner.finish()
        out = [
            f"the autopilot changed its correction, from {time:.3f} s on was taken back: {text}"
            for time, text in self._changes[:_CHANGES]
        ]
        if len(self._changes) > _CHANGES:
            out.append(f"the autopilot changed its correction {len(self._changes) - _CHANGES} times more")
        if self._dropped:
            out.append(f"the logger lost {self._dropped} messages")
        if self._joiner.lost:
            out.append(
                f"gyro samples left out for lack of accelerometers near enough before and after: {self._joiner.lost}"
            )
        return out


def _between(found: Found, low: int, high: int) -> Found:
    a, b = np.searchsorted(found.places, [low, high])
    return Found(found.name, found.places[a:b], found.records[a:b])
