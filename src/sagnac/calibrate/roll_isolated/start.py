"""First look at a recording of a roll-isolated rig: what is refused and why, and the published closed form as start value."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...errors import DataError, InputError
from ...observe.rolling import half_width, interval_of, need_rates
from ...plan import Plan
from ...recording import GAP, Recording
from ...rigs.roll_isolated import HALF_ANGLE, MOUNT_PITCH, MOUNT_YAW, PHASE
from .seen import Seen, add_all

TURNS = 3.0
"""Fewest turns of a spinning segment."""
_SURE = 4.0  # standard errors
_CODES = 1 << 22  # finest encoder whose readings are counted one by one
_OFF = 0.02
"""Relative difference of a rate to the plan's that no roll-isolated rig has."""
_GAIN = 0.2
_NOISY = 1e-6  # of the rate: more from sample to sample than steady rates change
_JUMP = math.radians(3.0)  # per radian of turn from sample to sample: more than any eccentricity does


@dataclass(frozen=True)
class Look:
    """Everything the first pass found.

    Attributes
    ----------
    seen : tuple of Seen
        Of each segment.
    interval : float, s
    half : int
    """

    seen: tuple[Seen, ...]
    interval: float
    half: int

    def of(self, stage: str) -> list[Seen]:
        """Segments of one stage."""
        return [s for s in self.seen if s.segment.stage == stage]

    @property
    def span(self) -> tuple[float, float]:
        """First and last sample time of the segments."""
        return min(s.first for s in self.seen), max(s.last for s in self.seen)


def look(recording: Recording, plan: Plan) -> Look:
    """First pass over the segments of a plan, with everything refused that needs no model.

    Parameters
    ----------
    recording : Recording
        Sampled gyro rates and, where the carrier spins, the column ``encoder``.
    plan : Plan
        Of a roll-isolated rig.

    Raises
    ------
    InputError
        When columns are missing or the plan is of another rig.
    DataError
        When a segment lies outside the data, is too short, too slowly sampled, saturated, or when the rates or the encoder
        do not do what the plan says; the message says which.
    """
    if plan.rig.kind != "roll-isolated":
        raise InputError(f'the plan is of a {plan.rig.kind}; roll-isolated needs [rig] kind = "roll-isolated"')
    if not plan.segment:
        raise DataError("the plan has no [[segment]]; this method needs to know when the rig did what")
    need_rates(recording)
    interval = interval_of(recording)
    half = half_width(interval)
    step = plan.rig.encoder_resolution
    codes = round(2.0 * math.pi / step) if step > 2.0 * math.pi / _CODES else 0
    seen = tuple(Seen(s, interval, codes=np.zeros(codes, dtype=np.bool_)) for s in plan.segment)
    for s in seen:
        _refuse_slow_sampling(s)
    add_all(seen, recording, interval, half)
    for s in seen:
        _refuse_outside(recording.name, s, half)
        _refuse_stuck(recording.name, s)
    for s in seen:
        if s.segment.stage == "inner":
            _check_inner(s)
        else:
            _check_spin(s, plan)
    return Look(seen, interval, half)


def _refuse_slow_sampling(s: Seen) -> None:
    step = abs(s.segment.spin_rate) * s.interval / (2.0 * math.pi)
    if step >= 0.5:
        raise DataError(
            f"segment {s.segment.name!r}: at {math.degrees(s.segment.spin_rate):.6g} deg/s and a sample every "
            f"{s.interval:.3g} s the encoder makes {step:.3g} turns from sample to sample, and half a turn or more cannot be "
            "told from less: sample faster or spin more slowly"
        )


def _refuse_outside(name: str, s: Seen, half: int) -> None:
    slack = (half + 1 + GAP) * s.interval
    if s.count == 0 or s.first > s.segment.start + slack or s.last < s.segment.stop - slack:
        there = "no sample" if s.count == 0 else f"samples from {s.first:g} s to {s.last:g} s only"
        raise DataError(
            f"segment {s.segment.name!r} ({s.segment.start:g} s to {s.segment.stop:g} s) holds {there} in {name} (a run of "
            f"samples without gap must be longer than {2 * half * s.interval:.2g} s): check the plan's times"
        )


def _refuse_stuck(name: str, s: Seen) -> None:
    """An axis without noise beside others that have some is saturated, dead or not connected."""
    noisy = s.noise.max() > _NOISY * abs(s.segment.turn_rate) * math.sqrt(s.interval)
    for axis, low, high in zip("xyz", s.low, s.high, strict=True):
        if low == high and noisy:
            raise DataError(
                f"{name}: gyro_{axis} stands at {_deg(float(low))} through segment {s.segment.name!r}: it is saturated, stuck or "
                "not connected"
            )


def _deg(rate: float) -> str:
    return f"{math.degrees(rate):.6g} deg/s"


def _check_inner(s: Seen) -> None:
    name, rate, mean = s.segment.name, s.segment.inner_rate, s.mean
    if abs(mean[0]) < max(abs(mean[1]), abs(mean[2])):
        axis = "yz"[int(abs(mean[2]) > abs(mean[1]))]
        raise DataError(
            f"segment {name!r}: the inner cylinder turns about its axis, but gyro_{axis} sees most of it, not gyro_x: columns "
            "are permuted (--map)"
        )
    gain = float(mean[0]) / rate
    if gain < 0:
        raise DataError(
            f"segment {name!r}: gyro_x reads {_deg(mean[0])} where inner_rate is {_deg(rate)}: wrong sign of inner_rate, or of "
            "the gyro_x column"
        )
    if abs(gain - 1.0) > _GAIN:
        cause = " (the column's unit is rad/s, not deg/s, or the reverse)" if 0.7 < gain * 57.3 < 1.3 else ""
        cause = " (the column's unit is deg/s, not rad/s, or the reverse)" if 0.7 < gain / 57.3 < 1.3 else cause
        raise DataError(
            f"segment {name!r}: gyro_x reads {_deg(mean[0])} where inner_rate is {_deg(rate)}{cause}: check unit, scale, "
            "inner_rate and the segment's times"
        )


