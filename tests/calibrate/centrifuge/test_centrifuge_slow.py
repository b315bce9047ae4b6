"""Slow noise on a centrifuge: means as in all methods, harmonics by their own covariance, intervals that hold the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from centrifuge_case import ACCEL_Z, ACCELS, ALL, DENSITY, RATE, Z, changed, on_rig, plan, record

from sagnac.calibrate import common
from sagnac.calibrate.centrifuge import calibrate_harmonics
from sagnac.calibrate.centrifuge.prepare import harmonics_of, prepare
from sagnac.calibrate.slow import scatter_density
from sagnac.plan import Noise, Plan, Unit
from sagnac.recording import from_arrays
from sagnac.sensors.series import basis
from sagnac.simulate.centrifuge import simulate_harmonics
from sagnac.simulate.noise import AxisNoise, NoiseModel

UG = 9.80665e-6
STEP = 0.05  # s
NINE = tuple(np.linspace(0.0, math.pi, 9).tolist())
KINDS = {"flicker": NoiseModel(instability=3 * UG, band=(STEP, 3e4)), "walk": NoiseModel(walk=0.5 * UG)}
"""Biases that wander eight times as far from segment to segment as white noise carries the mean."""


def stating(given: Plan, **noise) -> Plan:
    return given.model_copy(update={"unit": Unit(noise=Noise(accel=DENSITY["accel"], **noise))})


def drawn(given, truth=ACCEL_Z, axes=Z, *, seed=1, **keys):
    return simulate_harmonics(given, truth, axes=axes, density=DENSITY, rng=np.random.default_rng(seed), **keys)


def task_of(given, run):
    return prepare(run, given, None, None, None)[0]


def test_without_slow_terms_there_are_none():
    given = stating(plan())
    assert task_of(given, drawn(given)).slow is None


def test_means_have_it_as_in_all_methods_and_harmonics_their_spectrum():
    given = stating(plan(rates=(RATE, 0.0), hold=40.0), accel_instability=3 * UG, accel_walk=0.1 * UG)
    run = drawn(given)
    task = task_of(given, run)
    np.testing.assert_allclose(task.slow[:, 0, 0, 0], common.slow_variance(run, given, "accel")[:, 2], rtol=1e-9)
    f = RATE / (2 * math.pi)
    density = (3 * UG) ** 2 / (2 * math.pi * f) + 2.0 * (0.1 * UG / (2 * math.pi * f)) ** 2  # mean of cosine and sine
    first = (task.slow[:3, 0, 1, 1] + task.slow[:3, 0, 2, 2]) / 2
    np.testing.assert_allclose(first, 2 / 40.0 * density, rtol=0.05)
    assert not task.slow[3:, 0, 1:].any()


def test_each_axis_has_its_own():
    given = stating(plan(), accel_instability=(0.0, 3 * UG, 6 * UG))
    slow = task_of(given, drawn(given, ALL, ACCELS)).slow
    assert not slow[:, 0].any()
    np.testing.assert_allclose(slow[:, 2], 4 * slow[:, 1], rtol=1e-12)


def test_the_terms_with_tau_taken_out_leave_the_plain_ones_covariance():
    """Least squares without these terms, from the coefficients with them and from the start; on samples and on cells: 1e-5."""
    given = changed(stating(plan(arm_continuous=True), accel_instability=3 * UG, accel_walk=UG), arm_phase=None)
    task = task_of(given, drawn(given, extended=True))
    assert task.extended
    both = task.plain_slow()
    direct = task_of(stating(plan(), accel_instability=3 * UG, accel_walk=UG), drawn(plan())).slow
    assert both.shape == direct.shape
    np.testing.assert_allclose(both, direct, rtol=1e-4, atol=1e-4 * np.abs(direct[..., 1:, 1:]).max())


def test_the_closed_form_counts_it_too():
    """What it adds to the covariance is that of the coefficients through the derivatives, by differences of the result."""
    quiet, loud = plan(), stating(plan(), accel_instability=3 * UG)
    run = drawn(quiet)
    few, many = (calibrate_harmonics(run, p, closed_form=True) for p in (stating(quiet), loud))

    def values(step, i, k):
        moved = run.coefficient.copy()
        moved[i, 0, k] += step
        found = calibrate_harmonics(replace(run, coefficient=moved), stating(quiet), closed_form=True)
        return np.array([p.value for p in found.parameters])

    step, slow = 1e-4, task_of(loud, run).slow[:, 0]
    added = np.zeros_like(many.matrix)
    for i in range(len(run.segments)):
        slopes = np.stack(
            [(values(step, i, k) - values(-step, i, k)) / (2 * step) for k in range(slow.shape[-1])], axis=1
        )
        added += slopes @ slow[i] @ slopes.T
    np.testing.assert_allclose(np.diag(many.matrix - few.matrix), np.diag(added), rtol=1e-4)
    # the bias is that of all means, and hardly anything of the harmonics
    k = [p.name for p in many.parameters].index("accel.bias.z")
    assert added[k, k] > 0.2 * slow[:, 0, 0].mean()


def test_found_noise_is_named_and_slow_noise_with_it():
    given = plan((0.0, 0.7, 1.5, 2.2, 3.0)).model_copy(update={"unit": Unit(noise=Noise(accel_walk=1e-3 * UG))})
    level = calibrate_harmonics(drawn(given, ALL, ACCELS), given).noise["accel"]
    assert level.origin == "recording"
    assert level.density == pytest.approx((DENSITY["accel"],) * 3, rel=0.1)
    assert level.walk == pytest.approx((1e-3 * UG,) * 3)


# -------------------------------------------------------------------------------------- the noise found in samples

WHITE = DENSITY["accel"]
LOUDER = "times as noisy about the harmonics as from sample to sample"


def walking(given, walk):
    """Samples of three turns in each of 18 segments whose bias walks, found without a plan that states so."""
    recording = record(given)
    (batch,) = recording.batches()
    noise = np.zeros(batch.time.size)
    AxisNoise(NoiseModel(walk=walk), 1e-3, 2, (2,)).add(noise)
    return harmonics_of(from_arrays(batch.time, single={"accel_z": batch.single["accel_z"] + noise}), given)


@pytest.fixture(scope="module")
def restless():
    given = plan(NINE + NINE[::-1], hold=6.0)
    return given, walking(given, 8 * UG)


def white_and_remarks(given, run, **noise):
    # where no slow noise is stated, the rates would be taken for other ones
    given = on_rig(given, rate_uncertainty=1e-5)
    task, remarks = prepare(run, given.model_copy(update={"unit": Unit(noise=Noise(**noise))}), None, None, None)
    return math.sqrt(task.variance[0, 0] * run.interval[0]), [r for r in remarks if LOUDER in r]


def test_slow_noise_alone_stated_is_not_counted_twice(restless):
    """The density found has what is expected of the walk taken out, but not below what there is from sample to sample."""
    given, run = restless
    ((axis, times),) = run.louder.items()
    assert axis == "accel_z"
    assert times > 1.3
    assert run.density[0] == pytest.approx(times * run.least_density[0])
    assert run.least_density[0] == pytest.approx(WHITE, rel=0.05)
    white, remarks = white_and_remarks(given, run, accel_walk=8 * UG)
    turns = (run.rate * run.duration).tolist()
    parts = [scatter_density(arc, 6.0, run.order, 16, extended=run.extended) for arc in turns]
    inside = (8 * UG) ** 2 * np.mean([walk for _, walk, _ in parts])
    least = run.least_density[0] ** 2
    assert white == pytest.approx(math.sqrt(max(run.density[0] ** 2 - inside, least)), rel=1e-3)
    assert white == pytest.approx(WHITE, rel=0.15)
    assert remarks == []
    # far more is stated than there is: no less white noise than from sample to sample
    assert white_and_remarks(given, run, accel_walk=100 * UG)[0] == run.least_density[0]


def test_what_slow_noise_explains_is_no_larger_noise(restless):
    given, run = restless
    assert white_and_remarks(given, run, accel=WHITE, accel_walk=8 * UG) == (pytest.approx(WHITE), [])
    # stated as white noise alone: the remark says which noise is used
    assert (LOUDER in run.remarks[0], "the larger noise is used" in run.remarks[0]) == (True, True)
    white, (remark,) = white_and_remarks(given, run)
    assert white == pytest.approx(run.density[0])
    assert remark == run.remarks[0]
    white, (remark,) = white_and_remarks(given, run, accel=0.9 * run.density[0])
    assert white == pytest.approx(0.9 * run.density[0])
    assert remark.endswith("the noise stated in the plan is used")
    white, (remark,) = white_and_remarks(given, run, accel=0.1 * run.density[0])
    assert white == pytest.approx(run.density[0])
    assert remark.endswith("the larger noise is used")


# ------------------------------------------------------------------------------------------------------ statistics


def wandering(run, given, model, seed):
    """Coefficients of slow noise in every segment, and its means."""
    end = max(s.stop for s in given.segment)
    series = np.zeros(math.ceil(end / STEP) + 1)
    AxisNoise(model, STEP, seed, (0,)).add(series)
    time = (np.arange(series.size) + 0.5) * STEP
    out, means = [], []
    for i, s in enumerate(run.segments):
        at = (time >= s.start) & (time < s.stop)
        terms = basis(run.phase[i] + run.rate[i] * (time[at] - run.mid_time[i]), run.order)
        out.append(np.linalg.lstsq(terms, series[at], rcond=None)[0])
        means.append(series[at].mean())
    return np.array(out), float(np.mean(means))


def runs_of(kind, *, stated, runs):
    """Errors in standard uncertainties (runs, k), chi-square over freedom, and squared errors over their number where white."""
    model, rng = KINDS[kind], np.random.default_rng(5)
    own = {"accel_instability": model.instability, "accel_walk": model.walk} if stated else {}
    times, chi2, squares = [], [], []
    for seed in range(runs):
        given = stating(plan(tuple(rng.permutation(NINE).tolist()), hold=20.0), **own)
        run = simulate_harmonics(given, ACCEL_Z, axes=Z, density=DENSITY, rng=rng)
        slow, mean = wandering(run, given, model, seed)
        found = calibrate_harmonics(replace(run, coefficient=run.coefficient + slow[:, None]), given)
        # the bias that is found is that of the test
        truth = ACCEL_Z | {"accel.bias.z": ACCEL_Z["accel.bias.z"] + mean}
        error = np.array([p.value - truth[p.name] for p in found.parameters])
        times.append(error / [p.standard_uncertainty for p in found.parameters])
        chi2.append(found.fit.chi2 / found.fit.degrees_of_freedom)
        if found.fit.uncertainty == "white":
            squares.append(error @ np.linalg.solve(found.matrix, error) / error.size)
    return np.array(times), np.array(chi2), np.array(squares)


@pytest.mark.statistical
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_the_truth_with_slow_noise_stated(kind):
    """60 runs, settings in random order: coverage of 95 % intervals, chi-square, squared errors."""
    times, chi2, squares = runs_of(kind, stated=True, runs=60)
    assert 0.92 < np.mean(np.abs(times) < 1.96) < 0.985
    assert 0.9 < chi2.mean() < 1.1
    assert 0.7 < squares.mean() < 1.2


@pytest.mark.statistical
def test_as_white_noise_alone_the_same_noise_gives_far_more():
    _, chi2, squares = runs_of("flicker", stated=False, runs=10)
    assert chi2.min() > 5.0
    assert squares.size == 0
