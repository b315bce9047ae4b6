"""A unit on an imperfect table: recordings sample by sample, or the mean of each segment at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..recording import SENSORS, nominal_scale
from ..rigs.turntable import Site, TableErrors, inputs
from .track import settings, track
from .unit import SimulatedUnit

_ARCSEC = np.pi / 648000


@dataclass(frozen=True)
class SimulatedTable:
    """The table as it is, which nobody at the rig knows.

    Attributes
    ----------
    errors : TableErrors
    settings : ndarray, shape (segments, 3), rad
        Error of each setting of outer, middle and inner axis.
    """

    errors: TableErrors
    settings: Array


def imperfect_table(
    plan: Plan, rng: np.random.Generator, *, setting: float = np.pi / 10800, axis: float = 5 * _ARCSEC
) -> SimulatedTable:
    """A table with errors as in [DONG18]: each setting off by uniform +-`setting`, each axis error +-`axis`.

    Parameters
    ----------
    plan : Plan
    rng : numpy Generator
    setting, axis : float, rad
    """
    signs = rng.choice([-1.0, 1.0], 7) * axis
    errors = TableErrors(
        (float(signs[0]), float(signs[1])),
        (float(signs[2]), float(signs[3])),
        (float(signs[4]), float(signs[5]), float(signs[6])),
    )
    return SimulatedTable(errors, rng.uniform(-setting, setting, (len(plan.segment), 3)))


def site_of(plan: Plan) -> Site:
    """Where the plan's rig stands."""
    return Site(plan.need_latitude("the Earth rate"), plan.site_gravity, plan.earth_rate)


def readings(unit: SimulatedUnit, force: Array, rate: Array) -> dict[str, Array]:
    """Noise-free readings of the unit for inputs in k, (n, 3) each."""
    return {
        "accel": force @ (unit.accel_matrix @ unit.to_b).T + unit.accel_bias,
        "gyro": rate @ (unit.gyro_matrix @ unit.to_b).T + unit.gyro_bias,
    }


def simulate_readings(unit: SimulatedUnit, plan: Plan, table: SimulatedTable, rng: np.random.Generator) -> SegmentMeans:
    """One reading a segment, taken at its middle, with the noise of an average over the segment.

    This is the published case: no time series, for campaigns of thousands of runs.
    """
    angles = np.array([s.angles for s in plan.segment], dtype=float) + table.settings
    rates = np.array([s.rates for s in plan.segment])
    hold = np.array([s.stop - s.start for s in plan.segment])
    angles += rates * hold[:, None] / 2
    n = len(hold)
    clean = readings(unit, *inputs(angles, rates, site_of(plan), table.errors, plan.rig.letters))
    noise = {"accel": unit.accel_density, "gyro": unit.gyro_density}
    means = {k: v + noise[k] / np.sqrt(hold)[:, None] * rng.standard_normal((n, 3)) for k, v in clean.items()}
    unknown = np.full(3, np.nan)
    return SegmentMeans(
        segments=plan.segment,
        mid_time=np.array([(s.start + s.stop) / 2 for s in plan.segment]),
        interval=hold,
        duration=hold,
        count=np.ones(n, dtype=int),
        mean=means,
        density={"accel": unknown, "gyro": unknown},
        noise_degrees_of_freedom=0.0,
        span=(plan.segment[0].start, plan.segment[-1].stop),
    )


def motion(plan: Plan, table: SimulatedTable, time: Array) -> tuple[Array, Array]:
    """Table angles and rates at any time: steady in the segments, a smooth move (cubic) between them.

    Parameters
    ----------
    plan : Plan
    table : SimulatedTable
    time : ndarray, shape (n,), s, increasing

    Returns
    -------
    angles, rates : ndarray, shape (n, 3), rad and rad/s
    """
    stated = np.array([settings(s, plan.rig.letters, len(plan.rig.axes)) for s in plan.segment])
    rates = np.array([s.rates for s in plan.segment])
    return track(plan.segment, stated + table.settings, rates).angles(time)


def simulate_recording(
    unit: SimulatedUnit, plan: Plan, table: SimulatedTable, rng: np.random.Generator, *, frequency: float = 50.0
) -> tuple[Array, dict[str, Array]]:
    """Samples of the whole plan.

    Parameters
    ----------
    unit : SimulatedUnit
    plan : Plan
    table : SimulatedTable
    rng : numpy Generator
    frequency : float, Hz

    Returns
    -------
    time : ndarray, shape (n,), s
    samples : dict of str to ndarray, shape (n, 3)
        m/s^2 and rad/s, or whole pulses counted over each sample interval, the rest carried to the next.
    """
    count = int(np.floor((plan.segment[-1].stop + 1.0) * frequency))
    time = np.arange(1, count + 1) / frequency
    # pulses are counted over the interval before the time stamp, other readings are taken at it
    samples = {}
    for sensor, density in (("accel", unit.accel_density), ("gyro", unit.gyro_density)):
        scales = [_scale(unit, sensor, axis) for axis in SENSORS[sensor]]
        summed = any(increment for _, increment in scales)
        angles, rates = motion(plan, table, time - 0.5 / frequency if summed else time)
        values = readings(unit, *inputs(angles, rates, site_of(plan), table.errors, plan.rig.letters))[sensor]
        values += density * np.sqrt(frequency) * rng.standard_normal((count, 3))
        for i, (factor, increment) in enumerate(scales):
            if factor:
                values[:, i] = _pulses(values[:, i] / factor, 1 / frequency if increment else None)
        samples[sensor] = values
    return time, samples


def _scale(unit: SimulatedUnit, sensor: str, axis: str) -> tuple[float, bool]:
    """Worth of a count and whether counts are summed over the interval; (0, False) for readings in SI."""
    text = unit.pulses.get(axis, unit.pulses.get(sensor))
    return nominal_scale(text, sensor, axis) if text is not None else (0.0, False)


def _pulses(values: Array, interval: float | None) -> Array:
    """Whole counts of a converter; increments carry their residue."""
    if interval is None:
        return np.round(values)
    return np.diff(np.floor(np.cumsum(values * interval)), prepend=0.0)


def write_recording(path: str | Path, time: Array, samples: dict[str, Array], pulses: dict[str, str]) -> None:
    """Write samples as a Parquet recording with units in its header."""
    import pyarrow as pa
    from pyarrow import parquet

    from ..files import write_atomically

    columns = {"time [s]": pa.array(time)}
    for sensor, unit_text in (("accel", "m/s^2"), ("gyro", "rad/s")):
        for i, axis in enumerate(SENSORS[sensor]):
            counted = axis in pulses or sensor in pulses
            values = samples[sensor][:, i]
            columns[f"{axis} [{'pulse' if counted else unit_text}]"] = pa.array(
                values.astype(np.int32) if counted else values
            )
    with write_atomically(path) as temporary:
        parquet.write_table(pa.table(columns), temporary)
