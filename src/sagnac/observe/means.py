"""Mean readings of segments in one streaming pass, with the noise of each mean and a look at every sample.

The noise of a mean is judged from the means of sixteen blocks of its segment, not from neighbouring samples: quantisation
carried over from sample to sample, which makes neighbours disagree without moving the mean, then hardly counts as noise,
and slow disturbances do. What is no noise is taken out first: a drift, and in a turning segment the Earth rate and the
tilt, which come round once a turn.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ..errors import DataError
from ..frames import Array
from ..plan import Plan, Segment
from ..recording import GAP, SENSORS, Batch, Recording, sample_interval
from .lattice import common_step
from .rig_angles import RigAngles
from .samples import axis_names, gaps_inside, refuse_outside, refuse_saturated
from .sums import BLOCKS, Sums

_DITHERED = 0.4  # noise, in steps of the converter, from which averaging takes the rounding away
_FINEST_STEP = 1e-5  # of the range: a converter of 17 bits
_WARMED = 3.0  # K
_MOVING = 100.0  # times the usual noise, and
_MOVED = 1e-3  # of the range over all segments: no noise


@dataclass(frozen=True)
class SegmentMeans:
    """What the recording says about each segment, n segments.

    Attributes
    ----------
    segments : tuple of Segment
    mid_time, interval, duration : ndarray, shape (n,), s
        Mean time of the samples, sample interval, and time that the samples stand for.
    count : ndarray of int, shape (n,)
    mean : dict of str to ndarray, shape (n, 3)
        Of ``accel`` and ``gyro``, m/s^2 and rad/s or counts.
    density : dict of str to ndarray, shape (3,)
        Noise of each axis found in the blocks, per sqrt(Hz); NaN where there are too few samples.
    noise_degrees_of_freedom : float
        How well `density` is known.
    pulse : dict of str to ndarray, shape (3,)
        What one pulse is worth (rad, m/s) on sensors that count pulses.
    rounding : dict of str to ndarray, shape (n, 3)
        Variance of readings rounded to a step coarser than their noise, which no averaging takes away.
    counts : frozenset of str
        Sensors read as raw counts.
    remarks : tuple of str
        Gaps and other findings.
    span : tuple of float, s
        First and last sample time of the recording.
    """

    segments: tuple[Segment, ...]
    mid_time: Array
    interval: Array
    duration: Array
    count: Array
    mean: dict[str, Array]
    density: dict[str, Array]
    noise_degrees_of_freedom: float
    pulse: dict[str, Array] = field(default_factory=dict)
    rounding: dict[str, Array] = field(default_factory=dict)
    counts: frozenset[str] = frozenset()
    remarks: tuple[str, ...] = ()
    span: tuple[float, float] = (0.0, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Segment names."""
        return tuple(s.name for s in self.segments)

    def variance(self, sensor: str, density: Array) -> Array:
        """Variance of the means of a sensor, shape (n, 3): white noise and one pulse lost or won at each end.

        Parameters
        ----------
        sensor : str
        density : ndarray, shape (3,)
            Noise per sqrt(Hz).
        """
        time = self.duration[:, None]
        pulses = _pulse_variance(self.pulse.get(sensor, np.zeros(3))) / time**2
        return density**2 / time + pulses + self.rounding.get(sensor, np.zeros_like(time))


def _pulse_variance(pulse: Array) -> Array:
    """Variance of a sum of pulses: uniform residues at both ends."""
    return np.asarray(pulse**2 / 6.0)


