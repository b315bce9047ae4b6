"""The result: named parameters with their covariance, how the fit went, where it came from. JSON in and out.

The JSON Schema of the file is :data:`SCHEMA_FILE`, published with the package.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from . import results
from .files import sha256
from .frames import Array
from .printed import printed, probability
from .results import Record, Software, Source

SCHEMA = "sagnac/calibration/1"
SCHEMA_FILE = Path(__file__).with_name("calibration-1.schema.json")


class Value(Record):
    """One parameter; `unit` is SI or counts."""

    name: str
    value: float
    unit: str
    standard_uncertainty: float = Field(ge=0)


class Influence(Record):
    """What one segment does to the result (see :class:`sagnac.estimate.Influence`)."""

    segment: str
    leverage: float
    chi2: float
    shift: float | None
    parameter: str
    rows: int | None = None
    """Readings of the segment that the fit used; the chi-square expected of it is their number less the leverage."""


class Scatter(Record):
    """Residuals of one kind of reading."""

    rms: float
    unit: str
    count: int


class Fit(Record):
    """How well the model describes the data.

    ``residual_rms`` is that of the whitened residuals: one when the stated noise explains them. ``white``,
    ``cluster`` and ``delete_one`` are standard uncertainties in the order of the parameters from the noise alone, from
    the scatter of whole segments, and from leaving out one segment at a time; ``uncertainty`` says which the result uses.
    """

    chi2: float
    degrees_of_freedom: int
    residual_rms: float
    converged: bool
    iterations: int
    p_value: float | None = None
    condition: float | None = None
    uncertainty: str = "white"
    white: tuple[float, ...] | None = None
    cluster: tuple[float, ...] | None = None
    delete_one: tuple[float, ...] | None = None
    residuals: dict[str, Scatter] = Field(default_factory=dict)
    influence: tuple[Influence, ...] = ()


class BudgetLine(Record):
    """Contribution of one source to each parameter's standard uncertainty, in the order of the parameters."""

    source: str
    standard_uncertainty: tuple[float, ...]


class UnitName(Record):
    """Which unit was calibrated, and the nominal scale factors that its counts were read with."""

    model: str = ""
    serial: str = ""
    scale: dict[str, str] = Field(default_factory=dict)


class Site(Record):
    """Latitude [rad], height [m], gravity [m/s^2], Earth rate [rad/s]."""

    latitude: float | None = None
    height: float = 0.0
    gravity: float
    gravity_source: str = ""
    earth_rate: float | None = None


class NoiseLevel(Record):
    """Noise of the axes x, y, z: density of white noise in `unit`, and where it is known from.

    Slow noise where it is known: bias instability B of IEEE Std 952 (in the unit of the readings) and random walk K of the bias
    (the same per sqrt(s)); zero where a test found none. `walk_limit` is what K stays below with 95 % probability.
    """

    density: tuple[float, float, float]
    unit: str
    origin: Literal["plan", "recording", "noise test"]
    instability: tuple[float, float, float] | None = None
    walk: tuple[float, float, float] | None = None
    walk_limit: tuple[float, float, float] | None = None


class Range(Record):
    """Mean and extremes of a quantity over the recording."""

    mean: float
    minimum: float
    maximum: float


class Environment(Record):
    """What the recording tells of its surroundings: temperature [K]."""

    temperature: Range | None = None


class Calibration(Record):
    """A calibration. :func:`load` reads one, :meth:`save` writes it."""

    schema_id: Literal["sagnac/calibration/1"] = Field(default="sagnac/calibration/1", alias="schema")
    method: str
    unit: UnitName = UnitName()
    misalignment: Literal["element", "input-axis"] = "element"
    """What a misalignment is: element S_ij of the matrix (raw counts: S_ij/S_ii), or S_ij/S_ii, where the input axis points."""
    parameters: tuple[Value, ...] = Field(min_length=1)
    covariance: tuple[tuple[float, ...], ...]
    fit: Fit
    budget: tuple[BudgetLine, ...] = ()
    noise: dict[Literal["accel", "gyro"], NoiseLevel] = Field(default_factory=dict)
    rig: dict[str, str] = Field(default_factory=dict)
    """The rig and how far it can be trusted, in the words of the plan."""
    environment: Environment = Environment()
    site: Site
    source: tuple[Source, ...] = ()
    remarks: tuple[str, ...] = ()
    software: Software
    created: str

    @model_validator(mode="after")
    def _square(self) -> Self:
        n = len(self.parameters)
        results.check_covariance(self.parameters, self.covariance)
        for what, values in (
            *((line.source, line.standard_uncertainty) for line in self.budget),
            *((kind, getattr(self.fit, kind)) for kind in ("white", "cluster", "delete_one")),
        ):
            if values is not None and len(values) != n:
                raise ValueError(f"{what!r} gives {len(values)} standard uncertainties for {n} parameters")
        return self

    def values(self) -> dict[str, float]:
        """Parameter values by name, SI or counts."""
        return {p.name: p.value for p in self.parameters}

    def __getitem__(self, name: str) -> Value:
        """Parameter by name."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise KeyError(f"{name!r} is not in this calibration; it has: {', '.join(self.values())}")

    @property
    def matrix(self) -> Array:
        """Covariance as an array, shape (k, k)."""
        return np.array(self.covariance).reshape(len(self.parameters), -1)

    def to_json(self) -> str:
        """The file's text; numbers are written so that they read back exactly."""
        return results.to_json(self)

    def with_source(self, path: str | Path, role: Literal["plan", "prior"]) -> Self:
        """The same with one more file named among its sources."""
        more = Source(file=str(path), sha256=sha256(path), role=role)
        return self.model_copy(update={"source": (*self.source, more)})

    def save(self, path: str | Path) -> None:
        """Write the JSON file, whole or not at all."""
        results.save(self, path)

    def summary(self) -> str:
        """The result as a page of text, like a laboratory's report."""
        return _summary(self)


