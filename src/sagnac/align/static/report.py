"""What a static alignment found, as the record that is written: attitude, uncertainty, and what could not be told apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..._version import __version__
from ...earth import STANDARD_GRAVITY
from ...files import sha256
from ...frames import Array, heading_pitch_roll, rotation_matrix
from ...recording import Recording
from ...results import Software, Source, covariance_rows, now
from ..result import Alignment, Moment, NotObserved, Observed, Value, columns_of, values_of
from . import checks
from .coarse import gyrocompass, inertial
from .fit import Data, Place, Solution, settled, stated
from .model import Blocks
from .noise import Noise

_REMAINS = 0.9
"""A bias of whose uncertainty more than this is left was not observed."""
_FEWEST = 50  # blocks that say something of heading
_SEEN = 1e-5  # m: less sway is none
_COURSE = (0.1, 0.2, 0.4, 0.7, 1.0)
_NAMES = (
    *(f"attitude_error.{a}" for a in "xyz"),
    *(f"velocity_error.{a}" for a in "xyz"),
    *(f"gyro.bias.{a}" for a in "xyz"),
    *(f"accel.bias.{a}" for a in "xyz"),
)
_UNITS = ("rad",) * 3 + ("m/s",) * 3 + ("rad/s",) * 3 + ("m/s^2",) * 3


def _angle_covariance(C_b_n: Array, covariance: Array) -> tuple[Array, Array]:
    """Heading, pitch and roll (3,) and their standard uncertainties, from the covariance of phi (3, 3)."""
    h = 1e-6
    sides = [np.array(heading_pitch_roll(rotation_matrix(s * h * np.eye(3)) @ C_b_n)) for s in (1.0, -1.0)]
    J = (sides[0] - sides[1] + math.pi) % (2.0 * math.pi) - math.pi
    J /= 2.0 * h
    return np.array(heading_pitch_roll(C_b_n)), np.sqrt(np.diag(J @ covariance @ J.T))


def of_means(
    recording: Recording, blocks: Blocks, place: Place, eps: Array, nab: Array, remarks: Sequence[str]
) -> Alignment:
    """The coarse alignment alone: biases, and the scatter of the blocks as that of means."""
    count = blocks.end.size
    scatter = [np.sqrt(v.var(axis=0)) for v in (blocks.body_force, blocks.body_rate)]
    found = gyrocompass(
        blocks.body_force.mean(axis=0),
        blocks.body_rate.mean(axis=0),
        place.latitude,
        accel_sigma=np.hypot(nab, scatter[0]),  # the attitude at the end is off its mean by the sway
        gyro_sigma=np.hypot(eps, scatter[1] / math.sqrt(count)),
        earth_rate=place.earth_rate,
    )
    angles, sigmas = _angle_covariance(found.C_b_n, found.covariance)
    sway = np.degrees(np.linalg.norm(scatter[1]) / math.sqrt(count)) * 3600.0
    advice = (
        f"Over this time the mean rate is only known to {sway:.3g} deg/h, since the unit sways: use the method fine, "
        f"or more time at rest"
    )
    checks.refuse_no_heading(float(sigmas[0]), eps, advice, recording.name)
    return Alignment(
        kind="static",
        method="gyrocompass",
        time=_end(blocks),
        parameters=values_of(_NAMES[:3], _UNITS[:3], np.zeros(3), np.sqrt(np.diag(found.covariance))),
        covariance=covariance_rows(found.covariance),
        attitude=values_of(("heading", "pitch", "roll"), ("rad",) * 3, angles, sigmas),
        place=_place(place, np.zeros(3), np.zeros(3)),
        remarks=tuple(remarks),
        source=_source(recording, blocks),
        columns=columns_of(recording),
        software=Software(version=__version__),
        created=now(),
    )


def of_fit(
    recording: Recording, blocks: Blocks, place: Place, found: Solution, prior: Array, remarks: Sequence[str]
) -> Alignment:
    """The maximum-likelihood alignment; `prior` is what the biases may be, shape (6,)."""
    sigmas = np.sqrt(np.diag(found.covariance))
    angles, angle_sigmas = _angle_covariance(found.C_b_n, found.covariance[:3, :3])
    checks.refuse_no_heading(
        float(angle_sigmas[0]), prior[:3], "Take more time, or gyros that see the Earth turn", recording.name
    )
    values = np.concatenate([np.zeros(6), found.eps, found.nab])
    observed = tuple(
        Observed(name=n, unit=u, initial=float(p), final=float(s))
        for n, u, p, s in zip(_NAMES[6:], _UNITS[6:], prior, sigmas[6:], strict=True)
    )
    return Alignment(
        kind="static",
        method="maximum likelihood",
        time=_end(blocks),
        parameters=values_of(_NAMES, _UNITS, values, sigmas),
        covariance=covariance_rows(found.covariance),
        attitude=values_of(("heading", "pitch", "roll"), ("rad",) * 3, angles, angle_sigmas),
        place=_place(place, found.velocity, sigmas[3:6]),
        observed=observed,
        not_observed=_not_observed(observed, found.C_b_n),
        course=_course(blocks, place, found, prior),
        remarks=(*remarks, *_floor_remarks(found, place, sigmas)),
        source=_source(recording, blocks),
        columns=columns_of(recording),
        software=Software(version=__version__),
        created=now(),
    )


def _end(blocks: Blocks) -> float:
    """Time that the result belongs to, as the recording has it: sums of steps are rounded to the nanosecond."""
    return round(blocks.start + float(blocks.end[-1]), 9)


def _source(recording: Recording, blocks: Blocks) -> tuple[Source, ...]:
    digest = sha256(recording.path) if recording.path is not None else None
    which, chosen, stop = recording.format, recording.select, _end(blocks)
    return (Source(file=recording.name, format=which, select=chosen, sha256=digest, start=blocks.start, stop=stop),)


def _place(place: Place, velocity: Array, sigmas: Array) -> tuple[Value, ...]:
    given = (("latitude", place.latitude, "rad"), ("longitude", place.longitude, "rad"), ("height", place.height, "m"))
    at = [Value(name=n, value=v, unit=u, standard_uncertainty=0.0) for n, v, u in given]
    return (*at, *values_of(("v_east", "v_north", "v_up"), ("m/s",) * 3, velocity, sigmas))


def _not_observed(observed: Sequence[Observed], C_b_n: Array) -> tuple[NotObserved, ...]:
    """Biases that the samples say next to nothing of, by where their axis points."""
    out = []
    for i, o in enumerate(observed):
        if o.final <= _REMAINS * o.initial:
            continue
        gyro, axis = i < 3, i % 3
        upright = abs(C_b_n[2, axis]) > math.sqrt(0.5)
        if gyro and upright:
            reason, shown = (
                "a bias about the vertical takes hours to show at rest",
                "a longer time, or turns of the unit",
            )
        else:
            looks = "heading" if gyro else "level"
            reason = f"at rest a horizontal bias {'along east ' * gyro}looks like an error of the {looks}"
            shown = "the unit turned half round on its place in the middle of the alignment would show it"
        out.append(NotObserved(name=o.name, remains=min(1.0, o.final / o.initial), reason=reason, shown_by=shown))
    return tuple(out)


def _course(blocks: Blocks, place: Place, found: Solution, prior: Array) -> tuple[Moment, ...]:
    """Uncertainties that shorter times would give."""
    out = []
    for share in _COURSE:
        part = blocks.head(round(share * blocks.end.size))
        if part.end.size < _FEWEST:
            continue
        C = inertial(part, place.latitude, earth_rate=place.earth_rate)
        sigmas = np.sqrt(
            np.diag(settled(Data.of(part, place), C, found.noise, stated(prior[:3], prior[3:])).covariance)
        )
        out.append(Moment(after=float(part.end[-1]), standard_uncertainty=tuple(sigmas.tolist())))
    return tuple(out)


def opening(gyro_bias: bool, accel_bias: bool) -> list[str]:
    """Remarks on biases of which nothing was stated."""
    remarks = []
    for missing, words in (
        (gyro_bias, "gyro bias taken to be 0.01 deg/h"),
        (accel_bias, "accelerometer bias taken to be 50 ug"),
    ):
        if missing:
            remarks.append(f"{words} (one sigma), since nothing was stated")
    return remarks


def noise_remarks(n: Noise, gyro: bool, accel: bool) -> list[str]:
    """What of the noise was found in the samples."""
    words = [f"displacement of {n.walk * 1e3:.2g} mm/sqrt(s)"]
    words += [f"sway of {n.sway * 1e3:.2g} mm"] if n.sway > _SEEN else []
    words += [f"accelerometer noise of {n.accel / STANDARD_GRAVITY * 1e6:.3g} ug/sqrt(Hz)"] * accel
    words += [f"gyro noise of {math.degrees(n.gyro) * 60:.2g} deg/sqrt(h)"] * gyro
    return ["found in the samples: " + ", ".join(words)]


def _floor_remarks(found: Solution, place: Place, sigmas: Array) -> list[str]:
    """Where heading cannot get better at rest: what is left of the gyros' bias along east."""
    east = found.C_b_n[0]
    left = math.sqrt(float(east @ found.covariance[6:9, 6:9] @ east))
    floor = left / (place.earth_rate * math.cos(place.latitude))
    if floor < 0.5 * sigmas[2]:
        return []
    return [
        (
            f"of the heading's uncertainty {math.degrees(floor) * 60:.2f}' are the gyros' bias along east "
            f"(over the horizontal Earth rate); at rest no length of time makes that less"
        )
    ]
