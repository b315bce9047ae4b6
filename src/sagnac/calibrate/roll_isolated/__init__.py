"""Roll-isolated rig: mounting angles, cone, gyro biases and scales, encoder delay and eccentricity in one fit of both stages.

Model and rows: :mod:`.model`; first look, refusals and the published closed form: :mod:`.start`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...calibration import Calibration, Scatter, named
from ...earth import STANDARD_GRAVITY
from ...errors import DataError
from ...estimate import Estimate, Parameter, estimate, settle
from ...estimate.problem import stacked
from ...frames import Array
from ...observe.rolling import SMOOTHING
from ...observe.sums import BLOCKS
from ...plan import Plan, Segment
from ...recording import Recording
from ...rigs.roll_isolated import DELAY, ECCENTRICITY, HALF_ANGLE, MOUNT_PITCH, MOUNT_YAW, PHASE
from .. import common
from ..slow import slow_noise
from .model import RollModel
from .rows import COAXIAL, EARTH_ALONG, RATE_ERROR, Noise, drift_name, earth_names, spin_name
from .start import Look, closed_form, look

GYRO_SCALE = 0.01
"""One sigma of the scale errors of gyros y and z where the plan does not state it."""
_ECCENTRICITY_PRIOR = 0.1  # rad: no encoder is off by more
_ANY_PHASE = math.pi / math.sqrt(3.0)  # standard deviation of an angle of which nothing is known
_DIFFERENT = 0.05  # of the faster one: spin rates that tell delay from phase
_STATED = (0.5, 1.5)
_ROUNDS = 3  # of noise from residuals and fit with that noise
_SAME = 0.05
_NOTHING = 0.01
_FLOOR = 1e-7  # of the rates: noise of a sample that no gyro is free of
_TOLERANCE = 1e-5  # of all residuals: far below a standard uncertainty, and each step is a pass over the recording
_PART = 100  # fewest samples of a part that a segment is judged by
_CONTRADICTED = 5.0  # standard uncertainties
_SCALES = {MOUNT_YAW: 0.01, MOUNT_PITCH: 0.01, HALF_ANGLE: 0.01, PHASE: 10.0, DELAY: 2e-3}


def calibrate_recording(recording: Recording, plan: Plan, *, robust: bool = False) -> Calibration:
    """Calibration from both stages of a roll-isolated rig.

    Parameters
    ----------
    recording : Recording
        Gyros, and the column ``encoder`` where the carrier spins. Read several times, piece by piece.
    plan : Plan
        ``rig.kind = "roll-isolated"``; segments of stage ``inner`` in both senses and of stage ``spin``.
    robust : bool
        Turn down parts of segments that disagree with the rest.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        When columns are missing or the plan is of another rig.
    DataError
        When a stage or a sense is missing, signs, units or rates are wrong, the encoder jumps, or delay and phase of the cone
        cannot be told apart; the message says which.

    References
    ----------
    [ZHANG15]; what is added to it is listed with the method's documentation.
    """
    seen = look(recording, plan)
    _refuse_missing(seen)
    remarks = [*_assumptions(plan), *_repeated(seen)]
    noise, known = first_noise(seen, plan)
    steady = steady_segments(seen, noise)
    _refuse_unseen_delay(seen, plan, steady)
    parameters = _parameters(seen, plan)
    model = RollModel(
        recording,
        plan.segment,
        tuple(p.name for p in parameters),
        {} if plan.rig.encoder_delay is None else {DELAY: plan.rig.encoder_delay},
        noise,
        seen.interval,
        seen.half,
        steady,
        {s.segment.name: s.repeated for s in seen.of("spin")},
        blocks=max(1, min(BLOCKS, min(s.count for s in seen.seen) // _PART)),
        slow=slow_noise(plan, "gyro"),
    )
    found: list[str] = []
    if not all(known):
        parameters = list(settle(parameters, model.rows, max_iterations=3))
        model.rows(np.array([p.start for p in parameters]))
        noise, found = seen_noise(model, noise, known)
        model = model.with_noise(noise)
    for _ in range(_ROUNDS):
        fit = estimate(parameters, model.rows, model.parts, robust=robust, tolerance=_TOLERANCE)
        noise, more = seen_noise(model, noise, known)
        found += more
        if _same(noise, model.noise):
            break
        model = model.with_noise(noise)
        parameters = [replace(p, start=float(v)) for p, v in zip(parameters, fit.value, strict=True)]
    _refuse_long_delay(fit)
    remarks += [*found, *_findings(fit, plan), *_stated_delay(fit, model, plan)]
    return _report(fit, model, plan, seen, recording, remarks)


def _same(one: Noise, other: Noise) -> bool:
    """Whether two noises differ by less than matters."""
    return bool(
        np.allclose(one.gyro, other.gyro, rtol=_SAME) and math.isclose(one.encoder, other.encoder, rel_tol=_SAME)
    )


def _refuse_long_delay(fit: Estimate) -> None:
    value = dict(zip(fit.names, fit.value, strict=True)).get(DELAY, 0.0)
    if abs(value) > SMOOTHING:
        raise DataError(
            f"the encoder seems to be read {value * 1e3:.4g} ms after the samples' time, more than the {SMOOTHING * 1e3:.0f} "
            "ms that this method can follow a swing over: shift the encoder's column in time first, or check it"
        )


def _stated_delay(fit: Estimate, model: RollModel, plan: Plan) -> list[str]:
    """A word where the swing contradicts the delay that the plan states: one step of the fit with the delay set free."""
    stated = plan.rig.encoder_delay
    if stated is None or len(model.steady) == sum(s.stage == "spin" for s in model.segments):
        return []
    free = replace(model, names=(*model.names, DELAY))
    parameters = [*fit.parameters, Parameter(DELAY, "s", stated, _SCALES[DELAY])]
    rows = free.rows(np.append(fit.value, stated))
    residual, jacobian = stacked(parameters, rows, np.append(fit.value, stated))
    information = jacobian.T @ jacobian
    step = float(np.linalg.solve(information, -jacobian.T @ residual)[-1])
    sigma = math.sqrt(float(np.linalg.inv(information)[-1, -1]))
    if abs(step) < _CONTRADICTED * sigma:
        return []
    text = (
        f"the swing shows the encoder read {(stated + step) * 1e3:.4g} ms (standard uncertainty {sigma * 1e3:.2g} ms) after the "
        f"samples' time where the plan states {stated * 1e3:.4g} ms; leave rig.encoder_delay out to have it estimated"
    )
    return [text]


def _repeated(seen: Look) -> list[str]:
    """A word on segments in which the encoder's rounding repeats itself."""
    return [
        f"segment {s.segment.name!r}: the encoder stands on {int(s.codes.sum())} of its steps only, each {s.repeated:.3g} times, "
        "and its rounding does not average out; the uncertainty says so. A swing, or another ratio of spin and sampling, helps"
        for s in seen.of("spin")
        if s.repeated > 1.0
    ]


