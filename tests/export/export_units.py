"""Calibrations to export, and samples of the units that they are of."""

from __future__ import annotations

import json

import numpy as np
from hypothesis import strategies as st

from sagnac.calibration import Calibration, loads
from sagnac.sensors import correction, forward

G = 9.80665  # standard gravity, m/s^2
RATE = 100 * np.pi / 180
_READING = {"accel": "m/s^2", "gyro": "rad/s"}
_NONLINEAR = {"accel": ("k2", "k3", "kip", "kio", "kpo"), "gyro": ("d_ii", "d_oo", "d_ss", "d_io", "d_is", "d_os")}
_TERM_UNITS = {"k2": "s^2/m", "k3": "s^4/m^2", "kip": "s^2/m", "kio": "s^2/m", "kpo": "s^2/m"}


def unit_of(name: str, counts: bool) -> str:
    """Unit of a parameter as the file gives it (conventions: SI, or counts and ratios)."""
    kind, term, _ = name.split(".")
    reading = _READING[kind]
    if counts and term in ("bias", "scale_factor", "g_sensitivity"):
        return {"bias": "count", "scale_factor": f"count/({reading})", "g_sensitivity": "count/(m/s^2)"}[term]
    si = {"bias": reading, "scale_error": "1", "misalignment": "rad", "g_sensitivity": "rad*s/m"}
    if term in si:
        return si[term]
    return _TERM_UNITS.get(term, "rad*s/m" if len(term) == 3 else "rad*s^3/m^2")


def calibration(values: dict[str, float], *, sigma=None, covariance=None, **more) -> Calibration:
    """A calibration of these values; `more` are further keys of the file."""
    n = len(values)
    covariance = np.zeros((n, n)) if covariance is None else np.asarray(covariance)
    if sigma is not None:
        covariance = np.diag(np.broadcast_to(sigma, n) ** 2)
    counts = {k: any(name.startswith(f"{k}.scale_factor") for name in values) for k in _READING}
    return loads(
        json.dumps(
            {
                "schema": "sagnac/calibration/1",
                "method": "by hand",
                "parameters": [
                    {
                        "name": name,
                        "value": value,
                        "unit": unit_of(name, counts[name.split(".")[0]]),
                        "standard_uncertainty": float(np.sqrt(covariance[i, i])),
                    }
                    for i, (name, value) in enumerate(values.items())
                ],
                "covariance": covariance.tolist(),
                "fit": {
                    "chi2": 0.0, "degrees_of_freedom": 0, "residual_rms": 0.0, "converged": True, "iterations": 0
                },
                "site": {"gravity": 9.81},
                "software": {"version": "0"},
                "created": "2000-01-01T00:00:00+00:00",
                **more,
            }
        )
    )  # fmt: skip


def names(kind: str, *, full: bool, counts: bool, g: bool) -> list[str]:
    """Names of the linear parameters of a triad."""
    scale = "scale_factor" if counts else "scale_error"
    out = [f"{kind}.{scale}.{a}" for a in "xyz"] + [f"{kind}.bias.{a}" for a in "xyz"]
    out += [f"{kind}.misalignment.{i}{j}" for i in "xyz" for j in "xyz" if (i != j if full else i > j)]
    return out + [f"{kind}.g_sensitivity.{i}{j}" for i in "xyz" for j in "xyz"] * g


_SIZES = {
    # term: accelerometer, gyro; far more than any unit has, so that second orders show
    "scale_error": (0.05, 0.05),
    "misalignment": (0.03, 0.03),
    "bias": (1.0, 0.05),
    "g_sensitivity": (0.0, 1e-3),
    "k3": (1e-6, 0.0),
}


@st.composite
def units(draw, counts: bool | None = False, higher: bool = True, negative: bool = False):
    """Values of a unit's parameters and how its misalignments are meant."""
    in_counts = draw(st.booleans()) if counts is None else counts
    full, ratio, g, linear = (draw(st.booleans()) for _ in range(4))
    values: dict[str, float] = {}
    fraction = st.floats(-1, 1, allow_subnormal=False).map(lambda v: 0.0 if abs(v) < 1e-6 else v)
    for i, kind in enumerate(("accel", "gyro")):
        gain = draw(st.floats(500, 5000)) if in_counts else 1.0
        for name in names(kind, full=full, counts=in_counts, g=g and kind == "gyro"):
            term, part = name.split(".")[1], draw(fraction)
            if term == "scale_factor":
                sign = -1.0 if negative and part < -0.7 else 1.0
                values[name] = sign * gain * (1.0 + 0.1 * part)
            else:
                values[name] = part * _SIZES[term][i] * (gain if term in ("bias", "g_sensitivity") else 1.0)
        terms = (("d_i", "d_o", "d_s") if linear and kind == "gyro" else ()) + (
            draw(st.sampled_from([(), _NONLINEAR[kind]])) if higher else ()
        )
        for term in terms:
            size = _SIZES.get(term, (1e-4, 1e-3 if len(term) == 3 else 1e-5))[i]
            values |= {f"{kind}.{term}.{a}": size * draw(fraction) for a in "xyz"}
    return values, "input-axis" if ratio else "element"


def samples(cal: Calibration, n: int = 300, seed: int = 1):
    """Inputs up to 1 g and 100 deg/s of any direction, and what the unit says of them: force, rate, and readings by sensor."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(2, n, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    size = np.where(np.arange(n) % 2, 1.0, rng.uniform(0, 1, n))[:, None]  # every other one at the limit
    force, rate = G * direction[0] * size, RATE * direction[1] * size
    ratio = cal.misalignment == "input-axis"
    readings = {}
    for kind, inputs in (("accel", force), ("gyro", rate)):
        model = correction(cal.values(), kind, ratio=ratio)
        if model is not None:
            readings[kind] = forward(model, inputs, None if kind == "accel" else force)
    return force, rate, readings
