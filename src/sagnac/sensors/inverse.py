"""The whole model of a triad read backwards: from readings to what the unit felt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..errors import DataError
from ..frames import Array
from .axis import TERMS, rows
from .triad import AXES


@dataclass(frozen=True)
class Correction:
    """Everything that :func:`invert` needs for one triad.

    Attributes
    ----------
    kind : str
        ``accel`` or ``gyro``.
    matrix : ndarray, shape (3, 3)
    bias : ndarray, shape (3,)
    g_matrix : ndarray, shape (3, 3)
        G, zero for accelerometers.
    terms : dict of str to ndarray, shape (3,)
        Further coefficients of the sensors x, y, z by the names of :data:`sagnac.sensors.TERMS`, SI; absent ones are zero.
    counts : bool
        Whether the readings are raw counts.
    """

    kind: str
    matrix: Array
    bias: Array
    g_matrix: Array = field(default_factory=lambda: np.zeros((3, 3)))
    terms: Mapping[str, Array] = field(default_factory=dict)
    counts: bool = False

    @property
    def needs_force(self) -> bool:
        """Whether a gyro's inverse needs the specific force."""
        return self.kind == "gyro" and (bool(np.any(self.g_matrix)) or bool(self.terms))


def correction(values: Mapping[str, float], kind: str, *, ratio: bool = False) -> Correction | None:
    """Gather the model of one triad from named parameters; None when it has none.

    Parameters
    ----------
    values : mapping of str to float
    kind : str
    ratio : bool
        Whether misalignments are those of the input axes, S_ij/S_ii (see :class:`sagnac.sensors.Triad`).

    Raises
    ------
    DataError
        When a parameter of the triad is of a kind that the model does not know: leaving it out would be wrong silently.
    """
    own = {name: value for name, value in values.items() if name.startswith(f"{kind}.")}
    if not own:
        return None
    counts = any(name.startswith(f"{kind}.scale_factor.") for name in own)
    matrix, g_matrix, bias = np.eye(3), np.zeros((3, 3)), np.zeros(3)
    terms: dict[str, Array] = {}
    for name, value in own.items():
        _, term, axes = name.split(".") if name.count(".") == 2 else (kind, "", "")
        at = tuple(AXES.find(a) for a in axes)
        if min(at, default=-1) < 0 or (term == "misalignment" and len(set(at)) < len(at)):
            term = ""
        if term in ("scale_error", "scale_factor") and len(at) == 1:
            matrix[at[0], at[0]] = value if counts else 1.0 + value
        elif term == "misalignment" and len(at) == 2:
            matrix[at] = value
        elif term == "bias" and len(at) == 1:
            bias[at[0]] = value
        elif term == "g_sensitivity" and len(at) == 2 and kind == "gyro":
            g_matrix[at] = value
        elif term in TERMS[kind] and len(at) == 1:
            terms.setdefault(term, np.zeros(3))[at[0]] = value
        else:
            raise DataError(f"the model has no term for the parameter {name!r}; it cannot be applied")
    if counts or ratio:
        matrix = np.where(np.eye(3, dtype=bool), matrix, matrix * np.diag(matrix)[:, None])
    return Correction(kind, matrix, bias, g_matrix, {t: v for t, v in terms.items() if np.any(v)}, counts)


def invert(model: Correction, readings: Array, specific_force: Array | None = None) -> Array:
    """Input that gives these readings, to rounding.

    Parameters
    ----------
    model : Correction
    readings : ndarray, shape (n, 3)
        m/s^2 or rad/s, or counts.
    specific_force : ndarray, shape (n, 3), m/s^2, optional
        Needed when a gyro answers to it.

    Returns
    -------
    ndarray, shape (n, 3), m/s^2 or rad/s

    Raises
    ------
    DataError
        When a gyro needs the specific force and there is none, or the higher terms have no solution near a reading.
    """
    raw = readings - model.bias
    if model.needs_force:
        if specific_force is None:
            raise DataError(
                "the gyros are g-sensitive: compensating them needs the accelerometers of the same recording"
            )
        raw = raw - specific_force @ model.g_matrix.T - _higher(model, specific_force)
    inverse = np.linalg.inv(model.matrix)
    out = raw @ inverse.T
    if model.kind == "gyro" or not model.terms:
        return out
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging iteration is refused below
        for _ in range(60):  # fixed point of u = S^-1 (raw - higher(u)), a contraction while K2 a and its like are << 1
            new = (raw - _higher(model, out)) @ inverse.T
            done = np.all(np.abs(new - out) <= 4e-16 * (1.0 + np.abs(new)))
            out = new
            if done:
                return out
    raise DataError("the higher accelerometer terms are too large for these readings: no input explains them")


def forward(model: Correction, u: Array, specific_force: Array | None = None) -> Array:
    """Readings for an input, the inverse of :func:`invert` (same shapes)."""
    out = np.asarray(u @ model.matrix.T + model.bias)
    if model.kind == "accel":
        return out + _higher(model, u) if model.terms else out
    if specific_force is not None:
        out = out + specific_force @ model.g_matrix.T + _higher(model, specific_force)
    return out


def _higher(model: Correction, force: Array) -> Array:
    """What the further terms add for a specific force (n, 3); in counts, times the gain."""
    out = np.zeros(force.shape)
    gain = np.diag(model.matrix)
    for i, axis in enumerate(AXES) if model.terms else ():
        pairs = {f"{axis}{AXES[j]}": model.matrix[i, j] / gain[i] for j in range(3) if j != i}
        a = force @ rows(f"{model.kind}.{axis}", pairs).T
        if model.kind == "accel":
            a[:, 0] = force @ (model.matrix[i] / gain[i])  # a full matrix tilts the input axis of sensor x and y too
        for term, value in model.terms.items():
            if value[i]:
                powers = TERMS[model.kind][term]
                out[:, i] += value[i] * a[:, 0] ** powers[0] * a[:, 1] ** powers[1] * a[:, 2] ** powers[2]
    return out * (gain if model.counts else 1.0)
