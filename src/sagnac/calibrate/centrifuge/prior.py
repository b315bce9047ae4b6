"""A calibration of the unit at 1 g as prior knowledge for the centrifuge, in the frame and the conventions used there.

A table gives the elements S_ij of the matrices; here a misalignment is S_ij/S_ii, where an input axis points, in the frame p
that the accelerometers define (x_p along the input axis of x, y_p in the plane of x and y). Lower triangular accelerometers are
in that frame already; full ones, in the table's case frame k, are turned into it: S_k = L C_k^p with L lower triangular, and the
gyros with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...calibration import Calibration
from ...errors import InputError
from ...frames import Array
from ...plan import Plan
from ...sensors import INPUT, TERMS, Triad, triad_of

_STEP = 1e-6  # of central differences in angles and scales: error 1e-12
_SENSED = {"bias", "scale_error", "misalignment", *TERMS["accel"], *TERMS["gyro"]}


class Prior(NamedTuple):
    """What is known of some parameters, SI."""

    names: tuple[str, ...]
    mean: Array
    """(p,)."""
    covariance: Array
    """(p, p)."""
    remarks: tuple[str, ...]

    def only(self, names: Sequence[str]) -> Prior:
        """That part which speaks of the named parameters."""
        at = [i for i, n in enumerate(self.names) if n in set(names)]
        return Prior(tuple(self.names[i] for i in at), self.mean[at], self.covariance[np.ix_(at, at)], self.remarks)


def prior_of(calibration: Calibration, plan: Plan) -> Prior:
    """Sensor parameters of a calibration as this rig names and defines them.

    Parameters
    ----------
    calibration : Calibration
        Of the same unit, for readings in SI.
    plan : Plan
        ``unit.limits`` tells how far biases may have drifted since.

    Returns
    -------
    Prior

    Raises
    ------
    InputError
        When it is for raw counts or says nothing about the sensors.
    """
    values = calibration.values()
    if any(".scale_factor." in name for name in values):
        raise InputError(
            "the prior calibration is for readings in raw counts; here they are in units of the input: calibrate it with the "
            "same --scale"
        )
    ratio = calibration.misalignment == "input-axis"
    names = tuple(n for n in values if n.split(".")[0] in TERMS and n.split(".")[1] in _SENSED)
    remarks: list[str] = []
    ready = ratio and not {f"accel.misalignment.{pair}" for pair in ("xy", "xz", "yz")} & set(names)
    if not ready:
        names = _usable(names, ratio, remarks)
    if any(".g_sensitivity." in n for n in values):
        remarks.append("the g-sensitivities of the prior calibration are not used: the centrifuge finds its own")
    if not names:
        raise InputError(f"the prior calibration ({calibration.method}) says nothing about accelerometers or gyros")
    at = [list(values).index(name) for name in names]
    mean, covariance = np.array([values[n] for n in names]), calibration.matrix[np.ix_(at, at)]
    if not ready:
        names, mean, covariance = _in_p(names, mean, covariance, ratio)
    for kind, drift in (("accel", plan.unit.limits.accel_drift), ("gyro", plan.unit.limits.gyro_drift)):
        for i, name in enumerate(names):
            if drift and name.startswith(f"{kind}.bias."):
                covariance[i, i] += drift**2
    return Prior(names, mean, covariance, tuple(remarks))


def _usable(names: tuple[str, ...], ratio: bool, remarks: list[str]) -> tuple[str, ...]:
    """Names of the parameters that can be turned into p."""
    accel, gyro = (triad_of(names, kind, ratio=ratio) for kind in ("accel", "gyro"))
    if any(n.startswith("gyro.misalignment.") for n in names) and (accel is None or gyro is None or not gyro.full):
        names = tuple(n for n in names if not n.startswith("gyro.misalignment."))
        remarks.append(
            "the gyros' misalignments of the prior calibration are not in the accelerometers' frame: they are not used"
        )
    if accel is None and any(n.startswith("accel.misalignment.") for n in names):
        names = tuple(n for n in names if not n.startswith("accel.misalignment."))
        remarks.append("the prior calibration has no whole accelerometer triad: its misalignments are not used")
    return names


def _in_p(names: tuple[str, ...], x: Array, covariance: Array, ratio: bool) -> tuple[tuple[str, ...], Array, Array]:
    """Names, values and covariance after :func:`_converted`, derivatives by central differences."""
    new, mean = _converted(names, x, ratio)
    jacobian = np.empty((len(new), len(names)))
    for i, name in enumerate(names):
        step = np.where(np.arange(len(names)) == i, _size(name), 0.0)
        ahead, behind = (_converted(names, v, ratio)[1] for v in (x + step, x - step))
        jacobian[:, i] = (ahead - behind) / (2.0 * step[i])
    return new, mean, jacobian @ covariance @ jacobian.T


def _size(name: str) -> float:
    """Step of the central difference; the conversion is linear in all but scales and misalignments."""
    return _STEP if name.split(".")[1] in ("scale_error", "misalignment") else 1.0


def _converted(names: Sequence[str], x: Array, ratio: bool) -> tuple[tuple[str, ...], Array]:
    """The parameters in p, misalignments as directions of the input axes."""
    out = dict(zip(names, x, strict=True))
    to_p = np.eye(3)
    for kind in INPUT:
        triad = triad_of(names, kind, ratio=ratio)
        if triad is None:
            continue
        matrix, bias, _ = triad.unpack(np.array([out[n] for n in triad.names]))
        for name in triad.names:
            del out[name]
        if kind == "accel" and triad.full:
            q, r = np.linalg.qr(matrix.T)
            to_p = (q * np.sign(np.diag(r) * np.diag(matrix))).T
        own = Triad(kind, full=kind == "gyro" and triad.full, ratio=True)
        out |= dict(zip(own.names, own.pack(matrix @ to_p.T, bias), strict=True))
    return tuple(out), np.array(list(out.values()))


def whitening(covariance: Array, least: Array) -> Array:
    """Inverse square root of a covariance that may be rank deficient.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
    least : ndarray, shape (p,)
        Standard deviation of what is said to be exact.

    Returns
    -------
    ndarray, shape (p, p)
    """
    covariance = covariance + np.diag(np.where(np.diag(covariance) > 0, 0.0, least**2))
    sigma = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    return np.asarray((vectors / np.sqrt(np.maximum(values, 1e-12))).T / sigma)
