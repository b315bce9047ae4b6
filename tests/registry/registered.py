"""Calibrations to register."""

from __future__ import annotations

from sagnac.calibration import Calibration, Fit, Site, UnitName, Value
from sagnac.registry.candidates import NOTHING, of_content
from sagnac.results import Software

MG = 9.80665e-3
DAY = "2025-03-{:02d}T12:00:00+00:00"
FIRST = DAY.format(1)


def calibration(serial="0001", created=FIRST, model="LG-1", *, bias=0.5 * MG, sigma=0.01 * MG, **other) -> Calibration:
    """Four parameters, uncorrelated."""
    parameters = (
        Value(name="accel.bias.x", value=bias, unit="m/s^2", standard_uncertainty=sigma),
        Value(name="accel.bias.y", value=-2 * bias, unit="m/s^2", standard_uncertainty=sigma),
        Value(name="accel.scale_error.x", value=1e-4, unit="1", standard_uncertainty=1e-6),
        Value(name="accel.misalignment.xy", value=2e-4, unit="rad", standard_uncertainty=1e-6),
    )
    given = {
        "method": "norm",
        "unit": UnitName(model=model, serial=serial),
        "parameters": parameters,
        "fit": Fit(chi2=9.0, degrees_of_freedom=10, residual_rms=1.0, converged=True, iterations=3),
        "site": Site(gravity=9.81),
        "software": Software(version="1.2.3"),
        "created": created,
    } | other
    kept = given["parameters"]
    n = range(len(kept))
    covariance = tuple(tuple(kept[i].standard_uncertainty ** 2 if i == j else 0.0 for j in n) for i in n)
    return Calibration(covariance=covariance, **given)


def content(*args, **other) -> bytes:
    """The file of :func:`calibration`."""
    return calibration(*args, **other).to_json().encode()


def candidate(*args, lacking=NOTHING, **other):
    """A candidate of :func:`calibration`."""
    return of_content(content(*args, **other), "cal.json", lacking)


def add(registry, *candidates):
    """Register them; their entries."""
    return [one.entry for one in registry.add(candidates)]
