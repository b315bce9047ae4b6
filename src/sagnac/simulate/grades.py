"""Grades of units: how far the units of a type scatter, and their noise, as published.

A unit of a grade is drawn with the seed: every coefficient from a normal distribution with the standard deviation below. Sources:

``mems``
    Bosch BMI088 (data sheet BST-BMI088-DS001): offsets 20 mg and 1 deg/s, their temperature coefficients 0.2 mg/K and
    0.015 deg/s/K, sensitivity within 1 %, its temperature coefficients 0.002 %/K and 0.03 %/K, cross-axis sensitivity 0.5 %
    and 1 %, g-sensitivity 0.1 deg/s/g, noise 175 ug/sqrt(Hz) and 0.014 deg/s/sqrt(Hz), bias instability of the gyros 2 deg/h.
``tactical``
    Sensonor STIM300 (data sheet TS1524, 10 g accelerometers): offsets 0.75 mg and 250 deg/h, bias over temperature 2 mg and
    5 deg/h over 125 K, scale 300 ppm and 500 ppm, misalignment 1 mrad, g-sensitivity 1 deg/h/g, non-linearity 100 ppm of
    10 g, random walks 0.06 m/s/sqrt(h) and 0.15 deg/sqrt(h), bias instability 0.05 mg and 0.5 deg/h.
``navigation``
    Honeywell HG9900 (brochure N61-1638): biases 25 ug and 0.0035 deg/h, scale 100 ppm and 5 ppm, random walk
    0.002 deg/sqrt(h). The rest is that of the quartz accelerometers and ring laser gyros of this class: noise
    10 ug/sqrt(Hz), second-order coefficient 20 ug/g^2, misalignment 0.1 mrad, temperature coefficients 2 ug/K, 5 ppm/K,
    0.0002 deg/h/K, 0.1 ppm/K, bias instability 3 ug and 0.001 deg/h.

Data sheets give most of these as typical or largest values; here they are one standard deviation. Bias instabilities of
data sheets are the lowest point of the Allan deviation, 0.664 B.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..quantities import si
from ..sensors import AXES, TERMS
from ..sensors.axis import unit_of
from .noise import NoiseModel

_FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Lowest Allan deviation of flicker noise over B, IEEE Std 952."""

_SPREAD: dict[str, dict[str, str]] = {
    "mems": {
        "accel.bias": "20 mg",
        "accel.scale_error": "1 %",
        "accel.misalignment": "5 mrad",
        "gyro.bias": "1 deg/s",
        "gyro.scale_error": "1 %",
        "gyro.misalignment": "10 mrad",
        "gyro.d_i": "0.1 deg/s/g",
        "gyro.d_o": "0.1 deg/s/g",
        "gyro.d_s": "0.1 deg/s/g",
        "rig.mount": "10 mrad",
    },
    "tactical": {
        "accel.bias": "0.75 mg",
        "accel.scale_error": "300 ppm",
        "accel.misalignment": "1 mrad",
        "accel.k2": "10 ug/g^2",
        "gyro.bias": "250 deg/h",
        "gyro.scale_error": "500 ppm",
        "gyro.misalignment": "1 mrad",
        "gyro.d_i": "1 deg/h/g",
        "gyro.d_o": "1 deg/h/g",
        "gyro.d_s": "1 deg/h/g",
        "rig.mount": "1 mrad",
    },
    "navigation": {
        "accel.bias": "25 ug",
        "accel.scale_error": "100 ppm",
        "accel.misalignment": "0.1 mrad",
        "accel.k2": "20 ug/g^2",
        "gyro.bias": "0.0035 deg/h",
        "gyro.scale_error": "5 ppm",
        "gyro.misalignment": "0.1 mrad",
        "rig.mount": "0.5 mrad",
    },
}
_SLOPES: dict[str, dict[str, str]] = {
    "mems": {
        "accel.bias": "0.2 mg/K",
        "accel.scale_error": "20 ppm/K",
        "gyro.bias": "0.015 deg/s/K",
        "gyro.scale_error": "300 ppm/K",
    },
    "tactical": {
        "accel.bias": "16 ug/K",
        "accel.scale_error": "5 ppm/K",
        "gyro.bias": "0.04 deg/h/K",
        "gyro.scale_error": "5 ppm/K",
    },
    "navigation": {
        "accel.bias": "2 ug/K",
        "accel.scale_error": "5 ppm/K",
        "gyro.bias": "0.0002 deg/h/K",
        "gyro.scale_error": "0.1 ppm/K",
    },
}
# white noise, lowest point of the Allan deviation
_NOISE: dict[str, dict[str, tuple[str, str]]] = {
    "mems": {"accel": ("175 ug/sqrt(Hz)", "20 ug"), "gyro": ("0.014 deg/s/sqrt(Hz)", "2 deg/h")},
    "tactical": {"accel": ("0.06 m/s/sqrt(h)", "0.05 mg"), "gyro": ("0.15 deg/sqrt(h)", "0.5 deg/h")},
    "navigation": {"accel": ("10 ug/sqrt(Hz)", "3 ug"), "gyro": ("0.002 deg/sqrt(h)", "0.001 deg/h")},
}

