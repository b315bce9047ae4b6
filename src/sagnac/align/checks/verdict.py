"""After the filter: whether the innovations are as its covariance says, and what the data did not show.

When the model is true the innovations, normalised by their covariance and squared, are chi-square and independent from update to
update. Where they are far from that the uncertainties are not true, and the result is refused with the likeliest cause.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...frames import Array
from ...printed import printed
from ..result import Innovations, NotObserved

if TYPE_CHECKING:
    from ..config import Config
    from ..history import Run

_REFUSED = 4.0  # innovations of twice their size
_PART_REFUSED = 9.0  # three times their size, in a tenth of the time
_SHUT_OUT = 0.2  # share of the updates that the gate may refuse
_MILD = 0.1  # deviation of the mean that is worth a word
_FOLLOWS = 0.3  # correlation of neighbouring innovations that noise does not have
_UNLIKELY = 4.0, 5.0  # times its spread that an estimate is worth a word, and is refused
_NO_PRIOR = ("velocity_error", "attitude_error", "position_error", "wander_error", "height_error", "flexure")
_SEEN = 0.9  # share of its uncertainty that an observed state has lost at least a tenth of


def judge(run: Run, config: Config, doubts: Sequence[str] = ()) -> tuple[Innovations, list[str]]:
    """Innovations in numbers, and what is to be said of them.

    Parameters
    ----------
    run : Run
    config : Config
    doubts : sequence of str
        What did not fit before the filter: told when it has trouble.

    Returns
    -------
    Innovations
    list of str
        Remarks.

    Raises
    ------
    DataError
        When the innovations are far larger than their covariance says, all along or from some time on.
    """
    from scipy.stats import chi2

    there = np.isfinite(run.nis)
    kept = there & run.used
    count, rows = int(kept.sum()), len(run.innovation_names)
    rejected = int(there.sum()) - count
    if rejected > _SHUT_OUT * there.sum():
        raise DataError(_shut_out(run, there, doubts))
    mean = float(run.nis[kept].mean())
    band = np.asarray(chi2.ppf([0.0005, 0.9995], count * rows)) / count
    ratios = run.innovations[kept] / run.innovation_sigmas[kept]
    record = Innovations(
        updates=int(there.sum()),
        rejected=rejected,
        mean=mean,
        expected=float(rows),
        band=(float(band[0]), float(band[1])),
        ratio={n: float(np.sqrt((ratios[:, i] ** 2).mean())) for i, n in enumerate(run.innovation_names)},
    )
    _refuse_wild(run, config, kept, mean / rows, ratios, doubts)
    return record, _remarks(record, run, config, there)


def _shut_out(run: Run, there: NDArray[np.bool_], doubts: Sequence[str]) -> str:
    """Why a filter that takes in too little is not trusted."""
    out = there & ~run.used
    first = float(run.time[np.flatnonzero(out)[0]])
    late = run.time > first
    lost = float((out & late).sum()) > 0.9 * float((there & late).sum())
    when = f"none of them from {first:.6g} s on" if lost else f"the first at {first:.6g} s"
    begin, end = float(run.time[0]), float(run.time[-1])
    if lost and first - begin < 0.1 * (end - begin):
        cause = "the two part at once: the uncertainties in [initial] or [noise] are too small, or the mounting is a large one"
    elif lost:
        cause = "the master or the slave jumped at that time, or the slave turned more than its gyros can follow"
    else:
        cause = "noise, lever arm, lateness or initial uncertainties are not those of the configuration"
    return _with(
        f"the gate shut out {int(out.sum())} of {int(there.sum())} samples of the master ({when}): {cause}", doubts
    )


def _with(text: str, doubts: Sequence[str]) -> str:
    return "; ".join([text, *doubts])


def _refuse_wild(
    run: Run, config: Config, kept: NDArray[np.bool_], ratio: float, ratios: Array, doubts: Sequence[str]
) -> None:
    """Raise when the innovations are far larger than they should be, with the likeliest cause."""
    tenths = [part for part in np.array_split(np.flatnonzero(kept), 10) if part.size >= 20]
    rows = len(run.innovation_names)
    means = [float(run.nis[part].mean()) / rows for part in tenths]
    worst = int(np.argmax(means)) if means else 0
    part_refused = bool(means) and means[worst] > _PART_REFUSED
    if ratio <= _REFUSED and not part_refused:
        return
    size = math.sqrt(means[worst] if part_refused and ratio <= _REFUSED else ratio)
    when = f" from {run.time[tenths[worst][0]]:.6g} to {run.time[tenths[worst][-1]]:.6g} s" if ratio <= _REFUSED else ""
    text = f"the innovations are {size:.2g} times as large as their uncertainty{when}: the result would not be true"
    raise DataError(_with(f"{text}. {_cause(config, ratios, size, ratio <= _REFUSED)}", doubts))


def _cause(config: Config, ratios: Array, size: float, partly: bool) -> str:
    """The likeliest cause of innovations that are too large."""
    if partly:
        return "something happened in that time: the master was reset, or the mounting moved"
    clipped = np.clip(ratios / max(size, 1.0), -5.0, 5.0)
    along = float((clipped[1:] * clipped[:-1]).sum() / (clipped**2).sum())
    if along < _FOLLOWS:
        return (
            f"They are as uneven as noise is: the master's velocity is noisier than stated; noise.velocity = "
            f'"{config.noise.velocity * size:.2g} m/s" would fit'
        )
    missing = [
        words
        for words, there in (
            (
                "a lever arm (lever_arm, or initial.lever_arm to have it estimated)",
                any(config.lever_arm) or config.initial.lever_arm,
            ),
            ("a master that is late (latency, or initial.delay)", config.latency or config.initial.delay),
            ("bending (flexure)", config.flexure),
        )
        if not there
    ]
    return f"They follow one another (correlation {along:.2f}), as a model does that lacks something: " + ", ".join(
        [*missing, "larger values in [initial]", "more noise of the gyros and accelerometers"]
    )


def _remarks(record: Innovations, run: Run, config: Config, there: NDArray[np.bool_]) -> list[str]:
    ratio = record.mean / record.expected
    out = []
    inside = record.band[0] <= record.mean <= record.band[1]
    if not inside and abs(ratio - 1.0) > _MILD:
        size = math.sqrt(ratio)
        word, sure = ("larger", "optimistic") if ratio > 1 else ("smaller", "pessimistic")
        out.append(
            f"the innovations are {word} than stated ({size:.2f} of their uncertainty): the uncertainties of the result are "
            f'{sure}; noise.velocity = "{config.noise.velocity * size:.2g} m/s" would fit better'
        )
    usual = record.updates * (1.0 - config.gate)
    if config.gate and record.rejected > usual + 4.0 * math.sqrt(usual) + 2.0:
        times = run.time[there & ~run.used]
        shown = ", ".join(f"{t:.6g} s" for t in times[:5]) + (", ..." if times.size > 5 else "")
        out.append(f"the gate shut out {record.rejected} samples of the master: {shown}")
    return out


def beyond_prior(run: Run, config: Config) -> list[str]:
    """Remarks on estimates that are hardly likely under what ``[initial]`` says.

    The filter expects an estimate to be off its first value by ``sqrt(sigma_0^2 - sigma^2)``.

    Raises
    ------
    DataError
        When one is off by more than five times that.
    """
    out = []
    first = dict(zip(("lever_arm.x", "lever_arm.y", "lever_arm.z"), config.lever_arm, strict=True))
    for i, (name, ratio) in enumerate(zip(run.names, run.observability.ratio, strict=True)):
        if name.startswith(_NO_PRIOR) or not ratio > 0:
            continue
        final = float(run.sigmas[-1, i])
        spread = final / ratio * math.sqrt(max(1.0 - ratio**2, 0.01))
        z = abs(float(run.values[-1, i]) - first.get(name, 0.0)) / spread
        if z < _UNLIKELY[0]:
            continue
        key = {"misalignment": "misalignment", "gyro": "gyro_bias", "accel": "accel_bias"}.get(name.partition(".")[0])
        shown, _, unit = printed(float(run.values[-1, i]), final, run.units[i])
        text = (
            f"{name} came out as {shown} {unit}, {z:.2g} times what initial.{key or name.partition('.')[0]} lets expect: "
            "a larger value there, if the unit is like that; otherwise something in the logs is wrong"
        )
        if z > _UNLIKELY[1]:
            raise DataError(text)
        out.append(text)
    return out


# what hides a state, and what shows it
_HIDDEN = {
    "misalignment.x": ("level", "turn"),
    "misalignment.y": ("level", "turn"),
    "misalignment.z": ("azimuth", "swerve"),
    "accel.bias": ("level", "turn"),
    "gyro.bias": ("drift", "longer"),
    "lever_arm.z": ("lever", "rock"),
    "lever_arm": ("lever", "swerve"),
    "delay": ("delay", "swerve"),
    "flexure": ("flexure", "rock"),
}
_REASONS = {
    "level": "a level error and an accelerometer bias do the same to the velocity as long as the heading stays",
    "azimuth": "the azimuth shows where the vehicle accelerates, and otherwise only slowly through the Earth's rate",
    "drift": "the angle that it grows to in this time is small against what the velocity shows, and what a level gyro drifts by "
    "looks like an azimuth",
    "lever": "a lever arm shows only where the vehicle turns across it",
    "delay": "a delay shows only where the velocity changes",
    "flexure": "bending shows only where the specific force or the attitude tells it from the mounting",
}
_SHOWN = {
    "turn": "a turn of 90 deg or more would show it",
    "swerve": "an S-turn or a change of speed would show it",
    "longer": "a longer alignment with turns would show it",
    "rock": "rolling and pitching, or attitude matching, would show it",
}


def not_observed(run: Run, parameters: Sequence[str]) -> list[NotObserved]:
    """Parameters of which less than a tenth of the initial uncertainty is gone.

    Parameters
    ----------
    run : Run
    parameters : sequence of str
        Their names.
    """
    out = []
    for name, ratio in zip(run.observability.names, run.observability.ratio, strict=True):
        if name not in parameters or not ratio > _SEEN:
            continue
        key = next((k for k in (name, name.rpartition(".")[0]) if k in _HIDDEN), "flexure")
        reason, shown = _HIDDEN[key]
        out.append(NotObserved(name=name, remains=float(ratio), reason=_REASONS[reason], shown_by=_SHOWN[shown]))
    return out


def not_separated(run: Run, parameters: Sequence[str], unseen: Sequence[NotObserved]) -> tuple[str, ...]:
    """Combinations of parameters that the data say less of than was known before; those not observed one by one are left out.

    Parameters
    ----------
    run : Run
    parameters : sequence of str
        Their names.
    unseen : sequence of NotObserved
    """
    alone = {n.name for n in unseen}
    out = []
    for words in run.observability.unseen():
        names = {part for part in words.split() if part in parameters}
        if len(names) > 1 and not names <= alone:
            out.append(words)
    return tuple(out)