def _refuse_missing(seen: Look) -> None:
    inner, spin = seen.of("inner"), seen.of("spin")
    if not inner:
        raise DataError(
            'the plan has no segment of stage = "inner": without the inner cylinder turned alone, mounting angles and gyro '
            "biases cannot be told from each other"
        )
    if not spin:
        raise DataError(
            'the plan has no segment of stage = "spin": half-angle and phase of the cone and the errors of the encoder show '
            "only while the carrier spins"
        )
    if len({math.copysign(1.0, s.segment.inner_rate) for s in inner}) == 1:
        raise DataError(
            "the inner cylinder turned in one sense only, so that these cannot be told apart: gyro.bias.x and "
            f"gyro.scale_error.x, gyro.bias.y and {MOUNT_PITCH}, gyro.bias.z and {MOUNT_YAW}. Add a segment with inner_rate of "
            "the other sign"
        )


def _refuse_unseen_delay(seen: Look, plan: Plan, steady: dict[str, float]) -> None:
    """One speed without swing shows the phase of the cone and the delay only as phase - spin * delay."""
    spins = [s.segment.spin_rate for s in seen.of("spin")]
    told = len(steady) < len(spins) or max(spins) - min(spins) > _DIFFERENT * max(map(abs, spins))
    if plan.rig.encoder_delay is None and not told:
        raise DataError(
            f"the data show only {PHASE} - {math.degrees(spins[0]):.6g} deg/s * {DELAY} and cannot tell the two apart: the inner "
            "cylinder does not swing and the carrier spins at one speed only. Let the cylinder swing, add a segment with another "
            "spin_rate, or state rig.encoder_delay"
        )


