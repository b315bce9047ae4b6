"""All misfits together: one chi-square, an unknown lever arm taken out, and a word on what is not checked."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ..calibrate import common
from ..calibration import Calibration
from ..errors import DataError
from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..printed import printed, probability
from ..sensors import Correction, invert, triad_of
from .axis import axes, joined
from .norms import Misfits, norms
from .record import PASS, Check, Verification

_QUANTITY = {"accel": ("static norm", "m/s^2"), "gyro": ("rate norm", "rad/s"), "axis": ("rate axis", "rad")}
_LEVER = 0.5
"""m, one sigma of a lever arm that the calibration does not hold: no unit sits further from the axis of a turntable."""
_TOLD = 0.3
"""Standard uncertainties that the lever arm moves the misfits by, from which it is estimated and not taken as noise."""
_DROPPED = 1e-6
"""Share of its variance below which nothing of a misfit is left to judge."""
_HIDDEN = 0.1
"""A turn of the gyros is not verified where the lever arm makes it uncertain by more than one over this."""
_IN_PART = "in part: all turning segments turn about one axis of the unit"
_EXCITED = 0.3
"""Share of the input that an axis must feel once for its scale to be checked."""


def judge(
    calibration: Calibration, means: SegmentMeans, plan: Plan, models: dict[str, Correction], closure: Array | None
) -> Verification:
    """Verdict on the misfits of all segments.

    A lever arm that the calibration does not hold is three unknowns common to all segments. What the misfits tell of it is
    projected out of the whitened chi-square, which costs a degree of freedom a direction (the generalised least-squares
    residual, Golub & Pereyra 1973); directions that they hardly show stay as noise of 0.5 m.

    Parameters
    ----------
    calibration : Calibration
    means : SegmentMeans
        Of the new recording.
    plan : Plan
        Of it.
    models : dict of str to Correction
        By sensor.
    closure : ndarray or None
        Misfits of the rotations of a hand-turned log, rad.

    Returns
    -------
    Verification

    Raises
    ------
    DataError
        When there is nothing to compare.
    """
    from scipy.linalg import block_diag
    from scipy.special import chdtrc

    names = calibration.values()
    whole = [k for k in ("accel", "gyro") if k in models and triad_of(names, k) is not None]
    parts = [norms(k, calibration, means, plan, models) for k in whole]
    parts.append(axes(calibration, means, plan, models))
    parts = [p for p in parts if p.residual.size]
    if not parts:
        raise DataError("nothing to compare: static segments need accelerometers, turning ones gyros")
    r = np.concatenate([p.residual for p in parts])
    jac = np.vstack([p.jacobian for p in parts])
    covariance = np.diag(np.concatenate([p.variance for p in parts])) + jac @ calibration.matrix @ jac.T
    shared = block_diag(*(p.common[:, None] for p in parts))
    covariance += shared @ shared.T
    covariance += 1e-24 * np.eye(r.size) * float(np.trace(covariance)) / r.size
    found = _without_lever(r, covariance, _stacked(parts, "lever"), _stacked(parts, "turn"))
    p_value = float(chdtrc(found.degrees_of_freedom, found.chi2))
    rms = None if closure is None else float(np.sqrt(np.mean(closure**2)))
    remarks = [*means.remarks, *_left_out(whole, models), *found.remarks]
    hidden = found.hidden
    if joined(calibration, models) and all(p.kind != "axis" for p in parts):
        hidden = "no segment turns about the vertical, or the calibration holds further terms"
    remarks += _unchecked(means, whole, models, closure, hidden)
    closed, remarks = _closure(calibration, closure, remarks)
    return Verification(
        _checks(parts, found),
        found.chi2,
        found.degrees_of_freedom,
        p_value,
        p_value >= PASS and closed,
        rms,
        tuple(remarks),
    )


def _stacked(parts: Sequence[Misfits], what: str) -> Array:
    """Derivatives of all misfits to three numbers, (r, 3); nothing where a kind does not depend on them."""
    own = [getattr(p, what) for p in parts]
    return np.vstack([np.zeros((p.residual.size, 3)) if d is None else d for p, d in zip(parts, own, strict=True)])


@dataclass(frozen=True)
class _Found:
    """Misfits after the lever arm."""

    residual: Array
    sigma: Array
    kept: Array
    """Share of the variance that is left to judge."""
    chi2: float
    degrees_of_freedom: int
    hidden: str
    """Why the misalignment of the gyros is not verified; empty where it is."""
    remarks: tuple[str, ...] = ()


def _without_lever(r: Array, covariance: Array, lever: Array, turn: Array) -> _Found:
    """Project out what the misfits tell of the lever arm."""
    half = np.linalg.cholesky(covariance)
    white = np.linalg.solve(half, r)
    u, s, v = np.linalg.svd(_LEVER * np.linalg.solve(half, lever), full_matrices=False)
    told = s > _TOLD
    # share of each direction that goes: all of it, or what noise of half a metre takes
    gone = np.where(told, 1.0, s**2 / (1.0 + s**2))
    along = u.T @ white
    left = r - half @ (u[:, told] @ along[told])
    every = np.diag(covariance)
    taken = np.sum((half @ u[:, told]) ** 2, axis=1)
    added = np.sum((half @ (u * np.where(told, 0.0, s))) ** 2, axis=1)
    remarks: tuple[str, ...] = ()
    if told.any():
        arm = _LEVER * v[told].T @ (along[told] / s[told])
        spread = np.sqrt(np.sum((_LEVER * v.T * np.where(told, 1.0 / np.maximum(s, _TOLD), 1.0)) ** 2, axis=1))
        # the misfit is gyros less accelerometers, so that the lever arm enters with its own sign
        remarks = (_told_lever(arm, spread),)
    return _Found(
        residual=left,
        sigma=np.sqrt(np.maximum(every - taken, 0.0) + added),
        kept=1.0 - taken / every,
        chi2=float(white @ white - gone @ along**2),
        degrees_of_freedom=r.size - int(told.sum()),
        hidden=_hidden(np.linalg.solve(half, turn), u, gone),
        remarks=remarks,
    )


def _told_lever(arm: Array, spread: Array) -> str:
    """What came out for the lever arm."""
    each = []
    for axis, value, sigma in zip("xyz", arm, spread, strict=True):
        text, uncertainty, unit = printed(float(value), float(sigma), "m")
        each.append(f"{axis} {text} ± {uncertainty} {unit}")
    return (
        "the calibration holds no lever arm; it was estimated from this recording, and its effect on the axis of the rate "
        f"taken out: {', '.join(each)}"
    )


def _hidden(turn: Array, u: Array, gone: Array) -> str:
    """Why a turn of the gyros against the accelerometers would not show; empty where it would."""
    values, directions = np.linalg.eigh(turn.T @ turn)
    if values[-1] <= 0:
        return ""
    shows = values > 1e-6 * values[-1]
    basis = directions[:, shows] / np.sqrt(values[shows])  # of turns that would show alike if the lever arm were known
    seen = turn @ basis
    shown = np.linalg.eigvalsh(seen.T @ seen - (seen.T @ u * gone) @ (u.T @ seen))
    if shown[0] < _HIDDEN**2:
        return (
            "the calibration holds no lever arm, and these segments cannot tell one from a misalignment (turn the unit upside "
            "down as well, or at a second rate)"
        )
    return "" if shows.all() else _IN_PART


def _checks(parts: Sequence[Misfits], found: _Found) -> tuple[Check, ...]:
    names = [(p.kind, n) for p in parts for n in p.names]
    return tuple(
        Check(name, _QUANTITY[kind][0], float(v), float(s), _QUANTITY[kind][1])
        for (kind, name), v, s, kept in zip(names, found.residual, found.sigma, found.kept, strict=True)
        if kept > _DROPPED
    )


def _unchecked(
    means: SegmentMeans,
    whole: Sequence[str],
    models: dict[str, Correction],
    closure: Array | None,
    hidden: str,
) -> list[str]:
    """What the calibration holds and this recording does not check."""
    rates = common.rates_of(means).sum(axis=1)
    out = []
    for kind in whole:
        if kind == "gyro" and closure is not None:  # by the rotations
            continue
        at = rates == 0 if kind == "accel" else rates != 0
        if not at.any():
            does = "stands still" if kind == "accel" else "turns"
            out.append(
                f"no segment {does}: scale factors, misalignments and biases of the {kind} triad are not verified"
            )
        else:
            out += _unexcited(kind, means.mean[kind][at], models[kind])
    if rates.any() and hidden == _IN_PART:
        out.append(f"the gyros' misalignment is verified only {hidden}")
    elif rates.any() and hidden:
        out.append(f"the gyros' misalignment is not verified: {hidden}")
    return out


def _unexcited(kind: str, readings: Array, model: Correction) -> list[str]:
    """Axes that feel little of the input in every segment, so that their scale does not show in the norm."""
    felt = np.abs(invert(model, readings))
    share = (felt / np.linalg.norm(felt, axis=1)[:, None]).max(axis=0)
    idle = [a for a, s in zip("xyz", share, strict=True) if s < _EXCITED]
    if not idle:
        return []
    does = "stands with it along the vertical" if kind == "accel" else "turns about it"
    return [f"{kind} {', '.join(idle)}: no segment {does}, so that the scale factor is not verified"]


def _left_out(whole: Sequence[str], models: Collection[str]) -> list[str]:
    """A word on sensors of which the calibration holds too little to judge them here."""
    return [
        f"the {kind} triad was not judged: the calibration lacks its scale or misalignments"
        for kind in sorted(set(models) - set(whole))
    ]


def _closure(calibration: Calibration, closure: Array | None, remarks: list[str]) -> tuple[bool, list[str]]:
    """Whether the rotations close as well as those of the fit did (F test at the same level)."""
    expected = calibration.fit.residuals.get("rotation")
    if closure is None or expected is None:
        return True, remarks
    from scipy.special import fdtrc

    # the fit's own residuals are too small and fresh ones too large by what nine fitted parameters took from them
    rows, fitted = 2 * expected.count, 9
    left = max(rows - fitted, 1)
    allowed = math.radians(expected.rms) ** 2 * rows / left * (1.0 + fitted / rows)
    p_value = float(fdtrc(2 * closure.size, left, float(np.mean(closure**2)) / allowed))
    remarks.append(
        f"rotations close to {math.degrees(math.sqrt(np.mean(closure**2))):.3g} deg rms, in the fit {expected.rms:.3g} deg "
        f"(probability {probability(p_value)})"
    )
    return p_value >= PASS, remarks
