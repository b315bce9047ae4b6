"""What a target cannot hold, and how much it matters.

Whatever a target computes is affine in the reading: ``u' = A y - c - B f'``, with f' its own specific force. Put the instrument
``y = S u + b + G f + h(f)`` in, and the error that is left is ::

    u' - u = (A S - I) u + (A b - c) + (A G - B) f + A h(f) - B (f' - f)

Each part is bounded over all inputs up to 1 g and 100 deg/s, so that the error of a sample is never larger than the sum of
the sizes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..frames import Array
from ..sensors import AXES, INPUT, TERMS
from ..sensors.axis import rows
from .canonical import Linear
from .record import FORCE, RATE, Dropped

_ROUNDING = 1e-13


@dataclass(frozen=True)
class Held:
    """What a target computes from a reading: u' = A y - c - B f'.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
        A.
    offset : ndarray, shape (3,)
        c, SI.
    g_matrix : ndarray, shape (3, 3)
        B.
    stored : tuple of ndarray, optional
        A and c with the digits that the target keeps.
    """

    matrix: Array
    offset: Array
    g_matrix: Array
    stored: tuple[Array, Array] | None = None


def nothing() -> Held:
    """A target that takes the readings as they are."""
    return Held(np.eye(3), np.zeros(3), np.zeros((3, 3)))


def whole(triad: Linear) -> Held:
    """A target that holds the canonical correction."""
    return Held(triad.matrix, triad.matrix @ triad.bias, triad.matrix @ triad.g_matrix)


def lost(triads: Mapping[str, Linear], held: Mapping[str, Held]) -> tuple[Dropped, ...]:
    """What is dropped, with its size.

    Parameters
    ----------
    triads : mapping of str to Linear
    held : mapping of str to Held
        For each of them.
    """
    out: list[Dropped] = []
    force_error = 0.0
    for kind, triad in triads.items():
        target = held[kind]
        parts = sorted(_parts(triad, target), key=lambda part: -part[1])
        through = float(np.linalg.norm(target.g_matrix, 2)) * force_error
        if through > 0:
            parts.append(("error of the specific force through the g-sensitivity", through))
        quiet = None if triad.noise is None else float(triad.noise.min())
        sizes = [
            Dropped(kind, what, size, INPUT[kind], None if quiet is None else size / quiet) for what, size in parts
        ]
        if kind == "accel":
            force_error = sum(d.size for d in sizes)
        out += sizes
    return tuple(out)


def _parts(triad: Linear, target: Held) -> Iterator[tuple[str, float]]:
    """Names and sizes of the parts of the error of one triad that are above rounding."""
    A, S = target.matrix, triad.forward
    size = FORCE if triad.kind == "accel" else RATE
    error = A @ S - np.eye(3)
    diagonal = np.diag(np.diag(error))
    rounding = _ROUNDING * float(np.linalg.cond(S)) * size
    parts = {
        "scale": (float(np.abs(diagonal).max()) * size, rounding),
        "misalignment (cross terms)": (_norm(error - diagonal) * size, rounding),
        "bias": (_length(A @ triad.bias - target.offset), _ROUNDING * _length(np.abs(A) @ np.abs(triad.bias))),
        "g-sensitivity": (
            _norm(A @ triad.g_matrix - target.g_matrix) * FORCE,
            _ROUNDING * _norm(np.abs(A) @ np.abs(triad.g_matrix)) * FORCE,
        ),
    }
    if target.stored is not None:
        change = target.stored[0] - A, target.stored[1] - target.offset
        rest = _norm(change[0] @ S) * size + _length(change[0] @ triad.bias - change[1])
        parts["digits beyond single precision"] = (rest, 0.0)
    for term, coefficients in triad.higher.items():
        parts[term.replace("_", " ")] = (_higher(triad, A, term, coefficients), 0.0)
    yield from ((what, value) for what, (value, least) in parts.items() if value > least)


def _higher(triad: Linear, A: Array, term: str, coefficients: Array) -> float:
    """Largest error that a further term leaves when it is not corrected."""
    S = triad.forward
    gain = np.diag(S)
    largest = np.zeros(3)
    for i, axis in enumerate(AXES):
        pairs = {f"{axis}{AXES[j]}": S[i, j] / gain[i] for j in range(3) if j != i}
        own = rows(f"{triad.kind}.{axis}", pairs)
        if triad.kind == "accel":
            own[0] = S[i] / gain[i]
        powers = TERMS[triad.kind][term]
        largest[i] = abs(coefficients[i]) * _monomial(own, powers) * (abs(gain[i]) if triad.counts else 1.0)
    return _length(np.abs(A) @ largest)


def _monomial(own: Array, powers: tuple[int, int, int]) -> float:
    """Largest value of a product of powers of two or three forces along given directions, at :data:`FORCE`.

    Of the product of two different ones, (a u)(b u), it is (|a||b| + |a b|)/2, the largest eigenvalue of its quadratic form.
    """
    factors = [own[k] for k, power in enumerate(powers) for _ in range(power)]
    if len(factors) == 2:
        a, b = factors
        return (_length(a) * _length(b) + abs(float(a @ b))) / 2.0 * FORCE**2
    return float(np.prod([_length(a) * FORCE for a in factors]))


def _norm(matrix: Array) -> float:
    return float(np.linalg.norm(matrix, 2))


def _length(vector: Array) -> float:
    return float(np.linalg.norm(vector))
