"""What a transfer alignment leaves behind: the record, the history of its updates, pictures; all files or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from .._version import __version__
from ..earth import ELLIPSOID
from ..errors import InputError
from ..files import sha256, write_atomically
from ..frames import Array
from ..results import Software, Source, covariance_rows, now
from .checks import verdict
from .config import Config
from .history import Run
from .result import Alignment, Moment, Observed, Stretch, Value, values_of

RESULT, HISTORY = "alignment.json", "history.parquet"
_DYNAMIC = ("velocity_error", "attitude_error", "position_error", "wander_error", "height_error", "flexure_rate")
"""States that are no parameters."""
_MOMENTS = (1.0, 3.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 14400.0, 28800.0)

Draw = Callable[[Alignment, Run, Path], None]
"""Draws a picture of an alignment to a path."""


def keep_inputs(out: str | Path | None, draw: Mapping[str, Draw] | None, inputs: tuple[object, ...]) -> None:
    """Refuse a folder in which a result would take the place of an input.

    Parameters
    ----------
    out : path or None
    draw : mapping or None
        By the names of the pictures.
    inputs : tuple of path or None

    Raises
    ------
    InputError
    """
    if out is None:
        return
    if Path(out).exists() and not Path(out).is_dir():
        raise InputError(f"{out}: is a file; the results need a folder")
    for name in (RESULT, HISTORY, *(draw or {})):
        target = Path(out) / name
        for given in inputs:
            if given is not None and target.exists() and target.samefile(str(given)):
                raise InputError(f"{target}: is an input; inputs are never modified. Give another folder")


def sources(*given: tuple[object, Array | None]) -> tuple[Source, ...]:
    """Files that went in, each with its times, shape (n,), s, or None; what is no path is left out."""
    return tuple(
        Source(
            file=Path(file).name,
            sha256=sha256(file),
            start=None if time is None else float(time[0]),
            stop=None if time is None else float(time[-1]),
        )
        for file, time in given
        if isinstance(file, str | Path)
    )


def of_run(
    kind: str,
    config: Config,
    found: Run,
    *,
    values: Array | None = None,
    uneven: float = 0.0,
    source: tuple[Source, ...] = (),
    remarks: tuple[str, ...] = (),
    **more: Any,
) -> Alignment:
    """The record of a run.

    Parameters
    ----------
    kind : str
        ``transfer`` or ``covariance``.
    config : Config
    found : Run
    values : ndarray, shape (n,), optional
        Of the states; none without data.
    uneven : float, rad
        Noise of the single sample of the master's attitude that the mounting is told against.
    source : tuple of Source
    remarks : tuple of str
    more
        Further fields of the record.
    """
    kept = [i for i, n in enumerate(found.names) if not n.startswith(_DYNAMIC)]
    names, given = ([part[i] for i in kept] for part in (found.names, found.units))
    mounting = [names.index(f"misalignment.{a}") for a in "xyz"]
    matrix = found.covariance[np.ix_(kept, kept)]
    matrix[mounting, mounting] += uneven**2
    sigmas = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    angles = None if values is None else found.angles[-1]
    unseen = tuple(verdict.not_observed(found, names))
    return Alignment.model_validate(
        {
            "schema": "sagnac/alignment/1",
            "kind": kind,
            "method": config.method,
            "matching": config.matching,
            "states": config.states,
            "correction": config.correction,
            "time": float(found.time[-1]),
            "parameters": values_of(names, given, None if values is None else values[kept], sigmas),
            "covariance": covariance_rows(matrix),
            "attitude": values_of(("heading", "pitch", "roll"), ("rad",) * 3, angles, found.angle_sigmas[-1]),
            "place": _place(config, found) if values is not None else (),
            "observed": _observed(found, names, sigmas),
            "singular_values": tuple(float(np.sqrt(g)) for g in found.observability.gains),
            "not_observed": unseen,
            "not_separated": verdict.not_separated(found, names, unseen),
            "skipped": tuple(Stretch(start=a, stop=b, reason=why) for a, b, why in found.skipped),
            "course": _course(found, kept, uneven),
            "source": source,
            "remarks": tuple(dict.fromkeys(remarks)),
            "software": Software(version=__version__),
            "created": now(),
            **more,
        }
    )


def _place(config: Config, found: Run) -> tuple[Value, ...]:
    """Where the slave is at the end and how fast it goes; the short form takes the position from the master as it is."""
    state = found.final
    s = dict(zip(found.names, found.sigmas[-1], strict=True))
    apart = config.initial.position / ELLIPSOID[0]
    place = [
        s.get("position_error.x", apart),
        s.get("position_error.y", apart),
        s.get("height_error", config.initial.height),
    ]
    level = float(max(place[:2]))
    velocity = [s.get(f"velocity_error.{a}", config.initial.velocity) for a in "xyz"]
    velocity[:2] = [max(velocity[:2])] * 2
    latitude, longitude, _ = state.place
    wide = level / max(float(np.cos(latitude)), 1e-9)
    return (
        *values_of(
            ("latitude", "longitude", "height"),
            ("rad", "rad", "m"),
            np.array([float(latitude), float(longitude), float(state.height)]),
            np.array([level, wide, place[2]]),
        ),
        *values_of(("v_east", "v_north", "v_up"), ("m/s",) * 3, state.velocity_enu, np.array(velocity)),
    )


def _observed(found: Run, names: list[str], sigmas: Array) -> tuple[Observed, ...]:
    ratio = dict(zip(found.observability.names, found.observability.ratio, strict=True))
    final = dict(zip(found.names, found.sigmas[-1], strict=True))
    units = dict(zip(found.names, found.units, strict=True))
    return tuple(
        Observed(name=n, unit=units[n], initial=float(final[n] / ratio[n]), final=float(s))
        for n, s in zip(names, sigmas, strict=True)
        if ratio[n] > 0
    )


def _course(found: Run, kept: list[int], uneven: float) -> tuple[Moment, ...]:
    """Uncertainties at some times, the end among them."""
    after = found.time - found.start
    at = [int(np.searchsorted(after, m - 1e-6)) for m in _MOMENTS if m < after[-1] - 1e-6]
    of_master = np.array([uneven if found.names[i].startswith("misalignment") else 0.0 for i in kept])
    return tuple(
        Moment(
            after=float(round(after[i], 9)),
            standard_uncertainty=tuple(np.hypot(found.sigmas[i, kept], of_master).tolist()),
        )
        for i in dict.fromkeys([*at, len(after) - 1])
    )


def write(out: str | Path | None, result: Alignment, found: Run, draw: Mapping[str, Draw] | None) -> None:
    """All files, or none.

    Parameters
    ----------
    out : path or None
        Folder; None writes nothing.
    result : Alignment
    found : Run
    draw : mapping of file name to callable, or None
    """
    if out is None:
        return
    with ExitStack() as stack:
        # entered last, left first: the result is moved into place at the very end
        names = (RESULT, HISTORY, *(draw or {}))
        files = {name: stack.enter_context(write_atomically(Path(out) / name)) for name in names}
        files[RESULT].write_text(result.to_json(), encoding="utf-8")
        _write_history(files[HISTORY], found)
        for name, picture in (draw or {}).items():
            picture(result, found, files[name])


def _write_history(path: Path, found: Run) -> None:
    """Every update: time, states, their standard deviations, innovations, attitude and place."""
    import pyarrow as pa
    from pyarrow import parquet

    degrees = 180.0 / np.pi
    columns: dict[str, Any] = {"time [s]": found.time}
    for i, (name, unit) in enumerate(zip(found.names, found.units, strict=True)):
        columns[f"{name} [{unit}]"] = found.values[:, i]
        columns[f"{name} sigma [{unit}]"] = found.sigmas[:, i]
        if found.smoothed is not None and found.smoothed_sigmas is not None:
            columns[f"{name} smoothed [{unit}]"] = found.smoothed[:, i]
            columns[f"{name} smoothed sigma [{unit}]"] = found.smoothed_sigmas[:, i]
    for i, name in enumerate(found.innovation_names):
        unit = "m/s" if name.startswith("velocity") else "rad"
        columns[f"innovation {name} [{unit}]"] = found.innovations[:, i]
        columns[f"innovation {name} sigma [{unit}]"] = found.innovation_sigmas[:, i]
    columns |= {"used": found.used, "nis": found.nis}
    for i, name in enumerate(("heading", "pitch", "roll")):
        columns[f"{name} [deg]"] = found.angles[:, i] * degrees
        columns[f"{name} sigma [deg]"] = found.angle_sigmas[:, i] * degrees
    for i, (name, unit) in enumerate((("latitude", "deg"), ("longitude", "deg"), ("height", "m"))):
        columns[f"{name} [{unit}]"] = found.places[:, i] * (degrees if unit == "deg" else 1.0)
    table = pa.table(columns).replace_schema_metadata({"sagnac": "sagnac/alignment-history/1", "version": __version__})
    parquet.write_table(table, path)
