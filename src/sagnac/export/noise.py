"""The four noise numbers of visual-inertial software, from the calibration and the options."""

from __future__ import annotations

from collections.abc import Mapping

from .. import units
from ..errors import InputError
from .canonical import Canonical
from .record import Options

UNITS = {
    "accel_density": "m/s^2/sqrt(Hz)",
    "accel_random_walk": "m/s^3/sqrt(Hz)",
    "gyro_density": "rad/s/sqrt(Hz)",
    "gyro_random_walk": "rad/s^2/sqrt(Hz)",
}
"""Names of the numbers and their SI units."""


def parse(pairs: Mapping[str, str]) -> dict[str, float]:
    """SI values of texts such as ``gyro_random_walk`` = ``2e-6 rad/s^2/sqrt(Hz)``.

    Raises
    ------
    InputError
        When a name is unknown, or a text is no positive quantity of its kind.
    """
    out = {}
    for name, text in pairs.items():
        if name not in UNITS:
            raise InputError(f"--noise {name}: there are {', '.join(UNITS)}")
        given = units.quantity(text, f"--noise {name}")
        try:
            out[name] = float(given.to(units.quantity(f"1 {UNITS[name]}").units).magnitude)
        except Exception as cause:  # pint's errors share no base with each other
            raise InputError(f"--noise {name}: {text!r} is not in {UNITS[name]} or a unit of that kind") from cause
        if not out[name] > 0:
            raise InputError(f"--noise {name}: {text!r} must be more than zero")
    return out


def known(canonical: Canonical, options: Options) -> dict[str, float]:
    """Those numbers that are given or stated; of the three axes of a triad the noisiest counts."""
    out = {
        f"{kind}_density": float(triad.noise.max())
        for kind, triad in canonical.triads.items()
        if triad.noise is not None
    }
    return out | dict(options.noise)


def complete(canonical: Canonical, options: Options) -> tuple[dict[str, float], float]:
    """All four numbers, and the sample rate [Hz].

    Raises
    ------
    InputError
        With the options that give those that are missing.
    """
    out = known(canonical, options)
    missing = {name: f"--noise {name}='... {unit}'" for name, unit in UNITS.items() if name not in out}
    if options.rate is None:
        missing["sample rate"] = "--rate '200 Hz'"
    if missing or options.rate is None:
        raise InputError(
            f"the target needs what the calibration does not state: {', '.join(missing)}. A data sheet or an Allan deviation "
            f"gives noise; write {' '.join(missing.values())}"
        )
    return out, options.rate