def steady_segments(seen: Look, noise: Noise) -> dict[str, float]:
    """Segments whose swing does not stand out of the noise, and their mean gyro x, rad/s."""
    density = float(noise.gyro[0])
    return {s.segment.name: float(s.mean[0]) for s in seen.of("spin") if not s.excited(density)}


def first_noise(seen: Look, plan: Plan) -> tuple[Noise, tuple[bool, bool]]:
    """Noise before there is a model, and whether the gyros' and the encoder's are stated."""
    # while the cylinder turns alone the rates are steady; else the fit's residuals tell better later
    quiet = seen.of("inner") or list(seen.seen)
    weights = np.array([s.count for s in quiet], dtype=float)
    density = np.sqrt(np.average([s.noise**2 for s in quiet], axis=0, weights=weights))
    stated = plan.unit.noise.of("gyro")
    step = plan.rig.encoder_resolution or min((s.finest for s in seen.of("spin")), default=0.0)
    floor = _least_noise(plan.segment, seen.interval)
    gyro = np.maximum(density if stated is None else np.array(stated), floor)
    return Noise(gyro, max(step**2 / 12.0, _least_reading(gyro, seen.interval))), (
        stated is not None,
        plan.rig.encoder_resolution > 0,
    )


def _least_noise(segments: Sequence[Segment], interval: float) -> float:
    """Density so small that nothing counts beside it, for gyros that seem to have none."""
    return _FLOOR * max(abs(s.turn_rate) for s in segments) * math.sqrt(interval)


def _least_reading(gyro: Array, interval: float) -> float:
    """Variance of a reading so small beside what gyro x walks in a step that it changes nothing."""
    return _NOTHING * float(gyro[0]) ** 2 * interval


def seen_noise(model: RollModel, noise: Noise, stated: tuple[bool, bool]) -> tuple[Noise, list[str]]:
    """Noise that the residuals of a settled fit show; stated noise gives way only where they clearly show more."""
    left, remarks = model.left(), []
    # without inner stage nothing is left over of gyro x alone
    squares = [left.get(a, (1.0, 1)) for a in "xyz"]
    times = np.array([math.sqrt(max(s, 1e-300) / max(dof, 1)) for s, dof in squares])
    gyro = np.maximum(noise.gyro * times, _least_noise(model.segments, model.interval))
    if stated[0]:
        gyro = np.where(times > _STATED[1], gyro, noise.gyro)
        if times.max() > _STATED[1]:
            remarks.append(
                f"the gyro data show up to {times.max():.2g} times the noise stated in the plan: the data's own is used"
            )
        elif times.max() < _STATED[0]:
            remarks.append(
                f"the gyro data show only {times.max():.2g} of the noise stated in the plan, which is used all the same"
            )
    more = left["encoder"][0] / max(left["encoder"][1], 1) if "encoder" in left else 1.0
    reading = noise.encoder
    if not stated[1] or more > _STATED[1] ** 2:
        # S = R + P and P^2 = q S in the steady state: R from the innovations' variance S found and the gyro's walk q
        q, was = float(noise.gyro[0]) ** 2 * model.interval, noise.encoder
        s = more * (was + (q + math.sqrt(q * q + 4.0 * q * was)) / 2.0)
        q = float(gyro[0]) ** 2 * model.interval
        reading = max(s - math.sqrt(q * s), _least_reading(gyro, model.interval))
    if stated[1] and more > _STATED[1] ** 2:
        remarks.append(
            f"the encoder scatters {math.sqrt(more):.2g} times as much as rig.encoder_resolution and gyro noise explain: the "
            "data's own noise is used"
        )
    return Noise(gyro, reading), remarks


