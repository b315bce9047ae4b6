"""Text export of Xsens MT Manager: comment lines, a header line, one row a packet.

Units: MTi and MTw user manuals, tables of the exported columns (``Acc`` m/s^2, ``Gyr`` rad/s, ``VelInc`` m/s, counter
of 16 bits); ``SampleTimeFine`` in 0.1 ms and the UTC fields: MTi user manual MT0605P, timestamp output.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...errors import InputError
from ..table import Table
from . import rows
from .lines import unended
from .xsens_marks import PACKET, SENSOR, TICKS, by_mt_manager, delimiter, fields
from .xsens_time import Clock, Counter, chosen

_HEAD = 1 << 16
_STANDARD = {"Acc": ("accel", "m/s^2"), "Gyr": ("gyro", "rad/s")}
_OTHER = (
    (re.compile(r"VelInc_[XYZ]"), "{} [m/s]"),
    (re.compile(r"FreeAcc_[XYZ]"), "{} [m/s^2]"),
    (re.compile(r"Roll|Pitch|Yaw"), "{} [deg]"),
    (re.compile(r"Temperature|Temp"), "temperature [degC]"),
)
_NUMBER = re.compile(r"Acc|Gyr|Mag|VelInc|FreeAcc|OriInc|Quat|Mat\[|UTC_|Roll|Pitch|Yaw|Temp|Press|Packet|SampleTime")
_MARK = "\ufeff"


def open_table(path: Path) -> Table:
    """Open a text export; its time is SampleTimeFine, else UTC, else the packet counter with the rate in the comments.

    Raises
    ------
    InputError
        When there is no header, or the file does not say in which unit times and angular rates are. Fault (while
        reading) at a row with another number of fields, or a field that is no number.
    """
    layout, comments, first = _layout(path)
    named = any(re.match(r"time\b", name) for name in layout.names)
    clock = Clock(()) if named else chosen(path, layout.names, first, comments)
    names = {_header(name): name for name in layout.names}
    if len(names) < len(layout.names):
        raise InputError(f"{path}: columns stand more than once in the header: {', '.join(layout.names)}")
    _need_units(path, layout.names, clock, comments)
    columns = ("time [s]", *names) if clock.timed else (*names,)

    def read(numeric: Sequence[str], other: Sequence[str]) -> Iterator[Any]:
        return _read(layout, clock, names, numeric, other)

    remarks = (*clock.remarks, *unended(path))
    return Table(path, columns, read, remarks, position=layout.position, size=path.stat().st_size)


def _layout(path: Path) -> tuple[rows.Layout, tuple[str, ...], Mapping[str, str]]:
    """Names and delimiter, the comment lines before the header, and the fields of the first row."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    start, comments = 0, []
    lines = head.splitlines(keepends=True)
    for i, raw in enumerate(lines):
        start += len(raw)
        line = raw.decode("utf-8", errors="replace").strip("\r\n").removeprefix(_MARK)
        if not line.strip() or line.lstrip().startswith(("//", "#", "%")):
            comments.append(line.strip())
            continue
        mark = delimiter(line)
        names = tuple(name.strip() or f"column {k}" for k, name in enumerate(fields(line), 1))
        layout = rows.Layout(path, start, i + 2, mark, names)
        row = next((r for r in lines[i + 1 :] if r.strip()), b"").decode("utf-8", errors="replace")
        return layout, tuple(comments), dict(zip(names, _row(row, mark), strict=False))
    raise InputError(f"{path}: no header line ({PACKET}, {TICKS}, Acc_X, ...) in its first {_HEAD // 1024} kB")


def _row(line: str, mark: str) -> list[str]:
    return line.split() if mark == " " else line.strip("\r\n").split(mark)


def _header(name: str) -> str:
    """Standard name with the unit, for the columns whose meaning the export fixes."""
    if match := SENSOR.fullmatch(name):
        standard, unit = _STANDARD[match[1]]
        return f"{standard}_{match[2].lower()} [{match[3] or unit}]"
    return next((form.format(name) for known, form in _OTHER if known.fullmatch(name)), name)


def _need_units(path: Path, names: Sequence[str], clock: Clock, comments: Sequence[str]) -> None:
    """Refuse a file without MT Manager's comments: a DOT's has the same names, but ticks of 1 us and rates in deg/s."""
    if by_mt_manager(comments, names):
        return
    bare = [n for n in names if re.fullmatch("Gyr_[XYZ]", n)]
    bare += [n for n in clock.columns if n == TICKS]
    if bare:
        raise InputError(
            f"{path}: without the comment lines of MT Manager nothing says the unit of {', '.join(bare)}. If "
            "SampleTimeFine is in 0.1 ms and Gyr in rad/s (MTi, MTw), put the line '// MT Manager' before the header; "
            "if they are in us and deg/s (DOT), name the columns time [us], accel_x [m/s^2], ..., gyro_x [deg/s], ..."
        )


def _read(
    layout: rows.Layout, clock: Clock, names: Mapping[str, str], numeric: Sequence[str], other: Sequence[str]
) -> Iterator[Any]:
    import pyarrow as pa

    wanted = [*numeric, *other]
    timed = clock.columns if not clock.timed or "time [s]" in wanted else ()
    kinds = {names[c]: bool(_NUMBER.match(names[c])) for c in other if c in names}
    kinds |= dict.fromkeys([*(names[c] for c in numeric if c in names), *timed], True)
    counter = Counter(layout.path, clock)
    for batch in rows.rows(layout, kinds):
        time = counter.seconds({c: batch.column(c).to_numpy(zero_copy_only=False) for c in timed}) if timed else None
        columns = [batch.column(names[c]) if c in names else pa.array(time) for c in wanted]
        yield pa.RecordBatch.from_arrays(columns, wanted)
