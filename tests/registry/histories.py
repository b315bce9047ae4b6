"""Histories of simulated units, without a registry."""

from __future__ import annotations

import numpy as np

from sagnac.registry import History, Parameter, Unit

YEAR = 31557600.0
START = np.datetime64("2015-03-01T10:00:00", "us")


def history_of(series, *, units=None) -> History:
    """A history from (item, Parameter, years (n,), values (n,), sigmas (n,)) in any number."""
    columns: dict[str, list] = {k: [] for k in ("item", "time", "calibration", "parameter", "value", "sigma")}
    parameters = sorted({s[1] for s in series}, key=lambda p: (p.name, p.unit, p.misalignment))
    for item, parameter, given, values, sigmas in sorted(series, key=lambda s: (s[0], parameters.index(s[1]))):
        years, order = np.sort(given), np.argsort(given, kind="stable")
        columns["item"] += [item] * len(years)
        columns["time"] += list(START + (np.asarray(years) * YEAR * 1e6).astype("timedelta64[us]"))
        columns["calibration"] += [1000 * item + round(100 * y) for y in years]
        columns["parameter"] += [parameters.index(parameter)] * len(years)
        columns["value"] += list(np.asarray(values)[order])
        columns["sigma"] += list(np.broadcast_to(sigmas, len(years))[order])
    items = {s[0] for s in series}
    return History(
        item=np.array(columns["item"], dtype=np.int64),
        time=np.array(columns["time"], dtype="datetime64[us]"),
        calibration=np.array(columns["calibration"], dtype=np.int64),
        parameter=np.array(columns["parameter"], dtype=np.int64),
        value=np.array(columns["value"], dtype=np.float64),
        standard_uncertainty=np.array(columns["sigma"], dtype=np.float64),
        parameters=tuple(parameters),
        units=units or {i: Unit(i, "demo RLG", f"{i:04d}") for i in items},
    )


def walk(rng, years, q: float):
    """A random walk of variance `q` a year at these times, from nothing; shape of the times (..., n)."""
    steps = np.sqrt(q * np.diff(years, axis=-1)) * rng.standard_normal(years[..., 1:].shape)
    return np.concatenate([np.zeros_like(years[..., :1]), np.cumsum(steps, axis=-1)], axis=-1)


def one(years, values, sigmas, name="accel.bias.x", unit="m/s^2", misalignment="") -> History:
    """One parameter of one unit."""
    return history_of([(1, Parameter(name, unit, misalignment), np.asarray(years, float), np.asarray(values), sigmas)])


def unit_of(rng, years, terms=("accel.bias", "gyro.bias")) -> History:
    """A unit with drifting accelerometers and wandering gyros."""
    series = []
    for term in terms:
        size, unit = (1e-4, "m/s^2") if term.startswith("accel") else (1e-8, "rad/s")
        for axis in "xyz":
            true = size * (rng.normal(0, 10) + rng.normal(0, 3) * years + walk(rng, years, 4.0))
            values = true + size * rng.standard_normal(len(years))
            series.append((1, Parameter(f"{term}.{axis}", unit), years, values, size))
    return history_of(series)
