"""VINS-Mono and VINS-Fusion: the noise of the IMU, lines for the configuration file.

``vins_estimator/src/factor/integration_base.h`` takes the numbers for standard deviations of single samples: white noise of
one sample, density times the root of the rate, and of the bias the change from sample to sample over the sample interval.
"""

from __future__ import annotations

import math

from . import noise
from .canonical import Canonical
from .loss import lost, nothing
from .record import Exported, Options
from .wording import comments, encoded, header, plain, real

_FIELDS = {
    "acc_n": ("accel_density", "m/s^2, of one sample"),
    "gyr_n": ("gyro_density", "rad/s, of one sample"),
    "acc_w": ("accel_random_walk", "m/s^3, of one sample interval"),
    "gyr_w": ("gyro_random_walk", "rad/s^2, of one sample interval"),
}


def build(canonical: Canonical, options: Options) -> Exported:
    """The lines of the configuration file; nothing is corrected.

    Raises
    ------
    InputError
        When a number is not known.
    """
    numbers, rate = noise.complete(canonical, options)
    dropped = lost(canonical.triads, {kind: nothing() for kind in canonical.triads})
    remarks = (
        "VINS states noise and corrects nothing but the biases that it estimates: hand it compensated samples (`sagnac apply`)",
        f"the noise is that of samples at {rate:g} Hz",
    )
    lines = ["%YAML:1.0", *comments(header(canonical, dropped, remarks))]
    for field, (name, meaning) in _FIELDS.items():
        lines += [f"# {meaning}", f"{field}: {real(numbers[name] * math.sqrt(rate))}"]
    lines += [f"# {_gravity(canonical)}", f"g_norm: {real(canonical.calibration.site.gravity)}"]
    return Exported({"": encoded(lines)}, dropped, remarks)


def _gravity(canonical: Canonical) -> str:
    """What the gravity of the file is."""
    source = canonical.calibration.site.gravity_source
    return plain("m/s^2, gravity where the unit was calibrated" + (f" ({source})" if source else ""))
