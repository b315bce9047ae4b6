"""What an ideal unit on an ideal rig would give for a plan: noise-free observations that carry the stated noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calibrate import common
from ..errors import InputError
from ..frames import Array
from ..observe.harmonics import SegmentHarmonics
from ..observe.means import SegmentMeans
from ..plan import Plan, Segment
from ..recording import SENSORS, Recording
from ..rigs import centrifuge
from ..rigs.turntable import Site, mean_inputs
from ..sensors import Axis
from ..sensors.series import basis, response
from ..simulate import roll_isolated

_INTERVAL = 0.01  # s: any that is short against the turns gives the same means
_ORDER = 4
_SAMPLES_A_TURN = 32


def need_noise(plan: Plan, sensors: Sequence[str]) -> None:
    """Refuse a plan that does not say how noisy the sensors are.

    Raises
    ------
    InputError
        With the key that is missing.
    """
    for sensor in sensors:
        if plan.unit.noise.of(sensor) is None:
            example = {"accel": "10 ug/sqrt(Hz)", "gyro": "0.01 deg/sqrt(h)"}[sensor]
            raise InputError(
                f"the plan does not state the noise of the {sensor} triad, without which nothing can be predicted: write "
                f'noise = {{ {sensor} = "{example}" }} under [unit]'
            )


def table_means(plan: Plan, sensors: Sequence[str]) -> SegmentMeans:
    """Means of the segments of a turntable's plan.

    Parameters
    ----------
    plan : Plan
    sensors : sequence of str
        ``accel``, ``gyro``.
    """
    hold = np.array([s.stop - s.start for s in plan.segment])
    count = np.maximum(np.round(hold / _INTERVAL), 1).astype(int)
    n = len(hold)
    means = SegmentMeans(
        segments=plan.segment,
        mid_time=np.array([(s.start + s.stop) / 2 for s in plan.segment]),
        interval=hold / count,
        duration=hold,
        count=count,
        mean=dict.fromkeys(sensors, np.zeros((n, 3))),
        density={s: np.full(3, np.nan) for s in sensors},
        noise_degrees_of_freedom=0.0,
        span=(plan.segment[0].start, plan.segment[-1].stop),
    )
    rates = common.rates_of(means)
    latitude = plan.need_latitude("the Earth rate") if "gyro" in sensors else plan.latitude or 0.0
    felt = mean_inputs(
        common.need_angles(means, "a prediction"),
        rates,
        common.left_of(means, rates),
        Site(latitude, plan.site_gravity, plan.earth_rate),
        letters=plan.rig.letters,
        derivatives=False,
    )
    means.mean.update({s: felt.force if s == "accel" else felt.rate for s in sensors})
    return means


def centrifuge_harmonics(plan: Plan, sensors: Sequence[str]) -> SegmentHarmonics:
    """Harmonics of the segments of a centrifuge's plan, in the form that its calibration would ask for.

    Parameters
    ----------
    plan : Plan
    sensors : sequence of str
        ``accel``, ``gyro`` or single ones, ``accel_z``.
    """
    axes = tuple(a for s, triad in SENSORS.items() for a in triad if s in sensors or a in sensors)
    segments, n = plan.segment, len(plan.segment)
    rates = np.array([s.arm_rate for s in segments])
    hold = np.array([s.stop - s.start for s in segments])
    middle = np.array([(s.start + s.stop) / 2 for s in segments])
    phase = np.array([(s.arm_phase or 0.0) for s in segments]) + rates * hold / 2
    arm = centrifuge.Arm(plan.rig.radius or 0.0, plan.rig.counter_rotating)
    site = Site(plan.need_latitude("the Coriolis force on the arm"), plan.site_gravity, plan.earth_rate)
    settings = np.array([[s.alpha, s.beta, s.gamma] for s in segments])
    felt = centrifuge.series(arm, site, rates, settings)
    ideal = [Axis(a.partition("_")[0], a[-1], ()) for a in axes]
    values = np.stack([response(a, np.zeros(0), felt.force, felt.rate, _ORDER).value for a in ideal], axis=1)
    still = rates == 0
    if not plan.rig.counter_rotating:  # at rest a unit fixed to the arm reads what is felt at the arm's angle
        values[still, :, 0] = np.einsum("nmc,nc->nm", values[still], basis(phase[still], _ORDER))
    values[still, :, 1:] = 0.0
    unsure = asks_for_rate(plan)
    if unsure:
        values = np.concatenate([values, np.zeros((n, len(axes), 2 * _ORDER))], axis=2)
    covariance = np.stack([_harmonic_covariance(s, p, unsure) for s, p in zip(segments, phase, strict=True)])
    nothing = np.full(n, np.nan)
    return SegmentHarmonics(
        segments=segments,
        order=_ORDER,
        axes=axes,
        mid_time=middle,
        interval=np.full(n, _INTERVAL),
        duration=hold,
        count=np.maximum(np.round(hold / _INTERVAL), 1).astype(int),
        rate=rates,
        phase=phase,
        coefficient=values,
        unit_covariance=covariance,
        condition=np.ones(n),
        density=np.full(len(axes), np.nan),
        noise_degrees_of_freedom=0.0,
        residual_variance=np.zeros((n, len(axes))),
        measured_rate=rates if unsure else nothing,
        rate_sigma=np.abs(rates) * 1e-6 if unsure else nothing,
        arm_known=np.zeros(n, dtype=bool),
        span=(segments[0].start, segments[-1].stop),
    )


def asks_for_rate(plan: Plan) -> bool:
    """Whether the calibration would look for the arm's rate in the samples."""
    return plan.rig.counter_rotating and (
        plan.rig.rate_uncertainty > 0 or any(s.arm_rate and s.arm_phase is None for s in plan.segment)
    )


