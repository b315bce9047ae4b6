"""Instrument models with named parameters: forward, derivative, inverse.

A triad says ::

    N = S u + b + G f

with u its input (specific force or angular rate), f the specific force (gyros only), S = I + scale errors and
misalignments for readings in SI, or counts per SI unit for raw readings. S is lower triangular when the triad's own
sensors define the frame (x_b along sensor x, y_b in the plane of x and y), full when the frame is given from outside.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .errors import DataError
from .frames import Array

AXES = "xyz"
_INPUT = {"accel": "m/s^2", "gyro": "rad/s"}


@dataclass(frozen=True)
class Triad:
    """Parameterisation of one triad.

    Attributes
    ----------
    kind : str
        ``accel`` or ``gyro``.
    counts : bool
        Raw counts: ``scale_factor.i`` [count/input], misalignment S_ij/S_ii. Otherwise ``scale_error.i`` and
        misalignment S_ij.
    full : bool
        Full matrix, or lower triangular.
    g_sensitivity : bool
        Whether G is part of the model (gyros).
    """

    kind: str
    counts: bool = False
    full: bool = False
    g_sensitivity: bool = False

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Output and input axis of each misalignment."""
        return tuple((i, j) for i in range(3) for j in range(3) if (i != j if self.full else i > j))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameter names: three scales, misalignments, three biases, g-sensitivity row by row."""
        scale = "scale_factor" if self.counts else "scale_error"
        out = [f"{self.kind}.{scale}.{a}" for a in AXES]
        out += [f"{self.kind}.misalignment.{AXES[i]}{AXES[j]}" for i, j in self.pairs]
        out += [f"{self.kind}.bias.{a}" for a in AXES]
        if self.g_sensitivity:
            out += [f"{self.kind}.g_sensitivity.{i}{j}" for i in AXES for j in AXES]
        return tuple(out)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter."""
        given = _INPUT[self.kind]
        reading = "count" if self.counts else given
        scale = f"count/({given})" if self.counts else "1"
        out = [scale] * 3 + ["rad"] * len(self.pairs) + [reading] * 3
        return tuple(out + [f"{reading}/(m/s^2)".replace("rad/s/(m/s^2)", "rad*s/m")] * (9 * self.g_sensitivity))

    def pack(self, matrix: Array, bias: Array, g_matrix: Array | None = None) -> Array:
        """Parameter vector of S, b and G.

        Parameters
        ----------
        matrix : ndarray, shape (3, 3)
        bias : ndarray, shape (3,)
        g_matrix : ndarray, shape (3, 3), optional
        """
        rows, cols = np.array(self.pairs).T
        diagonal = np.diag(matrix)
        crossed = matrix[rows, cols]
        parts = [diagonal, crossed / diagonal[rows], bias] if self.counts else [diagonal - 1.0, crossed, bias]
        if self.g_sensitivity:
            parts.append(np.zeros(9) if g_matrix is None else g_matrix.ravel())
        return np.concatenate(parts)

    def unpack(self, x: Array) -> tuple[Array, Array, Array]:
        """S (3, 3), b (3,) and G (3, 3) of a parameter vector."""
        n = len(self.pairs)
        rows, cols = np.array(self.pairs).T
        diagonal = x[:3] if self.counts else 1.0 + x[:3]
        matrix = np.diag(diagonal)
        matrix[rows, cols] = x[3 : 3 + n] * (diagonal[rows] if self.counts else 1.0)
        g_matrix = x[6 + n : 15 + n].reshape(3, 3) if self.g_sensitivity else np.zeros((3, 3))
        return matrix, x[3 + n : 6 + n], g_matrix

    def derivatives(self, x: Array) -> tuple[Array, Array, Array]:
        """Derivatives of S (k, 3, 3), b (k, 3) and G (k, 3, 3) to the parameters."""
        n, k = len(self.pairs), len(self.names)
        d_matrix, d_bias, d_g = np.zeros((k, 3, 3)), np.zeros((k, 3)), np.zeros((k, 3, 3))
        for i in range(3):
            d_matrix[i, i, i] = 1.0
            d_bias[3 + n + i, i] = 1.0
        for m, (i, j) in enumerate(self.pairs):
            d_matrix[3 + m, i, j] = x[i] if self.counts else 1.0
            if self.counts:
                d_matrix[i, i, j] = x[3 + m]
        if self.g_sensitivity:
            d_g[6 + n :] = np.eye(9).reshape(9, 3, 3)
        return d_matrix, d_bias, d_g

    def scales(self, matrix: Array, size: float) -> Array:
        """Sizes that matter: one percent of the input in every parameter.

        Parameters
        ----------
        matrix : ndarray, shape (3, 3)
            A first S.
        size : float
            Magnitude of the input, SI.
        """
        gain = float(np.abs(np.diag(matrix)).max()) if self.counts else 1.0
        out = [0.01 * gain] * 3 + [0.01] * len(self.pairs) + [0.01 * gain * size] * 3
        return np.array(out + [0.01 * gain * size / 9.8] * (9 * self.g_sensitivity))


