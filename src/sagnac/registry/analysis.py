"""Questions to a registry that its analyses answer: the trend of a unit, and that of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np

from ..errors import DataError, InputError
from ..limits import meets
from .bounds import finder
from .entries import Bound, History, Parameter, Unit
from .series import STEP, of_the_unit

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from .fleet import FleetTrend
    from .store import Registry
    from .trend_records import Trend

_MISALIGNMENTS = "*.misalignment.*"


def unit_trend(
    registry: Registry,
    unit: Unit,
    names: Sequence[str] | None = None,
    *,
    at: datetime | None = None,
    since: datetime | None = None,
    without: Sequence[int] = (),
    k: float = STEP,
) -> Trend:
    """The trend of a unit against the limits in force for it, see :func:`sagnac.registry.trend.trend`.

    Parameters
    ----------
    registry : Registry
    unit : Unit
    names : sequence of str, optional
        Parameters or patterns; left out: all of the unit, none of the rig.
    at, since : datetime, optional
        Date to predict for; time from which calibrations count.
    without : sequence of int
        Numbers of calibrations that do not count.
    k : float
        Joint standard uncertainties of a step.

    Raises
    ------
    InputError
        When one that is not to count is none of the unit.
    DataError
        When there is no calibration, or none with one of the parameters.
    """
    from .trend import Made, trend

    history, frames = _asked(registry, unit, None, names, since, without)
    for name in names or ():
        if not any(meets(name, p.name) for p in history.parameters):
            has = ", ".join(dict.fromkeys(p.name for p in registry.history(unit).parameters))
            after = "" if since is None else f" since {since.date().isoformat()}"
            raise DataError(f"no calibration of {unit}{after} has a parameter {name!r}; they have {has}")
    limit_of = _limits(registry, None, unit)
    made = {e.id: Made(e.method, e.recordings) for e in registry.entries(unit)}
    return trend(history, limit_of=lambda p: limit_of(unit, p), at=at, since=since, made=made, frames=frames, k=k)


def fleet_trend(
    registry: Registry,
    model: str | None = None,
    names: Sequence[str] | None = None,
    *,
    since: datetime | None = None,
    without: Sequence[int] = (),
) -> FleetTrend:
    """The trend of all units, or those of a model, against their limits, see :func:`sagnac.registry.fleet.fleet`.

    Parameters
    ----------
    registry : Registry
    model : str, optional
    names : sequence of str, optional
        Parameters or patterns; left out: all of the units, none of the rig.
    since : datetime, optional
        Time from which calibrations count.
    without : sequence of int
        Numbers of calibrations that do not count.

    Raises
    ------
    InputError
        When one that is not to count is none of these units.
    DataError
        When there is no calibration.
    """
    from .fleet import fleet

    history, frames = _asked(registry, None, model, names, since, without)
    return fleet(history, model=model or "all units", limit_of=_limits(registry, model), since=since, frames=frames)


def _asked(
    registry: Registry,
    unit: Unit | None,
    model: str | None,
    names: Sequence[str] | None,
    since: datetime | None,
    without: Sequence[int],
) -> tuple[History, History | None]:
    """The history that was asked for, and that of all misalignments where only some were."""
    history, frames = registry.history(unit, names, model=model, since=since), None
    if names is None:
        own = np.array([of_the_unit(p.name) for p in history.parameters], dtype=bool)
        history = _kept(history, own[history.parameter])
    elif any(meets(_MISALIGNMENTS, p.name) for p in history.parameters):
        frames = registry.history(unit, [_MISALIGNMENTS], model=model, since=since)
    if without:
        strange = np.setdiff1d(np.array(without), history.calibration)
        if strange.size:
            whose = unit or model or "these units"
            raise InputError(f"--without: id:{strange[0]} is no calibration of {whose} that would count")
        history = _kept(history, ~np.isin(history.calibration, np.array(without)))
    return history, frames


def _kept(history: History, kept: NDArray[np.bool_]) -> History:
    columns = ("item", "time", "calibration", "parameter", "value", "standard_uncertainty")
    return replace(history, **{c: getattr(history, c)[kept] for c in columns})


def _limits(
    registry: Registry, model: str | None = None, unit: Unit | None = None
) -> Callable[[Unit, Parameter], Bound | None]:
    """Limits in force, by unit and parameter."""
    return finder(registry.limits(unit, model=model))