def _check_spin(s: Seen, plan: Plan) -> None:
    name, rate = s.segment.name, s.segment.spin_rate
    turns = abs(rate) * (s.last - s.first) / (2.0 * math.pi)
    if turns < TURNS:
        raise DataError(f"segment {name!r}: {turns:.2g} turns of the carrier are too few; {TURNS:g} are needed")
    density = (plan.unit.noise.of("gyro") or s.noise.tolist())[0]
    swings = s.excited(density)
    _check_sense(s, rate, swings)
    off = s.spin / rate - 1.0
    if abs(off) > max(_OFF, 5.0 * plan.rig.rate_uncertainty):
        raise DataError(
            f"segment {name!r}: spin_rate is {_deg(rate)}, but the encoder turns at {_deg(s.encoder_rate)} and gyro_x at "
            f"{_deg(float(s.mean[0]))}, together {_deg(s.spin)}: check spin_rate, the encoder's unit and the segment's times"
        )
    _refuse_jump(s, plan)
    answer, error = s.answer() if swings else (-1.0, 0.0)
    if abs(answer + 1.0) > _GAIN + _SURE * error:
        raise DataError(
            f"segment {name!r}: for a swing of 1 deg/s in gyro_x the encoder changes its rate by {answer:.3g} deg/s where -1 "
            "is expected: check the units of both"
        )
    forward, backward = (abs(v) for v in s.harmonics())
    if backward > max(2.0 * forward, 20.0 * density / math.sqrt(s.count * s.interval)):
        raise DataError(
            f"segment {name!r}: the rate across the roll axis, {_deg(backward)}, turns against the encoder: gyro_y and gyro_z "
            "are swapped, one of them has its sign reversed, or the encoder counts the other way"
        )


def _check_sense(s: Seen, rate: float, swings: bool) -> None:
    """Signs of encoder, gyro x and plan; the swing tells which of them is at fault."""
    name, against = s.segment.name, s.encoder_rate * rate < 0
    answer, error = s.answer() if swings else (-1.0, 0.0)
    same_sense = answer > _SURE * error
    swings = swings and abs(answer) > _SURE * error
    if against and same_sense:
        raise DataError(
            f"segment {name!r}: the encoder counts the other way: it turns at {_deg(s.encoder_rate)} where spin_rate is "
            f"{_deg(rate)}, and answers to a swing with the sign of gyro_x. It must show the roll of the carrier against the "
            "inner cylinder"
        )
    if against:
        which = "wrong sign of spin_rate" if swings else "wrong sign of spin_rate, or the encoder counts the other way"
        raise DataError(
            f"segment {name!r}: the encoder turns at {_deg(s.encoder_rate)} where spin_rate is {_deg(rate)}: {which}"
        )
    if same_sense:
        raise DataError(
            f"segment {name!r}: the encoder answers to a swing with the sign of gyro_x, where a roll of the cylinder takes away "
            "from it: wrong sign of the gyro_x column, or both spin_rate and the encoder have theirs reversed"
        )


def _refuse_jump(s: Seen, plan: Plan) -> None:
    turn = abs(s.segment.spin_rate) * s.interval
    limit = 4.0 * (plan.rig.encoder_resolution or min(s.finest, 0.1)) + _JUMP * min(1.0, turn)
    limit += 4.0 * math.sqrt(s.swing_variance) * s.interval
    size, time, row = s.jump
    if size > limit:
        raise DataError(
            f"segment {s.segment.name!r}: the encoder jumps by {math.degrees(size):.3g} deg more than the carrier turns, at "
            f"{time:.6g} s (row {row}): it lost counts, was read late, or stuck. Leave that time out of the segment"
        )


def closed_form(seen: Look) -> dict[str, float]:
    """The published two-stage solution, unweighted: biases and mounting angles from the means, the cone from the harmonics.

    Parameters
    ----------
    seen : Look
        With inner segments of both senses and a spinning one.

    Returns
    -------
    dict of str to float
        Parameters by name, SI; the encoder is taken as perfect.

    References
    ----------
    [ZHANG15]: ``yaw = asin(w2z / |w2|)``, ``pitch = -atan2(w2y, w2x)``, cone from the first harmonic of ``C_2^1 w2``.
    """
    inner = seen.of("inner")
    rates = np.array([s.segment.inner_rate for s in inner])
    means = np.array([s.mean for s in inner])
    slope, bias = np.linalg.lstsq(np.column_stack([rates, np.ones(rates.size)]), means, rcond=None)[0]
    out = {f"gyro.bias.{a}": float(b) for a, b in zip("xyz", bias, strict=True)}
    size = float(np.linalg.norm(slope))
    out["gyro.scale_error.x"] = size - 1.0
    out[MOUNT_YAW], out[MOUNT_PITCH] = math.asin(slope[2] / size), -math.atan2(slope[1], slope[0])
    # y and z of w1 differ from those of w2 by the roll rate times small angles, which the harmonics' fit takes out
    spinning = seen.of("spin")
    phasor = sum(s.harmonics()[0] * s.segment.spin_rate * s.count for s in spinning) / sum(
        s.segment.spin_rate**2 * s.count for s in spinning
    )
    out[HALF_ANGLE], out[PHASE] = math.asin(min(abs(phasor), 1.0)), math.atan2(phasor.imag, phasor.real)
    return out
