"""Benchmarks: ours against a plain baseline in the same run, best of several, alternating. ``make bench`` prints the table.

Figures are CPU seconds of this process; ratios above one are in our favour. Nothing is asserted about time; that both sides
give the same answer is.
"""

from __future__ import annotations

import time
from unittest import mock

import numpy as np
from scipy.optimize import least_squares

import allan
import bags
import campaign
import harmonics
import lanes
import plain
import readers
import registry
import simulate
import strapdown
from sagnac.calibrate import common, hand_turned, norm, table
from sagnac.kernels.rotation import integrate
from sagnac.observe.means import segment_means
from sagnac.observe.static import moving_variance
from sagnac.plan import Plan
from sagnac.recording import from_arrays
from sagnac.sensors import Correction
from sagnac.simulate.hand import simulate_hand_turned
from sagnac.simulate.plans import table_plan
from sagnac.simulate.table import imperfect_table, simulate_readings, simulate_recording
from sagnac.simulate.unit import laser_gyro_unit


def race(ours, baseline, repeats=5):
    """Best CPU time of each and both answers."""
    best = [np.inf, np.inf]
    answers = [None, None]
    for _ in range(repeats):
        for i, job in enumerate((ours, baseline)):
            start = time.process_time()
            answers[i] = job()
            best[i] = min(best[i], time.process_time() - start)
    return best, answers


def hand_turned_log():
    """512 s at 100 Hz, 38 attitudes: the size of the public Xsens recording."""
    accel = Correction("accel", np.diag([414.5, 412.1, 414.5]), np.full(3, 33000.0), counts=True)
    gyro = Correction("gyro", np.diag([4781.0, 4766, 4768]), np.full(3, 32700.0), 0.5 * np.eye(3), counts=True)
    return simulate_hand_turned(
        accel,
        gyro,
        np.random.default_rng(1),
        attitudes=38,
        rest=7.0,
        turn=5.0,
        first_rest=50.0,
        accel_noise=3.0,
        gyro_noise=23.0,
    )


def rotation_kernel(log):
    clock, accel, gyro = log
    force = (accel - 33000.0) / 414.0
    args = clock, gyro, force, np.eye(3) / 4770, np.full(3, 32700.0), np.zeros((3, 3))
    first, last = np.arange(5000, 49000, 1200), np.arange(5500, 49500, 1200)
    best, (a, b) = race(lambda: integrate(*args, first, last), lambda: plain.integrate(*args, first, last))
    assert all(np.allclose(x, y, rtol=1e-10, atol=1e-10) for x, y in zip(a, b, strict=True))
    return "rotations with derivative, 18500 samples", "vectorised NumPy", best


def variance(log):
    values = np.hstack(log[1:])
    best, (a, b) = race(lambda: moving_variance(values, 101), lambda: plain.moving_variance(values, 101), 3)
    assert np.allclose(a, b, rtol=1e-6)
    return "moving variance, 51000 x 6 samples", "NumPy sliding windows", best


def whole_hand_turned(log):
    recording = from_arrays(*log, counts=("accel", "gyro"))
    site = Plan(gravity=9.80665)

    def ours():
        return hand_turned.calibrate(recording, site)

    def baseline():
        with (
            mock.patch("sagnac.kernels.rotation.integrate", plain.integrate),
            mock.patch("sagnac.observe.static.moving_variance", plain.moving_variance),
        ):
            return hand_turned.calibrate(recording, site)

    best, (a, b) = race(ours, baseline, 4)
    assert np.allclose([p.value for p in a.parameters], [p.value for p in b.parameters], rtol=1e-6, atol=1e-8)
    return "hand-turned calibration, whole library call", "the same on the plain twins", best