def segment_means(recording: Recording, plan: Plan, rig: Literal["refuse", "tell"] = "refuse") -> SegmentMeans:
    """Means of every segment of a plan.

    Parameters
    ----------
    recording : Recording
    plan : Plan
    rig : {"refuse", "tell"}
        What to do where the rig recorded other angles than the plan's: methods whose result hardly rests on them tell.

    Returns
    -------
    SegmentMeans

    Raises
    ------
    DataError
        When a segment lies outside the data or holds no sample, an axis is saturated, or the rig's own angles, where they were
        recorded, are not the plan's (:mod:`.rig_angles`); rates, and axes that do not rest, whatever `rig` says.
    InputError
        When a sample cannot be read (see :meth:`Recording.batches`), or a triad lacks an axis.
    """
    recording.need_whole()
    if not plan.segment:
        raise DataError("the plan has no [[segment]]; this method needs to know which samples belong to which position")
    sensors = [s for s in SENSORS if s in recording.has]
    sums = [Sums(s, 3 * len(sensors)) for s in plan.segment]
    interval, first, last, gaps = np.nan, np.nan, np.nan, []
    warmth: list[float] = []
    angles = RigAngles(recording, plan)
    for batch in recording.batches():
        angles.add(batch.time, batch.rig)
        warmth += _extremes(batch.rig.get("temperature"))
        if np.isnan(interval) and batch.time.size > 1:
            interval = sample_interval(batch.time)
        first = batch.time[0] if np.isnan(first) else first
        gaps += _gaps(batch, last, interval)
        last = float(batch.time[-1])
        values = np.hstack([v for v in (batch.accel, batch.gyro) if v is not None])
        # pulses were counted over the interval before their time stamp
        time = batch.time - interval / 2 if recording.increments else batch.time
        for part in sums:
            i, j = np.searchsorted(time, [part.segment.start, part.segment.stop])
            if j > i:
                part.add(time[i:j], values[i:j], interval if np.isfinite(interval) else np.inf)
    refuse_outside(recording.name, sums, float(first), last, interval)
    refuse_saturated(recording.name, sums, axis_names(recording))
    of_rig = angles.remarks(tell=rig == "tell")
    found = _gather(recording, sums, sensors, interval, gaps, (float(first), last))
    return replace(found, remarks=(*found.remarks, *_warmth_remarks(warmth), *of_rig))


def _extremes(temperature: Array | None) -> list[float]:
    """Least and greatest temperature of a batch, K."""
    known = temperature[np.isfinite(temperature)] if temperature is not None else np.zeros(0)
    return [float(known.min()), float(known.max())] if known.size else []


def _warmth_remarks(temperatures: list[float]) -> list[str]:
    """A word where the temperature changed: no method has a term for it."""
    change = max(temperatures, default=0.0) - min(temperatures, default=0.0)
    if change < _WARMED:
        return []
    text = (
        f"the temperature changed by {change:.2g} K during the recording, and no term of the model follows it: biases and "
        "scales are those of some temperature between"
    )
    return [text]


def _gaps(batch: Batch, last: float, interval: float) -> list[tuple[float, float]]:
    steps = np.diff(batch.time, prepend=last if np.isfinite(last) else batch.time[0])
    where = np.flatnonzero(steps > GAP * interval)
    return [(float(batch.time[i] - steps[i]), float(steps[i])) for i in where]


