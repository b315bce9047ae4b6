"""The one correction that every exporter starts from.

The instrument says ``y = S u + b + G f`` and higher terms (see :mod:`sagnac.sensors`), so that ::

    f = M_a (y - b_a),    w = M_g (y - b_g - G f),    M = S^-1

Terms that are linear in the specific force (the gyros' DI, DO and DS of IEEE Std 517) are part of G. The covariance of all
entries follows from that of the parameters by the derivatives of M, b and G, taken by a complex step: exact to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..calibration import Calibration
from ..errors import DataError
from ..frames import Array
from ..sensors import AXES, INPUT, Correction, check_whole, correction
from ..sensors.axis import rows

KINDS = ("accel", "gyro")
_LINEAR_IN_FORCE = ("d_i", "d_o", "d_s")
_STEP = 1e-30
_FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)  # of the Allan deviation over the bias instability


@dataclass(frozen=True)
class LikelyWalk:
    """Random walk for software that asks for one, of biases that show none.

    Attributes
    ----------
    value : ndarray, shape (3,)
        SI per sqrt(s).
    reason : str
        Where it is from.
    """

    value: Array
    reason: str


@dataclass(frozen=True)
class Linear:
    """The correction of one triad: u = M (y - b - G f).

    Attributes
    ----------
    kind : str
        ``accel`` or ``gyro``.
    matrix : ndarray, shape (3, 3)
        M.
    bias : ndarray, shape (3,)
        b, in the unit of the readings.
    g_matrix : ndarray, shape (3, 3)
        G, zero for accelerometers.
    counts : bool
        Whether the readings are raw counts.
    higher : dict of str to ndarray, shape (3,)
        Coefficients of the terms that are not in it, by the names of :data:`sagnac.sensors.TERMS`.
    noise : ndarray, shape (3,), or None
        White noise of the corrected axes, SI per sqrt(Hz); None when the calibration states none.
    walk : ndarray, shape (3,), or None
        Random walk of their biases, SI per sqrt(s); None when the calibration states none.
    likely_walk : LikelyWalk or None
        What may be stated for it where it states none.
    """

    kind: str
    matrix: Array
    bias: Array
    g_matrix: Array
    counts: bool
    higher: Mapping[str, Array]
    noise: Array | None
    walk: Array | None = None
    likely_walk: LikelyWalk | None = None

    @property
    def forward(self) -> Array:
        """S, the inverse of M."""
        return np.asarray(np.linalg.inv(self.matrix))

    @property
    def entries(self) -> Array:
        """M row by row, b, and for gyros G row by row."""
        parts = [self.matrix.ravel(), self.bias] + ([self.g_matrix.ravel()] if self.kind == "gyro" else [])
        return np.concatenate(parts)


@dataclass(frozen=True)
class Canonical:
    """The correction of a calibration.

    Attributes
    ----------
    calibration : Calibration
    triads : dict of str to Linear
    names, units : tuple of str
        Of the entries: ``accel.matrix.xy``, ``accel.bias.x``, ..., ``gyro.g_sensitivity.xy``.
    covariance : ndarray, shape (k, k)
        Of the entries.
    remarks : tuple of str
    """

    calibration: Calibration
    triads: dict[str, Linear]
    names: tuple[str, ...]
    units: tuple[str, ...]
    covariance: Array
    remarks: tuple[str, ...]

    @property
    def entries(self) -> Array:
        """Values of all entries, shape (k,)."""
        return np.concatenate([t.entries for t in self.triads.values()])

    def uncertainty(self, function: Callable[[dict[str, Linear]], Array]) -> Array:
        """Standard uncertainties of numbers that are computed from the correction, to first order.

        Parameters
        ----------
        function : callable
            Takes the triads, returns an array of any shape.

        Returns
        -------
        ndarray
            Of that shape: the root sum of squares of the changes over one standard uncertainty along each principal axis of
            the covariance.
        """
        sigma = np.sqrt(np.diag(self.covariance))
        scale = np.where(sigma > 0, sigma, 1.0)
        size, axes = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        total = np.zeros(np.shape(function(self.triads)))
        for variance, axis in zip(size, axes.T, strict=True):
            if variance > 1e-12:
                step = np.sqrt(variance) * axis * sigma
                up, down = (function(self._moved(sign * step)) for sign in (1.0, -1.0))
                total += ((up - down) / 2.0) ** 2
        return np.sqrt(total)

    def _moved(self, step: Array) -> dict[str, Linear]:
        """The triads with their entries changed."""
        out, at = {}, 0
        for kind, triad in self.triads.items():
            n = triad.entries.size
            own = triad.entries + step[at : at + n]
            at += n
            g_matrix = own[12:].reshape(3, 3) if kind == "gyro" else triad.g_matrix
            out[kind] = replace(triad, matrix=own[:9].reshape(3, 3), bias=own[9:12], g_matrix=g_matrix)
        return out


def canonical(calibration: Calibration) -> Canonical:
    """The canonical correction of a calibration, with covariance.

    Raises
    ------
    DataError
        When the calibration covers no whole triad, turns with a rig's angle, or has a matrix that cannot be inverted.
    """
    if calibration.method == "roll-isolated":
        raise DataError(
            "a roll-isolated calibration corrects with the encoder's angle, sample by sample; no other software holds that: "
            "use `sagnac apply` and hand on the compensated samples"
        )
    values = calibration.values()
    ratio = calibration.misalignment == "input-axis"
    triads: dict[str, Linear] = {}
    slopes, names, units, remarks = [], [], [], []
    for kind in KINDS:
        model = correction(values, kind, ratio=ratio)
        if model is None:
            continue
        check_whole({p.name: p.unit for p in calibration.parameters}, model)
        remarks += _nominal(calibration, model)
        matrix, bias, g_matrix = _inverse(values, kind, model.counts, ratio)
        higher = {t: v for t, v in model.terms.items() if t not in _LINEAR_IN_FORCE}
        noise, walk, likely = _noise(calibration, kind, matrix)
        triads[kind] = Linear(kind, matrix, bias, g_matrix, model.counts, higher, noise, walk, likely)
        slopes.append(_slopes(values, kind, model.counts, ratio))
        entries = _names(kind, model.counts)
        names += list(entries)
        units += list(entries.values())
    if not triads:
        raise DataError("the calibration says nothing about accelerometers or gyros: there is nothing to export")
    if "accel" not in triads and np.any(triads["gyro"].g_matrix):
        remarks.append(
            "the gyros answer to the specific force, and this calibration has none of the accelerometers that measure it"
        )
    J = np.vstack(slopes)
    covariance = J @ calibration.matrix @ J.T
    return Canonical(calibration, triads, tuple(names), tuple(units), (covariance + covariance.T) / 2.0, tuple(remarks))


def best_diagonal(forward: Array) -> Array:
    """Gain of each axis that leaves the least rms error over inputs of all directions.

    The error of axis i is ``(s_i S_i - e_i) u`` with S_i row i of the instrument's matrix, smallest for ``s_i = S_ii / |S_i|^2``.

    Parameters
    ----------
    forward : ndarray, shape (3, 3)
        S.

    Returns
    -------
    ndarray, shape (3,)
    """
    return np.asarray(np.diag(forward) / np.sum(forward**2, axis=1))


def _forward(values: Mapping[str, Any], kind: str, counts: bool, ratio: bool) -> tuple[Any, Any, Any]:
    """S, b and G of named parameters, which may be complex."""

    def of(term: str, axes: str) -> Any:
        return values.get(f"{kind}.{term}.{axes}", 0.0)

    gain = np.array([of("scale_factor", a) if counts else 1.0 + of("scale_error", a) for a in AXES])
    bias = np.array([of("bias", a) for a in AXES])
    cross = np.array([[0.0 if i == j else of("misalignment", i + j) for j in AXES] for i in AXES])
    matrix = np.diag(gain) + cross * (gain[:, None] if counts or ratio else 1.0)
    if kind == "accel":
        return matrix, bias, np.zeros((3, 3))
    g_matrix = np.array([[of("g_sensitivity", i + j) for j in AXES] for i in AXES])
    along = []
    for i, axis in enumerate(AXES):
        pairs = {axis + AXES[j]: matrix[i, j] / gain[i] for j in range(3) if j != i}
        linear = np.array([of(term, axis) for term in _LINEAR_IN_FORCE])
        along.append(linear @ rows(f"gyro.{axis}", pairs) * (gain[i] if counts else 1.0))
    return matrix, bias, g_matrix + np.array(along)


def _inverse(values: Mapping[str, Any], kind: str, counts: bool, ratio: bool) -> tuple[Any, Any, Any]:
    """M, b and G."""
    matrix, bias, g_matrix = _forward(values, kind, counts, ratio)
    return np.linalg.inv(matrix), bias, g_matrix


def _slopes(values: Mapping[str, float], kind: str, counts: bool, ratio: bool) -> Array:
    """Derivatives of the entries of one triad to all parameters of the calibration, shape (entries, parameters)."""
    columns = []
    for name in values:
        moved: dict[str, Any] = dict(values)
        moved[name] = values[name] + 1j * _STEP
        matrix, bias, g_matrix = _inverse(moved, kind, counts, ratio)
        parts = [matrix.ravel(), bias] + ([g_matrix.ravel()] if kind == "gyro" else [])
        columns.append(np.concatenate(parts).imag / _STEP)
    return np.stack(columns, axis=1)


def _names(kind: str, counts: bool) -> dict[str, str]:
    """Names of the entries of one triad, and their units."""
    reading = "count" if counts else INPUT[kind]
    pairs = [i + j for i in AXES for j in AXES]
    out = {f"{kind}.matrix.{p}": f"{INPUT[kind]}/count" if counts else "1" for p in pairs}
    out |= {f"{kind}.bias.{a}": reading for a in AXES}
    if kind == "gyro":
        out |= {f"{kind}.g_sensitivity.{p}": "count/(m/s^2)" if counts else "rad*s/m" for p in pairs}
    return out


def _noise(calibration: Calibration, kind: str, matrix: Array) -> tuple[Array | None, Array | None, LikelyWalk | None]:
    """White noise of the corrected axes, the random walk of their biases, and what may be stated for a walk that was not seen."""
    level = next((v for k, v in calibration.noise.items() if k == kind), None)
    if level is None:
        return None, None, None

    def turned(each: tuple[float, ...]) -> Array:
        return np.asarray(np.sqrt(matrix**2 @ np.array(each) ** 2))

    # every axis has white noise; a walk may be seen on some of them only
    white = turned(level.density) if min(level.density) > 0 else None
    if level.walk is not None and max(level.walk) > 0:
        return white, turned(level.walk), None
    if level.walk_limit is not None:
        return white, None, LikelyWalk(turned(level.walk_limit), "its noise test saw none, it stays below that")
    if white is None or level.instability is None or not max(level.instability) > 0:
        return white, None, None
    # K^2 T / 3 as large as the floor at the time T where the floor begins, N^2 / T being as large: K = sqrt(3) floor^2 / N
    floors = zip(level.instability, level.density, strict=True)
    like_floor = tuple(math.sqrt(3.0) * (_FLOOR * b) ** 2 / n for b, n in floors)
    return (
        white,
        None,
        LikelyWalk(turned(like_floor), "it drifts as far as the bias instability where this begins to show"),
    )


def _nominal(calibration: Calibration, model: Correction) -> list[str]:
    """Say which linear parameters are taken as nominal."""
    own = [p.name for p in calibration.parameters if p.name.startswith(f"{model.kind}.")]
    known = {name.split(".")[1] for name in own}
    scale = "scale_factor" if model.counts else "scale_error"
    absent = {"bias": "bias", scale: "scale", "misalignment": "misalignment"}
    missing = [word for term, word in absent.items() if term not in known]
    return [f"the calibration says nothing of {model.kind} {', '.join(missing)}: taken as nominal"] if missing else []
