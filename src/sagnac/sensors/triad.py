"""Three sensors as one linear instrument with named parameters.

A triad says ::

    N = S u + b + G f

with u its input (specific force or angular rate), f the specific force (gyros only), S = I + scale errors and
misalignments for readings in SI, or counts per SI unit for raw readings. S is lower triangular when the triad's own
sensors define the frame (x_b along sensor x, y_b in the plane of x and y), full when the frame is given from outside.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..frames import Array

AXES = "xyz"
INPUT = {"accel": "m/s^2", "gyro": "rad/s"}
"""SI unit of what each kind of sensor measures."""


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
    ratio : bool
        Misalignments as those of the input axes, S_ij/S_ii, in SI too (raw counts always have them so).
    """

    kind: str
    counts: bool = False
    full: bool = False
    g_sensitivity: bool = False
    ratio: bool = False

    @property
    def _relative(self) -> bool:
        return self.counts or self.ratio

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
        given = INPUT[self.kind]
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
        parts = [
            diagonal if self.counts else diagonal - 1.0,
            crossed / diagonal[rows] if self._relative else crossed,
            bias,
        ]
        if self.g_sensitivity:
            parts.append(np.zeros(9) if g_matrix is None else g_matrix.ravel())
        return np.concatenate(parts)

    def unpack(self, x: Array) -> tuple[Array, Array, Array]:
        """S (3, 3), b (3,) and G (3, 3) of a parameter vector."""
        n = len(self.pairs)
        rows, cols = np.array(self.pairs).T
        diagonal = x[:3] if self.counts else 1.0 + x[:3]
        matrix = np.diag(diagonal)
        matrix[rows, cols] = x[3 : 3 + n] * (diagonal[rows] if self._relative else 1.0)
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
            gain = x[i] if self.counts else 1.0 + x[i]
            d_matrix[3 + m, i, j] = gain if self._relative else 1.0
            if self._relative:
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


def triad_of(names: Collection[str], kind: str, *, ratio: bool = False) -> Triad | None:
    """The triad that a set of parameter names belongs to; None when it does not hold a whole one."""
    for counts in (False, True):
        for full in (True, False):
            for g_sensitivity in (True, False):
                triad = Triad(kind, counts, full, g_sensitivity, ratio)
                if set(triad.names) <= set(names):
                    return triad
    return None


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
