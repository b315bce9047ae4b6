"""The published centrifuge test [XU18] as plan and truth, shared by the tests."""

from __future__ import annotations

import math

import numpy as np

from sagnac.plan import Plan, Rig, Segment
from sagnac.recording import Recording, from_arrays
from sagnac.simulate.centrifuge import PERFECT, SimulatedCentrifuge, simulate

G = 9.80665
RATE = math.pi
RADIUS = 10 * G / RATE**2
DEG_H = math.pi / 648000
THREE = (0.0, math.pi / 2, math.pi)
Z = ("accel_z",)
ACCELS = ("accel_x", "accel_y", "accel_z")
DENSITY = {"accel": 2.5e-5 * G / math.sqrt(1000.0), "gyro": 0.01 * 60.0 * DEG_H}
"""2.5e-5 g in each sample at 1000 Hz; 0.01 deg/sqrt(h), which is 0.6 deg/h in one second."""

# methods, section 3: accelerometer z and gyro x of the worked example
ACCEL_Z = {
    "accel.bias.z": 6.310e-3 * G,
    "accel.scale_error.z": -1.1e-3,
    "accel.k2.z": 1.2e-5 / G,
    "accel.k3.z": 3e-6 / G**2,
    "accel.kip.z": 5e-6 / G,
    "accel.misalignment.zx": 0.001478,
    "accel.misalignment.zy": 0.00126,
}
GYRO = {
    "bias": 7.3701 * DEG_H,
    "d_i": 1.0830 * DEG_H / G,
    "d_o": 1.0830 * DEG_H / G,
    "d_s": 1.0830 * DEG_H / G,
    "d_ii": 0.0602 * DEG_H / G**2,
    "d_oo": 0.0753 * DEG_H / G**2,
    "d_ss": 0.0902 * DEG_H / G**2,
    "d_io": 0.0451 * DEG_H / G**2,
    "d_is": 0.0451 * DEG_H / G**2,
    "d_os": 0.0451 * DEG_H / G**2,
}
GYRO_X = {f"gyro.{term}.x": value for term, value in GYRO.items()}
ALL = {
    **ACCEL_Z,
    **{n.replace(".z", f".{a}"): v for n, v in ACCEL_Z.items() if n.endswith(".z") for a in "xy"},
    "accel.misalignment.yx": -1e-3,
    **{f"gyro.{term}.{a}": value for term, value in GYRO.items() for a in "xyz"},
}


def plan(gammas=THREE, rates=(RATE,), *, hold=2.0, move=10.0, phase=0.0, gimbals=None, gravity_uncertainty=0.0, **rig):
    """One segment of `hold` seconds for each gamma at each rate of the arm; `gimbals` gives alpha, beta and gamma instead."""
    settings = gimbals or [(0.0, 0.0, g) for g in gammas]
    segments, now = [], 5.0
    for rate in rates:
        for alpha, beta, gamma in settings:
            segments.append(
                Segment(
                    name=str(len(segments) + 1),
                    start=now,
                    stop=now + hold,
                    arm_rate=rate,
                    arm_phase=phase,
                    alpha=alpha,
                    beta=beta,
                    gamma=gamma,
                )
            )
            now += hold + move
    return Plan(
        latitude=math.radians(29.89),
        gravity=G,
        gravity_uncertainty=gravity_uncertainty,
        earth_rate=7.292e-5,
        rig=Rig(kind="centrifuge", **{"radius": RADIUS, **rig}),
        segment=tuple(segments),
    )


def changed(given: Plan, **keys) -> Plan:
    """A plan with other values in every segment; a function is asked segment by segment."""
    segments = [s.model_copy(update={k: v(s) if callable(v) else v for k, v in keys.items()}) for s in given.segment]
    return given.model_copy(update={"segment": tuple(segments)})


def on_rig(given: Plan, **keys) -> Plan:
    """A plan with other values in its rig."""
    return given.model_copy(update={"rig": given.rig.model_copy(update=keys)})


def record(
    given: Plan,
    truth=ACCEL_Z,
    axes=Z,
    *,
    rig: SimulatedCentrifuge = PERFECT,
    seed: int | None = 1,
    arm: bool = False,
    frequency: float = 1000.0,
) -> Recording:
    """Samples of a plan in memory; without seed without noise."""
    rng = None if seed is None else np.random.default_rng(seed)
    density = None if rng is None else DENSITY
    parts = list(simulate(given, truth, rig=rig, axes=axes, frequency=frequency, density=density, rng=rng))

    def joined(name):
        return None if getattr(parts[0], name) is None else np.concatenate([getattr(p, name) for p in parts])

    single = {a: np.concatenate([p.single[a] for p in parts]) for a in parts[0].single}
    column = {"arm": joined("arm")} if arm else None
    return from_arrays(joined("time"), joined("accel"), joined("gyro"), single=single or None, rig=column)