def norm_fit():
    """200 norm calibrations of accelerometers, 12 positions; the baseline solves for all 33 unknowns with SciPy."""
    unit = laser_gyro_unit()
    plan = table_plan(unit, dwell=1.0, turning=0.0)
    rng = np.random.default_rng(0)
    runs = [simulate_readings(unit, plan, imperfect_table(plan, rng), rng) for _ in range(20)]
    sigma = unit.accel_density

    def baseline():
        return [plain.norm_by_scipy(m.mean["accel"], plan.gravity, sigma, least_squares) for m in runs]

    def ours():
        return [norm.solve(m, plan).fit.value for m in runs]

    best, (a, b) = race(ours, baseline, 3)
    assert np.allclose(a, b, rtol=0, atol=1e-3 * 7e-6 * 10)  # a hundredth of the bound of the scale factors
    return "norm fit with covariances, 20 runs of 12 positions", "SciPy least_squares, all unknowns", best


def table_campaign():
    """1000 joint calibrations, 12 positions static and turning; the baseline runs 4 of them, with all 106 unknowns."""
    unit = laser_gyro_unit()
    plan = table_plan(unit, dwell=1.0, turning=1.0, move=1.0)
    rng = np.random.default_rng(0)
    runs = [simulate_readings(unit, plan, imperfect_table(plan, rng), rng) for _ in range(1000)]
    sigma = {"accel": unit.accel_density, "gyro": unit.gyro_density}

    def ours(some):
        return [table.calibrate_means(m, plan) for m in some]

    def baseline():
        angles, left = common.need_angles(runs[0], "table"), common.left_of(runs[0], common.rates_of(runs[0]))
        return [plain.table_by_scipy(m.mean, sigma, plan, angles, left, least_squares) for m in runs[:4]]

    best, (a, b) = race(lambda: ours(runs[:4]), baseline, 2)
    for one, other in zip(a, b, strict=True):
        found = one.values()
        matrix = np.eye(3) + other[9:18].reshape(3, 3)
        misalignments = [found[f"gyro.misalignment.{p}"] for p in ("xy", "xz", "yx", "yz", "zx", "zy")]
        assert np.allclose(misalignments, matrix[~np.eye(3, dtype=bool)], rtol=0, atol=1e-8)
    start = time.process_time()
    ours(runs)
    spent = time.process_time() - start
    return (
        "1000 joint table calibrations, with covariances",
        "SciPy, all unknowns (4 runs, x 250)",
        [spent, 250 * best[1]],
    )


def means():
    """A 2.3 h table recording at 50 Hz."""
    unit = laser_gyro_unit()
    unit = type(unit)(**{**vars(unit), "pulses": {}})
    plan = table_plan(unit)
    rng = np.random.default_rng(0)
    clock, samples = simulate_recording(unit, plan, imperfect_table(plan, rng), rng)
    recording = from_arrays(clock, samples["accel"], samples["gyro"])
    best, (a, b) = race(lambda: segment_means(recording, plan), lambda: plain.segment_means(clock, samples, plan), 4)
    assert np.allclose(a.mean["gyro"], b["gyro"], rtol=0, atol=1e-14)
    return "segment means, noise and checks, 400000 x 6 samples", "NumPy means and variances", best


def main() -> None:
    log = hand_turned_log()
    rows = [rotation_kernel(log), variance(log), whole_hand_turned(log), norm_fit(), table_campaign(), means()]
    print(f"| {'job':<52} | {'ours [ms]':>9} | {'baseline [ms]':>13} | {'ratio':>6} | {'baseline':<34} |")
    print(f"|{'-' * 54}|{'-' * 10}:|{'-' * 14}:|{'-' * 7}:|{'-' * 36}|")
    for name, against, (ours, baseline) in rows:
        print(
            f"| {name:<52} | {ours * 1e3:>9.1f} | {baseline * 1e3:>13.1f} | {baseline / ours:>6.1f} | {against:<34} |"
        )
    print()
    harmonics.main()
    print()
    simulate.main()
    print()
    strapdown.main()
    print()
    lanes.main()
    print()
    readers.main()
    print()
    bags.main()
    print()
    campaign.main(1000)
    print()
    allan.main()
    print()
    registry.main()


if __name__ == "__main__":
    main()
