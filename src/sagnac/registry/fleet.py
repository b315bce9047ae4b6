"""How the units of a model drift: the distribution over the units, and which are nearest to their limits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from .. import results
from .._version import __version__
from ..errors import DataError
from ..frames import Array
from ..limits import Limit
from ..results import Record, Software
from .drift import in_threads, pooled
from .entries import History, Parameter, Unit
from .probability import chi_square_above
from .series import Series, taken_apart, tells_drift
from .trend import Fitted, bounds_of, fit, known, leaving_of, moment_of
from .trend_records import Bounds, Known, Leaving

SCHEMA = "sagnac/fleet-trend/1"
SCHEMA_FILE = Path(__file__).with_name("fleet-trend-1.schema.json")


class UnitTrend(Record):
    """One parameter of one unit, in the unit of measurement of its :class:`FleetParameter`."""

    model: str
    serial: str
    calibrations: int
    last: str
    level: Known
    drift: Known
    limits: Bounds | None
    leaving: Leaving | None


class FleetParameter(Record):
    """One parameter over the units of a model.

    ``mean`` and ``spread`` are those of the drift [unit/s] over units of which these are a sample: the spread is what the drifts
    differ by beyond their own uncertainties (Paule and Mandel 1982), zero where these explain it, and within ``spread_lower`` and
    ``spread_upper`` with 95 % probability. None for fewer than two units. ``units`` begins with the one that is nearest to its
    limits.
    """

    model: str
    name: str
    unit: str
    misalignment: str = ""
    frame: str = ""
    mean: float | None
    mean_standard_uncertainty: float | None
    spread: float | None
    spread_lower: float | None
    spread_upper: float | None
    median: float
    units: tuple[UnitTrend, ...]
    untold: int
    """Units with too few calibrations to tell a drift."""


class FleetTrend(Record):
    """The trend of the units of a model."""

    schema_id: Literal["sagnac/fleet-trend/1"] = Field(default="sagnac/fleet-trend/1", alias="schema")
    model: str
    since: str | None
    units: int
    calibrations: int
    parameters: tuple[FleetParameter, ...]
    untold: tuple[str, ...]
    """Parameters of which no unit has enough calibrations."""
    software: Software
    created: str

    def to_json(self) -> str:
        """The file's text."""
        return results.to_json(self)

    def summary(self, most: int = 10) -> str:
        """The fleet as a page of text, with so many units of those nearest to their limits."""
        from .told import model_text

        return model_text(self, most)


class Consensus(NamedTuple):
    """Mean and spread of a quantity over units, see :func:`consensus`; None for fewer than two."""

    mean: float | None
    mean_standard_uncertainty: float | None
    spread: float | None
    spread_lower: float | None
    spread_upper: float | None


_Key = tuple[str, str, str, str, str]
"""Of units that are alike: model; name, unit and convention of a parameter; frame."""
LimitOf = Callable[[Unit, Parameter], Limit | None]
"""The limit of a parameter of a unit."""


def fleet(
    history: History,
    *,
    model: str = "",
    limit_of: LimitOf | None = None,
    since: datetime | None = None,
    frames: History | None = None,
) -> FleetTrend:
    """Drifts of many units.

    Parameters
    ----------
    history : History
        Of the units, see :meth:`sagnac.registry.Registry.history`.
    model : str
        What they are, for the head.
    limit_of : callable, optional
        Limit of a parameter of a unit, None where it has none.
    since : datetime, optional
        Earlier calibrations are left out.
    frames : History, optional
        With all misalignments of the units, where `history` has only some (:func:`sagnac.registry.series.taken_apart`).

    Returns
    -------
    FleetTrend

    Raises
    ------
    DataError
        When there is no calibration.
    """
    every = taken_apart(history, None if since is None else since.timestamp(), frames)
    if not every:
        raise DataError(f"there is no calibration of {model or 'these units'} to make a trend of")
    told = [s for s in every if tells_drift(s)]
    limits = [limit_of(history.units[s.item], s.parameter) if limit_of else None for s in told]
    fitted = fit(told, limits)
    rows: dict[_Key, list[int]] = {}
    for i, s in enumerate(told):
        rows.setdefault(_key(s, history), []).append(i)
    short = Counter(_key(s, history) for s in every if not tells_drift(s))
    parameters = [] if fitted is None else _parameters(rows, fitted, history, limits, short)
    return FleetTrend(
        schema="sagnac/fleet-trend/1",
        model=model,
        since=None if since is None else since.astimezone(UTC).isoformat(),
        units=len({s.item for s in every}),
        calibrations=len(np.unique(np.concatenate([s.calibration for s in every]))),
        parameters=tuple(parameters),
        untold=tuple(sorted({key[1] for key in short} - {key[1] for key in rows})),
        software=Software(version=__version__),
        created=results.now(),
    )


