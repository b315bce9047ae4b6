"""Each parameter of a unit over its calibrations: drift, scatter, what to expect at a date, and when it leaves its limits.

The model is that of :mod:`sagnac.registry.drift`. Calibrations count as independent of one another; what they share (the rig, the
gravity of the site, a prior) shifts all of them together and does not change a drift, but makes the stated uncertainties larger
than the scatter, which is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal

import numpy as np

from .. import results
from .._version import __version__
from ..frames import Array
from ..limits import Limit
from ..results import Software
from .dates import YEAR
from .drift import MODELS, Histories, Posterior, infer, quantiles
from .entries import History, Parameter
from .leaving import Passage, passage
from .probability import chi_square_above
from .series import STEP, Series, jumps, side_by_side, taken_apart, tells_drift
from .trend_records import Bounds, Expected, Known, Leaving, Moment, ParameterTrend, Scatter, Step, Trend

HORIZON = 20.0
"""Years after the last calibration beyond which no date is given."""
_95 = (0.025, 0.5, 0.975)
_NORMAL_95 = 1.959964
_TOO_GOOD = 0.999
"""Probability of a larger chi-square from which the stated uncertainties are larger than the scatter."""
_TOO_GOOD_WORDS = (
    "scatters far less than its stated uncertainties: the calibrations share an error (rig, site, prior), or the uncertainties "
    "are stated too large; the drift is then better known than it says"
)


@dataclass(frozen=True)
class Made:
    """How a calibration came about: the method, and the recordings that it was made from (SHA-256)."""

    method: str
    recordings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fitted:
    """What the histories that tell a drift have come to, rows in the order of `series`.

    Attributes
    ----------
    series : tuple of Series
    histories : Histories
    posterior : Posterior
    drift, level : ndarray, shape (3, s)
        Quantiles at 2.5 %, 50 % and 97.5 %.
    passage : Passage
    """

    series: tuple[Series, ...]
    histories: Histories
    posterior: Posterior
    drift: Array
    level: Array
    passage: Passage


def fit(series: Sequence[Series], limits: Sequence[Limit | None]) -> Fitted | None:
    """Drift, level and departure of the series that tell them.

    Parameters
    ----------
    series : sequence of Series
        Each with three calibrations or more.
    limits : sequence of Limit or None
        One a series.

    Returns
    -------
    Fitted or None
        None when there is none.
    """
    if not series:
        return None
    histories = side_by_side(series)
    posterior = infer(histories)
    everywhere = Limit(-np.inf, np.inf)
    bounds = np.array([[(b or everywhere).lower, (b or everywhere).upper] for b in limits])
    return Fitted(
        tuple(series),
        histories,
        posterior,
        quantiles(posterior.weight, posterior.drift, posterior.drift_sigma, _95),
        quantiles(posterior.weight, *posterior.at(posterior.last), _95),
        passage(posterior, bounds[:, 0], bounds[:, 1], HORIZON * YEAR),
    )


def trend(
    history: History,
    *,
    limit_of: Callable[[Parameter], Limit | None] | None = None,
    at: datetime | None = None,
    since: datetime | None = None,
    made: Mapping[int, Made] | None = None,
    frames: History | None = None,
    k: float = STEP,
) -> Trend:
    """The trend of one unit.

    Parameters
    ----------
    history : History
        Of one unit, see :meth:`sagnac.registry.Registry.history`.
    limit_of : callable, optional
        Limit of a parameter in its own unit of measurement, None where it has none.
    at : datetime, optional
        Date to predict for, not before the last calibration; a year after it if left out.
    since : datetime, optional
        Earlier calibrations are left out, as of a time before a repair.
    made : mapping of int to Made, optional
        How each calibration came about, by its number, so that what they share or differ in is named.
    frames : History, optional
        With all misalignments of the unit, where `history` has only some (:func:`sagnac.registry.series.taken_apart`).
    k : float
        Joint standard uncertainties from which a change between calibrations is named a step.

    Returns
    -------
    Trend

    Raises
    ------
    DataError
        When there is no calibration, or the date lies before the last one.
    """
    from ..errors import DataError

    if len(history.units) > 1:
        raise ValueError("a trend is that of one unit; the histories of several are for sagnac.registry.fleet")
    every = taken_apart(history, None if since is None else since.timestamp(), frames)
    if not every:
        raise DataError("there is no calibration" + (f" since {_day(since)}" if since else "") + " to make a trend of")
    last = max(s.time[-1] for s in every)
    end = last + YEAR if at is None else at.timestamp()
    if end < last:
        raise DataError(
            f"{_day(at)} lies before the last calibration of {moment_of(last)[:10]}: what was in force then is told by "
            "`sagnac registry find --at`"
        )
    told = [s for s in every if tells_drift(s)]
    limits = [limit_of(s.parameter) if limit_of else None for s in every]
    fitted = fit(told, [limit for s, limit in zip(every, limits, strict=True) if tells_drift(s)])
    row = {id(s): i for i, s in enumerate(told)}
    spread = _expected(fitted, end) if fitted else None
    unit, made = next(iter(history.units.values())), made or {}
    moments = _moments(every, made)
    return Trend(
        schema="sagnac/trend/1",
        model=unit.model,
        serial=unit.serial,
        at=moment_of(end),
        since=None if since is None else since.astimezone(UTC).isoformat(),
        calibrations=tuple(moments.values()),
        parameters=tuple(
            _parameter(s, limit, fitted, row.get(id(s)), spread, end, moments, k)
            for s, limit in zip(every, limits, strict=True)
        ),
        remarks=_common(list(moments), made),
        software=Software(version=__version__),
        created=results.now(),
    )


def _moments(every: Sequence[Series], made: Mapping[int, Made]) -> dict[int, Moment]:
    """The calibrations by number, in the order of their times."""
    times = {c: t for s in every for c, t in zip(s.calibration.tolist(), s.time.tolist(), strict=True)}
    return {
        c: Moment(id=c, created=moment_of(times[c]), method=made[c].method if c in made else "")
        for c in sorted(times, key=lambda c: (times[c], c))
    }


def _expected(fitted: Fitted, end: float) -> Array:
    posterior = fitted.posterior
    when = np.full(len(fitted.series), end)
    return quantiles(posterior.weight, *posterior.at(when, white=True), _95)


def _parameter(
    s: Series,
    limit: Limit | None,
    fitted: Fitted | None,
    row: int | None,
    spread: Array | None,
    end: float,
    moments: Mapping[int, Moment],
    k: float,
) -> ParameterTrend:
    numbers = s.calibration.tolist()
    steps = tuple(
        Step(
            before=moments[numbers[j.index - 1]],
            after=moments[numbers[j.index]],
            change=j.change,
            joint_standard_uncertainty=j.sigma,
        )
        for j in jumps(s, k)
    )
    found = ParameterTrend(
        name=s.parameter.name,
        unit=s.parameter.unit,
        misalignment=s.parameter.misalignment,
        frame=s.frame,
        calibrations=tuple(numbers),
        times=tuple(moments[c].created for c in numbers),
        values=tuple(s.value.tolist()),
        standard_uncertainties=tuple(s.sigma.tolist()),
        limits=None if limit is None else bounds_of(limit),
        steps=steps,
        remarks=tuple(f"left out: {words}, which is not comparable" for words in s.elsewhere),
    )
    if fitted is None or row is None or spread is None:
        return found.model_copy(update={"remarks": (*found.remarks, *_untold(s, limit))})
    scatter = scatter_of(fitted, row)
    expected = Expected(at=moment_of(end), **known(spread[:, row]).model_dump())
    return found.model_copy(
        update={
            "level": known(fitted.level[:, row]),
            "drift": known(fitted.drift[:, row]),
            "scatter": scatter,
            "expected": expected,
            "leaving": None if limit is None else leaving_of(fitted, row),
            "remarks": (*found.remarks, *_scatter_remarks(scatter)),
        }
    )


def known(three: Array) -> Known:
    """From the quantiles at 2.5 %, 50 % and 97.5 %."""
    low, middle, high = (float(v) for v in three)
    return Known(value=middle, standard_uncertainty=(high - low) / (2 * _NORMAL_95), lower=low, upper=high)


def bounds_of(limit: Limit) -> Bounds:
    """Limits for a record."""
    return Bounds(**limit.written())


def scatter_of(fitted: Fitted, row: int) -> Scatter:
    """What scatters in one history."""
    s, posterior = fitted.series[row], fitted.posterior
    best = posterior.best[row]
    dof, chi2 = s.time.size - 2, None
    if np.all(s.sigma > 0):
        weight = 1 / s.sigma
        time = (s.time - s.time[0]) / (s.time[-1] - s.time[0])
        middle = np.average(s.value, weights=weight**2)
        design = np.column_stack([weight, weight * time])
        line = np.linalg.lstsq(design, weight * (s.value - middle), rcond=None)[0]
        chi2 = float(np.sum((weight * (s.value - middle) - design @ line) ** 2))
    return Scatter(
        model=MODELS[int(posterior.model[row])],
        white=float(posterior.white[row, best]),
        walk=float(np.sqrt(posterior.walk[row, best])),
        chi2=chi2,
        degrees_of_freedom=dof,
        p_value=None if chi2 is None else chi_square_above(chi2, dof),
    )


def leaving_of(fitted: Fitted, row: int) -> Leaving:
    """When one history leaves its limits."""
    p, last = fitted.passage, float(fitted.posterior.last[row])
    earliest, middle, latest = (float(v) for v in p.within[:, row])

    def date(after: float) -> str | None:
        return moment_of(last + after) if np.isfinite(after) else None

    state: Literal["already outside", "leaves", "stays"] = "leaves" if np.isfinite(middle) else "stays"
    return Leaving(
        state="already outside" if middle == 0 else state,
        bound="upper" if p.upper[row] else "lower",
        probability_outside=float(p.outside[row]),
        date=date(middle),
        earliest=date(earliest),
        latest=date(latest),
        horizon_years=HORIZON,
    )


def _untold(s: Series, limit: Limit | None) -> list[str]:
    """What too short a history cannot tell."""
    n = s.time.size
    if n == 1:
        told = "one calibration: neither drift nor scatter nor a prediction can be told"
    elif s.time[-1] == s.time[0]:
        told = f"all {n} calibrations are of the same moment: no drift can be told"
    else:
        told = "two calibrations: a difference, and nothing left to judge the scatter by; drift and prediction need a third one"
    lines = [told]
    if limit is not None:
        inside = limit.lower <= s.value[-1] <= limit.upper
        lines.append(
            f"the last value lies {'inside' if inside else 'outside'} its limits; when it leaves them cannot be told"
        )
    return lines


def _scatter_remarks(scatter: Scatter) -> list[str]:
    if scatter.p_value is not None and scatter.p_value > _TOO_GOOD:
        return [_TOO_GOOD_WORDS]
    if scatter.chi2 is None:
        return ["stated as exact in one calibration or more: the scatter alone tells its uncertainty"]
    return []


def _common(listed: Sequence[int], made: Mapping[int, Made]) -> tuple[str, ...]:
    """What holds for all parameters."""
    own = {c: made[c] for c in listed if c in made}
    remarks = []
    used = list(dict.fromkeys(m.method for m in own.values()))
    if len(used) > 1:
        named = ", ".join(used)
        remarks.append(
            f"made by different methods ({named}): a step where the method changes may be no change of the unit"
        )
    of_recording: dict[str, list[int]] = {}
    for c, m in own.items():
        for recording in m.recordings:
            of_recording.setdefault(recording, []).append(c)
    for several in dict.fromkeys(tuple(numbers) for numbers in of_recording.values() if len(numbers) > 1):
        named = ", ".join(f"id:{c}" for c in several)
        remarks.append(
            f"{named} are evaluations of the same recording and count as {len(several)} independent calibrations all the same; "
            "leave out all but one with --without"
        )
    return tuple(remarks)


def moment_of(time: float) -> str:
    """POSIX time [s] as ISO 8601 in UTC."""
    return (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=time)).isoformat(timespec="seconds")


def _day(at: datetime | None) -> str:
    return "" if at is None else at.astimezone(UTC).date().isoformat()
