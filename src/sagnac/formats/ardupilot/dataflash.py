"""ArduPilot DataFlash: messages IMU, or ACC and GYR, of one instance, with the autopilot's correction taken back.

Labels, units and what is logged where: ArduPilot, ``libraries/AP_InertialSensor/LogStructure.h`` and
``AP_InertialSensor_Logging.cpp``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...frames import Array
from ..join import remark
from ..table import Fault, Table
from . import correction
from .records import SAMPLES, Log, walk
from .rows import ALONG, HEADERS, TEMPERATURE, Pass, corrections
from .survey import Key, Survey, survey


def open_table(path: Path, select: str | None = None) -> Table:
    """Open a DataFlash log.

    Parameters
    ----------
    path : path
    select : str, optional
        Instance of the sensors, ``0``; or messages and instance, ``IMU/0`` or ``RAW/0`` (ACC and GYR, taken where there are any).
        Needed where there are several.

    Raises
    ------
    InputError
        When there are no samples, several instances are and none was chosen, or the parameters are not there without which
        the autopilot's correction cannot be taken back.
    """
    keys, found = survey(path, select)
    reader = _Reader(path, keys, found)
    remarks = reader.remarks()

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        import pyarrow as pa

        types = dict.fromkeys(numeric, pa.float64())
        for columns in reader.rows(remarks):
            names = [*numeric, *other]
            yield pa.RecordBatch.from_arrays([pa.array(columns[n], types.get(n)) for n in names], names=names)

    choice = f"{'IMU' if len(keys) == 1 else 'RAW'}/{reader.instance}"
    return Table(path, reader.columns, read, remarks, lambda: reader.log.position, path.stat().st_size, choice)


def _filtered(parameters: correction.Parameters) -> list[str]:
    """A word on messages that hold filtered samples.

    AP_InertialSensor_Backend.cpp, log_accel_raw and log_gyro_raw: bit 1 of INS_LOG_BAT_OPT, unless INS_LOG_BAT_MASK is 0. With
    bit 0 (rate of the sensor) or 2 (both) beside it, later versions log filtered and unfiltered batches in turn. For gyros
    INS_RAW_LOG_OPT says so since it came, bit 2; with bit 3 both are logged, the filtered ones under instances of their own.
    """
    raw, batch = "INS_RAW_LOG_OPT", "INS_LOG_BAT_OPT"
    known = {n: int(v) for n, v in parameters.items() if n in {raw, batch} and math.isfinite(v)}
    bits = known.get(batch, 0) if parameters.get("INS_LOG_BAT_MASK", 1.0) else 0
    how = "were" if bits & 0b111 == 0b010 else "may in part have been" if bits & 0b100 or bits & 0b11 == 0b11 else ""
    found = {"ACC": ("accelerometers", how, batch), "GYR": ("gyros", how, batch)}
    if raw in known:
        found["GYR"] = "gyros", "were" if known[raw] & 0b1100 == 0b0100 else "", raw
    return [
        f"samples in {name} {how} logged behind the filters of the {sensors} ({cause})"
        for name, (sensors, how, cause) in found.items()
        if how
    ]


class _Reader:
    """Rows of one choice, any number of times."""

    def __init__(self, path: Path, keys: tuple[Key, ...], found: Survey) -> None:
        self.path, self.keys, self.found, self.log = path, keys, found, Log()
        self.instance = keys[0][1]
        self.first = corrections(path, found.parameters, self.instance)
        warm = self.instance in found.temperature
        if not warm and any(c.thermal for c in self.first.values()):
            raise InputError(f"{path}: a correction for temperature was applied, and no temperature is in messages IMU")
        along = [name for label, name in ALONG.items() if label in found.labels[keys[0]]]
        self.columns = ("time [s]", *HEADERS["ACC"], *HEADERS["GYR"], *([TEMPERATURE] if warm else []), *along)

    def remarks(self) -> list[str]:
        """What the beginning of the log tells; reading adds what only the whole of it does."""
        known = self.found.parameters
        named = " and ".join(name for name, _ in self.keys)
        taken = correction.text(self.first, known)
        whose = f"instance {self.instance} ({correction.names(self.instance)['accel']}_X, ...)"
        out = [f"messages {named}, {whose}: the autopilot's correction of the samples was taken back: {taken}"]
        filters = [f"{n} {known[n]:g} Hz" for n in ("INS_ACCEL_FILTER", "INS_GYRO_FILTER") if n in known]
        if len(self.keys) == 1:
            out.append(
                f"samples in IMU were low-pass filtered ({', '.join(filters) or 'cut-off unknown'}) and thinned out"
            )
            return out
        out += _filtered(known)
        joined = remark(*(self.found.time(key) for key in self.keys))
        return out + ([joined] if joined else [])

    def rows(self, remarks: list[str]) -> Iterator[dict[str, Array]]:
        """Columns under their header texts, many rows at a time; at the end `remarks` grows."""
        self.log = Log()
        state = Pass(self.path, self.keys, self.found)
        try:
            for piece in walk(self.path, self.log, lambda name: name in SAMPLES or name in {"PARM", "DSF"}):
                for part in state.stretches(piece):
                    yield from state.rows(part)
        except Fault:
            remarks += [text for text in state.report() if text not in remarks]
            raise
        remarks += [text for text in state.report() if text not in remarks]
