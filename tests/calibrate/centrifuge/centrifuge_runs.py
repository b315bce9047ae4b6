"""Noisy runs on a centrifuge, and how far a result may lie from their truth."""

from __future__ import annotations

import numpy as np
from centrifuge_case import (
    ACCEL_Z,
    DENSITY,
    G,
    Z,
)

from sagnac.simulate.centrifuge import SimulatedCentrifuge, simulate_harmonics

# methods, section 3: Cramer-Rao bound with 2.5e-5 g a sample, 1000 Hz, one turn at each of gamma = 0, pi/2, pi, in g
BOUND = {
    "accel.k2.z": 1.05e-8 / G,
    "accel.k3.z": 2.7e-9 / G**2,
    "accel.kip.z": 1.5e-8 / G,
    "accel.misalignment.zx": 5.6e-8,
    "accel.misalignment.zy": 4.6e-8,
    "accel.bias.z": 3.7e-7 * G,
    "accel.scale_error.z": 2.1e-7,
}
MOUNT = {"rig.mount.x": 1e-3, "rig.mount.y": -2e-3, "rig.mount.z": 5e-4}
TURNED = SimulatedCentrifuge(mount=(1e-3, -2e-3, 5e-4))


def drawn(given, truth=ACCEL_Z, axes=Z, *, seed=1, **keys):
    """Harmonics of a noisy run."""
    rng = np.random.default_rng(seed)
    return simulate_harmonics(given, truth, axes=axes, density=DENSITY, rng=rng, **keys)


def errors(found, truth):
    """Errors in standard uncertainties, by name."""
    return {p.name: (p.value - truth[p.name]) / p.standard_uncertainty for p in found.parameters}


def within(found, truth, limit=4.5):
    """No error beyond chance: 4.5 standard uncertainties are exceeded once in 150 000."""
    off = {n: z for n, z in errors(found, truth).items() if abs(z) > limit}
    assert not off, off
    assert found.fit.p_value > 1e-3