def triad_of(names: Collection[str], kind: str) -> Triad | None:
    """The triad that a set of parameter names belongs to; None when it does not hold a whole one."""
    for counts in (False, True):
        for full in (True, False):
            for g_sensitivity in (True, False):
                triad = Triad(kind, counts, full, g_sensitivity)
                if set(triad.names) <= set(names):
                    return triad
    return None


@dataclass(frozen=True)
class Correction:
    """Everything that :func:`invert` needs for one triad.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
    bias : ndarray, shape (3,)
    g_matrix : ndarray, shape (3, 3)
        G, zero for accelerometers.
    quadratic : ndarray, shape (3,)
        K2 of each accelerometer, zero for gyros.
    counts : bool
        Whether the readings are raw counts.
    """

    matrix: Array
    bias: Array
    g_matrix: Array
    quadratic: Array
    counts: bool


def correction(values: Mapping[str, float], kind: str) -> Correction | None:
    """Gather the model of one triad from named parameters; None when it has none.

    Raises
    ------
    DataError
        When a parameter of the triad is of a kind that the model does not know: leaving it out would be wrong silently.
    """
    own = {name: value for name, value in values.items() if name.startswith(f"{kind}.")}
    if not own:
        return None
    counts = any(name.startswith(f"{kind}.scale_factor.") for name in own)
    matrix, g_matrix = np.eye(3), np.zeros((3, 3))
    bias, quadratic = np.zeros(3), np.zeros(3)
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
        elif term == "k2" and len(at) == 1 and kind == "accel":
            quadratic[at[0]] = value
        else:
            raise DataError(f"the model has no term for the parameter {name!r}; it cannot be applied")
    if counts:
        matrix = np.where(np.eye(3, dtype=bool), matrix, matrix * np.diag(matrix)[:, None])
    return Correction(matrix, bias, g_matrix, quadratic, counts)


def invert(model: Correction, readings: Array, specific_force: Array | None = None) -> Array:
    """Input that gives these readings, to rounding.

    Parameters
    ----------
    model : Correction
    readings : ndarray, shape (n, 3)
        m/s^2 or rad/s, or counts.
    specific_force : ndarray, shape (n, 3), m/s^2, optional
        Needed when G is not zero.

    Returns
    -------
    ndarray, shape (n, 3), m/s^2 or rad/s

    Raises
    ------
    DataError
        When G needs the specific force and there is none, or the quadratic term has no solution near a reading.
    """
    raw = readings - model.bias
    if np.any(model.g_matrix):
        if specific_force is None:
            raise DataError(
                "the gyros are g-sensitive: compensating them needs the accelerometers of the same recording"
            )
        raw = raw - specific_force @ model.g_matrix.T
    inverse = np.linalg.inv(model.matrix)
    out = raw @ inverse.T
    if not np.any(model.quadratic):
        return out
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging iteration is refused below
        for _ in range(60):  # fixed point of u = S^-1 (raw - K2 a_I^2), a contraction while 2 K2 a_I << 1
            new = (raw - _squared(model, out @ model.matrix.T)) @ inverse.T
            done = np.all(np.abs(new - out) <= 4e-16 * (1.0 + np.abs(new)))
            out = new
            if done:
                return out
    raise DataError("the quadratic accelerometer term is too large for these readings: no input explains them")


def forward(model: Correction, u: Array, specific_force: Array | None = None) -> Array:
    """Readings for an input, the inverse of :func:`invert` (same shapes)."""
    along = u @ model.matrix.T
    out = along + model.bias + _squared(model, along)
    if specific_force is not None:
        out = out + specific_force @ model.g_matrix.T
    return out


def _squared(model: Correction, along: Array) -> Array:
    """Quadratic term of readings whose linear part is `along`: K2 a_I^2, in counts times the gain."""
    gain = np.diag(model.matrix)
    return np.asarray((gain if model.counts else 1.0) * model.quadratic * (along / gain) ** 2)


def signed_permutation(matrix: Array) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """Which input each output answers most, and with which sign.

    Parameters
    ----------
    matrix : ndarray, shape (3, 3)
        Rows are outputs.

    Returns
    -------
    axes : tuple of int
        Input axis of outputs x, y, z, each used once.
    signs : tuple of int
        +1 or -1.
    """
    from itertools import permutations

    size = np.abs(matrix) / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-300)
    best = max(permutations(range(3)), key=lambda p: sum(size[i, p[i]] for i in range(3)))
    signs = [1 if matrix[i, best[i]] > 0 else -1 for i in range(3)]
    return (best[0], best[1], best[2]), (signs[0], signs[1], signs[2])
