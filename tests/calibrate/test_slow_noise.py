"""Slow noise that a plan states: it weighs the means of segments, and chi-square and intervals come out right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sagnac.calibrate import common, multi_position, norm
from sagnac.calibrate.slow import SlowNoise, slow_noise
from sagnac.observe.means import segment_means
from sagnac.plan import Noise, Plan, Rig, Segment, Unit
from sagnac.recording import from_arrays
from sagnac.rigs.turntable import TableErrors
from sagnac.simulate.noise import AxisNoise, NoiseModel
from sagnac.simulate.plans import ICOSAHEDRON, table_plan
from sagnac.simulate.table import SimulatedTable, simulate_readings
from sagnac.simulate.unit import laser_gyro_unit

UG, DEG_H = 9.80665e-6, math.pi / 648000
UNIT = laser_gyro_unit(accel_density=20 * UG, gyro_density=0.06 * DEG_H)
STEP = 1.0  # s


def slow_plan(noise: Noise, order=None):
    plan = table_plan(UNIT, ICOSAHEDRON, dwell=60.0, turning=72.0)
    segments = plan.segment
    if order is not None:  # the same times, positions in another order, each kind among its own
        static = [s for s in segments if not s.turn_rate]
        moved = iter([static[i] for i in order])
        segments = tuple(
            next(moved).model_copy(update={"start": s.start, "stop": s.stop}) if not s.turn_rate else s
            for s in segments
        )
    unit = plan.unit.model_copy(update={"noise": noise})
    rig = Rig(angle_uncertainty=0.0)
    return plan.model_copy(update={"rig": rig, "unit": unit, "segment": segments, "gravity": plan.site_gravity})


def wandering(plan, model: dict[str, NoiseModel], seed: int) -> dict[str, np.ndarray]:
    """Means of slow noise over the segments, (n, 3) a sensor."""
    end = max(s.stop for s in plan.segment)
    out = {}
    for number, (sensor, own) in enumerate(model.items()):
        means = np.zeros((len(plan.segment), 3))
        for k in range(3):
            series = np.zeros(math.ceil(end / STEP) + 1)
            AxisNoise(own, STEP, seed, (number, k)).add(series)
            total = np.concatenate([[0.0], np.cumsum(series)])
            i = np.array([round(s.start / STEP) for s in plan.segment])
            j = np.array([round(s.stop / STEP) for s in plan.segment])
            means[:, k] = (total[j] - total[i]) / (j - i)
        out[sensor] = means
    return out


def readings(plan, model, seed):
    table = SimulatedTable(TableErrors(), np.zeros((len(plan.segment), 3)))
    means = simulate_readings(UNIT, plan, table, np.random.default_rng(seed))
    slow = wandering(plan, model, seed)
    return replace(means, mean={s: v + slow[s] for s, v in means.mean.items()})


BAND = (1.0, 1e5)
FLICKER = {"accel": NoiseModel(instability=15 * UG, band=BAND), "gyro": NoiseModel(instability=0.03 * DEG_H, band=BAND)}
WALK = {"accel": NoiseModel(walk=0.6 * UG), "gyro": NoiseModel(walk=1e-3 * DEG_H)}
STATED = {
    "flicker": Noise(accel=20 * UG, gyro=0.06 * DEG_H, accel_instability=15 * UG, gyro_instability=0.03 * DEG_H),
    "walk": Noise(accel=20 * UG, gyro=0.06 * DEG_H, accel_walk=0.6 * UG, gyro_walk=1e-3 * DEG_H),
}
MODEL = {"flicker": FLICKER, "walk": WALK}


@pytest.mark.parametrize("kind", ["flicker", "walk"])
def test_the_variance_of_the_means_is_what_simulation_gives(kind):
    """Means less their mean over the test, 400 runs of three axes: mean square against the formula, to five sampling errors."""
    plan = slow_plan(STATED[kind])
    means = readings(plan, MODEL[kind], 0)
    stated = common.slow_variance(means, plan, "accel")
    length = np.array([s.stop - s.start for s in plan.segment])
    squares = []
    for seed in range(400):
        slow = wandering(plan, {"accel": MODEL[kind]["accel"]}, seed)["accel"]
        about = np.average(slow, axis=0, weights=length)
        squares.append(np.mean((slow - about) ** 2))
    found, error = np.mean(squares), np.std(squares) / math.sqrt(len(squares))
    assert abs(found - stated.mean()) < 5.0 * error + 0.03 * stated.mean()


def test_without_slow_terms_nothing_changes():
    plan = slow_plan(Noise(accel=20 * UG, gyro=0.06 * DEG_H))
    means = readings(plan, FLICKER, 1)
    assert not common.slow_variance(means, plan, "accel").any()
    assert common.noise_of(means, plan, "accel").density.shape == (3,)


def test_slow_terms_of_each_axis_weigh_that_axis():
    noise = Noise(accel=(20 * UG, 20 * UG, 40 * UG), accel_instability=(0.0, 15 * UG, 0.0), gyro=0.06 * DEG_H)
    plan = slow_plan(noise)
    means = readings(plan, FLICKER, 1)
    density = common.noise_of(means, plan, "accel").density
    assert np.allclose(density[:, [0, 2]], [20 * UG, 40 * UG])
    whole = means.segments[-1].stop - means.segments[0].start
    expected = (20 * UG) ** 2 + means.duration * (15 * UG) ** 2 / math.pi * np.log(whole / means.duration)
    assert np.allclose(density[:, 1] ** 2, expected, rtol=1e-12)


def test_the_calibration_names_the_slow_terms():
    plan = slow_plan(STATED["flicker"])
    found = norm.calibrate_means(readings(plan, FLICKER, 2), plan)
    assert found.noise["accel"].instability == pytest.approx((15 * UG,) * 3)
    assert found.noise["accel"].walk is None


def test_slow_noise_alone_stated_is_not_counted_twice():
    """Density as sixteen blocks of each segment show it, with what is expected there of the slow noise: the white noise again."""
    both = STATED["walk"]
    alone = both.model_copy(update={"accel": None})
    plan = slow_plan(alone)
    means = replace(readings(plan, WALK, 1), noise_degrees_of_freedom=300.0)
    turned = np.array([s.turn_rate for s in plan.segment]) * means.duration
    own = slow_noise(plan, "accel")
    inside = own.blocks_density(means.duration, turned, 16)
    loud = replace(means, density=means.density | {"accel": np.sqrt((20 * UG) ** 2 + inside)})
    expected = common.noise_of(means, slow_plan(both), "accel").density
    np.testing.assert_allclose(common.noise_of(loud, plan, "accel").density, expected, rtol=1e-9)
    # all of it slow: half the density found is white at least
    less = replace(means, density=means.density | {"accel": 0.5 * np.sqrt(inside)})
    white = np.sqrt(inside / 16 + common.slow_variance(means, plan, "accel") * means.duration[:, None])
    np.testing.assert_allclose(common.noise_of(less, plan, "accel").density, white, rtol=1e-9)


def test_white_noise_beside_a_walk_is_found_in_blocks():
    """60 segments of a minute at rest, a walk that doubles the power of their blocks: the white noise to five sampling errors."""
    white, step, T = 20 * UG, 0.1, 60.0
    walk = 20 * UG / math.sqrt(SlowNoise(np.zeros(3), np.ones(3)).blocks_density(np.array([T]), np.zeros(1), 16)[0])
    time = (np.arange(60 * 600) + 0.5) * step
    accel = np.random.default_rng(8).normal(size=(time.size, 3)) * white / math.sqrt(step)
    for k in range(3):
        AxisNoise(NoiseModel(walk=walk), step, 9, (k,)).add(accel[:, k])
    spans = tuple(Segment(name=str(i), start=T * i, stop=T * (i + 1)) for i in range(60))
    plan = Plan(latitude=0.8, unit=Unit(noise=Noise(accel_walk=walk)), segment=spans)
    means = segment_means(from_arrays(time, accel + [0, 0, 9.8]), plan)
    assert means.density["accel"] == pytest.approx(white * math.sqrt(2.0), rel=0.15)
    slow = common.slow_variance(means, plan, "accel")[0] * T
    found = np.sqrt(common.noise_of(means, plan, "accel").density[0] ** 2 - slow)
    assert found == pytest.approx(white, rel=0.2)


def test_raw_counts_have_their_slow_noise_on_record_in_counts():
    """B and K as they have weighed: times the scale factor."""
    gain, plan = 2.0e6, slow_plan(STATED["flicker"])
    means = readings(plan, FLICKER, 2)
    found = {"accel": np.full(3, 20 * UG), "gyro": np.full(3, 0.07 * DEG_H)}
    means = replace(means, density=found, noise_degrees_of_freedom=300.0)
    counted = replace(
        means,
        mean=means.mean | {"gyro": gain * means.mean["gyro"]},
        density=means.density | {"gyro": gain * means.density["gyro"]},
        counts=frozenset({"gyro"}),
    )
    of = {
        c: multi_position.calibrate_means(m, plan, matrix="triangular").noise["gyro"]
        for c, m in enumerate((means, counted))
    }
    assert of[1].unit == "count/sqrt(Hz)"
    assert of[1].origin == of[0].origin == "recording"
    assert of[1].instability == pytest.approx(tuple(gain * v for v in of[0].instability), rel=1e-2)
    assert of[1].density == pytest.approx(tuple(gain * v for v in of[0].density), rel=1e-2)
    blind = replace(counted, noise_degrees_of_freedom=0.0)
    level = multi_position.calibrate_means(blind, plan, matrix="triangular").noise["gyro"]
    assert (level.origin, level.unit) == ("plan", "count/sqrt(Hz)")
    assert level.density == pytest.approx((gain * 0.06 * DEG_H,) * 3, rel=1e-2)


def runs(method, kind, stated, count):
    """Chi-square over its degrees of freedom in the mean, and normalised errors of all parameters, (count, k).

    The bias is that of the test: the slow noise's mean over the segments that it was found from belongs to it.
    """
    ratio, z = [], []
    shuffle = np.random.default_rng(3)
    for seed in range(count):
        plan = slow_plan(stated, shuffle.permutation(12))
        means, turning = readings(plan, MODEL[kind], seed), np.array([s.turn_rate != 0 for s in plan.segment])
        everything = np.ones(turning.size, dtype=bool)
        if method is norm:
            found, used = norm.calibrate_means(means, plan), {"accel": everything, "gyro": turning}
        else:
            found = multi_position.calibrate_means(means, plan, matrix="triangular")
            used = {"accel": ~turning, "gyro": everything}
        truth, slow = UNIT.truth(), wandering(plan, MODEL[kind], seed)
        for sensor, which in used.items():
            for a, mean in zip("xyz", slow[sensor][which].mean(axis=0), strict=True):
                truth[f"{sensor}.bias.{a}"] += float(mean)
        ratio.append(found.fit.chi2 / found.fit.degrees_of_freedom)
        sigma = dict(zip([p.name for p in found.parameters], found.fit.white or (), strict=True))
        z.append([(found[n].value - truth[n]) / sigma[n] for n in truth if n in sigma])
    return float(np.mean(ratio)), np.array(z)


@pytest.mark.statistical
@pytest.mark.parametrize("method", [norm, multi_position], ids=["norm", "multi-position"])
@pytest.mark.parametrize("kind", ["flicker", "walk"])
def test_chi_square_and_coverage_come_out_right(method, kind):
    """25 runs with positions in random order: 95 % intervals hold 93 % or more, and no parameter is far off.

    Chi-square is between 0.7 and 1.15 of its degrees of freedom, below one where a sensor is found from a part of the test only,
    over which slow noise wanders less. Stated as white noise alone, the same noise gives far more.
    """
    ratio, z = runs(method, kind, STATED[kind], 25)
    assert 0.7 < ratio < 1.15
    assert np.mean(np.abs(z) < 1.96) > 0.93
    assert np.all(np.sqrt(np.mean(z**2, axis=0)) < 1.8)
    blind, z = runs(method, kind, Noise(accel=20 * UG, gyro=0.06 * DEG_H), 8)
    assert blind > 2.0 * ratio
