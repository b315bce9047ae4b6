"""What spoils a log for the noise of its sensors: found in its blocks, named, and judged by what it would do to the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...frames import Array
from ...observe.samples import RESOLVED
from .blocks import Blocks
from .levels import FEWEST, Step, between, drift_in, harm, share_of, steps

_NEVER = 1e-9  # probability of a run of equal samples that is no chance
_FEWEST_EQUAL = 10
_MANY_RUNS = 30  # of a length or more, from which their numbers tell how usual longer ones are
_LEVELS = 30  # of the readings, above which the extreme ones are rare
_AT_LIMIT = 0.002  # share of the samples at an extreme of the range, from which it is a limit
_DITHERED = 0.4  # noise in steps of the converter, below which averaging keeps the rounding
_HELD = 0.3  # share of samples equal to the one before, of an axis whose steps are fine
_LOUD = 6.0  # robust standard deviations of the logarithm of the variances, and
_LOUDER = math.log(2.0)  # at least, for motion
_SHARE = 0.1  # of the noise power, from which motion spoils the result
_UNSTEADY = 0.35  # spread of the logarithm of the fast noise beyond what chance gives
_PARTS = 64  # of the log that its steadiness is judged by
_HARM = 0.3  # share of the variance at some averaging time, from which a step spoils the result
_WORTH = 0.02  # of the log, from which an undisturbed stretch of it is worth taking
_FEW_STEPS = 5  # of the converter, over all of the log: where the mean lies among them decides how much noise is seen
_ROUNDED = 0.05  # share of rounding in the noise power, from which it is told
_SETTLED = 5.0  # time constants, after which 0.7 % of a drift are left


@dataclass(frozen=True)
class Disturbance:
    """Something in a log that is no noise of the sensor.

    Attributes
    ----------
    kind : str
        One of :data:`sagnac.noise.record.Found`.
    axis : str
        ``gyro_x``, ...; empty for all of the recording.
    text : str
        What was found, where, and what to do about it.
    spoils : bool
        Whether the result of the axis would be wrong.
    start, stop : float or None, s
        Where in the log.
    size : float or None
        Of a step, a shock or a line (amplitude), in the unit of the axis; of the effect of temperature, in this unit per K.
    significance : float or None
        Size over its standard deviation.
    frequency : float or None, Hz
        Of a line.
    stretches : tuple of (float, float), s
        All that it spoils, where it comes and goes.
    """

    kind: str
    axis: str
    text: str
    spoils: bool = False
    start: float | None = None
    stop: float | None = None
    size: float | None = None
    significance: float | None = None
    frequency: float | None = None
    stretches: tuple[tuple[float, float], ...] = ()


def find(
    blocks: Blocks,
    axes: Sequence[str],
    pulses: Sequence[bool],
    unit_text: Sequence[str],
    scale: Sequence[float],
    gaps: Sequence[tuple[float, float]] = (),
) -> list[Disturbance]:
    """All disturbances that blocks show but the effects of temperature; of an axis that one has spoilt, no further ones.

    Parameters
    ----------
    blocks : Blocks
    axes : sequence of str
    pulses : sequence of bool
        See :func:`samples_at_fault`.
    unit_text, scale : sequence
        See :func:`level_changes`.
    gaps : sequence of (float, float)
        Time of the last sample before each, and its length, s.
    """
    out = samples_at_fault(blocks, axes, pulses)
    parts = between(blocks, gaps)
    for more in (motion(blocks, axes, parts), level_changes(blocks, axes, unit_text, scale, parts)):
        spoilt = {d.axis for d in out if d.spoils}
        out += [d for d in more if d.axis not in spoilt]
    return out


def samples_at_fault(blocks: Blocks, axes: Sequence[str], pulses: Sequence[bool]) -> list[Disturbance]:
    """Axes that are dead, stuck, saturated, rounded too coarsely or that repeat their samples.

    Parameters
    ----------
    blocks : Blocks
    axes : sequence of str
    pulses : sequence of bool
        Whether the samples of an axis are pulses counted over the interval, whose rounding is carried on.
    """
    out = []
    for k, axis in enumerate(axes):
        found = _fault(blocks, k, axis, counted=pulses[k])
        if found is not None:
            out.append(found)
    return out


def _fault(b: Blocks, k: int, axis: str, *, counted: bool) -> Disturbance | None:
    samples = b.count * b.size
    if b.low[k] == b.high[k]:
        return Disturbance("dead", axis, f"{axis} never changes: the axis is dead or not connected", spoils=True)
    noise = float(b.noise[k])
    resolved = noise > RESOLVED * b.finest[k]
    wide = b.high[k] - b.low[k] > _LEVELS * b.finest[k]
    chance = min(max(float(b.equal[k]), 1e-3), 0.999)
    run = float(b.run[k])
    limit = max(_FEWEST_EQUAL, math.log(_NEVER / max(samples, 1)) / math.log(chance), _usual_run(b, k))
    for side, value, held in (("top", b.high[k], b.at_high[k]), ("bottom", b.low[k], b.at_low[k])):
        if wide and held > max(_FEWEST_EQUAL, _AT_LIMIT * samples):
            text = (
                f"{axis} is saturated: {int(held)} samples stand exactly at the {side} of its range; choose a wider one"
            )
            return Disturbance("saturated", axis, text, spoils=True, size=float(value))
    if not counted and b.equal[k] < _HELD and run > limit:
        start = float(b.run_start[k])
        stop = start + run * b.interval
        text = f"{axis} is stuck for {int(run)} samples from {start:.6g} s: its channel stopped"
        return Disturbance("stuck", axis, text, spoils=True, start=start, stop=stop, stretches=((start, stop),))
    if not counted and (found := _rounded(b, k, axis)) is not None:
        return found
    if resolved and not counted and b.equal[k] > _HELD:
        share = float(b.equal[k])
        text = (
            f"{axis} repeats {share:.0%} of its samples although its steps are fine: it is logged faster than it is read, about "
            f"{1 / (1 - share):.2g} times; noise within that time is not the sensor's"
        )
        return Disturbance("repeated", axis, text, spoils=False)
    return None


def _usual_run(b: Blocks, k: int) -> float:
    """Samples that the longest run may have, as the log's other runs go.

    The noise of a unit that is calm at times, or whose pulses stop around zero rate, has more long runs than its share of equal
    samples tells. So runs are taken to go on as rarely as they did in the octave of lengths that most of them ended in; a channel
    that stops many times makes runs that hardly end in any octave.
    """
    reach = np.cumsum(b.runs[k][::-1])[::-1]  # runs of 2^j samples or more
    many = int(np.count_nonzero(reach >= _MANY_RUNS))
    if many <= 1:
        return 0.0
    stay = reach[1:many] / reach[: many - 1]
    j = int(np.argmin(stay)) + 1
    goes_on = math.log(min(stay[j - 1], 0.999)) / 2.0 ** (j - 1)
    return float(2.0**j + math.log(_NEVER / reach[j]) / goes_on)


def _rounded(b: Blocks, k: int, axis: str) -> Disturbance | None:
    """Rounding that hides the noise or, by a share that is told, adds to it."""
    lattice, noise = float(b.finest[k]), float(b.noise[k])
    if noise < _DITHERED * lattice or b.high[k] - b.low[k] < (_FEW_STEPS + 0.5) * lattice:
        text = (
            f"{axis} is rounded to steps coarser than its noise, which cannot be told from these samples; record with a finer "
            "step, or without the filter that took the noise away"
        )
        return Disturbance("rounded", axis, text, spoils=True, size=lattice)
    share = lattice**2 / 12.0 / noise**2
    if share < _ROUNDED:
        return None
    larger = 1.0 / math.sqrt(1.0 - share) - 1.0
    text = (
        f"{share:.0%} of the noise power of {axis} from sample to sample is that of rounding to the steps of its readings: its "
        f"white noise comes out some {larger:.0%} too large, more or less as its mean lies among them; record with a finer step"
    )
    return Disturbance("rounded", axis, text, size=lattice)


def motion(blocks: Blocks, axes: Sequence[str], parts: Sequence[slice] | None = None) -> list[Disturbance]:
    """Axes whose noise is far louder in some stretches than usual, or never steady.

    Parameters
    ----------
    blocks : Blocks
    axes : sequence of str
    parts : sequence of slice, optional
        See :func:`sagnac.noise.findings.levels.between`: what the noise has done meanwhile makes no block loud that holds a gap.
    """
    if blocks.count < FEWEST:
        return []
    whole = np.zeros(blocks.count, dtype=bool)
    for part in (slice(None),) if parts is None else parts:
        whole[part] = True
    out = []
    for k, axis in enumerate(axes):
        grain = _grain(blocks, k)
        loud = _loud(blocks.variance[:, k] + grain, blocks.size) | _loud(blocks.steps[:, k] + grain, blocks.size)
        loud &= whole
        if loud.any():
            out.append(_moved(blocks, k, axis, loud))
            continue
        unsteady = _restless(blocks.steps[:, k], blocks.size)
        if unsteady is not None:
            text = (
                f"the noise of {axis} is never steady (its size wanders by {math.expm1(unsteady / 2):.0%}): the unit was not at "
                "rest, or its surroundings shake; record on a still base"
            )
            out.append(Disturbance("restless", axis, text, spoils=True, size=unsteady))
    return out


def _grain(blocks: Blocks, k: int) -> float:
    """Variance of rounding, of which the few samples of a block may by chance show none."""
    finest = float(blocks.finest[k])
    return finest**2 / 12.0 if math.isfinite(finest) else 0.0


def _loud(variance: Array, size: int) -> NDArray[np.bool_]:
    """Blocks of so many samples that are louder than the usual ones by far more than these differ among themselves."""
    floor = float(np.median(variance))
    if not floor > 0:
        return np.zeros(variance.size, dtype=bool)
    level = np.log(np.maximum(variance, 1e-6 * floor))
    middle = np.median(level)
    spread = max(1.4826 * float(np.median(np.abs(level - middle))), math.sqrt(4.0 / size))
    return np.asarray(level > middle + max(_LOUD * spread, _LOUDER))


def _moved(b: Blocks, k: int, axis: str, loud: NDArray[np.bool_]) -> Disturbance:
    usual = float(np.median(b.variance[:, k])) + _grain(b, k)
    share = float((b.variance[loud, k] - usual).sum() / b.variance[:, k].sum())
    fast = float((b.steps[loud, k] - np.median(b.steps[:, k])).sum() / b.steps[:, k].sum())
    stretches = _stretches(b, loud)
    times = math.sqrt(float(b.variance[loud, k].max()) / usual)
    where = ", ".join(f"{s:.6g} to {e:.6g} s" for s, e in stretches[:3]) + (" ..." if len(stretches) > 3 else "")
    spoils = max(share, fast) > _SHARE
    text = f"{axis} has up to {times:.3g} times its usual scatter at {where}: the unit was moved or knocked"
    text += "" if spoils else ", too short to matter"
    return Disturbance(
        "motion",
        axis,
        text,
        spoils=spoils,
        start=stretches[0][0],
        stop=stretches[-1][1],
        size=times,
        stretches=tuple(stretches),
    )


def _restless(steps: Array, size: int) -> float | None:
    """Spread of the logarithm of the fast noise over parts of the log, where it is beyond what chance gives."""
    each = max(1, steps.size // _PARTS)
    parts = steps[: steps.size // each * each].reshape(-1, each).mean(axis=1)
    if not np.all(parts > 0):
        return None
    level = np.log(parts)
    spread = 1.4826 * float(np.median(np.abs(level - np.median(level))))
    return spread if spread > _UNSTEADY + 3.0 * math.sqrt(4.0 / (size * each)) else None


def _stretches(b: Blocks, loud: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Times of what is loud, close ones joined."""
    at = np.flatnonzero(loud)
    parts = np.split(at, np.flatnonzero(np.diff(at) > max(3, b.count // 100)) + 1)
    return [(float(b.start[p[0]]), float(b.stop[p[-1]])) for p in parts]


def advice(blocks: Blocks, seen: Sequence[Disturbance]) -> str:
    """Words for the longest stretch without anything that comes and goes and spoils an axis; empty when nothing does.

    Parameters
    ----------
    blocks : Blocks
    seen : sequence of Disturbance
    """
    bad = sorted(pair for d in seen if d.spoils for pair in d.stretches)
    if not bad or not blocks.count:
        return ""
    begin, end = float(blocks.start[0]), float(blocks.stop[-1])
    best, reached = (begin, begin), begin
    for start, stop in [*bad, (end, end)]:
        if start - reached > best[1] - best[0]:
            best = reached, start
        reached = max(reached, stop)
    if best[1] - best[0] < _WORTH * (end - begin):
        return "nothing of it is undisturbed for long: record again, at rest"
    first = math.ceil(best[0] * 10) / 10 if best[0] > begin else best[0]
    last = math.floor(best[1] * 10) / 10 if best[1] < end else best[1]
    of_start = f"--from '{first:.10g} s'" if best[0] > begin else ""
    of_stop = f"--to '{last:.10g} s'" if best[1] < end else ""
    return f"undisturbed for longest ({last - first:.4g} s): {' '.join(t for t in (of_start, of_stop) if t)}"


# ------------------------------------------------------------------------------------------------------- steps


def level_changes(
    blocks: Blocks,
    axes: Sequence[str],
    unit_text: Sequence[str],
    scale: Sequence[float],
    parts: Sequence[slice] | None = None,
) -> list[Disturbance]:
    """Steps, drifts and shocks of the mean of every axis.

    Parameters
    ----------
    blocks : Blocks
    axes : sequence of str
    unit_text, scale : sequence
        Unit that a size is told in, and the factor from the unit of the samples to it.
    parts : sequence of slice, optional
        See :func:`sagnac.noise.findings.levels.between`.
    """
    if blocks.count < FEWEST:
        return []
    parts = (slice(0, blocks.count),) if parts is None else parts
    out = []
    for k, axis in enumerate(axes):
        finest, mean = float(blocks.finest[k]), blocks.mean[:, k]
        found = steps(mean, finest / blocks.size if math.isfinite(finest) else 0.0, parts)
        drift = drift_in(blocks, mean, [s for s in found if not s.back], parts)
        if drift is not None:
            spoils = share_of(drift, blocks, mean, parts) > _HARM
            out.append(_drifts(blocks, drift, axis, unit_text[k], scale[k], spoils=spoils))
            found = [s for s in found if s.back]
        out += [_told(blocks, mean, s, parts, axis, unit_text[k], scale[k]) for s in found]
    return out


def _drifts(b: Blocks, drift: tuple[float, float], axis: str, unit: str, scale: float, *, spoils: bool) -> Disturbance:
    size, tau = drift
    begin, end = float(b.start[0]), float(b.stop[-1])
    over = size * (math.exp(-(end - begin) / tau) - 1.0)
    settled = begin + _SETTLED * tau
    text = f"{axis} drifts by {over * scale:.3g} {unit}, fast at first, with a time constant of {tau:.3g} s"
    text += (
        f": let the unit warm up for {_SETTLED * tau:.3g} s before the log"
        if spoils
        else ", too little to change the result"
    )
    return Disturbance(
        "drift",
        axis,
        text,
        spoils=spoils,
        start=begin,
        stop=min(settled, end),
        size=over,
        stretches=((begin, min(settled, end)),),
    )


def _told(
    b: Blocks, mean: Array, step: Step, parts: Sequence[slice], axis: str, unit: str, scale: float
) -> Disturbance:
    at = min(step.at, b.count - 1)
    size = step.size * scale
    time = float(b.start[at])
    spoils = harm(step, mean, parts) > _HARM
    kind = "shock" if step.back else "step"
    what = "is pushed by" if step.back else "changes its mean by"
    text = f"{axis} {what} {size:.3g} {unit} at {time:.6g} s ({step.significance:.0f} times its noise there)"
    text += " and comes back" if step.back else ""
    text += "" if spoils else ", too little to change the result"
    end = float(b.stop[min(at + step.width, b.count - 1)]) if step.back else time
    return Disturbance(
        kind,
        axis,
        text,
        spoils=spoils,
        start=time,
        size=step.size,
        significance=step.significance,
        stretches=((time, end),),
    )