def _harmonic_covariance(segment: Segment, middle: float, extended: bool) -> Array:
    """Covariance of the coefficients for samples of unit variance, one each `_INTERVAL`."""
    hold, c = segment.stop - segment.start, 1 + 2 * _ORDER
    size = c + 2 * _ORDER * extended
    if segment.arm_rate == 0:
        out = np.diag(np.full(size, np.inf))
        out[0, 0] = _INTERVAL / hold
        return out
    count = int(max(512, min(_SAMPLES_A_TURN * abs(segment.arm_rate) * hold / (2 * np.pi), 1e5)))
    since = ((np.arange(count) + 0.5) / count - 0.5) * hold
    angle = middle + segment.arm_rate * since
    terms = [np.ones(count)]
    for h in range(1, _ORDER + 1):
        terms += [np.cos(h * angle), np.sin(h * angle)]
    if extended:
        terms += [since * t for t in terms[1:]]
    design = np.column_stack(terms)
    return np.asarray(np.linalg.inv(design.T @ design) * count * _INTERVAL / hold)


def roll_recording(plan: Plan) -> tuple[Recording, str]:
    """Samples of a roll-isolated rig with the angles of [ZHANG15], 1 kHz, an inner swing of 2 deg at 1.7 Hz; and these words.

    Its information depends on the cone, the swing and the encoder, so that it is a recording with noise that is looked at.

    Parameters
    ----------
    plan : Plan
    """
    step = plan.rig.encoder_resolution
    batches = roll_isolated.simulate(
        plan,
        roll_isolated.PUBLISHED,
        np.random.default_rng(1),
        density=None,
        encoder_bits=round(np.log2(2.0 * np.pi / step)) if step > 0 else None,
    )
    words = (
        "predicted for a cone of 0.16 deg, samples at 1 kHz and an inner swing of 2 deg at 1.7 Hz: the phase of the cone is as "
        "much less certain as the cone is smaller, the encoder's delay as the swing is"
    )
    return roll_isolated.recording_of(batches), words