def loads(text: str, source: str = "calibration") -> Calibration:
    """A calibration from JSON text, see :func:`load`."""
    return results.loads(Calibration, SCHEMA, "a calibration", text, source)


def load(path: str | Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    InputError
        When the file cannot be read, is no calibration, or is of a version that this one does not know.
    """
    return loads(results.read_text(path, "calibration"), str(path))


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above."""
    return results.json_schema(Calibration, SCHEMA)


def _summary(cal: Calibration) -> str:
    head = [f"Calibration by {cal.method}", ""]
    if cal.unit.model or cal.unit.serial:
        head.append(f"  unit        {cal.unit.model} {cal.unit.serial}".rstrip())
    head += [f"  {s.role:<10}  {s.file}" + (f"  sha256 {s.sha256[:12]}..." if s.sha256 else "") for s in cal.source]
    gravity = f"{cal.site.gravity:.6f} m/s^2"
    head.append(f"  gravity     {gravity}" + (f" ({cal.site.gravity_source})" if cal.site.gravity_source else ""))
    head += ["", f"  {'parameter':<28}{'value':>14}  {'std. unc.':>11}  {'unit':<16}"]
    for p in cal.parameters:
        value, sigma, unit = printed(p.value, p.standard_uncertainty, p.unit)
        head.append(f"  {p.name:<28}{value:>14}  {sigma:>11}  {unit:<16}".rstrip())
    return "\n".join([*head, "", *_fit_lines(cal), *_strongest(cal), *_budget_lines(cal), *_remark_lines(cal)]) + "\n"


def _fit_lines(cal: Calibration) -> list[str]:
    fit = cal.fit
    p_text = "" if fit.p_value is None else f", probability {probability(fit.p_value)}"
    lines = [f"  chi-square {fit.chi2:.4g} for {fit.degrees_of_freedom} degrees of freedom{p_text}"]
    if fit.degrees_of_freedom == 0:
        lines = ["  as many readings as unknowns: nothing is left to judge the fit by"]
    meaning = {
        "white": "the noise explains the scatter between segments; uncertainties follow from it",
        "scaled": "from the noise, scaled by the scatter of the residuals, which it does not explain or which is all there is",
        "delete-one-segment": "from leaving out one segment at a time: noise does not explain the scatter, or is not known",
    }
    lines += [
        f"  uncertainty: {used} ({meaning.get(used.rpartition(': ')[2], 'see the documentation')})"
        for used in fit.uncertainty.split(" / ")
    ]
    for kind, scatter in fit.residuals.items():
        rms, unit = f"{scatter.rms:.3g}", ""  # a ratio
        if scatter.unit:
            rms, _, unit = printed(scatter.rms, scatter.rms / 30, scatter.unit)
        lines.append(f"  residual {kind}: {rms} {unit}".rstrip() + f" rms over {scatter.count}")
    if fit.condition is not None:
        lines.append(f"  condition {fit.condition:.3g}, {fit.iterations} iterations")
    return lines


def _strongest(cal: Calibration) -> list[str]:
    if not cal.fit.influence:
        return []
    top = max(cal.fit.influence, key=lambda i: i.shift if i.shift is not None else math.inf)
    if top.shift is None:
        return [f"  without segment {top.segment!r} the parameters would not be determined"]
    return [
        f"  most influence: segment {top.segment!r} moves {top.parameter} by {top.shift:.2g} standard uncertainties"
    ]


def _budget_lines(cal: Calibration) -> list[str]:
    """One row a parameter, one column a source: its share of the variance."""
    if not cal.budget:
        return []
    columns = "".join(f"{f'({k})':>8}" for k in range(1, len(cal.budget) + 1))
    lines = ["", f"  {'share of the variance [%]':<28}{columns}"]
    for i, p in enumerate(cal.parameters):
        if p.standard_uncertainty > 0:
            shares = [line.standard_uncertainty[i] / p.standard_uncertainty for line in cal.budget]
            lines.append(f"  {p.name:<28}" + "".join(f"{_percent(100 * s * s):>8}" for s in shares))
    return [*lines, *(f"  ({k}) {line.source}" for k, line in enumerate(cal.budget, 1))]


def _percent(share: float) -> str:
    if share == 0:
        return "-"
    return f"{share:.0f}" if share >= 1 else "<1"


def _remark_lines(cal: Calibration) -> list[str]:
    return ["", *(f"  note: {r}" for r in cal.remarks)] if cal.remarks else []


def named(names: Sequence[str], given: Sequence[str], values: Array, covariance: Array) -> tuple[Value, ...]:
    """Records of parameters from parallel arrays (names, units, values (k,), covariance (k, k))."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return tuple(
        Value(name=n, value=float(v), unit=u, standard_uncertainty=float(s))
        for n, u, v, s in zip(names, given, values, sigma, strict=True)
    )
