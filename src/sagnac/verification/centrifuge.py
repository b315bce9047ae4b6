"""Check a calibration on a centrifuge run that its fit has not seen.

The harmonics of the new recording are fitted with the calibration as prior knowledge, so that only the arm's unknown angle and
rate and the mounting are free. The chi-square of that fit is the one of the differences between recording and calibration, with
the covariance of the calibration, the noise of the recording and what the plan says of the rig in it.
"""

from __future__ import annotations

import numpy as np

from ..calibrate.centrifuge import solve_mounted
from ..calibrate.centrifuge.explain import refuse_other_reading
from ..calibrate.centrifuge.model import Group
from ..calibrate.centrifuge.prepare import harmonics_of, prepare
from ..calibrate.centrifuge.prior import Prior, prior_of
from ..calibrate.centrifuge.task import Fitted
from ..calibration import Calibration
from ..errors import DataError, InputError
from ..frames import Array
from ..observe.harmonics import SegmentHarmonics
from ..plan import Plan
from ..recording import Recording
from ..sensors import INPUT
from . import PASS, Check, Verification

_ORDERS = {"accel": 3, "gyro": 2}
"""Highest harmonic that a sensor shows."""
_WORDS = ("mean", "1x", "2x", "3x")


def verify(calibration: Calibration, recording: Recording, plan: Plan | None) -> Verification:
    """Compare a recording of a centrifuge with what a calibration says of it.

    Parameters
    ----------
    calibration : Calibration
        By centrifuge, or any other of the same unit.
    recording : Recording
    plan : Plan
        Of the recording.

    Returns
    -------
    Verification
        Checks are differences of means and amplitudes of the difference of harmonics, the latter without sign.

    Raises
    ------
    InputError
        When there is no plan, or it cannot be used.
    DataError
        When there is nothing to compare, or the plan contradicts the data.
    """
    if plan is None:
        raise InputError(
            "centrifuge needs a plan (--plan) that says how fast the arm turned and where the gimbals stood"
        )
    return verify_harmonics(calibration, harmonics_of(recording, plan), plan)


def verify_harmonics(calibration: Calibration, harmonics: SegmentHarmonics, plan: Plan) -> Verification:
    """:func:`verify` for harmonics that were found before.

    Parameters
    ----------
    calibration : Calibration
    harmonics : SegmentHarmonics
    plan : Plan
    """
    prior = prior_of(calibration, plan)
    columns = [
        c for c in harmonics.axes if any(n.startswith(f"{c[:-2]}.") and _axis_of(n) == c[-1] for n in prior.names)
    ]
    if not columns:
        raise DataError(
            f"the calibration says nothing about the sensors in the recording ({', '.join(harmonics.axes)})"
        )
    task, remarks = prepare(harmonics, plan, prior, (), columns)
    refuse_other_reading(task)
    fitted = solve_mounted(task, remarks)
    found = fitted.estimate
    checks = tuple(check for group in fitted.model.groups for check in _checks(fitted, group))
    return Verification(
        checks, found.chi2, found.degrees_of_freedom, found.p_value, found.p_value >= PASS, None, tuple(remarks)
    )


def _axis_of(name: str) -> str:
    """Axis of the sensor that a parameter belongs to."""
    return name.split(".")[2][0]


def _checks(fitted: Fitted, group: Group) -> list[Check]:
    """Differences of one group, with what the calibration, the noise and the stated uncertainties allow."""
    task, model = fitted.task, fitted.model
    prior = task.prior
    assert prior is not None
    x, known = _beforehand(fitted, prior)
    told = model.predicted(group, x, np.zeros((len(group.index), 3)))
    left = group.coefficient - told.value
    inverse = np.linalg.inv(group.weight)
    variance = np.einsum("nmij,nmij->nmi", inverse, inverse)
    variance += np.einsum("nmci,ij,nmcj->nmc", told.to_x, known, told.to_x)
    variance += task.setting_sigma**2 * np.sum(told.to_local**2, axis=-1)
    out = []
    for i, segment in enumerate(group.index):
        for j, sensor in enumerate(task.sensors):
            column, unit = sensor.sensor.replace(".", "_"), INPUT[sensor.kind]
            for h in range(min(group.order, _ORDERS[sensor.kind]) + 1):
                at = [0] if h == 0 else [2 * h - 1, 2 * h]
                size = float(left[i, j, 0]) if h == 0 else float(np.linalg.norm(left[i, j, at]))
                sigma = float(np.sqrt(variance[i, j, at].mean()))
                out.append(Check(task.names[segment], f"{column} {_WORDS[h]}", size, sigma, unit))
    return out


def _beforehand(fitted: Fitted, prior: Prior) -> tuple[Array, Array]:
    """Parameters as they were known before the recording, those that were not as it says, and the covariance of the former."""
    found, places = fitted.estimate, fitted.model.places
    x, known = found.value.copy(), np.zeros((len(found.value),) * 2)
    at = [places[n] for n in prior.names if n in places]
    own = [i for i, n in enumerate(prior.names) if n in places]
    x[at] = prior.mean[own]
    known[np.ix_(at, at)] = prior.covariance[np.ix_(own, own)]
    for i, p in enumerate(found.parameters):
        if np.isfinite(p.prior_sigma):
            x[i] = p.prior
            known[i, i] += p.prior_sigma**2
    return x, known
