"""Two calibrations in the same terms: what can be compared as it is, what is converted first, what is left out and why.

Parameters of one name need not be one quantity. A misalignment is an element S_ij or the direction S_ij/S_ii of an input axis; a
bias is in counts or in SI; the matrix stands in the frame of the mounting faces (full) or in the accelerometers' own (lower
triangular). The conversions are exact, and the covariance goes with them by derivatives:

- misalignments to directions of input axes, S_ij/S_ii;
- biases and g-sensitivities to the input, b_i/S_ii, where one calibration is for raw counts;
- matrices to the accelerometers' frame, S_k = L C with L lower triangular, the gyros with them, where one has them so already.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..calibration import Calibration, Value, named
from ..frames import Array
from ..sensors import INPUT, Triad, triad_of

_STEP = 1e-6
"""Of central differences, relative to one for angles and ratios: error 1e-12."""
_RATIO = "directions of input axes"
_INPUT = "referred to the input"
_FRAME = "in the accelerometers' frame"


@dataclass(frozen=True)
class Terms:
    """Parameters of a calibration in some terms.

    Attributes
    ----------
    values : dict of str to float
        By name.
    units : dict of str to str
    covariance : ndarray, shape (k, k)
        In the order of `values`.
    """

    values: dict[str, float]
    units: dict[str, str]
    covariance: Array

    def part(self, names: list[str]) -> tuple[Array, Array]:
        """Values (m,) and covariance (m, m) of some parameters."""
        every = list(self.values)
        at = [every.index(n) for n in names]
        return np.array([self.values[n] for n in names]), self.covariance[np.ix_(at, at)]


@dataclass(frozen=True)
class Alike:
    """Two calibrations in the same terms.

    Attributes
    ----------
    before, after : Terms
    common : tuple of str
        Parameters that both have, in the order of `after`.
    converted : dict of str to str
        What was done to some of them.
    left_out : dict of str to str
        The others, and why they are not compared.
    """

    before: Terms
    after: Terms
    common: tuple[str, ...]
    converted: dict[str, str]
    left_out: dict[str, str]

    def pairs(self) -> list[tuple[Value, Value]]:
        """Each common parameter before and after."""
        sides = []
        for terms in (self.before, self.after):
            values, covariance = terms.part(list(self.common))
            units = [terms.units[n] for n in self.common]
            sides.append(named(self.common, units, values, covariance))
        return list(zip(*sides, strict=True))


def alike(before: Calibration, after: Calibration) -> Alike:
    """Two calibrations in the same terms.

    Parameters
    ----------
    before, after : Calibration

    Returns
    -------
    Alike
    """
    both = before, after
    steps: tuple[list[str], list[str]] = ([], [])
    dropped: dict[str, str] = {}
    _frames(both, steps, dropped)
    ratios = tuple(_ratio(c) for c in both)
    if any(".misalignment." in n for n in after.values()) and ratios[0] != ratios[1]:
        steps[ratios.index(False)].append(_RATIO)
    for kind in INPUT:
        raw = [any(n.startswith(f"{kind}.scale_factor.") for n in c.values()) for c in both]
        if raw[0] != raw[1]:
            for own in steps:
                own.append(f"{kind} {_INPUT}")
    made = [_converted(c, own) for c, own in zip(both, steps, strict=True)]
    common, left_out = [], {}
    for name in [*made[1].values, *(n for n in made[0].values if n not in made[1].values)]:
        reason = dropped.get(name.rpartition(".")[0]) or _unlike(name, made[0], made[1])
        if reason:
            left_out[name] = reason
        else:
            common.append(name)
    return Alike(made[0], made[1], tuple(common), _said(common, steps), left_out)


def _ratio(calibration: Calibration) -> bool:
    """Whether its misalignments are directions; those of raw counts always are."""
    return calibration.misalignment == "input-axis" or any(".scale_factor." in n for n in calibration.values())


def _unlike(name: str, before: Terms, after: Terms) -> str:
    """Why a parameter cannot be compared; empty when it can."""
    for terms, which in ((before, "first"), (after, "second")):
        if name not in terms.values:
            return f"not in the {which} calibration"
    units = before.units[name], after.units[name]
    return "" if units[0] == units[1] else f"in {units[0]} and in {units[1]}"


def _frames(both: tuple[Calibration, Calibration], steps: tuple[list[str], list[str]], dropped: dict[str, str]) -> None:
    """See that matrices stand in one frame, or that their misalignments are not compared."""
    full = [_is_full(c, "accel") for c in both]
    if None not in full and full[0] != full[1]:
        which = full.index(True)
        if _whole(both[which]):
            steps[which].append(_FRAME)
        else:
            reason = "in the frame of the mounting faces and in the accelerometers' own"
            dropped |= {"accel.misalignment": reason, "gyro.misalignment": reason}
    gyros = [_is_full(c, "gyro") for c in both]
    if None not in gyros and gyros[0] != gyros[1]:
        dropped["gyro.misalignment"] = "in the gyros' own frame and in another one"


def _is_full(calibration: Calibration, kind: str) -> bool | None:
    """Whether the matrix of a triad is full; None where there is no misalignment."""
    pairs = {n.rpartition(".")[2] for n in calibration.values() if n.startswith(f"{kind}.misalignment.")}
    return bool(pairs & {"xy", "xz", "yz"}) if pairs else None


def _whole(calibration: Calibration) -> bool:
    """Whether its matrices can be turned: whole full triads."""
    ratio = _ratio(calibration)
    triads = [triad_of(calibration.values(), kind, ratio=ratio) for kind in INPUT]
    there = [any(n.startswith(f"{kind}.misalignment.") for n in calibration.values()) for kind in INPUT]
    return triads[0] is not None and all(t is not None and t.full for t, own in zip(triads, there, strict=True) if own)


def _said(common: list[str], steps: tuple[list[str], list[str]]) -> dict[str, str]:
    """What was done to each parameter."""
    done = {s for own in steps for s in own}
    out = {}
    for name in common:
        kind, term = name.split(".")[0], name.split(".")[1] if "." in name else ""
        words = []
        if _FRAME in done and term in ("misalignment", "scale_error", "g_sensitivity", "scale_factor"):
            words.append(_FRAME)
        if _RATIO in done and term == "misalignment":
            words.append(_RATIO)
        if f"{kind} {_INPUT}" in done and term in ("bias", "g_sensitivity"):
            words.append(_INPUT)
        if words:
            out[name] = ", ".join(words)
    return out


_Change = Callable[[dict[str, float]], dict[str, float]]


def _converted(calibration: Calibration, steps: list[str]) -> Terms:
    """A calibration after some conversions."""
    values, units = calibration.values(), {p.name: p.unit for p in calibration.parameters}
    if not steps:
        return Terms(values, units, calibration.matrix)
    ratio = _ratio(calibration)

    def change(x: dict[str, float]) -> dict[str, float]:
        for step in steps:
            x = _in_own_frame(x, ratio) if step == _FRAME else _to_ratio(x) if step == _RATIO else _to_input(x, step)
        return x

    new = change(values)
    jacobian = np.empty((len(new), len(values)))
    for i, (name, value) in enumerate(values.items()):
        size = _STEP * (abs(value) if ".scale_factor." in name else 1.0)
        ahead, behind = (change({**values, name: value + s}) for s in (size, -size))
        jacobian[:, i] = (np.array(list(ahead.values())) - np.array(list(behind.values()))) / (2 * size)
    for step in steps:
        units = units if not step.endswith(_INPUT) else _input_units(units, step.partition(" ")[0])
    covariance = jacobian @ calibration.matrix @ jacobian.T
    return Terms(new, {n: units[n] for n in new}, (covariance + covariance.T) / 2)


def _gain(values: Mapping[str, float], kind: str, axis: str) -> float:
    """S_ii; one where the calibration does not tell."""
    factor = values.get(f"{kind}.scale_factor.{axis}")
    return factor if factor is not None else 1.0 + values.get(f"{kind}.scale_error.{axis}", 0.0)


def _to_ratio(values: dict[str, float]) -> dict[str, float]:
    out = dict(values)
    for name, value in values.items():
        kind, _, pair = name.partition(".misalignment.")
        if pair:
            out[name] = value / _gain(values, kind, pair[0])
    return out


def _to_input(values: dict[str, float], step: str) -> dict[str, float]:
    kind, out = step.partition(" ")[0], dict(values)
    for name, value in values.items():
        if name.startswith((f"{kind}.bias.", f"{kind}.g_sensitivity.")):
            out[name] = value / _gain(values, kind, name.rpartition(".")[2][0])
    return out


def _input_units(units: dict[str, str], kind: str) -> dict[str, str]:
    si = {"bias": INPUT[kind], "g_sensitivity": "rad*s/m"}
    return {n: si.get(n.split(".")[1], u) if n.startswith(f"{kind}.") else u for n, u in units.items()}


def _in_own_frame(values: dict[str, float], ratio: bool) -> dict[str, float]:
    """Matrices in the frame that the accelerometers define: accelerometer x along x, y in the plane of x and y."""
    out, turn = dict(values), np.eye(3)
    for kind in INPUT:
        triad = triad_of(values, kind, ratio=ratio)
        if triad is None:
            continue
        matrix, bias, g_matrix = triad.unpack(np.array([values[n] for n in triad.names]))
        if kind == "accel":
            q, r = np.linalg.qr(matrix.T)
            turn = q * np.sign(np.diag(r) * np.diag(matrix))
        own = Triad(kind, triad.counts, kind == "gyro" and triad.full, triad.g_sensitivity, ratio)
        for name in triad.names:
            del out[name]
        out |= dict(zip(own.names, map(float, own.pack(matrix @ turn, bias, g_matrix @ turn)), strict=True))
    return out