def _key(s: Series, history: History) -> _Key:
    return history.units[s.item].model, s.parameter.name, s.parameter.unit, s.parameter.misalignment, s.frame


def _parameters(
    rows: dict[_Key, list[int]], fitted: Fitted, history: History, limits: list[Limit | None], short: Mapping[_Key, int]
) -> list[FleetParameter]:
    def several(own: list[int]) -> Consensus:
        if len(own) < 2:
            return Consensus(None, None, None, None, None)
        return consensus(*pooled(fitted.histories.rows(own), compiled=fitted.histories.many))

    keys = sorted(rows)
    every = in_threads(several, [rows[key] for key in keys])
    return [
        _parameter(key, rows[key], own, fitted, history, limits, short[key])
        for key, own in zip(keys, every, strict=True)
    ]


def _parameter(
    key: _Key,
    own: list[int],
    several: Consensus,
    fitted: Fitted,
    history: History,
    limits: list[Limit | None],
    short: int,
) -> FleetParameter:
    drifts = [known(fitted.drift[:, i]) for i in own]
    units = [
        _unit(fitted.series[i], i, drift, fitted, history, limits[i]) for i, drift in zip(own, drifts, strict=True)
    ]
    model, name, measure, misalignment, frame = key
    return FleetParameter(
        model=model,
        name=name,
        unit=measure,
        misalignment=misalignment,
        frame=frame,
        **several._asdict(),
        median=float(np.median(fitted.drift[1, own])),
        units=tuple(u for _, u in sorted(units, key=lambda pair: pair[0])),
        untold=short,
    )


def _unit(
    s: Series, row: int, drift: Known, fitted: Fitted, history: History, limit: Limit | None
) -> tuple[tuple[float, ...], UnitTrend]:
    """One unit and its place among the others: soonest departure first, then the earliest possible, then the least margin."""
    unit, level = history.units[s.item], known(fitted.level[:, row])
    place: tuple[float, ...] = (math.inf, math.inf, math.inf, math.inf)
    if limit is not None:
        p = fitted.passage
        margin = min(limit.upper - level.value, level.value - limit.lower)
        place = (float(p.within[1, row]), -float(p.outside[row]), float(p.within[0, row]), margin)
    return place, UnitTrend(
        model=unit.model,
        serial=unit.serial,
        calibrations=s.time.size,
        last=moment_of(float(s.time[-1])),
        level=level,
        drift=drift,
        limits=None if limit is None else bounds_of(limit),
        leaving=None if limit is None else leaving_of(fitted, row),
    )


def consensus(values: Array, sigmas: Array) -> Consensus:
    """Mean of quantities that differ among themselves, with its standard uncertainty, and how much they differ.

    The spread is that for which the weighted squares about the mean have their expectation, n - 1 (R. C. Paule, J. Mandel,
    Consensus values and weighting factors, J. Res. NBS 87 (1982) 377-385), and its bounds are those for which they are as large
    as they are once in forty times, and as small (W. Viechtbauer, Confidence intervals for the amount of heterogeneity in
    meta-analysis, Statistics in Medicine 26 (2007) 37-52).

    Parameters
    ----------
    values, sigmas : ndarray, shape (n,)
        Two or more.
    """
    n = values.size
    scale = max(float(np.ptp(values)), float(np.max(sigmas)))
    if scale == 0:
        return Consensus(float(values[0]), 0.0, 0.0, 0.0, 0.0)

    def weights(spread: float) -> tuple[Array, float]:
        weight = 1.0 / np.maximum((sigmas / scale) ** 2 + spread**2, 1e-24)
        return weight, float(np.sum(weight * values) / np.sum(weight))

    def squares(spread: float) -> float:
        weight, mean = weights(spread)
        return float(np.sum(weight * ((values - mean) / scale) ** 2))

    def likely(p: float) -> Callable[[float], bool]:
        return lambda spread: chi_square_above(squares(spread), n - 1) >= p

    spread = _first_where(lambda spread: squares(spread) <= n - 1)
    lower, upper = _first_where(likely(0.025)), _first_where(likely(0.975))
    weight, mean = weights(spread)
    sigma = scale / math.sqrt(np.sum(weight))
    return Consensus(mean, sigma, scale * spread, scale * lower, scale * upper)


def _first_where(true: Callable[[float], bool]) -> float:
    """The least number, zero or more, from which on something is true."""
    low, high = 0.0, 1.0
    if true(low):
        return low
    while not true(high) and high < 1e6:
        low, high = high, 2 * high
    for _ in range(45):
        middle = (low + high) / 2
        low, high = (low, middle) if true(middle) else (middle, high)
    return high


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above; published as :data:`SCHEMA_FILE`."""
    return results.json_schema(FleetTrend, SCHEMA)
