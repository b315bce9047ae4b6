"""Check a calibration on a recording that its fit has not seen.

Static segments must show the norm of gravity, turning ones the norm of rate and Earth rate, attitudes found in a
hand-turned log besides must be joined by the integrated rate. Each misfit is compared with what the calibration's
covariance, the noise of the new means and (where its own fit scattered by more than noise) that scatter allow; all of them
together pass or fail by one chi-square.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..calibrate import four_position, hand_turned
from ..calibrate.hand_gyros import rotation_misfit
from ..calibration import Calibration
from ..compensation import corrections
from ..errors import DataError, InputError
from ..files import sha256
from ..observe.means import SegmentMeans, segment_means
from ..observe.static import THRESHOLD, static_intervals
from ..plan import Plan
from ..recording import Recording
from ..sensors import triad_of
from .judge import judge
from .record import PASS, Check, Verification

__all__ = ["PASS", "Check", "Verification", "made_by_hand", "verify"]

_AMPLE = 0.999
"""Probability above which the misfits are suspiciously small."""


def verify(
    calibration: Calibration, recording: Recording, plan: Plan | None = None, *, threshold: float = THRESHOLD
) -> Verification:
    """Compare a recording, compensated, with what is known of its inputs.

    Parameters
    ----------
    calibration : Calibration
    recording : Recording
        In the same units as the calibration's own.
    plan : Plan, optional
        Its segments; without segments (or plan) the static intervals are found as for a hand-turned unit.
    threshold : float
        See :func:`sagnac.observe.static.static_intervals`.

    Returns
    -------
    Verification

    Raises
    ------
    DataError
        When there is nothing to compare.
    InputError
        When units do not match, or a calibration from a rig lacks the plan of the recording.
    """
    found = _verified(calibration, recording, plan, threshold)
    own = _same_source(calibration, recording)
    notes = (*([] if own else _ample(found)), *own, *_other_unit(calibration, plan))
    return replace(found, remarks=(*found.remarks, *notes)) if notes else found


def made_by_hand(calibration: Calibration) -> bool:
    """Whether a calibration was made from the static intervals of a log, without the segments of a plan.

    Parameters
    ----------
    calibration : Calibration
    """
    numbered = {str(i + 1) for i in range(len({i.segment for i in calibration.fit.influence}))}
    if calibration.method != "norm" or {i.segment for i in calibration.fit.influence} != numbered:
        return False
    return not calibration.rig or any("static intervals found" in r for r in calibration.remarks)


def _ample(found: Verification) -> list[str]:
    """A word where the misfits are far smaller than they may be."""
    if found.p_value <= _AMPLE or found.degrees_of_freedom == 0:
        return []
    dof = found.degrees_of_freedom
    return [
        f"chi-square {found.chi2:.3g} is far below its {dof}: the stated uncertainties are larger than what is seen"
    ]


def _verified(calibration: Calibration, recording: Recording, plan: Plan | None, threshold: float) -> Verification:
    if calibration.method == "roll-isolated":
        from . import roll_isolated

        return roll_isolated.verify(calibration, recording, plan)
    if plan is not None and plan.rig.kind == "centrifuge":
        from . import centrifuge

        return centrifuge.verify(calibration, recording, plan)
    models = corrections(calibration, recording)
    site = plan or Plan(latitude=calibration.site.latitude, gravity=calibration.site.gravity)
    if site.segment:
        biases = all(triad_of(calibration.values(), kind) is None for kind in models)
        means = segment_means(recording, site, rig="refuse" if biases else "tell")  # norms hardly rest on the angles
        if biases:
            if any(m.terms for m in models.values()):
                raise DataError(
                    f"this calibration by {calibration.method} holds terms but no whole triad with scale and misalignment: "
                    "it can only be verified on the rig that it is from"
                )
            return _biases(calibration, means, site)
        return judge(calibration, means, site, models, None)
    if calibration.rig and not made_by_hand(calibration):
        rig = calibration.rig.get("kind", "turntable").replace("-", " ")
        raise InputError(
            f"{recording.name}: the calibration was made on a {rig}; give the plan of this recording (--plan), with its segments"
        )
    batch = recording.read()
    found = static_intervals(batch, threshold)
    if "accel" not in models or len(found.start) == 0:
        raise DataError(
            "without a plan's segments there must be static intervals of a calibrated accelerometer triad; none found"
        )
    means, site = hand_turned.means_of(batch, found, site, recording.counts, recording.name)
    closure = None
    if "gyro" in models and len(found.start) > 1:
        closure = rotation_misfit(batch, found, means, models["accel"], models["gyro"])
    return judge(calibration, means, site, models, closure)


def _biases(calibration: Calibration, means: SegmentMeans, plan: Plan) -> Verification:
    """Biases alone say nothing about norms: compare them with those that the new recording gives by the same method."""
    from scipy.special import chdtrc

    fresh = four_position.calibrate_means(means, plan)
    names = [n for n in calibration.values() if n in fresh.values()]
    old, new = ([list(c.values()).index(n) for n in names] for c in (calibration, fresh))
    difference = np.array([fresh[n].value - calibration[n].value for n in names])
    covariance = calibration.matrix[np.ix_(old, old)] + fresh.matrix[np.ix_(new, new)]
    chi2 = float(difference @ np.linalg.solve(covariance, difference))
    p_value = float(chdtrc(len(names), chi2))
    checks = tuple(
        Check("all", name, float(d), float(s), calibration[name].unit)
        for name, d, s in zip(names, difference, np.sqrt(np.diag(covariance)), strict=True)
    )
    return Verification(checks, chi2, len(names), p_value, p_value >= PASS, None, fresh.remarks)


def _same_source(calibration: Calibration, recording: Recording) -> list[str]:
    """A word where the recording is one that the fit has seen."""
    known = {s.sha256 for s in calibration.source if s.sha256}
    if recording.path is None or not known or sha256(recording.path) not in known:
        return []
    return ["this is the recording that the calibration was made from: that it fits says nothing about another one"]


def _other_unit(calibration: Calibration, plan: Plan | None) -> list[str]:
    """A word where the serial numbers of calibration and plan differ."""
    theirs = plan.unit.serial if plan is not None else ""
    if not theirs or not calibration.unit.serial or theirs == calibration.unit.serial:
        return []
    return [f"the calibration is of unit {calibration.unit.serial!r}, the plan names {theirs!r}"]
