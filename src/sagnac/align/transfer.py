"""Transfer alignment from files to files, and the same question without data.

Everything around the filter: logs are opened and checked, what does not fit is named, the filter runs, its result is judged,
and all files are written or none.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from .._version import __version__
from ..calibration import Software, Source, covariance_rows
from ..earth import ELLIPSOID
from ..errors import DataError, InputError
from ..files import sha256, write_atomically
from ..frames import Array
from ..navigate.strapdown import increments
from ..recording import GAP, SENSORS, Recording, open_recording, sample_interval
from . import config as configs
from . import differences, explain, master_checks, run, timing, verdict
from .config import Config
from .history import Run
from .master import Master, open_master
from .result import Alignment, Moment, Observed, Stretch, Value, values_of
from .samples import Slave

RESULT, HISTORY = "alignment.json", "history.parquet"
_DYNAMIC = ("velocity_error", "attitude_error", "position_error", "wander_error", "height_error", "flexure_rate")
"""States that are no parameters."""
_MOMENTS = (1.0, 3.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 14400.0, 28800.0)
_ROUNDING = 1e-6  # rad: less noise than this of the master's attitude is none
_LARGE = np.radians(3.0)
"""A mounting of a larger sigma is looked for before the filter starts."""
_WIDE = 0.2  # rad: of larger mountings the slave's axes are no good measure of the master's

Draw = Callable[[Alignment, Run, Path], None]
"""Draws a picture of an alignment to a path."""


def transfer(
    master: str | Path,
    slave: str | Path | Recording,
    config: str | Path | Config,
    out: str | Path | None = None,
    *,
    draw: Mapping[str, Draw] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Alignment:
    """Align a slave from its master's log.

    Parameters
    ----------
    master : path
        CSV or Parquet, see :mod:`sagnac.align.master`.
    slave : path or Recording
        With accelerometers and gyros; a recording with a nominal scale, other units or other names is opened with
        :func:`sagnac.recording.open_recording`.
    config : path or Config
    out : path, optional
        Folder for ``alignment.json``, ``history.parquet`` and the pictures; all are written, or none.
    draw : mapping of file name to callable, optional
        Pictures, for example :data:`sagnac.report.alignment.PICTURES`.
    progress : callable, optional
        Takes the time reached, s.

    Raises
    ------
    InputError
        When a file cannot be used as it stands, or the logs do not overlap.
    DataError
        When the logs do not fit each other, or the innovations not the filter's covariance; with the likeliest cause.
    """
    settings = configs.load(config) if not isinstance(config, Config) else config
    recording = slave if isinstance(slave, Recording) else open_recording(slave)
    _keep_inputs(out, draw, (master, recording.path, config if not isinstance(config, Config) else None))
    log = open_master(master)
    samples = slave_of(recording, settings)
    remarks, doubts, uneven = examine(samples, log, settings)
    mounting, said = _first_mounting(samples, log, settings)
    found = run.transfer(settings, samples, log, mounting=mounting, progress=progress)
    innovations, more = verdict.judge(found, settings, doubts)
    more += verdict.beyond_prior(found, settings)
    stamps = log.time - settings.latency
    start = float(stamps[np.searchsorted(stamps, samples.time[0] - 1e-9)])
    result = _alignment(
        "transfer",
        settings,
        found,
        start,
        values=found.values[-1],
        uneven=uneven,
        innovations=innovations,
        source=_sources((master, log.time), (recording.path, samples.time), (config, None)),
        remarks=(*remarks, *said, *doubts, *more),
    )
    _write(out, result, found, draw)
    return result


def covariance(
    config: str | Path | Config, out: str | Path | None = None, *, draw: Mapping[str, Draw] | None = None
) -> Alignment:
    """How well an alignment would do along the course of its configuration: the same result with values of null.

    Parameters
    ----------
    config : path or Config
        With ``[trajectory]``.
    out, draw
        As those of :func:`transfer`.

    Raises
    ------
    InputError
        When the configuration has no course, or cannot be used as it stands.
    """
    from .covariance import covariance as follow

    settings = configs.load(config) if not isinstance(config, Config) else config
    _keep_inputs(out, draw, (config if not isinstance(config, Config) else None,))
    found = follow(settings)
    result = _alignment("covariance", settings, found, 0.0, source=_sources((config, None)))
    _write(out, result, found, draw)
    return result


def slave_of(recording: Recording, config: Config) -> Slave:
    """Increments of a recording: counted pulses as they are, other samples integrated.

    Parameters
    ----------
    recording : Recording
        With all six sensor columns.
    config : Config
        What a sample that is no pulse means.

    Raises
    ------
    InputError
        When a sensor lacks columns, or its counts have no nominal scale.
    """
    for sensor in SENSORS:
        recording.need(sensor)
        if sensor in recording.counts:
            raise InputError(
                f"{recording.name}: {sensor} is in counts; give its nominal scale with --scale {sensor}=..."
            )
    batches = list(recording.batches())
    if not batches or sum(b.time.size for b in batches) < 2:
        raise InputError(f"{recording.name}: fewer than two samples")
    counted = sample_interval(batches[0].time) if recording.increments else 0.0
    time = np.concatenate([b.time for b in batches])
    gyro, accel = (np.concatenate([getattr(b, s) for b in batches]) for s in ("gyro", "accel"))
    steps, turns, pushes = increments(time, gyro, accel, config.samples)
    if "gyro" in recording.increments:
        turns = _counted(gyro, counted, steps)
    if "accel" in recording.increments:
        pushes = _counted(accel, counted, steps)
    return Slave(time, steps, turns, pushes, recording.name)


def _counted(rates: Array, interval: float, steps: Array) -> Array:
    """What was counted, from the rates that the recording makes of it; over a gap what the samples around it say."""
    out = rates[1:] * interval
    wide = np.flatnonzero(steps > GAP * np.median(steps))
    out[wide] = 0.5 * (rates[wide] + rates[wide + 1]) * steps[wide, None]
    return np.asarray(out)


def examine(slave: Slave, master: Master, config: Config) -> tuple[list[str], list[str], float]:
    """All checks that need no filter.

    Parameters
    ----------
    slave : Slave
    master : Master
    config : Config

    Returns
    -------
    remarks, doubts : list of str
        What is worth a word, and what may explain trouble of the filter.
    uneven : float, rad
        Noise of the single sample of the master's attitude that velocity matching starts with; zero for attitude matching.

    Raises
    ------
    InputError, DataError
        As :mod:`~sagnac.align.master_checks`, :mod:`~sagnac.align.explain`, :mod:`~sagnac.align.timing` and
        :mod:`~sagnac.align.differences` say.
    """
    if master.attitude is None:
        raise InputError(
            f"{master.name}: the columns heading [deg], pitch [deg] and roll [deg] are missing: the slave starts with the "
            "master's attitude"
        )
    explain.refuse_apart(slave, master, config.latency)
    remarks = master_checks.check(master)
    doubts = explain.refuse_other_reading(slave, master, config)
    if float(np.linalg.norm(config.initial.misalignment)) > _WIDE:
        return remarks, doubts, 0.0
    late, more = timing.check(slave, master, config)
    remarks += more
    if doubts:  # then a lever arm or noise would be made up of what else is wrong
        return remarks, doubts, 0.0
    noise, more = differences.check(slave, master, config, late)
    remarks += more
    if config.matching == "velocity+attitude" or noise.attitude < _ROUNDING:
        return remarks, doubts, 0.0
    remarks.append(
        f"the mounting is told against one sample of the master's attitude; its noise, {noise.attitude * 10800.0 / np.pi:.2g} "
        'arcmin, is in its uncertainty; matching = "velocity+attitude" would use all samples'
    )
    return remarks, doubts, noise.attitude


def _first_mounting(slave: Slave, master: Master, config: Config) -> tuple[Array | None, list[str]]:
    """Where to linearise first when the mounting may be a large one, and what is to be said of it.

    Raises
    ------
    DataError
        When the first minutes do not show which mounting it is.
    """
    if max(config.initial.misalignment) <= _LARGE:
        return None, []
    from .large import start

    found = start(config, slave, master)
    angles = ", ".join(f"{v:.3g}" for v in np.degrees(found.mounting))
    if not found.converged:
        raise DataError(
            f"the mounting of {slave.name} cannot be told: {'; '.join(found.notes) or 'the start did not settle'}"
        )
    text = f"the first {found.used:.3g} s show a mounting of about {angles} deg about x, y, z, from which the filter starts"
    return found.mounting, [text, *found.notes]


def _keep_inputs(out: str | Path | None, draw: Mapping[str, Draw] | None, inputs: tuple[object, ...]) -> None:
    """Refuse a folder in which a result would take the place of an input."""
    if out is None:
        return
    if Path(out).exists() and not Path(out).is_dir():
        raise InputError(f"{out}: is a file; the results need a folder")
    for name in (RESULT, HISTORY, *(draw or {})):
        target = Path(out) / name
        for given in inputs:
            if given is not None and target.exists() and target.samefile(str(given)):
                raise InputError(f"{target}: is an input; inputs are never modified. Give another folder")


def _sources(*given: tuple[object, Array | None]) -> tuple[Source, ...]:
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


def _alignment(
    kind: str,
    config: Config,
    found: Run,
    start: float,
    *,
    values: Array | None = None,
    uneven: float = 0.0,
    source: tuple[Source, ...] = (),
    remarks: tuple[str, ...] = (),
    **more: Any,
) -> Alignment:
    """The record of a run."""
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
            "course": _course(found, kept, start, uneven),
            "source": source,
            "remarks": tuple(dict.fromkeys(remarks)),
            "software": Software(version=__version__),
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
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


def _course(found: Run, kept: list[int], start: float, uneven: float) -> tuple[Moment, ...]:
    """Uncertainties at some times, the end among them."""
    after = found.time - start
    at = [int(np.searchsorted(after, m - 1e-6)) for m in _MOMENTS if m < after[-1] - 1e-6]
    of_master = np.array([uneven if found.names[i].startswith("misalignment") else 0.0 for i in kept])
    return tuple(
        Moment(
            after=float(round(after[i], 9)),
            standard_uncertainty=tuple(np.hypot(found.sigmas[i, kept], of_master).tolist()),
        )
        for i in dict.fromkeys([*at, len(after) - 1])
    )


def _write(out: str | Path | None, result: Alignment, found: Run, draw: Mapping[str, Draw] | None) -> None:
    """All files, or none."""
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
