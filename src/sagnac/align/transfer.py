"""Transfer alignment from files to files, and the same question without data.

Everything around the filter: logs are opened and checked, what does not fit is named, the filter runs, its result is judged,
and all files are written or none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import DataError, InputError
from ..frames import Array
from ..navigate.strapdown import increments
from ..recording import EPOCH, SENSORS, Recording, open_recording, sample_interval
from . import config as configs
from . import run
from .checks import differences, timing, verdict
from .checks import master as master_checks
from .checks import samples as sample_checks
from .config import Config
from .history import Run
from .master import Master, open_master
from .record import Draw, keep_inputs, of_run, sources, write
from .result import Alignment, Innovations, columns_of
from .samples import Slave

_ROUNDING = 3e-6  # rad: less noise than this of the master's attitude is none
_LARGE = np.radians(0.6)
"""A mounting of a larger sigma is looked for before the filter starts: with 1 deg in level and 2 in azimuth a filter that
starts at zero is off by many sigmas in some of a hundred runs; after a start it is not."""
_LEVEL = np.radians(3.0)  # of tilt, at which a twentieth of the z accelerometer's bias is in x and y
_WIDE = 0.2  # rad: of larger mountings the slave's axes are no good measure of the master's


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
    keep_inputs(out, draw, (master, recording.path, config if not isinstance(config, Config) else None))
    log = open_master(master)
    found, judged = align(recording, log, settings, progress=progress)
    source = sources((master, judged.log.time), (recording.path, judged.samples.time), (config, None))
    result = judged.record(settings, found, source=source, columns=columns_of(recording))
    write(out, result, found, draw)
    return result


class Judged(NamedTuple):
    """What was found about the logs of an alignment besides its run."""

    samples: Slave
    log: Master
    """On the clock of the samples."""
    uneven: float
    """Noise of the single sample of the master's attitude, rad, see :func:`examine`."""
    innovations: Innovations
    remarks: tuple[str, ...]

    def record(self, config: Config, found: Run, **more: Any) -> Alignment:
        """The result, see :func:`sagnac.align.record.of_run`."""
        return of_run(
            "transfer",
            config,
            found,
            values=found.values[-1],
            uneven=self.uneven,
            innovations=self.innovations,
            remarks=self.remarks,
            **more,
        )


def align(
    recording: Recording, log: Master, settings: Config, *, progress: Callable[[float], None] | None = None
) -> tuple[Run, Judged]:
    """:func:`transfer` of logs that are open, without files; raises as that does."""
    samples = slave_of(recording, settings)
    log = _on_the_clock_of(recording, log)
    remarks, doubts, uneven = examine(samples, log, settings)
    mounting, said = _first_mounting(samples, log, settings)
    found = run.transfer(settings, samples, log, mounting=mounting, progress=progress)
    innovations, more = verdict.judge(found, settings, doubts)
    more += verdict.beyond_prior(found, settings)
    if settings.states == "full" and settings.gravity is None:
        more.append(
            "gravity is not given: what the site's own differs from the normal one by, some 30 mGal (30 ug), is in "
            "accel.bias.z and not in its uncertainty; write gravity = the measured value"
        )
    return found, Judged(samples, log, uneven, innovations, (*remarks, *said, *doubts, *more))


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
    keep_inputs(out, draw, (config if not isinstance(config, Config) else None,))
    found = follow(settings)
    result = of_run("covariance", settings, found, source=sources((config, None)))
    write(out, result, found, draw)
    return result


def _on_the_clock_of(recording: Recording, log: Master) -> Master:
    """The master's log with its times counted as the recording counts its own, where both were written since an epoch."""
    since_epoch = recording.origin and log.time[0] > EPOCH
    return replace(log, time=log.time - recording.origin) if since_epoch else log


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
    slave = Slave(time, *increments(time, gyro, accel, config.samples), recording.name)
    if "gyro" in recording.increments:
        slave = replace(slave, turns=_counted(gyro, counted, slave))
    if "accel" in recording.increments:
        slave = replace(slave, pushes=_counted(accel, counted, slave))
    return slave


def _counted(rates: Array, interval: float, slave: Slave) -> Array:
    """What was counted, from the rates that the recording makes of it; over a gap what the samples around it say."""
    out, wide = rates[1:] * interval, np.flatnonzero(slave.wide)
    out[wide] = 0.5 * (rates[wide] + rates[wide + 1]) * slave.steps[wide, None]
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
        As :mod:`~sagnac.align.checks.master`, :mod:`~sagnac.align.checks.samples`, :mod:`~sagnac.align.checks.timing` and
        :mod:`~sagnac.align.checks.differences` say.
    """
    if master.attitude is None:
        raise InputError(
            f"{master.name}: the columns heading [deg], pitch [deg] and roll [deg] are missing: the slave starts with the "
            "master's attitude"
        )
    sample_checks.refuse_apart(slave, master, config.latency)
    remarks = master_checks.check(master)
    doubts = sample_checks.refuse_other_reading(slave, master, config)
    if float(np.linalg.norm(config.initial.misalignment)) > _WIDE:
        return remarks, doubts, 0.0
    late, more = timing.check(slave, master, config)
    remarks += more
    if doubts:  # then a lever arm or noise would be made up of what else is wrong
        return remarks, doubts, 0.0
    noise, more = differences.check(slave, master, config, late)
    remarks += more
    if config.matches_attitude or noise.attitude < _ROUNDING:
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
    said = [text, *found.notes]
    if config.states == "short" and float(np.abs(found.mounting[:2]).max()) > _LEVEL:
        said.append(
            "the slave is tilted, and short states leave out the z accelerometer's bias, which its tilt brings into x and y: "
            'their uncertainties are too small by it; write states = "full"'
        )
    return found.mounting, said