def _assumptions(plan: Plan) -> list[str]:
    """What the result takes for granted because the plan does not say otherwise."""
    out = []
    if plan.unit.limits.gyro_scale is None:
        out.append(
            f"unit.limits.gyro_scale is not stated: {GYRO_SCALE:.0%} is taken for the scale errors of gyros y and z, which this "
            "rig cannot tell from the half-angle of the cone"
        )
    if plan.unit.limits.gyro_drift is None:
        out.append("unit.limits.gyro_drift is not stated: gyro biases are taken as the same in all segments")
    if plan.rig.rate_uncertainty == 0:
        out.append("rig.rate_uncertainty is not stated: inner_rate is taken as exact")
    if plan.rig.angle_uncertainty > 0:
        out.append("rig.angle_uncertainty says nothing here: this method uses no settings")
    return out


def _parameters(seen: Look, plan: Plan) -> list[Parameter]:
    start = closed_form(seen)
    size = max(abs(s.segment.inner_rate) for s in seen.of("inner"))
    out = [
        Parameter(n, "rad", start[n], _SCALES[n], 0.0, _ANY_PHASE if n == PHASE else np.inf)
        for n in (MOUNT_YAW, MOUNT_PITCH, HALF_ANGLE, PHASE)
    ]
    out += [Parameter(f"gyro.bias.{a}", "rad/s", start[f"gyro.bias.{a}"], 0.01 * size) for a in "xyz"]
    out.append(Parameter("gyro.scale_error.x", "1", start["gyro.scale_error.x"], 0.01))
    prior = GYRO_SCALE if plan.unit.limits.gyro_scale is None else plan.unit.limits.gyro_scale
    out += [_known(f"gyro.scale_error.{a}", "1", prior, nuisance=False) for a in "yz"]
    if plan.rig.encoder_delay is None:
        out.append(Parameter(DELAY, "s", 0.0, _SCALES[DELAY]))
    stated = plan.rig.encoder_uncertainty
    out += [_known(n, "rad", _ECCENTRICITY_PRIOR if stated is None else stated, nuisance=False) for n in ECCENTRICITY]
    return [*out, *nuisances(seen, plan)]


def _known(name: str, unit: str, sigma: float, *, nuisance: bool = True) -> Parameter:
    """A parameter that is zero within sigma beforehand; that much, and ten times it, is of use."""
    sigma = max(sigma, 1e-12)
    return Parameter(name, unit, 0.0, 10.0 * sigma, 0.0, sigma, nuisance=nuisance)


def nuisances(seen: Look, plan: Plan) -> list[Parameter]:
    """What differs from recording to recording: Earth rate, the table's own errors, drifts of the biases, spin rates.

    Parameters
    ----------
    seen : Look
    plan : Plan
    """
    # a component of a vector whose direction is not known
    earth = plan.earth_rate / math.sqrt(3.0)
    out = [_known(EARTH_ALONG, "rad/s", earth)]
    if plan.rig.rate_uncertainty > 0:
        out.append(_known(RATE_ERROR, "1", plan.rig.rate_uncertainty))
    if plan.rig.axis_uncertainty > 0:
        out += [_known(n, "rad", plan.rig.axis_uncertainty) for n in COAXIAL]
    drift = plan.unit.limits.gyro_drift or 0.0
    for s in seen.seen:
        spins = s.segment.stage == "spin"
        out += [_known(n, "rad/s", earth) for n in earth_names(s.segment)]
        if drift > 0:  # of gyro x in a spinning segment it cannot be told from the spin rate, and moves nothing else
            out += [_known(drift_name(a, s.segment), "rad/s", drift) for a in ("yz" if spins else "xyz")]
        if spins:
            rate = abs(s.segment.spin_rate)
            out.append(Parameter(spin_name(s.segment), "rad/s", s.spin, 0.1 * rate, nuisance=True))
    return out


