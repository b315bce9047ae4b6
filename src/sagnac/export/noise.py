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


_ASK = (
    "`sagnac noise --into` finds noise in a log at rest and writes it into the calibration, a data sheet gives it too; "
)


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
    out = {}
    for kind, triad in canonical.triads.items():
        for name, each in (("density", triad.noise), ("random_walk", triad.walk)):
            if each is not None:
                out[f"{kind}_{name}"] = float(each.max())
    return out | dict(options.noise)


def complete(canonical: Canonical, options: Options) -> tuple[dict[str, float], float]:
    """All four numbers, and the sample rate [Hz].

    Raises
    ------
    InputError
        With the options that give those that are missing.
    """
    out = known(canonical, options)
    if options.rate is not None and len(out) == len(UNITS):
        return out, options.rate
    likely = _likely(canonical)
    absent = [name for name in UNITS if name not in out]
    write = [
        f"--noise {name}='{f'{likely[name][0]:.3g}' if name in likely else '...'} {UNITS[name]}'" for name in absent
    ]
    ask = "" if all(name in likely for name in absent) else _ASK
    reasons = "".join(f"; {name} of {likely[name][0]:.3g}: {likely[name][1]}" for name in absent if name in likely)
    if options.rate is None:
        absent, write = [*absent, "sample rate"], [*write, "--rate '200 Hz'"]
    raise InputError(
        f"the target needs what the calibration does not state: {', '.join(absent)}. {ask}write {' '.join(write)}{reasons}"
    )


def _likely(canonical: Canonical) -> dict[str, tuple[float, str]]:
    """Random walks that may be stated where none was seen, and where they are from."""
    return {
        f"{kind}_random_walk": (float(triad.likely_walk.value.max()), triad.likely_walk.reason)
        for kind, triad in canonical.triads.items()
        if triad.likely_walk is not None
    }
