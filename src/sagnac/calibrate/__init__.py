"""One module a method; each turns means (or a log) and a plan into a :class:`sagnac.calibration.Calibration`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import DataError, InputError

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from ..calibration import Calibration
    from ..plan import Plan
    from ..recording import Recording

RIGS = {
    "four-position": "turntable",
    "multi-position": "turntable",
    "norm": "turntable",
    "table": "turntable",
    "centrifuge": "centrifuge",
    "roll-isolated": "roll-isolated",
}
"""Which rig each method is for."""
METHODS = tuple(RIGS)


def calibrate(
    method: str,
    recording: Recording,
    plan: Plan | None = None,
    *,
    matrix: str = "full",
    robust: bool = False,
    threshold: float | None = None,
    closed_form: bool = False,
    prior: Calibration | None = None,
    terms: Sequence[str] | None = None,
    sensors: Collection[str] | None = None,
) -> Calibration:
    """Calibrate a unit from a recording.

    Parameters
    ----------
    method : str
        One of :data:`METHODS`. ``norm`` without segments in the plan (or without plan) is for a unit turned by hand.
    recording : Recording
    plan : Plan, optional
        What was done with the unit.
    matrix : str
        ``full`` or ``triangular``, for multi-position.
    robust : bool
        Turn down segments that disagree with the rest.
    threshold : float, optional
        For the static intervals of a hand-turned unit, see :func:`sagnac.observe.static.static_intervals`.
    closed_form : bool
        Centrifuge: the published equations instead of the fit.
    prior : Calibration, optional
        Centrifuge: what is known of the unit beforehand.
    terms : sequence of str, optional
        Centrifuge: which terms to estimate, ``accel.k2``, ``gyro.d_i``, ...; otherwise all that the method knows but Kio and Kpo.
    sensors : collection of str, optional
        Centrifuge: only these sensors or columns, ``accel``, ``gyro_x``, ...

    Returns
    -------
    Calibration

    Raises
    ------
    DataError
        When the data do not support the result.
    InputError
        When the recording or the plan cannot be used for this method.
    """
    if method not in METHODS:
        raise InputError(f"there is no method {method!r}; choose from {', '.join(METHODS)}")
    if matrix not in ("full", "triangular"):
        raise InputError(f"matrix is 'full' or 'triangular', not {matrix!r}")
    _refuse_options(method, plan, closed_form, prior, bool(terms or sensors))
    if method == "norm" and (plan is None or not plan.segment):
        from ..observe.static import THRESHOLD
        from .hand_turned import calibrate as calibrate_hand_turned

        return calibrate_hand_turned(recording, plan, threshold=threshold or THRESHOLD, robust=robust)
    if plan is None:
        raise InputError(f"{method} needs a plan (--plan) that says which segment was in which position")
    if plan.rig.kind != RIGS[method]:
        raise InputError(f"{method} is for a {RIGS[method]} rig; the plan says rig.kind = {plan.rig.kind!r}")
    if prior is not None and prior.unit.serial and plan.unit.serial not in ("", prior.unit.serial):
        raise InputError(
            f"the prior calibration is of unit {prior.unit.serial!r}, the plan is for {plan.unit.serial!r}"
        )
    if method == "centrifuge":
        from . import centrifuge

        return centrifuge.calibrate_recording(
            recording, plan, robust=robust, closed_form=closed_form, prior=prior, terms=terms, sensors=sensors
        )
    if method == "roll-isolated":
        from . import roll_isolated

        return roll_isolated.calibrate_recording(recording, plan, robust=robust)
    return _on_table(method, recording, plan, matrix, robust)


def _refuse_options(method: str, plan: Plan | None, closed_form: bool, prior: Calibration | None, chosen: bool) -> None:
    """Refuse options that mean nothing for the method or together."""
    if method != "centrifuge" and (closed_form or prior is not None or chosen):
        raise InputError(f"closed_form, prior, terms and sensors are for centrifuge; {method} takes none of them")
    if prior is None:
        return
    if closed_form:
        raise InputError("the closed form takes no prior calibration; leave one of the two out")
    serial = plan.unit.serial if plan is not None else ""
    if prior.unit.serial and serial not in ("", prior.unit.serial):
        raise InputError(f"the prior calibration is of unit {prior.unit.serial!r}, the plan is for {serial!r}")


def _on_table(method: str, recording: Recording, plan: Plan, matrix: str, robust: bool) -> Calibration:
    """Methods that take the mean of each segment."""
    from ..observe.means import segment_means
    from . import four_position, multi_position, norm, table

    # norm takes next to nothing from the angles
    means = segment_means(recording, plan, rig="tell" if method == "norm" else "refuse")
    try:
        if method == "multi-position":
            return multi_position.calibrate_means(means, plan, matrix=matrix, recording=recording, robust=robust)
        if method == "four-position":
            return four_position.calibrate_means(means, plan, recording=recording, robust=robust)
        if method == "norm":
            return norm.calibrate_means(means, plan, recording=recording, robust=robust)
        return table.calibrate_means(means, plan, recording=recording, robust=robust)
    except DataError as error:
        if means.remarks:
            raise DataError(f"{error}\nNoted before: {'; '.join(means.remarks[:5])}") from error
        raise
