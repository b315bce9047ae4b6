"""Calibration files of a fleet that drifts, for the page about the registry.

Run as ``python docs/examples/fleet.py FOLDER``. Eight units of model LG-1, six to ten calibrations each over about as many years;
biases drift and wander, unit 0003 was repaired in 2022. The covariance of each file has correlations.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from sagnac.calibration import Calibration, Fit, Site, UnitName, named
from sagnac.earth import normal_gravity
from sagnac.results import Software, covariance_rows

MG, DEG_H = 9.80665e-3, np.radians(1 / 3600)
TERMS = {  # unit, level, drift a year, walk over a year, standard uncertainty
    "accel.bias": ("m/s^2", 0.5 * MG, 0.03 * MG, 0.02 * MG, 0.01 * MG),
    "accel.scale_error": ("1", 1e-4, 5e-6, 3e-6, 2e-6),
    "gyro.bias": ("rad/s", 0.02 * DEG_H, 0.0005 * DEG_H, 0.0010 * DEG_H, 0.001 * DEG_H),
}
NAMES = [f"{term}.{axis}" for term in TERMS for axis in "xyz"]
UNITS, LEVEL, DRIFT, WALK, SIGMA = (list(column) for column in zip(*(TERMS[n[:-2]] for n in NAMES), strict=True))


def calibrations(rng: np.random.Generator, serial: str, *, repaired: bool = False) -> list[Calibration]:
    """The history of one unit."""
    years = np.cumsum(np.r_[rng.uniform(0, 1), rng.uniform(0.8, 1.2, rng.integers(5, 10))])
    walk = np.cumsum(np.sqrt(np.diff(years, prepend=years[0]))[:, None] * rng.standard_normal((years.size, 9)), axis=0)
    level = np.array(LEVEL) * rng.standard_normal(9) + np.array(DRIFT) * rng.standard_normal(9) * years[:, None]
    level += np.array(WALK) * walk
    if repaired:
        level[years > 6, 0] += 0.3 * MG
    mix = np.eye(9) + 0.3 * rng.standard_normal((9, 9))
    mix *= (np.array(SIGMA) / np.linalg.norm(mix, axis=1))[:, None]
    return [
        Calibration(
            method="norm",
            unit=UnitName(model="LG-1", serial=serial),
            parameters=named(NAMES, UNITS, level[k] + mix @ rng.standard_normal(9), mix @ mix.T),
            covariance=covariance_rows(mix @ mix.T),
            fit=Fit(chi2=80.0, degrees_of_freedom=84, residual_rms=1.0, converged=True, iterations=4),
            rig={"kind": "turntable", "angle_uncertainty": "1 arcmin"},
            site=Site(latitude=0.84, gravity=normal_gravity(0.84, 0.0)),
            software=Software(version="0.1"),
            created=(datetime(2016, 1, 8, 9, tzinfo=UTC) + timedelta(days=round(365.25 * t))).isoformat(),
        )
        for k, t in enumerate(years)
    ]


def main(folder: Path) -> None:
    """Write the files."""
    rng = np.random.default_rng(2)
    for unit in range(1, 9):
        for made in calibrations(rng, f"{unit:04d}", repaired=unit == 3):
            made.save(folder / f"{made.unit.serial}-{made.created[:4]}.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
