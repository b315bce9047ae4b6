"""One sensor with all the terms of the standards, as polynomial in the specific force along its own axes.

Accelerometer with input axis I, pendulous axis P and output axis O (IEEE Std 1293)::

    y = K0 + (1 + K1) a_I + K2 a_I^2 + K3 a_I^3 + Kip a_I a_P + Kio a_I a_O + Kpo a_P a_O

Gyro with input axis I, output axis O and spin (or third) axis S (IEEE Std 517)::

    y = (1 + dK) w_I + DF + DI a_I + DO a_O + DS a_S + DII a_I^2 + DOO a_O^2 + DSS a_S^2
      + DIO a_I a_O + DIS a_I a_S + DOS a_O a_S

The rows that give a_I and its companions are those of [XU18] with small misalignments: ``misalignment.zx`` is what the
input axis of sensor z has along x. A term is one line of :data:`TERMS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

TERMS: dict[str, dict[str, tuple[int, int, int]]] = {
    "accel": {
        "bias": (0, 0, 0),
        "scale_error": (1, 0, 0),
        "k2": (2, 0, 0),
        "k3": (3, 0, 0),
        "kip": (1, 1, 0),
        "kio": (1, 0, 1),
        "kpo": (0, 1, 1),
    },
    "gyro": {
        "bias": (0, 0, 0),
        "d_i": (1, 0, 0),
        "d_o": (0, 1, 0),
        "d_s": (0, 0, 1),
        "d_ii": (2, 0, 0),
        "d_oo": (0, 2, 0),
        "d_ss": (0, 0, 2),
        "d_io": (1, 1, 0),
        "d_is": (1, 0, 1),
        "d_os": (0, 1, 1),
    },
}
"""Powers of the specific force along the three axes of an accelerometer (I, P, O) and of a gyro (I, O, S)."""

# rows of the three axes in the frame p of the unit, and what each misalignment adds ([XU18])
_ROWS: dict[str, tuple[tuple[tuple[int, ...], ...], dict[str, tuple[tuple[int, int, int], ...]]]] = {
    # sensor: rows, then misalignment -> (row, column, sign) of each place where it stands
    "accel.x": (((1, 0, 0), (0, 1, 0), (0, 0, 1)), {}),
    "accel.y": (((0, 1, 0), (0, 0, -1), (-1, 0, 0)), {"yx": ((0, 0, 1), (2, 1, 1))}),
    "accel.z": (
        ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
        {"zx": ((0, 0, 1), (2, 2, 1)), "zy": ((0, 1, 1), (1, 2, -1))},
    ),
    "gyro.x": (
        ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
        {"xy": ((0, 1, 1), (2, 0, -1)), "xz": ((0, 2, 1), (1, 0, 1))},
    ),
    "gyro.y": (
        ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
        {"yx": ((0, 0, 1), (2, 1, 1)), "yz": ((0, 2, 1), (1, 1, 1))},
    ),
    "gyro.z": (
        ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
        {"zx": ((0, 0, 1), (1, 2, -1)), "zy": ((0, 1, 1), (2, 2, -1))},
    ),
}

Numbers = NDArray[Any]
"""Real, or complex for derivatives by a complex step."""


class Reading(NamedTuple):
    """What a sensor says, and how that changes."""

    value: Numbers
    """(n,), m/s^2 or rad/s."""
    to_parameters: Numbers
    """(n, k)."""
    to_force: Numbers
    """(n, 3), by the specific force in p."""
    to_rate: Numbers
    """(n, 3), by the angular rate in p; zero for accelerometers."""


def rows(sensor: str, misalignment: dict[str, Any]) -> Numbers:
    """Directions of the three axes of a sensor in p.

    Parameters
    ----------
    sensor : str
        ``accel.x`` to ``gyro.z``.
    misalignment : dict of str to float, rad
        ``{"zx": ...}``; those that the sensor does not have are not looked at.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows I, P, O of an accelerometer; I, O, S of a gyro.
    """
    base, places = _ROWS[sensor]
    out = np.array(base, dtype=np.result_type(float, *misalignment.values()))
    for pair, where in places.items():
        for row, column, sign in where:
            out[row, column] += sign * misalignment.get(pair, 0.0)
    return out


def unit_of(kind: str, term: str) -> str:
    """SI unit of a coefficient.

    Parameters
    ----------
    kind : str
        ``accel`` or ``gyro``.
    term : str
        A key of :data:`TERMS`, ``scale_error`` or ``misalignment``.
    """
    if term in ("scale_error", "misalignment"):
        return {"scale_error": "1", "misalignment": "rad"}[term]
    order = sum(TERMS[kind][term])
    if kind == "accel":
        return ("m/s^2", "1", "s^2/m", "s^4/m^2")[order]
    return ("rad/s", "rad*s/m", "rad*s^3/m^2")[order]


@dataclass(frozen=True)
class Axis:
    """Parameterisation of one sensor.

    Attributes
    ----------
    kind : str
        ``accel`` or ``gyro``.
    axis : str
        ``x``, ``y`` or ``z``.
    terms : tuple of str
        Which coefficients are parameters: keys of :data:`TERMS`, and ``scale_error`` for a gyro.
    misalignments : tuple of str
        Which misalignments are parameters, ``("zx", "zy")``.
    """

    kind: str
    axis: str
    terms: tuple[str, ...]
    misalignments: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what the sensor does not have."""
        known = {*TERMS[self.kind], "scale_error"}
        if not known.issuperset(self.terms) or not set(_ROWS[self.sensor][1]).issuperset(self.misalignments):
            raise ValueError(f"{self.sensor} has no such terms among {self.terms} and {self.misalignments}")

    @property
    def sensor(self) -> str:
        """``accel.x`` to ``gyro.z``."""
        return f"{self.kind}.{self.axis}"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters: terms, then misalignments."""
        terms = tuple(f"{self.kind}.{term}.{self.axis}" for term in self.terms)
        return terms + tuple(f"{self.kind}.misalignment.{pair}" for pair in self.misalignments)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter."""
        return tuple(unit_of(self.kind, t) for t in self.terms) + ("rad",) * len(self.misalignments)

    def scales(self, force: float) -> NDArray[np.float64]:
        """Sizes that matter: one percent of the largest input in every parameter.

        Parameters
        ----------
        force : float, m/s^2
            Largest specific force. For a gyro, one percent of one degree per second stands for its input.
        """
        whole = force if self.kind == "accel" else np.pi / 180
        out = [0.01 * (1.0 if t == "scale_error" else whole / force ** sum(TERMS[self.kind][t])) for t in self.terms]
        return np.array(out + [0.01] * len(self.misalignments))

    def evaluate(self, x: Numbers, force: Numbers, rate: Numbers, fixed: dict[str, float] | None = None) -> Reading:
        """Readings and derivatives.

        Parameters
        ----------
        x : ndarray, shape (k,)
            Parameters in the order of `names`.
        force, rate : ndarray, shape (n, 3), m/s^2 and rad/s
            Inputs in p.
        fixed : dict of str to float, optional
            Other parameters of the sensor by name, held where they are; absent ones are zero.

        Returns
        -------
        Reading
        """
        values: dict[str, Any] = dict(fixed or {}) | dict(zip(self.names, x, strict=True))
        pairs = {p: values.get(f"{self.kind}.misalignment.{p}", 0.0) for p in _ROWS[self.sensor][1]}
        c = rows(self.sensor, pairs)
        a = force @ c.T
        w = rate @ c[0]
        coefficient = {t: values.get(f"{self.kind}.{t}.{self.axis}", 0.0) for t in TERMS[self.kind]}
        gain = 1.0 + values.get(f"{self.kind}.scale_error.{self.axis}", 0.0)
        if self.kind == "accel":
            coefficient["scale_error"] = gain
        basis = {t: _monomial(a, p) for t, p in TERMS[self.kind].items()}
        value = sum(coefficient[t] * basis[t] for t in basis)
        to_a = sum(coefficient[t] * _slopes(a, p) for t, p in TERMS[self.kind].items())
        to_w = np.zeros_like(w)
        if self.kind == "gyro":
            value = value + gain * w
            to_w = gain + np.zeros_like(w)
            basis["scale_error"] = w
        columns = [basis[t] for t in self.terms]
        for pair in self.misalignments:
            change = np.zeros((3, 3))
            for row, column, sign in _ROWS[self.sensor][1][pair]:
                change[row, column] = sign
            columns.append(np.sum(to_a * (force @ change.T), axis=1) + to_w * (rate @ change[0]))
        return Reading(
            value, np.stack(columns, axis=1) if columns else np.zeros((len(a), 0)), to_a @ c, to_w[:, None] * c[0]
        )


def _monomial(a: Numbers, powers: tuple[int, int, int]) -> Numbers:
    """Product of powers of the columns of a, (n,)."""
    out = np.ones(len(a), dtype=a.dtype)
    for k, power in enumerate(powers):
        for _ in range(power):
            out = out * a[:, k]
    return out


def _slopes(a: Numbers, powers: tuple[int, int, int]) -> Numbers:
    """Derivative of :func:`_monomial` to each column, (n, 3)."""
    out = np.zeros(a.shape, dtype=a.dtype)
    for k, power in enumerate(powers):
        if power:
            less = (powers[0] - (k == 0), powers[1] - (k == 1), powers[2] - (k == 2))
            out[:, k] = power * _monomial(a, less)
    return out