def _gather(
    recording: Recording,
    sums: list[Sums],
    sensors: list[str],
    interval: float,
    gaps: list[tuple[float, float]],
    span: tuple[float, float],
) -> SegmentMeans:
    count = np.array([p.count for p in sums])
    steps = np.array([p.interval for p in sums])
    finest = np.min([p.finest for p in sums], axis=0)
    worth = np.zeros(3 * len(sensors))
    for i, s in enumerate(sensors):
        if s in recording.increments:
            worth[3 * i : 3 * i + 3] = finest[3 * i : 3 * i + 3] * interval
    worth[~np.isfinite(worth)] = 0.0
    squared, weight = np.zeros(3 * len(sensors)), 0
    found = []
    for p, dt in zip(sums, steps, strict=True):
        density2, n = p.block_density(dt)
        # what the pulses lost or won at the ends of the blocks add is no noise of the sensor
        own = np.maximum(density2 - _pulse_variance(worth) / max(p.count * dt / BLOCKS, 1e-300), 0.1 * density2)
        found.append((p, own, n))
        squared, weight = squared + n * own, weight + n
    density = np.sqrt(squared / weight) if weight else np.full(3 * len(sensors), np.nan)
    means = np.array([p.mean for p in sums])
    finest = np.minimum(finest, _lattice(np.array([[p.low, p.high] for p in sums])))
    noise = np.array([p.sample_noise for p in sums])
    rounded = np.where((noise < _DITHERED * finest) & np.isfinite(finest), finest, 0.0) ** 2 / 12.0
    return SegmentMeans(
        segments=tuple(p.segment for p in sums),
        mid_time=np.array([p.mid_time for p in sums]),
        interval=steps,
        duration=count * steps,
        count=count,
        mean={s: means[:, 3 * i : 3 * i + 3] for i, s in enumerate(sensors)},
        density={s: density[3 * i : 3 * i + 3] for i, s in enumerate(sensors)},
        noise_degrees_of_freedom=float(weight),
        pulse={s: worth[3 * i : 3 * i + 3] for i, s in enumerate(sensors) if s in recording.increments},
        rounding={s: rounded[:, 3 * i : 3 * i + 3] for i, s in enumerate(sensors) if s not in recording.increments},
        counts=recording.counts,
        remarks=(
            *_rounding_remarks(rounded, noise, recording, sensors),
            *_gap_remarks(gaps, sums),
            *_restless(found, sensors, worth),
        ),
        span=span,
    )


def _rounding_remarks(rounded: Array, noise: Array, recording: Recording, sensors: list[str]) -> list[str]:
    axes = [a for s in sensors for a in SENSORS[s]]
    out = []
    for k, axis in enumerate(axes):
        if rounded[:, k].any() and axis.partition("_")[0] not in recording.increments:
            step = np.sqrt(12.0 * rounded[:, k].max())
            out.append(
                f"{axis} is rounded to steps of {step:.3g} (SI or counts), coarser than its noise: no averaging takes that away"
            )
        elif not noise[:, k].any():
            out.append(
                f"{axis} is constant within every segment: rounding coarser than its noise would not be in the uncertainty"
            )
    return out


def _lattice(extremes: Array) -> Array:
    """Step of which all readings are whole multiples apart (axes,); infinite where there is none, or too few to tell.

    Readings that stay constant in each segment show their rounding only from segment to segment.
    """
    out = np.full(extremes.shape[-1], np.inf)
    for k in range(out.size):
        step = common_step(extremes[..., k])
        if step > _FINEST_STEP * float(np.ptp(extremes[..., k])):
            out[k] = step
    return out


def _gap_remarks(gaps: list[tuple[float, float]], sums: list[Sums]) -> list[str]:
    turning = "; while turning, what is left of the Earth rate is then only roughly known: better cut the segment there"
    return [text + turning * (s.turn_rate != 0) for s, text in gaps_inside(gaps, [p.segment for p in sums])]


def _restless(found: list[tuple[Sums, Array, int]], sensors: list[str], worth: Array) -> list[str]:
    """Segments whose own noise is far above that of the others (knocked, or not yet settled)."""
    usable = [(p, d) for p, d, n in found if n]
    if len(usable) < 4:
        return []
    axes = [a for s in sensors for a in SENSORS[s]]
    usual = np.median([d for _, d in usable], axis=0)
    span = np.ptp([p.mean for p, _ in usable], axis=0)
    out = []
    for part, density2 in usable:
        block = (part.segment.stop - part.segment.start) / BLOCKS
        loud = np.flatnonzero(density2 > 6.0 * (usual + _pulse_variance(worth) / block))
        if loud.size and usual[loud[0]] > 0:
            k = int(loud[np.argmax(density2[loud] / usual[loud])])
            times = np.sqrt(density2[k] / usual[k])
            if times > _MOVING and density2[k] > block * (_MOVED * span[k]) ** 2:
                raise DataError(
                    f"segment {part.segment.name!r} is not steady: {axes[k]} has {times:.0f} times its usual noise, as when the "
                    "unit is moved before the segment ends. Check the plan's start and stop"
                )
            out.append(f"segment {part.segment.name!r} is restless: {axes[k]} has {times:.1f} times its usual noise")
    return out
