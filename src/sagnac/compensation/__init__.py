"""Apply a calibration to a recording: readings in, inputs out, of any size."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration import Calibration
from ..errors import DataError, InputError
from ..files import write_atomically
from ..recording import SENSORS, Batch, Recording, header_parts
from ..sensors import Correction, check_whole, correction, invert

_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}
_RIG_UNITS = {"temperature": "K"}


def corrections(calibration: Calibration, recording: Recording) -> dict[str, Correction]:
    """The models of a calibration that apply to a recording's sensors.

    Raises
    ------
    InputError
        When the calibration is for raw counts and the recording is not, or the reverse, or a triad lacks an axis.
    DataError
        When the calibration has no model of any sensor in the recording.
    """
    recording.need_whole()
    out = {}
    for sensor in SENSORS:
        model = correction(calibration.values(), sensor, ratio=calibration.misalignment == "input-axis")
        if model is None or sensor not in recording.has:
            continue
        if model.counts != (sensor in recording.counts):
            here, there = ("raw counts", "SI units") if model.counts else ("SI units", "raw counts")
            raise InputError(
                f"the calibration of the {sensor} triad is for readings in {here}, but {recording.name} gives {there}: open it "
                "with the same header units and --scale as for the calibration"
            )
        check_whole({p.name: p.unit for p in calibration.parameters}, model)
        out[sensor] = model
    if not out:
        raise DataError(
            f"the calibration says nothing about the sensors in {recording.name} ({', '.join(recording.has)})"
        )
    return out


def compensate(batch: Batch, models: dict[str, Correction]) -> dict[str, np.ndarray]:
    """Inputs of each calibrated sensor, shape (n, 3), m/s^2 and rad/s.

    Raises
    ------
    DataError
        When g-sensitive gyros come without accelerometers, or a reading has no input that explains it.
    """
    out: dict[str, np.ndarray] = {}
    if "accel" in models and batch.accel is not None:
        out["accel"] = invert(models["accel"], batch.accel)
    if "gyro" in models and batch.gyro is not None:
        if models["gyro"].needs_force and batch.accel is not None and "accel" not in models:
            raise DataError(
                "the gyros answer to the specific force, and this calibration has none of the accelerometers that measure it: "
                "calibrate accelerometers and gyros together"
            )
        out["gyro"] = invert(models["gyro"], batch.gyro, out.get("accel"))
    return out


def stream(calibration: Calibration, recording: Recording) -> Iterator[tuple[Batch, dict[str, np.ndarray]]]:
    """Compensated samples piece by piece, with the batch that each came from; other values go by their column's header."""
    if calibration.method == "roll-isolated":
        from . import roll_isolated

        yield from roll_isolated.stream(calibration, recording)
        return
    models = corrections(calibration, recording)
    for batch in recording.batches(with_other=True):
        yield batch, compensate(batch, models)


def apply(
    calibration: Calibration, recording: Recording, out: str | Path, *, progress: Callable[[int], None] | None = None
) -> int:
    """Apply a calibration to a recording and write the compensated samples.

    Parameters
    ----------
    calibration : Calibration
    recording : Recording
    out : path
        ``.parquet`` or ``.csv``. Written whole or not at all; sensors without a calibration and all other columns are kept.
    progress : callable, optional
        Called with the number of samples written so far.

    Returns
    -------
    int
        Number of samples.

    Raises
    ------
    InputError
        When the file's ending is unknown, or `out` is the recording itself.
    """
    out = Path(out)
    if out.suffix not in (".parquet", ".csv"):
        raise InputError(f"{out}: write to a .parquet or .csv file")
    if recording.path is not None and out.exists() and out.samefile(recording.path):
        raise InputError(f"{out}: is the recording itself; input is never modified")
    rows = 0
    with write_atomically(out) as temporary:
        writer: Any = None
        try:
            for batch, values in stream(calibration, recording):
                table = _table(batch, values, recording)
                if writer is None:
                    writer = _writer(temporary, table.schema)
                writer.write_batch(table)
                rows += batch.time.size
                if progress is not None:
                    progress(rows)
        finally:
            if writer is not None:
                writer.close()
        if rows == 0:
            raise DataError(f"{recording.name}: no samples to compensate")
    return rows


def _writer(path: Path, schema: Any) -> Any:
    if path.suffix == ".csv":
        from pyarrow import csv

        return csv.CSVWriter(path, schema)
    from pyarrow import parquet

    return parquet.ParquetWriter(path, schema)


def _free(name: str, taken: Collection[str]) -> str:
    """Name of a column that is passed on; one that would read as a column written here is marked as the input's."""
    own = {header_parts(t)[0] for t in taken}
    return f"input {name}" if header_parts(name)[0] in own else name


def _table(batch: Batch, values: dict[str, np.ndarray], recording: Recording) -> Any:
    import pyarrow as pa

    columns: dict[str, Any] = {"time [s]": batch.time}
    for sensor, axes in SENSORS.items():
        samples = values.get(sensor, getattr(batch, sensor))
        if samples is None:
            continue
        raw = sensor not in values and sensor in recording.counts
        for i, axis in enumerate(axes):
            columns[f"{axis} [{'count' if raw else _UNITS[sensor]}]"] = np.ascontiguousarray(samples[:, i])
    columns |= {name: column for name, column in values.items() if name not in SENSORS}
    for name, column in batch.rig.items():
        columns[f"{name} [{_RIG_UNITS.get(name, 'rad')}]"] = column
    if batch.other is not None:
        for i, name in enumerate(batch.other.schema.names):
            columns[_free(name, columns)] = batch.other.column(i)
    return pa.RecordBatch.from_pydict(columns)