def _findings(fit: Estimate, plan: Plan) -> list[str]:
    # many parts to a segment: what is wrong in the plan moves the chi-square little and its probability much
    out = [*common.misfit_remarks(fit, noise_known=True, poor=1.0), *common.prior_remarks(fit)]
    value, sigma = dict(zip(fit.names, fit.value, strict=True)), dict(zip(fit.names, fit.sigma, strict=True))
    if abs(value[HALF_ANGLE]) < 3.0 * sigma[HALF_ANGLE]:
        out.append("the cone is no larger than its uncertainty: its phase means nothing")
    for n in (n for n in fit.names if n.startswith("rig.spin_rate.")):
        stated = next(s.spin_rate for s in plan.segment if spin_name(s) == n)
        off = value[n] / stated - 1.0
        if abs(off) > max(1e-4, 3.0 * plan.rig.rate_uncertainty):
            out.append(
                f"segment {n.removeprefix('rig.spin_rate.')!r} spun at {math.degrees(value[n]):.8g} deg/s by encoder and gyro_x, "
                f"{off:.2g} (relative) off spin_rate; their value is used"
            )
    return out


def _report(
    fit: Estimate,
    model: RollModel,
    plan: Plan,
    seen: Look,
    recording: Recording,
    remarks: list[str],
) -> Calibration:
    order = [i for i, p in enumerate(fit.parameters) if not p.nuisance]
    names = [fit.names[i] for i in order]
    units = [fit.parameters[i].unit for i in order]
    value, covariance = fit.value[order], fit.covariance[np.ix_(order, order)]
    value, covariance = _plain_cone(names, value, covariance)
    record = common.fit_record([(fit, order)], _scatter(model))
    if plan.rig.encoder_delay is not None:
        names, units = [*names, DELAY], [*units, "s"]
        value, covariance = np.append(value, plan.rig.encoder_delay), np.pad(covariance, (0, 1))
        record = record.model_copy(
            update={k: (*v, 0.0) for k in ("white", "cluster", "delete_one") if (v := getattr(record, k)) is not None}
        )
    given = plan.gravity is not None or plan.latitude is not None
    found = common.result(
        "roll-isolated",
        named(names, units, value, covariance),
        covariance,
        record,
        plan=plan,
        gravity=plan.site_gravity if given else STANDARD_GRAVITY,
        recording=recording,
        span=seen.span,
        remarks=remarks,
    )
    stated = plan.unit.noise.of("gyro")
    own = stated is None or np.any(model.noise.gyro > 1.01 * np.array(stated))
    return common.with_found_noise(found, plan, "gyro", model.noise.gyro) if own else found


def _plain_cone(names: list[str], value: Array, covariance: Array) -> tuple[Array, Array]:
    """The same cone with a half-angle that is not negative and a phase between -pi and pi."""
    half, phase = names.index(HALF_ANGLE), names.index(PHASE)
    sign = np.ones(value.size)
    out = value.copy()
    if out[half] < 0:
        sign[half] = -1.0
        out[half], out[phase] = -out[half], out[phase] + math.pi
    out[phase] = math.remainder(out[phase], 2.0 * math.pi)
    return out, covariance * np.outer(sign, sign)


def _scatter(model: RollModel) -> dict[str, Scatter]:
    """Root mean square residuals of single samples, by channel."""
    out, noise = {}, model.noise
    for i, axis in enumerate("xyz"):
        squares, dof = model.left()[axis]
        size = float(noise.gyro[i]) / math.sqrt(model.interval)
        out[f"gyro {axis}"] = Scatter(rms=size * math.sqrt(squares / max(dof, 1)), unit="rad/s", count=dof)
    squares, dof = model.left()["encoder"]
    q = float(noise.gyro[0]) ** 2 * model.interval
    size = noise.encoder + (q + math.sqrt(q * q + 4.0 * q * noise.encoder)) / 2.0
    out["encoder"] = Scatter(rms=math.sqrt(size * squares / max(dof, 1)), unit="rad", count=dof)
    return out