GRADES = tuple(_SPREAD)
"""Names of the grades."""
FAMILIES = frozenset(
    f"{kind}.{term}" for kind, terms in TERMS.items() for term in (*terms, "scale_error", "misalignment")
) | {"rig.mount"}
"""Names without axis, which stand for all axes."""


@dataclass(frozen=True)
class Grade:
    """One grade, SI.

    Attributes
    ----------
    spread : dict of str to float
        Standard deviation of each coefficient by its name, ``accel.bias.x``.
    slopes : dict of str to float
        The same of temperature coefficients, per kelvin.
    noise : dict of str to NoiseModel
        ``accel`` and ``gyro``.
    """

    spread: dict[str, float]
    slopes: dict[str, float]
    noise: dict[str, NoiseModel]


@lru_cache(maxsize=8)
def grade(name: str) -> Grade:
    """A grade by its name, one of :data:`GRADES`."""
    spread = {full: si(text, _unit(term), text) for term, text in _SPREAD[name].items() for full in names_of(term)}
    slopes = {
        full: si(text, f"{_unit(term)}/K", text) for term, text in _SLOPES[name].items() for full in names_of(term)
    }
    noise = {}
    for sensor, (density, floor) in _NOISE[name].items():
        unit = {"accel": "m/s^2", "gyro": "rad/s"}[sensor]
        noise[sensor] = NoiseModel(si(density, f"{unit}/Hz^0.5", density), si(floor, unit, floor) / _FLOOR)
    return Grade(spread, slopes, noise)


def names_of(term: str) -> list[str]:
    """Full names of a coefficient of all axes; accelerometers define the frame, so that theirs is lower triangular."""
    kind, _, what = term.partition(".")
    if what != "misalignment":
        return [f"{term}.{a}" for a in AXES]
    pairs = [(i, j) for i in range(3) for j in range(3) if (i > j if kind == "accel" else i != j)]
    return [f"{term}.{AXES[i]}{AXES[j]}" for i, j in pairs]


def draw(name: str, rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """Coefficients and temperature coefficients of one unit of a grade.

    Parameters
    ----------
    name : str
    rng : numpy Generator

    Returns
    -------
    parameters, slopes : dict of str to float, SI
    """
    model = grade(name)
    parameters = {full: size * float(rng.standard_normal()) for full, size in model.spread.items()}
    return parameters, {full: size * float(rng.standard_normal()) for full, size in model.slopes.items()}


def unit_of_name(name: str) -> str:
    """SI unit of a coefficient by its full name.

    Raises
    ------
    ValueError
        When there is no coefficient of that name.
    """
    kind, _, rest = name.partition(".")
    term, _, axes = rest.rpartition(".")
    if kind == "rig" and term == "mount" and axes in AXES and len(axes) == 1:
        return "rad"
    if kind not in TERMS or not axes or set(axes) - set(AXES):
        raise ValueError(_unknown(name))
    pair = len(axes) == 2
    if term == "g_sensitivity" and kind == "gyro" and pair:
        return "rad*s/m"
    if term == "misalignment":
        if name not in names_of(f"{kind}.misalignment"):
            detail = " (accelerometers define the frame: yx, zx, zy; turn the unit with rig.mount)" if pair else ""
            raise ValueError(_unknown(name) + detail)
        return "rad"
    if len(axes) != 1 or term not in {*TERMS[kind], "scale_error"}:
        raise ValueError(_unknown(name))
    return unit_of(kind, term)


def _unit(term: str) -> str:
    kind, _, what = term.partition(".")
    return "rad" if kind == "rig" else unit_of(kind, what)


def _unknown(name: str) -> str:
    return f"{name!r} is no coefficient (accel.bias.x, accel.k2.z, gyro.misalignment.xy, gyro.d_ii.x, rig.mount.x, ...)"
