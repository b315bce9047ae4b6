"""Calibrations to write certificates of, and what stands in these."""

from __future__ import annotations

import numpy as np

from sagnac.calibration import Calibration, Fit, Influence, Site, Software, UnitName, Value
from sagnac.report.document import Facts, Grid, Text, Verdict
from sagnac.results import covariance_rows

MG = 9.80665e-3
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"></svg>'


def made(values=((1.0 * MG, 0.1 * MG),), *, names=None, used="white", dof=10, segments=0, **more):
    """A calibration of accelerometer biases, uncorrelated."""
    names = names or [f"accel.bias.{'xyz'[i]}" for i in range(len(values))]
    sigma = np.array([s for _, s in values])
    influence = tuple(
        Influence(segment=f"s{i}", leverage=0.1, chi2=1.0, shift=0.5, parameter=names[0]) for i in range(segments)
    )
    fit = Fit(
        chi2=9.0,
        degrees_of_freedom=dof,
        residual_rms=1.0,
        converged=True,
        iterations=2,
        uncertainty=used,
        p_value=0.5,
        white=tuple(float(s) for s in sigma),
        influence=influence,
    )
    given = {
        "method": "norm",
        "unit": UnitName(model="unit", serial="7"),
        "fit": fit,
        "site": Site(gravity=9.81, gravity_source="given"),
        "software": Software(version="1.2.3"),
        "created": "2026-11-22T09:27:53+00:00",
        **more,
    }
    parameters = tuple(
        Value(name=n, value=v, unit="m/s^2", standard_uncertainty=s) for n, (v, s) in zip(names, values, strict=True)
    )
    return Calibration(parameters=parameters, covariance=covariance_rows(np.diag(sigma**2)), **given)


def sections(document):
    return {s.title: s for s in document.sections}


def facts(section):
    return {a: b for block in section.blocks if isinstance(block, Facts) for a, b in block.rows}


def table(section, caption):
    grid = next(b for b in section.blocks if isinstance(b, Grid) and caption in b.caption)
    return [dict(zip(grid.header, row, strict=True)) for row in grid.rows]


def words(section):
    return " ".join(b.text for b in section.blocks if isinstance(b, Text | Verdict))
